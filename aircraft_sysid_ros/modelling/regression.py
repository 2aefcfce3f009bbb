"""The jitted loop of the second step: rows of signals in, measured coefficients and parameters out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel
from aircraft_sysid_ros.aircraft.expression import SIGNALS, evaluate_programs
from aircraft_sysid_ros.aircraft.rigid_body import coefficients_of, moment_at_reference
from aircraft_sysid_ros.estimation.lagged_moments import add_sample
from aircraft_sysid_ros.estimation.recursive_least_squares import rls_update
from aircraft_sysid_ros.estimation.window_average import window_average
from aircraft_sysid_ros.modelling.signals import fill_signals, signal_noise
from aircraft_sysid_ros.reconstruction.state import D_ACCELEROMETER_BIAS, Column

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_SIGNAL_COUNT = len(SIGNALS)

_ACCELEROMETER_BIAS_STD = Column.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS

#: Nothing is learnt while the innovations of the first step are this much larger than expected: a sensor lies.
LARGEST_CONSISTENCY = 4.0
#: Nor with biases that no working IMU has: it is mounted or scaled in another way than the recording says.
LARGEST_ACCELEROMETER_BIAS = 2.0  # [m/s^2]
LARGEST_GYRO_BIAS = 0.3  # [rad/s]
#: Variance of the parameters before any data, over that of the coefficient noise.
PRIOR_VARIANCE = 1e8
#: Forgetting stops where a parameter makes the prediction this uncertain, over the noise variance.
LARGEST_PREDICTION_VARIANCE = 10.0

# Columns of a history row, one per reconstructed state; terms follow, each times dynamic pressure.
TIME, FLYING, QBAR = 0, 1, 2
FORCE, RATE, CENTRIPETAL, GYROSCOPIC = 3, 6, 9, 12  # three columns each
DOUBT = 15  # variance of the measured force coefficients from the accelerometer bias, three columns
SIGNAL = 18
NOISE = SIGNAL + _SIGNAL_COUNT
TERM = NOISE + _SIGNAL_COUNT


class Point:
    """Columns of an evaluation: what the second step saw and made of it."""

    TIME = 0
    MEASURED = slice(1, 7)
    PREDICTED = slice(7, 13)  # by the parameters before this sample
    VALID = slice(13, 19)  # the axis could be evaluated
    LEARNT = slice(19, 25)  # and its parameters were updated
    SIGNALS = slice(25, 25 + _SIGNAL_COUNT)
    TERMS = 25 + _SIGNAL_COUNT  # and on


class Body(NamedTuple):
    """Mass properties and geometry."""

    mass: float
    inertia: Array  # (3, 3)
    imu: Array  # (3,) from the centre of gravity
    reference: Array  # (3,) aerodynamic reference point from the centre of gravity
    geometry: Array  # wing area, span, chord
    gravity: float
    minimum_airspeed: float


class Learning(NamedTuple):
    """Recursive estimates of all axes; rows padded to the longest axis."""

    offsets: npt.NDArray[np.int64]  # (7,)
    theta: Array  # (6, n)
    p: Array  # (6, n, n)
    sums: Array  # (6, lags, n + 2, n + 2) of lagged_moments
    recent: Array  # (6, lags, n + 2)
    term_mean: Array  # (parameters,) running mean and square of each term: is it moving now?
    term_square: Array
    noise_square: Array  # (parameters,) running mean of the noise variance of each term, while learning
    updates: npt.NDArray[np.int64]  # (6,)
    last_learnt: Array  # (parameters,) time [s]
    last_valid: Array  # (6,) time [s] of the newest sample in the lagged sums
    doubt: Array  # (6,) newest variance of the measured coefficient from the accelerometer bias
    prior: Array  # (6, n, n) information of what was known before the axis changed, over the noise; 0: it never did
    prior_variance: Array  # (6,) of the noise before the change
    sampling: Array  # (6,) running mean square of the share of a parameter that sparse samples may take, while learning


def new_learning(model: AerodynamicModel, lags: int) -> Learning:
    """Nothing learnt yet of a model; ``lags`` of the sums, in evaluations."""
    counts = np.diff(model.offsets)
    n, total = int(counts.max()), int(counts.sum())
    return Learning(
        offsets=model.offsets,
        theta=np.zeros((6, n)),
        p=np.tile(PRIOR_VARIANCE * np.eye(n), (6, 1, 1)),
        sums=np.zeros((6, lags, n + 2, n + 2)),
        recent=np.full((6, lags, n + 2), np.nan),
        term_mean=np.full(total, np.nan),
        term_square=np.zeros(total),
        noise_square=np.zeros(total),
        updates=np.zeros(6, np.int64),
        last_learnt=np.full(total, np.nan),
        last_valid=np.full(6, -np.inf),
        doubt=np.zeros(6),
        prior=np.zeros((6, n, n)),
        prior_variance=np.zeros(6),
        sampling=np.zeros(6),
    )


class Tuning(NamedTuple):
    """Options of the loop."""

    half_width: float  # [s] of the differentiator
    step: float  # [s] between evaluations
    largest_gap: float  # [s] between states inside a window
    sparse: bool  # states are far apart beside the window, see ``window_average``
    sampling: float  # share of a parameter that sparse samples may take
    forgetting: float  # per evaluation
    motion_weight: float  # of the running mean that tells motion from rest
    excitation: float  # how many sigma of noise a term must move before the axis learns
    force_noise: float  # one sigma [N] of the accelerometer's white noise, averaged over a window, times mass


@njit(cache=True)
def _may_learn(row: Array, body: Body) -> bool:
    """In flight, and the first step is not at odds with its sensors."""
    if not (row[47] >= body.minimum_airspeed and row[53] > 0.0 and row[52] < LARGEST_CONSISTENCY):
        return False
    for i in range(3):
        if abs(row[14 + i]) > LARGEST_ACCELEROMETER_BIAS or abs(row[17 + i]) > LARGEST_GYRO_BIAS:
            return False
    return True


@njit(cache=True)
def fill_history(
    rows: Array,
    controls: Array,
    heights: Array,
    body: Body,
    sensors: Array,
    code: Array,
    code_offsets: Integers,
    start_time: float,
    out: Array,
) -> None:
    """History rows (n, TERM + terms) from states (n, Column.WIDTH), controls (n, 7) and heights (n,)."""
    for i in range(len(rows)):
        row, h = rows[i], out[i]
        rate = row[44:47]
        signals = h[SIGNAL:NOISE]
        h[TIME] = row[0]
        h[FLYING] = 1.0 if _may_learn(row, body) else 0.0
        fill_signals(row, controls[i], heights[i], start_time, body.geometry, body.gravity, signals)
        signal_noise(signals, row, sensors, body.geometry, h[NOISE:TERM])
        h[QBAR] = 0.5 * row[50] * row[47] * row[47]
        h[RATE : RATE + 3] = rate
        momentum = body.inertia @ rate
        h[GYROSCOPIC : GYROSCOPIC + 3] = np.cross(rate, momentum)
        h[CENTRIPETAL : CENTRIPETAL + 3] = np.cross(rate, np.cross(rate, body.imu))
        h[FORCE : FORCE + 3] = body.mass * row[41:44]
        for k in range(3):
            doubt = body.mass * row[_ACCELEROMETER_BIAS_STD + k] / (h[QBAR] * body.geometry[0])
            h[DOUBT + k] = doubt * doubt
        evaluate_programs(code, code_offsets, signals, h[TERM:])
        h[TERM:] *= h[QBAR]


@njit(cache=True)
def measured_coefficients(means: Array, slopes: Array, body: Body, out: Array) -> None:
    """C_X … C_n (6,) from window means: m A / (qbar S), A at the centre of gravity; (6.19) for moments."""
    acceleration = slopes[RATE : RATE + 3]
    at_cg = means[FORCE : FORCE + 3] - body.mass * (
        np.cross(acceleration, body.imu) + means[CENTRIPETAL : CENTRIPETAL + 3]
    )
    moment = body.inertia @ acceleration + means[GYROSCOPIC : GYROSCOPIC + 3]
    moment = moment_at_reference(moment, at_cg, body.reference)
    area, span, chord = body.geometry
    out[:] = coefficients_of(at_cg, moment, means[QBAR], area, span, chord)


@njit(cache=True)
def term_noise(
    code: Array, code_offsets: Integers, signals: Array, noise: Array, terms: Array, out: Array
) -> None:
    """One sigma of each term (n,) from the noise of the signals it reads, by finite differences."""
    out[:] = 0.0
    moved, shifted = signals.copy(), np.empty(len(terms))
    for k in range(len(signals)):
        if noise[k] > 0.0 and np.isfinite(noise[k]) and np.isfinite(signals[k]):
            moved[k] = signals[k] + noise[k]
            evaluate_programs(code, code_offsets, moved, shifted)
            moved[k] = signals[k]
            for j in range(len(terms)):
                if np.isfinite(shifted[j]):
                    out[j] += (shifted[j] - terms[j]) ** 2
    for j in range(len(terms)):
        out[j] = np.sqrt(out[j])


@njit(cache=True)
def _moving_terms(
    learning: Learning, first: int, last: int, noise: Array, tuning: Tuning
) -> tuple[int, int]:
    """How many terms of the axis have noise, and how many of those move by more than it just now."""
    noisy, moving = 0, 0
    for j in range(first, last):
        if noise[j] > 0.0:
            noisy += 1
            variance = learning.term_square[j] - learning.term_mean[j] ** 2
            if variance > (tuning.excitation * noise[j]) ** 2:
                moving += 1
    return noisy, moving


@njit(cache=True)
def _is_well_known(axis: int, first: int, last: int, learning: Learning) -> bool:
    """Every variance is so small that it may grow: the prediction is far better than one sample."""
    for j in range(last - first):
        if learning.p[axis, j, j] * learning.term_square[first + j] > LARGEST_PREDICTION_VARIANCE:
            return False
    return True


@njit(cache=True)
def _learn_axis(
    axis: int,
    point: Array,
    terms: Array,
    noise: Array,
    doubt: float,
    known: float,
    learning: Learning,
    tuning: Tuning,
) -> None:
    """Predict, and update the parameters of one axis if it moves; fills the axis' columns of the point.

    ``doubt`` is the variance of the measured coefficient from a bias that is not known yet, ``known`` that of
    its white noise: the weight (4.5) of the sample is known / (known + doubt).
    """
    first, last = learning.offsets[axis], learning.offsets[axis + 1]
    n = last - first
    x, y = terms[first:last], point[1 + axis]
    valid = np.isfinite(y) and n > 0
    for j in range(n):
        valid = valid and np.isfinite(x[j])
    if not valid:
        return
    point[13 + axis] = 1.0
    prediction = 0.0
    for j in range(n):
        prediction += x[j] * learning.theta[axis, j]
    point[7 + axis] = prediction
    noisy, moving = _moving_terms(learning, first, last, noise, tuning)
    if noisy > 0 and moving == 0:
        return  # nothing but noise: hold
    point[19 + axis] = 1.0
    root_weight = np.sqrt(known / (known + doubt))
    x, y = root_weight * x, root_weight * y
    p, forgetting = learning.p[axis, :n, :n], tuning.forgetting
    if moving == noisy and _is_well_known(axis, first, last, learning):
        p /= forgetting  # all is in motion: forget in every direction
        forgetting = 1.0
    rls_update(learning.theta[axis, :n], p, x, y, forgetting)
    learning.doubt[axis] = doubt
    accumulate(axis, point[0], x, y, root_weight, noise, learning, tuning)


@njit(cache=True)
def accumulate(
    axis: int,
    time: float,
    x: Array,
    y: float,
    root_weight: float,
    noise: Array,
    learning: Learning,
    tuning: Tuning,
) -> None:
    """Add a weighted sample that was learnt from to the lagged sums and to the noise of its terms."""
    first, last = learning.offsets[axis], learning.offsets[axis + 1]
    n = last - first
    recent = learning.recent[axis]
    if time - learning.last_valid[axis] > 1.5 * tuning.step:
        recent[:] = np.nan
    row = np.empty(n + 2)
    row[:n], row[n], row[n + 1] = x, y, root_weight
    sums = learning.sums[axis, :, : n + 2, : n + 2]
    add_sample(sums, recent[:, : n + 2], row, tuning.forgetting)
    learning.prior[axis] *= tuning.forgetting
    learning.last_valid[axis] = time
    learning.updates[axis] += 1
    learning.sampling[axis] += root_weight**2 / sums[0, n + 1, n + 1] * (tuning.sampling**2 - learning.sampling[axis])
    for j in range(first, last):
        share = root_weight**2 / sums[0, n + 1, n + 1]
        learning.noise_square[j] += share * (noise[j] ** 2 - learning.noise_square[j])
        variance = learning.term_square[j] - learning.term_mean[j] ** 2
        if noise[j] == 0.0 or variance > (tuning.excitation * noise[j]) ** 2:
            learning.last_learnt[j] = time


@njit(cache=True)
def _follow_motion(terms: Array, learning: Learning, tuning: Tuning) -> None:
    """Running mean and square of every term."""
    for j in range(len(terms)):
        if np.isfinite(terms[j]):
            if np.isnan(learning.term_mean[j]):
                learning.term_mean[j], learning.term_square[j] = terms[j], terms[j] ** 2
            learning.term_mean[j] += tuning.motion_weight * (terms[j] - learning.term_mean[j])
            learning.term_square[j] += tuning.motion_weight * (terms[j] ** 2 - learning.term_square[j])


@njit(cache=True)
def _window(
    times: Array, history: Array, low: int, center: float, tuning: Tuning
) -> tuple[int, int, bool]:
    """First and last row of the window about ``center``, and whether it is in flight and without a gap."""
    while low + 1 < len(times) and times[low + 1] <= center - tuning.half_width:
        low += 1
    high = low
    usable = times[low] <= center - tuning.half_width
    while usable and times[high] < center + tuning.half_width:
        high += 1
        usable = (
            times[high] - times[high - 1] <= tuning.largest_gap
            and history[high, FLYING] > 0.0
            and history[high - 1, FLYING] > 0.0
        )
    return low, high, usable


@njit(cache=True)
def _evaluate(
    center: float,
    means: Array,
    slopes: Array,
    body: Body,
    code: Array,
    code_offsets: Integers,
    learning: Learning,
    tuning: Tuning,
    point: Array,
) -> None:
    """Coefficients and terms from the averages of one window, and what all axes learn from them."""
    point[:] = np.nan
    point[13:25] = 0.0
    point[0] = center
    measured_coefficients(means, slopes, body, point[1:7])
    terms = means[TERM:] / means[QBAR]
    point[25 : 25 + _SIGNAL_COUNT] = means[SIGNAL:NOISE]
    point[25 + _SIGNAL_COUNT :] = terms
    noise, at_mean = np.empty(len(terms)), np.empty(len(terms))
    evaluate_programs(code, code_offsets, means[SIGNAL:NOISE], at_mean)  # a mean of powers is no power of means
    term_noise(code, code_offsets, means[SIGNAL:NOISE], means[NOISE:TERM], at_mean, noise)
    _follow_motion(terms, learning, tuning)
    known = (tuning.force_noise / (means[QBAR] * body.geometry[0])) ** 2
    for axis in range(6):
        doubt = means[DOUBT + axis] if axis < 3 else 0.0
        _learn_axis(axis, point, terms, noise, doubt, known, learning, tuning)


@njit(cache=True)
def learn(
    history: Array,
    next_index: int,
    body: Body,
    code: Array,
    code_offsets: Integers,
    learning: Learning,
    tuning: Tuning,
    points: Array,
) -> tuple[int, int]:
    """Evaluate and learn at every multiple of the step that the history covers.

    history (n, TERM + terms) ascending in time; ``next_index`` the first multiple to look at. Returns the
    next one and the number of points written to ``points`` (m, Point.TERMS + terms). A window with a gap, or
    on the ground, is passed over.
    """
    times = history[:, TIME].copy()
    count, low = 0, 0
    means, slopes = np.empty(history.shape[1]), np.empty(history.shape[1])
    while True:
        center = next_index * tuning.step
        if center + tuning.half_width > times[-1] or count == len(points):
            return next_index, count
        next_index += 1
        low, high, usable = _window(times, history, low, center, tuning)
        if usable:
            window_average(times, history, low, high, center, tuning.half_width, means, slopes, tuning.sparse)
            _evaluate(center, means, slopes, body, code, code_offsets, learning, tuning, points[count])
            count += 1
