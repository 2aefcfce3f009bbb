"""Recursive maximum likelihood, (5.8) and (5.10)-(5.13) of docs/references.md, on plain arrays.

A filter that depends on theta (q,) gives the innovation e (m,), its covariance L (m, m) and their derivatives.
One innovation adds to the cost (5.7) a gradient (5.10) and a Fisher information (5.11)

    g_i  = d_i e' L^-1 e + 1/2 (eta_i - mu_i),     eta_i = tr(L^-1 d_i L),    mu_i = e' L^-1 d_i L L^-1 e
    F_ij = d_i e' L^-1 d_j e + 1/2 tr(L^-1 d_i L L^-1 d_j L)

(5.11) as printed has 1/2 eta_i eta_j for the last term, which equals it for one output only. With L = C C',
whitened e = C^-1 e, E_i = C^-1 d_i e and S_i = C^-1 d_i L C^-T, both are a linear regression with unit noise,

    g = W' rho,    F = W' W,    rows of (W, rho):  (E_i[a], e[a]),  (S_i[a, b] c_ab, (delta_ab - e[a] e[b]) c_ab)

with c_aa = 1/sqrt(2) and c_ab = 1 for a < b. The Gauss-Newton step (5.8) for the data so far is then recursive
least squares (4.12)-(4.14) on these rows: the gradient of the earlier data is zero where they left theta. The
covariance P = R R' is carried as its root R (Potter), so that it stays positive and symmetric over any number of
steps, and no matrix is inverted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.iterated_ekf import cholesky
from aircraft_sysid_ros.estimation.lagged_moments import add_sample
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

#: r = w' P w of a row that says nothing.
_NO_INFORMATION = 1e-300
#: A row with less than this share of the r at which forgetting settles does not make P grow.
_LEAST_SHARE = 0.1
#: Share of all information that is taken as it is when that of the scores is widened: holds what they do not see.
_HELD_SHARE = 0.01


class Scores(NamedTuple):
    """Sums from which the covariance is corrected for coloured innovations; see ``widening``."""

    block: Array  # (q,) gradient of the block of samples that is being filled
    lagged: Array  # (lags, q, q) sums of block(k) block(k - l)'
    recent: Array  # (lags, q) newest blocks, newest first, NaN before the first and after a break
    information: Array  # (q, q) sum of W' W over the same samples


def new_scores(size: int, lags: int) -> Scores:
    """Empty sums for ``size`` parameters and blocks that are correlated over fewer than ``lags`` of them."""
    return Scores(np.zeros(size), np.zeros((lags, size, size)), np.full((lags, size), np.nan), np.zeros((size, size)))


@njit(cache=True)
def _forward(factor: Array, b: Array) -> Array:
    """C^-1 b for lower triangular C (m, m) and b (m, k)."""
    m = factor.shape[0]
    x = b.copy()
    for i in range(m):
        for k in range(i):
            x[i] -= factor[i, k] * x[k]
        x[i] /= factor[i, i]
    return x


@njit(cache=True)
def innovation_rows(
    innovation: Array, covariance: Array, d_innovation: Array, d_covariance: Array
) -> tuple[Array, Array]:
    """Rows W (m + m (m + 1) / 2, q) and residuals rho of one innovation, so that g = W' rho and F = W' W.

    innovation (m,), covariance (m, m) positive definite, d_innovation (q, m), d_covariance (q, m, m) symmetric
    in its last two axes. A covariance that is not positive definite gives NaN, which teaches nothing.
    """
    m, q = len(innovation), len(d_innovation)
    factor = cholesky(covariance)
    count = m + m * (m + 1) // 2
    rows, residuals = np.empty((count, q)), np.empty(count)
    if not np.all(np.isfinite(np.diag(factor))):
        rows[:], residuals[:] = np.nan, np.nan
        return rows, residuals
    white = _forward(factor, innovation.reshape(m, 1))[:, 0]
    residuals[:m] = white
    rows[:m] = _forward(factor, np.ascontiguousarray(d_innovation.T))
    for i in range(q):
        half = _forward(factor, np.ascontiguousarray(d_covariance[i]))
        s = _forward(factor, np.ascontiguousarray(half.T))
        at = m
        for a in range(m):
            rows[at, i] = s[a, a] / np.sqrt(2.0)
            at += 1
            for b in range(a + 1, m):
                rows[at, i] = s[a, b]
                at += 1
    at = m
    for a in range(m):
        residuals[at] = (1.0 - white[a] ** 2) / np.sqrt(2.0)
        at += 1
        for b in range(a + 1, m):
            residuals[at] = -white[a] * white[b]
            at += 1
    return rows, residuals


@njit(cache=True)
def scalar_innovation_rows(
    innovation: float, variance: float, d_innovation: Array, d_variance: Array, rows: Array, residuals: Array
) -> None:
    """The same for one output, into rows (2, q) and residuals (2,), without a factorisation.

    A filter that takes its outputs one after the other has scalar innovations that are independent of each
    other. Their rows stacked give the gradient of the whole measurement, and its information on average.
    A variance that is not positive gives NaN, which teaches nothing.
    """
    if not variance > 0.0:
        rows[:], residuals[:] = np.nan, np.nan
        return
    sigma = np.sqrt(variance)
    residuals[0] = innovation / sigma
    residuals[1] = (1.0 - residuals[0] ** 2) / np.sqrt(2.0)
    for i in range(len(d_innovation)):
        rows[0, i] = d_innovation[i] / sigma
        rows[1, i] = d_variance[i] / (np.sqrt(2.0) * variance)


@njit(cache=True)
def _take_row(step: Array, root: Array, row: Array, residual: float, forgetting: float, direction: Array) -> None:
    """Recursive least squares with one row on step (q,) and root (q, q), in place; ``direction`` (q,) is scratch."""
    q = len(step)
    error = residual
    direction[:] = 0.0
    for i in range(q):
        if row[i] != 0.0:
            error += row[i] * step[i]
            for j in range(q):
                direction[j] += root[i, j] * row[i]
    r = 0.0
    for j in range(q):
        r += direction[j] * direction[j]
    if not (r > _NO_INFORMATION and np.isfinite(r) and np.isfinite(error)):
        return
    left = forgetting * (1.0 + r)
    if r < _LEAST_SHARE * (1.0 / forgetting - 1.0):
        left = max(left, 1.0)
    shrink = (1.0 / np.sqrt(left) - 1.0) / r
    for i in range(q):
        pw = 0.0
        for j in range(q):
            pw += root[i, j] * direction[j]
        step[i] -= pw * error / (1.0 + r)
        for j in range(q):
            root[i, j] += shrink * pw * direction[j]


@njit(cache=True)
def learn_rows(
    theta: Array, root: Array, rows: Array, residuals: Array, forgetting: float, largest_step: Array
) -> None:
    """One Gauss-Newton step (5.8) with the rows of one innovation, in place.

    theta (q,), root (q, q) with covariance P = root root', rows (k, q), residuals (k,), 0 < forgetting <= 1 per
    row, largest_step (q,): no parameter moves by more, so that one that is far off does not hold up the others.
    Far from the optimum the linearisation does not reach as far as the step; near it the bound is not met.

    Forgetting is directional and bounded: only along the row is anything forgotten. With r = w' P w a row leaves
    r / (forgetting (1 + r)), so that r settles at r0 = 1 / forgetting - 1; a row with less than a tenth of r0, such
    as what noise leaves of a motion that has ended, takes away what it brings at most. So what is not excited
    keeps its value and its variance. A row that is not finite, or zero, changes nothing.
    """
    q = len(theta)
    step, direction = np.zeros(q), np.empty(q)
    for k in range(len(rows)):
        _take_row(step, root, rows[k], residuals[k], forgetting, direction)
    for i in range(q):
        theta[i] += min(max(step[i], -largest_step[i]), largest_step[i])


@njit(cache=True)
def add_score(scores: Scores, rows: Array, residuals: Array) -> None:
    """Add the gradient and information of one innovation to the block, in place; what is not finite is left out."""
    q = rows.shape[1]
    for k in range(len(rows)):
        usable = np.isfinite(residuals[k])
        for i in range(q):
            usable = usable and np.isfinite(rows[k, i])
        if not usable:
            continue
        for i in range(q):
            w = rows[k, i]
            if w != 0.0:
                scores.block[i] += w * residuals[k]
                for j in range(i + 1):
                    scores.information[i, j] += w * rows[k, j]


@njit(cache=True)
def close_block(scores: Scores, forgetting: float) -> None:
    """End a block of samples: its gradient goes into the lagged sums. ``forgetting`` is per block.

    Scores of the early phase, when theta was far off, are larger than those that follow: a forgetting of less
    than one takes them out of the standard errors. After a break in the data set ``scores.recent`` to NaN.
    """
    add_sample(scores.lagged, scores.recent, scores.block, forgetting)
    scores.information[:] *= forgetting
    scores.block[:] = 0.0


def widening(root: Array, scores: Scores) -> Array:
    """How many times the standard errors of P = root root' coloured innovations make larger, (q,), at least 1.

    For white Gaussian innovations the scores have the covariance F and are uncorrelated. Else that of theta is
    the sandwich F^-1 M F^-1 with their long-run covariance M, here of blocks with Bartlett's weights, which are
    positive (Newey and West 1987). The result is the root of the ratio of its diagonal to that of F^-1, in
    coordinates in which P is the identity, with a part of P^-1 added to both F and M: a parameter that the
    scores do not see keeps its standard error.
    """
    lags, q = scores.lagged.shape[0], len(root)
    middle = np.zeros((q, q))
    for lag in range(lags):
        weight = (1.0 - lag / lags) * (0.5 if lag == 0 else 1.0)
        middle += weight * (scores.lagged[lag] + scores.lagged[lag].T)
    information = np.tril(scores.information) + np.tril(scores.information, -1).T
    held = _HELD_SHARE * np.eye(q)
    middle = root.T @ middle @ root + held
    factor = np.linalg.cholesky(root.T @ information @ root + held)
    half = np.linalg.solve(factor, root.T)  # columns: white covariance is half' half
    bread = np.linalg.solve(factor.T, half)
    white = np.sum(half**2, axis=0)
    coloured = np.sum(bread * (middle @ bread), axis=0)
    return np.asarray(np.sqrt(np.maximum(coloured / white, 1.0)))


def coloured_covariance(root: Array, scores: Scores) -> Array:
    """Covariance (q, q) of theta, P = root root' with its standard errors widened for coloured innovations."""
    scaled = widening(root, scores)[:, None] * root
    return np.asarray(scaled @ scaled.T)
