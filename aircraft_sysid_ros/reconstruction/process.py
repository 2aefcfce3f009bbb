"""Propagation (3.10), (3.11) of the reconstructed state with the IMU as input.

    v' = C(q) f + g,  p' = v,  q' = q (x) exp(omega dt),  u' = f + C(q)' g - omega x u  (6.16)-(6.18),

with the velocity over ground v, the air-relative velocity u in body axes, f = f_m - b_a - w_a, omega =
omega_m - b_g - w_g. Biases are random walks; a random walk of the wind enters u. f and omega are the mean measured
specific force (6.4) and rate (6.5) of the step. White noise of an IMU sample of variance s^2, held over T, has the
density s^2 T.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft.frames import (
    cross_matrix,
    product,
    quaternion_exp,
    quaternion_product,
    right_jacobian,
    rotation_matrix,
    times,
)
from aircraft_sysid_ros.estimation.iterated_ekf import symmetrise
from aircraft_sysid_ros.reconstruction.state import (
    ACCELEROMETER_BIAS,
    AIR_VELOCITY,
    ATTITUDE,
    D_ACCELEROMETER_BIAS,
    D_AIR_VELOCITY,
    D_ATTITUDE,
    D_GYRO_BIAS,
    D_POSITION,
    D_VELOCITY,
    ERROR_SIZE,
    GYRO_BIAS,
    Setup,
)

Array = npt.NDArray[np.float64]


@njit(cache=True)
def propagate_state(x: Array, force: Array, rate: Array, dt: float, gravity: float) -> None:
    """Advance the nominal state x (19,) by dt [s], in place; force and rate (3,) as measured, means over the step."""
    f = force - x[ACCELEROMETER_BIAS]
    omega = rate - x[GYRO_BIAS]
    attitude = x[ATTITUDE].copy()
    begin = rotation_matrix(attitude)
    half = rotation_matrix(quaternion_product(attitude, quaternion_exp(0.5 * dt * omega)))
    attitude = quaternion_product(attitude, quaternion_exp(dt * omega))
    attitude /= np.sqrt(np.sum(attitude * attitude))
    end = rotation_matrix(attitude)
    through_air = np.empty(3)  # NED, at the end, for steady wind
    for i in range(3):
        step = dt * (half[i, 0] * f[0] + half[i, 1] * f[1] + half[i, 2] * f[2])
        if i == 2:
            step += dt * gravity
        through_air[i] = begin[i, 0] * x[16] + begin[i, 1] * x[17] + begin[i, 2] * x[18] + step
        x[3 + i] += dt * (x[i] + 0.5 * step)
        x[i] += step
    for i in range(3):
        x[16 + i] = end[0, i] * through_air[0] + end[1, i] * through_air[1] + end[2, i] * through_air[2]
    x[ATTITUDE] = attitude


@njit(cache=True)
def transition_blocks(x: Array, force: Array, rate: Array, dt: float, gravity: float) -> tuple[Array, ...]:
    """Blocks (3, 3) of the transition matrix (3.9) that are neither 0 nor I, at the state before the step.

    Velocity by attitude, accelerometer bias, gyro bias; attitude by attitude, gyro bias; air velocity by
    attitude, accelerometer bias, gyro bias. Air velocity by itself is as attitude by attitude; position is dt
    times the mean of velocity before and after.
    """
    f, omega = force - x[ACCELEROMETER_BIAS], rate - x[GYRO_BIAS]
    begin = rotation_matrix(x[ATTITUDE])
    turn_half = rotation_matrix(quaternion_exp(0.5 * dt * omega))
    half = product(begin, turn_half)
    across = cross_matrix(f)
    turned = product(half, across)
    back = rotation_matrix(quaternion_exp(-dt * omega))
    to_end = product(back, turn_half)  # from mid-step to the end
    down = begin[2] * gravity  # gravity in body axes, before the step
    moved = times(turn_half, f)
    for i in range(3):
        moved[i] = x[AIR_VELOCITY.start + i] + dt * (moved[i] + down[i])
    by_rate = right_jacobian(dt * omega)
    va, vg = product(turned, turn_half.T), turned
    ua, ug = product(back, cross_matrix(down)), product(to_end, across)
    by_turn = product(cross_matrix(times(back, moved)), by_rate)
    for i in range(3):
        for j in range(3):
            va[i, j] *= -dt
            half[i, j] *= -dt
            vg[i, j] *= 0.5 * dt * dt
            by_rate[i, j] *= -dt
            ua[i, j] *= dt
            to_end[i, j] *= -dt
            ug[i, j] = 0.5 * dt * dt * ug[i, j] - dt * by_turn[i, j]
    return va, half, vg, back, by_rate, ua, to_end, ug


@njit(cache=True)
def transition_matrix(x: Array, force: Array, rate: Array, dt: float, gravity: float) -> Array:
    """Whole transition matrix, shape (18, 18), for tests and smoothers."""
    phi = np.eye(ERROR_SIZE)
    _apply_transition(phi, transition_blocks(x, force, rate, dt, gravity), dt)
    return phi


@njit(cache=True)
def _row(block: Array, i: int, a0: float, a1: float, a2: float) -> float:
    return block[i, 0] * a0 + block[i, 1] * a1 + block[i, 2] * a2


@njit(cache=True)
def _apply_transition(m: Array, blocks: tuple[Array, ...], dt: float) -> None:
    """Phi m for m (18, n), in place; the zero and identity blocks are not multiplied."""
    va, vb, vg, aa, ag, ua, ub, ug = blocks
    for c in range(m.shape[1]):
        a0, a1, a2 = m[D_ATTITUDE, c], m[D_ATTITUDE + 1, c], m[D_ATTITUDE + 2, c]
        b0, b1 = m[D_ACCELEROMETER_BIAS, c], m[D_ACCELEROMETER_BIAS + 1, c]
        b2 = m[D_ACCELEROMETER_BIAS + 2, c]
        g0, g1, g2 = m[D_GYRO_BIAS, c], m[D_GYRO_BIAS + 1, c], m[D_GYRO_BIAS + 2, c]
        u0, u1, u2 = m[D_AIR_VELOCITY, c], m[D_AIR_VELOCITY + 1, c], m[D_AIR_VELOCITY + 2, c]
        for i in range(3):
            step = _row(va, i, a0, a1, a2) + _row(vb, i, b0, b1, b2) + _row(vg, i, g0, g1, g2)
            m[D_POSITION + i, c] += dt * (m[D_VELOCITY + i, c] + 0.5 * step)
            m[D_VELOCITY + i, c] += step
            m[D_ATTITUDE + i, c] = _row(aa, i, a0, a1, a2) + _row(ag, i, g0, g1, g2)
            m[D_AIR_VELOCITY + i, c] = (
                _row(aa, i, u0, u1, u2) + _row(ua, i, a0, a1, a2) + _row(ub, i, b0, b1, b2) + _row(ug, i, g0, g1, g2)
            )


@njit(cache=True)
def add_process_noise(p: Array, x: Array, dt: float, density: Array, wind_walk: float, setup: Setup) -> None:
    """Add the covariance of Gamma w over dt [s] (3.11) to p (18, 18), at the state after the step.

    ``density`` (2,) of the white noise of accelerometer [(m/s^2)^2 s] and gyro [(rad/s)^2 s]. The noise of the
    accelerometer moves both velocities; that of the gyro turns u together with the attitude.
    """
    c = rotation_matrix(x[ATTITUDE])
    arm = cross_matrix(x[AIR_VELOCITY])
    force, rate = density[0] * dt, density[1] * dt
    by_rate = product(arm, arm.T)
    for i in range(3):
        p[D_VELOCITY + i, D_VELOCITY + i] += force
        p[D_ATTITUDE + i, D_ATTITUDE + i] += rate
        p[D_ACCELEROMETER_BIAS + i, D_ACCELEROMETER_BIAS + i] += setup.accelerometer_walk**2 * dt
        p[D_GYRO_BIAS + i, D_GYRO_BIAS + i] += setup.gyro_walk**2 * dt
        p[D_AIR_VELOCITY + i, D_AIR_VELOCITY + i] += force + wind_walk**2 * dt
        for j in range(3):
            p[D_AIR_VELOCITY + i, D_AIR_VELOCITY + j] += rate * by_rate[i, j]
            p[D_VELOCITY + i, D_AIR_VELOCITY + j] += force * c[i, j]
            p[D_AIR_VELOCITY + j, D_VELOCITY + i] += force * c[i, j]
            p[D_AIR_VELOCITY + i, D_ATTITUDE + j] += rate * arm[i, j]
            p[D_ATTITUDE + j, D_AIR_VELOCITY + i] += rate * arm[i, j]


@njit(cache=True)
def propagate(
    x: Array, p: Array, force: Array, rate: Array, dt: float, density: Array, wind_walk: float, setup: Setup
) -> None:
    """State and covariance (3.10), (3.11) by dt [s], in place; ``density`` as in ``add_process_noise``."""
    blocks = transition_blocks(x, force, rate, dt, setup.gravity)
    propagate_state(x, force, rate, dt, setup.gravity)
    _apply_transition(p, blocks, dt)
    transposed = p.T.copy()
    _apply_transition(transposed, blocks, dt)
    p[:] = transposed
    add_process_noise(p, x, dt, density, wind_walk, setup)
    symmetrise(p)
