"""Gyros against the attitude: body rates are twice the vector part of q* dq/dt, (6.20)-(6.22) differentiated."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.flight_check.grid import compare
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import ATTITUDE, GYRO, unwrapped
from aircraft_sysid_ros.flight_check.triple import Triple

#: Average [s] over which the noise of an attitude leaves a rate; a wider one for the scale; beyond it a bias does.
_WIDTH, _WIDE, _LONG = 0.4, 1.2, 12.0
_SCALE = 0.04
_WORDS = "the derivative of the attitude"


def triple(motion: Motion, width: float = _WIDTH) -> Triple:
    """Rates by gyros and by the attitude, in the same band."""
    grid = motion.grid
    width = max(width, 4.0 * grid.step)
    gyro = [grid.band(grid.as_slope(v), width, _LONG) for v in motion.gyro.T]
    attitude = [grid.band(v, width, _LONG) for v in motion.attitude_rate.T]
    return Triple(GYRO, gyro, attitude, grid.step, _WORDS)


def relations(motion: Motion, rates: Triple) -> list[Relation]:
    """Of each axis that follows its own: time and sign, the scale, and the sign of the Euler angle by itself."""
    slow = triple(motion, _WIDE)
    found = []
    for i in set(range(3)) - set(rates.follows):
        own = rates.comparisons[i][i]
        scale = compare(slow.measured[i], slow.expected[i], slow.step)
        if own is not None and scale is not None:
            found.append(Relation(GYRO[i], ATTITUDE[i], own, _WORDS))
            found.append(Relation(GYRO[i], ATTITUDE[i], scale, _WORDS, _SCALE, has_lag=False))
    return found + _euler_angles(motion)


def _euler_angles(motion: Motion) -> list[Relation]:
    """d(angle)/dt by the gyros: a wrong sign of one angle leaves the others' part of a body rate as it is."""
    grid = motion.grid
    roll, pitch, yaw = motion.euler.T
    p, q, r = motion.gyro.T
    turning = q * np.sin(roll) + r * np.cos(roll)
    by_gyros = (p + np.tan(pitch) * turning, q * np.cos(roll) - r * np.sin(roll), turning / np.cos(pitch))
    found = []
    for i, (angle, rate) in enumerate(zip((unwrapped(roll), pitch, yaw), by_gyros, strict=True)):
        width = max(_WIDTH, 4.0 * grid.step)
        y, x = grid.band(grid.slope(angle), width, _LONG), grid.band(grid.as_slope(rate), width, _LONG)
        comparison = compare(y, x, grid.step, 0.1)
        if comparison is not None:
            words = "its derivative by the gyros"
            found.append(Relation(ATTITUDE[i], GYRO[i], comparison, words, has_lag=False))
    return found
