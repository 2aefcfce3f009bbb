"""Conditions (17) and (18) of the two-stage paper (docs/references.md) on a sample of xi2.

(17), that the model is close to linear, reads in the scan without its l2:

    ||dA/dxi2|| l2 / ||A|| <= T1,   ||db/dxi2|| l2 / ||b|| <= T2.

l2 is here how far a sample has to reach, half the distance to the next: within it the optimum may lie. As printed the
second condition rejects a sample at which b happens to vanish, however linear b is; b is therefore measured by z.

(18), that the cost is convex there ("enforces local convergence"), is printed as positive second derivatives of the
elements of A and b, summed. That cannot be: with the sign of all outputs turned round, z to -z, the problem is the
same and the printed condition the opposite. ``cost`` asks what (18) is for: the Hessian of the cost with R = I and xi1
at its least squares is positive. ``printed`` is there for the paper's examples.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.two_stage.covariance import cost_hessian, smallest_scaled_eigenvalue
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

Array = npt.NDArray[np.float64]

_STEP = 1e-4


class Verdict(IntEnum):
    """What became of a sample."""

    NOT_JUDGED = 0  # nothing depends on it: enough samples with a lower Tr R were accepted
    ACCEPTED = 1
    NOT_LINEAR = 2  # fails (17)
    NOT_CONVEX = 3  # fails (18)
    DEFICIENT = 4  # the columns of A cannot be told apart there
    NOT_FINITE = 5  # the model has no value there


@dataclass(frozen=True)
class Conditions:
    """Limits of (17) as shares, infinite to switch off, and the meaning of (18)."""

    t1: float = 1.0
    t2: float = 1.0
    curvature: Literal["cost", "printed", "none"] = "cost"


def judge(problem: Problem, xi1: Array, xi2: Array, reach: Array, conditions: Conditions) -> Verdict:
    """Verdict on one sample with its xi1; reach (n2,) is l2 by element."""
    changes = linear_change(problem, xi2, reach)
    if not (changes[0] <= conditions.t1 and changes[1] <= conditions.t2):
        return Verdict.NOT_LINEAR
    if conditions.curvature == "cost":
        convex = cost_is_convex(problem, xi1, xi2)
    elif conditions.curvature == "printed":
        convex = all(smallest_scaled_eigenvalue(h) > 0.0 for h in summed_curvature(problem, xi2))
    else:
        convex = True
    return Verdict.ACCEPTED if convex else Verdict.NOT_CONVEX


def linear_change(problem: Problem, xi2: Array, reach: Array) -> tuple[float, float]:
    """Left sides of (17), Frobenius norms over all rows."""
    a, _ = problem.evaluate(xi2)
    da, db = problem.derivatives(xi2)
    change_a, change_b = np.linalg.norm(da * reach), np.linalg.norm(db * reach)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(change_a / np.linalg.norm(a)), float(np.nan_to_num(change_b / np.linalg.norm(problem.kept)))


def cost_is_convex(problem: Problem, xi1: Array, xi2: Array) -> bool:
    """Whether the projected cost has a positive Hessian; A has full rank, so it has if that of all unknowns has."""
    return smallest_scaled_eigenvalue(cost_hessian(problem, xi1, xi2, np.ones(problem.kept.shape[1]))) > 0.0


def summed_curvature(problem: Problem, xi2: Array) -> tuple[Array, Array]:
    """(18) as printed: second derivatives (n2, n2) of the sums of all elements of A and of b over all samples."""
    steps = _STEP * problem.scale2
    xi2 = np.clip(xi2, problem.bounds2[:, 0] + steps, problem.bounds2[:, 1] - steps)
    of_a, of_b = np.empty((problem.n2, problem.n2)), np.empty((problem.n2, problem.n2))
    for j, step in enumerate(np.diag(steps)):
        (a1, b1), (a0, b0) = problem.derivatives(xi2 + step), problem.derivatives(xi2 - step)
        of_a[:, j] = np.sum(a1 - a0, axis=(0, 1, 2)) / (2.0 * steps[j])
        of_b[:, j] = np.sum(b1 - b0, axis=(0, 1)) / (2.0 * steps[j])
    return 0.5 * (of_a + of_a.T), 0.5 * (of_b + of_b.T)
