"""Propagation (3.10), (3.11) of the reconstructed state with the IMU as input.

    v' = C(q) f + g,  p' = v,  q' = q (x) exp(omega dt),  f = f_m - b_a - w_a,  omega = omega_m - b_g - w_g,

biases and wind random walks. f and omega are the measured specific force (6.4) and rate (6.5), taken at the middle
of the step. White noise of an IMU sample of variance s^2 held over T has the density s^2 T.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from aircraft_sysid_ros.aircraft.frames import (
    cross_matrix,
    quaternion_exp,
    quaternion_product,
    right_jacobian,
    rotation_matrix,
)
from aircraft_sysid_ros.estimation.iterated_ekf import symmetrise
from aircraft_sysid_ros.reconstruction.state import (
    ACCELEROMETER_BIAS,
    ATTITUDE,
    D_ACCELEROMETER_BIAS,
    D_ATTITUDE,
    D_GYRO_BIAS,
    D_POSITION,
    D_VELOCITY,
    D_WIND,
    ERROR_SIZE,
    GYRO_BIAS,
    POSITION,
    VELOCITY,
)


@njit(cache=True)
def propagate_state(x, force, rate, dt, gravity):
    """Advance the nominal state x (19,) by dt [s], in place; force and rate (3,) as measured at mid-step."""
    f = force - x[ACCELEROMETER_BIAS]
    omega = rate - x[GYRO_BIAS]
    attitude = x[ATTITUDE].copy()
    half = rotation_matrix(quaternion_product(attitude, quaternion_exp(0.5 * dt * omega)))
    for i in range(3):
        acceleration = half[i, 0] * f[0] + half[i, 1] * f[1] + half[i, 2] * f[2]
        if i == 2:
            acceleration += gravity
        x[3 + i] += dt * x[i] + 0.5 * dt * dt * acceleration
        x[i] += dt * acceleration
    attitude = quaternion_product(attitude, quaternion_exp(dt * omega))
    x[ATTITUDE] = attitude / np.sqrt(np.sum(attitude * attitude))


@njit(cache=True)
def transition_blocks(x, force, rate, dt):
    """Blocks of the transition matrix (3.9) that are neither 0 nor I, each (3, 3).

    velocity by attitude, accelerometer bias, gyro bias; position by the same three; attitude by attitude and by
    gyro bias. Position by velocity is dt I.
    """
    f = force - x[ACCELEROMETER_BIAS]
    omega = rate - x[GYRO_BIAS]
    half = rotation_matrix(quaternion_product(x[ATTITUDE], quaternion_exp(0.5 * dt * omega)))
    turned = half @ cross_matrix(f)
    turn = rotation_matrix(quaternion_exp(-dt * omega))
    jacobian = right_jacobian(dt * omega)
    back = rotation_matrix(quaternion_exp(-0.5 * dt * omega))  # error at the start seen at mid-step
    return (
        -dt * (turned @ back),
        -dt * half,
        0.5 * dt * dt * turned,
        -0.5 * dt * dt * (turned @ back),
        -0.5 * dt * dt * half,
        dt**3 / 6.0 * turned,
        turn,
        -dt * jacobian,
    )


@njit(cache=True)
def transition_matrix(x, force, rate, dt):
    """Whole transition matrix, shape (18, 18), for tests and smoothers."""
    va, vb, vg, pa, pb, pg, aa, ag = transition_blocks(x, force, rate, dt)
    phi = np.eye(ERROR_SIZE)
    for i in range(3):
        phi[D_POSITION + i, D_VELOCITY + i] = dt
        for j in range(3):
            phi[D_VELOCITY + i, D_ATTITUDE + j] = va[i, j]
            phi[D_VELOCITY + i, D_ACCELEROMETER_BIAS + j] = vb[i, j]
            phi[D_VELOCITY + i, D_GYRO_BIAS + j] = vg[i, j]
            phi[D_POSITION + i, D_ATTITUDE + j] = pa[i, j]
            phi[D_POSITION + i, D_ACCELEROMETER_BIAS + j] = pb[i, j]
            phi[D_POSITION + i, D_GYRO_BIAS + j] = pg[i, j]
            phi[D_ATTITUDE + i, D_ATTITUDE + j] = aa[i, j]
            phi[D_ATTITUDE + i, D_GYRO_BIAS + j] = ag[i, j]
    return phi


@njit(cache=True)
def _apply_transition(m, blocks, dt):
    """Phi m for m (18, n), in place; the zero and identity blocks are not multiplied."""
    va, vb, vg, pa, pb, pg, aa, ag = blocks
    for c in range(m.shape[1]):
        a0, a1, a2 = m[6, c], m[7, c], m[8, c]
        b0, b1, b2 = m[9, c], m[10, c], m[11, c]
        g0, g1, g2 = m[12, c], m[13, c], m[14, c]
        for i in range(3):
            m[D_POSITION + i, c] += (
                dt * m[D_VELOCITY + i, c]
                + (pa[i, 0] * a0 + pa[i, 1] * a1 + pa[i, 2] * a2)
                + (pb[i, 0] * b0 + pb[i, 1] * b1 + pb[i, 2] * b2)
                + (pg[i, 0] * g0 + pg[i, 1] * g1 + pg[i, 2] * g2)
            )
            m[D_VELOCITY + i, c] += (
                (va[i, 0] * a0 + va[i, 1] * a1 + va[i, 2] * a2)
                + (vb[i, 0] * b0 + vb[i, 1] * b1 + vb[i, 2] * b2)
                + (vg[i, 0] * g0 + vg[i, 1] * g1 + vg[i, 2] * g2)
            )
            m[D_ATTITUDE + i, c] = (aa[i, 0] * a0 + aa[i, 1] * a1 + aa[i, 2] * a2) + (
                ag[i, 0] * g0 + ag[i, 1] * g1 + ag[i, 2] * g2
            )


@njit(cache=True)
def propagate(x, p, force, rate, dt, sample_time, setup):
    """State and covariance (3.10), (3.11) by dt [s], in place; sample_time is the interval between IMU samples."""
    blocks = transition_blocks(x, force, rate, dt)
    propagate_state(x, force, rate, dt, setup.gravity)
    _apply_transition(p, blocks, dt)
    transposed = p.T.copy()
    _apply_transition(transposed, blocks, dt)
    p[:] = transposed
    velocity = setup.accelerometer_variance * sample_time * dt
    attitude = setup.gyro_variance * sample_time * dt
    for i in range(3):
        p[D_VELOCITY + i, D_VELOCITY + i] += velocity
        p[D_ATTITUDE + i, D_ATTITUDE + i] += attitude
        p[D_ACCELEROMETER_BIAS + i, D_ACCELEROMETER_BIAS + i] += setup.accelerometer_walk**2 * dt
        p[D_GYRO_BIAS + i, D_GYRO_BIAS + i] += setup.gyro_walk**2 * dt
        p[D_WIND + i, D_WIND + i] += setup.wind_walk**2 * dt
    symmetrise(p)
