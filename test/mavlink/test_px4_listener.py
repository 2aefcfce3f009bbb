"""PX4's topics live, without ROS: numbers as PX4 means them, as `import` has them, and stamps of either clock."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from px4_agent import SERVOS, px4_messages

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.px4_listener import Px4Listener, named, wanted_fields
from aircraft_sysid_ros.mavlink.px4_table import PX4, sample_time
from aircraft_sysid_ros.mavlink.servo_mapping import servo_mapping_from_dict
from aircraft_sysid_ros.ros_messages.conversion import TOPICS, USED_FIELDS, to_samples
from aircraft_sysid_ros.samples import Kind, concatenate
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

MAPPING = servo_mapping_from_dict(yaml.safe_load(SERVOS))


@pytest.fixture(scope="module")
def samples(aircraft):
    whole = simulate_samples(aircraft, seed=3, duration=20.0).samples
    return whole[whole.stamp < whole.stamp.min() + 8_000_000_000]


def heard(listener, messages, delay=0):
    """Outputs of messages that arrive so long [ns] after they were sent."""
    outputs = []
    for stamp, topic, _, fields in messages:
        listener._now = lambda stamp=stamp: stamp + delay
        wanted = wanted_fields(named(topic)[0])
        given = {name: np.array([value]) for name, value in fields.items() if name in wanted}
        outputs += listener.receive(named(topic)[0], given)
    return outputs


def as_samples(outputs):
    return concatenate([s for o in outputs if o.topic in TOPICS for s in to_samples(o.topic, o.stamp, whole(o))])


def whole(output):
    """Fields with NaN for what is not measured, as the node publishes them."""
    used = USED_FIELDS[output.topic] if output.topic == "control_surfaces" else output.fields
    return {name: output.fields.get(name, np.full(len(output.stamp), np.nan)) for name in used}


@pytest.mark.long
def test_what_was_flown_comes_back(samples):
    listener = Px4Listener(MAPPING)
    found = as_samples(heard(listener, px4_messages(samples)))
    for kind, columns, tolerance in (
        (Kind.IMU, slice(0, 6), 1e-6), (Kind.GPS_POSITION, slice(0, 3), 1e-9), (Kind.GPS_VELOCITY, slice(0, 3), 1e-6),
        (Kind.AIRSPEED, slice(0, 1), 3e-4), (Kind.CONTROLS, slice(0, 3), 1e-6), (Kind.CONTROLS, slice(4, 5), 1e-6),
    ):  # fmt: skip
        sent, came = samples.kind == kind, found.kind == kind
        late = came.sum() - sent.sum()
        assert -2 <= late <= 0, kind  # an airspeed before the first pressure, or a servo before its motor
        stamps = samples.stamp[sent][-late or None :]
        assert np.array_equal(found.stamp[came], stamps // 1000 * 1000), kind
        np.testing.assert_allclose(
            found.values[came, columns], samples.values[sent, columns][-late or None :], rtol=tolerance, atol=tolerance
        )
    assert listener.condition == "" and listener.summary()["clock"] == "of this computer"


@pytest.mark.long
def test_stamps_since_the_start_are_late_by_the_least_delay(samples):
    listener = Px4Listener(MAPPING)
    outputs = heard(listener, px4_messages(samples, start=7_000_000), delay=2_000_000)
    stamps = np.concatenate([output.stamp for output in outputs if output.topic == "imu/data"])
    sent = samples.stamp[samples.kind == Kind.IMU][-len(stamps) :]
    assert np.abs(stamps - sent - 2_000_000).max() < 200_000  # [ns]
    assert 0 < listener.unstamped < 0.3 * len(samples.stamp)
    assert "least delay" in listener.summary()["clock"]
    heard(listener, px4_messages(samples, start=1_000_000)[:400], delay=2_000_000)
    assert listener.restarts == 1 and "has restarted" in " ".join(listener.take_notes())


@pytest.mark.long
def test_a_restart_of_a_synchronised_autopilot_is_said(samples):
    """It begins with stamps since its start, until clocks are synchronised again; one such message is no restart."""
    listener = Px4Listener(MAPPING)
    later = np.flatnonzero(samples.stamp > samples.stamp.min() + 4_000_000_000)[0]
    flown, restarted = samples[:later], samples[later:]
    heard(listener, px4_messages(flown)[:500])
    assert listener.restarts == 0
    heard(listener, [message for message in px4_messages(flown, start=9_000_000)[500:501]])
    heard(listener, px4_messages(flown)[501:])
    assert listener.restarts == 0 and listener.summary()["clock"] == "of this computer"
    listener.take_notes()
    outputs = heard(listener, px4_messages(restarted, start=1_000_000), delay=1_000_000)
    assert listener.restarts == 1 and listener.take_notes() == ["the autopilot has restarted"]
    assert "least delay" in listener.summary()["clock"]
    stamps = np.concatenate([output.stamp for output in outputs if output.topic == "imu/data"])
    assert len(stamps) > 50 and np.all(stamps > flown.stamp.max()) and np.all(stamps <= samples.stamp.max() + 2_000_000)
    heard(listener, px4_messages(restarted)[-5:])
    assert listener.restarts == 1 and listener.summary()["clock"] == "of this computer"


SECOND = 1_000_000_000


class Imu:
    """A listener that hears an IMU at 100 Hz, stamped since the start of the autopilot."""

    def __init__(self, mapping=None):
        self.listener, self.now = Px4Listener(mapping, clock=lambda: self.now), 1_760_000_000 * SECOND

    def hear(self, up, seconds):
        """Messages of an autopilot that is up for so long [s]; by how much [s] stamps are off, of those that came."""
        off = []
        for k in range(round(seconds * 100)):
            self.now += SECOND // 100
            off += self.hear_one(up + k / 100)
        return np.array(off)

    def hear_one(self, up):
        fields = {"accelerometer_m_s2": np.zeros((1, 3)), "gyro_rad": np.zeros((1, 3))}
        outputs = self.listener.receive("sensor_combined", {"timestamp": np.array([round(1e6 * up)]), **fields})
        return [(int(output.stamp[0]) - self.now) / SECOND for output in outputs]


def test_one_late_message_is_no_restart():
    """It made the clock be learnt anew, and seconds of all sensors were lost."""
    imu = Imu()
    imu.hear(100.0, 5.0)
    assert imu.hear_one(102.0) == []
    assert len(imu.hear(105.0, 2.0)) == 200 and imu.listener.restarts == 0
    assert imu.hear(1.0, 0.4).size == 0
    assert imu.listener.restarts == 0
    assert np.abs(imu.hear(1.4, 5.0)).max() < 0.02
    assert imu.listener.restarts == 1 and imu.listener.take_notes() == ["the autopilot has restarted"]


def test_a_restart_in_a_long_silence_is_followed():
    """It is up for longer than before, so that no time goes back: stamps were minutes behind for the rest."""
    imu = Imu()
    imu.hear(10.0, 10.0)
    imu.now += 600 * SECOND
    found = imu.hear(100.0, 10.0)
    assert len(found) > 700 and np.abs(found).max() < 0.02


@pytest.mark.parametrize("by", [-3600, 3600])
def test_the_clock_of_the_computer_may_be_set(by):
    """Without synchronised clocks stamps stayed in the old time."""
    imu = Imu()
    imu.hear(10.0, 10.0)
    imu.now += by * SECOND
    found = imu.hear(20.0, 10.0)
    assert len(found) > 700 and np.abs(found).max() < 0.02 and imu.listener.restarts == 0


def test_the_attitude_is_fed_on_after_the_clock_was_set_back():
    """Of synchronised clocks: it was left out until the old time came again."""
    listener = Px4Listener(replace(MAPPING, attitude_std=0.05))
    fed = []
    for begin in (1_760_000_000, 1_760_000_000 - 3600):
        for k in range(100):
            time = {"timestamp": np.array([1_000_000 * begin + 10_000 * k])}
            listener.receive("vehicle_attitude", {**time, "q": np.array([[1.0, 0.0, 0.0, 0.0]])})
            imu = {"accelerometer_m_s2": np.zeros((1, 3)), "gyro_rad": np.zeros((1, 3))}
            (output,) = listener.receive("sensor_combined", time | imu)
            fed.append(output.fields["orientation_covariance"][0, 0] > 0.0)
    assert all(fed)


def airspeed(source, name="airspeed_source"):
    fields = {"calibrated_airspeed_m_s": np.array([20.0]), name: np.array([source], np.int8)}
    return PX4["airspeed_validated"][0].values(fields)[0, 0]


@pytest.mark.parametrize("name", ["airspeed_source", "selected_airspeed_index"])
@pytest.mark.parametrize(("source", "counts"), [(-1, False), (0, False), (1, True), (3, True), (4, False)])
def test_an_airspeed_that_no_sensor_measured_is_none(source, counts, name):
    """Up to 1.15 PX4 has another name for what it is of, and ground speed less wind came as an airspeed."""
    assert name in wanted_fields("airspeed_validated") and np.isfinite(airspeed(source, name)) == counts


def test_an_accelerometer_that_px4_calls_invalid_is_none():
    fields = {"accelerometer_m_s2": np.ones((2, 3)), "gyro_rad": np.ones((2, 3))}
    fields["accelerometer_timestamp_relative"] = np.array([0, 2**31 - 1])
    values = PX4["sensor_combined"][0].values(fields)
    assert np.isfinite(values).sum(axis=1).tolist() == [6, 3]


@pytest.mark.parametrize(
    ("published", "taken", "expected"), [(5_000_000, 4_999_000, 4_999_000), (5_000_000, 0, 5_000_000), (5, 9, 5)]
)
def test_a_time_of_the_sample_counts_where_it_is_filled_in(published, taken, expected):
    fields = {"timestamp": np.array([published], np.uint64), "timestamp_sample": np.array([taken], np.uint64)}
    assert sample_time(fields) == expected * 1000


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        ("/fmu/out/sensor_combined", ("sensor_combined", 0)),
        ("/px4_1/fmu/out/airspeed_validated_v1", ("airspeed_validated", 1)),
        ("vehicle_attitude_v12", ("vehicle_attitude", 12)),
    ],
)
def test_versions_stand_at_the_end_of_a_topic(topic, expected):
    assert named(topic) == expected


IN_PULSES = servo_mapping_from_dict({"outputs": {1: {"surface": "elevator", "us": [1000, 2000], "deg": [-25, 25]}}})


@pytest.mark.parametrize(
    ("mapping", "outputs", "said"),
    [
        (MAPPING, (), "no actuator_servos has come"),  # as PX4 is set by default
        (IN_PULSES, (), "no actuator_outputs has come"),
        (IN_PULSES, ("actuator_servos",), "give command in place of us"),
        (MAPPING, ("actuator_outputs",), "give us in place of command"),
        (IN_PULSES, ("actuator_servos", "actuator_outputs"), ""),
        (MAPPING, ("actuator_servos",), ""),
        (None, (), ""),  # nobody asked for the controls
    ],
)
def test_control_surfaces_that_do_not_come_are_said(mapping, outputs, said):
    """Diagnostics were ok throughout a flight from which nothing could be learnt of the controls."""
    imu = Imu(mapping)
    fields = {
        "actuator_servos": {"control": np.zeros((1, 8))},
        "actuator_outputs": {"output": np.full((1, 16), 1500.0), "noutputs": np.array([8])},
    }
    imu.hear(10.0, 2.0)
    assert imu.listener.condition == ""  # what has just begun may still come
    for k in range(8):
        imu.hear(12.0 + k, 1.0)
        for name in outputs:
            imu.listener.receive(name, {"timestamp": np.array([(13 + k) * 10**6]), **fields[name]})
    assert said in imu.listener.condition and bool(said) == bool(imu.listener.condition)


def test_nothing_heard_is_said():
    listener = Px4Listener()
    assert "no topic of PX4 has come" in listener.condition
    listener.receive("vehicle_air_data", {"timestamp": np.array([10**15]), "baro_pressure_pa": np.array([1e5])})
    assert "sensor_combined" in listener.condition


@pytest.mark.parametrize(
    ("outputs", "text"),
    [
        ({101: {"surface": "throttle", "us": [1000, 2000], "fraction": [0, 1]}}, "as command, not as us"),
        ({40: {"surface": "throttle", "command": [0, 1], "fraction": [0, 1]}}, "the motors of PX4 101 to 112"),
    ],
)
def test_motors_have_px4_s_numbers_and_are_commands(outputs, text):
    with pytest.raises(InputError, match=text):
        servo_mapping_from_dict({"outputs": outputs})
