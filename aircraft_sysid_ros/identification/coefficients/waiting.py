"""Samples that come before the states of their time: however long they wait, the next one costs as much."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.samples import Kind, Samples, concatenate

#: Samples that wait, as many as the topic of states holds; older ones are dropped. So are masses beyond as many, but
#: for nothing else: one may have been said once, an hour before the flight.
MOST_WAITING = 50_000
#: Batches that are joined at a time.
_JOINED = 1000


class WaitingSamples:
    """Samples in order of arrival, until states of their time come."""

    def __init__(self) -> None:
        self._joined, self._new = concatenate([]), list[Samples]()
        self._first = np.inf  # stamp [ns]

    def add(self, samples: Samples) -> None:
        """Let samples wait."""
        if len(samples):
            self._new.append(samples)
            self._first = min(self._first, int(samples.stamp.min()))
        if len(self._new) > _JOINED:
            self._join()

    def take(self, until: float = np.inf) -> Samples:
        """What is stamped ``until`` [ns] at most, which waits no longer, and all masses."""
        if until < self._first or not (len(self._joined) or self._new):
            return concatenate([])
        self._join()
        is_due = (self._joined.stamp <= until) | (self._joined.kind == Kind.MASS)
        due, self._joined = self._joined[is_due], self._joined[~is_due]
        self._first = int(self._joined.stamp.min()) if len(self._joined) else np.inf
        return due

    def forget(self) -> None:
        """What waits is by another clock."""
        self._joined, self._first = concatenate([]), np.inf
        self._new.clear()

    def _join(self) -> None:
        waiting = concatenate([self._joined, *self._new])
        of_mass = waiting.kind == Kind.MASS
        after = np.where(of_mass, of_mass.sum() - np.cumsum(of_mass), (~of_mass).sum() - np.cumsum(~of_mass))
        self._joined = waiting[after < MOST_WAITING]
        self._new.clear()
        self._first = int(self._joined.stamp.min()) if len(self._joined) else np.inf
