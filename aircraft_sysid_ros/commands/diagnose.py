"""``diagnose``: which physical effect the model of a run lacks, with the evidence.

Several runs of one aeroplane are one body of evidence, and what changed between them is said, too.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from shlex import quote
from typing import Any

from aircraft_sysid_ros.after_flight.diagnose import diagnose
from aircraft_sysid_ros.commands.compare import percent
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.progress import telling
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT
from aircraft_sysid_ros.diagnosis.words import chosen_anew, headline


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "diagnose", help="which effect is missing", description=__doc__
    )
    parser.add_argument(
        "run", metavar="RUN", nargs="+",
        help="folder written by replay or live; several of one aeroplane and one model are judged together, and "
        "nothing is written into them",
    )  # fmt: skip
    parser.add_argument(
        "--replicas", type=int, default=COUNT, metavar="N",
        help="simulated flights without the effect, to compare the evidence with (default %(default)s)",
    )  # fmt: skip
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Diagnose; returns what ``--json`` prints and writes it into the run, where it is one. Raises InputError."""
    with telling("diagnose") as tell:
        return diagnose(args.run, args.replicas, tell)


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    lines = [f"model {result['model']}: {headline(result)}", ""]
    if "runs" in result:
        lines[1:] = [f"{len(result['runs'])} runs: {', '.join(result['runs'])}; held out: {result['held_out']}", ""]
    for candidate in result["candidates"]:
        lines += _about(candidate, result.get("file"))
    lines += [result["advice"], ""]
    lines += note_lines(result["notes"])
    if result.get("cannot_show"):
        unseen = "; ".join(f"{each['effect']} ({each['why']})" for each in result["cannot_show"])
        lines.append(f"this flight could not show: {unseen}")
    if result["replicas"]:
        lines.append(
            f"{result['tried']} effects tried, {result['replicas']} replicas; a flight with nothing missing is "
            f"given another verdict in at most {result['false_alarm_rate']:.0%} of cases"
        )
    else:
        count = result["tried"]
        lines.append(f"{count} {'input' if count == 1 else 'inputs'} checked, without replicas")
    return "\n".join(lines)


def _about(candidate: dict[str, Any], file: str | None) -> list[str]:
    mark = "*" if candidate["found"] else " "
    fall = f"{percent(candidate['error_before'])} to {percent(candidate['error_after'])} %"
    lines = [f"{mark} {candidate['label']}: error of {candidate['main_axis']} {fall}, p {candidate['p_value']:.1g}"]
    if candidate["name"] != candidate["label"]:
        lines.append(f"    {candidate['name']}. {candidate['physics']}")
    added = candidate["effect"] or f'"{candidate["expression"]}"'
    if candidate["found"] and file is not None and candidate.get("is_to_add", True):
        lines.append(f"    to add: aircraft-sysid add {quote(str(Path(file).parent))} {added}")
    elif candidate["expression"] and candidate["expression"] != candidate["label"]:
        lines.append(f"    to add: {added}")
    lines.append(f"    where: {candidate['where']}")
    if candidate.get("how_large"):
        lines.append(f"    how large: {candidate['how_large']}")
    if anew := chosen_anew(candidate):
        lines.append(f"    {anew}")
    if candidate["confounded_with"]:
        lines.append(f"    this flight cannot tell it from {', '.join(candidate['confounded_with'])}")
    if candidate.get("refused"):
        lines.append(f"    not named: {candidate['refused']}")
    return [*lines, ""]
