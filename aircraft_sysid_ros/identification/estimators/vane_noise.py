"""Bias-compensated least squares: parameters freed of the pull of the vanes' noise towards zero.

Of regressors x + n, with white noise n that is independent of x and has the covariance S, N samples give

    theta = (I - P N S) theta_true    on the average,    P = (sum (x + n)(x + n)')^-1,

and S is known: `flow_angles` finds the noise of the vanes (Soderstrom, Errors-in-variables methods in system
identification, Automatica 43, 2007). The recursions go on with theta, which predicts best; what is published is freed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]

#: At most this share of a combination of terms is taken for noise of the vanes and put right.
LARGEST_SHARE = 0.5
#: One sigma of the correction, over the correction: the noise of a vane is known to so much of its variance.
CORRECTION_ERROR = 0.15


class Compensation(NamedTuple):
    """What is put right of n parameters."""

    matrix: Array  # (n, n) (I - P N S)^-1
    covariance: Array  # (n, n) of the noise that is put right: S, or less of it

    def freed(self, theta: Array) -> Array:
        """Parameters (n,) without the pull; NaN stays NaN."""
        known, out = np.isfinite(theta), theta.copy()
        if known.all():
            return np.asarray(self.matrix @ theta)
        out[known] = self.matrix[np.ix_(known, known)] @ theta[known]
        return out

    def widened(self, covariance: Array, theta: Array) -> Array:
        """Covariance (n, n) of ``freed`` from that of theta (n,), with the error of the correction; NaN stays NaN."""
        known, correction = np.isfinite(covariance.diagonal()) & np.isfinite(theta), self.freed(theta) - theta
        if known.all():
            return self._widened(self.matrix, covariance, correction)
        block, out = np.ix_(known, known), covariance.copy()
        out[block] = self._widened(self.matrix[block], covariance[block], correction[known])
        return out

    @staticmethod
    def _widened(matrix: Array, covariance: Array, correction: Array) -> Array:
        error = CORRECTION_ERROR**2 * np.outer(correction, correction)
        return np.asarray(matrix @ covariance @ matrix.T + error)


def compensation(inverse: Array, amount: float, covariance: Array) -> Compensation:
    """For P = ``inverse`` (n, n), N = ``amount`` and S = ``covariance`` (n, n)."""
    nothing = Compensation(np.eye(len(inverse)), np.zeros_like(inverse))
    share = amount * inverse @ covariance
    if not (share.any() and np.all(np.isfinite(share))):
        return nothing
    scale = min(1.0, LARGEST_SHARE / max(float(np.max(np.linalg.eigvals(share).real)), 1e-300))
    return Compensation(np.asarray(np.linalg.inv(nothing.matrix - scale * share)), scale * covariance)


@njit(cache=True)
def follow_vane_noise(shifts: Array, share: float, covariance: Array) -> None:
    """Running mean of S (n, n), in place, from what one sigma of each vane moves the terms by, ``shifts`` (2, n)."""
    n = shifts.shape[1]
    for i in range(n):
        for j in range(n):
            now = shifts[0, i] * shifts[0, j] + shifts[1, i] * shifts[1, j]
            covariance[i, j] += share * (now - covariance[i, j])
