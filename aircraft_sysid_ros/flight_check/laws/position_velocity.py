"""GPS velocity is the derivative of GPS position."""

from __future__ import annotations

from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import GEODETIC, VELOCITY
from aircraft_sysid_ros.flight_check.triple import Triple

_LONG = 20.0
_SCALE, _LAG = 0.04, 0.05  # the time [s] for a GPS of four fixes a second or more


def triple(motion: Motion) -> Triple:
    """Velocity and the slope of the position, in the same band."""
    grid, width = motion.grid, 2.0 * motion.gps_width
    velocity = [grid.band(grid.as_slope(v), width, _LONG) for v in motion.velocity.T]
    position = [grid.band(grid.slope(p), width, _LONG) for p in motion.position.T]
    return Triple(VELOCITY, velocity, position, grid.step, "the derivative of the GPS position", 1.5)


def relations(motion: Motion, moved: Triple) -> list[Relation]:
    """North, east and down, those that follow their own."""
    return [
        Relation(VELOCITY[i], GEODETIC[i], comparison, moved.words, _SCALE, lag_tolerance=_LAG * motion.gps_width)
        for i in range(3)
        if (comparison := moved.comparisons[i][i]) is not None and i not in moved.follows
    ]
