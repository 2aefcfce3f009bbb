"""A mild stabiliser that keeps a test flight near its condition; gains from the aeroplane's derivatives.

Its bandwidth is low and it feeds back no rates, so that it does not tie the surfaces to the motion that they
excite: surfaces in proportion to rates would make their effects inseparable.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.simulation.dynamics import ATTITUDE, DEFLECTION_LIMIT, POSITION, VELOCITY
from aircraft_sysid_ros.simulation.manoeuvres import Excitation
from aircraft_sysid_ros.simulation.trim import Derivatives, Trim

Array = npt.NDArray[np.float64]

#: Bandwidths [rad/s] of pitch, bank, speed and height.
PITCH_BANDWIDTH, BANK_BANDWIDTH, SPEED_BANDWIDTH, HEIGHT_BANDWIDTH = 0.8, 0.8, 0.15, 0.2
PITCH_LIMIT = np.radians(10.0)
# What the manoeuvres aim at.
ALPHA_CHANGE = np.radians(3.5)
ROLL_RATE, BANK_CHANGE = np.radians(50.0), np.radians(28.0)
SIDESLIP = np.radians(4.0)
THROTTLE_CHANGE = 0.25


class Autopilot(NamedTuple):
    """Gains and references; controls = trim + gain * error."""

    trim_controls: Array  # (4,)
    trim_pitch: float  # [rad]
    airspeed: float  # [m/s]
    pitch_gain: float  # elevator per pitch error
    bank_gain: float  # aileron per bank error
    speed_gain: float  # throttle per m/s
    climb_gain: float  # pitch per metre of height error
    climb_throttle: float  # throttle that carries the weight up the slope, per pitch change


def pitch_rate_per_elevator(aircraft: Aircraft, trim: Trim, slopes: Derivatives) -> float:
    """Steady pitch rate per elevator [1/s]: C_m,a da + C_m,q q c/V + C_m,de de = 0 with q = lift_rate da."""
    resistance = slopes.pitch_stiffness / slopes.lift_rate + slopes.pitch_damping * aircraft.chord / trim.airspeed
    return -slopes.pitch_control / resistance


def roll_rate_per_aileron(aircraft: Aircraft, trim: Trim, slopes: Derivatives) -> float:
    """Steady roll rate per aileron [1/s]."""
    return -slopes.roll_control / (slopes.roll_damping * aircraft.span / (2.0 * trim.airspeed))


def autopilot_for(aircraft: Aircraft, trim: Trim, slopes: Derivatives) -> Autopilot:
    """Gains for the bandwidths above; InputError where a control that it needs moves nothing, or nothing resists."""
    needed = {
        "CX_Tc": slopes.thrust_rate, "CZ_alpha": slopes.lift_rate, "Cm_de": slopes.pitch_control,
        "Cl_p": slopes.roll_damping, "Cl_da": slopes.roll_control,
    }  # fmt: skip
    lacking = [name for name, slope in needed.items() if slope == 0.0]
    if lacking:
        raise InputError(
            f"aircraft '{aircraft.name}' cannot be simulated: its autopilot flies by elevator, ailerons and throttle, "
            f"and {' and '.join(lacking)} {'is' if len(lacking) == 1 else 'are'} 0"
        )
    return Autopilot(
        trim.controls,
        trim.alpha,
        trim.airspeed,
        PITCH_BANDWIDTH / pitch_rate_per_elevator(aircraft, trim, slopes),
        BANK_BANDWIDTH / roll_rate_per_aileron(aircraft, trim, slopes),
        SPEED_BANDWIDTH / slopes.thrust_rate,
        HEIGHT_BANDWIDTH / trim.airspeed,
        STANDARD_GRAVITY / slopes.thrust_rate,
    )


def excitation_for(aircraft: Aircraft, qbar: float, trim: Trim, slopes: Derivatives) -> Excitation:
    """Sizes and pulse lengths of manoeuvres from the derivatives at a dynamic pressure [Pa]."""
    scale = qbar * aircraft.wing_area
    pitch_force = slopes.pitch_stiffness + slopes.pitch_damping * aircraft.chord * slopes.lift_rate / trim.airspeed
    short_period = np.sqrt(max(-pitch_force * scale * aircraft.chord / aircraft.inertia[1, 1], 0.04))
    dutch_roll = np.sqrt(max(slopes.yaw_stiffness * scale * aircraft.span / aircraft.inertia[2, 2], 0.04))
    elevator = ALPHA_CHANGE * -pitch_force / slopes.pitch_control
    half_dutch_roll = float(np.clip(np.pi / dutch_roll, 0.3, 1.5))
    aileron = min(ROLL_RATE, BANK_CHANGE / half_dutch_roll) / roll_rate_per_aileron(aircraft, trim, slopes)
    rudder = SIDESLIP * slopes.yaw_stiffness / slopes.yaw_control if slopes.yaw_control else 0.0
    return Excitation(
        elevator=_at_most(elevator, 0.5 * DEFLECTION_LIMIT),
        aileron=_at_most(aileron, 0.5 * DEFLECTION_LIMIT),
        rudder=_at_most(rudder, 0.5 * DEFLECTION_LIMIT),
        throttle=THROTTLE_CHANGE,
        pitch_pulse=float(np.clip(2.0 / short_period, 0.15, 1.0)),
        roll_pulse=half_dutch_roll,
        yaw_pulse=half_dutch_roll,
        airspeed=trim.airspeed,
    )


def _at_most(value: float, limit: float) -> float:
    return float(np.clip(value, -limit, limit))


@njit(cache=True)
def autopilot_controls(
    pilot: Autopilot, state: Array, airspeed: float, bank_reference: float, airspeed_reference: float
) -> Array:
    """Elevator, aileron, rudder [rad] and throttle, shape (4,), that hold height 0, bank and airspeed."""
    roll, pitch, _ = euler_from_quaternion(state[ATTITUDE : ATTITUDE + 4])
    height_error = state[POSITION + 2]
    climb = -state[VELOCITY + 2]
    # The wing must lift more in a turn; climb is fed back as well, which damps the phugoid.
    pitch_reference = pilot.trim_pitch / max(np.cos(roll), 0.5) + pilot.climb_gain * (height_error - 2.0 * climb)
    change = min(max(pitch_reference - pilot.trim_pitch, -PITCH_LIMIT), PITCH_LIMIT)
    out = pilot.trim_controls.copy()
    out[0] += pilot.pitch_gain * (pilot.trim_pitch + change - pitch)
    out[1] += pilot.bank_gain * (bank_reference - roll)
    out[3] += pilot.speed_gain * (airspeed_reference - airspeed) + pilot.climb_throttle * change
    return out
