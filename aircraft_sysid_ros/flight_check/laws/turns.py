"""Turns, for steady wind: tan(roll) = V d(course)/dt / g, yaw and body z rate follow the course, pitch the climb."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.flight_check.finding import ERROR, WARNING, Finding
from aircraft_sysid_ros.flight_check.grid import compare
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import ATTITUDE, GYRO, VELOCITY
from aircraft_sysid_ros.flight_check.steady_wind import LEAST_DIFFERENCE, block_sums, blocks_of, difference_of_courses

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


#: A heading is off by so much [rad] and so many standard errors: of 22 logs of two strangers' simulators, with headings
#: that are 0.3 to 2 degrees off, it was 2.4 degrees at most.
_OFF, _SURE = np.radians(5.0), 5.0
_FEWEST = 4  # blocks
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


class HeadingOffset(NamedTuple):
    """By how much a heading is too large [rad], and the standard error."""

    angle: float
    std: float


def heading_offset(motion: Motion) -> HeadingOffset | None:
    """By airspeed, attitude, flow angles and GPS in one steady wind; None where the flight does not tell.

    As complex numbers, north + i east, the velocity over ground is v = a u + w, where u is the velocity through the air
    by the heading as it is recorded: a = s exp(-i angle) with a scale s of the airspeed. Courses that differ tell a
    from w. The standard error is by blocks (``steady_wind``).
    """
    through, ground = _through_the_air(motion), motion.velocity[:, 0] + 1j * motion.velocity[:, 1]
    known = np.isfinite(through) & np.isfinite(ground) & (np.abs(through) > 0.0)
    through, ground = through[known], ground[known]
    blocks = blocks_of(motion.grid.time[known])
    if len(np.unique(blocks)) < _FEWEST or difference_of_courses(through) < LEAST_DIFFERENCE:
        return None
    centred = through - np.mean(through)
    size = float(np.sum(np.abs(centred) ** 2))
    a = np.vdot(centred, ground) / size
    left = ground - np.mean(ground) - a * centred
    scores = block_sums(centred.conj() * left, blocks)
    across = (scores * np.exp(-1j * np.angle(a))).imag
    return HeadingOffset(-float(np.angle(a)), float(np.sqrt(np.sum(across**2)) / size / abs(a)))


def _through_the_air(motion: Motion) -> npt.NDArray[np.complex128]:
    """Horizontal velocity through the air by the recorded heading (count,), north + i east; angles that no vane
    measures are taken for 0, or for those of straight flight along the nose."""
    roll, pitch, yaw = motion.euler.T
    alpha, beta = (np.asarray(angle) for angle in motion.angles_at_imu)
    beta = beta if np.isfinite(beta).any() else np.zeros_like(yaw)
    if np.isfinite(alpha).any():
        ahead, right, down = np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)
        along = ahead * np.cos(pitch) + (right * np.sin(roll) + down * np.cos(roll)) * np.sin(pitch)
        across = right * np.cos(roll) - down * np.sin(roll)
    else:
        along, across = np.ones_like(yaw), beta
    return np.asarray(motion.airspeed * (along + 1j * across) * np.exp(1j * yaw))


def findings(motion: Motion) -> list[Finding]:
    """A yaw that counts from another direction than north, or is off."""
    angle = heading_error(motion)
    if not angle:
        return _off(motion)
    return [Finding(
        ATTITUDE[2:], "offset", ERROR,
        f"it differs from the course over ground by {np.degrees(angle):.0f}° all the time: it counts from another "
        f"direction than north, take {np.degrees(angle):.0f}° off (offset in the map)",
    )]  # fmt: skip


def _off(motion: Motion) -> list[Finding]:
    offset = heading_offset(motion)
    if offset is None or abs(offset.angle) < max(_OFF, _SURE * offset.std):
        return []
    angle, std = np.degrees(offset)
    way = "large" if angle > 0.0 else "small"
    return [Finding(
        ATTITUDE[2:], "offset", WARNING,
        f"by airspeed, GPS and one steady wind it is {abs(angle):.1f} ± {std:.1f}° too {way}: "
        f"calibrate the compass and allow for its declination, or take {angle:.1f}° off (offset in the map)",
    )]  # fmt: skip
