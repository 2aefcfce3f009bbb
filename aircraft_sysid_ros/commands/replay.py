"""``replay``: the whole pipeline over recordings, as fast as the machine can, with the numbers of live."""

from __future__ import annotations

import argparse
from typing import Any

from aircraft_sysid_ros.after_flight.replay import ReplayOptions, replay
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.options import (
    add_estimator_options,
    add_prior_options,
    estimator_options,
    parameter_table,
    state_table,
)
from aircraft_sysid_ros.commands.progress import telling


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "replay", help="the whole pipeline over recordings", description=__doc__
    )
    parser.add_argument(
        "bags", nargs="+", metavar="BAG", help="rosbag2 folder, .mcap, .db3 or .bag file; several make one body of data"
    )
    parser.add_argument(
        "--segments",
        metavar="FILE",
        help="YAML list of {recording, start, stop, name}, in seconds: only these manoeuvres",
    )
    parser.add_argument("--aircraft", required=True, metavar="FILE", help="aircraft file (YAML)")
    parser.add_argument("--out", required=True, metavar="RUN", help="folder to write")
    parser.add_argument("--overwrite", action="store_true", help="replace what is there")
    parser.add_argument("--calibration", metavar="FILE", help="calibration file of `calibrate`: sensors are corrected")
    parser.add_argument(
        "--smooth",
        action="store_true",
        help="estimate every state from later measurements too, which live cannot, and learn from those states",
    )
    parser.add_argument(
        "--stage-1",
        type=float,
        metavar="S",
        help="with --air-data-errors: stage 1 of the two-stage estimator on the first S seconds of flight starts wind "
        "and errors; what live cannot",
    )
    parser.add_argument(
        "--learn-sensors",
        metavar="FILE",
        help="write the aircraft file with what the flight shows and it does not say: noise of sensors and gusts, "
        "delay and lag of the surfaces, place of the vane",
    )
    parser.add_argument(
        "--as-live",
        action="store_true",
        help="a vane that the aircraft file does not place stays in the middle, as live has it, even where the flight "
        "shows that it is out on the wing",
    )
    add_estimator_options(parser)
    add_prior_options(parser)
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Replay and write; returns state, parameters and notes. Raises InputError."""
    state, parameters = estimator_options(args)
    options = ReplayOptions(
        state,
        parameters,
        args.segments,
        args.overwrite,
        args.calibration,
        args.smooth,
        args.stage_1,
        args.learn_sensors,
        args.prior,
        args.airframe,
        args.as_live,
    )
    with telling() as tell:
        return replay(args.bags, args.aircraft, args.out, options, tell)


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    state = result["state"]
    lines = [parameter_table(result["parameters"]["parameters"]), "", state_table(state), ""]
    lines += note_lines(result["notes"])
    lines.append(f"{state['duration']:.1f} s of flight, {state['realtime_factor']:.0f} times real time")
    lines += [f"run {result['run']}"] if result["run"] else []
    return "\n".join(lines)
