"""Recursive least squares, (4.9)-(4.14) of docs/references.md: three forms, and directional forgetting.

Vector measurements ``y(k) = H(k) theta + e(k)`` with e of covariance W(k), shapes y (m,), H (m, n), W (m, m):

| form | carries | sound where |
|---|---|---|
| ``gain_update`` (4.12), (4.14) | theta and P = R^-1 | P begins finite: a prior; no solution per step |
| ``information_update`` (4.11), (4.13) | R and R theta | before all is determined; squares the condition |
| ``square_root_update`` | the triangular root of R | always: collinear regressors, twice the digits |

(4.14) as printed carries a W^-1 too many, which W = I hides: the Woodbury identity has none,
``R^-1(k+1) = (I - R^-1 H' (H R^-1 H' + W)^-1 H) R^-1``.

``rls_update`` is the gain form for scalar y and W = 1, with forgetting (for other W divide x and y by its root).

Exponential forgetting loses the information of every direction at each step, so that without excitation the
covariance P = R^-1 grows without bound and the estimate drifts. Directional forgetting (Kulhavy 1987;
Bittanti, Bolzern and Campi 1990) forgets only along the direction in which the new sample brings information:
what is not excited is held.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.iterated_ekf import cholesky, symmetrise
from aircraft_sysid_ros.estimation.least_squares import Solution, solve_factor
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

#: x' P x of a sample that says nothing; what is forgotten along x is divided by it.
_NO_INFORMATION = 1e-300


@njit(cache=True)
def rls_update(theta: Array, p: Array, x: Array, y: float, forgetting: float) -> float:
    """One sample, in place: theta (n,), p (n, n) = R^-1, x (n,) regressors, y measured, 0 < forgetting <= 1.

    Returns the prediction error y - x' theta before the update. P changes along P x only, and stays symmetric
    and positive: with r = x' P x before, x' P x is r / (forgetting (1 + r)) after. A sample without
    information (r = 0) or without a value (NaN) changes nothing.
    """
    n = len(theta)
    px = np.zeros(n)
    for i in range(n):
        for j in range(n):
            px[i] += p[i, j] * x[j]
    r, error = 0.0, y
    for i in range(n):
        r += x[i] * px[i]
        error -= x[i] * theta[i]
    if not (r > _NO_INFORMATION) or not np.isfinite(error):
        return error
    # P - P x x' P / (1 + r), and what is forgotten along x
    forgotten = (1.0 - forgetting) / (forgetting * r * (1.0 + r))
    scale = forgotten - 1.0 / (1.0 + r)
    for i in range(n):
        theta[i] += px[i] / (1.0 + r) * error
        for j in range(n):
            p[i, j] += scale * px[i] * px[j]
    symmetrise(p)
    return error


@njit(cache=True)
def whiten(h: Array, y: Array, w: Array) -> tuple[Array, Array]:
    """H and y divided by the lower root of W, so that W is I; NaN where W is not positive definite."""
    root = cholesky(w)
    rows, values = h.copy(), y.copy()
    for i in range(len(y)):
        for k in range(i):
            values[i] -= root[i, k] * values[k]
            for j in range(h.shape[1]):
                rows[i, j] -= root[i, k] * rows[k, j]
        values[i] /= root[i, i]
        for j in range(h.shape[1]):
            rows[i, j] /= root[i, i]
    return rows, values


@njit(cache=True)
def gain_update(theta: Array, p: Array, h: Array, y: Array, w: Array) -> None:
    """(4.12) and (4.14) with any W, in place: theta (n,), p (n, n) = R^-1, h (m, n), y (m,), w (m, m).

    The rows of a whitened measurement are independent: each is one ``rls_update``, which needs no inverse. A
    measurement with a NaN, or with W not positive definite, changes nothing.
    """
    rows, values = whiten(h, y, w)
    if np.all(np.isfinite(rows)) and np.all(np.isfinite(values)):
        for i in range(len(values)):
            rls_update(theta, p, rows[i], values[i], 1.0)


@njit(cache=True)
def information_update(information: Array, vector: Array, h: Array, y: Array, w: Array) -> None:
    """(4.11) and the sum of (4.10), in place: R += H' W^-1 H (n, n) and R theta += H' W^-1 y (n,).

    Zeros are the start: nothing is known. A measurement with a NaN, or with W not positive definite, changes
    nothing.
    """
    rows, values = whiten(h, y, w)
    if np.all(np.isfinite(rows)) and np.all(np.isfinite(values)):
        information += rows.T @ rows
        vector += rows.T @ values


def information_solution(information: Array, vector: Array) -> Solution:
    """theta and R^-1 of the information form, (4.12) and (4.13); what is not determined is marked as such.

    Through the symmetric root of the scaled R, whose small eigenvalues are rounding: the condition that it can
    bear is the root of what ``square_root_solution`` can.
    """
    scale = np.sqrt(np.diag(information))
    scale[~(scale > 0.0)] = 1.0
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    known = values > 1e-13 * max(float(values[-1]), 1e-300)
    half = np.sqrt(values[known])
    root = half[:, None] * vectors[:, known].T * scale
    right = (vectors[:, known].T @ (vector / scale)) / half
    return solve_factor(root, right)


@njit(cache=True)
def square_root_update(root: Array, h: Array, y: Array, w: Array, forgetting: float) -> None:
    """One measurement into the triangular root (n + 1, n + 1) of [H y]' W^-1 [H y], by Givens rotations, in place.

    Its first n columns hold the root of R (4.11), the last what gives theta, its corner the root of the least
    cost. Zeros are the start. ``forgetting`` multiplies the weight of all that came before. A measurement with a
    NaN, or with W not positive definite, changes nothing.
    """
    rows, values = whiten(h, y, w)
    if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(values))):
        return
    root *= np.sqrt(forgetting)
    size = root.shape[0]
    row = np.empty(size)
    for i in range(len(values)):
        row[: size - 1], row[size - 1] = rows[i], values[i]
        for j in range(size):
            length = np.hypot(root[j, j], row[j])
            if length == 0.0:
                continue
            c, s = root[j, j] / length, row[j] / length
            for k in range(j, size):
                above = root[j, k]
                root[j, k] = c * above + s * row[k]
                row[k] = c * row[k] - s * above


def square_root_solution(root: Array) -> Solution:
    """theta and R^-1 from the root of ``square_root_update``; what is not determined is marked as such."""
    n = len(root) - 1
    return solve_factor(root[:n, :n], root[:n, n])
