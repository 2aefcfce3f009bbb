"""How large what was found is: in newtons, and as the number that its physics means.

A share of a surface or of the thrust, an angle at which a surface sticks, a shift of the centre of gravity and a mass
follow from the terms that were fitted, by the formulas of ``effects/change.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AXIS_WORDS, FORCES, term_label
from aircraft_sysid_ros.aircraft.signals import SURFACE_WORDS
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate
from aircraft_sysid_ros.diagnosis.search.evaluator import Score, new_terms
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis
from aircraft_sysid_ros.effects.effect import CHORD_BY_SPAN
from aircraft_sysid_ros.rounding import with_error

Array = npt.NDArray[np.float64]
#: The largest that is quoted is passed in one hundredth of the time in which it acts.
_LARGEST = 0.99
#: Standard error [rad] from which an angle says nothing.
_TOLD_TO = np.radians(5.0)
#: Newtons from which on they are said as kN.
_KILO = 1e4
#: A number is divided by one that is so many of its standard errors away from 0.
_SURE = 3.0


class Fitted(NamedTuple):
    """A parameter and its standard error; NaN where the flight does not determine it."""

    value: float
    std: float

    @property
    def is_sure(self) -> bool:
        """Whether it is not 0."""
        return abs(self.value) > _SURE * self.std


@dataclass(frozen=True)
class AddedTerms:
    """The terms of a candidate, fitted in the model to which they are added."""

    flight: FlightData  # under that model
    candidate: Candidate
    axis: str  # the main one
    terms: Mapping[str, Sequence[Fitted]]  # by axis, in the order of the candidate
    model: Mapping[str, Fitted]  # all parameters of these axes by name


def added_terms(flight: FlightData, trial: Score) -> AddedTerms:
    """Fit the terms of a trial beside the model of a flight, in each axis that the flight can judge."""
    added = flight.with_terms(new_terms(flight, trial))
    terms: dict[str, list[Fitted]] = {}
    model: dict[str, Fitted] = {}
    for axis in (axis for axis in trial.candidate.terms if axis in trial.gains):
        fit = fit_axis(added, axis).fit
        known = dict(zip(added.model.terms[axis], map(Fitted, fit.parameters.tolist(), fit.std.tolist()), strict=True))
        programs = added.parsed(trial.candidate.terms[axis])
        terms[axis] = [known.get(program.text, Fitted(np.nan, np.nan)) for program in programs]
        model |= {f"{axis}_{term_label(text)}": fitted for text, fitted in known.items()}
    return AddedTerms(added, trial.candidate, trial.main_axis, terms, model)


def how_large(added: AddedTerms) -> str:
    """What a finding does in its main axis, in words; empty where the flight does not determine it."""
    if added.axis not in added.terms:
        return ""
    return "; ".join(text for text in (_as_physics(added), _in_newtons(added)) if text)


def _in_newtons(added: AddedTerms) -> str:
    flight, aircraft = added.flight, added.flight.aircraft
    arm, unit = (1.0, "N") if added.axis in FORCES else (aircraft.chord if added.axis == "Cm" else aircraft.span, "N m")
    part = np.abs(_part(added, added.axis) * flight.signal("qbar")) * aircraft.wing_area * arm
    part = part[np.isfinite(part) & (part > 0.0)]
    if not len(part):
        return ""
    rms, largest = float(np.sqrt(np.mean(part**2))), float(np.quantile(part, _LARGEST))
    if largest >= _KILO:
        rms, largest, unit = 1e-3 * rms, 1e-3 * largest, f"k{unit}"
    acts = f"it makes {_plain(rms)} {unit} (rms) of {AXIS_WORDS[added.axis]} while it acts"
    return f"{acts}, and up to {_plain(largest)} {unit}"


def _as_physics(added: AddedTerms) -> str:
    effect, terms = added.candidate.effect, added.terms
    if effect is None:
        return ""
    if effect.identifier == "mass_change":
        return _mass(added)
    if effect.identifier == "cg_shift":
        return _shift(added)
    if effect.identifier == "loss_of_thrust" and "CX" in terms:
        lost = _share(terms["CX"][0], added.model.get("CX_Tc"))
        return f"{lost} of the thrust is lost" if lost else ""
    if effect.identifier in ("control_damage", "stuck_control"):
        return _surface(added)
    return ""


def _surface(added: AddedTerms) -> str:
    """What is lost of a surface, and where it stands that sticks: C += C_δ (a δ + b)."""
    ties = added.candidate.ties
    tied = [axis for axis in ties if axis in added.terms and ties[axis][0].of not in ("", CHORD_BY_SPAN)]
    if not tied:
        return ""
    axis = added.axis if added.axis in tied else tied[0]
    name, terms = ties[axis][0].of, added.terms[axis]
    word = SURFACE_WORDS[name.partition("_")[2]]
    lost = _share(terms[0], added.model.get(name))
    said = [f"{lost} of the effect of the {word} on the {AXIS_WORDS[axis]} is lost"] if lost else []
    angle, std = np.nan, np.nan
    if len(terms) > 1 and terms[0].is_sure:
        angle = -terms[1].value / terms[0].value
        std = np.hypot(terms[1].std, angle * terms[0].std) / abs(terms[0].value)
    if std < _TOLD_TO:
        said.append(f"the stuck part stands at {with_error(np.degrees(angle), np.degrees(std))} deg")
    return " and ".join(said)


def _share(term: Fitted, whole: Fitted | None) -> str:
    """-term / whole in percent, where both are sure and something is lost."""
    if whole is None or not whole.is_sure or not term.is_sure or term.value * whole.value > 0.0:
        return ""
    share = -term.value / whole.value
    std = np.hypot(term.std, share * whole.std) / abs(whole.value)
    return f"{with_error(100.0 * share, 100.0 * std)} %"


def _shift(added: AddedTerms) -> str:
    """C_m += a C_Z with a = -d / c, d aft; C_l += a C_Z with a = -d / b, d to the right.

    Angles of flow have errors, which make all derivatives of such a fit too small, this one by up to a fifth: where
    shares are quotients of two of them, this is none, and its standard error would say too much.
    """
    aircraft, along = added.flight.aircraft, "Cm" in added.candidate.terms
    terms = added.terms.get("Cm" if along else "Cl")
    if terms is None or not terms[0].is_sure:
        return ""
    length, ways = (aircraft.chord, ("aft", "forward")) if along else (aircraft.span, ("to the right", "to the left"))
    moved = -terms[0].value * length
    said = f"it moved about {_plain(100.0 * abs(moved))} cm {ways[moved < 0.0]}"
    return f"{said}, {_plain(100.0 * abs(moved) / aircraft.chord)} % of the chord" if along else said


def _mass(added: AddedTerms) -> str:
    """a = m_stated / m - 1: what is added to a coefficient, over that coefficient without it.

    The term multiplies what one model says of all of the flight, which is neither the coefficient before nor after.
    """
    axis, (term,) = added.axis, added.terms[added.axis]
    part, without = _part(added, axis), _without(added, axis)
    there = np.isfinite(part) & np.isfinite(without) & (part != 0.0)
    there &= added.flight.signal("time") >= dict(added.candidate.inner).get("full", -np.inf)  # of a ramp
    if not term.is_sure or not np.any(there):
        return ""
    share = float(np.sum(part[there] * without[there]) / np.sum(without[there] ** 2))
    mass = added.flight.aircraft.mass
    change = mass / (1.0 + share) - mass
    std = mass * abs(share * term.std / term.value) / (1.0 + share) ** 2
    return f"it weighs {with_error(abs(change), std)} kg {'less' if change < 0.0 else 'more'} than is stated"


def _part(added: AddedTerms, axis: str) -> Array:
    """What the terms add to a coefficient (n,)."""
    values = np.array([each.value for each in added.terms[axis]])
    return np.asarray(added.flight.columns(added.flight.parsed(added.candidate.terms[axis])) @ values)


def _without(added: AddedTerms, axis: str) -> Array:
    """What the model says of the coefficient without them (n,)."""
    model = added.flight.model
    values = [added.model[f"{axis}_{term_label(text)}"].value for text in model.terms[axis]]
    whole = added.flight.columns(model.programs[AXES.index(axis)]) @ np.nan_to_num(values)
    return np.asarray(whole - np.nan_to_num(_part(added, axis)))


def _plain(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"
