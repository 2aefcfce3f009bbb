"""Model against measurement over a sliding window, one figure per axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.identification.coefficients.layout import MEASURED, PREDICTED, VALID
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class AxisError:
    """Error of one axis; predictions are made before each sample is learnt from."""

    axis: str
    measured: float
    predicted: float
    nrmse: float
    residual_rms: float
    lag_one_correlation: float
    white: bool  # where samples do not overlap, the correlation is within what white noise gives in 99 % of windows
    over_noise: float  # rms error over what noise makes of it, in the newest minutes of motion; NaN: not known yet


def samples_apart(step: float, half_width: float) -> int:
    """How many samples, ``step`` [s] each, from one window of ``half_width`` [s] to the first that shares nothing."""
    return math.floor(2.0 * half_width / step) + 1


def model_errors(samples: Array, apart: int, over_noise: Sequence[float]) -> list[AxisError]:
    """One entry per axis that was evaluated in samples (n, …) of ``CoefficientSample``, every ``apart``-th on its own.

    ``over_noise`` (6,): rms error of each axis over what noise makes of it.
    """
    errors, overlap = [], (2.0 * apart**2 + 1.0) / (3.0 * apart)  # sum of squared correlations of means that overlap
    for i, axis in enumerate(AXES):
        count, measured, predicted, spread, rms, lag_one, correlation = _axis_error(samples, i, apart)
        if count > 2:
            nrmse = rms / spread if spread > 0.0 else np.nan
            enough = count >= THRESHOLDS.white_windows * apart
            white = enough and abs(correlation) < THRESHOLDS.white_sigma * np.sqrt(overlap / count)
            errors.append(AxisError(axis, measured, predicted, nrmse, rms, lag_one, bool(white), float(over_noise[i])))
    return errors


@njit(cache=True)
def _axis_error(samples: Array, axis: int, apart: int) -> tuple[int, float, float, float, float, float, float]:
    """How many of the samples (n, …) are valid in an axis, the newest of what was measured and predicted of them.

    Then the standard deviation of what was measured, and rms and correlations of the residuals: of successive samples,
    and of those that are ``apart``.
    """
    count, mean, mean_residual, square = 0, 0.0, 0.0, 0.0
    measured, residual = np.empty(len(samples)), np.empty(len(samples))
    predicted = np.nan
    for sample in samples:
        if sample[VALID + axis] > 0.0:
            predicted = sample[PREDICTED + axis]
            measured[count], residual[count] = sample[MEASURED + axis], sample[MEASURED + axis] - predicted
            mean, mean_residual = mean + measured[count], mean_residual + residual[count]
            square += residual[count] ** 2
            count += 1
    if count == 0:
        return 0, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan
    variance, power, product, far = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        variance += (measured[i] - mean / count) ** 2
        residual[i] -= mean_residual / count
        power += residual[i] * residual[i]
        product += residual[i] * residual[i - 1] if i > 0 else 0.0
        far += residual[i] * residual[i - apart] if i >= apart else 0.0
    if power > 0.0:
        product, far = product / power, far / power
    return count, measured[count - 1], predicted, np.sqrt(variance / count), np.sqrt(square / count), product, far
