"""Weighted least squares, linear and nonlinear: (4.1)-(4.8) of docs/references.md, by orthogonal factors.

Model: ``y(k) = H(k) p + e(k)`` or ``y(k) = f(k, p) + e(k)``, cost (4.5) ``1/2 sum z(k)' W(k)^-1 z(k)``. The rows
are divided by the root of W(k), the columns by their norm, and what is left is factored, never squared: the
normal equations (4.6) would lose twice the digits. Which parameters the data determine follows from the singular
values of the triangular factor: a parameter is determined if no direction that leaves all predictions as they
are moves it.

(4.7) is the covariance for white errors of covariance W. Residuals in flight are correlated: from their
autocovariance R_e(l) follows, for whitened rows h(k) (Morelli and Klein, J. Guidance 20(1), 1997),

    (sum h'h)^-1  [ sum_l w_l sum_k h(k)' R_e(l) h(k - l) ]  (sum h'h)^-1

with the lag window w_l of Parzen, whose spectrum is positive, so that the covariance is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Singular values below this share of the largest are zero: what is left of them is rounding.
_RANK_TOLERANCE = 1e-11
#: A parameter that an undetermined direction moves by more than this (of a unit direction) is not determined.
_MOVED = 1e-6
_MOST_HALVINGS = 30


class Solution(NamedTuple):
    """Least-squares solution of a factored problem with unit noise."""

    estimate: Array  # (n,) of minimum norm in scaled columns where not determined
    inverse: Array  # (n, n), the pseudo-inverse of R'R that belongs to it
    determined: npt.NDArray[np.bool_]  # (n,)
    rank: int

    @property
    def covariance(self) -> Array:
        """(4.7), shape (n, n); rows and columns of what is not determined are NaN."""
        return self.masked(self.inverse)

    def masked(self, covariance: Array) -> Array:
        """A covariance (n, n) with NaN for what is not determined."""
        both = np.outer(self.determined, self.determined)
        return np.where(both, 0.5 * (covariance + covariance.T), np.nan)


class LinearFit(NamedTuple):
    """Result of ``weighted_least_squares``."""

    estimate: Array  # (n,) of minimum norm in scaled columns where not determined
    determined: npt.NDArray[np.bool_]  # (n,)
    covariance: Array  # (n, n), (4.7): right if the errors are white and W is their covariance
    coloured_covariance: Array  # (n, n) from the residuals as they are
    variance: float  # of the whitened residuals: 1 if W is right, NaN without degrees of freedom
    residuals: Array  # (k, m), m = 1 for scalar y: y - H p, not whitened; NaN where a sample was not complete


class NonlinearFit(NamedTuple):
    """Result of ``iterated_least_squares``."""

    linear: LinearFit  # at the last iterate; its estimate is the last step delta p
    estimate: Array  # (n,)
    converged: bool
    reason: str
    iterations: int
    costs: Array  # (iterations + 1,) of (4.5), falling


def solve_factor(root: Array, right: Array) -> Solution:
    """min ``|root p - right|``: root (m, n) with any rank, right (m,).

    A column of zeros, or one that others explain, is not determined; the rest holds without it.
    """
    scale = np.sqrt(np.einsum("ij,ij->j", root, root))
    scale[~(scale > 0.0)] = 1.0
    u, s, vt = np.linalg.svd(root / scale, full_matrices=root.shape[0] < root.shape[1])
    n = root.shape[1]
    rank = int(np.sum(s > _RANK_TOLERANCE * max(s[0], 1e-300))) if len(s) and s[0] > 0.0 else 0
    estimate = vt[:rank].T @ ((u[:, :rank].T @ right) / s[:rank]) / scale
    free = np.sqrt(np.einsum("ij,ij->j", vt[rank:], vt[rank:])) if rank < n else np.zeros(n)
    determined = free < _MOVED
    half = vt[:rank].T / s[:rank] / scale[:, None]
    return Solution(estimate, half @ half.T, determined, rank)


def whitened(rows: Array, values: Array, w: Array | None) -> tuple[Array, Array, int]:
    """Rows (k, m, n) and values (k, m) divided by the root of W: None, variances (k,) or (k, m), or (k, m, m).

    Samples that are not finite become zeros: they say nothing; the number of the others is returned too. Raises
    ValueError where W is not positive.
    """
    usable = np.all(np.isfinite(values), axis=1) & np.all(np.isfinite(rows), axis=(1, 2))
    rows, values = np.where(usable[:, None, None], rows, 0.0), np.where(usable[:, None], values, 0.0)
    if w is None:
        return rows, values, int(usable.sum())
    w = np.asarray(w, dtype=np.float64)
    if w.ndim < 3:
        w = np.broadcast_to(w.reshape(len(values), -1), values.shape)
        if not np.all(w > 0.0):
            raise ValueError("the weights W must be positive")
        return rows / np.sqrt(w)[:, :, None], values / np.sqrt(w), int(usable.sum())
    try:
        lower = np.linalg.cholesky(w)
    except np.linalg.LinAlgError:
        raise ValueError("every matrix W must be symmetric and positive definite") from None
    values = np.linalg.solve(lower, values[:, :, None])[:, :, 0]
    return np.linalg.solve(lower, rows), values, int(usable.sum())


def weighted_least_squares(rows: Array, values: Array, w: Array | None = None, *, lags: int = 1) -> LinearFit:
    """p that minimises (4.5) for y(k) = H(k) p + e(k), by QR: (4.6), with (4.7) and its coloured form.

    rows: H, (k, n) for scalar y or (k, m, n); values: y, (k,) or (k, m), in order of time; w: W, None for unit
    weights, variances (k,) or (k, m), or matrices (k, m, m). Residuals may be correlated over fewer than
    ``lags`` samples: 1 for white ones. Raises ValueError for shapes that do not fit or W that is not positive.
    """
    rows, values = _blocks(rows, values)
    h, z, usable = whitened(rows, values, w)
    n = rows.shape[2]
    stacked = np.concatenate([h, z[:, :, None]], axis=2).reshape(-1, n + 1)
    root = np.asarray(np.linalg.qr(stacked, mode="r"))
    solution = solve_factor(root[:, :n], root[:, n])
    white_residuals = z - h @ solution.estimate
    freedom = usable * values.shape[1] - solution.rank
    variance = float(np.sum(white_residuals**2) / freedom) if freedom > 0 else np.nan
    coloured = coloured_sandwich(h, white_residuals, solution, lags, usable * values.shape[1])
    residuals = values - rows @ solution.estimate
    return LinearFit(solution.estimate, solution.determined, solution.covariance, coloured, variance, residuals)


def coloured_sandwich(h: Array, residuals: Array, solution: Solution, lags: int, count: int) -> Array:
    """Covariance (n, n) of the estimate from whitened rows (k, m, n) and their residuals (k, m); see above.

    ``count`` are the numbers in all complete samples. Undetermined parameters, and all without degrees of freedom,
    are NaN. It stays positive: with the biased autocovariance of residuals and Parzen's window the middle is a sum
    of positive spectra. What the fit took from the residuals is put back by the number of independent ones among
    them, count / sum_l w_l R_e(l) / R_e(0).
    """
    k, m, n = h.shape
    middle, correlated, power = np.zeros((n, n)), 0.0, float(np.sum(residuals**2))
    for lag in range(min(max(lags, 1), k)):
        taper = parzen(lag / max(lags, 1)) * (0.5 if lag == 0 else 1.0)
        autocovariance = residuals[lag:].T @ residuals[: k - lag] * (m / max(count, 1))
        lagged = (autocovariance.T @ h[lag:]).reshape(-1, n).T @ h[: k - lag].reshape(-1, n)
        middle += taper * (lagged + lagged.T)
        correlated += 2.0 * taper * float(np.trace(autocovariance)) * count / (m * max(power, 1e-300))
    freedom = count - solution.rank * max(correlated, 1.0)
    if freedom <= 0.0:
        return np.full((n, n), np.nan)
    return solution.masked(solution.inverse @ middle @ solution.inverse) * (count / freedom)


def parzen(u: float) -> float:
    """Parzen's lag window at 0 <= u, 1 at 0 and 0 from 1 on; its spectrum is positive."""
    if u >= 1.0:
        return 0.0
    return 1.0 - 6.0 * u**2 * (1.0 - u) if u <= 0.5 else 2.0 * (1.0 - u) ** 3


def iterated_least_squares(
    model: Callable[[Array], Array],
    start: Array,
    values: Array,
    w: Array | None = None,
    *,
    jacobian: Callable[[Array], Array] | None = None,
    tolerance: float = 1e-6,
    most_iterations: int = 50,
    lags: int = 1,
) -> NonlinearFit:
    """p that minimises (4.5) for y(k) = f(k, p) + e(k): steps (4.8), each a linear problem (4.3), (4.6).

    model: p (n,) to f (k,) or (k, m); jacobian: p to df/dp (k, n) or (k, m, n), central differences if None. A
    step that does not lower the cost is halved. It has converged when the part of the residuals that a step can
    explain is less than ``tolerance`` of the part that it cannot, each per degree of freedom (Bates and Watts
    1981), or when the step is less than ``tolerance`` of the parameters, or of rounding. Raises ValueError where
    the model is not finite at the start.
    """
    p = np.array(start, dtype=np.float64)
    cost, f = _cost(model, p, values, w)
    if not np.isfinite(cost):
        raise ValueError("the model is not finite at the start: begin elsewhere")
    costs, reason, converged = [cost], f"no convergence in {most_iterations} iterations", False
    differentiate = jacobian or (lambda at: central_differences(model, at))
    while True:
        fit = weighted_least_squares(differentiate(p), values - f, w, lags=lags)
        if converged or len(costs) > most_iterations:
            break
        if _explained_share(fit, values - f, w) < tolerance:
            converged, reason = True, "the residuals hold nothing more that a step explains"
            break
        step, trial = fit.estimate, np.inf
        for _ in range(_MOST_HALVINGS):
            trial, f_trial = _cost(model, p + step, values, w)
            if trial < cost or np.all(np.abs(step) <= 1e-15 * np.abs(p)):
                break
            step = 0.5 * step
        if not trial < cost:
            converged = bool(np.all(np.abs(fit.estimate) <= np.sqrt(tolerance) * np.abs(p) + 1e-12))
            reason = "no step lowers the cost any more"
            break
        small = bool(np.all(np.abs(step) <= tolerance * np.abs(p)))
        p, cost, f = p + step, trial, f_trial
        costs.append(cost)
        if small:
            converged, reason = True, "the step is small"
    return NonlinearFit(fit, p, converged, reason, len(costs) - 1, np.array(costs))


def central_differences(model: Callable[[Array], Array], p: Array) -> Array:
    """df/dp, the shape of f with (n,) after it, with an error of order 1e-10 of f for parameters of order 1."""
    columns = []
    for j in range(len(p)):
        step = np.zeros(len(p))
        step[j] = 6e-6 * max(abs(p[j]), 1e-3)
        columns.append((model(p + step) - model(p - step)) / (2.0 * step[j]))
    return np.stack(columns, axis=-1)


def _explained_share(fit: LinearFit, residuals: Array, w: Array | None) -> float:
    """Rms per degree of freedom of what the step explains over that of what it cannot."""
    before = residuals.reshape(len(residuals), -1)
    no_rows = np.zeros((*before.shape, 1))
    _, z, _ = whitened(no_rows, before, w)
    _, left, _ = whitened(no_rows, fit.residuals, w)
    n = max(int(fit.determined.sum()), 1)
    freedom = max(z.size - n, 1)
    explained = float(np.sqrt(np.sum((z - left) ** 2) / n))
    rest = float(np.sqrt(np.sum(left**2) / freedom))
    if explained == 0.0:
        return 0.0
    return explained / rest if rest > 0.0 else np.inf


def _cost(model: Callable[[Array], Array], p: Array, values: Array, w: Array | None) -> tuple[float, Array]:
    """(4.5) at p, and f; infinite where the model is not finite at a sample that is."""
    with np.errstate(all="ignore"):
        f = np.asarray(model(p), dtype=np.float64)
    z = (values - f).reshape(len(values), -1)
    if not np.all(np.isfinite(f[np.isfinite(values)])):
        return np.inf, f
    _, z, _ = whitened(np.zeros((*z.shape, 1)), z, w)
    return 0.5 * float(np.sum(z**2)), f


def _blocks(rows: Array, values: Array) -> tuple[Array, Array]:
    """H as (k, m, n) and y as (k, m)."""
    rows, values = np.asarray(rows, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if values.ndim == 1 and rows.ndim == 2:
        rows, values = rows[:, None, :], values[:, None]
    if values.ndim != 2 or rows.ndim != 3 or rows.shape[:2] != values.shape:
        raise ValueError(f"H {rows.shape} and y {values.shape} do not fit: (k, n) and (k,), or (k, m, n) and (k, m)")
    return rows, values
