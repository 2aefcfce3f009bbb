"""What an innovation says: whether it passes its gate, how noisy its sensor is, how gusty the air."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import three
from aircraft_sysid_ros.estimation.iterated_ekf import (
    Update,
    normalised_square,
)
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.measurements import outputs_of
from aircraft_sysid_ros.reconstruction.sensor_noise import (
    WALK,
    bounded,
    is_another_second,
    is_held,
    is_outlier,
    is_recent,
    learn,
    note_left,
    raise_if_rejected,
    seconds_of,
    settle_scales,
    share_across,
    share_tilt,
    wind_walk_of,
)
from aircraft_sysid_ros.reconstruction.state import AIR_VELOCITY, NO_GUIDE, Memory, Setup
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

_MAGNETIC_FIELD, _ATTITUDE = int(Kind.MAGNETIC_FIELD), int(Kind.ATTITUDE)
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


@njit(cache=True)
def air_speed(x: Array) -> float:
    """Speed through the air [m/s] of a state."""
    u, v, w = three(x[AIR_VELOCITY])
    return float(np.sqrt(u * u + v * v + w * w))


@njit(inline="always")  # its memory is handed over array by array otherwise
def learns_from(kind: int, values: Array, base: Array, x: Array, setup: Setup, memory: Memory) -> bool:
    """Whether a sample says something of the noise of its sensor: in flight, and no repetition.

    Where the noise is stated a part of them is enough to see whether it can be true.
    """
    is_passed = setup.given[kind] and (memory.fused[kind] + memory.rejected[kind]) % _LOOKED_AT != 0
    is_of_use = not is_passed and kind != _MAGNETIC_FIELD and air_speed(x) >= setup.minimum_airspeed
    return setup.learns and is_of_use and not is_held(values, np.sqrt(base[0]), outputs_of(kind), memory.noise[kind])


@njit(inline="always")  # its memory is handed over array by array otherwise
def is_welcome(
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
        note_what_is_left(kind, innovation, update, learns, memory)
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
        elif kind == _ATTITUDE:
            share_tilt(channel)
        if is_air_data and setup.learns_wind:
            _find_wind_walk(time, x, setup, memory.noise, memory.calm_walk)


@njit(cache=True)
def note_what_is_left(kind: int, residual: Array, update: Update, learns: bool, memory: Memory) -> None:
    """What is left of a residual after its update, and all corrections so far."""
    if learns:
        note_left(residual, update.h, update.delta, memory.noise[kind])
        memory.moved[kind] = memory.moved[-1]


@njit(cache=True)
def _find_wind_walk(time: float, x: Array, setup: Setup, noise: Array, walk: Array) -> None:
    """The least random walk of the wind, from what the air data show of gusts."""
    found, seconds, count, speed = np.empty(3), 0.0, 0, air_speed(x)
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
