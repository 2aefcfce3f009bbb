"""`aircraft-sysid check` as a user meets it: recordings that are whole, poor, damaged or none."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.commands.check import render
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.flight_check.finding import KINDS, SEVERITIES
from aircraft_sysid_ros.flight_check.signals import held_length
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A flight of 60 s as a recording, and the flight."""
    flight = simulate_samples(default_aircraft(), 61, 60.0, sensors=SensorOptions(attitude=True))
    path = tmp_path_factory.mktemp("check") / "flight"
    write(path, flight.streams)
    return path, flight


def write(path, streams):
    with RecordingWriter(path) as writer:
        for stream in streams:
            writer.write(stream.topic, TOPICS[stream.topic], stream.stamp, stream.fields, log_time=stream.arrival)


def answer(capsys, *arguments):
    capsys.readouterr()
    assert main(["check", *map(str, arguments), "--json"]) == 0
    out, err = capsys.readouterr()
    assert "Traceback" not in err and "Warning" not in err
    return json.loads(out)


@pytest.mark.long
def test_the_command_in_a_process_prints_one_document_and_nothing_else(recorded, tmp_path):
    path, _ = recorded
    done = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", "-m", "aircraft_sysid_ros.commands.main", "check", str(path)]
        + ["--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and done.stderr == ""
    result = json.loads(done.stdout)
    assert result["rates"]["specific_force.z"] == pytest.approx(100.0, rel=0.01)
    assert result["rates"]["latitude"] == pytest.approx(5.0, rel=0.01)
    assert [f for f in result["findings"] if f["severity"] != "info"] == []
    assert len(result["identifiable"]) == 32 and sum(result["identifiable"].values()) >= 25


@pytest.mark.long
def test_findings_have_a_known_kind_a_severity_and_a_sentence_that_says_what_to_do(recorded, capsys, tmp_path):
    _, flight = recorded
    streams = [s for s in flight.streams if s.topic not in ("gps/vel", "air_data")]
    air = next(s for s in flight.streams if s.topic == "air_data")
    reversed_angle = {"angle_of_attack": -air.fields["angle_of_attack"]}
    streams.append(type(air)(air.topic, air.stamp, air.arrival, {**air.fields, **reversed_angle}))
    write(tmp_path / "wrong", streams)
    found = answer(capsys, tmp_path / "wrong")["findings"]
    assert ("angle_of_attack", "sign", "error") in {(f["signal"], f["kind"], f["severity"]) for f in found}
    assert ("velocity.north", "missing") in {(f["signal"], f["kind"]) for f in found}
    for finding in found:
        assert finding["kind"] in KINDS and finding["severity"] in SEVERITIES and ":" in finding["sentence"]


@pytest.mark.long
@pytest.mark.parametrize("topics", [("imu/data",), ("gps/fix",), ("air_data",), ("control_surfaces",)])
def test_a_recording_of_one_topic_is_judged_by_what_it_lacks(recorded, capsys, tmp_path, topics):
    _, flight = recorded
    streams = [s for s in flight.streams if s.topic in topics]
    write(tmp_path / "one", streams)
    found = answer(capsys, tmp_path / "one")["findings"]
    assert ("imu/data" in topics) != any(f["signal"] == "specific_force.x" and f["kind"] == "missing" for f in found)


def test_two_seconds_are_enough_for_rates_and_not_for_more(recorded, capsys, tmp_path):
    _, flight = recorded
    first = min(int(s.stamp.min()) for s in flight.streams)
    streams = []
    for s in flight.streams:
        rows = s.stamp < first + 2_000_000_000
        fields = {name: np.asarray(column)[rows] for name, column in s.fields.items()}
        streams.append(type(s)(s.topic, s.stamp[rows], s.arrival[rows], fields))
    write(tmp_path / "short", streams)
    result = answer(capsys, tmp_path / "short")
    assert result["rates"]["true_airspeed"] == pytest.approx(50.0, rel=0.01)
    assert {f["kind"] for f in result["findings"]} <= {"missing", "rate", "gap"}
    assert "too short to say" in render({**result, "findings": []})


def test_what_is_no_recording_is_one_sentence(capsys, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mcap").write_text("not a recording")
    for name in ("nowhere", "empty", "text.mcap"):
        capsys.readouterr()
        assert main(["check", str(tmp_path / name)]) == 2
        out, err = capsys.readouterr()
        assert out == "" and err.count("\n") == 1 and "Traceback" not in err


def test_a_damaged_recording_is_judged_by_what_can_be_read(recorded, capsys, tmp_path):
    path, _ = recorded
    (file,) = path.glob("*.mcap")
    content = file.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) // 2])
    result = answer(capsys, tmp_path / "cut.mcap")
    assert result["notes"] and 10.0 < result["duration"] < 60.0


@pytest.mark.long
def test_numbers_that_nothing_has_are_said_and_harm_nothing(recorded, capsys, tmp_path):
    """Squared they are infinite, and check ended with a ValueError of scipy."""
    streams = []
    for stream in recorded[1].streams:
        fields = {name: np.array(values) for name, values in stream.fields.items()}
        for values in fields.values():
            if values.dtype.kind == "f" and len(values) == len(stream.stamp) and len(values) > 60:
                values.reshape(len(values), -1)[50:52, 0] = (1e300, -1e300)
        streams.append(replace(stream, fields=fields))
    write(tmp_path / "wild", streams)
    result = answer(capsys, tmp_path / "wild")
    wild = [note for note in result["notes"] if "beyond 1e+12, the largest 1e+300, are taken as not measured" in note]
    assert len(wild) == 1 and sum(result["identifiable"].values()) >= 25
    assert not [f for f in result["findings"] if f["severity"] == "error"]


@pytest.mark.long
@pytest.mark.parametrize("count", [50, None])
def test_stamps_of_another_day_are_said_and_do_not_fill_the_memory(recorded, capsys, tmp_path, count):
    _, flight = recorded
    streams = []
    for s in flight.streams:
        stamp = s.stamp.copy()
        if s.topic == "air_data":
            stamp[:count] = np.arange(len(stamp[:count]))
        streams.append(type(s)(s.topic, stamp, s.arrival, s.fields))
    write(tmp_path / "clock", streams)
    result = answer(capsys, tmp_path / "clock")
    assert result["duration"] < 61.0
    assert ("true_airspeed", "jitter", "error") in {(f["signal"], f["kind"], f["severity"]) for f in result["findings"]}


@pytest.mark.long
def test_a_page_and_a_picture_are_written_and_a_bad_name_is_refused_before_the_work(
    recorded, capsys, pictures, tmp_path
):
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    path, _ = recorded
    result = answer(capsys, path, "--out", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf8")
    assert result["figure"] == str(tmp_path / "page.html") and "data:image/png;base64," in page
    assert all(f"<td>{name}</td>" in page for name in result["identifiable"])
    assert "http://" not in page and "https://" not in page
    answer(capsys, path, "--out", tmp_path / "picture.png")
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
    for name in ("page.txt", "nowhere/page.html"):
        capsys.readouterr()
        assert main(["check", str(path), "--out", str(tmp_path / name)]) == 2
        out, err = capsys.readouterr()
        assert out == "" and err.count("\n") == 1
    (tmp_path / "folder.html").mkdir()
    assert main(["check", str(path), "--out", str(tmp_path / "folder.html"), "--json"]) == 1
    out, err = capsys.readouterr()  # the answer is there all the same
    assert json.loads(out)["figure"] is None and f"--out {tmp_path / 'folder.html'} is not written" in err


@pytest.mark.long
def test_the_late_gps_of_a_real_log_is_found_and_is_known_with_its_aircraft_file(shared_data, capsys, tmp_path):
    """SwissLog1: its notes give 0.23 s for the velocity and 0.21 s for the position, 0.35 s for the height."""
    main(["import", str(shared_data / "inertialnav" / "SwissLog1.mat"), "--out", str(tmp_path / "log")])
    found = answer(capsys, tmp_path / "log")["findings"]
    late = {f["signal"]: f["sentence"] for f in found if f["kind"] == "offset" and f["severity"] != "info"}
    assert {"velocity.north", "latitude"} <= late.keys()
    seconds = float(late["velocity.north"].split(" s ")[0].rsplit(" ", 1)[1])
    assert 0.15 < seconds < 0.35
    assert not [f for f in found if f["severity"] == "error"]
    known = answer(capsys, tmp_path / "log", "--aircraft", CONFIG / "inertialnav_swisslog.yaml")["findings"]
    assert not [f for f in known if f["kind"] == "offset" and f["signal"].startswith("velocity")]


@pytest.mark.long
def test_a_real_flight_shows_no_rudder_derivative_and_nothing_that_contradicts_itself(shared_data, capsys, tmp_path):
    """Thor: its notes say that the rudder moves by 0.7 degrees and that its derivatives cannot be had."""
    main(["import", str(shared_data / "umn_thor_flight75" / "flight75.mat"), "--out", str(tmp_path / "thor")])
    result = answer(capsys, tmp_path / "thor", "--aircraft", CONFIG / "umn_thor.yaml")
    assert not any(result["identifiable"][name] for name in ("CY_dr", "Cl_dr", "Cn_dr"))
    assert result["identifiable"]["Cl_da"] and result["identifiable"]["Cm_de"]
    serious = {(f["signal"], f["kind"]) for f in result["findings"] if f["severity"] != "info"}
    assert {kind for _, kind in serious} == {"gap"}


@pytest.mark.parametrize(("hold", "expected"), [("steps", 1.0), ("slow", 10.0), ("slow with rests", 10.0)])
def test_a_command_that_moves_by_steps_of_a_manoeuvre_is_no_slow_sensor(hold, expected):
    """A rudder with doublets stands still for most of the flight; a slower signal never does for long."""
    runs = {"steps": [30, 31, 939, 55, 35, 18, 18, 874] * 4, "slow": [10] * 400, "slow with rests": [10] * 300 + [900]}
    fresh = np.zeros(sum(runs[hold]) + 1, dtype=bool)
    fresh[np.concatenate([[0], np.cumsum(runs[hold])])] = True
    assert held_length(fresh) == expected
