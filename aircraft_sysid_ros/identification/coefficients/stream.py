"""States and controls in, coefficient samples out: one direction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.postfix import evaluate_term_rows
from aircraft_sysid_ros.aircraft.term_values import Memory, link
from aircraft_sysid_ros.identification.coefficients.body import force_noise
from aircraft_sysid_ros.identification.coefficients.controls import ControlHistory
from aircraft_sysid_ros.identification.coefficients.evaluation import evaluate_windows, fill_history, fill_lag_noise
from aircraft_sysid_ros.identification.coefficients.flow_angles import VANES, FlowAngles, angles_of_filter
from aircraft_sysid_ros.identification.coefficients.layout import (
    NOISE,
    QBAR,
    SIGNAL,
    TERM,
    TIME,
    WEIGHT_COLUMNS,
    Body,
    CoefficientBatch,
    CoefficientSample,
)
from aircraft_sysid_ros.identification.coefficients.pace import BRIDGED_GAP, Pace
from aircraft_sysid_ros.identification.coefficients.signals import sensor_noise
from aircraft_sysid_ros.identification.coefficients.waiting import WaitingSamples
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.reconstruction.ordering import LARGEST_LEAP as _LARGEST_LEAP_OF_IMU
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.stamps import nanoseconds

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Rows this long [s] before the newest window are dropped.
_MARGIN = 0.5
#: States that leap further ahead than this [s] are by a clock that was set.
LARGEST_LEAP = 1e-9 * _LARGEST_LEAP_OF_IMU
#: Samples so far [s] ahead of the states wait: where these have stopped, or by a clock of their own.
EARLY = 10.0
#: [s] by which times that are equal may differ.
_ROUNDING = 1e-6
_OWN_KINDS = [int(kind) for kind in (Kind.CONTROLS, Kind.HEIGHT, Kind.MASS, Kind.INPUTS, *(kind for kind, _ in VANES))]


class CoefficientStream:
    """States wait for their controls, become history rows, and those become samples at every multiple of the step."""

    def __init__(self, aircraft: Aircraft, options: ParameterOptions) -> None:
        self._aircraft = aircraft
        self._sensor_noise = sensor_noise(aircraft)
        self._early = WaitingSamples()
        self.controls = ControlHistory(aircraft, options.settle)
        self.pace = Pace()  # of the states
        self._angles = FlowAngles(aircraft, self.controls.body.gravity)
        self.change_options(options)
        self._set_model(aircraft)
        self._history = np.empty((0, self._width))
        self._restart()

    def change_options(self, options: ParameterOptions) -> None:
        """Go on with other options."""
        self._options, self.controls.settle = options, options.settle
        self._keep_pace()

    def _keep_pace(self) -> None:
        """Gaps and noise for the rate at which states come now."""
        self._kept_interval = self.pace.interval
        self._largest_gap = self.pace.largest_gap(self._options.largest_gap)
        self._remembered = self.pace.largest_gap(max(self._options.largest_gap, BRIDGED_GAP))
        self.force_noise = force_noise(self.pace.seen_by(self._aircraft), self._options.half_width)

    def _set_model(self, aircraft: Aircraft) -> None:
        self._model, self._code = aircraft.model, aircraft.model.linked
        self._width = TERM + len(self._model.parameter_names)
        self._memory = Memory(self._model.lags)
        self._lag_code = link([lag.program for lag in self._model.lags])

    def adopt(self, aircraft: Aircraft) -> None:
        """Go on with another model: the terms of the rows that are kept are worked out anew."""
        self._set_model(aircraft)
        history = np.empty((len(self._history), self._width))
        history[:, :TERM] = self._history[:, :TERM]
        self._write_terms(history)
        self._history = history

    def _write_terms(self, history: Array) -> None:
        """Lags and terms of history rows, which follow those before, from their signals."""
        signals = np.ascontiguousarray(history[:, SIGNAL:NOISE])
        if self._model.lags:
            self._memory.write(np.ascontiguousarray(history[:, TIME]), signals, self._remembered)
            history[:, SIGNAL:NOISE] = signals
            fill_lag_noise(*self._lag_code, history)
        terms = np.empty((len(history), self._width - TERM))
        evaluate_term_rows(*self._code, signals, terms)
        history[:, TERM:] = terms * history[:, QBAR : QBAR + 1]

    def _restart(self) -> None:
        self._memory.forget()
        self._waiting: list[Array] = []
        self._history = np.empty((0, self._width))
        self._newest: float | None = None
        self._next_index = 0
        #: Time [s] of the first state by this clock.
        self.start_time: float | None = None

    def begin_manoeuvre(self) -> None:
        """The next states are those of another manoeuvre by the same clock, however much later."""
        self._newest = None

    def forget_early(self) -> None:
        """The clock goes back: what is ahead was by the one before."""
        self._early.forget()

    def begin_flight(self) -> None:
        """Another flight begins, by the same clock."""
        self._angles.begin_flight()

    def restart_clock(self) -> None:
        """The clock started over: what waited has been taken."""
        self._restart()
        self.pace.restart()
        self.controls.restart_clock()
        self._angles.restart_clock()

    # -- what comes in ------------------------------------------------------------------------------------------------

    def wait_for_states(self, samples: Samples, *, whole: bool) -> None:
        """Samples that are early for the states; the ``whole`` of them, or what this stream needs."""
        self._early.add(samples if whole else samples[np.isin(samples.kind, _OWN_KINDS)])

    def are_early(self, samples: Samples, epoch: int) -> bool:
        """Whether all samples are far ahead of the states. Masses are not: the controls know those that are to come."""
        if self._newest is None or not len(samples) or np.any(samples.kind == Kind.MASS):
            return False
        return int(samples.stamp.min()) > int(nanoseconds(np.array(self._newest + EARLY), epoch))

    def due_samples(self, time: float, epoch: int) -> Samples:
        """Of what has waited, what is not early for states up to ``time`` [s]."""
        return self._early.take(int(nanoseconds(np.array(time + EARLY), epoch)))

    def has_passed(self, time: float) -> bool:
        """Whether a state of this time [s] cannot follow those that have come: its clock is another one."""
        return self._newest is not None and bool(is_another_clock(time - self._newest))

    @property
    def newest(self) -> float | None:
        """Time [s] of the newest state by this clock; None before it."""
        return self._newest

    @property
    def flown(self) -> float:
        """Time [s] since the first state by this clock; 0 before it."""
        return 0.0 if self.start_time is None or self._newest is None else self._newest - self.start_time

    @property
    def next_sample(self) -> float:
        """Time [s] of the first state that may bring another sample; those before it bring none."""
        if self.start_time is None:
            return -np.inf
        options = self._options
        return self._next_index * options.step + options.half_width + options.settle - _ROUNDING

    def add_states(self, rows: Array) -> float:
        """States (n, StateField.WIDTH) in order of time; returns up to when [s] their controls should be there."""
        self._waiting.append(rows)
        self._newest = float(rows[-1, StateField.TIME])
        return self._newest - self._options.settle

    # -- what comes out -----------------------------------------------------------------------------------------------

    def history_until(self, limit: float) -> Iterator[tuple[Array, Array, Body]]:
        """States up to a time [s] with their history rows, in parts of one body and of one ``pace``."""
        if not self._waiting:
            return
        rows = self._waiting[0] if len(self._waiting) == 1 else np.vstack(self._waiting)
        due = int(np.searchsorted(rows[:, StateField.TIME], limit, side="right"))
        self._waiting = [rows[due:]] if due < len(rows) else []
        if not due:
            return
        angles = self._flow_angles(rows, due)
        for part, body in self.controls.parts_of_one_mass(rows[:due]):
            of_part, angles = angles[: len(part)], angles[len(part) :]
            for even in self.pace.follow(part[:, StateField.TIME]):
                if self.pace.interval != self._kept_interval:
                    self._keep_pace()
                flow = angles_of_filter(part[even]) if self.pace.is_sparse else of_part[even]
                yield part[even], self._history_of(part[even], flow, body), body

    def _flow_angles(self, rows: Array, due: int) -> Array:
        """Angles of the first ``due`` of states, as ``flow_angles`` has them.

        rml predicts the vanes itself and begins on the states of the first step as they are.
        """
        options = self._options
        vanes = self.controls.vanes() if options.measured_angles and options.estimator != "rml" else None
        return self._angles.at(rows, due, vanes, options.settle, options.half_width)

    def _history_of(self, rows: Array, angles: Array, body: Body) -> Array:
        times = rows[:, StateField.TIME]
        if self.start_time is None:
            self.start_time = float(times[0])
            self._next_index = int(np.ceil(times[0] / self._options.step))
        controls, heights = self.controls.at(rows, self.pace.is_sparse)
        history = np.empty((len(rows), self._width))
        fill_history(rows, angles, controls, heights, body, self._sensor_noise, *self._code, self.start_time, history)
        if self._model.lags:
            self._write_terms(history)
        self.controls.forget_before(float(times[-1]))
        return history

    def batch(self, rows: Array, history: Array, body: Body) -> CoefficientBatch:
        """States that came together with the samples whose windows they close."""
        options, terms = self._options, self._width - TERM
        if len(self._history) and history[0, TIME] - self._history[-1, TIME] > LARGEST_LEAP:  # no window reaches across
            self._history, self._next_index = self._history[:0], int(np.ceil(history[0, TIME] / options.step))
        self._history = np.vstack([self._history, history]) if len(self._history) else history
        span = self._history[-1, TIME] - self._next_index * options.step
        most = max(int(span / options.step) + 2, 0)
        samples, noise = np.empty((most, CoefficientSample.TERMS + terms)), np.empty((most, terms))
        vane_noise, weights = np.empty((most, len(VANES), terms)), np.empty((most, WEIGHT_COLUMNS))
        self._next_index, count = evaluate_windows(
            self._history, self._next_index, options.step, options.half_width, self._largest_gap, self.force_noise,
            self.pace.is_sparse, body, *self._code, samples, noise, vane_noise, weights,
        )  # fmt: skip
        oldest = self._next_index * options.step - options.half_width - _MARGIN
        self._history = self._history[int(np.searchsorted(self._history[:, TIME], oldest)) :]
        return CoefficientBatch(
            rows, history, body, samples[:count], noise[:count], vane_noise[:count], weights[:count],
            self._angles.drifts_since,
        )  # fmt: skip


def is_another_clock(steps: Any, largest_leap: float = LARGEST_LEAP) -> Any:
    """Where a step [s] between states, or each of an array of them, is none that one clock makes."""
    return (steps <= 0.0) | (steps > largest_leap)


def one_clock(rows: Array, largest_leap: float = np.inf) -> list[Array]:
    """States (n, StateField.WIDTH) in parts, each in order of time: between them the clock started over.

    So it did where they leap ahead by more than ``largest_leap`` [s].
    """
    return np.split(rows, np.flatnonzero(is_another_clock(np.diff(rows[:, StateField.TIME]), largest_leap)) + 1)


def coefficient_samples(
    aircraft: Aircraft, options: ParameterOptions, samples: Samples, rows: Array, epoch: int
) -> Array:
    """The coefficient samples (m, …) of a whole flight, from its states (n, StateField.WIDTH) and its samples.

    They are those of an ``Identifier``, but none is predicted, judged valid or learnt from.
    """
    stream = CoefficientStream(aircraft, options)
    stream.controls.add(samples, epoch)
    for part in one_clock(rows):  # of a flight that is over it counts where it landed, too
        stream.controls.ground.below(part)
        stream.controls.ground.restart_clock()
    found = [np.empty((0, CoefficientSample.TERMS + len(aircraft.model.parameter_names)))]

    def use(limit: float) -> None:
        found.extend(stream.batch(*part).samples for part in stream.history_until(limit))

    for part in one_clock(rows) if len(rows) else []:
        if stream.has_passed(float(part[0, StateField.TIME])):
            use(np.inf)
            stream.restart_clock()
        use(stream.add_states(part))
    use(np.inf)
    return np.vstack(found)
