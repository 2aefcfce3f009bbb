"""``check``: a flight as data, before anything is estimated: what its sensors say of themselves and of each other."""

from __future__ import annotations

import argparse
import textwrap
from io import BytesIO
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.after_flight.check import check_recording
from aircraft_sysid_ros.commands.pictures import picture, picture_lines
from aircraft_sysid_ros.commands.progress import telling
from aircraft_sysid_ros.errors import IncompleteError, InputError
from aircraft_sysid_ros.flight_check.check import Checked, nothing_wrong
from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, SEVERITIES, WARNING, Finding, joined, short_names
from aircraft_sysid_ros.text_file import write_whole

_PAGES = (".html", ".htm")


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "check", help="the data of a flight, before anything is estimated", description=__doc__
    )
    parser.add_argument("bag", metavar="BAG", help="rosbag2 folder, .mcap, .db3 or .bag file")
    parser.add_argument(
        "--aircraft",
        metavar="FILE",
        help="aircraft file (YAML): its delays, lag and signs of surfaces are known, its named inputs and the terms of "
        "its model are checked (default: the textbook's 32)",
    )
    parser.add_argument(
        "--out", metavar="FILE", help="picture to write, .png, or a page with it, .html; one that is there is replaced"
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Check and draw; returns findings, rates and what can be identified.

    Raises InputError, or IncompleteError with all but the picture where that cannot be written.
    """
    _check_out(args.out)
    with telling() as tell:
        found = check_recording(args.bag, args.aircraft, tell)
        title = f"{args.bag}, {found.duration:.1f} s"
        figure, notes = picture(lambda: _draw(found.checked, args.out, title)) if args.out else (None, [])
    result = {**found.json, "figure": figure, "notes": [*found.notes, *notes]}
    if args.out and figure is None:
        raise IncompleteError(f"--out {args.out} is not written", result)
    return result


def _check_out(out: str | None) -> None:
    """Raises InputError where the picture cannot be written, before the work."""
    if out is None:
        return
    path = Path(out)
    if path.suffix.lower() not in (".png", *_PAGES):
        raise InputError(f"--out {out} is neither a picture nor a page: give it a name that ends in .png or .html")
    if not path.parent.is_dir():
        raise InputError(f"--out {out}: the folder {path.parent} is not there")


def _draw(checked: Checked, out: str, title: str) -> Path:
    """The picture, or the page with it; the file."""
    from aircraft_sysid_ros.report.check_figure import check_figure
    from aircraft_sysid_ros.report.check_page import check_page

    path = Path(out)
    content = BytesIO()
    check_figure(checked, content, title)
    if path.suffix.lower() in _PAGES:
        write_whole(path, check_page(checked, content.getvalue(), title))
    else:
        write_whole(path, content.getvalue())
    return path


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    findings = joined(Finding((f["signal"],), f["kind"], f["severity"], f["sentence"]) for f in result["findings"])
    counts = {severity: sum(f.severity == severity for f in findings) for severity in SEVERITIES}
    lines = [f"{result['recording']}: {result['duration']:.1f} s", ""]
    by_rate: dict[str, list[str]] = {}
    for name, rate in result["rates"].items():
        by_rate.setdefault(f"{rate:.3g} Hz" if rate == rate else "one sample", []).append(name)
    lines += [f"{rate:>12}  {short_names(tuple(names))}" for rate, names in by_rate.items()]
    lines += ["", *_parameter_lines(result)]
    lines += ["", *(f"{f.severity:<8}{f.kind:<10}{short_names(f.signals)}: {f.sentence}" for f in findings)]
    if not counts[ERROR] + counts[WARNING]:
        lines.append(nothing_wrong(result["duration"]))
    else:
        lines.append(f"{counts[ERROR]} errors, {counts[WARNING]} warnings, {counts[INFO]} notes")
    return "\n".join([*lines, *picture_lines(result)])


def _parameter_lines(result: dict[str, Any]) -> list[str]:
    """Those that the flight shows by name, the others with the reason; one line for those that share it."""
    shown = [name for name, is_shown in result["identifiable"].items() if is_shown]
    count = f"{len(shown)} of {len(result['identifiable'])} parameters"
    lines = [f"shown by measured signals alone: {count}; replay knows the states better and may show more"]
    lines += textwrap.wrap(" ".join(shown), 112, initial_indent="  ", subsequent_indent="  ")
    reasons: dict[str, list[str]] = {}
    for parameter in result["parameters"]:
        if not result["identifiable"][parameter["name"]]:
            reasons.setdefault(parameter["reason"], []).append(parameter["name"])
    return lines + [f"not shown: {' '.join(names)}: {reason}" for reason, names in reasons.items()]
