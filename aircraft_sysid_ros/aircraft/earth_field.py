"""The magnetic field of the earth at a place: spherical harmonics of the World Magnetic Model 2025 up to degree 6.

With theta from the north pole and Schmidt's semi-normalised P_n^m(cos theta), at the radius that the model refers to,

    north = sum (g cos m lon + h sin m lon) dP/dtheta,   east = sum m (g sin m lon - h cos m lon) P / sin theta,
    down = -sum (n + 1) (g cos m lon + h sin m lon) P

(NOAA and British Geological Survey, The US/UK World Magnetic Model for 2025-2030). The dipole alone, degree 1, is off
by 20 deg or more on a fifth of the earth, and by up to the half of the strength in the South Atlantic.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: g and h [nT] of degree n = 1, 2, … by order m = 0 to n.
_GAUSS: tuple[tuple[tuple[float, float], ...], ...] = (
    ((-29351.8, 0.0), (-1410.8, 4545.4)),
    ((-2556.6, 0.0), (2951.1, -3133.6), (1649.3, -815.1)),
    ((1361.0, 0.0), (-2404.1, -56.6), (1243.8, 237.5), (453.6, -549.5)),
    ((895.0, 0.0), (799.5, 278.6), (55.7, -133.9), (-281.1, 212.0), (12.1, -375.6)),
    ((-233.2, 0.0), (368.9, 45.4), (187.2, 220.2), (-138.7, -122.9), (-142.0, 43.0), (20.9, 106.1)),
    ((64.4, 0.0), (63.8, -18.4), (76.9, 16.8), (-115.7, 48.8), (-40.9, -59.8), (14.9, 10.9), (-60.7, 72.7)),
)
#: Nearer to a pole than this, east is as it is there.
_LEAST_SINE = 1e-6


@dataclass(frozen=True)
class FieldAtPlace:
    """Strength [T, or the unit of a sensor], inclination and declination [rad] of the earth's field."""

    strength: float
    inclination: float
    declination: float

    def vector(self) -> Array:
        """NED (3,)."""
        level = np.cos(self.inclination)
        direction = [level * np.cos(self.declination), level * np.sin(self.declination), np.sin(self.inclination)]
        return self.strength * np.array(direction)


def earth_field(latitude: float, longitude: float) -> FieldAtPlace:
    """Field [T] near the ground at a place [rad]: within 5 % in strength and 4 deg in direction, from 60 S to 70 N."""
    cos, sin = float(np.sin(latitude)), max(float(np.cos(latitude)), _LEAST_SINE)  # of theta
    earlier, last = [0.0], [1.0]  # P of the degree before last and of the last, by order
    north = east = down = 0.0
    for n, row in enumerate(_GAUSS, start=1):
        p = [
            ((2 * n - 1) * cos * last[m] - sqrt((n - 1) ** 2 - m**2) * (earlier[m] if m < n - 1 else 0.0))
            / sqrt(n**2 - m**2)
            for m in range(n)
        ]
        p.append(sin * last[-1] * (1.0 if n == 1 else sqrt((2 * n - 1) / (2 * n))))
        for m, (g, h) in enumerate(row):
            slope = (n * cos * p[m] - sqrt(n**2 - m**2) * (last[m] if m < n else 0.0)) / sin
            along = g * np.cos(m * longitude) + h * np.sin(m * longitude)
            north += along * slope
            east += m * (g * np.sin(m * longitude) - h * np.cos(m * longitude)) * p[m] / sin
            down -= (n + 1) * along * p[m]
        earlier, last = last, p
    level = float(np.hypot(north, east))
    strength = 1e-9 * float(np.hypot(level, down))
    return FieldAtPlace(strength, float(np.arctan2(down, level)), float(np.arctan2(east, north)))
