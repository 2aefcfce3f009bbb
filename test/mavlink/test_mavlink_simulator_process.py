"""The MAVLink simulator's command line: what it refuses, before it writes or deletes anything."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.simulation.mavlink_simulator import process
from aircraft_sysid_ros.simulation.mavlink_simulator.process import main

CONNECTION = "udpout:127.0.0.1:9"


def refused(capfd, *arguments):
    assert main(["--connect", CONNECTION, "--simulator", "textbook", *map(str, arguments)]) == 2
    captured = capfd.readouterr()
    (line,) = captured.err.splitlines()
    assert captured.out == "" and line.startswith("mavlink_simulator: ")
    return line


@pytest.fixture
def victim(tmp_path):
    """A recording with the truth beside it."""
    with RecordingWriter(tmp_path / "victim") as writer:
        writer.write("air_data", "aircraft_sysid_msgs/msg/AirData", [1], {"true_airspeed": [17.0]})
    (tmp_path / "victim" / "truth.json").write_text("{}")
    return tmp_path / "victim"


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def quick(monkeypatch):
    """No waiting: the clock of the flight is the one that is asked for."""

    def run_until(radio, flight_time):
        radio._serve(flight_time)

    monkeypatch.setattr(process.Radio, "run_until", run_until)


def test_a_recording_that_is_there_stays(capfd, victim):
    before = contents(victim)
    assert "victim is already there" in refused(capfd, "--record", victim, "--duration", "20")
    assert contents(victim) == before


@pytest.mark.long
@pytest.mark.parametrize("more", [("--connect", "nonsense"), ("--duration", "5"), ("--calibration", "nowhere.yaml")])
def test_a_flight_that_is_refused_replaces_nothing(capfd, victim, more):
    before = contents(victim)
    refused(capfd, "--record", victim, "--overwrite", *more)
    assert contents(victim) == before


@pytest.mark.long
def test_a_flight_is_recorded_and_may_replace_a_recording(victim, quick):
    arguments = ["--connect", CONNECTION, "--simulator", "textbook", "--duration", "20", "--record"]
    assert main([*arguments, str(victim.parent / "new" / "bag")]) == 0
    assert main([*arguments, str(victim), "--overwrite"]) == 0
    assert len(read_raw(victim)) == len(read_raw(victim.parent / "new" / "bag")) > 1000


def test_delays_of_an_aircraft_file_are_not_flown_and_that_is_said(tmp_path, quick, capfd):
    """The estimators allowed for a delay that no sample had."""
    text = config_path(DEFAULT_AIRCRAFT).read_text(encoding="utf8")
    late = text.replace("  gps_velocity: {", "  gps_velocity: {delay: 0.2, ")
    assert late != text
    (tmp_path / "late.yaml").write_text(late)
    arguments = ["--connect", CONNECTION, "--simulator", "textbook", "--duration", "20", "--aircraft"]
    assert main([*arguments, str(tmp_path / "late.yaml")]) == 0
    assert "take the delay of gps_velocity out of the file for the estimators" in capfd.readouterr().err


def test_what_cannot_be_written_is_said_before_the_flight(capfd, tmp_path):
    (tmp_path / "file").write_text("")
    for option, target in (("--record", tmp_path / "file" / "bag"), ("--write-aircraft", tmp_path / "no" / "a.yaml")):
        assert f"cannot write {tmp_path}" in refused(capfd, option, target, "--duration", "20")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--seed", "-1"], "--seed must not be negative, not -1"),
        (["--clock-offset", "nan"], "--clock-offset must be from 0 to 4000000 s, not nan"),
        (["--clock-offset", "-3"], "--clock-offset must be from 0"),
        (["--reboot", "nan"], "--reboot must be from 0 to the --duration of 120 s, not nan"),
        (["--reboot", "10", "-5"], "--reboot must be from 0 to the --duration of 120 s, not -5"),
        (["--reboot", "121"], "not 121"),
        (["--simulator", "jsbsim", "--aircraft", "x.yaml"], "--aircraft is for --simulator textbook"),
        (["--loss", "nan"], "--loss is from 0 to 0.9"),
    ],
)
def test_bad_numbers_are_one_line(capfd, arguments, text):
    assert text in refused(capfd, *arguments)


@pytest.mark.long
def test_jsbsim_flies_through_a_restart_and_writes_what_the_page_says(tmp_path):
    """By the command of the page, with a restart sooner and a flight that is shorter."""
    root = Path(__file__).resolve().parents[2]
    page = (root / "docs" / "mavlink.md").read_text(encoding="utf8").replace("\\\n", " ")
    (line,) = re.findall(r"python (-m .*--write-aircraft .*)", page)
    words = shlex.split(line.replace("--reboot 60", "--reboot 3"))
    command = [sys.executable, *words, "--connect", CONNECTION, "--duration", "6"]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0 and "speaks MAVLink" in done.stderr, done.stderr
    recording = read_recording(tmp_path / "direct")
    assert recording.topics["imu/data"] == pytest.approx(600, abs=2) and recording.topics["gps/fix"] > 25
    assert load_aircraft(tmp_path / "c172p.yaml").name == "JSBSim c172p"
