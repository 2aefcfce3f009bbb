"""Which points of a flight wheels may have pushed: those just after and just before it was too slow to fly.

Nobody says when an aeroplane leaves the ground or meets it. On a run of take-off or landing it is faster than the least
airspeed for a while, and what wheels do then is in the measured coefficients: one touchdown is harder than a hundred
doublets.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS

Mask = npt.NDArray[np.bool_]

#: [s] without a point after which it was slow for long: a stall that is slower than the least airspeed lasts shorter.
_SLOW = 5.0
_POINTS = 5  # whose median is the airspeed at an end


def off_wheels(data: FlightData) -> Mask:
    """Points (n,) that no wheels touched; all of them where that would leave too little of the flight."""
    time, speed = data.time, data.signal("V")
    near = THRESHOLDS.rolling_speed * data.aircraft.minimum_airspeed
    keep = np.ones(len(time), np.bool_)
    borders = np.flatnonzero(np.diff(time) > _SLOW) + 1
    for at in np.split(np.arange(len(time)), borders):
        known = at[np.isfinite(speed[at])]
        if not len(known):
            continue
        if np.median(speed[known[:_POINTS]]) < near:
            keep[at[time[at] < time[at[0]] + THRESHOLDS.rolling]] = False
        if np.median(speed[known[-_POINTS:]]) < near:
            keep[at[time[at] > time[at[-1]] - THRESHOLDS.rolling]] = False
    left = float(keep.sum())
    return keep if left * data.step >= THRESHOLDS.shortest and 2.0 * left >= len(keep) else np.ones_like(keep)
