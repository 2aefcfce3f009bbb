"""A stop uses all that has come, however slow the machine is; what is lost is told, and where none may be, fails.

Processes are slowed to a fifth of their time, so that they are far behind when the signal comes.
"""

import contextlib
import itertools
import json
import signal
import subprocess
import sys
import time

import pytest
from aircraft_sysid_msgs.msg import AircraftState, Parameters
from diagnostic_msgs.msg import DiagnosticArray
from processes import live, ours, play, slowed
from rclpy.qos import HistoryPolicy, QoSProfile
from waiting import LONGEST, finish

from aircraft_sysid_ros.nodes.common import message_class
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.ros_messages.conversion import nanoseconds_of
from aircraft_sysid_ros.samples import Kind

LONG = 4.0  # [s] horizon


@pytest.fixture(scope="module")
def short(aircraft, tmp_path_factory):
    """A simulated flight of 20 s as a bag."""
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
    from aircraft_sysid_ros.simulation.truth_files import write_flight

    path = tmp_path_factory.mktemp("short") / "flight"
    write_flight(simulate_samples(aircraft, seed=4, duration=20.0), path)
    return path


@pytest.fixture
def run(tmp_path):
    """Name of a run that is not there yet."""
    return tmp_path / "live" / "run"


@pytest.fixture(autouse=True)
def folder(run, domain):
    run.parent.mkdir()


def publish_with_losses(node, recording, process, pause=0.0, depth=500):
    """Publish a recording, with ``process`` standing still for more messages than are kept for it.

    Publishers wait for those that listen reliably; for others they ``pause`` [s] after each message while it runs.
    """
    raw = read_raw(recording)
    publishers = {
        key: node.create_publisher(message_class(channel.type), channel.topic, QoSProfile(depth=depth))
        for key, channel in raw.channels.items()
    }
    deadline = time.monotonic() + LONGEST
    while not all(p.get_subscription_count() for p in publishers.values()):
        assert time.monotonic() < deadline, "live does not listen"
        time.sleep(0.02)
    sent = dict.fromkeys((channel.topic for channel in raw.channels.values()), 0)
    parts = ((None, 0.25), (signal.SIGSTOP, 0.8), (signal.SIGCONT, 1.0))
    begin = 0
    for number, share in parts:
        if number is not None:
            process.send_signal(number)
        end = round(share * len(raw))
        for i in range(begin, end):
            key = int(raw.channel[i])
            publishers[key].publish(raw[i])
            sent[raw.channels[key].topic] += 1
            if pause and number != signal.SIGSTOP:
                time.sleep(pause)
        begin = end
        for publisher in publishers.values() if number != signal.SIGSTOP else ():
            publisher.wait_for_all_acked()
    return sent


def received(result):
    return {"/" + topic: count for topic, count in result["received"].items() if count}


def check_full(result, sent, run):
    assert received(result) == sent["messages"]
    assert result["lost"] == {}
    assert result["states"][0] == result["states"][1] > 0  # where it starts depends on what came late
    assert result["state"]["duration"] == pytest.approx(sent["duration"], abs=0.02)
    assert json.loads((run / "state.json").read_text())["duration"] == result["state"]["duration"]


def test_a_process_that_is_far_behind_writes_the_run_in_full(short, aircraft_file, run):
    with live(run, aircraft_file, "--reliable", "--horizon", LONG) as process, slowed(process):
        sent = play(short, 16)
        process.send_signal(signal.SIGINT)
        output, errors = finish(process)
    assert process.returncode == 0, errors
    check_full(json.loads(output), sent, run)


@pytest.mark.long
def test_further_signals_tear_nothing_apart_and_are_told_what_is_left(short, aircraft_file, run):
    with live(run, aircraft_file, "--reliable", "--horizon", LONG) as process:
        with slowed(process):
            sent = play(short, 16)
            for number in itertools.cycle((signal.SIGTERM, signal.SIGINT)):
                if process.poll() is not None:
                    break
                process.send_signal(number)
                time.sleep(0.05)  # between two of them; nothing depends on it
        output, errors = finish(process)
    assert process.returncode == 0, errors
    assert "messages that have come are used first" in errors
    assert "Traceback" not in errors
    check_full(json.loads(output), sent, run)


@pytest.mark.long
def test_best_effort_says_how_much_was_lost(short, aircraft_file, run, helper):
    with live(run, aircraft_file, "--horizon", LONG) as process:
        sent = publish_with_losses(helper[0], short, process, pause=0.001)
        process.send_signal(signal.SIGINT)
        output, errors = finish(process)
    assert process.returncode == 0, errors
    result = json.loads(output)
    imu, lost = result["received"]["imu/data"], result["lost"]["imu/data"]
    assert lost > 500, "half of the recording came while the process stood still, and its queue holds 100"
    assert imu + lost <= sent["/imu/data"]  # what was lost after the last that came, no number shows
    assert any(f"{lost} of imu/data" in note for note in result["notes"])


@pytest.mark.long
def test_samples_that_are_lost_where_none_may_be_are_a_failure(short, aircraft_file, run, helper):
    with live(run, aircraft_file, "--reliable") as process:
        sent = publish_with_losses(helper[0], short, process)
        process.send_signal(signal.SIGINT)
        output, errors = finish(process)
    result = json.loads(output)
    lost = result["lost"]["imu/data"]
    assert lost > 0
    assert received(result)["/imu/data"] + lost == sent["/imu/data"]
    assert process.returncode == 1
    assert f"{lost} of imu/data" in errors and "Traceback" not in errors
    assert (run / "parameters.json").exists()


# -- the executables, as `ros2 launch` starts them -----------------------------------------------------------------


@contextlib.contextmanager
def estimators(aircraft_file):
    """Both executables, which hear every sample."""
    options = {"aircraft_file": aircraft_file, "input_reliability": "reliable"}
    arguments = ["--ros-args", *(a for key, value in options.items() for a in ("-p", f"{key}:={value}"))]
    names = ("state_estimator", "parameter_estimator")
    made = [subprocess.Popen(ours(f"nodes.{name}", *arguments), stderr=subprocess.PIPE, text=True) for name in names]
    try:
        yield made
    finally:
        for process in made:
            process.kill()
            process.communicate()


class Listener:
    """Hears all that both nodes publish."""

    def __init__(self, node, executor):
        self.states, self.sets, self.values, self.executor = [], [], {}, executor
        everything = QoSProfile(history=HistoryPolicy.KEEP_ALL)
        node.create_subscription(AircraftState, "/state_estimator/state", self.states.append, everything)
        node.create_subscription(Parameters, "/parameter_estimator/parameters", self.sets.append, everything)
        node.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, 100)

    def on_diagnostics(self, message):
        for status in message.status:
            self.values[status.name] = {item.key: item.value for item in status.values}

    def spin_until(self, done):
        deadline = time.monotonic() + LONGEST
        while not done():
            assert time.monotonic() < deadline, f"nothing came in time: {self.values}"
            self.executor.spin_once(timeout_sec=0.1)


@pytest.fixture
def listener(helper):
    """A listener that hears the nodes."""
    return Listener(*helper)


def is_newest(found, stamp, within=0):
    """Whether the newest message has a stamp [ns], or is older by no more than ``within`` [ns]."""
    return bool(found) and stamp - within <= nanoseconds_of(found[-1]) <= stamp


def last_imu(recording):
    samples = read_recording(recording).samples
    return int(samples.stamp[samples.kind == Kind.IMU].max())


@pytest.mark.long
def test_each_node_uses_and_publishes_all_that_has_come(short, aircraft_file, listener):
    """Ended by one signal or by the other."""
    last = last_imu(short)
    with estimators(aircraft_file) as (state, parameters):
        listener.spin_until(lambda: listener.values.get("state_estimator", {}).get("state_listeners") == "2")
        with slowed(state), slowed(parameters):
            sent = play(short, 4)
            for process, number in ((state, signal.SIGTERM), (parameters, signal.SIGINT)):
                process.send_signal(number)
                _, errors = finish(process)
                assert process.returncode == 0, errors
                assert "Traceback" not in errors
    listener.spin_until(lambda: is_newest(listener.states, last))
    assert sent["messages"]["/imu/data"] - 300 < len(listener.states) <= sent["messages"]["/imu/data"]
    listener.spin_until(lambda: is_newest(listener.sets, last, 200_000_000))


@pytest.mark.long
def test_ctrl_c_in_a_terminal_ends_both_at_once(short, aircraft_file, listener):
    """As every process of a terminal gets it, and as a launch system that passes it on gives it twice."""
    last = last_imu(short)
    with estimators(aircraft_file) as made:
        listener.spin_until(lambda: listener.values.get("state_estimator", {}).get("state_listeners") == "2")
        play(short, 8)
        for process in 2 * made:
            process.send_signal(signal.SIGINT)
        for process in made:
            _, errors = finish(process)
            assert process.returncode == 0, errors
            assert "Traceback" not in errors
    listener.spin_until(lambda: is_newest(listener.states, last))
    assert listener.sets


@pytest.mark.long
def test_play_says_who_keeps_it_waiting_and_goes_on_when_it_can(short, aircraft_file, run, helper):
    node, executor = helper
    heard = []
    node.create_subscription(message_class("sensor_msgs/msg/Imu"), "/imu/data", heard.append, 10)
    code = "from aircraft_sysid_ros.commands import main, play; play.LONG_WAIT = 0.2; main.main()"
    command = [sys.executable, "-c", code, "play", str(short), "--rate", "3", "--wait", "60", "--json"]
    with (
        live(run, aircraft_file, "--reliable") as process,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as player,
    ):
        while not heard:
            executor.spin_once(timeout_sec=0.1)
        process.send_signal(signal.SIGSTOP)
        said = player.stderr.readline()
        process.send_signal(signal.SIGCONT)
        sent, errors = finish(player)
        assert "waiting for " in said and " of /" in said and "took nothing for 0.2 s; Ctrl-C ends" in said
        assert player.returncode == 0, errors
        process.send_signal(signal.SIGINT)
        output, errors = finish(process)
    assert received(json.loads(output)) == json.loads(sent)["messages"], errors
