"""An aircraft without vanes: what is assumed in place of a measured angle of attack and sideslip.

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
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft.frames import cross_matrix, rotation_matrix, three
from aircraft_sysid_ros.estimation.iterated_ekf import linear_update
from aircraft_sysid_ros.reconstruction.measurements import air_data_gradient
from aircraft_sysid_ros.reconstruction.state import (
    AIR_VELOCITY,
    ATTITUDE,
    D_AIR_VELOCITY,
    D_ATTITUDE,
    D_VELOCITY,
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
_GPS_VELOCITY = int(Kind.GPS_VELOCITY)
_TIMEOUT = 2.0  # [s] as of a sensor that is lost


@njit(cache=True)
def has_vane(kind: int, fused: Integers, rejected: Integers, skipped: Integers) -> bool:
    """Whether a vane for the angle has ever spoken in this flight, by the counts of ``Memory``, each (kinds,)."""
    return bool(fused[kind] + rejected[kind] + skipped[kind] > 0)


@njit(cache=True)
def lacks_vane(fused: Integers, rejected: Integers, skipped: Integers) -> bool:
    """Whether there is an angle for which ``has_vane`` does not hold."""
    return not (has_vane(_ALPHA, fused, rejected, skipped) and has_vane(_BETA, fused, rejected, skipped))


@njit(cache=True)
def can_infer(time: float, memory: Memory) -> bool:
    """Whether GPS and airspeed are there, without which the wind says nothing about the angles."""
    gps = time - memory.last_fused[_GPS_VELOCITY] < _TIMEOUT
    return bool(gps and time - memory.last_fused[_AIRSPEED] < _TIMEOUT and memory.fused[_AIRSPEED] > 0)


@njit(cache=True)
def is_inferred(kind: int, time: float, x: Array, p: Array, memory: Memory) -> bool:
    """Whether an angle without a vane is known well enough to be given."""
    if has_vane(kind, memory.fused, memory.rejected, memory.skipped) or not can_infer(time, memory):
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
    c = rotation_matrix(x[ATTITUDE])
    by_attitude = c @ cross_matrix(v)
    h[0, D_VELOCITY + 2] = 1.0
    for j in range(3):
        h[0, D_ATTITUDE + j] = by_attitude[2, j]
        h[0, D_AIR_VELOCITY + j] = -c[2, j]
    return -(x[2] - (c[2, 0] * v[0] + c[2, 1] * v[1] + c[2, 2] * v[2])), VERTICAL_STD**2


@njit(cache=True)
def update_by(kind: int, x: Array, p: Array) -> Array:
    """Error (n,) by which a pseudo-measurement moves the state x; the covariance p (n, n), n >= 18, is updated."""
    h = np.empty((1, len(p)))
    residual, variance = assumption(kind, x, h)
    noise = np.full(1, variance)
    delta = linear_update(p, h, noise, np.full(1, residual))
    return delta if np.isfinite(delta[0]) else np.zeros(len(p))


@njit(cache=True)
def is_due(kind: int, time: float, setup: Setup, x: Array, memory: Memory) -> bool:
    """Whether the pseudo-measurement in place of the angle ``kind`` is to be made now."""
    if has_vane(kind, memory.fused, memory.rejected, memory.skipped) or not can_infer(time, memory):
        return False
    v = x[AIR_VELOCITY]
    flying = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] >= setup.minimum_airspeed**2
    return bool(flying and time - memory.assumed[kind] >= PERIOD)
