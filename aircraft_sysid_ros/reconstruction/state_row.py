"""A row of ``state.StateField`` at the centre of gravity, from the state at the place of the IMU."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY, air_density
from aircraft_sysid_ros.aircraft.frames import (
    Matrix,
    Vector,
    air_data_from_velocity,
    applied,
    cross_matrix,
    rotation,
    rotation_matrix,
    three,
)
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.measurements import air_data_gradient, air_velocity_at
from aircraft_sysid_ros.reconstruction.process import attitude_of
from aircraft_sysid_ros.reconstruction.pseudo_measurements import has_vane, is_inferred
from aircraft_sysid_ros.reconstruction.sensor_noise import mean_attitude_errors
from aircraft_sysid_ros.reconstruction.state import (
    ACCELEROMETER_BIAS,
    AIR_VELOCITY,
    ATTITUDE,
    D_ACCELEROMETER_BIAS,
    D_AIR_VELOCITY,
    D_ATTITUDE,
    D_VELOCITY,
    ERROR_SIZE,
    GYRO_BIAS,
    NO_GUIDE,
    POSITION,
    SUSPECTED,
    VELOCITY,
    Memory,
    Setup,
    StateField,
    Status,
)
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_AIRSPEED, _ALPHA, _BETA = int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP)
_GPS_POSITION, _GPS_VELOCITY = int(Kind.GPS_POSITION), int(Kind.GPS_VELOCITY)
# Columns of a row, and elements of the state, as plain numbers for numba: the first of each.
_TIME, _AIRSPEED_OF_ROW, _ALPHA_OF_ROW = StateField.TIME, StateField.AIRSPEED, StateField.ANGLE_OF_ATTACK
_BETA_OF_ROW, _DENSITY, _FLOW_STD = StateField.SIDESLIP, StateField.AIR_DENSITY, StateField.AIR_VELOCITY_STD
_CONSISTENCY, _STATUS, _CONTRADICTION = StateField.CONSISTENCY, StateField.STATUS, StateField.CONTRADICTION
_FUSED, _REJECTED, _ORIGIN = StateField.FUSED, StateField.REJECTED, StateField.ORIGIN.start
_STD, _WIND = StateField.STANDARD_DEVIATIONS.start, StateField.WIND.start
_ROW_AIR, _ROW_POSITION, _ROW_VELOCITY = (
    StateField.AIR_VELOCITY.start,
    StateField.POSITION.start,
    StateField.VELOCITY.start,
)
_ROW_ATTITUDE, _ROW_AIR_VELOCITY = StateField.ATTITUDE, StateField.AIR_VELOCITY
_FORCE, _OMEGA = StateField.SPECIFIC_FORCE.start, StateField.ANGULAR_VELOCITY.start
_AS_IT_IS = StateField.ATTITUDE.start  # attitude and biases stand in a row as in the state
_AS_IT_IS_IN_STATE, _AS_IT_IS_COUNT = ATTITUDE.start, AIR_VELOCITY.start - ATTITUDE.start
_X_VELOCITY, _X_POSITION, _X_AIR = VELOCITY.start, POSITION.start, AIR_VELOCITY.start
_X_FORCE_BIAS, _X_RATE_BIAS = ACCELEROMETER_BIAS.start, GYRO_BIAS.start

_OK, _NO_GPS = Status.OK, Status.NO_GPS
_NO_AIR_DATA, _INERTIAL_ONLY = Status.NO_AIR_DATA, Status.INERTIAL_ONLY
_INFERRED_ALPHA, _INFERRED_BETA = Status.INFERRED_ALPHA, Status.INFERRED_BETA
_INFERRED_ANGLES = Status.INFERRED_ANGLES
_WITHOUT_GPS, _CALM_AIR = Status.WITHOUT_GPS, Status.CALM_AIR

#: Mean normalised innovation squared of all sensors from which one is looked for, and that of one that is suspected;
#: of another it is at most so large a share, where one alone is.
_UNEASY, _SUSPECT, _ALONE = 1.3, 3.0, 0.3
_ATTITUDE, _MAGNETIC_FIELD = int(Kind.ATTITUDE), int(Kind.MAGNETIC_FIELD)
_FIRST_SUSPECT = min(SUSPECTED)
#: A sensor that has not been fused for this long [s] is counted as lost.
SENSOR_TIMEOUT = 2.0


@njit(cache=True)
def _status(time: float, last_fused: Array, heard: tuple[Integers, Integers, Integers], setup: Setup) -> int:
    """``heard``: counts (kinds,) of samples that were fused, rejected and skipped."""
    gps = time - max(last_fused[_GPS_POSITION], last_fused[_GPS_VELOCITY]) < SENSOR_TIMEOUT
    air = time - last_fused[_AIRSPEED] < SENSOR_TIMEOUT
    inferred_alpha, inferred_beta = not has_vane(_ALPHA, *heard), not has_vane(_BETA, *heard)
    if setup.guide == NO_GUIDE:
        return _WITHOUT_GPS + inferred_alpha + 2 * inferred_beta if air else _INERTIAL_ONLY
    if gps and setup.is_calm and not (air and heard[0][_AIRSPEED] > 0):
        return _CALM_AIR + inferred_alpha + 2 * inferred_beta
    if gps and air:
        if inferred_alpha and inferred_beta:
            return _INFERRED_ANGLES
        if inferred_alpha:
            return _INFERRED_ALPHA
        return _INFERRED_BETA if inferred_beta else _OK
    if gps:
        return _NO_AIR_DATA
    return _NO_GPS if air else _INERTIAL_ONLY


@njit(cache=True)
def _suspected(nis: Array) -> float:
    """Number in SUSPECTED of the sensor whose innovations (kinds,) are too large; 0 where none is."""
    own = max(nis[_GPS_POSITION], nis[_GPS_VELOCITY]), nis[_AIRSPEED], nis[_ALPHA], nis[_BETA], nis[_ATTITUDE]
    largest, second, at = 0.0, 0.0, 0
    for i in range(len(own)):
        if own[i] > largest:
            largest, second, at = own[i], largest, i
        elif own[i] > second:
            second = own[i]
    if not largest > _SUSPECT:
        return 0.0
    return float(_FIRST_SUSPECT + (at if second < _ALONE * largest else len(own)))


@njit(cache=True)
def _density_at(altitude: float, time: float, air: Array) -> float:
    """Density [kg/m^3]: as measured, later as much above or below that of the standard atmosphere as it was then."""
    if abs(time - air[2]) < SENSOR_TIMEOUT or (air[0] > 0.0 and not np.isfinite(air[1] * air_density(altitude))):
        return float(air[0])
    return float(air_density(altitude) * (air[1] if air[1] > 0.0 else 1.0))


@njit(inline="always")  # its memory is handed over array by array otherwise
def write_row(
    row: Array, x: Array, p: Array, force: Array, rate: Array, time: float, setup: Setup, memory: Memory
) -> None:
    """Whole row at the time [s], from the state x (19,), p (18, 18) and the IMU as measured, each (3,)."""
    row[_TIME] = time
    write_state(row, x, p, force, rate, setup.imu_position)
    if memory.fused[_ATTITUDE] > 0 and not setup.given[_ATTITUDE]:
        mean_attitude_errors(memory.noise[_ATTITUDE], memory.attitude_doubt)
        doubt_attitude(row, memory.attitude_doubt, not setup.wind_std[0] > 0.0)
    # once its vane is lost an angle rests on the wind staying as it was: not a measurement, so NaN
    if not (time - memory.last_fused[_ALPHA] < SENSOR_TIMEOUT or is_inferred(_ALPHA, time, x, p, setup, memory)):
        row[_ALPHA_OF_ROW] = np.nan
    if not (time - memory.last_fused[_BETA] < SENSOR_TIMEOUT or is_inferred(_BETA, time, x, p, setup, memory)):
        row[_BETA_OF_ROW] = np.nan
    row[_DENSITY] = _density_at(setup.origin[2] - x[_X_POSITION + 2], time, memory.air)
    row[_CONSISTENCY] = memory.recent_nis[0]
    row[_CONTRADICTION] = _suspected(memory.own_nis) if memory.recent_nis[0] > _UNEASY else 0.0
    fused, rejected = memory.fused, memory.rejected
    row[_STATUS] = _status(time, memory.last_fused, (fused, rejected, memory.skipped), setup)
    row[_FUSED], row[_REJECTED] = np.sum(fused), np.sum(rejected) - rejected[_MAGNETIC_FIELD]  # see _passes_gate
    for i in range(3):
        row[_ORIGIN + i] = setup.origin[i]


@njit(cache=True)
def doubt_attitude(row: Array, doubt: Array, of_wind: bool) -> None:
    """Widen what rests on the attitude by what it may be off about the body axes (3,) [rad] in the mean of a flight.

    Attitude, the biases of the accelerometer that look like roll and pitch, and ``of_wind`` the wind v - C u: the air
    velocity u is measured in body axes.
    """
    for i in range(3):
        _widen(row, D_ATTITUDE + i, doubt[i] ** 2)
    for i in range(2):
        _widen(row, D_ACCELEROMETER_BIAS + 1 - i, (STANDARD_GRAVITY * doubt[i]) ** 2)
    if of_wind:
        by_attitude = rotation_matrix(row[_ROW_ATTITUDE]) @ cross_matrix(row[_ROW_AIR_VELOCITY])
        for axis in range(3):
            _widen(row, D_AIR_VELOCITY + axis, np.sum((by_attitude[axis] * doubt) ** 2))


@njit(cache=True)
def doubt_attitudes(rows: Array, doubt: Array, of_wind: bool) -> None:
    """The same of each of many rows (n, StateField.WIDTH)."""
    for row in rows:
        doubt_attitude(row, doubt, of_wind)


@njit(cache=True)
def _widen(row: Array, at: int, variance: float) -> None:
    """A standard deviation of a row with a variance that is added to it."""
    if variance > 0.0:
        row[_STD + at] = np.sqrt(row[_STD + at] ** 2 + variance)


@njit(cache=True)
def _displaced(x: Array, first: int, c: Matrix, arm: Vector) -> Vector:
    """Three numbers of the state from ``first`` on, plus C times an arm in body axes."""
    return (
        x[first] + c[0] * arm[0] + c[1] * arm[1] + c[2] * arm[2],
        x[first + 1] + c[3] * arm[0] + c[4] * arm[1] + c[5] * arm[2],
        x[first + 2] + c[6] * arm[0] + c[7] * arm[1] + c[8] * arm[2],
    )


@njit(cache=True)
def write_state(row: Array, x: Array, p: Array, force: Array, rate: Array, imu: Array) -> None:
    """The columns that follow from state and covariance; the others are left as they are. ``imu``: its position."""
    to_cg = -imu[0], -imu[1], -imu[2]
    v = air_velocity_at(x, rate, to_cg)
    w, i, j, k = attitude_of(x)
    c = rotation(w, i, j, k)
    omega = rate[0] - x[_X_RATE_BIAS], rate[1] - x[_X_RATE_BIAS + 1], rate[2] - x[_X_RATE_BIAS + 2]
    arm = (
        omega[1] * to_cg[2] - omega[2] * to_cg[1],
        omega[2] * to_cg[0] - omega[0] * to_cg[2],
        omega[0] * to_cg[1] - omega[1] * to_cg[0],
    )
    position, velocity = _displaced(x, _X_POSITION, c, to_cg), _displaced(x, _X_VELOCITY, c, arm)
    through_air = applied(c, three(x[AIR_VELOCITY]))
    for axis in range(3):
        row[_ROW_AIR + axis], row[_ROW_POSITION + axis], row[_ROW_VELOCITY + axis] = (
            v[axis],
            position[axis],
            velocity[axis],
        )
        row[_WIND + axis] = x[_X_VELOCITY + axis] - through_air[axis]
        row[_FORCE + axis], row[_OMEGA + axis] = force[axis] - x[_X_FORCE_BIAS + axis], omega[axis]
    for at in range(_AS_IT_IS_COUNT):
        row[_AS_IT_IS + at] = x[_AS_IT_IS_IN_STATE + at]
    for at in range(D_AIR_VELOCITY):
        row[_STD + at] = np.sqrt(p[at, at])
    jacobian = wind_jacobian(x)
    for axis in range(3):
        row[_STD + D_AIR_VELOCITY + axis] = np.sqrt(max(_quadratic(jacobian[axis], p), 0.0))
    row[_AIRSPEED_OF_ROW], row[_ALPHA_OF_ROW], row[_BETA_OF_ROW] = air_data_from_velocity(v)
    row[_FLOW_STD] = _air_velocity_std(p, v)


@njit(cache=True)
def wind_of(x: Array) -> Array:
    """Wind NED (3,): velocity over ground minus C u (6.23)."""
    w, i, j, k = attitude_of(x)
    through_air = applied(rotation(w, i, j, k), three(x[AIR_VELOCITY]))
    wind = np.empty(3)
    for axis in range(3):
        wind[axis] = x[_X_VELOCITY + axis] - through_air[axis]
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
                if h[j] != 0.0:
                    total += h[i] * p[i, j] * h[j]
    return total


@njit(cache=True)
def _air_velocity_std(p: Array, v: Vector) -> float:
    """Rms standard deviation [m/s] of the air velocity across the flow: what alpha and beta rest on."""
    if v[0] * v[0] + v[2] * v[2] < 1e-6:
        return np.nan
    total = 0.0
    for kind in (_ALPHA, _BETA):
        g = air_data_gradient(kind, v)
        for i in range(3):
            for j in range(3):
                total += g[i] * p[D_AIR_VELOCITY + i, D_AIR_VELOCITY + j] * g[j]
    square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    return float(np.sqrt(max(0.5 * total * square, 0.0)))
