"""How recursive maximum likelihood begins: equation error on the states of the first step, then its handing over."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.iterated_ekf import cholesky
from aircraft_sysid_ros.estimation.recursive_maximum_likelihood import learn_rows
from aircraft_sysid_ros.identification.coefficients.evaluation import measured_coefficients
from aircraft_sysid_ros.identification.coefficients.layout import QBAR, TERM, Body
from aircraft_sysid_ros.identification.estimators.likelihood_state import Recursion
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import D_ACCELEROMETER_BIAS, StateField

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: One sigma of the measured coefficients of forces and moments in the start: generous, it is only a start.
_START_NOISE = np.array([0.02, 0.02, 0.02, 0.005, 0.01, 0.005])
#: A coefficient is known well enough to begin with at this share of its range, or at this standard error.
_KNOWN_SHARE, _KNOWN_STD = 0.05, 0.3
#: Standard errors of the start are taken so many times larger.
_START_WIDENING = 5.0
#: The states of the first step are believed this many times less than it says: other filter, other errors.
START_DOUBT = 2.0
_BIAS = StateField.ACCELEROMETER_BIAS.start  # those of the gyros follow
_BIAS_STD = StateField.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS


@njit(cache=True, error_model="numpy")
def learn_start(time: float, history: Array, body: Body, offsets: Integers, recursion: Recursion) -> None:
    """Least squares of the measured coefficients at the knot before, rates differentiated over two steps."""
    before, times = recursion.before, recursion.before_time
    span = time - times[0]
    if np.isfinite(span):
        slopes, measured = (history - before[0]) / span, np.empty(6)
        measured_coefficients(before[1], slopes, body, measured)
        q = len(recursion.free)
        row, residual = np.zeros((1, q)), np.empty(1)
        free_theta, bound = recursion.theta[recursion.free], np.full(q, np.inf)
        for axis in range(6):
            row[:] = 0.0
            residual[0] = measured[axis] / _START_NOISE[axis]
            for j in range(offsets[axis], offsets[axis + 1]):
                row[0, j] = -before[1, TERM + j] / before[1, QBAR] / _START_NOISE[axis]
                residual[0] += row[0, j] * free_theta[j]
            learn_rows(free_theta, recursion.root, row, residual, 1.0, bound)
        set_theta(free_theta, recursion)
    before[0], before[1] = before[1], history
    times[0], times[1] = times[1], time


@njit(cache=True, error_model="numpy")
def all_known(count: int, recursion: Recursion) -> bool:
    """All coefficients have moved enough to begin with: filters that know little may settle far from the truth."""
    for i in range(count):
        variance = 0.0
        for j in range(count):
            variance += recursion.root[i, j] ** 2
        if np.sqrt(variance) > max(_KNOWN_SHARE * recursion.start_root[i, i], _KNOWN_STD):
            return False
    return True


@njit(cache=True, error_model="numpy")
def set_theta(free_theta: Array, recursion: Recursion) -> None:
    """Take new values of the free parameters (q,), within their bounds, into all filters."""
    for i in range(len(recursion.free)):
        value = min(max(free_theta[i], recursion.low[i]), recursion.high[i])
        if np.isfinite(value):
            recursion.theta[recursion.free[i]] = value
    recursion.thetas[:] = recursion.theta
    for i in range(len(recursion.free)):
        recursion.thetas[1 + i, recursion.free[i]] += recursion.moves[i]


@njit(cache=True, error_model="numpy")
def take_start(row: Array, offsets: Integers, recursion: Recursion) -> None:
    """From the start to the recursion: biases of the first step, coefficients with a wider covariance.

    Equation error is biased by noise in its terms and by biases that the first step was still finding; what it
    says is a place to begin, not data.
    """
    first, root = offsets[6], recursion.root
    free_theta = recursion.theta[recursion.free]
    p = _START_WIDENING**2 * (root @ root.T)
    for i in range(6):
        free_theta[first + i] = row[_BIAS + i]
        p[first + i, :], p[:, first + i] = 0.0, 0.0
        p[first + i, first + i] = (START_DOUBT * row[_BIAS_STD + i]) ** 2
    for i in range(first):
        p[i, i] += recursion.start_doubt[i] ** 2
    root[:] = cholesky(p)
    set_theta(free_theta, recursion)
