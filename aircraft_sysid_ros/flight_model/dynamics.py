"""f(x, u, theta) of the aircraft, (6.8)-(6.19) of docs/references.md, and one Runge-Kutta step.

Below MINIMUM_AIRSPEED the speed in denominators is held there: no state is singular.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import quaternion_product, rotation_matrix
from aircraft_sysid_ros.aircraft.postfix import evaluate_terms
from aircraft_sysid_ros.aircraft.signals import MOST_INPUTS, SIGNAL_COUNT, SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.flight_model.layout import (
    ATTITUDE,
    CONTROL_COUNT,
    D_ATTITUDE,
    D_POSITION,
    D_RATES,
    D_VELOCITY,
    D_WIND,
    DENSITY,
    HEIGHT,
    INPUT_SIZE,
    NAMED,
    SPEED_OF_SOUND,
    STATE_SIZE,
    TIME,
    FlightModel,
    Vector,
)
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

MINIMUM_AIRSPEED = 0.1  # [m/s]
#: Flow rates depend on the forces that they cause: so many passes leave nothing of a 5 % coupling.
FLOW_RATE_PASSES = 5
_ALPHA, _BETA, _P, _Q, _R = (SIGNAL_INDEX[s] for s in ("alpha", "beta", "p", "q", "r"))
_DE, _DA, _DR, _FLAPS = (SIGNAL_INDEX[s] for s in ("de", "da", "dr", "flaps"))
_TC, _THROTTLE, _PROPELLER = (SIGNAL_INDEX[s] for s in ("Tc", "throttle", "propeller_speed"))
_V, _QBAR, _MACH, _HEIGHT = (SIGNAL_INDEX[s] for s in ("V", "qbar", "mach", "height"))
_ALPHA_DOT, _BETA_DOT, _TIME = (SIGNAL_INDEX[s] for s in ("alpha_dot", "beta_dot", "time"))
_FIRST_INPUT, _NAMED = len(SIGNALS), NAMED.start


@njit(cache=True, error_model="numpy")
def air_velocity_of(x: Array, c: Array, out: Array) -> None:
    """u = C' (v - W), (3,) [m/s], for the state x (16,) and C = rotation_matrix of its attitude."""
    a, b, d = x[0] - x[13], x[1] - x[14], x[2] - x[15]
    for i in range(3):
        out[i] = c[0, i] * a + c[1, i] * b + c[2, i] * d


@njit(cache=True, error_model="numpy")
def fill_model_signals(u: Array, rates: Array, inputs: Array, geometry: Vector, out: Array) -> float:
    """Row of SIGNALS without the flow rates, from air velocity and rates, each (3,); returns the airspeed."""
    area, span, chord = geometry[0], geometry[1], geometry[2]
    speed = max(np.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]), MINIMUM_AIRSPEED)
    qbar = 0.5 * inputs[DENSITY] * speed * speed
    out[_ALPHA] = np.arctan2(u[2], u[0])
    out[_BETA] = np.arctan2(u[1], np.sqrt(u[0] * u[0] + u[2] * u[2]))
    out[_P] = rates[0] * span / (2.0 * speed)
    out[_Q] = rates[1] * chord / speed
    out[_R] = rates[2] * span / (2.0 * speed)
    out[_DE], out[_DA], out[_DR], out[_FLAPS] = inputs[0], inputs[1], inputs[2], inputs[3]
    out[_THROTTLE], out[_PROPELLER] = inputs[4], inputs[6]
    out[_TC] = inputs[5] / (qbar * area)
    out[_V], out[_QBAR], out[_MACH] = speed, qbar, speed / inputs[SPEED_OF_SOUND]
    out[_HEIGHT], out[_TIME] = inputs[HEIGHT], inputs[TIME]
    out[_ALPHA_DOT] = out[_BETA_DOT] = 0.0
    for k in range(MOST_INPUTS):
        out[_FIRST_INPUT + k] = inputs[_NAMED + k]
    return speed


@njit(cache=True, error_model="numpy")
def motion_of(
    coefficients: Array, signals: Array, rates: Array, model: FlightModel, force: Array, acceleration: Array
) -> None:
    """Specific force and angular acceleration of C_X … C_n (6,): (6.14)-(6.19), moment reference included."""
    scale = signals[_QBAR] * model.geometry[0]
    span, chord = model.geometry[1], model.geometry[2]
    for i in range(3):
        force[i] = scale * coefficients[i] / model.mass
    angular_acceleration(
        scale * span * coefficients[3],
        scale * chord * coefficients[4],
        scale * span * coefficients[5],
        force,
        model,
        acceleration,
    )
    p, q, r = rates[0], rates[1], rates[2]
    xx, yy, zz, xz = inertia_of(model)
    hx, hy, hz = xx * p + xz * r, yy * q, xz * p + zz * r
    add_solved(model, -(q * hz - r * hy), -(r * hx - p * hz), -(p * hy - q * hx), acceleration)


@njit(cache=True, error_model="numpy")
def angular_acceleration(
    l: float,  # noqa: E741
    m: float,
    n: float,
    force: Array,
    model: FlightModel,
    out: Array,
) -> None:
    """I^-1 (M + r x m f), (3,), of a moment about the aerodynamic reference and a specific force."""
    x, y, z = model.reference[0], model.reference[1], model.reference[2]
    mass = model.mass
    out[0] = out[1] = out[2] = 0.0
    add_solved(
        model,
        l + mass * (y * force[2] - z * force[1]),
        m + mass * (z * force[0] - x * force[2]),
        n + mass * (x * force[1] - y * force[0]),
        out,
    )


@njit(cache=True, error_model="numpy")
def inertia_of(model: FlightModel) -> tuple[float, float, float, float]:
    """The elements xx, yy, zz and xz of the matrix of (6.19), the last with its sign there."""
    return model.inertia[0], model.inertia[1], model.inertia[2], -model.inertia[3]


@njit(cache=True, error_model="numpy")
def add_solved(model: FlightModel, a: float, b: float, c: float, out: Array) -> None:
    """out += I^-1 (a, b, c) for the inertia of (6.19)."""
    xx, yy, zz, xz = inertia_of(model)
    determinant = xx * zz - xz * xz
    out[0] += (zz * a - xz * c) / determinant
    out[1] += b / yy
    out[2] += (xx * c - xz * a) / determinant


@njit(cache=True, error_model="numpy")
def sum_terms(terms: Array, theta: Array, offsets: npt.NDArray[np.int64], out: Array) -> None:
    """C_X … C_n into out (6,) from the terms (p,) and theta, whose first p numbers are their parameters."""
    for axis in range(6):
        total = 0.0
        for j in range(offsets[axis], offsets[axis + 1]):
            total += terms[j] * theta[j]
        out[axis] = total


@njit(cache=True, error_model="numpy")
def fill_flow_rates(u: Array, rates: Array, force: Array, fall: Array, geometry: Vector, signals: Array) -> None:
    """alpha_dot c/V and beta_dot b/2V from (6.16)-(6.18), for steady wind; ``fall`` is gravity in body axes."""
    a = force[0] + fall[0] - rates[1] * u[2] + rates[2] * u[1]
    b = force[1] + fall[1] - rates[2] * u[0] + rates[0] * u[2]
    c = force[2] + fall[2] - rates[0] * u[1] + rates[1] * u[0]
    ahead2 = max(u[0] * u[0] + u[2] * u[2], MINIMUM_AIRSPEED**2)
    ahead, speed = np.sqrt(ahead2), signals[_V]
    signals[_ALPHA_DOT] = (u[0] * c - u[2] * a) / ahead2 * geometry[2] / speed
    along = (u[0] * a + u[2] * c) / ahead
    signals[_BETA_DOT] = (ahead * b - u[1] * along) / (speed * speed) * geometry[1] / (2.0 * speed)


@njit(cache=True, error_model="numpy")
def accelerations(
    u: Array,
    rates: Array,
    fall: Array,
    inputs: Array,
    theta: Array,
    model: FlightModel,
    force: Array,
    acceleration: Array,
) -> None:
    """Specific force at the centre of gravity and angular acceleration, each (3,), into the last two arguments."""
    signals = np.empty(SIGNAL_COUNT)
    terms = np.empty(len(model.code_offsets) - 1)
    coefficients = np.empty(6)
    fill_model_signals(u, rates, inputs, model.geometry, signals)
    for i in range(FLOW_RATE_PASSES if model.has_flow_rates else 1):
        if i:
            fill_flow_rates(u, rates, force, fall, model.geometry, signals)
        evaluate_terms(model.code, model.code_offsets, signals, terms)
        sum_terms(terms, theta, model.axis_offsets, coefficients)
        motion_of(coefficients, signals, rates, model, force, acceleration)


@njit(cache=True, error_model="numpy")
def derivative(x: Array, inputs: Array, theta: Array, model: FlightModel, out: Array) -> None:
    """x' (16,) without noise, for a state x (16,), inputs (INPUT_SIZE,) and parameters theta: (6.6)."""
    c = rotation_matrix(x[ATTITUDE])
    u, force, acceleration, fall = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    air_velocity_of(x, c, u)
    rates = x[10:13]
    for i in range(3):
        fall[i] = c[2, i] * model.gravity
    accelerations(u, rates, fall, inputs, theta, model, force, acceleration)
    for i in range(3):
        out[i] = c[i, 0] * force[0] + c[i, 1] * force[1] + c[i, 2] * force[2]
        out[3 + i] = x[i]
        out[10 + i] = acceleration[i]
        out[13 + i] = 0.0
    out[2] += model.gravity
    w, a, b, d = x[6], x[7], x[8], x[9]
    p, q, r = rates[0], rates[1], rates[2]
    out[6] = 0.5 * (-a * p - b * q - d * r)
    out[7] = 0.5 * (w * p + b * r - d * q)
    out[8] = 0.5 * (w * q + d * p - a * r)
    out[9] = 0.5 * (w * r + a * q - b * p)


@njit(cache=True, error_model="numpy")
def propagate_mean(x: Array, inputs0: Array, inputs1: Array, dt: float, theta: Array, model: FlightModel) -> None:
    """Advance x (16,) by dt [s] in place: Runge-Kutta of fourth order.

    Inputs are linear between both ends, and controls quadratic where inputs1 holds those of the middle as well.
    """
    middle = 0.5 * (inputs0 + inputs1)
    if len(inputs1) > INPUT_SIZE:
        middle[:CONTROL_COUNT] = inputs1[INPUT_SIZE : INPUT_SIZE + CONTROL_COUNT]
        middle[_NAMED : _NAMED + MOST_INPUTS] = inputs1[INPUT_SIZE + CONTROL_COUNT :]
    slope, total, stage = np.empty(STATE_SIZE), np.empty(STATE_SIZE), np.empty(STATE_SIZE)
    derivative(x, inputs0, theta, model, total)
    stage[:] = x + 0.5 * dt * total
    for k in range(1, 4):
        derivative(stage, inputs1 if k == 3 else middle, theta, model, slope)
        weight, ahead = (1.0, 0.0) if k == 3 else (2.0, 0.5 * dt if k == 1 else dt)
        for i in range(STATE_SIZE):
            total[i] += weight * slope[i]
            stage[i] = x[i] + ahead * slope[i]
    for i in range(STATE_SIZE):
        x[i] += dt / 6.0 * total[i]
    norm = np.sqrt(x[6] * x[6] + x[7] * x[7] + x[8] * x[8] + x[9] * x[9])
    for i in range(6, 10):
        x[i] /= norm


@njit(cache=True, error_model="numpy")
def move(x: Array, error: Array) -> None:
    """Add an error (15,) to the state (16,), in place."""
    for i in range(3):
        x[i] += error[D_VELOCITY + i]
        x[3 + i] += error[D_POSITION + i]
        x[10 + i] += error[D_RATES + i]
        x[13 + i] += error[D_WIND + i]
    v = error[D_ATTITUDE : D_ATTITUDE + 3]
    angle = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    s = 0.5 - angle * angle / 48.0 if angle < 1e-5 else np.sin(0.5 * angle) / angle
    turned = quaternion_product(x[ATTITUDE], np.array([np.cos(0.5 * angle), s * v[0], s * v[1], s * v[2]]))
    norm = np.sqrt(np.sum(turned * turned))
    for i in range(4):
        x[6 + i] = turned[i] / norm
