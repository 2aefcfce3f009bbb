"""Which GPS there is in a flight: found out from the samples, and without losing any of them.

Recordings and live nodes do not say what will come. While GPS position or velocity have not come, the samples are kept;
once the aircraft has flown for PATIENCE without them, or the recording ends, they count as not there, and the filter
begins with the first sample that was kept. It depends on stamps alone, so that live and replay decide alike. After the
filter was lost the same holds of the GPS that was there: it may have been lost, too.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.reconstruction.alignment import GPS, WINDOW

Array = npt.NDArray[np.float64]
Sample = tuple[float, int, Array]

#: Flight [s] without GPS position or velocity after which they are not waited for.
PATIENCE = 5.0


class Batch(NamedTuple):
    """Samples in order of time."""

    times: Array  # (n,) [s]
    kinds: npt.NDArray[np.int64]  # (n,)
    values: Array  # (n, WIDTH)

    def followed_by(self, other: Batch) -> Batch:
        """This one and then the other."""
        return Batch(*(np.concatenate(both) for both in zip(self, other, strict=True)))


class GpsWait:
    """Keeps samples, in order of time, until it is decided."""

    def __init__(self) -> None:
        #: Kinds of GPS samples that are there, None while it is not decided.
        self.decided: frozenset[int] | None = None
        self._kept: deque[Sample] = deque()
        self._flying_since = np.inf

    def forget(self) -> None:
        """There was a gap: what was kept is of no use."""
        self._kept.clear()
        self._flying_since = np.inf

    def reconsider(self) -> None:
        """GPS has come that was taken as not there."""
        self.decided = None
        self.forget()

    def keep(self, sample: Sample, seen: frozenset[int]) -> None:
        """Keep a sample, if it may be needed: not all of the GPS that is waited for has been ``seen``."""
        if seen >= (GPS if self.decided is None else self.decided):
            self._kept.clear()
            return
        self._kept.append(sample)
        if np.isinf(self._flying_since):
            while self._kept[0][0] < sample[0] - 2.0 * WINDOW:
                self._kept.popleft()

    def is_over(self, time: float, flies: bool) -> bool:
        """Whether the wait ends at an IMU sample at ``time`` [s]."""
        if not self._kept:
            return False
        self._flying_since = min(self._flying_since, time) if flies else np.inf
        return time - self._flying_since >= PATIENCE

    def decide(self, seen: frozenset[int]) -> Batch:
        """What has come is what there is; returns what was kept."""
        self.decided = seen
        kept = list(self._kept)
        self.forget()
        times = np.array([time for time, _, _ in kept])
        kinds = np.array([kind for _, kind, _ in kept], dtype=np.int64)
        return Batch(times, kinds, np.array([values for _, _, values in kept]))

    @property
    def waits(self) -> bool:
        """Whether samples are kept for a decision."""
        return len(self._kept) > 0
