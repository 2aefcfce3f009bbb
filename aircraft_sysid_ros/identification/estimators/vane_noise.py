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

from aircraft_sysid_ros.kernels import njit

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
        return np.asarray(freed(self.matrix, theta))

    def widened(self, covariance: Array, theta: Array) -> Array:
        """Covariance (n, n) of ``freed`` from that of theta (n,), with the error of the correction; NaN stays NaN."""
        return np.asarray(widened(self.matrix, np.ascontiguousarray(covariance), theta))


def compensation(inverse: Array, amount: float, covariance: Array) -> Compensation:
    """For P = ``inverse`` (n, n), N = ``amount`` and S = ``covariance`` (n, n)."""
    matrix, share = correction(np.ascontiguousarray(inverse), amount, np.ascontiguousarray(covariance))
    return Compensation(matrix, share * covariance)


@njit(cache=True, error_model="numpy")
def correction(inverse: Array, amount: float, covariance: Array) -> tuple[Array, float]:
    """(I - P N S)^-1 (n, n) as ``compensation`` has it, and which share of S is put right in it."""
    n = len(inverse)
    matrix, share, trace, largest = np.eye(n), np.zeros((n, n)), 0.0, 0.0
    for i in range(n):
        for j in range(n):
            for k in range(n):
                share[i, j] += amount * inverse[i, k] * covariance[k, j]
            largest = max(largest, abs(share[i, j]))
        trace += share[i, i]
    if not (largest > 0.0 and np.isfinite(trace) and np.isfinite(largest)):
        return matrix, 0.0
    scale = 1.0
    if trace > LARGEST_SHARE:  # of a product of two positive matrices no eigenvalue is negative, or above the trace
        scale = min(1.0, LARGEST_SHARE / np.max(np.linalg.eigvals(share.astype(np.complex128)).real))
    matrix[:] = np.linalg.inv(matrix - scale * share)
    return matrix, scale


@njit(cache=True)
def freed(matrix: Array, theta: Array) -> Array:
    """Parameters (n,) without the pull, by ``matrix`` (n, n) of ``correction``; NaN stays NaN."""
    out = theta.copy()
    for i in range(len(theta)):
        if np.isfinite(theta[i]):
            out[i] = 0.0
            for j in range(len(theta)):
                out[i] += matrix[i, j] * theta[j] if np.isfinite(theta[j]) else 0.0
    return out


@njit(cache=True)
def widened(matrix: Array, covariance: Array, theta: Array) -> Array:
    """Covariance (n, n) of ``freed`` from that of theta (n,), with the error of the correction; NaN stays NaN."""
    n, moved, out = len(theta), freed(matrix, theta) - theta, covariance.copy()
    known, half = np.empty(n, np.bool_), np.zeros((n, n))
    for i in range(n):
        known[i] = np.isfinite(covariance[i, i]) and np.isfinite(theta[i])
    for i in range(n):
        for j in range(n):
            for k in range(n):
                if known[i] and known[j] and known[k]:
                    half[i, j] += matrix[i, k] * covariance[k, j]
    for i in range(n):
        for j in range(n):
            if known[i] and known[j]:
                total = 0.0
                for k in range(n):
                    total += half[i, k] * matrix[j, k] if known[k] else 0.0
                out[i, j] = total + CORRECTION_ERROR**2 * (moved[i] * moved[j])
    return out


@njit(cache=True)
def follow_vane_noise(shifts: Array, share: float, covariance: Array) -> None:
    """Running mean of S (n, n), in place, from what one sigma of each vane moves the terms by, ``shifts`` (2, n)."""
    n = shifts.shape[1]
    for i in range(n):
        for j in range(n):
            now = shifts[0, i] * shifts[0, j] + shifts[1, i] * shifts[1, j]
            covariance[i, j] += share * (now - covariance[i, j])
