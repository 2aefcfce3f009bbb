"""Recursive maximum likelihood of the aerodynamic parameters, live: the estimator ``rml``.

The second step of the two-step method believes the states of the first. This estimator only starts from them, and
keeps a slow attitude reference: it predicts the measurements themselves, specific force, angular rate, GPS, and air
data at their own times, with the aircraft of (6.8)-(6.19) of docs/references.md, and estimates coefficients, IMU
biases and the levels of gusts and sensor noise together by (5.8) and (5.10)-(5.13). Biases that the first step is
still finding then do not end up in constant terms, nor the noise of air data in derivatives.
"""

from __future__ import annotations

from copy import copy

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.earth import Odometer, gravity
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.estimation.recursive_maximum_likelihood import coloured_covariance, new_scores
from aircraft_sysid_ros.flight_model.layout import (
    AIRSPEED,
    ALPHA,
    BETA,
    CONTROLS,
    DENSITY,
    ERROR_SIZE,
    GPS_POSITION,
    GPS_VELOCITY,
    GYRO,
    HEIGHT,
    INPUT_SIZE,
    NAMED,
    OUTPUT_GROUPS,
    OUTPUT_SIZE,
    PROCESS_GROUPS,
    REFERENCE,
    SPEED_OF_SOUND,
    STATE_SIZE,
    TIME,
    FlightModel,
    flight_model_of,
    make_theta,
    process_slice,
)
from aircraft_sysid_ros.identification.coefficients import layout
from aircraft_sysid_ros.identification.coefficients.body import body_of
from aircraft_sysid_ros.identification.coefficients.layout import WEIGHT_COLUMNS, Body, CoefficientBatch
from aircraft_sysid_ros.identification.coefficients.pace import BRIDGED_GAP, Pace
from aircraft_sysid_ros.identification.estimators import likelihood_state as loop
from aircraft_sysid_ros.identification.estimators.contract import AxisEstimate, AxisReset, KnownParameters
from aircraft_sysid_ros.identification.estimators.dense_epochs import DenseEpochs
from aircraft_sysid_ros.identification.estimators.likelihood_recursion import run
from aircraft_sysid_ros.identification.estimators.likelihood_restore import Past, copied, put_back, take_axis
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.reconstruction.drift import SENSORS as AIR_DATA
from aircraft_sysid_ros.reconstruction.drift import Drift
from aircraft_sysid_ros.reconstruction.filter_setup import measured_at, stamp_delays
from aircraft_sysid_ros.reconstruction.state import StateField, in_moving_air
from aircraft_sysid_ros.samples import CONTROL_COLUMNS, Kind, Samples, is_absurd

Array = npt.NDArray[np.float64]
Checkpoint = tuple[loop.Recursion, set[int], Array]

#: Which outputs a kind of sample gives: first of them, how many values.
_OUTPUTS = {
    Kind.AIRSPEED: (AIRSPEED, 1),
    Kind.ANGLE_OF_ATTACK: (ALPHA, 1),
    Kind.SIDESLIP: (BETA, 1),
    Kind.GPS_POSITION: (GPS_POSITION, 3),  # places until they are used
    Kind.GPS_VELOCITY: (GPS_VELOCITY, 3),
}
#: Levels at the start: gusts [m/s per sqrt(s)] horizontal and vertical, rates [rad/s per sqrt(s)].
_PROCESS_START = (0.3, 0.3, 0.5)
#: Outputs rest on so many rows per second of each knot that forgetting counts in rows (see ``learn_rows``).
_ROWS_PER_KNOT = 3.0
_EARLY_FORGETTING, _EARLY_TIME = 0.998, 10.0  # per row; [s]
_EARLY_RATE = 100.0  # [Hz] of epochs that it is meant for
_BRIDGED = 3.5  # intervals of sparse states that the filters predict over
_START_TIME, _LONGEST_START = 20.0, 90.0  # [s] of equation error before the filters
_FORCE_DOUBT, _MOMENT_DOUBT = 0.02, 0.002  # of the constant terms after it
_ATTITUDE_STEP = 1.0  # [s]
_SCORE_BLOCK, _SCORE_START = 0.2, 10.0  # [s]
#: What was learnt this long [s] before a change is not touched by it.
_MARGIN = 0.1
#: Published samples are counted at this rate [Hz], that of recursive least squares.
_SAMPLE_RATE = 25.0


def _column(signal: str) -> int:
    return layout.SIGNAL + SIGNAL_INDEX[signal]


class MaximumLikelihoodEstimator:
    """Estimator of all axes, see ``Estimator``; ``restarts`` counts how often its filters were lost."""

    joint = True

    def __init__(self, aircraft: Aircraft, options: ParameterOptions) -> None:
        self.aircraft, self.options = aircraft, options
        self._names = aircraft.model.parameter_names
        self._delays, self._drift = stamp_delays(aircraft), Drift(aircraft)
        per_knot = max(round(aircraft.sensors["accelerometer"].rate / options.rml_rate), 1)
        self._model = flight_model_of(aircraft, STANDARD_GRAVITY, per_knot)
        self.keep_pace(Pace())
        self._body: Body | None = None
        self._origin: Array | None = None
        self._odometer: Odometer | None = None  # at the newest place that was used
        self._covariance: tuple[float, Array] = (-1.0, np.empty((0, 0)))
        self._past = Past()
        self.late = 0
        self.reset()
        self.restart_clock()

    # -- starting over ----------------------------------------------------------------------------------------------

    def change_options(self, options: ParameterOptions) -> None:
        """See ``Estimator``."""
        self.options = options
        self._tuning = self._new_tuning()

    def keep_pace(self, pace: Pace) -> None:
        """See ``Estimator``."""
        self._pace = pace
        self._tuning = self._new_tuning()

    def reset(self) -> None:
        """Forget all that was learnt."""
        self.recursion = self._new_recursion()
        self._past.clear()
        self._waiting: set[int] = set()
        self._changed = np.full(len(AXES), -np.inf)

    def restart_clock(self) -> None:
        """The clock started over: drop what refers to old times, keep what was learnt."""
        self._past.clear()
        self._open = (np.empty((0, StateField.WIDTH)), np.empty((0, layout.TERM + len(self._names))))
        self._times, self._samples = np.empty(0), np.empty((0, OUTPUT_SIZE))
        self._dense = DenseEpochs()
        self._used_until = -np.inf
        clock = self.recursion.clock
        clock[loop.TIME], clock[loop.RUNNING] = -np.inf, 0.0
        self.recursion.before_time[:] = np.nan

    def move_times(self, by: float) -> None:
        """The clock that has started over shows ``by`` [s] more: what was learnt is as old as it was."""
        self.recursion.last_learnt[:] += by

    @property
    def restarts(self) -> int:
        """How often the filters were lost."""
        return int(self.recursion.clock[loop.RESTARTS])

    def noise_levels(self) -> dict[str, float]:
        """Gusts [m/s per sqrt(s)], unmodelled angular acceleration, and factors on the noise of the aircraft file."""
        levels = np.exp(self.recursion.theta[process_slice(self._model).start :])
        return dict(zip(PROCESS_GROUPS + OUTPUT_GROUPS, levels.tolist(), strict=True))

    def _new_tuning(self) -> loop.Tuning:
        options, pace = self.options, self._pace
        rate = min(options.rml_rate, pace.rate) if pace.is_sparse else options.rml_rate
        rows = options.forgetting_time * rate * _ROWS_PER_KNOT
        early = _EARLY_FORGETTING ** (_EARLY_RATE / rate) if pace.is_sparse else _EARLY_FORGETTING
        gap = max(options.largest_gap, BRIDGED_GAP, 2.0 / options.rml_rate)
        return loop.Tuning(
            largest_gap=pace.largest_gap(gap, _BRIDGED),
            forgetting=float(np.exp(-1.0 / rows)),
            early_forgetting=min(early, float(np.exp(-1.0 / rows))),
            early_time=_EARLY_TIME,
            start_time=_START_TIME,
            longest_start=_LONGEST_START,
            attitude_step=_ATTITUDE_STEP,
            block=_SCORE_BLOCK,
            score_forgetting=float(np.exp(-_SCORE_BLOCK / options.forgetting_time)),
            score_start=_SCORE_START,
            gyro_std=float(self._model.output_std[GYRO]),
        )

    def _new_recursion(self) -> loop.Recursion:
        known = loop.prior_of(self._names)
        n, q = len(self._names), len(known.std)
        theta = make_theta(self._model, np.zeros(n), process=_PROCESS_START)
        clock = np.zeros(loop.CLOCK_SIZE)
        clock[loop.TIME] = -np.inf
        return loop.Recursion(
            theta=theta,
            free=np.arange(q),
            moves=known.move,
            start=theta.copy(),
            start_root=np.diag(known.std),
            start_doubt=self._start_doubt(q),
            low=known.low,
            high=known.high,
            largest_step=known.largest_step,
            root=np.diag(known.std),
            thetas=np.tile(theta, (q + 1, 1)),
            states=np.zeros((q + 1, STATE_SIZE)),
            covariances=np.zeros((q + 1, ERROR_SIZE, ERROR_SIZE)),
            innovations=np.full((q + 1, OUTPUT_SIZE), np.nan),
            variances=np.full((q + 1, OUTPUT_SIZE), np.nan),
            scores=new_scores(q, max(round(self.options.lag_time / _SCORE_BLOCK), 1)),
            last_learnt=np.full(q, np.nan),
            inputs=np.zeros(INPUT_SIZE),
            before=np.zeros((2, layout.TERM + n)),
            before_time=np.full(2, np.nan),
            clock=clock,
        )

    def _start_doubt(self, size: int) -> Array:
        """Constant terms of the forces hold what the first step had not yet found of the accelerometer's biases."""
        doubt = np.zeros(size)
        programs = [program for axis in self.aircraft.model.programs for program in axis]
        for i, program in enumerate(programs):
            if program.text == "1":
                doubt[i] = _FORCE_DOUBT if i < self.aircraft.model.offsets[3] else _MOMENT_DOUBT
        return doubt

    # -- what comes in ----------------------------------------------------------------------------------------------

    def push_samples(self, samples: Samples, epoch: int) -> None:
        """Take air data and GPS; other kinds are passed over. What comes after its time was used is late."""
        samples = samples[np.isin(samples.kind, [int(kind) for kind in _OUTPUTS])]
        if not len(samples):
            return
        times = measured_at(samples, self._delays, epoch)
        values = np.where(is_absurd(samples), np.nan, samples.values)
        rows = np.full((len(samples), OUTPUT_SIZE), np.nan)
        for kind, (first, count) in _OUTPUTS.items():
            chosen = samples.kind == kind
            rows[chosen, first : first + count] = values[chosen, :count]
        in_time = times > self._used_until
        self.late += int((~in_time).sum())
        times = np.concatenate([self._times, times[in_time]])
        order = np.argsort(times, kind="stable")
        self._times, self._samples = times[order], np.vstack([self._samples, rows[in_time]])[order]

    def step(self, batch: CoefficientBatch) -> KnownParameters:
        """See ``Estimator``: coefficients at the end of each block of scores."""
        self._drift.since = batch.drifts_since
        epochs = self._close_epochs(in_moving_air(batch.rows), batch.history)
        epochs = self._dense.add(epochs, self._tuning.largest_gap if self._pace.is_sparse else 0.0)
        times, known = np.empty(len(epochs.time)), np.empty((len(epochs.time), len(self._names)))
        if not len(epochs.time):
            return KnownParameters(times, known)
        self._set_body(batch.body, epochs.rows[0])
        if self._waiting:
            epochs = epochs._replace(usable=np.zeros_like(epochs.usable))
        elif self.options.relearn:
            self._past.keep(float(epochs.time[0]), self.recursion)
        used, count = run(
            epochs, self._times, self._ned_samples(), batch.body, self._model, self.aircraft.model.offsets,
            self.recursion, self._tuning, times, known,
        )  # fmt: skip
        self._odometer = self._along(self._samples[:used])[1]
        self._times, self._samples = self._times[used:], self._samples[used:]
        self._used_until = float(epochs.time[-1])
        return KnownParameters(times[:count], known[:count])

    def known(self) -> Array:
        """See ``Estimator``."""
        return self.recursion.theta[: len(self._names)].copy()

    def reset_axis(self, *resets: AxisReset) -> None:
        """See ``Estimator`` and ``likelihood_restore``: the axes wait."""
        if not self._waiting:
            self._past.restore(min(reset.since for reset in resets) - _MARGIN, self.recursion)
        self._waiting |= {reset.axis for reset in resets}

    def needs_reseed(self, axis: int) -> bool:
        """See ``Estimator``."""
        return axis in self._waiting

    def reseed(self, axis: int, known: AxisEstimate) -> None:
        """See ``Estimator``."""
        part = self.aircraft.model.axis_slice(AXES[axis])
        take_axis(self.recursion, part, known.theta, known.covariance)
        self._changed[axis] = self.recursion.clock[loop.LEARNT]
        self._waiting.discard(axis)
        self._covariance = (-1.0, self._covariance[1])
        self._past.clear()

    def checkpoint(self) -> Checkpoint:
        """See ``Estimator``."""
        return copied(self.recursion), self._waiting.copy(), self._changed.copy()

    def restore(self, checkpoint: Checkpoint, *axes: int) -> None:
        """See ``Estimator``: its filters start over."""
        put_back(checkpoint[0], self.recursion)
        self._waiting, self._changed = checkpoint[1].copy(), checkpoint[2].copy()
        self._covariance = (-1.0, self._covariance[1])
        self._past.clear()

    def warm_up(self) -> None:
        """Compile, or load from the cache, what two seconds of level flight do not reach: the filters."""
        other = MaximumLikelihoodEstimator(self.aircraft, self.options)
        other._tuning = other._tuning._replace(start_time=0.0, longest_start=0.0)
        rows = np.zeros((20, StateField.WIDTH))
        rows[:, StateField.TIME] = np.arange(20) / self.options.rml_rate
        rows[:, StateField.ATTITUDE.start] = rows[:, StateField.AIR_DENSITY] = 1.0
        rows[:, [StateField.VELOCITY.start, StateField.AIRSPEED]] = 2.0 * self.aircraft.minimum_airspeed
        rows[:, StateField.STANDARD_DEVIATIONS] = 0.1
        history = np.zeros((20, layout.TERM + len(self._names)))
        history[:, layout.TIME] = rows[:, StateField.TIME]
        history[:, [layout.FLYING, layout.QBAR, _column("V"), _column("mach")]] = 1.0
        columns = layout.CoefficientSample.TERMS + len(self._names)
        terms = len(self._names)
        none = np.empty((0, columns)), np.empty((0, terms)), np.empty((0, 2, terms)), np.empty((0, WEIGHT_COLUMNS))
        other.step(CoefficientBatch(rows, history, body_of(self.aircraft), *none))
        n = len(other.estimate(0).theta)
        nothing = np.zeros(n)
        other.reset_axis(AxisReset(0, 0.0, nothing, nothing, np.eye(n), np.eye(n), 1.0, none[0], none[-1]))
        other.reseed(0, AxisEstimate(np.zeros(n), np.eye(n), 0, np.zeros(n)))

    # -- rows to knots ----------------------------------------------------------------------------------------------

    def _close_epochs(self, rows: Array, history: Array) -> loop.ImuEpochs:
        """Means of the rows of each interval of 1 / rml_rate that is over; the others wait."""
        rows, history = np.vstack([self._open[0], rows]), np.vstack([self._open[1], history])
        bins = np.floor(rows[:, StateField.TIME] * self.options.rml_rate + 1e-6)
        first = np.flatnonzero(np.diff(bins, prepend=-np.inf))
        self._open = (rows[first[-1] :], history[first[-1] :])
        rows, history, starts = rows[: first[-1]], history[: first[-1]], first[:-1]
        if not len(starts):
            rows, history = np.empty((0, rows.shape[1])), np.empty((0, history.shape[1]))
        counts = np.diff(first)[:, None].astype(np.float64)
        mean_rows = _sums(rows, starts) / counts
        mean_history = _sums(history, starts) / counts
        attitude = mean_rows[:, StateField.ATTITUDE]
        attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
        imu = np.hstack([mean_rows[:, StateField.SPECIFIC_FORCE], mean_rows[:, StateField.ANGULAR_VELOCITY]])
        imu += np.hstack(
            [mean_rows[:, StateField.ACCELEROMETER_BIAS], mean_rows[:, StateField.GYRO_BIAS]]
        )  # as measured
        inputs = self._inputs(mean_rows, mean_history)
        sound = np.all(np.isfinite(imu), axis=1) & np.all(np.isfinite(inputs), axis=1)
        flying = mean_history[:, layout.FLYING] == 1.0
        ends = rows[np.maximum(first[1:] - 1, 0), StateField.TIME] if len(starts) else np.empty(0)
        return loop.ImuEpochs(
            mean_rows[:, StateField.TIME].copy(), ends, sound & flying, imu, inputs, mean_rows, mean_history
        )

    def _inputs(self, rows: Array, history: Array) -> Array:
        """Inputs of the flight model (n, INPUT_SIZE); what the model does not read is a number even if not measured."""
        used = self.aircraft.model.signals_used
        inputs = np.zeros((len(rows), INPUT_SIZE))
        controls = inputs[:, CONTROLS]
        for i, signal in enumerate(CONTROL_COLUMNS):
            if signal in used:
                controls[:, i] = history[:, _column(signal)]
        for i, name in enumerate(self.aircraft.model.inputs):
            if name in used:
                inputs[:, NAMED.start + i] = history[:, layout.SIGNAL + len(SIGNALS) + i]
        controls[:, 5] *= history[:, layout.QBAR] * self.aircraft.wing_area
        inputs[:, DENSITY] = rows[:, StateField.AIR_DENSITY]
        inputs[:, HEIGHT] = history[:, _column("height")] if "height" in used else 0.0
        inputs[:, SPEED_OF_SOUND] = history[:, _column("V")] / history[:, _column("mach")] if "mach" in used else 340.0
        inputs[:, TIME] = history[:, _column("time")]
        inputs[:, REFERENCE] = rows[:, StateField.ATTITUDE]
        return inputs

    def _ned_samples(self) -> Array:
        """The waiting samples (m, 18), positions in NED, air data without the errors that the aircraft file states."""
        samples = self._along(self._samples)[0]
        for kind in AIR_DATA:
            column, kinds = _OUTPUTS[kind][0], np.full(len(samples), kind)
            samples[:, [column]] = self._drift.corrected(self._times, kinds, samples[:, [column]])
        return samples

    def _along(self, samples: Array) -> tuple[Array, Odometer]:
        """Samples with positions for places, on the way from the newest that was used; and the odometer after them."""
        samples, place = samples.copy(), slice(GPS_POSITION, GPS_POSITION + 3)
        assert self._odometer is not None
        odometer = copy(self._odometer)
        for i in np.flatnonzero(np.isfinite(samples[:, place]).all(axis=1)):
            samples[i, place] = odometer.position_at(samples[i, place])
        return samples, odometer

    def _set_body(self, body: Body, row: Array) -> None:
        """Mass properties and gravity of the place into the flight model; a new origin starts the filters anew."""
        origin = row[StateField.ORIGIN]
        if self._origin is None or not np.array_equal(origin, self._origin, equal_nan=True):
            self._origin, self._odometer = origin.copy(), Odometer(origin)
            self.recursion.clock[loop.RUNNING] = 0.0
            self._body = None
            self._past.clear()
        if self._body is None or not _same_body(body, self._body):
            self._body = body
            self._model = _model_with(self._model, self.aircraft, body, self._origin)

    # -- what was learnt --------------------------------------------------------------------------------------------

    def _samples_since(self, axis: int) -> int:
        """Of what was learnt from since the axis changed, if it did."""
        learnt = float(self.recursion.clock[loop.LEARNT])
        return max(int(min(learnt - _SCORE_START, learnt - self._changed[axis]) * _SAMPLE_RATE), 0)

    def estimate(self, axis: int) -> AxisEstimate:
        """Parameters of one axis now, with the covariance corrected for coloured innovations."""
        part = self.aircraft.model.axis_slice(AXES[axis])
        n, samples = part.stop - part.start, self._samples_since(axis)
        last = self.recursion.last_learnt[part].copy()
        if samples <= n and not 0.0 < self._changed[axis] <= self.recursion.clock[loop.LEARNT]:
            return AxisEstimate(np.full(n, np.nan), np.full((n, n), np.nan), 0, last)
        covariance = self._whole_covariance()[part, part].copy()
        return AxisEstimate(self.recursion.theta[part].copy(), covariance, samples, last)

    def _whole_covariance(self) -> Array:
        """Covariance of all free parameters, worked out once for all axes."""
        learnt = float(self.recursion.clock[loop.LEARNT])
        if self._covariance[0] != learnt:
            self._covariance = (learnt, coloured_covariance(self.recursion.root, self.recursion.scores))
        return self._covariance[1]


def _sums(values: Array, starts: npt.NDArray[np.int64]) -> Array:
    """Sums of the rows between starts, (len(starts), columns)."""
    if not len(starts):
        return np.empty((0, values.shape[1]))
    return np.asarray(np.add.reduceat(values, starts, axis=0))


def _same_body(one: Body, other: Body) -> bool:
    return all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in zip(one, other, strict=True))


def _model_with(model: FlightModel, aircraft: Aircraft, body: Body, origin: Array) -> FlightModel:
    """The flight model with the mass properties of ``body`` and the gravity at ``origin``."""
    shift = aircraft.imu_position - body.imu
    inertia = body.inertia
    return model._replace(
        mass=float(body.mass),
        inertia=(float(inertia[0, 0]), float(inertia[1, 1]), float(inertia[2, 2]), float(-inertia[0, 2])),
        gravity=float(gravity(origin[0], origin[2])),
        reference=_vector(body.reference),
        imu=_vector(body.imu),
        gps=_vector(aircraft.gps_position - shift),
        probe=_vector(aircraft.air_data_position - shift),
    )


def _vector(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
