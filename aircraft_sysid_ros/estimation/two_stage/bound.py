"""The bound on the cost of stage 1: (7) to (13) of the two-stage paper (docs/references.md), for fixed R.

With J the sum of squares of (6), 1/2 sum |z - A xi1 - b|^2 in the norm of R^-1, J* its minimum and Jp the minimum over
xi1 at a sample xi2p,

    (max(sqrt(Jp) - sqrt(E), 0))^2 <= J* <= Jp,
    E = 1/2 sum_k (|[A_k(xi2*) - A_k(xi2p)] xi1*| + |b_k(xi2*) - b_k(xi2p)|)^2 <= N/2 (L_A l1 l2 + L_b l2)^2      (13)

with |xi1*| <= l1 and |xi2* - xi2p| <= l2. The paper has Jp - E <= J*, (7), from (8), where the square of |v + w| >=
|v| - |w| loses its mixed term -2 |v||w|: that does not hold in general (a test has a counterexample). Right is the
triangle inequality of the whole residual, sqrt(Jp) <= sqrt(J*) + sqrt(E).

Elements of xi2 have different units; L and l2 are both taken per ``scale2`` of the problem, which (13) allows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.two_stage.linear import linear_stage
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class CostBound:
    """What a sample's cost says of the least cost; costs without the term of |R|, which is the same in all."""

    stage_1: float  # Jp
    optimum: float  # J* as found
    error: float  # E
    error_bound: float  # of (13)
    lower: float  # what J* must exceed by E
    lower_by_constants: float  # what it must exceed by (13): lower still


def cost_bound(
    problem: Problem, xi1: Array, xi2: Array, xi2p: Array, noise: Array, constants: tuple[float, float]
) -> CostBound:
    """The bound at a sample xi2p, for an estimate xi1, xi2 with R (m,), and L_A, L_b given or estimated."""
    (a, b), (ap, bp) = problem.evaluate(xi2), problem.evaluate(xi2p)
    stage_1 = 0.5 * linear_stage(ap, problem.kept - bp, noise).squares
    optimum = 0.5 * float(np.sum((problem.kept - b - a @ xi1) ** 2 / noise))
    error = error_term(problem, xi1, xi2, xi2p, noise)
    l1, l2 = float(np.linalg.norm(xi1)), scaled_distance(problem, xi2, xi2p)
    bound = error_bound(len(problem.kept), *constants, l1, l2)
    return CostBound(stage_1, optimum, error, bound, lower_bound(stage_1, error), lower_bound(stage_1, bound))


def lower_bound(stage_1_cost: float, error: float) -> float:
    """The least that J* can be, from Jp and E or a bound of E."""
    return float(max(np.sqrt(stage_1_cost) - np.sqrt(error), 0.0) ** 2)


def error_term(problem: Problem, xi1: Array, xi2: Array, xi2p: Array, noise: Array) -> float:
    """E of (9) between xi2 and a sample xi2p, with xi1 of the optimum and R (m,)."""
    (a, b), (ap, bp) = problem.evaluate(xi2), problem.evaluate(xi2p)
    change_a, change_b = (np.sqrt(np.sum(rows**2 / noise, axis=1)) for rows in ((a - ap) @ xi1, b - bp))
    return float(0.5 * np.sum((change_a + change_b) ** 2))


def error_bound(count: int, lipschitz_a: float, lipschitz_b: float, l1: float, l2: float) -> float:
    """Right side of (13) for N = count samples."""
    return 0.5 * count * (lipschitz_a * l1 * l2 + lipschitz_b * l2) ** 2


def lipschitz_constants(problem: Problem, samples: Array, noise: Array) -> tuple[float, float]:
    """L_A and L_b as estimated at samples (S, n2): the largest derivatives, Frobenius norms over one k.

    Each is an upper bound at its sample; between the samples the derivatives may be larger, so take them dense.
    """
    of_a, of_b = 0.0, 0.0
    for xi2 in samples:
        da, db = problem.derivatives(xi2)
        da, db = da * problem.scale2, db * problem.scale2
        of_a = max(of_a, float(np.max(np.sum(da**2 / noise[:, None, None], axis=(1, 2, 3)))))
        of_b = max(of_b, float(np.max(np.sum(db**2 / noise[:, None], axis=(1, 2)))))
    return float(np.sqrt(of_a)), float(np.sqrt(of_b))


def scaled_distance(problem: Problem, one: Array, other: Array) -> float:
    """l2 between two xi2, in units of ``scale2``."""
    return float(np.linalg.norm((one - other) / problem.scale2))
