"""Values of a quantity as they came, to be looked up by what another quantity needs of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aircraft_sysid_ros.mavlink.quantities import Array, Stamps
from aircraft_sysid_ros.stamps import NANOSECONDS


@dataclass
class Held:
    """Values of a quantity in order of time, to be looked up; all of a log, or the newest of a flight."""

    stamp: Stamps = field(default_factory=lambda: np.empty(0, np.int64))
    values: Array = field(default_factory=lambda: np.empty((0, 0)))

    def add(self, stamp: Stamps, values: Array, keep: int | None) -> None:
        """Take n values; ``keep`` bounds how many stay. A clock that went back forgets what it said."""
        if len(self.stamp) and len(stamp) and stamp[0] < self.stamp[-1] - NANOSECONDS:
            self.stamp, self.values = self.stamp[:0], self.values[:0]
        if len(self.stamp):
            width = max(values.shape[1], self.values.shape[1])
            stamp = np.concatenate([self.stamp, stamp])
            values = np.vstack([wide(self.values, width), wide(values, width)])
        order = np.argsort(stamp, kind="stable") if np.any(np.diff(stamp) < 0) else slice(None)
        self.stamp, self.values = stamp[order], values[order]
        if keep is not None:
            self.stamp, self.values = self.stamp[-keep:], self.values[-keep:]

    def at(self, stamp: Stamps, age: float, column: int = 0) -> Array:
        """Last value (n,) at or before each stamp, not older than ``age`` [s]; else NaN."""
        if column >= self.values.shape[1]:
            return np.full(len(stamp), np.nan)
        return _last(self.stamp, self.values[:, column], stamp, age)

    def number_at(self, stamp: Stamps, age: float, column: int) -> Array:
        """The same of the last number in a column: each of several senders knows its own."""
        if column >= self.values.shape[1]:
            return np.full(len(stamp), np.nan)
        known = np.isfinite(self.values[:, column])
        return _last(self.stamp[known], self.values[known, column], stamp, age)


def _last(held: Stamps, values: Array, stamp: Stamps, age: float) -> Array:
    rows = np.searchsorted(held, stamp, side="right") - 1
    found = np.full(len(stamp), np.nan)
    if len(held):
        near = (rows >= 0) & (stamp - held[np.maximum(rows, 0)] <= age * NANOSECONDS)
        found[near] = values[rows[near]]
    return found


def wide(values: Array, width: int) -> Array:
    """Values (n, k) with ``width`` columns, NaN in those that are new."""
    if values.shape[1] == width:
        return values
    return np.pad(values, ((0, 0), (0, width - values.shape[1])), constant_values=np.nan)
