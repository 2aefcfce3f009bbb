"""Options that several commands share."""

from __future__ import annotations

import argparse
from typing import Any

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.estimators.by_name import ESTIMATORS
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.reconstruction.options import StateOptions


def add_estimator_options(parser: argparse.ArgumentParser) -> None:
    """What a flight may want different from the defaults."""
    state, parameters = StateOptions(), ParameterOptions()
    parser.add_argument(
        "--horizon",
        type=float,
        default=state.horizon,
        metavar="S",
        help=f"how late a sample may come and still be fused (default: {state.horizon:g} s)",
    )
    parser.add_argument(
        "--forgetting-time",
        type=float,
        default=parameters.forgetting_time,
        metavar="S",
        help=f"seconds of motion that the estimates rest on (default: {parameters.forgetting_time:g})",
    )
    parser.add_argument(
        "--estimator",
        choices=tuple(ESTIMATORS),
        default=parameters.estimator,
        help="whose parameters are the result: rls, recursive least squares in the time domain (default); fourier, "
        "equation error in the frequency domain; rml, recursive maximum likelihood",
    )
    band = (parameters.lowest_frequency, parameters.highest_frequency)
    parser.add_argument(
        "--frequencies",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help=f"band [Hz] of the estimator fourier (default: {band[0]:g} {band[1]:g})",
    )
    parser.add_argument(
        "--air-data-errors",
        action="store_true",
        help="scales and offsets of airspeed, alpha and beta are states of the filter too, begun by --calibration",
    )
    parser.add_argument(
        "--no-relearn",
        action="store_true",
        help="after a sudden change of the aeroplane keep what was known, instead of learning the changed axis anew",
    )


def estimator_options(args: argparse.Namespace) -> tuple[StateOptions, ParameterOptions]:
    """Options of both steps; raises InputError where they make no sense."""
    if not 0.0 <= args.horizon <= 5.0:
        raise InputError(f"--horizon must be between 0 and 5 s, not {args.horizon:g}")
    if not 1.0 <= args.forgetting_time <= 1e6:
        raise InputError(f"--forgetting-time must be between 1 and 1e6 s, not {args.forgetting_time:g}")
    if args.frequencies is not None and args.estimator != "fourier":
        raise InputError(f"--frequencies is for --estimator fourier, and this is {args.estimator}: leave it out")
    defaults = ParameterOptions()
    low, high = args.frequencies or (defaults.lowest_frequency, defaults.highest_frequency)
    if not 0.01 <= low < high <= 20.0:
        raise InputError(f"--frequencies must rise between 0.01 and 20 Hz, not go from {low:g} to {high:g}")
    parameters = ParameterOptions(
        forgetting_time=args.forgetting_time,
        estimator=args.estimator,
        lowest_frequency=low,
        highest_frequency=high,
        relearn=not args.no_relearn,
    )
    return StateOptions(horizon=args.horizon, air_data_errors=args.air_data_errors), parameters


def parameter_table(parameters: list[dict[str, Any]], truth: dict[str, float] | None = None) -> str:
    """Table of parameters for people; with the truth where it is known."""
    header = f"{'parameter':<12}{'estimate':>12}{'std. error':>12}"
    header += (f"{'truth':>12}" if truth else "") + "  status"
    lines = [header, "-" * (len(header) + 8)]
    for p in parameters:
        line = f"{p['name']:<12}{_number(p['value']):>12}{_number(p['std']):>12}"
        if truth:
            line += f"{_number(truth.get(p['name'])):>12}"
        lines.append(f"{line}  {p['status']:<7}{p['reason']}".rstrip())
    return "\n".join(lines)


def state_table(state: dict[str, Any], truth: dict[str, Any] | None = None) -> str:
    """Table of biases and wind for people."""
    lines = [f"{'state':<30}{'estimate':>12}{'std. error':>12}" + (f"{'truth':>12}" if truth else "")]
    lines.append("-" * len(lines[0]))
    parts = (
        ("accelerometer_bias", "xyz", "m/s²"),
        ("gyro_bias", "xyz", "rad/s"),
        ("wind_ned", "NED", "m/s"),
    )
    for name, labels, unit in parts:
        for i, label in enumerate(labels):
            title = f"{name.removesuffix('_ned').replace('_', ' ')} {label} [{unit}]"
            line = f"{title:<30}{_number(state[name][i]):>12}{_number(state[name + '_std'][i]):>12}"
            lines.append(line + (f"{_number(truth[name][i]):>12}" if truth else ""))
    for name, found in state.get("air_data_errors", {}).items():
        lines.append(f"{'air data ' + name:<30}{_number(found['value']):>12}{_number(found['std']):>12}")
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"
