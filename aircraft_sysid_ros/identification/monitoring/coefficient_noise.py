"""What noise makes of the error of a coefficient: the floor under the residual of a model that lacks nothing.

Per axis, variances added:

- the response: white noise of accelerometer and gyro through the window of ``estimation.window_average``, which takes
  means of the one and slopes of the other, and through m A / (qbar S) and (6.19). What is said of it, by the aircraft
  file or by default, is the most that it may be, and less counts where the flight shows less in the band of the window
  (``quiet_noise``). What fifth differences of dense samples show (``reconstruction.sensor_noise``) counts as well;
- the condition: noise of the terms, times the parameters, as least squares keeps it; that of an angle of the air is at
  most what the error of the force shows that it makes, since the moments cannot have more of it;
- the bias of the accelerometer, as far as it is not known yet;
- what sparse samples may take of a coefficient (``coefficients.pace``);
- the errors of the parameters, x' P x, since a sample is predicted with what was known before it. A sample of which
  less was known than it says itself, by least squares or the estimator that is published, says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.body import body_of
from aircraft_sysid_ros.identification.coefficients.evaluation import imu_response
from aircraft_sysid_ros.identification.coefficients.flow_angles import share_in_window
from aircraft_sysid_ros.identification.coefficients.layout import (
    FLYING,
    FORCE_BIAS_VARIANCE,
    MEASURED,
    TERMS_OF_SAMPLE,
    WEIGHT_COLUMNS,
    Body,
    CoefficientBatch,
    CoefficientSample,
)
from aircraft_sysid_ros.identification.history import ParameterCheckpoint
from aircraft_sysid_ros.identification.monitoring.quiet_noise import follow, in_use, new_quiet_noise
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.sensor_noise import imu_interval, imu_scales, learn_imu, new_imu_noise
from aircraft_sysid_ros.reconstruction.sparse_imu import LONG
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: The force whose error shows what the noise of an angle can be.
_SHOWN_BY = {"alpha": "CZ", "beta": "CY"}
_LITTLE_KNOWN, _OF_ANOTHER = THRESHOLDS.little_known, THRESHOLDS.little_known_of_another
_QBAR = CoefficientSample.SIGNALS.start + SIGNAL_INDEX["qbar"]
_TIME, _FORCE, _RATES = StateField.TIME, StateField.SPECIFIC_FORCE.start, StateField.ANGULAR_VELOCITY.start


def slope_variance(interval: float, half_width: float) -> float:
    """Variance [1/s^2] of the slope over a window of unit white noise, ``interval`` [s] from sample to sample.

    The parabola of ``window_average`` over straight lines: 1.5 r / half-width^2 for r = interval / half-width far below
    1; the denominator is fitted to sums of squared weights, to 3 % up to r = 1.25.
    """
    r = interval / half_width
    return 1.5 * r / ((1.0 + 0.74 * r + 0.24 * r * r + 0.70 * r * r * r) * half_width**2)


@njit(cache=True)
def _learn(
    rows: Array,
    flying: Array,
    of_force: float,
    of_rate: float,
    half_width: float,
    noise: Array,
    one_quiet: npt.NDArray[np.void],
) -> None:
    values, quiet = np.empty(6), one_quiet[0]
    for i in range(len(rows)):
        if flying[i] > 0.0:
            values[:3], values[3:] = rows[i, _FORCE : _FORCE + 3], rows[i, _RATES : _RATES + 3]
            learn_imu(rows[i, _TIME], values, of_force, of_rate, noise)
            follow(rows[i], half_width, quiet)


@njit(cache=True)
def _respond(samples: Array, response: Array, of_force: float, of_rate: float, out: Array) -> None:
    """Variances (m, 6) of samples from those of the mean force and of the slope of the rates in their windows."""
    for k in range(len(samples)):
        for axis in range(out.shape[1]):
            at_unit = response[axis, 0] * of_force + response[axis, 1] * of_rate
            out[k, axis] = at_unit / samples[k, _QBAR] ** 2


@njit(cache=True)
def _add_known(samples: Array, weights: Array, terms: Array, sampling: Array, out: Array) -> None:
    """Add that of the terms (6,), of sparse samples (6,) and of the bias of the accelerometer to variances (m, 6)."""
    for k in range(len(samples)):
        for axis in range(out.shape[1]):
            out[k, axis] += terms[axis]
            out[k, axis] += sampling[axis] * samples[k, MEASURED + axis] ** 2
        for axis in range(WEIGHT_COLUMNS - FORCE_BIAS_VARIANCE):
            out[k, axis] += weights[k, FORCE_BIAS_VARIANCE + axis]


@njit(cache=True)
def _add_parameters(samples: Array, offsets: Integers, p: Array, own: Array, out: Array) -> None:
    """The errors of parameters into variances (m, 6): ``p`` (6, n, n) of least squares, over the variance of the noise.

    ``own`` (6, n, n) is the covariance of another estimator, 0 where there is none.
    """
    for k in range(len(samples)):
        for axis in range(len(p)):
            first, last, relative, total = offsets[axis], offsets[axis + 1], 0.0, 0.0
            x = samples[k, TERMS_OF_SAMPLE + first : TERMS_OF_SAMPLE + last]
            for i in range(last - first):
                for j in range(last - first):
                    relative += x[i] * p[axis, i, j] * x[j]
                    total += x[i] * own[axis, i, j] * x[j]
            known = relative <= (_LITTLE_KNOWN if total == 0.0 else _OF_ANOTHER)
            out[k, axis] = out[k, axis] * (1.0 + relative) + total if known else np.nan


def _forces_that_show(model: AerodynamicModel) -> list[list[int]]:
    """Of each axis and term the force whose error shows what the noise of its angle can be; its own axis: none does."""
    names = [(axis, [_SHOWN_BY.get(term.partition("**")[0], axis) for term in model.terms[axis]]) for axis in AXES]
    return [[AXES.index(force) for force in forces] for _, forces in names]


def _shares(axis: int, forces: list[int], over_noise: Sequence[float]) -> Array:
    """Of the noise of each term of an axis (n,) as much as the error of the force of its angle leaves."""
    return np.array([1.0 if force == axis else np.fmin(over_noise[force] ** 2, 1.0) for force in forces])


class CoefficientNoise:
    """Follows the noise of the IMU, and says what noise makes of samples."""

    def __init__(self, aircraft: Aircraft, half_width: float) -> None:
        """``half_width`` [s] of the differentiating window."""
        sensors = aircraft.sensors
        self._said = sensors["accelerometer"].noise[0] ** 2, sensors["gyro"].noise[0] ** 2
        self._half_width, self._imu, self._quiet = half_width, new_imu_noise(), new_quiet_noise()
        self._set_body(body_of(aircraft))
        self._model, self._forces = aircraft.model, _forces_that_show(aircraft.model)
        self._terms = self._sampling = np.zeros(len(AXES))
        self._offsets = np.zeros(len(AXES) + 1, np.int64)
        self._p = self._own = np.zeros((len(AXES), 0, 0))

    def _set_body(self, body: Body) -> None:
        self._body, self._response = body, imu_response(body)

    def add(self, batch: CoefficientBatch) -> None:
        """Take states that came together."""
        if batch.body is not self._body:
            self._set_body(batch.body)
        _learn(batch.rows, batch.history[:, FLYING], *self._said, self._half_width, self._imu, self._quiet)

    def note(self, kept: ParameterCheckpoint, model: AerodynamicModel, over_noise: Sequence[float]) -> None:
        """Take what is known now; ``over_noise`` (6,) rms error of each axis over what noise makes of it, or NaN."""
        known, self._offsets = kept.least_squares, model.offsets
        self._sampling, self._p, self._own = known.sampling, known.p, np.zeros_like(known.p)
        if model is not self._model:
            self._model, self._forces = model, _forces_that_show(model)
        terms = np.zeros(len(AXES))
        for axis, own in enumerate(kept.describe.own):
            part = slice(model.offsets[axis], model.offsets[axis + 1])
            n = part.stop - part.start
            theta = known.theta[axis, :n] if own is None else np.nan_to_num(own.theta)
            terms[axis] = theta**2 @ (known.noise_square[part] * _shares(axis, self._forces[axis], over_noise))
            if own is not None:
                enough = own.samples >= THRESHOLDS.samples
                self._own[axis, :n, :n] = own.covariance if enough else np.nan
        self._terms = terms

    def response(self, samples: Array) -> Array:
        """Variances (m, 6) of samples (m, …) from the noise of the IMU."""
        interval = imu_interval(self._imu)
        shown = (0.0, 0.0) if interval > LONG else imu_scales(self._imu, np.inf)  # beside sparse ones it is motion
        force, rate = map(in_use, self._said, shown, self._quiet["variance"][0].tolist())
        of_force = self._body.mass**2 * force * share_in_window(interval, self._half_width)
        of_rate = rate * slope_variance(interval, self._half_width)
        found = np.empty((len(samples), len(AXES)))
        _respond(samples, self._response, of_force, of_rate, found)
        return found

    def variances(self, samples: Array, weights: Array) -> Array:
        """Of the errors of samples (m, …), with weights (m, WEIGHT_COLUMNS), from all that is known now: (m, 6).

        NaN where it was not known what was predicted.
        """
        found = self.response(samples)
        _add_known(samples, weights, self._terms, self._sampling, found)
        _add_parameters(samples, self._offsets, self._p, self._own, found)
        return found
