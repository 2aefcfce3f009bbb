"""JSBSim aeroplanes as subjects of a diagnosis: what a good aircraft file of each says, and what they have hidden.

JSBSim's aeroplanes are no textbook: their own slipstream, gyroscopic moments, flow rates and drag of sideslip must
stand in the aircraft file, or no flight is clean. BASE_TERMS were found on noiseless coefficients of flights of all
kinds: of about forty products of physics all that changed the fit by little were dropped, one by one. An effect that
an aeroplane has itself is hidden by leaving its terms out of the file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import TEXTBOOK_TERMS, textbook_model
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.hidden_effects import Hidden, hidden_effect
from aircraft_sysid_ros.simulation.hidden_flight import low_passes
from aircraft_sysid_ros.simulation.jsbsim_effects import fly_jsbsim_hidden
from aircraft_sysid_ros.simulation.jsbsim_flight import (
    GROUND,
    RATE,
    JsbsimSetup,
    excitation_of,
    fly_jsbsim,
    prepare_jsbsim,
    projection,
    signals_of,
)
from aircraft_sysid_ros.simulation.manoeuvres import Plan
from aircraft_sysid_ros.simulation.varied_plan import plan_of

Array = npt.NDArray[np.float64]
Terms = Mapping[str, tuple[str, ...]]

_SPIN_PITCH, _SPIN_YAW, _TORQUE = (
    "propeller_speed*r*V/qbar", "propeller_speed*q*V/qbar", "propeller_speed**2/qbar",
)  # fmt: skip
_DRAG = ("beta**2", "abs(beta)", "de**2")
#: Terms that each aeroplane needs besides the 32.
BASE_TERMS: dict[str, Terms] = {
    "c172p": {
        "CX": ("alpha*de", *_DRAG, "de*abs(de)"),
        "CY": ("beta*abs(beta)",),
        "CZ": ("alpha**2",),
        "Cl": ("alpha*r", "qbar", _TORQUE),
        "Cm": ("alpha_dot", "Tc", "Tc*de", _SPIN_PITCH),
        "Cn": ("Tc*dr", _SPIN_YAW),
    },
    "c182": {
        "CX": ("alpha*de", *_DRAG, "de*abs(de)"),
        "CY": ("beta*abs(beta)",),
        "CZ": ("alpha**2",),
        "Cl": ("alpha*r", "alpha**2*r", _TORQUE),
        "Cm": ("alpha*de", "alpha_dot", "Tc", _SPIN_PITCH, "alpha**2*de"),
        "Cn": ("alpha*beta", "alpha*da", _SPIN_YAW, "alpha**2*p"),
    },
    "J3Cub": {
        "CX": ("alpha**3", *_DRAG),
        "CY": ("alpha*beta", "beta*abs(beta)", "qbar*da"),
        "CZ": ("alpha**2", "alpha**3"),
        "Cl": ("alpha*beta", "alpha*r", "alpha**2*r", _TORQUE),
        "Cm": ("alpha**2", "alpha_dot", "Tc", "Tc*de", "qbar*alpha", _SPIN_PITCH, "p"),
        "Cn": ("Tc*dr", _SPIN_YAW, "qbar*da"),
    },
}
#: Effects that JSBSim's aeroplanes have themselves, with the terms of the file that say so.
OWN: dict[str, Terms] = {
    "alpha_dot": {"Cm": ("alpha_dot",)},
    "thrust_offset": {"Cm": ("Tc",)},
    "propwash": {"Cm": ("Tc*de",), "Cn": ("Tc*dr",)},
    "propeller_gyroscopic": {"Cm": (_SPIN_PITCH,), "Cn": (_SPIN_YAW,)},
    "propeller_torque": {"Cl": (_TORQUE,)},
    "sideslip_drag": {"CX": ("beta**2", "abs(beta)")},
    "lift_tilt": {"CX": ("alpha*de",)},
}
#: Effects of their own that show only in a flight that goes there, and the terms that describe them best.
_NEAR = "exp(-3*max(height,0)/{span:.4g})"
SHOWN_BY_FLYING: dict[str, Terms] = {
    "flaps": {
        "CZ": ("flaps", "flaps**2", "flaps*alpha"), "CX": ("flaps", "flaps**2", "flaps*alpha"),
        "Cm": ("flaps", "flaps**2", "flaps*alpha"), "CY": ("flaps*beta", "flaps*p"), "Cl": ("flaps*r",),
    },
    "ground_effect": {
        "CZ": (_NEAR, f"{_NEAR}*alpha"), "CX": (_NEAR, f"{_NEAR}*alpha"), "Cm": (_NEAR, f"{_NEAR}*alpha"),
    },
}  # fmt: skip
#: What an aeroplane cannot show: no flaps; too slow for compressibility; no stall within reach of the manoeuvres.
IMPOSSIBLE: dict[str, tuple[str, ...]] = {
    "c172p": ("compressibility",), "c182": ("compressibility",),
    "J3Cub": ("compressibility", "dynamic_stall", "flaps", "stall"),
}  # fmt: skip


@cache
def prepared(name: str) -> tuple[JsbsimSetup, dict[str, float]]:
    """Setup of an aeroplane, and its coefficients of the 32 terms in a clean flight: sizes of what is hidden."""
    setup = prepare_jsbsim(name)
    truth = fly_jsbsim(setup, np.zeros((int(60 * RATE) + 1, 3)))[::8]
    return setup, projection(textbook_model(), signals_of(setup.aircraft, truth), truth.coefficients)


def jsbsim_effects(name: str, hidden: Sequence[tuple[str, float]], seed: int, duration: float) -> tuple[Hidden, ...]:
    """What is hidden in a flight, drawn from the seed; what the aeroplane has itself is hidden at full strength.

    InputError for an effect that it cannot show.
    """
    setup, coefficients = prepared(name)
    trim = (setup.trim.alpha, float(setup.trim.controls[0]))
    found = []
    for identifier, strength in hidden:
        if identifier in IMPOSSIBLE[name]:
            raise InputError(f"{identifier} cannot be seen in flights of the JSBSim aircraft {name}")
        effect = hidden_effect(identifier, strength, seed, duration, setup.aircraft, coefficients, trim)
        own = own_terms(name, identifier, setup.aircraft.span)
        if own:
            effect = replace(effect, variant="", strength=1.0, terms=(), native=own, inner={})
        found.append(effect)
    return tuple(found)


def own_terms(name: str, identifier: str, span: float) -> tuple[tuple[str, str], ...]:
    """Axes and terms by which an aeroplane has an effect itself; none when it does not."""
    if identifier in SHOWN_BY_FLYING:
        listed = SHOWN_BY_FLYING[identifier].items()
        return tuple((axis, text.format(span=span)) for axis, terms in listed for text in terms)
    base = BASE_TERMS[name]
    own = OWN.get(identifier, {}).items()
    return tuple((axis, text) for axis, terms in own for text in terms if text in base.get(axis, ()))


def users_aircraft(name: str, hidden: Sequence[Hidden], plain: bool = False) -> Aircraft:
    """The aircraft file of a user who knows the aeroplane except for what is hidden; plain: the 32 terms."""
    lacking = {pair for effect in hidden for pair in effect.native}
    more = {} if plain else BASE_TERMS[name]
    model = {
        axis: [*terms, *(text for text in more.get(axis, ()) if (axis, text) not in lacking)]
        for axis, terms in TEXTBOOK_TERMS.items()
    }
    return aircraft_from_dict({**prepared(name)[0].aircraft.source, "model": model})


def fly_jsbsim_plan(
    name: str, hidden: Sequence[Hidden], manoeuvres: str, seed: int, wind: Array
) -> tuple[Truth, float]:
    """A flight (wind NED (n, 3) at RATE) and the altitude [m] of its ground, which low passes bring near."""
    setup, _ = prepared(name)
    plan = plan_of(manoeuvres, np.arange(len(wind)) / RATE, excitation_of(setup), seed)
    ground = GROUND

    def attempt(flown: Plan, drop: float) -> Truth:
        nonlocal ground
        ground = GROUND + drop
        return fly_jsbsim_hidden(setup, wind, flown, hidden, ground)

    span = setup.aircraft.span
    return low_passes(plan, span, attempt, attempts=4), ground


def projected(aircraft: Aircraft, truth: Truth) -> dict[str, float]:
    """Coefficients of the model of a file that are nearest to the true ones of a flight."""
    return projection(aircraft.model, signals_of(aircraft, truth), truth.coefficients)
