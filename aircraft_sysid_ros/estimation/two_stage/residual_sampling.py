"""First stage of the two-stage paper (docs/references.md): steps 2 and 3 of section II.C.

For every sample of xi2: xi1 by linear least squares with R = I, its residuals v, and

    Tr R(xi2) = 1/N sum_k v_k' v_k                                                                              (19)

(printed without the 1/N, which figure 2 has). Outputs of different units should be scaled before.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.conditions import Conditions, Verdict, judge
from aircraft_sysid_ros.estimation.two_stage.linear import linear_stage
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

Array = npt.NDArray[np.float64]
Progress = Callable[[str, int, int], None]
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

#: So many accepted samples, lowest first and each in a hollow of its own, are candidates for the minimum.
_CANDIDATES = 5


class NoMinimumError(InputError):
    """No sample may be the minimum: the unknowns cannot be told apart, or bounds and conditions do not fit."""


@dataclass(frozen=True)
class ResidualSamples:
    """The samples and what was found at each."""

    xi2: Array  # (S, n2)
    xi1: Array  # (S, n1), NaN where there is none
    trace: Array  # (S,) Tr R, infinite where there is none
    verdict: npt.NDArray[np.int64]  # (S,) of Verdict

    @property
    def reach(self) -> Array:
        """(n2,) half the distance between neighbours if the samples were a grid: l2 of (17)."""
        return np.asarray(self.spread * len(self.xi2) ** (-1.0 / self.xi2.shape[1]))

    @property
    def spread(self) -> Array:
        """(n2,) half the range that the samples cover, 1 where they are all the same."""
        half = 0.5 * np.ptp(self.xi2, axis=0)
        return np.where(half > 0.0, half, 1.0)

    def count(self, verdict: Verdict) -> int:
        """Number of samples with a verdict."""
        return int(np.sum(self.verdict == verdict))


def sample_residuals(problem: Problem, xi2: Array, progress: Progress | None = None) -> ResidualSamples:
    """xi1 and Tr R of every sample (S, n2), not judged yet. Raises InputError where no sample has a solution."""
    count, ones = len(xi2), np.ones(problem.kept.shape[1])
    out = ResidualSamples(xi2, np.full((count, problem.n1), np.nan), np.full(count, np.inf), np.zeros(count, np.int64))
    vague = np.zeros(problem.n1, bool)

    def solve(i: int) -> None:
        with np.errstate(all="ignore"):
            a, b = problem.evaluate(xi2[i])
        if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
            out.verdict[i] = Verdict.NOT_FINITE
            return
        found = linear_stage(a, problem.kept - b, ones)
        if not np.all(found.determined):
            out.verdict[i] = Verdict.DEFICIENT
            vague[~found.determined] = True
            return
        out.xi1[i], out.trace[i] = found.xi1, found.squares / len(problem.kept)

    for done, _ in enumerate(side_by_side(solve, range(count)), start=1):
        if progress is not None:
            progress("stage 1", done, count)
    if not np.any(np.isfinite(out.trace)):
        raise InputError(_no_solution(problem, out, vague))
    return out


def _no_solution(problem: Problem, samples: ResidualSamples, vague: npt.NDArray[np.bool_]) -> str:
    if samples.count(Verdict.NOT_FINITE) == len(samples.xi2):
        return f"the model is not finite at any of {len(samples.xi2)} samples: check the bounds and the inputs"
    names = ", ".join(name for name, is_vague in zip(problem.names1, vague, strict=True) if is_vague)
    return f"the data do not determine {names} at any of {len(samples.xi2)} samples: record motion that separates them"


def candidates(problem: Problem, samples: ResidualSamples, conditions: Conditions) -> tuple[ResidualSamples, list[int]]:
    """Accepted samples that may be the minimum, lowest Tr R first, and the samples with their verdicts.

    They are judged in order of Tr R, first those that are lower than all their neighbours, and only until there are
    enough. Raises NoMinimumError if all fail.
    """
    verdict = samples.verdict.copy()
    hollows = local_minima(samples)
    rest = [i for i in np.argsort(samples.trace, kind="stable") if np.isfinite(samples.trace[i]) and i not in hollows]
    accepted: list[int] = []
    for queue, wanted in ((hollows, _CANDIDATES), (rest, 1)):
        queue = list(queue)
        while queue and len(accepted) < wanted:
            now, queue = queue[: wanted - len(accepted)], queue[wanted - len(accepted) :]
            verdict[now] = list(side_by_side(
                lambda i: judge(problem, samples.xi1[i], samples.xi2[i], samples.reach, conditions), now
            ))  # fmt: skip
            accepted += [i for i in now if verdict[i] == Verdict.ACCEPTED]
    samples = replace(samples, verdict=verdict)
    if not accepted:
        raise NoMinimumError(
            f"all samples were rejected, {samples.count(Verdict.NOT_LINEAR)} as not linear and "
            f"{samples.count(Verdict.NOT_CONVEX)} not convex: take more samples, narrower bounds or weaker conditions"
        )
    return samples, accepted


def local_minima(samples: ResidualSamples) -> list[int]:
    """Samples with a Tr R below that of their nearest neighbours, lowest first; the lowest of all is one."""
    finite = np.flatnonzero(np.isfinite(samples.trace))
    points, trace = samples.xi2[finite] / samples.spread, samples.trace[finite]
    near = min(2 * points.shape[1] + 2, len(finite) - 1)
    order = np.argsort(trace, kind="stable")
    found = []
    for i in order:
        distance = np.sum((points - points[i]) ** 2, axis=1)
        distance[i] = np.inf
        nearest = np.argpartition(distance, near - 1)[:near] if near else np.empty(0, np.int64)
        if np.all(trace[i] <= trace[nearest]):
            found.append(int(finite[i]))
    return found


def side_by_side(work: Callable[[_Item], _Result], items: Sequence[_Item]) -> Iterable[_Result]:
    """Results in the order of the items, from as many threads as there are processors: numpy lets them run."""
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        yield from pool.map(work, items)
