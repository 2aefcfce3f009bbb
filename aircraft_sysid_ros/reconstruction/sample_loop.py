"""The jitted loop of the first step: samples in time order in, a row of states per IMU sample out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import air_density, density_of, temperature
from aircraft_sysid_ros.aircraft.frames import three
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.air_data_errors import settle
from aircraft_sysid_ros.reconstruction.error_state import jacobian_of, retract, turn_attitude_error
from aircraft_sysid_ros.reconstruction.fusion import fuse, is_finite
from aircraft_sysid_ros.reconstruction.innovations import air_speed
from aircraft_sysid_ros.reconstruction.measurements import air_velocity_at
from aircraft_sysid_ros.reconstruction.process import propagate
from aircraft_sysid_ros.reconstruction.pseudo_measurements import (
    count_heading_from_now,
    hold_wind,
    is_due,
    is_wind_due,
    lacks_vane,
    update_by,
)
from aircraft_sysid_ros.reconstruction.sensor_noise import (
    imu_scales,
    largest_scale,
    learn_imu,
)
from aircraft_sysid_ros.reconstruction.smoother_history import HAS_ROW, record_step
from aircraft_sysid_ros.reconstruction.sparse_imu import (
    LONG,
    held_motion,
    hidden_motion,
    is_sparse,
    mean_beyond_line,
    missed_by_line,
    missed_by_parabola,
    note_motion,
    second_difference,
)
from aircraft_sysid_ros.reconstruction.state import AIR_VELOCITY, ERROR_SIZE, NO_GUIDE, Memory, Setup
from aircraft_sysid_ros.reconstruction.state_row import write_row
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

_IMU, _AIR, _ATTITUDE = int(Kind.IMU), int(Kind.AIR), int(Kind.ATTITUDE)
_MAGNETIC_FIELD = int(Kind.MAGNETIC_FIELD)
_AIRSPEED, _ALPHA, _BETA = int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP)
_GPS_POSITION, _GPS_VELOCITY = int(Kind.GPS_POSITION), int(Kind.GPS_VELOCITY)

RUNNING, GAP, DIVERGED, ELSEWHERE = 0, 1, 2, 3


@njit(cache=True)
def _is_flying(x: Array, rate: Array, values: Array, kind: int, setup: Setup) -> bool:
    """Air data mean something: measured or expected airspeed is above the least that flies."""
    if kind == _AIRSPEED:
        return values[0] >= setup.minimum_airspeed
    u, v, w = air_velocity_at(x, rate, setup.probe_from_imu)
    return bool(np.sqrt(u * u + v * v + w * w) >= setup.minimum_airspeed)


@njit(cache=True)
def _take(kind: int, values: Array, x: Array, p: Array, rate: Array, time: float, setup: Setup, memory: Memory) -> None:
    """Fuse or note one sample that is not an IMU sample."""
    if kind == _AIR:
        altitude = setup.origin[2] - x[5]
        density = values[0]
        if not density > 0.0 and values[1] > 0.0:
            density = density_of(values[1], temperature(altitude))
        if density > 0.0:
            memory.air[0], memory.air[1], memory.air[2] = density, density / air_density(altitude), time
        if np.isnan(setup.origin[0]) and values[1] > 0.0:  # nothing else shows the height
            fuse(kind, values, x, p, rate, time, setup, memory)
        return
    is_air_data = kind == _AIRSPEED or kind == _ALPHA or kind == _BETA
    if is_air_data and not _is_flying(x, rate, values, kind, setup):
        memory.skipped[kind] += 1
        return
    fuse(kind, values, x, p, rate, time, setup, memory)


@njit(cache=True)
def _move(x: Array, p: Array, delta: Array, memory: Memory) -> None:
    """State and covariance after a pseudo-measurement, of which ``delta`` is the error; in place."""
    memory.moved[-1, : len(delta)] += delta
    turn_attitude_error(p, jacobian_of(delta))
    moved = retract(x, delta)
    if len(p) > ERROR_SIZE:
        settle(three(x[AIR_VELOCITY]), x, delta, moved, p)
    x[:] = moved


@njit(cache=True)
def _assume_angles(x: Array, p: Array, time: float, setup: Setup, memory: Memory) -> None:
    for kind in (_ALPHA, _BETA):
        if is_due(kind, time, setup, x, memory):
            _move(x, p, update_by(kind, x, p), memory)
            memory.assumed[kind] = time


@njit(cache=True)
def _hold_wind(x: Array, p: Array, time: float, setup: Setup, memory: Memory) -> None:
    for axis in range(3):
        _move(x, p, hold_wind(axis, x, p, setup.wind_std[axis], memory.wind_walk[0]), memory)
    if setup.guide == NO_GUIDE and memory.fused[_ATTITUDE] == 0 and memory.fused[_MAGNETIC_FIELD] == 0:
        count_heading_from_now(x, p)
    memory.assumed[_GPS_VELOCITY] = time


@njit(inline="always")  # as _passes_gate
def _assume(x: Array, p: Array, time: float, setup: Setup, memory: Memory) -> None:
    """Pseudo-measurements in place of vanes and GPS that are not there, when they are due; x, p in place."""
    if lacks_vane(memory.fused, memory.rejected, memory.skipped):
        _assume_angles(x, p, time, setup, memory)
    if is_wind_due(time, setup, x, memory):
        _hold_wind(x, p, time, setup, memory)


@njit(cache=True)
def _has_diverged(time: float, last_fused: Array, last_rejected: Array, setup: Setup) -> bool:
    """All of the GPS that still comes rejected for ``divergence_time`` without a break: the state is wrong, not it.

    In a flight without GPS the same of the airspeed.
    """
    position = last_rejected[_GPS_POSITION] - last_fused[_GPS_POSITION]
    velocity = last_rejected[_GPS_VELOCITY] - last_fused[_GPS_VELOCITY]
    if setup.guide == NO_GUIDE:
        position = velocity = last_rejected[_AIRSPEED] - last_fused[_AIRSPEED]
    elif setup.guide == _GPS_POSITION:
        velocity = position
    elif np.isnan(setup.origin[0]):
        position = velocity
    else:
        has_position = time - max(last_fused[_GPS_POSITION], last_rejected[_GPS_POSITION]) < setup.divergence_time
        has_velocity = time - max(last_fused[_GPS_VELOCITY], last_rejected[_GPS_VELOCITY]) < setup.divergence_time
        if has_velocity and not has_position:
            position = velocity
        elif has_position and not has_velocity:
            velocity = position
    return bool(min(position, velocity) > setup.divergence_time)


@njit(cache=True)
def _is_elsewhere(time: float, last_fused: Array, last_rejected: Array, setup: Setup) -> bool:
    """GPS position rejected for ``divergence_time`` without a break beside a velocity that is fused: it has leapt, as
    where a receiver finds a better fix.
    """
    if setup.guide != _GPS_VELOCITY or last_fused[_GPS_VELOCITY] < last_rejected[_GPS_VELOCITY]:
        return False
    is_fused = time - last_fused[_GPS_VELOCITY] < setup.divergence_time
    return bool(is_fused and last_rejected[_GPS_POSITION] - last_fused[_GPS_POSITION] > setup.divergence_time)


@njit(cache=True)
def _doubted(time: float, last_fused: Array, last_rejected: Array, setup: Setup) -> int:
    """DIVERGED or ELSEWHERE where the GPS contradicts the state for long, else RUNNING."""
    if _has_diverged(time, last_fused, last_rejected, setup):
        return DIVERGED
    return ELSEWHERE if _is_elsewhere(time, last_fused, last_rejected, setup) else RUNNING


@njit(cache=True)
def _look_at_interval(
    end: float, values: Array, x: Array, setup: Setup, memory: Memory, bend: Array, density: Array
) -> None:
    """Density (6,) of the noise of the IMU up to its sample at ``end`` [s], and its bend (6,), 0 where it is dense."""
    interval = end - memory.imu[0]
    of_force, of_rate = setup.accelerometer_variance, setup.gyro_variance
    if setup.learns and air_speed(x) >= setup.minimum_airspeed:
        learn_imu(end, values, of_force, of_rate, memory.imu_noise)
    sparse = is_sparse(interval, memory)  # what changes between its samples is motion
    scales = imu_scales(memory.imu_noise, largest_scale(sparse))
    if not setup.imu_given[0]:
        of_force *= scales[0]
    if not setup.imu_given[1]:
        of_rate *= scales[1]
    bend[:] = 0.0
    hidden = held_motion(interval, end, values, memory)
    if sparse:
        missed_by_parabola(interval, setup.maximum_gap, values, (of_force, of_rate), memory, density)
        second_difference(end, values, setup.maximum_gap, memory, bend)
        beyond = mean_beyond_line(0.0, 1.0, interval)
        of_force += np.sum((beyond * bend[0:3]) ** 2) / 3.0
        of_rate += np.sum((beyond * bend[3:6]) ** 2) / 3.0
    else:
        missed_by_line(interval, values, (of_force, of_rate), memory, density)
        if interval > LONG:
            across = hidden_motion(interval, values, memory)
            hidden = max(hidden[0], across[0]), max(hidden[1], across[1])
    for i in range(6):
        density[i] = (density[i] + (of_force + hidden[0] if i < 3 else of_rate + hidden[1])) * interval


@njit(cache=True)
def _mean_input(now: float, until: float, end: float, values: Array, imu: Array, bend: Array, out: Array) -> None:
    """Mean of specific force and angular rate from ``now`` to ``until`` [s], into ``out`` (6,).

    imu (7,) is the newest sample, values those of the one at ``end`` [s].
    """
    begin, interval = imu[0], end - imu[0]
    middle = (0.5 * (now + until) - begin) / interval
    beyond = mean_beyond_line((now - begin) / interval, (until - begin) / interval, interval)
    for i in range(6):
        out[i] = imu[1 + i] + middle * (values[i] - imu[1 + i]) + beyond * bend[i]


@njit(cache=True)
def _between(begin: Array, end: Array, elapsed: float, interval: float, out: Array) -> None:
    """Vector (3,) ``elapsed`` [s] after ``begin``, on the way to ``end``, into ``out``."""
    share = elapsed / interval if interval > 0.0 else 0.0
    for i in range(3):
        out[i] = begin[i] + share * (end[i] - begin[i])


@njit(cache=True)
def _note_imu(time: float, values: Array, memory: Memory) -> None:
    """Keep the sample of the IMU that has been reached, and the two before it."""
    if time > memory.imu[0]:
        note_motion(time - memory.imu[0], values, memory)
        memory.imu_first[:] = memory.imu_before
        memory.imu_before[:] = memory.imu
    memory.imu[0] = time
    memory.imu[1:7] = values[0:6]


@njit(cache=True)
def run(
    times: Array,
    kinds: npt.NDArray[np.int64],
    values: Array,
    start: int,
    x: Array,
    p: Array,
    one_setup: npt.NDArray[np.void],
    one_memory: npt.NDArray[np.void],
    rows: Array,
    tape: Array,
) -> tuple[int, int, int, int]:
    """Process samples ``start`` onward, up to the last IMU sample among them.

    times (n,) [s] ascending, kinds (n,), values (n, WIDTH); arrays (1,) of the ``Setup`` and the ``Memory``. The IMU
    input is interpolated between its samples (``sparse_imu``), so that every measurement is fused at its own time.
    Writes rows (at most n, StateField.WIDTH), and for a smoother every step of the integration to the tape (at most n,
    STEP_WIDTH; of length 0: off).
    Returns the index of the first sample that is not processed, the numbers of rows and of steps, and RUNNING,
    or GAP when the IMU was silent for longer than setup.maximum_gap before that sample, or DIVERGED when GPS and
    state contradict each other for long, or ELSEWHERE when its position alone does.
    """
    setup, memory = one_setup[0], one_memory[0]
    count, steps, i, n = 0, 0, start, len(times)
    imu, mean, bend, density = memory.imu, np.empty(6), np.zeros(6), np.empty(6)
    force, rate, rate_now = mean[0:3], mean[3:6], np.empty(3)
    while True:
        j = i
        while j < n and kinds[j] != _IMU:
            j += 1
        if j == n:
            return i, count, steps, RUNNING
        begin, end = imu[0], times[j]
        interval = end - begin
        if interval > setup.maximum_gap:
            return i, count, steps, GAP
        _look_at_interval(end, values[j], x, setup, memory, bend, density)
        now = begin
        for k in range(i, j + 1):
            until = min(max(times[k], now), end)
            if until > now:
                _mean_input(now, until, end, values[j], imu, bend, mean)
                if steps < len(tape):
                    record_step(tape[steps], x, p, force, rate, until - now, density, memory.wind_walk[0])
                    steps += 1
                propagate(x, p, force, rate, until - now, density, memory.wind_walk[0], setup)
                now = until
            if k < j:
                _between(imu[4:7], values[j, 3:6], now - begin, interval, rate_now)
                _take(kinds[k], values[k], x, p, rate_now, now, setup, memory)
        _assume(x, p, end, setup, memory)
        _note_imu(end, values[j], memory)
        i = j + 1
        finite = bool(np.isfinite(np.sum(x))) & is_finite(p.ravel())
        if interval > 0.0 and finite:  # a stamp that stands twice gives one row
            write_row(rows[count], x, p, values[j, 0:3], values[j, 3:6], end, setup, memory)
            count += 1
            if steps > 0:
                tape[steps - 1, HAS_ROW] = 1.0
        doubt = _doubted(end, memory.last_fused, memory.last_rejected, setup) if finite else DIVERGED
        if doubt != RUNNING:
            return i, count, steps, doubt
