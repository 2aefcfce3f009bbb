"""``import``: the flight log of another program as a recording with our topics."""

from __future__ import annotations

import argparse
from typing import Any

from aircraft_sysid_ros.after_flight.log_import import KINDS, guess_columns, import_log
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.options import add_servos
from aircraft_sysid_ros.errors import InputError


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "import", help="a log of another program to a recording", description=__doc__
    )
    parser.add_argument(
        "log",
        metavar="SOURCE",
        help=f"{' '.join(KINDS)} file, a bag of MAVROS topics or px4_msgs; with --map or --guess any bag, a table, or "
        "a folder of tables: CSV, TSV, columns between blanks, Parquet, HDF5, .mat, .xlsx",
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
    add_servos(
        parser,
        "what servo outputs and airspeed of an autopilot mean (YAML); without it no control surfaces. "
        "For tables that an autopilot wrote, only its outputs are read",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a recording that is there")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Import; returns what was found, mapped and missing. Raises InputError."""
    if args.guess:
        if args.out:
            raise InputError("--guess writes a MAP and imports nothing: leave --out out")
        return guess_columns(args.log, args.guess, calibration=args.servos, overwrite=args.overwrite)
    return import_log(args.log, args.out, columns=args.map, calibration=args.servos, overwrite=args.overwrite)


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
