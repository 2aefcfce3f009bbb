"""Recursive least squares, (4.12)-(4.14) of the summary, with directional forgetting.

Model: ``y(k) = x(k)' theta + e(k)``, scalar y. With forgetting 1 this is (4.12) and (4.14) for W = 1; (4.14) as
printed carries a W^-1 too many, which W = 1 hides (EQUATIONS: the Woodbury identity has none).

Exponential forgetting loses the information of every direction at each step, so that without excitation the
covariance P = R^-1 grows without bound and the estimate drifts. Directional forgetting (Kulhavy 1987; Bittanti,
Bolzern and Campi 1990) forgets only along the direction in which the new sample brings information: what is not
excited is held.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from aircraft_sysid_ros.estimation.iterated_ekf import symmetrise


@njit(cache=True)
def rls_update(theta, p, x, y, forgetting):
    """One sample, in place: theta (n,), p (n, n) = R^-1, x (n,) regressors, y measured, 0 < forgetting <= 1.

    Returns the prediction error y - x' theta before the update. The covariance is updated in the Joseph form plus a
    positive rank-one term, so that it stays symmetric and positive.
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
    if not (r > 0.0) or not np.isfinite(error):
        return error
    # (I - k x') P (I - k x')' + k k' with k = P x / (1 + r), and what is forgotten along x
    forgotten = (1.0 - forgetting) / (forgetting * r * (1.0 + r))
    scale = forgotten - 1.0 / (1.0 + r)
    for i in range(n):
        theta[i] += px[i] / (1.0 + r) * error
        for j in range(n):
            p[i, j] += scale * px[i] * px[j]
    symmetrise(p)
    return error
