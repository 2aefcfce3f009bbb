"""One measurement fused into the state: an iterated update with its gate."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.iterated_ekf import (
    move,
    settle_covariance,
    update_within,
    weigh,
)
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.air_data_errors import settle
from aircraft_sysid_ros.reconstruction.error_state import (
    jacobian_of,
    retract_into,
    turn_attitude_columns,
    turn_attitude_error,
)
from aircraft_sysid_ros.reconstruction.innovations import is_welcome, learns_from, note_what_is_left
from aircraft_sysid_ros.reconstruction.measurements import (
    air_velocity_at,
    outputs_of,
    residual_and_jacobian,
    variance_of_place,
)
from aircraft_sysid_ros.reconstruction.sensor_noise import (
    SCALE,
    believed_variance,
)
from aircraft_sysid_ros.reconstruction.state import ERROR_SIZE, Memory, Setup
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

_ATTITUDE, _GPS_POSITION = int(Kind.ATTITUDE), int(Kind.GPS_POSITION)
_AIRSPEED, _ALPHA, _BETA = int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP)


@njit(cache=True)
def measurement_variance(kind: int, values: Array, setup: Setup) -> Array:
    """Variance (3,): from the aircraft file if it says so, else from the message, else the default."""
    if setup.given[kind] or not (kind == _ATTITUDE or kind == _GPS_POSITION):
        return setup.variance[kind]
    variance = setup.variance[kind].copy()
    first = 4 if kind == _ATTITUDE else 3  # where ATTITUDE and GPS_POSITION carry theirs
    for i in range(3):
        if values[first + i] > 0.0:
            variance[i] = believed_variance(values[first + i], variance[i])
    return variance


@njit(inline="always")  # the setup is handed over array by array otherwise
def _variance_in_use(kind: int, base: Array, setup: Setup, noise: Array) -> Array:
    """The same (3,) with what the flight has shown of the sensor, unless the aircraft file says its noise."""
    variance = base.copy()
    if not setup.given[kind]:
        for i in range(3):
            variance[i] *= noise[kind, i, SCALE]
    return variance


@njit(cache=True)
def is_finite(values: Array) -> bool:
    """Whether all of the numbers (n,) are; counted, which the machine does several at a time."""
    wrong = 0
    for value in values:
        wrong += 0 if np.isfinite(value) else 1
    return wrong == 0


@njit(cache=True)
def fuse(kind: int, values: Array, x: Array, p: Array, rate: Array, time: float, setup: Setup, memory: Memory) -> None:
    """One measurement update (3.15)-(3.18) on the state x and p, in place, with its gate.

    x (19,), p (18, 18), or x (25,), p (24, 24) with errors of the air data.
    """
    n = len(p)
    update = update_within(memory.working, outputs_of(kind), n)
    h, delta, residual, eta = update.h, update.delta, memory.residual[: outputs_of(kind)], memory.eta[: len(x)]
    eta[:] = x
    base = measurement_variance(kind, values, setup)
    noise, learns = _variance_in_use(kind, base, setup, memory.noise), False
    variance = noise + variance_of_place(kind, x, rate, setup)
    # with errors of the air data as states an update is one of what they show, in which they are linear
    is_linear = n > ERROR_SIZE and (kind == _AIRSPEED or kind == _ALPHA or kind == _BETA)
    for iteration in range(1 if is_linear else setup.maximum_iterations):
        count = residual_and_jacobian(kind, values, eta, rate, setup, residual, h)
        if count == 0 or not is_finite(residual):
            memory.skipped[kind] += 1
            return
        if iteration > 0:  # (3.15): the residual at eta is referred back to the prediction
            turn_attitude_columns(h, jacobian_of(delta))
        for i in range(count):
            total = residual[i]
            for k in range(n):
                total += h[i, k] * delta[k]
            residual[i] = total
        if not weigh(p, variance, update):
            memory.skipped[kind] += 1
            return
        if iteration == 0:
            learns = learns_from(kind, values, base, x, setup, memory)
            if not is_welcome(kind, time, x, residual, update, noise, base, learns, setup, memory):
                return
        change = move(p, residual, update)
        retract_into(x, delta, eta)
        if change <= setup.tolerance:
            break
    for k in range(n):
        memory.moved[-1, k] += delta[k]
    note_what_is_left(kind, residual, update, learns, memory)
    settle_covariance(p, variance, update)
    # from the error about the predicted attitude to that about the updated one
    turn_attitude_error(p, jacobian_of(delta))
    if n > ERROR_SIZE:
        settle(air_velocity_at(x, rate, setup.probe_from_imu), x, delta, eta, p)
    x[:] = eta
    memory.last_fused[kind] = time
