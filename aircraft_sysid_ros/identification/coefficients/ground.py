"""Where the ground is: as the aircraft file has it, or where the aeroplane was seen to stand.

A flight that begins and ends in the air does not say how high it is above ground: its lowest point is none.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]


def altitudes(rows: Array) -> Array:
    """Altitudes (n,) [m] of states (n, StateField.WIDTH), as the GPS reports them."""
    return np.asarray(rows[:, StateField.ORIGIN.stop - 1] - rows[:, StateField.POSITION.stop - 1])


class Ground:
    """The altitude [m] of the ground, from states as they come."""

    def __init__(self, aircraft: Aircraft) -> None:
        """``aircraft``: its ``ground_altitude`` is the ground, whatever the flight shows."""
        self._of_file, self._slowest = aircraft.ground_altitude, float(aircraft.minimum_airspeed)
        self._lowest = np.inf
        self.restart_clock()

    def restart_clock(self) -> None:
        """Times of states start over."""
        self._slow_since = np.inf

    def below(self, rows: Array) -> Array:
        """The ground (n,) as each of states (n, StateField.WIDTH) and those before it know it; NaN: nothing says it."""
        if self._of_file is not None or not len(rows):
            return np.full(len(rows), self._of_file if self._of_file is not None else np.nan)
        stands = np.where(self._stands(rows), altitudes(rows), np.inf)
        lowest = np.minimum.accumulate(np.minimum(stands, self._lowest))
        self._lowest = float(lowest[-1])
        return np.where(np.isfinite(lowest), lowest, np.nan)

    def _stands(self, rows: Array) -> npt.NDArray[np.bool_]:
        """Whether it stands (n,), by the time [s] since when it is slow and level."""
        time = rows[:, StateField.TIME]
        north, east, down = rows[:, StateField.VELOCITY].T
        slow = (rows[:, StateField.AIRSPEED] < self._slowest) & (np.hypot(north, east) < self._slowest)
        slow &= np.abs(down) < THRESHOLDS.level
        fast = np.maximum.accumulate(np.where(slow, -1, np.arange(len(rows))))  # the newest that was
        since = np.where(fast < 0, min(self._slow_since, time[0]), time[np.minimum(fast + 1, len(rows) - 1)])
        self._slow_since = float(since[-1]) if slow[-1] else np.inf
        return np.asarray(slow & (time - since >= THRESHOLDS.stands))


def ground_of(aircraft: Aircraft, rows: Array) -> float:
    """The ground [m] of a whole flight, from its states; NaN where nothing says it."""
    below = Ground(aircraft).below(rows)
    return float(below[-1]) if len(below) else np.nan
