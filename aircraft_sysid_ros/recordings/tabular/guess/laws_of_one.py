"""Laws that give one column a reference in SI: gravity, the kinematics of attitude and of the flow angles, integrals.

They hold for any aeroplane ((6.20)-(6.24) of docs/references.md); stability is never assumed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aircraft_sysid_ros.recordings.tabular.guess.flight_columns import (
    HEIGHTS,
    SLOW_SECONDS,
    Flight,
    G,
    body_rates,
    climb_of,
    cosines,
    height_of,
    metres_along,
)
from aircraft_sysid_ros.recordings.tabular.guess.series import Array, Column
from aircraft_sysid_ros.recordings.tabular.signals import UNITS
from aircraft_sysid_ros.recordings.tabular.units import conversion

#: Units that are tried where a header says none, by SI unit.
CANDIDATES: dict[str, tuple[str, ...]] = {
    "m/s^2": ("m/s^2", "g", "ft/s^2", "mg"),
    "rad/s": ("rad/s", "deg/s", "mrad/s"),
    "rad": ("rad", "deg"),
    "m": ("m", "ft", "km"),
    "m/s": ("m/s", "kt", "ft/s", "km/h", "cm/s"),
    "Pa": ("Pa", "hPa", "kPa", "inHg", "psi", "psf", "mmHg"),
    "K": ("K", "degC", "degF"),
    "kg/m^3": ("kg/m^3", "slug/ft^3"),
    "1": ("1", "%"),
}
_CLIMB = ("m/s", "ft/min", "ft/s", "kt")

Law = Callable[[Flight], "tuple[str, Array, Array, float] | None"]


def _gyro(axis: int) -> Law:
    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        signal = f"angular_velocity.{'xyz'[axis]}"
        rates = body_rates(f)
        if rates is not None:
            return "the derivative of the attitude", rates[axis], f.smooth(f.raw(signal)), 0.3
        angle = ("attitude.roll", "attitude.pitch", "attitude.yaw")[axis]
        if f.known(angle):
            return f"the derivative of {angle}", f.rate(angle), f.smooth(f.raw(signal)), 0.4
        return None

    return law


def _yaw_rate_by_turn(seconds: float) -> Law:
    """r = g sin(phi) / V in a coordinated turn; the longer the mean, the less there is of a Dutch roll."""

    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        speed = f.pace()
        if speed is None or not f.known("attitude.roll"):
            return None
        with np.errstate(all="ignore"):
            reference = np.where(f.flying(), G * np.sin(f.si("attitude.roll")) / speed, np.nan)
        return "the bank in turns", f.smooth(reference, seconds), f.smooth(f.raw("angular_velocity.z"), seconds), 0.5

    return law


def _pitch_rate_by_kinematics(f: Flight) -> tuple[str, Array, Array, float] | None:
    """q = d alpha/dt - (f_z + g cos(theta) cos(phi)) / V, slow."""
    speed = f.pace()
    if speed is None or not f.known("specific_force.z"):
        return None
    with np.errstate(all="ignore"):
        reference = np.where(f.flying(), -(f.si("specific_force.z") + G * cosines(f)) / speed, np.nan)
    return (
        "a_z over airspeed",
        f.smooth(reference, SLOW_SECONDS),
        f.smooth(f.raw("angular_velocity.y"), SLOW_SECONDS),
        0.5,
    )


def _angle_by_gyro(axis: int) -> Law:
    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        angle = ("attitude.roll", "attitude.pitch", "attitude.yaw")[axis]
        rate = f"angular_velocity.{'xyz'[axis]}"
        if not f.known(rate):
            return None
        return f"the integral of {rate}", f.smooth(f.si(rate)), f.raw_rate(angle), 0.4

    return law


def _pitch_by_gravity(f: Flight) -> tuple[str, Array, Array, float] | None:
    """g sin(theta) = f_x - dV/dt - (q w - r v), slow."""
    if not f.known("specific_force.x"):
        return None
    force = f.si("specific_force.x")
    speed = f.speed()
    if speed is not None:
        force = force - f.grid.rate(speed, SLOW_SECONDS)
    law = "gravity along the body: a_x less the acceleration" if speed is not None else "gravity along the body"
    return law, f.smooth(force, SLOW_SECONDS) / G, f.smooth(f.raw("attitude.pitch"), SLOW_SECONDS), 0.7


def _pitch_by_climb(f: Flight) -> tuple[str, Array, Array, float] | None:
    """theta = gamma + alpha."""
    speed, climb = f.speed(), climb_of(f)
    if speed is None or climb is None:
        return None
    with np.errstate(all="ignore"):
        gamma = np.where(f.flying(), np.arcsin(np.clip(climb[1] / speed, -1.0, 1.0)), np.nan)
    return f"the angle of climb ({climb[0]})", f.smooth(gamma, 2.0), f.smooth(f.raw("attitude.pitch"), 2.0), 0.7


def _force_x_by_gravity(f: Flight) -> tuple[str, Array, Array, float] | None:
    if not f.known("attitude.pitch"):
        return None
    reference = G * np.sin(f.smooth(f.si("attitude.pitch"), SLOW_SECONDS))
    speed = f.speed()
    if speed is not None:
        reference = reference + f.grid.rate(speed, SLOW_SECONDS)
    return "gravity along the body", reference, f.smooth(f.raw("specific_force.x"), SLOW_SECONDS), 0.7


def track_of(f: Flight) -> Array | None:
    """Course over ground [rad], to the east from north."""
    if f.known("velocity.north", "velocity.east"):
        return np.asarray(np.arctan2(f.si("velocity.east"), f.si("velocity.north")))
    north, east = metres_along(f, 0), metres_along(f, 1)
    if north is None or east is None:
        return None
    return np.asarray(np.arctan2(f.grid.rate(east, 2.0), f.grid.rate(north, 2.0)))


def _track_rate(f: Flight) -> Array | None:
    track = track_of(f)
    return None if track is None else f.grid.rate(f.grid.unwrapped(track, 2.0 * np.pi), 2.0)


def _yaw_by_track(f: Flight) -> tuple[str, Array, Array, float] | None:
    """Turns alike; courses and headings themselves drift apart in the wind."""
    rate = _track_rate(f)
    if rate is None:
        return None
    return "the rate of turn of the course", rate, f.raw_rate("attitude.yaw", 2.0), 0.5


def _yaw_by_turn(f: Flight) -> tuple[str, Array, Array, float] | None:
    """dpsi/dt = g tan(phi) / V in a coordinated turn."""
    speed = f.speed()
    if not f.known("attitude.roll"):
        return None
    roll = np.tan(f.smooth(f.si("attitude.roll"), 2.0))
    reference = roll if speed is None else G * roll / f.smooth(speed, 2.0)
    return "the bank in turns", reference, f.raw_rate("attitude.yaw", 2.0), np.inf if speed is None else 0.5


def _roll_by_turn(f: Flight) -> tuple[str, Array, Array, float] | None:
    """tan(phi) = V dpsi/dt / g in a coordinated turn."""
    speed = f.speed()
    rate = _track_rate(f)
    name = "the rate of turn of the course"
    if rate is None and f.known("attitude.yaw"):
        rate, name = f.rate("attitude.yaw", 2.0), "the rate of turn of the heading"
    elif rate is None and f.known("angular_velocity.z"):
        rate, name = f.smooth(f.si("angular_velocity.z"), 2.0), "the rate of turn of the gyro"
    if rate is None:
        return None
    reference = np.arctan(rate * f.smooth(speed, 2.0) / G) if speed is not None else rate
    return name, reference, f.smooth(f.raw("attitude.roll"), 2.0), 0.7 if speed is not None else np.inf


def _alpha_by_climb(f: Flight) -> tuple[str, Array, Array, float] | None:
    """alpha = theta - gamma with level wings."""
    speed, climb = f.speed(), climb_of(f)
    if speed is None or climb is None or not f.known("attitude.pitch"):
        return None
    with np.errstate(all="ignore"):
        gamma = np.arcsin(np.clip(climb[1] / speed, -1.0, 1.0))
    reference = f.si("attitude.pitch") - gamma
    if f.known("attitude.roll"):
        reference = np.where(np.abs(f.si("attitude.roll")) < 0.35, reference, np.nan)
    return (
        f"pitch less the angle of climb ({climb[0]})",
        f.smooth(reference, SLOW_SECONDS),
        f.smooth(f.raw("angle_of_attack"), SLOW_SECONDS),
        0.9,
    )


def _alpha_by_kinematics(f: Flight) -> tuple[str, Array, Array, float] | None:
    """d alpha/dt = q + (f_z + g cos(theta) cos(phi)) / V."""
    speed = f.pace()
    if speed is None or not f.known("angular_velocity.y", "specific_force.z"):
        return None
    weight = G * cosines(f)
    with np.errstate(all="ignore"):
        reference = f.si("angular_velocity.y") + (f.si("specific_force.z") + weight) / speed
    return "its kinematics from q and a_z", f.smooth(reference), f.raw_rate("angle_of_attack"), 0.7


def _height_by_others(signal: str) -> Law:
    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        other = height_of(f, signal)
        sign = -1.0 if signal == "position.down" else 1.0
        if other is not None:
            return other[0], sign * f.smooth(other[1], SLOW_SECONDS), f.smooth(f.raw(signal), SLOW_SECONDS), 0.3
        if f.known("velocity.down"):
            rise = -sign * f.grid.integral(f.si("velocity.down"))
            return "the integral of the vertical speed", rise, f.raw(signal), 0.3
        speed = f.speed()
        if speed is not None and f.known("attitude.pitch"):
            angle = f.si("attitude.pitch") - (f.si("angle_of_attack") if f.known("angle_of_attack") else 0.0)
            climb = sign * f.smooth(speed * np.sin(angle), 2.0)
            return "the climb of pitch and airspeed", climb, f.raw_rate(signal, 2.0), 0.35
        return None

    return law


def _down_by_height(f: Flight) -> tuple[str, Array, Array, float] | None:
    height = height_of(f)
    if height is None:
        return None
    return height[0], -f.smooth(height[1], SLOW_SECONDS), f.grid.integral(f.raw("velocity.down")), 0.15


def _ground_velocity(axis: int) -> Law:
    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        metres = metres_along(f, axis)
        if metres is None:
            return None
        return "the position", metres, f.grid.integral(f.raw(f"velocity.{('north', 'east')[axis]}")), 0.04

    return law


def _position_by_velocity(axis: int) -> Law:
    name = ("north", "east")[axis]

    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        if not f.known(f"velocity.{name}"):
            return None
        return "the integral of the velocity", f.grid.integral(f.si(f"velocity.{name}")), f.raw(f"position.{name}"), 0.2

    return law


_LAWS: dict[str, tuple[Law, ...]] = {
    "attitude.roll": (_angle_by_gyro(0), _roll_by_turn),
    "attitude.pitch": (_pitch_by_climb, _pitch_by_gravity, _angle_by_gyro(1)),
    "attitude.yaw": (_yaw_by_track, _angle_by_gyro(2), _yaw_by_turn),
    "angular_velocity.x": (_gyro(0),),
    "angular_velocity.y": (_gyro(1), _pitch_rate_by_kinematics),
    "angular_velocity.z": (_gyro(2), _yaw_rate_by_turn(2.0), _yaw_rate_by_turn(5.0)),
    "specific_force.x": (_force_x_by_gravity,),
    "angle_of_attack": (_alpha_by_kinematics, _alpha_by_climb),
    "velocity.north": (_ground_velocity(0),),
    "velocity.east": (_ground_velocity(1),),
    "velocity.down": (_down_by_height,),
    "position.north": (_position_by_velocity(0),),
    "position.east": (_position_by_velocity(1),),
    "position.down": (_height_by_others("position.down"),),
    **{name: (_height_by_others(name),) for name in HEIGHTS},
}


def references(f: Flight, signal: str) -> list[tuple[str, Array, Array, float]]:
    """Of a signal: the law, the reference in SI, the column in the same form, the tolerance of the slope."""
    return [found for law in _LAWS.get(signal, ()) if (found := law(f)) is not None]


def unit_of_slope(slope: float, correlation: float, signal: str, tolerance: float) -> str:
    """The unit whose factor the slope [SI per unit] allows; "" where none does, or another is not far enough from it.

    What is not explained may belong to either side: the slope is between slope * correlation and slope / correlation.
    """
    units = _CLIMB if signal == "velocity.down" else CANDIDATES[UNITS[signal]]
    width = tolerance - np.log(max(abs(correlation), 0.05))
    away = {unit: abs(np.log(abs(slope) / conversion(unit, UNITS[signal]).factor)) for unit in units}
    near = [unit for unit in units if away[unit] < 2.0 * width]
    return near[0] if len(near) == 1 and away[near[0]] < width else ""


def is_of_size(slope: float, column: Column, tolerance: float) -> bool:
    """Whether a slope [SI per unit] is that of the unit of a column, to within exp(tolerance)."""
    return bool(abs(np.log(abs(slope) / column.factor)) < tolerance)
