"""Iterated extended Kalman filter, (3.10)-(3.18) of docs/references.md, on plain arrays.

Model: ``x(k+1) = f(x(k)) + w``, ``y = h(x) + v``, v ~ N(0, R). One measurement update iterates

    eta_{i+1} = x + K(eta_i) (y - h(eta_i) - H(eta_i) (x - eta_i))                                     (3.15)

until it no longer moves (3.16), then sets the covariance in the Joseph form (3.18), which stays symmetric and
positive definite for any gain. The jitted pieces (gain, Joseph form) also serve filters whose state is not a
vector space; ``iterated_update`` is the whole update for one that is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]


@njit(cache=True)
def cholesky(a: Array) -> Array:
    """Lower factor L of a symmetric positive matrix, a = L L'; NaN on its diagonal if it is not positive."""
    n = a.shape[0]
    factor = np.zeros((n, n))
    for j in range(n):
        s = a[j, j]
        for k in range(j):
            s -= factor[j, k] * factor[j, k]
        factor[j, j] = np.sqrt(s) if s > 0.0 else np.nan
        for i in range(j + 1, n):
            s = a[i, j]
            for k in range(j):
                s -= factor[i, k] * factor[j, k]
            factor[i, j] = s / factor[j, j]
    return factor


@njit(cache=True)
def solve_factored(factor: Array, b: Array) -> Array:
    """Solve L L' x = b, b of shape (m,)."""
    m = factor.shape[0]
    x = np.empty(m)
    for i in range(m):
        s = b[i]
        for k in range(i):
            s -= factor[i, k] * x[k]
        x[i] = s / factor[i, i]
    for i in range(m - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, m):
            s -= factor[k, i] * x[k]
        x[i] = s / factor[i, i]
    return x


@njit(cache=True)
def _times_transposed(p: Array, h: Array) -> Array:
    """(P H')', shape (m, n)."""
    m, n = h.shape
    ph = np.zeros((m, n))
    for j in range(m):
        for k in range(n):
            if h[j, k] != 0.0:  # most are
                for i in range(n):  # p is symmetric: along its rows, which the machine takes four at a time
                    ph[j, i] += p[k, i] * h[j, k]
    return ph


@njit(cache=True)
def _innovation_covariance(h: Array, ph: Array, r: Array) -> Array:
    """S = H P H' + diag(r), (m, m), from H and (P H')', both (m, n)."""
    m, n = h.shape
    innovation = np.zeros((m, m))
    for i in range(m):
        for j in range(m):
            for k in range(n):
                innovation[i, j] += h[i, k] * ph[j, k]
        innovation[i, i] += r[i]
    return innovation


@njit(cache=True)
def gain(p: Array, h: Array, r: Array) -> tuple[Array, Array]:
    """Kalman gain K = P H' S^-1 (3.14), shape (n, m), and the factor of S = H P H' + diag(r).

    p (n, n), h (m, n), r (m,) variances of independent measurement errors. A gain that does not exist is NaN.
    """
    m, n = h.shape
    ph = _times_transposed(p, h)
    factor = cholesky(_innovation_covariance(h, ph, r))
    k_gain = np.empty((n, m))
    if m == 1:  # most measurements are scalars
        for i in range(n):
            k_gain[i, 0] = ph[0, i] / (factor[0, 0] * factor[0, 0])
        return k_gain, factor
    for a in range(m):  # L L' K' = (P H')', all columns at once
        for b in range(a):
            for i in range(n):
                ph[a, i] -= factor[a, b] * ph[b, i]
        for i in range(n):
            ph[a, i] /= factor[a, a]
    for a in range(m - 1, -1, -1):
        for b in range(a + 1, m):
            for i in range(n):
                ph[a, i] -= factor[b, a] * ph[b, i]
        for i in range(n):
            ph[a, i] /= factor[a, a]
            k_gain[i, a] = ph[a, i]
    return k_gain, factor


@njit(cache=True)
def joseph_update(p: Array, k_gain: Array, h: Array, r: Array) -> None:
    """(I - K H) P (I - K H)' + K diag(r) K', (3.18), written over p; symmetric to the last bit."""
    m, n = h.shape
    hp = _times_transposed(p, h)  # H P, p being symmetric
    hph = np.zeros((m, m))
    for i in range(m):
        for k in range(m):
            for j in range(n):
                hph[i, k] += h[i, j] * hp[k, j]
    gains, rest = np.empty((m, n)), np.empty((m, n))  # K', and (K R - (I - K H) P H')'
    for k in range(m):
        for i in range(n):
            gains[k, i] = k_gain[i, k]
            rest[k, i] = k_gain[i, k] * r[k] - hp[k, i]
            for a in range(m):
                rest[k, i] += k_gain[i, a] * hph[a, k]
    for i in range(n):
        for k in range(m):
            for j in range(n):
                p[i, j] += rest[k, i] * gains[k, j] - gains[k, i] * hp[k, j]
    symmetrise(p)


@njit(cache=True)
def symmetrise(p: Array) -> None:
    """Make p symmetric in place: rounding must not grow over a million steps."""
    n = p.shape[0]
    for i in range(n):
        for j in range(i):
            mean = 0.5 * (p[i, j] + p[j, i])
            p[i, j] = mean
            p[j, i] = mean


@dataclass(frozen=True)
class Update:
    """Result of one measurement update: state (n,), covariance (n, n), its normalised innovation squared."""

    state: Array
    covariance: Array
    iterations: int
    converged: bool
    innovation: Array
    normalised_innovation_squared: float


def iterated_update(
    state: Array,
    covariance: Array,
    measurement: Array,
    output: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    variances: Array,
    tolerance: float = 1e-9,
    maximum_iterations: int = 20,
) -> Update:
    """Update (3.15)-(3.18) with y = h(x) + v; ``maximum_iterations=1`` is the EKF (3.12)-(3.14).

    state (n,), covariance (n, n), measurement (m,), variances (m,); ``output`` is h, ``jacobian`` gives H of
    shape (m, n). Raises numpy.linalg.LinAlgError if the innovation covariance is not positive definite.
    """
    eta = state.copy()
    first = measurement - output(state)
    nis = np.nan
    converged = False
    iterations = 0
    while iterations < maximum_iterations and not converged:
        h = np.ascontiguousarray(jacobian(eta))
        k_gain, factor = gain(covariance, h, variances)
        if not np.all(np.isfinite(k_gain)):
            raise np.linalg.LinAlgError("the innovation covariance is not positive definite")
        if iterations == 0:
            nis = float(first @ solve_factored(factor, first))
        moved = state + k_gain @ (measurement - output(eta) - h @ (state - eta))
        size = max(float(np.linalg.norm(eta)), 1e-300)
        converged = bool(np.linalg.norm(moved - eta) <= tolerance * size)  # (3.16)
        eta = moved
        iterations += 1
    updated = covariance.copy()
    joseph_update(updated, k_gain, h, variances)
    return Update(eta, updated, iterations, converged, first, nis)
