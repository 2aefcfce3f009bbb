"""Model against measurement over a sliding window, one figure per axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.identification.coefficients.layout import MEASURED, PREDICTED, VALID
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
    white: bool  # the lag-one correlation is within what white noise gives in 99 % of windows


def model_errors(samples: Array) -> list[AxisError]:
    """One entry per axis that was evaluated in samples (n, …) of ``CoefficientSample``."""
    errors = []
    for i, axis in enumerate(AXES):
        count, measured, predicted, spread, rms, correlation = _axis_error(samples, i)
        if count > 2:
            nrmse, white = rms / spread if spread > 0.0 else np.nan, abs(correlation) < 2.58 / np.sqrt(count)
            errors.append(AxisError(axis, measured, predicted, nrmse, rms, correlation, bool(white)))
    return errors


@njit(cache=True)
def _axis_error(samples: Array, axis: int) -> tuple[int, float, float, float, float, float]:
    """How many of the samples (n, …) are valid in an axis, the newest of what was measured and predicted of them.

    Then the standard deviation of what was measured, and rms and lag-one correlation of the residuals.
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
        return 0, np.nan, np.nan, np.nan, np.nan, np.nan
    variance, power, product, before = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        variance += (measured[i] - mean / count) ** 2
        centred = residual[i] - mean_residual / count
        power, product, before = power + centred * centred, product + centred * before, centred
    correlation = product / power if power > 0.0 else 0.0
    return count, measured[count - 1], predicted, np.sqrt(variance / count), np.sqrt(square / count), correlation
