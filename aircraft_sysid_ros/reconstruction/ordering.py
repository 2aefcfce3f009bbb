"""Time order: samples arrive late and mixed; they leave in the order of the times at which they were taken.

The stamps of the IMU are the clock, since it is the fastest sensor. A sample is held until the clock has
passed it by the horizon plus the longest sensor delay, so that one that is late by less than the horizon
takes its own place, and the result depends on stamps alone: live and replay are the same to the last bit.
What comes later still is dropped and counted. So is a sample that is there already: of a topic that was recorded twice
every measurement would count as two.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.samples import REQUIRED_VALUES, Kind, Samples, concatenate, is_absurd, repeats
from aircraft_sysid_ros.stamps import NANOSECONDS

#: An IMU stamp that leaps further ahead than this [ns] is believed only if the next one confirms it.
LARGEST_LEAP = 120 * NANOSECONDS
#: Two stamps this close [ns] confirm each other.
_CONFIRMATION = 1 * NANOSECONDS
#: Samples further ahead of the clock than this [ns] have a wrong stamp.
_FUTURE = 30 * NANOSECONDS
#: So do those of GPS further ahead than this [ns] of all other sensors: time of GPS is 18 s ahead of UTC.
_GPS_FUTURE = 5 * NANOSECONDS
_GPS = (Kind.GPS_POSITION, Kind.GPS_VELOCITY)
_MOST_HELD = 200_000
_NEVER = 1 << 62
#: So many samples, and such a share of them, with the stamp of the one before: two sensors may send under one name.
_MANY, _MOST_STAND = 50, 0.6
#: Such a share of the GPS that is ahead is worth a word: it may run on while the IMU does not.
_MOST_AHEAD = 0.5
#: No driver holds the IMU back for so long [ns]: of so many samples each of which is stamped further ahead of the IMU
#: than that when it comes, the clock is ahead.
_CLOCK_AHEAD, _ENOUGH = NANOSECONDS // 2, 10
#: Such a share of samples that came again is worth a word.
_MOST_REPEATED = 0.01
#: Stamps that step by more [s] begin another part, and one of fewer samples is wrong stamps.
_STEP, _LEAST_PART = 1.0, 50


@dataclass
class OrderCounts:
    """What was dropped and why, by kind where that matters."""

    received: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(Kind), np.int64))
    invalid: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(Kind), np.int64))
    late: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(Kind), np.int64))
    wrong_stamp: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(Kind), np.int64))
    #: The same sample once more.
    repeated: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(Kind), np.int64))
    #: By how much [ns] the least late of those that were late came too late.
    least_late: npt.NDArray[np.int64] = field(default_factory=lambda: np.full(len(Kind), _NEVER))
    #: Samples that came when the IMU had shown the clock, and by how much [ns] the least early was ahead of it then.
    clocked: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(Kind), np.int64))
    least_early: npt.NDArray[np.int64] = field(default_factory=lambda: np.full(len(Kind), _NEVER))
    #: By how much [ns] the least early of those that were ahead of all other sensors were.
    least_ahead: npt.NDArray[np.int64] = field(default_factory=lambda: np.full(len(Kind), _NEVER))
    standing: int = 0  # samples of the IMU with the stamp of the one before
    restarts: int = 0

    @property
    def stamps_in_words(self) -> str:
        """That the stamps of the IMU, which are the clock, are none; empty: they rise."""
        received, repeated = int(self.received[Kind.IMU]), int(self.repeated[Kind.IMU])
        standing = self.standing - repeated
        if standing < _MANY or standing < _MOST_STAND * (received - repeated):
            return ""
        return (
            f"the stamps of the IMU do not advance: {self.standing} of {received} samples have that of the one before; "
            "the driver must stamp each with the time at which it was taken"
        )

    @property
    def repeated_in_words(self) -> str:
        """That samples came more than once; empty: next to none did."""
        many = [kind for kind in Kind if self.repeated[kind] > _MOST_REPEATED * max(int(self.received[kind]), 1)]
        if not many:
            return ""
        listed = ", ".join(f"{self.repeated[kind]} of {self.received[kind]} of {kind.name.lower()}" for kind in many)
        return (
            f"samples came again with the same stamp and values, and count once ({listed}): is a topic recorded twice, "
            "or sent by two programs?"
        )

    @property
    def gps_in_words(self) -> str:
        """That GPS is stamped by a clock that is ahead of that of the other sensors; empty: it is not."""
        wrong = [kind for kind in _GPS if self.wrong_stamp[kind] > _MOST_AHEAD * max(int(self.received[kind]), 1)]
        if not wrong:
            return ""
        count, total = (int(sum(each[kind] for kind in wrong)) for each in (self.wrong_stamp, self.received))
        ahead = float(min(self.least_ahead[kind] for kind in wrong)) / NANOSECONDS
        leap = ", as GPS time is ahead of UTC" if 17.0 <= ahead < 19.0 else ""
        return (
            f"{count} of {total} samples of the GPS are stamped {ahead:.1f} s or more ahead of the other sensors{leap}"
            ", and are left out: stamp them by the clock that stamps the IMU"
        )

    @property
    def ahead_in_words(self) -> str:
        """That sensors are stamped by a clock that is ahead of that of the IMU, and are used; empty: none are."""
        early = (self.clocked >= _ENOUGH) & (self.least_early > _CLOCK_AHEAD) & (self.least_ahead == _NEVER)
        listed = [
            f"{Kind(int(k)).name.lower()} by {self.least_early[k] / NANOSECONDS:.1f} s" for k in np.flatnonzero(early)
        ]
        if not listed:
            return ""
        return (
            f"stamps are ahead of those of the IMU that come with them ({', '.join(listed)} or more), so that they are "
            "used at the wrong time: stamp all by one clock"
        )

    def far_behind(self, horizon: float) -> dict[Kind, float]:
        """Kinds that came too late by more than any ``horizon`` [s] waits, and by how much [s] at least."""
        return {
            kind: float(self.least_late[kind]) / NANOSECONDS
            for kind in Kind
            if self.late[kind] and self.least_late[kind] > horizon * NANOSECONDS
        }


@dataclass(frozen=True)
class Released:
    """Samples in time order, stamps less sensor delays; ``restarted``: the clock started over before them."""

    samples: Samples
    restarted: bool = False


class TimeOrder:
    """Holds samples for ``horizon`` [s], releases them in time order; ``delays`` [s] (kinds,)."""

    def __init__(self, horizon: float, delays: npt.NDArray[np.float64]) -> None:
        self._delays = np.rint(np.asarray(delays) * NANOSECONDS).astype(np.int64)
        self.change_horizon(horizon)
        self._forget_clock()
        self._suspect: Samples | None = None
        self._held = concatenate([])
        self.elapsed = 0  # [ns] by the clock, leaps left out
        self.counts = OrderCounts()

    def _forget_clock(self) -> None:
        self._clock: int | None = None
        self._beside = -_NEVER  # newest stamp [ns] of what is neither IMU nor GPS
        self._released_until = -_NEVER  # by this clock

    def change_horizon(self, horizon: float) -> None:
        """Hold samples that come from now on for ``horizon`` [s]."""
        self._lag = round(horizon * NANOSECONDS) + int(self._delays.max())

    @property
    def clock(self) -> int | None:
        """Newest believed IMU stamp [ns]."""
        return self._clock

    def newest_due(self, samples: Samples) -> npt.NDArray[np.int64]:
        """Newest time [ns] that is due when each of the next samples (n,) arrives; by their stamps alone."""
        ahead = np.where(samples.kind == Kind.IMU, samples.stamp, -_NEVER)
        clock = np.maximum.accumulate(np.concatenate([[-_NEVER if self._clock is None else self._clock], ahead]))
        known = clock[clock > -_NEVER]
        if np.any(np.diff(known) > LARGEST_LEAP):  # in doubt nothing is too late
            return np.full(len(samples), -_NEVER)
        return np.asarray(clock[1:] - self._lag)

    def push(self, samples: Samples) -> Iterator[Released]:
        """Take samples in the order of arrival; yields what is due, in time order."""
        np.add.at(self.counts.received, samples.kind, 1)
        samples = samples[self._valid(samples)]
        start = 0
        for leap in self._leaps(samples):
            if leap > start:
                yield from self._advance(samples[start:leap])
            yield from self._question(samples[leap : leap + 1])
            start = leap + 1
        if start < len(samples):
            yield from self._advance(samples[start:])

    def flush(self) -> Iterator[Released]:
        """Everything that is still held, in time order: the recording ended or the clock started over."""
        held, self._held = self._held, concatenate([])
        if len(held):
            self._released_until = max(self._released_until, int(held.stamp[-1]))
            yield Released(held)

    def begin_anew(self) -> None:
        """Another manoeuvre by another clock, after ``flush``."""
        self._forget_clock()
        self._suspect = None

    def _valid(self, samples: Samples) -> npt.NDArray[np.bool_]:
        needed = REQUIRED_VALUES[samples.kind]
        present = np.arange(samples.values.shape[1])[None, :] >= needed[:, None]
        valid = np.all(np.isfinite(samples.values) | present, axis=1) & ~np.any(is_absurd(samples), axis=1)
        if not valid.all():
            np.add.at(self.counts.invalid, samples.kind[~valid], 1)
        return np.asarray(valid)

    def _leaps(self, samples: Samples) -> list[int]:
        """IMU samples whose stamp leaps back beyond the horizon or far ahead; all of them while in doubt."""
        imu = np.flatnonzero(samples.kind == Kind.IMU)
        if not len(imu):
            return []
        stamps = samples.stamp[imu]
        previous = np.concatenate([[stamps[0] if self._clock is None else self._clock], stamps[:-1]])
        step = stamps - np.maximum.accumulate(previous)
        if self._suspect is None and not np.any((step > LARGEST_LEAP) | (step < -self._lag)):
            return []
        return [int(i) for i in imu]  # rare: decide one by one

    def _question(self, sample: Samples) -> Iterator[Released]:
        """One IMU sample while stamps leap: a leap is believed once the next stamp confirms it."""
        stamp = int(sample.stamp[0])
        if self._clock is None or -self._lag <= stamp - self._clock <= LARGEST_LEAP:
            if self._suspect is not None:
                self.counts.wrong_stamp[Kind.IMU] += 1
                self._suspect = None
            yield from self._advance(sample)
        elif self._suspect is not None and abs(stamp - int(self._suspect.stamp[0])) <= _CONFIRMATION:
            first, self._suspect = self._suspect, None
            yield from self.flush()
            self._forget_clock()
            self.counts.restarts += 1
            yield Released(concatenate([]), restarted=True)
            yield from self._advance(concatenate([first, sample]))
        else:
            if self._suspect is not None:
                self.counts.wrong_stamp[Kind.IMU] += 1
            self._suspect = sample

    def _advance(self, samples: Samples) -> Iterator[Released]:
        """Samples without leaps: drop the late, hold the rest, release what the clock has passed."""
        taken = samples.stamp - self._delays[samples.kind]
        clock = self._clock_at_arrival(samples)
        known = clock > np.iinfo(np.int64).min
        due_at = np.maximum(np.where(known, clock, 0) - self._lag, self._released_until)
        late = known & (taken < due_at)
        ahead = known & (samples.stamp > np.where(known, clock, 0) + _FUTURE) & (samples.kind != Kind.IMU)
        ahead |= self._are_ahead(samples, clock, known, ahead)
        np.add.at(self.counts.late, samples.kind[late], 1)
        np.minimum.at(self.counts.least_late, samples.kind[late], (due_at - taken)[late])
        np.add.at(self.counts.wrong_stamp, samples.kind[ahead], 1)
        clocked = known & ~ahead & (samples.kind != Kind.IMU)
        np.add.at(self.counts.clocked, samples.kind[clocked], 1)
        np.minimum.at(self.counts.least_early, samples.kind[clocked], (samples.stamp - clock)[clocked])
        keep = ~(late | ahead)
        held = concatenate([self._held, Samples(taken[keep], samples.kind[keep], samples.values[keep])])
        imu = samples.stamp[samples.kind == Kind.IMU]
        if len(imu):
            if self._clock is None:
                held = self._of_this_clock(held, int(imu[0]))
            begin = int(imu[0]) if self._clock is None else self._clock
            self.counts.standing += int(np.sum(np.diff(imu, prepend=begin - 1 if self._clock is None else begin) == 0))
            self._clock = max(begin, int(imu.max()))
            self.elapsed += self._clock - begin
        held = held[np.lexsort((held.kind, held.stamp))]  # stable: equals stay in the order of arrival
        if (repeated := repeats(held.stamp, held.values) & (np.diff(held.kind, prepend=-1) == 0)).any():
            np.add.at(self.counts.repeated, held.kind[repeated], 1)
            held = held[~repeated]
        due = 0
        if self._clock is not None:
            self._released_until = max(self._released_until, self._clock - self._lag)
            due = int(np.searchsorted(held.stamp, self._clock - self._lag, side="left"))
        self._held = held[max(due, len(held) - _MOST_HELD) :]
        if due:
            yield Released(held[:due])

    def _of_this_clock(self, held: Samples, begin: int) -> Samples:
        """What came before the IMU did, without what no clock that begins at its first stamp [ns] has: a stamp of 0."""
        fits = (held.stamp >= begin - LARGEST_LEAP) | (held.kind == Kind.IMU)
        np.add.at(self.counts.wrong_stamp, held.kind[~fits], 1)
        return held[fits]

    def _are_ahead(
        self,
        samples: Samples,
        clock: npt.NDArray[np.int64],
        known: npt.NDArray[np.bool_],
        wrong: npt.NDArray[np.bool_],
    ) -> npt.NDArray[np.bool_]:
        """Which samples (n,) of the GPS are ahead of all else that has come, where the clock is ``known``; what has a
        ``wrong`` stamp does not count.
        """
        of_gps = np.isin(samples.kind, _GPS)
        others = ~of_gps & (samples.kind != Kind.IMU) & ~wrong
        beside = np.append(self._beside, np.where(others, samples.stamp, -_NEVER))
        newest = np.maximum.accumulate(beside)
        self._beside = int(newest[-1])
        by = samples.stamp - np.maximum(clock, newest[:-1])
        ahead = of_gps & known & (by > _GPS_FUTURE)
        np.minimum.at(self.counts.least_ahead, samples.kind[ahead], by[ahead])
        return np.asarray(ahead)

    def _clock_at_arrival(self, samples: Samples) -> npt.NDArray[np.int64]:
        """The clock just before each sample arrived (n,); the smallest integer before there is one."""
        lowest = np.iinfo(np.int64).min
        stamps = np.where(samples.kind == Kind.IMU, samples.stamp, lowest)
        before = np.concatenate([[lowest if self._clock is None else self._clock], stamps[:-1]])
        return np.asarray(np.maximum.accumulate(before))


def flown_twice(samples: Samples) -> float:
    """Time [s] of samples, in the order in which they came, whose IMU stamps an earlier part by another clock has."""
    stamps = samples.stamp[samples.kind == Kind.IMU].astype(np.float64) * 1e-9
    parts = np.split(stamps, np.flatnonzero(np.abs(np.diff(stamps)) > _STEP) + 1)
    spans = [(float(part.min()), float(part.max())) for part in parts if len(part) >= _LEAST_PART]
    return sum(
        max(min(end, last) - max(begin, first), 0.0)
        for at, (begin, end) in enumerate(spans)
        for first, last in spans[:at]
    )
