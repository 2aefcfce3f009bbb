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

from aircraft_sysid_ros.aircraft.frames import (
    Matrix,
    Quaternion,
    Vector,
    applied,
    crossing,
    multiplied,
    rotation,
    three,
    transposed,
    turn_by,
    turn_jacobian,
    turned,
)
from aircraft_sysid_ros.estimation.iterated_ekf import symmetrise
from aircraft_sysid_ros.kernels import njit
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
    POSITION,
    VELOCITY,
    Setup,
)

Array = npt.NDArray[np.float64]
Blocks = tuple[Matrix, Matrix, Matrix, Matrix, Matrix, Matrix, Matrix, Matrix]


@njit(cache=True)
def _inputs(x: Array, force: Array, rate: Array) -> tuple[Vector, Vector]:
    """Specific force and angular rate without the biases of the state."""
    return (
        (
            force[0] - x[ACCELEROMETER_BIAS.start],
            force[1] - x[ACCELEROMETER_BIAS.start + 1],
            force[2] - x[ACCELEROMETER_BIAS.start + 2],
        ),
        (rate[0] - x[GYRO_BIAS.start], rate[1] - x[GYRO_BIAS.start + 1], rate[2] - x[GYRO_BIAS.start + 2]),
    )


@njit(cache=True)
def _scaled(a: float, v: Vector) -> Vector:
    return a * v[0], a * v[1], a * v[2]


@njit(cache=True)
def _scaled_matrix(a: float, m: Matrix) -> Matrix:
    return a * m[0], a * m[1], a * m[2], a * m[3], a * m[4], a * m[5], a * m[6], a * m[7], a * m[8]


@njit(cache=True)
def attitude_of(x: Array) -> Quaternion:
    """The quaternion of a state."""
    return x[ATTITUDE.start], x[ATTITUDE.start + 1], x[ATTITUDE.start + 2], x[ATTITUDE.start + 3]


@njit(cache=True)
def propagate_state(x: Array, force: Array, rate: Array, dt: float, gravity: float) -> None:
    """Advance the nominal state x (19,) by dt [s], in place; force and rate (3,) as measured, means over the step."""
    f, omega = _inputs(x, force, rate)
    attitude = attitude_of(x)
    w, i, j, k = turned(attitude, turn_by(_scaled(0.5 * dt, omega)))
    s = applied(rotation(w, i, j, k), f)
    step = dt * s[0], dt * s[1], dt * s[2] + dt * gravity
    w, i, j, k = attitude
    before = applied(rotation(w, i, j, k), three(x[AIR_VELOCITY]))
    through_air = before[0] + step[0], before[1] + step[1], before[2] + step[2]  # NED, at the end, for steady wind
    w, i, j, k = turned(attitude, turn_by(_scaled(dt, omega)))
    norm = np.sqrt(w * w + i * i + j * j + k * k)
    w, i, j, k = w / norm, i / norm, j / norm, k / norm
    u = applied(transposed(rotation(w, i, j, k)), through_air)
    velocity, position, air = VELOCITY.start, POSITION.start, AIR_VELOCITY.start
    for axis in range(3):
        x[position + axis] += dt * (x[velocity + axis] + 0.5 * step[axis])
        x[velocity + axis] += step[axis]
        x[air + axis] = u[axis]
    x[ATTITUDE.start], x[ATTITUDE.start + 1], x[ATTITUDE.start + 2], x[ATTITUDE.start + 3] = w, i, j, k


@njit(cache=True)
def transition_blocks(x: Array, force: Array, rate: Array, dt: float, gravity: float) -> Blocks:
    """Blocks (3, 3) of the transition matrix (3.9) that are neither 0 nor I, at the state before the step.

    Velocity by attitude, accelerometer bias, gyro bias; attitude by attitude, gyro bias; air velocity by
    attitude, accelerometer bias, gyro bias. Air velocity by itself is as attitude by attitude; position is dt
    times the mean of velocity before and after.
    """
    f, omega = _inputs(x, force, rate)
    w, i, j, k = attitude_of(x)
    begin = rotation(w, i, j, k)
    w, i, j, k = turn_by(_scaled(0.5 * dt, omega))
    turn_half = rotation(w, i, j, k)
    half = multiplied(begin, turn_half)
    across = crossing(f)
    tilted = multiplied(half, across)
    w, i, j, k = turn_by(_scaled(-dt, omega))
    back = rotation(w, i, j, k)
    to_end = multiplied(back, turn_half)  # from mid-step to the end
    down = begin[6] * gravity, begin[7] * gravity, begin[8] * gravity  # gravity in body axes, before the step
    pushed, air = applied(turn_half, f), AIR_VELOCITY.start
    moved = (
        x[air] + dt * (pushed[0] + down[0]),
        x[air + 1] + dt * (pushed[1] + down[1]),
        x[air + 2] + dt * (pushed[2] + down[2]),
    )
    by_rate = turn_jacobian(_scaled(dt, omega))
    by_turn = _scaled_matrix(dt, multiplied(crossing(applied(back, moved)), by_rate))
    ug = _scaled_matrix(0.5 * dt * dt, multiplied(to_end, across))
    return (
        _scaled_matrix(-dt, multiplied(tilted, transposed(turn_half))),
        _scaled_matrix(-dt, half),
        _scaled_matrix(0.5 * dt * dt, tilted),
        back,
        _scaled_matrix(-dt, by_rate),
        _scaled_matrix(dt, multiplied(back, crossing(down))),
        _scaled_matrix(-dt, to_end),
        (
            ug[0] - by_turn[0], ug[1] - by_turn[1], ug[2] - by_turn[2],
            ug[3] - by_turn[3], ug[4] - by_turn[4], ug[5] - by_turn[5],
            ug[6] - by_turn[6], ug[7] - by_turn[7], ug[8] - by_turn[8],
        ),
    )  # fmt: skip


@njit(cache=True)
def transition_matrix(x: Array, force: Array, rate: Array, dt: float, gravity: float) -> Array:
    """Whole transition matrix, shape (18, 18), for tests and smoothers."""
    phi = np.eye(ERROR_SIZE)
    blocks = transition_blocks(x, force, rate, dt, gravity)
    for c in range(ERROR_SIZE):
        _apply_transition(phi[:, c], blocks, dt)
    return phi


@njit(inline="always")
def _apply_transition(m: Array, blocks: Blocks, dt: float) -> None:
    """Phi m for m (18,) or longer, in place; the zero and identity blocks are not multiplied."""
    va, vb, vg, aa, ag, ua, ub, ug = blocks
    a = m[D_ATTITUDE], m[D_ATTITUDE + 1], m[D_ATTITUDE + 2]
    b = m[D_ACCELEROMETER_BIAS], m[D_ACCELEROMETER_BIAS + 1], m[D_ACCELEROMETER_BIAS + 2]
    g = m[D_GYRO_BIAS], m[D_GYRO_BIAS + 1], m[D_GYRO_BIAS + 2]
    u = m[D_AIR_VELOCITY], m[D_AIR_VELOCITY + 1], m[D_AIR_VELOCITY + 2]
    v1, v2, v3 = applied(va, a), applied(vb, b), applied(vg, g)
    a1, a2 = applied(aa, a), applied(ag, g)
    u1, u2, u3, u4 = applied(aa, u), applied(ua, a), applied(ub, b), applied(ug, g)
    for i in range(3):
        step = v1[i] + v2[i] + v3[i]
        m[D_POSITION + i] += dt * (m[D_VELOCITY + i] + 0.5 * step)
        m[D_VELOCITY + i] += step
        m[D_ATTITUDE + i] = a1[i] + a2[i]
        m[D_AIR_VELOCITY + i] = u1[i] + u2[i] + u3[i] + u4[i]


@njit(cache=True)
def _add_block(p: Array, row: int, column: int, m: Matrix) -> None:
    """Add a block to p, whose first element stands at (row, column)."""
    for j in range(3):
        p[row, column + j] += m[j]
        p[row + 1, column + j] += m[3 + j]
        p[row + 2, column + j] += m[6 + j]


@njit(cache=True)
def _by_axis(m: Matrix, d: Vector) -> Matrix:
    """Matrix times the diagonal matrix of d."""
    return (
        m[0] * d[0], m[1] * d[1], m[2] * d[2],
        m[3] * d[0], m[4] * d[1], m[5] * d[2],
        m[6] * d[0], m[7] * d[1], m[8] * d[2],
    )  # fmt: skip


@njit(cache=True)
def add_process_noise(p: Array, x: Array, dt: float, density: Array, wind_walk: float, setup: Setup) -> None:
    """Add the covariance of Gamma w over dt [s] (3.11) to p (18, 18), at the state after the step.

    ``density`` (6,) of the white noise of the axes of accelerometer [(m/s^2)^2 s] and gyro [(rad/s)^2 s]. The noise of
    the accelerometer moves both velocities; that of the gyro turns u together with the attitude.
    """
    w, i, j, k = attitude_of(x)
    c, arm = rotation(w, i, j, k), crossing(three(x[AIR_VELOCITY]))
    force = density[0] * dt, density[1] * dt, density[2] * dt
    rate = density[3] * dt, density[4] * dt, density[5] * dt
    for axis in range(3):
        p[D_ATTITUDE + axis, D_ATTITUDE + axis] += rate[axis]
        p[D_ACCELEROMETER_BIAS + axis, D_ACCELEROMETER_BIAS + axis] += setup.accelerometer_walk**2 * dt
        p[D_GYRO_BIAS + axis, D_GYRO_BIAS + axis] += setup.gyro_walk**2 * dt
        p[D_AIR_VELOCITY + axis, D_AIR_VELOCITY + axis] += force[axis] + wind_walk**2 * dt
    moves, turns = _by_axis(c, force), _by_axis(arm, rate)
    _add_block(p, D_VELOCITY, D_VELOCITY, multiplied(moves, transposed(c)))
    _add_block(p, D_AIR_VELOCITY, D_AIR_VELOCITY, multiplied(turns, transposed(arm)))
    _add_block(p, D_VELOCITY, D_AIR_VELOCITY, moves)
    _add_block(p, D_AIR_VELOCITY, D_VELOCITY, transposed(moves))
    _add_block(p, D_AIR_VELOCITY, D_ATTITUDE, turns)
    _add_block(p, D_ATTITUDE, D_AIR_VELOCITY, transposed(turns))


@njit(cache=True)
def propagate(
    x: Array, p: Array, force: Array, rate: Array, dt: float, density: Array, wind_walk: float, setup: Setup
) -> None:
    """State and covariance (3.10), (3.11) by dt [s], in place; ``density`` as in ``add_process_noise``."""
    blocks = transition_blocks(x, force, rate, dt, setup.gravity)
    propagate_state(x, force, rate, dt, setup.gravity)
    n = len(p)
    for c in range(n):
        _apply_transition(p[:, c], blocks, dt)
    for c in range(n):
        _apply_transition(p[c], blocks, dt)
    add_process_noise(p, x, dt, density, wind_walk, setup)
    symmetrise(p)
