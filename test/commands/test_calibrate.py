"""``calibrate`` as users meet it: files that replay takes, and one line for what is wrong."""

import json

import pytest
import yaml

from aircraft_sysid_ros.after_flight.calibrate import sections_kept
from aircraft_sysid_ros.calibration import compatibility
from aircraft_sysid_ros.calibration.calibration_file import AIR_DATA_ERRORS, calibration_from_dict, load_calibration
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


@pytest.mark.long
def test_simulate_writes_the_truth_of_the_instruments(bag):
    document, _ = load_truth(bag)
    assert document["manoeuvres"] == "calibration"
    assert set(document["calibration"]) == {"five_hole_probe", "magnetometer", "compatibility"}


@pytest.mark.long
def test_five_hole_writes_file_result_and_pictures(bag, tmp_path, pictures, capsys):
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
    assert [m["used"] for m in printed["models"]] == [True, False, False] and "linear curve, steady wind" in shown
    join(bag, out, tmp_path)
    replay_with_states(bag, out, truth, tmp_path, capsys)


def join(bag, probe, tmp_path):
    """A second calibration keeps what the file holds already."""
    out = tmp_path / "both"
    more = ["--calibration", str(probe / "calibration.yaml"), "--out", str(out), "--samples", "32"]
    assert main(["calibrate", "magnetometer", bag, "--aircraft", AIRCRAFT, *more]) == 0
    content = yaml.safe_load((out / "calibration.yaml").read_text())
    assert {"five_hole_probe", "magnetometer", "source"} == set(content)


def replay_with_states(bag, probe, truth, tmp_path, capsys):
    """Errors of the air data as states: started by the calibration they stay near zero; by stage 1 they are found."""
    started = ["--calibration", str(probe / "calibration.yaml"), "--air-data-errors"]
    found = replayed(bag, tmp_path / "known", *started)["air_data_errors"]
    assert set(found) == {"lambda_V", "b_V", "lambda_alpha", "b_alpha", "lambda_beta", "b_beta"}
    assert abs(found["lambda_V"]["value"]) < 0.01 and found["lambda_V"]["std"] < 0.01
    nominal = tmp_path / "nominal.yaml"
    nominal.write_text("five_hole_probe: {alpha_sensitivity: 3.9, beta_sensitivity: 3.9}")
    options = ["--calibration", str(nominal), "--air-data-errors", "--stage-1", "60"]
    found = replayed(bag, tmp_path / "stage-1", *options)["air_data_errors"]
    assert abs(found["lambda_V"]["value"] - truth["lambda_V"]) < max(4.0 * found["lambda_V"]["std"], 0.02)
    capsys.readouterr()
    for options, words in (
        (["--stage-1", "60"], "give that too"), (["--air-data-errors", "--smooth"], "leave one of them out"),
        (["--air-data-errors", "--stage-1", "5"], "between 30 and 600 s"),
    ):  # fmt: skip
        assert main(["replay", bag, "--aircraft", AIRCRAFT, "--out", str(tmp_path / "no"), *options]) == 2
        assert words in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def replayed(bag, out, *options):
    assert main(["replay", bag, "--aircraft", AIRCRAFT, "--out", str(out), *options]) == 0
    return json.loads((out / "state.json").read_text())


def says(capsys, *arguments):
    """Status 2 and the one line on standard error."""
    capsys.readouterr()
    assert main(["calibrate", *map(str, arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


def test_errors_of_other_air_data_are_not_applied_to_a_probe():
    """What compatibility has found of air_data, or of the probe by an earlier calibration, was applied to the new one
    as well; biases of the IMU and errors of the attitude hold as before.
    """
    names = (*compatibility.NAMES1, *compatibility.NAMES2)
    section = {**dict.fromkeys(names, 0.01), "std": dict.fromkeys(names, 0.001)}
    before = calibration_from_dict({"compatibility": section})
    kept, notes = sections_kept(before, "five-hole")
    assert kept["compatibility"] == {
        **{name: 0.0 if name in AIR_DATA_ERRORS else 0.01 for name in names},
        "std": {name: None if name in AIR_DATA_ERRORS else 0.001 for name in names},
    }
    assert "compatibility" in notes[0] and calibration_from_dict(kept)
    assert sections_kept(before, "magnetometer") == ({"compatibility": section}, [])


@pytest.mark.long
def test_bad_input_is_one_sentence(bag, tmp_path, capsys):
    probe = ["five-hole", bag, "--aircraft", AIRCRAFT]
    assert "needs --aircraft" in says(capsys, "five-hole", bag)
    assert "--to must be later than --from: 10 s is not after 20 s" in says(
        capsys, *probe, "--from", "20", "--to", "10"
    )
    assert "--from must be zero or more" in says(capsys, *probe, "--from", "-1")
    assert "--samples" in says(capsys, *probe, "--samples", "0")
    assert "--seed" in says(capsys, *probe, "--seed", "-1")
    assert "--sensitivity" in says(capsys, *probe, "--sensitivity", "0", "4")
    assert "--field-strength" in says(capsys, "magnetometer", bag, "--field-strength", "nan")
    assert "30 s" in says(capsys, *probe, "--from", "10", "--to", "25")
    assert "cannot read the calibration file" in says(capsys, *probe, "--calibration", tmp_path / "none.yaml")
    (tmp_path / "file").write_text("")
    assert "must be a folder" in says(capsys, *probe, "--out", tmp_path / "file")
    assert "for the five-hole probe" in says(capsys, "magnetometer", bag, "--curve", "cubic")
    assert "not a folder that can be written" in says(capsys, *probe, "--out", tmp_path / "file" / "sub")
    scaled = yaml.safe_load(config_path(CALIBRATION_AIRCRAFT).read_text())
    for sensor, key, value in (
        ("airspeed", "scale", 0.9),
        ("angle_of_attack", "offset", 0.1),
        ("sideslip", "drift", 0.001),
    ):
        content = {**scaled, "sensors": {**scaled.get("sensors", {}), sensor: {"noise": 0.3, key: value}}}
        (tmp_path / "scaled.yaml").write_text(yaml.safe_dump(content))
        said = says(capsys, "five-hole", bag, "--aircraft", tmp_path / "scaled.yaml")
        assert f"{key} of {value:g} for {sensor}, which would come on top of this calibration" in said
    assert "choose from" in _usage(capsys, "gyro", bag)


def _usage(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(["calibrate", *arguments])
    assert stop.value.code == 2
    return capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize("place", ["main.build_parser", "calibrate.calibrate"])
def test_ctrl_c_leaves_nothing(bag, tmp_path, capsys, monkeypatch, place):
    """While modules are imported, and in the middle of the work."""

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"aircraft_sysid_ros.commands.{place}", interrupt)
    arguments = ["calibrate", "five-hole", bag, "--aircraft", AIRCRAFT, "--out", str(tmp_path / "probe")]
    assert main(arguments) == 130
    assert capsys.readouterr().err.endswith(": stopped\n") and not list(tmp_path.iterdir())


def test_a_recording_without_the_topic(tmp_path, capsys):
    path = tmp_path / "plain"
    assert main(["simulate", "--out", str(path), "--duration", "20"]) == 0
    assert "lacks /five_hole_probe" in says(capsys, "five-hole", path, "--aircraft", AIRCRAFT)
    assert "lacks /imu/mag" in says(capsys, "magnetometer", path)
