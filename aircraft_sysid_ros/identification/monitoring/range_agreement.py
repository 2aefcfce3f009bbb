"""Does one model hold at small and at large angles of attack, or is it two?

Blocks of BLOCK evaluations of motion keep x x' and x y of an axis, and are parted by their mean angle of attack at
some SHARES of them. Least squares over either part give a and b; the model is one where b - a = d is noise:

    F = (K - n) / (K - 1) d' (V_a + V_b)^-1 d / n,     V = M^-1 (sum g g') M^-1 + p p',     g = sum x (y - x' a)

with g over each cluster of CLUSTER blocks of its part, K of them in the smaller one: what noise there is, of what
colour, the flight shows by itself. p = M^-1 (m v * a) is the pull of noise of variance v in the terms on m samples.
The parts disagree where F > SURE (about four standard errors in each of n parameters) and the rms of x' d over all
motion is above LARGE times the spread of the coefficient. A stall, or whatever else bends, shows so, though the whole
error may be near what noise is said to make.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.expression import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, MEASURED, SIGNALS_OF_SAMPLE, TERMS_OF_SAMPLE
from aircraft_sysid_ros.identification.monitoring.agreement import solved_sums

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]

#: Evaluations of a block, blocks of a cluster (2 s), blocks that are remembered (ten minutes of motion), and the least
#: number of them in either part.
BLOCK, CLUSTER, MOST, LEAST = 25, 2, 600, 20
#: Where blocks are parted: shares of them with a smaller angle of attack.
SHARES = np.array([0.25, 0.5, 0.75, 0.9])
#: With right models F was at most 9 where the difference is LARGE, at any time of 35 flights; in eleven axes of nine
#: flights through stalls it was 24 to 386 (benchmarks/stalls.py, flights of another maker).
SURE, LARGE = 16.0, 0.1
#: New blocks after which an axis is looked at again.
EVERY = 5
#: Clusters of a part beyond the number of terms.
_SPARE = 4

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
def _part(sums: Array, rank: Integers, ranks: tuple[int, int], noise: Array, theta: Array, covariance: Array) -> int:
    """Least squares over the blocks between two ranks into ``theta`` (n,), with its covariance (n, n).

    Returns how many clusters there are; 0 where it cannot be told.
    """
    n = len(theta)
    whole = np.zeros((n + 2, n + 2))
    for i in range(len(sums)):
        if ranks[0] <= rank[i] < ranks[1]:
            whole += sums[i, : n + 2, : n + 2]
    for j in range(n):
        if not whole[j, j] > 0.0:
            return 0
    found, inverse, is_regular = solved_sums(whole)
    if not is_regular:
        return 0
    theta[:] = found
    covariance[:] = 0.0
    clusters = _add_clusters(sums, rank, ranks, theta, inverse, covariance)
    if clusters < n + _SPARE:
        return 0
    covariance *= clusters / (clusters - n)
    _add_square(inverse, whole[n + 1, n + 1] * noise * theta, covariance)
    return clusters


@njit(cache=True)
def _compare(sums: Array, rank: Integers, noise: Array, low: Array, high: Array) -> tuple[float, int]:
    """The largest F of a parting with a LARGE difference, and the rank at which it is parted; 0 where there is none.

    ``sums`` (k, n + 2, n + 2) of blocks, ``rank`` (k,) of their angles; parameters of the parts go to ``low`` and
    ``high`` (n,).
    """
    count, n = len(rank), len(noise)
    whole = np.zeros((n + 2, n + 2))
    for i in range(count):
        whole += sums[i, : n + 2, : n + 2]
    points = max(whole[n + 1, n + 1], 1.0)
    variance = whole[n, n] / points - (whole[n, n + 1] / points) ** 2
    a, b, of_a, of_b = np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    best, where, both = 0.0, 0, np.zeros((n + 2, n + 2))
    for share in SHARES:
        edge = int(share * count)
        if edge < LEAST or count - edge < LEAST:
            continue
        clusters = _part(sums, rank, (0, edge), noise, a, of_a)
        clusters = min(clusters, _part(sums, rank, (edge, count), noise, b, of_b))
        if clusters == 0:
            continue
        moved = 0.0  # mean square of x' d
        for i in range(n):
            both[i, n] = b[i] - a[i]
            for j in range(n):
                both[i, j] = of_a[i, j] + of_b[i, j]
                moved += (b[i] - a[i]) * whole[i, j] / points * (b[j] - a[j])
        if not moved > LARGE**2 * variance:
            continue
        solution, _, is_regular = solved_sums(both)
        f = 0.0
        for i in range(n if is_regular else 0):
            f += both[i, n] * solution[i] / n * (clusters - n) / (clusters - 1.0)
        if f > best:
            best, where = f, edge
            low[:], high[:] = a, b
    return best, where


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

    def forget(self, axis: int) -> None:
        """Begin an axis anew."""
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

    def _judge(self, axis: int, noise: Array) -> str:
        size = min(int(self._count[axis]), MOST)
        low, high = np.zeros((2, len(noise)))
        order = np.argsort(self._angle[axis, :size], kind="stable")
        rank = np.empty(size, np.int64)
        rank[order] = np.arange(size)
        f, edge = _compare(self._sums[axis, :size], rank, noise, low, high)
        if not f > SURE:
            return ""
        angle = np.degrees(self._angle[axis, order[edge - 1 : edge + 1]].mean())
        name = AXES[axis]
        terms = self._model.parameter_names[self._model.axis_slice(name)]
        rms = np.sqrt(np.einsum("kii->i", self._sums[axis, :size])[: len(noise)])
        j = int(np.argmax(np.abs(high - low) * rms * (self._model.constants[axis] == 0.0)))
        values = f"{terms[j]} is {low[j]:.3g}, above it {high[j]:.3g}"
        return f"not one model of {name}: below an angle of attack of {angle:.1f}° {values}"
