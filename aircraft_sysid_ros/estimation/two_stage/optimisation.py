"""Second stage of the two-stage paper (docs/references.md): (24), (26), (27), step 5 of section II.C.

With R fixed, J of (6) is a sum of squares. Its Gauss-Newton step comes from the triangle of the whitened columns
[A, G, r], G = d(A xi1 + b)/dxi2, r the residual:

    | T11 T12 t1 |     all unknowns:  T (d1, d2) = t
    |     T22 t2 |     xi2 alone:     T22 d2 = t2, and xi1 by least squares at the new xi2.

The second is variable projection with Kaufman's derivative of the projector: the gradient of the projected cost is
exact, -G' R^-1 r (Golub and Pereyra), because r is orthogonal to A. Steps are damped (Levenberg-Marquardt) and kept
within the bounds; R alternates with xi until (26).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.linear import linear_stage, triangle
from aircraft_sysid_ros.estimation.two_stage.problem import Mask, Problem

Array = npt.NDArray[np.float64]

#: A diagonal element of R is never less than this share of the mean square of its output: data without noise.
_LEAST_NOISE = 1e-20
#: Converged: the next step is shorter than this, in standard errors.
_SHORT = 1e-3
#: A bound is reached within this share of the distance of the bounds.
_AT_BOUND = 1e-9
_MOST_ALTERNATIONS = 50


@dataclass(frozen=True)
class Optimum:
    """Where an optimisation ended."""

    xi1: Array
    xi2: Array
    noise: Array  # (m,) diagonal of R
    cost: float  # (6)
    iterations: int  # Gauss-Newton steps, all alternations together
    alternations: int  # of xi and R
    converged: bool
    reason: str


def optimise(
    problem: Problem, xi1: Array, xi2: Array, noise: Array, *, alone: bool, most_iterations: int = 60
) -> Optimum:
    """Minimum of (6) for fixed noise (m,), from xi1 (n1,) and xi2 (n2,), which are first moved inside the bounds.

    ``alone``: xi2 alone, bounded; xi1 follows by least squares and is not kept in its bounds, (20). Otherwise all
    unknowns within both bounds. Raises InputError where the model is not finite at the start.
    """
    at = _Point.of(problem, xi1, xi2, noise, alone)
    if not np.isfinite(at.squares):
        raise InputError("the model is not finite at the start: begin elsewhere")
    damping, iterations, reason = 1e-4, 0, ""
    while not reason:
        root, right, low, high = _linearised(problem, at, noise, alone)
        step = _bounded_step(root, right, low, high, 0.0)
        if _explained(root, right, step) <= _SHORT**2:
            reason = "converged"
        elif iterations == most_iterations:
            reason = f"not converged in {iterations} iterations"
        else:
            iterations += 1
            new, damping = _damped_descent(problem, at, (root, right, low, high), damping, noise, alone)
            reason = "converged to the accuracy of the cost" if new is None else ""
            at = at if new is None else new
    converged = not reason.startswith("not")
    return Optimum(at.xi1, at.xi2, noise, _cost(problem, at, noise), iterations, 0, converged, reason)


def alternate(
    problem: Problem,
    xi1: Array,
    xi2: Array,
    *,
    alone: bool,
    tolerance: float = 0.05,
    progress: Callable[[int], None] | None = None,
) -> Optimum:
    """xi and R in turn until no diagonal element of R changes by more than ``tolerance`` of itself, (26).

    R begins with the residuals of the start. What is returned has R of its own residuals, and for xi2 alone xi1 by
    (27) with that R.
    """
    xi1, xi2 = _inside(problem, xi1, xi2, alone)
    noise, steps = residual_noise(problem, xi1, xi2), 0
    for turn in range(1, _MOST_ALTERNATIONS + 1):
        found = optimise(problem, xi1, xi2, noise, alone=alone)
        xi1, xi2, steps = found.xi1, found.xi2, steps + found.iterations
        new = residual_noise(problem, xi1, xi2)
        settled = bool(np.all(np.abs(new - noise) <= tolerance * noise))
        noise = new
        if progress is not None:
            progress(turn)
        if settled:
            break
    at = _Point.of(problem, xi1, xi2, noise, alone)
    converged = found.converged and settled
    reason = found.reason if settled else f"R still changes after {turn} alternations"
    return Optimum(at.xi1, xi2, noise, _cost(problem, at, noise), steps, turn, converged, reason)


def residual_noise(problem: Problem, xi1: Array, xi2: Array) -> Array:
    """Diagonal of R (m,): mean squares of the residuals, the minimum of (6) over R."""
    a, b = problem.evaluate(xi2)
    least = _LEAST_NOISE * np.mean(problem.kept**2, axis=0) + np.finfo(float).tiny
    return np.maximum(np.mean((problem.kept - b - a @ xi1) ** 2, axis=0), least)


def at_bound(problem: Problem, xi1: Array, xi2: Array) -> Mask:
    """(n1 + n2,) whether an unknown stands at one of its bounds, or beyond."""
    low, high = problem.bounds.T
    xi = np.concatenate([xi1, xi2])
    near = _AT_BOUND * np.where(np.isfinite(high - low), high - low, 0.0)
    return np.asarray((xi <= low + near) | (xi >= high - near))


@dataclass(frozen=True)
class _Point:
    """An iterate with its matrix A, residual and sum of whitened squares."""

    xi1: Array
    xi2: Array
    a: Array
    residual: Array
    squares: float

    @classmethod
    def of(cls, problem: Problem, xi1: Array, xi2: Array, noise: Array, alone: bool) -> _Point:
        xi1, xi2 = _inside(problem, xi1, xi2, alone)
        with np.errstate(all="ignore"):
            a, b = problem.evaluate(xi2)
            if alone and np.all(np.isfinite(a)) and np.all(np.isfinite(b)):
                xi1 = linear_stage(a, problem.kept - b, noise).xi1
            residual = problem.kept - b - a @ xi1
            squares = float(np.sum(np.sum(residual**2, axis=0) / noise))
        return cls(xi1, xi2, a, residual, squares if np.isfinite(squares) else np.inf)


def _cost(problem: Problem, at: _Point, noise: Array) -> float:
    return 0.5 * at.squares + 0.5 * len(problem.kept) * float(np.sum(np.log(noise)))


def _inside(problem: Problem, xi1: Array, xi2: Array, alone: bool) -> tuple[Array, Array]:
    xi2 = np.clip(xi2, *problem.bounds2.T)
    return (xi1 if alone else np.clip(xi1, *problem.bounds1.T)), xi2


def _linearised(problem: Problem, at: _Point, noise: Array, alone: bool) -> tuple[Array, Array, Array, Array]:
    """Triangle and right side of the step, and how far each unknown of the step may go down and up."""
    t = triangle([at.a, problem.slopes(at.xi1, at.xi2), at.residual[:, :, None]], noise)
    first, last = (problem.n1 if alone else 0), problem.n1 + problem.n2
    xi = np.concatenate([at.xi1, at.xi2])[first:]
    low, high = problem.bounds[first:].T
    return t[first:last, first:last], t[first:last, last], low - xi, high - xi


def _bounded_step(root: Array, right: Array, low: Array, high: Array, damping: float) -> Array:
    """Least squares of root d = right, damped in units of the columns, low <= d <= high."""
    from scipy.optimize import lsq_linear  # here: 0.4 s that every other use of a calibration does not need

    scale = np.sqrt(np.einsum("ij,ij->j", root, root))
    scale[~(scale > 0.0)] = 1.0
    matrix, values = root / scale, right
    if damping > 0.0:
        matrix = np.concatenate([matrix, np.sqrt(damping) * np.eye(len(scale))])
        values = np.concatenate([values, np.zeros(len(scale))])
    found: Any = lsq_linear(matrix, values, (low * scale, high * scale), method="bvls")
    return np.clip(found.x / scale, low, high)


def _explained(root: Array, right: Array, step: Array) -> float:
    """By how much the step lowers the sum of whitened squares, if the model were linear."""
    left = right - root @ step
    return float(right @ right - left @ left)


def _damped_descent(
    problem: Problem, at: _Point, linear: tuple[Array, Array, Array, Array], damping: float, noise: Array, alone: bool
) -> tuple[_Point | None, float]:
    """A point of lower cost and the damping for the next step; None if there is none."""
    root, right, low, high = linear
    for _ in range(25):
        step = _bounded_step(root, right, low, high, damping)
        d1, d2 = (np.zeros(problem.n1), step) if alone else (step[: problem.n1], step[problem.n1 :])
        new = _Point.of(problem, at.xi1 + d1, at.xi2 + d2, noise, alone)
        promised = _explained(root, right, step)
        if new.squares < at.squares:
            kept = at.squares - new.squares > 0.25 * promised
            return new, (0.1 * damping if kept else 4.0 * damping)
        if promised <= 1e-14 * at.squares:
            break
        damping *= 10.0
    return None, damping


def within_bounds(problem: Problem, optimum: Optimum) -> bool:
    """Whether xi1 of an optimum of xi2 alone stayed within its bounds, see (20)."""
    low, high = problem.bounds1.T
    return bool(np.all((optimum.xi1 >= low) & (optimum.xi1 <= high)))
