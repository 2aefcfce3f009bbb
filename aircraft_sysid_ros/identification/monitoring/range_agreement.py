"""Does one model hold at small and at large angles of attack, or is it two?

Blocks of BLOCK evaluations of motion keep x x' and x y of an axis, and are parted by their mean angle of attack at
some SHARES of them. Least squares over either part give a and b; the model is one where b - a = d is noise:

    F = (K - n) / (K - 1) d' (V_a + V_b)^-1 d / n,     V = M^-1 (sum g g') M^-1 + p p',     g = sum x (y - x' a)

with g over each cluster of CLUSTER blocks of its part, K of them in the smaller one: what noise there is, of what
colour, the flight shows by itself. p = M^-1 (m v * a) is the pull of noise of variance v in the terms on m samples.
The parts disagree where F is above ``range_surely`` (``thresholds``; about four standard errors in each of n
parameters) and the rms of x' d over all motion is above ``range_effect`` of the spread of the coefficient. A stall, or
whatever else bends, shows so, though the whole error may be near what noise is said to make.

What disagrees are the parameters without which F of the others is at most ``range_alike``. One of the others is spared
where either part says so by itself: with the difference of the rest of them taken as noise, which makes both parts
surer,

    a* = a + V_a C' (C (V_a + V_b) C')^-1 C d,    V_a* = V_a - V_a C' (C (V_a + V_b) C')^-1 C V_a,

and b* alike, both are nearer to what is published than ``range_near`` of it, by ``range_sigma`` of their standard
errors. That two parts do not differ is not enough: what moves too little in one of them to be known there is not
spared.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, MEASURED, SIGNALS_OF_SAMPLE, TERMS_OF_SAMPLE
from aircraft_sysid_ros.identification.monitoring.agreement import solved_sums
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]

#: Evaluations of a block, blocks of a cluster (2 s), blocks that are remembered (ten minutes of motion).
BLOCK, CLUSTER, MOST = 25, 2, 600
#: Where blocks are parted: shares of them with a smaller angle of attack.
SHARES = np.array([0.25, 0.5, 0.75, 0.9])
#: New blocks after which an axis is looked at again.
EVERY = 5
_LEAST, _SPARE, _EFFECT = THRESHOLDS.range_blocks, THRESHOLDS.range_spare, THRESHOLDS.range_effect

_ALPHA = SIGNALS_OF_SAMPLE + SIGNAL_INDEX["alpha"]


@njit(cache=True)
def _add(
    samples: Array, offsets: Integers, asked: Bools, open_sums: Array, open_count: Array, sums: Array, angle: Array,
    count: Integers,
) -> None:  # fmt: skip
    """Samples (m, …) that the axes asked for learnt from, into the open block of each, and that when full into all."""
    row = np.ones(open_sums.shape[1])
    for i in range(len(samples)):
        for axis in range(6):
            alpha = samples[i, _ALPHA]
            if not (asked[axis] and samples[i, LEARNT + axis] > 0.0 and np.isfinite(alpha)):
                continue
            first, n = offsets[axis], offsets[axis + 1] - offsets[axis]
            for j in range(n):
                row[j] = samples[i, TERMS_OF_SAMPLE + first + j]
            row[n], row[n + 1] = samples[i, MEASURED + axis], 1.0
            for j in range(n + 2):
                for k in range(n + 2):
                    open_sums[axis, j, k] += row[j] * row[k]
            open_count[axis, 0] += 1.0
            open_count[axis, 1] += alpha
            if open_count[axis, 0] == BLOCK:
                slot = count[axis] % MOST
                sums[axis, slot], angle[axis, slot] = open_sums[axis], open_count[axis, 1] / BLOCK
                count[axis] += 1
                open_sums[axis], open_count[axis] = 0.0, 0.0


@njit(cache=True)
def _add_sums(block: Array, whole: Array) -> None:
    """Sums of a block, of which those of the axis stand first, to ``whole`` (n + 2, n + 2)."""
    for j in range(len(whole)):
        for k in range(len(whole)):
            whole[j, k] += block[j, k]


@njit(cache=True)
def _add_square(inverse: Array, g: Array, out: Array) -> None:
    """z z' with z = inverse g, to ``out`` (n, n)."""
    z = np.zeros(len(g))
    for j in range(len(g)):
        for k in range(len(g)):
            z[j] += inverse[j, k] * g[k]
    for j in range(len(g)):
        for k in range(len(g)):
            out[j, k] += z[j] * z[k]


@njit(cache=True)
def _add_clusters(sums: Array, rank: Integers, ranks: tuple[int, int], theta: Array, inverse: Array, out: Array) -> int:
    """What the errors of each cluster move ``theta`` (n,) by, squared, to ``out`` (n, n); returns their number."""
    n = len(theta)
    g, clusters, newest = np.zeros(n), 0, -1
    for i in range(len(sums)):
        if not ranks[0] <= rank[i] < ranks[1]:
            continue
        if i // CLUSTER != newest:
            _add_square(inverse, g, out)
            g[:] = 0.0
            newest, clusters = i // CLUSTER, clusters + 1
        for j in range(n):
            g[j] += sums[i, j, n]
            for k in range(n):
                g[j] -= sums[i, j, k] * theta[k]
    _add_square(inverse, g, out)
    return clusters


@njit(cache=True)
def _part(sums: Array, rank: Integers, ranks: tuple[int, int], theta: Array, inverse: Array) -> float:
    """Least squares over the blocks between two ranks into ``theta`` (n,), with the inverse (n, n) of its matrix.

    Returns of how many samples; 0 where it cannot be told.
    """
    n = len(theta)
    whole = np.zeros((n + 2, n + 2))
    for i in range(len(sums)):
        if ranks[0] <= rank[i] < ranks[1]:
            _add_sums(sums[i], whole)
    for j in range(n):
        if not whole[j, j] > 0.0:
            return 0.0
    theta[:], inverse[:], is_regular = solved_sums(whole)
    return whole[n + 1, n + 1] if is_regular else 0.0


@njit(cache=True)
def _spread(
    sums: Array,
    rank: Integers,
    ranks: tuple[int, int],
    noise: Array,
    points: float,
    theta: Array,
    inverse: Array,
    covariance: Array,
) -> int:
    """The covariance (n, n) of what ``_part`` found of so many ``points``; returns how many clusters there are.

    0 where there are too few.
    """
    n = len(theta)
    covariance[:] = 0.0
    clusters = _add_clusters(sums, rank, ranks, theta, inverse, covariance)
    if clusters < n + _SPARE:
        return 0
    covariance *= clusters / (clusters - n)
    _add_square(inverse, points * noise * theta, covariance)
    return clusters


@njit(cache=True)
def _compare(sums: Array, rank: Integers, noise: Array, edge: Integers, theta: Array, covariance: Array) -> Array:
    """F (partings,) of each parting, NaN where it cannot be told or the difference is too small to matter.

    ``sums`` (k, n + 2, n + 2) of blocks, ``rank`` (k,) of their angles. The ranks ``edge`` (partings,) at which it is
    parted, and ``theta`` (partings, 2, n) of the parts with ``covariance`` (partings, 2, n, n) are written.
    """
    count, n = len(rank), len(noise)
    whole, found = np.zeros((n + 2, n + 2)), np.full(len(edge), np.nan)
    for i in range(count):
        _add_sums(sums[i], whole)
    points = max(whole[n + 1, n + 1], 1.0)
    variance = whole[n, n] / points - (whole[n, n + 1] / points) ** 2
    both, inverse = np.zeros((n + 2, n + 2)), np.empty((2, n, n))
    for k in range(len(edge)):
        edge[k] = int(SHARES[k] * count)
        if edge[k] < _LEAST or count - edge[k] < _LEAST:
            continue
        low, high = (0, edge[k]), (edge[k], count)
        of_low = _part(sums, rank, low, theta[k, 0], inverse[0])
        of_high = _part(sums, rank, high, theta[k, 1], inverse[1])
        d, moved = theta[k, 1] - theta[k, 0], 0.0  # mean square of x' d
        for i in range(n):
            for j in range(n):
                moved += d[i] * whole[i, j] / points * d[j]
        if min(of_low, of_high) == 0.0 or not moved > _EFFECT**2 * variance:
            continue
        clusters = min(
            _spread(sums, rank, low, noise, of_low, theta[k, 0], inverse[0], covariance[k, 0]),
            _spread(sums, rank, high, noise, of_high, theta[k, 1], inverse[1], covariance[k, 1]),
        )
        if clusters == 0:
            continue
        both[:n, :n], both[:n, n] = covariance[k, 0] + covariance[k, 1], d
        solution, _, is_regular = solved_sums(both)
        if is_regular:
            found[k] = 0.0
            for i in range(n):
                found[k] += d[i] * solution[i] / n * (clusters - n) / (clusters - 1.0)
    return found


def _f(d: Array, covariance: Array, chosen: list[int]) -> float:
    """F of some parameters of a difference (n,), in the limit of many clusters."""
    part = np.ix_(chosen, chosen)
    return float(d[chosen] @ np.linalg.solve(covariance[part], d[chosen])) / max(len(chosen), 1)


def agreeing(theta: Array, covariance: Array) -> list[int]:
    """Of the parameters (2, n) of two parts, with covariance (2, n, n), the most of which F is at most ``range_alike``.

    One after the other is left out, that which carries most of the rest of the difference.
    """
    d, both = theta[1] - theta[0], covariance.sum(axis=0)
    chosen = list(range(len(d)))
    while chosen and _f(d, both, chosen) > THRESHOLDS.range_alike:
        chosen.remove(min(chosen, key=lambda j: len(chosen) * _f(d, both, [i for i in chosen if i != j])))
    return chosen


def said_by_either(theta: Array, covariance: Array) -> Array:
    """Least and largest value (2, n) of each parameter by two parts, some standard errors (``range_sigma``) from it;
    infinite of what disagrees.
    """
    d, both, chosen = theta[1] - theta[0], covariance.sum(axis=0), agreeing(theta, covariance)
    out = np.outer([-np.inf, np.inf], np.ones(len(d)))
    for j in chosen:
        rest = [i for i in chosen if i != j]
        gain = np.linalg.solve(both[np.ix_(rest, rest)], np.eye(len(rest)))
        shift = covariance[:, j, rest] @ gain  # (2, rest)
        value = theta[:, j] + np.array([1.0, -1.0]) * (shift @ d[rest])
        std = np.sqrt(np.maximum(covariance[:, j, j] - np.sum(shift * covariance[:, j, rest], axis=1), 0.0))
        out[:, j] = np.min(value - THRESHOLDS.range_sigma * std), np.max(value + THRESHOLDS.range_sigma * std)
    return out


class RangeAgreement:
    """Follows the blocks of all axes, and says which model holds in a part of the angles of attack only."""

    def __init__(self, model: AerodynamicModel) -> None:
        self._model = model
        most = 2 + int(np.diff(model.offsets).max())
        axes = len(AXES)
        self._open, self._open_count = np.zeros((axes, most, most)), np.zeros((axes, 2))
        self._sums, self._angle = np.zeros((axes, MOST, most, most)), np.zeros((axes, MOST))
        self._count, self._seen = np.zeros(axes, np.int64), np.zeros(axes, np.int64)
        self._words = [""] * axes
        self._range = [np.zeros((2, 0))] * axes  # of the values that the parts of an axis allow, where they disagree

    def forget(self, axis: int) -> None:
        """Start an axis over."""
        self._open[axis], self._open_count[axis] = 0.0, 0.0
        self._count[axis] = self._seen[axis] = 0
        self._words[axis] = ""

    def add(self, asked: Bools, samples: Array) -> None:
        """New samples (m, …) for the axes (6,) that are asked; those that an axis learnt from count."""
        blocks = self._sums, self._angle, self._count
        _add(samples, self._model.offsets, asked, self._open, self._open_count, *blocks)

    def disagreement(self, axis: int, noise: Array) -> str:
        """What to say of an axis whose model is not one; ``noise`` (n,) is the variance of the noise in each term."""
        if self._count[axis] >= self._seen[axis] + EVERY:
            self._seen[axis] = self._count[axis]
            self._words[axis] = self._judge(axis, noise)
        return self._words[axis]

    def warm_up(self) -> None:
        """Compile, or load from the cache, what is first needed after a minute."""
        for axis, name in enumerate(AXES):
            self._judge(axis, np.zeros(len(self._model.terms[name])))

    def spared(self, axis: int, values: Array) -> Bools:
        """Of an axis whose model is not one, which of the values (n,) that are published hold in either part."""
        low, high = self._range[axis]
        return np.asarray(np.maximum(values - low, high - values) < THRESHOLDS.range_near * np.abs(values))

    def _judge(self, axis: int, noise: Array) -> str:
        size, n = min(int(self._count[axis]), MOST), len(noise)
        order = np.argsort(self._angle[axis, :size], kind="stable")
        rank = np.empty(size, np.int64)
        rank[order] = np.arange(size)
        partings = len(SHARES)
        edge, theta, covariance = (
            np.zeros(partings, np.int64),
            np.zeros((partings, 2, n)),
            np.zeros((partings, 2, n, n)),
        )
        f = np.nan_to_num(_compare(self._sums[axis, :size], rank, noise, edge, theta, covariance))
        if not (f > THRESHOLDS.range_surely).any():
            return ""
        ranges = [said_by_either(theta[k], covariance[k]) for k in np.flatnonzero(f > THRESHOLDS.range_surely)]
        self._range[axis] = np.array([np.min(ranges, axis=0)[0], np.max(ranges, axis=0)[1]])
        best = int(np.argmax(f))
        low, high = theta[best]
        angle = np.degrees(self._angle[axis, order[edge[best] - 1 : edge[best] + 1]].mean())
        name = AXES[axis]
        terms = self._model.parameter_names[self._model.axis_slice(name)]
        rms = np.sqrt(np.einsum("kii->i", self._sums[axis, :size])[:n])
        j = int(np.argmax(np.abs(high - low) * rms * (self._model.constants[axis] == 0.0)))
        values = f"{terms[j]} is {low[j]:.3g}, above it {high[j]:.3g}"
        return f"no single model fits {name}: below an angle of attack of {angle:.1f}° {values}"
