"""Flight-test systems that nobody here has made: the first guess, the corrections that it needs, and what is imported.

Truth is the simulated flight that the files were made from.
"""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml
from flight_test_layouts import (
    Flown,
    ascii_manoeuvres,
    business_jet,
    file_per_manoeuvre,
    manoeuvre_columns,
    semicolons,
    sheet_per_manoeuvre,
    sheets,
)

from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

KINDS = {
    Kind.IMU: ("fx", "fy", "fz", "p", "q", "r"), Kind.AIRSPEED: ("V",), Kind.ANGLE_OF_ATTACK: ("alpha",),
    Kind.CONTROLS: ("de", "da", "dr"),
}  # fmt: skip


@pytest.fixture(scope="module")
def flown(aircraft):
    return Flown(simulate_samples(aircraft, seed=5, duration=100.0, sensors=SensorOptions(attitude=True)))


def guessed(source, folder, capsys):
    """Lines of the MAP by signal, and what else is said."""
    assert main(["import", str(source), "--guess", str(folder / "map.yaml")]) == 0
    out = capsys.readouterr().out
    said = {}
    for line in out.splitlines():
        if match := re.match(r"  (sure|likely|undecided) +(\S+) +(-?)(.*?) \[", line):
            said[match[2]] = (match[1], -1 if match[3] else 1, match[4])
    return said, out


def imported(source, folder, text, capsys):
    (folder / "corrected.yaml").write_text(text)
    target = folder / "bag"
    assert main(["import", str(source), "--map", str(folder / "corrected.yaml"), "--out", str(target)]) == 0
    return read_recording(target), capsys.readouterr().out


def check_samples(recording, flown, start, places=1e-6):
    """Every sample of the recording is the flight's own at its time; ``start`` [s]: stamp at time 0 of the flight."""
    for kind, names in KINDS.items():
        rows = recording.samples.kind == kind
        time = (recording.samples.stamp[rows] - start * 10**9) * 1e-9
        truth = flown.at(time)
        found = recording.samples.values[rows, : len(names)]
        np.testing.assert_allclose(found, np.stack([truth[n] for n in names], axis=1), atol=places, err_msg=kind.name)


def with_all(text):
    """The MAP with its undecided lines as they stand."""
    return re.sub(r"(?m)^( +)# (\w[\w.]*: \{(?:column|expression))", r"\1\2", text)


@pytest.mark.long
def test_a_structure_for_each_signal_needs_one_correction(flown, tmp_path, capsys):
    source = business_jet(flown, tmp_path)
    said, out = guessed(source, tmp_path, capsys)
    assert said["specific_force.z"][:2] == ("sure", -1) and said["pressure_altitude"][2] == "Dadc1_alt"
    undecided = {signal for signal, (certainty, *_) in said.items() if certainty == "undecided"}
    assert undecided <= {"specific_force.y"} and len(said) == 17
    assert "elevator_dte" in out.split("no signal by their names: ")[1]
    trim = "      inputs.elevator_trim: {column: elevator_dte, unit: deg}\n      # no signal"
    text = with_all((tmp_path / "map.yaml").read_text()).replace("      # no signal", trim)
    recording, out = imported(source, tmp_path, text, capsys)
    check_samples(recording, flown, 946_684_809)
    attitude = recording.samples.values[recording.samples.kind == Kind.ATTITUDE, :4]
    time = (recording.samples.stamp[recording.samples.kind == Kind.ATTITUDE] - 946_684_809 * 10**9) * 1e-9
    roll, pitch, yaw = np.array([euler_from_quaternion(q) for q in attitude]).T
    truth = flown.at(time)
    np.testing.assert_allclose(roll, truth["phi"], atol=1e-6)
    np.testing.assert_allclose(pitch, truth["theta"], atol=1e-6)
    np.testing.assert_allclose(np.exp(1j * yaw), np.exp(1j * truth["psi"]), atol=1e-6)
    # latitude and longitude without an altitude, once a second
    assert "the positions have the pressure_altitude in its place" in out
    assert np.sum(recording.samples.kind == Kind.GPS_POSITION) == pytest.approx(flown.end, abs=2)
    assert recording.unnamed == ("elevator_trim",)


@pytest.mark.long
def test_accelerations_without_gravity_become_forces_by_the_expressions_of_the_docs(flown, tmp_path, capsys):
    source = business_jet(flown, tmp_path, gravity=False)
    said, out = guessed(source, tmp_path, capsys)
    assert [said[f"specific_force.{a}"][0] for a in "xyz"] == ["undecided"] * 3
    assert "which is not gravity: an acceleration without it?" in out
    docs = (Path(__file__).parents[2] / "docs" / "import.md").read_text()
    lines = re.findall(r"(?m)^ +specific_force\.[xyz]: \{expression: .*radians.*$", docs)
    assert len(lines) == 3
    named = "\n".join(lines)
    for name, column in (("roll", "Ahrs1_Roll"), ("pitch", "Ahrs1_Pitch"), ("ax", "Ahrs1_bLongAcc")):
        named = re.sub(rf"\b{name}\b", column, named)
    named = re.sub(r"\bay\b", "Ahrs1_bLatAcc", re.sub(r"\baz\b", "-Ahrs1_bNormAcc", named))
    text = (tmp_path / "map.yaml").read_text().replace("    signals:\n", f"    signals:\n{named}\n")
    recording, _ = imported(source, tmp_path, text, capsys)
    check_samples(recording, flown, 946_684_809)


def test_the_same_structure_of_matlab_7_3(flown, tmp_path, capsys):
    """Texts are numbers of characters there, and columns are stored as rows."""
    from scipy.io import loadmat

    content = loadmat(business_jet(flown, tmp_path), squeeze_me=True, struct_as_record=False)["flightdata"]
    path = tmp_path / "seven.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name in content._fieldnames:
            channel, group = getattr(content, name), file.require_group(f"flightdata/{name}")
            group.create_dataset("data", data=np.atleast_2d(channel.data)).attrs["MATLAB_class"] = np.bytes_("double")
            for key in ("units", "description"):
                text = np.array([[ord(c)] for c in getattr(channel, key)], np.uint16)
                group.create_dataset(key, data=text).attrs["MATLAB_class"] = np.bytes_("char")
    said, _ = guessed(path, tmp_path, capsys)
    assert len(said) == 17 and said["specific_force.z"][:2] == ("sure", -1)


@pytest.mark.long
def test_columns_without_names_whose_time_restarts_are_manoeuvres(flown, tmp_path, capsys, aircraft_file):
    source = ascii_manoeuvres(flown, tmp_path, starts=[4.0, 20.0, 36.0, 52.0, 68.0, 84.0])
    said, out = guessed(source, tmp_path, capsys)
    assert all(certainty != "undecided" for certainty, *_ in said.values()) and len(said) == 17
    assert "the columns of fAttas01.asc are named by fAttas01_names.txt" in out
    text = (tmp_path / "map.yaml").read_text()
    assert "restarts: true" in text and "it starts over 5 times" in text
    recording, out = imported(source, tmp_path, text, capsys)
    assert "6 manoeuvres, each 10 s after the one before" in out
    segments = yaml.safe_load((tmp_path / "bag.segments.yaml").read_text())
    assert [s["start"] for s in segments] == pytest.approx([19.96 * i for i in range(6)], abs=2e-3)
    imu = recording.samples[recording.samples.kind == Kind.IMU]
    for number in range(6):
        part = imu.values[250 * number : 250 * (number + 1)]
        truth = flown.at(4.0 + 16.0 * number + np.arange(250) / 25.0)
        np.testing.assert_allclose(part[:, 3], truth["p"], atol=1e-6)
    run = ["replay", tmp_path / "bag", "--aircraft", aircraft_file, "--out", tmp_path / "run"]
    assert main([str(word) for word in [*run, "--segments", tmp_path / "bag.segments.yaml"]]) == 0
    said = capsys.readouterr().out
    assert "59.8 s of flight" in said and re.search(r"(?m)^Cl_p +-0\.4.* USE", said)


def test_a_time_that_goes_back_without_a_word_is_refused_with_the_way_out(flown, tmp_path, capsys):
    source = ascii_manoeuvres(flown, tmp_path, starts=[4.0, 20.0])
    guessed(source, tmp_path, capsys)
    (tmp_path / "map.yaml").write_text((tmp_path / "map.yaml").read_text().replace(", restarts: true", ""))
    command = ["import", source, "--map", tmp_path / "map.yaml", "--out", tmp_path / "bag"]
    assert main([str(word) for word in command]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "goes back by 9.96 s at data row 251" in line and "restarts: true" in line
    (tmp_path / "fAttas01_names.txt").unlink()
    (tmp_path / "map.yaml").unlink()
    _, out = guessed(source, tmp_path, capsys)
    assert "have no names, their numbers stand for them: list the names, one a line, in a text file beside it" in out


@pytest.mark.long
def test_a_sheet_for_each_manoeuvre_is_one_body_of_data(flown, tmp_path, capsys):
    starts = [4.0 + 8.0 * i for i in range(11)]
    said, _ = guessed(sheet_per_manoeuvre(flown, tmp_path, starts), tmp_path, capsys)
    assert all(certainty != "undecided" for certainty, *_ in said.values()) and len(said) == 16
    text = (tmp_path / "map.yaml").read_text()
    assert 'file: "Man *"' in text and "restarts: true" in text and text.count("time:") == 1
    recording, out = imported(tmp_path / "Flight 13.xlsx", tmp_path, text, capsys)
    assert "11 manoeuvres, each 10 s after the one before" in out
    segments = yaml.safe_load((tmp_path / "bag.segments.yaml").read_text())
    lengths = [s["stop"] - s["start"] for s in segments]
    assert lengths == pytest.approx([8.96 + i for i in range(11)], abs=2e-3)  # the second before the tenth
    imu = recording.samples[recording.samples.kind == Kind.IMU]
    truth = flown.at(starts[1] + np.arange(250) / 25.0)
    np.testing.assert_allclose(imu.values[225 : 225 + 250, 3], truth["p"], atol=1e-6)


def test_a_file_for_each_manoeuvre_whose_clock_goes_on(flown, tmp_path, capsys):
    folder = tmp_path / "flight"
    folder.mkdir()
    file_per_manoeuvre(flown, folder, starts=[4.0 + 8.0 * i for i in range(11)])
    said, _ = guessed(folder, tmp_path, capsys)
    assert len(said) == 16 and 'file: "run*.csv"' in (tmp_path / "map.yaml").read_text()
    recording, _ = imported(folder, tmp_path, (tmp_path / "map.yaml").read_text(), capsys)
    imu = recording.samples[recording.samples.kind == Kind.IMU]
    time = (imu.stamp - imu.stamp[0]) * 1e-9
    np.testing.assert_allclose(time, np.arange(11 * 200) / 25.0, atol=1e-6)
    np.testing.assert_allclose(imu.values[:, 3], flown.at(4.0 + time)["p"], atol=1e-6)


def test_two_recorders_of_one_flight_are_no_manoeuvres(flown, tmp_path, capsys):
    """They have the same columns and both begin at time 0."""
    folder, rng = tmp_path / "flight", np.random.default_rng(3)
    folder.mkdir()
    for name in ("ins_a.csv", "ins_b.csv"):
        columns = manoeuvre_columns(flown, np.arange(0.0, 60.0, 0.04), start=4.0)
        content = np.stack(list(columns.values()), axis=1)
        content[:, 1:] *= 1.0 + 0.01 * rng.standard_normal(content[:, 1:].shape)
        np.savetxt(folder / name, content, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    guessed(folder, tmp_path, capsys)
    text = (tmp_path / "map.yaml").read_text()
    assert "ins_*" not in text and "restarts" not in text and 'file: "ins_a.csv"' in text


def test_rows_in_the_wrong_order_are_no_manoeuvres(flown, tmp_path, capsys):
    source, columns = tmp_path / "backwards.csv", manoeuvre_columns(flown, np.arange(0.0, 20.0, 0.04), start=4.0)
    content = np.stack(list(columns.values()), axis=1)[::-1]
    np.savetxt(source, content, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    text = 'tables:\n  - time: {column: "Time [s]", unit: s, restarts: true}\n    signals:\n'
    (tmp_path / "map.yaml").write_text(text + '      angular_velocity.x: {column: "p [deg/s]", unit: deg/s}\n')
    command = ["import", source, "--map", tmp_path / "map.yaml", "--out", tmp_path / "bag"]
    assert main([str(word) for word in command]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "'Time [s]' goes back after 1 row, and restarts: true takes that for a manoeuvre: sort the rows" in line
    assert not (tmp_path / "bag").exists()


def test_a_clock_that_shows_the_second_of_the_minute_is_no_row_of_manoeuvres(flown, tmp_path, capsys):
    """Each minute would come 10 s after the one before."""
    source, time = tmp_path / "clock.csv", np.arange(0.0, 95.0, 0.05)
    c = flown.at(time)
    columns = np.stack([np.round(time % 60.0, 2), c["fx"], c["fy"], c["fz"]], axis=1)
    np.savetxt(source, columns, fmt="%.9g", delimiter=",", header="sec,ax,ay,az", comments="")
    assert main(["import", str(source), "--guess", str(tmp_path / "map.yaml")]) == 2
    said = capsys.readouterr().err
    assert "its column 'sec' goes back at data row 1201" in said and "restarts: true" in said


@pytest.mark.long
def test_semicolons_decimal_commas_and_a_zone_need_no_correction(flown, tmp_path, capsys):
    source = semicolons(flown, tmp_path)
    said, _ = guessed(source, tmp_path, capsys)
    assert all(certainty != "undecided" for certainty, *_ in said.values()) and len(said) == 23
    assert said["velocity.down"][1] == -1 and said["elevator"][2] == "Höhenruder"
    recording, out = imported(source, tmp_path, (tmp_path / "map.yaml").read_text(), capsys)
    check_samples(recording, flown, 1_717_157_100, places=1e-4)  # 12:05 UTC; times of day in ms
    # GPS of 5 Hz on a grid of 20 Hz: what was interpolated is left out
    assert "velocity: its rows lie on straight lines between one of 4 and the next" in out
    assert np.sum(recording.samples.kind == Kind.GPS_VELOCITY) == pytest.approx(5.0 * flown.end, rel=0.02)


@pytest.mark.long
def test_sheets_with_clocks_of_their_own_are_told_apart_and_put_together_by_their_offsets(flown, tmp_path, capsys):
    source = sheets(flown, tmp_path, 40.0)
    said, out = guessed(source, tmp_path, capsys)
    assert len(re.findall("does not overlap with that of", out)) == 4
    assert said["attitude.pitch"][0] == said["elevator"][0] == "undecided"  # nothing is compared between clocks
    text = with_all((tmp_path / "map.yaml").read_text())
    text = re.sub("# clock: .*", "clock: 2024-05-31T14:00:00Z", text)
    command = ["import", source, "--map", tmp_path / "map.yaml", "--out", tmp_path / "bag"]
    (tmp_path / "map.yaml").write_text(text)
    assert main([str(word) for word in command]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.endswith("of the map are 6 days apart: set 'clock', or the 'offset' of one of their times")
    assert not (tmp_path / "bag").exists()
    for time, offset in (("unit: ms", -5000), ('"tow [s]", unit: s', -482382), ('"time [s]", unit: s', 0.4)):
        text = text.replace(time + "}", f"{time}, offset: {offset}}}")
    recording, _ = imported(source, tmp_path, text, capsys)
    check_samples(recording, flown, 1_717_164_000, places=0.03)  # air data are stamped in ms
