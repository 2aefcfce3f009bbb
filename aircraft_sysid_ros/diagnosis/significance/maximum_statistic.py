"""How probable is it that a flight in which nothing is missing explains as much as this one, anywhere in the search?

Every replica has been searched as the flight was: each effect of the library with its best inner numbers, and in each
axis the best of the expressions outside it. A search keeps the best of what it tries, so that its scores are maxima,
which are skewed, and related to each other. Two steps allow for that.

1. Each family of candidates is compared with its own scores in the B replicas, t = (score - mean) / deviation, and the
   smallest tail probability, times the number F of families, is the statistic: x = -ln(min(1, F p)). Were the scores
   normal and the families independent, x would be exponential with mean 1.
2. They are not. So each replica is compared with the others in the same way, which gives B values x_b under "nothing is
   missing" (the statistic of the maximum over replicas: Westfall and Young 1993). Their mean says by how much the
   first step was too sure. An exponential variable whose rate is known from B others and, before, like from K with
   the mean 1 exceeds x with the probability p = (1 + x / (S + K))^-(B + K), S their sum, B at least (Lomax 1954).

3. Where replicas show as much, p is at least the share of them that do, the flight itself among them: that is so
   whatever law the x_b follow, which is none of exponential ones where scores are skewed and families related.

So few replicas say little of what is far beyond them: with five nothing is as improbable as it would be with twenty.
On simulated scores, skewed, heavy-tailed or related, p of twenty replicas is below 5 % in no more than 5 % of cases,
and below 1 % in up to 4 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import stdtr

from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS

Array = npt.NDArray[np.float64]

#: K: replicas for which it counts that the first step is right where scores are normal.
_BEFORE = 2
#: Spread of a score that is taken where no family has two replicas.
_SPREAD = 0.05


@dataclass(frozen=True)
class Null:
    """Scores of each family of candidates in the replicas, (B,) each, NaN where a replica has none."""

    scores: Mapping[str, Array]

    def test(self, family: str, score: float) -> tuple[float, float, float]:
        """Excess over the replicas, evidence in their scatter, and the p-value of a score, for the whole search."""
        own = self.scores.get(family)
        if own is None or not np.isfinite(own).any():
            return score, 0.0, 1.0
        excess, evidence, tail = _compared(own[None], _spread(self._table), np.array([score]))
        return float(excess[0]), float(evidence[0]), self._for_the_search(_surprise(len(self.scores) * float(tail[0])))

    def with_family(self, family: str, scores: Array) -> Null:
        """The same with one more family."""
        return Null({**self.scores, family: scores})

    @cached_property
    def _table(self) -> Array:
        return np.stack([np.asarray(own, dtype=np.float64) for own in self.scores.values()])

    @cached_property
    def surprises(self) -> Array:
        """x_b of every replica (B,), compared with the others."""
        count = self._table.shape[1]
        found = np.zeros(count)
        for b in range(count):
            others = np.delete(self._table, b, axis=1)
            judged = np.isfinite(self._table[:, b]) & np.isfinite(others).any(axis=1)
            if judged.any():
                _, _, tails = _compared(others[judged], _spread(others), self._table[judged, b])
                found[b] = _surprise(len(self.scores) * float(tails.min()))
        return found

    def _for_the_search(self, surprise: float) -> float:
        count = self._table.shape[1]
        total = max(float(np.sum(self.surprises)), float(count)) if count > 1 else float(count)
        by_law = float((1.0 + surprise / (total + _BEFORE)) ** -(count + _BEFORE))
        as_much = int(np.sum(self.surprises >= surprise)) if count > 1 else 0
        return max(by_law, (1 + as_much) / (1 + count)) if as_much else by_law


def _compared(own: Array, spread: float, score: Array) -> tuple[Array, Array, Array]:
    """Excess, evidence and tail probability (F,) of scores (F,) beside those of replicas (F, B)."""
    count = np.sum(np.isfinite(own), axis=1)
    mean = np.nanmean(own, axis=1)
    freedom = count - 1 + THRESHOLDS.shrinkage
    squares = np.nansum((own - mean[:, None]) ** 2, axis=1)
    variance = (squares + THRESHOLDS.shrinkage * spread**2) / freedom
    usual = np.maximum(mean, 0.0)
    deviation = np.sqrt((variance + THRESHOLDS.least_spread**2) * (1.0 + 1.0 / count) + (THRESHOLDS.doubt * usual) ** 2)
    excess = score - mean
    evidence = excess / deviation
    return excess, evidence, stdtr(freedom, -evidence)


def _spread(table: Array) -> float:
    """Rms over families of the standard deviation of a score over replicas."""
    repeated = table[np.sum(np.isfinite(table), axis=1) > 1]
    return float(np.sqrt(np.mean(np.nanvar(repeated, axis=1, ddof=1)))) if len(repeated) else _SPREAD


def _surprise(probability: float) -> float:
    return -float(np.log(np.clip(probability, 1e-300, 1.0)))
