"""PX4 without MAVLink, with real processes: an agent that publishes px4_msgs, `bridge dds:`, and `live`."""

import json
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from message_packages import environment
from processes import live, ours
from waiting import LONGEST, finish

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

sys.path.append(str(Path(__file__).resolve().parents[1] / "mavlink"))
from px4_agent import SERVOS, px4_messages

pytestmark = pytest.mark.usefixtures("domain")
AGENT = Path(__file__).resolve().parents[1] / "mavlink" / "px4_agent.py"
DURATION = 60.0


@pytest.fixture
def px4():
    return environment("px4_msgs")


def bridge(px4, *words):
    command = ours("commands.main", "bridge", *words, "--json")
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=px4)


@pytest.mark.long
def test_a_flight_beside_px4(px4, aircraft, aircraft_file, tmp_path):
    flight = simulate_samples(aircraft, seed=3, duration=DURATION)
    (tmp_path / "servos.yaml").write_text(SERVOS)
    (tmp_path / "messages").write_bytes(pickle.dumps(px4_messages(flight.samples)))
    words = ("dds:px4_1/fmu/out", "--servos", tmp_path / "servos.yaml", "--namespace", "uav1")
    with live(tmp_path / "run", aircraft_file, "--namespace", "uav1", "--reliable", "--until-idle", "5") as running:
        bridging = bridge(px4, *map(str, words))
        agent = [sys.executable, AGENT, tmp_path / "messages", "2", "/uav1/px4_1/fmu/out/"]
        subprocess.run(agent, env=px4, check=True, timeout=LONGEST)
        result = json.loads(finish(running)[0])
        bridging.send_signal(signal.SIGINT)
        told = json.loads(finish(bridging)[0])
    sent = len(flight.samples.stamp[flight.samples.kind == Kind.IMU])
    assert told["vehicle"] == "PX4" and told["clock"] == "of this computer"
    assert told["received"]["sensor_combined"] > 0.98 * sent and told["received"]["airspeed_validated"]
    assert told["published"].keys() == {"imu/data", "gps/fix", "gps/vel", "air_data", "control_surfaces"}
    assert result["lost"] == {} and result["received"]["imu/data"] > 0.98 * told["published"]["imu/data"]
    parameters = {p["name"]: p for p in result["parameters"]["parameters"]}
    usable = [name for name, p in parameters.items() if p["status"] == "USE"]
    assert len(usable) >= 2, parameters  # no vane: what rests on inferred angles is held
    for name in usable:
        p, truth = parameters[name], flight.coefficients[name]
        assert abs(p["value"] - truth) < 5.0 * p["std"] + 0.1 * abs(truth), (name, p, truth)


@pytest.mark.long
def test_a_version_that_is_not_here_is_one_sentence(px4, aircraft, tmp_path):
    messages = px4_messages(simulate_samples(aircraft, seed=3, duration=20.0).samples)[:20]
    messages = [(s, t.replace("airspeed_validated_v1", "airspeed_validated_v7"), k, f) for s, t, k, f in messages]
    (tmp_path / "messages").write_bytes(pickle.dumps(messages))
    agent = subprocess.Popen([sys.executable, AGENT, tmp_path / "messages", "1", "/fmu/out/"], env=px4)
    try:
        said = finish(bridge(px4, "dds:", "--duration", "8"))[1]
    finally:
        agent.kill()
        agent.wait()
    assert "airspeed_validated_v7 is not heard: it is version 7" in said and "have version 1" in said
    assert "Traceback" not in said


@pytest.mark.long
def test_without_px4_msgs_it_is_one_sentence():
    bridging = subprocess.run(ours("commands.main", "bridge", "dds:"), capture_output=True, text=True, check=False)
    (line,) = bridging.stderr.splitlines()
    assert bridging.returncode == 2 and "px4_msgs is not in this environment" in line


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("dds:a b",), "no topic begins with the prefix 'a b'"),
        (("dds:", "--peer", "10.0.0.1"), "--peer is for MAVLink"),
        (("dds:", "--back", "CZ_alpha"), "--back sends MAVLink"),
        (("dds:", "--topics", "imu"), "unknown topic imu"),
        (("dds:", "--servos", "nowhere.yaml"), "cannot read the calibration file"),
    ],
)
def test_bad_input_is_one_sentence(words, text, capsys):
    assert main(["bridge", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert text in line


@pytest.mark.long
def test_its_bag_is_read_by_import_to_the_same_samples(aircraft, aircraft_file, tmp_path):
    pytest.importorskip("rosbags")
    sys.path.append(str(Path(__file__).resolve().parents[1] / "recordings"))
    from autopilot_log_files import write_bag
    from message_packages import DEFINITIONS

    flight = simulate_samples(aircraft, seed=3, duration=20.0)
    definitions = {f"px4_msgs/msg/{f.stem}": f.read_text() for f in sorted((DEFINITIONS / "px4_msgs").iterdir())}
    bag = write_bag(tmp_path / "bag", definitions, px4_messages(flight.samples))
    (tmp_path / "servos.yaml").write_text(SERVOS)
    command = ours("commands.main", "replay", bag, "--aircraft", aircraft_file, "--out", tmp_path / "run")
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert refused.returncode == 2 and f"`aircraft-sysid import {bag} --out BAG` makes a recording" in refused.stderr
    words = ("import", bag, "--out", tmp_path / "flight", "--servos", tmp_path / "servos.yaml")
    subprocess.run(ours("commands.main", *words), check=True, capture_output=True)
    found = read_recording(tmp_path / "flight").samples
    for kind, columns in ((Kind.IMU, 6), (Kind.CONTROLS, 3), (Kind.AIRSPEED, 1), (Kind.GPS_POSITION, 3)):
        came, sent = found.values[found.kind == kind], flight.samples.values[flight.samples.kind == kind]
        np.testing.assert_allclose(came[-1, :columns], sent[-1, :columns], rtol=3e-4, atol=1e-5)
        assert len(sent) - 2 <= len(came) <= len(sent)
