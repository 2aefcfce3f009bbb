"""A model version of a run with its parameters, the rows that it was learnt from, and what follows from both.

Signals are those of ``expression.SIGNALS``: rates normalised, angles [rad], V [m/s], qbar [Pa]; coefficients in body
axes FRD about the aerodynamic reference point.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel, model_from_terms
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.rigid_body import coefficients_about_gravity
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.rounding import fixed

Array = npt.NDArray[np.float64]

#: Signals whose range is told in any case, where the flight has them.
ALWAYS_RANGED = ("V", "alpha", "beta", "p", "q", "r", "de", "da", "dr")
SURFACES = ("de", "da", "dr")
ENGINE = frozenset({"Tc", "throttle", "propeller_speed"})
UNITS = {
    "V": "m/s", "qbar": "Pa", "height": "m", "propeller_speed": "rad/s", "time": "s", "p": "pb/2V", "q": "qc/V",
    "r": "rb/2V", "alpha_dot": "c/V", "beta_dot": "b/2V",
}  # fmt: skip
#: Draws from the covariance for standard errors of what is worked out from the parameters: theirs is a tenth of them.
DRAWS = 50
#: Share of the larger end of a range below which the other one is 0 to people.
_NOTHING = 1e-6
#: What a model has worked out that does not depend on the values of its parameters.
_OF_ROWS = {"terms", "ranges"}
_ANGLES = ("alpha", "beta", "de", "da", "dr", "flaps")


@dataclass(frozen=True)
class Parameter:
    """One parameter as the run has it; NaN where it is not known."""

    name: str
    value: float
    std: float
    status: str  # USE, HOLD or REJECT
    reason: str = ""


@dataclass(frozen=True)
class LearntModel:
    """What is exported."""

    aircraft: Aircraft
    identifier: str  # of the model version
    parameters: tuple[Parameter, ...]  # of aircraft.model.parameter_names, in that order
    signals: Array  # (n, SIGNAL_COUNT) rows that were learnt from, in order of time
    step: float  # [s] between them

    @property
    def model(self) -> AerodynamicModel:
        """Terms by axis."""
        return self.aircraft.model

    @cached_property
    def values(self) -> Array:
        """Values (k,) of the parameters; 0 of those that are not known, whose terms no export has."""
        return np.nan_to_num(np.array([p.value for p in self.parameters]))

    @cached_property
    def std(self) -> Array:
        """Standard errors (k,), NaN where not known."""
        return np.array([p.std for p in self.parameters])

    def value(self, name: str) -> float:
        """One parameter; 0 where the model does not have it."""
        names = self.model.parameter_names
        return float(self.values[names.index(name)]) if name in names else 0.0

    def knows(self, axis: str) -> bool:
        """Whether any parameter of an axis is known."""
        return any(np.isfinite(p.value) for p in self.parameters[self.model.axis_slice(axis)])

    def terms_on(self, signals: Array) -> Array:
        """All terms (n, k) on signal rows in order of time; 0 of one that is undefined there, as they were learnt."""
        names = self.model.signal_names
        time, rows = signals[:, names.index("time")], np.ascontiguousarray(signals)
        terms = self.model.terms_along(time, rows, 1.5 * self.step)
        for k, program in enumerate(program for programs in self.model.programs for program in programs):
            known = np.isfinite(signals[:, [names.index(name) for name in program.signals]]).all(axis=1)
            terms[known & ~np.isfinite(terms[:, k]), k] = 0.0
        return terms

    def coefficients_of(self, terms: Array) -> Array:
        """C_X … C_n (n, 6) of terms (n, k); terms whose parameter is not known count nothing, even where NaN."""
        known = np.where(self.values != 0.0, terms * self.values, 0.0)
        return np.stack([known[:, self.model.axis_slice(axis)].sum(axis=1) for axis in AXES], axis=1)

    @cached_property
    def flown(self) -> LearntModel:
        """The same with only the rows at which every term with a value is known.

        Raises InputError where there are none.
        """
        used = self.values != 0.0
        whole = np.isfinite(self.terms[:, used]).all(axis=1)
        if whole.sum() < 2:
            raise InputError("no two rows of the run have all signals that the model reads: fly a longer flight")
        return self if whole.all() else replace(self, signals=self.signals[whole])

    @cached_property
    def terms(self) -> Array:
        """Terms (n, k) on the rows."""
        return self.terms_on(self.signals)

    @cached_property
    def coefficients(self) -> Array:
        """C_X … C_n (n, 6) of the model on the rows."""
        return self.coefficients_of(self.terms)

    def signal(self, name: str) -> Array:
        """One signal (n,) of the rows."""
        return np.asarray(self.signals[:, self.model.signal_names.index(name)])

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest of each signal that the model reads, and of ALWAYS_RANGED, where it was learnt."""
        names = [name for name in self.model.signal_names if name in ALWAYS_RANGED or name in self.model.signals_used]
        found = {}
        for name in names:
            values = self.signal(name)
            values = values[np.isfinite(values)]
            if len(values) and name != "time":
                found[name] = (float(values.min()), float(values.max()))
        return found

    @cached_property
    def covariance(self) -> Array:
        """Covariance (k, k) of the parameters; NaN in rows and columns of those without a standard error.

        Standard errors are those of the run. Correlations within an axis are those of least squares on the rows,
        (X'X)^-1 scaled; axes are independent of each other, as in the second step.
        """
        count = len(self.parameters)
        correlation = np.zeros((count, count))
        for axis in AXES:
            part = self.model.axis_slice(axis)
            correlation[part, part] = _correlation(self.flown.terms[:, part], self.values[part] != 0.0)
        return correlation * np.outer(self.std, self.std)

    def share_of_terms(self) -> dict[str, float]:
        """By how much [-] each parameter's term moves its coefficient over the rows, of the coefficient's spread."""
        spread, parts = np.std(self.coefficients, axis=0), self.terms * self.values
        moved = np.where(np.ptp(self.terms, axis=0) > 0.0, np.std(parts, axis=0), np.abs(parts[0]))
        shares = {}
        for i, axis in enumerate(AXES):
            for k in range(*self.model.axis_slice(axis).indices(len(moved))):
                shares[self.parameters[k].name] = float(moved[k] / spread[i]) if spread[i] > 0.0 else 0.0
        return shares

    @cached_property
    def arms(self) -> Array:
        """Span, chord and span (3,) [m], which the moments are made dimensionless with."""
        return np.array([self.aircraft.span, self.aircraft.chord, self.aircraft.span])

    @cached_property
    def about_gravity(self) -> Array:
        """(6, 6) that turns C_X … C_n about the aerodynamic reference into those about the centre of gravity."""
        aircraft = self.aircraft
        return coefficients_about_gravity(aircraft.aerodynamic_reference, aircraft.span, aircraft.chord)

    def reads(self, *axes: str) -> frozenset[str]:
        """Signals that terms with a value read in some axes."""
        read: set[str] = set()
        for axis in axes:
            part = zip(self.model.programs[AXES.index(axis)], self.values[self.model.axis_slice(axis)], strict=True)
            read |= {name for program, value in part if value != 0.0 for name in program.signals}
        return frozenset(read)

    def draws(self, count: int, seed: int = 0) -> Array:
        """Parameter values (count, k) drawn from their covariance; those without a standard error stay."""
        values, vectors = np.linalg.eigh(np.nan_to_num(self.covariance))
        random = np.random.default_rng(seed).standard_normal((count, len(values)))
        return np.asarray(self.values + random @ (vectors * np.sqrt(np.maximum(values, 0.0))).T)

    def with_values(self, values: Array) -> LearntModel:
        """The same rows under other parameter values (k,)."""
        parameters = tuple(replace(p, value=float(v)) for p, v in zip(self.parameters, values, strict=True))
        other = replace(self, parameters=parameters)
        for name in _OF_ROWS & self.__dict__.keys():  # not worked out again
            other.__dict__[name] = self.__dict__[name]
        return other


def standard_errors(learnt: LearntModel, numbers: Callable[[LearntModel], Mapping[str, Any]]) -> dict[str, float]:
    """Standard errors of what a target's numbers become under draws from the parameters' covariance, by name.

    Lists are left out. A draw for which there are no numbers (InputError) is too.
    """
    drawn: list[Mapping[str, Any]] = []
    names = [name for name, value in numbers(learnt.flown).items() if isinstance(value, float)]
    for values in learnt.draws(DRAWS):
        with contextlib.suppress(InputError):
            drawn.append(numbers(learnt.flown.with_values(values)))
    return {name: float(np.std([each[name] for each in drawn])) if len(drawn) > 1 else np.nan for name in names}


def stalled_lift(linear: Array, alpha: Array, stall: float, sharpness: float) -> Array:
    """C_L (n,) that turns from ``linear`` into that of a flat plate beyond an angle of ``stall`` [rad] on either side.

    The blend of both simulators that have one: sigma = (1 + e1 + e2) / ((1 + e1) (1 + e2)) with
    e1 = exp(-M (alpha - stall)) and e2 = exp(M (alpha + stall)).
    """
    past, before = np.exp(-sharpness * (alpha - stall)), np.exp(sharpness * (alpha + stall))
    sigma = (1.0 + past + before) / ((1.0 + past) * (1.0 + before))
    plate = 2.0 * np.copysign(1.0, alpha) * np.sin(alpha) ** 2 * np.cos(alpha)
    return np.asarray((1.0 - sigma) * linear + sigma * plate)


def lost(flown: LearntModel, theirs: Array) -> dict[str, float]:
    """By axis the rms difference [-] of coefficients (n, 6) from ours on the rows, over the standard deviation of ours.

    NaN without spread, and of an axis of which nothing is known.
    """
    ours = flown.coefficients
    error, spread = np.sqrt(np.mean((ours - theirs) ** 2, axis=0)), np.std(ours, axis=0)
    return {
        axis: float(e / s) if s > 1e-12 else (0.0 if e < 1e-12 and flown.knows(axis) else float("nan"))
        for axis, e, s in zip(AXES, error, spread, strict=True)
    }


def thrust_terms(learnt: LearntModel) -> npt.NDArray[np.bool_]:
    """Which parameters (k,) are thrust along x: terms of C_X that read a signal of the engine, and at most V and qbar.

    Simulators with a thrust of their own do not take it from the model.
    """
    programs = [program for programs in learnt.model.programs for program in programs]
    of_axis = learnt.model.axis_slice("CX")
    alone = [bool(p.signals & ENGINE) and p.signals <= {*ENGINE, "V", "qbar"} for p in programs]
    return np.array([alone[k] and of_axis.start <= k < of_axis.stop for k in range(len(programs))], dtype=np.bool_)


def thrust_part(learnt: LearntModel) -> Array:
    """Coefficients (n, 6) that ``thrust_terms`` make on the rows."""
    part, chosen = np.zeros((len(learnt.signals), 6)), thrust_terms(learnt) & (learnt.values != 0.0)
    part[:, 0] = learnt.terms[:, chosen] @ learnt.values[chosen]
    return part


def that_go_with_time(learnt: LearntModel) -> str:
    """Names of parameters with a value whose terms read the time of the flight, such as damage from a time on."""
    programs = [program for programs in learnt.model.programs for program in programs]
    known = zip(learnt.parameters, programs, learnt.values != 0.0, strict=True)
    return ", ".join(p.name for p, program, is_known in known if is_known and "time" in program.signals)


def percent(share: float) -> str:
    """A share [-] in per cent with two digits, as people write them: 0.16 %, 58 %, 176 %."""
    return f"{100.0 * share:.2g} %" if share < 0.995 else f"{100.0 * share:.0f} %"


def not_held(learnt: LearntModel, held: Mapping[str, Sequence[str]]) -> list[str]:
    """A sentence for each term with a value that is not among those that a target holds, by axis; thrust apart.

    ``held``: terms by axis as they are written in aircraft files.
    """
    canonical = model_from_terms(held, learnt.model.inputs).terms
    thrust = {p.name for p, is_thrust in zip(learnt.parameters, thrust_terms(learnt), strict=True) if is_thrust}
    shares, sentences = learnt.flown.share_of_terms(), []
    for axis in AXES:
        names = learnt.model.parameter_names[learnt.model.axis_slice(axis)]
        for name, term in zip(names, learnt.model.terms[axis], strict=True):
            if term not in canonical[axis] and name not in thrust and learnt.value(name) != 0.0:
                what = "its constant" if term == "1" else f"the term {term}"
                sentences.append(
                    f"{axis}: no place for {what}, which moves {axis} by {percent(shares[name])} of its "
                    "spread; the other terms have taken what they can of it"
                )
    return sentences


def range_words(learnt: LearntModel) -> list[str]:
    """The range in which the model was learnt, a line for each signal; angles in rad and degrees.

    What is next to nothing beside the other end is 0.
    """
    lines = []
    for name, ends in learnt.ranges.items():
        low, high = (end if abs(end) > _NOTHING * max(map(abs, ends)) else 0.0 for end in ends)
        if name in _ANGLES:
            degrees = f" ({fixed(np.degrees(low), 1)} to {fixed(np.degrees(high), 1)} deg)"
            lines.append(f"{name}: {low:.4g} to {high:.4g} rad{degrees}")
        else:
            lines.append(f"{name}: {low:.4g} to {high:.4g} {UNITS.get(name, '')}".rstrip())
    return lines


def fitted(columns: Mapping[str, Array], target: Array, allowed: Collection[str]) -> dict[str, float]:
    """Least squares of named columns (n,) on a target (n,): their factors, 0 for those that are not ``allowed``.

    A target's number stays 0 where the model does not read that signal: it would only take up what others miss.
    """
    names = [name for name in columns if name in allowed]
    if not names:
        return dict.fromkeys(columns, 0.0)
    x = np.stack([columns[name] for name in names], axis=1)
    size = np.sqrt(np.sum(x**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    found = np.linalg.lstsq(x / size, target, rcond=1e-9)[0] / size
    return dict.fromkeys(columns, 0.0) | {name: float(value) for name, value in zip(names, found, strict=True)}


def _correlation(terms: Array, known: npt.NDArray[np.bool_]) -> Array:
    """Correlation (k, k) of least squares on terms (n, k); unit where a term is not in the data."""
    result = np.eye(terms.shape[1])
    used = np.flatnonzero(known)
    if not len(used):
        return result
    x = terms[:, used]
    size = np.sqrt(np.sum(x**2, axis=0))
    inverse = np.linalg.pinv((x / np.where(size > 0.0, size, 1.0)).T @ (x / np.where(size > 0.0, size, 1.0)))
    scale = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    result[np.ix_(used, used)] = inverse / np.outer(scale, scale)
    return result
