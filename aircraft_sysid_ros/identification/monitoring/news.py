"""Is a model error a contradiction, or what an axis did not know before?

The variance of its predictions x' P x may explain the error, by the covariance from before it: as white noise has it,
or as it was published, for residuals that are coloured, within ``contradicts_sigma`` (``thresholds``) standard errors.
Or other values of the parameters do that were not trusted, the error being theirs alone,

    e = sum over them of x_j d_j,    d by least squares over the window.

Or one of their terms moves as it never did. What hardly moved has parameters that noise made, with small standard
errors; the first motion says so.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.identification.coefficients.layout import MEASURED, PREDICTED, CoefficientSample
from aircraft_sysid_ros.identification.history import ParameterCheckpoint
from aircraft_sysid_ros.identification.monitoring.residuals import WINDOW
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust

Array = npt.NDArray[np.float64]


def is_news(
    model: AerodynamicModel,
    axis: int,
    past: ParameterCheckpoint,
    samples: Array,
    level: float,
    usual: tuple[float, float],
) -> bool:
    """Whether the mean square error ``level`` of the newest WINDOW samples (n, …) of an axis is what it did not know.

    ``past``: what was known before them; ``usual`` mean square error, and that of the largest block.
    """
    part = model.axis_slice(AXES[axis])
    n = part.stop - part.start
    x = samples[:, CoefficientSample.TERMS + part.start : CoefficientSample.TERMS + part.stop]
    said, counted = past.found.covariance[part, part], usual[0] * past.least_squares.p[axis, :n, :n]
    by_sigma = (THRESHOLDS.contradicts_sigma / THRESHOLDS.alarm[0]) ** 2
    published = by_sigma * _variance(x, said) if np.isfinite(said).all() else 0.0
    explained = max(_variance(x, counted), published)
    if not _alarms(level, usual, explained):
        return True
    doubted = np.array([p.status != Trust.USE for p in past.found.parameters[part]], np.bool_)
    doubted &= model.constants[axis] == 0.0
    if not doubted.any():
        return False
    sums = past.least_squares.sums[axis, 0]
    learnt = np.diag(sums)[:n] / max(sums[n + 1, n + 1], 1e-300)
    if ((x * x).mean(axis=0) > THRESHOLDS.new_motion * learnt)[doubted].any():
        return True
    error = (samples[:, MEASURED + axis] - samples[:, PREDICTED + axis])[-WINDOW:]
    free = x[-WINDOW:, doubted]
    left = error - free @ np.linalg.lstsq(free, error, rcond=None)[0]
    return not _alarms(float(left @ left) / WINDOW, usual, explained)


def _variance(x: Array, covariance: Array) -> float:
    return float(np.einsum("ki,ij,kj->k", x, covariance, x).mean())


def _alarms(level: float, usual: tuple[float, float], explained: float) -> bool:
    limits = zip(THRESHOLDS.alarm, usual, strict=True)
    return all(level > over**2 * (usually + explained) for over, usually in limits)
