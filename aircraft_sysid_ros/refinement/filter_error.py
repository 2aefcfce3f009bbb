"""Filter error on the flight model: maximum likelihood of the innovations of its Kalman filter.

Estimated jointly: coefficients, IMU biases, random walks of the wind (gusts) and of the rates, and the noise of each
group of outputs. Derivatives of innovations and variances by forward differences of a bank of filters, through gain
and covariance. Noise levels, as logarithms, have a weak prior about their start, so that a level which the flight
shows to be nothing stays finite.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.maximum_likelihood import (
    Expansion,
    Minimum,
    fisher_information,
    minimise,
    negative_log_likelihood,
    score,
)
from aircraft_sysid_ros.flight_model.bank import filter_bank
from aircraft_sysid_ros.refinement.record import FlightRecord
from aircraft_sysid_ros.refinement.segments import Segment

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Uncertainty of velocity, position, attitude, rates and wind of the reference motion where a filter begins.
_START_STD = np.repeat([0.5, 2.0, 0.05, 0.05, 1.0], 3)
#: One standard deviation of the prior of the logarithm of a noise level.
_LEVEL_STD = 3.0


@dataclass(frozen=True)
class FilterModel:
    """Cost and expansion of (5.7) for the active numbers of theta."""

    record: FlightRecord
    segments: list[Segment]
    theta: Array  # (parameters,) the start
    active: Mask
    levels: Mask  # which of the active are logarithms of noise levels
    steps: Array
    latest: dict[str, list[Array]] = field(default_factory=dict)  # gradient terms of the newest expansion

    def whole(self, theta: Array) -> Array:
        """All of theta from its active numbers."""
        out = self.theta.copy()
        out[self.active] = theta
        return out

    def cost(self, theta: Array) -> float:
        """V and the prior."""
        found = self._side_by_side(lambda segment: self.innovations(segment, self.whole(theta)[None]))
        return sum(negative_log_likelihood(e[0], s[0]) for e, s in found) + self._prior(theta)

    def expand(self, theta: Array) -> Expansion:
        """V, its gradient (5.10) and the Fisher information, and the prior."""
        cost, gradient, information = self._prior(theta), np.zeros(len(theta)), np.zeros((len(theta),) * 2)
        scores = []
        for segment in self.segments:
            e, s, by_e, by_s = self._differences(segment, theta)
            cost += negative_log_likelihood(e, s)
            scores.append(score(e, s, by_e, by_s))
            gradient += scores[-1].sum(axis=0)
            information += fisher_information(s, by_e, by_s)
        self.latest["scores"] = scores
        weight = self.levels[self.active] / _LEVEL_STD**2
        gradient += weight * (theta - self.theta[self.active])
        return Expansion(cost, gradient, information + np.diag(weight))

    def innovations(self, segment: Segment, thetas: Array) -> tuple[Array, Array]:
        """Decorrelated innovations and variances, each (M, N, 18), of one segment."""
        record, part = self.record, segment.part
        start, covariance = record.states[part.start], np.diag(np.square(_START_STD))
        times, inputs, y = record.time[part], record.inputs[part], record.outputs[part]
        e, s = filter_bank(start, covariance, times, inputs, y, thetas, record.model)
        if not np.all(np.isfinite(e[:, np.isfinite(y)])):
            raise np.linalg.LinAlgError("the filter diverges with these parameters")
        return e, s

    def _differences(self, segment: Segment, theta: Array) -> tuple[Array, Array, Array, Array]:
        moved = np.flatnonzero(self.active)
        thetas = np.tile(self.whole(theta), (1 + len(moved), 1))
        for i, j in enumerate(moved):
            thetas[1 + i, j] += self.steps[j]
        e, s = self.innovations(segment, thetas)
        steps = self.steps[moved][:, None, None]
        return e[0], s[0], (e[1:] - e[0]) / steps, (s[1:] - s[0]) / steps

    def _prior(self, theta: Array) -> float:
        from_start = (theta - self.theta[self.active])[self.levels[self.active]]
        return 0.5 * float(np.sum(np.square(from_start / _LEVEL_STD)))

    def _side_by_side(self, work: Callable[[Segment], tuple[Array, Array]]) -> list[tuple[Array, Array]]:
        with ThreadPoolExecutor() as pool:
            return list(pool.map(work, self.segments))


def filter_error_fit(
    model: FilterModel, maximum_iterations: int, progress: Callable[[int, float], None] | None = None
) -> tuple[Minimum, list[Array]]:
    """Fit of the active numbers from their start by Gauss-Newton, and gradient terms (N, n) of each segment.

    The noise levels are found first, alone: they are what is known least, and a bank of few filters is quick.
    """
    alone = replace(model, active=model.active & model.levels)
    levels = minimise(alone.cost, alone.expand, model.theta[alone.active], tolerance=0.5, longest_step=100.0,
                      maximum_iterations=min(maximum_iterations, 10))  # fmt: skip
    start = model.whole(model.theta[model.active])
    start[alone.active] = levels.theta
    found = minimise(
        model.cost, model.expand, start[model.active],
        tolerance=0.05, maximum_iterations=maximum_iterations, longest_step=100.0, progress=progress,
    )  # fmt: skip
    return found, model.latest["scores"]
