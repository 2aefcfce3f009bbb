"""PX4 without MAVLink: uORB topics, as the agent of uXRCE-DDS publishes them, to messages of our topics. No ROS here.

The agent's client puts the time of the companion into every message, once it has synchronised clocks (its parameter
UXRCE_DDS_SYNCT, on by default): such stamps are Unix time and are used as they are. Stamps that count from the start
of the autopilot are mapped by the least delay of each second, as MAVLink's are without TIMESYNC. So a restart shows in
two ways: stamps since the start that begin again, and stamps since the start after those of the companion. One in a
silence shows in neither: after one, and where our own clock was set, the least delay is found anew.
"""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from aircraft_sysid_ros.mavlink.assembler import Assembler, Output
from aircraft_sysid_ros.mavlink.clock import AutopilotClock
from aircraft_sysid_ros.mavlink.px4_table import OPTIONAL, PX4, TIMES, sample_time
from aircraft_sysid_ros.mavlink.quantities import Batch, Fields, is_sound, readings_of
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.stamps import NANOSECONDS

#: Package of the messages.
PACKAGE = "px4_msgs"
#: Where the agent publishes, relative to the namespace.
FMU_OUT = "fmu/out"
#: [ns] 2001: more is Unix time.
_UNIX = 10**18
_LOST_AFTER = 5 * NANOSECONDS
#: A restart is believed, and synchronised clocks lost, after so many messages in a row, over such a time [ns].
CONFIRMING, CONFIRMING_SPAN = 5, NANOSECONDS // 2
_VERSION = re.compile(r"_v(\d+)$")
_IMU = ("sensor_combined", "vehicle_imu")


def named(topic: str) -> tuple[str, int]:
    """uORB topic and version of its message, of a topic such as /fmu/out/airspeed_validated_v1."""
    name = topic.rsplit("/", 1)[-1]
    found = _VERSION.search(name)
    return (name, 0) if found is None else (name[: found.start()], int(found[1]))


def wanted_fields(name: str) -> frozenset[str]:
    """Fields of a topic that are used, of whatever version of PX4."""
    return frozenset(OPTIONAL).union(*(entry.needs for entry in PX4.get(name, ())))


class Px4Listener:
    """Messages of one vehicle in, messages of our topics out; ``clock`` gives our time [ns]."""

    def __init__(self, mapping: ServoMapping | None = None, clock: Callable[[], int] = time.time_ns) -> None:
        self.mapping = mapping or ServoMapping()
        self._now = clock
        self.assembler = Assembler(PX4, self.mapping)
        self.clock = AutopilotClock()  # while the agent has not synchronised clocks
        self.received: Counter[str] = Counter()
        self.published: Counter[str] = Counter()
        self.not_finite = 0  # messages with NaN or infinity where a number must be
        self.unstamped = 0  # messages before the clock was known
        self.restarts = 0  # of the autopilot
        self.notes: list[str] = []  # news since they were last taken
        self._newest_remote = 0
        self._last = self._first = 0  # message [ns of our clock]
        self._is_synchronised = False
        self._doubtful = 0  # messages in a row that may be of another start
        self._doubtful_since = 0

    def receive(self, name: str, fields: Fields) -> list[Output]:
        """What a message (n = 1) of a uORB topic says."""
        now = self._now()
        self.received[name] += 1
        if not -NANOSECONDS <= now - self._last <= _LOST_AFTER:
            self.clock.reset()
            self._first = now
        self._last = now
        stamp = self._stamp(int(sample_time(fields)[0]), int(np.asarray(fields[TIMES[1]])[0]) * 1000, now)
        if stamp is None:
            self.unstamped += 1
            return []
        readings = readings_of(PX4, Batch(name, np.array([stamp], np.int64), fields))
        sound = [reading for reading in readings if is_sound(reading)]
        self.not_finite += len(sound) < len(readings)
        outputs = self.assembler.take(sound)
        for output in outputs:
            self.published[output.topic] += len(output.stamp)
        return outputs

    def _stamp(self, taken: int, sent: int, now: int) -> int | None:
        """Our time [ns] of a sample; None while it is not known."""
        if sent >= _UNIX:
            self._doubtful = 0
            if not self._is_synchronised:
                self._is_synchronised = True
                self.notes.append("PX4's stamps are those of this computer's clock")
            return taken
        has_gone_back = sent < self._newest_remote - NANOSECONDS
        if not has_gone_back and not self._is_synchronised:
            self._doubtful = 0
        elif self._is_confirmed(now):
            self._start_anew(sent)
        elif has_gone_back:
            return None
        self._newest_remote = max(sent, self._newest_remote)
        self.clock.add_one_way(sent, now)
        return self.clock.to_local(taken)

    def _is_confirmed(self, now: int) -> bool:
        """Whether stamps are of another start for good, and not those of one message that is late."""
        if not self._doubtful:
            self._doubtful_since = now
        self._doubtful += 1
        return self._doubtful >= CONFIRMING and now - self._doubtful_since >= CONFIRMING_SPAN

    def _start_anew(self, sent: int) -> None:
        self.restarts += 1
        self.notes.append("the autopilot has restarted")
        self.clock.reset()
        self.assembler = Assembler(PX4, self.mapping)
        self._newest_remote = sent
        self._is_synchronised, self._doubtful = False, 0

    @property
    def condition(self) -> str:
        """What is wrong, in words; empty when nothing is."""
        if not self.received:
            return "no topic of PX4 has come: does the agent run, with the same ROS_DOMAIN_ID and namespace?"
        if self._now() - self._last > _LOST_AFTER:
            return "PX4 is silent"
        if not any(self.received[name] for name in _IMU):
            return "no sensor_combined has come: add it to dds_topics.yaml"
        return self.outputs_condition

    @property
    def outputs_condition(self) -> str:
        """Why there are no control surfaces, in words; empty: there are, none are wanted, or they may still come."""
        outputs = "actuator_servos" if self.mapping.normalised else "actuator_outputs"
        if self.assembler.outputs_condition or not self.mapping.outputs or self.received[outputs]:
            return self.assembler.outputs_condition
        if self._last - self._first <= _LOST_AFTER:
            return ""
        return f"no {outputs} has come, so no control surfaces: if it does not in flight, add it to dds_topics.yaml"

    def take_notes(self) -> list[str]:
        """News since the last call."""
        notes, self.notes = self.notes, []
        return notes

    def summary(self) -> dict[str, Any]:
        """Counts for a report or for diagnostics."""
        return {
            "vehicle": "PX4" if self.received else None,
            "received": dict(self.received),
            "published": dict(self.published),
            "not_finite": self.not_finite,
            "unstamped": self.unstamped,
            "reboots": self.restarts,
            "clock": "of this computer" if self._is_synchronised else "by the least delay" if self.clock.ready else "",
        }
