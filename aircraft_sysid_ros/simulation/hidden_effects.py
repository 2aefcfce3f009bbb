"""Effects of the library as truth: what is really there in a flight while the user's aircraft file knows nothing of it.

Terms of the aerodynamics come from effect_recipes with numbers drawn from the seed; what happens to mass, sensors,
actuators or wind is made here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.effects import effect_of
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.sensors.sensor_models import generator
from aircraft_sysid_ros.simulation.dynamics import Effect, trim_airspeed_of
from aircraft_sysid_ros.simulation.effect_recipes import RECIPES, STEP, Recipe

Array = npt.NDArray[np.float64]
Setting = tuple[tuple[str, ...], float]
Coefficients = Mapping[str, float]

#: When changes happen, as shares of the flight.
EARLIEST, LATEST = 0.3, 0.7
#: Strengths that make sense: more would leave the validity of the recipes.
STRONGEST = 3.0
_GUST_RISE = 3.0  # [s]


@dataclass(frozen=True)
class Hidden:
    """One effect in one flight: the truth that a diagnosis is to find.

    ``terms`` are what the true aerodynamics has beyond the model, as numbers; ``settings`` are what the aircraft file
    should have said of the measurement. ``inner`` holds the drawn numbers, with ``t0`` [s] of a change.
    """

    identifier: str
    variant: str = ""
    strength: float = 1.0
    inner: Mapping[str, float] = field(default_factory=dict)
    terms: tuple[Effect, ...] = ()
    settings: tuple[Setting, ...] = ()
    native: tuple[tuple[str, str], ...] = ()  # axes and terms that the simulator has without our doing
    mass_factor: float = 1.0  # on the mass from t0 on
    cg_shift: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] FRD from t0 on
    air_data_lag: float = 0.0  # [s] time constant
    command_lag: float = 0.0  # [s] time constant of the actuators whose commands are recorded
    command_dead_time: float = 0.0  # [s] and dead time
    gust: tuple[float, float] = (0.0, 0.0)  # [m/s] north, east, from t0 on

    def sensors_of(self, aircraft: Aircraft) -> Aircraft:
        """The aircraft as its sensors really are: scales, drifts, places; lags of air data are flown and not set."""
        for path, value in self.settings:
            of_motion = path[:2] in (("sensors", "imu"), ("sensors", "gps"))
            if of_motion or path[-1] in ("scale", "drift", "offset") or path[0].endswith("_position"):
                aircraft = with_setting(aircraft, path, value)
        return aircraft

    def wind(self, time: Array) -> Array:
        """What the effect adds to the wind NED (n, 3) [m/s]."""
        rise = np.clip((time - self.inner.get("t0", 0.0)) / _GUST_RISE, 0.0, 1.0)
        result: Array = rise[:, None] * np.array([*self.gust, 0.0])
        return result

    def oracle(self, aircraft: Aircraft, coefficients: Coefficients) -> Aircraft:
        """The aircraft file of one who knows the effect: its true terms in the model, the right settings.

        ``coefficients`` are the true ones of the model without the effect; mass and centre of gravity need them.
        """
        for path, value in self.settings:
            aircraft = with_setting(aircraft, path, value)
        terms = {axis: list(listed) for axis, listed in aircraft.model.terms.items()}
        added = [(term.axis, term.expression) for term in self.terms]
        for axis, text in [*added, *self.native, *self._apparent(aircraft, coefficients)]:
            text = parse_expression(text, aircraft.model.inputs).text
            if text not in terms[axis]:
                terms[axis].append(text)
        model = model_from_terms(terms, aircraft.model.inputs)
        return aircraft_from_dict({**aircraft.source, "model": {k: list(v) for k, v in model.terms.items()}})

    def _apparent(self, aircraft: Aircraft, coefficients: Coefficients) -> list[tuple[str, str]]:
        """Axes and terms by which coefficients worked out with the mass properties of the file are wrong."""
        if self.mass_factor == 1.0 and not any(self.cg_shift):
            return []
        step = STEP.format(t0=self.inner["t0"])
        forces = {axis: f"{step}*({_text(aircraft, coefficients, axis)})" for axis in ("CX", "CY", "CZ")}
        if self.mass_factor != 1.0:
            return list(forces.items())
        x, y, _ = self.cg_shift
        along = [("Cm", forces["CZ"]), ("Cn", forces["CY"])] if x else []
        return along + ([("Cl", forces["CZ"]), ("Cn", forces["CX"])] if y else [])

    def document(self) -> dict[str, Any]:
        """For truth.json."""
        return {
            "effect": self.identifier,
            "variant": self.variant,
            "strength": self.strength,
            "inner": dict(self.inner),
            "terms": [{"axis": t.axis, "expression": t.expression, "value": t.value} for t in self.terms],
            "native": [{"axis": axis, "expression": text} for axis, text in self.native],
            "settings": [{"key": list(path), "value": value} for path, value in self.settings],
            "mass_factor": self.mass_factor,
            "cg_shift": list(self.cg_shift),
            "gust": list(self.gust),
            "air_data_lag": self.air_data_lag,
            "command_lag": self.command_lag,
            "command_dead_time": self.command_dead_time,
        }


def _text(aircraft: Aircraft, coefficients: Coefficients, axis: str) -> str:
    names, terms = aircraft.model.parameter_names[aircraft.model.axis_slice(axis)], aircraft.model.terms[axis]
    known = [(n, t) for n, t in zip(names, terms, strict=True) if n in coefficients]  # not those of other effects
    return "+".join(f"{coefficients[n]:.6g}*{t}" for n, t in known)


def hidden_effect(
    identifier: str,
    strength: float,
    seed: int,
    duration: float,
    aircraft: Aircraft,
    coefficients: Coefficients,
    trim: tuple[float, float] = (0.05, 0.0),
) -> Hidden:
    """An effect of the library in a flight of ``duration`` [s], drawn from a seed.

    ``coefficients`` by name: values of recipes are shares of them, and of one that is not there there is no share.
    ``trim``: angle of attack and elevator [rad] in cruise. InputError for an id that is not in the library, for one of
    which nothing is left without the coefficients that are not there, and for a strength that is not from 0 to
    STRONGEST.
    """
    effect_of(identifier)  # says what there is
    if identifier not in SIMULATED:
        raise InputError(f"{identifier} is in the library, but no simulated flight can hide it")
    if not 0.0 <= strength <= STRONGEST:
        raise InputError(f"the strength of {identifier} must be from 0 to {STRONGEST:g}, not {strength:g}")
    rng = generator(seed, "effect " + identifier)
    t0 = round(float(rng.uniform(EARLIEST, LATEST)) * duration, 3)
    if identifier in _OTHER:
        return _OTHER[identifier](_Draw(identifier, strength, t0, float(rng.choice([-1.0, 1.0])), rng, aircraft))
    recipe = RECIPES[identifier]
    spin = 6e-5 * aircraft.mass * aircraft.span**2  # [kg m^2] of a usual propeller
    sizes = {**coefficients, "propeller": spin / (aircraft.span * aircraft.wing_area * aircraft.chord), "": 1.0}
    variants = {name: [t for t in terms if t.coefficient in sizes] for name, terms in recipe.variants.items()}
    possible = [name for name, terms in variants.items() if terms]
    if not possible:
        changed = dict.fromkeys(term.coefficient for terms in recipe.variants.values() for term in terms)
        raise InputError(f"{identifier} changes {' '.join(changed)}, of which the aircraft file has none")
    variant = str(rng.choice(possible))
    inner = {name: round(float(rng.uniform(*limits)), 4) for name, limits in recipe.inner.items()}
    numbers = {
        **inner, "t0": t0, "span": aircraft.span, "qbar": 0.6 * trim_airspeed_of(aircraft) ** 2,
        "trim_alpha": trim[0], "trim_de": trim[1],
    }  # fmt: skip
    terms = []
    for term in variants[variant]:
        text = term.expression.format(**{k: f"({v:.6g})" for k, v in numbers.items()})
        terms.append(Effect(term.axis, text, strength * term.factor * sizes[term.coefficient]))
    if any("{t0}" in term.expression for term in variants[variant]):
        inner["t0"] = t0
    return Hidden(identifier, variant, strength, inner, tuple(terms))


class _Draw(NamedTuple):
    """What the effects that are no terms are made from."""

    name: str
    strength: float
    t0: float
    sign: float
    rng: np.random.Generator
    aircraft: Aircraft


def _mass_change(d: _Draw) -> Hidden:
    return Hidden(d.name, "", d.strength, {"t0": d.t0}, mass_factor=1.0 - 0.22 * d.strength)


def _cg_shift(d: _Draw) -> Hidden:
    if d.rng.uniform() < 0.6:
        shift = (-0.06 * d.strength * d.aircraft.chord, 0.0, 0.0)
        return Hidden(d.name, "along the fuselage", d.strength, {"t0": d.t0}, cg_shift=shift)
    shift = (0.0, d.sign * 0.012 * d.strength * d.aircraft.span, 0.0)
    return Hidden(d.name, "along the wing", d.strength, {"t0": d.t0}, cg_shift=shift)


def _scale(d: _Draw) -> Hidden:
    sensor, size = {
        "alpha_scale": ("angle_of_attack", 0.15),
        "beta_scale": ("sideslip", 0.18),
        "airspeed_scale": ("airspeed", 0.08),
    }[d.name]
    value = 1.0 + d.sign * d.strength * size
    return Hidden(d.name, "", d.strength, {"scale": value}, settings=((("sensors", sensor, "scale"), value),))


def _drift(d: _Draw) -> Hidden:
    """A pitot that ices shows ever less, a vane bends to either side: over a minute so much, at full strength."""
    sensor, each_minute = {
        "alpha_drift": ("angle_of_attack", d.sign * np.radians(1.5)),
        "beta_drift": ("sideslip", d.sign * np.radians(1.5)),
        "airspeed_drift": ("airspeed", -0.03),
    }[d.name]
    value = float(d.strength * each_minute / 60.0)
    return Hidden(d.name, "", d.strength, {"drift": value}, settings=((("sensors", sensor, "drift"), value),))


def _vane_offset(d: _Draw) -> Hidden:
    """A vane that is mounted wrong: 2° at full strength."""
    sensor = {"alpha_offset": "angle_of_attack", "beta_offset": "sideslip"}[d.name]
    value = float(d.strength * d.sign * np.radians(2.0))
    return Hidden(d.name, "", d.strength, {"offset": value}, settings=((("sensors", sensor, "offset"), value),))


def _air_data_lag(d: _Draw) -> Hidden:
    lag = 0.12 * d.strength
    setting = (("sensors", "air_data", "delay"), lag)
    return Hidden(d.name, "all air data", d.strength, {"delay": lag}, settings=(setting,), air_data_lag=lag)


def _late(d: _Draw) -> Hidden:
    """A sensor of the motion whose stamps are those of arrival."""
    sensor, most = {"imu_lag": ("imu", 0.1), "gps_lag": ("gps", 0.3)}[d.name]
    lag = most * d.strength
    return Hidden(d.name, "", d.strength, {"delay": lag}, settings=((("sensors", sensor, "delay"), lag),))


def _actuator_lag(d: _Draw) -> Hidden:
    lag, dead_time = 0.05 * d.strength, 0.06 * d.strength
    delay = -(dead_time + np.log(2.0) * lag)  # when half of a step is done
    setting = (("sensors", "control_surfaces", "delay"), float(delay))
    return Hidden(
        d.name, "", d.strength, {"delay": float(delay)}, settings=(setting,), command_lag=lag,
        command_dead_time=dead_time,
    )  # fmt: skip


def _offset(d: _Draw) -> Hidden:
    position, size = {"probe_offset": ("air_data_position", 0.35), "imu_offset": ("imu_position", 0.1)}[d.name]
    axis = str(d.rng.choice(["x", "y"]))
    shift = d.sign * d.strength * size
    variant = {"x": "ahead", "y": "sideways"}[axis]
    return Hidden(d.name, variant, d.strength, {"shift": shift}, settings=(((position, axis), shift),))


def _wind_change(d: _Draw) -> Hidden:
    size, direction = 0.3 * d.strength * trim_airspeed_of(d.aircraft), d.rng.uniform(0.0, 2.0 * np.pi)
    gust = (float(size * np.cos(direction)), float(size * np.sin(direction)))
    walk = float(size / np.sqrt(_GUST_RISE))
    setting = (("process_noise", "wind"), walk)
    return Hidden(d.name, "", d.strength, {"t0": d.t0, "walk": walk}, settings=(setting,), gust=gust)


#: Effects that are not terms of the aerodynamics, and the flights in which they show.
_OTHER: dict[str, Callable[[_Draw], Hidden]] = {
    "mass_change": _mass_change, "cg_shift": _cg_shift, "alpha_scale": _scale, "beta_scale": _scale,
    "airspeed_scale": _scale,
    "alpha_offset": _vane_offset, "beta_offset": _vane_offset,
    "alpha_drift": _drift, "beta_drift": _drift, "airspeed_drift": _drift,
    "air_data_lag": _air_data_lag, "imu_lag": _late, "gps_lag": _late, "actuator_lag": _actuator_lag,
    "probe_offset": _offset, "imu_offset": _offset, "wind_change": _wind_change,
}  # fmt: skip
#: Ids that a simulated flight can hide.
SIMULATED = (*RECIPES, *_OTHER)


def plans_of(identifier: str) -> tuple[str, ...]:
    """Kinds of flights (varied_plan.PLANS) in which an effect shows."""
    return RECIPES[identifier].plans if identifier in RECIPES else Recipe().plans
