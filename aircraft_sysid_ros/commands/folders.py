"""A look at the folder that a page or a report is asked for, before what makes it is imported: that takes seconds."""

from __future__ import annotations

from pathlib import Path

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.run_reader import AIRCRAFT, CALIBRATION, not_a_run
from aircraft_sysid_ros.workbench.calibration_view import RESULT, is_calibration


def check_folder(path: str | Path) -> None:
    """Raises InputError where a folder is neither that of a run nor that of a calibration, or lacks what is shown."""
    folder = Path(path)
    if is_calibration(folder) or (folder / AIRCRAFT).exists():
        return
    if (folder / CALIBRATION).exists():
        raise InputError(
            f"{path} is a calibration without {RESULT}, which holds what is shown: calibrate again with --out {path} "
            "--overwrite, or copy that file back"
        )
    raise not_a_run(path)


def holds_runs(path: str | Path) -> bool:
    """Whether a folder is none of a run but has some in it."""
    folder = Path(path)
    if not folder.is_dir() or (folder / AIRCRAFT).exists():
        return False
    try:
        return any((each / AIRCRAFT).is_file() for each in folder.iterdir() if not each.name.startswith("."))
    except OSError:
        return False
