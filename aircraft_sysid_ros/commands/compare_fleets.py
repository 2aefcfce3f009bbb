"""``compare`` of two fleets, or of two airframes of one."""

from __future__ import annotations

import argparse
from typing import Any

from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.side_by_side import airframes_side_by_side, fleets_side_by_side


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Raises InputError."""
    if args.airframes and args.other is None:
        return airframes_side_by_side(args.run, *args.airframes)
    if args.other is None or args.airframes:
        raise InputError(
            f"{args.run} is a fleet: compare it with another one (--with FLEET2), or two airframes (--airframes A B)"
        )
    return fleets_side_by_side(args.run, args.other)


def render(result: dict[str, Any]) -> str:
    """The result for people: what differs, then how much there was to look at."""
    a, b = result["between"]
    rows = [row for row in result["parameters"] if row["differs"]]
    lines = [f"a: {a}", f"b: {b}", ""]
    if rows:
        widths = [max(len(row[key]) for row in rows) for key in ("airframe", "parameter")]
        head = f"{'airframe':<{max(widths[0], 8)}}  {'parameter':<{max(widths[1], 9)}}"
        lines.append(f"{head}{'a':>12}{'b':>12}{'b - a':>12}{'std. error':>12}  flights, p")
        lines += [_line(row, max(widths[0], 8), max(widths[1], 9)) for row in rows]
    rate, count = 100.0 * result["false_discovery_rate"], len(result["parameters"])
    lines.append(
        f"{len(rows)} of {count} parameters differ; of those named, at most {rate:.0f} % do not, on average"
        if rows
        else f"none of {count} parameters differs by more than chance explains"
    )
    return "\n".join([*lines, *note_lines(result.get("notes", ()))])


def _line(row: dict[str, Any], of_airframe: int, of_parameter: int) -> str:
    numbers = (*row["value"], row["difference"], row["std_difference"])
    flights = f"{row['flights'][0]} in both" if row["paired"] else f"{row['flights'][0]} and {row['flights'][1]}"
    text = "".join(f"{number:>12.4g}" for number in numbers)
    return (
        f"{row['airframe']:<{of_airframe}}  {row['parameter']:<{of_parameter}}{text}  {flights}, p {row['p_value']:.1g}"
    )
