"""The model as the JSON of aerodynamic coefficients that ArduPlane's own simulator reads.

Formula: ``Plane::getForce`` and ``Plane::getTorque``, libraries/SITL/SIM_Plane.cpp of ArduPilot/ardupilot at 05c3a9e3;
names: Tools/autotest/models/skywalker_2013.json at 3fb70208, which pull request 29809 made loadable. The simulator
flies a mass of 2 kg and divides moments by 1 kg m^2 whatever the aeroplane is, and its inputs are -1 to 1. So the
coefficients are scaled: accelerations, not forces, are those of the aeroplane. docs/export.md states the formula.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.export.exported import Exported, header_lines, induced_drag_notes, number_lines
from aircraft_sysid_ros.export.learnt_model import (
    SURFACES,
    LearntModel,
    fitted,
    lost,
    not_held,
    stalled_lift,
    standard_errors,
    thrust_part,
)
from aircraft_sysid_ros.export.level_flight import middle_row, moment_signs

Array = npt.NDArray[np.float64]

VERSIONS = ("pr29809",)
#: ``mass`` in Plane::Plane, and the inertia that getTorque's moments are an acceleration of.
SIMULATED_MASS = 2.0
#: ``max_alpha_delta`` of Plane::liftCoeff: alpha is held within this of alpha_stall.
_ALPHA_HELD = 0.8
#: ``mcoeff`` of the program's own aeroplane.
_BLENDING = 50.0
_LATERAL = ("1", "beta", "p", "r", "da", "dr")
HELD = {
    "CX": ("1", "alpha", "alpha**2", "q"), "CY": _LATERAL, "CZ": ("1", "alpha", "q", "de"),
    "Cl": _LATERAL, "Cm": ("1", "alpha", "q", "de"), "Cn": _LATERAL,
}  # fmt: skip
_OF_SIDE = {"1": "0", "beta": "b", "p": "p", "r": "r", "da": "deltaa", "dr": "deltar"}
#: Prefix of the program's names: axis, and suffix by what is multiplied.
_MOMENTS_AND_SIDE = {
    "c_y": (1, _OF_SIDE), "c_l": (3, _OF_SIDE), "c_n": (5, _OF_SIDE),
    "c_m": (4, {"1": "0", "alpha": "a", "q": "q", "de": "deltae"}),
}  # fmt: skip
#: Induced drag over lift squared that stands for none.
LEAST_INDUCED = 1e-9


def export_ardupilot_sitl(learnt: LearntModel, full: Array) -> Exported:
    """``full`` (3,) [rad]: how far elevator, aileron and rudder go at an input of 1, whichever way makes the moment
    positive, as the program's own aeroplane has it (c_m_deltae, c_l_deltaa and c_n_deltar are positive there).

    Raises InputError without whole rows.
    """
    flown = learnt.flown
    signs = moment_signs(learnt, middle_row(flown))
    full = np.array([signs[name] or 1.0 for name in SURFACES]) * full
    values = coefficients(flown, full)
    thrust = thrust_part(flown)
    misses = lost(flown, body_coefficients(values, flown, flown.signals, full) + thrust)
    missing = (*not_held(learnt, HELD), *_ALWAYS_MISSING)
    lines = header_lines(learnt, "ArduPlane SITL (pull request 29809)", misses, missing)
    travel = "full input is elevator {:.1f}, aileron {:.1f}, rudder {:.1f} deg".format(*np.degrees(full))
    std = standard_errors(flown, lambda model: coefficients(model, full))
    lines += number_lines(values, std)
    lines.append(f"Scaled for a simulated mass of {SIMULATED_MASS:g} kg and an inertia of 1 kg m^2; {travel}")
    doubts = induced_drag_notes(values["oswald"])
    body = json.dumps(values, indent=4)
    return Exported(
        "".join(f"# {line}\n" for line in (*lines, *doubts)) + body + "\n", misses, missing, (travel, *doubts)
    )


_ALWAYS_MISSING = (
    "thrust: the simulator's own, g/0.7 times the mass at full throttle",
    "gyroscopic moments: aerodynamic ones alone are turned into accelerations, with the product of inertia",
    "stall: none was learnt, alpha_stall is as far away as the simulator allows",
)


def coefficients(flown: LearntModel, full: Array) -> dict[str, Any]:
    """All numbers of the file, by least squares over the rows."""
    aircraft = flown.aircraft
    target = simulated(flown, flown.coefficients - thrust_part(flown))
    x = _inputs(flown, flown.signals, full)
    lift = target[:, 0] * np.sin(x["alpha"]) - target[:, 2] * np.cos(x["alpha"])
    drag = -target[:, 0] * np.cos(x["alpha"]) - target[:, 2] * np.sin(x["alpha"])
    reads = {"1", *flown.reads("CX", "CZ")}
    c_lift = fitted({name: x[name] for name in ("1", "alpha", "q", "de")}, lift, reads)
    of_wing = (c_lift["1"] + c_lift["alpha"] * x["alpha"]) ** 2
    of_drag = {"1": x["1"], "wing": of_wing, "q": x["q"], "de": np.abs(x["de"])}
    c_drag = fitted(of_drag, drag, reads | {"wing"})
    aspect = aircraft.span**2 / aircraft.wing_area
    values: dict[str, Any] = {
        "s": aircraft.wing_area, "b": aircraft.span, "c": aircraft.chord,
        "c_lift_0": c_lift["1"], "c_lift_a": c_lift["alpha"], "c_lift_q": c_lift["q"], "c_lift_deltae": c_lift["de"],
        "mcoeff": _BLENDING, "oswald": 1.0 / (np.pi * aspect * (c_drag["wing"] or LEAST_INDUCED)),
        "alpha_stall": _ALPHA_HELD + min(float(x["alpha"].min()), 0.0),
        "c_drag_p": c_drag["1"], "c_drag_q": c_drag["q"], "c_drag_deltae": c_drag["de"],
    }  # fmt: skip
    for prefix, (column, suffixes) in _MOMENTS_AND_SIDE.items():
        # turned into accelerations, rolling and yawing moments mix
        reads = {"1", *flown.reads(*(("Cl", "Cn") if column in (3, 5) else (AXES[column],)))}
        reads |= flown.reads("CX", "CY", "CZ") if column > 2 and flown.aircraft.aerodynamic_reference.any() else set()
        found = fitted({name: x[name] for name in suffixes}, target[:, column], reads)
        values |= {f"{prefix}_{suffix}": found[name] for name, suffix in suffixes.items()}
    values |= dict(zip(("deltae_max", "deltaa_max", "deltar_max"), np.abs(full), strict=True))
    return {**{name: float(value) for name, value in values.items()}, "CGOffset": [0.0, 0.0, 0.0]}


def _inputs(learnt: LearntModel, signals: Array, full: Array) -> dict[str, Array]:
    """What the formula multiplies (n,): its own rates, sideslip atan(v / u), and surfaces -1 to 1."""
    names = learnt.model.signal_names
    x = {name: np.nan_to_num(signals[:, names.index(name)]) for name in ("alpha", "p", "q", "r", *SURFACES)}
    x |= {name: x[name] / limit for name, limit in zip(SURFACES, full, strict=True)}
    return {**x, "1": np.ones(len(signals)), "q": 0.5 * x["q"], "beta": _beta(signals, learnt)}


def _beta(signals: Array, learnt: LearntModel) -> Array:
    """The program's sideslip atan(v / u) [rad] of ours, asin(v / V); 0 where it is not known."""
    names = learnt.model.signal_names
    alpha, beta = (np.nan_to_num(signals[:, names.index(name)]) for name in ("alpha", "beta"))
    return np.asarray(np.arctan2(np.sin(beta), np.cos(beta) * np.cos(alpha)))


def simulated(learnt: LearntModel, ours: Array) -> Array:
    """Coefficients (n, 6) that give the simulator's mass and inertia the accelerations that ours give the aeroplane."""
    about_gravity = ours @ learnt.about_gravity.T
    turned = np.linalg.solve(learnt.aircraft.inertia, (about_gravity[:, 3:] * learnt.arms).T).T
    return np.hstack([ours[:, :3] * SIMULATED_MASS / learnt.aircraft.mass, turned / learnt.arms])


def of_aeroplane(learnt: LearntModel, theirs: Array) -> Array:
    """The inverse of ``simulated``."""
    forces = theirs[:, :3] * learnt.aircraft.mass / SIMULATED_MASS
    moments = (theirs[:, 3:] * learnt.arms) @ learnt.aircraft.inertia.T / learnt.arms
    return np.asarray(np.linalg.solve(learnt.about_gravity, np.hstack([forces, moments]).T).T)


def body_coefficients(c: Mapping[str, Any], learnt: LearntModel, signals: Array, full: Array) -> Array:
    """C_X … C_n (n, 6) of the aeroplane, without thrust, that the simulator's formula gives on signal rows."""
    x = _inputs(learnt, signals, full)
    alpha = x["alpha"]
    lift = lift_of(c, alpha) + c["c_lift_q"] * x["q"] + c["c_lift_deltae"] * x["de"]
    drag = c["c_drag_p"] + (c["c_lift_0"] + c["c_lift_a"] * alpha) ** 2 / (np.pi * c["oswald"] * c["b"] ** 2 / c["s"])
    drag = drag + c["c_drag_q"] * x["q"] + c["c_drag_deltae"] * np.abs(x["de"])
    theirs = np.empty((len(signals), 6))
    theirs[:, 0] = -drag * np.cos(alpha) + lift * np.sin(alpha)
    theirs[:, 2] = -drag * np.sin(alpha) - lift * np.cos(alpha)
    for prefix, (column, suffixes) in _MOMENTS_AND_SIDE.items():
        theirs[:, column] = np.sum([c[f"{prefix}_{suffix}"] * x[name] for name, suffix in suffixes.items()], axis=0)
    return of_aeroplane(learnt, theirs)


def lift_of(c: Mapping[str, Any], alpha: Array) -> Array:
    """``Plane::liftCoeff``."""
    held = np.clip(alpha, c["alpha_stall"] - _ALPHA_HELD, c["alpha_stall"] + _ALPHA_HELD)
    return stalled_lift(c["c_lift_0"] + c["c_lift_a"] * held, held, c["alpha_stall"], c["mcoeff"])
