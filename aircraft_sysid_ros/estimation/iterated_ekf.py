"""Iterated extended Kalman filter, (3.10)-(3.18) of docs/references.md, on plain arrays.

Model: ``x(k+1) = f(x(k)) + w``, ``y = h(x) + v``, v ~ N(0, R). One measurement update iterates

    eta_{i+1} = x + K(eta_i) (y - h(eta_i) - H(eta_i) (x - eta_i))                                     (3.15)

until it no longer moves (3.16), then sets the covariance in the Joseph form (3.18), which stays symmetric and
positive definite for any gain. The compiled pieces ``weigh``, ``move`` and ``settle_covariance`` are the update of
filters whose state is no vector space too; ``iterated_update`` is the whole for one that is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]


@njit(cache=True)
def cholesky(a: Array) -> Array:
    """Lower factor L of a symmetric positive matrix, a = L L'; NaN on its diagonal if it is not positive."""
    factor = np.empty_like(a)
    _factorise(a, factor)
    return factor


@njit(cache=True)
def _factorise(a: Array, factor: Array) -> None:
    """``cholesky`` of a into ``factor``; both (n, n)."""
    n = a.shape[0]
    for j in range(n):
        for i in range(j):
            factor[i, j] = 0.0
        s = a[j, j]
        for k in range(j):
            s -= factor[j, k] * factor[j, k]
        factor[j, j] = np.sqrt(s) if s > 0.0 else np.nan
        for i in range(j + 1, n):
            s = a[i, j]
            for k in range(j):
                s -= factor[i, k] * factor[j, k]
            factor[i, j] = s / factor[j, j]


@njit(cache=True)
def solve_factored(factor: Array, b: Array) -> Array:
    """Solve L L' x = b, b of shape (m,)."""
    x = b.copy()
    _solve_in_place(factor, x)
    return x


@njit(cache=True)
def _solve_in_place(factor: Array, x: Array) -> None:
    m = factor.shape[0]
    for i in range(m):
        s = x[i]
        for k in range(i):
            s -= factor[i, k] * x[k]
        x[i] = s / factor[i, i]
    for i in range(m - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, m):
            s -= factor[k, i] * x[k]
        x[i] = s / factor[i, i]


# -- one update, in memory that is given: m outputs, n states ------------------------------------------------------


class Update(NamedTuple):
    """Working memory of one update."""

    h: Array  # (m, n) output matrix
    ph: Array  # (m, n) (P H')'
    gains: Array  # (m, n) K'
    rest: Array  # (m, n)
    innovation_covariance: Array  # (m, m) H P H' + diag(r), then that without r
    factor: Array  # (m, m) its Cholesky factor
    delta: Array  # (n,) by how much the state has moved


@njit(cache=True)
def working_size(m: int, n: int) -> int:
    """How many numbers the working memory of an update is, with m outputs of n states."""
    return 4 * m * n + 2 * m * m + n


@njit(cache=True)
def new_update(m: int, n: int) -> Update:
    """Working memory for m outputs and n states, which have not moved."""
    return update_within(np.empty(working_size(m, n)), m, n)


@njit(cache=True)
def update_within(memory: Array, m: int, n: int) -> Update:
    """The same in memory that is there, of at least ``working_size(m, n)``."""
    rows = memory[: 4 * m * n].reshape(4, m, n)
    squares = memory[4 * m * n : 4 * m * n + 2 * m * m].reshape(2, m, m)
    delta = memory[4 * m * n + 2 * m * m : working_size(m, n)]
    delta[:] = 0.0
    return Update(rows[0], rows[1], rows[2], rows[3], squares[0], squares[1], delta)


@njit(cache=True)
def weigh(p: Array, r: Array, update: Update) -> bool:
    """Covariance of the innovation (3.14) and its factor, from p (n, n), H and r (m,); whether it is positive."""
    h, ph, innovation = update.h, update.ph, update.innovation_covariance
    m, n = h.shape
    ph[:] = 0.0
    for j in range(m):
        for k in range(n):
            if h[j, k] != 0.0:  # most are
                for i in range(n):  # p is symmetric: along its rows, which the machine takes four at a time
                    ph[j, i] += p[k, i] * h[j, k]
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(n):
                total += h[i, k] * ph[j, k]
            innovation[i, j] = total + r[i] if i == j else total
    _factorise(innovation, update.factor)
    return bool(np.isfinite(update.factor[m - 1, m - 1]))


@njit(cache=True)
def normalised_square(innovation: Array, update: Update) -> float:
    """Normalised innovation squared of an innovation (m,), after ``weigh``."""
    weighted = update.rest[0, : len(innovation)]
    weighted[:] = innovation
    _solve_in_place(update.factor, weighted)
    total = 0.0
    for i in range(len(innovation)):
        total += innovation[i] * weighted[i]
    return total


@njit(cache=True, error_model="numpy")
def _gain(update: Update) -> None:
    """K = P H' S^-1 (3.14), after ``weigh``."""
    ph, gains, factor = update.ph, update.gains, update.factor
    m, n = ph.shape
    if m == 1:  # most measurements are scalars
        for i in range(n):
            gains[0, i] = ph[0, i] / (factor[0, 0] * factor[0, 0])
        return
    gains[:] = ph
    for a in range(m):  # L L' K' = (P H')', all columns at once
        for b in range(a):
            for i in range(n):
                gains[a, i] -= factor[a, b] * gains[b, i]
        for i in range(n):
            gains[a, i] /= factor[a, a]
    for a in range(m - 1, -1, -1):
        for b in range(a + 1, m):
            for i in range(n):
                gains[a, i] -= factor[b, a] * gains[b, i]
        for i in range(n):
            gains[a, i] /= factor[a, a]


@njit(cache=True, error_model="numpy")
def move(p: Array, residual: Array, update: Update) -> float:
    """One iteration (3.15), after ``weigh``: delta becomes K residual; returns by how much it changed (3.16).

    ``residual`` (m,) is y - h(eta) + H delta, referred back to the prediction. The change is the largest of all states,
    in their standard deviations, since they have different units.
    """
    gains, delta, changes = update.gains, update.delta, update.rest[0]
    _gain(update)
    for k in range(len(delta)):
        moved = 0.0
        for i in range(len(residual)):
            moved += gains[i, k] * residual[i]
        changes[k] = abs(moved - delta[k]) / np.sqrt(p[k, k])
        delta[k] = moved
    change = 0.0
    for k in range(len(delta)):
        change = max(change, changes[k])
    return change


@njit(cache=True)
def settle_covariance(p: Array, r: Array, update: Update) -> None:
    """(I - K H) P (I - K H)' + K diag(r) K', (3.18), over p, which is symmetric to the bit, with the last gain."""
    h, hp, gains, rest, hph = update.h, update.ph, update.gains, update.rest, update.innovation_covariance
    m, n = h.shape
    for i in range(m):
        for k in range(m):
            total = 0.0
            for j in range(n):
                total += h[i, j] * hp[k, j]
            hph[i, k] = total
    for k in range(m):  # (K R - (I - K H) P H')'
        for i in range(n):
            rest[k, i] = gains[k, i] * r[k] - hp[k, i]
            for a in range(m):
                rest[k, i] += gains[a, i] * hph[a, k]
    if m > 1:
        _add_products(p, rest, gains, hp)
        return
    for i in range(n):  # most measurements are scalars: both halves are made their mean at once
        for j in range(n):
            here = p[i, j] + (rest[0, i] * gains[0, j] - gains[0, i] * hp[0, j])
            there = p[i, j] + (rest[0, j] * gains[0, i] - gains[0, j] * hp[0, i])
            p[i, j] = 0.5 * (here + there)


@njit(cache=True)
def _add_products(p: Array, rest: Array, gains: Array, hp: Array) -> None:
    """rest' gains - gains' hp, each (m, n), added to p (n, n), which is then made symmetric."""
    m, n = gains.shape
    for i in range(n):
        for k in range(m):
            for j in range(n):
                p[i, j] += rest[k, i] * gains[k, j] - gains[k, i] * hp[k, j]
    symmetrise(p)


# -- the same in one call --------------------------------------------------------------------------------------------


@njit(cache=True)
def gain(p: Array, h: Array, r: Array) -> tuple[Array, Array]:
    """Kalman gain K = P H' S^-1 (3.14), shape (n, m), and the factor of S = H P H' + diag(r).

    p (n, n), h (m, n), r (m,) variances of independent measurement errors. A gain that does not exist is NaN.
    """
    update = new_update(*h.shape)
    update.h[:] = h
    weigh(p, r, update)
    _gain(update)
    return update.gains.T.copy(), update.factor.copy()


@njit(cache=True)
def joseph_update(p: Array, k_gain: Array, h: Array, r: Array) -> None:
    """(I - K H) P (I - K H)' + K diag(r) K', (3.18), written over p, for any gain K (n, m)."""
    update = new_update(*h.shape)
    update.h[:] = h
    weigh(p, r, update)
    update.gains[:] = k_gain.T
    settle_covariance(p, r, update)
    symmetrise(p)


@njit(cache=True)
def linear_update(p: Array, h: Array, r: Array, residual: Array) -> Array:
    """By how much a state moves (n,) for the residual (m,) of one linear measurement; p (n, n) is updated in place.

    NaN, and p as it was, where the innovation covariance is not positive definite.
    """
    update = new_update(*h.shape)
    update.h[:] = h
    if not weigh(p, r, update):
        return np.full(len(p), np.nan)
    move(p, residual, update)
    settle_covariance(p, r, update)
    return update.delta


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
class Updated:
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
) -> Updated:
    """Update (3.15)-(3.18) with y = h(x) + v; ``maximum_iterations=1`` is the EKF (3.12)-(3.14).

    state (n,), covariance (n, n), measurement (m,), variances (m,); ``output`` is h, ``jacobian`` gives H of
    shape (m, n). It ends when no state moves by more than ``tolerance`` standard deviations. Raises
    numpy.linalg.LinAlgError if the innovation covariance is not positive definite.
    """
    update = new_update(len(measurement), len(state))
    first = measurement - output(state)
    eta, nis, iterations, change = state, np.nan, 0, np.inf
    while iterations < maximum_iterations and not change <= tolerance:
        update.h[:] = jacobian(eta)
        if not weigh(covariance, variances, update):
            raise np.linalg.LinAlgError("the innovation covariance is not positive definite")
        if iterations == 0:
            nis = normalised_square(first, update)
        change = move(covariance, measurement - output(eta) + update.h @ update.delta, update)
        eta = state + update.delta
        iterations += 1
    updated = covariance.copy()
    settle_covariance(updated, variances, update)
    symmetrise(updated)
    return Updated(eta, updated, iterations, change <= tolerance, first, nis)
