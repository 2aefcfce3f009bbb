"""The two benchmarks of the two-stage paper (docs/references.md), section III: one stage, and Haupt-Kasdin's two."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from aircraft_sysid_ros.estimation.least_squares import central_differences
from aircraft_sysid_ros.estimation.two_stage.covariance import cost_gradient
from aircraft_sysid_ros.estimation.two_stage.linear import triangle
from aircraft_sysid_ros.estimation.two_stage.optimisation import Optimum, alternate, residual_noise
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

Array = npt.NDArray[np.float64]


def nonlinear_programming(
    problem: Problem, xi1: Array, xi2: Array, method: Literal["gauss-newton", "sqp"] = "gauss-newton"
) -> Optimum:
    """Benchmark 1: all unknowns at once from a start that nobody chose, with R in turn until (26).

    ``gauss-newton`` is the optimiser of stage 2, so that only the start differs; ``sqp`` is sequential quadratic
    programming with a quasi-Newton Hessian, like the fmincon of the paper.
    """
    if method == "gauss-newton":
        return alternate(problem, xi1, xi2, alone=False)
    start = np.clip(np.concatenate([xi1, xi2]), *problem.bounds.T)
    noise = residual_noise(problem, *np.split(start, [problem.n1]))
    steps, settled, turn = 0, False, 0
    while not settled and turn < 50:
        found = _sequential_quadratic(problem, start, noise)
        start, steps, turn = found.x, steps + int(found.nit), turn + 1
        new = residual_noise(problem, *np.split(start, [problem.n1]))
        settled, noise = bool(np.all(np.abs(new - noise) <= 0.05 * noise)), new
    one, two = np.split(start, [problem.n1])
    cost = _cost(problem, start, noise) + 0.5 * len(problem.kept) * float(np.sum(np.log(noise)))
    return Optimum(one, two, noise, cost, steps, turn, settled and bool(found.success), str(found.message))


def _cost(problem: Problem, xi: Array, noise: Array) -> float:
    a, b = problem.evaluate(xi[problem.n1 :])
    return float(0.5 * np.sum((problem.kept - b - a @ xi[: problem.n1]) ** 2 / noise))


def _sequential_quadratic(problem: Problem, start: Array, noise: Array):  # type: ignore[no-untyped-def]
    n1 = problem.n1
    return minimize(
        lambda xi: _cost(problem, xi, noise), start, method="SLSQP", bounds=problem.bounds,
        jac=lambda xi: cost_gradient(problem, xi[:n1], xi[n1:], noise), options={"maxiter": 400, "ftol": 1e-8},
    )  # fmt: skip


@dataclass(frozen=True)
class TwoSteps:
    """Result of the Haupt-Kasdin estimator."""

    xi: Array
    y: Array  # first-step states, of minimum norm where H does not tell them
    rank: int  # of H
    cost: float  # (32)


def haupt_kasdin(
    rows: Array,
    measured: Array,
    change: Callable[[Array], Array],
    start: Array,
) -> TwoSteps:
    """Benchmark 2, (28)-(32): z = H y + v linear in new states y = f(xi), then xi from y-hat, both by least squares.

    rows: H (N, c); measured: z (N,); change: f, xi (n,) to y (c,); start of the second step. That minimises

        (y-hat - f(xi))' P^-1 (y-hat - f(xi)),   P^-1 = H' R^-1 H,                                              (32)

    by BFGS without bounds, as fminunc does. For example 1 the columns of H in (28) are [cos, -sin, 1, cos, -sin]: the
    first two equal the last two (the paper says third and fourth), H has rank 3 whatever N is, and P does not exist.
    P^-1 does, and (32) with it is the cost of the original problem. The scan's (31), (32) do not say which was used.
    """
    factor = triangle([rows[:, None, :], measured[:, None, None]], np.ones(1))
    c = rows.shape[1]
    root, right = factor[:c, :c], factor[:c, c]
    y, _, rank, _ = np.linalg.lstsq(root, right, rcond=1e-10)
    variance = float(factor[c, c] ** 2) / max(len(rows) - int(rank), 1)
    root = root / np.sqrt(variance)
    gradient = lambda xi: -2.0 * (root @ central_differences(change, xi)).T @ (root @ (y - change(xi)))  # noqa: E731
    found = minimize(lambda xi: float(np.sum((root @ (y - change(xi))) ** 2)), start, jac=gradient, method="BFGS")
    return TwoSteps(np.asarray(found.x), np.asarray(y, np.float64), int(rank), float(found.fun))
