"""The whole chain: samples → first step (state, biases, wind) → second step (aerodynamic parameters)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.flight_check.in_flight import watch_of
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.ordering import LARGEST_LEAP
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator, warm_up
from aircraft_sysid_ros.samples import SAME_FLIGHT, Kind, Samples, manoeuvres_in_turn

Array = npt.NDArray[np.float64]


def parts_by_clock(samples: Samples, clock: int | None) -> list[Samples]:
    """The samples in parts: one by one where IMU stamps leap, until the next two IMU samples, which confirm it or not.

    ``clock`` is the newest IMU stamp [ns] before them.
    """
    imu = np.flatnonzero(samples.kind == Kind.IMU)
    stamps = samples.stamp[imu]
    steps = np.diff(stamps, prepend=stamps[:1] if clock is None else clock)
    leaps = np.flatnonzero((steps < 0) | (steps > LARGEST_LEAP))
    if not len(leaps):
        return [samples]
    begins = np.where(leaps > 0, imu[leaps - 1] + 1, 0)
    ends = imu[np.minimum(leaps + 1, len(imu) - 1)] + 1
    near = [np.arange(low, high + 1) for low, high in zip(begins.tolist(), ends.tolist(), strict=True)]
    edges = np.unique(np.concatenate([[0], *near, [len(samples)]]))
    return [samples[low:high] for low, high in pairwise(edges.tolist())]


class Pipeline:
    """Both steps in one process, as replay runs them; the live nodes hold the same two objects."""

    def __init__(
        self,
        aircraft: Aircraft,
        state_options: StateOptions | None = None,
        parameter_options: ParameterOptions | None = None,
    ) -> None:
        self.check = watch_of(aircraft, state_options)
        self.state = StateEstimator(aircraft, state_options, watch=self.check)
        self.parameters = Identifier(aircraft, parameter_options)

    def warm_up(self) -> None:
        """Compile (or load from the cache) the kernels before the first sample."""
        warm_up(self.state.aircraft)
        self.parameters.warm_up()

    def push(self, samples: Samples) -> tuple[Array, Array]:
        """Take samples in the order of arrival; returns new rows of ``StateField`` and of ``CoefficientSample``."""
        done = []
        for since, manoeuvre in manoeuvres_in_turn(samples):
            if since is not None:
                done.append(self.begin_anew(since))
            done += [self._push(part) for part in parts_by_clock(manoeuvre, self.state.order.clock)]
        return np.vstack([rows for rows, _ in done]), np.vstack([points for _, points in done])

    def _push(self, samples: Samples) -> tuple[Array, Array]:
        """Samples of which the last may be the first by a clock that started over."""
        before, due = self.state.order.counts.restarts, self.state.order.newest_due(samples)
        rows = self.state.push(samples)
        if self.state.order.counts.restarts > before:  # the rows are what was held by the old clock
            points = [self.parameters.push_states(rows, self.state.epoch), self.parameters.restart_clock()]
            self.parameters.push_samples(samples, self.state.epoch)
            return rows, np.vstack(points)
        self.parameters.push_samples(samples, self.state.epoch, due)
        return rows, self.parameters.push_states(rows, self.state.epoch)

    def begin_anew(self, since: float) -> tuple[Array, Array]:
        """Another manoeuvre begins, ``since`` [s] after the one before: its motion is found anew, what was learnt
        stays; returns what was held back.
        """
        rows = self.state.begin_anew(since)
        points = [self.parameters.push_states(rows, self.state.epoch), self.parameters.begin_anew(since <= SAME_FLIGHT)]
        return rows, np.vstack(points)

    def flush(self) -> tuple[Array, Array]:
        """Process what is held back, at the end of a recording."""
        rows = self.state.flush()
        points = [self.parameters.push_states(rows, self.state.epoch), self.parameters.flush()]
        return rows, np.vstack(points)
