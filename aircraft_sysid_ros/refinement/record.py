"""The 18 outputs (6.3) of a flight on one grid, with the inputs of the model and a reference motion.

The grid is made of groups of consecutive IMU samples: their mean is the output at their mean time, so that nothing is
interpolated. Where the IMU is sparse it has a time for each of its samples, and times between them without an output of
the IMU. Other samples belong to the nearest grid time; what the reference motion, that of the first step, says
that they would have changed by until then (10 ms at most) is added. Sensor delays of the aircraft file are taken out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import speed_of_sound
from aircraft_sysid_ros.aircraft.configuration import SURFACES, Aircraft
from aircraft_sysid_ros.aircraft.earth import gravity, ned_along
from aircraft_sysid_ros.aircraft.frames import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
    rotation_matrix,
)
from aircraft_sysid_ros.aircraft.signals import MOST_INPUTS, SIGNAL_COUNT
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_model.dynamics import fill_flow_rates, fill_model_signals
from aircraft_sysid_ros.flight_model.layout import (
    AIRSPEED,
    ALPHA,
    ATTITUDE,
    ATTITUDE_VECTOR,
    BETA,
    CONTROL_COUNT,
    DENSITY,
    FORCE,
    GPS_POSITION,
    GPS_VELOCITY,
    GYRO,
    HEIGHT,
    INPUT_SIZE,
    MIDDLE_SIZE,
    NAMED,
    OUTPUT_SIZE,
    REFERENCE,
    SPEED_OF_SOUND,
    STATE_SIZE,
    TIME,
    FlightModel,
    flight_model_of,
)
from aircraft_sysid_ros.identification.coefficients.ground import ground_of
from aircraft_sysid_ros.identification.coefficients.pace import sparse_interval
from aircraft_sysid_ros.identification.coefficients.signals import named_inputs
from aircraft_sysid_ros.reconstruction.drift import Drift
from aircraft_sysid_ros.reconstruction.filter_setup import measured_at, stamp_delays
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.servo_lag import servo_lag
from aircraft_sysid_ros.reconstruction.smoother_history import SmootherHistory
from aircraft_sysid_ros.reconstruction.sparse_imu import LONG
from aircraft_sysid_ros.reconstruction.state import StateField, Status, in_moving_air
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.refinement.resampling import LONGEST_STEP, cubic, dense_rows, sharpened
from aircraft_sysid_ros.samples import CONTROL_COLUMNS, Kind, Samples, flight_at, is_absurd
from aircraft_sysid_ros.stamps import nanoseconds

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]

#: Longest distance [s] of a control sample.
_SETTLE = 0.2
#: A value that leaps from the mean of its neighbours by more than this many times the usual leap is a fault.
_FAULT = 50.0
#: A step [s] that is no sample lost: between manoeuvres, whose IMUs may have rates of their own.
_APART = 1.0


@dataclass(frozen=True)
class FlightRecord:
    """N times of a flight, as the flight model wants them."""

    model: FlightModel
    stamp: Integers  # (N,) [ns]
    time: Array  # (N,) [s]
    inputs: Array  # (N, INPUT_SIZE + MIDDLE_SIZE), with controls in the middle of each step
    outputs: Array  # (N, 18), NaN: not measured then
    states: Array  # (N, 16) of the first step, at the centre of gravity
    in_flight: Mask  # (N,) and all inputs there
    missing: frozenset[str]  # signals that were never measured
    step: float  # [s]
    longest_step: float  # [s] that is regular: 1.5 times as much is a gap

    @property
    def measured(self) -> Mask:
        """Which outputs (18,) are there at all in flight."""
        return np.asarray(np.any(np.isfinite(self.outputs[self.in_flight]), axis=0))

    def signals(self) -> Array:
        """Signals (N, SIGNAL_COUNT) of the reference motion."""
        out = np.zeros((len(self.time), SIGNAL_COUNT))
        for k, x in enumerate(self.states):
            u = rotation_matrix(x[ATTITUDE]).T @ (x[0:3] - x[13:16])
            fill_model_signals(u, x[10:13], self.inputs[k], self.model.geometry, out[k])
            force = self.outputs[k, FORCE : FORCE + 3]
            if self.model.has_flow_rates and np.isfinite(force).all():
                fall = self.model.gravity * rotation_matrix(x[ATTITUDE])[2]
                fill_flow_rates(u, x[10:13], force, fall, self.model.geometry, out[k])
        return out


def record_of(aircraft: Aircraft, samples: Samples, rate: float, options: StateOptions | None = None) -> FlightRecord:
    """Record of a flight at about ``rate`` [Hz]; raises InputError where samples do not make a flight."""
    with SmootherHistory() as tape:
        estimator = StateEstimator(aircraft, options, tape)
        estimator.push(samples)
        estimator.flush()
        if not estimator.has_been_aligned or estimator.epoch is None:
            raise InputError("the samples of the run give no state: replay the recording again")
        rows = in_moving_air(estimator.smooth())
    interval, known = sparse_interval(samples), np.ones(len(rows), np.bool_)
    if interval > 0.0:
        rows, known = dense_rows(rows, interval)
    first, every = _groups(rows, rate)
    if not len(first):
        raise InputError("the IMU samples of the run have gaps everywhere: nothing can be refined")
    time = _mean(rows[:, StateField.TIME], first, every)
    states = _states(rows, first, every)
    samples = servo_lag(aircraft).follow(samples)
    times = measured_at(samples, stamp_delays(aircraft), estimator.epoch)
    values = np.where(is_absurd(samples), np.nan, samples.values)
    values = _corrected(aircraft, samples, times, values, rows[:, StateField.TIME])
    inputs, missing = _inputs(aircraft, samples.kind, times, values, rows, states, time, first, every)
    origin = rows[first[0], StateField.ORIGIN]
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0 / rate
    longest_step = LONGEST_STEP if interval > 0.0 else step
    outputs = _outputs(aircraft, samples.kind, times, values, rows, time, first, every, longest_step)
    outputs[~known[first], : GYRO + 3] = np.nan
    airspeed = _mean(rows[:, StateField.AIRSPEED], first, every)
    status = rows[first, StateField.STATUS]
    finite = np.all(np.isfinite(inputs), axis=1) & np.all(np.isfinite(states), axis=1)
    in_flight = finite & (airspeed >= aircraft.minimum_airspeed) & (status != Status.WAITING)
    model = flight_model_of(aircraft, float(gravity(origin[0], origin[2])), int(np.median(every)))
    outputs = _without_outliers(outputs, in_flight, time if interval > 0.0 else None)
    return FlightRecord(
        model, nanoseconds(time, estimator.epoch), time, inputs, outputs, states, in_flight, missing,
        step, longest_step,
    )  # fmt: skip


def _corrected(aircraft: Aircraft, samples: Samples, times: Array, values: Array, states: Array) -> Array:
    """Values (n, …) without the stated errors of the air data; a drift begins with the first state [s] of a flight."""
    drift, values = Drift(aircraft), values.copy()
    flight = flight_at(samples)
    for number in range(int(flight.max(initial=0)) + 1):
        own = flight == number
        first = int(np.searchsorted(states, times[own].min(initial=np.inf)))
        drift.since = float(states[min(first, len(states) - 1)])
        values[own] = drift.corrected(times[own], samples.kind[own], values[own])
    return values


def _groups(rows: Array, rate: float) -> tuple[Integers, Integers]:
    """First row and number of rows of each group of IMU samples that is one grid step, without gaps inside."""
    time, starts, counts = rows[:, StateField.TIME], [], []
    steps = np.diff(time)
    for manoeuvre in np.split(np.arange(len(time)), np.flatnonzero((steps > _APART) | (steps <= 0.0)) + 1):
        own = np.diff(time[manoeuvre])
        interval = float(np.median(own)) if len(own) else 1.0
        every = max(round(1.0 / (rate * interval)), 1)
        for part in np.split(manoeuvre, np.flatnonzero(own > 1.5 * interval) + 1):
            starts.append(part[: len(part) // every * every : every])
            counts.append(np.full(len(starts[-1]), every))
    return np.concatenate(starts), np.concatenate(counts)


def _mean(series: Array, first: Integers, every: Integers) -> Array:
    """Means over groups of ``every`` rows that begin at ``first``."""
    out = np.empty((len(first), *series.shape[1:]))
    for count in np.unique(every).tolist():
        own = every == count
        out[own] = np.mean([series[first[own] + k] for k in range(count)], axis=0)
    return out


def _states(rows: Array, first: Integers, every: Integers) -> Array:
    states, turned = np.empty((len(first), STATE_SIZE)), np.empty((len(first), 4))
    attitude = rows[:, StateField.ATTITUDE]
    for count in np.unique(every).tolist():
        own = every == count
        of_group = np.stack([attitude[first[own] + k] for k in range(count)], 1)
        same_side = np.sign(np.sum(of_group[:, :1] * of_group, axis=2))
        turned[own] = np.sum(same_side[:, :, None] * of_group, axis=1)
    states[:, 0:3] = _mean(rows[:, StateField.VELOCITY], first, every)
    states[:, 3:6] = _mean(rows[:, StateField.POSITION], first, every)
    states[:, 6:10] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    states[:, 10:13] = _mean(rows[:, StateField.ANGULAR_VELOCITY], first, every)
    states[:, 13:16] = _mean(rows[:, StateField.WIND], first, every)
    return states


def _inputs(
    aircraft: Aircraft,
    kinds: Integers,
    times: Array,
    values: Array,
    rows: Array,
    states: Array,
    time: Array,
    first: Integers,
    every: Integers,
) -> tuple[Array, frozenset[str]]:
    """Inputs (N, INPUT_SIZE + MIDDLE_SIZE) and the signals that are never measured.

    Columns of those are 0, and of those that no term reads where they are not known: no second of flight is lost by it.
    """
    inputs = np.zeros((len(time), INPUT_SIZE + MIDDLE_SIZE))
    names = (*CONTROL_COLUMNS, *aircraft.model.inputs)
    is_read = np.array([name in aircraft.model.signals_used for name in names])
    signs = np.array([*(aircraft.surface_signs[s] for s in SURFACES), 1.0, 1.0, 1.0])
    middle = 0.5 * (time + np.concatenate([time[:1], time[:-1]]))
    for first_control, first_named, at in ((0, NAMED.start, time), (INPUT_SIZE, INPUT_SIZE + CONTROL_COUNT, middle)):
        controls = _series(Kind.CONTROLS, CONTROL_COUNT, kinds, times, values, at) * signs
        order = _in_order(Kind.INPUTS, kinds, times)
        named = named_inputs(len(aircraft.inputs), times[order], values[order], at, partial(cubic, longest=_SETTLE))
        both = np.hstack([controls, named])
        never = ~np.any(np.isfinite(both), axis=0)
        both[:, never] = 0.0
        both[:, : len(names)][np.isnan(both[:, : len(names)]) & ~is_read] = 0.0
        inputs[:, first_control : first_control + CONTROL_COUNT] = both[:, :CONTROL_COUNT]
        inputs[:, first_named : first_named + MOST_INPUTS] = both[:, CONTROL_COUNT:]
    inputs[:, DENSITY] = _mean(rows[:, StateField.AIR_DENSITY], first, every)
    altitude = rows[first, StateField.ORIGIN.stop - 1] - states[:, 5]
    ground, height = ground_of(aircraft, rows), _series(Kind.HEIGHT, 1, kinds, times, values, time)[:, 0]
    if np.isnan(ground) and np.isfinite(height).any():
        ground = float(np.nanmedian(altitude - height))
    inputs[:, HEIGHT] = np.where(np.isfinite(height), height, altitude - ground) if np.isfinite(ground) else 0.0
    inputs[:, SPEED_OF_SOUND] = [speed_of_sound(h) for h in altitude]
    inputs[:, TIME] = time - time[0]
    inputs[:, REFERENCE] = states[:, ATTITUDE]
    no_ground = {"height"} if np.isnan(ground) else set()
    return inputs, frozenset(name for name, gone in zip(names, never, strict=False) if gone) | no_ground


def _series(kind: Kind, width: int, kinds: Integers, times: Array, values: Array, at: Array) -> Array:
    order = _in_order(kind, kinds, times)
    return cubic(times[order], np.ascontiguousarray(values[order, :width]), at, _SETTLE)


def _in_order(kind: Kind, kinds: Integers, times: Array) -> Integers:
    """Which samples are of a kind, in order of time."""
    chosen = np.flatnonzero(kinds == kind)
    return chosen[np.argsort(times[chosen], kind="stable")]


def _outputs(
    aircraft: Aircraft,
    kinds: Integers,
    times: Array,
    values: Array,
    rows: Array,
    time: Array,
    first: Integers,
    every: Integers,
    longest_step: float,
) -> Array:
    """Outputs (N, 18); the IMU as measured, that is with the biases that the rows are without."""
    y = np.full((len(time), OUTPUT_SIZE), np.nan)
    force = rows[:, StateField.SPECIFIC_FORCE] + rows[:, StateField.ACCELEROMETER_BIAS]
    y[:, FORCE : FORCE + 3] = sharpened(_mean(force, first, every), time, every)
    rates = _mean(rows[:, StateField.ANGULAR_VELOCITY] + rows[:, StateField.GYRO_BIAS], first, every)
    y[:, GYRO : GYRO + 3] = sharpened(rates, time, every)
    row_time = rows[:, StateField.TIME]

    def put(kind: Kind, at: int, found: Array, reference: Array | None) -> None:
        """Mean of the samples (m, k) at each grid time, carried there along the reference (rows, k)."""
        seen = times[kinds == kind]
        nearest, near = _nearest(time, seen, longest_step)
        if reference is not None:
            for j in range(found.shape[1]):
                column = reference[:, j]
                found[:, j] += np.interp(time[nearest], row_time, column) - np.interp(seen, row_time, column)
        for j in range(found.shape[1]):
            there = near & np.isfinite(found[:, j])
            count = np.bincount(nearest[there], minlength=len(time))
            total = np.bincount(nearest[there], weights=found[there, j], minlength=len(time))
            y[count > 0, at + j] = total[count > 0] / count[count > 0]

    def of(kind: Kind, width: int) -> Array:
        return values[kinds == kind, :width].copy()

    geodetic = of(Kind.GPS_POSITION, 3)
    row, _ = _nearest(row_time, times[kinds == Kind.GPS_POSITION], longest_step)
    origins = rows[row, StateField.ORIGIN]  # a manoeuvre has its own
    position = np.full_like(geodetic, np.nan)
    for origin in np.unique(origins[np.isfinite(origins).all(axis=1)], axis=0):
        own = (origins == origin).all(axis=1)
        position[own] = ned_along(geodetic[own], origin)
    put(Kind.GPS_POSITION, GPS_POSITION, position, rows[:, StateField.POSITION])
    put(Kind.GPS_VELOCITY, GPS_VELOCITY, of(Kind.GPS_VELOCITY, 3), rows[:, StateField.VELOCITY])
    for kind, at, column in (
        (Kind.AIRSPEED, AIRSPEED, StateField.AIRSPEED),
        (Kind.ANGLE_OF_ATTACK, ALPHA, StateField.ANGLE_OF_ATTACK),
        (Kind.SIDESLIP, BETA, StateField.SIDESLIP),
    ):
        put(kind, at, of(kind, 1), rows[:, column : column + 1])
    if np.any(kinds == Kind.ATTITUDE):
        turns = _attitude_errors(of(Kind.ATTITUDE, 4), times[kinds == Kind.ATTITUDE], rows)
        put(Kind.ATTITUDE, ATTITUDE_VECTOR, turns, None)
    elif aircraft.magnetic_declination is not None:
        heading = _heading_errors(
            of(Kind.MAGNETIC_FIELD, 3), times[kinds == Kind.MAGNETIC_FIELD], rows, aircraft.magnetic_declination
        )
        put(Kind.MAGNETIC_FIELD, ATTITUDE_VECTOR + 2, heading, None)
    return y


def _nearest(time: Array, at: Array, longest_step: float) -> tuple[Integers, Mask]:
    """Index of the nearest grid time, and whether it is within half of the longest step."""
    right = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    nearest = np.where(at - time[right - 1] < time[right] - at, right - 1, right)
    return nearest, np.abs(time[nearest] - at) <= 0.51 * longest_step


def _attitude_at(at: float, rows: Array) -> Array:
    """Reference attitude (4,) at a time, from the row before it and its rates."""
    k = int(np.clip(np.searchsorted(rows[:, StateField.TIME], at) - 1, 0, len(rows) - 1))
    turn = rows[k, StateField.ANGULAR_VELOCITY] * np.clip(at - rows[k, StateField.TIME], -0.1, 0.1)
    return np.asarray(quaternion_product(rows[k, StateField.ATTITUDE], quaternion_exp(turn)))


def _attitude_errors(quaternions: Array, at: Array, rows: Array) -> Array:
    """Rotation vectors (m, 3), NED axes, from the reference attitude to that measured."""
    out = np.empty((len(at), 3))
    for i, (q, t) in enumerate(zip(quaternions, at, strict=True)):
        size = float(np.sqrt(np.sum(q * q)))
        unit = q / size if size > 0.0 else np.full(4, np.nan)
        out[i] = quaternion_log(quaternion_product(unit, quaternion_conjugate(_attitude_at(t, rows))))
    return out


def _heading_errors(fields: Array, at: Array, rows: Array, declination: float) -> Array:
    """Headings (m, 1) of the magnetic field over those of the reference attitude; NaN where it is vertical."""
    out = np.full((len(at), 1), np.nan)
    for i, (field, t) in enumerate(zip(fields, at, strict=True)):
        level = rotation_matrix(_attitude_at(t, rows)) @ field
        if np.hypot(level[0], level[1]) > 0.2 * np.sqrt(np.sum(level * level)):
            angle = declination - np.arctan2(level[1], level[0])
            out[i] = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return out


def _without_outliers(outputs: Array, in_flight: Mask, sparse: Array | None) -> Array:
    """Outputs without single values that leap from both neighbours by far more than is usual.

    ``sparse``: the times (N,) [s] where the IMU is sparse; what leaps between samples of IMU or flow that are so far
    apart is motion.
    """
    out = outputs.copy()
    for j in range(OUTPUT_SIZE):
        there = np.flatnonzero(in_flight & np.isfinite(outputs[:, j]))
        if len(there) < 20:
            continue
        moves = not GPS_POSITION <= j < ATTITUDE_VECTOR
        if sparse is not None and moves and np.median(np.diff(sparse[there])) > LONG:
            continue
        y = outputs[there, j]
        leap = np.abs(y[1:-1] - 0.5 * (y[:-2] + y[2:]))
        usual = 1.4826 * float(np.median(leap))
        highest = np.maximum(np.abs(y[1:-1] - y[:-2]), np.abs(y[1:-1] - y[2:]))
        alone = (leap >= 0.4 * highest) & (usual > 0.0)  # not a neighbour of the fault
        out[there[1:-1][alone & (leap > _FAULT * usual)], j] = np.nan
    return out
