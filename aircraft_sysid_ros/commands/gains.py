"""``gains``: trim, feed-forward and first gains of the roll and pitch rate loops of PX4 or ArduPlane, from a run.

Refused where the uncertainty of the parameters allows an unstable loop: docs/export.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from aircraft_sysid_ros.commands.export import (
    about,
    add_model_options,
    check_travel,
    checked_out,
    chosen_model,
    full_deflection,
    late_of,
    notes_on,
    write,
)
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.export.autopilot_parameters import not_set
from aircraft_sysid_ros.export.gains import AUTOPILOTS, SUFFIXES, Gains, gains
from aircraft_sysid_ros.export.rate_loops import Actuator, actuator_of
from aircraft_sysid_ros.rounding import fixed, rounded_to_error

#: Longest lag and delay [s] of an actuator that is believed.
_LONGEST = 0.5


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "gains", help="first gains of an autopilot's rate loops", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    parser.add_argument("--to", required=True, choices=AUTOPILOTS, help="the autopilot")
    endings = ", ".join(f"{suffix} for {name}" for name, suffix in SUFFIXES.items())
    parser.add_argument("--out", metavar="FILE", help=f"parameter file to write: {endings}")
    for field in fields(Actuator):
        of_flight = f"the {field.name} of the surfaces that the flight shows or the aircraft file says, "
        usual = f"{'or' if field.name == 'lag' else 'at least'} {field.default}"
        parser.add_argument(
            f"--actuator-{field.name}", type=float, metavar="S",
            help=f"{field.name} from command to surface [s] (default: {of_flight}{usual})",
        )  # fmt: skip
    add_model_options(parser)
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Design, and write where asked. Raises InputError."""
    full = full_deflection(args.full_deflection)
    if full is None:
        raise InputError(
            "gains need to know how far the surfaces go: give --full-deflection E,A,R, the degrees of elevator, "
            "aileron and rudder at full command"
        )
    asked = {name: value for name in ("lag", "delay") if (value := getattr(args, f"actuator_{name}")) is not None}
    if not all(1e-3 <= value <= _LONGEST for value in asked.values()):
        raise InputError(f"--actuator-lag and --actuator-delay must be from 0.001 to {_LONGEST:g} s")
    out = None if args.out is None else checked_out(args.out, SUFFIXES[args.to], args.overwrite)
    opened = open_run(args.run)
    learnt = chosen_model(opened, args.model)
    check_travel(learnt, full)
    actuator = actuator_of(learnt.aircraft, opened.late_surfaces(learnt.aircraft))
    found = gains(learnt, args.to, full, replace(actuator, **asked))
    if out is not None:
        write(out, found.content, args.overwrite)
    made_for = "the loops are made for that, where --actuator-lag and --actuator-delay do not say otherwise"
    servos = [f"{late_of(opened, learnt)}: {made_for}"] if actuator != Actuator() else []
    loops = {
        loop.axis: {
            "gain_margin_db": 20.0 * float(np.log10(loop.gain_margin)),
            "phase_margin_deg": float(np.degrees(loop.phase_margin)),
            "crossover": loop.crossover,
            "stable_share": loop.stable_share,
        }
        for loop in found.loops
    }
    return {
        **about(learnt),
        "target": args.to,
        "gains": listed(found),
        "loops": loops,
        "file": None if out is None else str(out),
        "notes": [*notes_on(opened, learnt), *servos, *found.notes],
    }


def listed(found: Gains) -> list[dict[str, Any]]:
    """The parameters of the autopilot for programs; one with a ``doubt`` rests on what is not to be used: not set."""
    return [{"name": e.name, "value": e.value, "std": e.std, "what": e.what, "doubt": e.doubt} for e in found.entries]


def gain_lines(gains_listed: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line for each of ``listed``."""
    lines = []
    for e in gains_listed:
        value, std = rounded_to_error(e["value"], e["std"]) if np.isfinite(e["std"]) else (fixed(e["value"], 4), "")
        error = std and f" ± {std}"
        lines.append(f"{e['name']:<20}{value:>10}{error:<12}  {e['what']}{not_set(e['doubt'])}")
    return lines


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    lines = [f"model {result['model']}, {result['target']}", ""]
    lines += gain_lines(result["gains"])
    lines += ["", "learnt in this range; OUTSIDE OF IT THE GAINS ARE NOT KNOWN TO HOLD:"]
    lines += [f"  {line}" for line in result["range_words"]]
    lines += note_lines(result["notes"])
    return "\n".join([*lines, f"file {result['file']}"] if result["file"] else lines)
