"""A test flight of the textbook aeroplane: the dynamics, the autopilot and the plan, stepped together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft import atmosphere, earth
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.autopilot import (
    Autopilot,
    autopilot_controls,
    autopilot_for,
    excitation_for,
)
from aircraft_sysid_ros.simulation.dynamics import (
    ATTITUDE,
    CONTROLS,
    POSITION,
    RATES,
    VELOCITY,
    Airframe,
    Effect,
    Place,
    airframe_of,
    motion,
    runge_kutta_step,
    trim_airspeed_of,
)
from aircraft_sysid_ros.simulation.manoeuvres import Excitation, Plan
from aircraft_sysid_ros.simulation.trim import Trim, derivatives_at, trim_level

Array = npt.NDArray[np.float64]

#: Where flights begin: latitude, longitude [rad], and height above the ground of the aircraft file [m].
LATITUDE, LONGITUDE = np.radians(44.7), np.radians(-93.1)
HEIGHT = 120.0
_SPEED = SIGNAL_INDEX["V"]


@dataclass(frozen=True)
class Setup:
    """An aeroplane in trim at a place, ready to be flown."""

    airframe: Airframe
    place: Place
    origin: Array  # (3,) latitude, longitude [rad], altitude [m]
    trim: Trim
    autopilot: Autopilot
    excitation: Excitation


def flight_origin(aircraft: Aircraft) -> Array:
    """Latitude, longitude [rad], altitude [m], shape (3,), of the beginning of a simulated flight."""
    return np.array([LATITUDE, LONGITUDE, HEIGHT + (aircraft.ground_altitude or 0.0)])


def prepare(aircraft: Aircraft, effects: Sequence[Effect] = ()) -> Setup:
    """Trim an aeroplane and give it an autopilot; InputError when its file does not allow it."""
    origin = flight_origin(aircraft)
    place = Place(float(earth.gravity(origin[0], origin[2])), float(origin[2]), float(origin[2] - HEIGHT))
    airframe = airframe_of(aircraft, effects)
    trim = trim_level(airframe, place, trim_airspeed_of(aircraft))
    slopes = derivatives_at(airframe, place, trim)
    qbar = 0.5 * atmosphere.air_density(place.altitude) * trim.airspeed**2
    autopilot = autopilot_for(aircraft, trim, slopes)
    return Setup(airframe, place, origin, trim, autopilot, excitation_for(aircraft, qbar, trim, slopes))


@dataclass(frozen=True)
class Change:
    """After a time [s] another airframe flies: mass, inertia or centre of gravity changed."""

    time: float
    airframe: Airframe


def fly(setup: Setup, plan: Plan, wind: Array, changes: Sequence[Change] = ()) -> Truth:
    """Fly a plan (n equal steps) in a wind NED (n, 3) [m/s], from trim in the wind at the beginning.

    ``changes`` by rising time. Raises InputError when the aeroplane does not stay in the air.
    """
    step, wind = float(plan.time[1] - plan.time[0]), np.ascontiguousarray(wind)
    state = setup.trim.state.copy()
    state[VELOCITY : VELOCITY + 3] += wind[0]
    flown = np.arange(len(wind)) * step
    begins = [0, *np.searchsorted(flown, [change.time for change in changes], side="right").tolist()]
    parts = []
    for airframe, first, last in zip(
        (setup.airframe, *(change.airframe for change in changes)), begins, [*begins[1:], len(wind)], strict=True
    ):
        if last > first:
            part, state = _run(
                airframe, setup.place, setup.autopilot, state, plan.controls, plan.bank, plan.airspeed, plan.height,
                plan.flaps, wind, step, first, last,
            )  # fmt: skip
            parts.append(part)
    truth = _truth(setup, plan.time, wind, *(np.concatenate(series) for series in zip(*parts, strict=True)))
    lost = ~np.isfinite(truth.airspeed) | (truth.height < 0.0) | (np.abs(truth.alpha) > 1.0)
    if lost.any():
        raise InputError(
            f"the simulated aircraft goes out of control after {plan.time[np.argmax(lost)]:.1f} s: "
            "its coefficients make it unstable or the wind is too strong for it"
        )
    return truth


@njit(cache=True)
def _run(
    airframe: Airframe, ground: Place, pilot: Autopilot, start: Array, additions: Array, bank: Array, airspeed: Array,
    height: Array, flaps: Array, wind: Array, step: float, first: int, last: int,
) -> tuple[tuple[Array, ...], Array]:  # fmt: skip
    """States and what acts in them at every step from the ``first`` until before the ``last``, and the state there."""
    n = last - first
    states, signals = np.empty((n, len(start))), np.empty((n, SIGNAL_COUNT))
    force, acceleration, air_velocity = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    coefficients, thrust = np.empty((n, 6)), np.empty(n)
    state = start
    for i in range(first, last):
        following = wind[min(i + 1, len(wind) - 1)]
        time, k = i * step, i - first
        place = Place(ground.gravity, ground.altitude, ground.ground, flaps[i])
        acting = motion(airframe, place, state, wind[i], time)
        states[k], signals[k], force[k] = state, acting.signals, acting.specific_force
        acceleration[k], air_velocity[k] = acting.angular_acceleration, acting.air_velocity
        coefficients[k], thrust[k] = acting.coefficients, acting.thrust
        seen = state.copy()
        seen[POSITION + 2] += height[i]  # the autopilot holds height 0
        command = autopilot_controls(pilot, seen, acting.signals[_SPEED], bank[i], airspeed[i]) + additions[i]
        state = runge_kutta_step(airframe, place, state, command, wind[i], following, time, step)
    return (states, signals, force, acceleration, air_velocity, coefficients, thrust), state


def _truth(
    setup: Setup, time: Array, wind: Array, states: Array, signals: Array, force: Array, acceleration: Array,
    air_velocity: Array, coefficients: Array, thrust: Array,
) -> Truth:  # fmt: skip
    def column(name: str) -> Array:
        return signals[:, SIGNAL_INDEX[name]]

    surfaces = states[:, CONTROLS : CONTROLS + 3]
    controls = np.column_stack([surfaces, column("flaps"), column("throttle"), thrust, column("propeller_speed")])
    altitude = setup.place.altitude - states[:, POSITION + 2]
    return Truth(
        time=time,
        position=states[:, POSITION : POSITION + 3],
        velocity=states[:, VELOCITY : VELOCITY + 3],
        quaternion=states[:, ATTITUDE : ATTITUDE + 4],
        rates=states[:, RATES : RATES + 3],
        angular_acceleration=acceleration,
        specific_force=force,
        air_velocity=air_velocity,
        airspeed=column("V"),
        alpha=column("alpha"),
        beta=column("beta"),
        density=np.array([atmosphere.air_density(h) for h in altitude]),
        static_pressure=atmosphere.pressures(altitude),
        height=column("height"),
        controls=controls,
        inputs=signals[:, len(SIGNALS) : len(SIGNALS) + len(setup.airframe.inputs)].copy(),
        wind=wind,
        coefficients=coefficients,
        origin=setup.origin,
    )
