"""Which input stopped acting, from when to when: every hypothesis at its own optimum of times, level and noise.

An input that is held, stuck or cut off between t1 and t2 is so in all axes: the columns that read it are frozen there.
Free numbers are the times and, where the level at which it stays is not known, one per axis in which it acts.

Hypotheses are ranked by their likelihood, each with the colour of noise that suits it best, less half of ln n per free
number (Schwarz). The evidence against the model as it is takes the noise of the hypothesis for both: a step that the
model lacks looks like noise with a long memory, and would hide itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.failures.axis_relation import ENGINE, MEMORY, AxisRelation, whitened
from aircraft_sysid_ros.diagnosis.failures.coloured_fit import coloured_fit
from aircraft_sysid_ros.diagnosis.failures.interval_search import (
    FROZEN,
    HELD,
    NIL,
    PART,
    Whitened,
    intervals,
    sums_of_squares,
)
from aircraft_sysid_ros.diagnosis.failures.repeats import times_there

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Shortest interval [s], and the least number of points of it.
SHORTEST, LEAST_POINTS = 3.0, 6
#: Share of a flight that is intact before, and in all.
BEFORE, INTACT = 0.12, 0.3
#: Edges of intervals of the first pass, and steps to either side between them when they are moved.
_EDGES, _NEARBY = 65, 24
#: Levels of an input that are tried first, and how finely they are told, as a share of its range.
_LEVELS, _FINEST_LEVEL = 9, 0.01
#: Doubt [s] of a time beyond which nobody looks, and the least: servos and engines take their time.
_LONGEST_DOUBT, _LEAST_DOUBT = 25.0, 0.5
#: Fall of the log-likelihood at two standard errors of a time: 2 where the model is right. With that 16 of 25 dates
#: were within their errors (benchmarks/failures.py, seeds 8650000 on).
_FALL = 8.0
#: Time [s] about a begin or an end in which an input that is sooner or later than recorded looks as if it failed.
_EDGE = 1.0
#: Longest time [s] from which others like it are looked for.
_SHORT = 15.0
#: Turns of times and of what a failure does.
_TURNS = 6
#: Rounds of search and of the colour of what is left.
_ROUNDS = 3
#: The colour of noise that has none.
_WHITE = np.ones(1)
#: Colours of noise with which the first pass begins, how many intervals of each it keeps, and how far apart [edges].
_COLOURS = ((1.0,), (1.0, -0.6))
_STARTS, _APART = 4, 3
#: Standard deviation [points] of the step that the low pass of the series makes of a sudden one, and the finest step.
_SMOOTH, _FINEST = 0.47, 0.25
#: Share of a coefficient's spread that a linear model of a stranger's aeroplane leaves at best: it counts as noise.
_MODEL_ERROR = 0.05


@dataclass(frozen=True)
class AxisFit:
    """One axis under one hypothesis."""

    log_likelihood: float  # of the innovations, at their own variance
    parameters: Array
    std: Array
    residual: Array  # (n,)
    filtering: Array


class _Solved(NamedTuple):
    """Whitened columns of usual size 1 and what solves them."""

    rows: Array  # (k + 1, m), the last is the response
    parameters: Array  # (k,) of columns of size 1
    filtering: Array
    size: Array  # (k,) that the columns have
    variance: float  # of the innovations, with the white noise that is in the residuals besides

    @property
    def log_likelihood(self) -> float:
        """Of the innovations, at their own variance."""
        return float(-0.5 * self.rows.shape[1] * np.log(max(self.variance, 1e-300)))


@dataclass(frozen=True)
class Hypothesis:
    """What fails, how, and between which points."""

    name: str  # of the input
    kind: str  # FROZEN, HELD, NIL, PART or CONSTANT
    begin: float  # [points]
    end: float  # the number of points where it lasts
    level: float = np.nan  # of HELD
    again: tuple[tuple[float, float], ...] = ()  # first and last points of what comes later

    @property
    def spans(self) -> tuple[tuple[float, float], ...]:
        """First and last points of all times."""
        return ((self.begin, self.end), *self.again)

    def lasts(self, count: int) -> bool:
        """To the end of the flight."""
        return self.spans[-1][1] >= count

    def share(self, count: int) -> Array:
        """How much it has failed at each point (n,): a step is as smooth as what the series have left of one."""
        from scipy.special import ndtr

        at, total = np.arange(count), np.zeros(count)
        for begin, end in self.spans:
            begun = ndtr((at - begin + 0.5) / _SMOOTH)
            total += begun if end >= count else begun - ndtr((at - end + 0.5) / _SMOOTH)
        return total


@dataclass(frozen=True)
class Judged:
    """A hypothesis with what speaks for it."""

    hypothesis: Hypothesis
    score: float  # ln of the likelihood, less what free numbers cost; of one input and one set of axes only
    evidence: float  # ln of the likelihood over that of the model as it is, less the same
    gains: Mapping[str, float]  # of the evidence by axis, without what numbers cost

    @property
    def main_axis(self) -> str:
        """The axis that it explains most of."""
        return max(self.gains, key=lambda axis: self.gains[axis])


def columns_of(relation: AxisRelation, hypothesis: Hypothesis | None, share: Array | None = None) -> Array:
    """Columns (n, k) of an axis under a hypothesis; the constant, where there is one, is the last.

    ``share`` (n,): how much it has failed, by default at the times of the hypothesis.
    """
    if hypothesis is None or hypothesis.name not in relation.acting:
        return relation.columns
    acting = relation.acting[hypothesis.name]
    failed = hypothesis.share(len(relation.response)) if share is None else share
    out = relation.columns.copy()
    at = list(acting.columns)
    if hypothesis.kind == NIL:
        out[:, at] += failed[:, None] * (acting.idle - out[:, at])
        return out
    if hypothesis.kind == HELD:
        held = acting.frozen + (hypothesis.level - acting.mean) * acting.per_unit
        out[:, at] += failed[:, None] * (held - out[:, at])
        return out
    if hypothesis.kind == FROZEN:
        out[:, at] += failed[:, None] * (acting.frozen - out[:, at])
    if hypothesis.kind == PART:
        out = np.column_stack([out, failed[:, None] * (out[:, at] - acting.frozen)])
    return np.column_stack([out, failed * acting.per_unit[:, 0]])


class FailureSearch:
    """The axes of one flight, and every input that may have failed in it."""

    def __init__(self, relations: Mapping[str, AxisRelation], step: float) -> None:
        self.relations, self.step = relations, step
        self.count = len(next(iter(relations.values())).response)
        self.names = tuple(dict.fromkeys(name for r in relations.values() for name in r.acting))
        self._order = round(MEMORY / step)
        self._scores: dict[Hypothesis, float] = {}
        self._best: dict[tuple[str, str], Judged] = {}
        self._floors = {axis: _MODEL_ERROR * float(np.std(r.response)) for axis, r in relations.items()}
        self.shortest = max(round(SHORTEST / step), LEAST_POINTS)
        self._every = max(self.count // _EDGES, 1)

    @cached_property
    def base(self) -> dict[str, AxisFit]:
        """The axes as they are, without any failure."""
        return {axis: self.fit(axis, r.columns) for axis, r in self.relations.items()}

    def axes_of(self, name: str) -> list[str]:
        """Axes that tell whether an input acts: those of its moments, or C_X of an engine.

        In C_X a surface does little, and what a constant there has to be follows from no other axis.
        """
        found = [axis for axis, r in self.relations.items() if name in r.acting]
        moments = [axis for axis in found if axis in ("Cl", "Cm", "Cn")]
        return ["CX"] if name == ENGINE and "CX" in found else moments or found

    def fit(self, axis: str, columns: Array, filtering: Array | None = None) -> AxisFit:
        """Generalised least squares of an axis, with the colour of residuals that suits them best or a given one."""
        found = self._solved(axis, columns, filtering)
        rows, theta, colour, size = found.rows[:-1], found.parameters, found.filtering, found.size
        covariance = found.variance * np.linalg.pinv(rows @ rows.T, rcond=1e-10)
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        size = np.where(size > 0.0, size, 1.0)
        residual = self.relations[axis].response - columns / size @ theta
        return AxisFit(found.log_likelihood, theta / size, std / size, residual, colour)

    def _solved(self, axis: str, columns: Array, filtering: Array | None = None) -> _Solved:
        colour, rounds = (_WHITE, _ROUNDS) if filtering is None else (filtering, 0)
        response = self.relations[axis].response
        regressors = np.ascontiguousarray(columns)
        return _Solved(*coloured_fit(regressors, response, colour, self._order, self._floors[axis], rounds))

    def fitted(self, axis: str, hypothesis: Hypothesis | None) -> AxisFit:
        """An axis under a hypothesis."""
        return self.base[axis] if hypothesis is None else self.fit(axis, columns_of(self.relations[axis], hypothesis))

    def judged(self, hypothesis: Hypothesis) -> Judged:
        """What speaks for a hypothesis."""
        gains = {}
        for axis in self.axes_of(hypothesis.name):
            found = self._solved(axis, columns_of(self.relations[axis], hypothesis))
            without = self._solved(axis, self.relations[axis].columns, found.filtering)
            gains[axis] = found.log_likelihood - without.log_likelihood
        return Judged(hypothesis, self.score(hypothesis), sum(gains.values()) - self._cost(hypothesis), gains)

    def score(self, hypothesis: Hypothesis) -> float:
        """Of ``Judged``."""
        if hypothesis not in self._scores:
            relations = {axis: self.relations[axis] for axis in self.axes_of(hypothesis.name)}
            likelihoods = [self._solved(a, columns_of(r, hypothesis)).log_likelihood for a, r in relations.items()]
            self._scores[hypothesis] = sum(likelihoods) - self._cost(hypothesis)
        return self._scores[hypothesis]

    def inside(self, hypothesis: Hypothesis) -> float:
        """ln of the likelihood over that of the same input if it had not failed, between its begins and ends only.

        What is there only near one is an input that comes sooner or later than it is recorded: a begin or an end in the
        midst of a doublet makes it so.
        """
        at, within = np.arange(self.count), np.zeros(self.count, np.bool_)
        edge = _EDGE / self.step
        for begin, end in hypothesis.spans:
            within |= (at > begin + edge) & (at < (end if end >= self.count else end - edge))
        return float(np.sum(self._told(hypothesis)[within]))

    def _cost(self, hypothesis: Hypothesis) -> float:
        """Half of ln n for each free number."""
        axes = self.axes_of(hypothesis.name)
        levels = {NIL: 0, HELD: 1}.get(hypothesis.kind, len(axes))
        if hypothesis.kind == PART:
            levels += sum(len(self.relations[axis].acting[hypothesis.name].columns) for axis in axes)
        free = levels + 2 * len(hypothesis.spans) - hypothesis.lasts(self.count)
        return 0.5 * free * float(np.log(self.count))

    def best(self, name: str, kind: str) -> Judged:
        """The best interval of one hypothesis on one input.

        The first pass needs a colour before it knows the interval: it is made with several, and with that of the best.
        """
        if (name, kind) not in self._best:
            self._best[name, kind] = self._searched(name, kind)
        return self._best[name, kind]

    def _searched(self, name: str, kind: str) -> Judged:
        axes = self.axes_of(name)
        colours = [{axis: np.array(colour) for axis in axes} for colour in _COLOURS]
        tried = [*colours, {axis: self.base[axis].filtering for axis in axes}]
        coarse = dict.fromkeys(h for colour in tried for h in self._coarse(name, kind, colour))
        promising = sorted(coarse, key=self.score)
        best = max((self._refined(each) for each in promising[-2:]), key=self.score)
        found = {axis: self.fitted(axis, best).filtering for axis in axes}
        again = max(self._coarse(name, kind, found), key=self.score)
        if self.score(again) > self.score(best):
            best = max(best, self._refined(again), key=self.score)
        return self.judged(self._repeated(best, found))

    def _repeated(self, hypothesis: Hypothesis, colours: Mapping[str, Array]) -> Hypothesis:
        """The same with all times at which it is there, begun from it and from what may be one time of several."""
        short = self._coarse(hypothesis.name, hypothesis.kind, colours, round(_SHORT / self.step))
        tried = dict.fromkeys(self._with_all_times(start) for start in (hypothesis, *short))
        best = max(tried, key=self.score)
        return self._refined(best) if self.score(best) > self.score(hypothesis) else hypothesis

    def _with_all_times(self, hypothesis: Hypothesis) -> Hypothesis:
        """By turns all times from what it does, and what it does from all times (hard expectation and maximisation)."""
        for _ in range(_TURNS):
            spans = times_there(self._told(hypothesis), float(np.log(self.count)), self.shortest)
            if not spans:
                break
            tried = replace(hypothesis, begin=spans[0][0], end=spans[0][1], again=tuple(spans[1:]))
            if not self.leaves_enough(tried) or self.score(tried) <= self.score(hypothesis):
                break
            hypothesis = tried
        return hypothesis

    def _told(self, hypothesis: Hypothesis) -> Array:
        """ln of the likelihood (n,) of each point if it is there, over that if it is not."""
        total = np.zeros(self.count)
        for axis in self.axes_of(hypothesis.name):
            relation = self.relations[axis]
            found = self._solved(axis, columns_of(relation, hypothesis))
            theta = found.parameters / np.where(found.size > 0.0, found.size, 1.0)
            intact, failed = (
                whitened(relation.response - columns_of(relation, hypothesis, share) @ theta, found.filtering)
                for share in (np.zeros(self.count), np.ones(self.count))
            )
            total[self.count - len(intact) :] += (intact**2 - failed**2) / (2.0 * found.variance)
        return total

    def held(self, judged: Judged) -> Judged:
        """The same with one level in all axes, where a control can be: one number in place of one per axis."""
        hypothesis = judged.hypothesis
        values = self.relations[self.axes_of(hypothesis.name)[0]].acting[hypothesis.name].values
        low, high = float(values.min()), float(values.max())
        width = (high - low) / (_LEVELS - 1)
        tried = [replace(hypothesis, kind=HELD, level=float(level)) for level in np.linspace(low, high, _LEVELS)]
        best = max(tried, key=self.score)
        while width > _FINEST_LEVEL * (high - low):
            width /= 3.0
            levels = np.clip(best.level + width * np.array([-2.0, -1.0, 1.0, 2.0]), low, high)
            best = max([best, *(replace(best, level=float(level)) for level in levels)], key=self.score)
        return self.judged(self._refined(best, 4.0 * _FINEST))

    def _coarse(self, name: str, kind: str, colours: Mapping[str, Array], longest: float = np.inf) -> list[Hypothesis]:
        """The best intervals with some colours of the axes that begin at different times; ``longest`` [points]."""
        begin, end = intervals(self.count, self.shortest, self._every)
        begin, end = begin[end - begin <= longest], end[end - begin <= longest]
        series = {axis: self._whitened(axis, name, colour) for axis, colour in colours.items()}
        total = self._scored(kind, series, begin, end)
        chosen: list[Hypothesis] = []
        while len(chosen) < _STARTS and np.isfinite(total).any():
            at = int(np.argmax(total))
            chosen.append(self._nearby(name, kind, series, int(begin[at]), int(end[at])))
            total[np.abs(begin - begin[at]) <= _APART * self._every] = -np.inf
        return chosen

    def _nearby(self, name: str, kind: str, series: Mapping[str, Whitened], begin: int, end: int) -> Hypothesis:
        """The best interval whose edges are within one of those of the first pass: a sudden step is easily missed.

        Of a long flight the edges of the first pass are far apart: the first look is at every so many points.
        """
        reach, lasts = self._every, end >= self.count
        while True:
            apart = max(reach // _NEARBY, 1)
            steps = apart * np.arange(-(reach // apart), reach // apart + 1)
            first, last = np.meshgrid(begin + steps, np.array([end]) if lasts else end + steps, indexing="ij")
            first, last = first.ravel(), np.minimum(last.ravel(), self.count)
            keep = (first > 0) & (last - first >= self.shortest)
            first, last = first[keep], last[keep]
            best = int(np.argmax(self._scored(kind, series, first, last)))
            begin, end, reach = int(first[best]), int(last[best]), apart
            if apart == 1:
                return Hypothesis(name, kind, float(begin), float(end))

    def _scored(self, kind: str, series: Mapping[str, Whitened], begin: Integers, end: Integers) -> Array:
        """Log-likelihood (w,) of intervals by the axes' series; -inf where too little of the flight is intact."""
        total = np.where(end < self.count, -0.5 * np.log(self.count), 0.0)
        for white in series.values():
            lost = self.count - len(white.response)
            first, last = np.maximum(begin - lost, 0), np.maximum(end - lost, 1)
            left = sums_of_squares(white, FROZEN if kind == NIL else kind, first, last)
            total -= 0.5 * (self.count - lost) * np.log(np.maximum(left, 1e-300))
        return np.where(self._leaves_enough(begin, end), total, -np.inf)

    def _leaves_enough(self, begin: npt.ArrayLike, end: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Intervals before and beside which enough of the flight is intact."""
        first, last = np.asarray(begin), np.asarray(end)
        return np.asarray((first >= BEFORE * self.count) & (self.count - (last - first) >= INTACT * self.count))

    def leaves_enough(self, hypothesis: Hypothesis) -> bool:
        """Whether enough of the flight is intact before and beside all of its times, each of which is long enough."""
        spans = np.array(hypothesis.spans)
        lengths, between = spans[:, 1] - spans[:, 0], spans[1:, 0] - spans[:-1, 1]
        intact = self.count - lengths.sum() >= INTACT * self.count
        return bool(spans[0, 0] >= BEFORE * self.count and intact and min([*lengths, *between]) >= self.shortest)

    def _whitened(self, axis: str, name: str, colour: Array) -> Whitened:
        relation = self.relations[axis]
        acting = relation.acting[name]
        at = list(acting.columns)
        parts = (np.delete(relation.columns, at, axis=1), relation.columns[:, at], acting.frozen, acting.per_unit[:, 0])
        return Whitened(*(whitened(part, colour) for part in (*parts, relation.response)))

    def _refined(self, hypothesis: Hypothesis, step: float = 0.0) -> Hypothesis:
        """Both times where the score is best, in ever smaller steps, by default from those of the first pass on.

        A step that was right is followed by one of twice its length: in a long flight the best may be far away.
        """
        step = step or float(max(self._every // 2, 1))
        while True:
            moved = max(self._near(hypothesis, step), key=self.score, default=hypothesis)
            if self.score(moved) > self.score(hypothesis):
                hypothesis, step = moved, 2.0 * step
            elif step <= _FINEST:
                return hypothesis
            else:
                step /= 2.0

    def _near(self, hypothesis: Hypothesis, step: float) -> list[Hypothesis]:
        found = []
        for number, span in enumerate(hypothesis.spans):
            for which in (0, 1) if span[1] < self.count else (0,):
                found += [self._with_edge(hypothesis, number, which, span[which] + s) for s in (-step, step)]
        return [h for h in found if self.leaves_enough(h)]

    def _with_edge(self, hypothesis: Hypothesis, number: int, which: int, point: float) -> Hypothesis:
        """A hypothesis with one of its times moved."""
        spans = [list(span) for span in hypothesis.spans]
        spans[number][which] = min(point, self.count) if which else point
        (begin, end), *again = [(first, last) for first, last in spans]
        return replace(hypothesis, begin=begin, end=end, again=tuple(again))

    def time_errors(self, judged: Judged) -> list[tuple[float, float]]:
        """How far [s] begin and end of each of its times may be off, at two standard errors."""
        found = []
        for number, span in enumerate(judged.hypothesis.spans):
            begin, end = (self._doubt(judged, number, which) for which in (0, 1))
            found.append((begin, np.nan if span[1] >= self.count else end))
        return found

    def _doubt(self, judged: Judged, number: int, which: int) -> float:
        """How far [s] one of the times may be off, at two standard errors."""
        far, point = 0.0, judged.hypothesis.spans[number][which]
        for sign in (-1.0, 1.0):
            for distance in np.arange(1.0, _LONGEST_DOUBT / self.step):
                other = self._with_edge(judged.hypothesis, number, which, point + sign * float(distance))
                if not self._is_possible(other) or self.score(other) < judged.score - _FALL:
                    break
                far = max(far, float(distance))
        return max((far + 1.0) * self.step, _LEAST_DOUBT)

    def _is_possible(self, hypothesis: Hypothesis) -> bool:
        """Whether its times are in the flight and follow each other."""
        edges = np.ravel(hypothesis.spans)
        return bool(edges[0] > 0.0 and edges[-1] <= self.count and np.all(np.diff(edges) > 1.0))
