"""Measured coefficients and the terms of the model, from reconstructed states: compiled loops.

A state becomes a history row: what the equations of motion need, each signal with its noise, and each term of the
model times dynamic pressure. At every multiple of the step the rows of a window about it are averaged in the weak form
(``estimation.window_average``), which gives forces, moments and terms that belong together, however fast they change.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.postfix import (
    STACK_SIZE,
    evaluate_program,
    evaluate_programs,
    evaluate_terms,
    reads_signal,
)
from aircraft_sysid_ros.aircraft.rigid_body import coefficients_of, moment_at_reference
from aircraft_sysid_ros.aircraft.signals import FIRST_LAG, SIGNAL_INDEX
from aircraft_sysid_ros.estimation.window_average import window_average
from aircraft_sysid_ros.identification.coefficients.flow_angles import ANGLES, STD, VANE_STD
from aircraft_sysid_ros.identification.coefficients.layout import (
    BIAS_VARIANCE,
    CENTRIPETAL,
    FLYING,
    FORCE,
    FORCE_BIAS_VARIANCE,
    GYROSCOPIC,
    LEARNT,
    MEASURED,
    NOISE,
    PREDICTED,
    QBAR,
    RATE,
    SIGNAL,
    SIGNALS_OF_SAMPLE,
    TERM,
    TERMS_OF_SAMPLE,
    TIME,
    VALID,
    VANE_NOISE,
    WHITE_VARIANCE,
    Body,
    CoefficientSample,
)
from aircraft_sysid_ros.identification.coefficients.signals import fill_signals, signal_noise
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import D_ACCELEROMETER_BIAS, StateField

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_MOST_INCONSISTENT = THRESHOLDS.most_inconsistent
_LARGEST_ACCELEROMETER_BIAS, _LARGEST_GYRO_BIAS = THRESHOLDS.largest_accelerometer_bias, THRESHOLDS.largest_gyro_bias

_TIME, _AIRSPEED, _DENSITY = StateField.TIME, StateField.AIRSPEED, StateField.AIR_DENSITY
_CONSISTENCY, _STATUS = StateField.CONSISTENCY, StateField.STATUS
_ACCELEROMETER_BIAS, _GYRO_BIAS = StateField.ACCELEROMETER_BIAS.start, StateField.GYRO_BIAS.start
_SPECIFIC_FORCE, _RATES = StateField.SPECIFIC_FORCE.start, StateField.ANGULAR_VELOCITY.start
_ACCELEROMETER_BIAS_STD = StateField.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS
_SAMPLE_TIME = CoefficientSample.TIME
_FORCES = 3
#: The signals that vanes measure, in the order of ``flow_angles.VANES``.
ANGLE_SIGNALS = np.array([SIGNAL_INDEX["alpha"], SIGNAL_INDEX["beta"]])


@njit(cache=True)
def _may_learn(row: Array, body: Body) -> bool:
    """In flight, and the first step is not at odds with its sensors."""
    if not (row[_AIRSPEED] >= body.minimum_airspeed and row[_STATUS] > 0.0 and row[_CONSISTENCY] < _MOST_INCONSISTENT):
        return False
    for i in range(3):
        if abs(row[_ACCELEROMETER_BIAS + i]) > _LARGEST_ACCELEROMETER_BIAS:
            return False
        if abs(row[_GYRO_BIAS + i]) > _LARGEST_GYRO_BIAS:
            return False
    return True


@njit(cache=True)
def fill_history(
    rows: Array,
    angles: Array,
    controls: Array,
    heights: Array,
    body: Body,
    sensors: Array,
    code: Array,
    code_offsets: Integers,
    start_time: float,
    out: Array,
) -> None:
    """History rows (n, TERM + terms) from states (n, StateField.WIDTH), controls (n, 17) and heights (n,).

    ``angles`` (n, …) of ``flow_angles`` take the place of those of the states.
    """
    for i in range(len(rows)):
        row, h = rows[i], out[i]
        rate = row[_RATES : _RATES + 3]
        signals = h[SIGNAL:NOISE]
        h[TIME] = row[_TIME]
        h[FLYING] = 1.0 if _may_learn(row, body) else 0.0
        fill_signals(row, controls[i], heights[i], start_time, body.geometry, body.gravity, signals)
        signal_noise(signals, row, sensors, body.geometry, h[NOISE:TERM])
        for k in range(len(ANGLE_SIGNALS)):
            signals[ANGLE_SIGNALS[k]], h[NOISE + ANGLE_SIGNALS[k]] = angles[i, ANGLES + k], angles[i, STD + k]
            h[VANE_NOISE + k] = angles[i, VANE_STD + k]
        h[QBAR] = 0.5 * row[_DENSITY] * row[_AIRSPEED] * row[_AIRSPEED]
        h[RATE : RATE + 3] = rate
        momentum = body.inertia @ rate
        h[GYROSCOPIC : GYROSCOPIC + 3] = np.cross(rate, momentum)
        h[CENTRIPETAL : CENTRIPETAL + 3] = np.cross(rate, np.cross(rate, body.imu))
        h[FORCE : FORCE + 3] = body.mass * row[_SPECIFIC_FORCE : _SPECIFIC_FORCE + 3]
        for k in range(3):
            std = body.mass * row[_ACCELEROMETER_BIAS_STD + k] / (h[QBAR] * body.geometry[0])
            h[BIAS_VARIANCE + k] = std * std
        evaluate_terms(code, code_offsets, signals, h[TERM:])
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


def imu_response(body: Body) -> Array:
    """Variance (6, 2) of the coefficients at a dynamic pressure of 1 Pa, from independent unit variances.

    Of the three components of the mean force [N], and of the mean slope of the rates [rad/s^2].
    """
    found, out = np.zeros((6, 2)), np.empty(6)
    for i in range(3):
        for kind, column in enumerate((FORCE + i, RATE + i)):
            both = np.zeros((2, SIGNAL))
            both[0, QBAR], both[kind, column] = 1.0, 1.0
            measured_coefficients(both[0], both[1], body, out)
            found[:, kind] += out**2
    return found


@njit(cache=True)
def term_noise(code: Array, code_offsets: Integers, signals: Array, noise: Array, terms: Array, out: Array) -> None:
    """One sigma of each term (n,) from the noise of the signals it reads, by finite differences."""
    out[:] = 0.0
    stack, moved = np.empty((STACK_SIZE, 1)), signals.copy()
    row = np.expand_dims(moved, 0)
    for k in range(len(signals)):
        if noise[k] > 0.0 and np.isfinite(noise[k]) and np.isfinite(signals[k]):
            moved[k] = signals[k] + noise[k]
            for j in range(len(terms)):
                first, last = code_offsets[j], code_offsets[j + 1]
                if reads_signal(code, first, last, k):
                    evaluate_program(code, first, last, row, stack)
                    if np.isfinite(stack[0, 0]) and np.isfinite(terms[j]):
                        out[j] += (stack[0, 0] - terms[j]) ** 2
            moved[k] = signals[k]
    for j in range(len(terms)):
        out[j] = np.sqrt(out[j])


@njit(cache=True)
def term_shifts(code: Array, code_offsets: Integers, signals: Array, noise: Array, terms: Array, out: Array) -> None:
    """By how much one sigma of the noise (2,) of each vane moves each term, into ``out`` (2, n)."""
    out[:] = 0.0
    stack, moved = np.empty((STACK_SIZE, 1)), signals.copy()
    row = np.expand_dims(moved, 0)
    for k in range(len(ANGLE_SIGNALS)):
        signal = ANGLE_SIGNALS[k]
        if not (noise[k] > 0.0 and np.isfinite(signals[signal])):
            continue
        moved[signal] = signals[signal] + noise[k]
        for j in range(len(terms)):
            first, last = code_offsets[j], code_offsets[j + 1]
            if reads_signal(code, first, last, signal):
                evaluate_program(code, first, last, row, stack)
                shift = stack[0, 0] - terms[j]
                out[k, j] = shift if np.isfinite(shift) else 0.0
        moved[signal] = signals[signal]


@njit(cache=True)
def fill_lag_noise(code: Array, code_offsets: Integers, history: Array) -> None:
    """One sigma of each lag into history rows: that of what it follows, since errors of the flow angles are slow."""
    values, out = np.empty(len(code_offsets) - 1), np.empty(len(code_offsets) - 1)
    for h in history:
        evaluate_programs(code, code_offsets, h[SIGNAL:NOISE], values)
        term_noise(code, code_offsets, h[SIGNAL:NOISE], h[NOISE:TERM], values, out)
        h[NOISE + FIRST_LAG : NOISE + FIRST_LAG + len(out)] = out


@njit(cache=True)
def _window(
    times: Array, history: Array, low: int, center: float, half_width: float, largest_gap: float
) -> tuple[int, int, bool]:
    """First and last row of the window about ``center``, and whether it is in flight and without a gap."""
    while low + 1 < len(times) and times[low + 1] <= center - half_width:
        low += 1
    high = low
    usable = times[low] <= center - half_width
    while usable and times[high] < center + half_width:
        high += 1
        usable = (
            times[high] - times[high - 1] <= largest_gap
            and history[high, FLYING] > 0.0
            and history[high - 1, FLYING] > 0.0
        )
    return low, high, usable


@njit(cache=True)
def evaluate_windows(
    history: Array,
    next_index: int,
    step: float,
    half_width: float,
    largest_gap: float,
    force_noise: float,
    sparse: bool,
    body: Body,
    code: Array,
    code_offsets: Integers,
    samples: Array,
    noise: Array,
    vane_noise: Array,
    weights: Array,
) -> tuple[int, int]:
    """Coefficients and terms at every multiple of the step [s] whose window the history covers.

    history (n, TERM + terms) ascending in time; ``next_index`` the first multiple to look at; ``force_noise`` [N] one
    sigma of the accelerometer's white noise over a window, times mass; ``sparse``: rows are far apart for the window.
    Returns the next multiple and how many rows were written to ``samples`` (m, CoefficientSample.TERMS + terms),
    ``noise`` (m, terms), ``vane_noise`` (m, 2, terms) and ``weights`` (m, WEIGHT_COLUMNS). A window with a gap or on
    the ground is passed over.
    """
    times = history[:, TIME].copy()
    count, low = 0, 0
    means, slopes = np.empty(history.shape[1]), np.empty(history.shape[1])
    at_mean = np.empty(history.shape[1] - TERM)
    while True:
        center = next_index * step
        if center + half_width > times[-1] or count == len(samples):
            return next_index, count
        next_index += 1
        low, high, usable = _window(times, history, low, center, half_width, largest_gap)
        if not usable:
            continue
        window_average(times, history, low, high, center, half_width, means, slopes, sparse)
        sample, signals = samples[count], means[SIGNAL:NOISE]
        sample[:] = np.nan
        sample[VALID : LEARNT + 6] = 0.0
        sample[_SAMPLE_TIME] = center
        measured_coefficients(means, slopes, body, sample[MEASURED:PREDICTED])
        sample[SIGNALS_OF_SAMPLE:TERMS_OF_SAMPLE] = signals
        sample[TERMS_OF_SAMPLE:] = means[TERM:] / means[QBAR]
        evaluate_programs(code, code_offsets, signals, at_mean)  # a mean of powers is no power of means
        term_noise(code, code_offsets, signals, means[NOISE:TERM], at_mean, noise[count])
        of_vanes = means[VANE_NOISE : VANE_NOISE + 2]
        term_shifts(code, code_offsets, signals, of_vanes, at_mean, vane_noise[count])
        weights[count, WHITE_VARIANCE] = (force_noise / (means[QBAR] * body.geometry[0])) ** 2
        for k in range(_FORCES):
            weights[count, FORCE_BIAS_VARIANCE + k] = means[BIAS_VARIANCE + k]
        count += 1
