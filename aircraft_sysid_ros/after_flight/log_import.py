"""The flight log of another program as a recording with our topics."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aircraft_sysid_ros.errors import InputError, echo

if TYPE_CHECKING:
    from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
    from aircraft_sysid_ros.recordings.imported_log import ImportedLog

BAGS = (".mcap", ".db3", ".bag")


def import_log(
    log: str | Path,
    out: str | Path | None,
    *,
    columns: str | Path | None = None,
    calibration: str | None = None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Write the recording ``out``; returns what was found, mapped and missing. Raises InputError.

    ``columns``: MAP of a stranger's tables; ``calibration``: what the servo outputs of an autopilot mean.
    """
    path = _there(log)
    if not out:
        raise InputError("give with --out where to write the recording")
    if calibration and (why := why_no_calibration(path, columns)):
        raise InputError(f"--servos is for logs of autopilots: {why}")
    if columns:
        return _import_tables(path, out, columns, overwrite)
    suffix = path.suffix.lower()
    if suffix == ".mat":
        from aircraft_sysid_ros.recordings.mat_import import import_mat  # scipy, only when it is used

        return import_mat(path, out, overwrite=overwrite)
    kind = suffix if suffix in _IMPORTERS else _kind_of(path)
    if not kind and holds_tables(path):
        return _import_known_tables(path, out, calibration, overwrite)
    importer = _import_bag if path.is_dir() or suffix in BAGS else _IMPORTERS.get(kind)
    if importer is None:
        raise _unknown(path)
    return _import_autopilot(path, importer, out, calibration, overwrite)


def why_no_calibration(log: Path, columns: str | Path | None) -> str:
    """Why a calibration file says nothing of a log; empty where it says what servo outputs mean."""
    if columns:
        return "the map itself gives units and signs"
    return "a .mat file needs none" if log.suffix.lower() == ".mat" else ""


def _there(log: str | Path) -> Path:
    path = Path(log)
    if not path.exists():
        raise InputError(f"there is no log {path}")
    return path


def _unknown(path: Path, why: str = "") -> InputError:
    """The error for what says not itself what it is."""
    return InputError(
        f"{path} cannot be imported: supported are {', '.join(KINDS)}, and bags; "
        f"tables need --map MAP.yaml, which `aircraft-sysid import {path} --guess MAP.yaml` begins{why}"
    )


def _kind_of(path: Path) -> str:
    """The usual end of the name of a log whose first bytes say what it is, whatever it is called; empty of others."""
    try:
        with path.open("rb") as file:
            head = file.read(max(map(len, _MAGIC)))
    except OSError:  # a folder, or what nobody may read: who reads it says so
        return ""
    return next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), "")


def holds_tables(path: Path) -> bool:
    """Whether a folder is no bag but holds tables, or a file is a table."""
    from aircraft_sysid_ros.recordings.tabular.source import is_table_file

    if not path.is_dir():
        return is_table_file(path)
    files = list(path.iterdir())
    is_bag = any(file.suffix in BAGS or file.name == "metadata.yaml" or ".db3" in file.name for file in files)
    return not is_bag and any(is_table_file(file) for file in files)


def holds_known_tables(folder: Path) -> bool:
    """Whether a folder holds tables whose names and columns say what they are; it is imported without a map."""
    from aircraft_sysid_ros.recordings.tabular.guess.first_map import is_known

    try:
        return folder.is_dir() and holds_tables(folder) and is_known(folder)
    except (InputError, OSError):
        return False


def _import_known_tables(path: Path, out: str | Path, calibration: str | None, overwrite: bool) -> dict[str, Any]:
    from aircraft_sysid_ros.recordings.tabular.guess.first_map import known_map
    from aircraft_sysid_ros.recordings.tabular.table_import import import_tables

    mapping = _outputs_of(calibration)
    try:
        known = known_map(path, mapping)
    except InputError as error:
        raise _unknown(path, f" ({error})") from None
    if known is None:
        raise _unknown(path)
    colmap, left_out = known
    report = import_tables(path, colmap, out, overwrite=overwrite)
    return {**report, "notes": [*left_out, *report["notes"]]}


def _outputs_of(calibration: str | None) -> ServoMapping | None:
    """A calibration file whose outputs alone are of use for tables. Raises InputError."""
    from dataclasses import replace

    from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping, load_servo_mapping

    if not calibration:
        return None
    mapping = load_servo_mapping(calibration)
    if replace(mapping, outputs={}) != ServoMapping():
        raise InputError(f"calibration file {calibration}: for tables only 'outputs' is read, put the rest into a map")
    return mapping


def guess_columns(
    log: str | Path, target: str | Path, *, calibration: str | None = None, overwrite: bool = False
) -> dict[str, Any]:
    """Write a first MAP of tables from names, units, values and physics; returns what it holds. Raises InputError."""
    from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map, report_of, write_map

    path, target = _there(log), Path(target)
    if target.exists() and not overwrite:
        raise InputError(f"{target} is already there: give another name or overwrite it (--overwrite)")
    first = guess_map(path, _outputs_of(calibration))
    write_map(first, target, path)
    return report_of(first, path, target)


def _import_tables(path: Path, out: str | Path, columns: str | Path, overwrite: bool) -> dict[str, Any]:
    from aircraft_sysid_ros.recordings.tabular.column_map import load_column_map
    from aircraft_sysid_ros.recordings.tabular.table_import import import_tables

    return import_tables(path, load_column_map(columns), out, overwrite=overwrite)


def _import_autopilot(
    path: Path,
    importer: Callable[[Path, ServoMapping | None], ImportedLog],
    out: str | Path,
    calibration: str | None,
    overwrite: bool,
) -> dict[str, Any]:
    from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
    from aircraft_sysid_ros.recordings.imported_log import write_log

    if path.resolve() == Path(out).resolve():
        raise InputError("--out must not be the log itself")
    mapping = load_servo_mapping(calibration) if calibration else None
    try:
        log = importer(path, mapping)
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (LookupError, TypeError, ValueError, OverflowError) as error:  # a name or a shape of another kind of message
        what = echo(f"{type(error).__name__}: {error}")
        raise InputError(f"{path} is damaged: a message in it does not match its type ({what})") from None
    return write_log(log, path, out, overwrite=overwrite)


def _import_ulog(path: Path, mapping: ServoMapping | None) -> ImportedLog:
    from aircraft_sysid_ros.recordings.ulog_import import import_ulog

    return import_ulog(path, mapping)


def _import_dataflash(path: Path, mapping: ServoMapping | None) -> ImportedLog:
    from aircraft_sysid_ros.recordings.dataflash_import import import_dataflash

    return import_dataflash(path, mapping)


def _import_tlog(path: Path, mapping: ServoMapping | None) -> ImportedLog:
    from aircraft_sysid_ros.recordings.tlog_import import import_tlog

    return import_tlog(path, mapping)


def _import_bag(path: Path, mapping: ServoMapping | None) -> ImportedLog:
    from aircraft_sysid_ros.recordings.autopilot_bag_import import import_autopilot_bag

    return import_autopilot_bag(path, mapping)


#: What imports a file of an autopilot, by the end of its name.
_IMPORTERS: dict[str, Callable[[Path, ServoMapping | None], ImportedLog]] = {
    ".ulg": _import_ulog,
    ".ulog": _import_ulog,
    ".bin": _import_dataflash,
    ".tlog": _import_tlog,
}
KINDS = (".mat", *_IMPORTERS)
#: First bytes of logs that are renamed now and then, and what they are.
_MAGIC = {b"\xa3\x95": ".bin", b"FMT,": ".bin", b"ULog\x01\x12\x35": ".ulg"}
