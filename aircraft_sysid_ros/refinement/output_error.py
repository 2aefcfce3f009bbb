"""Output error on the flight model: simulated from the start of each segment, nothing fed back.

Common to all segments: coefficients and IMU biases. Each segment has its own initial state with the wind over it, 15
numbers, as an error from the reference motion. Derivatives by forward differences of simulations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.output_error import Fit, Linearised, estimate, residual_variance
from aircraft_sysid_ros.flight_model.bank import simulation_bank
from aircraft_sysid_ros.flight_model.dynamics import move
from aircraft_sysid_ros.flight_model.layout import ERROR_SIZE
from aircraft_sysid_ros.refinement.record import FlightRecord
from aircraft_sysid_ros.refinement.segments import Segment

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Steps of velocity, position, attitude, rates and wind for differences, and what the start may be wrong by.
_STEPS = np.repeat([1e-3, 1e-2, 1e-4, 1e-4, 1e-3], 3)
_START_STD = np.repeat([2.0, 10.0, 0.2, 0.3, 5.0], 3)
#: Correlation of residuals that the standard errors allow for [s].
_CORRELATION = 3.0
#: Residuals smaller than this share of the noise of the aircraft file are not believed.
_LEAST_NOISE = 0.1


@dataclass(frozen=True)
class SegmentModel:
    """``estimation.output_error.Model`` of a flight; its theta are the active numbers of the whole one."""

    record: FlightRecord
    segments: list[Segment]
    theta: Array  # (parameters,) the start, from which what is not active is taken
    active: Mask
    steps: Array  # (parameters,)

    def residuals(self, theta: Array, nuisances: Array) -> list[Array]:
        """Measured minus simulated outputs (N, 18) of each segment."""
        whole = self.whole(theta)[None]
        return [self._simulate(g, whole, nuisances[g][None])[1][0] for g in range(len(self.segments))]

    def linearise(self, theta: Array, nuisances: Array) -> list[Linearised]:
        """Residuals and derivatives of each segment."""
        whole = self.whole(theta)
        moved = np.flatnonzero(self.active)
        count = 1 + len(moved) + ERROR_SIZE
        thetas = np.tile(whole, (count, 1))
        for i, j in enumerate(moved):
            thetas[1 + i, j] += self.steps[j]
        records = []
        for g in range(len(self.segments)):
            starts = np.tile(nuisances[g], (count, 1))
            starts[1 + len(moved) :] += np.diag(_STEPS)
            simulated, residual = self._simulate(g, thetas, starts)
            slopes = (simulated[1:] - simulated[0]) / np.concatenate([self.steps[moved], _STEPS])[:, None, None]
            records.append(Linearised(residual[0], slopes[: len(moved)], slopes[len(moved) :]))
        return records

    def whole(self, theta: Array) -> Array:
        """All of theta from its active numbers."""
        out = self.theta.copy()
        out[self.active] = theta
        return out

    def _simulate(self, g: int, thetas: Array, starts: Array) -> tuple[Array, Array]:
        part, record = self.segments[g].part, self.record
        states = np.tile(record.states[part.start], (len(starts), 1))
        for state, error in zip(states, starts, strict=True):
            move(state, error)
        simulated = simulation_bank(states, record.time[part], record.inputs[part], thetas, record.model)
        return simulated, record.outputs[part] - simulated


def output_error_fit(
    model: SegmentModel, maximum_iterations: int, progress: Callable[[int, float], None] | None = None
) -> Fit:
    """Fit of the active numbers from their start; maximum_iterations 0: only the accuracy at the start."""
    theta, nuisances = model.theta[model.active], np.zeros((len(model.segments), ERROR_SIZE))
    floor = np.square(_LEAST_NOISE * model.record.model.output_std)
    return estimate(
        model, theta, nuisances,
        variance=residual_variance(model.residuals(theta, nuisances), floor),
        precision=1.0 / np.square(_START_STD), floor=floor, maximum_iterations=maximum_iterations,
        lags=0 if maximum_iterations == 0 else round(_CORRELATION / model.record.step), progress=progress,
    )  # fmt: skip
