"""Second step: states and controls in, aerodynamic parameters out. The facade of ``identification``.

One direction: states wait for their controls and become coefficient samples (``coefficients``), estimators learn from
those (``estimators``), monitors compare what was predicted (``monitoring``) and return commands, which ``learning``
carries out.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.coefficients.stream import (
    LARGEST_LEAP,
    CoefficientStream,
    is_another_clock,
    one_clock,
)
from aircraft_sysid_ros.identification.estimators.contract import Estimator
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import RlsState
from aircraft_sysid_ros.identification.history import Carry
from aircraft_sysid_ros.identification.learning import STALE, Learning
from aircraft_sysid_ros.identification.monitoring.error_window import AxisError, model_errors, samples_apart
from aircraft_sysid_ros.identification.options import ParameterOptions, check_change
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.physical_bounds import check_bounds
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]

#: Time [s] between evaluations of the monitors.
EVALUATION_STEP = 0.2


class Identifier:
    """Estimates the parameters of an aircraft's model, fed with states and samples of controls, height and mass.

    ``options.estimator`` names whose parameters are the result, or leaves it to the flight (``learning.published``).
    """

    def __init__(self, aircraft: Aircraft, options: ParameterOptions | None = None) -> None:
        check_bounds(aircraft.parameter_bounds)
        self.aircraft, self.options = aircraft, options or ParameterOptions()
        self.stream = CoefficientStream(aircraft, self.options)
        self.learning = Learning(aircraft, self.options, self.stream.pace, self.stream.controls.pace)
        self._slot, self._interval = -np.inf, self.stream.pace.interval
        self._before: float | None = None  # time [s] of the newest state by a clock of which none has come since

    @property
    def model(self) -> AerodynamicModel:
        """The model that is estimated."""
        return self.aircraft.model

    @property
    def late(self) -> int:
        """Samples of controls and heights that came after their time was used."""
        return self.stream.controls.late

    @property
    def late_vanes(self) -> int:
        """The same of vanes, which the first step counts for itself."""
        return self.stream.controls.late_vanes

    # -- starting over ------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Forget all that was learnt."""
        self.learning.reset()
        self._slot = -np.inf

    def change_options(self, options: ParameterOptions) -> None:
        """Go on with other options: what is learnt from now on is learnt with them.

        Raises InputError for those that the estimator is made of, see ``options.check_change``.
        """
        check_change(self.options, options)
        self.options = options
        self.stream.change_options(options)
        self.learning.change_options(options)

    def adopt(self, aircraft: Aircraft, state: RlsState, estimator: Estimator, carry: Carry) -> None:
        """Go on with another model and what is known of it, see ``model_change``; ``carry`` what was known before."""
        self.aircraft = aircraft
        self.learning.adopt(aircraft, state, estimator, carry)
        self.stream.adopt(aircraft)
        self._slot = -np.inf

    def restart_clock(self) -> Array:
        """The clock of the states starts over: what waits is used, what was learnt stays; returns new samples."""
        samples = self.flush()
        self._before = self._before if self.stream.newest is None else self.stream.newest
        self.stream.restart_clock()
        self.learning.restart_clock()
        self._slot = -np.inf
        return samples

    def begin_anew(self, same_flight: bool) -> Array:
        """Another manoeuvre begins, by the same clock: what waits is used, what was learnt stays; returns new samples.

        No window reaches across the pause, and nothing looks back across it. What errors are usual is of one flight.
        """
        samples = self.flush()
        self.stream.begin_manoeuvre()
        self.learning.begin_anew(same_flight)
        if not same_flight:
            self.stream.begin_flight()
        return samples

    # -- what comes in ------------------------------------------------------------------------------------------------

    def push_samples(self, samples: Samples, epoch: int | None, due: npt.NDArray[np.int64] | None = None) -> None:
        """Take controls, heights and mass properties, and what the estimator asks for.

        ``epoch`` is that of the states; None while no state has come: the samples then wait for it, and so do those
        that come by themselves and are far ahead. ``due`` (n,) [ns] is the newest time of states that could have come
        before each sample, where samples come in blocks.
        """
        if epoch is None or (due is None and self.stream.are_early(samples, epoch)):
            self.stream.wait_for_states(samples, whole=epoch is not None or self.learning.lends)
            return
        self.learning.push_samples(samples, epoch)
        self.stream.controls.add(samples, epoch, due)

    def states_until_news(self, times: Array) -> int:
        """How many of the next states at times (n,) [s] may come at once: those that bring no sample and leave ``time``
        as it is, and the one after them.
        """
        newest = self.learning.newest
        stale = np.inf if newest is None else float(newest[CoefficientSample.TIME]) + STALE + self.options.settle
        if self.stream.has_passed(float(times[0])):
            return 1
        steps = np.diff(times, prepend=times[0] - 1.0)
        brings = (times >= min(self.stream.next_sample, stale)) | is_another_clock(steps)
        return int(np.argmax(brings)) + 1 if brings.any() else len(times)

    def push_states(self, rows: Array, epoch: int | None = None) -> Array:
        """Take states (n, StateField.WIDTH) in order of time; returns new samples (m, CoefficientSample.TERMS + …)."""
        if not len(rows):
            return self._no_samples()
        parts = one_clock(rows, LARGEST_LEAP)
        if len(parts) > 1:
            return np.vstack([self.push_states(part, epoch) for part in parts])
        begin = float(rows[0, StateField.TIME])
        if epoch is not None:
            self._take_early(rows, epoch)
        before = self.restart_clock() if self.stream.has_passed(begin) else self._no_samples()
        if self._before is not None:
            self.learning.move_times(min(begin - self._before, 0.0))  # ahead, and so much may have passed
            self._before = None
        self.learning.constants.note(rows)
        samples = self._process_until(self.stream.add_states(rows))
        return np.vstack([before, samples]) if len(before) else samples

    def _take_early(self, rows: Array, epoch: int) -> None:
        """Samples that have waited for states such as these."""
        if self.stream.newest is not None and rows[0, StateField.TIME] <= self.stream.newest:
            self.stream.forget_early()
        early = self.stream.due_samples(float(rows[-1, StateField.TIME]), epoch)
        if len(early):
            self.learning.push_samples(early, epoch)
            self.stream.controls.add(early, epoch)

    def flush(self) -> Array:
        """Process the states that wait for controls, at the end of a recording."""
        return self._process_until(np.inf)

    def _process_until(self, limit: float) -> Array:
        """States up to a time [s] -> history -> samples -> estimators, cut where the monitors are due."""
        found = [self._no_samples()]
        for rows, history, body in self.stream.history_until(limit):
            if self.stream.pace.interval != self._interval:
                self._interval = self.stream.pace.interval
                self.learning.keep_pace()
            times = rows[:, StateField.TIME]
            slots = np.floor(times / EVALUATION_STEP)
            edges = [0, *(np.flatnonzero(slots[1:] != slots[:-1]) + 1).tolist(), len(rows)]
            batch = self.stream.batch(rows, history, body)
            for part, slot in zip(batch.parts(edges, self.options.half_width), slots[edges[:-1]].tolist(), strict=True):
                if slot != self._slot:
                    self._slot = slot
                    time, used_until = float(part.rows[0, StateField.TIME]), self.stream.controls.used_until
                    misread = self.stream.controls.misread(time)
                    self.learning.evaluate(time, self.stream.start_time or 0.0, used_until, misread)
                    self.learning.choose(part)
                self.learning.learn(part)
            found.append(batch.samples)
        return np.vstack(found)

    # -- what was learnt ----------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time [s] of what is published; NaN before any sample."""
        return self.learning.time(self.stream.controls.used_until)

    def snapshot(self) -> ParameterSet:
        """What is published now: ``estimates`` that have passed the integrity monitor, or what was known before."""
        return self.learning.published_now(self.stream.controls.used_until, self.stream.start_time or 0.0)

    def estimates(self) -> ParameterSet:
        """The parameters now, with standard errors corrected for coloured residuals and a verdict on each."""
        return self.learning.estimates(self.stream.controls.used_until)

    def std_of_sensors(self) -> Array:
        """One sigma (parameters,) of what sensors that nobody described do to each parameter of another estimator."""
        return self.learning.std_of_sensors(self.stream.controls.used_until)

    def model_error(self) -> list[AxisError]:
        """Measured against predicted coefficients over the sliding window."""
        apart = samples_apart(self.options.step, self.options.half_width)
        over_noise = self.learning.integrity.errors.monitor.fits()[:, 1]
        return model_errors(self.learning.history.newest(), apart, over_noise.tolist())

    def _no_samples(self) -> Array:
        return np.empty((0, self.learning.columns))

    def warm_up(self) -> None:
        """Compile (or load from the cache) the jitted loops before the first sample of a flight."""
        warm_up(Identifier(self.aircraft, self.options))


def level_flight(aircraft: Aircraft, begin: float) -> Array:
    """Two seconds of it from ``begin`` [s] on, as states (200, StateField.WIDTH)."""
    rows = np.zeros((200, StateField.WIDTH))
    rows[:, StateField.TIME] = begin + 0.01 * np.arange(200)
    rows[:, StateField.ATTITUDE.start] = rows[:, StateField.STATUS] = 1.0
    rows[:, StateField.AIRSPEED] = 2.0 * aircraft.minimum_airspeed
    rows[:, [StateField.AIR_DENSITY, StateField.AIR_VELOCITY_STD]] = 1.0
    return rows


def warm_up(identifier: Identifier) -> None:
    """Two seconds of level flight through an identifier of its own, and what they do not reach."""
    identifier.push_states(level_flight(identifier.aircraft, 0.0))
    identifier.flush()
    identifier.snapshot()
    identifier.model_error()
    identifier.learning.warm_up()
