"""Second step: states and controls in, aerodynamic parameters out, (6.8)-(6.13) by (4.12)-(4.14)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from copy import copy

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import SURFACES, Aircraft
from aircraft_sysid_ros.aircraft.expression import SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.estimation.lagged_moments import coloured_covariance
from aircraft_sysid_ros.modelling.body import body_of, body_with
from aircraft_sysid_ros.modelling.error_window import AxisError, ErrorWindow
from aircraft_sysid_ros.modelling.gates import Gates
from aircraft_sysid_ros.modelling.good_sets import KnownSet, copied, go_back
from aircraft_sysid_ros.modelling.inferred_angles import InferredAngles
from aircraft_sysid_ros.modelling.learner import Learner, ParameterOptions, check_change, force_noise
from aircraft_sysid_ros.modelling.learners import LEARNERS, make_learner
from aircraft_sysid_ros.modelling.pace import GAP, LOWEST_RATE, Pace
from aircraft_sysid_ros.modelling.parameter_set import ParameterEstimate, ParameterSet, axis_estimates
from aircraft_sysid_ros.modelling.regression import (
    PRIOR_VARIANCE,
    TERM,
    TIME,
    Learning,
    Point,
    Tuning,
    fill_history,
    learn,
    new_learning,
)
from aircraft_sysid_ros.modelling.relearning import KNOWN, Changes, learn_again
from aircraft_sysid_ros.modelling.signals import interpolate, interpolate_sparse
from aircraft_sysid_ros.modelling.trust import TrustRules, check_bounds
from aircraft_sysid_ros.reconstruction.state import Column
from aircraft_sysid_ros.reconstruction.state_estimator import seconds, sensor_delays
from aircraft_sysid_ros.samples import Kind, Samples, is_absurd

__all__ = [
    "LEARNERS", "PRIOR_VARIANCE", "ParameterEstimator", "ParameterOptions", "interpolate", "make_learner",
]  # fmt: skip

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_OWN_KINDS = [int(Kind.CONTROLS), int(Kind.HEIGHT), int(Kind.MASS)]
#: Without a point for so long [s] what is published has the time of the newest state.
STALE = 1.0
#: Batches that wait for the first state; older ones are from before it.
_MOST_EARLY = 10_000
#: Signals that stand in the samples of the controls.
_CONTROL_SIGNALS = frozenset({"de", "da", "dr", "flaps", "Tc", "throttle", "propeller_speed"})
#: Time [s] between samples of the controls over which they are known, beside sparse states.
_SPARSEST_CONTROLS = GAP / LOWEST_RATE
#: Late samples of a kind that are kept, in case the clock began anew and the states have yet to say so.
_MOST_BEHIND = 1000


class ParameterEstimator:
    """Recursive least squares per axis, fed with rows of ``Column`` and samples of controls, height, mass.

    Where ``options.estimator`` names another learner, that one runs too and its parameters are the result.
    """

    def __init__(self, aircraft: Aircraft, options: ParameterOptions | None = None) -> None:
        self.aircraft = aircraft
        self.options = options or ParameterOptions()
        self.model: AerodynamicModel = aircraft.model
        self.late = 0
        self.inferred = InferredAngles()
        self._early: deque[Samples] = deque(maxlen=_MOST_EARLY)
        self._delays = np.rint(sensor_delays(aircraft) * 1e9).astype(np.int64)
        self._signs = np.array([*(aircraft.surface_signs[s] for s in SURFACES), 1.0, 1.0, 1.0])
        self._code = self.model.linked
        check_bounds(aircraft.parameter_bounds)
        self.learner = make_learner(aircraft, self.options)
        self.pace, self._pace_of_controls = Pace(), Pace()
        self._kept_interval = 0.0  # [s] between states that windows, gaps and noise are for
        self._reset_learning()
        self._restart_time()
        self._lowest = np.inf
        self._masses: list[tuple[float, Array]] = []
        self.body = body_of(aircraft)
        self.errors = ErrorWindow(self.options.error_window, self.options.step)

    # -- starting over --------------------------------------------------------------------------------------

    def _reset_learning(self) -> None:
        self.learning = self.empty_learning(self.model)
        self.tuning = self._new_tuning()
        self.changes = Changes(self.options.step)
        self.gates = Gates(self.aircraft, self.options.step, self.tuning.forgetting, self.learner is not None)
        self.newest_point: Array | None = None
        self._signals_seen = np.zeros(len(SIGNALS), np.bool_)
        self._ranges = np.full((3, 2), np.nan)
        self._predictions: list[tuple[float, Array]] = []

    def _new_tuning(self) -> Tuning:
        """Options, with gaps and noise for the rate at which states come now."""
        options = self.options
        return Tuning(
            half_width=options.half_width,
            step=options.step,
            largest_gap=self.pace.largest_gap(options.largest_gap),
            sparse=self.pace.is_sparse,
            sampling=self.pace.sampling_error,
            forgetting=float(np.exp(-options.step / options.forgetting_time)),
            motion_weight=float(1.0 - np.exp(-options.step / 2.0)),
            excitation=options.excitation,
            force_noise=force_noise(self.pace.seen_by(self.aircraft), options),
        )

    def change_options(self, options: ParameterOptions) -> None:
        """Go on with other options: what is learnt from now on is learnt with them. Raises InputError.

        Those that the estimator is made of cannot change, see ``learner.check_change``.
        """
        check_change(self.options, options)
        if options.relearn and not self.options.relearn:
            self.changes.restart()  # its memory is from before it was switched off
        self.options = options
        self.tuning = self._new_tuning()
        self.gates.forget_at(self.tuning.forgetting)
        self.errors.resize(options.error_window, options.step)
        if self.learner is not None:
            self.learner.change_options(options)

    def empty_learning(self, model: AerodynamicModel) -> Learning:
        """Nothing learnt yet of a model."""
        return new_learning(model, max(round(self.options.lag_time / self.options.step), 1))

    def adopt(self, aircraft: Aircraft, learning: Learning, history: Array, learner: Learner | None) -> None:
        """Go on with another model and what is known of it, see ``model_change``; history (n, TERM + terms)."""
        if learner is not None and learner is not self.learner:
            theta = [learning.theta[i, : len(aircraft.model.terms[name])] for i, name in enumerate(AXES)]
            self._predictions = [(-np.inf, np.concatenate(theta))]  # until the new learner knows better
        self.aircraft, self.model, self._code = aircraft, aircraft.model, aircraft.model.linked
        self.learning, self.history, self.learner = learning, history, learner
        self._keep_pace()
        self.changes.restart()
        self.gates.adopt(aircraft)

    def _restart_time(self) -> None:
        self._waiting: list[Array] = []
        self.history = np.empty((0, TERM + len(self.model.parameter_names)))
        self._series: dict[Kind, tuple[Array, Array]] = {
            Kind.CONTROLS: (np.empty(0), np.empty((0, 7))),
            Kind.HEIGHT: (np.empty(0), np.empty((0, 1))),
        }
        self._behind: dict[Kind, list[tuple[float, Array]]] = {kind: [] for kind in self._series}
        self._used_until = -np.inf
        self._newest_time: float | None = None
        self._start_time: float | None = None
        self._next_index = 0
        self.pace.restart()
        self._pace_of_controls.restart()
        self.learning.last_valid[:] = -np.inf
        self.changes.restart()
        self.changes.since[:] = -np.inf
        self.gates.restart()
        if self.learner is not None:
            self.learner.restart_time()
            self._predictions = [(-np.inf, theta) for _, theta in self._predictions[-1:]]

    # -- what comes in --------------------------------------------------------------------------------------

    def push_samples(self, samples: Samples, epoch: int | None, due: Integers | None = None) -> None:
        """Take controls, heights and mass properties; other kinds are passed over.

        ``epoch`` is that of the states; None while no state has come: the samples then wait for it. ``due`` (n,) [ns]
        is the newest time of states that could have come before each sample, where samples come in blocks: what was
        late by then is late, however large the blocks are.
        """
        if epoch is None:
            kept = samples if self.learner is not None else samples[np.isin(samples.kind, _OWN_KINDS)]
            self._early.append(kept)
            return
        if self.learner is not None:
            self.learner.push_samples(samples, epoch)
        times = seconds(samples.stamp - self._delays[samples.kind], epoch)
        values = np.where(is_absurd(samples), np.nan, samples.values)
        for kind in (Kind.CONTROLS, Kind.HEIGHT):
            chosen = samples.kind == kind
            if chosen.any():
                used = None if due is None else seconds(due[chosen], epoch) - self.options.settle
                self._insert(kind, times[chosen], values[chosen], used)
        for i in np.flatnonzero(samples.kind == Kind.MASS):
            self._masses.append((float(times[i]), values[i]))
            self._masses.sort(key=lambda item: item[0])

    def push_states(self, rows: Array, epoch: int | None = None) -> Array:
        """Take rows (n, Column.WIDTH) in order of time; returns new points (m, Point.TERMS + terms)."""
        if not len(rows):
            return self._no_points()
        while epoch is not None and self._early:
            self.push_samples(self._early.popleft(), epoch)
        falls = np.flatnonzero(rows[1:, Column.TIME] <= rows[:-1, Column.TIME]) + 1
        if len(falls):
            return np.vstack([self.push_states(part, epoch) for part in np.split(rows, falls)])
        before = self._no_points()
        if self._newest_time is not None and rows[0, Column.TIME] <= self._newest_time:
            before = self.restart_clock()
        self.inferred.note(rows)
        self._waiting.append(rows)
        self._newest_time = float(rows[-1, Column.TIME])
        points = self._process_until(self._newest_time - self.options.settle)
        return np.vstack([before, points]) if len(before) else points

    def restart_clock(self) -> Array:
        """The clock of the states begins anew: what waits is used, what was learnt stays; returns new points.

        Samples by the new clock that have come before this were late by the old one, and are taken now.
        """
        points, behind = self._process_until(np.inf), self._behind
        self._restart_time()
        for kind, samples in behind.items():
            self.late -= len(samples)
            for time, values in samples:
                self._insert(kind, np.array([time]), values[None])
        return points

    def warm_up(self) -> None:
        """Compile (or load from the cache) the jitted loop before the first sample of a flight."""
        other = ParameterEstimator(self.aircraft, self.options)
        rows = np.zeros((200, Column.WIDTH))
        rows[:, Column.TIME] = 0.01 * np.arange(200)
        rows[:, Column.ATTITUDE.start] = rows[:, Column.STATUS] = 1.0
        rows[:, Column.AIRSPEED] = 2.0 * self.aircraft.minimum_airspeed
        rows[:, [Column.AIR_DENSITY, Column.AIR_VELOCITY_STD]] = 1.0
        other.push_states(rows)
        other.flush()
        other.snapshot()
        n = len(other.learning.theta[0])
        coloured_covariance(np.zeros((2, n + 2, n + 2)), np.zeros(n))
        learn_again(0, other._no_points(), 1.0, other.learning, other.tuning)
        if other.learner is not None:
            other.learner.warm_up()

    def flush(self) -> Array:
        """Process the states that wait for controls, at the end of a recording."""
        return self._process_until(np.inf)

    def reset(self) -> None:
        """Forget all that was learnt."""
        self._reset_learning()
        self.errors.clear()
        if self.learner is not None:
            self.learner.reset()

    # -- one direction: waiting rows -> history -> points --------------------------------------------------

    def _process_until(self, limit: float) -> Array:
        if not self._waiting:
            return self._no_points()
        rows = np.vstack(self._waiting)
        due = int(np.searchsorted(rows[:, Column.TIME], limit, side="right"))
        self._waiting = [rows[due:]] if due < len(rows) else []
        if not due:
            return self._no_points()
        return np.vstack([self._process_at_paces(part) for part in self._parts_of_one_mass(rows[:due])])

    def _process_at_paces(self, rows: Array) -> Array:
        points = []
        for part in self.pace.follow(rows[:, Column.TIME]):
            if self.pace.interval != self._kept_interval:
                self._keep_pace()
            points.append(self._process(rows[part]))
        return np.vstack(points)

    def _keep_pace(self) -> None:
        self._kept_interval = self.pace.interval
        self.tuning = self._new_tuning()
        if self.learner is not None:
            self.learner.keep_pace(self.pace)

    def _controls(self, times: Array) -> Array:
        """Controls (n, 7) at times [s] of states, with the signs of the aircraft file."""
        settle, series = self.options.settle, self._series[Kind.CONTROLS]
        if self.pace.is_sparse:
            return interpolate_sparse(*series, times, _SPARSEST_CONTROLS, settle) * self._signs
        held = 2.0 / self.aircraft.sensors["control_surfaces"].rate
        return interpolate(*series, times, settle, held) * self._signs

    def _process(self, rows: Array) -> Array:
        times, settle = rows[:, Column.TIME], self.options.settle
        if self._start_time is None:
            self._start_time = float(times[0])
            self._next_index = int(np.ceil(times[0] / self.options.step))
        controls = self._controls(times)
        heights = interpolate(*self._series[Kind.HEIGHT], times, settle, settle)[:, 0]
        heights = np.where(np.isfinite(heights), heights, self._height_from_gps(rows))
        history = np.empty((len(rows), TERM + len(self.model.parameter_names)))
        sensors = np.array(
            [self.aircraft.sensors["gyro"].noise[0], self.aircraft.sensors["control_surfaces"].noise[0]]
        )
        fill_history(rows, controls, heights, self.body, sensors, *self._code, self._start_time, history)
        self._prune(float(times[-1]))
        points = []
        for part in self.changes.parts(times):
            if self.changes.is_due(float(times[part.start])):
                if self.options.relearn:
                    self._look_for_changes(float(times[part.start]))
                self._pass_gates(float(times[part.start]))
            self.changes.take_rows(rows[part])
            self.gates.signs.take(rows[part])
            points.append(self._take(rows[part], history[part]))
        return np.vstack(points)

    def _look_for_changes(self, time: float) -> None:
        area = float(self.body.geometry[0])
        openings = self.changes.look(self.model, self.learning, self.tuning, area)
        for opening in openings:
            self.changes.times[opening.axis] = opening.since - (self._start_time or 0.0)
            self.gates.note_change(opening.axis, time)
        if self.learner is None:
            return
        if openings:
            self._predictions = [(-np.inf, self.learner.relearn(openings))]
        for axis in range(6):
            known = self.changes.relearnt(axis, self.model, self.learning) if self.learner.waits(axis) else None
            if known is not None:
                self._predictions = [(-np.inf, self.learner.take_over(axis, known))]

    def _pass_gates(self, time: float) -> None:
        """May what is known at ``time`` [s] be used? Where a sensor had been wrong, go back to before it."""
        releases = self.gates.look(time, self.learning.updates >= KNOWN)
        for axis, good in releases:
            go_back(axis, self.model, self.learning, good.learning)
            self.changes.undo(axis, good.changed[:, axis])
            self._ranges[:] = good.ranges
        if releases and self.learner is not None:
            oldest = min((good for _, good in releases), key=lambda good: good.time)
            self._predictions = [(-np.inf, self.learner.recall(oldest.learner))]
        if self.newest_point is not None and self.gates.sets.is_due(time):
            learning = copied(self.learning)
            learner = None if self.learner is None else self.learner.remember()
            changed = np.array([self.changes.since, self.changes.times])
            self.gates.keep(KnownSet(time, self._describe(learning), learning, learner, changed, self._ranges.copy()))

    def _take(self, rows: Array, history: Array) -> Array:
        self.history = np.vstack([self.history, history])
        if self.learner is not None:
            self._predictions.extend(zip(*self.learner.push(rows, history, self.body), strict=True))
        return self._learn()

    def _learn(self) -> Array:
        span = self.history[-1, TIME] - self._next_index * self.options.step
        most = max(int(span / self.options.step) + 2, 0)
        points = np.empty((most, Point.TERMS + len(self.model.parameter_names)))
        self._next_index, count = learn(
            self.history, self._next_index, self.body, *self._code, self.learning, self.tuning, points
        )
        oldest = self._next_index * self.options.step - self.options.half_width - 0.5
        self.history = self.history[int(np.searchsorted(self.history[:, TIME], oldest)) :]
        points = points[:count]
        if count:
            if self.options.relearn:
                self.changes.take(points)
            if self.learner is not None:
                self._predict(points)
            self._signals_seen |= np.any(np.isfinite(points[:, Point.SIGNALS]), axis=0)
            self._widen_ranges(points)
            self.errors.add(points)
            self.gates.take(points)
            self.newest_point = points[-1]
        return points

    def _predict(self, points: Array) -> None:
        """Predict with what the learner knew before the window of each point began, in place."""
        for point in points:
            begin = point[Point.TIME] - self.options.half_width
            while len(self._predictions) > 1 and self._predictions[1][0] <= begin:
                self._predictions.pop(0)
            known = bool(self._predictions) and self._predictions[0][0] <= begin
            theta = self._predictions[0][1] if known else np.zeros(len(self.model.parameter_names))
            each = point[Point.TERMS :] * theta
            for axis, name in enumerate(AXES):
                if self.learner is not None and self.learner.waits(axis):
                    continue  # the prediction of least squares stands there
                point[Point.PREDICTED.start + axis] = each[self.model.axis_slice(name)].sum()

    def _height_from_gps(self, rows: Array) -> Array:
        altitude = rows[:, Column.ORIGIN.stop - 1] - rows[:, Column.POSITION.stop - 1]
        if self.aircraft.ground_altitude is not None:
            return altitude - self.aircraft.ground_altitude
        lowest = np.minimum.accumulate(np.minimum(altitude, self._lowest))
        self._lowest = float(lowest[-1])
        return altitude - lowest

    def _parts_of_one_mass(self, rows: Array) -> Iterator[Array]:
        """Rows split where mass properties change; the body is changed in between."""
        while self._masses and self._masses[0][0] <= rows[-1, Column.TIME]:
            time, values = self._masses.pop(0)
            at = int(np.searchsorted(rows[:, Column.TIME], time))
            if at:
                yield rows[:at]
            rows = rows[at:]
            self.body = body_with(self.aircraft, self.body, values)
        yield rows

    def _insert(self, kind: Kind, times: Array, values: Array, used: Array | None = None) -> None:
        """Keep a series sorted; what comes after its time was used, or could have been (n,) [s], is late."""
        in_time = times > (self._used_until if used is None else np.maximum(used, self._used_until))
        self.late += int((~in_time).sum())
        if in_time.any():
            self._behind[kind].clear()
        self._behind[kind].extend(zip(times[~in_time].tolist(), values[~in_time], strict=True))
        del self._behind[kind][:-_MOST_BEHIND]
        old_times, old_values = self._series[kind]
        all_times = np.concatenate([old_times, times[in_time]])
        all_values = np.vstack([old_values, values[in_time, : old_values.shape[1]]])
        order = np.argsort(all_times, kind="stable")
        self._series[kind] = (all_times[order], all_values[order])

    def _prune(self, used_until: float) -> None:
        times = self._series[Kind.CONTROLS][0]
        self._pace_of_controls.take(times[(times > self._used_until) & (times <= used_until)])
        self._used_until = used_until
        for kind, (times, values) in self._series.items():
            keep = max(int(np.searchsorted(times, used_until)) - 2, 0)
            self._series[kind] = (times[keep:], values[keep:])

    # -- what was learnt ------------------------------------------------------------------------------------

    def snapshot(self) -> ParameterSet:
        """What is published now: ``estimates`` that have passed the gates, or what was known before."""
        return self.gates.gated(self.estimates(), self.changes.since, self._start_time or 0.0)

    @property
    def time(self) -> float:
        """Time [s] of the newest point, of the newest state where no point came for STALE; NaN before any."""
        if self.newest_point is None:
            return np.nan
        newest = float(self.newest_point[Point.TIME])
        return self._used_until if self._used_until > newest + STALE else newest

    def estimates(self) -> ParameterSet:
        """The parameters now, with standard errors corrected for coloured residuals and a verdict on each."""
        return self._describe(self.learning)()

    def _describe(self, learning: Learning) -> Callable[[], ParameterSet]:
        """``estimates`` of now, made when it is called: of ``learning``, which must not have changed by then."""
        model, time, point, bounds = self.model, self.time, self.newest_point, self.aircraft.parameter_bounds
        waits = [self.learner is None or self.learner.waits(axis) for axis in range(len(AXES))]
        own = [None if waits[axis] or self.learner is None else self.learner.axis(axis) for axis in range(len(AXES))]
        missing = [self._missing(axis) for axis in range(len(AXES))]
        changed, inferred = self.changes.times.tolist(), copy(self.inferred)
        ranges = [(float(low), float(high)) for low, high in self._ranges]

        def described() -> ParameterSet:
            names = model.parameter_names
            covariance = np.full((len(names), len(names)), np.nan)
            estimates: list[ParameterEstimate] = []
            for axis, name in enumerate(AXES):
                part = model.axis_slice(name)
                block = axis_estimates(model, axis, learning, time, missing[axis], own[axis], changed[axis], bounds)
                estimates.extend(block[0])
                covariance[part, :] = covariance[:, part] = 0.0
                covariance[part, part] = block[1]
            found = ParameterSet(time, model.identifier, tuple(estimates), covariance, ranges[0], ranges[1], ranges[2])
            return inferred.widened(found, model, point)

        return described

    def model_error(self) -> list[AxisError]:
        """Measured against predicted coefficients over the sliding window."""
        return self.errors.summary()

    def _missing(self, axis: int) -> str:
        """What keeps an axis from being learnt, in words; empty where nothing but motion does."""
        few = self.learning.updates[axis] < TrustRules().samples
        if few and self.pace.is_too_slow:
            return f"the IMU comes at {self.pace.rate:.2g} Hz: derivatives need at least {LOWEST_RATE:g} Hz"
        used = {int(row[1]) for program in self.model.programs[axis] for row in program.code if row[0] == 1}
        needed = [SIGNALS[k] for k in sorted(used)]
        controls = ", ".join(name for name in needed if name in _CONTROL_SIGNALS)
        unseen = [name for name in needed if not self._signals_seen[SIGNALS.index(name)]]
        nothing = self.newest_point is not None and not self.learning.updates[axis]
        never = (few and self.pace.is_sparse) or (nothing and {*unseen} & _CONTROL_SIGNALS)
        if controls and never and self._pace_of_controls.interval > _SPARSEST_CONTROLS:
            rate = f"{self._pace_of_controls.rate:.2g} Hz"
            return f"needs {controls}, which comes at {rate}: at least {LOWEST_RATE:g} Hz are needed"
        return f"needs {', '.join(unseen)}, which is not measured" if nothing and unseen else ""

    def _widen_ranges(self, points: Array) -> None:
        learnt = points[np.any(points[:, Point.LEARNT] > 0.0, axis=1)]
        if len(learnt):
            columns = learnt[:, Point.SIGNALS][:, [SIGNAL_INDEX[s] for s in ("V", "alpha", "beta")]]
            self._ranges[:, 0] = np.fmin(self._ranges[:, 0], columns.min(axis=0))
            self._ranges[:, 1] = np.fmax(self._ranges[:, 1], columns.max(axis=0))

    def _no_points(self) -> Array:
        return np.empty((0, Point.TERMS + len(self.model.parameter_names)))
