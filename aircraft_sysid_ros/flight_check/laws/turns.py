"""Turns, for steady wind: tan(roll) = V d(course)/dt / g, yaw and body z rate follow the course, pitch the climb."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.flight_check.finding import ERROR, Finding
from aircraft_sysid_ros.flight_check.grid import compare
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import ATTITUDE, GYRO, VELOCITY

_LONG = 40.0
#: A turn is coordinated only so much: the ratio tells a wrong unit and no scale.
_UNIT = 1.5
#: Rms acceleration across the track [m/s^2] from which yaw follows the course, and bank what the turn needs: in
#: straight flight a gust from the side takes the course one way and turns the nose the other, and a Dutch roll slips.
_TURNS = 0.3


def relations(motion: Motion) -> list[Relation]:
    """Signs, and units of the gyros: sideslip, wind and the angle of attack are not allowed for."""
    grid, width = motion.grid, 2.0 * motion.gps_width
    bank = np.arctan(grid.smooth(motion.turn_acceleration, motion.gps_width) / STANDARD_GRAVITY)
    with np.errstate(invalid="ignore", divide="ignore"):
        climb = -motion.velocity[:, 2] / np.linalg.norm(motion.velocity, axis=1)
    roll, pitch, yaw = motion.euler.T
    pairs = (
        (ATTITUDE[0], np.tan(np.clip(roll, -1.4, 1.4)), np.tan(bank), "the bank that the turns over ground need"),
        (ATTITUDE[2], grid.slope(yaw), motion.course_rate, "the rate of the course over ground"),
        (GYRO[2], motion.gyro[:, 2], motion.course_rate * np.cos(bank), "the rate of the course over ground"),
        (GYRO[0], motion.gyro[:, 0], grid.slope(bank), "the rate of the bank that the turns over ground need"),
        (ATTITUDE[1], pitch, climb, "the climb of the GPS velocity"),
    )
    turning = grid.band(motion.turn_acceleration, width, _LONG)
    turns = float(np.sqrt(np.nanmean(turning**2))) if np.isfinite(turning).any() else 0.0
    found = []
    for name, y, x, words in pairs:
        if name != ATTITUDE[1] and turns < _TURNS:
            continue
        comparison = compare(grid.band(y, width, _LONG), grid.band(x, width, _LONG), grid.step, 1.0)
        if comparison is not None:
            tolerance = _UNIT if name in GYRO else None
            also = VELOCITY[2:] if name == ATTITUDE[1] else VELOCITY[:2]
            found.append(Relation(name, "", comparison, words, tolerance, has_lag=False, also=also))
    return found


#: A heading that differs from the course by more than wind and sideslip can, steadily [rad].
_HEADING, _STEADY = np.radians(45.0), np.radians(35.0)


def heading_error(motion: Motion) -> float:
    """Mean of yaw less course [rad] where it is steady; 0 where it is not, or where wind and sideslip explain it."""
    course = np.arctan2(motion.velocity[:, 1], motion.velocity[:, 0])
    apart = np.exp(1j * (motion.euler[:, 2] - course))
    apart = apart[np.isfinite(apart)]
    if len(apart) * motion.grid.step < 10.0 or abs(np.mean(apart)) < np.cos(_STEADY):
        return 0.0
    angle = float(np.angle(np.mean(apart)))
    return angle if abs(angle) > _HEADING else 0.0


def findings(motion: Motion) -> list[Finding]:
    """A yaw that counts from another direction than north."""
    angle = heading_error(motion)
    if not angle:
        return []
    return [Finding(
        ATTITUDE[2:], "offset", ERROR,
        f"it differs from the course over ground by {np.degrees(angle):.0f}° all the time: it counts from another "
        f"direction than north, take {np.degrees(angle):.0f}° off (offset in the map)",
    )]  # fmt: skip
