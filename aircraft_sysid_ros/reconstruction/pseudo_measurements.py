"""What is assumed in place of a measured angle of attack and sideslip, and of a wind that nothing shows.

With GPS, attitude and airspeed the filter infers both angles through the wind: u = C' (v - W). Motion within seconds
comes from the IMU and is good; what is slow rests on what is known of the wind, and in straight flight that is too
little. Two pseudo-measurements bound it, once a second:

    0 = beta + e,  e of SIDESLIP_STD      an aeroplane flies straight through the air, on average
    0 = W_d + e,   e of VERTICAL_STD      air rises and sinks, on average by nothing

They are weak beside what a second of manoeuvre says, so that doublets pass, and a minute of them fixes the mean: to
SIDESLIP_STD / sqrt(60) where nothing else is known. An inferred angle is given once it is known to LARGEST_STD:
gusts, which nothing on board measures then, keep it from that, and parameters are not learnt from it. They are made
only for an angle that no vane has ever shown in this flight; a vane that is lost leaves NaN, since the model was
learnt with it. A. M. Lie and D. Gebre-Egziabher, Synthetic air data system, Journal of Aircraft 50 (2013).

Without GPS, and where the user takes the air as calm, the wind is a stationary process about zero of the standard
deviation s. The filter lets it walk by Q per second, and holds it by a pseudo-measurement every T = PERIOD,

    0 = W + e,   e of variance s^4 / (Q T),   under which P = s^2 is where walk and measurement are in balance:

the wind neither becomes known by it, however long the flight, nor does its uncertainty grow without bound.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import cross_matrix, rotation_matrix, three
from aircraft_sysid_ros.estimation.iterated_ekf import linear_update
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.measurements import air_data_gradient
from aircraft_sysid_ros.reconstruction.state import (
    AIR_VELOCITY,
    ATTITUDE,
    D_AIR_VELOCITY,
    D_ATTITUDE,
    D_VELOCITY,
    NO_GUIDE,
    Memory,
    Setup,
)
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

PERIOD = 1.0  # [s]
SIDESLIP_STD = 0.1  # [rad]
VERTICAL_STD = 1.5  # [m/s]
LARGEST_STD = 0.015  # [rad]
_AIRSPEED, _ALPHA, _BETA = int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP)
_ATTITUDE, _GPS_VELOCITY = int(Kind.ATTITUDE), int(Kind.GPS_VELOCITY)
_TIMEOUT = 2.0  # [s] as of a sensor that is lost
_LEAST_WALK = 1e-3  # [m/s per sqrt(s)]


@njit(cache=True)
def has_vane(kind: int, fused: Integers, rejected: Integers, skipped: Integers) -> bool:
    """Whether a vane for the angle has ever spoken in this flight, by the counts of ``Memory``, each (kinds,)."""
    return bool(fused[kind] + rejected[kind] + skipped[kind] > 0)


@njit(cache=True)
def lacks_vane(fused: Integers, rejected: Integers, skipped: Integers) -> bool:
    """Whether there is an angle for which ``has_vane`` does not hold."""
    return not (has_vane(_ALPHA, fused, rejected, skipped) and has_vane(_BETA, fused, rejected, skipped))


@njit(cache=True)
def can_infer(time: float, setup: Setup, memory: Memory) -> bool:
    """Whether GPS and airspeed are there, or what stands in for them: else the wind says nothing about the angles.

    In a flight without GPS that is a measured attitude. Without it the filter would have to find tilt and angles from
    the airspeed alone, and is then sure of wrong ones.
    """
    guide = _ATTITUDE if setup.guide == NO_GUIDE else setup.guide
    gps = time - memory.last_fused[guide] < _TIMEOUT and (guide != _ATTITUDE or memory.fused[guide] > 0)
    air = time - memory.last_fused[_AIRSPEED] < _TIMEOUT and memory.fused[_AIRSPEED] > 0
    return bool(gps and (air or setup.is_calm))


@njit(cache=True)
def is_inferred(kind: int, time: float, x: Array, p: Array, setup: Setup, memory: Memory) -> bool:
    """Whether an angle without a vane is known well enough to be given."""
    if has_vane(kind, memory.fused, memory.rejected, memory.skipped) or not can_infer(time, setup, memory):
        return False
    g = air_data_gradient(kind, three(x[AIR_VELOCITY]))
    variance = 0.0
    for i in range(3):
        for j in range(3):
            variance += g[i] * p[D_AIR_VELOCITY + i, D_AIR_VELOCITY + j] * g[j]
    return bool(variance <= LARGEST_STD**2)


@njit(cache=True)
def assumption(kind: int, x: Array, h: Array) -> tuple[float, float]:
    """Residual and variance of a pseudo-measurement, and its row h (1, n): sideslip, or the vertical wind."""
    h[:] = 0.0
    v = x[AIR_VELOCITY]
    if kind == _BETA:
        g = air_data_gradient(kind, three(v))
        for i in range(3):
            h[0, D_AIR_VELOCITY + i] = g[i]
        return -np.arctan2(v[1], np.sqrt(v[0] * v[0] + v[2] * v[2])), SIDESLIP_STD**2
    return no_wind(2, x, h), VERTICAL_STD**2


@njit(cache=True)
def no_wind(axis: int, x: Array, h: Array) -> float:
    """Residual 0 - W of a component of the wind NED, and its row h (1, n), which is 0 but for that."""
    c, v = rotation_matrix(x[ATTITUDE]), x[AIR_VELOCITY]
    by_attitude = c @ cross_matrix(v)
    h[0, D_VELOCITY + axis] = 1.0
    for j in range(3):
        h[0, D_ATTITUDE + j] = by_attitude[axis, j]
        h[0, D_AIR_VELOCITY + j] = -c[axis, j]
    return float(-(x[axis] - (c[axis, 0] * v[0] + c[axis, 1] * v[1] + c[axis, 2] * v[2])))


@njit(cache=True)
def update_by(kind: int, x: Array, p: Array) -> Array:
    """Error (n,) by which a pseudo-measurement moves the state x; the covariance p (n, n), n >= 18, is updated."""
    h = np.empty((1, len(p)))
    residual, variance = assumption(kind, x, h)
    return _updated(x, p, h, residual, variance)


@njit(cache=True)
def hold_wind(axis: int, x: Array, p: Array, std: float, walk: float) -> Array:
    """The same for a component of a wind of ``std`` [m/s] about zero, with its random walk [m/s per sqrt(s)]."""
    h = np.zeros((1, len(p)))
    residual = no_wind(axis, x, h)
    return _updated(x, p, h, residual, std**4 / (max(walk, _LEAST_WALK) ** 2 * PERIOD))


@njit(cache=True)
def count_heading_from_now(x: Array, p: Array) -> None:
    """Turn north to where the estimate says that it is: covariance p (n, n) in place, the state x as it is.

    Where nothing shows the heading, turning velocity, position and attitude together about the vertical changes
    nothing that is measured: g = (e_z x v, e_z x p, C' e_z, 0 …). The error d becomes d - g (C' e_z)' d_attitude.
    An uncertain heading would bend what is known of the tilt, which the filter linearises.
    """
    n, c = len(p), rotation_matrix(x[ATTITUDE])
    g, across = np.zeros(n), np.zeros(n)
    for first in (0, 3):  # of velocity and position, in state and error
        g[first], g[first + 1] = -x[first + 1], x[first]
    total = 0.0
    for i in range(3):
        g[D_ATTITUDE + i] = c[2, i]
        for j in range(n):
            across[j] += c[2, i] * p[D_ATTITUDE + i, j]
    for i in range(3):
        total += c[2, i] * across[D_ATTITUDE + i]
    for i in range(n):
        for j in range(n):
            p[i, j] += g[i] * g[j] * total - g[i] * across[j] - across[i] * g[j]


@njit(cache=True)
def _updated(x: Array, p: Array, h: Array, residual: float, variance: float) -> Array:
    noise = np.full(1, variance)
    delta = linear_update(p, h, noise, np.full(1, residual))
    return delta if np.isfinite(delta[0]) else np.zeros(len(p))


@njit(cache=True)
def is_due(kind: int, time: float, setup: Setup, x: Array, memory: Memory) -> bool:
    """Whether the pseudo-measurement in place of the angle ``kind`` is to be made now."""
    if has_vane(kind, memory.fused, memory.rejected, memory.skipped):
        return False
    is_of_use = setup.guide == NO_GUIDE or can_infer(time, setup, memory)
    return bool(is_of_use and _flies(x, setup) and time - memory.assumed[kind] >= PERIOD)


@njit(cache=True)
def is_wind_due(time: float, setup: Setup, x: Array, memory: Memory) -> bool:
    """Whether the wind is one that is held, and is to be held now."""
    return bool(setup.wind_std[0] > 0.0 and time - memory.assumed[_GPS_VELOCITY] >= PERIOD and _flies(x, setup))


@njit(cache=True)
def _flies(x: Array, setup: Setup) -> bool:
    v = x[AIR_VELOCITY]
    return bool(v[0] * v[0] + v[1] * v[1] + v[2] * v[2] >= setup.minimum_airspeed**2)
