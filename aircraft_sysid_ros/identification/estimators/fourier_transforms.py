"""The jitted loop of the estimator ``fourier``: history rows in, transforms of all axes out.

See ``fourier_learner`` for the equations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.recursive_fourier import advance, step_factor
from aircraft_sysid_ros.identification.coefficients.evaluation import ANGLE_SIGNALS, term_noise, term_shifts
from aircraft_sysid_ros.identification.coefficients.layout import (
    BIAS_VARIANCE,
    CENTRIPETAL,
    FLYING,
    FORCE,
    GYROSCOPIC,
    NOISE,
    QBAR,
    RATE,
    SIGNAL,
    TERM,
    TIME,
    VANE_NOISE,
    Body,
)
from aircraft_sysid_ros.identification.estimators.vane_noise import follow_vane_noise
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
ComplexArray = npt.NDArray[np.complex128]

#: Time constant [s] of the running mean that tells motion from rest.
_MOTION_TIME = 2.0
#: An axis goes on for this time [s] after its newest motion: every end of a stretch costs the noise of one sample.
_PATIENCE = 5.0
#: The weight of new data rises by this factor at a time.
_WEIGHT_STEP = 1.05
# Columns of an axis: s, g, then its terms.
STATIC, MOMENTUM, TERMS = 0, 1, 2


class Bank(NamedTuple):
    """Transforms of all axes, rows padded to the longest axis, and what decides whether they go on."""

    offsets: npt.NDArray[np.int64]  # (7,)
    transforms: ComplexArray  # (6, 2 + n, m)
    boundary: ComplexArray  # (6, m)
    before: Array  # (6, 2 + n) newest values
    open: npt.NDArray[np.bool_]  # (6,) a stretch of data is under way
    length: Array  # (6,) [s] of data
    weight: Array  # (6,) root of the weight of data that come now, when the transforms were scaled last
    noise_square: Array  # (parameters,) faded mean of the noise variance of each term in the band
    vane_covariance: (
        Array  # (6, n, n) faded mean of the covariance of the terms from the noise of the vanes in the band
    )
    dynamic_pressure: Array  # (6,) faded mean of its square
    bias_variance: Array  # (6,) newest variance of the coefficient from the accelerometer bias
    last_learnt: Array  # (parameters,) [s]
    last_motion: Array  # (6,) [s]
    term_mean: Array  # (parameters,) running mean and square: is the term moving now?
    term_square: Array
    noise: Array  # (parameters,) newest one sigma, as the term is recorded
    noise_in_band: Array  # (parameters,) and what of it lies in the band
    vane_noise: Array  # (2, parameters) newest: by how much one sigma of each vane, in the band, moves the term
    clock: Array  # (3,) newest time, time of the newest look at motion, step of ``factor``
    factor: ComplexArray  # (m,)


class Setting(NamedTuple):
    """Options of the loop."""

    frequencies: Array  # (m,) angular, from zero
    memory: float  # [s] of the amplitude
    step: float  # [s] between looks at motion
    largest_gap: float  # [s]
    excitation: float  # how many sigma of noise a term must move
    force_noise: float  # one sigma [N] of the accelerometer's white noise, as the time domain takes it
    in_band: Array  # (signals,) share of the standard deviation of a signal's noise that lies in the band
    vane_in_band: float  # the same share of the noise of a vane, which history rows have as a window leaves it


def new_bank(offsets: Integers, frequencies: int) -> Bank:
    """A bank that has seen nothing, for axes that start at ``offsets`` (7,) among the parameters."""
    n, total = int(np.diff(offsets).max()), int(offsets[-1])
    return Bank(
        offsets=offsets,
        transforms=np.zeros((6, TERMS + n, frequencies), np.complex128),
        boundary=np.zeros((6, frequencies), np.complex128),
        before=np.zeros((6, TERMS + n)),
        open=np.zeros(6, np.bool_),
        length=np.zeros(6),
        weight=np.full(6, 1e-6),
        noise_square=np.zeros(total),
        vane_covariance=np.zeros((6, n, n)),
        dynamic_pressure=np.zeros(6),
        bias_variance=np.zeros(6),
        last_learnt=np.full(total, np.nan),
        last_motion=np.full(6, -np.inf),
        term_mean=np.full(total, np.nan),
        term_square=np.zeros(total),
        noise=np.zeros(total),
        noise_in_band=np.zeros(total),
        vane_noise=np.zeros((2, total)),
        clock=np.array([-np.inf, -np.inf, np.nan]),
        factor=np.zeros(frequencies, np.complex128),
    )


@njit(cache=True)
def fill_axes(h: Array, body: Body, out: Array) -> None:
    """s and g of the module's equations over area and length, into ``out`` (6, 2), from a history row."""
    area, span, chord = body.geometry
    static = h[FORCE : FORCE + 3] - body.mass * h[CENTRIPETAL : CENTRIPETAL + 3]
    momentum = -body.mass * np.cross(h[RATE : RATE + 3], body.imu)
    turning = h[GYROSCOPIC : GYROSCOPIC + 3] - np.cross(body.reference, static)
    spin = body.inertia @ h[RATE : RATE + 3] - np.cross(body.reference, momentum)
    for k in range(3):
        length = chord if k == 1 else span
        out[k, 0], out[k, 1] = static[k] / area, momentum[k] / area
        out[3 + k, 0], out[3 + k, 1] = turning[k] / (area * length), spin[k] / (area * length)


@njit(cache=True)
def _look_at_motion(h: Array, code: Array, code_offsets: Integers, bank: Bank, setting: Setting) -> None:
    """Running mean and square of every term, and its noise."""
    terms = h[TERM:] / h[QBAR]
    weight = 1.0 - np.exp(-setting.step / _MOTION_TIME)
    term_noise(code, code_offsets, h[SIGNAL:NOISE], h[NOISE:TERM], terms, bank.noise)
    in_band, of_vanes = h[NOISE:TERM] * setting.in_band, h[VANE_NOISE : VANE_NOISE + 2] * setting.vane_in_band
    for k in range(len(ANGLE_SIGNALS)):
        signal = ANGLE_SIGNALS[k]
        in_band[signal] = np.sqrt(max(in_band[signal] ** 2 - h[VANE_NOISE + k] ** 2, 0.0) + of_vanes[k] ** 2)
    term_noise(code, code_offsets, h[SIGNAL:NOISE], in_band, terms, bank.noise_in_band)
    term_shifts(code, code_offsets, h[SIGNAL:NOISE], of_vanes, terms, bank.vane_noise)
    for j in range(len(terms)):
        if np.isfinite(terms[j]):
            if np.isnan(bank.term_mean[j]):
                bank.term_mean[j], bank.term_square[j] = terms[j], terms[j] ** 2
            bank.term_mean[j] += weight * (terms[j] - bank.term_mean[j])
            bank.term_square[j] += weight * (terms[j] ** 2 - bank.term_square[j])


@njit(cache=True)
def _is_moving(axis: int, time: float, bank: Bank, setting: Setting) -> bool:
    """Some term of the axis moves by more than its noise, or did just now; marks those that do as learnt from."""
    noisy, moving = False, False
    for j in range(bank.offsets[axis], bank.offsets[axis + 1]):
        limit = (setting.excitation * bank.noise[j]) ** 2
        moves = bank.term_square[j] - bank.term_mean[j] ** 2 > limit
        noisy = noisy or bank.noise[j] > 0.0
        moving = moving or (bank.noise[j] > 0.0 and moves)
    if moving or not noisy:
        bank.last_motion[axis] = time
    if time - bank.last_motion[axis] > _PATIENCE:
        return False
    for j in range(bank.offsets[axis], bank.offsets[axis + 1]):
        limit = (setting.excitation * bank.noise[j]) ** 2
        if bank.noise[j] == 0.0 or bank.term_square[j] - bank.term_mean[j] ** 2 > limit:
            bank.last_learnt[j] = time
    return True


@njit(cache=True)
def close_axis(axis: int, bank: Bank) -> None:
    """End the stretch of data of one axis: its second boundary term."""
    if bank.open[axis]:
        bank.boundary[axis] += bank.before[axis, MOMENTUM]
        bank.open[axis] = False


def clear_axis(axis: int, bank: Bank) -> None:
    """Forget what one axis has learnt; how its terms move and what their noise is stays."""
    for array in (bank.transforms, bank.boundary, bank.before, bank.length, bank.dynamic_pressure):
        array[axis] = 0.0
    bank.open[axis] = False


@njit(cache=True)
def transform_again(axis: int, history: Array, body: Body, bank: Bank, setting: Setting) -> None:
    """Take rows (n, TERM + terms) that were taken before once more, for one axis that was cleared since."""
    sides = np.empty((6, 2))
    first, last = TERM + bank.offsets[axis], TERM + bank.offsets[axis + 1]
    factor = np.empty_like(bank.factor)
    for i in range(len(history)):
        h = history[i]
        step = h[TIME] - history[max(i - 1, 0), TIME]
        fill_axes(h, body, sides)
        now = np.empty(TERMS + last - first)
        now[:TERMS], now[TERMS:] = sides[axis], h[first:last]
        usable = h[FLYING] > 0.0 and np.all(np.isfinite(now))
        if step > setting.largest_gap or not usable:
            close_axis(axis, bank)
        if usable:
            factor[:] = bank.factor
            step_factor(setting.frequencies, setting.memory, step, bank.factor)
            follow(axis, now, h, step, bank, setting)
            bank.factor[:] = factor


@njit(cache=True)
def weigh(axis: int, dynamic_force: float, bias_variance: float, bank: Bank, setting: Setting) -> None:
    """Make what a force axis learnt with a less known accelerometer bias count less, as if it were shorter.

    ``bias_variance`` is that of its coefficient from the bias, ``dynamic_force`` qbar S [N]. The weight (4.5) of a
    sample is known / (known + bias_variance), known the variance from white noise. It rises in steps: between them it
    is constant, so that derivatives are still exact.
    """
    bank.bias_variance[axis] = bias_variance
    known = (setting.force_noise / dynamic_force) ** 2
    weight = np.sqrt(known / (known + bias_variance))
    if weight > _WEIGHT_STEP * bank.weight[axis]:
        ratio = bank.weight[axis] / weight
        close_axis(axis, bank)
        bank.transforms[axis] *= ratio
        bank.boundary[axis] *= ratio
        shorter = ratio * ratio * -np.expm1(-2.0 * bank.length[axis] / setting.memory)
        bank.length[axis] = -0.5 * setting.memory * np.log1p(-shorter)
        bank.weight[axis] = weight


@njit(cache=True)
def follow(axis: int, now: Array, h: Array, step: float, bank: Bank, setting: Setting) -> None:
    """Go on with the stretch of an axis by one step, or begin one."""
    n = len(now)
    first, last = bank.offsets[axis], bank.offsets[axis + 1]
    if bank.open[axis]:
        advance(bank.transforms[axis, :n], bank.before[axis, :n], now, step, bank.factor)
        bank.boundary[axis] *= bank.factor
        bank.length[axis] += step
        share = 1.0 / (bank.length[axis] / step + 1.0)
        share = max(share, 2.0 * step / setting.memory)
        bank.dynamic_pressure[axis] += share * (h[QBAR] ** 2 - bank.dynamic_pressure[axis])
        for j in range(first, last):
            bank.noise_square[j] += share * (bank.noise_in_band[j] ** 2 - bank.noise_square[j])
        follow_vane_noise(bank.vane_noise[:, first:last], share, bank.vane_covariance[axis])
    else:
        bank.boundary[axis] -= now[MOMENTUM]
        bank.open[axis] = True
    bank.before[axis, :n] = now


@njit(cache=True)
def transform_rows(
    history: Array, body: Body, code: Array, code_offsets: Integers, bank: Bank, setting: Setting
) -> None:
    """Take history rows (n, TERM + terms) in order of time; an axis that cannot or need not learn stands still."""
    sides = np.empty((6, 2))
    for i in range(len(history)):
        h = history[i]
        step = h[TIME] - bank.clock[0]
        if step <= 0.0:
            continue
        bank.clock[0] = h[TIME]
        if np.floor(h[TIME] / setting.step) != bank.clock[1]:
            bank.clock[1] = np.floor(h[TIME] / setting.step)
            _look_at_motion(h, code, code_offsets, bank, setting)
        if step <= setting.largest_gap and step != bank.clock[2]:
            bank.clock[2] = step
            step_factor(setting.frequencies, setting.memory, step, bank.factor)
        fill_axes(h, body, sides)
        for axis in range(6):
            first, last = TERM + bank.offsets[axis], TERM + bank.offsets[axis + 1]
            now = np.empty(TERMS + last - first)
            now[:TERMS], now[TERMS:] = sides[axis], h[first:last]
            usable = h[FLYING] > 0.0 and last > first and np.all(np.isfinite(now))
            usable = usable and _is_moving(axis, h[TIME], bank, setting)
            if step > setting.largest_gap or not usable:
                close_axis(axis, bank)
            if usable and axis < 3:
                weigh(axis, h[QBAR] * body.geometry[0], h[BIAS_VARIANCE + axis], bank, setting)
            if usable:
                follow(axis, now, h, step, bank, setting)
