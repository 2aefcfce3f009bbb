"""The aircraft file: geometry, mass, sensors and model of one aeroplane, checked once when it is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import TEXTBOOK_TERMS, AerodynamicModel, model_from_terms
from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.file_values import (
    between,
    check_keys,
    mapping_of,
    number_of,
    positive,
    reject,
    rising,
    said_or_found,
)
from aircraft_sysid_ros.aircraft.fleet_prior import FleetPrior, prior_from_dict, read_prior
from aircraft_sysid_ros.aircraft.named_inputs import NamedInput, inputs_of
from aircraft_sysid_ros.aircraft.sensor_settings import DEFAULT_PROCESS_NOISE, Sensor, process_noise_of, sensors_of
from aircraft_sysid_ros.aircraft.shape import check_place, check_shape
from aircraft_sysid_ros.aircraft.signals import MOST_INPUTS
from aircraft_sysid_ros.errors import InputError, echo, one_line
from aircraft_sysid_ros.yaml_file import read_yaml

Vector = npt.NDArray[np.float64]


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
    "from the centre of gravity, FRD; `null` for an unknown coordinate, `0.40 ± 0.02` for one that was estimated"
)
_NEAR, _SPEEDS = (-200.0, 200.0), (0.01, 2000.0)
KEYS = {
    "name": Key("name of the aircraft in results"),
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
        "for each sensor `noise` (one sigma per sample), `rate` [Hz], `delay` [s]; for `airspeed`, `angle_of_attack` "
        "and `sideslip` also `scale` (measured = scale × true) and `drift` from the start of the filter (airspeed: "
        "share per second; an angle: rad/s); for the angles also `offset` [rad] "
        "(measured = scale × (true + offset + drift × time)); for `control_surfaces` also `lag` [s], the time constant "
        "with which the servos follow what is recorded. A lag or delay that was estimated may be given as "
        "`0.060 ± 0.003`",
        default="small UAV",
    ),
    "process_noise": Key(
        "random walks per √s: `accelerometer_bias`, `gyro_bias`, `wind`",
        default=", ".join(f"{value:g}" for value in DEFAULT_PROCESS_NOISE.values()),
    ),
    "model": Key(
        "terms per axis, as expressions of the signals; an axis that is not listed keeps its default terms, `[]`: none",
        default="the 32 terms of (6.25)",
    ),
    "inputs": Key(
        f"further inputs of the recording, by name, that terms may use as signals, at most {MOST_INPUTS}: for each its "
        "`unit` in the recording, `noise` (one sigma) and `limits` `[lowest, highest]`, both in that unit",
        "rad, deg, 1, N, W, rad/s",
        "none; rad",
    ),
    "surface_signs": Key("+1 or -1 for each surface: factor on the recorded deflection", default="1"),
    "minimum_airspeed": Key(
        "airspeed below which the aircraft is not flying",
        "m/s",
        f"0.8 of a stall speed at C_L {_MAXIMUM_LIFT:g}",
        _SPEEDS,
    ),
    "ground_altitude": Key(
        "altitude of the ground as the GPS reports it, for height",
        "m",
        "where the aircraft stood; none if the flight begins in the air",
        (-1000.0, 1e5),
    ),
    "magnetic_declination": Key(
        "declination; without it a magnetometer only starts the heading", "rad", "none", (-float(np.pi), float(np.pi))
    ),
    "parameter_bounds": Key(
        "by parameter name `[lowest, highest]`, narrower than physics allows: outside these a parameter never has USE "
        "([trust.md](trust.md))",
        default="the range of real aircraft",
    ),
    "prior": Key(
        "prior for the parameters from earlier flights, as `fleet` writes it ([fleet.md](fleet.md#a-prior-for-the-next-"
        "flight)): `flights` in words, `parameters` by name `[value, standard deviation]`",
        default="none",
    ),
    "coefficients": Key(
        "known values by parameter name, which `simulate` flies; never used by the estimators", default="none"
    ),
    "trim_airspeed": Key("airspeed of simulated flights", "m/s", "that at C_L 0.4", _SPEEDS),
}
_REQUIRED = tuple(name for name, key in KEYS.items() if not key.default)


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
    """Read and check an aircraft file; raises InputError naming the file, the key and what to correct."""
    content = read_yaml(path, "aircraft file")
    try:
        return aircraft_from_dict(content)
    except InputError as error:
        raise InputError(f"aircraft file {path}: {error}") from None


def aircraft_from_dict(data: Any) -> Aircraft:
    """Check the content of an aircraft file; raises InputError."""
    if not isinstance(data, Mapping):
        raise InputError("it must be a YAML mapping with the keys " + ", ".join(_REQUIRED))
    check_keys(data, tuple(KEYS), "key")
    missing = [key for key in _REQUIRED if data.get(key) is None]
    if missing:
        raise InputError(f"the required key '{missing[0]}' is missing: add it")
    mass, wing_area, span, chord = (_positive(data, key) for key in ("mass", "wing_area", "span", "chord"))
    inertia = _inertia(data["inertia"])
    check_shape(mass, wing_area, span, chord, inertia)
    stall = np.sqrt(2.0 * mass * STANDARD_GRAVITY / (1.225 * wing_area * _MAXIMUM_LIFT))
    inputs = inputs_of(mapping_of(data, "inputs", "{trim_tab: {unit: deg}}"))
    terms = mapping_of(data, "model", "{CZ: [1, alpha, q, de]}")  # axes that are not named keep their terms
    model = model_from_terms({**TEXTBOOK_TERMS, **terms}, tuple(item.name for item in inputs))
    return Aircraft(
        name=_name(data["name"]),
        mass=mass,
        wing_area=wing_area,
        span=span,
        chord=chord,
        inertia=inertia,
        imu_position=_position(data, "imu_position", span),
        air_data_position=_position(data, "air_data_position", span),
        gps_position=_position(data, "gps_position", span),
        aerodynamic_reference=_position(data, "aerodynamic_reference", span),
        sensors=sensors_of(mapping_of(data, "sensors", "{gyro: {noise: 0.002, rate: 100, delay: 0}}")),
        process_noise=process_noise_of(mapping_of(data, "process_noise", "{wind: 0.2}")),
        model=model,
        coefficients=_coefficients(mapping_of(data, "coefficients", "{CZ_alpha: -4.5}")),
        surface_signs=_surface_signs(mapping_of(data, "surface_signs", "{rudder: -1}")),
        ground_altitude=_optional_number(data, "ground_altitude"),
        magnetic_declination=_optional_number(data, "magnetic_declination"),
        minimum_airspeed=_positive(data, "minimum_airspeed", default=0.8 * float(stall)),
        trim_airspeed=_positive(data, "trim_airspeed") if data.get("trim_airspeed") is not None else None,
        unsaid=_unsaid(data),
        parameter_bounds=_bounds(mapping_of(data, "parameter_bounds", "{CZ_alpha: [-8, -2]}"), model),
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


def _name(value: Any) -> str:
    """On one line, since it stands in comments of other programs' files."""
    if isinstance(value, bool) or not isinstance(value, (str, int, float)) or not str(value).strip():
        reject("name", "text (in quotes where YAML would not read it as text)", value)
    name = " ".join(str(value).split())
    if one_line(name) != name:
        reject("name", "text that prints", value)
    return name


def _positive(data: Mapping[str, Any], key: str, default: float | None = None) -> float:
    if default is not None and data.get(key) is None:
        return default
    return _within(key, positive(data[key], key), key)


def _within(key: str, number: float, what: str) -> float:
    """A number that the key of the aircraft file can have."""
    return between(number, what, KEYS[key].limits, KEYS[key].unit)


def _optional_number(data: Mapping[str, Any], key: str) -> float | None:
    return None if data.get(key) is None else _within(key, number_of(data[key], key), key)


def _position(data: Mapping[str, Any], key: str, span: float) -> Vector:
    value = data.get(key)
    if value is None:
        return np.zeros(3)
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise InputError(f"{key} must be three numbers [x forward, y right, z down] in m, null for an unknown one")
    names = [f"{at} of {key}" for at in "xyz"]
    place = np.array([_within(key, _coordinate(v, name)[0], name) for v, name in zip(value, names, strict=True)])
    check_place(key, place, span)
    return place


def _coordinate(value: Any, name: str) -> tuple[float, float]:
    """A coordinate [m] and one sigma: 0 where it is said, NaN where nobody knows it, else that of what was found."""
    return (0.0, np.nan) if value is None else said_or_found(value, name, "0.40 ± 0.02", "null, ")


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
    check_keys(data, ("xx", "yy", "zz", "xz"), "key of inertia")
    for key in ("xx", "yy", "zz"):
        if key not in data:
            raise InputError(f"inertia needs '{key}' in kg m^2")
    xx, yy, zz = (
        _within("inertia", positive(data[key], f"inertia {key}"), f"inertia {key}") for key in ("xx", "yy", "zz")
    )
    xz = number_of(data.get("xz", 0.0), "inertia xz")
    if xz * xz >= xx * zz:
        raise InputError("inertia is not that of a body: xz^2 must be less than xx*zz")
    if 1.01 * (xx + yy + zz) < 2.02 * max(xx, yy, zz):
        raise InputError("inertia is not that of a body: none of xx, yy, zz may exceed the sum of the other two")
    return inertia_matrix(xx, yy, zz, xz)


def _coefficients(data: Mapping[str, Any]) -> dict[str, float]:
    limits = (-_LARGEST_COEFFICIENT, _LARGEST_COEFFICIENT)
    named = {str(name): (f"coefficient {echo(str(name))}", value) for name, value in data.items()}
    return {name: between(number_of(value, what), what, limits, "") for name, (what, value) in named.items()}


def _bounds(data: Mapping[str, Any], model: AerodynamicModel) -> dict[str, tuple[float, float]]:
    """Lowest and highest value by parameter name, of the model or of the textbook."""
    textbook = model_from_terms(TEXTBOOK_TERMS).parameter_names
    check_keys(data, (*model.parameter_names, *textbook), "parameter in parameter_bounds:")
    return {name: rising(value, f"parameter_bounds {name}") for name, value in data.items()}


def _surface_signs(data: Mapping[str, Any]) -> dict[str, float]:
    check_keys(data, SURFACES, "surface")
    signs = {name: 1.0 for name in SURFACES}
    for name, value in data.items():
        if number_of(value, f"surface_signs {name}") not in (1.0, -1.0):
            raise InputError(f"surface_signs {name} must be 1 or -1")
        signs[name] = float(value)
    return signs
