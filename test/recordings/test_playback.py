"""Pacing of a playback with a clock of its own, and one playback over real ROS 2."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.playback import LONGEST_LAG, Schedule, every
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS, imu_fields

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


class Clock:
    """Time that passes only in sleep, a little longer than asked for as real ones are."""

    def __init__(self, oversleep=0.0):
        self.now, self.oversleep = 100.0, oversleep

    def __call__(self):
        return self.now

    def sleep(self, duration):
        assert duration > 0.0
        self.now += duration + self.oversleep


def scheduled(rate, clock):
    return Schedule(rate, clock, clock.sleep)


@pytest.mark.parametrize("rate", [0.5, 1.0, 20.0])
def test_messages_go_out_on_time_without_drift(rate):
    clock = Clock(oversleep=1e-3)
    schedule = scheduled(rate, clock)
    for i in range(10_000):
        schedule.wait(START + i * SECOND // 10)
        late = clock.now - (100.0 + i / (10 * rate))
        assert -1e-6 <= late <= 1e-3 + 1e-6
    assert schedule.delay == 0.0


def test_messages_of_one_time_are_not_waited_for_twice():
    clock = Clock()
    schedule = scheduled(1.0, clock)
    for log_time in (START, START + SECOND, START + SECOND, START + SECOND):
        schedule.wait(log_time)
    assert clock.now == pytest.approx(101.0)


def test_a_short_stall_is_caught_up():
    clock = Clock()
    schedule = scheduled(1.0, clock)
    schedule.wait(START)
    clock.now += 1.0 + 0.5 * LONGEST_LAG
    schedule.wait(START + SECOND)
    schedule.wait(START + 2 * SECOND)
    assert clock.now == pytest.approx(102.0)


def test_a_long_stall_shifts_the_rest_instead_of_a_burst():
    clock = Clock()
    schedule = scheduled(1.0, clock)
    schedule.wait(START)
    clock.now += 11.0  # the machine slept
    times = []
    for i in range(1, 4):
        schedule.wait(START + i * SECOND)
        times.append(clock.now)
    np.testing.assert_allclose(np.diff(times), 1.0)
    assert schedule.delay == pytest.approx(10.0)


def test_a_clock_that_was_set_is_not_waited_for():
    """A board without a clock of its own began in 1970 until it heard the time: a playback slept for decades."""
    clock = Clock()
    schedule = scheduled(2.0, clock)
    for log_time in (0, SECOND, START, START + SECOND, START + 101 * SECOND):
        schedule.wait(log_time)
    assert clock.now == pytest.approx(100.0 + (1.0 + 1.0 + 100.0) / 2.0)


def test_rate_zero_never_waits():
    clock = Clock()
    schedule = scheduled(0.0, clock)
    for i in range(5):
        schedule.wait(START + i * SECOND)
    assert clock.now == 100.0


def test_every_is_true_once_per_interval():
    clock = Clock()
    show = every(1.0, clock)
    seen = [next(show)]  # starts it
    for _ in range(40):
        clock.now += 0.25
        seen.append(next(show))
    assert sum(seen) == 10


@pytest.fixture
def flight(tmp_path):
    n = 200
    stamp = START + np.arange(n) * SECOND // 100
    with RecordingWriter(tmp_path / "flight") as writer:
        force = np.arange(n)[:, None] * np.array([1.0, 0.0, 0.0])
        writer.write("imu/data", TOPICS["imu/data"], stamp, imu_fields(force, force), frame_id="base_link")
        writer.write("air_data", TOPICS["air_data"], stamp[::10], {"true_airspeed": np.arange(20.0)})
    return tmp_path / "flight"


def play(*arguments):
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "play", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture
def ros(domain):
    """A context of its own in a domain that nobody else uses."""
    rclpy = pytest.importorskip("rclpy")
    pytest.importorskip("aircraft_sysid_msgs.msg")
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(domain))
    node = rclpy.create_node("listener", context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, executor
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.mark.long
@pytest.mark.parametrize("reliability", ["reliable", "best_effort"])
def test_a_subscriber_gets_every_message_with_its_stamp_in_order(ros, flight, reliability):
    from aircraft_sysid_msgs.msg import AirData
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import Imu

    node, executor = ros
    quality = QoSProfile(depth=1000, reliability=ReliabilityPolicy[reliability.upper()])
    imu, air, clocks = [], [], []
    node.create_subscription(Clock, "/clock", clocks.append, 1000)
    node.create_subscription(Imu, "/uav1/imu/data", imu.append, quality)
    node.create_subscription(AirData, "/uav1/air_data", air.append, quality)
    arguments = [flight, "--rate", 2, "--topic-prefix", "uav1", "--json", "--wait", 60, "--clock", 20]
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "play", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 300.0
        while (len(imu) < 200 or len(air) < 20) and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        output, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    result = json.loads(output)
    assert result["messages"] == {"/uav1/imu/data": 200, "/uav1/air_data": 20}
    assert result["subscribers"] == {"/uav1/imu/data": 1, "/uav1/air_data": 1}
    assert result["elapsed"] > 0.9
    assert [m.linear_acceleration.x for m in imu] == list(range(200))
    assert [m.true_airspeed for m in air] == list(range(20))
    assert imu[0].header.frame_id == "base_link"
    stamps = [m.header.stamp.sec * SECOND + m.header.stamp.nanosec for m in imu]
    assert stamps == [START + i * SECOND // 100 for i in range(200)]
    times = np.array([m.clock.sec * SECOND + m.clock.nanosec for m in clocks])  # at twice the speed: each 0.1 s
    assert len(times) == 20 and np.array_equal(times, START + np.arange(20) * SECOND // 10)


@pytest.mark.long
@pytest.mark.parametrize("options", [(), ("--best-effort",)])
def test_a_mass_is_heard_by_who_comes_later(ros, flight, tmp_path, options):
    """Played before a node was started, a weighing was lost, and ROS warned of a subscription that does not fit."""
    from aircraft_sysid_msgs.msg import AirData, MassProperties
    from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data

    with RecordingWriter(tmp_path / "weighed") as writer:
        writer.write("mass_properties", TOPICS["mass_properties"], [START], {"mass": 2.5})
        writer.write("air_data", TOPICS["air_data"], START + np.arange(3000) * SECOND // 100, {"true_airspeed": 15.0})
    node, executor = ros
    air, masses = [], []
    node.create_subscription(AirData, "air_data", air.append, qos_profile_sensor_data)
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "play", str(tmp_path / "weighed"), *options]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 100.0
        while not air and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(MassProperties, "mass_properties", masses.append, latched)
        while not masses and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        process.send_signal(signal.SIGINT)
        errors = process.communicate(timeout=100)[1]
    assert [m.mass for m in masses] == [2.5]
    assert "incompatible" not in errors


@pytest.mark.long
def test_without_subscribers_it_plays_after_the_wait(domain, flight):
    pytest.importorskip("rclpy")
    result = play(flight, "--rate", 0, "--wait", 0.2, "--json", "--best-effort", "--topics", "air_data")
    assert result.returncode == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["messages"] == {"/air_data": 20}
    assert document["subscribers"] == {"/air_data": 0}


@pytest.mark.long
@pytest.mark.long_after_the_first
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("nowhere",), "no recording"),
        (("FLIGHT", "--rate", "-1"), "--rate"),
        (("FLIGHT", "--rate", "nan"), "--rate"),
        (("FLIGHT", "--topics", "gps/fix"), "/gps/fix"),
        (("FLIGHT", "--clock", "0"), "--clock"),
        (("FLIGHT", "--topic-prefix", "a b"), "topic name"),
    ],
)
def test_bad_input_is_one_line_and_status_2(domain, flight, arguments, text):
    pytest.importorskip("rclpy")
    result = play(*(flight if a == "FLIGHT" else a for a in arguments))
    assert result.returncode == 2
    assert result.stdout == ""
    assert len(result.stderr.strip().splitlines()) == 1
    assert text in result.stderr


@pytest.mark.long
def test_the_module_itself_needs_no_ros():
    code = "import sys, aircraft_sysid_ros.commands.play; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_bad_rate_is_refused_before_anything_else(flight):
    import argparse

    from aircraft_sysid_ros.commands.play import run

    with pytest.raises(InputError, match="--rate"):
        run(argparse.Namespace(recording="nowhere", rate=-1.0, wait=0.0))


@pytest.mark.parametrize(
    ("found", "begins"),
    [
        ((0.2, 0.5), 3.2),
        ((0.1, 2.6), 3.2),  # the middleware had lost something, and sends it again
        ((0.1, 3.1), 3.6),
        ((4.0, 6.5), 9.7),  # started after the playback, one a moment after the other
    ],
)
def test_a_second_node_that_hears_a_topic_is_waited_for(monkeypatch, found, begins):
    """Both estimators hear the controls: the one that is found later had missed the beginning of a fast playback."""
    from aircraft_sysid_ros.commands import play

    now = 0.0

    class Publisher:
        """Of a topic that two nodes hear, which are found one after the other."""

        def get_subscription_count(self):
            return sum(now > each for each in found)

    def sleep(seconds):
        nonlocal now
        now += seconds

    monkeypatch.setattr(play.time, "perf_counter", lambda: now)
    monkeypatch.setattr(play.time, "sleep", sleep)
    play._wait_for_subscribers({0: Publisher()}, 60.0, created=0.0)
    assert now == pytest.approx(begins, abs=0.05)


def test_who_comes_after_the_beginning_is_told_of():
    from aircraft_sysid_ros.commands import play

    class Publisher:
        """Of a topic with so many subscribers."""

        topic_name, count = "/air_data", 1

        def get_subscription_count(self):
            return self.count

    late = play._Latecomers([publisher := Publisher()])
    late.look(1.0)
    assert late.notes == []
    for count, played in ((2, 1.6), (1, 3.0), (1, 4.0)):  # one more; gone again
        publisher.count = count
        late.look(played)
    assert len(late.notes) == 1 and "/air_data" in late.notes[0] and "1.6 s" in late.notes[0]


HEARS = """
import rclpy
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

QUALITY = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
if __name__ == "__main__":
    rclpy.init()
    node = rclpy.create_node("hears")
    node.create_subscription(Imu, "soon", lambda message: None, QUALITY)
    rclpy.spin(node)
"""
SAYS = """
import time
import rclpy
from sensor_msgs.msg import Imu
from hears import QUALITY
from aircraft_sysid_ros.commands import play
from aircraft_sysid_ros.stamps import NANOSECONDS

rclpy.init()
with play._quick_heartbeats():
    publisher = rclpy.create_node("says").create_publisher(Imu, "soon", QUALITY)
while not publisher.get_subscription_count():
    time.sleep(0.01)
started, together = time.monotonic(), play._Together([publisher])
for second in range(5):
    together.wait(second * NANOSECONDS)
    publisher.publish(Imu())
print(time.monotonic() - started)
"""


@pytest.mark.long
def test_what_subscribers_have_is_known_soon(domain, tmp_path):
    """Each second of a recording waits for it, and by default the middleware asks every three seconds only."""
    pytest.importorskip("rclpy")
    for name, text in (("hears.py", HEARS), ("says.py", SAYS)):
        (tmp_path / name).write_text(text)
    hears = subprocess.Popen([sys.executable, tmp_path / "hears.py"])
    try:
        command = [sys.executable, tmp_path / "says.py"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    finally:
        hears.kill()
        hears.wait()
    assert float(done.stdout.splitlines()[-1]) < 5.0
