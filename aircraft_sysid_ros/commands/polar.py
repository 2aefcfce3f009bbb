"""``polar``: drag polar, efficiency of propulsion and power of level flight, from the energy of a flight.

Needs airspeed, height and the mass, no vane and no surface: what minimal logs have. docs/polar.md.
"""

from __future__ import annotations

import argparse
from typing import Any

from aircraft_sysid_ros.after_flight.drag_polar import LEAST_EXPLAINED, drag_polar
from aircraft_sysid_ros.commands.pictures import picture_lines
from aircraft_sysid_ros.report.polar_figure import draw_polar
from aircraft_sysid_ros.rounding import rounded_to_error, with_error

_MEANINGS = {
    "efficiency": "of propulsion, power to the air over power consumed",
    "CD0": "drag without lift",
    "k": "of C_L squared",
}


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "polar", help="drag polar from the energy of a flight", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    parser.add_argument(
        "--power", metavar="INPUT",
        help="input of the aircraft file with the power of propulsion [W], electric or at the shaft (without it: the "
        "thrust that was recorded)",
    )  # fmt: skip
    parser.add_argument(
        "--idle", type=float, metavar="W", default=0.0, help="part of that power with the motor off (default: 0)"
    )
    parser.add_argument("--gliding", action="store_true", help="the flight was without propulsion")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Fit and write. Raises InputError."""
    return drag_polar(args.run, draw_polar, args.power, args.idle, args.gliding)


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    (low, high), (slow, fast) = result["lift"], result["airspeed"]
    lines = [f"model {result['model']}: {result['time']:.0f} s of flight, C_L {low:.2f} to {high:.2f}", ""]
    for p in result["parameters"]:
        doubt = f"   {p['status']}  {p['reason']}".rstrip()
        value, std = rounded_to_error(p["value"], p["std"])
        lines.append(f"{p['name']:<12}{value:>9} ± {std:<9}{_MEANINGS[p['name']]:<54}{doubt}")
    lines += ["", f"the energy balance explains {result['explained']:.0%} of the power, where it was not fitted"]
    glide = result["best_glide"]
    if glide is not None:
        outside = "" if glide["inside"] else ", which was NOT FLOWN"
        lines.append(
            f"best glide {with_error(glide['ratio'], glide['std'])} at {glide['airspeed']:.1f} m/s "
            f"(C_L {glide['lift']:.2f}{outside})"
        )
    what = "power" if result["method"] == "power" else "power of thrust"
    level = result["level"]
    told = result["explained"] >= LEAST_EXPLAINED
    lines += ["", f"level flight at   {what}" if told else "too little is explained to give the power of level flight"]
    for at in range(0, len(level["airspeed"]), 4) if told else ():
        power, std = rounded_to_error(level["power"][at], level["std"][at])
        lines.append(f"{level['airspeed'][at]:>8.1f} m/s   {power:>8} ± {std} W")
    lines += ["", f"only between C_L {low:.2f} and {high:.2f}, {slow:.1f} and {fast:.1f} m/s"]
    return "\n".join([*lines, *picture_lines(result), f"file {result['file']}"])
