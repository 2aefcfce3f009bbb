"""The earth under a flight: WGS-84 positions in a local level frame, gravity.

A position is the way that was made north and east since the origin (the first GPS fix), each piece of it by the radii
of the ellipsoid there, and the altitude that was lost: what velocities north, east and down add up to at any distance.
It is no map: two ways to one place give two positions, 4 m apart after a loop around 25 km^2 at 48 degrees. Earth
rotation (0.004 deg/s) and the turning of the level (0.001 deg/s at 100 m/s) are left to the gyro biases.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

SEMI_MAJOR_AXIS = 6378137.0  # [m]
ECCENTRICITY_SQUARED = 6.69437999014e-3


@njit(cache=True)
def _metres_per_radian(latitude: float, altitude: float) -> tuple[float, float]:
    """How far [m] a radian of latitude and one of longitude go."""
    s = np.sin(latitude)
    root = np.sqrt(1.0 - ECCENTRICITY_SQUARED * s * s)
    meridian = SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / root**3
    return meridian + altitude, (SEMI_MAJOR_AXIS / root + altitude) * np.cos(latitude)


@njit(cache=True)
def ned_between(begin: Array, end: Array) -> Array:
    """From one place (3,), latitude, longitude [rad], altitude [m], to another that is near: north, east, down [m]."""
    north, east = _metres_per_radian(0.5 * (begin[0] + end[0]), 0.5 * (begin[2] + end[2]))
    turned = (end[1] - begin[1] + np.pi) % (2.0 * np.pi) - np.pi
    return np.array([north * (end[0] - begin[0]), east * turned, begin[2] - end[2]])


@njit(cache=True)
def moved(begin: Array, way: Array) -> Array:
    """The place (3,) that is ``way`` (3,) [m] north, east, down from another; inverse of ned_between."""
    end = begin.copy()
    end[2] -= way[2]
    for _ in range(4):  # each pass gains three digits
        north, east = _metres_per_radian(0.5 * (begin[0] + end[0]), 0.5 * (begin[2] + end[2]))
        end[0] = begin[0] + way[0] / north
        end[1] = begin[1] + way[1] / east
    end[1] = (end[1] + np.pi) % (2.0 * np.pi) - np.pi
    return end


class Odometer:
    """Positions along a way, from places or to them; ``origin`` (3,): latitude, longitude [rad], altitude [m]."""

    def __init__(self, origin: npt.ArrayLike) -> None:
        self.place = np.array(origin, dtype=np.float64)
        self.position = np.zeros(3)

    def position_at(self, place: Array) -> Array:
        """North, east, down [m] (3,) of the next place (3,)."""
        self.position = self.position + ned_between(self.place, place)
        self.place = np.array(place)
        return self.position

    def place_at(self, position: Array) -> Array:
        """The place (3,) of the next position (3,)."""
        self.place = moved(self.place, position - self.position)
        self.position = np.array(position)
        return self.place


def ned_along(places: Array, origin: npt.ArrayLike) -> Array:
    """Positions NED (n, 3) [m] of places (n, 3 or more) along a way that begins at ``origin``; NaN where it is none."""
    return _along(np.ascontiguousarray(places[:, :3], dtype=np.float64), np.array(origin, dtype=np.float64))


@njit(cache=True)
def _along(places: Array, origin: Array) -> Array:
    """``ned_along``."""
    positions, position, before = np.full((len(places), 3), np.nan), np.zeros(3), origin
    for i in range(len(places)):
        if np.isfinite(np.sum(places[i])):
            position += ned_between(before, places[i])
            positions[i], before = position, places[i]
    return positions


def geodetic_along(positions: Array, origin: npt.ArrayLike) -> Array:
    """Latitude, longitude [rad], altitude [m] (n, 3) of positions NED (n, 3) along a way; inverse of ned_along."""
    odometer = Odometer(origin)
    return np.array([odometer.place_at(position) for position in positions]).reshape(-1, 3)


@njit(cache=True)
def gravity(latitude: float, altitude: float) -> float:
    """Gravity [m/s^2] at latitude [rad] and altitude [m]: WGS-84 normal gravity with the free-air term.

    A latitude that is not known, NaN, counts as 45 degrees: right to 0.03 m/s^2.
    """
    s2 = 0.5 if np.isnan(latitude) else np.sin(latitude) ** 2
    surface = 9.7803253359 * (1.0 + 0.00193185265241 * s2) / np.sqrt(1.0 - ECCENTRICITY_SQUARED * s2)
    return surface * (1.0 - 2.0 * altitude / SEMI_MAJOR_AXIS)
