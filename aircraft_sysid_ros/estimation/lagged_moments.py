"""Running sums from which the standard errors of least squares are corrected for coloured residuals.

For ``y(k) = x(k)' theta + e(k)`` with correlated e the covariance of the least-squares estimate is not
``s^2 (sum x x')^-1`` (4.7) of docs/references.md but

    (sum x x')^-1  [ sum_l w_l R_e(l) sum_k x(k) x(k-l)' ]  (sum x x')^-1

(Morelli and Klein, J. Guidance 20(1), 1997), with the autocovariance R_e(l) of the residuals. All of it
follows from sums of lagged products: it is exact for the newest estimate at any time, at bounded memory.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

#: A regressor of which the others explain all but this share is not one of its own.
_SINGULAR = 1e-10


@njit(cache=True)
def add_sample(sums: Array, recent: Array, row: Array, forgetting: float) -> None:
    """Add one sample, in place. ``row`` (n + 2,) = w (x, y, 1), with w the root of the sample's weight (4.5).

    sums (lags, n + 2, n + 2): sum of row(k) row(k - l)', its last element the sum of the weights; recent
    (lags, n + 2) the newest rows, newest first. After a break in the data set ``recent`` to NaN.
    """
    lags, m = recent.shape
    for lag in range(lags - 1, 0, -1):
        for i in range(m):
            recent[lag, i] = recent[lag - 1, i]
    for i in range(m):
        recent[0, i] = row[i]
    for lag in range(lags):
        present = 0.0 if np.isnan(recent[lag, 0]) else 1.0
        for i in range(m):
            weight = present * row[i]
            if present:
                for j in range(m):
                    sums[lag, i, j] = forgetting * sums[lag, i, j] + weight * recent[lag, j]
            else:
                for j in range(m):
                    sums[lag, i, j] *= forgetting


@njit(cache=True)
def residual_autocovariance(sums: Array, theta: Array) -> Array:
    """R_e(l) for the residuals y - x' theta, shape (lags,); 0 where there is no data."""
    lags, n = sums.shape[0], len(theta)
    out = np.zeros(lags)
    for lag in range(lags):
        weight = sums[lag, n + 1, n + 1]
        if weight <= 0.0:
            break
        s = sums[lag, n, n]
        for i in range(n):
            s -= theta[i] * (sums[lag, i, n] + sums[lag, n, i])
            for j in range(n):
                s += theta[i] * sums[lag, i, j] * theta[j]
        out[lag] = s / weight
    return out


@njit(cache=True)
def coloured_covariance(sums: Array, theta: Array) -> tuple[Array, Array, Array]:
    """Covariance of theta (n, n) allowing for coloured residuals, that for white ones, and R_e (lags,).

    The lag window is that of Tukey and Hanning. Rows and columns of a regressor that is zero throughout, or
    that the others explain, are NaN; the rest holds without it. With weights below 1 both are upper bounds.
    """
    lags, n = sums.shape[0], len(theta)
    autocovariance = residual_autocovariance(sums, theta)
    middle = np.zeros((n, n))
    for lag in range(lags):
        taper = 0.5 * (1.0 + np.cos(np.pi * lag / lags))
        factor = taper * autocovariance[lag] * (0.5 if lag == 0 else 1.0)
        for i in range(n):
            for j in range(n):
                middle[i, j] += factor * (sums[lag, i, j] + sums[lag, j, i])
    information = sums[0, :n, :n].copy()
    scale = np.sqrt(np.diag(information))
    for i in range(n):
        if not scale[i] > 0.0:
            scale[i] = 1.0
    inverse = np.linalg.inv(information / np.outer(scale, scale) + 1e-12 * np.eye(n))
    singular = np.diag(inverse) > 1.0 / _SINGULAR
    inverse /= np.outer(scale, scale)
    white = max(autocovariance[0], 0.0) * inverse
    coloured = inverse @ middle @ inverse
    for i in range(n):
        if singular[i]:
            coloured[i, :], coloured[:, i], white[i, :], white[:, i] = np.nan, np.nan, np.nan, np.nan
    return coloured, white, autocovariance
