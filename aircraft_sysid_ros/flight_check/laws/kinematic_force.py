"""Specific force against GPS: f_b = C(q)' (dv/dt - g) with an attitude, |f| = |dv/dt - g| without one."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.flight_check.grid import compare
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import ATTITUDE, FORCE, VELOCITY
from aircraft_sysid_ros.flight_check.triple import Triple

_LONG = 20.0
#: What the average over a second of GPS gets wrong: scale of the size and of one axis, and time [s].
_SCALE, _AXIS_SCALE, _LAG = 0.08, 0.2, 0.04


def triple(motion: Motion) -> Triple:
    """Forces by accelerometers, and by GPS velocity and attitude, in the same band."""
    grid, width = motion.grid, motion.gps_width
    measured = [grid.band(grid.as_slope(v), width, _LONG) for v in motion.force.T]
    expected = [grid.band(v, width, _LONG) for v in motion.force_of_gps.T]
    return Triple(FORCE, measured, expected, grid.step, "the force that GPS velocity and attitude give", 1.0)


def relations(motion: Motion, forces: Triple) -> list[Relation]:
    """The size of the force for time and scale, its axes for their signs."""
    grid, width = motion.grid, motion.gps_width
    expected = np.linalg.norm(motion.acceleration - [0.0, 0.0, STANDARD_GRAVITY], axis=1)
    measured = grid.as_slope(np.linalg.norm(motion.force, axis=1))
    size = compare(grid.band(measured, width, _LONG), grid.band(expected, width, _LONG), grid.step, 1.0)
    found = []
    if size is not None:
        words = "|dv/dt - g| of the GPS velocity"
        found.append(
            Relation(FORCE[2], VELOCITY[2], size, words, _SCALE * width, has_sign=False, lag_tolerance=_LAG * width)
        )
    also = ((ATTITUDE[1],), (ATTITUDE[0],), ())
    for i, name in enumerate(FORCE):
        axis = forces.comparisons[i][i] if forces.measured else None
        if axis is not None and i not in forces.follows:
            tolerance = _AXIS_SCALE * width if i != 1 else None
            found.append(Relation(name, "", axis, forces.words, has_lag=False, also=also[i], is_derived=True))
            found.append(
                Relation(
                    name, VELOCITY[2], axis, forces.words, tolerance, has_lag=False, has_sign=False, is_derived=True
                )
            )
    return found
