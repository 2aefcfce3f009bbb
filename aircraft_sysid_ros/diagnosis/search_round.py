"""One pass of the search over the library and over the expressions outside it, and what is named of it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.finding import (
    Finding,
    clearly_more,
    explains_more,
    is_simpler,
    resting_on,
    share_of_first,
)
from aircraft_sysid_ros.diagnosis.flight.place_columns import unsaid_columns
from aircraft_sysid_ros.diagnosis.late_vane import delay_that_explains
from aircraft_sysid_ros.diagnosis.search.candidates import can_act
from aircraft_sysid_ros.diagnosis.search.evaluator import (
    CandidateEvaluator,
    Score,
    best_by_axis,
    expressions,
    new_terms,
    size_of,
)
from aircraft_sysid_ros.diagnosis.search.fit import Gain
from aircraft_sysid_ros.diagnosis.search.sudden_change import sudden_change, without_axes, without_lasting_terms
from aircraft_sysid_ros.diagnosis.significance.maximum_statistic import Null
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import Replica
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import in_parallel

Array = npt.NDArray[np.float64]


class SearchRound:
    """One pass over the library and over the expressions outside it."""

    def __init__(
        self,
        bench: CandidateEvaluator,
        empty: Sequence[CandidateEvaluator],
        null: Null,
        library: Sequence[Effect],
        progress: Callable[[float], None],
        last: SearchRound | None,
        first: Mapping[str, float],
        floor: Mapping[str, float],
        is_part: bool = False,
    ) -> None:
        """``first``: held-out errors by axis before anything was found; ``floor``: those of the replicas.

        ``is_part``: the bench has a part of the flight, in which less can be determined.
        """
        self.bench, self.empty, self.null, self.library, self.is_part = bench, empty, null, library, is_part
        self.first, self.floor = first, floor
        self.left = left_of(bench, floor, resting_on(bench.data.inferred))
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

    def on(self, bench: CandidateEvaluator) -> SearchRound:
        """The same pass over a part of the flight."""
        return SearchRound(bench, self.empty, self.null, self.library, _nobody, None, self.first, self.floor, True)

    def after(self, named: Finding) -> SearchRound:
        """The pass that follows, with what this one has named in the model."""
        candidate = named.trial.candidate
        bench = self.bench.judging(candidate).extended(new_terms(self.bench.data, named.trial))
        return SearchRound(
            bench, self.empty, self.null, self.library, _nobody, self, self.first, self.floor, self.is_part
        )

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

    def named(self, significant: Sequence[Finding], before: Sequence[Finding], surer: bool = False) -> Finding | None:
        """The one of the findings that is named, after some that were found before; None where none is a verdict.

        ``surer``: one is asked for that is as sure as what is found later.
        """
        level = THRESHOLDS.further if before or surer else THRESHOLDS.verdict
        resting = resting_on(self.bench.data.inferred)
        sizeable = (f for f in significant if f.matters and f.trial.main_axis not in resting)
        candidates = [f for f in sizeable if not before or self.is_part or f.lowers_the_error()]
        sure = next((f for f in candidates if f.p_value < level), None)
        if sure is None:
            return None
        # That something is missing the surest one proves; what it is, the one that explains clearly most.
        best = next((f for f in candidates[: candidates.index(sure)] if explains_more(f.trial, sure.trial)), sure)
        simpler, axis = [f for f in candidates if is_simpler(f, best)], best.trial.main_axis
        return max(simpler, key=lambda f: f.trial.log_ratios[axis], default=best)

    @property
    def p_value(self) -> float:
        """The smallest of all candidates, the changes at one moment apart."""
        families = [(t.candidate.family, t.score) for t in self.trials]
        families += [(outside_in(axis), trial.score) for axis, trial in best_by_axis(self.outside).items()]
        return min((self.null.test(family, score)[2] for family, score in families), default=1.0)

    def _test(self, trial: Score) -> Finding:
        excess, evidence, p_value = self.null.test(trial.candidate.family, trial.score)
        return self._finding(trial, excess, evidence, p_value)

    def _finding(self, trial: Score, excess: float, evidence: float, p_value: float) -> Finding:
        data = self.bench.judging(trial.candidate).data
        over = self._above_floor(trial)
        amid = tuple(
            axis for axis, (error, _) in self.left.items() if error > THRESHOLDS.left_most and axis not in trial.gains
        )
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
        return share_of_first(trial.gains[axis], self.bench.fits[axis].nrmse_held_out, self.first[axis])

    def _outside(self, best: Finding | None, first: bool) -> Finding | None:
        """The generic expression that explains most, if it explains clearly more than the best effect."""
        rivals = sorted(self._rivals(best, first), key=lambda t: -t.score)
        for trial in rivals:
            if best is None or explains_more(trial, best.trial):
                finding = self._test_outside(trial)
                sizeable = finding.size >= THRESHOLDS.size and not self._is_of_place(trial)
                if finding.p_value < THRESHOLDS.false_alarm and sizeable:
                    return finding
        return None

    def _is_of_place(self, trial: Score) -> bool:
        """Whether an expression has no size beside what places of IMU and vanes may make that nobody has said.

        The moments that turn the aeroplane are measured: what acts in them as well as in a force may look like a place
        too, so that effects of the library, which have a name, are not asked.
        """
        if trial.candidate.happens or not self.bench.data.aircraft.unsaid:
            return False
        axis, data = trial.main_axis, self.bench.data
        columns, names = unsaid_columns(data, axis)
        if not names:
            return False
        try:
            fit = self.bench.fits[axis].extended(columns, names)
            gain = fit.gain(data.columns(data.parsed(trial.candidate.terms[axis])))
        except InputError:  # what places make is nowhere known where the coefficient is
            return False
        return share_of_first(gain, fit.nrmse_held_out, self.first[axis]) < THRESHOLDS.size

    def _rivals(self, best: Finding | None, first: bool) -> Iterator[Score]:
        """The best expression of each axis and, where an effect would be named first, the best change at one moment."""
        yield from best_by_axis(self.outside).values()
        if first and best is not None and best.size >= THRESHOLDS.size:
            change = self._change()
            if change is not None:
                yield change

    def _change(self) -> Score | None:
        """The best change at one moment, without axes and terms in which what was always there explains as much.

        A change may take anything with it that is missing besides, and then explains more than what has happened.
        """
        change = sudden_change(self.bench)
        if change is None:
            return None
        change = without_lasting_terms(self.bench, change)
        lasting = [trial.gains for trial in self.trials if not trial.candidate.happens]
        others = {
            axis for axis, gain in change.gains.items() if any(_explains_as_much(of, axis, gain) for of in lasting)
        }
        return change if not others or len(others) == len(change.gains) else without_axes(self.bench, change, others)

    def _test_outside(self, trial: Score) -> Finding:
        null, family = self.null, outside_in(trial.main_axis)
        if trial.candidate.happens:  # the same search in every replica, which takes its time
            family = trial.candidate.family
            null = null.with_family(family, np.array([*in_parallel(_change_in, self.empty)]))
        excess, evidence, p_value = null.test(family, trial.score)
        return self._finding(trial, excess, evidence, p_value)

    def _with_company(self, finding: Finding, others: Sequence[Finding]) -> Finding:
        """The finding with the candidates that this flight cannot tell from it; what physics rules out is none.

        Where that explains clearly more, something else is there that is like it.
        """
        axis, family = finding.trial.main_axis, finding.trial.candidate.family
        own = self.bench.contribution(finding.trial, axis)
        has_name = finding.trial.candidate.effect is not None  # one that could be wrong
        names, outdone_by = list[str](), ""
        for other in others:
            candidate = other.trial.candidate
            if candidate.effect is None or candidate.family == family or axis not in other.trial.gains:
                continue
            if other.impossible:
                if has_name and not outdone_by and clearly_more(other.trial.gains[axis], finding.trial.gains[axis]):
                    outdone_by = candidate.label
                continue
            alike = _correlation(own, self.bench.contribution(other.trial, axis))
            if alike >= THRESHOLDS.alike and other.excess >= THRESHOLDS.as_good * finding.excess:
                names.append(candidate.family)
        first, happens = self.first[axis], finding.trial.candidate.happens
        late = np.nan if happens else delay_that_explains(self.bench, finding.trial, first)
        return replace(finding, confounded_with=tuple(names), outdone_by=outdone_by, late_vane=late)


def _nobody(share: float) -> None:
    """Hears the progress that nobody waits for."""


def null_of(replicas: Sequence[Replica], library: Sequence[Effect], axes: Collection[str]) -> Null:
    """What the same search finds in the replicas: each effect, and the best expression of each axis."""
    effects = {e.identifier: np.array([r.scores.get(e.identifier, np.nan) for r in replicas]) for e in library}
    outside = {outside_in(axis): np.array([r.outside.get(axis, np.nan) for r in replicas]) for axis in axes}
    return Null({**effects, **outside})


def outside_in(axis: str) -> str:
    """Family of the expressions of an axis, of which the best one counts."""
    return f"outside the library in {axis}"


def left_of(
    bench: CandidateEvaluator, floor: Mapping[str, float], resting: Collection[str]
) -> dict[str, tuple[float, float]]:
    """Axes of which a good part is left, far above the replicas: their error, and that over the replicas'."""
    errors = {a: fit.nrmse_held_out for a, fit in bench.fits.items() if a not in resting and floor.get(a, 0.0) > 0.0}
    return {
        axis: (error, error / floor[axis])
        for axis, error in errors.items()
        if error > THRESHOLDS.left and error > THRESHOLDS.left_times * floor[axis]
    }


def _change_in(bench: CandidateEvaluator) -> float:
    """What the best change at one moment scores."""
    change = sudden_change(bench)
    return 0.0 if change is None else change.score


def _explains_as_much(gains: Mapping[str, Gain], axis: str, gain: Gain) -> bool:
    """Whether a candidate has size in an axis, and another one does not gain clearly more there."""
    own = gains.get(axis)
    return own is not None and size_of(own) >= THRESHOLDS.size and not clearly_more(gain, own)


def _simplicity(finding: Finding) -> tuple[int, bool]:
    """Numbers that a candidate fits, and whether it is rare: the smallest is named first."""
    candidate = finding.trial.candidate
    return candidate.numbers, candidate.effect is not None and candidate.effect.rare


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
