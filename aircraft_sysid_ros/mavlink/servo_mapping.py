"""The calibration file (YAML): what the outputs and the airspeed of one autopilot mean. Checked on load.

    outputs:                      # number of the output; 1 is SERVO1 or MAIN 1
      1: {surface: left_elevon, us: [1100, 1500, 1900], deg: [-25, 0, 25]}
      2: {surface: right_elevon, us: [1100, 1500, 1900], deg: [-25, 0, 25], reversed: true}
      3: {surface: throttle, us: [1000, 2000], fraction: [0, 1]}
      4: {input: spoiler, us: [1000, 2000], deg: [0, 60]}
    airspeed: {source: VFR_HUD, meaning: indicated, scale: 1.0, offset: 0.0}
    flow_angles: measured         # AOA_SSA comes from vanes; by default it is the autopilot's own estimate: not used
    air_temperature: standard     # or sensor: the barometer's own
    gps_velocity: raw             # or filtered: that of the autopilot's filter
    attitude: {std: 0.05}         # [rad] feed the autopilot's attitude to the filter; by default only a reference
    propeller: {engine: 1, gear: 1.0}
    named_values: {THRUST: thrust}
    rates: {SERVO_OUTPUT_RAW: 50}

``input`` names an input of its own, on the topic of the inputs, beside a surface or in its place.

A table of points is interpolated and held beyond its ends; ``reversed`` mirrors the deflection, or the fraction within
its range. Positive is as in the
conventions of the textbook aeroplane: trailing edge down for elevator, flaps and every half, aileron = (right - left) /
2, rudder trailing edge left. A ruddervator of a V-tail counts as elevator and rudder; on an inverted V it counts as
rudder with the other sign: ``inverted_vtail``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.expression import is_name, is_reserved
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.airspeed import MEANINGS
from aircraft_sysid_ros.spelling import did_you_mean
from aircraft_sysid_ros.yaml_file import read_yaml

Array = npt.NDArray[np.float64]

#: Controls by what an output moves: each adds this share of its own deflection.
MIXING: dict[str, dict[str, float]] = {
    **{name: {name: 1.0} for name in ("elevator", "aileron", "rudder", "flaps", "throttle")},
    "left_aileron": {"aileron": -0.5},
    "right_aileron": {"aileron": 0.5},
    "left_elevator": {"elevator": 0.5},
    "right_elevator": {"elevator": 0.5},
    "left_flap": {"flaps": 0.5},
    "right_flap": {"flaps": 0.5},
    "left_elevon": {"elevator": 0.5, "aileron": -0.5},
    "right_elevon": {"elevator": 0.5, "aileron": 0.5},
    "left_flaperon": {"flaps": 0.5, "aileron": -0.5},
    "right_flaperon": {"flaps": 0.5, "aileron": 0.5},
    "left_vtail": {"elevator": 0.5, "rudder": 0.5},
    "right_vtail": {"elevator": 0.5, "rudder": -0.5},
    "left_inverted_vtail": {"elevator": 0.5, "rudder": -0.5},
    "right_inverted_vtail": {"elevator": 0.5, "rudder": 0.5},
}
#: Named floats may bring what MAVLink has no message for.
NAMED_TARGETS = ("thrust", "angle_of_attack", "sideslip", "propeller_speed")
LARGEST_DEFLECTION = 1.6  # [rad]
_KEYS = (
    "outputs", "airspeed", "flow_angles", "air_temperature", "gps_velocity", "attitude", "propeller", "named_values",
    "rates",
)  # fmt: skip
#: Sections of the other kind of calibration file, that of a sensor's errors.
_OF_CALIBRATE = ("five_hole_probe", "magnetometer", "compatibility")
_MOST_OUTPUTS = 32
#: Numbers of motors among the outputs that are commands: PX4's own for Motor 1 to Motor 12.
MOTORS = range(101, 113)


@dataclass(frozen=True)
class Output:
    """One output: ``points`` in us, or in -1..1 where ``normalised``, and the deflections [rad] or fractions there."""

    surface: str  # empty: it moves an input alone
    points: Array
    values: Array
    normalised: bool = False
    input: str = ""  # its own name on the topic of the inputs; empty: none

    def value(self, pulses: Array) -> Array:
        """Deflection [rad] or fraction (n,) of pulses (n,); NaN where there is none."""
        shown = np.interp(pulses, self.points, self.values)
        return np.where(np.isfinite(pulses), shown, np.nan)

    def pulse(self, value: Array) -> Array:
        """Pulse that gives a value: the inverse, for a simulated autopilot."""
        order = np.argsort(self.values)
        return np.asarray(np.interp(value, self.values[order], self.points[order]))


@dataclass(frozen=True)
class ServoMapping:
    """What one autopilot's numbers mean; the defaults are those without a file."""

    outputs: Mapping[int, Output] = field(default_factory=dict)
    airspeed_source: str | None = None  # None: the best that is there; "none": there is no airspeed sensor
    airspeed_meaning: str | None = None  # None: as the source usually means it
    airspeed_scale: float = 1.0
    airspeed_offset: float = 0.0  # [m/s] added after the scale
    measured_angles: bool = False
    sensor_temperature: bool = False
    filtered_velocity: bool = False
    attitude_std: float | None = None  # [rad]
    engine: int = 1
    gear: float = 1.0  # turns of the engine sensor per turn of the propeller
    named_values: Mapping[str, str] = field(default_factory=dict)  # name: target
    rates: Mapping[str, float] = field(default_factory=dict)  # message: Hz, 0 is never asked for

    @property
    def normalised(self) -> bool:
        """The points of the outputs are commands -1..1 and not pulses."""
        return any(output.normalised for output in self.outputs.values())

    def controls(self, pulses: Array) -> dict[str, Array]:
        """Controls (n,) by name from outputs (n, k), output 1 first; NaN where one of its outputs is missing."""
        found: dict[str, Array] = {}
        for number, output in self.outputs.items():
            column = pulses[:, number - 1] if number <= pulses.shape[1] else np.full(len(pulses), np.nan)
            value = output.value(column)
            for control, share in MIXING.get(output.surface, {}).items():
                found[control] = found.get(control, 0.0) + share * value
        return found

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs of their own, in the order of the outputs."""
        return tuple(output.input for output in self.outputs.values() if output.input)

    def input_values(self, pulses: Array) -> Array:
        """``inputs`` (n, inputs) in rad or as fraction from outputs (n, k), output 1 first; NaN where there is none."""
        named = [(number, output) for number, output in self.outputs.items() if output.input]
        columns = [
            output.value(pulses[:, number - 1]) if number <= pulses.shape[1] else np.full(len(pulses), np.nan)
            for number, output in named
        ]
        return np.stack(columns, axis=1) if columns else np.empty((len(pulses), 0))


def load_servo_mapping(path: str | Path) -> ServoMapping:
    """Read and check a calibration file; raises InputError that names the file, the key and what to correct."""
    content = read_yaml(path, "calibration file")
    try:
        return servo_mapping_from_dict({} if content is None else content)
    except InputError as error:
        raise InputError(f"calibration file {path}: {error}") from None


def servo_mapping_from_dict(content: Any) -> ServoMapping:
    """A calibration from the content of a file; raises InputError."""
    data = _mapping(content, "the content", _KEYS)
    airspeed = _mapping(data.get("airspeed"), "airspeed", ("source", "meaning", "scale", "offset"))
    propeller = _mapping(data.get("propeller"), "propeller", ("engine", "gear"))
    attitude = _mapping(data.get("attitude"), "attitude", ("std",))
    meaning = "true" if airspeed.get("meaning") is True else airspeed.get("meaning")  # to YAML the word is a truth
    if meaning is not None and meaning not in MEANINGS:
        raise InputError(f"the meaning of airspeed must be one of {', '.join(MEANINGS)}, not {meaning}")
    std = None if attitude.get("std") is None else _number(attitude["std"], "the std of attitude", 1e-4, 1.0)
    return ServoMapping(
        outputs=_outputs(data.get("outputs")),
        airspeed_source=None if airspeed.get("source") is None else str(airspeed["source"]),
        airspeed_meaning=meaning,
        airspeed_scale=_number(airspeed.get("scale", 1.0), "the scale of airspeed", 0.2, 5.0),
        airspeed_offset=_number(airspeed.get("offset", 0.0), "the offset of airspeed", -20.0, 20.0),
        measured_angles=_choice(data, "flow_angles", ("ignored", "measured")) == "measured",
        sensor_temperature=_choice(data, "air_temperature", ("standard", "sensor")) == "sensor",
        filtered_velocity=_choice(data, "gps_velocity", ("raw", "filtered")) == "filtered",
        attitude_std=std,
        engine=int(_number(propeller.get("engine", 1), "the engine of propeller", 1, 16)),
        gear=_number(propeller.get("gear", 1.0), "the gear of propeller", 0.01, 100.0),
        named_values=_named_values(data.get("named_values")),
        rates=_rates(data.get("rates")),
    )


def _outputs(data: Any) -> dict[int, Output]:
    outputs: dict[int, Output] = {}
    for key, value in _mapping(data, "outputs").items():
        if isinstance(key, bool) or not isinstance(key, int) or not (1 <= key <= _MOST_OUTPUTS or key in MOTORS):
            motors = f"the motors of PX4 {MOTORS[0]} to {MOTORS[-1]}"
            raise InputError(f"outputs are numbered 1 to {_MOST_OUTPUTS}, {motors}, not '{key}'")
        outputs[key] = _output(key, value)
        if key in MOTORS and not outputs[key].normalised:
            raise InputError(f"output {key}: motors of PX4 are commands: give its points as command, not as us")
    _check_surfaces({number: output.surface for number, output in outputs.items() if output.surface})
    names = [output.input for output in outputs.values() if output.input]
    if len(set(names)) < len(names):
        raise InputError(f"two outputs are the input {max(names, key=names.count)}: give each a name of its own")
    if len({output.normalised for output in outputs.values()}) > 1:
        raise InputError("give the points of all outputs in us, or of all as command, not some of each")
    return outputs


def _output(number: int, data: Any) -> Output:
    what = f"output {number}"
    known = ("surface", "input", "us", "command", "rad", "deg", "fraction", "reversed")
    content = _mapping(data, what, known)
    surface, own_name = _moved(what, content)
    inputs = [name for name in ("us", "command") if name in content]
    units = [name for name in ("rad", "deg", "fraction") if name in content]
    wanted = ("fraction",) if surface == "throttle" else ("rad", "deg") if surface else ("rad", "deg", "fraction")
    if len(inputs) != 1 or len(units) != 1 or units[0] not in wanted:
        moved = surface or own_name
        raise InputError(f"{what}: a {moved} needs its points as us or command, and as {' or '.join(wanted)}")
    points, values = _points(content[inputs[0]], what), _points(content[units[0]], what)
    if len(points) != len(values) or len(points) < 2 or np.any(np.diff(points) <= 0.0):
        both = f"{inputs[0]} and {units[0]}"
        raise InputError(f"{what}: {both} need equally many points, two or more, {inputs[0]} rising")
    steps = np.diff(values)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise InputError(f"{what}: {units[0]} must rise or fall all the way")
    if units[0] == "deg":
        values = np.radians(values)
    _check_ranges(what, inputs[0], points, surface, values)
    flip = content.get("reversed", False)
    if not isinstance(flip, bool):
        raise InputError(f"{what}: reversed must be true or false, not '{flip}'")
    if flip:
        values = values.min() + values.max() - values if units[0] == "fraction" else -values
    return Output(surface, points, values, normalised=inputs[0] == "command", input=own_name)


def _moved(what: str, content: Mapping[Any, Any]) -> tuple[str, str]:
    """The surface that an output moves, and the name of the input that it is; one of them may be empty."""
    surface, own_name = content.get("surface"), content.get("input")
    if surface not in MIXING and (surface is not None or own_name is None):
        hint = did_you_mean(str(surface), MIXING) or f"known are {', '.join(MIXING)}, or name it as input"
        raise InputError(f"{what}: unknown surface '{surface}': {hint}")
    if own_name is None:
        return str(surface), ""
    name = str(own_name)
    if is_reserved(name) or name in SIGNALS:
        raise InputError(f"{what}: the input '{name}' has a name that terms use otherwise: give it another one")
    if not is_name(name):
        raise InputError(
            f"{what}: the input '{name[:60]}' cannot be used in a term: name it with letters, digits and _"
        )
    return str(surface or ""), name


def _check_ranges(what: str, unit: str, points: Array, surface: str, values: Array) -> None:
    """The commonest mistakes are one unit for another."""
    low, high = (-1.0, 1.0) if unit == "command" else (500.0, 2500.0)
    if points[0] < low or points[-1] > high:
        raise InputError(f"{what}: points in {unit} lie between {low:g} and {high:g}")
    if surface == "throttle" and not (values.min() >= 0.0 and values.max() <= 1.0):
        raise InputError(f"{what}: the fraction of a throttle lies between 0 and 1")
    if np.abs(values).max() > LARGEST_DEFLECTION:
        raise InputError(f"{what}: {np.abs(values).max():g} rad is not a deflection: degrees go under deg")


def _check_surfaces(surfaces: Mapping[int, str]) -> None:
    """Each surface once, halves in pairs, and no control from two families."""
    names = list(surfaces.values())
    for number, name in surfaces.items():
        if names.count(name) > 1:
            raise InputError(f"output {number}: {name} is there twice: remove one")
        side, _, rest = name.partition("_")
        other = {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side)
        if other is not None and other not in names:
            raise InputError(f"output {number}: {name} needs {other} too")
    for control in ("elevator", "aileron", "rudder", "flaps"):
        families = {name.split("_", 1)[-1] for name in names if control in MIXING[name]}
        if len(families) > 1:
            raise InputError(f"{control} comes from {' and '.join(sorted(families))}: keep one")


def _named_values(data: Any) -> dict[str, str]:
    named = {str(name): str(target) for name, target in _mapping(data, "named_values").items()}
    for name, target in named.items():
        if target not in NAMED_TARGETS:
            raise InputError(f"named_values {name}: must be one of {', '.join(NAMED_TARGETS)}, not {target}")
        if not 1 <= len(name) <= 10:
            raise InputError(f"named_values {name}: MAVLink names have 1 to 10 characters")
    return named


def _rates(data: Any) -> dict[str, float]:
    return {
        str(name).upper(): _number(value, f"the rate of {name}", 0.0, 1000.0)
        for name, value in _mapping(data, "rates").items()
    }


def _mapping(data: Any, what: str, known: tuple[str, ...] | None = None) -> Mapping[Any, Any]:
    if data is None:
        return {}
    if not isinstance(data, Mapping):
        raise InputError(f"{what} must be a mapping, not '{str(data)[:60]}'")
    for key in data:
        if known is not None and key not in known:
            if known is _KEYS and key in _OF_CALIBRATE:
                raise InputError("it holds what `calibrate` found: that is for --calibration of replay and live")
            hint = did_you_mean(str(key), known, quote="'") or f"known are {', '.join(known)}"
            raise InputError(f"{what}: unknown key '{key}': {hint}")
    return data


def _choice(data: Mapping[Any, Any], key: str, choices: tuple[str, ...]) -> str:
    value = data.get(key, choices[0])
    if value not in choices:
        raise InputError(f"{key} must be {' or '.join(choices)}, not '{value}'")
    return str(value)


def _number(value: Any, what: str, low: float, high: float) -> float:
    number = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else float("nan")
    if not low <= number <= high:
        raise InputError(f"{what} must be a number from {low:g} to {high:g}, not '{value}'")
    return number


def _points(value: Any, what: str) -> Array:
    if not isinstance(value, list) or not all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in value):
        raise InputError(f"{what}: points are a list of numbers, not '{str(value)[:60]}'")
    return np.array(value, dtype=np.float64)
