"""Try the effects of a library, and expressions outside it, on one flight: how much does each explain?

The score of a candidate is the sum over its axes of ln(before / after), with the held-out sums of squares of
``fit``: the logarithm by which it lowers the error variance on flight that it was not fitted to. An axis in which it
explains nothing counts as nothing.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, MOMENTS
from aircraft_sysid_ros.aircraft.expression import MAXIMUM_LENGTH
from aircraft_sysid_ros.diagnosis.flight.flight_data import GUARD, FlightData
from aircraft_sysid_ros.diagnosis.search.candidates import (
    MOMENTS_OF_CHANGE,
    Candidate,
    airspeed_texts,
    base_texts,
    candidates_of,
    growths,
    is_possible,
    limits,
    slope_texts,
    with_inner,
)
from aircraft_sysid_ros.diagnosis.search.fit import (
    AxisFit,
    Gain,
    fit_axis,
    fits_of,
    held_out_error,
    tied_gains,
    why_none,
)
from aircraft_sysid_ros.diagnosis.search.intervals import best_intervals
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import CHORD_BY_SPAN, END, FULL, Effect, ShapeParameter, Variant
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import in_parallel

Array = npt.NDArray[np.float64]

#: Steps of the refinement of an inner number, each a third as wide as the last.
REFINEMENTS = 3
#: Of a step, a pulse and a ramp one that explains less than this share of the best is not refined. A judgement.
_CATCHES_UP = 0.5


@dataclass(frozen=True)
class Score:
    """A candidate tried on a flight: its gain in each of its axes where it has data."""

    candidate: Candidate
    gains: Mapping[str, Gain]
    told_in: str = ""  # the axis that told it, where that was no held-out error

    @cached_property
    def log_ratios(self) -> dict[str, float]:
        """ln(held-out sum of squares before / after) by axis."""
        return {axis: log_ratio(gain) for axis, gain in self.gains.items()}

    @cached_property
    def score(self) -> float:
        """Sum of the log ratios of the axes in which the candidate explains something.

        Of all its axes where they share numbers: what makes one worse speaks against the others.
        """
        if self.candidate.ties:
            return max(sum(self.log_ratios.values()), 0.0)
        return sum(max(value, 0.0) for value in self.log_ratios.values())

    @property
    def price(self) -> float:
        """What its numbers cost in the unit of the score."""
        return self.candidate.numbers * price_of_one(next(iter(self.gains.values())))

    @property
    def pays(self) -> bool:
        """It explains more than its numbers cost; or something else than held-out errors has told it."""
        return bool(self.told_in) or self.score > self.price

    @property
    def main_axis(self) -> str:
        """The axis that told it, or in which it explains most."""
        ratios = self.log_ratios
        return self.told_in or max(ratios, key=lambda axis: ratios[axis])


def log_ratio(gain: Gain) -> float:
    """ln(before / after) of the held-out sums of squares, but no more than of those of the fit to all points.

    Where a flight hardly determines the model, held-out errors are large and any column that steadies the prediction
    seems to explain them; to the fit it then adds nothing.
    """
    held_out, fitted = (
        (float(gain.before.sum()), float(gain.after.sum())), (gain.fitted_before, gain.fitted_after)
    )  # fmt: skip
    return min(
        math.log(before) - math.log(after) if min(before, after) > 0.0 else 0.0 for before, after in (held_out, fitted)
    )


def price_of_one(gain: Gain) -> float:
    """What one number costs in the unit of the score: its description length, ln(n) / n (Rissanen 1978).

    n is the number of independent points of an axis, one in each time over which residuals are correlated.
    """
    n = max(float(np.sum(gain.count)) * gain.fit.flight.step / GUARD, np.e)
    return float(np.log(n) / n)


def size_of(gain: Gain) -> float:
    """Share of the rms error that goes, held out and fitted alike."""
    return float(1.0 - np.exp(-0.5 * max(log_ratio(gain), 0.0)))


class CandidateEvaluator:
    """One flight, with the fit of the present model in every axis, on which candidates are tried."""

    def __init__(
        self,
        data: FlightData,
        fits: Mapping[str, AxisFit] | None = None,
        shapes: Mapping[str, tuple[str, ...]] | None = None,
    ) -> None:
        """``shapes``: terms by axis that are fitted beside the model and are none of it."""
        self.data, self.shapes = data, shapes or {}
        self.fits = _fits(data, shapes=self.shapes) if fits is None else dict(fits)
        if not self.fits:
            raise InputError(f"no axis of the model can be judged: {why_none(data)}")

    @cached_property
    def _one_off(self) -> CandidateEvaluator:
        if self.data.run is None or not self.data.by_manoeuvre:
            return self
        return CandidateEvaluator(replace(self.data, blocks_only=True), shapes=self.shapes)

    def judging(self, candidate: Candidate) -> CandidateEvaluator:
        """The bench on which a candidate is judged: this one, which holds out run by run where there are several.

        Of what happened at one moment the other runs teach nothing: there blocks of each run are held out.
        """
        return self._one_off if candidate.happens else self

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Parameters of the fitted model, 0 where the flight does not determine them."""
        return self._parameters()

    def _parameters(self, beside: Sequence[str] = ()) -> dict[str, float]:
        """The same, fitted beside other terms in every axis."""
        parameters = dict.fromkeys(self.data.model.parameter_names, 0.0)
        for axis in self.fits:
            with contextlib.suppress(InputError):
                fit = fit_axis(self.data, axis)
                if beside:
                    fit = fit.extended(self.data.columns(self.data.parsed(beside)), beside)
                known = np.where(fit.determined, fit.parameters, 0.0)
                parameters |= {k: v for k, v in zip(fit.names, known.tolist(), strict=True) if k in parameters}
        return parameters

    @cached_property
    def derivatives(self) -> dict[str, float]:
        """C_axis,δ of the fitted model by name (Cm_de), the mean over the flight: a slipstream may be in it."""
        found = {}
        for name in ("de", "da", "dr"):
            column, step = self.data.model.signal_names.index(name), 0.01
            high, low = self.data.signals.copy(), self.data.signals.copy()
            high[:, column] += step
            low[:, column] -= step
            for axis in self.fits:
                model, programs = self.data.model, self.data.model.programs[AXES.index(axis)]
                part = np.array([self.parameters[name] for name in model.parameter_names[model.axis_slice(axis)]])
                more, less = (self.data.with_signals(signals).columns(programs) @ part for signals in (high, low))
                change = (more - less)[np.isfinite(more - less)]
                found[f"{axis}_{name}"] = float(np.mean(change)) / (2.0 * step) if len(change) else 0.0
        return found

    @cached_property
    def base(self) -> dict[str, str]:
        """Text of the fitted model by axis, of its slopes and of its changes with the airspeed, for candidates of it.

        An angle that drifts moves while the coefficient does not, and hides its slope: that is fitted beside the drift.
        """
        model = self.data.model
        return {
            **base_texts(model, self.parameters),
            **slope_texts(model, self._parameters(beside=("time",))),
            **airspeed_texts(model, self.parameters),
        }

    def _tied(self, candidate: Candidate) -> dict[str, Gain]:
        """Gains of a candidate whose axes share numbers."""
        known = {"": 1.0, CHORD_BY_SPAN: self.data.aircraft.chord / self.data.aircraft.span, **self.derivatives}
        ties, columns = {}, {}
        for axis, terms in candidate.terms.items():
            if axis in self.fits:
                ties[axis] = np.zeros((len(terms), candidate.numbers - len(candidate.inner)))
                for row, tie in zip(ties[axis], candidate.ties[axis], strict=True):
                    row[tie.number] = tie.factor * known.get(tie.of, 0.0)
                columns[axis] = self.data.columns(self.data.parsed(terms))
        return tied_gains(self.fits, columns, ties)

    def trial(self, candidate: Candidate) -> Score | None:
        """Try one candidate; None where it has no data in any of its axes."""
        bench = self.judging(candidate)
        if bench is not self:
            return bench.trial(candidate)
        if candidate.ties:
            gains = self._tied(candidate)
            return Score(candidate, gains) if gains else None
        gains = {}
        for axis, terms in candidate.terms.items():
            if axis in self.fits:
                with contextlib.suppress(InputError):
                    columns = self.data.columns(self.data.parsed(terms))
                    gains[axis] = self.fits[axis].gain(columns)
        return Score(candidate, gains) if gains else None

    def best_of(self, effect: Effect) -> Score | None:
        """The best variant of an effect with its best inner numbers; None where the flight cannot tell."""
        trials = [self.trial(candidate) for candidate in candidates_of(effect, self.data, self.base)]
        known = [t for t in trials if t is not None]
        best = max(known, key=lambda t: t.score, default=None)
        if best is None:
            return None
        passing = max(self._passing(effect, known), key=lambda t: t.score, default=None)
        growing = max(self._growing(effect, known), key=lambda t: t.score, default=None)
        forms = [t for t in (best, passing, growing) if t is not None]
        most = max(t.score for t in forms)
        found = [self._refined(t) for t in forms if t.score >= _CATCHES_UP * most]
        found += [t for t in map(self._lasting, found) if t is not None]
        return max(found, key=lambda t: t.score - t.price)

    def best_candidates(self, effects: Sequence[Effect]) -> Iterator[Candidate | None]:
        """The candidate of ``best_of`` each of some effects, on all cores."""
        return in_parallel(self._best_candidate, effects)

    def _best_candidate(self, effect: Effect) -> Candidate | None:
        best = self.best_of(effect)
        return None if best is None else best.candidate

    def _passing(self, effect: Effect, trials: Sequence[Score]) -> Iterator[Score]:
        """Changes that are undone, of each variant of which a step was tried: in the intervals that suit all points."""
        for variant, _ in _steps(effect, trials):
            if (passing := variant.passing) is None:
                continue
            for values in best_intervals(self.data, self.fits, variant, self.base):
                trial = self.trial(with_inner(effect, passing, values, self.base))
                if trial is not None:
                    yield trial

    def _growing(self, effect: Effect, trials: Sequence[Score]) -> Iterator[Score]:
        """Changes that take their time: of each variant the best step is the middle."""
        for variant, edge in _steps(effect, trials) if effect.takes_time else ():
            if (growing := variant.growing) is None:
                continue
            for values in growths(edge, self.data):
                trial = self.trial(with_inner(effect, growing, values, self.base))
                if trial is not None:
                    yield trial

    def _lasting(self, trial: Score) -> Score | None:
        """A change that is undone, with the same beginning and no end; None of anything else."""
        effect, candidate = trial.candidate.effect, trial.candidate
        if effect is None or not candidate.passes:
            return None
        variant = next(v for v in effect.variants if v.name == candidate.variant)
        values = {name: value for name, value in candidate.inner if name != END.name}
        return self.trial(with_inner(effect, variant, values, self.base))

    def _refined(self, best: Score) -> Score:
        """Move each inner number to where it explains most, in ever smaller steps."""
        effect, candidate = best.candidate.effect, best.candidate
        if effect is None or not candidate.inner:
            return best
        variant = next(v for v in effect.variants if v.name == candidate.variant)
        if candidate.passes or candidate.grows:
            variant = (variant.passing if candidate.passes else variant.growing) or variant
        numbers = {number.name: number for number in (*effect.inner, END, FULL)}
        for name, _ in candidate.inner:

            def at(trial: Score, value: float, name: str = name) -> Score | None:
                values = {**dict(trial.candidate.inner), name: value}
                possible = is_possible(effect, values, self.data)
                return self.trial(with_inner(effect, variant, values, self.base)) if possible else None

            best = refined(best, numbers[name], self.data, at, lambda trial: trial.score)
            best = at_seam(best, name, self.data, at, lambda trial: trial.score)
        return best

    def extended(
        self, terms: Mapping[str, Sequence[str]], shapes: Mapping[str, Sequence[str]] | None = None
    ) -> CandidateEvaluator:
        """The bench of the model with more terms by axis; an axis that they leave without data stays as it is.

        ``shapes``: terms that are fitted, too, but are none of the model.
        """
        data, more = self.data.with_terms(terms), dict(self.shapes)
        for axis, texts in (shapes or {}).items():
            more[axis] = tuple(dict.fromkeys((*more.get(axis, ()), *texts)))
        tilted = {"CX"} if {"CY", "CZ"} & set(terms) else set()
        again = {*terms, *tilted, *(shapes or {})} & set(self.fits)
        return CandidateEvaluator(data, {**self.fits, **_fits(data, again, more)}, more)

    def contribution(self, trial: Score, axis: str) -> Array:
        """What a candidate explains in an axis beyond the model, (n,), 0 where it has no data."""
        fit, gain = self.fits[axis], trial.gains[axis]
        columns = self.data.columns(self.data.parsed(trial.candidate.terms[axis]))
        values = np.zeros(len(fit.rows))
        rows = fit.rows & np.all(np.isfinite(columns), axis=1)
        z = columns @ np.nan_to_num(gain.parameters)
        inside = np.where(np.isfinite(z[fit.rows]), z[fit.rows], 0.0)
        values[fit.rows] = inside - fit.basis @ (fit.basis.T @ inside)
        values[~rows] = 0.0
        return values


def _steps(effect: Effect, trials: Sequence[Score]) -> Iterator[tuple[Variant, float]]:
    """Variants of which a step was tried, with the moment of the best one."""
    for variant in effect.variants:
        steps = [t for t in trials if t.candidate.variant == variant.name and t.candidate.happens]
        if steps:
            yield variant, max(steps, key=lambda t: t.score).candidate.moment


def refined(
    best: Score,
    number: ShapeParameter,
    data: FlightData,
    at: Callable[[Score, float], Score | None],
    gain: Callable[[Score], float],
) -> Score:
    """Move an inner number of a trial to where it gains most, in ever smaller steps; ``at`` tries another value."""
    low, high = limits(number, data)
    width = (high - low) / max(number.count - 1, 1)
    for _ in range(REFINEMENTS):
        width /= 3.0
        for sign in (-2.0, -1.0, 1.0, 2.0):
            value = dict(best.candidate.inner)[number.name] + sign * width
            other = at(best, float(np.clip(value, low, high)))
            if other is not None and gain(other) > gain(best):
                best = other
    return best


def at_seam(
    best: Score,
    name: str,
    data: FlightData,
    at: Callable[[Score, float], Score | None],
    gain: Callable[[Score], float],
) -> Score:
    """The trial with a time of change at a seam between two runs, where that explains nearly as much.

    Between flights much may change; a change in the last seconds of one is a rarer thing.
    """
    trials = [at(best, seam) for seam in data.seams] if name in MOMENTS_OF_CHANGE else []
    other = max((trial for trial in trials if trial is not None), key=gain, default=None)
    return other if other is not None and gain(other) >= THRESHOLDS.nearly * gain(best) else best


def new_terms(flight: FlightData, trial: Score) -> dict[str, tuple[str, ...]]:
    """What a candidate has by axis that the model lacks and the flight determines beside it: what ``add`` adds."""
    found: dict[str, tuple[str, ...]] = {}
    for axis in trial.gains:
        parsed = [program.text for program in flight.parsed(trial.candidate.terms[axis])]
        texts = [text for text in parsed if text not in flight.model.terms[axis]]
        with contextlib.suppress(InputError):
            unknown = undetermined(flight, axis, texts)
            if len(unknown) < len(texts):
                found[axis] = tuple(text for text in texts if text not in unknown)
    return found


def why_no_terms(flight: FlightData, trial: Score, name: str) -> str:
    """Why ``new_terms`` has none of an effect, in words."""
    terms = trial.candidate.terms
    texts = {axis: {program.text for program in flight.parsed(terms[axis])} for axis in trial.gains}
    if all(found <= set(flight.model.terms[axis]) for axis, found in texts.items()):
        return f"the model has '{name}' already"
    return f"this flight does not determine '{name}' besides what the model has"


def errors_of(flight: FlightData, trial: Score, axis: str) -> tuple[float, float]:
    """Held-out errors of an axis without a candidate and with it, as ``compare`` has them before and after ``add``."""
    return held_out_error(flight, axis), held_out_error(flight.with_terms(new_terms(flight, trial)), axis)


def undetermined(flight: FlightData, axis: str, texts: Sequence[str]) -> list[str]:
    """Terms whose parameters the flight does not determine beside those of the model. Raises InputError."""
    if not texts:
        return []
    columns = flight.columns(flight.parsed(texts))
    determined = fit_axis(flight, axis).extended(columns, texts).determined[-len(texts) :]
    return [text for text, known in zip(texts, determined, strict=True) if not known]


def shapes_of(bench: CandidateEvaluator, trial: Score) -> dict[str, list[Score]]:
    """What a true effect leaves where its shape is not quite that of a candidate, by axis, what explains most first.

    Its terms curved, growing with the angle of attack, or once more with other inner numbers. ``bench`` has the
    candidate in its model.
    """
    effect, shapes = trial.candidate.effect, {}
    again = bench.best_of(effect) if effect is not None and trial.candidate.inner else None
    for axis, terms in trial.candidate.terms.items():
        if axis not in bench.fits:
            continue
        texts = [text for term in terms for text in (f"({term})*abs({term})", f"({term})**3", f"alpha*({term})")]
        texts += again.candidate.terms.get(axis, ()) if again is not None else ()
        parts = [bench.trial(Candidate(None, "", (), {axis: (t,)})) for t in texts if len(t) <= MAXIMUM_LENGTH]
        known = [part for part in parts if part is not None and part.pays]
        if known:
            shapes[axis] = sorted(known, key=lambda part: -part.score)
    return shapes


def _fits(
    data: FlightData, axes: Collection[str] = AXES, shapes: Mapping[str, Sequence[str]] | None = None
) -> dict[str, AxisFit]:
    """The fit of every axis that has data, with the tilt of the lift vector in C_X, and ``shapes`` by axis."""
    fits, _ = fits_of(data, axes)
    more = {axis: list(texts) for axis, texts in (shapes or {}).items() if axis in fits}
    if "CX" in fits:
        more["CX"] = [*tilt_terms(data), *more.get("CX", ())]
    for axis, texts in more.items():
        columns = data.columns(data.parsed(texts))
        with contextlib.suppress(InputError):
            fits[axis] = fits[axis].extended(columns, [f"{axis}_{term}" for term in texts])
    return fits


def tilt_terms(data: FlightData) -> list[str]:
    """Terms of C_X that follow from those of C_Z and C_Y, since forces turn with the flow: no effect is missing.

    In body axes C_X = C_L sin(alpha) - C_D cos(alpha) - C_Y' sin(beta): a lift that depends on q and de gives alpha q
    and alpha de, a side force across the flow that depends on dr gives beta dr. What beta itself makes, beta**2, is an
    effect of its own (sideslip_drag).
    """
    present, model = set(data.model.terms["CX"]), data.model.terms
    tilted = [f"alpha*({term})" for term in model["CZ"] if term not in ("1", "alpha")]
    tilted += [f"beta*({term})" for term in model["CY"] if term not in ("1", "beta")]
    texts = [program.text for program in data.parsed(term for term in tilted if len(term) <= MAXIMUM_LENGTH)]
    return [text for text in texts if text not in present]


#: Signals whose products the search outside the library tries, with the named inputs of the aircraft.
_SIGNALS = ("alpha", "beta", "p", "q", "r", "de", "da", "dr", "flaps", "Tc", "V", "height", "alpha_dot", "beta_dot")
_HINGED = ("alpha", "beta", "V", "height")
#: Rates of the flow angles contain the measured forces, which answer to gusts before the reconstructed angles do, and
#: the gradient of a gust along the aeroplane, which turns it as a rate does and which no replica has: in gusts they say
#: something of every force and moment. In forces they say nothing in calm air either: the noise of the accelerometer is
#: on both sides, and is all that there is where nothing moves the aeroplane sideways. And see
#: ``FlightData.has_late_surfaces``.
_RATES = frozenset({"alpha_dot", "beta_dot"})


def expressions(data: FlightData) -> Iterator[Candidate]:
    """Generic terms, one per axis each: products, powers, kinks of the signals that this flight has and moves."""
    moving = [name for name in (*_SIGNALS, *data.model.inputs) if moves(data.signal(name))]
    texts = [*moving, *(f"{name}*abs({name})" for name in moving), *(f"{name}**3" for name in moving)]
    texts += [f"{a}*{b}" for i, a in enumerate(moving) for b in moving[i + 1 :]]
    texts += [f"{name}**2" for name in moving]
    texts += [f"abs({name})" for name in ("beta", "de", "da", "dr") if name in moving]
    for name in _HINGED:
        if name in moving:
            levels = np.nanquantile(data.signal(name), (0.25, 0.5, 0.75))
            texts += [f"max({name}-({level:.4g}),0)" for level in levels]
    unclear = data.aircraft.process_noise["wind"] > THRESHOLDS.calm or data.has_late_surfaces
    for axis in AXES:
        known = set(data.model.terms[axis]) | (set(tilt_terms(data)) if axis == "CX" else set())
        for program in data.parsed(texts):
            is_same = bool(program.signals & _RATES) and (unclear or axis not in MOMENTS)
            if program.text not in known and not is_same:
                yield Candidate(None, "", (), {axis: (program.text,)})


def best_by_axis(trials: Iterable[Score]) -> dict[str, Score]:
    """Of expressions, each in one axis, that which explains most by axis."""
    best: dict[str, Score] = {}
    for trial in trials:
        for axis in trial.gains:
            best[axis] = max(best.get(axis, trial), trial, key=lambda t: t.score)
    return best


def moves(column: Array) -> bool:
    """Whether a signal has numbers in most of the flight, and more than one."""
    finite = column[np.isfinite(column)]
    return len(finite) > 0.5 * len(column) and float(np.ptp(finite)) > 0.0
