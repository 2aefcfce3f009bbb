"""Derivatives of the motion by the error of the state.

Forces and moments depend on attitude and wind only through the air-relative velocity u = C' (v - W), so that six
derivatives, by u and by the rates, carry the whole Jacobian:

    d(C f) = C (F_u du + F_w dw) - C [f x] d,   du = C' (dv - dW) + [u x] d,   d' = dw - omega x d,

with the attitude error d.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.flight_model.dynamics import (
    FLOW_RATE_PASSES,
    MINIMUM_AIRSPEED,
    add_solved,
    air_velocity_of,
    angular_acceleration,
    fill_flow_rates,
    fill_model_signals,
    inertia_of,
    motion_of,
    sum_terms,
)
from aircraft_sysid_ros.flight_model.layout import (
    D_ATTITUDE,
    D_POSITION,
    D_RATES,
    D_VELOCITY,
    D_WIND,
    DENSITY,
    ERROR_SIZE,
    SPEED_OF_SOUND,
    FlightModel,
    Vector,
)
from aircraft_sysid_ros.flight_model.term_gradients import DIRECTIONS, terms_and_gradients
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

_ALPHA, _BETA, _P, _Q, _R = (SIGNAL_INDEX[s] for s in ("alpha", "beta", "p", "q", "r"))
_TC, _V, _QBAR, _MACH = (SIGNAL_INDEX[s] for s in ("Tc", "V", "qbar", "mach"))
_ALPHA_DOT, _BETA_DOT = (SIGNAL_INDEX[s] for s in ("alpha_dot", "beta_dot"))


class Aerodynamics(NamedTuple):
    """What acts on the aeroplane, with derivatives by air-relative velocity and rates."""

    air_velocity: Array  # (3,) [m/s] body
    force: Array  # (3,) specific force at the centre of gravity [m/s^2]
    acceleration: Array  # (3,) angular acceleration [rad/s^2]
    force_slopes: Array  # (3, 6)
    acceleration_slopes: Array  # (3, 6)


@njit(cache=True, error_model="numpy")
def _fill_tangents(u: Array, rates: Array, signals: Array, model: FlightModel, inputs: Array, out: Array) -> None:
    """Derivatives (signals, 6) of the signals by u, v, w and p, q, r; those of the flow rates are left alone."""
    span, chord = model.geometry[1], model.geometry[2]
    speed = signals[_V]
    flying = 1.0 if u[0] * u[0] + u[1] * u[1] + u[2] * u[2] > MINIMUM_AIRSPEED**2 else 0.0
    uw2 = max(u[0] * u[0] + u[2] * u[2], MINIMUM_AIRSPEED**2)
    root, v2 = np.sqrt(uw2), uw2 + u[1] * u[1]
    out[_ALPHA, 0], out[_ALPHA, 2] = -u[2] / uw2, u[0] / uw2
    out[_BETA, 0], out[_BETA, 1], out[_BETA, 2] = -u[0] * u[1] / (v2 * root), root / v2, -u[2] * u[1] / (v2 * root)
    for j in range(3):
        by_speed = flying * u[j] / speed
        out[_V, j] = by_speed
        out[_QBAR, j] = inputs[DENSITY] * speed * by_speed
        out[_MACH, j] = by_speed / inputs[SPEED_OF_SOUND]
        out[_TC, j] = -2.0 * signals[_TC] / speed * by_speed
        out[_P, j] = -signals[_P] / speed * by_speed
        out[_Q, j] = -signals[_Q] / speed * by_speed
        out[_R, j] = -signals[_R] / speed * by_speed
    out[_P, 3] = out[_R, 5] = span / (2.0 * speed)
    out[_Q, 4] = chord / speed


@njit(cache=True, error_model="numpy")
def _slopes_of_motion(
    coefficients: Array,
    slopes: Array,
    signals: Array,
    qbar_slopes: Array,
    rates: Array,
    model: FlightModel,
    by_force: Array,
    by_acceleration: Array,
) -> None:
    """Derivatives (3, 6) of both accelerations from those of the coefficients (6, 6)."""
    area, span, chord = model.geometry[0], model.geometry[1], model.geometry[2]
    qbar = signals[_QBAR]
    force, out, load = np.empty(3), np.empty(3), np.empty(6)
    p, q, r = rates[0], rates[1], rates[2]
    xx, yy, zz, xz = inertia_of(model)
    for d in range(DIRECTIONS):
        for i in range(6):
            load[i] = area * (qbar_slopes[d] * coefficients[i] + qbar * slopes[i, d])
        for i in range(3):
            force[i] = load[i] / model.mass
            by_force[i, d] = force[i]
        angular_acceleration(span * load[3], chord * load[4], span * load[5], force, model, out)
        if d == 3:  # -d(omega x I omega): products of two rates
            add_solved(model, -q * xz, 2.0 * p * xz - r * (xx - zz), -q * (yy - xx), out)
        elif d == 4:
            add_solved(model, -(xz * p + zz * r) + r * yy, 0.0, -p * yy + (xx * p + xz * r), out)
        elif d == 5:
            add_solved(model, -q * (zz - yy), -2.0 * r * xz - p * (xx - zz), q * xz, out)
        for i in range(3):
            by_acceleration[i, d] = out[i]


@njit(cache=True, error_model="numpy")
def aerodynamics(x: Array, c: Array, inputs: Array, theta: Array, model: FlightModel) -> Aerodynamics:
    """Accelerations at a state and their derivatives; c = rotation_matrix of its attitude.

    The derivative of a flow rate by the direction of gravity is left out, a second-order part of a small term.
    """
    u, fall, rates = np.empty(3), np.empty(3), x[10:13]
    air_velocity_of(x, c, u)
    for i in range(3):
        fall[i] = c[2, i] * model.gravity
    signals, tangents = np.empty(SIGNAL_COUNT), np.zeros((SIGNAL_COUNT, DIRECTIONS))
    n = len(model.code_offsets) - 1
    terms, gradients = np.empty(n), np.empty((n, DIRECTIONS))
    coefficients, slopes = np.empty(6), np.empty((6, DIRECTIONS))
    force, acceleration = np.empty(3), np.empty(3)
    by_force, by_acceleration = np.empty((3, DIRECTIONS)), np.empty((3, DIRECTIONS))
    fill_model_signals(u, rates, inputs, model.geometry, signals)
    _fill_tangents(u, rates, signals, model, inputs, tangents)
    for i in range(FLOW_RATE_PASSES if model.has_flow_rates else 1):
        if i:
            fill_flow_rates(u, rates, force, fall, model.geometry, signals)
            _fill_flow_rate_tangents(u, rates, fall, force, by_force, model.geometry, signals, tangents)
        terms_and_gradients(model.code, model.code_offsets, signals, tangents, terms, gradients)
        sum_terms(terms, theta, model.axis_offsets, coefficients)
        for axis in range(6):
            for d in range(DIRECTIONS):
                slopes[axis, d] = 0.0
            for j in range(model.axis_offsets[axis], model.axis_offsets[axis + 1]):
                for d in range(DIRECTIONS):
                    slopes[axis, d] += theta[j] * gradients[j, d]
        motion_of(coefficients, signals, rates, model, force, acceleration)
        _slopes_of_motion(coefficients, slopes, signals, tangents[_QBAR], rates, model, by_force, by_acceleration)
    return Aerodynamics(u, force, acceleration, by_force, by_acceleration)


@njit(cache=True, error_model="numpy")
def _fill_flow_rate_tangents(
    u: Array,
    rates: Array,
    fall: Array,
    force: Array,
    by_force: Array,
    geometry: Vector,
    signals: Array,
    tangents: Array,
) -> None:
    """Derivatives of the flow rates by central differences in each direction, force moving along its slopes."""
    step = 1e-4
    row, moved_u, moved_rates, moved_force = signals.copy(), np.empty(3), np.empty(3), np.empty(3)
    for d in range(DIRECTIONS):
        difference = np.zeros(2)
        for sign in (1.0, -1.0):
            moved_u[:], moved_rates[:] = u, rates
            if d < 3:
                moved_u[d] += sign * step
            else:
                moved_rates[d - 3] += sign * step
            for i in range(3):
                moved_force[i] = force[i] + sign * step * by_force[i, d]
            row[_V] = max(np.sqrt(np.sum(moved_u * moved_u)), MINIMUM_AIRSPEED)
            fill_flow_rates(moved_u, moved_rates, moved_force, fall, geometry, row)
            difference[0] += sign * row[_ALPHA_DOT]
            difference[1] += sign * row[_BETA_DOT]
        tangents[_ALPHA_DOT, d] = difference[0] / (2.0 * step)
        tangents[_BETA_DOT, d] = difference[1] / (2.0 * step)


@njit(cache=True, error_model="numpy")
def _put_aerodynamic(a: Array, row: int, block: Array, c: Array, u: Array) -> None:
    """Rows of d(error)'/d(error) of something with derivatives (3, 6) by u and the rates."""
    for i in range(3):
        b0, b1, b2 = block[i, 0], block[i, 1], block[i, 2]
        for j in range(3):
            by_velocity = b0 * c[j, 0] + b1 * c[j, 1] + b2 * c[j, 2]
            a[row + i, D_VELOCITY + j] = by_velocity
            a[row + i, D_WIND + j] = -by_velocity
            a[row + i, D_RATES + j] = block[i, 3 + j]
        a[row + i, D_ATTITUDE] = b1 * u[2] - b2 * u[1]
        a[row + i, D_ATTITUDE + 1] = b2 * u[0] - b0 * u[2]
        a[row + i, D_ATTITUDE + 2] = b0 * u[1] - b1 * u[0]


@njit(cache=True, error_model="numpy")
def error_dynamics(x: Array, c: Array, air: Aerodynamics, out: Array) -> None:
    """A (15, 15) of d(error)/dt = A error at the state x, from its aerodynamics; ``out`` is all overwritten."""
    out[:] = 0.0
    f, rates = air.force, x[10:13]
    turned = np.empty((3, DIRECTIONS))
    for i in range(3):
        for d in range(DIRECTIONS):
            turned[i, d] = (
                c[i, 0] * air.force_slopes[0, d] + c[i, 1] * air.force_slopes[1, d] + c[i, 2] * air.force_slopes[2, d]
            )
    _put_aerodynamic(out, D_VELOCITY, turned, c, air.air_velocity)
    _put_aerodynamic(out, D_RATES, air.acceleration_slopes, c, air.air_velocity)
    for i in range(3):
        out[D_POSITION + i, D_VELOCITY + i] = 1.0
        out[D_ATTITUDE + i, D_RATES + i] = 1.0
        # - C [f x]
        out[D_VELOCITY + i, D_ATTITUDE] -= c[i, 1] * f[2] - c[i, 2] * f[1]
        out[D_VELOCITY + i, D_ATTITUDE + 1] -= c[i, 2] * f[0] - c[i, 0] * f[2]
        out[D_VELOCITY + i, D_ATTITUDE + 2] -= c[i, 0] * f[1] - c[i, 1] * f[0]
    p, q, r = rates[0], rates[1], rates[2]
    out[D_ATTITUDE, D_ATTITUDE + 1], out[D_ATTITUDE, D_ATTITUDE + 2] = r, -q
    out[D_ATTITUDE + 1, D_ATTITUDE], out[D_ATTITUDE + 1, D_ATTITUDE + 2] = -r, p
    out[D_ATTITUDE + 2, D_ATTITUDE], out[D_ATTITUDE + 2, D_ATTITUDE + 1] = q, -p


@njit(cache=True, error_model="numpy")
def transition(a: Array, dt: float, out: Array) -> None:
    """exp(A dt) (15, 15) to second order; the zero blocks of A are passed over."""
    for i in range(ERROR_SIZE):
        for j in range(ERROR_SIZE):
            out[i, j] = a[i, j] * dt
        for k in range(ERROR_SIZE):
            factor = 0.5 * dt * dt * a[i, k]
            if factor != 0.0:
                for j in range(ERROR_SIZE):
                    out[i, j] += factor * a[k, j]
        out[i, i] += 1.0
