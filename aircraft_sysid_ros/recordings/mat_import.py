"""MATLAB files of flights to recordings: which of the known kinds a file is shows in its content."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import inertialnav_mat, umn_mat
from aircraft_sysid_ros.recordings.imported_log import ImportedLog, write_log
from aircraft_sysid_ros.recordings.mat_file import Matlab73, read_mat

#: Variables that tell a kind of file, and what reads it.
_KINDS: tuple[tuple[tuple[str, ...], Callable[[dict[str, Any]], ImportedLog]], ...] = (
    (("flight_data",), umn_mat.import_flight_data),
    (("IMU_label", "GPS_label", "NTUN_label", "IMU", "GPS", "NTUN"), inertialnav_mat.import_labelled),
    (("angRate", "accel", "IMUtime", "GPStime", "LatDeg", "Veas"), inertialnav_mat.import_vectors),
)


def import_mat(path: str | Path, out: str | Path, *, overwrite: bool = False) -> dict[str, Any]:
    """Write the recording ``out`` from a .mat file; returns the report of write_log.

    Raises InputError for a file that cannot be read, is of no known kind, or lacks a channel.
    """
    content = _load(Path(path))
    for names, importer in _KINDS:
        if all(name in content for name in names):
            try:
                log = importer(content)
            except InputError as error:
                raise InputError(f"{path}: {error}") from None
            except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
                raise InputError(
                    f"{path} looks like {importer.__doc__} but lacks a channel or has another shape ({error})"
                ) from None
            return write_log(log, path, out, overwrite=overwrite)
    found = ", ".join(name for name in content if not name.startswith("__"))[:200]
    raise InputError(
        f"{path} is not a flight that can be imported: known are those of the UMN UAV Lab (flight_data) "
        "and of InertialNav (IMU, GPS, … with labels, or angRate, accel, …), "
        f"and it holds {found or 'nothing'}; tables of others need --map MAP.yaml, which --guess MAP.yaml begins"
    )


def _load(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(f"there is no file {path}")
    try:
        return read_mat(path)
    except Matlab73 as error:
        raise InputError(f"{error}: it needs --map MAP.yaml, which --guess MAP.yaml begins") from None
