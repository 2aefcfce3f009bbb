"""One vehicle over one link, without the link: bytes and time in, messages of our topics and bytes out.

Finds the vehicle by its heartbeat, answers and asks (heartbeats, TIMESYNC, rates), follows its clock, and starts anew
when it does. Memory is bounded: counts by name, and a few last values per quantity.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.mavlink.assembler import Assembler, Output
from aircraft_sysid_ros.mavlink.clock import AutopilotClock, BootTime
from aircraft_sysid_ros.mavlink.decoder import Decoder, batch_of, fields_of
from aircraft_sysid_ros.mavlink.mavlink_table import MAVLINK
from aircraft_sysid_ros.mavlink.quantities import NAMED_VALUES, is_sound, readings_of
from aircraft_sysid_ros.mavlink.requests import Requests
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.stamps import NANOSECONDS

HEARTBEAT_PERIOD = 1.0  # [s]
SYNC_PERIOD, FIRST_SYNC_PERIOD, FIRST_SYNCS = 1.0, 0.2, 10
LOST_AFTER = 5.0  # [s] without a message
#: Numbers of packets, and how many of them a packet may be overtaken by.
_NUMBERS, _OVERTAKEN = 256, 64
_AUTOPILOT_NAMES = {dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: "ArduPilot", dialect.MAV_AUTOPILOT_PX4: "PX4"}
_NOT_VEHICLES = (dialect.MAV_TYPE_GCS, dialect.MAV_TYPE_ANTENNA_TRACKER, dialect.MAV_TYPE_GIMBAL, dialect.MAV_TYPE_ADSB)


def is_vehicle(heartbeat: Any) -> bool:
    """Whether a heartbeat is that of an autopilot, and not of a ground station, a gimbal or a companion."""
    return heartbeat.autopilot != dialect.MAV_AUTOPILOT_INVALID and heartbeat.type not in _NOT_VEHICLES


@dataclass(frozen=True)
class Vehicle:
    """Who was found."""

    system: int
    component: int
    autopilot: str


def _are_finite(name: str, fields: dict[str, Any]) -> bool:
    """Whether the fields of a message that its quantities need are numbers."""
    needed = [fields[field] for entry in MAVLINK.get(name, ()) for field in entry.needs if field in fields]
    return all(np.all(np.isfinite(value)) for value in needed if isinstance(value, (float, list)))


class Session:
    """The protocol; ``now`` is our time [ns], that of the stamps."""

    def __init__(
        self, mapping: ServoMapping | None = None, system: int | None = None, key: bytes | None = None
    ) -> None:
        """``key``: what is not signed with it is not heard, and what is sent is signed."""
        self.mapping = mapping or ServoMapping()
        self.decoder = Decoder(key)
        self.clock, self.boot_time = AutopilotClock(), BootTime()
        self.assembler = Assembler(MAVLINK, self.mapping)
        self.requests = Requests(self.mapping.rates)
        self.vehicle: Vehicle | None = None
        self.received: Counter[str] = Counter()
        self.published: Counter[str] = Counter()
        self.unstamped = 0  # messages before the clock was known
        self.not_finite = 0  # messages with NaN or infinity where a number must be
        self.losses = 0  # times that the vehicle fell silent
        self.missing = 0  # packets that the vehicle sent and that did not come, by their numbers
        self.notes: list[str] = []  # news since they were last taken
        self._wanted_system = system
        self._other = ""  # vehicle that is heard while ours is not, in words
        self._last_message = 0
        self._silent = True
        self._number: int | None = None  # of the vehicle's newest packet
        self._next_heartbeat = self._next_sync = 0
        self._syncs = 0
        self._asked: deque[int] = deque(maxlen=32)  # our times in questions: other stations ask too
        self._question: int | None = None  # of the vehicle, to be answered

    # -- in ------------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now: int) -> list[Output]:
        """What the bytes that came at ``now`` say."""
        outputs: list[Output] = []
        for message in self.decoder.decode(data):
            outputs += self._take(message, now)
        for output in outputs:
            self.published[output.topic] += len(output.stamp)
        return outputs

    def _take(self, message: Any, now: int) -> list[Output]:
        name = message.get_type()
        if name == "HEARTBEAT":
            self._find(message, now)
        if not self._is_from_vehicle(message):
            return []
        self._last_message = now
        if self._silent:
            self._return(now)
        self._count_missing(message.get_seq())
        self.received[name] += 1
        self.requests.heard(name, now)
        fields = fields_of(message)
        if name == "TIMESYNC":
            self._synchronise(fields, now)
            return []
        if name == "COMMAND_ACK":
            self.requests.acknowledged(fields["command"], fields["result"])
        return self._samples(name, fields, now)

    def _count_missing(self, number: int) -> None:
        """Packets carry a number from 0 to 255, one after the other: one that is overtaken was counted, and comes."""
        ahead = 1 if self._number is None else (number - self._number) % _NUMBERS
        if ahead > _NUMBERS - _OVERTAKEN:
            self.missing -= 1
        elif ahead:
            self.missing += ahead - 1
            self._number = number

    def _samples(self, name: str, fields: dict[str, Any], now: int) -> list[Output]:
        reboots = self.boot_time.reboots
        boot = self.boot_time.of(name, fields, now)
        if self.boot_time.reboots != reboots:
            self._restart(now)
        if boot is None:
            return []
        if "time_boot_ms" in fields or "time_usec" in fields:
            self.clock.add_one_way(boot, now)
        stamp = self.clock.to_local(boot)
        if stamp is None:
            self.unstamped += 1
            return []
        if (name not in MAVLINK and name != NAMED_VALUES) or self.boot_time.is_repeated(name, boot):
            return []
        readings = readings_of(MAVLINK, batch_of(name, stamp, fields))
        sound = [reading for reading in readings if is_sound(reading)]
        quantities = {entry.quantity for entry in MAVLINK.get(name, ())}
        self.not_finite += len(sound) < len(quantities) and not _are_finite(name, fields)
        return self.assembler.take(sound)

    def _find(self, message: Any, now: int) -> None:
        """Take the first autopilot, or the one with the wanted number."""
        system = message.get_srcSystem()
        if not is_vehicle(message):
            return
        name = _AUTOPILOT_NAMES.get(message.autopilot, f"autopilot {message.autopilot}")
        wanted = self._wanted_system if self.vehicle is None else self.vehicle.system
        if wanted not in (None, system):
            self._note_other(name, system)
        if self.vehicle is not None or wanted not in (None, system):
            return
        self.vehicle = Vehicle(system, message.get_srcComponent(), name)
        self.decoder.system, self._other = system, ""
        self.notes.append(f"found {name}, system {system}")
        self.requests.start(now)
        self._silent = False

    def _note_other(self, name: str, system: int) -> None:
        """Another vehicle is heard: while ours is not, that may be ours under another number."""
        other = f"{name}, system {system}, is heard"
        if not self.is_heard and other != self._other:
            self._other = other
            self.notes.append(f"{self.condition}: restart the bridge to follow it")

    def _is_from_vehicle(self, message: Any) -> bool:
        vehicle = self.vehicle
        source = (message.get_srcSystem(), message.get_srcComponent())
        return vehicle is not None and source == (vehicle.system, vehicle.component)

    def _return(self, now: int) -> None:
        """The vehicle speaks again: whatever it was asked for may be forgotten, and its clock may be another.

        Answers tell that soon. Messages alone do not, if it has started anew and is up for longer than it was.
        """
        if not self.clock.is_answered:
            self.clock.reset()
        self._silent, self._other, self._number = False, "", None
        self.notes.append("the vehicle is back")
        self.requests.start(now)

    def _restart(self, now: int) -> None:
        """The autopilot started anew: its clock, its rates and what it last said are gone."""
        self.notes.append("the autopilot has restarted")
        self.clock.reset()
        self._number = None
        self.assembler = Assembler(MAVLINK, self.mapping)
        self.requests.start(now)
        self._syncs, self._next_sync = 0, now

    def clock_was_set(self, by: int, now: int) -> None:
        """Our clock was set by so much [ns], and shows ``now``: what is remembered is of the old time."""
        if self.vehicle is not None:
            step = f"{'ahead' if by > 0 else 'back'} by {abs(by) / NANOSECONDS:.1f} s"
            self.notes.append(f"the clock of this computer was set {step}: stamps follow it")
        self.clock.reset()
        self.boot_time.clock_was_set(by)
        self.requests.clock_was_set(by)
        self._last_message += by
        self._asked.clear()
        self._syncs, self._next_sync, self._next_heartbeat = 0, now, now

    def _synchronise(self, fields: dict[str, Any], now: int) -> None:
        """An answer carries our time back in ts1; a question (tc1 = 0) is answered in the next ``tick``."""
        if fields["tc1"] != 0 and int(fields["ts1"]) in self._asked:
            self.clock.add_round_trip(int(fields["ts1"]), now, int(fields["tc1"]))
        elif fields["tc1"] == 0:
            self._question = int(fields["ts1"])

    # -- out -----------------------------------------------------------------------------------------------------

    def tick(self, now: int) -> bytes:
        """What is to be sent now; to be called several times a second."""
        return b"".join(self.decoder.encode(message) for message in self._due(now))

    def _due(self, now: int) -> Iterator[Any]:
        self._look_for_silence(now)
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + round(HEARTBEAT_PERIOD * NANOSECONDS)
            yield dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
            )
        if self._question is not None:
            yield dialect.MAVLink_timesync_message(now, self._question)
            self._question = None
        if self.vehicle is None:
            return
        if now >= self._next_sync:
            period = FIRST_SYNC_PERIOD if self._syncs < FIRST_SYNCS else SYNC_PERIOD
            self._next_sync = now + round(period * NANOSECONDS)
            self._syncs += 1
            self._asked.append(now)
            yield dialect.MAVLink_timesync_message(0, now)
        if not self._silent:
            yield from self.requests.due(now, self.vehicle.system, self.vehicle.component)

    def _look_for_silence(self, now: int) -> None:
        heard = self.vehicle is not None and not self._silent and self._last_message > 0
        if heard and now - self._last_message > LOST_AFTER * NANOSECONDS:
            self._silent = True
            self.losses += 1
            self.notes.append("the vehicle is silent")

    @property
    def is_heard(self) -> bool:
        """Whether the vehicle was found and has not fallen silent."""
        return self.vehicle is not None and not self._silent

    @property
    def condition(self) -> str:
        """What is wrong, in words; empty when nothing is."""
        other = f", and {self._other}" if self._other else ""
        if self.vehicle is None:
            wanted = "an autopilot" if self._wanted_system is None else f"system {self._wanted_system}"
            return f"waiting for the heartbeat of {wanted}{other}"
        if self._silent:
            return f"the vehicle, system {self.vehicle.system}, is silent{other}" if other else "the vehicle is silent"
        if not self.clock.ready:
            return "waiting for the clock of the autopilot"
        return ""

    @property
    def outputs_condition(self) -> str:
        """Why outputs that come are no control surfaces, in words; empty when they are."""
        return self.assembler.outputs_condition

    def take_notes(self) -> list[str]:
        """News since the last call."""
        notes, self.notes = self.notes, []
        return notes

    def summary(self) -> dict[str, Any]:
        """Counts for a report or for diagnostics."""
        vehicle = self.vehicle
        return {
            "vehicle": None if vehicle is None else f"{vehicle.autopilot} {vehicle.system}",
            "received": dict(self.received),
            "published": dict(self.published),
            "bad_data": self.decoder.bad,
            "unstamped": self.unstamped,
            "not_finite": self.not_finite,
            "not_signed": self.decoder.refused,
            "reboots": self.boot_time.reboots,
            "losses": self.losses,
            "missing": self.missing,
            "clock": {
                "drift_ppm": 1e6 * self.clock.drift if self.clock.ready else None,
                "std": self.clock.std if self.clock.ready else None,
            },
        }
