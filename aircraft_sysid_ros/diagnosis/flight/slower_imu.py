"""A recording whose IMU is as fast as a likelihood of the sensors needs it.

The search for what is wrong with the sensors flies the recording some hundred times. Between 50 Hz and 400 Hz no
aeroplane moves in a way that GPS or air data could tell, so that the mean of neighbouring samples says the same: the
likelihood of each setting is that of all samples to about a per cent (test_slower_imu.py), in a half of the time at
200 Hz.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.pace import interval_of
from aircraft_sysid_ros.samples import LARGEST_VALUES, Kind, Samples

Array = npt.NDArray[np.float64]

#: Time [s] from one mean to the next, at most.
LONGEST = 0.02
#: What is no gap, over the usual time between samples.
_NO_GAP = 1.5
#: Specific force and rates, and beyond what they are no measurements.
_OUTPUTS = 6
_LARGEST = LARGEST_VALUES[Kind.IMU][:_OUTPUTS]


def with_slower_imu(aircraft: Aircraft, samples: Samples) -> tuple[Aircraft, Samples]:
    """Means of as many samples of the IMU as follow each other within LONGEST, and as few of a fast attitude.

    Of an attitude, whose error is slow, one in so many is left. No mean reaches over a gap, a seam, or a step of time
    back, and what is no measurement is in none. The aircraft has the noise of a mean.
    """
    together, slower = _slower(samples)
    if together > 1:
        sensors = dict(aircraft.sensors)
        for name in ("accelerometer", "gyro"):
            less = tuple(value / np.sqrt(together) for value in sensors[name].noise)
            sensors[name] = replace(sensors[name], noise=less)
        aircraft = replace(aircraft, sensors=sensors)
    return aircraft, slower


@lru_cache(maxsize=2)  # one recording is flown with many settings
def _slower(samples: Samples) -> tuple[int, Samples]:
    """How many samples of the IMU are one, and the samples then."""
    together = _together(samples, Kind.IMU)
    slower = _averaged(samples, together) if together > 1 else samples
    every = _together(slower, Kind.ATTITUDE)
    if every > 1:
        kept = slower.kind != Kind.ATTITUDE
        kept[np.flatnonzero(~kept)[::every]] = True
        slower = slower[kept]
    return together, slower


def _together(samples: Samples, kind: Kind) -> int:
    """How many samples of a kind follow each other within LONGEST."""
    interval = interval_of(samples, kind)
    return int(LONGEST / interval * 1.01) if interval > 0.0 else 1


def _averaged(samples: Samples, together: int) -> Samples:
    """Where a group of samples of the IMU ends stands its mean."""
    at = np.flatnonzero(samples.kind == Kind.IMU)
    stamp, values = samples.stamp[at], samples.values[at]
    apart = np.diff(stamp)
    begins = (apart <= 0) | (apart > _NO_GAP * np.median(apart))
    begins |= np.diff(np.cumsum(samples.kind == Kind.SEAM)[at]) > 0
    run = np.concatenate([[0], np.cumsum(begins)])
    since = np.arange(len(at)) - np.searchsorted(run, run)  # the beginning of its run
    first = np.flatnonzero(since % together == 0)
    last = np.append(first[1:], len(at)) - 1
    sound = (np.isfinite(values[:, :_OUTPUTS]) & (abs(values[:, :_OUTPUTS]) <= _LARGEST)).all(axis=1)
    count: Array = np.add.reduceat(sound.astype(np.float64), first)
    some = np.flatnonzero(count > 0.0)
    mean, middle = values[last], stamp[last]
    sums = np.add.reduceat(np.where(sound[:, None], values[:, :_OUTPUTS], 0.0), first, axis=0)
    mean[some, :_OUTPUTS] = sums[some] / count[some, None]
    late = np.add.reduceat((stamp - np.repeat(stamp[first], last - first + 1)) * sound, first)
    middle[some] = stamp[first][some] + np.rint(late[some] / count[some]).astype(np.int64)
    kept = samples.kind != Kind.IMU
    kept[at[last]] = True
    all_values, all_stamps = samples.values.copy(), samples.stamp.copy()
    all_values[at[last]], all_stamps[at[last]] = mean, middle
    return Samples(all_stamps, samples.kind, all_values)[kept]
