"""Which effect is missing: candidates ranked by what they explain on held-out flight, and a verdict.

A candidate is significant when it explains more than the same search finds in replicas of the flight in which nothing
is missing (``maximum_statistic``). A verdict needs size as
well: a share of the held-out error of an axis must go, so that what is true but tiny is listed and not called missing.
The effects are found one after another, each with those before it in the model, until none is left. What is found
later must explain that share of the error that there was at first, and more than another shape of what was found
before would. All limits are in ``thresholds``.

When a generic expression, or a change at one moment, explains clearly more than the best effect of the library, the
cause is not in the library: the verdict is "unexplained", with the expression, and that effect is not named first.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.candidates import can_act
from aircraft_sysid_ros.diagnosis.search.evaluator import (
    CandidateEvaluator,
    Score,
    best_by_axis,
    errors_of,
    expressions,
    log_ratio,
    new_terms,
    shapes_of,
    size_of,
)
from aircraft_sysid_ros.diagnosis.search.fit import Gain
from aircraft_sysid_ros.diagnosis.search.sudden_change import sudden_change
from aircraft_sysid_ros.diagnosis.significance.maximum_statistic import Null
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import Replica
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect
from aircraft_sysid_ros.identification.conditions import listed
from aircraft_sysid_ros.processes import in_parallel

Array = npt.NDArray[np.float64]


#: Axes whose model reads a signal of the air data.
_RESTING = {"V": AXES, "alpha": ("CX", "CZ", "Cm"), "beta": ("CY", "Cl", "Cn")}
NONE, MISSING, UNEXPLAINED = "none", "missing", "unexplained"


@dataclass(frozen=True)
class Finding:
    """A significant candidate, with its evidence."""

    trial: Score
    flight: FlightData = field(repr=False)  # under the model that lacks it: with what was found before
    excess: float  # of the score over that in replicas
    evidence: float  # the same in standard deviations over replicas
    p_value: float  # allowing for the number of candidates
    size: float  # share of the held-out rms error of its main axis, before anything was found, that goes
    above_floor: float  # error of its main axis without it, over that of the replicas
    confounded_with: tuple[str, ...] = ()
    blocks: tuple[int, ...] = ()  # numbers of the blocks of time that hold most of the evidence
    amid: tuple[str, ...] = ()  # axes on which it does not act and of which most is left
    #: By axis the term that explains most of what the effect leaves since it has another shape, if that has size.
    shape: Mapping[str, str] = field(default_factory=dict)
    told_by: str = ""  # in words, of what is no held-out error of the whole flight

    @property
    def matters(self) -> bool:
        """It has size, moves the coefficient, and explains more than its numbers cost."""
        return not self._weakness

    @property
    def _weakness(self) -> str:
        """The first rule of size that refuses it, in words; empty where none does."""
        gain = self.trial.gains[self.trial.main_axis]
        moved = np.sqrt(max(gain.nrmse_before**2 - gain.nrmse_after**2, 0.0))
        if impossible := self.impossible:
            return impossible
        if self._must_show_in and not self._shown:
            return f"it cannot be seen in {self._must_show_in}, where it cannot be absent"
        if self.size < THRESHOLDS.size:
            return f"that is less than {THRESHOLDS.size:.0%}"
        if moved < THRESHOLDS.least_moved:
            return f"it moves the coefficient by less than {THRESHOLDS.least_moved:.0%} of its spread"
        if self.above_floor < THRESHOLDS.above_floor:
            return f"the error is only {self.above_floor:.2g} times what noise makes of it"
        if len(self.amid) >= THRESHOLDS.left_axes and self._share_above_noise() < THRESHOLDS.left_share:
            return (
                f"it explains only {self._share_above_noise():.0%} of what is above the noise, while most of "
                f"{listed([f'{axis[0]}_{axis[1]}' for axis in self.amid])} is left: replicas of a model that fails so "
                "widely say little of chance"
            )
        return "" if self.excess > self.trial.price else "it explains no more than its numbers cost"

    @property
    def impossible(self) -> str:
        """Why its physics rules it out, in words; empty where it does not."""
        shown = self._shown
        if shown and max(shown) < 0.5 * THRESHOLDS.size:
            return f"it does not show in {self._must_show_in}, where it cannot be absent"
        if wrong := self._wrong_sign:
            return f"its part of {wrong[0]}_{wrong[1]} has the sign that it cannot have"
        return ""

    @property
    def _must_show_in(self) -> str:
        """The axes where its physics cannot be absent, in words."""
        effect = self.trial.candidate.effect
        return " and ".join(f"{axis[0]}_{axis[1]}" for axis in (effect.shows_in if effect else ()))

    @property
    def _shown(self) -> list[float]:
        """Share of the error of each of these axes that goes, where the flight can judge it."""
        effect, gains = self.trial.candidate.effect, self.trial.gains
        return [size_of(gains[axis]) for axis in (effect.shows_in if effect else ()) if axis in gains]

    @property
    def _wrong_sign(self) -> str:
        """The first axis in which the mean of what it adds has not the sign that its physics gives; empty: none has."""
        trial, effect = self.trial, self.trial.candidate.effect
        for axis, sign in effect.signs.items() if effect else ():
            if axis in trial.gains:
                columns = self.flight.columns(self.flight.parsed(trial.candidate.terms[axis]))
                if sign * np.nanmean(columns @ np.nan_to_num(trial.gains[axis].parameters)) < 0.0:
                    return axis
        return ""

    def refusal(self, first: bool) -> str:
        """Why it is no verdict, in words; empty where nothing but what was found before it is in the way."""
        level = THRESHOLDS.verdict if first else THRESHOLDS.further
        return self._weakness or (f"chance does as much (p = {self.p_value:.2g})" if self.p_value >= level else "")

    def _share_above_noise(self) -> float:
        """Share of the variance of what is left of its main axis, beyond that of the replicas, that goes."""
        goes = 1.0 - (1.0 - size_of(self.trial.gains[self.trial.main_axis])) ** 2
        return goes / max(1.0 - self.above_floor**-2.0, goes)

    def lowers_the_error(self) -> bool:
        """Whether what is left falls as ``add`` adds it: the search has shapes of what was found before besides."""
        before, after = errors_of(self.flight, self.trial, self.trial.main_axis)
        return after <= (1.0 - THRESHOLDS.size) * before


@dataclass(frozen=True)
class Diagnosis:
    """The verdict with everything that it rests on."""

    verdict: str
    found: tuple[Finding, ...]  # one after another
    candidates: tuple[Finding, ...]  # best first; what is found comes first
    floor: Mapping[str, float]  # held-out NRMSE by axis that the flight would have if nothing were missing
    tried: int
    replicas: int
    bench: CandidateEvaluator = field(repr=False)  # the flight with what was found in the model
    #: How probable it is that a flight in which nothing is missing shows as much as this one, in whatever candidate.
    p_value: float
    #: By axis in which inferred angles allow no name: the error, over that of replicas.
    unknown: Mapping[str, float] = field(default_factory=dict)
    #: By axis of which most is left and nothing explains it: the held-out error, and that over the replicas'.
    left: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def after(self, finding: Finding) -> Diagnosis:
        """The same with what was found before anything was searched for."""
        found, candidates = (finding, *self.found), (finding, *self.candidates)
        p_value = min(self.p_value, finding.p_value)
        return replace(self, verdict=_verdict(found), found=found, candidates=candidates, p_value=p_value)


def diagnose(
    bench: CandidateEvaluator,
    replicas: Sequence[Replica],
    library: Sequence[Effect],
    progress: Callable[[float], None] = lambda share: None,
) -> Diagnosis:
    """Diagnose one flight with replicas of it; ``progress`` hears shares from 0 to 1."""
    empty = [CandidateEvaluator(replica.data) for replica in replicas]
    floor = {
        axis: float(np.mean([other.fits[axis].nrmse_held_out for other in empty if axis in other.fits]))
        for axis in bench.fits
    }
    null = _null_of(replicas, library, tuple(bench.fits))
    found: list[Finding] = []
    listed: list[Finding] = []
    resting, tried, p_value = resting_on(bench.data.inferred), 0, 1.0
    one: _Round | None = None
    first = {axis: fit.nrmse_held_out for axis, fit in bench.fits.items()}
    for number in range(THRESHOLDS.most_effects):
        one = _Round(bench, empty, null, library, _part(progress, number), one, first, floor)
        p_value = one.p_value if number == 0 else p_value
        tried = max(tried, len(one.trials))
        significant = one.findings(found)
        known = {f.trial.candidate.family for f in listed}
        listed += [f for f in significant if f.trial.candidate.family not in known]
        level = THRESHOLDS.further if found else THRESHOLDS.verdict
        sizeable = (f for f in significant if f.matters and f.trial.main_axis not in resting)
        named = [f for f in sizeable if not found or f.lowers_the_error()]
        sure = next((f for f in named if f.p_value < level), None)
        if sure is None:
            break
        # That something is missing the surest one proves; what it is, the one that explains clearly most.
        best = next((f for f in named[: named.index(sure)] if explains_more(f.trial, sure.trial)), sure)
        terms = new_terms(bench.data, best.trial)
        bench = bench.judging(best.trial.candidate).extended(terms)
        shapes = shapes_of(bench, best.trial)
        found.append(replace(best, shape=_sizeable(shapes, bench, first)))
        columns = {
            axis: [text for part in parts for text in part.candidate.terms[axis]] for axis, parts in shapes.items()
        }
        bench = bench.extended({}, columns)
        empty = [other.judging(best.trial.candidate).extended(terms, columns) for other in empty]
    progress(1.0)
    unknown = _unknown(bench, floor, resting, listed)
    names = {f.trial.candidate.family for f in found}
    order = found + [f for f in listed if f.trial.candidate.family not in names]
    left = _left(bench, floor, resting)
    return Diagnosis(
        _verdict(found), tuple(found), tuple(order), floor, tried, len(replicas), bench, p_value, unknown, left
    )


def _null_of(replicas: Sequence[Replica], library: Sequence[Effect], axes: Collection[str]) -> Null:
    """What the same search finds in the replicas: each effect, and the best expression of each axis."""
    effects = {e.identifier: np.array([r.scores.get(e.identifier, np.nan) for r in replicas]) for e in library}
    outside = {_outside_in(axis): np.array([r.outside.get(axis, np.nan) for r in replicas]) for axis in axes}
    return Null({**effects, **outside})


def _outside_in(axis: str) -> str:
    """Family of the expressions of an axis, of which the best one counts."""
    return f"outside the library in {axis}"


def _sizeable(
    shapes: Mapping[str, Sequence[Score]], bench: CandidateEvaluator, first: Mapping[str, float]
) -> dict[str, str]:
    """By axis the term that explains most of what an effect leaves, where that is a share of the first error."""
    best = {axis: parts[0] for axis, parts in shapes.items()}
    sizes = {
        axis: _share(part.gains[axis], bench.fits[axis].nrmse_held_out, first[axis]) for axis, part in best.items()
    }
    texts = {axis: bench.data.parsed(part.candidate.terms[axis])[0].text for axis, part in best.items()}
    return {axis: text for axis, text in texts.items() if sizes[axis] >= THRESHOLDS.size}


def _share(gain: Gain, now: float, first: float) -> float:
    """Share of the error that an axis had at first that goes; ``now`` is what it has now."""
    return size_of(gain) * min(now / first, 1.0) if first > 0.0 else 0.0


def _unknown(
    bench: CandidateEvaluator, floor: Mapping[str, float], resting: Collection[str], listed: Sequence[Finding]
) -> dict[str, float]:
    """Axes in which something could be named if the angles of flow were measured: their error over that of replicas."""
    axes = {f.trial.main_axis for f in listed if f.matters} & set(resting)
    return {axis: bench.fits[axis].nrmse_held_out / floor[axis] for axis in sorted(axes, key=AXES.index)}


def _left(
    bench: CandidateEvaluator, floor: Mapping[str, float], resting: Collection[str]
) -> dict[str, tuple[float, float]]:
    """Axes of which most is left, far above the replicas: their error, and that over the replicas'."""
    errors = {a: fit.nrmse_held_out for a, fit in bench.fits.items() if a not in resting and floor.get(a, 0.0) > 0.0}
    return {
        axis: (error, error / floor[axis])
        for axis, error in errors.items()
        if error > THRESHOLDS.left and error > THRESHOLDS.left_times * floor[axis]
    }


def resting_on(inferred: Collection[str]) -> set[str]:
    """Axes that rest on signals of the air data that no sensor measures."""
    return {axis for name in inferred for axis in _RESTING[name]}


def _verdict(found: Sequence[Finding]) -> str:
    """What was found first decides."""
    if not found:
        return NONE
    return MISSING if found[0].trial.candidate.effect is not None else UNEXPLAINED


def _part(progress: Callable[[float], None], number: int) -> Callable[[float], None]:
    return lambda share: progress((number + share) / THRESHOLDS.most_effects)


class _Round:
    """One pass over the library and over the expressions outside it."""

    def __init__(
        self,
        bench: CandidateEvaluator,
        empty: Sequence[CandidateEvaluator],
        null: Null,
        library: Sequence[Effect],
        progress: Callable[[float], None],
        last: _Round | None,
        first: Mapping[str, float],
        floor: Mapping[str, float],
    ) -> None:
        """``first``: held-out errors by axis before anything was found; ``floor``: those of the replicas."""
        self.bench, self.empty, self.null, self.first, self.floor = bench, empty, null, first, floor
        self.left = _left(bench, floor, resting_on(bench.data.inferred))
        changed = {axis for axis, fit in bench.fits.items() if last is None or fit is not last.bench.fits[axis]}
        tried: dict[str, Score | None] = {}
        if last is not None:
            tried |= {t.candidate.family: t for t in (*last.trials, *last.outside)}
        acting = [e for e in library if can_act(e, bench.data)]  # replicas have scored all: that is chance, too
        again = [e for e in acting if changed & {*e.axes, *e.reads} or e.identifier not in tried]
        for i, (effect, candidate) in enumerate(zip(again, bench.best_candidates(again), strict=True)):
            progress(0.7 * i / len(again))
            trial = None if candidate is None else bench.trial(candidate)
            tried |= {effect.identifier: trial}
        self.trials: list[Score] = [trial for e in acting if (trial := tried.get(e.identifier)) is not None]
        self.outside: list[Score] = []
        for candidate in expressions(bench.data):
            new = changed & set(candidate.terms) or candidate.family not in tried
            trial = bench.trial(candidate) if new else tried[candidate.family]
            if trial is not None:
                self.outside.append(trial)

    def findings(self, before: Sequence[Finding]) -> list[Finding]:
        """Significant candidates, best first."""
        done = {f.trial.candidate.family for f in before}
        tested = [self._test(t) for t in self.trials if t.candidate.family not in done]
        significant = [f for f in tested if f.p_value < THRESHOLDS.false_alarm]
        significant.sort(key=lambda f: f.trial.price - f.excess)
        if significant:
            near = [f for f in significant if f.excess >= THRESHOLDS.nearly * significant[0].excess]
            best = min(near, key=_simplicity)
            significant.sort(key=lambda f: f is not best)
        outside = self._outside(significant[0] if significant else None, first=not before)
        if outside is not None:
            significant.insert(0, outside)
        return [self._with_company(f, significant) for f in significant]

    @property
    def p_value(self) -> float:
        """The smallest of all candidates, the changes at one moment apart."""
        families = [(t.candidate.family, t.score) for t in self.trials]
        families += [(_outside_in(axis), trial.score) for axis, trial in best_by_axis(self.outside).items()]
        return min((self.null.test(family, score)[2] for family, score in families), default=1.0)

    def _test(self, trial: Score) -> Finding:
        excess, evidence, p_value = self.null.test(trial.candidate.family, trial.score)
        return self._finding(trial, excess, evidence, p_value)

    def _finding(self, trial: Score, excess: float, evidence: float, p_value: float) -> Finding:
        data = self.bench.judging(trial.candidate).data
        over = self._above_floor(trial)
        amid = tuple(axis for axis in self.left if axis not in trial.gains)
        return Finding(
            trial, data, excess, evidence, p_value, self._size(trial), over, blocks=_blocks(trial), amid=amid
        )

    def _above_floor(self, trial: Score) -> float:
        """Error of the main axis of a candidate without it, over what noise makes of it.

        That is the error of the replicas, or what the candidate leaves where that is less: an aircraft file that says
        nothing of a sensor may make replicas noisier than the flight.
        """
        axis = trial.main_axis
        error = self.bench.fits[axis].nrmse_held_out
        floor = min(self.floor.get(axis, 0.0), error * (1.0 - size_of(trial.gains[axis])))
        return error / floor if floor > 0.0 else np.inf

    def _size(self, trial: Score) -> float:
        axis = trial.main_axis
        return _share(trial.gains[axis], self.bench.fits[axis].nrmse_held_out, self.first[axis])

    def _outside(self, best: Finding | None, first: bool) -> Finding | None:
        """The generic expression that explains most, if it explains clearly more than the best effect."""
        rivals = sorted(self._rivals(best, first), key=lambda t: -t.score)
        for trial in rivals:
            if best is None or explains_more(trial, best.trial):
                finding = self._test_outside(trial)
                if finding.p_value < THRESHOLDS.false_alarm and finding.size >= THRESHOLDS.size:
                    return finding
        return None

    def _rivals(self, best: Finding | None, first: bool) -> Iterator[Score]:
        """The best expression of each axis and, where an effect would be named first, the best change at one moment."""
        yield from best_by_axis(self.outside).values()
        if first and best is not None and best.size >= THRESHOLDS.size:
            change = sudden_change(self.bench)
            if change is not None:
                yield change

    def _test_outside(self, trial: Score) -> Finding:
        null, family = self.null, _outside_in(trial.main_axis)
        if trial.candidate.happens:  # the same search in every replica, which takes its time
            family = trial.candidate.family
            null = null.with_family(family, np.array([*in_parallel(_change_in, self.empty)]))
        excess, evidence, p_value = null.test(family, trial.score)
        return self._finding(trial, excess, evidence, p_value)

    def _with_company(self, finding: Finding, others: Sequence[Finding]) -> Finding:
        """The finding with the candidates that this flight cannot tell from it; what physics rules out is none."""
        axis, family = finding.trial.main_axis, finding.trial.candidate.family
        own = self.bench.contribution(finding.trial, axis)
        names = []
        for other in others:
            candidate = other.trial.candidate
            if candidate.effect is None or candidate.family == family or axis not in other.trial.gains:
                continue
            if other.impossible:
                continue
            alike = _correlation(own, self.bench.contribution(other.trial, axis))
            if alike >= THRESHOLDS.alike and other.excess >= THRESHOLDS.as_good * finding.excess:
                names.append(candidate.family)
        return replace(finding, confounded_with=tuple(names))


def _change_in(bench: CandidateEvaluator) -> float:
    """What the best change at one moment scores."""
    change = sudden_change(bench)
    return 0.0 if change is None else change.score


def explains_more(outside: Score, inside: Score) -> bool:
    """An expression explains clearly more than an effect: in some axis where it has size, and in all."""
    if outside.score - outside.price <= inside.score - inside.price + max(
        THRESHOLDS.preference, THRESHOLDS.preference_share * inside.score
    ):
        return False
    return any(_clearly_more(gain, inside.gains.get(axis)) for axis, gain in outside.gains.items())


def _clearly_more(gain: Gain, other: Gain | None) -> bool:
    if size_of(gain) < THRESHOLDS.size:
        return False
    if other is None:
        return True
    return (
        explained(other) < THRESHOLDS.enough * explained(gain)
        or log_ratio(gain) > log_ratio(other) + THRESHOLDS.clearly
    )


def _simplicity(finding: Finding) -> tuple[int, bool]:
    """Numbers that a candidate fits, and whether it is rare: the smallest is named first."""
    candidate = finding.trial.candidate
    return candidate.numbers, candidate.effect is not None and candidate.effect.rare


def explained(gain: Gain) -> float:
    """Share of the held-out sum of squares that goes."""
    return 1.0 - float(np.sum(gain.after)) / float(np.sum(gain.before))


def _correlation(a: Array, b: Array) -> float:
    size = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return abs(float(np.sum(a * b))) / size if size > 0.0 else 0.0


def _blocks(trial: Score) -> tuple[int, ...]:
    """Blocks that hold most of what a candidate explains, in order of time."""
    gain = trial.gains[trial.main_axis]
    explained = gain.before - gain.after
    order = np.argsort(-explained)
    total, wanted = 0.0, 0.6 * float(np.sum(np.maximum(explained, 0.0)))
    chosen = []
    for i in order:
        if total >= wanted:
            break
        total += float(explained[i])
        chosen.append(int(gain.fit.blocks[i]))
    return tuple(sorted(chosen))
