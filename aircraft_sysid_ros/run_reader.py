"""The files of a run: their names, how they are read, and which of them is damaged.

Much may be unknown in a run, and is null or NaN there: parameters that HOLD or REJECT, signals that are not measured
with the terms and predictions that read them, values of samples. What can be neither is refused: times, a parameter
with USE that has no value or standard error, a flight without one sound IMU sample.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.archives import is_bomb
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.options import EstimatorName
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.samples import REQUIRED_VALUES, Kind, Samples

Array = npt.NDArray[np.float64]

AIRCRAFT, PARAMETERS, STATE, POINTS, SAMPLES, ESTIMATES = (
    "aircraft.yaml", "parameters.json", "state.json", "points.npz", "samples.npz", "estimates.mcap",
)  # fmt: skip
#: What ``diagnose`` writes into a run.
DIAGNOSIS = "diagnosis.json"
#: What ``calibrate`` writes into its folder.
CALIBRATION, RESULT = "calibration.yaml", "result.json"
#: Begin of the note of a run whose samples a calibration has corrected.
#: Key of state.json.
CORRECTED_BY = "corrected_by"
#: Arrays of points.npz, besides the stamps, that a run is read with.
_OF_POINTS = ("measured", "valid", "terms", "signals", "signal_names")
#: What the readers below raise where a file is not there, cannot be read, or is not what it should be.
UNREADABLE = (
    OSError, EOFError, LookupError, TypeError, ValueError, AttributeError, RecursionError, MemoryError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip


class _Impossible(ValueError):
    """What a file holds that no run can hold, as a sentence goes on after the name of the file."""


def read_parameters(folder: Path) -> dict[str, dict[str, Any]]:
    """Parameters by name, as in parameters.json. Raises UNREADABLE."""
    listed = json.loads((folder / PARAMETERS).read_text(encoding="utf8"))["parameters"]
    parameters = {str(p["name"]): p for p in listed}
    for name, p in parameters.items():
        if p["status"] not in Trust.__members__:
            raise _Impossible(f"holds {name} with a status that is not one of {', '.join(Trust.__members__)}")
        if p["status"] == Trust.USE.name and not _are_finite(p["value"], p["std"]):
            raise _Impossible(f"holds {name} to USE without a finite value and standard error")
    return parameters


def estimator_of(folder: Path) -> EstimatorName:
    """The estimator that a run was asked for; that which is chosen by itself where nothing says so."""
    try:
        asked = json.loads((folder / PARAMETERS).read_text(encoding="utf8"))["estimator"]["asked"]
    except (*UNREADABLE, TypeError):  # said of that file
        asked = "auto"
    names: tuple[EstimatorName, ...] = get_args(EstimatorName)
    return asked if asked in names else "auto"


def late_surfaces_of(folder: Path) -> dict[str, tuple[float, float]]:
    """Delay or lag [s] of the surfaces that a run has shown, each with one sigma, where its aircraft file is silent."""
    try:
        said = json.loads((folder / PARAMETERS).read_text(encoding="utf8")).get("late_surfaces", {})
        found = {key: (float(said[key]["value"]), float(said[key]["std"])) for key in ("delay", "lag") if key in said}
    except UNREADABLE:  # said of that file
        return {}
    return {key: number for key, number in found.items() if _are_finite(*number)}


def lack_of_fit_of(folder: Path) -> dict[str, str]:
    """What the recursion said at the end of each axis, by its name, that its model does not explain.

    Empty for an older run. Raises UNREADABLE.
    """
    said = json.loads((folder / PARAMETERS).read_text(encoding="utf8")).get("lack_of_fit", {})
    return {str(axis): str(words) for axis, words in said.items()}


def std_of_sensors_of(folder: Path) -> dict[str, float]:
    """One sigma of what sensors that nobody described leave in doubt of each parameter of another estimator, by name.

    Empty for an older run. Raises UNREADABLE.
    """
    said = json.loads((folder / PARAMETERS).read_text(encoding="utf8")).get("std_of_sensors", {})
    return {str(name): float(std) for name, std in said.items()}


def corrected_note(calibration: str) -> str:
    """For a run whose samples are corrected by the file of a calibration."""
    return (f"its samples are corrected by the calibration {calibration}: what is found from them now is what that has "
            "left, and adds to it")  # fmt: skip


def correction_of(folder: Path) -> str:
    """The file of the calibration that the samples of a run are corrected by; empty where state.json names none."""
    try:
        return str(read_state(folder).get(CORRECTED_BY, ""))
    except UNREADABLE:  # said of that file
        return ""


def read_state(folder: Path) -> dict[str, Any]:
    """The content of state.json. Raises UNREADABLE."""
    state = json.loads((folder / STATE).read_text(encoding="utf8"))
    biases = [b for key in ("accelerometer_bias", "gyro_bias") for b in state[key] if b is not None]
    if not _are_finite(*biases):
        raise _Impossible("holds biases that are not finite")
    return dict(state)


def calm_air_of(folder: Path) -> bool:
    """Whether the air was taken as calm when a run was made; not where nothing says so."""
    try:
        return bool(read_state(folder).get("calm_air", False))
    except UNREADABLE:  # said of that file
        return False


def read_samples(folder: Path) -> Samples:
    """All samples, as they arrived: their stamps need not rise. Raises UNREADABLE."""
    with _arrays(folder / SAMPLES) as stored:
        stamp, kind, values = _stamps(stored["stamp"]), stored["kind"].astype(np.int64), stored["values"]
    of_imu = values[kind == Kind.IMU, : REQUIRED_VALUES[Kind.IMU]]
    if not np.isfinite(of_imu).all(axis=1).any():
        raise _Impossible("holds no IMU sample with finite numbers")
    return Samples(stamp, kind, values)


def read_points(folder: Path) -> dict[str, npt.NDArray[Any]]:
    """The arrays of points.npz. Raises UNREADABLE."""
    with _arrays(folder / POINTS) as stored:
        points = {name: stored[name] for name in stored.files}
    points["stamp"] = _stamps(points["stamp"])
    if np.any(np.diff(points["stamp"]) <= 0) and not _clock_leapt(folder):
        raise _Impossible("holds times that do not rise")
    lacking = [name for name in _OF_POINTS if name not in points]
    if lacking:
        raise _Impossible(f"lacks {' and '.join(lacking)}")
    measured, valid = points["measured"], points["valid"]
    if np.isinf(measured).any() or np.isnan(measured[valid]).any():
        raise _Impossible("holds measured coefficients that are not finite")
    return points


def _arrays(path: Path) -> Any:
    """What np.load opens."""
    if is_bomb(path):
        raise _Impossible("announces more than its size can hold")
    return np.load(path)


def _stamps(stamp: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    if not np.isfinite(stamp).all():
        raise _Impossible("holds times that are not finite")
    return stamp.astype(np.int64)


def _clock_leapt(folder: Path) -> bool:
    try:
        return bool(read_state(folder)["clock_restarts"])
    except UNREADABLE:  # said of that file
        return True


def _are_finite(*values: Any) -> bool:
    return all(value is not None and np.isfinite(float(value)) for value in values)


def _read_aircraft(folder: Path) -> None:
    (folder / AIRCRAFT).read_text(encoding="utf8")


#: Readers of what a run needs; ESTIMATES is not needed to show a model.
_READERS: dict[str, Callable[[Path], Any]] = {
    AIRCRAFT: _read_aircraft,
    PARAMETERS: read_parameters,
    STATE: read_state,
    SAMPLES: read_samples,
    POINTS: read_points,
    ESTIMATES: lambda folder: None,
}


def damaged_files(folder: Path) -> list[str]:
    """What is wrong with which file, each in a few words; empty where all can be read."""
    return [f"{name} {wrong}" for name in _READERS if (wrong := _wrong(folder, name))]


def _wrong(folder: Path, name: str) -> str:
    try:
        if (folder / name).stat().st_size == 0:
            return "is empty"
        _READERS[name](folder)
    except FileNotFoundError:
        return "is not there"
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    except _Impossible as error:
        return str(error)
    except UNREADABLE:
        return "is damaged"
    return ""


def journal_path(run: str | Path) -> Path:
    """The folder beside a run in which its flight is kept until the run is written."""
    path = Path(run)
    return path.with_name(f"{path.name}.flying")


def not_a_run(path: str | Path) -> InputError:
    """What to say of a folder that cannot be read as a run: which files are damaged, or that it is something else."""
    folder = Path(path)
    if not folder.exists() and journal_path(path).is_dir():
        return InputError(f"{path} was cut off in flight, or is being flown: aircraft-sysid recover {path}")
    if any((folder / name).exists() for name in _READERS):
        wrong = "".join(f", {text}" for text in [" and ".join(damaged_files(folder))] if text)
        return InputError(
            f"the run {path} is damaged{wrong}: replay the recording again with --out {path} --overwrite, "
            "or copy that file back"
        )
    if (folder / CALIBRATION).exists() or (folder / RESULT).exists():
        return InputError(f"{path} is a calibration and not a run: give the folder that replay or live has written")
    return InputError(f"{path} is not a run: make one with aircraft-sysid replay BAG --aircraft FILE --out RUN")
