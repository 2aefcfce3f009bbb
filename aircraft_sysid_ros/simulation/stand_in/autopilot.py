"""The protocol of the stand-in, without sockets: samples and bytes in with their times, packets out."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.mavlink.calibration import Calibration
from aircraft_sysid_ros.mavlink.decoder import Decoder
from aircraft_sysid_ros.simulation.stand_in.messages import MESSAGES_OF, Encoder
from aircraft_sysid_ros.simulation.stand_in.sensors import Event

NANOSECONDS = 1_000_000_000
SYSTEM, COMPONENT = 1, 1
#: Rates [Hz] before anybody asks: those of a slow telemetry link.
FIRST_RATES = {
    "RAW_IMU": 2.0, "GPS_RAW_INT": 2.0, "SCALED_PRESSURE": 2.0, "VFR_HUD": 2.0, "ATTITUDE": 4.0,
    "GLOBAL_POSITION_INT": 2.0, "SERVO_OUTPUT_RAW": 2.0, "AOA_SSA": 2.0, "SYSTEM_TIME": 1.0, "SYS_STATUS": 1.0,
    "WIND": 1.0, "RPM": 2.0, "NAMED_VALUE_FLOAT": 50.0,
}  # fmt: skip
#: Messages by number of REQUEST_DATA_STREAM.
STREAMS = {
    1: ("RAW_IMU", "SCALED_PRESSURE"), 2: ("GPS_RAW_INT", "SYS_STATUS"), 3: ("SERVO_OUTPUT_RAW",),
    6: ("GLOBAL_POSITION_INT",), 10: ("ATTITUDE", "AOA_SSA"), 11: ("VFR_HUD",), 12: ("WIND", "RPM", "SYSTEM_TIME"),
}  # fmt: skip
#: Messages of the stand-in by number; AIRSPEED it does not know, as most ArduPlane versions in use.
KNOWN = {
    getattr(dialect, f"MAVLINK_MSG_ID_{name}"): name
    for name in {name for names in MESSAGES_OF.values() for name in names} | FIRST_RATES.keys()
    if name != "AIRSPEED"
}
_TOLERANCE = 0.3  # of an interval: a sample that comes so early is sent
START_TIME = 3.0  # [s] of silence after a restart
_MOST_HEARD = 10_000
_SENSORS = 0x3F  # with an airspeed sensor


@dataclass(frozen=True)
class Faults:
    """What is wrong with clock and link."""

    clock_offset: float = 100.0  # [s] since start when the flight begins
    drift: float = 0.0  # how much faster than ours the autopilot's clock runs, e.g. 50e-6
    loss: float = 0.0  # share of packets lost, either way
    highres_imu: bool = True  # older versions have RAW_IMU alone
    answers_timesync: bool = True
    knows_intervals: bool = True  # else only REQUEST_DATA_STREAM


@dataclass
class _Schedule:
    rate: float
    last: float = -np.inf


@dataclass
class StandIn:
    """One autopilot; ``time`` is that of the flight [s], the same for everybody."""

    calibration: Calibration
    faults: Faults = field(default_factory=Faults)
    seed: int = 0

    def __post_init__(self) -> None:
        self.encoder = Encoder(self.calibration)
        self.heard: deque[Any] = deque(maxlen=_MOST_HEARD)  # wind and parameters that came back
        self.sent: Counter[str] = Counter()
        self.lost = 0
        self._rng = np.random.default_rng([self.seed, 77])
        self._began = -self.faults.clock_offset  # time of flight at which it started
        self._speaks_from = -np.inf
        self._codec()

    def _codec(self) -> None:
        self._decoder = Decoder()
        self._decoder.system = SYSTEM
        self._decoder.component = COMPONENT
        self._rates = {name: _Schedule(rate) for name, rate in FIRST_RATES.items()}
        self._packets: list[bytes] = []
        self._next_second = -np.inf

    def boot(self, time: float) -> int:
        """The autopilot's time since start [ns]."""
        return round((time - self._began) * (1.0 + self.faults.drift) * NANOSECONDS)

    def reboot(self, time: float) -> None:
        """Start anew: the clock begins at 0, rates are forgotten, nothing is said for a while."""
        self._began, self._speaks_from = time, time + START_TIME
        self._codec()

    def sense(self, event: Event) -> None:
        """A sample of a sensor: whatever messages of it are due go out."""
        self.encoder.take(event)
        if event.time < self._speaks_from:
            return
        for name in MESSAGES_OF.get(event.topic, ()):
            if self._is_due(name, event.time):
                message = self.encoder.message(name, event, self.boot(event.time))
                if message is not None:
                    self._send(message)

    def tick(self, time: float) -> None:
        """Heartbeat, system time and status, once a second."""
        if time < self._speaks_from or time < self._next_second:
            return
        self._next_second = time + 1.0
        kind, autopilot = dialect.MAV_TYPE_FIXED_WING, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
        self._send(dialect.MAVLink_heartbeat_message(kind, autopilot, 217, 10, 4, 3))
        if "SYSTEM_TIME" in self._rates:
            self._send(dialect.MAVLink_system_time_message(0, self.boot(time) // 1_000_000))
        sensors = (_SENSORS, _SENSORS, _SENSORS)
        self._send(dialect.MAVLink_sys_status_message(*sensors, 300, 12000, 100, 90, 0, 0, 0, 0, 0, 0))

    def receive(self, data: bytes, time: float) -> None:
        """Bytes of the bridge: questions are answered, what is for the autopilot is kept in ``heard``."""
        if time < self._speaks_from or self._is_lost():
            return
        for message in self._decoder.decode(data):
            for answer in self._answers(message, time):
                self._send(answer)

    def packets(self) -> list[bytes]:
        """What goes out now; a packet that the link loses is not among them."""
        packets, self._packets = self._packets, []
        return packets

    def _is_due(self, name: str, time: float) -> bool:
        schedule = self._rates.get(name)
        if schedule is None or schedule.rate <= 0.0:
            return False
        if time - schedule.last < (1.0 - _TOLERANCE) / schedule.rate:
            return False
        schedule.last = time
        return True

    def _answers(self, message: Any, time: float) -> Iterator[Any]:
        name = message.get_type()
        if name == "TIMESYNC" and message.tc1 == 0 and self.faults.answers_timesync:
            yield dialect.MAVLink_timesync_message(self.boot(time), message.ts1)
        elif name == "COMMAND_LONG":
            yield dialect.MAVLink_command_ack_message(message.command, self._set_interval(message))
        elif name == "REQUEST_DATA_STREAM":
            for each in STREAMS.get(message.req_stream_id, ()):
                self._rates[each] = _Schedule(float(message.req_message_rate))
        elif name in ("WIND_COV", "NAMED_VALUE_FLOAT", "DEBUG_FLOAT_ARRAY"):
            self.heard.append(message)

    def _set_interval(self, message: Any) -> int:
        """Result of a command, as a number of MAV_RESULT."""
        if message.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL or not self.faults.knows_intervals:
            return int(dialect.MAV_RESULT_UNSUPPORTED)
        name = KNOWN.get(int(message.param1))
        if name is None or (name == "HIGHRES_IMU" and not self.faults.highres_imu):
            return int(dialect.MAV_RESULT_FAILED)
        self._rates[name] = _Schedule(1e6 / message.param2 if message.param2 > 0.0 else 0.0)
        return int(dialect.MAV_RESULT_ACCEPTED)

    def _send(self, message: Any) -> None:
        packet = self._decoder.encode(message)
        self.sent[message.get_type()] += 1
        if self._is_lost():
            self.lost += 1
        else:
            self._packets.append(packet)

    def _is_lost(self) -> bool:
        return self.faults.loss > 0.0 and bool(self._rng.random() < self.faults.loss)
