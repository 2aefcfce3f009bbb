"""The autopilot's clock in ours: offset and drift from TIMESYNC, by a Kalman filter of two states.

    theta(k+1) = theta(k) + s(k) dt + w,   s(k+1) = s(k) + v        offset [s] and drift [s/s]
    z = (sent + received) / 2 - remote = theta + e,   |e| <= rtt / 2

The error of a round trip is bounded by half its time, whichever way was slow; it enters as noise of that size, so
that a delayed answer weighs little. Without TIMESYNC the least of (arrival - remote) over a second is taken: it is
late by the least delay of the link, which nobody can see one way. Cristian (1989), Probabilistic clock
synchronization; the filter is (2.5)-(2.9) of docs/references.md.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]

# One sigma.
_DRIFT_STD = 1e-4  # of a crystal, [s/s]
_FLOOR = 2e-5  # [s] of a time stamp
_ONE_WAY_STD = 0.01  # [s]
_OFFSET_WALK, _DRIFT_WALK = 2e-6, 1e-8  # per sqrt(s)
_GATE = 5.0
_MOST_REJECTED = 5  # in a row: then it is the clock that leapt
_ENOUGH = 3  # round trips
_ENOUGH_ONE_WAY = 2  # seconds
_ROUND_TRIP_AGE = 10.0  # [s] without an answer: one-way times count again
_LONGEST_ROUND_TRIP = 1.0  # [s]


class AutopilotClock:
    """Offset and drift of a remote clock; times are integers [ns]."""

    def __init__(self) -> None:
        self.resets = -1
        self.reset()

    def reset(self) -> None:
        """Forget everything: the remote clock started over."""
        self.resets += 1
        self._base: tuple[int, int] | None = None  # remote and local time at the first measurement
        self._x = np.zeros(2)
        self._p = np.zeros((2, 2))
        self._at = 0  # remote time of the state
        self._round_trips = self._seconds = self._rejected = 0
        self._last_round_trip = 0  # local
        self._least: tuple[int, int] | None = None  # of this second: remote, arrival
        self._second_began = 0

    @property
    def ready(self) -> bool:
        """Whether the offset is known well enough to stamp samples."""
        return self._round_trips >= _ENOUGH or self._seconds >= _ENOUGH_ONE_WAY

    @property
    def is_answered(self) -> bool:
        """Whether round trips have told the offset, and not messages alone."""
        return self._round_trips > 0

    @property
    def drift(self) -> float:
        """How much faster our clock runs than the remote one [s/s]."""
        return float(self._x[1])

    @property
    def std(self) -> float:
        """Standard deviation of the offset [s]; infinite while there is none."""
        return float(np.sqrt(self._p[0, 0])) if self._base is not None else np.inf

    def add_round_trip(self, sent: int, received: int, remote: int) -> None:
        """An answer to TIMESYNC: our times of question and answer, the remote time of the answer [ns]."""
        trip = (received - sent) / NANOSECONDS
        if not 0.0 <= trip <= _LONGEST_ROUND_TRIP:
            return
        self._last_round_trip = received
        if self._update(remote, sent + (received - sent) // 2, 0.5 * trip + _FLOOR):
            self._round_trips += 1

    def add_one_way(self, remote: int, arrival: int) -> None:
        """A message with its own time came [ns]; used while there are no round trips."""
        if self._round_trips and arrival - self._last_round_trip < _ROUND_TRIP_AGE * NANOSECONDS:
            return
        if self._least is None:
            self._least, self._second_began = (remote, arrival), arrival
        if arrival - remote < self._least[1] - self._least[0]:
            self._least = (remote, arrival)
        if arrival - self._second_began >= NANOSECONDS:
            self._seconds += self._update(*self._least, _ONE_WAY_STD, may_wait=True)
            self._least = None

    def to_local(self, remote: int) -> int | None:
        """Our time [ns] of a remote time; None while the offset is not known."""
        if self._base is None or not self.ready:
            return None
        elapsed = (remote - self._at) / NANOSECONDS
        ahead = round((self._x[0] + self._x[1] * elapsed) * NANOSECONDS)
        return self._base[1] + (remote - self._base[0]) + ahead

    def to_remote(self, local: int) -> int | None:
        """Remote time [ns] of our time; None while the offset is not known."""
        if self._base is None or not self.ready:
            return None
        guess = self._base[0] + (local - self._base[1])
        for _ in range(2):  # the drift of the correction is left, 1e-4 of it each time
            at_guess = self.to_local(guess)
            assert at_guess is not None
            guess -= at_guess - local
        return guess

    def _update(self, remote: int, local: int, std: float, may_wait: bool = False) -> bool:
        """One measurement of the offset; whether it was believed. One that ``may_wait`` is late for many a reason."""
        if self._base is None:
            self._base, self._at = (remote, local), remote
            self._p = np.diag([std**2, _DRIFT_STD**2])
            return True
        self._predict(remote)
        measured = ((local - self._base[1]) - (remote - self._base[0])) / NANOSECONDS
        innovation, variance = measured - self._x[0], self._p[0, 0] + std**2
        if abs(innovation) > _GATE * np.sqrt(variance):
            self._rejected += not (may_wait and innovation > 0.0)
            if self._rejected >= _MOST_REJECTED:
                self.reset()
            return False
        self._rejected = 0
        gain = self._p[:, 0] / variance
        self._x = self._x + gain * innovation
        keep = np.eye(2) - np.outer(gain, [1.0, 0.0])
        self._p = keep @ self._p @ keep.T + np.outer(gain, gain) * std**2  # Joseph form
        return True

    def _predict(self, remote: int) -> None:
        dt = max((remote - self._at) / NANOSECONDS, 0.0)
        step = np.array([[1.0, dt], [0.0, 1.0]])
        self._x = step @ self._x
        self._p = step @ self._p @ step.T + np.diag([_OFFSET_WALK**2, _DRIFT_WALK**2]) * dt
        self._at = max(self._at, remote)


#: A step [ns] of our clock beside the steady one of the machine that is no drift.
_SET = NANOSECONDS


class OurClock:
    """Whether our clock is set while it is used, as NTP and GPS do to that of a computer some time after its start."""

    def __init__(self, steady: Callable[[], int] = time.monotonic_ns) -> None:
        """``steady`` [ns] is set by nobody."""
        self._steady = steady
        self._ahead: int | None = None  # [ns] of the steady one

    def was_set(self, now: int) -> int:
        """By how much [ns] it was set since it was last asked, where it now shows ``now`` [ns]; 0: it was not."""
        before, self._ahead = self._ahead, now - self._steady()
        by = 0 if before is None else self._ahead - before
        return by if abs(by) > _SET else 0


# -- the time since start that messages carry ------------------------------------------------------------------

_EPOCH_BEGINS = 10**15  # [us] more is Unix time (2001), less is time since start
_WRAP = 2**32  # [us] 71.6 min
_NARROW = ("SERVO_OUTPUT_RAW", "AOA_SSA")  # ArduPilot counts in 32 bits there, whatever the field could hold
_FIX, _FIX_2D = "GPS_RAW_INT", 2  # told again and again until there is another
_BACKWARDS = 5 * NANOSECONDS  # [ns] a sender that is short of time may send samples later than the time by less
_LEAP = 5 * NANOSECONDS  # [ns] ahead of what the quickest message allows: those that waited for longer were later
#: A restart is believed after so many messages in a row that agree with each other and not with the clock, over such a
#: time [ns]: some forged ones would else shut out the genuine, which come between them. Where that clock began before
#: the newest message of the old one came, over the longer: so do those of an autopilot that tells the time each second
#: and is behind with all else, and what has started anew tells the old time no more.
_CONFIRMING, _CONFIRMING_SPAN, _BEGAN_BEFORE = 5, NANOSECONDS // 2, 2 * NANOSECONDS
#: So long [ns] after the first of these nobody knows when a message without a time was sent.
_UNTOLD = NANOSECONDS // 5


@dataclass
class _Suspect:
    boot: int
    arrival: int
    count: int
    since: int  # arrival of the first


class BootTime:
    """Time since start [ns] of each message, and whether the autopilot started anew."""

    def __init__(self) -> None:
        self.reboots = 0
        self._newest: int | None = None
        self._least = 0  # of arrival - boot: the quickest message
        self._heard = 0  # arrival of the newest message of this clock
        self._unix_minus_boot: int | None = None  # [ns]
        self._suspect: _Suspect | None = None
        self._last_fix: int | None = None

    @property
    def is_in_doubt(self) -> bool:
        """Whether the newest times agree with each other and not with those before: a restart, or forged ones."""
        return self._suspect is not None

    def clock_was_set(self, by: int) -> None:
        """Arrivals are told by a clock that was set by so much [ns]."""
        self._least, self._heard = self._least + by, self._heard + by
        if (suspect := self._suspect) is not None:
            self._suspect = replace(suspect, arrival=suspect.arrival + by, since=suspect.since + by)

    def is_repeated(self, name: str, boot: int) -> bool:
        """Whether a message that was taken at ``boot`` is one that was heard before: to be asked once of each.

        ArduPilot sends GPS_RAW_INT as often as it is asked, with the fix that it has.
        """
        if name != _FIX:
            return False
        before, self._last_fix = self._last_fix, boot
        return before == boot

    def of(self, name: str, fields: Mapping[str, Any], arrival: int) -> int | None:
        """Time since start of a message that came at ``arrival`` [ns]; None where it cannot be told.

        A message without a time of its own gets the newest one: it was sent just after, unless a restart is in doubt.
        """
        own = self._own(name, fields)
        if own is None:
            return None if self._suspect and arrival - self._suspect.since > _UNTOLD else self._newest
        if name in _NARROW:  # the others alone tell how often it has wrapped, and so what is believed
            assert self._newest is not None  # else it has no time of its own
            return own if self._fits(own, arrival, self._newest, self._least) else None
        if not self._believe(own, arrival):
            return None
        if name == "SYSTEM_TIME" and int(fields["time_unix_usec"]) > _EPOCH_BEGINS:
            self._unix_minus_boot = int(fields["time_unix_usec"]) * 1000 - own
        return own

    def _own(self, name: str, fields: Mapping[str, Any]) -> int | None:
        if "time_boot_ms" in fields:
            milliseconds = int(fields["time_boot_ms"])
            return milliseconds * 1_000_000 or None
        if "time_usec" not in fields or (name == _FIX and int(fields["fix_type"]) < _FIX_2D):
            return None  # without a fix GPS_RAW_INT has the time of the last
        microseconds = int(fields["time_usec"])
        if microseconds == 0:
            return None
        if microseconds > _EPOCH_BEGINS:
            return None if self._unix_minus_boot is None else microseconds * 1000 - self._unix_minus_boot
        if name in _NARROW:
            if self._newest is None:
                return None
            microseconds += round((self._newest // 1000 - microseconds) / _WRAP) * _WRAP  # that brings it nearest
        return microseconds * 1000

    def _believe(self, boot: int, arrival: int) -> bool:
        """Follow the newest time; a leap counts once several messages in a row confirm it."""
        if self._newest is None:
            self._newest, self._least = boot, arrival - boot
        if self._fits(boot, arrival, self._newest, self._least):
            self._newest, self._least = max(self._newest, boot), min(self._least, arrival - boot)
            self._suspect, self._heard = None, arrival
            return True
        suspect = self._suspect
        if suspect is None or not self._fits(boot, arrival, suspect.boot, suspect.arrival - suspect.boot):
            self._suspect = _Suspect(boot, arrival, 1, arrival)
            return False
        self._suspect = _Suspect(max(boot, suspect.boot), arrival, suspect.count + 1, suspect.since)
        span = _CONFIRMING_SPAN if boot <= arrival - self._heard + _LEAP else _BEGAN_BEFORE
        if self._suspect.count < _CONFIRMING or arrival - suspect.since < span:
            return False
        self._newest, self._least, self._suspect, self._heard = boot, arrival - boot, None, arrival
        self._unix_minus_boot = None
        self.reboots += 1
        return True

    def _fits(self, boot: int, arrival: int, before: int, least: int) -> bool:
        """Whether a time is after one before, and the message no quicker than possible; it may have waited long."""
        return boot - before >= -_BACKWARDS and arrival - boot >= least - _LEAP
