"""Motion that follows from the IMU alone, (B5) of the two-stage paper (docs/references.md), and its errors.

The air-relative velocity v is integrated in NED, where (B5) is dv/dt = C (f - b_a) + g, and the attitude C as a
quaternion, which unlike the Euler angles of (B5) is regular at theta = 90 deg. With a small rotation e of the attitude
in NED, C -> exp([e x]) C, errors of the start (v0, e0) and of the biases move both to first order by

    e = e0 - G db_g,   dv = dv0 - F e0 + K db_g - G db_a,
    G = int C dt,   F = int [C(f - b_a) x] dt,   K = int [C(f - b_a) x] G dt.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import quaternion_exp, quaternion_product, rotation_matrix
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Outputs in the order of (B4c), and numbers of a start: velocity and attitude.
OUTPUTS, START = 6, 6


@njit(cache=True, nogil=True)
def integrated_outputs(
    time: Array, force: Array, rate: Array, piece: Integers, bins: Integers, weights: Array, count: int,
    velocity0: Array, attitude0: Array, biases: Array, arm: Array, gravity: float, measured: Array, with_slopes: bool,
) -> tuple[Array, Array]:  # fmt: skip
    """Means in each bin of V, alpha, beta at the probe, roll, pitch, yaw (count, 6), and their derivatives.

    IMU as measured at times (k,) [s], force and rate (k, 3); piece (k,): a new number begins from the next row of
    velocity0 (pieces, 3) [m/s] NED and attitude0 (pieces, 4); bins (k,), and with which weights (k, 6) the outputs
    then count in them; biases (6,), measured minus true, of accelerometers and gyros; arm (3,) [m] of the probe;
    measured (count, 6): roll and yaw are within pi of what it has of them. Derivatives (count, 6, 12) by dv0, e0, b_a,
    b_g, three each, or (0, 6, 12). All is 0 in a bin without weight.
    """
    outputs, total, now = np.zeros((count, OUTPUTS)), np.zeros((count, OUTPUTS)), np.empty(OUTPUTS)
    slopes = np.zeros((count if with_slopes else 0, OUTPUTS, 12))
    g, f, k = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    velocity, attitude, turn, acceleration = np.zeros(3), np.zeros(4), np.zeros(3), np.zeros(3)
    omega, flow = np.zeros(3), np.zeros(3)
    for i in range(len(time)):
        b = bins[i]
        if i == 0 or piece[i] != piece[i - 1]:
            velocity[:], attitude[:] = velocity0[piece[i]], attitude0[piece[i]]
            g[:], f[:], k[:] = 0.0, 0.0, 0.0
        else:
            step = time[i] - time[i - 1]
            middle = _step(velocity, attitude, rate[i - 1], rate[i], force[i - 1], force[i], biases, step, gravity,
                           turn, acceleration)  # fmt: skip
            if with_slopes:
                _extend(g, f, k, middle, acceleration, step)
        for j in range(3):
            omega[j] = rate[i, j] - biases[3 + j]
        c = rotation_matrix(attitude)
        _cross(omega, arm, flow)
        for j in range(3):
            flow[j] += c[0, j] * velocity[0] + c[1, j] * velocity[1] + c[2, j] * velocity[2]
        ahead = np.sqrt(flow[0] ** 2 + flow[2] ** 2)
        now[0] = np.sqrt(ahead**2 + flow[1] ** 2)
        now[1] = np.arctan2(flow[2], flow[0])
        now[2] = np.arctan2(flow[1], ahead)
        now[3] = _near(np.arctan2(c[2, 1], c[2, 2]), measured[b, 3])
        now[4] = -np.arcsin(min(max(c[2, 0], -1.0), 1.0))
        now[5] = _near(np.arctan2(c[1, 0], c[0, 0]), measured[b, 5])
        for j in range(OUTPUTS):
            outputs[b, j] += weights[i, j] * now[j]
            total[b, j] += weights[i, j]
        if with_slopes:
            _add_slopes(slopes[b], weights[i], velocity, c, flow, arm, g, f, k)
    for b in range(count):
        for j in range(OUTPUTS):
            scale = 1.0 / total[b, j] if total[b, j] > 0.0 else 0.0
            outputs[b, j] *= scale
            if with_slopes:
                slopes[b, j] *= scale
    return outputs, slopes


@njit(cache=True, nogil=True)
def _near(angle: float, other: float) -> float:
    """The angle, whole turns apart, that is within pi of the other one."""
    return other + (angle - other + np.pi) % (2.0 * np.pi) - np.pi


@njit(cache=True, nogil=True)
def _step(
    velocity: Array, attitude: Array, rate0: Array, rate1: Array, force0: Array, force1: Array, biases: Array,
    step: float, gravity: float, turn: Array, acceleration: Array,
) -> Array:  # fmt: skip
    """One step of velocity (3,) and attitude (4,), in place; ``acceleration`` (3,) becomes C (f - b_a).

    Rate and force are linear between samples: coning and sculling are what both change while the axes turn. Returns
    C (3, 3) in the middle of the step.
    """
    body, moved = np.empty(3), np.empty(3)
    for j in range(3):
        turn[j] = (0.5 * (rate0[j] + rate1[j]) - biases[3 + j]) * step
        moved[j] = (force1[j] - force0[j]) / 12.0
    _cross(turn, moved, body)
    for j in range(3):
        body[j] += 0.5 * (force0[j] + force1[j]) - biases[j]
    middle = rotation_matrix(quaternion_product(attitude, quaternion_exp(0.5 * turn)))
    for j in range(3):
        acceleration[j] = middle[j, 0] * body[0] + middle[j, 1] * body[1] + middle[j, 2] * body[2]
        velocity[j] += step * acceleration[j]
    velocity[2] += step * gravity
    _cross(rate0 - biases[3:], rate1 - biases[3:], moved)
    for j in range(3):
        turn[j] += step * step / 12.0 * moved[j]
    attitude[:] = quaternion_product(attitude, quaternion_exp(turn))
    return middle


@njit(cache=True, nogil=True)
def _extend(g: Array, f: Array, k: Array, middle: Array, acceleration: Array, step: float) -> None:
    """G, F and K (3, 3) one step [s] further, in place."""
    for j in range(3):
        column = np.empty(3)
        for i in range(3):
            column[i] = g[i, j] + 0.5 * step * middle[i, j]
        k[0, j] += step * (acceleration[1] * column[2] - acceleration[2] * column[1])
        k[1, j] += step * (acceleration[2] * column[0] - acceleration[0] * column[2])
        k[2, j] += step * (acceleration[0] * column[1] - acceleration[1] * column[0])
        for i in range(3):
            g[i, j] += step * middle[i, j]
    f[0, 1] -= step * acceleration[2]
    f[0, 2] += step * acceleration[1]
    f[1, 0] += step * acceleration[2]
    f[1, 2] -= step * acceleration[0]
    f[2, 0] -= step * acceleration[1]
    f[2, 1] += step * acceleration[0]


@njit(cache=True, nogil=True)
def _add_slopes(
    slope: Array, weight: Array, velocity: Array, c: Array, flow: Array, arm: Array, g: Array, f: Array, k: Array
) -> None:
    """Add derivatives (6, 12) at one instant by weights (6,): du = C'(dv + v x e) + r x db_g, and Euler angles by e."""
    ahead2 = flow[0] ** 2 + flow[2] ** 2
    ahead, speed2 = np.sqrt(ahead2), ahead2 + flow[1] ** 2
    row, by_v, by_e, by_arm = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(6):
        if i < 3:
            if i == 0:
                row[0], row[1], row[2] = flow[0], flow[1], flow[2]
                row /= np.sqrt(speed2)
            elif i == 1:
                row[0], row[1], row[2] = -flow[2] / ahead2, 0.0, flow[0] / ahead2
            else:
                row[0], row[1] = -flow[0] * flow[1] / (speed2 * ahead), ahead / speed2
                row[2] = -flow[2] * flow[1] / (speed2 * ahead)
            for j in range(3):
                by_v[j] = row[0] * c[j, 0] + row[1] * c[j, 1] + row[2] * c[j, 2]
            _cross(by_v, velocity, by_e)  # by_v' [v x] e
            _cross(row, arm, by_arm)
        else:
            by_v[:], by_arm[:] = 0.0, 0.0
            _euler_row(i - 3, c, by_e)
        for j in range(3):
            of_f = by_v[0] * f[0, j] + by_v[1] * f[1, j] + by_v[2] * f[2, j]
            of_k = by_v[0] * k[0, j] + by_v[1] * k[1, j] + by_v[2] * k[2, j]
            by_v_of_g = by_v[0] * g[0, j] + by_v[1] * g[1, j] + by_v[2] * g[2, j]
            by_e_of_g = by_e[0] * g[0, j] + by_e[1] * g[1, j] + by_e[2] * g[2, j]
            slope[i, j] += weight[i] * by_v[j]
            slope[i, 3 + j] += weight[i] * (by_e[j] - of_f)
            slope[i, 6 + j] -= weight[i] * by_v_of_g
            slope[i, 9 + j] += weight[i] * (of_k - by_e_of_g + by_arm[j])


@njit(cache=True, nogil=True)
def _euler_row(angle: int, c: Array, row: Array) -> None:
    """Derivative (3,) of roll, pitch or yaw by a small rotation in NED; at theta = 90 deg large, not infinite."""
    level2 = max(c[0, 0] ** 2 + c[1, 0] ** 2, 1e-12)
    if angle == 0:
        row[0], row[1], row[2] = c[0, 0] / level2, c[1, 0] / level2, 0.0
    elif angle == 1:
        level = np.sqrt(level2)
        row[0], row[1], row[2] = -c[1, 0] / level, c[0, 0] / level, 0.0
    else:
        row[0], row[1], row[2] = -c[2, 0] * c[0, 0] / level2, -c[2, 0] * c[1, 0] / level2, 1.0


@njit(cache=True, nogil=True)
def _cross(a: Array, b: Array, out: Array) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
