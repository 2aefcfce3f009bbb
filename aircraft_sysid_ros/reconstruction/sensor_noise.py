"""The noise of every sensor and the intensity of gusts, from the flight itself, while it is flown.

What a sensor shows beyond the motion that the IMU says is d(k) = v(k) - v(k-1) + w(k): its white noise v, and what
wanders, w: gusts in the air data, an error of its own in an attitude. d is the innovation minus the residual that the
update before it left; what other sensors have moved since is put back, so that the tuning of the filter does not
matter. A level that wanders seen through white noise of variance R,

    z(k) = l(k) + v(k),   l(k) = l(k-1) + w(k),   w of variance Q,

is predicted best by exponential smoothing with one gain a, in which R = (1 - a) S and Q = a^2 S, S the variance of the
errors of prediction (Muth 1960; Harvey 1989, section 4.1.2). A bank of smoothers runs over each signal, and the gain
with the least errors is the likeliest. Any rate will do, since the IMU has taken the motion out.

R of the air data is that R, and the random walk of the wind their Q. Errors of GPS and attitude are not white. Their
innovations tell what the filter should expect (Mehra 1970): the variance of an innovation is H P H' + R. Of an attitude
that drifts the mean of SLOW seconds tells it: its variance is H P H' + R dt / (2 SLOW), if R is to stand for an error
that lasts. Noise of the IMU is white in fifth differences, (1, -5, 10, -10, 5, -1) with the sum of squares 252, in
which motion up to a tenth of the rate is gone.

No sensor is rejected for long: where more of its samples are than can be outliers its noise is raised until they pass.

All means forget over FORGETTING, count what is beyond CLIP standard deviations as that, and hold while the aeroplane
is not flying. One number that repeats itself is no sample, unless the signal has steps of a size that shows.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

#: Gains of the bank.
_RATIO_OF_GAINS = 2.2
GAINS = 0.007 * _RATIO_OF_GAINS ** np.arange(7)
_COUNT_OF_GAINS = len(GAINS)
FORGETTING = 120.0  # [s]
SLOW = 5.0  # [s]
#: Largest and smallest factor on a variance.
LEAST, MOST = 0.2**2, 20.0**2
#: Samples that what is known before the flight stands for, and seconds of that of the wind.
_PRIOR, _PRIOR_TIME = 8.0, 10.0
CLIP = 2.5
_CLIPPED = 0.9776  # mean of min(z^2, CLIP^2) of a standard normal variable
_OUTLIER = 5.0  # standard deviations
_MOST_OUTLIERS = 3  # in turn: more are a step
_LONGEST = 2.0  # [s] between samples that are compared
#: A slow error of an attitude is one that is so much larger than all that is white.
_COLOURED = 2.0
#: Such an error lasts some half a minute [s], as levelling and drifts of gyros do, and is so many times what is seen of
#: it. Judgements.
_LASTING, _FOLLOWED = 30.0, 2.0
#: What an attitude is before the flight, the output of a filter: its slow error, and the seconds that this stands for.
_SLOW_PRIOR, _SLOW_PRIOR_TIME = 100.0, 20.0
#: Share of the white noise by which innovations are larger than by chance; samples from which a noise is stated.
_BEYOND_CHANCE, _ENOUGH = 0.3, 100.0
#: Share of samples that a gate may reject, more are no outliers, and the time [s] in which the noise is raised for it.
_MAY_BE_REJECTED, _RAISING = 0.06, 5.0
#: Steps of this share of a standard deviation make two equal numbers in turn likely.
_COARSE = 0.3

#: A message is believed within these factors on the default's variance.
_LEAST_CARRIED, _MOST_CARRIED = 1e-6, 1e4

# Columns of a channel of a sensor. Variances are in units of the one that file, message or default gives.
_LEFT = 0  # what each smoother has left of the newest sample
_SQUARE = _LEFT + _COUNT_OF_GAINS  # mean square of its errors of prediction
(
    _BEFORE, _SINCE, _CARRIED, _OUTLIERS, _TIME, _INTERVAL, _COUNT, _INNOVATION, _EXPECTED, _WEIGHT, _MEAN,
    _SLOW_SQUARE, _VALUE, _STEP, WHITE, WALK, SCALE, COLOURED, BASE, _INFLATION,
) = range(_SQUARE + _COUNT_OF_GAINS, _SQUARE + _COUNT_OF_GAINS + 20)  # fmt: skip
CHANNEL_WIDTH = _SQUARE + _COUNT_OF_GAINS + 20

# Rows of the memory of the IMU: six signals, newest values first and then their mean square; then what all share.
_DEPTH = 5
_OF_IMU, _IMU_TIME, _IMU_INTERVAL, _IMU_FILLED, _IMU_COUNT = 6, 0, 1, 2, 3
_WEIGHTS = (1.0, -5.0, 10.0, -10.0, 5.0, -1.0)
_SUM_OF_SQUARES = 252.0


def new_channels(kinds: int) -> Array:
    """Channels (kinds, 3, CHANNEL_WIDTH) before a flight: noise is as it was said."""
    channels = np.zeros((kinds, 3, CHANNEL_WIDTH))
    channels[:, :, _SQUARE : _SQUARE + _COUNT_OF_GAINS] = 1.0 / (1.0 - GAINS)
    channels[:, :, [_TIME, _STEP]] = -np.inf, np.inf
    channels[:, :, [_INNOVATION, WHITE, SCALE]] = 1.0
    channels[:, :, _SLOW_SQUARE] = _SLOW_PRIOR
    channels[:, :, [_VALUE, WALK]] = np.nan
    return channels


def new_imu_noise() -> Array:
    """Memory (7, 6) of the IMU before a flight."""
    noise = np.zeros((7, _DEPTH + 1))
    noise[:_OF_IMU, _DEPTH] = 1.0
    noise[_OF_IMU, _IMU_TIME] = -np.inf
    return noise


@njit(cache=True)
def believed_variance(carried: float, default: float) -> float:
    """The variance that a message carries, within what can be believed of one."""
    return min(max(carried, _LEAST_CARRIED * default), _MOST_CARRIED * default)


@njit(cache=True)
def bounded(ratio: float) -> float:
    """A factor on a variance within what is believed."""
    return min(max(ratio, LEAST), MOST)


@njit(cache=True)
def _towards(mean: float, square: float, gain: float) -> float:
    """Mean square after one more, of which what is beyond CLIP counts as that."""
    return mean + gain * (min(square, CLIP * CLIP * mean) / _CLIPPED - mean)


# -- sensors that are fused ------------------------------------------------------------------------------------------


@njit(cache=True)
def is_held(values: Array, unit: float, outputs: int, channel: Array) -> bool:
    """Whether a sample only repeats the one before it; channel (3, CHANNEL_WIDTH), in which it is noted.

    ``unit``: one sigma that was said, of the first output.
    """
    same = True
    for i in range(3):
        change = abs(values[i] - channel[i, _VALUE])
        if change > 0.0:
            channel[i, _STEP] = min(channel[i, _STEP] * 1.001, change)
            same = False
        channel[i, _VALUE] = values[i]
    is_coarse = outputs == 1 and channel[0, _STEP] > _COARSE * unit * np.sqrt(channel[0, WHITE])
    return bool(same and not is_coarse)


@njit(cache=True)
def learn(
    time: float, innovation: Array, h: Array, total: Array, variance: Array, base: Array, moved: Array, channel: Array
) -> None:
    """One innovation (m,) of a sensor, before it is fused, and before its gate.

    h (m, n); total (m, m) the covariance of the innovation; of the noise in it ``variance`` (3,), which is ``base``
    (3,) times the factor in use; moved (n,): by how much other updates have moved the state since the sample before.
    """
    interval = time - channel[0, _TIME]
    begins = not 0.0 < interval <= _LONGEST
    for i in range(len(innovation)):
        one, unit = channel[i], base[i]
        one[_TIME], one[BASE] = time, unit
        if begins:
            one[_SINCE] = one[_CARRIED] = one[_OUTLIERS] = 0.0
        else:
            limit = FORGETTING / max(one[_INTERVAL], 1e-4)
            one[_COUNT] = min(one[_COUNT] + 1.0, limit)
            one[_INTERVAL] += max(1.0 / one[_COUNT], 0.01) * (interval - one[_INTERVAL])
        known = max(total[i, i] - variance[i], 0.0)
        share = variance[i] / (variance[i] + known)
        _match(one, innovation[i] ** 2 / unit, known / unit, share * share)
        back = 0.0
        for k in range(len(moved)):
            back += h[i, k] * moved[k]
        _predict(one, (innovation[i] - one[_BEFORE] + back) / np.sqrt(unit))
        _follow_mean(one, innovation[i] / np.sqrt(unit), known / unit, share * share)


@njit(cache=True)
def _match(one: Array, square: float, known: float, share: float) -> None:
    """Mean square of the innovations, and what of it is known to be of the state; where noise prevails."""
    one[_WEIGHT] = min(one[_WEIGHT] + share, FORGETTING / max(one[_INTERVAL], 1e-4))
    gain = share / (one[_WEIGHT] + _PRIOR)
    one[_INNOVATION] = _towards(one[_INNOVATION], square, gain)
    one[_EXPECTED] += gain * (known - one[_EXPECTED])


@njit(cache=True)
def _follow_mean(one: Array, innovation: float, known: float, share: float) -> None:
    """Mean square of the mean of SLOW seconds, in units of that of white noise of the variance 1."""
    if not one[_COUNT] > 0.0:
        return
    gain, largest = min(one[_INTERVAL] / SLOW, 1.0), CLIP * np.sqrt(one[_INNOVATION])
    one[_MEAN] += gain * (min(max(innovation, -largest), largest) - one[_MEAN])
    beyond = (one[_MEAN] ** 2 - known) * (2.0 - gain) / gain
    weight = one[_COUNT] + _SLOW_PRIOR_TIME / max(one[_INTERVAL], 1e-4)
    one[_SLOW_SQUARE] += share * (beyond - one[_SLOW_SQUARE]) / weight


@njit(cache=True)
def _predict(one: Array, change: float) -> None:
    """The bank of smoothers meets the next sample, ``change`` after the one before it."""
    if one[_SINCE] == 0.0:
        one[_SINCE] = 1.0
        one[_LEFT : _LEFT + _COUNT_OF_GAINS] = 0.0
        return
    change += one[_CARRIED]
    best = np.argmin(one[_SQUARE : _SQUARE + _COUNT_OF_GAINS])
    if (one[_LEFT + best] + change) ** 2 > _OUTLIER * _OUTLIER * one[_SQUARE + best]:
        one[_CARRIED], one[_OUTLIERS] = change, one[_OUTLIERS] + 1.0
        if one[_OUTLIERS] < _MOST_OUTLIERS:
            return
        one[_SINCE] = 1.0
        one[_LEFT : _LEFT + _COUNT_OF_GAINS] = 0.0
    else:
        one[_SINCE] += 1.0
        weight = 1.0 / (one[_COUNT] + _PRIOR)
        for i in range(_COUNT_OF_GAINS):
            error = one[_LEFT + i] + change
            one[_SQUARE + i] = _towards(one[_SQUARE + i], error * error, weight)
            one[_LEFT + i] = (1.0 - max(GAINS[i], 1.0 / one[_SINCE])) * error
    one[_CARRIED] = one[_OUTLIERS] = 0.0


@njit(cache=True)
def weigh_bank(one: Array) -> None:
    """White variance and random walk [per second] of a channel, by the gain under which its samples are likeliest.

    Between the gains of the bank the logarithm of the mean square is a parabola over that of the gain.
    """
    squares = one[_SQUARE : _SQUARE + _COUNT_OF_GAINS]
    best = np.argmin(squares)
    gain, lowest = GAINS[best], np.log(squares[best])
    if 0 < best < _COUNT_OF_GAINS - 1:
        before, after = np.log(squares[best - 1]) - lowest, np.log(squares[best + 1]) - lowest
        if before + after > 0.0:
            shift = 0.5 * (before - after) / (before + after)
            gain = gain * _RATIO_OF_GAINS**shift
            lowest -= 0.25 * (before - after) * shift
    square = np.exp(lowest)
    one[WHITE], one[WALK] = (1.0 - gain) * square, gain * gain * square / one[_INTERVAL]


@njit(cache=True)
def is_another_second(time: float, channel: Array) -> bool:
    """Whether what was learnt is to be used: once a second of stamps."""
    return bool(np.floor(time) != np.floor(channel[0, _TIME]))


@njit(cache=True)
def settle_scales(outputs: int, is_air_data: bool, may_drift: bool, channel: Array) -> None:
    """Factors in use, from what was learnt: of air data that of white noise, else what the innovations ask for.

    ``may_drift``: an attitude in a flight in which something else shows the tilt.
    """
    for i in range(outputs):
        one = channel[i]
        if one[_COUNT] < 2.0:
            continue
        weigh_bank(one)
        found, one[COLOURED] = one[WHITE], 0.0
        if not is_air_data:
            found = max(found, one[_INNOVATION] - one[_EXPECTED])
        one[SCALE] = bounded(found * np.exp(one[_INFLATION]))
        if may_drift and one[_SLOW_SQUARE] > _COLOURED * one[SCALE]:
            one[SCALE], one[COLOURED] = bounded(one[_SLOW_SQUARE]), 1.0


@njit(cache=True)
def raise_if_rejected(passes: bool, outputs: int, channel: Array) -> None:
    """Raise the noise of a sensor of which more samples are rejected than can be outliers, until that is so no more.

    The logarithm of the factor goes up with each that is rejected, and down with the others, in balance at that share.
    """
    first = channel[0]
    step = first[_INTERVAL] / _RAISING * (-_MAY_BE_REJECTED if passes else 1.0 - _MAY_BE_REJECTED)
    for i in range(outputs):
        channel[i, _INFLATION] = min(max(channel[i, _INFLATION] + step, 0.0), np.log(MOST))


@njit(cache=True)
def share_across(outputs: Array, first: int, last: int) -> None:
    """Channels from ``first`` to ``last`` have the mean of their factors: north and east of a GPS are alike."""
    mean = 0.0
    for i in range(first, last):
        mean += outputs[i, SCALE] / (last - first)
    for i in range(first, last):
        outputs[i, SCALE] = mean


@njit(cache=True)
def share_tilt(outputs: Array) -> None:
    """Where roll or pitch of an attitude has a slow error of its own, both have the larger: one filter makes both.

    Of one that is believed sample by sample nothing is left over that would show it: tilt and the bias of the
    accelerometer follow it together.
    """
    if outputs[0, COLOURED] or outputs[1, COLOURED]:
        larger = max(outputs[0, SCALE], outputs[1, SCALE])
        for i in range(2):
            outputs[i, SCALE], outputs[i, COLOURED] = larger, 1.0


@njit(cache=True)
def wind_walk_of(walks: Array, seconds: float, said: float) -> float:
    """Random walk of the wind [m/s per sqrt(s)] from those that the air data show (n,), and what was said before.

    Their median: gusts move all of them, a failing sensor only itself.
    """
    found = 0.5 * np.log(np.median(walks))
    weight = seconds / (seconds + _PRIOR_TIME)
    return float(np.exp(weight * found + (1.0 - weight) * np.log(said)))


@njit(cache=True)
def seconds_of(one: Array) -> float:
    """Time [s] of samples that a channel stands for."""
    return float(one[_COUNT] * one[_INTERVAL])


@njit(cache=True)
def is_recent(time: float, one: Array) -> bool:
    """Whether a channel has met a sample lately, and some before it."""
    return bool(time - one[_TIME] <= _LONGEST and one[_COUNT] > _PRIOR)


@njit(cache=True)
def note_left(residual: Array, h: Array, delta: Array, channel: Array) -> None:
    """What an update has left of its residual (m,); delta (n,) is 0 where it was rejected."""
    for i in range(len(residual)):
        left = residual[i]
        for k in range(len(delta)):
            left -= h[i, k] * delta[k]
        channel[i, _BEFORE] = left


def slow_part(one: Array) -> float:
    """Mean square of what is not white in the innovations of a channel, 0 where it is within chance."""
    beyond = float(one[_INNOVATION] - one[WHITE])
    return beyond if one[COLOURED] and beyond > _BEYOND_CHANCE * one[WHITE] else 0.0


@njit(cache=True)
def mean_attitude_errors(outputs: Array, found: Array) -> None:
    """What an attitude with an error of its own may be off by in the mean of a flight about its axes, into ``found``
    (3,) [rad]: one filter makes all of it, and its heading is no better than its tilt, though it shows later.

    A heading that was set anew in flight is off by more than any factor on a variance that is believed.
    """
    for i in range(3):
        one = outputs[i]
        is_far = i == 2 and one[COLOURED] and one[_SLOW_SQUARE] > one[SCALE]
        found[i] = _mean_error(one, one[_SLOW_SQUARE] if is_far else one[SCALE])
    found[2] = max(found[0], found[1], found[2])


@njit(cache=True)
def _mean_error(one: Array, factor: float) -> float:
    """The same of one channel, of which the slow error has ``factor`` on the variance.

    A constant tilt and a bias of the accelerometer move the aeroplane alike, and the filter follows both: only a part
    of a slow error is seen in its innovations. Of errors that last _LASTING seconds the mean over a time T has that
    variance by 2 _LASTING / (T + 2 _LASTING).
    """
    beyond = one[BASE] * (factor - one[WHITE])
    if not beyond > 0.0:
        return 0.0
    seen = np.sqrt(beyond * one[_INTERVAL] / (2.0 * SLOW))
    return float(_FOLLOWED * seen * np.sqrt(2.0 * _LASTING / (seconds_of(one) + 2.0 * _LASTING)))


def has_learnt(one: Array) -> bool:
    """Whether a channel has met enough samples to be stated."""
    return bool(one[_COUNT] > _ENOUGH)


# -- the IMU ---------------------------------------------------------------------------------------------------------


@njit(cache=True)
def learn_imu(time: float, values: Array, force_variance: float, rate_variance: float, noise: Array) -> None:
    """One sample of the IMU, in flight; of the noise in it what was said. ``noise``: ``new_imu_noise``."""
    shared, same = noise[_OF_IMU], True
    for i in range(_OF_IMU):
        same = same and values[i] == noise[i, 0]
    interval = time - shared[_IMU_TIME]
    if same or interval == 0.0:
        return
    shared[_IMU_TIME] = time
    if not 0.0 < interval <= _LONGEST:
        shared[_IMU_FILLED] = 0.0
    else:
        if shared[_IMU_COUNT] > 0.0 and interval > 3.0 * shared[_IMU_INTERVAL]:
            shared[_IMU_FILLED] = 0.0
        shared[_IMU_COUNT] = min(shared[_IMU_COUNT] + 1.0, FORGETTING / max(interval, 1e-4))
        shared[_IMU_INTERVAL] += max(1.0 / shared[_IMU_COUNT], 0.01) * (interval - shared[_IMU_INTERVAL])
    is_full, weight = shared[_IMU_FILLED] >= _DEPTH, 1.0 / (shared[_IMU_COUNT] + _PRIOR)
    for i in range(_OF_IMU):
        one = noise[i]
        if is_full:
            difference = values[i]
            for k in range(_DEPTH):
                difference += _WEIGHTS[k + 1] * one[k]
            unit = _SUM_OF_SQUARES * (force_variance if i < 3 else rate_variance)
            one[_DEPTH] = _towards(one[_DEPTH], difference * difference / unit, weight)
        for k in range(_DEPTH - 1, 0, -1):
            one[k] = one[k - 1]
        one[0] = values[i]
    shared[_IMU_FILLED] = min(shared[_IMU_FILLED] + 1.0, float(_DEPTH))


def imu_has_learnt(noise: Array) -> bool:
    """Whether the IMU has given enough samples for its noise to be stated."""
    return bool(noise[_OF_IMU, _IMU_COUNT] > _ENOUGH)


def imu_interval(noise: Array) -> float:
    """Time [s] between samples of the IMU that differ; 0 before there are two."""
    return float(noise[_OF_IMU, _IMU_INTERVAL])


@njit(cache=True)
def largest_scale(is_sparse: bool) -> float:
    """Largest factor on the variances of an IMU: beside sparse samples (``sparse_imu``) what differs is motion."""
    return 1.0 if is_sparse else MOST


@njit(cache=True)
def imu_scales(noise: Array, most: float) -> tuple[float, float]:
    """Factors on the variances of accelerometer and gyro, means over their axes, not above ``most``."""
    squares = noise[:, _DEPTH]
    return (
        min(bounded((squares[0] + squares[1] + squares[2]) / 3.0), most),
        min(bounded((squares[3] + squares[4] + squares[5]) / 3.0), most),
    )


@njit(cache=True)
def is_outlier(one: Array) -> bool:
    """Whether the newest sample of a channel was far from those before it."""
    return bool(one[_OUTLIERS] > 0.0)
