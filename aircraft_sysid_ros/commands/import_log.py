"""``import``: the flight log of another program as a recording with our topics."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.errors import InputError, echo

if TYPE_CHECKING:
    from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
    from aircraft_sysid_ros.recordings.imported_log import ImportedLog

BAGS = (".mcap", ".db3")


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "import", help="a log of another program to a recording", description=__doc__
    )
    parser.add_argument(
        "log",
        metavar="SOURCE",
        help=f"{' '.join(KINDS)} file, a bag of MAVROS topics or px4_msgs; with --map or --guess a table, or a folder "
        "of tables: CSV, TSV, columns between blanks, Parquet, HDF5, .mat, .xlsx",
    )
    parser.add_argument("--out", metavar="BAG", help="rosbag2 folder to write, or a file NAME.mcap")
    ways = parser.add_mutually_exclusive_group()
    ways.add_argument(
        "--map", metavar="MAP", help="which column is which signal, with unit and sign (YAML, docs/import.md)"
    )
    ways.add_argument(
        "--guess",
        metavar="MAP",
        help="write a first MAP from names, units, values and physics, to be checked and edited; nothing is imported",
    )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        help="what servo outputs and airspeed of an autopilot mean (YAML); without it no control surfaces",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a recording that is there")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Import; returns what was found, mapped and missing. Raises InputError."""
    path = Path(args.log)
    if not path.exists():
        raise InputError(f"there is no log {path}")
    if args.guess:
        return _guess(path, args)
    if not args.out:
        raise InputError("say with --out where the recording shall be written")
    if args.map:
        return _import_tables(path, args)
    suffix = path.suffix.lower()
    if suffix == ".mat":
        if args.calibration:
            raise InputError("--calibration is for logs of autopilots: a .mat file needs none")
        from aircraft_sysid_ros.recordings.mat_import import import_mat  # scipy, only when it is used

        return import_mat(path, args.out, overwrite=args.overwrite)
    if _holds_tables(path):
        return _import_known_tables(path, args)
    importer = _import_bag if path.is_dir() or suffix in BAGS else _IMPORTERS.get(suffix)
    if importer is None:
        raise _unknown(path)
    return _import_autopilot(path, importer, args)


def render(report: dict[str, Any]) -> str:
    """The report for people."""
    if "tables" in report:
        from aircraft_sysid_ros.recordings.tabular.guess.first_map import render_guess

        return render_guess(report)
    width = max(len(topic) for topic in report["topics"]) + 1
    lines = [
        f"{report['log']}: {report['format']}, {report['duration']:.1f} s from {report['start']}",
        f"{'topic':<{width}}  {'messages':>8}  {'rate':>6}  made of",
        *(
            f"/{topic:<{width - 1}}  {found['messages']:>8}  {found['rate']:>6.1f}  {found['source']}"
            for topic, found in report["topics"].items()
        ),
        *_found_lines(report["found"]),
        *(["missing"] if report["missing"] else []),
        *(f"  {name}: {why}" for name, why in report["missing"].items()),
        *note_lines(report["notes"]),
        f"recording {report['out']}",
    ]
    return "\n".join(lines)


def _found_lines(found: dict[str, dict[str, Any]]) -> list[str]:
    """Messages of the log by what became of them."""
    by_state: dict[str, list[str]] = {}
    for name, item in sorted(found.items()):
        by_state.setdefault(item["state"], []).append(f"{name} {item['messages']}")
    return [f"{state}: {', '.join(names)}" for state, names in by_state.items()]


def _unknown(path: Path, why: str = "") -> InputError:
    """The error for what says not itself what it is."""
    return InputError(
        f"{path} cannot be imported: files that can are {', '.join(KINDS)}, and bags; "
        f"tables need --map MAP.yaml, which --guess MAP.yaml begins{why}"
    )


def _holds_tables(path: Path) -> bool:
    """Whether a folder is no bag but holds tables, or a file is a table."""
    from aircraft_sysid_ros.recordings.tabular.source import is_table_file

    if not path.is_dir():
        return is_table_file(path)
    files = list(path.iterdir())
    is_bag = any(file.suffix in BAGS or file.name == "metadata.yaml" or ".db3" in file.name for file in files)
    return not is_bag and any(is_table_file(file) for file in files)


def _import_known_tables(path: Path, args: argparse.Namespace) -> dict[str, Any]:
    from aircraft_sysid_ros.recordings.tabular.guess.first_map import known_map
    from aircraft_sysid_ros.recordings.tabular.table_import import import_tables

    if args.calibration:
        raise InputError("--calibration is for logs of autopilots: say units and signs in a map")
    try:
        known = known_map(path)
    except InputError as error:
        raise _unknown(path, f" ({error})") from None
    if known is None:
        raise _unknown(path)
    colmap, left_out = known
    report = import_tables(path, colmap, args.out, overwrite=args.overwrite)
    return {**report, "notes": [*left_out, *report["notes"]]}


def _guess(path: Path, args: argparse.Namespace) -> dict[str, Any]:
    from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map, report_of, write_map

    if args.out or args.calibration:
        raise InputError("--guess writes a MAP and imports nothing: leave --out and --calibration out")
    target = Path(args.guess)
    if target.exists() and not args.overwrite:
        raise InputError(f"{target} is already there: give another name or overwrite it (--overwrite)")
    first = guess_map(path)
    write_map(first, target, path)
    return report_of(first, path, target)


def _import_tables(path: Path, args: argparse.Namespace) -> dict[str, Any]:
    from aircraft_sysid_ros.recordings.tabular.column_map import load_column_map
    from aircraft_sysid_ros.recordings.tabular.table_import import import_tables

    if args.calibration:
        raise InputError("--calibration is for logs of autopilots: say units and signs in a map")
    return import_tables(path, load_column_map(args.map), args.out, overwrite=args.overwrite)


def _import_autopilot(
    path: Path, importer: Callable[[Path, ServoMapping | None], ImportedLog], args: argparse.Namespace
) -> dict[str, Any]:
    from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
    from aircraft_sysid_ros.recordings.imported_log import write_log

    if path.resolve() == Path(args.out).resolve():
        raise InputError("--out must be another place than the log")
    mapping = load_servo_mapping(args.calibration) if args.calibration else None
    try:
        log = importer(path, mapping)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (LookupError, TypeError, ValueError, OverflowError) as error:  # a name or a shape of another kind of message
        what = echo(f"{type(error).__name__}: {error}")
        raise InputError(f"{path} is damaged: a message in it is not what its kind is ({what})") from None
    return write_log(log, path, args.out, overwrite=args.overwrite)


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
