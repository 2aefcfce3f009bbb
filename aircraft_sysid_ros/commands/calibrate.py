"""``calibrate``: errors of a five-hole probe, a magnetometer, or of IMU and air data together, from a flight.

The two-stage batch estimator runs on a recording or a run; with --out it writes calibration.yaml, which replay and live
take with --calibration, result.json and pictures. docs/calibration.md says what to fly.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from aircraft_sysid_ros.after_flight.calibrate import SECTIONS, CalibrationOptions, calibrate
from aircraft_sysid_ros.calibration.five_hole_probe import SENSITIVITY
from aircraft_sysid_ros.calibration.procedure import SAMPLES
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.progress import counting
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT
from aircraft_sysid_ros.report.calibration_figures import draw_calibration
from aircraft_sysid_ros.rounding import rounded_to_error


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "calibrate", help="errors of sensors from a flight", description=__doc__
    )
    add = parser.add_argument
    add("what", choices=tuple(SECTIONS), help="which sensor")
    add("bag", metavar="BAG", help="rosbag2 folder, .mcap, .db3 or .bag file, or a run, with its aircraft file")
    add("--aircraft", metavar="FILE", help="aircraft file: where the probe is, delays and noise of the sensors "
        f"(needed but for magnetometer; default there: {DEFAULT_AIRCRAFT})")  # fmt: skip
    add("--out", metavar="FOLDER", help="folder for calibration.yaml, result.json and pictures")
    add("--overwrite", action="store_true", help="replace a calibration that is there")
    add("--from", dest="begin", type=float, default=0.0, metavar="S", help="use the flight from S seconds on")
    add("--to", dest="end", type=float, default=np.inf, metavar="S", help="and up to S seconds")
    add("--calibration", metavar="FILE", help="corrections that are applied first, and that the new file holds too")
    add("--samples", type=int, default=None, metavar="N", help=f"samples of stage 1 (default: {SAMPLES}; "
        "compatibility takes fewer)")  # fmt: skip
    add("--seed", type=int, default=0, help="of the samples (default: 0)")
    add("--sensitivity", type=float, nargs=2, default=(SENSITIVITY, SENSITIVITY), metavar=("KA", "KB"),
        help=f"five-hole: nominal K_alpha and K_beta [1/rad] (default: {SENSITIVITY:g})")  # fmt: skip
    add(
        "--curve",
        choices=("auto", "linear", "cubic"),
        default="auto",
        help="five-hole: angles over pressure ratios; auto: what predicts left-out parts of the flight better",
    )
    add("--wind", choices=("auto", "steady", "varying"), default="auto",
        help="five-hole: one wind, or linear between knots a minute apart")  # fmt: skip
    add("--field-strength", type=float, metavar="F", help="magnetometer: strength of the earth's field here, in the "
        "unit of the recording (default: that of a model of the earth's, in tesla)")  # fmt: skip
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Calibrate and write; returns the result. Raises InputError."""
    options = CalibrationOptions(
        args.what, str(args.bag), args.aircraft, args.out, args.overwrite, args.begin, args.end, args.calibration,
        args.samples, args.seed, tuple(args.sensitivity), args.curve, args.wind, args.field_strength,
    )  # fmt: skip
    with counting(f"{args.what}: navigation") as tell:
        return calibrate(options, draw_calibration, lambda stage, done, of: tell(f"{args.what}: {stage}", done, of))


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    header = f"{'parameter':<14}{'estimate':>12}{'std. error':>12}{'':>2}{'unit'}"
    lines = [header, "-" * 60]
    for p in result["parameters"]:
        shown, std = rounded_to_error(p["value"], p["std"]) if p["determined"] else ("-", "-")
        lines.append(f"{p['name']:<14}{shown:>12}{std:>12}  {p['unit']:<6}{p['reason']}".rstrip())
    lines += ["", f"rms of the residuals [{result['residual_unit']}]: uncalibrated, calibrated"]
    for name, rms in result["residuals"].items():
        lines.append(f"  {name:<10}{rms['before']:>10.4g}{rms['after']:>10.4g}")
    if result["models"]:
        lines += ["", "rms of the residuals [m/s] in parts of the flight that were left out, by model"]
    for m in result["models"]:
        lines.append(f"  {m['model']:<30}{m['held_out_rms']:>8.4g}{'  used' if m['used'] else ''}")
    lines += ["", f"stage 1: {result['decision']}"]
    lines.append(f"stage 2: {result['stage_2']}")
    lines += note_lines(result["notes"])
    lines.append(f"{result['seconds_used']:.0f} s of flight used, {result['elapsed']:.1f} s of work")
    lines += [f"file {name}" for name in result.get("files", [])]
    return "\n".join(lines)
