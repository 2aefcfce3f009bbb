"""Laws of several columns at once, each of which tells unit and sign of all of them by its slopes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aircraft_sysid_ros.recordings.tabular.guess.flight_columns import (
    SURE_T,
    Flight,
    G,
    climb_of,
    cosines,
    turn_rate,
)
from aircraft_sysid_ros.recordings.tabular.guess.laws_of_one import is_of_size, unit_of_slope
from aircraft_sysid_ros.recordings.tabular.guess.series import SPEEDS, Array, Column, Fit, regress

_TRIM = 10.0  # [s] whose mean is the trim
_MOST = 0.5  # of the points that must be left when it is taken off
_ANSWER = 3.0  # [s] of a motion about the centre of gravity after a deflection
_LEFT_OVER = 0.5  # of the largest term of a law, at most, in mean squares
_NOISE_T = 2.5  # t-values below it contradict nothing

Slopes = dict[str, tuple[float, float]]


def _joint(f: Flight, target: Array, parts: dict[str, Array], free: list[Array] | None = None) -> Slopes:
    """Slopes and t-values of columns that together make up a target; nothing where they do not."""
    if not parts:
        return {}
    result = regress(np.where(f.flying(), target, np.nan), list(parts.values()), free or [], f.block())
    if result is None or result[2] > _LEFT_OVER:
        return {}
    return {name: (float(k), float(t)) for name, k, t in zip(parts, result[0], result[1], strict=True)}


def _clearest(law: Callable[[float], Slopes], scales: tuple[float, ...]) -> Slopes:
    """Of a law looked at with several smoothing times [s], for each signal the slope with the largest t-value.

    Nothing of a signal whose slope changes its sign from one of them to another: something else is in it.
    """
    found = [law(seconds) for seconds in scales]
    best: Slopes = {}
    for signal in {signal: None for slopes in found for signal in slopes}:
        told = [slopes[signal] for slopes in found if signal in slopes]
        clearest = max(told, key=lambda slope: abs(slope[1]))
        if all(slope * clearest[0] > 0.0 or abs(t) < _NOISE_T for slope, t in told):
            best[signal] = clearest
    return best


def _in_whole(f: Flight, found: Slopes, large: tuple[str, ...]) -> Slopes:
    """Slopes of a law, only those of its large terms where these do not come out as large as they are.

    A term that is lost in its noise leaves what it should explain to the others, with any sign.
    """
    if all(_is_seen(f.columns[signal], *found[signal]) for signal in large if signal in found):
        return found
    return {signal: slope for signal, slope in found.items() if signal in large}


def _is_seen(column: Column, slope: float, t: float) -> bool:
    """Whether a slope is beyond noise and one that its column can have."""
    if abs(t) < SURE_T or slope * column.sign < 0.0:
        return False
    return is_of_size(slope, column, 0.4) if column.unit else bool(unit_of_slope(slope, 1.0, column.signal, 0.4))


def longitudinal(f: Flight) -> Slopes:
    """f_x = dV/dt + g theta: slopes of the numbers of an airspeed, and of pitch (per g), for a_x as it reads.

    a_x is taken as it reads, but for its unit: where it counts backwards, the airspeed comes out negative. The speed
    over ground ("speed") stands in for an airspeed that is not there, the integral of q ("gravity") for pitch.
    """
    return _clearest(lambda seconds: _longitudinal(f, seconds), (0.7, 1.5, 3.0))


def _longitudinal(f: Flight, seconds: float) -> Slopes:
    force = f.columns.get("specific_force.x")
    if force is None or not force.unit:
        return {}
    speed = next((s for s in SPEEDS if f.has(s)), "")
    forward = f.speed()
    if speed:
        rate = f.raw_rate(speed, seconds)
    elif forward is not None:
        rate = f.grid.rate(forward, seconds)
    else:
        return {}
    parts = {speed or "speed": rate}
    target = f.smooth(f.raw("specific_force.x") * force.factor, seconds)
    if forward is not None and f.known("angular_velocity.y", "angle_of_attack"):
        turning = f.si("angular_velocity.y") * forward * np.sin(f.si("angle_of_attack"))
        parts["turning"] = f.smooth(turning, seconds)
    if f.has("attitude.pitch"):
        return _joint(f, target, {**parts, "attitude.pitch": G * f.smooth(f.raw("attitude.pitch"), seconds)})
    if not f.known("angular_velocity.y"):
        return {}
    parts["gravity"] = G * f.smooth(f.grid.integral(f.si("angular_velocity.y")), seconds)
    return _joint(f, f.grid.changes(target), {name: f.grid.changes(part) for name, part in parts.items()})


def climb_of_pitch(f: Flight, height: str) -> Fit | None:
    """V sin(theta) against the rate of a height's own numbers; pitch in SI but for its sign, with trim taken out."""
    speed, pitch = f.speed(), f.columns.get("attitude.pitch")
    if speed is None or pitch is None or not pitch.unit or not f.has(height):
        return None
    theta = pitch.factor * f.raw("attitude.pitch")
    reference = np.where(f.flying(), speed * np.sin(theta - np.nanmedian(theta)), np.nan)
    return f.fit(f.smooth(reference, 2.0), f.raw_rate(height, 2.0))


def vertical(f: Flight) -> Slopes:
    """(f_z + g cos(theta) cos(phi)) / V = d alpha/dt - q, of which d alpha/dt alone tells nothing: q goes with it."""
    return _clearest(lambda seconds: _vertical(f, seconds), (0.25, 0.8))


def _vertical(f: Flight, seconds: float) -> Slopes:
    speed = f.pace()
    if speed is None or not f.known("specific_force.z"):
        return {}
    with np.errstate(all="ignore"):
        target = f.smooth((f.si("specific_force.z") + G * cosines(f)) / speed, seconds)
    parts = {}
    if f.has("angular_velocity.y"):
        parts["angular_velocity.y"] = -f.smooth(f.raw("angular_velocity.y"), seconds)
    elif (turning := turn_rate(f, 1)) is not None:
        target = target + f.smooth(turning, seconds)
    else:
        return {}
    if f.has("angle_of_attack"):
        parts["angle_of_attack"] = f.raw_rate("angle_of_attack", seconds)
    return _in_whole(f, _joint(f, target, parts), ("angular_velocity.y",))


def lateral(f: Flight) -> Slopes:
    """g cos(theta) sin(phi) / V = d beta/dt + r cos(alpha) - p sin(alpha) - f_y / V.

    Without a bank angle its changes are those of the integral of p. All of it must be there: in a slip d beta/dt
    and r are opposite and much larger than f_y / V, so that what is left without one of them tells no sign.
    """
    return _clearest(lambda seconds: _lateral(f, seconds), (0.25, 0.8, 2.0))


def _lateral(f: Flight, seconds: float) -> Slopes:
    speed = f.pace()
    by_roll = f.known("attitude.roll")
    if speed is None or not (by_roll or f.known("angular_velocity.x")) or not f.has("sideslip"):
        return {}
    changes = (lambda values: values) if by_roll else f.grid.changes
    theta = f.si("attitude.pitch") if f.known("attitude.pitch") else np.zeros(len(f.grid.time))
    alpha = f.si("angle_of_attack") if f.known("angle_of_attack") else f.smooth(theta, 5.0)
    rolling = f.si("angular_velocity.x") if f.known("angular_velocity.x") else f.rate("attitude.roll", 0.0)
    with np.errstate(all="ignore"):
        roll = np.sin(f.si("attitude.roll")) if by_roll else changes(f.grid.integral(rolling))
        target = f.smooth(G * np.cos(theta) * roll / speed + rolling * np.sin(alpha), seconds)
        slip = f.raw_rate("sideslip", seconds)
        parts = {"sideslip": slip}
        if f.has("angular_velocity.z"):
            parts["angular_velocity.z"] = f.smooth(f.raw("angular_velocity.z") * np.cos(alpha), seconds)
        elif (turning := turn_rate(f, 2)) is not None:
            target = target - f.smooth(turning * np.cos(alpha), seconds)
        else:
            return {}
        if f.has("specific_force.y"):
            parts["specific_force.y"] = -f.smooth(f.raw("specific_force.y") / speed, seconds)
    # A bank and a vane that come late, and an angle of attack that is not the one of the flow.
    late = [changes(f.smooth(rolling, seconds)), changes(np.gradient(slip, f.grid.step))]
    found = _joint(f, changes(target), {name: changes(part) for name, part in parts.items()}, late)
    return _in_whole(f, found, ("sideslip", "angular_velocity.z"))


def side_force(f: Flight) -> Slopes:
    """f_y = y axis of the acceleration over ground less gravity."""
    return _clearest(lambda seconds: _side_force(f, seconds), (0.8, 2.0, 4.0))


def _side_force(f: Flight, seconds: float) -> Slopes:
    angles = ("attitude.roll", "attitude.pitch", "attitude.yaw")
    if not f.has("specific_force.y") or not f.known("velocity.north", "velocity.east", *angles):
        return {}
    phi, theta, psi = (f.si(angle) for angle in angles)
    climb = climb_of(f)
    down = -f.grid.rate(climb[1], seconds) if climb is not None else np.zeros(len(phi))
    north, east = (f.rate(f"velocity.{way}", seconds) for way in ("north", "east"))
    across = f.smooth(np.sin(phi) * np.sin(theta) * np.cos(psi) - np.cos(phi) * np.sin(psi), seconds)
    along = f.smooth(np.sin(phi) * np.sin(theta) * np.sin(psi) + np.cos(phi) * np.cos(psi), seconds)
    level = f.smooth(np.sin(phi) * np.cos(theta), seconds)
    target = north * across + east * along + (down - G) * level
    late = [f.rate("attitude.roll", seconds)]
    return _joint(f, target, {"specific_force.y": f.smooth(f.raw("specific_force.y"), seconds)}, late)


def control_sign(f: Flight, signal: str) -> Slopes:
    """Angular acceleration per deflection, by its signal; the push of a touchdown is none."""
    return _clearest(lambda seconds: _control(f, signal, seconds), (0.12, 0.3, 0.6))


def _control(f: Flight, signal: str, seconds: float) -> Slopes:
    axis, others = {
        "aileron": (0, ("sideslip", "specific_force.y", "rudder")),
        "elevator": (1, ("angle_of_attack", "specific_force.z")),
        "rudder": (2, ("sideslip", "specific_force.y", "aileron")),
    }[signal]
    rate = turn_rate(f, axis)
    if rate is None:
        return {}
    reference = np.where(f.airborne(), f.grid.rate(rate, seconds), np.nan)
    columns = [f.smooth(f.raw(signal), seconds), f.smooth(rate, seconds)]
    columns += [f.smooth(f.raw(other), seconds) for other in others if f.has(other)]
    beside = turn_rate(f, 2 - axis) if axis != 1 else None
    columns += [f.smooth(beside, seconds)] if beside is not None else []
    whole = np.array([reference, *columns])
    quick = np.array([f.grid.changes(values, _TRIM) for values in whole])  # what trims it slowly is no answer
    of_whole, of_quick = (np.isfinite(series).all(axis=0).sum() for series in (whole, quick))
    target, *read = whole if of_quick < _MOST * of_whole else quick  # short manoeuvres have no slow trim
    result = regress(target, read, [], f.block(_ANSWER))
    return {} if result is None else {signal: (float(result[0][0]), float(result[1][0]))}
