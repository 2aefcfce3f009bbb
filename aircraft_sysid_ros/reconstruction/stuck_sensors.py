"""Air data that stand still to the last bit while the aeroplane moves: a dead sensor, or a driver that repeats itself.

A filter cannot see it: wind explains an airspeed that never changes, and in gusts wind is expected to move. But no
sensor in moving air gives one number for long. What repeats it for STILL_TIME while the accelerometer says that the
aeroplane moves is taken for invalid until it changes; where nothing moves, it may be right.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.samples import Kind, Samples

Array = npt.NDArray[np.float64]

STILL_TIME = 2.0  # [s]
#: Standard deviation of the specific force [m/s^2] that is motion, three to ten times the noise of its sensors.
MOTION = 0.5
_KINDS = (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
_LARGEST_FORCE = 1e4  # [m/s^2]; more is no number


class _Run(NamedTuple):
    """One number that repeats itself."""

    value: float
    since: int  # [ns]
    sums: Array  # (7,) of the accelerometer when it began
    dead: bool


class StuckSensors:
    """Looks at samples in the order of arrival, in portions of any size."""

    def __init__(self, minimum_airspeed: float) -> None:
        self._minimum_airspeed = minimum_airspeed
        self._sums = np.zeros(7)  # of the accelerometer: number, sums, sums of squares
        self._runs = {kind: _Run(np.nan, 0, self._sums, False) for kind in _KINDS}

    def without(self, samples: Samples) -> Samples:
        """The samples; those that stand still are NaN."""
        sums, flies = self._follow(samples), self._flies(samples)
        dead = np.concatenate([self._dead(kind, samples, sums) for kind in _KINDS])
        dead = dead[flies[dead]]
        if not len(dead):
            return samples
        values = samples.values.copy()
        values[dead, 0] = np.nan
        return Samples(samples.stamp, samples.kind, values)

    def _flies(self, samples: Samples) -> npt.NDArray[np.bool_]:
        """Whether the newest airspeed at each sample (n,) is one to fly with, or not known."""
        at = np.flatnonzero(samples.kind == Kind.AIRSPEED)
        speeds = np.concatenate([[self._runs[Kind.AIRSPEED].value], samples.values[at, 0]])
        newest = speeds[np.searchsorted(at, np.arange(len(samples)), side="right")]
        return ~np.asarray(newest < self._minimum_airspeed)

    def _follow(self, samples: Samples) -> Array:
        """Sums of the accelerometer up to each sample (n, 7)."""
        force = samples.values[:, :3]
        sound = (samples.kind == Kind.IMU) & np.all(np.abs(force) < _LARGEST_FORCE, axis=1)
        force = np.where(sound[:, None], force, 0.0)
        rows = np.concatenate([self._sums[None], np.column_stack([sound, force, force**2])])
        sums = np.cumsum(rows, axis=0)[1:]
        if len(sums):
            self._sums = sums[-1]
        return sums

    def _dead(self, kind: Kind, samples: Samples, sums: Array) -> npt.NDArray[np.int64]:
        """Indices of the samples of a kind that stand still."""
        at = np.flatnonzero(samples.kind == kind)
        if not len(at):
            return at
        values, stamps, run = samples.values[at, 0], samples.stamp[at], self._runs[kind]
        begins = values != np.concatenate([[run.value], values[:-1]])  # NaN is never the same
        start = np.maximum.accumulate(np.where(begins, np.arange(len(at)), -1))
        long = stamps - np.where(start < 0, run.since, stamps[start]) > int(STILL_TIME * 1e9)
        found = [at[:0]]
        for first in np.unique(start[long | ((start < 0) & run.dead)]).tolist():
            one = self._run(run, first, at, samples, sums)
            members = start == first
            dead = np.logical_or.accumulate(long[members] & self._moves(one, sums[at[members]])) | one.dead
            found.append(at[members][dead])
            if first == start[-1]:
                self._runs[kind] = one._replace(dead=bool(dead[-1]))
                return np.concatenate(found)
        self._runs[kind] = self._run(run, int(start[-1]), at, samples, sums)
        return np.concatenate(found)

    @staticmethod
    def _run(before: _Run, first: int, at: npt.NDArray[np.int64], samples: Samples, sums: Array) -> _Run:
        """The run that begins at the sample ``first``, that from ``before`` if it is negative."""
        if first < 0:
            return before
        return _Run(float(samples.values[at[first], 0]), int(samples.stamp[at[first]]), sums[at[first]], False)

    @staticmethod
    def _moves(run: _Run, sums: Array) -> npt.NDArray[np.bool_]:
        """Whether the aeroplane has moved from the beginning of the run to each sample (n,)."""
        since = sums - run.sums
        number = np.maximum(since[:, :1], 1.0)
        variance = since[:, 4:] / number - (since[:, 1:4] / number) ** 2
        return np.asarray(variance.sum(axis=1) > MOTION**2)
