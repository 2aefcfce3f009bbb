"""The earth under a flight: WGS-84 positions in a local level frame, gravity.

The world is a plane tangent at the origin (the first GPS fix): over 30 km the height error of the plane is
70 m, which the position carries consistently; earth rotation (0.004 deg/s) is left to the gyro biases.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]

SEMI_MAJOR_AXIS = 6378137.0  # [m]
ECCENTRICITY_SQUARED = 6.69437999014e-3


@njit(cache=True)
def ecef_from_geodetic(latitude: float, longitude: float, altitude: float) -> Array:
    """Earth-centred position, shape (3,) [m], of WGS-84 latitude, longitude [rad] and altitude [m]."""
    s, c = np.sin(latitude), np.cos(latitude)
    n = SEMI_MAJOR_AXIS / np.sqrt(1.0 - ECCENTRICITY_SQUARED * s * s)
    return np.array(
        [
            (n + altitude) * c * np.cos(longitude),
            (n + altitude) * c * np.sin(longitude),
            (n * (1.0 - ECCENTRICITY_SQUARED) + altitude) * s,
        ]
    )


@njit(cache=True)
def ned_axes(latitude: float, longitude: float) -> Array:
    """Matrix, shape (3, 3), that turns earth-centred vectors into NED at that place."""
    sa, ca = np.sin(latitude), np.cos(latitude)
    so, co = np.sin(longitude), np.cos(longitude)
    return np.array([[-sa * co, -sa * so, ca], [-so, co, 0.0], [-ca * co, -ca * so, -sa]])


@njit(cache=True)
def ned_from_geodetic(latitude: float, longitude: float, altitude: float, origin: Array) -> Array:
    """Position NED, shape (3,) [m], relative to ``origin`` = (latitude, longitude [rad], altitude [m])."""
    difference = ecef_from_geodetic(latitude, longitude, altitude) - ecef_from_geodetic(origin[0], origin[1], origin[2])
    return ned_axes(origin[0], origin[1]) @ difference


@njit(cache=True)
def geodetic_from_ned(position: Array, origin: Array) -> Array:
    """Latitude, longitude [rad], altitude [m], (3,), of a NED position; inverse of ned_from_geodetic."""
    ecef = ecef_from_geodetic(origin[0], origin[1], origin[2]) + ned_axes(origin[0], origin[1]).T @ position
    longitude = np.arctan2(ecef[1], ecef[0])
    radius = np.sqrt(ecef[0] ** 2 + ecef[1] ** 2)
    latitude = np.arctan2(ecef[2], radius * (1.0 - ECCENTRICITY_SQUARED))
    altitude = 0.0
    for _ in range(6):  # each pass gains three digits
        s = np.sin(latitude)
        n = SEMI_MAJOR_AXIS / np.sqrt(1.0 - ECCENTRICITY_SQUARED * s * s)
        latitude = np.arctan2(ecef[2] + ECCENTRICITY_SQUARED * n * s, radius)
        altitude = radius * np.cos(latitude) + ecef[2] * np.sin(latitude)
        altitude -= SEMI_MAJOR_AXIS * np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    return np.array([latitude, longitude, altitude])


@njit(cache=True)
def gravity(latitude: float, altitude: float) -> float:
    """Gravity [m/s^2] at latitude [rad] and altitude [m]: WGS-84 normal gravity with the free-air term.

    A latitude that is not known, NaN, counts as 45 degrees: right to 0.03 m/s^2.
    """
    s2 = 0.5 if np.isnan(latitude) else np.sin(latitude) ** 2
    surface = 9.7803253359 * (1.0 + 0.00193185265241 * s2) / np.sqrt(1.0 - ECCENTRICITY_SQUARED * s2)
    return surface * (1.0 - 2.0 * altitude / SEMI_MAJOR_AXIS)
