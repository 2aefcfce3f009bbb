"""``calibrate`` as users meet it: files that replay takes, and one line for what is wrong."""

import json

import pytest
import yaml

from aircraft_sysid_ros.calibration.calibration_file import load_calibration
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.simulation.calibration_flight import CALIBRATION_AIRCRAFT
from aircraft_sysid_ros.simulation.truth_files import load_truth

AIRCRAFT = str(config_path(CALIBRATION_AIRCRAFT))


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("calibrate") / "flight"
    options = ["--manoeuvres", "calibration", "--seed", "5", "--duration", "150"]
    assert main(["simulate", *options, "--out", str(path)]) == 0
    return str(path)


def test_simulate_writes_the_truth_of_the_instruments(bag):
    document, _ = load_truth(bag)
    assert document["manoeuvres"] == "calibration"
    assert set(document["calibration"]) == {"five_hole_probe", "magnetometer", "compatibility"}


def test_five_hole_writes_file_result_and_pictures(bag, tmp_path, capsys):
    capsys.readouterr()
    out = tmp_path / "probe"
    arguments = ["calibrate", "five-hole", bag, "--aircraft", AIRCRAFT, "--out", str(out), "--samples", "64", "--json"]
    assert main(arguments) == 0
    printed = json.loads(capsys.readouterr().out)
    truth = load_truth(bag)[0]["calibration"]["five_hole_probe"]
    found = {p["name"]: p for p in printed["parameters"]}
    assert all(abs(found[name]["value"] - value) < 5.0 * found[name]["std"] for name, value in truth.items())
    assert printed["residuals"]["V_E"]["after"] < 0.2 < printed["residuals"]["V_E"]["before"]
    calibration = load_calibration(out / "calibration.yaml")
    assert calibration.five_hole_probe["lambda_V"] == found["lambda_V"]["value"]
    assert len(printed["files"]) == 4 and all((out / name).stat().st_size > 100 for name in printed["files"])
    assert not list(out.glob(".*"))
    from aircraft_sysid_ros.commands import calibrate

    shown = calibrate.render(printed)
    assert "lambda_alpha" in shown and "calibration.yaml" in shown and "stage 1" in shown
    assert "holds a calibration already" in says(capsys, *arguments[1:])
    join(bag, out, tmp_path)


def join(bag, probe, tmp_path):
    """A second calibration keeps what the file holds already."""
    out = tmp_path / "both"
    more = ["--calibration", str(probe / "calibration.yaml"), "--out", str(out), "--samples", "32"]
    assert main(["calibrate", "magnetometer", bag, "--aircraft", AIRCRAFT, *more]) == 0
    content = yaml.safe_load((out / "calibration.yaml").read_text())
    assert {"five_hole_probe", "magnetometer", "source"} == set(content)


def says(capsys, *arguments):
    """Status 2 and the one line on standard error."""
    capsys.readouterr()
    assert main(["calibrate", *map(str, arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


def test_bad_input_is_one_sentence(bag, tmp_path, capsys):
    probe = ["five-hole", bag, "--aircraft", AIRCRAFT]
    assert "needs --aircraft" in says(capsys, "five-hole", bag)
    assert "must rise" in says(capsys, *probe, "--from", "20", "--to", "10")
    assert "--samples" in says(capsys, *probe, "--samples", "0")
    assert "--seed" in says(capsys, *probe, "--seed", "-1")
    assert "--sensitivity" in says(capsys, *probe, "--sensitivity", "0", "4")
    assert "--field-strength" in says(capsys, "magnetometer", bag, "--field-strength", "nan")
    assert "30 s" in says(capsys, *probe, "--from", "10", "--to", "25")
    assert "cannot read the calibration file" in says(capsys, *probe, "--calibration", tmp_path / "none.yaml")
    (tmp_path / "file").write_text("")
    assert "must be a folder" in says(capsys, *probe, "--out", tmp_path / "file")
    assert "choose from" in _usage(capsys, "gyro", bag)


def _usage(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(["calibrate", *arguments])
    assert stop.value.code == 2
    return capsys.readouterr().err


def test_a_recording_without_the_topic(tmp_path, capsys):
    path = tmp_path / "plain"
    assert main(["simulate", "--out", str(path), "--duration", "20"]) == 0
    assert "lacks /five_hole_probe" in says(capsys, "five-hole", path, "--aircraft", AIRCRAFT)
    assert "lacks /imu/mag" in says(capsys, "magnetometer", path)
