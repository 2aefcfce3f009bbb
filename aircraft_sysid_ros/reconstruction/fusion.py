"""The jitted loop of the first step: samples in time order in, a row of states per IMU sample out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import GAS_CONSTANT, temperature
from aircraft_sysid_ros.aircraft.frames import Matrix, applied, three, transposed, turn_by, turn_jacobian, turned
from aircraft_sysid_ros.estimation.iterated_ekf import (
    Update,
    move,
    normalised_square,
    settle_covariance,
    symmetrise,
    update_within,
    weigh,
)
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.air_data_errors import settle
from aircraft_sysid_ros.reconstruction.measurements import air_velocity_at, outputs_of, residual_and_jacobian
from aircraft_sysid_ros.reconstruction.process import attitude_of, propagate
from aircraft_sysid_ros.reconstruction.pseudo_measurements import (
    count_heading_from_now,
    hold_wind,
    is_due,
    is_wind_due,
    lacks_vane,
    update_by,
)
from aircraft_sysid_ros.reconstruction.sensor_noise import (
    SCALE,
    WALK,
    believed_variance,
    bounded,
    imu_scales,
    is_another_second,
    is_held,
    is_outlier,
    is_recent,
    largest_scale,
    learn,
    learn_imu,
    note_left,
    raise_if_rejected,
    seconds_of,
    settle_scales,
    share_across,
    wind_walk_of,
)
from aircraft_sysid_ros.reconstruction.smoother_history import HAS_ROW, record_step
from aircraft_sysid_ros.reconstruction.sparse_imu import is_sparse, mean_beyond_line, second_difference
from aircraft_sysid_ros.reconstruction.state import AIR_VELOCITY, D_ATTITUDE, ERROR_SIZE, NO_GUIDE, Memory, Setup
from aircraft_sysid_ros.reconstruction.state_row import write_row
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

_IMU, _AIR, _ATTITUDE = int(Kind.IMU), int(Kind.AIR), int(Kind.ATTITUDE)
_MAGNETIC_FIELD = int(Kind.MAGNETIC_FIELD)
_AIRSPEED, _ALPHA, _BETA = int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP)
_GPS_POSITION, _GPS_VELOCITY = int(Kind.GPS_POSITION), int(Kind.GPS_VELOCITY)

#: Weight of the newest update in the running innovation consistency.
_NIS_WEIGHT = 0.01
#: Time [s] over which those of one sensor are averaged, and the most that one of them counts.
_OWN_TIME, _OWN_WEIGHT = 0.5, 0.3
#: An innovation counts in the consistency as at most this many variances.
_LARGEST_NIS = 25.0
#: And as at most so many standard deviations in the mean of so many seconds that tells its colour.
_LARGEST, _SLOW = 5.0, 5.0
# The random walk of the wind follows the gusts: it grows while the innovations of air data are larger than expected
# and falls back when they are not. Fast enough for a gust front (a factor of 10 in some seconds), and deaf to what
# no gust does.
_GUSTY, _CALM = 1.3, 1.1  # running mean of the normalised innovation squared
_WALK_RATE = 0.01  # per sample and unit of that mean
_LARGEST_WALK = 2.0  # [m/s per sqrt(s)]
_LOOKED_AT = 8  # one in so many samples of a sensor whose noise is stated
_GUIDED = 2.0  # [s] since a sensor was fused, in which it is at work
_NO_GUST = 400.0  # normalised innovation squared of a sensor that fails
RUNNING, GAP, DIVERGED = 0, 1, 2


@njit(cache=True)
def retract(x: Array, delta: Array) -> Array:
    """State x (19,) or (25,) moved by the error delta (18,) or (24,): added, and for the attitude turned."""
    moved = np.empty(len(x))
    _retract(x, delta, moved)
    return moved


@njit(cache=True)
def _retract(x: Array, delta: Array, moved: Array) -> None:
    """``retract`` into ``moved``."""
    w, i, j, k = turned(attitude_of(x), turn_by(three(delta[D_ATTITUDE : D_ATTITUDE + 3])))
    norm = np.sqrt(w**2 + i**2 + j**2 + k**2)
    for at in range(6):
        moved[at] = x[at] + delta[at]
    moved[6], moved[7], moved[8], moved[9] = w / norm, i / norm, j / norm, k / norm
    for at in range(10, len(x)):
        moved[at] = x[at] + delta[at - 1]


@njit(cache=True)
def _turn_attitude_columns(h: Array, jacobian: Matrix) -> None:
    """Attitude columns of h times ``jacobian``: from the error at eta to the error at the prediction."""
    back = transposed(jacobian)
    for i in range(h.shape[0]):
        columns = applied(back, three(h[i, D_ATTITUDE : D_ATTITUDE + 3]))
        h[i, D_ATTITUDE], h[i, D_ATTITUDE + 1], h[i, D_ATTITUDE + 2] = columns


@njit(cache=True)
def jacobian_of(delta: Array) -> Matrix:
    """Right Jacobian of the turn in an error (18,) or (24,)."""
    return turn_jacobian(three(delta[D_ATTITUDE : D_ATTITUDE + 3]))


@njit(cache=True)
def turn_attitude_error(p: Array, jacobian: Matrix) -> None:
    """Covariance p (n, n) after the attitude error is multiplied by ``jacobian``, in place; symmetric to the bit."""
    a, b, c = D_ATTITUDE, D_ATTITUDE + 1, D_ATTITUDE + 2
    for j in range(len(p)):
        p[a, j], p[b, j], p[c, j] = applied(jacobian, (p[a, j], p[b, j], p[c, j]))
    for j in range(a, c + 1):
        p[j, a], p[j, b], p[j, c] = applied(jacobian, (p[j, a], p[j, b], p[j, c]))
    symmetrise(p[a : c + 1, a : c + 1])
    for j in range(len(p)):
        p[j, a], p[j, b], p[j, c] = p[a, j], p[b, j], p[c, j]


@njit(cache=True)
def measurement_variance(kind: int, values: Array, setup: Setup) -> Array:
    """Variance (3,): from the aircraft file if it says so, else from the message, else the default."""
    if setup.given[kind] or not (kind == _ATTITUDE or kind == _GPS_POSITION):
        return setup.variance[kind]
    variance = setup.variance[kind].copy()
    first = 4 if kind == _ATTITUDE else 3  # where ATTITUDE and GPS_POSITION carry theirs
    for i in range(3):
        if values[first + i] > 0.0:
            variance[i] = believed_variance(values[first + i], variance[i])
    return variance


@njit(inline="always")  # the setup is handed over array by array otherwise
def _variance_in_use(kind: int, base: Array, setup: Setup, noise: Array) -> Array:
    """The same (3,) with what the flight has shown of the sensor, unless the aircraft file says its noise."""
    variance = base.copy()
    if not setup.given[kind]:
        for i in range(3):
            variance[i] *= noise[kind, i, SCALE]
    return variance


@njit(cache=True)
def _is_finite(values: Array) -> bool:
    """Whether all of the numbers (n,) are; counted, which the machine does several at a time."""
    wrong = 0
    for value in values:
        wrong += 0 if np.isfinite(value) else 1
    return wrong == 0


@njit(cache=True)
def fuse(kind: int, values: Array, x: Array, p: Array, rate: Array, time: float, setup: Setup, memory: Memory) -> None:
    """One measurement update (3.15)-(3.18) on the state x and p, in place, with its gate.

    x (19,), p (18, 18), or x (25,), p (24, 24) with errors of the air data.
    """
    n = len(p)
    update = update_within(memory.working, outputs_of(kind), n)
    h, delta, residual, eta = update.h, update.delta, memory.residual[: outputs_of(kind)], memory.eta[: len(x)]
    eta[:] = x
    base = measurement_variance(kind, values, setup)
    variance, learns = _variance_in_use(kind, base, setup, memory.noise), False
    # with errors of the air data as states an update is one of what they show, in which they are linear
    is_linear = n > ERROR_SIZE and (kind == _AIRSPEED or kind == _ALPHA or kind == _BETA)
    for iteration in range(1 if is_linear else setup.maximum_iterations):
        count = residual_and_jacobian(kind, values, eta, rate, setup, residual, h)
        if count == 0 or not _is_finite(residual):
            memory.skipped[kind] += 1
            return
        if iteration > 0:  # (3.15): the residual at eta is referred back to the prediction
            _turn_attitude_columns(h, jacobian_of(delta))
        for i in range(count):
            total = residual[i]
            for k in range(n):
                total += h[i, k] * delta[k]
            residual[i] = total
        if not weigh(p, variance, update):
            memory.skipped[kind] += 1
            return
        if iteration == 0:
            learns = _learns(kind, values, base, x, setup, memory)
            if not _is_welcome(kind, time, x, residual, update, variance, base, learns, setup, memory):
                return
        change = move(p, residual, update)
        _retract(x, delta, eta)
        if change <= setup.tolerance:
            break
    for k in range(n):
        memory.moved[-1, k] += delta[k]
    _note_left(kind, residual, update, learns, memory)
    settle_covariance(p, variance, update)
    # from the error about the predicted attitude to that about the updated one
    turn_attitude_error(p, jacobian_of(delta))
    if n > ERROR_SIZE:
        settle(air_velocity_at(x, rate, setup.probe_from_imu), x, delta, eta, p)
    x[:] = eta
    memory.last_fused[kind] = time


@njit(inline="always")  # its memory is handed over array by array otherwise
def _learns(kind: int, values: Array, base: Array, x: Array, setup: Setup, memory: Memory) -> bool:
    """Whether a sample says something of the noise of its sensor: in flight, and no repetition.

    Where the noise is stated a part of them is enough to see whether it can be true.
    """
    is_passed = setup.given[kind] and (memory.fused[kind] + memory.rejected[kind]) % _LOOKED_AT != 0
    is_of_use = not is_passed and kind != _MAGNETIC_FIELD and _air_speed(x) >= setup.minimum_airspeed
    return is_of_use and not is_held(values, np.sqrt(base[0]), outputs_of(kind), memory.noise[kind])


@njit(inline="always")  # its memory is handed over array by array otherwise
def _is_welcome(
    kind: int,
    time: float,
    x: Array,
    innovation: Array,
    update: Update,
    variance: Array,
    base: Array,
    learns: bool,
    setup: Setup,
    memory: Memory,
) -> bool:
    """Whether an innovation passes its gate, after what it says of the noise of its sensor was learnt."""
    if learns:
        _learn(kind, time, x, innovation, update, variance, base, setup, memory)
    passes = _passes_gate(kind, innovation, update, time, setup, memory)
    if learns and time - memory.last_fused[kind] < _GUIDED:  # longer, and it has failed
        raise_if_rejected(passes, len(innovation), memory.noise[kind])
    if not passes:
        _note_left(kind, innovation, update, learns, memory)
    return passes


@njit(inline="always")  # its memory is handed over array by array otherwise
def _learn(
    kind: int,
    time: float,
    x: Array,
    innovation: Array,
    update: Update,
    variance: Array,
    base: Array,
    setup: Setup,
    memory: Memory,
) -> None:
    """What an innovation says of the noise of its sensor, and once a second what follows from it."""
    channel, outputs = memory.noise[kind], len(innovation)
    due, moved = is_another_second(time, channel), memory.moved
    between = moved[-1, : update.h.shape[1]] - moved[kind, : update.h.shape[1]]
    learn(time, innovation, update.h, update.innovation_covariance, variance, base, between, channel)
    if due:
        is_air_data = kind == _AIRSPEED or kind == _ALPHA or kind == _BETA
        guided = setup.guide != NO_GUIDE and time - memory.last_fused[setup.guide] < _GUIDED
        settle_scales(outputs, is_air_data, guided and kind == _ATTITUDE, channel)
        if kind == _GPS_POSITION or kind == _GPS_VELOCITY:
            share_across(channel, 0, 2)
        if is_air_data and setup.learns_wind:
            _find_wind_walk(time, x, setup, memory.noise, memory.calm_walk)


@njit(cache=True)
def _note_left(kind: int, residual: Array, update: Update, learns: bool, memory: Memory) -> None:
    """What is left of a residual after its update, and all corrections so far."""
    if learns:
        note_left(residual, update.h, update.delta, memory.noise[kind])
        memory.moved[kind] = memory.moved[-1]


@njit(cache=True)
def _find_wind_walk(time: float, x: Array, setup: Setup, noise: Array, walk: Array) -> None:
    """The least random walk of the wind, from what the air data show of gusts."""
    found, seconds, count, speed = np.empty(3), 0.0, 0, _air_speed(x)
    for kind in (_AIRSPEED, _ALPHA, _BETA):
        one = noise[kind, 0]
        if is_recent(time, one):
            unit = setup.variance[kind, 0] * (1.0 if kind == _AIRSPEED else speed * speed)
            found[count] = one[WALK] * unit
            seconds, count = max(seconds, seconds_of(one)), count + 1
    if count > 0:
        ratio = (wind_walk_of(found[:count], seconds, setup.wind_walk) / setup.wind_walk) ** 2
        walk[0] = setup.wind_walk * np.sqrt(bounded(ratio))


@njit(inline="always")  # its memory is handed over array by array otherwise
def _passes_gate(kind: int, innovation: Array, update: Update, time: float, setup: Setup, memory: Memory) -> bool:
    """Normalised innovation squared against its gate; keeps the counts and the consistency."""
    m, factor = len(innovation), update.factor
    nis = normalised_square(innovation, update)
    log_determinant, newest, recent = 0.0, memory.innovation, memory.recent_nis
    for i in range(m):
        log_determinant += 2.0 * np.log(factor[i, i])
        newest[kind, i] = innovation[i]
    likelihood = memory.likelihood
    likelihood[kind, 0] += m
    likelihood[kind, 1] += min(nis, m * _LARGEST_NIS)
    likelihood[kind, 2] += log_determinant
    before = max(memory.last_fused[kind], memory.last_rejected[kind])
    _follow_colour(time - before, innovation, factor, likelihood[kind])
    capped = min(nis / m, _LARGEST_NIS)
    # a magnetometer that is not calibrated errs in the heading, which GPS and air data then contradict
    if kind != _MAGNETIC_FIELD:
        recent[0] += _NIS_WEIGHT * (capped - recent[0])
    memory.own_nis[kind] += min(max((time - before) / _OWN_TIME, _NIS_WEIGHT), _OWN_WEIGHT) * (
        capped - memory.own_nis[kind]
    )
    is_air_data = kind == _AIRSPEED or kind == _ALPHA or kind == _BETA
    if is_air_data and not (setup.learns_wind and is_outlier(memory.noise[kind, 0])):
        _follow_gusts(nis, memory)
    if not nis <= setup.gate[m]:
        memory.rejected[kind] += 1
        memory.last_rejected[kind] = time
        return False
    memory.fused[kind] += 1
    memory.nis_sum[kind] += nis
    memory.degrees[kind] += m
    return True


@njit(cache=True)
def _follow_colour(interval: float, innovation: Array, factor: Array, sums: Array) -> None:
    """How much larger the means of innovations over _SLOW seconds are than those of white ones: their squares (8,)."""
    gain = min(interval / _SLOW, 1.0) if interval > 0.0 else 1.0
    for i in range(len(innovation)):
        variance = 0.0
        for j in range(i + 1):
            variance += factor[i, j] ** 2
        normalised = min(max(innovation[i] / np.sqrt(variance), -_LARGEST), _LARGEST)
        sums[5 + i] += gain * (normalised - sums[5 + i])
        sums[3] += normalised**2
        sums[4] += sums[5 + i] ** 2 * (2.0 - gain) / gain


@njit(cache=True)
def _follow_gusts(nis: float, memory: Memory) -> None:
    """Raise or lower the random walk of the wind by one innovation of air data."""
    if not nis <= _NO_GUST:
        return
    mean = memory.air_nis[0] + _NIS_WEIGHT * (min(nis, _LARGEST_NIS) - memory.air_nis[0])
    memory.air_nis[0], walk = mean, memory.wind_walk[0]
    if mean > _GUSTY:
        walk *= np.exp(_WALK_RATE * (mean - 1.0))
    elif mean < _CALM:
        walk *= np.exp(-_WALK_RATE * (1.0 + _CALM - mean) * 0.2)
    memory.wind_walk[0] = min(max(walk, memory.calm_walk[0]), max(_LARGEST_WALK, memory.calm_walk[0]))


@njit(cache=True)
def _is_flying(x: Array, rate: Array, values: Array, kind: int, setup: Setup) -> bool:
    """Air data mean something: measured or expected airspeed is above the least that flies."""
    if kind == _AIRSPEED:
        return values[0] >= setup.minimum_airspeed
    u, v, w = air_velocity_at(x, rate, setup.probe_from_imu)
    return bool(np.sqrt(u * u + v * v + w * w) >= setup.minimum_airspeed)


@njit(cache=True)
def _air_speed(x: Array) -> float:
    """Speed through the air [m/s] of a state."""
    u, v, w = three(x[AIR_VELOCITY])
    return float(np.sqrt(u * u + v * v + w * w))


@njit(cache=True)
def _take(kind: int, values: Array, x: Array, p: Array, rate: Array, time: float, setup: Setup, memory: Memory) -> None:
    """Fuse or note one sample that is not an IMU sample."""
    if kind == _AIR:
        if values[0] > 0.0:
            memory.air[0] = values[0]
        elif values[1] > 0.0:
            memory.air[0] = values[1] / (GAS_CONSTANT * temperature(setup.origin[2] - x[5]))
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
def _has_diverged(last_fused: Array, last_rejected: Array, setup: Setup) -> bool:
    """All of the GPS rejected for ``divergence_time`` without a break: the state is wrong, not it.

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
    return bool(min(position, velocity) > setup.divergence_time)


@njit(cache=True)
def _look_at_interval(
    end: float, values: Array, x: Array, setup: Setup, memory: Memory, bend: Array, density: Array
) -> None:
    """Density (2,) of the noise of the IMU up to its sample at ``end`` [s], and its bend (6,), 0 where it is dense."""
    interval = end - memory.imu[0]
    of_force, of_rate = setup.accelerometer_variance, setup.gyro_variance
    if _air_speed(x) >= setup.minimum_airspeed:
        learn_imu(end, values, of_force, of_rate, memory.imu_noise)
    sparse = is_sparse(interval, memory)  # what changes between its samples is motion
    scales = imu_scales(memory.imu_noise, largest_scale(sparse))
    if not setup.imu_given[0]:
        of_force *= scales[0]
    if not setup.imu_given[1]:
        of_rate *= scales[1]
    bend[:] = 0.0
    if sparse:
        second_difference(end, values, setup.maximum_gap, memory, bend)
        beyond = mean_beyond_line(0.0, 1.0, interval)
        of_force += np.sum((beyond * bend[0:3]) ** 2) / 3.0
        of_rate += np.sum((beyond * bend[3:6]) ** 2) / 3.0
    density[0], density[1] = of_force * interval, of_rate * interval


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
    """Keep the sample of the IMU that has been reached, and the one before it."""
    if time > memory.imu[0]:
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
    setup: Setup,
    memory: Memory,
    rows: Array,
    tape: Array,
) -> tuple[int, int, int, int]:
    """Process samples ``start`` onward, up to the last IMU sample among them.

    times (n,) [s] ascending, kinds (n,), values (n, WIDTH). The IMU input is interpolated between its samples
    (``sparse_imu``), so that every measurement is fused at its own time. Writes rows (at most n, StateField.WIDTH), and
    for a smoother every step of the integration to the tape (at most n, STEP_WIDTH; of length 0: off).
    Returns the index of the first sample that is not processed, the numbers of rows and of steps, and RUNNING,
    or GAP when the IMU was silent for longer than setup.maximum_gap before that sample, or DIVERGED when GPS and
    state contradict each other for long.
    """
    count, steps, i, n = 0, 0, start, len(times)
    imu, mean, bend, density = memory.imu, np.empty(6), np.zeros(6), np.empty(2)
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
        finite = bool(np.isfinite(np.sum(x))) & _is_finite(p.ravel())
        if interval > 0.0 and finite:  # a stamp that stands twice gives one row
            write_row(rows[count], x, p, values[j, 0:3], values[j, 3:6], end, setup, memory)
            count += 1
            if steps > 0:
                tape[steps - 1, HAS_ROW] = 1.0
        if not finite or _has_diverged(memory.last_fused, memory.last_rejected, setup):
            return i, count, steps, DIVERGED
