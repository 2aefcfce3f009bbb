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
#: Least share of the time upright, and inverted, of a flight with both: a body that is always inverted has other axes.
_BOTH = 0.1


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
    has_sign = not _is_inverted(motion, down)
    return [Relation(FORCE[2], "", comparison, words, 0.0, has_lag=False, has_sign=has_sign)]


def _is_inverted(motion: Motion, down: float) -> bool:
    """Whether by the attitude the median ``down`` of z is that of inverted flight: its sign is left to GPS velocity."""
    upright, force = motion.rotation[:, 2, 2], motion.force[:, 2]
    known = np.isfinite(upright * force)
    if not np.any(known) or not _BOTH < np.mean(upright[known] > 0.0) < 1.0 - _BOTH:
        return False
    return bool(np.median(force[known] * upright[known]) * down < 0.0)
