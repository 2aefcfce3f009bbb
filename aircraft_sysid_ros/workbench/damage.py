"""Which file of a run is damaged, and what to do: readers of a run say only that it is."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from aircraft_sysid_ros.run_folder import AIRCRAFT, ESTIMATES, PARAMETERS, POINTS, SAMPLES, STATE


def _text(path: Path) -> None:
    path.read_text(encoding="utf8")


def _json(*names: str) -> Callable[[Path], None]:
    def read(path: Path) -> None:
        content = json.loads(path.read_text(encoding="utf8"))
        for name in names:
            list(content[name])

    return read


def _arrays(*names: str) -> Callable[[Path], None]:
    def read(path: Path) -> None:
        with np.load(path) as stored:
            for name in names:
                len(stored[name])

    return read


#: What a reader of a run needs of its files; the last one is not needed to show a model.
_READERS: dict[str, Callable[[Path], None]] = {
    AIRCRAFT: _text,
    PARAMETERS: _json("parameters"),
    STATE: _json("accelerometer_bias", "gyro_bias"),
    SAMPLES: _arrays("stamp", "kind", "values"),
    POINTS: _arrays("stamp", "measured", "terms"),
    ESTIMATES: lambda path: None,
}


def damaged_files(folder: Path) -> list[str]:
    """What is wrong with which file, each in a few words; empty where all can be read."""
    return [f"{name} {wrong}" for name, reader in _READERS.items() if (wrong := _wrong(folder / name, reader))]


def _wrong(path: Path, reader: Callable[[Path], None]) -> str:
    try:
        if path.stat().st_size == 0:
            return "is empty"
        reader(path)
    except FileNotFoundError:
        return "is not there"
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    except (EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        return "is damaged"
    return ""


def said_of(path: str | Path, error: Exception) -> str:
    """The sentence of an error, with the files that are damaged in place of a run that is, and what to do."""
    is_run = any((Path(path) / name).exists() for name in _READERS)
    about = "is damaged" in str(error) or "is no run" in str(error)
    wrong = damaged_files(Path(path)) if is_run and about else []
    if not wrong:
        return str(error)
    return (
        f"the run {path} is damaged, {' and '.join(wrong)}: replay the recording again with --out {path} --overwrite, "
        "or copy that file back"
    )
