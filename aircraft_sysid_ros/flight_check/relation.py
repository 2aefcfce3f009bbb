"""What kinematics says of two signals: they agree, or one of them has another sign, unit, scale or time.

A relation names two signals and cannot say which of them is wrong. All relations together can: of the faults that
explain them, the fewest are taken (least absolute deviations: Boyd and Vandenberghe, Convex Optimization, 2004, 6.1.2).
A signal that agrees with two others is not the one that a fourth contradicts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.flight_check.grid import Comparison

Array = npt.NDArray[np.float64]

#: No lag is below this time [s] or within four standard errors, and no scale so near to 1.
LEAST_LAG, LEAST_SCALE, SIGMAS = 0.03, 0.04, 4.0
#: What one signal does not explain of the other, such as gusts, may shift it by so much [s].
_UNEXPLAINED = 0.25
#: Half a step of the grid [s], by which a relation may be outside of its range.
_BARELY = 0.01
#: Least correlation for a lag.
LEAST_FOR_LAG = 0.75
#: Cost of a fault where a contradiction costs 1; signals that come from an estimator of their own are doubted last.
FAULT = 0.4
_MOST_SUSPECTS, _MOST_TOGETHER = 12, 3
#: Signs that are explained by one fault in place of so many, or more.
_IN_PLACE_OF = 3
#: Costs that differ by less are the same.
_SAME_COST = 1e-9
#: How much a relation that holds counts in the choice of suspects.
_BESIDE = 0.01


@dataclass(frozen=True)
class Relation:
    """``first`` against ``second``, a signal or "" for what physics knows, and the evidence in words.

    scale_tolerance: how far the ratio may be from 1, None where the ratio says nothing; has_lag: whether the lag does;
    lag_tolerance: what the law itself gets wrong [s].
    """

    first: str
    second: str
    comparison: Comparison
    evidence: str
    scale_tolerance: float | None = None
    has_lag: bool = True
    has_sign: bool = True
    lag_tolerance: float = LEAST_LAG
    also: tuple[str, ...] = ()  # further signals whose sign turns the relation
    is_derived: bool = False  # made of several signals: to be asked only where nothing simpler is contradicted
    divisor: str = ""  # what the second is divided by: its scale counts the other way

    @property
    def signals(self) -> tuple[str, ...]:
        """All whose sign it has."""
        return tuple(s for s in (self.first, self.second, *self.also) if s)

    @property
    def sign(self) -> float:
        """-1 where they contradict each other."""
        return float(np.copysign(1.0, self.comparison.correlation))

    @property
    def log_ratio(self) -> tuple[float, float]:
        """Least and largest logarithm of the ratio's size that the data and the law allow."""
        room = float(np.log1p(self.scale_tolerance or 0.0))
        return float(np.log(self.comparison.low)) - room, float(np.log(self.comparison.high)) + room

    @property
    def lag(self) -> tuple[float, float]:
        """Least and largest time [s] that the first may be later than the second."""
        c = self.comparison
        unexplained = _UNEXPLAINED * (1.0 - abs(c.correlation))
        room = max(self.lag_tolerance + unexplained, SIGMAS * c.lag_std)
        return c.lag - room, c.lag + room


@dataclass(frozen=True)
class Fault:
    """A signal, what it is wrong by (a sign, the logarithm of a ratio, a lag [s]), and what says so, the best first."""

    signal: str
    size: float
    relations: tuple[Relation, ...]
    also: tuple[str, ...] = ()  # further signals that the same fault reverses


def sign_faults(
    relations: Sequence[Relation], prior: Mapping[str, float], together: Sequence[tuple[str, ...]] = ()
) -> list[Fault]:
    """The fewest signals whose change of sign makes the relations hold; weights by ``prior``, 1 where it is silent.

    ``together``: signals that one fault reverses, which is taken in place of ``_IN_PLACE_OF`` faults or more.
    """
    relations = [r for r in relations if r.has_sign and r.comparison.is_sure]
    suspects = sorted({s for r in relations if r.sign < 0.0 for s in r.signals})[:_MOST_SUSPECTS]
    if not suspects:
        return []
    nodes = [(s,) for s in suspects] + [group for group in together if len({*group} & {*suspects}) > 1]
    turned = np.array(list(product((False, True), repeat=len(nodes))))  # every choice of faults
    cost = FAULT * turned @ np.array([prior.get(n[0], 1.0) if len(n) == 1 else _IN_PLACE_OF - 0.5 for n in nodes])
    for r in relations:
        inside = turned @ np.array([len({*node} & {*r.signals}) for node in nodes])
        contradicts = (inside % 2 == 1) != (r.sign < 0.0)
        cost += abs(r.comparison.correlation) * contradicts
    best = turned[np.argmin(cost)]
    return [
        Fault(node[0], -1.0, tuple(r for r in relations if {*node} & {*r.signals} and r.sign < 0.0), node[1:])
        for node, is_wrong in zip(nodes, best, strict=True)
        if is_wrong
    ]


def scale_faults(relations: Sequence[Relation], prior: Mapping[str, float]) -> list[Fault]:
    """Logarithms of the ratios by which the fewest signals are too large."""
    chosen = [r for r in relations if r.scale_tolerance is not None and r.comparison.is_sure]
    middle = [float(0.5 * np.log(r.comparison.low * r.comparison.high)) for r in chosen]
    return _fewest(chosen, [r.log_ratio for r in chosen], middle, lambda signal: signal, prior, LEAST_SCALE, 0.0)


def lag_faults(
    relations: Sequence[Relation],
    prior: Mapping[str, float],
    stream_of: Callable[[str], str],
    together: Sequence[tuple[str, ...]] = (),
    early: Mapping[str, float] | None = None,
) -> list[Fault]:
    """Times [s] by which the fewest streams are late; the signals of a fault are streams.

    ``together``: streams of one device, which are late as one; ``early``: what their priors are times, where they are
    early instead.
    """
    chosen = [r for r in relations if r.has_lag and r.comparison.is_sure]
    chosen = [r for r in chosen if abs(r.comparison.correlation) > LEAST_FOR_LAG]
    return _fewest(
        chosen, [r.lag for r in chosen], [r.comparison.lag for r in chosen], stream_of, prior, LEAST_LAG, _BARELY,
        together, early,
    )  # fmt: skip


def _fewest(
    relations: Sequence[Relation],
    ranges: Sequence[tuple[float, float]],
    middle: Sequence[float],
    name: Callable[[str], str],
    prior: Mapping[str, float],
    least: float,
    barely: float,
    together: Sequence[tuple[str, ...]] = (),
    negative: Mapping[str, float] | None = None,
) -> list[Fault]:
    """Faults t with t(first) - t(second) + t(divisor) within each relation's range: the cheapest set of up to three.

    A fault costs FAULT times its prior, and times that of ``negative`` sizes, whatever its size, a relation outside its
    range its correlation. Within a set the sizes are those of least absolute deviations (a linear programme); those
    reported fit the middles of the ranges, and of two sets that cost the same it is the one that fits these better.
    Signals ``together`` are one fault, too. A relation that is outside of its range by ``barely`` so much contradicts
    nothing.
    """
    low, high = np.array(ranges, dtype=np.float64).reshape(-1, 2).T
    broken = (low > barely) | (high < -barely)
    if not broken.any():
        return []
    nodes, rows = _nodes(relations, name, together)
    weight = np.array([abs(r.comparison.correlation) for r in relations])
    price = FAULT * np.array([min(prior.get(member, 1.0) for member in node) for node in nodes])
    dearer = np.array([max((negative or {}).get(member, 1.0) for member in node) - 1.0 for node in nodes])
    contradicted = np.any(rows[broken] != 0.0, axis=0)
    beside = np.any(rows[np.any(rows[:, contradicted] != 0.0, axis=1)] != 0.0, axis=0)  # equally wrong, perhaps
    said = weight * (broken + _BESIDE * ~broken) @ np.abs(rows)
    suspects = sorted((int(k) for k in np.flatnonzero(beside)), key=lambda k: -float(said[k]))[:_MOST_SUSPECTS]
    best: tuple[int, ...] = ()
    cheapest, sizes, misfit = float(weight @ broken), np.zeros(0), np.inf
    for chosen in _sets(suspects, nodes):
        fixed, columns = float(np.sum(price[list(chosen)])), rows[:, chosen]
        if fixed > cheapest:
            continue
        cost = fixed + float(weight @ _least_deviations(columns, low, high, weight)[1])
        limit = cheapest + (_SAME_COST if best else -_SAME_COST)
        if cost > limit:
            continue
        fitted, _ = _least_deviations(columns, np.array(middle), np.array(middle), 1.0 / (high - low))
        cost += float(np.sum((dearer * price)[list(chosen)][fitted < 0.0]))
        if cost > limit:
            continue
        away = float(np.sum(np.abs(columns @ fitted - middle) / (high - low)))
        if cost < cheapest - _SAME_COST or away < misfit:
            best, cheapest, sizes, misfit = chosen, cost, fitted, away
    found = []
    for column, size in zip(best, sizes, strict=True):
        for member in nodes[column] if abs(size) >= least else ():  # less contradicts itself, as height and place do
            its = rows[:, nodes.index((member,))]
            evidence = sorted(map(int, np.flatnonzero(its)), key=lambda i: (not broken[i], high[i] - low[i]))
            found.append(Fault(member, float(size), tuple(relations[i] for i in evidence)))
    return found


def _nodes(
    relations: Sequence[Relation], name: Callable[[str], str], together: Sequence[tuple[str, ...]]
) -> tuple[list[tuple[str, ...]], Array]:
    """What may be wrong, by ``name`` and groups of them, and how each enters each relation (relations, nodes)."""
    nodes: list[tuple[str, ...]] = [(n,) for n in sorted({name(s) for r in relations for s in _names(r)})]
    rows = np.zeros((len(relations), len(nodes)))
    for row, relation in zip(rows, relations, strict=True):
        for signal, way in ((relation.first, 1.0), (relation.second, -1.0), (relation.divisor, 1.0)):
            if signal:
                row[nodes.index((name(signal),))] += way
    groups = [group for group in together if all((member,) in nodes for member in group)]
    rows = np.hstack([rows, *(rows[:, [nodes.index((m,)) for m in g]].sum(axis=1, keepdims=True) for g in groups)])
    return nodes + groups, rows


def _sets(suspects: Sequence[int], nodes: Sequence[tuple[str, ...]]) -> Iterator[tuple[int, ...]]:
    """Sets of up to three suspects, none of which has a signal twice."""
    for count in range(1, _MOST_TOGETHER + 1):
        for chosen in combinations(suspects, count):
            members = [member for k in chosen for member in nodes[k]]
            if len(set(members)) == len(members):
                yield chosen


def _names(relation: Relation) -> list[str]:
    return [signal for signal in (relation.first, relation.second, relation.divisor) if signal]


def _least_deviations(rows: Array, low: Array, high: Array, weight: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
    """t (k,) with rows t within low and high (m,) as far as can be, and which relations (m,) are outside."""
    from scipy.optimize import linprog  # here: a flight in which all sensors agree does not need it

    m, k = rows.shape
    above = np.hstack([rows, -np.eye(m)])
    below = np.hstack([-rows, -np.eye(m)])
    solved = linprog(
        np.concatenate([np.zeros(k), weight]), A_ub=np.vstack([above, below]), b_ub=np.concatenate([high, -low]),
        bounds=[(None, None)] * k + [(0.0, None)] * m, method="highs",
    )  # fmt: skip
    return solved.x[:k], solved.x[k:] > 1e-6
