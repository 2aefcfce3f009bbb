"""Every field of every message of the MAVLink simulator in a flight, against the truth in the unit of the definition.

The units, types and enumerations are those of pymavlink's dialect, which is generated from MAVLink's definitions; the
packets are read by pymavlink alone. What the definitions leave open is as ArduPlane 4.6 fills it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.aircraft.earth import geodetic_along
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion, rotation_matrix
from aircraft_sysid_ros.simulation.mavlink_simulator.autopilot import KNOWN, MavlinkSimulator
from aircraft_sysid_ros.simulation.mavlink_simulator.process import Radio
from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import ATTITUDE, VELOCITY, FlightSensors, pieces
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

BOOT = 100.0  # [s] since start when the flight begins
UNIX = 1_780_000_000
NOISE = 0.01  # of the usual
DURATION, FLOWN = 14.0, 20.0  # [s] of what the shortest flight is
QUESTION = 123_456_789
#: Units of the definitions in SI and radians, temperatures in deg C.
UNITS = {
    None: 1.0, "us": 1e-6, "ms": 1e-3, "ns": 1e-9, "m/s/s": 1.0, "mG": 9.80665e-3, "rad/s": 1.0, "mrad/s": 1e-3,
    "gauss": 1e-4, "mgauss": 1e-7, "hPa": 100.0, "degC": 1.0, "cdegC": 0.01, "m": 1.0, "mm": 1e-3, "m/s": 1.0,
    "cm/s": 0.01, "mm/s": 1e-3, "rad": 1.0, "deg": np.radians(1.0), "cdeg": np.radians(0.01),
    "degE5": np.radians(1e-5), "degE7": np.radians(1e-7), "%": 0.01, "d%": 1e-3, "c%": 1e-4, "mV": 1e-3, "cA": 0.01,
}  # fmt: skip


@dataclass(frozen=True)
class Sent:
    """n messages of one name, the times of flight [s] at which they were sent, and the flight."""

    messages: list
    time: np.ndarray
    flight: "Flown"

    def truth(self, topic=None):
        """Truth at the newest sample of a topic that each message can know; at their own times without a topic."""
        if topic is None:
            return self.flight.truth.at(self.time)
        taken = self.flight.sampled[topic]
        return self.flight.truth.at(taken[np.searchsorted(taken, self.time + 1e-9) - 1])


class Flown:
    """A flight whose sensors are nearly without noise, as the packets of a simulator that is asked for everything."""

    def __init__(self, aircraft, mapping):
        self.aircraft, self.truth = aircraft, simulate_samples(aircraft, seed=2, duration=FLOWN).truth
        self.sensors = FlightSensors(aircraft, 2, noise_scale=NOISE)
        events = [event for piece in pieces(self.truth)[: int(DURATION)] for event in self.sensors.events(piece)]
        topics = {event.topic for event in events}
        self.sampled = {topic: np.array([e.time for e in events if e.topic == topic]) for topic in topics}
        simulator = MavlinkSimulator(mapping, unix_start=UNIX * 10**9)
        self._reader = dialect.MAVLink(None)
        self._sent = []
        self._ask(simulator)
        for event in events:
            simulator.tick(event.time)
            simulator.sense(event)
            self._read(simulator, event.time)

    def _ask(self, simulator):
        link = dialect.MAVLink(None, srcSystem=7, srcComponent=191)
        simulator.receive(dialect.MAVLink_timesync_message(0, QUESTION).pack(link), 0.0)
        for number in KNOWN:
            command = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
            message = dialect.MAVLink_command_long_message(1, 1, command, 0, number, 1e4, 0, 0, 0, 0, 0)
            simulator.receive(message.pack(link), 0.0)
        self._read(simulator, 0.0)

    def _read(self, simulator, time):
        for packet in simulator.packets():
            self._sent += [(time, message) for message in self._reader.parse_buffer(packet)]

    @property
    def names(self):
        return {message.get_type() for _, message in self._sent}

    def of(self, name):
        chosen = [(time, message) for time, message in self._sent if message.get_type() == name]
        return Sent([message for _, message in chosen], np.array([time for time, _ in chosen]), self)


@pytest.fixture(scope="module")
def flown(aircraft, mapping):
    return Flown(aircraft, mapping)


# -- what is true ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Field:
    """What a field must be, (n,) in SI, and how much noise [SI] may be on it beside the rounding of its type."""

    true: Callable[[Sent], np.ndarray]
    noise: float = 0.0
    is_angle: bool = False


def constant(value):
    return Field(lambda sent: np.full(len(sent.time), value))


def column(of, i, noise=0.0):
    return Field(lambda sent: of(sent)[:, i], noise)


NOTHING = constant(0.0)
SINCE_START = Field(lambda sent: BOOT + sent.time)


def at_place(truth, position, velocity):
    """Velocity (n, 3) at a place of the body."""
    return velocity + np.cross(truth.rates, position)


def turned(truth, vector, back=False):
    matrices = [rotation_matrix(q) for q in truth.quaternion]
    vectors = np.broadcast_to(vector, (len(matrices), 3))
    return np.array([(m.T if back else m) @ v for m, v in zip(matrices, vectors, strict=True)])


def force(sent):
    truth, arm = sent.truth("imu/data"), sent.flight.aircraft.imu_position
    lever = np.cross(truth.angular_acceleration, arm) + np.cross(truth.rates, np.cross(truth.rates, arm))
    return truth.specific_force + lever + sent.flight.sensors.accelerometer_bias


def gyro(sent):
    return sent.truth("imu/data").rates + sent.flight.sensors.gyro_bias


def magnetic_field(sent):
    return turned(sent.truth("imu/mag"), np.array([1.7e-5, 0.0, 5.1e-5]), back=True)


def geodetic(truth, position):
    return geodetic_along(truth.position + turned(truth, position), truth.origin)


def antenna(sent):
    return geodetic(sent.truth("gps/fix"), sent.flight.aircraft.gps_position)


def antenna_velocity(sent):
    truth, arm = sent.truth("gps/vel"), sent.flight.aircraft.gps_position
    return truth.velocity + turned(truth, np.cross(truth.rates, arm))


def filtered_place(sent):
    return geodetic(sent.truth(VELOCITY), np.zeros(3))


def filtered_velocity(sent):
    return sent.truth(VELOCITY).velocity


def euler(sent):
    return np.array([euler_from_quaternion(q) for q in sent.truth(ATTITUDE).quaternion])


def flow(sent):
    """V, alpha, beta at the probe."""
    truth = sent.truth("air_data")
    u, v, w = at_place(truth, sent.flight.aircraft.air_data_position, truth.air_velocity).T
    return np.stack([np.sqrt(u**2 + v**2 + w**2), np.arctan2(w, u), np.arctan2(v, np.hypot(u, w))], axis=1)


def static_pressure(sent):
    return sent.truth("air_data").static_pressure


def altitude(sent):
    truth = sent.truth("air_data")
    return truth.origin[2] - truth.position[:, 2]


def standard_pressure(height):
    """ISO 2533."""
    return 101_325.0 * (1.0 - 2.25577e-5 * height) ** 5.25588


def impact_pressure(sent):
    truth, speed = sent.truth("air_data"), flow(sent)[:, 0]
    mach2 = speed**2 * truth.density / (1.4 * truth.static_pressure)
    return 0.5 * truth.density * speed**2 * (1.0 + 0.25 * mach2)


def equivalent_airspeed(sent):
    return flow(sent)[:, 0] * np.sqrt(sent.truth("air_data").density / 1.225)


def controls(sent):
    return sent.truth("control_surfaces").controls


def heading(sent):
    return euler(sent)[:, 2]


def pulse(i, per_radian):
    """A servo about 1500 us, by the servo mapping of the simulator."""
    return Field(lambda sent: (1500.0 + controls(sent)[:, i] * per_radian) * 1e-6, 1e-6)


def hypot(of):
    return lambda sent: np.hypot(of(sent)[:, 0], of(sent)[:, 1])


def course(of):
    return lambda sent: np.arctan2(of(sent)[:, 1], of(sent)[:, 0])


US_PER_RADIAN = 500.0 / np.radians(30.0)
SPEED_NOISE = 0.15 * NOISE * 6
AIR_TEMPERATURE = Field(lambda sent: 15.0 - 0.0065 * altitude(sent), 0.03)
STATIC = Field(static_pressure, 10.0 * NOISE * 6)
IMPACT = Field(impact_pressure, 0.3)
AIRSPEED = Field(equivalent_airspeed, SPEED_NOISE)
FORCE, GYRO = ([column(of, i, noise * NOISE * 6) for i in range(3)] for of, noise in ((force, 0.03), (gyro, 0.002)))
MAGNETIC = [column(magnetic_field, i, 0.05 * 1.7e-5 * NOISE * 6) for i in range(3)]
RATES = [column(lambda sent: sent.truth(ATTITUDE).rates, i) for i in range(3)]
ANGLES = [Field(lambda sent, i=i: euler(sent)[:, i], is_angle=True) for i in range(3)]
FILTERED = [column(filtered_velocity, i, 0.05 * NOISE * 6) for i in range(3)]
HEADING = Field(heading, is_angle=True)
WHOLE_IMU = {
    **dict(zip(("xacc", "yacc", "zacc"), FORCE, strict=True)),
    **dict(zip(("xgyro", "ygyro", "zgyro"), GYRO, strict=True)),
    **dict(zip(("xmag", "ymag", "zmag"), MAGNETIC, strict=True)),
}  # fmt: skip
TURNING = dict(zip(("rollspeed", "pitchspeed", "yawspeed"), RATES, strict=True))
SENSORS = constant(0x1321FC3F)  # sensors, control, outputs, RC, AHRS, log, battery, checks before arming

BELOW_GROUND_PRESSURE = Field(
    lambda sent: static_pressure(sent) - standard_pressure(sent.flight.truth.origin[2]), 10.0 * NOISE * 6 + 2.0
)

EXPECTED = {
    "HIGHRES_IMU": {
        "time_usec": SINCE_START, **WHOLE_IMU, "abs_pressure": STATIC,
        "diff_pressure": BELOW_GROUND_PRESSURE,
        "pressure_alt": Field(altitude, 0.2), "temperature": AIR_TEMPERATURE,
        "fields_updated": constant(0b1_1111_1111_1111), "id": NOTHING,
    },
    "SCALED_IMU": {"time_boot_ms": SINCE_START, **WHOLE_IMU, "temperature": constant(45.0)},
    "RAW_IMU": {"time_usec": SINCE_START, **WHOLE_IMU, "id": NOTHING, "temperature": constant(45.0)},
    "GPS_RAW_INT": {
        "time_usec": Field(lambda sent: BOOT + sent.truth("gps/fix").time, 1e-3),  # ArduPlane knows it in ms
        "fix_type": constant(dialect.GPS_FIX_TYPE_3D_FIX),
        "lat": column(antenna, 0, 0.8 * NOISE * 6 / 6.3e6), "lon": column(antenna, 1, 0.8 * NOISE * 6 / 4.4e6),
        "alt": column(antenna, 2, 1.5 * NOISE * 6 + 0.01), "alt_ellipsoid": column(antenna, 2, 1.5 * NOISE * 6 + 0.01),
        "eph": constant(80), "epv": constant(120),
        "vel": Field(hypot(antenna_velocity), 0.1 * NOISE * 6),
        "cog": Field(course(antenna_velocity), 0.1 * NOISE * 6 / 10.0, is_angle=True),
        "satellites_visible": constant(14), "h_acc": constant(np.sqrt(2.0) * 0.8 * NOISE),
        "v_acc": constant(1.5 * NOISE), "vel_acc": constant(0.1),
        "hdg_acc": NOTHING, "yaw": NOTHING,  # a receiver with one antenna
    },
    "GLOBAL_POSITION_INT": {
        "time_boot_ms": SINCE_START, "lat": column(filtered_place, 0), "lon": column(filtered_place, 1),
        "alt": column(filtered_place, 2), "relative_alt": Field(lambda sent: -sent.truth(VELOCITY).position[:, 2]),
        "vx": FILTERED[0], "vy": FILTERED[1], "vz": FILTERED[2], "hdg": HEADING,
    },
    "SCALED_PRESSURE": {
        "time_boot_ms": SINCE_START, "press_abs": STATIC, "press_diff": IMPACT, "temperature": AIR_TEMPERATURE,
        "temperature_press_diff": AIR_TEMPERATURE,
    },
    "VFR_HUD": {
        "airspeed": AIRSPEED, "groundspeed": Field(hypot(filtered_velocity), 0.05 * NOISE * 6), "heading": HEADING,
        "throttle": Field(lambda sent: controls(sent)[:, 4]), "alt": column(filtered_place, 2),
        "climb": Field(lambda sent: -filtered_velocity(sent)[:, 2], 0.05 * NOISE * 6),
    },
    "AIRSPEED": {
        "id": NOTHING, "airspeed": AIRSPEED, "temperature": AIR_TEMPERATURE, "raw_press": IMPACT,
        "flags": constant(dialect.AIRSPEED_SENSOR_USING),
    },
    "AOA_SSA": {
        "time_usec": SINCE_START, "AOA": column(flow, 1, 0.003 * NOISE * 6), "SSA": column(flow, 2, 0.003 * NOISE * 6),
    },
    "SERVO_OUTPUT_RAW": {
        "time_usec": SINCE_START, "port": NOTHING, "servo1_raw": pulse(1, US_PER_RADIAN),
        "servo2_raw": pulse(0, -US_PER_RADIAN), "servo3_raw": Field(lambda sent: (1.0 + controls(sent)[:, 4]) * 1e-3),
        "servo4_raw": pulse(2, US_PER_RADIAN), "servo5_raw": pulse(1, US_PER_RADIAN),
        **{f"servo{i}_raw": NOTHING for i in range(6, 17)},
    },
    "RPM": {"rpm1": Field(lambda sent: controls(sent)[:, 6] * 60.0 / (2.0 * np.pi)), "rpm2": constant(-1.0)},
    "NAMED_VALUE_FLOAT": {"time_boot_ms": SINCE_START, "value": column(controls, 5)},
    "ATTITUDE": {
        "time_boot_ms": SINCE_START, **dict(zip(("roll", "pitch", "yaw"), ANGLES, strict=True)), **TURNING,
    },
    "ATTITUDE_QUATERNION": {
        "time_boot_ms": SINCE_START, **TURNING,
        **{f"q{i + 1}": column(lambda sent: sent.truth(ATTITUDE).quaternion, i) for i in range(4)},
    },
    "WIND": {
        "direction": Field(course(lambda sent: -sent.truth().wind), is_angle=True),
        "speed": Field(hypot(lambda sent: sent.truth().wind)), "speed_z": column(lambda sent: sent.truth().wind, 2),
    },
    "SYSTEM_TIME": {"time_unix_usec": Field(lambda sent: UNIX + sent.time), "time_boot_ms": SINCE_START},
    "SYS_STATUS": {
        **{f"onboard_control_sensors_{what}": SENSORS for what in ("present", "enabled", "health")},
        "load": constant(0.3), "voltage_battery": constant(12.0), "current_battery": constant(1.0),
        "battery_remaining": constant(0.9), "drop_rate_comm": NOTHING, "errors_comm": NOTHING,
        **{f"errors_count{i}": NOTHING for i in range(1, 5)},
        **{f"onboard_control_sensors_{what}_extended": NOTHING for what in ("present", "enabled", "health")},
    },
    "HEARTBEAT": {
        "type": constant(dialect.MAV_TYPE_FIXED_WING), "autopilot": constant(dialect.MAV_AUTOPILOT_ARDUPILOTMEGA),
        "base_mode": constant(0b1101_1001), "custom_mode": constant(dialect.PLANE_MODE_AUTO),
        "system_status": constant(dialect.MAV_STATE_ACTIVE), "mavlink_version": constant(3),
    },
    "TIMESYNC": {  # its answer to our question, then questions of its own
        "tc1": Field(lambda sent: np.where(sent.time > 0.0, 0.0, first(sent, BOOT))),
        "ts1": Field(lambda sent: np.where(first(sent, 1.0) > 0.0, QUESTION * 1e-9, BOOT + sent.time)),
    },
    "COMMAND_ACK": {
        "command": constant(dialect.MAV_CMD_SET_MESSAGE_INTERVAL), "result": NOTHING,  # MAV_RESULT_ACCEPTED
        "progress": NOTHING, "result_param2": NOTHING, "target_system": constant(7), "target_component": constant(191),
    },
}  # fmt: skip
#: Fields that are no numbers.
OTHERS = {"NAMED_VALUE_FLOAT": {"name": "THRUST"}, "ATTITUDE_QUATERNION": {"repr_offset_q": [0.0] * 4}}


def first(sent, value):
    """A value for the first message, 0 for the others."""
    return np.where(np.arange(len(sent.time)) == 0, value, 0.0)


# -- the comparison -------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_every_message_that_is_sent_is_compared_in_every_field(flown):
    assert flown.names == set(EXPECTED)
    for name, fields in EXPECTED.items():
        assert set(fields) | set(OTHERS.get(name, ())) == set(definition(name).fieldnames), name


def definition(name):
    return dialect.mavlink_map[getattr(dialect, f"MAVLINK_MSG_ID_{name}")]


@pytest.mark.long
@pytest.mark.parametrize("name", EXPECTED)
def test_fields_are_the_truth_in_the_unit_of_the_definition(flown, name):
    sent = flown.of(name)
    assert len(sent.messages) > 10 or name in ("TIMESYNC", "HEARTBEAT", "WIND")
    kinds = dict(zip(definition(name).fieldnames, definition(name).fieldtypes, strict=True))
    for field, expected in EXPECTED[name].items():
        unit = UNITS[definition(name).fieldunits_by_name.get(field)]
        raw = np.array([getattr(message, field) for message in sent.messages], dtype=np.float64)
        difference = raw * unit - expected.true(sent)
        if expected.is_angle:
            difference = (difference + np.pi) % (2.0 * np.pi) - np.pi
        rounding = 1.0 * unit if "int" in kinds[field] else 3e-7 * np.abs(raw).max() * unit
        worst = np.abs(difference).max()
        assert worst <= expected.noise + 1.001 * rounding, f"{name}.{field} is off by {worst:g}"


@pytest.mark.parametrize("name", EXPECTED)
def test_what_ardupilot_fills_is_filled_and_enumerations_have_their_values(flown, name):
    sent = flown.of(name)
    for field, expected in EXPECTED[name].items():
        values = [getattr(message, field) for message in sent.messages]
        assert any(values) == (expected is not NOTHING), field
        enumeration = definition(name).fieldenums_by_name.get(field)
        if enumeration is not None:
            known = dialect.enums[enumeration]
            is_mask = definition(name).fielddisplays_by_name.get(field) == "bitmask"
            assert all(known_bits(value, known) if is_mask else value in known for value in values), field


def known_bits(value, known):
    return value & ~sum(bit for bit in known if bit & (bit - 1) == 0) == 0


def test_texts_and_lists(flown):
    for name, fields in OTHERS.items():
        for field, value in fields.items():
            assert all(getattr(message, field) == value for message in flown.of(name).messages)


def test_a_busy_machine_tells_no_time_that_its_samples_are_far_behind(mapping):
    """The stand-in has flown to 1 s when 30 s have gone by: an autopilot's clock and samples are of one machine."""

    class Link:
        def __init__(self) -> None:
            self.sent = []

        def write(self, packet: bytes) -> None:
            self.sent += dialect.MAVLink(None).parse_buffer(packet)

        def read(self, wait: float) -> bytes:
            return b""

    link = Link()
    radio = Radio(MavlinkSimulator(mapping), link, ())
    radio.begin()
    radio.add([], 1.0)
    radio.started -= 30.0
    radio.run_until(0.0)
    (told,) = [message.time_boot_ms for message in link.sent if message.get_type() == "SYSTEM_TIME"]
    assert told == 1000 * (BOOT + 1.0)
