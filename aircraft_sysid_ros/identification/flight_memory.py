"""Points of the flight at bounded memory: what a model is extended from, and what is looked at for missing effects.

The newest ``WHOLE`` [s] are kept whole. What is older stays in blocks of ``BLOCK`` [s] that lie evenly over the
flight: every third of them when they are more than ``MOST_BLOCKS``, then every ninth, and so on (three, since blocks
take turns at being held out by four). That is some 5 MB for a flight of any length.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample

Array = npt.NDArray[np.float64]

#: Newest stretch [s] of which every point is kept.
WHOLE = 300.0
#: Length [s] of the blocks of which the older flight is a sample, and the most of them.
BLOCK, MOST_BLOCKS = 5.0, 60


class RememberedSamples(NamedTuple):
    """n points in order of time."""

    time: Array  # (n,) [s] as in CoefficientSample.TIME
    measured: Array  # (n, 6)
    learnt: Array  # (n, 6) 1 where the axis learnt from the point
    signals: Array  # (n, SIGNAL_COUNT)
    bias_std: Array  # (n, 3) one sigma [m/s^2] of the accelerometer bias
    air_velocity_std: Array  # (n,) one sigma [m/s] across the flow


class SampleMemory:
    """Keeps points, and what the first step said of its own errors at their time."""

    def __init__(self) -> None:
        self._recent: deque[tuple[float, Array]] = deque()
        self._older: dict[int, list[Array]] = {}
        self._stride = 1

    def clear(self) -> None:
        """Forget the flight."""
        self._recent.clear()
        self._older.clear()
        self._stride = 1

    def add(self, points: Array, bias_std: Array, air_velocity_std: float) -> None:
        """New samples (m, …) of ``CoefficientSample`` with the accuracy (3,) and [m/s] of the states behind them.

        A clock that started over begins a new memory.
        """
        for point in points:
            time = float(point[CoefficientSample.TIME])
            if self._recent and time <= self._recent[-1][0]:
                self.clear()
            self._recent.append(
                (time, np.concatenate([point[: CoefficientSample.TERMS], bias_std, [air_velocity_std]]))
            )
        while self._recent and self._recent[0][0] < self._recent[-1][0] - WHOLE:
            self._retire(*self._recent.popleft())

    def _retire(self, time: float, row: Array) -> None:
        number = int(time // BLOCK)
        if number % self._stride == 0:
            self._older.setdefault(number, []).append(row)
        if len(self._older) > MOST_BLOCKS:
            self._stride *= 3
            self._older = {n: rows for n, rows in self._older.items() if n % self._stride == 0}

    def newest(self, length: float = WHOLE) -> RememberedSamples:
        """All points of the newest ``length`` [s], at most WHOLE."""
        since = self._recent[-1][0] - length if self._recent else 0.0
        return _kept([row for time, row in self._recent if time >= since])

    def flight(self) -> RememberedSamples:
        """All that is kept of the flight."""
        return _kept([row for rows in self._older.values() for row in rows] + [row for _, row in self._recent])


def _kept(rows: list[Array]) -> RememberedSamples:
    table = np.array(rows) if rows else np.empty((0, CoefficientSample.TERMS + 4))
    return RememberedSamples(
        table[:, CoefficientSample.TIME],
        table[:, CoefficientSample.MEASURED],
        table[:, CoefficientSample.LEARNT],
        table[:, CoefficientSample.SIGNALS],
        table[:, CoefficientSample.TERMS : CoefficientSample.TERMS + 3],
        table[:, CoefficientSample.TERMS + 3],
    )
