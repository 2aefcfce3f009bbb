"""Model against measurement over a sliding window, one figure per axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample

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
        valid = samples[:, CoefficientSample.VALID.start + i] > 0.0
        if valid.sum() > 2:
            measured = samples[valid, CoefficientSample.MEASURED.start + i]
            errors.append(_axis_error(axis, measured, samples[valid, CoefficientSample.PREDICTED.start + i]))
    return errors


def _axis_error(axis: str, measured: Array, predicted: Array) -> AxisError:
    residual = measured - predicted
    rms, spread = float(np.sqrt(np.mean(residual**2))), float(np.std(measured))
    centred = residual - residual.mean()
    power = float(centred @ centred)
    correlation = float(centred[1:] @ centred[:-1]) / power if power > 0.0 else 0.0
    return AxisError(
        axis,
        float(measured[-1]),
        float(predicted[-1]),
        rms / spread if spread > 0.0 else np.nan,
        rms,
        correlation,
        bool(abs(correlation) < 2.58 / np.sqrt(len(measured))),
    )
