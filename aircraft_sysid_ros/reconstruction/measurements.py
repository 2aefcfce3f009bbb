"""Measurement functions h(x) and their Jacobians, for the state and error of ``state``.

``residual_and_jacobian`` gives y - h(x) and H = dh/d(error) at x, where the attitude error is a rotation
vector in body axes. Air data are measured at the probe: V, alpha, beta of u + omega x r with the air-relative
velocity u.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY, air_density, pressure
from aircraft_sysid_ros.aircraft.frames import (
    Vector,
    applied,
    crossing,
    multiplied,
    put_matrix,
    quaternion_conjugate,
    quaternion_log,
    quaternion_product,
    right_jacobian,
    rotation,
    rotation_matrix,
    three,
)
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.air_data_errors import shown
from aircraft_sysid_ros.reconstruction.process import attitude_of
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
from aircraft_sysid_ros.samples import GPS_NED, Kind

Array = npt.NDArray[np.float64]

_ATTITUDE, _MAGNETIC_FIELD = int(Kind.ATTITUDE), int(Kind.MAGNETIC_FIELD)
_GPS_POSITION, _GPS_VELOCITY = int(Kind.GPS_POSITION), int(Kind.GPS_VELOCITY)
_AIRSPEED, _ALPHA, _BETA = int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP)
_AIR = int(Kind.AIR)


@njit(cache=True)
def wrap(angle: float) -> float:
    """Angle [rad] within [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@njit(cache=True)
def air_velocity_at(x: Array, rate: Array, place: Array | Vector) -> Vector:
    """Air-relative body velocity at ``place`` (3,) (FRD from the IMU)."""
    p, q, r = rate[0] - x[GYRO_BIAS.start], rate[1] - x[GYRO_BIAS.start + 1], rate[2] - x[GYRO_BIAS.start + 2]
    return (
        x[AIR_VELOCITY.start] + (q * place[2] - r * place[1]),
        x[AIR_VELOCITY.start + 1] + (r * place[0] - p * place[2]),
        x[AIR_VELOCITY.start + 2] + (p * place[1] - q * place[0]),
    )


@njit(cache=True)
def air_data_gradient(kind: int, v: Vector) -> Vector:
    """Gradient of V, alpha or beta by the air-relative velocity v."""
    uw2 = v[0] * v[0] + v[2] * v[2]
    v2 = uw2 + v[1] * v[1]
    if kind == _AIRSPEED:
        speed = np.sqrt(v2)
        return v[0] / speed, v[1] / speed, v[2] / speed
    if kind == _ALPHA:
        return -v[2] / uw2, 0.0, v[0] / uw2
    root = np.sqrt(uw2)
    return -v[0] * v[1] / (v2 * root), root / v2, -v[2] * v[1] / (v2 * root)


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
    h[0, D_AIR_VELOCITY], h[0, D_AIR_VELOCITY + 1], h[0, D_AIR_VELOCITY + 2] = g
    h[0, D_GYRO_BIAS] = g[1] * place[2] - g[2] * place[1]  # d(omega x r)/d(b_g) = [r x]
    h[0, D_GYRO_BIAS + 1] = g[2] * place[0] - g[0] * place[2]
    h[0, D_GYRO_BIAS + 2] = g[0] * place[1] - g[1] * place[0]
    if len(x) > STATE_SIZE:
        predicted = shown(kind, predicted, x, h)
    residual[0] = wrap(value - predicted) if kind == _ALPHA else value - predicted
    return 1


@njit(cache=True)
def variance_of_place(kind: int, x: Array, rate: Array, setup: Setup) -> float:
    """Variance of V, alpha or beta for not knowing where on a turning aircraft they are measured."""
    if kind != _AIRSPEED and kind != _ALPHA and kind != _BETA:
        return 0.0
    bias = GYRO_BIAS.start
    p, q, r = rate[0] - x[bias], rate[1] - x[bias + 1], rate[2] - x[bias + 2]
    g, doubt = air_data_gradient(kind, air_velocity_at(x, rate, setup.probe_from_imu)), setup.probe_doubt[kind]
    ahead, right, below = g[1] * r - g[2] * q, g[2] * p - g[0] * r, g[0] * q - g[1] * p  # of omega x one metre
    return (ahead * doubt[0]) ** 2 + (right * doubt[1]) ** 2 + (below * doubt[2]) ** 2


@njit(cache=True)
def _gps(kind: int, values: Array, x: Array, rate: Array, setup: Setup, residual: Array, h: Array) -> int:
    w, i, j, k = attitude_of(x)
    c, place = rotation(w, i, j, k), three(setup.gps_from_imu)
    if kind == _GPS_POSITION:
        measured = three(values[GPS_NED])
        arm, block, state = place, D_POSITION, three(x[POSITION])
    else:
        measured, bias = three(values), GYRO_BIAS.start
        arm = applied(crossing((rate[0] - x[bias], rate[1] - x[bias + 1], rate[2] - x[bias + 2])), place)
        block, state = D_VELOCITY, three(x[VELOCITY])
        put_matrix(multiplied(c, crossing(place)), h[:, D_GYRO_BIAS : D_GYRO_BIAS + 3])
    at = applied(c, arm)
    residual[0], residual[1], residual[2] = (
        measured[0] - state[0] - at[0],
        measured[1] - state[1] - at[1],
        measured[2] - state[2] - at[2],
    )
    h[0, block] = h[1, block + 1] = h[2, block + 2] = 1.0
    m = multiplied(c, crossing(arm))
    by_attitude = -m[0], -m[1], -m[2], -m[3], -m[4], -m[5], -m[6], -m[7], -m[8]
    put_matrix(by_attitude, h[:, D_ATTITUDE : D_ATTITUDE + 3])
    return 3


@njit(cache=True)
def _attitude(values: Array, x: Array, residual: Array, h: Array) -> int:
    error = quaternion_log(quaternion_product(quaternion_conjugate(x[ATTITUDE]), values[:4]))
    residual[:] = error
    # log(exp(-delta) exp(error)) = error - J_l(error)^-1 delta, and J_l(error) = J_r(-error)
    h[:, D_ATTITUDE : D_ATTITUDE + 3] = np.linalg.inv(right_jacobian(-error))
    return 3


@njit(cache=True)
def _heading(values: Array, x: Array, setup: Setup, residual: Array, h: Array) -> int:
    """Heading of the magnetic field: its horizontal direction in NED is the declination.

    The residual is that angle times the horizontal share of the field, whose noise is that of the direction in any
    inclination. The Jacobian is that of the predicted direction, of which the sample gives the inclination alone. At
    the direction of the sample it would carry the noise of the residual, and the products of both would tilt the
    attitude.
    """
    c = rotation_matrix(x[ATTITUDE])
    level = c @ (values[:3] / np.sqrt(np.sum(values[:3] * values[:3])))
    horizontal = np.sqrt(level[0] ** 2 + level[1] ** 2)
    if horizontal < 0.2 or np.isnan(setup.declination):  # field nearly vertical: no heading in it
        return 0
    residual[0] = horizontal * wrap(setup.declination - np.arctan2(level[1], level[0]))
    north, east = np.cos(setup.declination), np.sin(setup.declination)
    for j in range(3):
        h[0, D_ATTITUDE + j] = horizontal * c[2, j] - level[2] * (north * c[0, j] + east * c[1, j])
    return 1


@njit(cache=True)
def _static_pressure(values: Array, x: Array, setup: Setup, residual: Array, h: Array) -> int:
    """Pressure of the standard atmosphere at the height."""
    down = POSITION.start + 2
    altitude = setup.origin[2] - x[down]
    residual[0] = values[1] - pressure(altitude)
    h[0, D_POSITION + 2] = air_density(altitude) * STANDARD_GRAVITY
    return 1


@njit(cache=True)
def outputs_of(kind: int) -> int:
    """How many numbers a kind of measurement has."""
    return 3 if kind == _GPS_POSITION or kind == _GPS_VELOCITY or kind == _ATTITUDE else 1


@njit(cache=True)
def residual_and_jacobian(
    kind: int, values: Array, x: Array, rate: Array, setup: Setup, residual: Array, h: Array
) -> int:
    """Fill residual (m,) = y - h(x) and h (m, 18), m = ``outputs_of(kind)``; returns m, or 0: nothing to fuse.

    With errors of the air data among the states x is (25,) and h (m, 24).

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
    if kind == _AIR:
        return _static_pressure(values, x, setup, residual, h)
    return 0
