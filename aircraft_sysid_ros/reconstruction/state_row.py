"""A row of ``state.StateField`` at the centre of gravity, from the state at the place of the IMU."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft.atmosphere import air_density
from aircraft_sysid_ros.aircraft.frames import air_data_from_velocity, cross_matrix, rotation_matrix
from aircraft_sysid_ros.reconstruction.measurements import air_data_gradient, air_velocity_at
from aircraft_sysid_ros.reconstruction.pseudo_measurements import has_vane, is_inferred
from aircraft_sysid_ros.reconstruction.state import (
    ACCELEROMETER_BIAS,
    AIR_VELOCITY,
    ATTITUDE,
    D_AIR_VELOCITY,
    D_ATTITUDE,
    D_VELOCITY,
    ERROR_SIZE,
    GYRO_BIAS,
    Memory,
    Setup,
    StateField,
    Status,
)
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

_AIRSPEED, _ALPHA, _BETA = int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP)
_GPS_POSITION, _GPS_VELOCITY = int(Kind.GPS_POSITION), int(Kind.GPS_VELOCITY)
# Columns, as plain numbers for numba.
_COLUMN_STD = StateField.STANDARD_DEVIATIONS.start

_OK, _NO_GPS = Status.OK, Status.NO_GPS
_NO_AIR_DATA, _INERTIAL_ONLY = Status.NO_AIR_DATA, Status.INERTIAL_ONLY
_INFERRED_ALPHA, _INFERRED_BETA = Status.INFERRED_ALPHA, Status.INFERRED_BETA
_INFERRED_ANGLES = Status.INFERRED_ANGLES

#: A sensor that has not been fused for this long [s] is counted as lost.
SENSOR_TIMEOUT = 2.0


@njit(cache=True)
def _status(time: float, memory: Memory) -> int:
    gps = time - max(memory.last_fused[_GPS_POSITION], memory.last_fused[_GPS_VELOCITY]) < SENSOR_TIMEOUT
    air = time - memory.last_fused[_AIRSPEED] < SENSOR_TIMEOUT
    if gps and air:
        inferred_alpha, inferred_beta = not has_vane(_ALPHA, memory), not has_vane(_BETA, memory)
        if inferred_alpha and inferred_beta:
            return _INFERRED_ANGLES
        if inferred_alpha:
            return _INFERRED_ALPHA
        return _INFERRED_BETA if inferred_beta else _OK
    if gps:
        return _NO_AIR_DATA
    return _NO_GPS if air else _INERTIAL_ONLY


@njit(cache=True)
def write_row(
    row: Array, x: Array, p: Array, force: Array, rate: Array, time: float, setup: Setup, memory: Memory
) -> None:
    """Whole row at the time [s], from the state x (19,), p (18, 18) and the IMU as measured, each (3,)."""
    row[0] = time
    write_state(row, x, p, force, rate, setup)
    # once its vane is lost an angle rests on the wind staying as it was: not a measurement, so NaN
    if not (time - memory.last_fused[_ALPHA] < SENSOR_TIMEOUT or is_inferred(_ALPHA, time, x, p, memory)):
        row[48] = np.nan
    if not (time - memory.last_fused[_BETA] < SENSOR_TIMEOUT or is_inferred(_BETA, time, x, p, memory)):
        row[49] = np.nan
    density = memory.air[0]
    row[50] = density if density > 0.0 else air_density(setup.origin[2] - x[5])
    row[52] = memory.recent_nis[0]
    row[53] = _status(time, memory)
    row[54] = np.sum(memory.fused)
    row[55] = np.sum(memory.rejected)
    row[57:60] = setup.origin


@njit(cache=True)
def write_state(row: Array, x: Array, p: Array, force: Array, rate: Array, setup: Setup) -> None:
    """The columns that follow from state and covariance; the others are left as they are."""
    to_cg = -setup.imu_position
    v = air_velocity_at(x, rate, to_cg)
    c = rotation_matrix(x[ATTITUDE])
    omega = rate - x[GYRO_BIAS]
    row[1:4] = v
    arm = np.array(
        [
            omega[1] * to_cg[2] - omega[2] * to_cg[1],
            omega[2] * to_cg[0] - omega[0] * to_cg[2],
            omega[0] * to_cg[1] - omega[1] * to_cg[0],
        ]
    )
    for i in range(3):
        row[4 + i] = x[3 + i] + c[i, 0] * to_cg[0] + c[i, 1] * to_cg[1] + c[i, 2] * to_cg[2]
        row[7 + i] = x[i] + c[i, 0] * arm[0] + c[i, 1] * arm[1] + c[i, 2] * arm[2]
    row[10:20] = x[6:16]
    for i in range(D_AIR_VELOCITY):
        row[_COLUMN_STD + i] = np.sqrt(p[i, i])
    row[20:23] = wind_of(x)
    jacobian = wind_jacobian(x)
    for i in range(3):
        row[_COLUMN_STD + D_AIR_VELOCITY + i] = np.sqrt(max(_quadratic(jacobian[i], p), 0.0))
    row[41:44] = force - x[ACCELEROMETER_BIAS]
    row[44:47] = omega
    row[47], row[48], row[49] = air_data_from_velocity(v)
    row[51] = _air_velocity_std(p, v)


@njit(cache=True)
def wind_of(x: Array) -> Array:
    """Wind NED (3,): velocity over ground minus C u (6.23)."""
    c = rotation_matrix(x[ATTITUDE])
    wind = np.empty(3)
    for i in range(3):
        wind[i] = x[i] - (c[i, 0] * x[16] + c[i, 1] * x[17] + c[i, 2] * x[18])
    return wind


@njit(cache=True)
def wind_jacobian(x: Array) -> Array:
    """Derivative of the wind by the error of the state, shape (3, 18)."""
    c = rotation_matrix(x[ATTITUDE])
    h = np.zeros((3, ERROR_SIZE))
    by_attitude = c @ cross_matrix(x[AIR_VELOCITY])
    for i in range(3):
        h[i, D_VELOCITY + i] = 1.0
        for j in range(3):
            h[i, D_ATTITUDE + j] = by_attitude[i, j]
            h[i, D_AIR_VELOCITY + j] = -c[i, j]
    return h


@njit(cache=True)
def _quadratic(h: Array, p: Array) -> float:
    """h p h' for a row h with few numbers that are not 0."""
    total = 0.0
    for i in range(len(h)):
        if h[i] != 0.0:
            for j in range(len(h)):
                total += h[i] * p[i, j] * h[j]
    return total


@njit(cache=True)
def _air_velocity_std(p: Array, v: Array) -> float:
    """Rms standard deviation [m/s] of the air velocity across the flow: what alpha and beta rest on."""
    if v[0] * v[0] + v[2] * v[2] < 1e-6:
        return np.nan
    total = 0.0
    for kind in (_ALPHA, _BETA):
        g = air_data_gradient(kind, v)
        for i in range(3):
            for j in range(3):
                total += g[i] * p[D_AIR_VELOCITY + i, D_AIR_VELOCITY + j] * g[j]
    return np.sqrt(max(0.5 * total * np.sum(v * v), 0.0))
