"""The aircraft file: geometry, mass, sensors and model of one aeroplane, checked once when it is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import TEXTBOOK_TERMS, AerodynamicModel, model_from_terms
from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.expression import MOST_INPUTS, SIGNALS, is_name, is_reserved
from aircraft_sysid_ros.aircraft.fleet_prior import FleetPrior, prior_from_dict, read_prior
from aircraft_sysid_ros.aircraft.shape import check_shape
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.spelling import did_you_mean, nearest
from aircraft_sysid_ros.yaml_file import read_yaml

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """One sensor: noise is one sigma per sample and axis, in the sensor's unit; rate [Hz]; delay [s].

    What it shows is scale times the true value, and the noise; only SCALED_SENSORS have another scale than 1.
    """

    noise: tuple[float, ...]
    rate: float
    delay: float = 0.0
    noise_is_given: bool = False  # by the aircraft file: then it goes before the covariance of the messages
    scale: float = 1.0
    drift: float = 0.0  # [1/s] of the scale of an airspeed, [rad/s] of an angle, from when the filter starts
    offset: float = 0.0  # [rad] of an angle of flow


@dataclass(frozen=True)
class NamedInput:
    """A further input of the aeroplane, as signal of model terms: one sigma of its noise, and what it can be, SI."""

    name: str
    factor: float = 1.0  # from the unit of the recording to SI
    noise: float = 0.002
    limits: tuple[float, float] = (-1.6, 1.6)  # what is outside is a fault of transmission


#: Units of named inputs: factor to SI, and by default one sigma of the noise and the largest magnitude, SI.
INPUT_UNITS: dict[str, tuple[float, float, float]] = {
    "rad": (1.0, 0.002, 1.6),
    "deg": (float(np.pi / 180.0), 0.002, 1.6),
    "1": (1.0, 0.01, 10.0),
    "N": (1.0, 1.0, 1e7),
    "rad/s": (1.0, 1.0, 1e5),
    "W": (1.0, 1.0, 1e9),
}
#: A small UAV. Units of the noise: m/s^2, rad/s, rad, rad (of heading), m (N, E, D), m/s (N, E, D), m/s, rad,
#: rad, Pa, Pa, rad, m.
DEFAULT_SENSORS: dict[str, Sensor] = {
    "accelerometer": Sensor((0.1,), 100.0),
    "gyro": Sensor((0.005,), 100.0),
    "attitude": Sensor((0.03,), 50.0),
    "magnetometer": Sensor((0.1,), 10.0),
    "gps_position": Sensor((1.5, 1.5, 3.0), 5.0),
    "gps_velocity": Sensor((0.2, 0.2, 0.4), 5.0),
    "airspeed": Sensor((0.3,), 50.0),
    "angle_of_attack": Sensor((0.005,), 50.0),
    "sideslip": Sensor((0.005,), 50.0),
    "static_pressure": Sensor((20.0,), 50.0),
    "five_hole_probe": Sensor((5.0,), 50.0),
    "control_surfaces": Sensor((0.002,), 50.0),
    "height_above_ground": Sensor((0.2,), 10.0),
}
#: Sensors that share a message may be set together; the noise is then one number for each member.
SENSOR_GROUPS: dict[str, tuple[str, ...]] = {
    "imu": ("accelerometer", "gyro"),
    "gps": ("gps_position", "gps_velocity"),
    "air_data": ("airspeed", "angle_of_attack", "sideslip"),
}
SCALED_SENSORS = SENSOR_GROUPS["air_data"]
#: Drifts [1/s or rad/s] beyond this are no slow fault.
FASTEST_DRIFT = 0.01
#: A vane that is further [rad] from where it should be is not rigged.
LARGEST_OFFSET = 0.35
SENSOR_ALIASES = {
    "gyroscope": "gyro", "alpha": "angle_of_attack", "beta": "sideslip", "true_airspeed": "airspeed",
    "orientation": "attitude", "controls": "control_surfaces",
}  # fmt: skip
#: Unit of the noise of each sensor, and more of it than leaves anything to be measured.
_NOISE: dict[str, tuple[str, float]] = {
    "accelerometer": ("m/s²", 1e3), "gyro": ("rad/s", 100.0), "attitude": ("rad", 10.0), "magnetometer": ("rad", 10.0),
    "gps_position": ("m", 1e5), "gps_velocity": ("m/s", 1e3), "airspeed": ("m/s", 1e3),
    "angle_of_attack": ("rad", 10.0), "sideslip": ("rad", 10.0), "static_pressure": ("Pa", 1e5),
    "five_hole_probe": ("Pa", 1e5), "control_surfaces": ("rad", 10.0), "height_above_ground": ("m", 1e4),
}  # fmt: skip
#: Less noise than this has no sensor: the square of it must be a number beside others.
_LEAST_NOISE = 1e-9
_RATES = (0.01, 1e5)  # [Hz]
#: Random walks [unit of the state per square root of a second].
DEFAULT_PROCESS_NOISE = {"accelerometer_bias": 5e-4, "gyro_bias": 2e-5, "wind": 0.2}
_LARGEST_PROCESS_NOISE = {"accelerometer_bias": ("m/s²", 10.0), "gyro_bias": ("rad/s", 1.0), "wind": ("m/s", 100.0)}
#: Larger is no coefficient, of whatever term.
_LARGEST_COEFFICIENT = 1e12
#: Lift coefficient that few small aircraft exceed: sets the default airspeed below which it cannot be flying.
_MAXIMUM_LIFT = 1.6
SURFACES = ("elevator", "aileron", "rudder", "flaps")


@dataclass(frozen=True)
class Key:
    """A key of the aircraft file, as docs/aircraft-file.md has it: its default in words, empty for one that must be."""

    meaning: str
    unit: str = ""
    default: str = ""
    limits: tuple[float, float] | None = None  # of a number, in that unit: no aeroplane is outside


_POSITION = (
    "from the centre of gravity, FRD, of a coordinate that nobody knows `null`, of one that was found `0.40 ± 0.02`"
)
_NEAR, _SPEEDS = (-200.0, 200.0), (0.01, 2000.0)
KEYS = {
    "name": Key("what results call the aeroplane"),
    "mass": Key("mass", "kg", limits=(1e-3, 2e6)),
    "wing_area": Key("wing area", "m²", limits=(1e-4, 1e4)),
    "span": Key("wing span", "m", limits=(0.01, 500.0)),
    "chord": Key("mean aerodynamic chord", "m", limits=(1e-3, 100.0)),
    "inertia": Key("`{xx, yy, zz, xz}` about the centre of gravity", "kg m²", limits=(1e-9, 1e10)),
    "imu_position": Key(f"position of the IMU {_POSITION}", "m", "0", _NEAR),
    "air_data_position": Key(f"position of the air data probe {_POSITION}", "m", "0", _NEAR),
    "gps_position": Key(f"position of the GPS antenna {_POSITION}", "m", "0", _NEAR),
    "aerodynamic_reference": Key(f"point of the moment coefficients {_POSITION}", "m", "centre of gravity", _NEAR),
    "sensors": Key(
        "per sensor `noise` (one sigma per sample), `rate` [Hz], `delay` [s], of `airspeed`, `angle_of_attack` and "
        "`sideslip` also `scale` (measured = scale × true) and `drift` (of airspeed what it shows more per second as a "
        "share, of an angle rad/s, from when the filter starts), of the angles also `offset` [rad] "
        "(measured = scale × (true + offset + drift × time))",
        default="small UAV",
    ),
    "process_noise": Key(
        "random walks per √s: `accelerometer_bias`, `gyro_bias`, `wind`",
        default=", ".join(f"{value:g}" for value in DEFAULT_PROCESS_NOISE.values()),
    ),
    "model": Key(
        "terms per axis, expressions of the signals; axes that are not named keep theirs, `[]` is none",
        default="the 32 terms of (6.25)",
    ),
    "inputs": Key(
        f"further inputs of the recording, by name, as signals of the terms, at most {MOST_INPUTS}: per input `unit` "
        "of the recording, `noise` (one sigma) and `limits` `[lowest, highest]`, both in that unit",
        "rad, deg, 1, N, rad/s",
        "none; rad",
    ),
    "surface_signs": Key("+1 or -1 by surface, on what the recording holds", default="1"),
    "minimum_airspeed": Key(
        "airspeed below which the aircraft is not flying",
        "m/s",
        f"0.8 of a stall speed at C_L {_MAXIMUM_LIFT:g}",
        _SPEEDS,
    ),
    "ground_altitude": Key(
        "altitude of the ground as the GPS reports it, for height", "m", "lowest of the flight so far", (-1000.0, 1e5)
    ),
    "magnetic_declination": Key(
        "declination; without it a magnetometer only starts the heading", "rad", "none", (-float(np.pi), float(np.pi))
    ),
    "parameter_bounds": Key(
        "by parameter name `[lowest, highest]`, narrower than physics: outside a parameter never has USE "
        "([trust.md](trust.md))",
        default="what aeroplanes have",
    ),
    "prior": Key(
        "what earlier flights say of the parameters, as `fleet` writes it ([fleet.md](fleet.md#a-prior-for-the-next-"
        "flight)): `flights` in words, `parameters` by name `[value, standard deviation]`",
        default="none",
    ),
    "coefficients": Key(
        "known values by parameter name: what `simulate` flies. Never used by the estimators", default="none"
    ),
    "trim_airspeed": Key("airspeed of simulated flights", "m/s", "that at C_L 0.4", _SPEEDS),
}
_REQUIRED = tuple(name for name, key in KEYS.items() if not key.default)
#: Known keys that a message lists; of more it shows the nearest.
_MOST_LISTED, _NEAREST = 25, 3


@dataclass(frozen=True)
class Aircraft:
    """One aeroplane. Lengths [m], mass [kg], inertia [kg m^2], positions FRD from the centre of gravity."""

    name: str
    mass: float
    wing_area: float
    span: float
    chord: float
    inertia: Vector  # (3, 3), with the products of inertia negative as in (6.19)
    imu_position: Vector
    air_data_position: Vector
    gps_position: Vector
    aerodynamic_reference: Vector
    sensors: dict[str, Sensor]
    process_noise: dict[str, float]
    model: AerodynamicModel
    coefficients: dict[str, float]  # known or prior values by parameter name; empty when nobody knows
    surface_signs: dict[str, float]  # +1 or -1 by surface, on what the recording holds
    ground_altitude: float | None = None  # [m] as the GPS reports it
    magnetic_declination: float | None = None  # [rad]; without it a magnetometer only starts the heading
    minimum_airspeed: float = 0.0  # [m/s] below it the aircraft is not flying and air data are not fused
    trim_airspeed: float | None = None  # [m/s] of simulated flights
    parameter_bounds: dict[str, tuple[float, float]] = field(default_factory=dict)  # outside: never to be used
    prior: FleetPrior | None = None  # of the parameters, from flights before
    inputs: tuple[NamedInput, ...] = ()  # in the order of the file, which is that of their values in samples
    #: Coordinates of sensors that nobody has said, such as ("imu_position", "x"), and one sigma [m] of what was found
    #: of them, which stands in the position; NaN: nothing was.
    unsaid: Mapping[tuple[str, str], float] = field(default_factory=dict)
    source: dict[str, Any] = field(default_factory=dict, compare=False)  # the file as read, to write copies


def load_aircraft(path: str | Path) -> Aircraft:
    """Read and check an aircraft file; raises InputError naming the file, the key and what to mend."""
    content = read_yaml(path, "aircraft file")
    try:
        return aircraft_from_dict(content)
    except InputError as error:
        raise InputError(f"aircraft file {path}: {error}") from None


def aircraft_from_dict(data: Any) -> Aircraft:
    """Check the content of an aircraft file; raises InputError."""
    if not isinstance(data, Mapping):
        raise InputError("it must be a YAML mapping with the keys " + ", ".join(_REQUIRED))
    _check_keys(data, tuple(KEYS), "key")
    missing = [key for key in _REQUIRED if data.get(key) is None]
    if missing:
        raise InputError(f"the required key '{missing[0]}' is missing: add it")
    mass, wing_area, span, chord = (_positive(data, key) for key in ("mass", "wing_area", "span", "chord"))
    inertia = _inertia(data["inertia"])
    check_shape(mass, wing_area, span, chord, inertia)
    stall = np.sqrt(2.0 * mass * STANDARD_GRAVITY / (1.225 * wing_area * _MAXIMUM_LIFT))
    inputs = _inputs(_mapping(data, "inputs", "{trim_tab: {unit: deg}}"))
    terms = _mapping(data, "model", "{CZ: [1, alpha, q, de]}")  # axes that are not named keep their terms
    model = model_from_terms({**TEXTBOOK_TERMS, **terms}, tuple(item.name for item in inputs))
    return Aircraft(
        name=_name(data["name"]),
        mass=mass,
        wing_area=wing_area,
        span=span,
        chord=chord,
        inertia=inertia,
        imu_position=_position(data, "imu_position"),
        air_data_position=_position(data, "air_data_position"),
        gps_position=_position(data, "gps_position"),
        aerodynamic_reference=_position(data, "aerodynamic_reference"),
        sensors=_sensors(_mapping(data, "sensors", "{gyro: {noise: 0.002, rate: 100, delay: 0}}")),
        process_noise=_process_noise(_mapping(data, "process_noise", "{wind: 0.2}")),
        model=model,
        coefficients=_coefficients(_mapping(data, "coefficients", "{CZ_alpha: -4.5}")),
        surface_signs=_surface_signs(_mapping(data, "surface_signs", "{rudder: -1}")),
        ground_altitude=_optional_number(data, "ground_altitude"),
        magnetic_declination=_optional_number(data, "magnetic_declination"),
        minimum_airspeed=_positive(data, "minimum_airspeed", default=0.8 * float(stall)),
        trim_airspeed=_positive(data, "trim_airspeed") if data.get("trim_airspeed") is not None else None,
        unsaid=_unsaid(data),
        parameter_bounds=_bounds(_mapping(data, "parameter_bounds", "{CZ_alpha: [-8, -2]}"), model),
        prior=prior_from_dict(data.get("prior")),
        inputs=inputs,
        source=dict(data),
    )


def with_prior(aircraft: Aircraft, fleet: str | Path | None, airframe: str | None = None) -> Aircraft:
    """The aircraft with the prior of a fleet in its file; as it is where none is named. Raises InputError."""
    if not fleet:
        if airframe:
            raise InputError("--airframe says which one of --prior is meant: give that too")
        return aircraft
    return aircraft_from_dict({**aircraft.source, "prior": read_prior(fleet, airframe or None, aircraft.name)})


def inertia_matrix(xx: float, yy: float, zz: float, xz: float) -> Vector:
    """Inertia of (6.19), shape (3, 3), from moments and the product of inertia xz [kg m^2]."""
    return np.array([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])


def _check_keys(data: Mapping[str, Any], known: tuple[str, ...], kind: str) -> None:
    for key in data:
        if key not in known:
            raise InputError(f"unknown {kind} '{echo(str(key))}': {_hint(str(key), known)}")


def _hint(key: str, known: tuple[str, ...]) -> str:
    """What may have been meant."""
    if hint := did_you_mean(key, known, quote="'"):
        return hint
    if len(known) <= _MOST_LISTED:
        return f"known are {', '.join(known)}"
    near = nearest(key, known, _NEAREST, 0.0)
    return f"the nearest are {', '.join(near)}; names are axis and term, as in the table that replay prints"


def _reject(what: str, wanted: str, value: Any) -> NoReturn:
    """Raise InputError that shows the value if it is a short one: a list may hold itself."""
    if isinstance(value, (list, tuple, set)):
        shown = "a list"
    elif isinstance(value, Mapping):
        shown = "a mapping"
    elif value is None:
        shown = "nothing"
    elif isinstance(value, bool):
        shown = str(value).lower()  # YAML's yes and no, too
    else:
        shown = f"'{echo(str(value))}'"
    raise InputError(f"{what} must be {wanted}, not {shown}")


def _name(value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, (str, int, float)) or not str(value).strip():
        _reject("name", "text (in quotes where YAML would not read it as text)", value)
    return str(value)


def _mapping(data: Mapping[str, Any], key: str, example: str) -> Mapping[str, Any]:
    """An optional mapping; one that is not there is empty."""
    value = data.get(key)
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        _reject(key, f"a mapping such as {example}", value)
    return value


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        _reject(what, "a number", value)
    try:
        number = float(value)  # PyYAML reads 1e-3 as text
    except ValueError:
        _reject(what, "a number", value)
    except OverflowError:
        number = np.inf
    if not np.isfinite(number):
        _reject(what, "a finite number", number)
    return number


def _positive(data: Mapping[str, Any], key: str, default: float | None = None, what: str | None = None) -> float:
    if default is not None and data.get(key) is None:
        return default
    number = _number(data[key], what or key)
    if number <= 0.0:
        raise InputError(f"{what or key} must be positive, not {number:g}")
    return number if key not in KEYS else _within(key, number, what or key)


def _within(key: str, number: float, what: str) -> float:
    """A number that the key of the aircraft file can have."""
    return _between(number, what, KEYS[key].limits, KEYS[key].unit)


def _between(number: float, what: str, limits: tuple[float, float] | None, unit: str) -> float:
    if limits is not None and not limits[0] <= number <= limits[1]:
        raise InputError(
            f"{what} must be between {limits[0]:g} and {limits[1]:g} {unit}".rstrip() + f", not {number:g}"
        )
    return number


def _optional_number(data: Mapping[str, Any], key: str) -> float | None:
    return None if data.get(key) is None else _within(key, _number(data[key], key), key)


def _position(data: Mapping[str, Any], key: str) -> Vector:
    value = data.get(key)
    if value is None:
        return np.zeros(3)
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise InputError(
            f"{key} must be three numbers [x forward, y right, z down] in m, null for one that nobody knows"
        )
    names = [f"{at} of {key}" for at in "xyz"]
    return np.array([_within(key, _coordinate(v, name)[0], name) for v, name in zip(value, names, strict=True)])


def _coordinate(value: Any, name: str) -> tuple[float, float]:
    """A coordinate [m] and one sigma: 0 where it is said, NaN where nobody knows it, else that of what was found."""
    if value is None:
        return 0.0, np.nan
    found, sign, sigma = value.partition("±") if isinstance(value, str) else (value, "", "0")
    try:
        parts = (float(found), float(sigma)) if sign else (_number(found, name), 0.0)
    except ValueError:
        raise InputError(f"{name} must be a number, null, or one that was found, as 0.40 ± 0.02") from None
    if not np.isfinite(parts).all() or not parts[1] >= 0.0:
        raise InputError(f"{name} must be a finite number, and what follows ± 0 or more")
    return parts


def _unsaid(data: Mapping[str, Any]) -> dict[tuple[str, str], float]:
    found = {}
    for key in ("imu_position", "air_data_position"):
        for at, value in zip("xyz", data.get(key) or (None, None, None), strict=True):
            if (sigma := _coordinate(value, at)[1]) != 0.0:
                found[key, at] = sigma
    return found


def _inertia(data: Any) -> Vector:
    if not isinstance(data, Mapping):
        raise InputError("inertia must be a mapping with xx, yy, zz and xz in kg m^2")
    _check_keys(data, ("xx", "yy", "zz", "xz"), "key of inertia")
    for key in ("xx", "yy", "zz"):
        if key not in data:
            raise InputError(f"inertia needs '{key}' in kg m^2")
    xx, yy, zz = (
        _within("inertia", _positive(data, key, what=f"inertia {key}"), f"inertia {key}") for key in ("xx", "yy", "zz")
    )
    xz = _number(data.get("xz", 0.0), "inertia xz")
    if xz * xz >= xx * zz:
        raise InputError("inertia is not that of a body: xz^2 must be less than xx*zz")
    if 1.01 * (xx + yy + zz) < 2.02 * max(xx, yy, zz):
        raise InputError("inertia is not that of a body: none of xx, yy, zz may exceed the sum of the other two")
    return inertia_matrix(xx, yy, zz, xz)


def _noise(value: Any, name: str, sizes: tuple[int, ...], members: tuple[str, ...]) -> tuple[float, ...]:
    values = value if isinstance(value, (list, tuple)) else [value]
    if len(values) not in sizes:
        raise InputError(f"the noise of sensor {name} must have {' or '.join(map(str, sizes))} numbers")
    noise = tuple(_number(v, f"the noise of sensor {name}") for v in values)
    if min(noise) <= 0.0:
        raise InputError(f"the noise of sensor {name} must be positive (one sigma)")
    for member, value in zip(members * (len(noise) if len(members) == 1 else 1), noise, strict=True):
        unit, largest = _NOISE[member]
        _between(value, f"the noise of sensor {name}", (_LEAST_NOISE, largest), unit)
    return noise


def _sensors(data: Mapping[str, Any]) -> dict[str, Sensor]:
    _check_keys(data, (*DEFAULT_SENSORS, *SENSOR_GROUPS, *SENSOR_ALIASES), "sensor")
    sensors = dict(DEFAULT_SENSORS)
    for name in sorted(data, key=lambda key: key not in SENSOR_GROUPS):  # a sensor goes before its group
        value = {} if data[name] is None else data[name]
        if not isinstance(value, Mapping):
            _reject(f"sensor {name}", "a mapping with noise, rate and delay", value)
        _check_keys(value, ("noise", "rate", "delay", "scale", "drift", "offset"), f"key of sensor {name}:")
        members = SENSOR_GROUPS.get(name, (SENSOR_ALIASES.get(name, name),))
        for i, member in enumerate(members):
            sensors[member] = _sensor(sensors[member], value, name, i, members)
    return sensors


def _sensor(base: Sensor, value: Mapping[str, Any], name: str, i: int, members: tuple[str, ...]) -> Sensor:
    member = members[i]
    noise, given = base.noise, base.noise_is_given
    of_gps = member in ("gps_position", "gps_velocity")
    if value.get("noise") is not None:
        given = True
        if len(members) > 1:
            noise = (_noise(value["noise"], name, (len(members),), members)[i],)
        else:
            noise = _noise(value["noise"], name, (1, 3) if of_gps else (1,), members)
        if of_gps and len(noise) == 1:
            noise = noise * 3
    delay = base.delay if value.get("delay") is None else _number(value["delay"], f"the delay of sensor {name}")
    least = -0.5 if member == "control_surfaces" else 0.0  # recorded commands run ahead of the surfaces
    if not least <= delay <= 2.0:
        raise InputError(f"the delay of sensor {name} must be between {least:g} and 2 s, not {delay:g}")
    rate = _positive(value, "rate", default=base.rate, what=f"the rate of sensor {name}")
    _between(rate, f"the rate of sensor {name}", _RATES, "Hz")
    scale = _of_air_data(base.scale, value, "scale", name, member, (0.2, 5.0))
    drift = _of_air_data(base.drift, value, "drift", name, member, (-FASTEST_DRIFT, FASTEST_DRIFT))
    offset = _of_air_data(base.offset, value, "offset", name, member, (-LARGEST_OFFSET, LARGEST_OFFSET))
    if offset and member == "airspeed":
        raise InputError("sensors that may have an offset: angle_of_attack, sideslip, not airspeed")
    return Sensor(noise, rate, delay, given, scale, drift, offset)


def _of_air_data(
    base: float, value: Mapping[str, Any], key: str, name: str, member: str, limits: tuple[float, float]
) -> float:
    """A number that only sensors of the air data have."""
    if value.get(key) is None:
        return base
    if member not in SCALED_SENSORS:
        raise InputError(f"sensor {name} has no {key}: only {', '.join(SCALED_SENSORS)} have one")
    number = _number(value[key], f"the {key} of sensor {name}")
    if not limits[0] <= number <= limits[1]:
        raise InputError(f"the {key} of sensor {name} must be between {limits[0]:g} and {limits[1]:g}, not {number:g}")
    return number


def _process_noise(data: Mapping[str, Any]) -> dict[str, float]:
    _check_keys(data, tuple(DEFAULT_PROCESS_NOISE), "key of process_noise:")
    result = dict(DEFAULT_PROCESS_NOISE)
    for key, value in data.items():
        result[key] = _number(value, f"process_noise {key}")
        if result[key] < 0.0:
            raise InputError(f"process_noise {key} must not be negative")
        unit, largest = _LARGEST_PROCESS_NOISE[key]
        _between(result[key], f"process_noise {key}", (0.0, largest), f"{unit} per √s")
    return result


def _coefficients(data: Mapping[str, Any]) -> dict[str, float]:
    limits = (-_LARGEST_COEFFICIENT, _LARGEST_COEFFICIENT)
    named = {str(name): (f"coefficient {echo(str(name))}", value) for name, value in data.items()}
    return {name: _between(_number(value, what), what, limits, "") for name, (what, value) in named.items()}


def _bounds(data: Mapping[str, Any], model: AerodynamicModel) -> dict[str, tuple[float, float]]:
    """Lowest and highest value by parameter name, of the model or of the textbook."""
    textbook = model_from_terms(TEXTBOOK_TERMS).parameter_names
    _check_keys(data, (*model.parameter_names, *textbook), "parameter in parameter_bounds:")
    return {name: _rising(value, f"parameter_bounds {name}") for name, value in data.items()}


def _inputs(data: Mapping[str, Any]) -> tuple[NamedInput, ...]:
    if len(data) > MOST_INPUTS:
        raise InputError(f"inputs are {len(data)}: at most {MOST_INPUTS} can be named, leave out what no term reads")
    return tuple(_input(str(name), value) for name, value in data.items())


def _input(name: str, value: Any) -> NamedInput:
    if is_reserved(name):
        raise InputError(f"the input '{echo(name)}' has a name that expressions use themselves: give it another one")
    if not is_name(name):
        raise InputError(f"the input '{echo(name)}' cannot stand in a term: name it with letters, digits and _")
    if name in SIGNALS:
        raise InputError(
            f"the input '{echo(name)}' has the name of a signal that there is already: give it another one"
        )
    value = {} if value is None else value
    if not isinstance(value, Mapping):
        _reject(f"input {name}", "a mapping such as {unit: deg}", value)
    _check_keys(value, ("unit", "noise", "limits"), f"key of input {name}:")
    unit = str(value.get("unit", "rad"))
    if unit not in INPUT_UNITS:
        raise InputError(f"input {name} has the unit '{echo(unit)}': use one of {', '.join(INPUT_UNITS)}")
    factor, noise, largest = INPUT_UNITS[unit]
    if value.get("noise") is not None:
        noise = factor * _positive(value, "noise", what=f"the noise of input {name}")
        _between(noise, f"the noise of input {name}", (_LEAST_NOISE, 1e9), "in SI")
    limits = value.get("limits")
    if limits is None:
        return NamedInput(name, factor, noise, (-largest, largest))
    low, high = _rising(limits, f"the limits of input {name}")
    return NamedInput(name, factor, noise, (factor * low, factor * high))


def _rising(value: Any, what: str) -> tuple[float, float]:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        _reject(what, "two numbers [lowest, highest]", value)
    low, high = (_number(v, what) for v in value)
    if low >= high:
        raise InputError(f"{what} must rise, not go from {low:g} to {high:g}")
    return low, high


def _surface_signs(data: Mapping[str, Any]) -> dict[str, float]:
    _check_keys(data, SURFACES, "surface")
    signs = {name: 1.0 for name in SURFACES}
    for name, value in data.items():
        if _number(value, f"surface_signs {name}") not in (1.0, -1.0):
            raise InputError(f"surface_signs {name} must be 1 or -1")
        signs[name] = float(value)
    return signs
