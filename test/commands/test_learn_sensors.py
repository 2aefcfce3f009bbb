"""`replay --learn-sensors`: the aircraft file, completed by a flight."""

import json

import numpy as np
import pytest
import yaml

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A recording, and a file with mass and shape of its aeroplane."""
    folder = tmp_path_factory.mktemp("learn")
    flight = simulate_samples(default_aircraft(), 71, 60.0)
    with RecordingWriter(folder / "bag") as writer:
        for stream in flight.streams:
            writer.write(stream.topic, TOPICS[stream.topic], stream.stamp, stream.fields, log_time=stream.arrival)
    keep = ("name", "mass", "wing_area", "span", "chord", "inertia", "imu_position", "air_data_position")
    source = {key: value for key, value in flight.aircraft.source.items() if key in keep}
    (folder / "plain.yaml").write_text(yaml.safe_dump(source))
    return folder


def replay(folder, aircraft, run, *more):
    return main(["replay", str(folder / "bag"), "--aircraft", str(aircraft), "--out", str(run), "--json", *more])


@pytest.mark.long
def test_the_file_that_is_written_states_what_the_flight_had(flown, tmp_path, capsys):
    learnt = tmp_path / "learnt.yaml"
    assert replay(flown, flown / "plain.yaml", tmp_path / "run", "--learn-sensors", str(learnt)) == 0
    said = json.loads(capsys.readouterr().out)["state"]["sensor_noise"]
    made, truth = load_aircraft(learnt), default_aircraft()
    assert said["airspeed"]["source"] == "flight" and said["airspeed"]["noise"] == list(made.sensors["airspeed"].noise)
    for name in ("accelerometer", "gyro", "airspeed", "angle_of_attack", "sideslip"):
        assert made.sensors[name].noise_is_given
        assert made.sensors[name].noise == pytest.approx(truth.sensors[name].noise, rel=0.2), name
    assert replay(flown, learnt, tmp_path / "again") == 0
    again = json.loads(capsys.readouterr().out)["state"]
    assert again["sensor_noise"]["airspeed"]["source"] == "file"
    assert np.isclose(again["innovation_consistency"]["airspeed"], 1.0, atol=0.2)


def test_a_file_that_is_there_or_cannot_be_written_is_said_before_the_flight(flown, tmp_path, capsys):
    there = tmp_path / "there.yaml"
    there.write_text("mine")
    for path, words in ((there, "already there"), (tmp_path / "none" / "a.yaml", "a folder that exists")):
        assert replay(flown, flown / "plain.yaml", tmp_path / "run", "--learn-sensors", str(path)) == 2
        assert words in capsys.readouterr().err
    assert there.read_text() == "mine" and not (tmp_path / "run").exists()


@pytest.mark.long
def test_a_vane_out_on_the_wing_that_the_file_leaves_out_is_placed_and_said(flown, tmp_path, capsys):
    """As live has it nothing may be used; placed where the roll shows it, 0.4 m to the right, most of it may."""
    silent = yaml.safe_load((flown / "plain.yaml").read_text())
    del silent["air_data_position"]
    (tmp_path / "silent.yaml").write_text(yaml.safe_dump(silent))
    assert replay(flown, tmp_path / "silent.yaml", tmp_path / "live", "--as-live") == 0
    as_live = json.loads(capsys.readouterr().out)
    assert not any(p["status"] == "USE" for p in as_live["parameters"]["parameters"])
    assert any("does not say where it is: set air_data_position: [null, 0." in note for note in as_live["notes"])
    learnt = tmp_path / "learnt.yaml"
    assert replay(flown, tmp_path / "silent.yaml", tmp_path / "run", "--learn-sensors", str(learnt)) == 0
    said = json.loads(capsys.readouterr().out)
    assert "it is taken 0." in said["notes"][0] and "the file that is written holds it" in said["notes"][0]
    for path in (learnt, tmp_path / "run" / "aircraft.yaml"):
        assert load_aircraft(path).air_data_position == pytest.approx([0.0, 0.4, 0.0], abs=0.03)
    truth = default_aircraft().coefficients
    used = {p["name"]: p for p in said["parameters"]["parameters"] if p["status"] == "USE"}
    assert {"CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_dr"} <= {*used}
    assert all(abs(used[name]["value"] - truth[name]) < 3.5 * used[name]["std"] for name in used)
    placed = {**silent, "air_data_position": yaml.safe_load(learnt.read_text())["air_data_position"]}
    (tmp_path / "placed.yaml").write_text(yaml.safe_dump(placed))
    assert replay(flown, tmp_path / "placed.yaml", tmp_path / "again", "--as-live") == 0
    assert json.loads(capsys.readouterr().out)["parameters"]["parameters"] == said["parameters"]["parameters"]
