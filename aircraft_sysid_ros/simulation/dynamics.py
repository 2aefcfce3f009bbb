"""Six degrees of freedom of one aeroplane whose aerodynamics are those of its file: (6.8)-(6.19), docs/references.md.

The velocity over ground is the state and the air-relative velocity follows from it with the wind, so that the
motion is right while the wind changes, which (6.16)-(6.18) with air-relative u, v, w are not.
Thrust reaches the aeroplane only through the terms that hold T_c, so that every coefficient is known exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft import atmosphere, rigid_body
from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel, model_from_terms, term_label
from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.frames import (
    Matrix,
    Vector,
    air_data_from_velocity,
    applied,
    rotation,
    three,
    transposed,
    turned,
)
from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.aircraft.postfix import STACK_SIZE, evaluate_program, evaluate_programs
from aircraft_sysid_ros.aircraft.signals import FIRST_LAG, SIGNAL_COUNT, SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.aircraft.term_values import link
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

# Layout of the state: position, velocity over ground [NED], quaternion, rates, actual controls.
POSITION, VELOCITY, ATTITUDE, RATES, CONTROLS = 0, 3, 6, 10, 13
STATE_SIZE = 17  # and the lags that the aerodynamics has
# Controls of the state and of commands: elevator, aileron, rudder [rad], throttle 0..1.
DEFLECTION_LIMIT = np.radians(25.0)
#: First-order lags of usual servos and of the motor [1/s].
ACTUATOR_RATES = np.array([20.0, 20.0, 20.0, 5.0])

_ALPHA, _BETA, _P, _Q, _R = (SIGNAL_INDEX[name] for name in ("alpha", "beta", "p", "q", "r"))
_DE, _DA, _DR, _FLAPS = (SIGNAL_INDEX[name] for name in ("de", "da", "dr", "flaps"))
_TC, _THROTTLE, _PROPELLER = (SIGNAL_INDEX[name] for name in ("Tc", "throttle", "propeller_speed"))
_V, _QBAR, _MACH, _HEIGHT = (SIGNAL_INDEX[name] for name in ("V", "qbar", "mach", "height"))
_ALPHA_DOT, _BETA_DOT, _TIME = (SIGNAL_INDEX[name] for name in ("alpha_dot", "beta_dot", "time"))
_INPUTS = len(SIGNALS)
#: Named inputs swing by so many times their noise, at a rate and at this multiple of it.
_SWING, _SECOND_RATE = 30.0, 1.618
#: Shortest lag [s] that the steps of the simulation follow.
SHORTEST_LAG = 0.02
#: The flow rates depend on the forces that they cause: so many passes leave nothing of a 5 % coupling.
_FLOW_RATE_PASSES = 6


@dataclass(frozen=True)
class Effect:
    """One more term of the true aerodynamics: ``C_axis += value * expression``."""

    axis: str
    expression: str
    value: float


class Airframe(NamedTuple):
    """What the jitted loop needs of an aeroplane; SI."""

    mass: float
    wing_area: float
    span: float
    chord: float
    inertia: Array  # (3, 3)
    reference: Array  # (3,) aerodynamic reference from the centre of gravity
    code: Array  # all terms, linked
    term_offsets: npt.NDArray[np.int64]
    axis_offsets: npt.NDArray[np.int64]  # (7,)
    parameters: npt.NDArray[np.float64]
    has_flow_rates: bool  # a term reads alpha_dot or beta_dot
    static_thrust: float  # [N] at full throttle
    pitch_speed: float  # [m/s] airspeed without thrust
    propeller_speed: float  # [rad/s] at full throttle
    actuator_rates: Array  # (4,) [1/s]
    lag_code: Array  # what its lags follow, linked
    lag_offsets: npt.NDArray[np.int64]
    lag_times: Array  # (lags,) [s]
    lag_rates: Array  # (lags,) most that they change by in a second
    inputs: Array  # (k, 3) middle, swing [SI] and rate [rad/s] of the two sines that each named input follows


class Place(NamedTuple):
    """Constant gravity [m/s^2], altitude of the NED origin and of the ground [m], and the flaps [rad]."""

    gravity: float
    altitude: float
    ground: float
    flaps: float = 0.0


class Motion(NamedTuple):
    """What acts on the aeroplane at one instant."""

    coefficients: Array  # (6,)
    specific_force: Array  # (3,) [m/s^2] body
    angular_acceleration: Array  # (3,) [rad/s^2]
    air_velocity: Array  # (3,) [m/s] body
    signals: Array  # (SIGNAL_COUNT,) signal row
    thrust: float  # [N]


def _actuator_rates(aircraft: Aircraft) -> Array:
    """Those of the servos that the file has, or usual ones."""
    lag, rates = aircraft.sensors["control_surfaces"].lag, ACTUATOR_RATES.copy()
    if lag > 0.0:
        rates[:3] = 1.0 / lag
    return rates


def trim_airspeed_of(aircraft: Aircraft) -> float:
    """Airspeed [m/s] of simulated flights: that of the file, or the one at a lift coefficient of 0.4."""
    wing_loading = aircraft.mass * STANDARD_GRAVITY / aircraft.wing_area
    return aircraft.trim_airspeed or float(np.sqrt(2.0 * wing_loading / (1.225 * 0.4)))


def airframe_of(aircraft: Aircraft, effects: Sequence[Effect] = ()) -> Airframe:
    """Airframe of an aircraft file with hidden effects; InputError names coefficients that the file lacks."""
    model, values = with_effects(aircraft.model, aircraft.coefficients, effects)
    missing = [name for name in model.parameter_names if name not in values]
    if missing:
        raise InputError(
            f"aircraft '{aircraft.name}' cannot be simulated: its file lacks the coefficients {' '.join(missing)}"
        )
    if any(lag.tau < SHORTEST_LAG and np.isinf(lag.rate) for lag in model.lags):
        raise InputError(f"the simulator follows lags of {SHORTEST_LAG:g} s and longer: write the static term")
    code, term_offsets = model.linked
    lag_code, lag_offsets = link([lag.program for lag in model.lags])
    return Airframe(
        aircraft.mass, aircraft.wing_area, aircraft.span, aircraft.chord,
        np.ascontiguousarray(aircraft.inertia), aircraft.aerodynamic_reference.copy(),
        code, term_offsets, model.offsets, np.array([values[name] for name in model.parameter_names]),
        bool({"alpha_dot", "beta_dot"} & model.signals_used),
        static_thrust=0.6 * aircraft.mass * STANDARD_GRAVITY,
        pitch_speed=2.2 * trim_airspeed_of(aircraft),
        propeller_speed=80.0 * trim_airspeed_of(aircraft) / aircraft.span,
        actuator_rates=_actuator_rates(aircraft),
        lag_code=lag_code,
        lag_offsets=lag_offsets,
        lag_times=np.array([max(lag.tau, SHORTEST_LAG) for lag in model.lags]),
        lag_rates=np.array([lag.rate for lag in model.lags]),
        inputs=np.array([_moved(k, item) for k, item in enumerate(aircraft.inputs)]).reshape(-1, 3),
    )  # fmt: skip


def _moved(number: int, item: NamedInput) -> tuple[float, float, float]:
    """Middle, swing and rate of a named input: about 0 as far as its limits allow, each at a rate of its own."""
    low, high = item.limits
    swing = min(_SWING * item.noise, 0.5 * (high - low))
    return min(max(0.0, low + swing), high - swing), swing, 2.0 * np.pi * 0.23 * 1.25**number


def with_effects(
    model: AerodynamicModel, coefficients: dict[str, float], effects: Sequence[Effect]
) -> tuple[AerodynamicModel, dict[str, float]]:
    """Model and coefficients with the terms of the effects; a term that is there has its value raised."""
    terms = {axis: list(listed) for axis, listed in model.terms.items()}
    values = dict(coefficients)
    for effect in effects:
        text = parse_expression(effect.expression, model.inputs).text
        if effect.axis not in terms:
            raise InputError(f"the effect names the axis '{effect.axis}': the axes are {' '.join(terms)}")
        name = f"{effect.axis}_{term_label(text)}"
        if text not in terms[effect.axis]:
            terms[effect.axis].append(text)
            values[name] = 0.0
        values[name] = values.get(name, 0.0) + effect.value
    return model_from_terms(terms, model.inputs), values


@njit(cache=True)
def thrust_of(airframe: Airframe, throttle: float, airspeed: float) -> float:
    """Thrust [N] of a fixed propeller: proportional to throttle, falling to nothing at its pitch speed."""
    return airframe.static_thrust * throttle * (1.0 - airspeed / airframe.pitch_speed)


@njit(cache=True)
def _put_signals(airframe: Airframe, place: Place, state: Array, air: Vector, time: float, out: Array) -> float:
    """Fill in a signal row (SIGNAL_COUNT,) but for the flow rates, of an air-relative velocity; returns thrust [N]."""
    out[:] = 0.0
    speed, alpha, beta = air_data_from_velocity(air)
    altitude = place.altitude - state[POSITION + 2]
    throttle = state[CONTROLS + 3]
    thrust = thrust_of(airframe, throttle, speed)
    qbar = 0.5 * atmosphere.air_density(altitude) * speed * speed
    out[_ALPHA], out[_BETA] = alpha, beta
    out[_P] = state[RATES] * airframe.span / (2.0 * speed)
    out[_Q] = state[RATES + 1] * airframe.chord / speed
    out[_R] = state[RATES + 2] * airframe.span / (2.0 * speed)
    out[_DE], out[_DA], out[_DR] = state[CONTROLS], state[CONTROLS + 1], state[CONTROLS + 2]
    out[_FLAPS] = place.flaps
    out[_TC] = thrust / (qbar * airframe.wing_area)
    out[_THROTTLE], out[_PROPELLER] = throttle, airframe.propeller_speed * np.sqrt(throttle)
    out[_V], out[_QBAR], out[_MACH] = speed, qbar, speed / atmosphere.speed_of_sound(altitude)
    out[_HEIGHT], out[_TIME] = altitude - place.ground, time
    for k in range(len(airframe.inputs)):
        middle, swing, rate = airframe.inputs[k]
        out[_INPUTS + k] = middle + 0.5 * swing * (np.sin(rate * time) + np.sin(_SECOND_RATE * rate * time))
    for k in range(len(state) - STATE_SIZE):
        out[FIRST_LAG + k] = state[STATE_SIZE + k]
    return thrust


@njit(cache=True)
def lagging(airframe: Airframe, signals: Array) -> Array:
    """What the lags of the aerodynamics follow, (lags,), of one signal row: their values in steady flight."""
    out, stack, row = np.empty(len(airframe.lag_times)), np.empty((STACK_SIZE, 1)), np.expand_dims(signals, 0)
    for k in range(len(out)):
        evaluate_program(airframe.lag_code, airframe.lag_offsets[k], airframe.lag_offsets[k + 1], row, stack)
        out[k] = stack[0, 0]
    return out


@njit(cache=True)
def aerodynamic_coefficients(airframe: Airframe, signals: Array) -> Array:
    """C_X … C_n, shape (6,), of one signal row: (6.8)-(6.13) or whatever terms the file lists."""
    out = np.empty(6)
    _put_coefficients(airframe, signals, np.empty(len(airframe.parameters)), out)
    return out


@njit(cache=True)
def _put_coefficients(airframe: Airframe, signals: Array, regressors: Array, out: Array) -> None:
    """``aerodynamic_coefficients`` into ``out``."""
    evaluate_programs(airframe.code, airframe.term_offsets, signals, regressors)
    for axis in range(6):
        out[axis] = 0.0
        for k in range(airframe.axis_offsets[axis], airframe.axis_offsets[axis + 1]):
            out[axis] += regressors[k] * airframe.parameters[k]


@njit(cache=True)
def motion(airframe: Airframe, place: Place, state: Array, wind: Array, time: float) -> Motion:
    """What acts in a state, shape (17,), in a wind NED (3,) [m/s]: a Motion.

    alpha_dot and beta_dot are those of the motion, (6.16)-(6.18): gusts, whose derivative is noise, are not in them.
    A state without the lags of the aerodynamics, which follow the 17, is a steady one.
    """
    signals, coefficients = np.empty(SIGNAL_COUNT), np.empty(6)
    regressors = np.empty(len(airframe.parameters))
    force, acceleration, air, thrust = _acting(
        airframe, place, state, three(wind), time, signals, regressors, coefficients
    )
    return Motion(coefficients, np.array(force), np.array(acceleration), np.array(air), signals, thrust)


@njit(cache=True)
def _acting(
    airframe: Airframe, place: Place, state: Array, wind: Vector, time: float, signals: Array, regressors: Array,
    coefficients: Array,
) -> tuple[Vector, Vector, Vector, float]:  # fmt: skip
    """Specific force, angular acceleration, air-relative velocity and thrust; fills in signals and coefficients."""
    to_body = transposed(_attitude(state))
    air = applied(to_body, (state[VELOCITY] - wind[0], state[VELOCITY + 1] - wind[1], state[VELOCITY + 2] - wind[2]))
    fall = (to_body[2] * place.gravity, to_body[5] * place.gravity, to_body[8] * place.gravity)
    rates = (state[RATES], state[RATES + 1], state[RATES + 2])
    thrust = _put_signals(airframe, place, state, air, time, signals)
    scale = signals[_QBAR] * airframe.wing_area
    for _ in range(_FLOW_RATE_PASSES if airframe.has_flow_rates else 1):
        if len(state) == STATE_SIZE and len(airframe.lag_times):
            signals[FIRST_LAG : FIRST_LAG + len(airframe.lag_times)] = lagging(airframe, signals)
        _put_coefficients(airframe, signals, regressors, coefficients)
        force = (scale * coefficients[0], scale * coefficients[1], scale * coefficients[2])
        specific = (force[0] / airframe.mass, force[1] / airframe.mass, force[2] / airframe.mass)
        alpha_dot, beta_dot = flow_rates(air, rigid_body.velocity_equations(specific, rates, air, fall))
        signals[_ALPHA_DOT] = alpha_dot * airframe.chord / signals[_V]
        signals[_BETA_DOT] = beta_dot * airframe.span / (2.0 * signals[_V])
    arm = rigid_body.crossed(three(airframe.reference), force)  # M_cg = M_ref + r x F
    moment = (
        scale * coefficients[3] * airframe.span + arm[0],
        scale * coefficients[4] * airframe.chord + arm[1],
        scale * coefficients[5] * airframe.span + arm[2],
    )
    return specific, rigid_body.euler_equations(moment, rates, airframe.inertia), air, thrust


@njit(cache=True)
def _attitude(state: Array) -> Matrix:
    """Body to NED."""
    return rotation(state[ATTITUDE], state[ATTITUDE + 1], state[ATTITUDE + 2], state[ATTITUDE + 3])


@njit(cache=True)
def flow_rates(velocity: Array | Vector, change: Array | Vector) -> tuple[float, float]:
    """d alpha/dt and d beta/dt [rad/s] of an air-relative velocity (3,) and its derivative, body axes."""
    u, v, w = velocity
    ahead2 = u * u + w * w
    ahead = np.sqrt(ahead2)
    alpha_dot = (u * change[2] - w * change[0]) / ahead2
    ahead_dot = (u * change[0] + w * change[2]) / ahead
    return alpha_dot, (ahead * change[1] - v * ahead_dot) / (ahead2 + v * v)


@njit(cache=True)
def state_derivative(airframe: Airframe, place: Place, state: Array, command: Array, wind: Array, time: float) -> Array:
    """d/dt of the state, shape (17,), for commanded controls (4,)."""
    out, signals, coefficients = np.empty(len(state)), np.empty(SIGNAL_COUNT), np.empty(6)
    regressors = np.empty(len(airframe.parameters))
    _put_derivative(airframe, place, state, limited(command), three(wind), time, signals, regressors, coefficients, out)
    return out


@njit(cache=True)
def _put_derivative(
    airframe: Airframe, place: Place, state: Array, command: Array, wind: Vector, time: float, signals: Array,
    regressors: Array, coefficients: Array, out: Array,
) -> None:  # fmt: skip
    """``state_derivative`` into ``out``, of a command that is within its limits; the arrays before are overwritten."""
    force, acceleration, _, _ = _acting(airframe, place, state, wind, time, signals, regressors, coefficients)
    faster = applied(_attitude(state), force)
    attitude = (state[ATTITUDE], state[ATTITUDE + 1], state[ATTITUDE + 2], state[ATTITUDE + 3])
    turn = turned(attitude, (0.0, state[RATES], state[RATES + 1], state[RATES + 2]))
    for i in range(3):
        out[POSITION + i], out[VELOCITY + i], out[RATES + i] = state[VELOCITY + i], faster[i], acceleration[i]
    out[VELOCITY + 2] += place.gravity
    for i in range(4):
        out[ATTITUDE + i] = 0.5 * turn[i]
        out[CONTROLS + i] = airframe.actuator_rates[i] * (command[i] - state[CONTROLS + i])
    if len(airframe.lag_times):
        towards = (lagging(airframe, signals) - state[STATE_SIZE:]) / airframe.lag_times
        out[STATE_SIZE:] = np.minimum(np.maximum(towards, -airframe.lag_rates), airframe.lag_rates)


@njit(cache=True)
def limited(command: Array) -> Array:
    """Commands within what the surfaces and the motor can do, shape (4,)."""
    out = np.minimum(np.maximum(command, -DEFLECTION_LIMIT), DEFLECTION_LIMIT)
    out[3] = min(max(command[3], 0.0), 1.0)
    return out


@njit(cache=True)
def runge_kutta_step(
    airframe: Airframe,
    place: Place,
    state: Array,
    command: Array,
    wind: Array,
    wind_next: Array,
    time: float,
    step: float,
) -> Array:
    """State one step [s] later: classical fourth order, wind linear within the step, controls held."""
    begin, end = three(wind), three(wind_next)
    middle = (0.5 * (begin[0] + end[0]), 0.5 * (begin[1] + end[1]), 0.5 * (begin[2] + end[2]))
    half, within = 0.5 * step, limited(command)
    signals, coefficients = np.empty(SIGNAL_COUNT), np.empty(6)
    regressors = np.empty(len(airframe.parameters))
    there, out, k = state.copy(), state.copy(), np.empty(len(state))
    for stage in range(4):
        air = begin if stage == 0 else end if stage == 3 else middle
        ahead = 0.0 if stage == 0 else step if stage == 3 else half
        if stage > 0:
            for i in range(len(state)):
                there[i] = state[i] + ahead * k[i]
        _put_derivative(airframe, place, there, within, air, time + ahead, signals, regressors, coefficients, k)
        share = step / 6.0 if stage in (0, 3) else step / 3.0
        for i in range(len(state)):
            out[i] += share * k[i]
    length = np.sqrt(np.sum(out[ATTITUDE : ATTITUDE + 4] ** 2))
    for i in range(4):
        out[ATTITUDE + i] /= length
    return out
