"""On the ground again: what is published then is what was known in the air.

Nobody says when an aeroplane meets the ground. It has where it was slower than it can fly for ``landed``
(``thresholds``), in the air and over ground, and neither climbed nor sank meanwhile, after it had flown: a stall is
shorter, and sinks, and where the airspeed fails it still moves over ground. On its run before that it was fast enough
to be learnt from, for ``rolling`` at most, and what wheels did is in the coefficients. So what was known ``rolling``
before it became too slow is published while it stands, with the statuses of that time, and is what is known when it
takes off again. In wind one that stands may be as fast as one that flies: what lasts less than ``flown`` is a gust or a
hop, after which the same is published again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.history import ParameterCheckpoint
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]

_LEVEL = THRESHOLDS.level
_MEMORY = THRESHOLDS.rolling + THRESHOLDS.landed + 5.0  # [s]
_TIME, _AIRSPEED, _NORTH = StateField.TIME, StateField.AIRSPEED, StateField.VELOCITY.start
_SLOW_SINCE, _FLOWN, _NEWEST = range(3)


class Known(NamedTuple):
    """What was known at a time, and how it was published."""

    kept: ParameterCheckpoint
    publish: Callable[[], ParameterSet]


@njit(cache=True)
def _follow(rows: Array, minimum_airspeed: float, motion: Array) -> bool:
    """Take states (n, StateField.WIDTH) in order of time; whether it was fast, or climbed or sank, in any of them.

    motion (3,) [s]: since when it has been slow and level, infinite if it is not; how long it has flown; the newest.
    """
    was_fast = False
    for row in rows:
        time, airspeed = row[_TIME], row[_AIRSPEED]
        north, east, down = row[_NORTH], row[_NORTH + 1], row[_NORTH + 2]
        if airspeed >= minimum_airspeed and np.isfinite(motion[_NEWEST]):
            motion[_FLOWN] += time - motion[_NEWEST]
        motion[_NEWEST] = time
        over_ground = np.sqrt(north * north + east * east)
        if airspeed < minimum_airspeed and over_ground < minimum_airspeed and abs(down) < _LEVEL:
            motion[_SLOW_SINCE] = min(motion[_SLOW_SINCE], time)
        else:
            motion[_SLOW_SINCE], was_fast = np.inf, True
    return was_fast


class Landing:
    """Watches the states, and remembers what was known of late."""

    def __init__(self, minimum_airspeed: float) -> None:
        """``minimum_airspeed`` [m/s] below which it does not fly."""
        self._minimum_airspeed = minimum_airspeed
        self.restart()

    def restart(self) -> None:
        """The clock started over."""
        self._kept: deque[Known] = deque()
        self._motion = np.array([np.inf, 0.0, np.nan])
        self._air: Known | None = None  # what is published on the ground, or was there last
        self.since = np.nan  # [s] on the ground since then; NaN: in flight

    def add(self, rows: Array) -> None:
        """States (n, StateField.WIDTH) in order of time."""
        if _follow(rows, self._minimum_airspeed, self._motion):
            self.since = np.nan

    def keep(self, known: Known) -> None:
        """What is known now."""
        if np.isnan(self.since):
            self._kept.append(known)
            while self._kept[0].kept.time < known.kept.time - _MEMORY:
                self._kept.popleft()

    def touched_down(self, now: float) -> Known | None:
        """What was known in the air, once, where it is found ``now`` [s] to be on the ground."""
        slow_since, flown, _ = self._motion.tolist()
        if not np.isnan(self.since) or now - slow_since < THRESHOLDS.landed:
            return None
        known = self._air
        if flown >= THRESHOLDS.flown:
            before = slow_since - THRESHOLDS.rolling
            known = next((each for each in reversed(self._kept) if each.kept.time <= before), None)
        if known is None:
            return None
        self._air, self.since = known, slow_since
        self._motion[_FLOWN] = 0.0
        self._kept.clear()
        return known

    def published(self, now: float, start: float) -> ParameterSet | None:
        """On the ground: what was known in the air, as of ``now`` [s] in a flight since ``start`` [s]; else None."""
        if self._air is None or np.isnan(self.since):
            return None
        found, words = self._air.publish(), self.words(start)
        elapsed = now - found.time if np.isfinite(now - found.time) else 0.0
        parameters = [
            replace(p, age=p.age + elapsed, reason="; ".join(filter(None, (p.reason, words)))) for p in found.parameters
        ]
        return replace(found, time=now, parameters=tuple(parameters))

    def words(self, start: float) -> str:
        """That it is on the ground, in a flight since ``start`` [s]; empty: it is not."""
        if np.isnan(self.since):
            return ""
        return f"on the ground since {max(self.since - start, 0.0):.1f} s: the values are those from the air"
