"""h(x, u, theta): the 18 outputs of (6.3) in docs/references.md and their derivatives by the error of the state.

The IMU reads the specific force f + omega' x r + omega x (omega x r) at its place r, with the angular acceleration
of the model. Air data are V, alpha and beta of u + omega x r at the probe.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import quaternion_conjugate, quaternion_log, quaternion_product
from aircraft_sysid_ros.flight_model.derivatives import Aerodynamics
from aircraft_sysid_ros.flight_model.dynamics import MINIMUM_AIRSPEED
from aircraft_sysid_ros.flight_model.layout import (
    AIRSPEED,
    ALPHA,
    ATTITUDE,
    ATTITUDE_VECTOR,
    BETA,
    D_ATTITUDE,
    D_POSITION,
    D_RATES,
    D_VELOCITY,
    D_WIND,
    FORCE,
    GPS_POSITION,
    GPS_VELOCITY,
    GYRO,
    REFERENCE,
    FlightModel,
    Vector,
)
from aircraft_sysid_ros.flight_model.term_gradients import DIRECTIONS
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def _cross_into(a: Array | Vector, b: Array | Vector, out: Array) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def attitude_vector(quaternion: Array, reference: Array) -> Array:
    """Rotation vector (3,) [rad], in NED axes, from the reference attitude to another."""
    return quaternion_log(quaternion_product(quaternion, quaternion_conjugate(reference)))


@njit(cache=True, error_model="numpy")
def outputs(
    x: Array,
    c: Array,
    force: Array,
    acceleration: Array,
    air_velocity: Array,
    inputs: Array,
    biases: Array,
    model: FlightModel,
    out: Array,
) -> None:
    """Outputs (18,) into ``out``.

    State x (16,) with c = rotation_matrix of its attitude, specific force at the centre of gravity, angular
    acceleration and air-relative velocity, each (3,), and the IMU biases (6,).
    """
    rates = x[10:13]
    once, twice, turning = np.empty(3), np.empty(3), np.empty(3)
    _cross_into(rates, model.imu, once)
    _cross_into(rates, once, twice)
    _cross_into(acceleration, model.imu, turning)
    for i in range(3):
        out[FORCE + i] = force[i] + turning[i] + twice[i] + biases[i]
        out[GYRO + i] = rates[i] + biases[3 + i]
    _cross_into(rates, model.gps, once)
    for i in range(3):
        out[GPS_POSITION + i] = x[3 + i]
        out[GPS_VELOCITY + i] = x[i]
        for j in range(3):
            out[GPS_POSITION + i] += c[i, j] * model.gps[j]
            out[GPS_VELOCITY + i] += c[i, j] * once[j]
    out[ATTITUDE_VECTOR : ATTITUDE_VECTOR + 3] = attitude_vector(x[ATTITUDE], inputs[REFERENCE])
    _cross_into(rates, model.probe, once)
    a, b, d = air_velocity[0] + once[0], air_velocity[1] + once[1], air_velocity[2] + once[2]
    ahead = np.sqrt(a * a + d * d)
    out[AIRSPEED] = np.sqrt(a * a + b * b + d * d)
    out[ALPHA] = np.arctan2(d, a)
    out[BETA] = np.arctan2(b, ahead)


@njit(cache=True, error_model="numpy")
def output_jacobian(x: Array, c: Array, air: Aerodynamics, attitude: Array, model: FlightModel, out: Array) -> None:
    """H (18, 15) into ``out``, all overwritten; ``attitude`` is the predicted attitude output (3,)."""
    out[:] = 0.0
    _put_imu(x, c, air, model, out)
    _put_gps(x, c, model, out)
    _put_attitude(attitude, c, out)
    _put_air_data(x, c, air.air_velocity, model, out)


@njit(cache=True, error_model="numpy")
def _put_row(out: Array, row: int, by_u: Array, by_rates: Array, c: Array, u: Array) -> None:
    """One output with derivatives (3,) by air velocity and rates."""
    for j in range(3):
        by_velocity = by_u[0] * c[j, 0] + by_u[1] * c[j, 1] + by_u[2] * c[j, 2]
        out[row, D_VELOCITY + j] = by_velocity
        out[row, D_WIND + j] = -by_velocity
        out[row, D_RATES + j] = by_rates[j]
    out[row, D_ATTITUDE] = by_u[1] * u[2] - by_u[2] * u[1]
    out[row, D_ATTITUDE + 1] = by_u[2] * u[0] - by_u[0] * u[2]
    out[row, D_ATTITUDE + 2] = by_u[0] * u[1] - by_u[1] * u[0]


@njit(cache=True, error_model="numpy")
def _put_imu(x: Array, c: Array, air: Aerodynamics, model: FlightModel, out: Array) -> None:
    rates, r = x[10:13], model.imu
    slopes, column, turning = np.empty((3, DIRECTIONS)), np.empty(3), np.empty(3)
    for d in range(DIRECTIONS):
        for i in range(3):
            column[i] = air.acceleration_slopes[i, d]
        _cross_into(column, r, turning)
        for i in range(3):
            slopes[i, d] = air.force_slopes[i, d] + turning[i]
    along = rates[0] * r[0] + rates[1] * r[1] + rates[2] * r[2]
    for i in range(3):  # omega x (omega x r) = omega (omega . r) - r omega^2
        slopes[i, 3 + i] += along
        for j in range(3):
            slopes[i, 3 + j] += rates[i] * r[j] - 2.0 * r[i] * rates[j]
        _put_row(out, FORCE + i, slopes[i, :3], slopes[i, 3:], c, air.air_velocity)
        out[GYRO + i, D_RATES + i] = 1.0


@njit(cache=True, error_model="numpy")
def _put_gps(x: Array, c: Array, model: FlightModel, out: Array) -> None:
    """Antenna at r: position p + C r, velocity v + C (omega x r)."""
    r, moving = model.gps, np.empty(3)
    _cross_into(x[10:13], r, moving)
    for i in range(3):
        out[GPS_POSITION + i, D_POSITION + i] = 1.0
        out[GPS_VELOCITY + i, D_VELOCITY + i] = 1.0
        c0, c1, c2 = c[i, 0], c[i, 1], c[i, 2]
        out[GPS_VELOCITY + i, D_ATTITUDE] = -(c1 * moving[2] - c2 * moving[1])
        out[GPS_VELOCITY + i, D_ATTITUDE + 1] = -(c2 * moving[0] - c0 * moving[2])
        out[GPS_VELOCITY + i, D_ATTITUDE + 2] = -(c0 * moving[1] - c1 * moving[0])
        for row, block in ((GPS_POSITION + i, D_ATTITUDE), (GPS_VELOCITY + i, D_RATES)):
            out[row, block] = -(c1 * r[2] - c2 * r[1])
            out[row, block + 1] = -(c2 * r[0] - c0 * r[2])
            out[row, block + 2] = -(c0 * r[1] - c1 * r[0])


@njit(cache=True, error_model="numpy")
def _put_attitude(e: Array, c: Array, out: Array) -> None:
    """log(exp(C d) exp(e)) = e + J_l(e)^-1 C d, with J_l^-1 = I - [e x]/2 + [e x]^2/12 + O(e^4)."""
    square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    for j in range(3):
        x, y, z = c[0, j], c[1, j], c[2, j]
        along = (e[0] * x + e[1] * y + e[2] * z) / 12.0
        less = 1.0 - square / 12.0
        out[ATTITUDE_VECTOR, D_ATTITUDE + j] = less * x - 0.5 * (e[1] * z - e[2] * y) + along * e[0]
        out[ATTITUDE_VECTOR + 1, D_ATTITUDE + j] = less * y - 0.5 * (e[2] * x - e[0] * z) + along * e[1]
        out[ATTITUDE_VECTOR + 2, D_ATTITUDE + j] = less * z - 0.5 * (e[0] * y - e[1] * x) + along * e[2]


@njit(cache=True, error_model="numpy")
def _put_air_data(x: Array, c: Array, u: Array, model: FlightModel, out: Array) -> None:
    """Gradients by the air velocity at the probe; below MINIMUM_AIRSPEED its square is held there."""
    r, moving = model.probe, np.empty(3)
    _cross_into(x[10:13], r, moving)
    a, b, d = u[0] + moving[0], u[1] + moving[1], u[2] + moving[2]
    uw2 = max(a * a + d * d, MINIMUM_AIRSPEED**2)
    v2, root = uw2 + b * b, np.sqrt(uw2)
    speed = np.sqrt(v2)
    gradient, by_rates = np.empty(3), np.empty(3)
    for row in (AIRSPEED, ALPHA, BETA):
        if row == AIRSPEED:
            gradient[0], gradient[1], gradient[2] = a / speed, b / speed, d / speed
        elif row == ALPHA:
            gradient[0], gradient[1], gradient[2] = -d / uw2, 0.0, a / uw2
        else:
            gradient[0], gradient[1], gradient[2] = -a * b / (v2 * root), root / v2, -d * b / (v2 * root)
        _cross_into(r, gradient, by_rates)  # g . (omega x r) = omega . (r x g)
        _put_row(out, row, gradient, by_rates, c, u)
