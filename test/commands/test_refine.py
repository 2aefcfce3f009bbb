"""``refine`` as users meet it: a run from replay, files, one line for what is wrong."""

import json
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight.refine import refined_sentences
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.commands.refine import render
from aircraft_sysid_ros.refinement.refine import worse_axes
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight


@pytest.fixture(scope="module")
def run(tmp_path_factory, aircraft, aircraft_file):
    folder = tmp_path_factory.mktemp("refine")
    write_flight(simulate_samples(aircraft, seed=6, duration=25.0), folder / "flight", overwrite=False)
    assert main(["replay", str(folder / "flight"), "--aircraft", str(aircraft_file), "--out", str(folder / "run")]) == 0
    return folder / "run"


@pytest.mark.long
def test_a_run_holds_its_samples(run, aircraft):
    from aircraft_sysid_ros.recordings.reader import read_recording

    samples = read_recording(run.parent / "flight").samples
    with np.load(run / "samples.npz") as stored:
        np.testing.assert_array_equal(stored["stamp"], samples.stamp)
        np.testing.assert_array_equal(stored["kind"], samples.kind)
        np.testing.assert_array_equal(stored["values"], samples.values)


@pytest.mark.long
def test_refine_writes_file_and_figure(run, pictures, capsys, monkeypatch):
    capsys.readouterr()
    monkeypatch.setattr("aircraft_sysid_ros.commands.progress.TOLD_EVERY", 0.0)
    assert main(["refine", str(run), "--method", "output-error", "--segment", "6", "--json"]) == 0
    said = capsys.readouterr()
    printed = json.loads(said.out)
    shares = [float(line.rpartition(" ")[0].rpartition(" ")[2]) for line in said.err.splitlines() if "%" in line]
    assert shares == sorted(shares) and len({*shares}) > 2  # how far it is, without a terminal
    stored = json.loads((run / "refined-output-error.json").read_text())
    assert {k: v for k, v in printed.items() if k not in ("file", "figure", "notes")} == stored
    assert stored["method"] == "output-error" and len(stored["parameters"]) == 32
    assert (run / "refined-output-error.png").stat().st_size > 10_000
    assert not list(run.glob(".*"))  # no leftovers of writing at once
    from aircraft_sysid_ros.commands import refine

    shown = refine.render(printed)
    assert "CZ_alpha" in shown and printed["file"] in shown and "that were not fitted" in shown
    assert shown.startswith(f"refined: model {printed['model']}, the current version\n")
    assert printed["worse"] == [] and "WORSE" not in shown
    errors = printed["not_fitted"]
    errors["Cl"]["nrmse"] = 2.0 * errors["Cl"]["nrmse_before"]  # a model that lacks something
    printed["worse"] = worse_axes(errors)
    assert printed["worse"] == ["Cl"] and "C_l predicted worse" in refine.render(printed)


def test_what_both_methods_say_differently_is_not_to_be_used_of_either():
    parameters = [
        {"name": "Cm_q", "status": "HOLD", "reason": "equation error of the same flight says -4.2"},
        {"name": "Cm_de", "status": "USE", "reason": ""},
        {"name": "CZ_q", "status": "HOLD", "reason": "equation error of the same flight says 4.2"},
        {"name": "CX_0", "status": "HOLD", "reason": "equation error of the same flight says: it lacks something"},
    ]
    result = {"converged": True, "iterations": 3, "seconds_fitted": 60.0, "elapsed": 2.0, "worse": []}
    _, sentence = refined_sentences({**result, "parameters": parameters})
    assert sentence.startswith("Cm_q and CZ_q of the run do not agree with") and "use neither" in sentence
    assert "`export` and `gains` take those of the run with HOLD" in sentence
    assert len(refined_sentences({**result, "parameters": parameters[1:2]})) == 1


def ask(capsys, *arguments):
    """The document that a command prints."""
    capsys.readouterr()
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.long
def test_what_was_added_is_refined_and_said_to_be(tmp_path, aircraft_file, capsys):
    """Simulate with an effect, replay, add, refine: the current version is refined, another one on request."""
    flight, run = tmp_path / "flight", tmp_path / "run"
    ask(capsys, "simulate", "--out", flight, "--effect", "CZ: alpha**3 = 60", "--duration", 30, "--seed", 6)
    first = ask(capsys, "replay", flight, "--aircraft", aircraft_file, "--out", run)["parameters"]["model"]
    added = ask(capsys, "add", run, "CZ: alpha**3")
    arguments = ("refine", run, "--method", "output-error", "--segment", 8)
    refined = ask(capsys, *arguments)
    assert (refined["model"], refined["changes"], refined["is_current"]) == (added["model"], ["CZ: alpha**3"], True)
    (term,) = (p for p in refined["parameters"] if p["name"] == "CZ_alpha3")
    assert abs(term["value"] - 60.0) < 4.0 * term["std"] < 0.4 * 60.0 and term["status"] == "USE"
    (start,) = (p for p in added["parameters"] if p["name"] == "CZ_alpha3")
    assert term["value"] != start["value"]  # it was moved
    assert Path(refined["file"]).parent == run / "models" / added["model"]
    other = ask(capsys, *arguments, "--model", first)
    assert (other["model"], other["changes"], other["is_current"]) == (first, [], False)
    assert len(other["parameters"]) == 32 and Path(other["file"]).parent == run
    assert other["not_fitted"]["CZ"]["nrmse"] > 2.0 * refined["not_fitted"]["CZ"]["nrmse"]
    of_lift = [p for p in other["parameters"] if p["name"].startswith("CZ")]  # of a model that lacks a term in it
    assert {p["status"] for p in of_lift} == {"HOLD"} and all("CZ" in p["reason"] for p in of_lift)
    from aircraft_sysid_ros.commands import refine

    assert refine.render(refined).startswith(f"refined: model {added['model']}, the current version with CZ: alpha")
    assert f"model {first}, not the current version\n" in refine.render(other)
    assert f"has no model 'cafe': it has {first} {added['model']}\n" in says(capsys, run, "--model", "cafe")


def says(capsys, *arguments):
    """Status 2 and the one line on standard error."""
    capsys.readouterr()
    assert main(["refine", *map(str, arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


def test_bad_input_is_one_sentence(run, tmp_path, capsys):
    assert "is not a run" in says(capsys, tmp_path)
    assert "--segment" in says(capsys, run, "--segment", "0")
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("parameters.json", "state.json", "aircraft.yaml", "points.npz"):
        (copy / name).write_bytes((run / name).read_bytes())
    assert "holds no samples" in says(capsys, copy)
    (copy / "samples.npz").write_bytes(b"nothing")
    assert "damaged" in says(capsys, copy)
    assert not list(copy.glob("refined*"))


def test_biases_and_levels_have_units():
    """A bias was 0.1600, and nobody knew of what."""
    item = {"value": 0.16, "std": 0.0046}
    biases = [{"name": f"{name}_x", **item} for name in ("accelerometer_bias", "gyro_bias")]
    result = {"is_current": True, "changes": [], "model": "a", "parameters": [], "not_fitted": {}, "file": "f"}
    result |= {"biases": biases, "process_noise": [{"name": "rates", **item}], "converged": True, "reason": ""}
    result |= {"iterations": 4, "seconds_fitted": 99.0, "elapsed": 1.0, "figure": None, "notes": [], "worse": []}
    lines = [line.split("  ")[0] for line in render(result).splitlines() if "0.0046" in line]
    assert lines == ["accelerometer_bias_x [m/s²]", "gyro_bias_x [rad/s]", "process noise: rates [rad/s per √s]"]
