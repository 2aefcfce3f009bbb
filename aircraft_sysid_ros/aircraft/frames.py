"""Rotations between body axes (FRD) and the local level world (NED).

A quaternion is ``(w, x, y, z)`` and turns body vectors into NED vectors, ``v_n = C(q) v_b``, C of (6.23) in
docs/references.md. It is regular at theta = +-90 deg; Euler angles are only for people and are derived from it.
Small attitude errors are rotation vectors in body axes: ``C = C_hat exp([delta x])``.

Each formula stands once, on plain numbers: a vector is a tuple of three, a matrix one of nine, row by row. Compiled
loops use those, since they need no memory; the functions of arrays are made of them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

Vector = tuple[float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]
Quaternion = tuple[float, float, float, float]

SMALL_ANGLE = 1e-5


# -- on plain numbers -------------------------------------------------------------------------------------------------


@njit(cache=True)
def three(v: Array) -> Vector:
    """The numbers of a vector (3,)."""
    return v[0], v[1], v[2]


@njit(cache=True)
def nine(m: Array) -> Matrix:
    """The numbers of a matrix (3, 3)."""
    return m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2], m[2, 0], m[2, 1], m[2, 2]


@njit(cache=True)
def put_matrix(m: Matrix, out: Array) -> None:
    """Write a matrix into an array (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = m[0], m[1], m[2]
    out[1, 0], out[1, 1], out[1, 2] = m[3], m[4], m[5]
    out[2, 0], out[2, 1], out[2, 2] = m[6], m[7], m[8]


@njit(cache=True)
def crossing(v: Vector) -> Matrix:
    """[v x] with ``[v x] w = v x w``."""
    return 0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0


@njit(cache=True)
def transposed(a: Matrix) -> Matrix:
    """A'."""
    return a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]


@njit(cache=True)
def multiplied(a: Matrix, b: Matrix) -> Matrix:
    """A B."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@njit(cache=True)
def applied(a: Matrix, v: Vector) -> Vector:
    """A v."""
    return (
        a[0] * v[0] + a[1] * v[1] + a[2] * v[2],
        a[3] * v[0] + a[4] * v[1] + a[5] * v[2],
        a[6] * v[0] + a[7] * v[1] + a[8] * v[2],
    )


@njit(cache=True)
def rotation(w: float, x: float, y: float, z: float) -> Matrix:
    """C of a quaternion: body to NED, L_EB of (6.23)."""
    return (
        w * w + x * x - y * y - z * z,
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        w * w - x * x + y * y - z * z,
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        w * w - x * x - y * y + z * z,
    )


@njit(cache=True)
def turned(a: Quaternion, b: Quaternion) -> Quaternion:
    """a (x) b: first turn by b, then by a."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@njit(cache=True)
def turn_by(v: Vector) -> Quaternion:
    """Unit quaternion of the rotation vector v [rad], regular at v = 0."""
    angle = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if angle < SMALL_ANGLE:  # sin(a/2)/a by its series, exact to double precision below the limit
        s = 0.5 - angle * angle / 48.0
    else:
        s = np.sin(0.5 * angle) / angle
    return np.cos(0.5 * angle), s * v[0], s * v[1], s * v[2]


@njit(cache=True)
def turn_jacobian(v: Vector) -> Matrix:
    """J with exp(v + d) = exp(v) exp(J d) to first order: I - a [v x] + b [v x]^2, and [v x]^2 = v v' - v'v I."""
    x, y, z = v
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-8:
        a, b = 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = np.sqrt(angle2)
        a, b = (1.0 - np.cos(angle)) / angle2, (angle - np.sin(angle)) / (angle2 * angle)
    return (
        1.0 - b * (y * y + z * z), a * z + b * x * y, b * x * z - a * y,
        b * x * y - a * z, 1.0 - b * (x * x + z * z), a * x + b * y * z,
        a * y + b * x * z, b * y * z - a * x, 1.0 - b * (x * x + y * y),
    )  # fmt: skip


# -- on arrays --------------------------------------------------------------------------------------------------------


@njit(cache=True)
def cross_matrix(v: Array) -> Array:
    """Matrix [v x] of shape (3, 3) with ``[v x] w = v x w``."""
    m = np.empty((3, 3))
    put_matrix(crossing(three(v)), m)
    return m


@njit(cache=True)
def product(a: Array, b: Array) -> Array:
    """Matrix product of two (3, 3): for so small a matrix a call of BLAS costs more than the work."""
    c = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            c[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return c


@njit(cache=True)
def times(a: Array, v: Array) -> Array:
    """Matrix (3, 3) times vector (3,), without BLAS for the same reason."""
    out = np.empty(3)
    for i in range(3):
        out[i] = a[i, 0] * v[0] + a[i, 1] * v[1] + a[i, 2] * v[2]
    return out


@njit(cache=True)
def rotation_matrix(q: Array) -> Array:
    """C(q), shape (3, 3): body to NED, L_EB of (6.23)."""
    c = np.empty((3, 3))
    put_matrix(rotation(q[0], q[1], q[2], q[3]), c)
    return c


@njit(cache=True)
def rotation_matrices(quaternions: Array) -> Array:
    """``rotation_matrix`` of each of n quaternions (n, 4): (n, 3, 3)."""
    out = np.empty((len(quaternions), 3, 3))
    for i in range(len(quaternions)):
        out[i] = rotation_matrix(quaternions[i])
    return out


def continuous(quaternions: Array) -> Array:
    """The same attitudes (n, 4) without changes of sign between neighbours, fit for interpolation."""
    steps = np.sum(quaternions[1:] * quaternions[:-1], axis=1)
    signs = np.cumprod(np.concatenate([[1.0], np.where(steps < 0.0, -1.0, 1.0)]))
    result: Array = quaternions * signs[:, None]
    return result


@njit(cache=True)
def quaternion_product(a: Array, b: Array) -> Array:
    """a (x) b, (4,): first turn by b, then by a."""
    p = np.empty(4)
    p[0], p[1], p[2], p[3] = turned((a[0], a[1], a[2], a[3]), (b[0], b[1], b[2], b[3]))
    return p


@njit(cache=True)
def quaternion_conjugate(q: Array) -> Array:
    """The inverse turn of a unit quaternion."""
    return np.array([q[0], -q[1], -q[2], -q[3]])


@njit(cache=True)
def quaternion_exp(v: Array) -> Array:
    """Unit quaternion (4,) of the rotation vector v (3,) [rad], regular at v = 0."""
    q = np.empty(4)
    q[0], q[1], q[2], q[3] = turn_by(three(v))
    return q


@njit(cache=True)
def quaternion_log(q: Array) -> Array:
    """Rotation vector [rad] of a unit quaternion, length at most pi."""
    sign = 1.0 if q[0] >= 0.0 else -1.0
    n = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if n < 0.5 * SMALL_ANGLE:
        k = 2.0 * sign
    else:
        k = 2.0 * np.arctan2(n, sign * q[0]) / n * sign
    return np.array([k * q[1], k * q[2], k * q[3]])


@njit(cache=True)
def right_jacobian(v: Array) -> Array:
    """J with exp(v + d) = exp(v) exp(J d) to first order, shape (3, 3)."""
    j = np.empty((3, 3))
    put_matrix(turn_jacobian(three(v)), j)
    return j


@njit(cache=True)
def euler_from_quaternion(q: Array) -> Array:
    """Roll, pitch, yaw [rad] of (6.20)-(6.22). At pitch = +-90 deg roll is 0 and yaw holds the rest."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    sin_pitch = 2.0 * (w * y - x * z)
    if abs(sin_pitch) > 1.0 - 1e-12:  # only roll - yaw (or roll + yaw) is defined there
        sign = np.copysign(1.0, sin_pitch)
        return np.array([0.0, 0.5 * np.pi * sign, np.arctan2(-2.0 * sign * x * w, w * w - x * x)])
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.array([roll, np.arcsin(sin_pitch), yaw])


@njit(cache=True)
def euler_angles(quaternions: Array) -> Array:
    """``euler_from_quaternion`` of each of n quaternions (n, 4): (n, 3)."""
    out = np.empty((len(quaternions), 3))
    for i in range(len(quaternions)):
        out[i] = euler_from_quaternion(quaternions[i])
    return out


@njit(cache=True)
def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> Array:
    """Unit quaternion of yaw, then pitch, then roll [rad]."""
    cr, sr = np.cos(0.5 * roll), np.sin(0.5 * roll)
    cp, sp = np.cos(0.5 * pitch), np.sin(0.5 * pitch)
    cy, sy = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


@njit(cache=True)
def quaternion_from_matrix(c: Array) -> Array:
    """Unit quaternion of a rotation matrix of shape (3, 3), by the largest of the four components."""
    trace = c[0, 0] + c[1, 1] + c[2, 2]
    squares = np.array([trace, c[0, 0], c[1, 1], c[2, 2]])
    largest = np.argmax(squares)
    q = np.empty(4)
    if largest == 0:
        q[0] = 1.0 + trace
        q[1], q[2], q[3] = c[2, 1] - c[1, 2], c[0, 2] - c[2, 0], c[1, 0] - c[0, 1]
    elif largest == 1:
        q[1] = 1.0 + 2.0 * c[0, 0] - trace
        q[0], q[2], q[3] = c[2, 1] - c[1, 2], c[0, 1] + c[1, 0], c[0, 2] + c[2, 0]
    elif largest == 2:
        q[2] = 1.0 + 2.0 * c[1, 1] - trace
        q[0], q[1], q[3] = c[0, 2] - c[2, 0], c[0, 1] + c[1, 0], c[1, 2] + c[2, 1]
    else:
        q[3] = 1.0 + 2.0 * c[2, 2] - trace
        q[0], q[1], q[2] = c[1, 0] - c[0, 1], c[0, 2] + c[2, 0], c[1, 2] + c[2, 1]
    if q[0] < 0.0:
        q = -q
    return q / np.sqrt(np.sum(q * q))


@njit(cache=True)
def air_data_from_velocity(v: Array | Vector) -> tuple[float, float, float]:
    """True airspeed [m/s], angle of attack and sideslip [rad] of the air-relative body velocity (u, v, w)."""
    speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    alpha = np.arctan2(v[2], v[0])
    beta = np.arctan2(v[1], np.sqrt(v[0] * v[0] + v[2] * v[2]))
    return speed, alpha, beta


@njit(cache=True)
def air_data_from_velocities(velocities: Array) -> Array:
    """``air_data_from_velocity`` of each of n velocities (n, 3): (n, 3)."""
    out = np.empty((len(velocities), 3))
    for i in range(len(velocities)):
        out[i, 0], out[i, 1], out[i, 2] = air_data_from_velocity(velocities[i])
    return out


@njit(cache=True)
def velocity_from_air_data(speed: float, alpha: float, beta: float) -> Array:
    """Air-relative body velocity (u, v, w), (3,): V (cos a cos b, sin b, sin a cos b), (37) of the two-stage paper."""
    return np.array([speed * np.cos(alpha) * np.cos(beta), speed * np.sin(beta), speed * np.sin(alpha) * np.cos(beta)])
