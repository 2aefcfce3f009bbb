"""From the library of effects to columns that can be tried on a flight.

A candidate is one effect in one variant with its inner numbers fixed: terms by axis, as texts that an aircraft
file could hold. ``{CZ}`` in a term of the library becomes what the present model says of C_Z.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.diagnosis.flight.flight_data import BLOCK, FlightData
from aircraft_sysid_ros.effects.effect import (
    CHORD_BY_SPAN,
    END,
    FULL,
    Effect,
    ShapeParameter,
    Tie,
    Variant,
    fill,
    placeholders,
)
from aircraft_sysid_ros.errors import InputError

Array = npt.NDArray[np.float64]

#: Signals in which the slope of a model may stand in a term, and the step of its central difference [rad].
SLOPES_IN, _SLOPE_STEP = ("alpha", "beta"), 0.01
#: Powers of the airspeed in signals: what a wrong airspeed makes wrong of what is as it was.
_POWERS_OF_AIRSPEED = {
    "V": 1, "mach": 1, "qbar": 2, "Tc": -2, "p": -1, "q": -1, "r": -1, "alpha_dot": -1, "beta_dot": -1,
}  # fmt: skip
#: Inner numbers that are times at which something changes.
MOMENTS_OF_CHANGE = ("t0", "t1")
#: And those that are its times in words and pictures: when it is complete, too.
TIMES_OF_CHANGE = (*MOMENTS_OF_CHANGE, FULL.name)
#: Time [s] for which a change that is undone is there: two blocks, one to learn it from, one to judge it on.
SHORTEST_CHANGE = 2.0 * BLOCK
#: Lengths of growth that are tried first, as shares of the flight.
_GROWTHS = (0.04, 0.08, 0.16, 0.32, 0.64)


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing, ready to be tried; ``effect`` is None for an expression of no effect.

    ``changed`` has, of a change at a moment (inner number t0) of no known cause, what changes by axis.
    """

    effect: Effect | None
    variant: str
    inner: tuple[tuple[str, float], ...]
    terms: Mapping[str, tuple[str, ...]]
    changed: Mapping[str, Sequence[str]] = field(default_factory=dict)
    ties: Mapping[str, tuple[Tie, ...]] = field(default_factory=dict)  # of every term, or of none

    @property
    def numbers(self) -> int:
        """How many numbers are fitted."""
        return Variant(terms=self.terms, ties=self.ties).numbers + len(self.inner)

    @property
    def shows_in(self) -> tuple[str, ...]:
        """Axes where its physics cannot be absent.

        What is lost of one half of a surface has an arm of its own in roll, but is lost of what the surface does, too.
        """
        own = () if self.effect is None else self.effect.shows_in
        of_surfaces = {axis: any(tie.of not in ("", CHORD_BY_SPAN) for tie in ties) for axis, ties in self.ties.items()}
        shared = tuple(axis for axis, is_of_one in of_surfaces.items() if is_of_one)
        return own or (shared if len(shared) < len(self.ties) else ())

    @property
    def label(self) -> str:
        """Id with variant, or the expression."""
        if self.changed:
            return f"{self.span} {self.what_changed}"
        if self.effect is None:
            return "; ".join(f"{axis}: {' + '.join(terms)}" for axis, terms in self.terms.items())
        return self.effect.identifier + (f" ({self.variant})" if self.variant else "")

    @property
    def what_changed(self) -> str:
        """Of a change of no known cause, what has changed by axis."""
        return "; ".join(f"{axis}: {' + '.join(names)}" for axis, names in self.changed.items())

    @property
    def happens(self) -> bool:
        """It is a change at a moment of the flight."""
        return "t0" in dict(self.inner)

    @property
    def moment(self) -> float:
        """Time [s] at which a change begins."""
        return dict(self.inner)["t0"]

    @property
    def moments(self) -> tuple[float, ...]:
        """Times [s] at which a change begins, is complete, or ends; none of what is no change."""
        return tuple(value for name, value in self.inner if name in TIMES_OF_CHANGE)

    @property
    def passes(self) -> bool:
        """It is a change that is undone later."""
        return "t1" in dict(self.inner)

    @property
    def grows(self) -> bool:
        """It is a change that takes its time."""
        return "full" in dict(self.inner)

    @property
    def span(self) -> str:
        """When a change is there, in words; its times count from the start of the recording."""
        times = dict(self.inner)
        grown = f", complete at {times['full']:.0f} s" if self.grows else ""
        return f"from {self.moment:.0f} s " + (f"to {times['t1']:.0f} s" if self.passes else f"on{grown}")

    @property
    def family(self) -> str:
        """What competes under one name: the id of the effect, or the expression."""
        return self.effect.identifier if self.effect is not None else self.label


def base_texts(model: AerodynamicModel, parameters: Mapping[str, float]) -> dict[str, str]:
    """What the model says of each coefficient, as one expression per axis: ``{CZ}`` of a term."""
    return {axis: "+".join(parts) or "0" for axis, parts in _parts(model, parameters).items()}


def slope_texts(model: AerodynamicModel, parameters: Mapping[str, float]) -> dict[str, str]:
    """Slopes of the model in the angles of flow, as expressions: ``{CZ_alpha}`` of a term."""
    texts = {}
    for axis, parts in _parts(model, parameters).items():
        for name in SLOPES_IN:
            signal = re.compile(rf"\b{name}\b")
            read = "+".join(part for part in parts if signal.search(part)) or "0"
            more, less = (signal.sub(f"({name}{sign}{_SLOPE_STEP})", read) for sign in "+-")
            texts[f"{axis}_{name}"] = f"(({more})-({less}))/{2.0 * _SLOPE_STEP:g}"
    return texts


def airspeed_texts(model: AerodynamicModel, parameters: Mapping[str, float]) -> dict[str, str]:
    """What coefficients gain, as they are shown, by the share by which the airspeed is shown too large:
    ``{CX_airspeed}`` of a term.

    A force is divided by a dynamic pressure that is too large, and so is the thrust of T_c, whose part stays as it is;
    rates are made dimensionless by the airspeed, so that theirs loses half as much.
    """
    names = re.compile(rf"\b({'|'.join(_POWERS_OF_AIRSPEED)})\b")

    def shown(parts: list[str], share: float) -> str:
        true = names.sub(
            lambda found: f"({found[0]}*{(1.0 + share) ** -_POWERS_OF_AIRSPEED[found[0]]:.9g})", "+".join(parts) or "0"
        )
        return f"({true})*{(1.0 + share) ** -2:.9g}"

    return {
        f"{axis}_airspeed": f"({shown(parts, _SLOPE_STEP)}-{shown(parts, -_SLOPE_STEP)})/{2.0 * _SLOPE_STEP:g}"
        for axis, parts in _parts(model, parameters).items()
    }


def _parts(model: AerodynamicModel, parameters: Mapping[str, float]) -> dict[str, list[str]]:
    """Each parameter of the model times its term, by axis."""
    values = {axis: [parameters[name] for name in model.parameter_names[model.axis_slice(axis)]] for axis in AXES}
    return {
        axis: [f"{value:.5g}*({term})" for value, term in zip(values[axis], model.terms[axis], strict=True)]
        for axis in AXES
    }


def can_act(effect: Effect, data: FlightData) -> bool:
    """Whether the flight gets to where an effect acts."""
    domain = effect.domain
    if domain is None:
        return True
    values = data.signal(domain.signal) / (data.aircraft.span if domain.in_spans else 1.0)
    return bool(np.any((values >= domain.low) & (values <= domain.high)))


def where_it_acts(effect: Effect, data: FlightData) -> str:
    """Of an effect that cannot act in a flight: where it does, and how near the flight gets."""
    domain = effect.domain
    assert domain is not None
    values = data.signal(domain.signal) / (data.aircraft.span if domain.in_spans else 1.0)
    name, unit = {"mach": "Mach number"}.get(domain.signal, domain.signal), " spans" if domain.in_spans else ""
    if np.nanmax(values) < domain.low:
        return f"it acts from a {name} of {domain.low:g}{unit} on, and the flight stays below {np.nanmax(values):.2g}"
    return f"it acts below a {name} of {domain.high:g}{unit}, and the flight stays above {np.nanmin(values):.2g}"


def candidates_of(effect: Effect, data: FlightData, base: Mapping[str, str]) -> Iterator[Candidate]:
    """All variants of an effect on the grid of its inner numbers; none where a signal that it reads is missing."""
    for variant in effect.variants:
        if not variant.terms or not is_measured(variant, data, base):
            continue
        used = {name for terms in variant.terms.values() for term in terms for name in placeholders(term)}
        inner = [number for number in effect.inner if number.name in used]
        for values in itertools.product(*(grid(number, data) for number in inner)):
            named = dict(zip((number.name for number in inner), values, strict=True))
            if is_possible(effect, named, data):
                yield with_inner(effect, variant, named, base)


def with_inner(effect: Effect, variant: Variant, values: Mapping[str, float], base: Mapping[str, str]) -> Candidate:
    """One candidate with these inner numbers."""
    terms = {axis: tuple(fill(term, {**base, **values}) for term in texts) for axis, texts in variant.terms.items()}
    return Candidate(effect, variant.name, tuple(values.items()), terms, ties=variant.ties)


def limits(number: ShapeParameter, data: FlightData) -> tuple[float, float]:
    """Lowest and highest value of an inner number that this flight can tell."""
    if number.signal is None:
        return number.low, number.high
    values = data.signal(number.signal)
    values = values[np.isfinite(values)]
    if not len(values):
        return np.nan, np.nan
    bottom, top = float(values.min()), float(values.max())
    return bottom + number.low * (top - bottom), bottom + number.high * (top - bottom)


def grid(number: ShapeParameter, data: FlightData) -> Array:
    """Values of an inner number that are tried first: of a time, those between two runs, too."""
    values = np.linspace(*limits(number, data), number.count)
    return np.unique([*values, *data.seams]) if number.name in MOMENTS_OF_CHANGE else values


def spans(edge: float, data: FlightData) -> Iterator[dict[str, float]]:
    """Times t0 and t1 of changes that begin or end at ``edge`` and are undone."""
    for other in grid(END, data).tolist():
        values = {"t0": min(edge, other), "t1": max(edge, other)}
        if lasts(values):
            yield values


def growths(edge: float, data: FlightData) -> Iterator[dict[str, float]]:
    """Times t0 and full of changes that take their time and are half there at ``edge``."""
    low, high = limits(FULL, data)
    for share in _GROWTHS:
        half = 0.5 * share * (high - low)
        values = {"t0": max(edge - half, low), "full": min(edge + half, high)}
        if lasts(values):
            yield values


def is_possible(effect: Effect, values: Mapping[str, float], data: FlightData) -> bool:
    """Whether an effect may have these inner numbers in a flight, beside the limits of each."""
    if not lasts(values):
        return False
    if not effect.beyond_ordinary or "onset" not in values:
        return True
    return bool(values["onset"] - values.get("width", 0.0) >= np.nanmedian(data.signal("alpha")))


def lasts(values: Mapping[str, float]) -> bool:
    """Whether a change that is undone, or that takes its time, does so for long enough."""
    end = values.get("t1", values.get("full", np.inf))
    return end == np.inf or end - values["t0"] >= SHORTEST_CHANGE


def is_measured(variant: Variant, data: FlightData, base: Mapping[str, str]) -> bool:
    """In some axis of the variant every signal that it reads has numbers in this flight; no term is too long to write.

    Where sideslip is not measured a wrong mass still shows in C_X and C_Z.
    """
    try:
        read = [
            {signal for program in data.parsed(_neutral(terms, base)) for signal in program.signals}
            for terms in variant.terms.values()
        ]
    except InputError:
        return False
    return any(not data.lacks(signals) for signals in read)


def _neutral(terms: Sequence[str], base: Mapping[str, str]) -> list[str]:
    """Terms with any number in the place of an inner one."""
    return [fill(term, {name: base.get(name, 0.5) for name in placeholders(term)}) for term in terms]
