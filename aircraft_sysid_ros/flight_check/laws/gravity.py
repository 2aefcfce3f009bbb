"""The mean of specific force over a flight is about -g on z: what flies for long must carry its weight."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.flight_check.grid import Comparison
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import FORCE

#: The median size in a flight is between these times g: aerobatics and steep turns carry more than the weight.
_LEAST, _MOST = 0.7, 2.2


def relations(motion: Motion) -> list[Relation]:
    """Sign and unit of z."""
    force = motion.force[np.all(np.isfinite(motion.force), axis=1)]
    if len(force) < 20:
        return []
    size, down = float(np.median(np.linalg.norm(force, axis=1))), float(np.median(force[:, 2]))
    ratio = max(size / STANDARD_GRAVITY, 1e-9)
    sure = 1.0 if abs(down) > 0.5 * size else 0.0
    comparison = Comparison(
        float(np.copysign(sure, -down)), ratio / _MOST, ratio / _LEAST, 0.0, np.inf, 1e4, len(force) * motion.grid.step
    )
    words = f"gravity, which must show as {-STANDARD_GRAVITY:.1f} m/s² on z: its median is {down:.2f}"
    return [Relation(FORCE[2], "", comparison, words, 0.0, has_lag=False)]
