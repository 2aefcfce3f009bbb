"""The first step backward over a flight: every state from all measurements, also the later ones.

Rauch-Tung-Striebel smoothing (2.20), (2.22) of docs/references.md on the error of the state: with the filtered state
x(k), its prediction f(x(k)) and the smoothed x(k+1|N),

    x(k|N) = x(k) [+] C_k (x(k+1|N) [-] f(x(k))),   C_k = P(k|k) Phi' P(k+1|k)^-1,

where [+] adds and, for the attitude, turns by a rotation vector in body axes, and [-] is its inverse. The
covariance is carried from the error about one attitude to that about the other as in the filter's own update.
Phi and the process noise are those of each step of the filter, with the random walk of the wind that it used.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import (
    nine,
    quaternion_conjugate,
    quaternion_log,
    quaternion_product,
    right_jacobian,
)
from aircraft_sysid_ros.estimation.iterated_ekf import cholesky, solve_factored
from aircraft_sysid_ros.estimation.smoothing import smoothed_covariance, smoother_gain
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.error_state import jacobian_of, retract, turn_attitude_error
from aircraft_sysid_ros.reconstruction.process import add_process_noise, propagate, transition_matrix
from aircraft_sysid_ros.reconstruction.smoother_history import (
    DENSITY,
    DT,
    FORCE,
    HAS_ROW,
    RATE,
    STATE,
    WIND_WALK,
    SmootherHistory,
    recorded_covariance,
)
from aircraft_sysid_ros.reconstruction.state import ATTITUDE, D_ATTITUDE, ERROR_SIZE, Setup, StateField
from aircraft_sysid_ros.reconstruction.state_row import write_state

Array = npt.NDArray[np.float64]

_STD, _FLOW_STD = StateField.STANDARD_DEVIATIONS, StateField.AIR_VELOCITY_STD
_WIND = StateField.WIND
_WIND_STD = StateField.WIND_STD
_ALPHA, _BETA = StateField.ANGLE_OF_ATTACK, StateField.SIDESLIP
_FORCE, _FORCE_BIAS = StateField.SPECIFIC_FORCE, StateField.ACCELEROMETER_BIAS
_OMEGA, _RATE_BIAS = StateField.ANGULAR_VELOCITY, StateField.GYRO_BIAS


@njit(cache=True)
def difference(x: Array, reference: Array) -> Array:
    """x [-] reference, (18,): the error with ``retract(reference, error)`` = x."""
    error = np.empty(ERROR_SIZE)
    error[:6] = x[:6] - reference[:6]
    between = quaternion_product(quaternion_conjugate(reference[ATTITUDE]), x[ATTITUDE])
    error[D_ATTITUDE : D_ATTITUDE + 3] = quaternion_log(between)
    error[9:] = x[10:] - reference[10:]
    return error


@njit(cache=True)
def smooth_step(step: Array, x: Array, p: Array, setup: Setup) -> tuple[Array, Array]:
    """x(k|N), P(k|N) from a recorded step and x(k+1|N) (19,), P(k+1|N) (18, 18).

    Where the predicted covariance is not positive definite the filtered state stays as it is.
    """
    force, rate, dt = step[FORCE], step[RATE], step[DT]
    density, wind_walk = step[DENSITY], step[WIND_WALK]
    filtered, p_filtered = step[STATE].copy(), recorded_covariance(step)
    predicted, p_predicted = filtered.copy(), p_filtered.copy()
    propagate(predicted, p_predicted, force, rate, dt, density, wind_walk, setup)
    phi = transition_matrix(filtered, force, rate, dt, setup.gravity)
    noise = np.zeros((ERROR_SIZE, ERROR_SIZE))
    add_process_noise(noise, predicted, dt, density, wind_walk, setup)
    gain = smoother_gain(p_filtered, phi, p_predicted)
    if not np.isfinite(np.sum(gain)):
        gain[:] = 0.0
    correction = difference(x, predicted)
    later = p.copy()
    turned = right_jacobian(correction[D_ATTITUDE : D_ATTITUDE + 3])
    back = np.linalg.solve(turned, np.eye(3)).astype(np.float64)
    turn_attitude_error(later, nine(back))  # about the prediction
    change = gain @ correction
    smoothed = smoothed_covariance(p_filtered, phi, gain, noise, later)
    turn_attitude_error(smoothed, jacobian_of(change))  # about x(k|N)
    return retract(filtered, change), smoothed


@njit(cache=True)
def smooth_state(step: Array, x: Array, setup: Setup) -> Array:
    """x(k|N) alone, as ``smooth_step`` has it: one factorisation instead of products of whole matrices."""
    force, rate, dt = step[FORCE], step[RATE], step[DT]
    filtered, p_filtered = step[STATE].copy(), recorded_covariance(step)
    predicted, p_predicted = filtered.copy(), p_filtered.copy()
    propagate(predicted, p_predicted, force, rate, dt, step[DENSITY], step[WIND_WALK], setup)
    weighted = solve_factored(cholesky(p_predicted), difference(x, predicted))
    if not np.isfinite(np.sum(weighted)):
        return filtered
    phi = transition_matrix(filtered, force, rate, dt, setup.gravity)
    return retract(filtered, p_filtered @ (phi.T @ weighted))


@njit(cache=True)
def smooth_segment(
    steps: Array, rows: Array, x: Array, p: Array, setup: Setup, with_covariance: bool
) -> tuple[Array, Array]:
    """Write the smoothed states over the rows (n, StateField.WIDTH) of a segment that ends with x (19,), p (18, 18).

    Returns the smoothed state and its covariance at the beginning. Without the covariance, p stays as it is and the
    standard deviations of the rows stay those of the filter. A segment that ends with numbers that are not
    finite is smoothed from the last finite state; the rows after that stay as the filter left them.
    """
    i, row = len(steps), len(rows)
    while i > 0 and not np.isfinite(np.sum(x) + np.sum(p)):
        i -= 1
        row -= int(steps[i, HAS_ROW])
        x, p = steps[i, STATE].copy(), recorded_covariance(steps[i])
    while i > 0:
        i -= 1
        if steps[i, HAS_ROW] > 0.0:
            row -= 1
            _rewrite(rows[row], x, p, setup, with_covariance)
        if with_covariance:
            x, p = smooth_step(steps[i], x, p, setup)
        else:
            x = smooth_state(steps[i], x, setup)
    return x, p


@njit(cache=True)
def _rewrite(row: Array, x: Array, p: Array, setup: Setup, with_covariance: bool) -> None:
    """The columns of a row that depend on the state; an angle or wind that is not known stays NaN."""
    no_wind = np.isnan(row[_WIND.start])
    alpha, beta, spread, flow_std = row[_ALPHA], row[_BETA], row[_STD].copy(), row[_FLOW_STD]
    write_state(row, x, p, row[_FORCE] + row[_FORCE_BIAS], row[_OMEGA] + row[_RATE_BIAS], setup.imu_position)
    if no_wind:
        row[_WIND] = row[_WIND_STD] = np.nan
    if np.isnan(alpha):
        row[_ALPHA] = np.nan
    if np.isnan(beta):
        row[_BETA] = np.nan
    if not with_covariance:
        row[_STD], row[_FLOW_STD] = spread, flow_std


def smooth(tape: SmootherHistory, with_covariance: bool = True) -> Array:
    """Smooth a recorded flight, each segment between two breaks on its own; returns its rows (n, StateField.WIDTH).

    Without the covariance it is several times faster, and standard deviations are those of the filter. The
    rows lie in the tape and stand in the place of those that the filter wrote.
    """
    for segment, steps, rows in tape.segments():
        if segment.steps:
            smooth_segment(steps, rows, segment.x, segment.p, segment.setup, with_covariance)
    return tape.rows
