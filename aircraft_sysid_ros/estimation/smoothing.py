"""Smoothing: estimates of state and process noise from later measurements too, (2.14)-(2.23) of docs/references.md.

The system is (2.1), (2.2) of ``kalman_filter``. Both steps correct by what the future says about the prediction:

    x(k|N) = x(k|k) + C_k (x(k+1|N) - x(k+1|k)),   C_k = P(k|k) Phi' P(k+1|k)^-1                           (2.20)
    w(k|N) =          B_k (x(k+1|N) - x(k+1|k)),   B_k = Q_d Gamma' P(k+1|k)^-1                            (2.21)

With N = k+1 these are (2.16), (2.17), which are printed with the sign of the bracket reversed: compare (2.14),
(2.15), which are right. The covariances (2.18), (2.19), (2.22), (2.23) are differences; since P(k+1|k) =
Phi P(k|k) Phi' + Gamma Q_d Gamma' they are equal to sums of squares, which rounding cannot make negative:

    P(k|N) = (I - C_k Phi) P(k|k) (I - C_k Phi)' + C_k (P(k+1|N) + Gamma Q_d Gamma') C_k'

and for w the same with B_k, Gamma, Q_d in the place of C_k, Phi, P(k|k).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.iterated_ekf import cholesky, solve_factored, symmetrise
from aircraft_sysid_ros.estimation.kalman_filter import FilterSeries, LinearSystem
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Smoothed:
    """x (n,), P (n, n), w (m,), Q (m, m); with one more axis in front for a series, N states and N - 1 noises."""

    state: Array
    covariance: Array
    noise: Array
    noise_covariance: Array


@njit(cache=True)
def smoother_gain(part: Array, by_part: Array, predicted_covariance: Array) -> Array:
    """C of (2.16) from part = P(k|k), by_part = Phi; B of (2.17) from Q_d, Gamma; shape (rows of part, n).

    NaN if the predicted covariance is not positive definite.
    """
    factor = cholesky(predicted_covariance)
    result = part @ by_part.T
    for i in range(len(result)):
        result[i] = solve_factored(factor, result[i])
    return result


@njit(cache=True)
def smoothed_covariance(part: Array, by_part: Array, gain: Array, rest: Array, next_covariance: Array) -> Array:
    """(2.18), (2.22), and for the noise (2.19), (2.23), as a sum of squares.

    P(k+1|k) = by_part part by_part' + rest; next_covariance is P(k+1|N).
    """
    left = -(gain @ by_part)
    for i in range(len(left)):
        left[i, i] += 1.0
    result = left @ part @ left.T + gain @ (next_covariance + rest) @ gain.T
    symmetrise(result)
    return result


@njit(cache=True)
def _smooth(
    phi: Array, gamma: Array, q: Array, x: Array, p: Array, x_next: Array, p_next: Array
) -> tuple[Array, Array, Array, Array]:
    """(2.20)-(2.23) from the last step backward; matrices (T, ., .), estimates as in FilterSeries."""
    steps, m = len(x), q.shape[2]
    states, covariances = x.copy(), p.copy()
    noises, noise_covariances = np.empty((max(steps - 1, 0), m)), np.empty((max(steps - 1, 0), m, m))
    for k in range(steps - 2, -1, -1):
        phi_k, gamma_k, q_k = phi[min(k, len(phi) - 1)], gamma[min(k, len(gamma) - 1)], q[min(k, len(q) - 1)]
        by_state, by_noise = phi_k @ p[k] @ phi_k.T, gamma_k @ q_k @ gamma_k.T
        correction = states[k + 1] - x_next[k]
        state_gain = smoother_gain(p[k], phi_k, p_next[k])
        noise_gain = smoother_gain(q_k, gamma_k, p_next[k])
        states[k] += state_gain @ correction
        noises[k] = noise_gain @ correction
        covariances[k] = smoothed_covariance(p[k], phi_k, state_gain, by_noise, covariances[k + 1])
        noise_covariances[k] = smoothed_covariance(q_k, gamma_k, noise_gain, by_state, covariances[k + 1])
    return states, covariances, noises, noise_covariances


def smooth_series(system: LinearSystem, filtered: FilterSeries) -> Smoothed:
    """Multistage (Rauch-Tung-Striebel) smoothing (2.20)-(2.23) of what ``filter_series`` gave for the system.

    Raises numpy.linalg.LinAlgError if a predicted covariance is not positive definite, as when a state is known
    exactly and has no process noise: leave such a state out of the system.
    """
    f = filtered
    estimates = (f.state, f.covariance, f.predicted_state, f.predicted_covariance)
    result = Smoothed(*_smooth(system.transition, system.noise_input, system.noise, *estimates))
    if not np.all(np.isfinite(result.covariance)):
        raise np.linalg.LinAlgError("a predicted covariance is not positive definite: the smoother needs its factor")
    return result


def smooth_single_stage(
    system: LinearSystem,
    state: Array,
    covariance: Array,
    predicted: tuple[Array, Array],
    updated: tuple[Array, Array],
) -> Smoothed:
    """x(0|1), P(0|1), w(0|1), Q(0|1) by (2.16)-(2.19), from x(0|0), P(0|0) and the estimates one step on.

    ``predicted`` = x(1|0), P(1|0); ``updated`` = x(1|1), P(1|1). Raises as ``smooth_series``.
    """
    x, p = (np.stack([a, b]) for a, b in zip((state, covariance), updated, strict=True))
    x_next, p_next = (np.stack([a, a]) for a in predicted)
    both = smooth_series(system, FilterSeries(x, p, x_next, p_next))
    return Smoothed(both.state[0], both.covariance[0], both.noise[0], both.noise_covariance[0])


def smooth_single_stage_by_residual(
    system: LinearSystem, state: Array, covariance: Array, residual: Array
) -> tuple[Array, Array]:
    """x(0|1) (2.14) and w(0|1) (2.15) from x(0|0), P(0|0) and the residual y(1) - D u(1) - C x(1|1), (p,).

    Needs no predicted covariance and so also serves states that are known exactly. Uses the matrices of step 0,
    and C and R of step 1.
    """
    c, r = (a[min(1, len(a) - 1)] for a in (system.output, system.measurement_noise))
    information = c.T @ np.linalg.solve(r, residual)
    x = state + covariance @ system.transition[0].T @ information
    return x, system.noise[0] @ system.noise_input[0].T @ information
