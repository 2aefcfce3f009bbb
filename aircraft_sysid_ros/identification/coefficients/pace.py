"""How fast states come, known from their times alone: what the second step does depends on it.

Where they are dense, up to LONG [s] apart, nothing depends on it. Where they are sparse the interval between them is
the median of a BLOCK, so that lost samples and jitter do not count, and is taken anew where it has become another by
more than CHANGE. Blocks are counted from the first state on: the interval at a state depends on the times before it,
and not on the portions in which they came.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.reconstruction.sparse_imu import LONG
from aircraft_sysid_ros.reconstruction.state_row import SENSOR_TIMEOUT
from aircraft_sysid_ros.samples import Kind, Samples

Array = npt.NDArray[np.float64]

#: Intervals of a block.
BLOCK = 24
#: Intervals of the first block that show how fast samples come.
_FEW = 3
#: Factor by which an interval must change to be taken anew.
CHANGE = 1.3
#: Rate [Hz] below which nothing is learnt, and how far it may be missed: a median of few jittered intervals errs.
LOWEST_RATE, SLACK = 10.0, 1.25
#: Intervals that are so many times as long as usual are gaps where samples are sparse: nobody knows what was in them.
GAP = 1.5
#: Time [s] between states over which goes on what differentiates nothing: lags, transforms and filters.
BRIDGED_GAP = 0.1
#: Share of a parameter that may be lost to what no sample saw, at LOWEST_RATE; it goes with the square of the interval.
#: The rms of flights of perfect sensors, of the derivatives that it is worst for (docs/parameters.md).
SAMPLING_ERROR = 0.025
#: Time [s] between samples of the controls over which they are known, beside sparse states.
SPARSEST_CONTROLS = GAP / LOWEST_RATE


def stamped_behind(seconds: float) -> str:
    """What is said of samples that no waiting helps, at least so late [s]."""
    return f"whose stamps are {seconds:.3g} s behind those of the IMU: stamp all by one clock"


def too_late(seconds: float) -> str:
    """What is said of samples that all come too late to be used, by so much [s] at least; a longer wait may help."""
    return (
        f"whose samples come {seconds:.2g} s too late to be used, or more: stamp all by one clock, and where the "
        "stamps are right choose a longer horizon"
    )


def too_slow(rate: float) -> str:
    """What is said of an IMU at ``rate`` [Hz] from which nothing can be learnt."""
    return f"the IMU comes at {rate:.2g} Hz: derivatives need at least {LOWEST_RATE:g} Hz"


def sampling_error(interval: float) -> float:
    """Share of a parameter that may be lost to what happens between samples ``interval`` [s] apart; 0 where dense."""
    return SAMPLING_ERROR * (interval * LOWEST_RATE) ** 2


def interval_of(samples: Samples, kind: Kind) -> float:
    """Median time [s] between samples of a kind, those of one time as one; NaN where there are not two times."""
    stamps = np.unique(samples.stamp[samples.kind == kind])
    return float(np.median(np.diff(stamps))) * 1e-9 if len(stamps) > 1 else np.nan


def sparse_interval(samples: Samples) -> float:
    """Median time [s] between samples of the IMU of a recording where they are sparse, else 0."""
    interval = interval_of(samples, Kind.IMU)
    return interval if interval > LONG else 0.0


def why_too_slow(samples: Samples) -> str:
    """That the IMU of a recording is too slow, in words; empty where it is not."""
    interval = interval_of(samples, Kind.IMU)
    return too_slow(1.0 / interval) if interval * LOWEST_RATE > SLACK else ""


def why_controls_too_slow(samples: Samples) -> str:
    """The same of the controls, from which nothing is known between the samples."""
    interval = interval_of(samples, Kind.CONTROLS)
    slow = f"the controls come at {1.0 / interval:.2g} Hz: at least {LOWEST_RATE:g} Hz are needed"
    return slow if interval > SPARSEST_CONTROLS else ""


def why_airspeed_too_slow(samples: Samples) -> str:
    """The same of the airspeed, which is not known where it is silent for ``SENSOR_TIMEOUT``."""
    interval = interval_of(samples, Kind.AIRSPEED)
    slow = f"the airspeed comes at {1.0 / interval:.2g} Hz: at least {1.0 / SENSOR_TIMEOUT:g} Hz is needed"
    return slow if interval > SENSOR_TIMEOUT else ""


class Pace:
    """Of one series of times."""

    def __init__(self) -> None:
        self.interval = 0.0  # [s]; 0: dense, or not known yet
        self._is_known = False  # a block has been full
        self.least_late = np.inf  # [s] by which the least late of those came too late that did
        self._in_time = False  # any came in time
        self.restart()

    def restart(self) -> None:
        """The clock started over; the rate is taken to be what it was."""
        self._newest = np.nan
        self._open = np.empty(0)

    @property
    def shown(self) -> float:
        """Time [s] between samples, in the first block by those that have come; infinite while too few have."""
        if self.interval > 0.0 or np.isnan(self._newest) or self._is_known:
            return self.interval
        return float(np.median(self._open)) if len(self._open) >= _FEW else np.inf

    def note_late(self, late: Array, in_time: bool) -> None:
        """By how much [s] samples (n,) came too late, and whether others came in time."""
        self.least_late = min(self.least_late, float(np.min(late, initial=np.inf)))
        self._in_time = self._in_time or in_time

    @property
    def behind(self) -> float:
        """By how much [s] all samples came too late, at least; 0 where some came in time, or none at all."""
        return 0.0 if self._in_time or not np.isfinite(self.least_late) else self.least_late

    @property
    def is_sparse(self) -> bool:
        """Samples are so far apart that what happens between them counts."""
        return self.interval > 0.0

    @property
    def is_too_slow(self) -> bool:
        """Nothing can be learnt."""
        return self.interval * LOWEST_RATE > SLACK

    @property
    def rate(self) -> float:
        """[Hz]; infinite where samples are dense."""
        return 1.0 / self.interval if self.is_sparse else np.inf

    @property
    def sampling_error(self) -> float:
        """Share of a parameter that may be lost to what happens between samples; 0 where they are dense."""
        return sampling_error(self.interval)

    def largest_gap(self, dense: float, intervals: float = GAP) -> float:
        """Longest time [s] between samples that is no gap: ``dense``, or so many intervals where they are sparse."""
        if self.is_too_slow:
            return 0.0
        return max(dense, intervals * self.interval) if self.is_sparse else dense

    def seen_by(self, aircraft: Aircraft) -> Aircraft:
        """The aircraft with the rates that samples really have, where they are sparse."""
        if not self.is_sparse:
            return aircraft
        sensors = dict(aircraft.sensors)
        for name in ("accelerometer", "gyro"):
            sensors[name] = replace(sensors[name], rate=self.rate)
        controls = sensors["control_surfaces"]  # read at the times of states
        sensors["control_surfaces"] = replace(controls, rate=min(controls.rate, self.rate))
        return replace(aircraft, sensors=sensors)

    def follow(self, times: Array) -> Iterator[slice]:
        """Parts of times [s] (n,), ascending, at each of which ``interval`` is that of all of the part."""
        cuts, found = self._blocks(times)
        edges = [0, *cuts, len(times)]
        for (begin, end), interval in zip(pairwise(edges), [self.interval, *found], strict=True):
            self.interval = interval
            if end > begin:
                yield slice(begin, end)

    def take(self, times: Array) -> None:
        """Times [s] (n,), ascending."""
        for _ in self.follow(times):
            pass

    def _blocks(self, times: Array) -> tuple[list[int], list[float]]:
        """Where the interval becomes another one, and which; a block counts after its last time."""
        intervals = np.diff(times, prepend=self._newest)
        waiting = np.concatenate([self._open, intervals[np.isfinite(intervals)]])
        self._newest = float(times[-1]) if len(times) else self._newest
        full = len(waiting) // BLOCK
        self._open = waiting[full * BLOCK :]
        self._is_known |= full > 0
        cuts, found, now = [], [], self.interval
        ordered = np.sort(waiting[: full * BLOCK].reshape(full, BLOCK), axis=1)
        medians = 0.5 * (ordered[:, (BLOCK - 1) // 2] + ordered[:, BLOCK // 2])
        for number, median in enumerate(np.where(medians > LONG, medians, 0.0).tolist()):
            if median > CHANGE * now or CHANGE * median < now:
                now = median
                cuts.append(len(times) - len(self._open) - (full - 1 - number) * BLOCK)
                found.append(now)
        return cuts, found
