"""``bridge`` and ``import`` of logs at the command line."""

import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from aircraft_sysid_ros.commands.main import main

CALIBRATION = Path(__file__).resolve().parents[2] / "config" / "mavlink_simulator_servos.yaml"


def refused(capfd, *arguments):
    try:
        status = main([str(argument) for argument in arguments])
    except SystemExit as end:
        status = end.code
    captured = capfd.readouterr()
    assert status == 2 and captured.out == ""
    (line,) = captured.err.strip().splitlines()
    return line


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["nonsense"], "the connection 'nonsense' is not understood"),
        (["udp:127.0.0.1:0"], "not understood"),
        (["--servos", "nowhere.yaml"], "cannot read the calibration file nowhere.yaml"),
        (["--system", "300"], "--system must be from 0 to 255"),
        (["--topics", "imu"], "unknown topic imu"),
        (["--topics", "mass_properties"], "unknown topic mass_properties"),  # no autopilot sends it
        (["--duration", "0"], "--duration must be a positive time"),
        (["--back-rate", "1000"], "--back-rate must be between 0 and 50 Hz, not 1000"),
        (["--back-rate", "-1"], "--back-rate must be between 0 and 50 Hz, not -1"),
        (["--back-rate", "nan"], "--back-rate must be between 0 and 50 Hz, not nan"),
        (["--back", "Cl_alpha*beta", "Cl_alpha*beta**2"], "use array"),
    ],
)
def test_bad_options_are_one_line(capfd, arguments, text):
    assert text in refused(capfd, "bridge", *arguments)


def test_a_port_that_is_taken_is_said(capfd):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        line = refused(capfd, "bridge", f"udp:127.0.0.1:{port}")
    assert f"cannot open udpin:127.0.0.1:{port}" in line and "take another port" in line


@pytest.mark.long
def test_a_bad_namespace_is_one_line():
    pytest.importorskip("rclpy")
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "bridge", "udpout:127.0.0.1:9"]
    done = subprocess.run([*command, "--namespace", "1a"], capture_output=True, text=True, timeout=300, check=False)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and "--namespace 1a is not a namespace: " in line and "starts with a number" in line


@pytest.mark.long
def test_a_simulator_that_does_not_run_is_said_with_what_to_do():
    pytest.importorskip("rclpy")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "bridge", f"tcp:127.0.0.1:{port}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert "cannot open tcp:127.0.0.1:" in last and "start the autopilot or its simulator first" in last


@pytest.mark.long
def test_a_bridge_that_hears_nothing_ends_and_says_so():
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "bridge", "udpout:127.0.0.1:9"]
    options = {"capture_output": True, "text": True, "timeout": 60}
    assert "no autopilot was heard" in subprocess.run([*command, "--duration", "1"], check=True, **options).stdout
    done = subprocess.run([*command, "--duration", "1", "--json"], check=True, **options)
    assert "without --servos" in done.stderr and "no control surfaces" in done.stderr
    result = json.loads(done.stdout)
    assert result["vehicle"] is None and result["received"] == {} and result["clock"]["std"] is None


def test_import_refuses_a_bad_calibration_before_it_writes(capfd, tmp_path):
    (tmp_path / "flight.bin").write_bytes(b"\xa3\x95")
    (tmp_path / "bad.yaml").write_text("outputs: {1: {surface: wing}}")
    line = refused(
        capfd, "import", tmp_path / "flight.bin", "--out", tmp_path / "bag", "--servos", tmp_path / "bad.yaml"
    )
    assert "unknown surface 'wing'" in line
    assert not (tmp_path / "bag").exists()


def test_the_example_of_a_calibration_file_is_one():
    from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping

    assert load_servo_mapping(CALIBRATION).measured_angles
