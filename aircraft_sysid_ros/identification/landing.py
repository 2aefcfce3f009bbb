"""On the ground again: what is published then is what was known in the air.

Nobody says when an aeroplane meets the ground. It has where it was slower than it can fly for SLOW, in the air
and over ground, and neither climbed nor sank meanwhile, after it had flown: a stall is shorter, and sinks, and where
the airspeed fails it still moves over ground. On its run before that it was fast enough to be
learnt from, for ROLLING at most, and what wheels did is in the coefficients. So what was known ROLLING before it became
too slow is published while it stands, with the statuses of that time, and is what is known when it takes off again.
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
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]

#: [s] too slow to fly, as in diagnosis/flight/wheels.py; [s] of the run before it, as ``rolling`` of its thresholds.
SLOW, ROLLING = 5.0, 20.0
#: [m/s] of climb and descent on the ground at most, and [s] in flight before there is a landing.
LEVEL, FLOWN = 1.0, 30.0
_MEMORY = ROLLING + SLOW + 5.0


class Known(NamedTuple):
    """What was known at a time, and how it was published."""

    kept: ParameterCheckpoint
    publish: Callable[[], ParameterSet]


class Landing:
    """Watches the states, and remembers what was known of late."""

    def __init__(self, minimum_airspeed: float) -> None:
        """``minimum_airspeed`` [m/s] below which it does not fly."""
        self._minimum_airspeed = minimum_airspeed
        self.restart()

    def restart(self) -> None:
        """The clock began anew."""
        self._kept: deque[Known] = deque()
        self._slow_since, self._flown, self._newest = np.inf, 0.0, np.nan
        self._air: Known | None = None  # what is published on the ground
        self.since = np.nan  # [s] on the ground since then

    def add(self, rows: Array) -> None:
        """States (n, StateField.WIDTH) in order of time."""
        time = rows[:, StateField.TIME]
        north, east, down = rows[:, StateField.VELOCITY].T
        speed = np.maximum(rows[:, StateField.AIRSPEED], np.hypot(north, east))
        slow = (speed < self._minimum_airspeed) & (np.abs(down) < LEVEL)
        steps = np.diff(time, prepend=self._newest if np.isfinite(self._newest) else time[:1])
        self._flown += float(steps[rows[:, StateField.AIRSPEED] >= self._minimum_airspeed].sum())
        self._newest = float(time[-1])
        fast = np.flatnonzero(~slow)
        if len(fast):
            self._slow_since = np.inf
            self._air, self.since = None, np.nan
        first = fast[-1] + 1 if len(fast) else 0
        if first < len(rows):
            self._slow_since = min(self._slow_since, float(time[first]))

    def keep(self, known: Known) -> None:
        """What is known now."""
        if self._air is None:
            self._kept.append(known)
            while self._kept[0].kept.time < known.kept.time - _MEMORY:
                self._kept.popleft()

    def touched_down(self, now: float) -> Known | None:
        """What was known in the air, once, where it is found ``now`` [s] to be on the ground."""
        if self._air is not None or now - self._slow_since < SLOW or self._flown < FLOWN:
            return None
        before = [known for known in self._kept if known.kept.time <= self._slow_since - ROLLING]
        if not before:
            return None
        self._air, self.since = before[-1], self._slow_since
        self._kept.clear()
        return self._air

    def published(self, now: float, start: float) -> ParameterSet | None:
        """On the ground: what was known in the air, as of ``now`` [s] in a flight since ``start`` [s]; else None."""
        if self._air is None:
            return None
        found, words = self._air.publish(), self.words(start)
        elapsed = now - found.time if np.isfinite(now - found.time) else 0.0
        parameters = [
            replace(p, age=p.age + elapsed, reason="; ".join(filter(None, (p.reason, words)))) for p in found.parameters
        ]
        return replace(found, time=now, parameters=tuple(parameters))

    def words(self, start: float) -> str:
        """That it is on the ground, in a flight since ``start`` [s]; empty: it is not."""
        if self._air is None:
            return ""
        return f"on the ground since {max(self.since - start, 0.0):.1f} s: the values from the air"
