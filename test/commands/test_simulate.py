"""The command simulate: what it writes, and one clear sentence for bad input."""

import argparse
import json
import os
import resource
import subprocess
import sys

import pytest
import yaml

from aircraft_sysid_ros import config_files
from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.commands import simulate
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.simulation.truth_files import load_truth


def call(*arguments):
    parser = argparse.ArgumentParser()
    simulate.add_parser(parser.add_subparsers())
    return simulate.run(parser.parse_args(["simulate", *map(str, arguments)]))


def test_writes_a_recording_with_its_truth(tmp_path):
    result = call("--out", tmp_path / "bag", "--duration", 20, "--seed", 4, "--effect", "CZ: alpha**3 = -5.0")
    assert read_recording(result["recording"]).topics == result["messages"]
    document, _ = load_truth(result["recording"])
    assert document["effects"] == [{"axis": "CZ", "expression": "alpha**3", "value": -5.0}]
    assert json.loads(json.dumps(result)) == result
    assert "truth.json" in simulate.render(result)
    assert load_aircraft(result["aircraft_file"]).name == result["aircraft"]


def test_every_message_of_a_recording_has_its_frame(tmp_path):
    from rosbags.highlevel import AnyReader

    call("--out", tmp_path / "bag", "--duration", 20, "--height-above-ground")
    with AnyReader([tmp_path / "bag"]) as reader:
        frames = {c.topic: reader.deserialize(raw, c.msgtype).header.frame_id for c, _, raw in reader.messages()}
    assert {topic for topic, frame in frames.items() if frame == "gps"} == {"/gps/fix", "/gps/vel"}
    assert len(frames) == 6 and set(frames.values()) == {"gps", "base_link"}


@pytest.mark.long
def test_jsbsim_writes_its_aircraft_file_beside_the_truth(tmp_path):
    pytest.importorskip("jsbsim")
    result = call("--out", tmp_path / "bag", "--duration", 20, "--simulator", "jsbsim")
    assert load_aircraft(result["aircraft_file"]).name == "JSBSim c172p"
    assert load_truth(tmp_path / "bag")[0]["coefficients"] is None


@pytest.mark.long
def test_jsbsim_keeps_quiet_on_standard_output():
    """With --json there must be one document there and nothing else."""
    pytest.importorskip("jsbsim")
    code = "from aircraft_sysid_ros.simulation.jsbsim_flight import prepare_jsbsim; prepare_jsbsim('c172p')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, env=dict(os.environ))
    assert done.stdout.strip() == b""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--duration", "5"], "lasts 20 to 3600 s"),
        (["--duration", "nan"], "lasts 20 to 3600 s"),
        (["--seed", "-1"], "--seed must not be negative"),
        (["--wind", "nan", "0", "0"], "--wind must be three finite numbers"),
        (["--wind", "300", "0", "0"], "--wind of 300 m/s must be less than the 17 m/s at which Ultra Stick 25e flies"),
        (["--wind", "12", "-12", "3"], "--wind of 17.2 m/s must be less than the 17 m/s"),
        (["--wind", "0", "60", "0", "--manoeuvres", "calibration"], "--wind of 60 m/s must be less than the "),
        (["--wind-walk", "-0.1"], "--wind-walk must be zero or more"),
        (["--noise-scale", "inf"], "--noise-scale must be zero or more"),
        (["--aircraft", "nowhere.yaml"], "cannot read the aircraft file nowhere.yaml"),
        (["--effect", "stalled"], "'stalled' is not an effect, did you mean stall"),
        (["--effect", "sideslip_drg:2"], "did you mean sideslip_drag"),
        (["--effect", "wobble"], "add --help` lists them"),
        (["--effect", "CZ: alpha**3 = much"], "'much' of the effect"),
        (["--effect", "CZ: wings = 1"], "'wings' in 'wings' is not a signal"),
        (["--effect", "CQ: alpha = 1"], "the axes are CX"),
        (["--jsbsim-aircraft", "c172p"], "needs --simulator jsbsim"),
        (["--simulator", "jsbsim", "--effect", "CZ: alpha = 1"], "do not go with --simulator jsbsim"),
    ],
)
def test_bad_input_is_said_and_nothing_is_written(tmp_path, options, message):
    with pytest.raises(InputError, match=message.replace("*", r"\*")):
        call("--out", tmp_path / "bag", *options)
    assert not list(tmp_path.iterdir())


@pytest.mark.long_after_the_first
@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_a_full_disk_leaves_nothing_behind(tmp_path, name, monkeypatch):
    """Full while the recording is written, and full when only the truth is left to be written."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        with pytest.raises(InputError, match="cannot write the recording"):
            call("--out", tmp_path / name, "--duration", 20)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())

    def full(self, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    with pytest.raises(InputError, match="No space left"):
        call("--out", tmp_path / name, "--duration", 20)
    assert not list(tmp_path.iterdir())


def test_a_recording_that_is_there_is_kept(tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(InputError, match="already there"):
        call("--out", tmp_path / "bag", "--duration", 20)


def test_an_aircraft_file_without_coefficients_is_refused(tmp_path):
    data = yaml.safe_load(config_files.config_path(config_files.DEFAULT_AIRCRAFT).read_text())
    del data["coefficients"]["CZ_alpha"]
    path = tmp_path / "plane.yaml"
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(InputError, match="lacks the coefficients CZ_alpha"):
        call("--out", tmp_path / "bag", "--aircraft", path)
