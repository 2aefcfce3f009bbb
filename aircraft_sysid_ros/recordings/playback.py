"""When to send each message of a recording: by the clock, without drift and without bursts."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from aircraft_sysid_ros.stamps import NANOSECONDS

#: A player that is later than this [s] does not catch up: what follows a stall would come in one burst.
LONGEST_LAG = 0.2
#: Log times that are further apart than this [ns] are of a clock that was set: nobody waits for that.
LARGEST_LEAP = 120 * NANOSECONDS


class Schedule:
    """Wall time of log times [ns] at ``rate`` times real time; a rate of 0 means at once. A leap takes no time."""

    def __init__(
        self,
        rate: float,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.rate, self._clock, self._sleep = rate, clock, sleep
        self._start: tuple[int, float] | None = None
        self._newest = 0
        self.delay = 0.0  # [s] given up so far because of stalls

    def wait(self, log_time: int) -> None:
        """Return when the message is due: counted from the first, so that errors do not add up."""
        if self.rate == 0.0:
            return
        now = self._clock()
        if self._start is None:
            self._start = (log_time, now)
        elif (step := log_time - self._newest) > LARGEST_LEAP:
            self._start = (self._start[0] + step, self._start[1])
        self._newest = log_time
        due = self._start[1] + (log_time - self._start[0]) / (self.rate * NANOSECONDS) + self.delay
        if due > now:
            self._sleep(due - now)
        elif now - due > LONGEST_LAG:
            self.delay += now - due


def every(interval: float, clock: Callable[[], float] = time.perf_counter) -> Iterator[bool]:
    """True when the interval [s] has passed since the last time, for a progress bar in a fast loop."""
    last = clock()
    while True:
        now = clock()
        if now - last >= interval:
            last = now
            yield True
        else:
            yield False
