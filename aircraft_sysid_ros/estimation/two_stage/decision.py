"""Step 4 of section II.C of the two-stage paper (docs/references.md): has Tr R one clear minimum?

The paper looks at its figures. Here the candidates of stage 1 are followed downhill, xi2 alone with R = I, and the
minimum is unique and clear if

- all that reach nearly the lowest Tr R end at the same place,
- it stands inside the bounds of xi2, and xi1 there inside its own: else the order of the two minimisations in (20)
  matters,
- no direction is flat: half the range of the samples changes Tr R noticeably (figure 6 is flat).

A sample that the conditions rejected, but which is lower than all that the candidates reach, is followed too.
"Nearly" and "noticeably" are the 5 % within which (26) holds R to be the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.two_stage.linear import triangle
from aircraft_sysid_ros.estimation.two_stage.optimisation import at_bound, optimise, residual_noise
from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import ResidualSamples, side_by_side

Array = npt.NDArray[np.float64]

#: Relative change of Tr R that counts, as in (26).
NOTICEABLE = 0.05
#: Two ends are the same place if they are nearer than this share of the range, in every unknown.
_SAME_PLACE = 0.02


@dataclass(frozen=True)
class TraceMinimum:
    """A local minimum of Tr R."""

    xi1: Array
    xi2: Array
    trace: float


@dataclass(frozen=True)
class Decision:
    """Whether stage 2 needs xi2 only, and why."""

    unique: bool
    reason: str
    minima: tuple[TraceMinimum, ...]  # distinct, within 5 % of the lowest Tr R, lowest first


def decide(problem: Problem, samples: ResidualSamples, candidates: list[int]) -> Decision:
    """The decision from candidates, indices of samples."""
    ends = list(side_by_side(lambda i: _followed(problem, samples, i), candidates))
    lowest = int(np.argmin(samples.trace))
    rejected = samples.trace[lowest] < min(end.trace for end in ends)
    if rejected:
        ends.append(_followed(problem, samples, lowest))
    ends.sort(key=lambda end: end.trace)
    near = [end for end in ends if end.trace <= (1.0 + NOTICEABLE) * ends[0].trace]
    distinct: list[TraceMinimum] = []
    for end in near:
        if all(np.any(np.abs(end.xi2 - other.xi2) > _SAME_PLACE * samples.spread) for other in distinct):
            distinct.append(end)
    best = distinct[0]
    change, name = flattest(problem, best, samples.spread)
    outside = at_bound(problem, best.xi1, best.xi2)
    unique = False
    if change < NOTICEABLE:
        reason = f"flat: half the range of the samples, mostly of {name}, changes Tr R by {100 * change:.2g} % only"
    elif len(distinct) > 1:
        apart = np.abs(distinct[1].xi2 - best.xi2) / samples.spread
        name = problem.names2[int(np.argmax(apart))]
        reason = f"{len(distinct)} minima of nearly equal Tr R, {apart.max():.2g} half ranges of {name} apart"
    elif np.any(outside):
        names = ", ".join(n for n, out in zip(problem.names, outside, strict=True) if out)
        reason = f"the minimum stands at or beyond the bounds of {names}"
    else:
        share = f"{100 * change:.2g} %" if change < 1.0 else f"{100 * change:.0f} %"
        alone = "the samples have one hollow" if len(samples.trace) > 1 else "it was followed from one start"
        reached = f"{len(near)} of {len(ends)} starts reach it" if len(ends) > 1 else alone
        reason = f"one clear minimum of Tr R: {reached}, and half the range changes it by {share} or more"
        unique = True
    if rejected:
        reason += "; only a sample that was rejected led there"
    return Decision(unique, reason, tuple(distinct))


def flattest(problem: Problem, minimum: TraceMinimum, spread: Array) -> tuple[float, str]:
    """Least relative change of Tr R over half the range (n2,), and the unknown that has most part in that direction.

    From the curvature at the minimum, with xi1 following.
    """
    a, _ = problem.evaluate(minimum.xi2)
    noise = _even_noise(problem, minimum.xi1, minimum.xi2)
    t = triangle([a, problem.slopes(minimum.xi1, minimum.xi2)], noise)[problem.n1 :, problem.n1 :] * spread
    _, s, vt = np.linalg.svd(t)
    return float(s[-1] ** 2 / problem.kept.size), problem.names2[int(np.argmax(np.abs(vt[-1])))]


def _followed(problem: Problem, samples: ResidualSamples, i: int) -> TraceMinimum:
    """Minimum that is reached from a sample."""
    noise = _even_noise(problem, samples.xi1[i], samples.xi2[i])
    found = optimise(problem, samples.xi1[i], samples.xi2[i], noise, alone=True)
    return TraceMinimum(found.xi1, found.xi2, float(np.sum(residual_noise(problem, found.xi1, found.xi2))))


def _even_noise(problem: Problem, xi1: Array, xi2: Array) -> Array:
    """R = I times the mean of the residuals' squares: the minimum of I, steps in standard errors."""
    noise = residual_noise(problem, xi1, xi2)
    return np.full(len(noise), np.mean(noise))
