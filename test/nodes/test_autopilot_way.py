"""An autopilot's MAVLink to parameters: the three commands of docs/mavlink.md as processes, and Ctrl-C.

Nothing waits for a time: the processes say when they listen, the nodes when there are parameters.
"""

import contextlib
import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from aircraft_sysid_msgs.msg import Parameter, Parameters
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Imu, NavSatFix, NavSatStatus

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.mavlink.assembler import ALL_TOPICS
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.ros_conversion import FIX, NO_FIX, UNKNOWN_FIX

REPOSITORY = Path(__file__).resolve().parents[2]
BEFORE = "The whole way, one terminal each"  # the block of commands in docs/mavlink.md
ENOUGH = 10  # parameters with USE
MAIN = "aircraft_sysid_ros.commands.main"
PATIENCE = 300.0  # [s] for what has no other end; the first start compiles


def commands(folder, port):
    """Bridge, live and stand-in as the page has them, on a port and in folders of the test's own."""
    page = (REPOSITORY / "docs" / "mavlink.md").read_text(encoding="utf8")
    (block,) = re.findall(rf"{BEFORE}.*?```sh\n(.*?)```", page, re.DOTALL)
    words = [shlex.split(line.replace("14550", str(port))) for line in block.splitlines()]
    programs = {".venv/bin/python": [sys.executable], ".venv/bin/aircraft-sysid": [sys.executable, "-m", MAIN]}
    bridge, live, stand_in = ([*programs[first], *rest] for first, *rest in words)
    assert [bridge[3], live[3]] == ["bridge", "live"]
    return (
        [*bridge, "--ready-file", str(folder / "bridge_listens"), "--json"],
        [*(str(folder / "run") if word == "runs/today" else word for word in live),
         "--ready-file", str(folder / "live_listens"), "--json"],
        [*stand_in, "--connect", f"udpout:127.0.0.1:{port}"],
    )  # fmt: skip


@contextlib.contextmanager
def running(command, folder):
    """A process with its output in files."""
    name = command[3] if command[2] == MAIN else "stand_in"
    with (folder / f"{name}.out").open("w") as out, (folder / f"{name}.err").open("w") as errors:
        process = subprocess.Popen(command, cwd=REPOSITORY, stdout=out, stderr=errors)
    process.said = lambda: (folder / f"{name}.err").read_text() + (folder / f"{name}.out").read_text()
    process.result = lambda: json.loads((folder / f"{name}.out").read_text())
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def until(done, *processes, spin=None):
    """Spin until ``done()``; fails where a process ends before."""
    deadline = time.monotonic() + PATIENCE
    while not done():
        for process in processes:
            assert process.poll() is None, process.said()
        assert time.monotonic() < deadline, [process.said() for process in processes]
        spin() if spin else time.sleep(0.05)


def interrupted(process):
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE) == 0, process.said()
    assert "Traceback" not in process.said()
    return process.result()


@pytest.fixture
def port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def ear(domain):
    """Hears topics of the processes: a list of messages by topic, and what spins."""
    rclpy = pytest.importorskip("rclpy")
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(domain))
    node = rclpy.create_node("ear", context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, lambda: executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


def heard(node, kind, topic):
    messages = []
    node.create_subscription(kind, topic, messages.append, 100)
    return messages


def diagnosed(messages, name):
    """Newest values of a node's diagnostics."""
    for message in reversed(messages):
        for status in message.status:
            if status.name.endswith(name):
                return {item.key: item.value for item in status.values}
    return {}


def usable(parameters):
    return [p for p in parameters[-1].parameters if p.status == Parameter.USE] if parameters else []


def test_from_mavlink_to_parameters_by_the_commands_of_the_page(tmp_path, port, ear, aircraft_file):
    bridge_command, live_command, stand_in_command = commands(tmp_path, port)
    node, spin = ear
    parameters, fixes = heard(node, Parameters, "parameter_estimator/parameters"), heard(node, NavSatFix, "gps/fix")
    diagnostics = heard(node, DiagnosticArray, "/diagnostics")
    with running(bridge_command, tmp_path) as bridge, running(live_command, tmp_path) as live:
        until((tmp_path / "bridge_listens").exists, bridge, live)
        until((tmp_path / "live_listens").exists, bridge, live)
        with running(stand_in_command, tmp_path) as stand_in:
            until(lambda: len(usable(parameters)) >= ENOUGH, bridge, live, stand_in, spin=spin)
            until(lambda: "published.gps/fix" in diagnosed(diagnostics, "mavlink_bridge"), bridge, live, spin=spin)
            seen = diagnosed(diagnostics, "state_estimator")
            result = interrupted(live)
            passed_on = interrupted(bridge)
    check_diagnosed(seen, fixes)
    check_bridge(passed_on)
    check_run(tmp_path / "run", result, aircraft_file)


def check_diagnosed(seen, fixes):
    for kind in ("imu", "gps_position", "gps_velocity", "airspeed", "angle_of_attack", "sideslip"):
        assert int(seen[f"{kind}.received"]) > 0 and f"{kind}.invalid" not in seen, seen
    assert {fix.status.status for fix in fixes} <= {FIX, UNKNOWN_FIX}  # the filter's, until the receiver's comes
    assert fixes[-1].status.status == FIX


def check_bridge(result):
    assert result["vehicle"] == "ArduPilot 1" and result["bad_data"] == 0 and result["reboots"] == 0
    not_mavlink = {"five_hole_probe", "height_above_ground", "mass_properties"}
    assert result["published"].keys() == ALL_TOPICS.keys() - not_mavlink
    assert result["clock"]["std"] < 0.01


def check_run(run, result, aircraft_file):
    """States, and parameters with USE within 5 standard errors of the truth."""
    assert result["states"][0] == result["states"][1] > 500
    learnt = json.loads((run / "parameters.json").read_text())["parameters"]
    state = json.loads((run / "state.json").read_text())
    assert state["duration"] == result["state"]["duration"] and (run / "estimates.mcap").stat().st_size > 0
    truth = load_aircraft(aircraft_file).coefficients
    used = [p for p in learnt if p["status"] == "USE"]
    assert len(used) >= ENOUGH / 2  # the newest states may take USE from some
    assert all(abs(p["value"] - truth[p["name"]]) < 5.0 * p["std"] for p in used), used


def test_live_without_anybody_says_that_nobody_is_there(tmp_path, port, domain):
    _, command, _ = commands(tmp_path, port)
    with running(command, tmp_path) as live:
        until((tmp_path / "live_listens").exists, live)
        live.send_signal(signal.SIGINT)
        assert live.wait(PATIENCE) == 2
        assert "no message came: the drivers or `bridge` must run" in live.said() and "Traceback" not in live.said()
    assert not (tmp_path / "run").exists()


def test_live_with_a_gps_that_has_no_fix_says_so(tmp_path, port, ear):
    _, command, _ = commands(tmp_path, port)
    node, spin = ear
    diagnostics = heard(node, DiagnosticArray, "/diagnostics")
    imu, gps = node.create_publisher(Imu, "imu/data", 10), node.create_publisher(NavSatFix, "gps/fix", 10)

    def publish():
        without = NavSatFix(status=NavSatStatus(status=NO_FIX), latitude=45.0, longitude=-93.0, altitude=300.0)
        for publisher, message in ((imu, Imu()), (gps, without)):
            message.header.stamp = node.get_clock().now().to_msg()
            publisher.publish(message)
        spin()

    def has_come():
        return int(diagnosed(diagnostics, "state_estimator").get("gps_position.invalid", 0)) > 0

    with running(command, tmp_path) as live:
        until((tmp_path / "live_listens").exists, live)
        until(has_come, live, spin=publish)
        live.send_signal(signal.SIGINT)
        assert live.wait(PATIENCE) == 2
        said = re.search(r"of (\d+) samples of the GPS position \1 have no fix", live.said())
        assert said and "no GPS velocity came on gps/vel" in live.said() and "Traceback" not in live.said()
    assert not (tmp_path / "run").exists()


def test_the_stand_in_flies_jsbsim_through_a_restart_and_writes_what_the_page_says(tmp_path):
    page = (REPOSITORY / "docs" / "mavlink.md").read_text(encoding="utf8").replace("\\\n", " ")
    (line,) = re.findall(r"python (-m .*--write-aircraft .*)", page)
    words = shlex.split(line.replace("--reboot 60", "--reboot 3"))
    command = [sys.executable, *words, "--connect", "udpout:127.0.0.1:9", "--duration", "6"]
    done = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(REPOSITORY)}, capture_output=True, text=True,
        timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and "speaks MAVLink" in done.stderr, done.stderr
    recording = read_recording(tmp_path / "direct")
    assert recording.topics["imu/data"] == pytest.approx(600, abs=2) and recording.topics["gps/fix"] > 25
    assert load_aircraft(tmp_path / "c172p.yaml").name == "JSBSim c172p"
