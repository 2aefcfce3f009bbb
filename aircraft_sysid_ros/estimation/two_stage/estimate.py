"""From a problem to its estimate: steps 2 to 5 of section II.C of the two-stage paper (docs/references.md)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.bound import CostBound, cost_bound, lipschitz_constants
from aircraft_sysid_ros.estimation.two_stage.conditions import Conditions, Verdict
from aircraft_sysid_ros.estimation.two_stage.covariance import Covariances, covariances
from aircraft_sysid_ros.estimation.two_stage.decision import Decision, decide
from aircraft_sysid_ros.estimation.two_stage.optimisation import Optimum, alternate, at_bound, within_bounds
from aircraft_sysid_ros.estimation.two_stage.problem import Integers, Mask, Problem
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import (
    Progress,
    ResidualSamples,
    candidates,
    sample_residuals,
)
from aircraft_sysid_ros.estimation.two_stage.sampling import Prior

Array = npt.NDArray[np.float64]
#: L_A and L_b of (13) themselves, or that they are taken from the samples.
Lipschitz = tuple[float, float] | Literal["from samples"]


@dataclass(frozen=True)
class TwoStageEstimate:
    """What the estimator found; unknowns in the order of ``names``, xi1 first, n of them."""

    names: tuple[str, ...]
    xi1: Array
    xi2: Array
    std: Array  # (n,), from ``covariance``; NaN for what the data do not tell
    covariance: Array  # (n, n), by element of the diagonal the larger of H^-1 and, with lags, its coloured form
    covariances: Covariances  # the alternatives
    noise: Array  # (m,) diagonal of R
    noise_std: Array  # (m,)
    at_bound: Mask  # (n,): such an unknown has no meaningful std
    samples: ResidualSamples
    decision: Decision
    bound: CostBound | None  # (7), (13) of the lowest sample, where it was asked for
    alone: bool  # stage 2 estimated xi2 alone; else all unknowns
    reason: str  # why
    cost: float  # (6)
    iterations: int
    alternations: int
    converged: bool
    convergence: str

    @property
    def xi(self) -> Array:
        """All unknowns (n,)."""
        return np.concatenate([self.xi1, self.xi2])

    def json(self) -> dict[str, Any]:
        """Estimate, uncertainty, decision and samples, for a file; numbers that are not known are NaN."""
        rows = zip(self.names, self.xi, self.std, np.sqrt(np.diag(self.covariances.hessian)),
                   np.sqrt(np.diag(self.covariances.coloured)), self.at_bound, strict=True)  # fmt: skip
        return {
            "parameters": [
                {"name": name, "value": float(value), "std": float(std), "std_hessian": float(hessian),
                 "std_coloured": float(coloured), "at_bound": bool(bound)}
                for name, value, std, hessian, coloured, bound in rows
            ],
            "covariance": self.covariance.tolist(),
            "noise_std": np.sqrt(self.noise).tolist(),
            "stage_1": {
                "xi2": self.samples.xi2.tolist(),
                "trace": self.samples.trace.tolist(),
                "verdicts": {v.name.lower(): self.samples.count(v) for v in Verdict},
                "unique_minimum": self.decision.unique,
                "decision": self.decision.reason,
                "bound": None if self.bound is None else asdict(self.bound),
            },
            "stage_2": {
                "estimated": "xi2 alone" if self.alone else "all unknowns",
                "reason": self.reason,
                "cost": self.cost,
                "iterations": self.iterations,
                "alternations": self.alternations,
                "converged": self.converged,
                "hessian_positive": self.covariances.hessian_positive,
                "convergence": self.convergence,
            },
        }  # fmt: skip


def estimate(
    problem: Problem,
    samples: int | Array = 500,
    prior: Prior | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    lags: int = 1,
    conditions: Conditions | None = None,
    piece: Integers | None = None,
    lipschitz: Lipschitz | None = None,
) -> TwoStageEstimate:
    """Both stages.

    samples: how many to draw from ``prior`` (Sobol samples within the bounds if None) with ``seed``, or the samples
    (S, n2) themselves. progress(what, done, of) is told how far it is, of = 0 where nobody knows. Residuals of flight
    data are correlated in time: ``lags`` is over how many rows of the record, those not usable among them, and rows of
    another ``piece`` (N,) are not correlated. lipschitz: L_A and L_b per ``scale2``, with R as estimated, for the bound
    of (13). Raises InputError where the problem has no answer.
    """
    if piece is not None and np.shape(piece) != (len(problem.measured),):
        raise InputError(f"piece must have one number for each of the {len(problem.measured)} measurements")
    drawn = _drawn(problem, samples, prior or Prior(), seed)
    judged, chosen = candidates(problem, sample_residuals(problem, drawn, progress), conditions or Conditions())
    problem.check_gradient(judged.xi2[chosen[0]])
    decision = decide(problem, judged, chosen)
    told = None if progress is None else lambda turn: progress("stage 2", turn, 0)
    found, alone, reason = second_stage(problem, decision, told)
    by_kind = covariances(problem, found.xi1, found.xi2, found.noise, lags, piece)
    covariance = _believed(by_kind, lags)
    return TwoStageEstimate(
        problem.names, found.xi1, found.xi2, np.sqrt(np.diag(covariance)), covariance, by_kind, found.noise,
        found.noise * np.sqrt(2.0 / len(problem.kept)), at_bound(problem, found.xi1, found.xi2), judged, decision,
        _bound(problem, found, judged, lipschitz), alone, reason, found.cost, found.iterations, found.alternations,
        found.converged, found.reason,
    )  # fmt: skip


def _drawn(problem: Problem, samples: int | Array, prior: Prior, seed: int) -> Array:
    if isinstance(samples, int):
        return prior.samples(problem.bounds2, samples, seed)
    given = np.asarray(samples, dtype=np.float64)
    if given.ndim != 2 or given.shape[1] != problem.n2 or not len(given):
        raise InputError(f"samples must be an array (S, {problem.n2}), not of shape {given.shape}")
    low, high = problem.bounds2.T
    if not np.all((given >= low) & (given <= high)):
        raise InputError("some samples are outside the bounds of the second set: move them inside or widen the bounds")
    return given


def second_stage(
    problem: Problem, decision: Decision, progress: Callable[[int], None] | None = None
) -> tuple[Optimum, bool, str]:
    """Step 5: optimum of least cost from the minima of stage 1, whether of xi2 alone, and why."""
    reason = decision.reason
    if decision.unique:
        best = decision.minima[0]
        found = alternate(problem, best.xi1, best.xi2, alone=True, progress=progress)
        if within_bounds(problem, found):
            return found, True, reason
        reason += "; but with the weights of R the first set left its bounds"
    every = [alternate(problem, m.xi1, m.xi2, alone=False, progress=progress) for m in decision.minima]
    return min(every, key=lambda optimum: optimum.cost), False, reason


def _believed(by_kind: Covariances, lags: int) -> Array:
    """H^-1, with the larger variances where residuals are correlated."""
    if lags <= 1:
        return by_kind.hessian
    grown = np.sqrt(np.fmax(np.diag(by_kind.coloured) / np.diag(by_kind.hessian), 1.0))
    return np.asarray(by_kind.hessian * np.outer(grown, grown))


def _bound(problem: Problem, found: Optimum, samples: ResidualSamples, lipschitz: Lipschitz | None) -> CostBound | None:
    """What the lowest sample said of the least cost."""
    if lipschitz is None:
        return None
    if lipschitz == "from samples":
        lipschitz = lipschitz_constants(problem, samples.xi2[np.isfinite(samples.trace)], found.noise)
    lowest = samples.xi2[int(np.argmin(samples.trace))]
    return cost_bound(problem, found.xi1, found.xi2, lowest, found.noise, lipschitz)
