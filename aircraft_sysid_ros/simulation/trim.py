"""Straight and level trim, and the derivatives of the motion there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler, rotation_matrix, velocity_from_air_data
from aircraft_sysid_ros.aircraft.signals import FIRST_LAG, SIGNAL_INDEX
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.simulation.dynamics import (
    ATTITUDE,
    CONTROLS,
    DEFLECTION_LIMIT,
    STATE_SIZE,
    VELOCITY,
    Airframe,
    Place,
    aerodynamic_coefficients,
    lagging,
    motion,
)

Array = npt.NDArray[np.float64]
_CALM = np.zeros(3)
_CX, _CZ, _CL, _CM, _CN = 0, 2, 3, 4, 5
_STEP = 1e-4
#: Residual [m/s^2] and [rad/s^2] that still counts as trimmed.
_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Trim:
    """Level flight straight north with wings level."""

    airspeed: float  # [m/s]
    alpha: float  # [rad]
    beta: float  # [rad]
    controls: Array  # (4,) elevator, aileron, rudder [rad], throttle 0..1
    state: Array  # (17 + lags,) in calm air


@dataclass(frozen=True)
class Derivatives:
    """How the moments and forces answer at trim, per rad or per whole throttle."""

    lift_rate: float  # [1/s] turn of the flight path per angle of attack
    thrust_rate: float  # [m/s^2] acceleration per whole throttle
    pitch_stiffness: float  # C_m,alpha
    pitch_damping: float  # C_m,q per q c/V
    pitch_control: float  # C_m,de
    roll_damping: float  # C_l,p
    roll_control: float  # C_l,da
    yaw_stiffness: float  # C_n,beta
    yaw_control: float  # C_n,dr


def level_state(airspeed: float, alpha: float, beta: float, controls: Array) -> Array:
    """State, shape (17,), of straight level flight north in calm air, wings level."""
    state = np.zeros(STATE_SIZE)
    attitude = quaternion_from_euler(0.0, alpha, 0.0)
    state[ATTITUDE : ATTITUDE + 4] = attitude
    state[VELOCITY : VELOCITY + 3] = rotation_matrix(attitude) @ velocity_from_air_data(airspeed, alpha, beta)
    state[CONTROLS:] = controls
    return state


def trim_level(airframe: Airframe, place: Place, airspeed: float) -> Trim:
    """Angles and controls at which nothing accelerates; InputError where there are none within the limits."""

    def residual(x: Array) -> Array:
        state = level_state(airspeed, x[0], x[1], x[2:])
        acting = motion(airframe, place, state, _CALM, 0.0)
        force = rotation_matrix(state[ATTITUDE : ATTITUDE + 4]) @ acting.specific_force
        return np.concatenate([force + [0.0, 0.0, place.gravity], acting.angular_acceleration])

    deflection = [DEFLECTION_LIMIT] * 3
    upper = np.array([0.35, 0.2, *deflection, 1.0])
    lower = np.array([-0.35, -0.2, *(-np.array(deflection)), 0.0])
    start = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.4])
    found = least_squares(residual, start, bounds=(lower, upper), x_scale=0.1, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    if not np.max(np.abs(found.fun)) < _TOLERANCE:
        raise InputError(
            f"no straight level flight at {airspeed:g} m/s with these coefficients and control limits: "
            "change trim_airspeed or the coefficients"
        )
    x = found.x
    level = level_state(airspeed, x[0], x[1], x[2:])
    lags = motion(airframe, place, level, _CALM, 0.0).signals[FIRST_LAG : FIRST_LAG + len(airframe.lag_times)]
    return Trim(airspeed, float(x[0]), float(x[1]), x[2:].copy(), np.concatenate([level, lags]))


def derivatives_at(airframe: Airframe, place: Place, trim: Trim) -> Derivatives:
    """Derivatives at trim, by central differences of the coefficients that are simulated, lags in steady flight."""
    acting = motion(airframe, place, trim.state, _CALM, 0.0)
    force_rate = acting.signals[SIGNAL_INDEX["qbar"]] * airframe.wing_area / airframe.mass

    def slope(signal: str, coefficient: int) -> float:
        high, low = acting.signals.copy(), acting.signals.copy()
        high[SIGNAL_INDEX[signal]] += _STEP
        low[SIGNAL_INDEX[signal]] -= _STEP
        for row in (high, low):
            row[FIRST_LAG : FIRST_LAG + len(airframe.lag_times)] = lagging(airframe, row)
        difference = aerodynamic_coefficients(airframe, high) - aerodynamic_coefficients(airframe, low)
        return float(difference[coefficient] / (2.0 * _STEP))

    thrust_rate = airframe.static_thrust * (1.0 - trim.airspeed / airframe.pitch_speed) / airframe.mass
    return Derivatives(
        lift_rate=-slope("alpha", _CZ) * force_rate / trim.airspeed,
        thrust_rate=slope("Tc", _CX) * thrust_rate,
        pitch_stiffness=slope("alpha", _CM),
        pitch_damping=slope("q", _CM),
        pitch_control=slope("de", _CM),
        roll_damping=slope("p", _CL),
        roll_control=slope("da", _CL),
        yaw_stiffness=slope("beta", _CN),
        yaw_control=slope("dr", _CN),
    )
