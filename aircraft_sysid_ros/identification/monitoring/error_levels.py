"""How large the errors of the newest second of motion are, against what is usual."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, MEASURED, PREDICTED, CoefficientSample
from aircraft_sysid_ros.identification.monitoring.residuals import WINDOW, thinness
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_ALARM, _SIGN, _SLIGHT = THRESHOLDS.alarm, THRESHOLDS.first_sign, THRESHOLDS.slight
_TIME = CoefficientSample.TIME


@njit(cache=True)
def _exceeds(level: float, usual: float, largest: float, common: float, limits: tuple[float, float]) -> bool:
    """Whether a mean square error is above what is usual and above the largest block, by factors of the rms."""
    return level > limits[0] ** 2 * (common * usual) and level > limits[1] ** 2 * (common * largest)


@njit(cache=True)
def error_levels(samples: Array, since: Array, one_summary: npt.NDArray[np.void], levels: Array, flags: Bools) -> None:
    """Mean square error of the newest WINDOW samples of motion of each axis, and what it says.

    samples (n, …) ascending; ``since`` (6,) [s] from when they count; ``levels`` (6,) NaN where there are too few;
    ``flags`` (6, 3): above the first sign, above the alarm, above the slight unease at which older parameters are
    compared. Where the aeroplane is slower than it was, what is usual grows as 1/qbar. ``one_summary`` holds a
    ``residuals.Summary``.
    """
    summary = one_summary[0]
    for axis in range(6):
        total, thin, count = 0.0, 0.0, 0
        for i in range(len(samples) - 1, -1, -1):
            if not samples[i, _TIME] > since[axis] or count == WINDOW:
                break
            if samples[i, LEARNT + axis] > 0.0:
                total += (samples[i, MEASURED + axis] - samples[i, PREDICTED + axis]) ** 2
                thin += thinness(samples[i])
                count += 1
        levels[axis] = total / WINDOW if count == WINDOW else np.nan
        usual, largest = summary.usual[axis, 0], summary.usual[axis, 1]
        common = summary.common[0]
        if thin > WINDOW * summary.usual[axis, 2] > 0.0:
            common *= thin / WINDOW / summary.usual[axis, 2]
        flags[axis, 0] = _exceeds(levels[axis], usual, largest, common, _SIGN)
        flags[axis, 1] = _exceeds(levels[axis], usual, largest, common, _ALARM)
        flags[axis, 2] = _exceeds(levels[axis], usual, largest, common, _SLIGHT)
