"""Do two estimators agree? Another learner with recursive least squares, and that with itself: now with before.

Estimates a and b of one parameter, of which each says its standard error, disagree where

    |a - b| > disagree_sigma sqrt(s_a^2 + s_b^2),    |a - b| > disagree_share |a|,    and |a - b| moves the coefficient
    by more than a share disagree_effect of its spread (``thresholds``):

surely, and by a size that matters. Correlated errors make the true difference smaller than the first says.

Recursive least squares is compared with itself on disjoint data: least squares over the newest motion, and over all
before it, which fades as in the recursion. With M = sum x x' of either, and s the published standard error,

    s_a^2 = s^2 (M_a^-1)_jj / ((M_a + M_b)^-1)_jj + [M_a^-1 (n_a v * theta_a)]_j^2,

with what coloured residuals do to the whole, and with the pull that noise of variance v in the terms has on that part
of the data alone: where a part hardly moves, that is most. It sees what came or went: a change, a poisoned stretch, a
model that holds in one part of the flight only. It is blind to what both parts share: a scale, a delay, a constant
bias. Constants are left out: they follow the accelerometer bias while it is being found.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.estimation.iterated_ekf import cholesky
from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, MEASURED, TERMS_OF_SAMPLE
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import are_far, disagree
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]

#: Evaluations of a block of motion, and blocks of the newest part.
BLOCK, NEWEST = 125, 3


@njit(cache=True)
def _add_products(samples: Array, offsets: Integers, asked: Bools, sums: Array, counts: Array) -> None:
    """Sum of (x, y, 1)(x, y, 1)' over the samples (m, …) that each axis learnt from, into ``sums`` (6, n + 2, n + 2).

    n is that of the axis with the most terms; ``counts`` (6,) of samples.
    """
    row = np.ones(sums.shape[1])
    for axis in range(6):
        first, n = offsets[axis], offsets[axis + 1] - offsets[axis]
        for i in range(len(samples) if asked[axis] else 0):
            if samples[i, LEARNT + axis] > 0.0:
                for j in range(n):
                    row[j] = samples[i, TERMS_OF_SAMPLE + first + j]
                row[n], row[n + 1] = samples[i, MEASURED + axis], 1.0
                counts[axis] += 1.0
                for j in range(n + 2):
                    for k in range(n + 2):
                        sums[axis, j, k] += row[j] * row[k]


class SplitHalfAgreement:
    """Least squares over the newest motion of each axis, and over what was before it."""

    def __init__(self, model: AerodynamicModel, forgetting: float) -> None:
        """``forgetting`` per evaluation."""
        self._model = model
        self.forget_at(forgetting)
        self._blocks: list[deque[Array]] = [deque() for _ in AXES]
        most = 2 + int(np.diff(model.offsets).max())
        self._open, self._count = np.zeros((len(AXES), most, most)), np.zeros(len(AXES))  # the block that is filled
        self._before = [self._nothing(axis) for axis in range(len(AXES))]
        self._parts: list[_Parts | None] = [None] * len(AXES)
        self._moving = [constants == 0.0 for constants in model.constants]

    def _nothing(self, axis: int) -> Array:
        n = len(self._model.terms[AXES[axis]])
        return np.zeros((n + 2, n + 2))

    def forget_at(self, forgetting: float) -> None:
        """Forget at another rate, per evaluation, from now on."""
        self._fade = forgetting**BLOCK

    def forget(self, axis: int) -> None:
        """Start an axis over."""
        self._blocks[axis].clear()
        self._open[axis], self._count[axis], self._before[axis] = 0.0, 0.0, self._nothing(axis)
        self._parts[axis] = None

    def add(self, asked: Bools, samples: Array) -> None:
        """New samples (m, …) for the axes (6,) that are asked; those that an axis learnt from count."""
        _add_products(samples, self._model.offsets, asked, self._open, self._count)
        if (self._count >= BLOCK).any():
            for axis in np.flatnonzero(asked & (self._count >= BLOCK)).tolist():
                self._close_block(axis)

    def _close_block(self, axis: int) -> None:
        blocks, size = self._blocks[axis], len(self._before[axis])
        blocks.append(self._open[axis, :size, :size].copy())
        self._open[axis], self._count[axis] = 0.0, 0.0
        if len(blocks) > NEWEST:
            self._before[axis] = self._fade * self._before[axis] + blocks.popleft()
        enough = len(blocks) == NEWEST and self._before[axis][-1, -1] >= THRESHOLDS.disagree_blocks * BLOCK
        self._parts[axis] = parts_of(np.sum(blocks, axis=0), self._before[axis]) if enough else None

    def are_apart(self, axis: int) -> bool:
        """Whether now and before could disagree on the axis, whatever the standard errors."""
        parts = self._parts[axis]
        return parts is not None and bool(parts.far[self._moving[axis]].any())

    def disagreeing(self, axis: int, std: Array, noise: Array) -> dict[int, tuple[float, float]]:
        """Terms of the axis on which now and before disagree, with both values.

        ``std`` (n,) is what is published, ``noise`` (n,) the variance of the noise in each term.
        """
        parts = self._parts[axis]
        if parts is None:
            return {}
        per_unit = std / np.sqrt(np.diag(parts.inverse))
        std_now, std_before = (
            np.hypot(per_unit * np.sqrt(np.diag(half.inverse)), half.inverse @ (half.points * noise * half.theta))
            for half in (parts.now, parts.before)
        )
        a, b = parts.now.theta, parts.before.theta
        apart = disagree(a, b, std_now, std_before, parts.effect) & self._moving[axis]
        return {j: (float(a[j]), float(b[j])) for j in np.flatnonzero(apart).tolist()}


class _Half(NamedTuple):
    theta: Array  # (n,)
    inverse: Array  # (n, n)
    points: float  # their number, faded


class _Parts(NamedTuple):
    """What two disjoint parts of the motion say of one axis."""

    now: _Half
    before: _Half
    inverse: Array  # (n, n) of both together
    effect: Array  # (n,) of one unit, over the spread of the coefficient
    far: npt.NDArray[np.bool_]  # (n,) differ by a size that matters


def parts_of(now: Array, before: Array) -> _Parts | None:
    """From sums (n + 2, n + 2) of either part; None where terms are collinear."""
    both, n = now + before, len(now) - 2
    solutions = [solved(sums) for sums in (now, before, both)]
    if any(solution is None for solution in solutions):
        return None
    (a, pa), (b, pb), (_, p) = (solution for solution in solutions if solution is not None)
    mean = both / both[-1, -1]
    spread = np.sqrt(max(mean[n, n] - mean[n, n + 1] ** 2, 1e-300))
    halves = _Half(a, pa, float(now[-1, -1])), _Half(b, pb, float(before[-1, -1]))
    effect = np.sqrt(np.diag(mean)[:n]) / spread
    return _Parts(*halves, p, effect, are_far(a, b, effect))


def solved(sums: Array) -> tuple[Array, Array] | None:
    """Least squares (n,) and the inverse (n, n) from sums (n + 2, n + 2); None where terms are collinear."""
    theta, inverse, is_regular = solved_sums(sums)
    return (theta, inverse) if is_regular else None


@njit(cache=True, error_model="numpy")
def solved_sums(sums: Array) -> tuple[Array, Array, bool]:
    """``solved``, and whether it could be: by the factor of the matrix of correlations."""
    n = len(sums) - 2
    scale, correlation = np.empty(n), np.empty((n, n))
    for i in range(n):
        scale[i] = np.sqrt(sums[i, i])
    for i in range(n):
        for j in range(n):
            correlation[i, j] = sums[i, j] / (scale[i] * scale[j])
    factor = cholesky(correlation)
    half, theta, inverse, y = np.zeros((n, n)), np.zeros(n), np.zeros((n, n)), np.zeros(n)
    for j in range(n):  # the inverse of the factor, with its columns scaled
        half[j, j] = 1.0 / scale[j] / factor[j, j]
        for i in range(j + 1, n):
            s = 0.0
            for k in range(j, i):
                s -= factor[i, k] * half[k, j]
            half[i, j] = s / factor[i, i]
    for k in range(n):
        for j in range(k + 1):
            y[k] += half[k, j] * sums[j, n]
        for i in range(k + 1):
            theta[i] += half[k, i] * y[k]
            for j in range(k + 1):
                inverse[i, j] += half[k, i] * half[k, j]
    return theta, inverse, bool(np.isfinite(factor[n - 1, n - 1])) if n else True
