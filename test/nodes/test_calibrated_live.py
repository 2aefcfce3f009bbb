"""With a calibration file live and replay correct the same samples in the same way, to the last bit."""

import json
import time

import pytest
import yaml
from processes import live, play
from test_live_equals_replay import check_same
from waiting import LONGEST, finish

from aircraft_sysid_ros.after_flight.calibrate import _flight
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.flight_journal import RECORD, RECORDS
from aircraft_sysid_ros.run_reader import correction_of, journal_path, read_samples
from aircraft_sysid_ros.simulation.calibration_flight import CALIBRATION_AIRCRAFT, calibration_flight
from aircraft_sysid_ros.simulation.truth_files import write_flight

HORIZON = 4.0
AIRCRAFT = config_path(CALIBRATION_AIRCRAFT)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A recording whose air data, pressures and field are all wrong, and the file that says how."""
    folder = tmp_path_factory.mktemp("calibrated")
    flight = calibration_flight(4, 40.0)
    write_flight(flight, folder / "flight")
    content = {
        "five_hole_probe": {"alpha_sensitivity": 3.9, "beta_sensitivity": 3.9, **flight.calibration["five_hole_probe"]},
        "magnetometer": flight.calibration["magnetometer"],
    }
    (folder / "calibration.yaml").write_text(yaml.safe_dump(content))
    return folder, flight


def replayed(flown, out, *more):
    folder, _ = flown
    arguments = ["replay", folder / "flight", "--aircraft", AIRCRAFT, "--out", out, "--horizon", HORIZON, *more]
    assert main([*map(str, arguments)]) == 0
    return json.loads((out / "state.json").read_text())


@pytest.mark.long
def test_the_first_step_is_right_with_a_calibration_and_wrong_without(flown, tmp_path):
    wind = flown[1].truth.wind[-1]
    right = replayed(flown, tmp_path / "right", "--calibration", flown[0] / "calibration.yaml")["wind_ned"]
    wrong = replayed(flown, tmp_path / "wrong")["wind_ned"]
    assert max(abs(a - b) for a, b in zip(right, wind, strict=True)) < 0.4
    assert max(abs(a - b) for a, b in zip(wrong, wind, strict=True)) > 0.8


@pytest.mark.long
def test_who_calibrates_a_run_that_was_corrected_is_told(flown, tmp_path):
    """The new file alone leaves in what the first one corrected."""
    corrected = replayed(flown, tmp_path / "right", "--calibration", flown[0] / "calibration.yaml")
    (told,) = [note for note in corrected["notes"] if str(flown[0]) in note]
    assert "adds to it" in told
    assert _flight(str(tmp_path / "right"), ())[1] == [told]
    assert _flight(str(flown[0] / "flight"), ())[1] == []
    (tmp_path / "right" / "state.json").write_text("{")  # a damaged file is said where it is needed
    assert correction_of(tmp_path / "right") == ""


@pytest.mark.long
def test_a_flight_that_was_cut_off_is_recovered_with_its_calibration(flown, tmp_path, domain, capsys):
    """The filter began without what the file says of the air data, and nothing said that samples were corrected."""
    states = ("--calibration", flown[0] / "calibration.yaml", "--air-data-errors")
    right = replayed(flown, tmp_path / "right", *states)
    with live(tmp_path / "run", AIRCRAFT, "--reliable", "--horizon", HORIZON, *states) as process:
        play(flown[0] / "flight", 8)
        deadline, kept = time.monotonic() + LONGEST, 0
        while kept < len(read_samples(tmp_path / "right")):
            assert time.monotonic() < deadline, f"{kept} samples are on disk"
            time.sleep(0.1)
            kept = (journal_path(tmp_path / "run") / RECORDS).stat().st_size // RECORD.itemsize
        process.kill()
        finish(process)
    assert main(["recover", str(tmp_path / "run")]) == 0
    found = json.loads((tmp_path / "run" / "state.json").read_text())
    assert found["corrected_by"] == right["corrected_by"] == str(flown[0] / "calibration.yaml")
    assert found["air_data_errors"] == right["air_data_errors"] and found["wind_ned"] == right["wind_ned"]


@pytest.mark.long
def test_live_is_replay_with_a_calibration(domain, flown, tmp_path):
    """With errors of the air data as states, too, which the calibration starts."""
    states = ("--calibration", flown[0] / "calibration.yaml", "--air-data-errors")
    assert replayed(flown, tmp_path / "replayed", *states)["air_data_errors"]["lambda_V"]["std"] < 0.2
    options = ("--reliable", "--until-idle", 1.5, "--horizon", HORIZON, *states)
    with live(tmp_path / "run", AIRCRAFT, *options) as process:
        sent = play(flown[0] / "flight", 8)
        check_same(process, tmp_path / "run", tmp_path / "replayed", heard(sent["messages"]))


def heard(messages):
    """Topics that some node listens to."""
    return {topic: count for topic, count in messages.items() if topic != "/height_above_ground"}


def test_a_bad_file_stops_both_with_one_sentence(flown, tmp_path, capsys):
    bad = tmp_path / "bad.yaml"
    bad.write_text("magnetometer: {lambda_x: -2}")
    for command in (["replay", str(flown[0] / "flight")], ["live"]):
        capsys.readouterr()
        arguments = [*command, "--aircraft", str(AIRCRAFT), "--out", str(tmp_path / "no"), "--calibration", str(bad)]
        assert main(arguments) == 2
        assert "lambda_x must be more than" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()
