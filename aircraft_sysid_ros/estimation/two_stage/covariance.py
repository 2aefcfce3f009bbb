"""Hessian of J, (6) of the two-stage paper (docs/references.md), and the covariance of the estimate, for fixed R.

With the whitened derivatives h = R^-1/2 [A, G] the gradient is -h' R^-1/2 r, and the Hessian

    H = sum h'h - sum r' R^-1 d2(A xi1 + b),

of which Gauss-Newton keeps the first sum. The paper takes standard deviations from H^-1 as fmincon has it, which is an
approximation built up on the way to the minimum; here H is computed at the minimum.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.least_squares import coloured_sandwich, solve_factor
from aircraft_sysid_ros.estimation.maximum_likelihood import covariance_of
from aircraft_sysid_ros.estimation.two_stage.linear import triangle
from aircraft_sysid_ros.estimation.two_stage.problem import Integers, Problem

Array = npt.NDArray[np.float64]

#: Steps of the differences of the gradient, in units of xi2: the gradient may itself be a difference.
_STEP = 1e-4
#: A Hessian is positive if its smallest eigenvalue, columns scaled, is above this.
_POSITIVE = 1e-9


class Covariances(NamedTuple):
    """Covariances (n, n) of all unknowns, xi1 first; NaN for what the data do not tell."""

    gauss_newton: Array
    hessian: Array  # inverse of the whole H; that of Gauss-Newton where H is not positive, as at a bound
    coloured: Array  # the sandwich of least_squares, for residuals that are correlated in time
    hessian_positive: bool


def cost_gradient(problem: Problem, xi1: Array, xi2: Array, noise: Array) -> Array:
    """dJ/dxi (n1 + n2,) of (6) for fixed noise (m,)."""
    a, b = problem.evaluate(xi2)
    weighted = (problem.kept - b - a @ xi1) / noise
    slopes = np.concatenate([a, problem.slopes(xi1, xi2)], axis=2)
    return -np.asarray(np.einsum("kmj,km->j", slopes, weighted))


def cost_hessian(problem: Problem, xi1: Array, xi2: Array, noise: Array) -> Array:
    """d2J/dxi2 (n, n), n = n1 + n2, exact in the xi1 block, else by central differences of the gradient.

    A point nearer to a bound of xi2 than the step is moved inside by that much first.
    """
    steps = _STEP * problem.scale2
    xi2 = np.clip(xi2, problem.bounds2[:, 0] + steps, problem.bounds2[:, 1] - steps)
    n1, n = problem.n1, problem.n1 + problem.n2
    a, _ = problem.evaluate(xi2)
    out = np.empty((n, n))
    root = triangle([a], noise)
    out[:n1, :n1] = root.T @ root
    for j, step in enumerate(np.diag(steps)):
        change = cost_gradient(problem, xi1, xi2 + step, noise) - cost_gradient(problem, xi1, xi2 - step, noise)
        out[:, n1 + j] = change / (2.0 * steps[j])
    out[n1:, n1:] = 0.5 * (out[n1:, n1:] + out[n1:, n1:].T)
    out[n1:, :n1] = out[:n1, n1:].T
    return out


def covariances(
    problem: Problem, xi1: Array, xi2: Array, noise: Array, lags: int, piece: Integers | None = None
) -> Covariances:
    """Covariances at a minimum, all multiplied by Km / (Km - n) for what the fit took from the residuals.

    Residuals may be correlated over fewer than ``lags`` rows of the record, unless they are of another ``piece`` (N,).
    The unknowns are taken as free: at a bound the numbers are those of the minimum without it.
    """
    a, b = problem.evaluate(xi2)
    residual = (problem.kept - b - a @ xi1) / np.sqrt(noise)
    h = np.concatenate([a, problem.slopes(xi1, xi2)], axis=2) / np.sqrt(noise)[:, None]
    n = h.shape[2]
    freedom = max(residual.size - n, 1)
    solution = solve_factor(triangle([h], np.ones(len(noise))), np.zeros(n))
    gauss_newton = solution.covariance * (residual.size / freedom)
    hessian = cost_hessian(problem, xi1, xi2, noise)
    positive = smallest_scaled_eigenvalue(hessian) > _POSITIVE
    whole = covariance_of(hessian) * (residual.size / freedom) if positive else gauss_newton
    h_in_time, residual_in_time = (in_time(rows, problem, piece, lags) for rows in (h, residual))
    coloured = coloured_sandwich(h_in_time, residual_in_time, solution, lags, residual.size)
    return Covariances(gauss_newton, whole, coloured, positive)


def in_time(rows: Array, problem: Problem, piece: Integers | None, lags: int) -> Array:
    """Usable rows (K, …) at their places in the record, with zeros where it has gaps: what lags are counted in."""
    if problem.usable is not None:
        spread = np.zeros((len(problem.measured), *rows.shape[1:]))
        spread[problem.usable] = rows
        rows = spread
    return rows if piece is None else separated(rows, piece, lags)


def separated(rows: Array, piece: Integers, lags: int) -> Array:
    """Rows (K, …) with ``lags`` rows of zeros between the pieces (K,), so that no product spans a gap."""
    cuts = np.flatnonzero(np.diff(piece)) + 1
    empty = np.zeros((lags, *rows.shape[1:]))
    parts = [part for block in np.split(rows, cuts) for part in (block, empty)]
    return np.concatenate(parts[:-1])


def smallest_scaled_eigenvalue(matrix: Array) -> float:
    """Of a symmetric matrix whose rows and columns were divided by the roots of its diagonal.

    -1 where the diagonal itself is not positive.
    """
    diagonal = np.diag(matrix)
    if not np.all(np.isfinite(matrix)) or not np.all(diagonal > 0.0):
        return -1.0
    scale = np.sqrt(diagonal)
    return float(np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0])
