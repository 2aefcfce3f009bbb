"""When an input fails again: of a failure of which one interval is known, all others in the same flight.

A loose plug comes and goes, and a test of failures is flown more than once. With what the failure does known from one
interval, each moment of the flight tells by its own innovations whether it is there: the likeliest sequence of intact
and failed is that of Viterbi, with ln n for each change. What the failure does is then worked out anew from all
intervals, and so on until they stay (hard expectation and maximisation).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.failures.axis_relation import whitened
from aircraft_sysid_ros.diagnosis.failures.failure_search import FailureSearch, Hypothesis, columns_of

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Rounds of times and of what the failure does.
_ROUNDS = 6


def repeated(search: FailureSearch, hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis with all times at which it is there, where that is likelier than with those it has."""
    best = hypothesis
    for _ in range(_ROUNDS):
        spans = [*_spans(_likeliest(_told(search, best), float(np.log(search.count))), search.shortest)]
        if not spans:
            break
        (begin, end), *again = spans
        tried = replace(best, begin=begin, end=end, again=tuple(again))
        if tried == best or not search.leaves_enough(tried) or search.score(tried) <= search.score(best):
            break
        best = tried
    return best


def _told(search: FailureSearch, hypothesis: Hypothesis) -> Array:
    """ln of the likelihood (n,) of each point if it is there, over that if it is not."""
    total, count = np.zeros(search.count), search.count
    for axis in search.axes_of(hypothesis.name):
        relation, fit = search.relations[axis], search.fitted(axis, hypothesis)
        left = []
        for share in (np.zeros(count), np.ones(count)):
            columns = columns_of(relation, hypothesis, share)
            left.append(whitened(relation.response - columns @ fit.parameters, fit.filtering))
        intact, failed = left
        known = whitened(fit.residual, fit.filtering)
        variance = float(np.mean(known**2)) + search.floor(axis, fit.filtering)
        total[count - len(intact) :] += (intact**2 - failed**2) / (2.0 * variance)
    return total


def _likeliest(gains: Array, change: float) -> Mask:
    """The likeliest sequence (n,) of what is there and what is not; each change costs ``change``."""
    n = len(gains)
    there, absent = -change, 0.0
    came_there, came_absent = np.zeros(n, np.bool_), np.zeros(n, np.bool_)  # whether it was there the point before
    for k, gain in enumerate(gains.tolist()):
        came_there[k], came_absent[k] = there >= absent - change, there - change > absent
        there, absent = max(there, absent - change) + gain, max(absent, there - change)
    state = np.empty(n, np.bool_)
    now = there > absent
    for k in range(n - 1, -1, -1):
        state[k] = now
        now = bool(came_there[k] if now else came_absent[k])
    return state


def _spans(there: Mask, shortest: int) -> Iterator[tuple[float, float]]:
    """First and last points of all times that are long enough; what lies between two that are near is part of them."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(np.int8), [0]])))
    begins, ends = list(edges[::2]), list(edges[1::2])
    joined: list[list[int]] = []
    for begin, end in zip(begins, ends, strict=True):
        if joined and begin - joined[-1][1] < shortest:
            joined[-1][1] = int(end)
        else:
            joined.append([int(begin), int(end)])
    for begin, end in joined:
        if end - begin >= shortest:
            yield float(begin), float(end)
