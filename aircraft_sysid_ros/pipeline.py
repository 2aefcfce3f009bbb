"""The whole chain: samples → first step (state, biases, wind) → second step (aerodynamic parameters)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.modelling.parameter_estimator import ParameterEstimator, ParameterOptions
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator, StateOptions, warm_up
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]


class Pipeline:
    """Both steps in one process, as replay runs them; the live nodes hold the same two objects."""

    def __init__(
        self,
        aircraft: Aircraft,
        state_options: StateOptions | None = None,
        parameter_options: ParameterOptions | None = None,
    ) -> None:
        self.state = StateEstimator(aircraft, state_options)
        self.parameters = ParameterEstimator(aircraft, parameter_options)

    def warm_up(self) -> None:
        """Compile (or load from the cache) the kernels before the first sample."""
        warm_up(self.state.aircraft)
        self.parameters.warm_up()

    def push(self, samples: Samples) -> tuple[Array, Array]:
        """Take samples in the order of arrival; returns new rows of ``Column`` and new rows of ``Point``."""
        rows = self.state.push(samples)
        self.parameters.push_samples(samples, self.state.epoch)
        return rows, self.parameters.push_states(rows, self.state.epoch)

    def flush(self) -> tuple[Array, Array]:
        """Process what is held back, at the end of a recording."""
        rows = self.state.flush()
        points = [self.parameters.push_states(rows, self.state.epoch), self.parameters.flush()]
        return rows, np.vstack(points)
