"""The protocol of the MAVLink simulator, without sockets: samples and bytes in with their times, packets out."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.mavlink.decoder import Decoder
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.sensors.sensor_models import EPOCH
from aircraft_sysid_ros.simulation.mavlink_simulator.messages import MESSAGES_OF, Encoder
from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import Event
from aircraft_sysid_ros.stamps import NANOSECONDS

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
#: Messages of the MAVLink simulator by number, those of ArduPlane 4.6.
KNOWN = {
    getattr(dialect, f"MAVLINK_MSG_ID_{name}"): name
    for name in {name for names in MESSAGES_OF.values() for name in names} | FIRST_RATES.keys()
}
_TOLERANCE = 0.3  # of an interval: a sample that comes so early is sent
MAVLINK_VERSION = 3
START_TIME = 3.0  # [s] of silence after a restart
_MOST_HEARD = 10_000
#: Armed, in mode AUTO, with stick mixing.
_MODE = (
    dialect.MAV_MODE_FLAG_SAFETY_ARMED | dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    | dialect.MAV_MODE_FLAG_STABILIZE_ENABLED | dialect.MAV_MODE_FLAG_GUIDED_ENABLED
    | dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
)  # fmt: skip
_SENSORS = (
    dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO | dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | dialect.MAV_SYS_STATUS_SENSOR_3D_MAG | dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | dialect.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE | dialect.MAV_SYS_STATUS_SENSOR_GPS
    | dialect.MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL | dialect.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
    | dialect.MAV_SYS_STATUS_SENSOR_YAW_POSITION | dialect.MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
    | dialect.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL | dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER | dialect.MAV_SYS_STATUS_AHRS | dialect.MAV_SYS_STATUS_LOGGING
    | dialect.MAV_SYS_STATUS_SENSOR_BATTERY | dialect.MAV_SYS_STATUS_PREARM_CHECK
)  # fmt: skip
_POWER = (300, 12000, 100, 90)  # load of the processor [d%], battery [mV], [cA], left [%]
_QUESTION_PERIOD = 10.0  # [s] between its own questions of TIMESYNC


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
class MavlinkSimulator:
    """One autopilot; ``time`` is that of the flight [s], the same for everybody."""

    mapping: ServoMapping
    faults: Faults = field(default_factory=Faults)
    seed: int = 0
    unix_start: int = EPOCH  # [ns] when the flight begins, as its GPS says

    def __post_init__(self) -> None:
        self.encoder = Encoder(self.mapping)
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
        self._next_second = self._next_question = -np.inf

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
                message = self.encoder.message(name, event, self.boot(self.encoder.sampled(name, event)))
                if message is not None:
                    self._send(message)

    def tick(self, time: float) -> None:
        """Heartbeat, system time and status, once a second; now and then a question of TIMESYNC."""
        if time < self._speaks_from or time < self._next_second:
            return
        self._next_second = time + 1.0
        kind, autopilot = dialect.MAV_TYPE_FIXED_WING, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
        state = (_MODE, dialect.PLANE_MODE_AUTO, dialect.MAV_STATE_ACTIVE, MAVLINK_VERSION)
        self._send(dialect.MAVLink_heartbeat_message(kind, autopilot, *state))
        unix = (self.unix_start + round(time * NANOSECONDS)) // 1000
        self._send(dialect.MAVLink_system_time_message(unix, self.boot(time) // 1_000_000))
        sensors, no_errors = (_SENSORS, _SENSORS, _SENSORS), (0,) * 6
        self._send(dialect.MAVLink_sys_status_message(*sensors, *_POWER, *no_errors))
        if time >= self._next_question:
            self._next_question = time + _QUESTION_PERIOD
            self._send(dialect.MAVLink_timesync_message(0, self.boot(time)))

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
            done, sender = 0, (message.get_srcSystem(), message.get_srcComponent())
            yield dialect.MAVLink_command_ack_message(message.command, self._set_interval(message), done, 0, *sender)
        elif name == "REQUEST_DATA_STREAM":
            rate = float(message.req_message_rate) if message.start_stop else 0.0
            for each in STREAMS.get(message.req_stream_id, ()):
                self._rates[each] = _Schedule(rate)
        elif name in ("WIND_COV", "NAMED_VALUE_FLOAT", "DEBUG_FLOAT_ARRAY"):
            self.heard.append(message)

    def _set_interval(self, message: Any) -> int:
        """Result of a command, as a number of MAV_RESULT."""
        if message.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL or not self.faults.knows_intervals:
            return int(dialect.MAV_RESULT_UNSUPPORTED)
        name = KNOWN.get(int(message.param1))
        if name is None or (name == "HIGHRES_IMU" and not self.faults.highres_imu):
            return int(dialect.MAV_RESULT_FAILED)
        usual = FIRST_RATES.get(name, 0.0) if message.param2 == 0.0 else 0.0  # negative: none
        self._rates[name] = _Schedule(1e6 / message.param2 if message.param2 > 0.0 else usual)
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
