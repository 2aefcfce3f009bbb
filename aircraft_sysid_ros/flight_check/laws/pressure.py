"""Altitude by GPS against the altitude at which the standard atmosphere has the static pressure (ISO 2533).

In colder air the pressure falls more in the same climb: as much as the temperature that the density holds says.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import GAS_CONSTANT, altitude_at, temperature_at
from aircraft_sysid_ros.flight_check.grid import Comparison, compare
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation

Array = npt.NDArray[np.float64]

#: Room of the altitude and of the climb, and how many times larger it is where nobody knows the temperature, which is
#: 233 K to 323 K at the ground.
_SCALE, _CLIMB_SCALE, _ANY_TEMPERATURE = 0.12, 0.2, 1.12
#: Temperatures of air over the standard one, and how near to that it is where the density was made of the pressure.
_WARMTH, _MADE = (0.75, 1.25), 1e-3
#: Static pressures [Pa] up to 20 km, those to which the standard atmosphere is asked for the height, and densities'
#: ratio to that at 283 K, which is 1.5 at 188 K under the tropopause.
_PRESSURE, _TROPOSPHERE, _DENSITY = (5e3, 108e3), 20e3, (0.8, 1.5)


def relations(motion: Motion) -> list[Relation]:
    """Units of pressure and density by what air can be, then the change of height."""
    density, pressure = motion.air.T
    found = []
    if np.any(np.isfinite(pressure)):
        middle = float(np.nanmedian(pressure))
        found += _constant("static_pressure", middle, *_PRESSURE, "the pressure of the air")
    if np.any(np.isfinite(density * pressure)):
        ratio = float(np.nanmedian(density * GAS_CONSTANT * 283.0 / pressure))
        found += _constant("air_density", ratio, *_DENSITY, "p/(R T)", "static_pressure")
    if np.any(np.isfinite(pressure)) and np.nanmedian(pressure) > _TROPOSPHERE:
        grid, width = motion.grid, 2.0 * motion.gps_width
        pressure = np.where(pressure > 0.0, pressure, np.nan)
        warmth = _warmth(density, pressure)
        height = altitude_at(pressure) * (warmth or 1.0)
        room = 1.0 if warmth else _ANY_TEMPERATURE
        y, x = grid.smooth(height, width), -grid.smooth(motion.position[:, 2], width)
        comparison = compare(y, x, grid.step, 1.5)
        climb = compare(
            grid.smooth(grid.as_slope(-motion.velocity[:, 2]), width), grid.smooth(grid.slope(height), width), grid.step
        )
        if climb is not None:
            scale, words = room * (1.0 + _CLIMB_SCALE) - 1.0, "the climb by pressure"
            found.append(Relation("velocity.down", "static_pressure", climb, words, scale, has_lag=False))
        if comparison is not None:
            scale, words = room * (1.0 + _SCALE) - 1.0, "the altitude of GPS, by the standard atmosphere"
            found.append(Relation("static_pressure", "altitude", comparison, words, scale, has_lag=False))
    return found


def _warmth(density: Array, pressure: Array) -> float | None:
    """Temperature over the standard one of what is measured (n,), by p/(R rho); None where that tells none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = pressure / (GAS_CONSTANT * density * temperature_at(pressure))
    middle = float(np.median(ratio[np.isfinite(ratio)])) if np.any(np.isfinite(ratio)) else np.nan
    return middle if _WARMTH[0] < middle < _WARMTH[1] and abs(middle - 1.0) > _MADE else None


def _constant(name: str, ratio: float, least: float, most: float, words: str, second: str = "") -> list[Relation]:
    """A value that physics bounds: the ratio to its middle, with the room that there is."""
    room = float(np.sqrt(most / least))
    middle = ratio / float(np.sqrt(most * least))
    if middle <= 0.0:
        return []
    comparison = Comparison(1.0, middle / room, middle * room, 0.0, np.inf, 1e4, 0.0)
    return [Relation(name, second, comparison, words, 0.02, has_lag=False)]
