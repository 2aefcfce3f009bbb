"""A session on a transport: the loop of the bridge, without ROS."""

from __future__ import annotations

import time
from collections.abc import Callable

from aircraft_sysid_ros.mavlink.assembler import Output
from aircraft_sysid_ros.mavlink.back_channel import BackChannel
from aircraft_sysid_ros.mavlink.clock import OurClock
from aircraft_sysid_ros.mavlink.session import Session
from aircraft_sysid_ros.mavlink.transport import Transport

#: Longest wait [s] for bytes before the clock is looked at again.
STEP = 0.02
_MOST_READS = 200  # per step, so that a flood does not keep heartbeats from going out


class Bridge:
    """Reads, answers, and gives messages of our topics; ``step`` is called again and again."""

    def __init__(
        self,
        transport: Transport,
        session: Session,
        back: BackChannel | None = None,
        clock: Callable[[], int] = time.time_ns,
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """``clock`` gives our time [ns], that of the stamps, ``steady`` one that nobody sets."""
        self.transport, self.session = transport, session
        self.back = back or BackChannel()
        self._clock, self._ours = clock, OurClock(steady)

    def step(self, timeout: float = STEP) -> list[Output]:
        """One round: wait for bytes, take all that is there, send what is due."""
        outputs: list[Output] = []
        for _ in range(_MOST_READS):
            data = self.transport.read(timeout)
            if not data:
                break
            outputs += self.session.receive(data, self._now())
            if self.session.is_heard:
                self.transport.hold()
            timeout = 0.0
        now = self._now()
        self.transport.write(self.session.tick(now))
        if not self.session.is_heard:
            self.transport.release()
        if not self.session.condition:
            for message in self.back.due(now, self.session.clock.to_remote(now)):
                self.transport.write(self.session.decoder.encode(message))
        return outputs

    def _now(self) -> int:
        """Our time [ns]; whoever remembers times is told where it was set."""
        now = self._clock()
        if by := self._ours.was_set(now):
            self.session.clock_was_set(by, now)
            self.back.clock_was_set()
        return now
