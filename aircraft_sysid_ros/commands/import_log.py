"""``import``: the flight log of another program as a recording with our topics."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.errors import InputError


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "import", help="a log of another program to a recording", description=__doc__
    )
    parser.add_argument("log", metavar="LOG", help=f"log to read ({', '.join(_IMPORTERS)})")
    parser.add_argument(
        "--out", required=True, metavar="BAG", help="rosbag2 folder to write, or a file NAME.mcap"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a recording that is there")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Import; returns what was found, mapped and missing. Raises InputError."""
    path = Path(args.log)
    if not path.exists():
        raise InputError(f"there is no log {path}")
    importer = _IMPORTERS.get(path.suffix.lower())
    if importer is None or not path.is_file():
        raise InputError(f"{path} cannot be imported: files that can are {', '.join(_IMPORTERS)}")
    return importer(path, args.out, args.overwrite)


def render(report: dict[str, Any]) -> str:
    """The report for people."""
    width = max(len(topic) for topic in report["topics"]) + 1
    lines = [
        f"{report['log']}: {report['format']}, {report['duration']:.1f} s from {report['start']}",
        f"{'topic':<{width}}  {'messages':>8}  {'rate':>6}  made of",
        *(
            f"/{topic:<{width - 1}}  {found['messages']:>8}  {found['rate']:>6.1f}  {found['source']}"
            for topic, found in report["topics"].items()
        ),
        "missing",
        *(f"  {name}: {why}" for name, why in report["missing"].items()),
        *(f"note: {note}" for note in report["notes"]),
        f"recording {report['out']}",
    ]
    return "\n".join(lines)


def _import_mat(path: Path, out: str, overwrite: bool) -> dict[str, Any]:
    from aircraft_sysid_ros.recordings.mat_import import import_mat  # scipy, only when it is used

    return import_mat(path, out, overwrite=overwrite)


#: What imports a file, by the end of its name.
_IMPORTERS: dict[str, Callable[[Path, str, bool], dict[str, Any]]] = {".mat": _import_mat}
