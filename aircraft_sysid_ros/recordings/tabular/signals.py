"""The signals that columns may be mapped to: name, SI unit, axes (FRD and NED)."""

from __future__ import annotations

from collections.abc import Iterable

from aircraft_sysid_ros.aircraft.expression import is_name, is_reserved
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.spelling import did_you_mean

#: SI unit by signal, as pint writes it; a signal without a dimension has "1".
UNITS: dict[str, str] = {
    **{f"specific_force.{axis}": "m/s^2" for axis in "xyz"},
    **{f"angular_velocity.{axis}": "rad/s" for axis in "xyz"},
    **{f"attitude.{angle}": "rad" for angle in ("roll", "pitch", "yaw")},
    "latitude": "rad", "longitude": "rad", "altitude": "m",
    **{f"position.{axis}": "m" for axis in ("north", "east", "down")},
    **{f"velocity.{axis}": "m/s" for axis in ("north", "east", "down")},
    "pressure_altitude": "m", "static_pressure": "Pa", "dynamic_pressure": "Pa",
    "air_temperature": "K", "air_density": "kg/m^3",
    "true_airspeed": "m/s", "calibrated_airspeed": "m/s", "indicated_airspeed": "m/s",
    "angle_of_attack": "rad", "sideslip": "rad",
    "elevator": "rad", "aileron": "rad", "rudder": "rad", "flaps": "rad",
    "throttle": "1", "thrust": "N", "propeller_speed": "rad/s",
    "height_above_ground": "m", "mass": "kg",
}  # fmt: skip
INPUTS = "inputs."
#: Signals that are one vector: a row counts where any of them is measured.
VECTORS: dict[str, tuple[str, ...]] = {
    "specific_force": tuple(f"specific_force.{axis}" for axis in "xyz"),
    "angular_velocity": tuple(f"angular_velocity.{axis}" for axis in "xyz"),
    "attitude": ("attitude.roll", "attitude.pitch", "attitude.yaw"),
    "geodetic": ("latitude", "longitude", "altitude"),
    "position": ("position.north", "position.east", "position.down"),
    "velocity": ("velocity.north", "velocity.east", "velocity.down"),
    "controls": ("elevator", "aileron", "rudder", "flaps", "throttle", "thrust", "propeller_speed"),
}
_VECTOR_OF = {signal: vector for vector, signals in VECTORS.items() for signal in signals}


#: By SI unit a magnitude that no signal of it has, and that no mistaken unit explains: a wrong unit is for ``check``.
_WILD = {"1": 1e7, "rad": 1e10, "rad/s": 1e9, "m/s^2": 1e9, "m/s": 1e9, "m": 1e12, "K": 1e7, "kg/m^3": 1e7}
_WILD_OF_OTHERS = 1e12


def check_signal(name: str) -> None:
    """Raises InputError for a name that is no signal, with the nearest ones."""
    if name in UNITS:
        return
    if name.startswith(INPUTS):
        own = name.removeprefix(INPUTS)
        if is_reserved(own) or own in SIGNALS:
            raise InputError(f"'{name}' has a name that terms of a model use otherwise: give the input another one")
        if not is_name(own):
            raise InputError(f"'{name}' is not a name for an input: write letters, digits and _ after '{INPUTS}'")
        return
    raise InputError(f"unknown signal '{name}': {near(name, [*UNITS, INPUTS + 'NAME'])}")


def unit_of(signal: str) -> str | None:
    """SI unit of a signal; None for an input, which may have any dimension."""
    return UNITS.get(signal)


def wild_beyond(signal: str) -> float:
    """Magnitude [SI] beyond which a value of a signal was never measured."""
    return _WILD.get(unit_of(signal) or "", _WILD_OF_OTHERS)


def vector_of(signal: str) -> str:
    """The vector that a signal is a part of, or its own name."""
    return "inputs" if signal.startswith(INPUTS) else _VECTOR_OF.get(signal, signal)


def place_in_vector(signal: str) -> int:
    """Which component of its vector a signal is; 0 for one that is none."""
    vector = VECTORS.get(_VECTOR_OF.get(signal, ""), ())
    return vector.index(signal) if signal in vector else 0


def near(name: str, known: Iterable[str]) -> str:
    """What may have been meant, for the end of a message."""
    names = list(known)
    if hint := did_you_mean(name, reversed(names), 3, 0.5, "'"):
        return hint
    shown = ", ".join(names[:25])
    return f"there are {shown}{' …' if len(names) > 25 else ''}" if names else "there are none"
