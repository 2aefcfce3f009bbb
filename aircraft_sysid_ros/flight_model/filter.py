"""One step of the extended Kalman filter (3.10)-(3.14), docs/references.md, of the flight model, or of its simulation.

The mean is advanced by Runge-Kutta, the covariance by exp(A dt). The outputs present at a time are fused one after
the other with the derivatives at the prediction, R being diagonal: output i has then the innovation

    e_i = y_i - h_i(x) - H_i dx,   s_i = H_i P H_i' + R_i,

dx and P those after the outputs before it. e = L (y - h(x)) with the unit lower factor L of the innovation
covariance, so that all e_i are independent, and sum (e_i^2 / s_i + ln s_i) is the term of (5.7). A step without
process noise from P = 0 is a simulation; ``simulation_step`` is that without the covariance.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.flight_model.derivatives import aerodynamics, error_dynamics, transition
from aircraft_sysid_ros.flight_model.dynamics import accelerations, air_velocity_of, move, propagate_mean
from aircraft_sysid_ros.flight_model.layout import (
    ATTITUDE,
    ATTITUDE_VECTOR,
    D_RATES,
    D_WIND,
    ERROR_SIZE,
    GROUP_OF_OUTPUT,
    OUTPUT_SIZE,
    TAIL,
    FlightModel,
)
from aircraft_sysid_ros.flight_model.outputs import output_jacobian, outputs
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def output_variance(theta: Array, model: FlightModel, out: Array) -> None:
    """Diagonal of R (18,)."""
    first = len(theta) - TAIL + 9
    for i in range(OUTPUT_SIZE):
        std = model.output_std[i] * np.exp(theta[first + GROUP_OF_OUTPUT[i]])
        out[i] = std * std


@njit(cache=True, error_model="numpy")
def _add_process_noise(p: Array, dt: float, theta: Array) -> None:
    """Add the random walks of wind and rates over dt [s] to the covariance (15, 15)."""
    first = len(theta) - TAIL + 6
    horizontal, vertical = np.exp(2.0 * theta[first]) * dt, np.exp(2.0 * theta[first + 1]) * dt
    rates = np.exp(2.0 * theta[first + 2]) * dt
    p[D_WIND, D_WIND] += horizontal
    p[D_WIND + 1, D_WIND + 1] += horizontal
    p[D_WIND + 2, D_WIND + 2] += vertical
    for i in range(3):
        p[D_RATES + i, D_RATES + i] += rates


@njit(cache=True, error_model="numpy")
def _propagate_covariance(p: Array, phi: Array, product: Array) -> None:
    """P = Phi P Phi' in place, symmetric to the last bit; the zeros of Phi are passed over."""
    for i in range(ERROR_SIZE):
        for j in range(ERROR_SIZE):
            product[i, j] = 0.0
        for k in range(ERROR_SIZE):
            factor = phi[i, k]
            if factor != 0.0:
                for j in range(ERROR_SIZE):
                    product[i, j] += factor * p[k, j]
    for i in range(ERROR_SIZE):
        for j in range(i + 1):
            total = 0.0
            for k in range(ERROR_SIZE):
                total += product[i, k] * phi[j, k]
            p[i, j] = total
            p[j, i] = total


@njit(cache=True, error_model="numpy")
def _fuse(
    p: Array, h: Array, y: Array, predicted: Array, noise: Array, error: Array, innovation: Array, variance: Array
) -> None:
    """All outputs present, one after the other; fills the error of the state (15,) and changes p."""
    ph = np.empty(ERROR_SIZE)
    error[:] = 0.0
    for i in range(OUTPUT_SIZE):
        innovation[i] = variance[i] = np.nan
        if np.isnan(y[i]):
            continue
        e, s = y[i] - predicted[i], noise[i]
        ph[:] = 0.0
        for k in range(ERROR_SIZE):
            factor = h[i, k]
            if factor != 0.0:
                e -= factor * error[k]
                for j in range(ERROR_SIZE):
                    ph[j] += factor * p[k, j]
        for k in range(ERROR_SIZE):
            s += h[i, k] * ph[k]
        innovation[i], variance[i] = e, s
        root = np.sqrt(s)
        for j in range(ERROR_SIZE):
            ph[j] /= root
            error[j] += ph[j] / root * e
        for j in range(ERROR_SIZE):
            for k in range(ERROR_SIZE):
                p[j, k] -= ph[j] * ph[k]  # the same product on both sides: stays symmetric


@njit(cache=True, nogil=True, error_model="numpy")
def filter_step(
    x: Array,
    p: Array,
    inputs0: Array,
    inputs1: Array,
    dt: float,
    y: Array,
    theta: Array,
    model: FlightModel,
    innovation: Array,
    variance: Array,
) -> None:
    """Predict over dt [s] and fuse the outputs y (18,) at its end; x (16,) and p (15, 15) change in place.

    inputs0, inputs1 (INPUT_SIZE,) at begin and end, linear between. dt = 0: fuse only. Writes the decorrelated
    innovation (18,) and its variance (18,), NaN where y is NaN.
    """
    if dt > 0.0:
        propagate_mean(x, inputs0, inputs1, dt, theta, model)
    c = rotation_matrix(x[ATTITUDE])
    air = aerodynamics(x, c, inputs1, theta, model)
    if dt > 0.0:
        a, phi = np.empty((ERROR_SIZE, ERROR_SIZE)), np.empty((ERROR_SIZE, ERROR_SIZE))
        error_dynamics(x, c, air, a)
        transition(a, dt, phi)
        _add_process_noise(p, 0.5 * dt, theta)  # half before and half after: noise acts all along the step
        _propagate_covariance(p, phi, a)
        _add_process_noise(p, 0.5 * dt, theta)
    predicted, h = np.empty(OUTPUT_SIZE), np.empty((OUTPUT_SIZE, ERROR_SIZE))
    noise, error = np.empty(OUTPUT_SIZE), np.empty(ERROR_SIZE)
    biases = theta[len(theta) - TAIL : len(theta) - TAIL + 6]
    outputs(x, c, air.force, air.acceleration, air.air_velocity, inputs1, biases, model, predicted)
    output_jacobian(x, c, air, predicted[ATTITUDE_VECTOR : ATTITUDE_VECTOR + 3], model, h)
    output_variance(theta, model, noise)
    _fuse(p, h, y, predicted, noise, error, innovation, variance)
    move(x, error)


@njit(cache=True, nogil=True, error_model="numpy")
def model_outputs(x: Array, inputs: Array, theta: Array, model: FlightModel, out: Array) -> None:
    """Outputs (18,) of a state x (16,): (6.7)."""
    c = rotation_matrix(x[ATTITUDE])
    u, fall, force, acceleration = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    air_velocity_of(x, c, u)
    for i in range(3):
        fall[i] = c[2, i] * model.gravity
    accelerations(u, x[10:13], fall, inputs, theta, model, force, acceleration)
    biases = theta[len(theta) - TAIL : len(theta) - TAIL + 6]
    outputs(x, c, force, acceleration, u, inputs, biases, model, out)


@njit(cache=True, nogil=True, error_model="numpy")
def simulation_step(
    x: Array, inputs0: Array, inputs1: Array, dt: float, theta: Array, model: FlightModel, out: Array
) -> None:
    """Predict x (16,) over dt [s] in place, without noise, and write its outputs (18,)."""
    if dt > 0.0:
        propagate_mean(x, inputs0, inputs1, dt, theta, model)
    model_outputs(x, inputs1, theta, model, out)
