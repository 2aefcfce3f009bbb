"""Recursive least squares, (4.12)-(4.14) of the summary, with directional forgetting.

Model: ``y(k) = x(k)' theta + e(k)``, scalar y. With forgetting 1 this is (4.12) and (4.14) for W = 1; (4.14)
as printed carries a W^-1 too many, which W = 1 hides (the Woodbury identity has none). For W other than 1,
divide x and y by its root.

Exponential forgetting loses the information of every direction at each step, so that without excitation the
covariance P = R^-1 grows without bound and the estimate drifts. Directional forgetting (Kulhavy 1987;
Bittanti, Bolzern and Campi 1990) forgets only along the direction in which the new sample brings information:
what is not excited is held.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.estimation.iterated_ekf import symmetrise

Array = npt.NDArray[np.float64]

#: x' P x of a sample that says nothing; what is forgotten along x is divided by it.
_NO_INFORMATION = 1e-300


@njit(cache=True)
def rls_update(theta: Array, p: Array, x: Array, y: float, forgetting: float) -> float:
    """One sample, in place: theta (n,), p (n, n) = R^-1, x (n,) regressors, y measured, 0 < forgetting <= 1.

    Returns the prediction error y - x' theta before the update. P changes along P x only, and stays symmetric
    and positive: with r = x' P x before, x' P x is r / (forgetting (1 + r)) after. A sample without
    information (r = 0) or without a value (NaN) changes nothing.
    """
    n = len(theta)
    px = np.zeros(n)
    for i in range(n):
        for j in range(n):
            px[i] += p[i, j] * x[j]
    r, error = 0.0, y
    for i in range(n):
        r += x[i] * px[i]
        error -= x[i] * theta[i]
    if not (r > _NO_INFORMATION) or not np.isfinite(error):
        return error
    # P - P x x' P / (1 + r), and what is forgotten along x
    forgotten = (1.0 - forgetting) / (forgetting * r * (1.0 + r))
    scale = forgotten - 1.0 / (1.0 + r)
    for i in range(n):
        theta[i] += px[i] / (1.0 + r) * error
        for j in range(n):
            p[i, j] += scale * px[i] * px[j]
    symmetrise(p)
    return error
