"""``simulate``: a flight with known truth, recorded as a bag, the truth beside it."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.rounding import fixed
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.calibration_flight import CALIBRATION_AIRCRAFT, DURATION, calibration_flight
from aircraft_sysid_ros.simulation.calibration_plan import CALIBRATION
from aircraft_sysid_ros.simulation.dynamics import Effect, trim_airspeed_of
from aircraft_sysid_ros.simulation.hidden_effects import Hidden
from aircraft_sysid_ros.simulation.jsbsim_flight import DEFAULT_MODEL, MODELS
from aircraft_sysid_ros.simulation.jsbsim_hidden import prepared
from aircraft_sysid_ros.simulation.simulated_flight import (
    DEFAULT_WIND,
    LONGEST,
    SHORTEST,
    SimulatedFlight,
    simulate_jsbsim_samples,
    simulate_samples,
)
from aircraft_sysid_ros.simulation.truth_files import aircraft_path, truth_path, write_flight
from aircraft_sysid_ros.simulation.varied_plan import PLANS, STANDARD
from aircraft_sysid_ros.simulation.wind import TURBULENCE_WIND
from aircraft_sysid_ros.spelling import did_you_mean


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "simulate", help="a flight with known truth, recorded as a bag", description=__doc__
    )
    add = parser.add_argument
    add(
        "--out",
        required=True,
        metavar="BAG",
        help="recording to write: a rosbag2 folder, or a file NAME.mcap",
    )
    add("--aircraft", metavar="FILE", help=f"aircraft file with coefficients (default: {DEFAULT_AIRCRAFT})")
    add("--effect", action="append", default=[], metavar="ID[:STRENGTH]",
        help="hide an effect of the library, at a strength (default 1), or one more term of the true aerodynamics, "
        "such as 'CZ: alpha**3 = -5'; may be repeated")  # fmt: skip
    add("--manoeuvres", choices=(*PLANS, CALIBRATION), metavar="KIND",
        help=f"kind of flight: {' '.join(PLANS)} (default: {STANDARD}, or one that shows the effect); {CALIBRATION}: "
        f"what calibrate needs, instruments with errors (default aircraft: {CALIBRATION_AIRCRAFT})")  # fmt: skip
    add("--seed", type=int, default=0, help="of all random numbers (default: 0)")
    add("--duration", type=float, help=f"{SHORTEST:g} to {LONGEST:g} s (default: 120; {CALIBRATION}: {DURATION:g})")
    add("--wind", type=float, nargs=3, default=list(DEFAULT_WIND), metavar=("N", "E", "D"),
        help="mean wind, the direction the air moves to [m/s] (default: 3 -2 0)")  # fmt: skip
    add("--wind-walk", type=float, metavar="SIGMA",
        help="random walk of the wind [m/s per sqrt(s)] (default: of the aircraft file)")  # fmt: skip
    add(
        "--turbulence",
        choices=tuple(TURBULENCE_WIND),
        default="none",
        help="Dryden, MIL-F-8785C at low altitude",
    )
    add("--noise-scale", type=float, default=1.0, help="on the sensor noise of the aircraft file (default: 1)")
    add("--attitude", action="store_true", help="the IMU sends an orientation")
    add("--magnetometer", action="store_true", help="record imu/mag")
    add("--five-hole-probe", action="store_true", help="record the raw pressures of a probe")
    add("--height-above-ground", action="store_true", help="record a range sensor")
    add(
        "--simulator",
        choices=("textbook", "jsbsim"),
        default="textbook",
        help="whose physics (default: textbook)",
    )
    add("--jsbsim-aircraft", choices=tuple(MODELS), metavar="NAME",
        help=f"aeroplane of JSBSim: {' '.join(MODELS)} (default: {DEFAULT_MODEL})")  # fmt: skip
    add("--overwrite", action="store_true", help="replace a recording that is there")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Simulate and write; returns what was written. Raises InputError for bad options and files."""
    _check(args)
    started = time.perf_counter()
    flight = _simulate(args)
    write_flight(flight, args.out, overwrite=args.overwrite)
    truth = flight.truth
    result: dict[str, Any] = {
        "recording": str(args.out),
        "truth": str(truth_path(args.out, ".json")),
        "aircraft": flight.aircraft.name,
        "aircraft_file": _aircraft_file(args, flight),
        "simulator": flight.simulator,
        "seed": args.seed,
        "duration": float(truth.time[-1] - truth.time[0]),
        "effects": [
            *(f"{e.axis}: {e.expression} = {e.value:g}" for e in flight.effects),
            *(_described(effect) for effect in flight.hidden),
        ],
        "manoeuvres": flight.manoeuvres,
        "messages": {stream.topic: len(stream.stamp) for stream in flight.streams},
        "airspeed": _range(truth.airspeed),
        "alpha": _range(truth.alpha),
        "beta": _range(truth.beta),
        "height": _range(truth.height),
        "computing_time": time.perf_counter() - started,
    }
    return result


def render(result: dict[str, Any]) -> str:
    """The summary for people."""
    degrees = {name: [fixed(np.degrees(x), 1) for x in result[name]] for name in ("alpha", "beta")}
    lines = [
        f"{result['aircraft']}: {result['duration']:g} s of flight in {result['computing_time']:.1f} s",
        *(f"  hidden effect    {effect}" for effect in result["effects"]),
        f"  airspeed         {result['airspeed'][0]:.1f} to {result['airspeed'][1]:.1f} m/s",
        f"  angle of attack  {degrees['alpha'][0]} to {degrees['alpha'][1]} deg",
        f"  sideslip         {degrees['beta'][0]} to {degrees['beta'][1]} deg",
        f"  height           {result['height'][0]:.0f} to {result['height'][1]:.0f} m",
        f"  messages         {', '.join(f'/{topic} {n}' for topic, n in result['messages'].items())}",
        f"recording {result['recording']}",
        f"truth     {result['truth']}",
        f"aircraft  {result['aircraft_file']}",
    ]
    return "\n".join(lines)


def _described(effect: Hidden) -> str:
    inner = ", ".join(f"{name} = {value:g}" for name, value in effect.inner.items())
    variant = f" ({effect.variant})" if effect.variant else ""
    return f"{effect.identifier}{variant} at strength {effect.strength:g}" + (f", {inner}" if inner else "")


def parse_hidden(text: str) -> tuple[str, float] | None:
    """Id and strength from ``ID[:STRENGTH]``; None for a text that is no id. Raises InputError."""
    name, _, rest = (part.strip() for part in text.partition(":"))
    if name not in BY_ID:
        return None
    try:
        return name, float(rest) if rest else 1.0
    except ValueError:
        raise InputError(f"the strength '{rest}' of the effect {name} is not a number") from None


def parse_effect(text: str) -> Effect:
    """Effect from ``AXIS: EXPRESSION = VALUE``; raises InputError."""
    axis, colon, rest = text.partition(":")
    expression, equals, value = rest.rpartition("=")
    if not (colon and equals):
        hint = did_you_mean(axis.strip(), BY_ID, 3, 0.5) or "`aircraft-sysid add --help` lists them"
        raise InputError(
            f"'{echo(text)}' is not an effect, {hint}; a term is written with axis and value, such as 'CZ: alpha**3 = "
            "-5'"
        )
    try:
        number = float(value)
    except ValueError:
        number = float("nan")
    if not np.isfinite(number):
        raise InputError(f"the value '{value.strip()}' of the effect '{text}' is not a number")
    return Effect(axis.strip(), expression.strip(), number)


def _check(args: argparse.Namespace) -> None:
    """Numbers that would otherwise fail deep inside; and the target, before the work."""
    if args.seed < 0:
        raise InputError(f"--seed must not be negative, not {args.seed}")
    if not np.all(np.isfinite(args.wind)):
        raise InputError("--wind must be three finite numbers")
    for name in ("noise_scale", "wind_walk"):
        value = getattr(args, name)
        if value is not None and not 0.0 <= value < np.inf:
            raise InputError(f"--{name.replace('_', '-')} must be zero or more, not {value:g}")
    if Path(args.out).exists() and not args.overwrite:
        raise InputError(f"{args.out} is already there: give another name or --overwrite")
    if args.manoeuvres == CALIBRATION and (args.simulator == "jsbsim" or args.effect):
        raise InputError(f"--manoeuvres {CALIBRATION} goes with the textbook simulator and without effects")
    if args.simulator == "jsbsim" and args.aircraft:
        raise InputError("--aircraft does not go with --simulator jsbsim: choose with --jsbsim-aircraft")
    if args.simulator == "jsbsim" and not all(parse_hidden(text) for text in args.effect):
        raise InputError("terms do not go with --simulator jsbsim: name effects of the library")
    if args.simulator != "jsbsim" and args.jsbsim_aircraft:
        raise InputError("--jsbsim-aircraft needs --simulator jsbsim")


def _simulate(args: argparse.Namespace) -> SimulatedFlight:
    sensors = SensorOptions(
        noise_scale=args.noise_scale,
        attitude=args.attitude,
        magnetometer=args.magnetometer,
        five_hole_probe=args.five_hole_probe,
        height_above_ground=args.height_above_ground,
    )
    named = [(text, parse_hidden(text)) for text in args.effect]
    hidden = [pair for _, pair in named if pair is not None]
    if args.manoeuvres == CALIBRATION:
        return _calibration(args, sensors)
    duration = 120.0 if args.duration is None else args.duration
    common: dict[str, Any] = {
        "wind": args.wind, "wind_walk": args.wind_walk, "turbulence": args.turbulence, "hidden": hidden,
        "manoeuvres": args.manoeuvres, "sensors": sensors,
    }  # fmt: skip
    if args.simulator == "jsbsim":
        name = args.jsbsim_aircraft or DEFAULT_MODEL
        _check_wind(args.wind, prepared(name)[0].trim.airspeed, name)
        return simulate_jsbsim_samples(name, args.seed, duration, **common, fitted=bool(hidden))
    aircraft = load_aircraft(args.aircraft or config_path(DEFAULT_AIRCRAFT))
    _check_wind(args.wind, trim_airspeed_of(aircraft), aircraft.name)
    effects = [parse_effect(text) for text, pair in named if pair is None]
    return simulate_samples(aircraft, args.seed, duration, **common, effects=effects)


def _check_wind(wind: list[float], airspeed: float, name: str) -> None:
    """Raises InputError where the wind carries the aeroplane away."""
    speed = float(np.linalg.norm(wind))
    if speed >= airspeed:
        raise InputError(f"--wind of {speed:.3g} m/s must be less than the {airspeed:.3g} m/s at which {name} flies")


def _calibration(args: argparse.Namespace, sensors: SensorOptions) -> SimulatedFlight:
    """A calibration flight; its wind is steady unless --wind-walk says otherwise."""
    aircraft = load_aircraft(_default_aircraft(args))
    _check_wind(args.wind, trim_airspeed_of(aircraft), aircraft.name)
    return calibration_flight(
        args.seed,
        DURATION if args.duration is None else args.duration,
        aircraft=aircraft,
        wind=args.wind,
        wind_walk=args.wind_walk or 0.0,
        turbulence=args.turbulence,
        sensors=sensors,
    )


def _default_aircraft(args: argparse.Namespace) -> str:
    name = CALIBRATION_AIRCRAFT if args.manoeuvres == CALIBRATION else DEFAULT_AIRCRAFT
    return str(args.aircraft or config_path(name))


def _aircraft_file(args: argparse.Namespace, flight: SimulatedFlight) -> str:
    """Where the aircraft file of the flight is; that of a JSBSim aeroplane is beside the truth."""
    return str(aircraft_path(args.out)) if flight.simulator == "jsbsim" else _default_aircraft(args)


def _range(values: np.ndarray) -> list[float]:
    return [float(values.min()), float(values.max())]
