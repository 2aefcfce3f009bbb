"""One vehicle over one link: finding it, asking, answering, and starting anew when it does."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.back_channel import BackChannel, Known, Wind
from aircraft_sysid_ros.mavlink.back_options import BackOptions
from aircraft_sysid_ros.mavlink.bridge import Bridge
from aircraft_sysid_ros.mavlink.decoder import Decoder
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping, servo_mapping_from_dict
from aircraft_sysid_ros.mavlink.session import Session
from aircraft_sysid_ros.mavlink.signing import load_key
from aircraft_sysid_ros.simulation.mavlink_simulator.autopilot import Faults, MavlinkSimulator
from aircraft_sysid_ros.simulation.mavlink_simulator.flight import START, Link, bridged

SECOND = 1_000_000_000
RADIO = Link(least=0.02, jitter=0.02)


def heartbeat(system=1, component=1, kind=dialect.MAV_TYPE_FIXED_WING, autopilot=dialect.MAV_AUTOPILOT_ARDUPILOTMEGA):
    decoder = Decoder()
    decoder.system, decoder.component = system, component
    return decoder.encode(dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3))


def sent(session, now):
    return list(Decoder().decode(session.tick(now)))


ALL = None
IMU_ALONE = ("imu/data",)  # enough where only stamps matter, and quicker


def first(events, seconds, topics=ALL):
    """Of the other topics one sample each: messages tell of several sensors."""
    chosen = [event for event in events if event.time < seconds and (topics is ALL or event.topic in topics)]
    others = {event.topic: event for event in reversed(events) if topics is not ALL and event.topic not in topics}
    return sorted([*chosen, *others.values()], key=lambda event: event.time)


# -- finding ------------------------------------------------------------------------------------------------


def test_a_ground_station_and_a_gimbal_are_no_vehicles():
    session = Session()
    session.receive(heartbeat(255, 190, dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID), START)
    session.receive(heartbeat(1, 154, dialect.MAV_TYPE_GIMBAL, dialect.MAV_AUTOPILOT_INVALID), START)
    assert session.vehicle is None and "waiting for the heartbeat" in session.condition
    session.receive(heartbeat(7), START)
    assert (session.vehicle.system, session.vehicle.autopilot) == (7, "ArduPilot")
    session.receive(heartbeat(8, autopilot=dialect.MAV_AUTOPILOT_PX4), START)
    assert session.vehicle.system == 7


def test_the_vehicle_that_is_wanted_is_waited_for():
    session = Session(system=8)
    session.receive(heartbeat(7), START)
    assert session.vehicle is None
    session.receive(heartbeat(8, autopilot=dialect.MAV_AUTOPILOT_PX4), START)
    assert session.vehicle.autopilot == "PX4"


def test_a_vehicle_that_comes_back_under_another_number_is_named():
    session = Session()
    session.receive(heartbeat(1), START)
    session.receive(heartbeat(7), START)  # beside ours another one is nothing to speak of
    assert session.take_notes() == ["found ArduPilot, system 1"]
    later = START + 10 * SECOND
    session.tick(later)
    assert session.condition == "the vehicle is silent" and session.take_notes() == ["the vehicle is silent"]
    for _ in range(3):
        session.receive(heartbeat(7), later)
    other = "the vehicle, system 1, is silent, and ArduPilot, system 7, is heard"
    assert session.condition == other
    assert session.take_notes() == [f"{other}: restart the bridge to follow it"]
    session.receive(heartbeat(1), later)
    assert "system 7" not in session.condition and session.take_notes() == ["the vehicle is back"]
    waits = Session(system=8)
    waits.receive(heartbeat(7), START)
    assert waits.condition == "waiting for the heartbeat of system 8, and ArduPilot, system 7, is heard"


def test_before_a_vehicle_only_heartbeats_go_out_once_a_second():
    session = Session()
    names = [m.get_type() for k in range(50) for m in sent(session, START + k * SECOND // 10)]
    assert names == ["HEARTBEAT"] * 5


def test_messages_of_others_are_not_mixed_in():
    session = Session()
    session.receive(heartbeat(1), START)
    other = Decoder()
    other.system = other.component = 2
    session.receive(other.encode(dialect.MAVLink_attitude_message(1000, 0, 0, 0, 0, 0, 0)), START)
    assert "ATTITUDE" not in session.received


# -- asking -------------------------------------------------------------------------------------------------


def test_a_calibration_in_commands_where_pulses_come_is_said(events, mapping):
    commands = {1: {"surface": "elevator", "command": [-1, 1], "deg": [-25, 25]}}
    simulator, session = MavlinkSimulator(mapping), Session(servo_mapping_from_dict({"outputs": commands}))
    bridged(first(events, 3.0), simulator, session)
    assert session.received["SERVO_OUTPUT_RAW"] and not session.published["control_surfaces"]
    assert "give us in place of command" in session.outputs_condition


@pytest.mark.long
def test_rates_are_asked_for_by_interval_and_heard(events, mapping):
    simulator, session = MavlinkSimulator(mapping), Session(mapping)
    bridged(first(events, 6.0), simulator, session)
    imu, servo = session.received["HIGHRES_IMU"], session.received["SERVO_OUTPUT_RAW"]
    assert imu > 100 * 5 and servo > 50 * 5
    assert session.received["RAW_IMU"] < 20  # its slow rate of the start: a better one is there
    assert session.received["GPS_RAW_INT"] > 45  # 10 Hz, each of the 5 fixes in a second twice
    assert 25 <= session.published["gps/fix"] <= 30
    # until the receiver's is whole, which takes a quarter of a second, that of the autopilot counts, at 50 Hz
    assert 25 <= session.published["gps/vel"] <= 30 + 15
    assert 50 <= session.published["imu/mag"] <= 60  # the sensor's own 10 Hz


@pytest.mark.long
def test_an_autopilot_without_highres_imu_gives_raw_imu(events, mapping):
    session = Session(mapping)
    bridged(first(events, 12.0, IMU_ALONE), MavlinkSimulator(mapping, Faults(highres_imu=False)), session)
    assert session.received["RAW_IMU"] > 100 * 6


@pytest.mark.long
def test_an_autopilot_that_knows_no_intervals_is_asked_for_streams(events, mapping):
    session = Session(mapping)
    simulator = MavlinkSimulator(mapping, Faults(knows_intervals=False))
    bridged(first(events, 20.0, ("imu/data", "control_surfaces")), simulator, session)
    assert session.received["RAW_IMU"] > 100 * 8
    assert session.received["SERVO_OUTPUT_RAW"] > 50 * 8


def test_a_rate_of_zero_is_never_asked_for_and_an_unknown_message_is_refused():
    session = Session(ServoMapping(rates={"AOA_SSA": 0.0, "BATTERY_STATUS": 2.0}))
    session.receive(heartbeat(), START)
    numbers = [int(m.param1) for m in sent(session, START) if m.get_type() == "COMMAND_LONG"]
    assert dialect.MAVLINK_MSG_ID_AOA_SSA not in numbers and dialect.MAVLINK_MSG_ID_BATTERY_STATUS in numbers
    with pytest.raises(InputError, match="no message RAW_IMUS"):
        Session(ServoMapping(rates={"RAW_IMUS": 1.0}))


def test_questions_become_rarer_where_nothing_comes():
    session = Session()
    session.receive(heartbeat(), START)
    times = []
    for k in range(6000):
        now = START + k * SECOND // 10
        if k % 10 == 0:
            session.receive(heartbeat(), now)
        asked = [m for m in sent(session, now) if m.get_type() == "COMMAND_LONG"]
        if any(m.param1 == dialect.MAVLINK_MSG_ID_AOA_SSA for m in asked):
            times.append(k / 10)
    assert 8 <= len(times) <= 20 and times[0] == 0.0
    assert np.diff(times)[-1] >= 59.0


# -- the clock ----------------------------------------------------------------------------------------------


def stamp_errors(outputs, events, bias=0.0):
    """Stamps of IMU messages [s of flight], and what they differ by from the times at which samples were taken."""
    stamps = np.array([o.stamp[0] for o in outputs if o.topic == "imu/data"])
    taken = np.array([e.time for e in events if e.topic == "imu/data"])
    seconds = (stamps - START) / SECOND - bias
    return seconds, seconds - taken[np.argmin(np.abs(taken[None, :] - seconds[:, None]), axis=1)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("faults", "tolerance", "bias"),
    [(Faults(drift=60e-6), 0.004, 0.0), (Faults(drift=60e-6, answers_timesync=False), 0.006, 0.02)],
)
def test_stamps_are_when_samples_were_taken_on_a_radio_that_is_late(events, mapping, faults, tolerance, bias):
    """20 to 100 ms late and by very different times; without answers the least delay is not seen, and no more."""
    session = Session(mapping)
    flown = first(events, 30.0, IMU_ALONE)
    outputs = bridged(flown, MavlinkSimulator(mapping, faults), session, RADIO)
    at, error = stamp_errors(outputs, flown, bias)
    assert np.abs(error[at > 20.0]).max() < tolerance
    assert len(np.unique(np.rint(at[at > 20.0] * 100))) > 980  # one for each sample


def test_questions_of_the_vehicle_are_answered():
    session = Session()
    session.receive(heartbeat(), START)
    vehicle = Decoder()
    vehicle.system = vehicle.component = 1
    session.receive(vehicle.encode(dialect.MAVLink_timesync_message(0, 12345)), START)
    (answer,) = [m for m in sent(session, START + SECOND) if m.get_type() == "TIMESYNC" and m.tc1 != 0]
    assert (answer.ts1, answer.tc1) == (12345, START + SECOND)


def test_answers_to_other_stations_are_not_ours():
    session = Session()
    session.receive(heartbeat(), START)
    vehicle = Decoder()
    vehicle.system = vehicle.component = 1
    session.receive(vehicle.encode(dialect.MAVLink_timesync_message(10**9, START - 3)), START)
    assert not np.isfinite(session.clock.std)


# -- faults of the link -------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_fifth_of_the_packets_lost_loses_a_fifth_of_the_samples(events, mapping):
    session = Session(mapping)
    flown = first(events, 30.0, IMU_ALONE)
    outputs = bridged(flown, MavlinkSimulator(mapping, Faults(loss=0.2, drift=40e-6)), session)
    stamps = np.array([o.stamp[0] for o in outputs if o.topic == "imu/data"])
    late = stamps > START + 12 * SECOND
    assert 0.72 * 1800 < late.sum() < 0.88 * 1800
    _, error = stamp_errors(outputs, flown)
    assert np.abs(error[late]).max() < 0.003
    assert session.decoder.bad == 0 and session.boot_time.reboots == 0
    came = session.received.total()
    assert 0.17 < session.missing / (came + session.missing) < 0.23


def test_a_packet_that_is_overtaken_is_not_missing(mapping):
    session, vehicle = Session(mapping), Decoder()
    vehicle.system = vehicle.component = 1
    session.receive(heartbeat(), START)
    packets = [vehicle.encode(dialect.MAVLink_attitude_message(k, 0, 0, 0, 0, 0, 0)) for k in range(600)]
    lost = {100, 101, 102, 300}
    order = [k for k in range(600) if k not in lost]
    for k in (20, 250, 400):  # the numbers begin again after 255
        at = order.index(k)
        order[at : at + 4] = order[at : at + 4][::-1]
    for k in order:
        session.receive(packets[k], START + k)
    assert session.missing == len(lost)


@pytest.mark.long
def test_a_restart_of_the_autopilot_is_found_and_everything_asked_for_again(events, mapping):
    session, simulator = Session(mapping), MavlinkSimulator(mapping)
    flown = first(events, 25.0, IMU_ALONE)
    outputs = bridged(flown, simulator, session, at=[(8.0, lambda: simulator.reboot(8.0))])
    stamps = (np.array([o.stamp[0] for o in outputs if o.topic == "imu/data"]) - START) / SECOND
    assert session.boot_time.reboots == 1 and "the autopilot has restarted" in session.notes
    after = stamps[stamps > 8.0]
    assert 11.0 < after[0] < 15.0  # three seconds of silence, then the clock must be known again
    assert len(after) > 0.95 * 100 * (25.0 - after[0])
    _, error = stamp_errors(outputs, flown)
    assert np.abs(error).max() < 0.004


def test_a_vehicle_that_falls_silent_is_said_to_be_and_asked_again_when_it_is_back(mapping):
    session = Session(mapping)
    session.receive(heartbeat(), START)
    sent(session, START)
    assert session.condition == "waiting for the clock of the autopilot"
    for k in range(100):
        names = [m.get_type() for m in sent(session, START + 6 * SECOND + k * SECOND // 10)]
    assert session.condition == "the vehicle is silent" and session.losses == 1 and "COMMAND_LONG" not in names
    session.receive(heartbeat(), START + 20 * SECOND)
    assert "COMMAND_LONG" in [m.get_type() for m in sent(session, START + 20 * SECOND)]


def test_a_restart_in_a_long_silence_is_followed_where_nothing_is_answered(mapping):
    """It is up for longer than before, so that no time goes back; without answers only the silence says it."""
    session, vehicle = Session(mapping), Decoder()
    vehicle.system = vehicle.component = 1
    stamps = []
    for begin, up in ((0, 10), (80, 60)):  # [s] when it is heard, and since when it is up
        session.receive(heartbeat(), START + begin * SECOND)
        for k in range(400):
            now = START + begin * SECOND + k * SECOND // 20
            boot = 1000 * up + 50 * k
            message = dialect.MAVLink_attitude_quaternion_message(boot, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            outputs = session.receive(vehicle.encode(message), now)
            stamps += [(int(o.stamp[0]) - now) / SECOND for o in outputs if o.topic == "autopilot/attitude"]
        session.tick(START + (begin + 40) * SECOND)
    assert len(stamps) > 600 and np.abs(stamps).max() < 0.02 and session.losses >= 1


@pytest.mark.long
class Vehicle:
    """An autopilot in place of a transport: IMU at 100 Hz and heartbeats; time goes on by 10 ms with each read."""

    def __init__(self, answers):
        self.decoder, self.ears, self.answers = Decoder(), Decoder(), answers
        self.decoder.system = self.decoder.component = 1
        self.steps, self.heard, self.asked = 0, [], []

    def read(self, timeout):
        if timeout == 0.0:
            return b""
        boot = 600 * SECOND + self.steps * SECOND // 100
        told = [dialect.MAVLink_highres_imu_message(boot // 1000, 0, 0, -9.8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 63)]
        told += [dialect.MAVLink_timesync_message(boot, sent) for sent in self.asked if self.answers]
        data = b"".join(self.decoder.encode(message) for message in told)
        self.asked.clear()
        self.steps += 1
        return heartbeat() + data

    def write(self, data):
        messages = list(self.ears.decode(data))
        self.heard += messages
        self.asked += [m.ts1 for m in messages if m.get_type() == "TIMESYNC" and m.tc1 == 0]

    def hold(self): ...

    def release(self): ...


@pytest.mark.parametrize("answers", [True, False])
@pytest.mark.parametrize("by", [-400 * 86400, -3600, 3600, 100 * 86400])
def test_our_own_clock_may_be_set_in_flight(by, answers):
    """By NTP or GPS, long after the start: heartbeats and what goes back stood still until the old time came again, or
    the link failed on a time that no message can hold, and stamps stayed in the old time."""
    vehicle, session = Vehicle(answers), Session()
    back = BackChannel(BackOptions(parameters=("CZ_alpha",)))
    now = lambda: START + vehicle.steps * SECOND // 100 + (by * SECOND if vehicle.steps >= 1000 else 0)  # noqa: E731
    bridge = Bridge(vehicle, session, back, now, lambda: vehicle.steps * SECOND // 100)
    behind = []
    for k in range(2000):
        back.wind, back.parameters = Wind((1.0, 2.0, 0.0), (1.0, 1.0, 1.0)), (Known("CZ_alpha", -5.0, 0.1, True),)
        outputs = bridge.step()
        behind += [(now() - int(o.stamp[0])) / SECOND for o in outputs if o.topic == "imu/data"]
        if k == 1000:
            vehicle.heard.clear()
    counts = {name: sum(m.get_type() == name for m in vehicle.heard) for name in ("HEARTBEAT", "WIND_COV")}
    assert counts["HEARTBEAT"] >= 9 and counts["WIND_COV"] >= 6, counts
    assert sum(m.get_type() == "NAMED_VALUE_FLOAT" for m in vehicle.heard) >= 6
    assert len(behind) > 1400 and np.abs(behind).max() < 0.05
    notes = " ".join(session.notes)
    assert "clock" in notes and ("back" if by < 0 else "ahead") in notes and "restarted" not in notes


@pytest.mark.parametrize("sort", ["noise", "nearly"])
def test_garbage_does_no_harm_and_takes_no_memory(events, mapping, sort):
    """400 kB, a minute of a radio at 57600 baud that hears another transmitter: noise, and broken packets."""
    import tracemalloc

    session, rng = Session(mapping), np.random.default_rng(1)
    session.receive(heartbeat(), START)
    packet = np.frombuffer(heartbeat(), np.uint8)
    tracemalloc.start()
    sizes = []
    for k in range(200):
        data = rng.integers(0, 256, 2000, np.uint8)
        if sort == "nearly":
            data = np.tile(packet, 90)
            data[rng.integers(0, len(data), 400)] ^= 0xFF
        assert not session.receive(data.tobytes(), START + k * SECOND)
        session.tick(START + k * SECOND)
        if k >= 50 and k % 50 == 0:
            sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert sizes[-1] - sizes[0] < 200_000
    assert session.decoder.waiting < 600 and session.decoder.bad > 1000
    # and then the flight goes on; what waits of a broken packet may take some messages with it
    outputs = bridged(first(events, 10.0, IMU_ALONE), MavlinkSimulator(mapping), replace_clock(session))
    assert len([o for o in outputs if o.topic == "imu/data"]) > 700


def replace_clock(session):
    """The session when the flight's time begins: only the schedule of what it sends goes back with the clock."""
    session._next_heartbeat = session._next_sync = 0
    session._last_message = START
    session._silent = False
    session.requests.start(0)
    return session


@pytest.mark.long
def test_the_faults_are_what_they_are_called(mapping, events):
    """The MAVLink simulator's own clock: the drift and offset that tests rely on."""
    simulator = MavlinkSimulator(mapping, replace(Faults(), clock_offset=10.0, drift=1e-3))
    assert simulator.boot(0.0) == pytest.approx(10.01e9) and simulator.boot(100.0) == pytest.approx(110.11e9)
    simulator.reboot(50.0)
    assert simulator.boot(50.0) == 0


# -- who is heard -------------------------------------------------------------------------------------------

KEY = bytes(range(32))


def signed(key, system=1, ahead=0):
    """A vehicle that signs, its clock so many seconds ahead."""
    decoder = Decoder(key)
    decoder.system = decoder.component = system
    decoder._codec.signing.timestamp += ahead * 100_000
    return decoder


def attitude(decoder, milliseconds=1000):
    return decoder.encode(dialect.MAVLink_attitude_message(milliseconds, 0, 0, 0, 0, 0, 0))


def alive(decoder):
    message = dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_FIXED_WING, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4, 3
    )
    return decoder.encode(message)


def test_with_a_key_only_what_is_signed_with_it_is_heard():
    session = Session(key=KEY)
    session.receive(heartbeat(1), START)
    session.receive(alive(signed(bytes(32))), START)
    assert session.vehicle is None and session.summary()["not_signed"] == 2
    vehicle = signed(KEY)
    session.receive(alive(vehicle), START)
    assert session.vehicle is not None
    once = attitude(vehicle)
    for data in (once, once, once):  # heard, and sent again by somebody who listened
        session.receive(data, START)
    changed = bytearray(attitude(vehicle, 2000))
    changed[12] ^= 1
    session.receive(bytes(changed), START)
    forger = signed(bytes(32), ahead=10**6)  # a stamp of the far future shuts nobody out
    session.receive(attitude(forger), START)
    session.receive(attitude(vehicle, 3000), START)
    assert session.received["ATTITUDE"] == 2
    unknown = bytearray(once)
    unknown[7:10] = b"\xff\xff\x7f"  # a message that nobody knows cannot be checked
    session.receive(bytes(unknown), START)
    assert sum(session.received.values()) == 3


def test_what_we_send_is_signed():
    session = Session(key=KEY)
    session.receive(alive(signed(KEY)), START)
    data = session.tick(START)
    assert {m.get_type() for m in signed(KEY, 7).decode(data)} >= {"HEARTBEAT", "TIMESYNC", "COMMAND_LONG"}
    assert not list(signed(bytes(32)).decode(data))


@pytest.mark.long
def test_a_signed_flight_is_that_of_an_unsigned_one(events, mapping):
    flown = first(events, 6.0, IMU_ALONE)
    stamps = []
    for key in (None, KEY):
        simulator = MavlinkSimulator(mapping)
        simulator._decoder = Decoder(key)
        simulator._decoder.system = simulator._decoder.component = 1
        wire = Link(least=0.002, jitter=0.0)  # stamps must rise: a signed packet that was overtaken is lost
        outputs = bridged(flown, simulator, Session(mapping, key=key), wire)
        stamps.append([int(o.stamp[0]) for o in outputs if o.topic == "imu/data"])
    assert stamps[0] == stamps[1] and len(stamps[0]) > 300


@pytest.mark.parametrize(
    ("content", "mode", "key"),
    [
        (KEY.hex(), 0o600, KEY),
        (KEY.hex().upper() + "\n", 0o400, KEY),
        ("correct horse", 0o600, hashlib.sha256(b"correct horse").digest()),
        ("", 0o600, "must be one line"),
        ("x" * 2000, 0o600, "must be one line"),
        (KEY.hex(), 0o644, "others can read the signing key .*: chmod 600"),
        (None, 0o600, "cannot read the signing key .*: No such file"),
    ],
)
def test_the_key_is_read_from_a_file_that_nobody_else_reads(tmp_path, content, mode, key):
    path = tmp_path / "key"
    if content is not None:
        path.write_text(content)
        path.chmod(mode)
    if isinstance(key, bytes):
        assert load_key(path) == key
        return
    with pytest.raises(InputError, match=key):
        load_key(path)


def test_numbers_that_are_none_are_left_out_and_counted(events, mapping):
    session, simulator = Session(mapping), MavlinkSimulator(mapping)
    bridged(first(events, 5.0, IMU_ALONE), simulator, session)
    vehicle, now = Decoder(), START + 6 * SECOND
    vehicle.system, vehicle.component = session.vehicle.system, session.vehicle.component
    newest = session.boot_time._newest
    for wrong in (np.nan, np.inf, -np.inf):
        numbers = [0.0] * 13
        numbers[4] = wrong  # a rate
        imu = dialect.MAVLink_highres_imu_message(newest // 1000, *numbers, 0xFFFF)
        pressure = dialect.MAVLink_scaled_pressure_message(newest // 1_000_000, wrong, 0.0, 2000)
        speed = dialect.MAVLink_vfr_hud_message(wrong, 0.0, 0, 0, 0.0, wrong)
        for message in (imu, pressure, speed):
            before = session.not_finite
            assert session.receive(vehicle.encode(message), now) == []
            assert session.not_finite == before + 1, (message.get_type(), wrong)
    assert session.summary()["not_finite"] == session.not_finite >= 9
