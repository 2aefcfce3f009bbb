"""Options that several commands share."""

from __future__ import annotations

import argparse
import math
import sys
from typing import Any

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.option import Option, OptionError, options_of
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.rounding import rounded_to_error

_BAND = ("lowest_frequency", "highest_frequency")


def flag_of(name: str) -> str:
    """An option as it is typed."""
    return "--" + name.replace("_", "-")


def add_option(parser: argparse.ArgumentParser, name: str, option: Option) -> None:
    """An option with its default and its sentence; a switch is for what it is not by default."""
    sentence = option.sentence[:1].lower() + option.sentence[1:].removesuffix(".")
    if isinstance(option.default, bool):
        flag, words = (flag_of(f"no-{name}"), f"do not {sentence}") if option.default else (flag_of(name), sentence)
        parser.add_argument(flag, dest=name, action="store_false" if option.default else "store_true", help=words)
        return
    default = str(option.default) if option.choices else f"{option.default:g} {option.unit}".rstrip()
    parser.add_argument(
        flag_of(name),
        type=type(option.default),
        default=option.default,
        choices=option.choices or None,
        metavar=None if option.choices else option.unit.upper() or "N",
        help=f"{sentence} (default: {default})",
    )


def add_estimator_options(parser: argparse.ArgumentParser) -> None:
    """What a flight may want different from the defaults."""
    state, parameters = options_of(StateOptions), options_of(ParameterOptions)
    for name in ("horizon", "calm_air", "air_data_errors"):
        add_option(parser, name, state[name])
    for name in ("forgetting_time", "estimator", "relearn"):
        add_option(parser, name, parameters[name])
    band = " ".join(f"{parameters[name].default:g}" for name in _BAND)
    parser.add_argument(
        "--frequencies",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help=f"lowest and highest frequency that the estimator fourier uses (default: {band} Hz)",
    )


class _OldName(argparse.Action):
    """An option that is called ``option_strings[0]`` no more: it still means the same, with a word of warning."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, values: Any, option: str | None = None) -> None:
        print(f"{parser.prog}: {option} is the old name: use {flag_of(self.dest)}", file=sys.stderr)
        setattr(namespace, self.dest, values)


def add_servos(parser: argparse.ArgumentParser, sentence: str) -> None:
    """--servos; its name before, --calibration, is the file of `calibrate` everywhere else."""
    parser.add_argument("--servos", metavar="FILE", help=sentence)
    parser.add_argument("--calibration", dest="servos", action=_OldName, metavar="FILE", help=argparse.SUPPRESS)


def add_prior_options(parser: argparse.ArgumentParser) -> None:
    """What earlier flights say, and of which aeroplane."""
    parser.add_argument(
        "--prior", metavar="FLEET", help="folder of `fleet`: what its flights say about the parameters before this one"
    )
    parser.add_argument(
        "--airframe",
        metavar="NAME",
        help="of --prior (default: its only one, the one named in the aircraft file, or what all have in common)",
    )


def estimator_options(args: argparse.Namespace) -> tuple[StateOptions, ParameterOptions]:
    """Options of both steps; raises InputError where they make no sense."""
    if args.frequencies is not None and args.estimator != "fourier":
        raise InputError(f"--frequencies is for --estimator fourier, and this is {args.estimator}: leave it out")
    band = {} if args.frequencies is None else dict(zip(_BAND, args.frequencies, strict=True))
    try:
        state = StateOptions(horizon=args.horizon, calm_air=args.calm_air, air_data_errors=args.air_data_errors)
        parameters = ParameterOptions(
            forgetting_time=args.forgetting_time,
            estimator=args.estimator,
            relearn=args.relearn,
            measured_angles=not args.air_data_errors,
            **band,
        )
    except OptionError as error:
        if error.name in band:
            raise _no_band(*args.frequencies) from None
        raise InputError(f"{flag_of(error.name)} {error.what}") from None
    return state, parameters


def _no_band(low: float, high: float) -> InputError:
    lowest, highest = (options_of(ParameterOptions)[name] for name in _BAND)
    return InputError(
        f"--frequencies must rise between {lowest.low:g} and {highest.high:g} Hz, not go from {low:g} to {high:g}"
    )


def parameter_table(parameters: list[dict[str, Any]], truth: dict[str, float] | None = None) -> str:
    """Table of parameters for people; with the truth where it is known."""
    width = max([12, *(len(p["name"]) + 1 for p in parameters)])
    header = f"{'parameter':<{width}}{'estimate':>12}{'std. error':>12}"
    header += (f"{'truth':>12}" if truth else "") + "  status"
    lines = [header, "-" * (len(header) + 8)]
    for p in parameters:
        line = f"{p['name']:<{width}}{_with_error(p['value'], p['std'])}"
        if truth:
            line += f"{_as_exact(truth.get(p['name']), p['std']):>12}"
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
            std = state[name + "_std"][i]
            line = f"{title:<30}{_with_error(state[name][i], std)}"
            lines.append(line + (f"{_as_exact(truth[name][i], std):>12}" if truth else ""))
    for name, found in state.get("air_data_errors", {}).items():
        lines.append(f"{'air data ' + name:<30}{_with_error(found['value'], found['std'])}")
    return "\n".join(lines)


def _with_error(value: float | None, std: float | None) -> str:
    """Two columns: a value and its standard error."""
    return f"{_as_exact(value, std):>12}{'-' if std is None else rounded_to_error(0.0, std)[1]:>12}"


def _as_exact(value: float | None, std: float | None) -> str:
    """A number to the places that a standard error lets it have."""
    return "-" if value is None else rounded_to_error(value, math.nan if std is None else std)[0]


def absolute_namespace(namespace: str) -> str | None:
    """A namespace from the root; None for the root itself."""
    name = namespace.strip("/")
    return f"/{name}" if name else None
