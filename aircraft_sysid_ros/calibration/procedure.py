"""From a problem of a calibration to its answer: both stages, what the flight does not tell, and standard errors.

Stage 1 of the two-stage paper runs on the samples of its own segments, stage 2 on all. A parameter whose standard error
is larger than half the range in which it is sought was not excited: it is taken as nominal, one after the other from
the least determined, and the rest is estimated again. What is left is determined, and says that it rests on the
nominal value of the others.

Least squares takes A and b as exact. Where they hold noise of the sensor, as the pressures of a probe do, scales come
out too small by the share of the noise in what they scale. The last step then solves the instrumental form

    sum_k h_k' R^-1 [z_k - A_k xi1 - b_k] = 0

with instruments h_k, the derivative of A xi1 + b by all unknowns at what the sensor would show without noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.calibration.standard_errors import (
    AttitudeErrors,
    Errors,
    by_the_others,
    embedded,
    jackknife,
    standard_errors,
    undetermined,
)
from aircraft_sysid_ros.estimation.two_stage.conditions import Conditions
from aircraft_sysid_ros.estimation.two_stage.decision import Decision, decide
from aircraft_sysid_ros.estimation.two_stage.estimate import second_stage
from aircraft_sysid_ros.estimation.two_stage.optimisation import at_bound, residual_noise
from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import (
    Progress,
    ResidualSamples,
    candidates,
    sample_residuals,
)
from aircraft_sysid_ros.estimation.two_stage.sampling import Prior
from aircraft_sysid_ros.rounding import with_error

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]

#: Samples of xi2 in stage 1, as in the paper.
SAMPLES = 500
#: Steps of the instrumental form: it begins within some standard errors of its answer.
_INSTRUMENTAL_STEPS = 4


@dataclass(frozen=True)
class Task:
    """A problem with K samples and n unknowns, xi1 first, and what else its answer rests on."""

    problem: Problem
    piece: Integers  # (K,): rows of another piece are not correlated
    nominal: Array  # (n,) values of unknowns that are not excited
    first: Mask | None = None  # (K,) samples of stage 1, all if None
    keep: tuple[str, ...] = ()  # names that are never taken as nominal
    instruments: Callable[[Array], Array] | None = None  # xi (n,) to h (K, m, n)
    attitude: Callable[[Array], AttitudeErrors] | None = None  # of xi (n,)
    by_piece: bool = False  # residuals are correlated over whole pieces
    conditions: Conditions = field(default_factory=Conditions)  # (17), (18)
    prior: Prior = field(default_factory=Prior)  # of xi2
    usual: Array | None = None  # (n,) how far unknowns of sensors as they are lie from nominal, one sigma

    def errors(self, xi: Array, noise: Array, free: Mask) -> Errors:
        """Standard errors at xi (n,) with R (m,), ``free`` (n,) being estimated and the others as usual."""
        xi1, xi2 = np.split(xi, [self.problem.n1])
        rows = None if self.instruments is None else self.instruments(xi)
        if self.by_piece:
            found = jackknife(self.problem, xi1, xi2, noise, self.piece, free)
        else:
            attitude = None if self.attitude is None else self.attitude(xi)
            found = standard_errors(self.problem, xi1, xi2, noise, self.piece, free, rows, attitude)
        if self.usual is None or free.all():
            return found
        moved = by_the_others(self.problem, xi1, xi2, noise, free, rows) * self.usual[~free]
        return replace(found, coloured=found.coloured + embedded(moved @ moved.T, free))


@dataclass(frozen=True)
class Answer:
    """All unknowns of a task; what is not determined has its nominal value and infinite std."""

    task: Task
    xi: Array  # (n,)
    errors: Errors
    determined: Mask  # (n,)
    at_bound: Mask  # (n,)
    noise: Array  # (m,) diagonal of R
    samples: ResidualSamples
    decision: Decision
    alone: bool  # stage 2 estimated xi2 alone
    converged: bool
    convergence: str
    refused: Mapping[str, str] = field(default_factory=dict)  # why a name that was estimated is taken as nominal

    @property
    def problem(self) -> Problem:
        """The problem of all unknowns."""
        return self.task.problem

    @property
    def std(self) -> Array:
        """Standard errors (n,), infinite for what is not determined."""
        return np.where(self.determined, self.errors.std, np.inf)

    @property
    def values(self) -> dict[str, float]:
        """Estimate by name."""
        return dict(zip(self.problem.names, map(float, self.xi), strict=True))

    @property
    def vague(self) -> tuple[str, ...]:
        """Names that were estimated though the flight does not tell them: the last of a set, which is always free."""
        bad = undetermined(self.problem, self.errors.std) & self.determined
        return tuple(n for n, out in zip(self.problem.names, bad, strict=True) if out and n not in self.task.keep)

    def without(self, refused: Mapping[str, str]) -> Answer:
        """The answer with some names as nominal, not determined, and in words why: what was found of them is wrong."""
        out = np.array([name in refused for name in self.problem.names]) & self.determined
        told = {
            name: f"{refused[name]} ({with_error(value, std)}): taken as {nominal:.4g}"
            for name, value, std, nominal, there in zip(
                self.problem.names, self.xi, self.std, self.task.nominal, out, strict=True
            )
            if there
        }
        return replace(
            self, xi=np.where(out, self.task.nominal, self.xi), determined=self.determined & ~out,
            at_bound=self.at_bound & ~out, refused=told,
        )  # fmt: skip

    def residuals(self, xi: Array | None = None) -> Array:
        """z - A xi1 - b (K, m) at the answer, or at other unknowns."""
        return residuals(self.problem, self.xi if xi is None else xi)

    def parameters(
        self, names: tuple[str, ...], units: Mapping[str, str], excited_by: Mapping[str, str]
    ) -> list[dict[str, Any]]:
        """What a table shows of each parameter."""
        white, rows = np.sqrt(np.diag(self.errors.white)), []
        for i, name in enumerate(self.problem.names):
            if name in names:
                there = bool(self.determined[i])
                unknown = "" if there else f"not excited, taken as {self.xi[i]:.4g}: fly {excited_by[name]}"
                reason = self.refused.get(name, unknown)
                if there and self.at_bound[i]:
                    reason = "at its bound: the standard error means nothing"
                rows.append({
                    "name": name, "value": float(self.xi[i]), "unit": units.get(name, ""),
                    "std": float(self.std[i]), "std_white": float(white[i]) if there else float("inf"),
                    "determined": there, "reason": reason,
                })  # fmt: skip
        return rows


def residuals(problem: Problem, xi: Array) -> Array:
    """z - A xi1 - b (K, m)."""
    xi1, xi2 = np.split(xi, [problem.n1])
    a, b = problem.evaluate(xi2)
    return np.asarray(problem.kept - b - a @ xi1)


def solve(task: Task, samples: int | Array = SAMPLES, seed: int = 0, progress: Progress | None = None) -> Answer:
    """Both stages, the instrumental step where there are instruments, and the standard errors.

    samples: number of samples of xi2 for stage 1, or the samples (S, n2) themselves. Raises InputError where there is
    no answer.
    """
    free, answer = np.ones(len(task.nominal), dtype=bool), None
    while answer is None or not np.array_equal(free, answer.determined):
        answer = _two_stages(task, free, samples, seed, progress)
        if task.instruments is not None:
            answer = refined(answer)
        free = _excited(answer)
    return answer


def refined(answer: Answer) -> Answer:
    """The answer of the instrumental form, by Gauss-Newton steps from that of least squares, bounds kept."""
    task, problem, free, xi = answer.task, answer.problem, answer.determined, answer.xi
    assert task.instruments is not None
    for _ in range(_INSTRUMENTAL_STEPS):
        xi1, xi2 = np.split(xi, [problem.n1])
        root = np.sqrt(residual_noise(problem, xi1, xi2))
        a, _ = problem.evaluate(xi2)
        slopes = np.concatenate([a, problem.slopes(xi1, xi2)], axis=2)
        both = (slopes, task.instruments(xi))
        rows, h = ((part / root[:, None])[:, :, free].reshape(-1, int(free.sum())) for part in both)
        xi = xi.copy()
        xi[free] += np.linalg.solve(h.T @ rows, h.T @ (residuals(problem, xi) / root).ravel())
        xi = np.where(free, np.clip(xi, *problem.bounds.T), xi)
    xi1, xi2 = np.split(xi, [problem.n1])
    noise = residual_noise(problem, xi1, xi2)
    errors = task.errors(xi, noise, free)
    return replace(answer, xi=xi, noise=noise, errors=errors, at_bound=at_bound(problem, xi1, xi2) & free)


def _excited(answer: Answer) -> Mask:
    """(n,) what is determined when the least determined are taken as nominal, one after the other."""
    task, problem, free = answer.task, answer.problem, answer.determined.copy()
    kept = np.array([name in task.keep for name in problem.names])
    half = 0.5 * (problem.bounds[:, 1] - problem.bounds[:, 0])
    while True:
        std = task.errors(answer.xi, answer.noise, free).std
        bad = undetermined(problem, std) & free & ~kept
        last = free.copy()
        last[np.argmax(np.where(bad, std / half, -np.inf))] = False
        if not bad.any() or not (last[: problem.n1].any() and last[problem.n1 :].any()):
            return free
        free = last


def _two_stages(task: Task, free: Mask, samples: int | Array, seed: int, progress: Progress | None) -> Answer:
    problem = reduced_problem(task.problem, task.nominal, free)
    stage1 = problem if task.first is None or task.first.all() else replace(problem, usable=task.first)
    drawn = _drawn(task, problem, free[task.problem.n1 :], samples, seed)
    judged, chosen = candidates(stage1, sample_residuals(stage1, drawn, progress), task.conditions)
    decision = decide(stage1, judged, chosen)
    told = None if progress is None else lambda turn: progress("stage 2", turn, 0)
    best, alone, _ = second_stage(problem, decision, told)
    xi, bound = task.nominal.copy(), np.zeros(len(free), dtype=bool)
    xi[free] = np.concatenate([best.xi1, best.xi2])
    bound[free] = at_bound(problem, best.xi1, best.xi2)
    errors = task.errors(xi, best.noise, free)
    return Answer(task, xi, errors, free, bound, best.noise, judged, decision, alone, best.converged, best.reason)


def _drawn(task: Task, problem: Problem, free2: Mask, samples: int | Array, seed: int) -> Array:
    """Samples of the free unknowns of xi2 from the prior of all."""
    if not isinstance(samples, int):
        return samples[:, free2]
    prior = task.prior
    if prior.mean is not None and prior.std is not None:
        prior = replace(prior, mean=prior.mean[free2], std=prior.std[free2])
    return prior.samples(problem.bounds2, samples, seed)


def reduced_problem(problem: Problem, nominal: Array, free: Mask) -> Problem:
    """The problem of the free unknowns, the others at their nominal values (n,)."""
    if free.all():
        return problem
    one, two = free[: problem.n1], free[problem.n1 :]
    known1, nominal2 = np.where(one, 0.0, nominal[: problem.n1]), nominal[problem.n1 :]

    def full(xi2: Array) -> Array:
        out = nominal2.copy()
        out[two] = xi2
        return out

    def model(xi2: Array) -> tuple[Array, Array]:
        a, b = problem.model(full(xi2))
        return a[:, :, one], b + a @ known1

    def gradient(xi2: Array) -> tuple[Array, Array]:
        assert problem.gradient is not None
        da, db = problem.gradient(full(xi2))
        return da[:, :, one][..., two], db[..., two] + np.einsum("kmij,i->kmj", da[..., two], known1)

    return Problem(
        problem.measured, model,
        tuple(name for name, there in zip(problem.names1, one, strict=True) if there),
        tuple(name for name, there in zip(problem.names2, two, strict=True) if there),
        problem.bounds1[one], problem.bounds2[two],
        gradient=None if problem.gradient is None else gradient, usable=problem.usable,
    )  # fmt: skip
