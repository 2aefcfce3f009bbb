"""The calls of a notebook: they need no ROS, say what the commands say, and take and give pandas."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import aircraft_sysid_ros as sysid
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Kind

WITHOUT_ROS = """
import sys
for name in ("rclpy", "pandas", "matplotlib", "jinja2", "nicegui", "pymavlink", "jsbsim"):
    sys.modules[name] = None
import aircraft_sysid_ros as sysid
assert "numpy" not in sys.modules
run = sysid.load(sys.argv[1])
print(run.model, run.state["duration"] > 0, sorted(sysid.__dir__())[0])
try:
    run.parameters
except sysid.InputError as error:
    print(error)
"""


@pytest.fixture
def run(run_with_hidden_effect, tmp_path) -> sysid.Run:
    shutil.copytree(run_with_hidden_effect, tmp_path / "run")
    return sysid.load(tmp_path / "run")


@pytest.mark.long
def test_a_run_is_read_where_only_the_core_is_installed(run_with_hidden_effect):
    words = [sys.executable, "-c", WITHOUT_ROS, str(run_with_hidden_effect)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    first, second = done.stdout.splitlines()
    assert first.split()[1] == "True"
    assert second == "tables need pandas: python3 -m pip install 'aircraft_sysid_ros[tables]'"


def test_every_call_that_is_promised_is_there():
    from aircraft_sysid_ros import api

    assert set(api.__all__) == set(sysid._OF_API)
    assert all(getattr(sysid, name) is getattr(api, name) for name in api.__all__)
    with pytest.raises(AttributeError, match="nobody"):
        _ = sysid.nobody


@pytest.mark.long
def test_calls_say_what_the_commands_say(run, capsys):
    capsys.readouterr()
    assert main(["compare", str(run.path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    found = sysid.compare(run)
    keys = ("model", "axes", "worst", "frequency_responses", "notes")
    assert {key: told[key] for key in keys} == json.loads(json.dumps(found.json))
    assert found.errors.nrmse_held_out["CZ"] == told["axes"]["CZ"]["nrmse_held_out"]
    added = sysid.add(run, "CZ: alpha**3")
    assert added.errors.error_after["CZ"] < added.errors.error_before["CZ"] and added.verdict.startswith(
        "with 'CZ: alpha**3' the held-out error falls"
    )
    assert run.model == added.json["model"] != told["model"]
    value = run.parameters.value["CZ_alpha3"]
    assert value == pytest.approx(60.0, rel=0.1)  # what `simulate` hid
    both = sysid.compare(run, told["model"])  # a version by its id
    assert both.json["with"]["same_flight"] and both.parameters.differs.sum() == 0 and len(both.errors) == 6
    assert sysid.remove(run, "CZ: alpha**3").run.model == told["model"]
    assert {"alpha", "CZ"} <= set(run.points) and len(run.points) > 500


@pytest.mark.long
def test_a_picture_that_cannot_be_written_is_bad_input(run, pictures, tmp_path):
    found = sysid.compare(run)
    for name, sentence in (("none/x.png", "cannot write"), ("x.nope", "not a kind of picture")):
        with pytest.raises(sysid.InputError, match=sentence):
            found.plot(tmp_path / name)


@pytest.mark.parametrize("frames", [{}, [], 3, {"imu": 1}, "imu"])
def test_what_is_no_table_is_not_recorded(frames, tmp_path):
    with pytest.raises(sysid.InputError, match="give a table of pandas"):
        sysid.record(frames, tmp_path / "run")


def test_a_table_without_times_is_not_recorded(tmp_path):
    pandas = pytest.importorskip("pandas")
    with pytest.raises(sysid.InputError, match=r"index of a table is its time \[s\], but 'noon' is not a number"):
        sysid.record(pandas.DataFrame({"true_airspeed": [15.0]}, index=["noon"]), tmp_path / "run")
    assert not Path(tmp_path, "run").exists()


def still(pandas, index):
    """A second of an IMU at rest."""
    columns = [f"{v}.{a}" for v in ("specific_force", "angular_velocity") for a in "xyz"]
    return pandas.DataFrame(np.tile([0.0, 0.0, -9.8, 0.0, 0.0, 0.0], (len(index), 1)), index, columns)


@pytest.mark.parametrize("kind", ["seconds", "since a start", "dates", "dates of a zone"])
def test_the_times_of_an_index_of_pandas_are_what_they_are(kind, tmp_path):
    """Times since a start were taken for nanoseconds, in seconds; dates were refused as a unit of a map."""
    pandas = pytest.importorskip("pandas")
    since, start = pandas.to_timedelta(10 * np.arange(100), unit="ms"), pandas.Timestamp("2024-05-31T14:05:00")
    index = {
        "seconds": since.total_seconds(), "since a start": since, "dates": start + since,
        "dates of a zone": (start + since).tz_localize("UTC").tz_convert("Asia/Tokyo"),
    }[kind]  # fmt: skip
    stamp = read_recording(sysid.record(still(pandas, index), tmp_path / "bag").path).samples.stamp
    assert np.diff(stamp) == pytest.approx(np.full(99, 1e7), abs=2)
    assert not kind.startswith("dates") or stamp[0] == start.value


def test_a_table_whose_columns_hold_no_numbers_or_stand_twice_is_not_recorded(tmp_path):
    pandas = pytest.importorskip("pandas")
    table = still(pandas, 0.01 * np.arange(100))
    words = table.astype(object)
    words.iloc[3, 0] = "bad"
    for wrong in (words, table.astype(complex), pandas.concat([table, table.iloc[:, :1]], axis=1)):
        with pytest.raises(sysid.InputError, match=r"cannot be recorded: .*specific_force\.x"):
            sysid.record(wrong, tmp_path / "bag")
    assert not Path(tmp_path, "bag").exists()


def test_named_inputs_are_among_the_tables_and_come_in_again(tmp_path):
    """A recording that was corrected in pandas had lost the elevons without a word."""
    pandas = pytest.importorskip("pandas")
    table = still(pandas, 0.01 * np.arange(100))
    moved = {f"inputs.{name}": 0.1 * k * np.sin(table.index) for k, name in enumerate("abcdefghijkl", 1)}
    there = sysid.record(table.assign(**moved), tmp_path / "there")
    again = sysid.record(list(there.tables().values()), tmp_path / "again")
    for recording in (there, again):
        shown = pandas.concat([t for name, t in recording.tables().items() if name.startswith("inputs")], axis=1)
        assert {*shown} == {*moved}
        for name, values in moved.items():
            assert shown[name].to_numpy() == pytest.approx(values)


@pytest.mark.long
def test_frames_of_pandas_become_the_same_recording(run_with_hidden_effect, tmp_path):
    """Samples go out as tables by sensor and come in again."""
    there = sysid.load(run_with_hidden_effect.parent / "flight")
    tables = there.tables()
    assert list(tables["imu"]) == [f"{v}.{a}" for v in ("specific_force", "angular_velocity") for a in "xyz"]
    again = sysid.record([tables["imu"], tables["gps_velocity"], tables["airspeed"]], tmp_path / "again")
    before, after = read_recording(there.path).samples, read_recording(again.path).samples
    for kind in (Kind.IMU, Kind.GPS_VELOCITY, Kind.AIRSPEED):
        old, new = before[before.kind == kind], after[after.kind == kind]
        known = np.isfinite(old.values[:, 0])
        assert new.values[:, :6] == pytest.approx(old.values[known][:, :6], rel=1e-6, abs=1e-9, nan_ok=True)
        assert np.diff(new.stamp) == pytest.approx(np.diff(old.stamp[known]), abs=2)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda place: sysid.load(place / "nothing"), "there is no .*nothing: give the folder of a run"),
        (sysid.load, "metadata.yaml|no recording|not a recording|holds no"),
        (lambda place: sysid.replay([], "aircraft.yaml", place / "run"), "no recording is given"),
        (lambda place: sysid.replay("a", "b", place / "run", estimatr="rml"), "'estimatr' is not an option of replay"),
        (lambda place: sysid.replay("a", "b", place / "run", estimator="best"), "estimator must be one of"),
        (lambda place: sysid.diagnose(), "no run is given to diagnose"),
        (lambda place: sysid.replay("a", {"name": "x"}, place / "run"), "the required key 'mass' is missing"),
        (lambda place: sysid.replay(3, {}, place / "run"), "required key|not 3"),
        (
            lambda place: sysid.replay([None], "aircraft.yaml", place / "run"),
            "or what another call has given, and not None",
        ),
        (lambda place: sysid.replay("a", 7, place / "run"), "an aircraft file, or its content, and not 7"),
        (lambda place: sysid.replay("a", "b", None), "give a path, and not None"),
        (lambda place: sysid.replay("a", "b", place / "run", segments=3), "give a path, and not 3"),
        (lambda place: sysid.load(None), "give a path, or what another call has given, and not None"),
        (lambda place: sysid.load(""), "not an empty text"),
        (lambda place: sysid.check({"imu": 1}), "give a path"),
        (lambda place: sysid.compare(3), "and not 3"),
        (lambda place: sysid.compare(place, 3), "no run|and not 3"),
        (lambda place: sysid.diagnose([place]), "give a path"),
        (lambda place: sysid.diagnose(place, replicas="many"), "must be from 2 to 50, not many"),
        (lambda place: sysid.add(place, None), "give an effect by its id"),
        (lambda place: sysid.explain(3, "b", place / "run"), "and not 3"),
        (lambda place: sysid.import_log(3, place / "run"), "and not 3"),
    ],
)
def test_bad_input_is_one_sentence(call, sentence, tmp_path):
    with pytest.raises(sysid.InputError, match=sentence):
        call(tmp_path)
    assert not Path(tmp_path, "run").exists()
