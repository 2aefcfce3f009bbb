"""Measurement functions h(x) and their Jacobians, for the state and error of ``state``.

``residual_and_jacobian`` gives y - h(x) and H = dh/d(error) at x, where the attitude error is a rotation
vector in body axes. Air data are measured at the probe: V, alpha, beta of u + omega x r with the air-relative
velocity u.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft.earth import ned_from_geodetic
from aircraft_sysid_ros.aircraft.frames import (
    cross_matrix,
    product,
    quaternion_conjugate,
    quaternion_log,
    quaternion_product,
    right_jacobian,
    rotation_matrix,
    times,
)
from aircraft_sysid_ros.reconstruction.air_data_errors import shown
from aircraft_sysid_ros.reconstruction.state import (
    AIR_VELOCITY,
    ATTITUDE,
    D_AIR_VELOCITY,
    D_ATTITUDE,
    D_GYRO_BIAS,
    D_POSITION,
    D_VELOCITY,
    GYRO_BIAS,
    POSITION,
    STATE_SIZE,
    VELOCITY,
    Setup,
)
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

_ATTITUDE, _MAGNETIC_FIELD = int(Kind.ATTITUDE), int(Kind.MAGNETIC_FIELD)
_GPS_POSITION, _GPS_VELOCITY = int(Kind.GPS_POSITION), int(Kind.GPS_VELOCITY)
_AIRSPEED, _ALPHA, _BETA = int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP)


@njit(cache=True)
def wrap(angle: float) -> float:
    """Angle [rad] within [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@njit(cache=True)
def _put(h: Array, row: int, column: int, block: npt.NDArray[np.floating[Any]]) -> None:
    for i in range(3):
        for j in range(3):
            h[row + i, column + j] = block[i, j]


@njit(cache=True)
def air_velocity_at(x: Array, rate: Array, place: Array) -> Array:
    """Air-relative body velocity (3,) at ``place`` (FRD from the IMU)."""
    p, q, r = rate[0] - x[GYRO_BIAS.start], rate[1] - x[GYRO_BIAS.start + 1], rate[2] - x[GYRO_BIAS.start + 2]
    v = np.empty(3)
    v[0] = x[AIR_VELOCITY.start] + (q * place[2] - r * place[1])
    v[1] = x[AIR_VELOCITY.start + 1] + (r * place[0] - p * place[2])
    v[2] = x[AIR_VELOCITY.start + 2] + (p * place[1] - q * place[0])
    return v


@njit(cache=True)
def air_data_gradient(kind: int, v: Array) -> Array:
    """Gradient (3,) of V, alpha or beta by the air-relative velocity v (3,)."""
    uw2 = v[0] * v[0] + v[2] * v[2]
    v2 = uw2 + v[1] * v[1]
    g = np.empty(3)
    if kind == _AIRSPEED:
        speed = np.sqrt(v2)
        g[0], g[1], g[2] = v[0] / speed, v[1] / speed, v[2] / speed
    elif kind == _ALPHA:
        g[0], g[1], g[2] = -v[2] / uw2, 0.0, v[0] / uw2
    else:
        root = np.sqrt(uw2)
        g[0], g[1], g[2] = -v[0] * v[1] / (v2 * root), root / v2, -v[2] * v[1] / (v2 * root)
    return g


@njit(cache=True)
def _air_data(kind: int, value: float, x: Array, rate: Array, setup: Setup, residual: Array, h: Array) -> int:
    place = setup.probe_from_imu
    v = air_velocity_at(x, rate, place)
    uw = np.sqrt(v[0] * v[0] + v[2] * v[2])
    if kind == _AIRSPEED:
        predicted = np.sqrt(uw * uw + v[1] * v[1])
    elif kind == _ALPHA:
        predicted = np.arctan2(v[2], v[0])
    else:
        predicted = np.arctan2(v[1], uw)
    g = air_data_gradient(kind, v)
    for i in range(3):
        h[0, D_AIR_VELOCITY + i] = g[i]
    h[0, D_GYRO_BIAS] = g[1] * place[2] - g[2] * place[1]  # d(omega x r)/d(b_g) = [r x]
    h[0, D_GYRO_BIAS + 1] = g[2] * place[0] - g[0] * place[2]
    h[0, D_GYRO_BIAS + 2] = g[0] * place[1] - g[1] * place[0]
    if len(x) > STATE_SIZE:
        predicted = shown(kind, predicted, x, h)
    residual[0] = wrap(value - predicted) if kind == _ALPHA else value - predicted
    return 1


@njit(cache=True)
def _gps(kind: int, values: Array, x: Array, rate: Array, setup: Setup, residual: Array, h: Array) -> int:
    c = rotation_matrix(x[ATTITUDE])
    place = setup.gps_from_imu
    if kind == _GPS_POSITION:
        position = ned_from_geodetic(values[0], values[1], values[2], setup.origin)
        arm = place
        block = D_POSITION
        state = x[POSITION]
    else:
        position = values[:3]
        arm = times(cross_matrix(rate - x[GYRO_BIAS]), place)
        block = D_VELOCITY
        state = x[VELOCITY]
        _put(h, 0, D_GYRO_BIAS, product(c, cross_matrix(place)))
    residual[:] = position - state - times(c, arm)
    _put(h, 0, block, np.eye(3))
    _put(h, 0, D_ATTITUDE, -product(c, cross_matrix(arm)))
    return 3


@njit(cache=True)
def _attitude(values: Array, x: Array, residual: Array, h: Array) -> int:
    error = quaternion_log(quaternion_product(quaternion_conjugate(x[ATTITUDE]), values[:4]))
    residual[:] = error
    # log(exp(-delta) exp(error)) = error - J_l(error)^-1 delta, and J_l(error) = J_r(-error)
    _put(h, 0, D_ATTITUDE, np.linalg.inv(right_jacobian(-error)))
    return 3


@njit(cache=True)
def _heading(values: Array, x: Array, setup: Setup, residual: Array, h: Array) -> int:
    """Heading of the magnetic field: its horizontal direction in NED is the declination."""
    c = rotation_matrix(x[ATTITUDE])
    field = values[:3] / np.sqrt(np.sum(values[:3] * values[:3]))
    level = c @ field
    horizontal2 = level[0] ** 2 + level[1] ** 2
    if horizontal2 < 0.04 or np.isnan(setup.declination):  # field nearly vertical: no heading in it
        return 0
    residual[0] = wrap(setup.declination - np.arctan2(level[1], level[0]))
    turned = -(c @ cross_matrix(field))
    for j in range(3):
        h[0, D_ATTITUDE + j] = (level[0] * turned[1, j] - level[1] * turned[0, j]) / horizontal2
    return 1


@njit(cache=True)
def residual_and_jacobian(
    kind: int, values: Array, x: Array, rate: Array, setup: Setup, residual: Array, h: Array
) -> int:
    """Fill residual (3,) = y - h(x) and h (3, 18); returns the number of outputs, 0: nothing to fuse.

    With errors of the air data among the states x is (25,) and h (3, 24).

    ``rate`` is the angular rate as measured at that time (3,) [rad/s].
    """
    residual[:] = 0.0
    h[:] = 0.0
    if kind == _AIRSPEED or kind == _ALPHA or kind == _BETA:
        return _air_data(kind, values[0], x, rate, setup, residual, h)
    if kind == _GPS_POSITION or kind == _GPS_VELOCITY:
        return _gps(kind, values, x, rate, setup, residual, h)
    if kind == _ATTITUDE:
        return _attitude(values, x, residual, h)
    if kind == _MAGNETIC_FIELD:
        return _heading(values, x, setup, residual, h)
    return 0
