"""Several runs of one aeroplane as one body of evidence, and what changed between them."""

import contextlib
import io
import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.several_runs import join_runs
from aircraft_sysid_ros.diagnosis.two_runs import _predicted, holm
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.run_reader import DIAGNOSIS, read_samples
from aircraft_sysid_ros.samples import (
    Kind,
    joined,
    manoeuvre_at,
    manoeuvres,
    run_of_manoeuvres,
    samples_of,
    with_run_numbers,
)

#: The third aeroplane weighs so much of what its file says.
HEAVIER = 1.12
DURATION = 45.0


def ask(*words) -> dict:
    """The JSON that a command answers."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        assert main([*map(str, words), "--json"]) == 0
    return json.loads(said.getvalue())


def refused(capsys, *words) -> str:
    """The sentence with which a command refuses, with the status 2."""
    capsys.readouterr()  # what a slow fixture has said
    assert main([*map(str, words)]) == 2
    said = capsys.readouterr().err.strip()
    assert said.count("\n") == 0 and "Traceback" not in said
    return said


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("several")


@pytest.fixture(scope="module")
def runs(aircraft_file, folder):
    """Flights on three mornings and one with a load, all replayed with the same file."""
    file = yaml.safe_load(aircraft_file.read_text())
    (folder / "loaded.yaml").write_text(yaml.safe_dump({**file, "mass": HEAVIER * file["mass"]}))
    made = {}
    for seed, name in enumerate(("monday", "tuesday", "wednesday", "loaded"), 301):
        flown = folder / "loaded.yaml" if name == "loaded" else aircraft_file
        ask("simulate", "--out", folder / f"{name}_bag", "--aircraft", flown, "--seed", seed, "--duration", DURATION)
        made[name] = folder / name
        ask("replay", folder / f"{name}_bag", "--aircraft", aircraft_file, "--out", made[name])
    return made


@pytest.mark.long
def test_a_load_in_the_second_flight_is_named_with_its_flight(runs):
    body = join_runs([runs["monday"], runs["loaded"]])
    library = [BY_ID[name] for name in ("mass_change", "cg_shift", "parameter_change")]
    found = diagnose_flight(body.aircraft, body.samples, library, replicas=2, names=body.manoeuvres, runs=body.names)
    assert [c["label"] for c in found.json["candidates"] if c["found"]] == ["mass_change"]
    assert "changed: Change of mass, in loaded." in found.json["advice"]


@pytest.mark.long
def test_a_load_between_two_flights_is_named_with_its_flight(runs):
    """C_measured = m_file / m C: what C_Z has more is m_file / m - 1 of it."""
    found = ask("diagnose", runs["monday"], runs["loaded"], runs["tuesday"], "--replicas", 2)
    best = found["candidates"][0]
    assert (found["verdict"], best["effect"], best["found"]) == ("missing", "mass_change", True)
    assert best["runs"] == ["loaded"] and best["where"].startswith("in loaded; ")
    assert "changed: Change of mass, in loaded." in found["advice"]
    (value,) = (parameter["value"] for parameter in best["parameters"] if parameter["axis"] == "CZ")
    assert value == pytest.approx(1.0 / HEAVIER - 1.0, abs=0.02)
    assert [c["label"] for c in found["candidates"] if c["found"]] == ["mass_change"]
    assert (found["runs"], found["held_out"]) == (["monday", "loaded", "tuesday"], "runs")
    assert found["file"] is None and not any((run / DIAGNOSIS).exists() for run in runs.values())


@pytest.mark.long
def test_flights_that_are_alike_give_nothing(runs):
    found = ask("diagnose", runs["monday"], runs["tuesday"], runs["wednesday"], "--replicas", 2)
    assert found["verdict"] == "none" and not [c for c in found["candidates"] if c["found"]]
    assert "Nothing that they could show changed between the flights." in found["advice"]


@pytest.mark.long
def test_of_two_flights_the_second_is_named(runs, capsys):
    assert main(["diagnose", str(runs["monday"]), str(runs["loaded"]), "--replicas", "2"]) == 0
    said = capsys.readouterr().out
    assert "2 runs: monday, loaded; held out: blocks of time" in said
    assert "Between the flights this changed: Change of mass, in loaded." in said


@pytest.mark.long
def test_runs_are_held_out_whole_and_what_happened_once_by_blocks(runs):
    body = join_runs([runs["monday"], runs["loaded"], runs["tuesday"]])
    data = settled_flight(reconstruct(body.aircraft, body.samples, with_covariance=False))
    assert data.folds == 3 and np.array_equal(data.fold, data.run)
    assert data.flown is None  # a flight has learnt its biases
    bench = CandidateEvaluator(data)
    begin, end = data.seams
    for number in range(3):
        time = data.signal("time")[data.run == number]
        assert (time.min() > begin) == (number > 0) and (time.max() < end) == (number < 2)
    lasting = Candidate(None, "", (), {"CZ": ("alpha**3",)})
    passing = Candidate(None, "", (("t0", begin), ("t1", end)), {"CZ": (f"sign(time-{begin:.6g})",)})
    assert bench.judging(lasting) is bench
    once = bench.judging(passing)
    assert once.data.blocks_only and np.array_equal(once.data.fold, once.data.block % 4)
    assert set(bench.trial(passing).gains["CZ"].fit.fold) == {0, 1, 2, 3}
    assert once.judging(passing) is once


# -- two runs side by side -----------------------------------------------------------------------------------------


@pytest.mark.long
def test_two_flights_of_one_aeroplane_differ_in_nothing(runs):
    found = ask("compare", runs["monday"], "--with", runs["tuesday"])["with"]
    assert (found["runs"], found["same_flight"], found["differing"]) == (["monday", "tuesday"], False, [])
    assert found["tried"] == len(found["parameters"]) >= 30 and found["only_in"] == [[], []]
    alone = ask("compare", runs["tuesday"])
    for axis, ((_, _), (_, own)) in found["errors"].items():
        assert own == alone["axes"][axis]["nrmse_held_out"]


@pytest.mark.long
def test_a_load_is_what_differs_between_two_flights(runs, folder, capsys):
    """Coefficients of force are m_file / m times what they were; the model of the one does badly on the other.

    Where the model of one is on HOLD its standard errors prove nothing: nothing is said to differ by more than chance.
    """
    found = ask("compare", runs["monday"], "--with", runs["loaded"])["with"]
    assert "CZ_alpha" in found["differing"] and not [n for n in found["differing"] if n in ("Cn_beta", "Cl_p")]
    (lift,) = (p for p in found["parameters"] if p["name"] == "CZ_alpha")
    assert lift["value"][1] / lift["value"][0] == pytest.approx(1.0 / HEAVIER, abs=0.02)
    assert lift["difference"] == lift["value"][1] - lift["value"][0] and lift["p_value"] < 1e-6
    assert lift["std_difference"] == pytest.approx(np.hypot(*lift["std"]))
    (own, other), (_, its_own) = found["errors"]["CZ"]
    assert other > 2.0 * max(own, its_own)
    held = shutil.copytree(runs["loaded"], folder / "held")
    content = json.loads((held / "parameters.json").read_text())
    for parameter in content["parameters"]:
        parameter.update(status="HOLD", reason="the model explains 12 % of it")
    (held / "parameters.json").write_text(json.dumps(content))
    assert main(["compare", str(runs["monday"]), str(held)]) == 0
    said = capsys.readouterr().out
    assert "0 of 32 parameters differ by more than chance" in said and "but b on HOLD" in said
    rows = {line.split()[0]: line for line in said.splitlines() if line.startswith(("C", "parameter"))}
    (same, *_) = (p["name"] for p in found["parameters"] if p["p_value"] > 0.5)
    assert rows[same].endswith("  b on HOLD")  # beside what does not differ, too
    assert not any(text.strip("-0.") == "" for text in rows["Cn_0"].split()[3:5])  # no 0.0000
    assert f"{len(found['differing'] + found['doubtful'])} more differ by their standard errors" in said
    assert "so no difference is proven" in said and "in held is HOLD: the model explains 12 % of it" in said


@pytest.mark.long
def test_two_versions_of_one_flight_give_no_chance(runs, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(runs["monday"], run)
    root = ask("add", run, "CZ: alpha**3")["parents"][0]
    found = ask("compare", run, "--with", root)["with"]
    assert found["same_flight"] and found["tried"] == 0 and found["differing"] == []
    assert found["only_in"] == [["CZ_alpha3"], []]
    assert {p["difference"] for p in found["parameters"] if p["name"].startswith("Cn")} == {0.0}


def test_p_values_by_holm():
    """0.005, 0.01, 0.03, 0.04 of four: times 4, 3, 2, 1, and none less than one before it."""
    assert holm(np.array([0.01, 0.04, 0.03, 0.005])) == pytest.approx([0.03, 0.06, 0.06, 0.02])


@pytest.mark.parametrize("inputs", [("spoiler", "trim_tab"), ("spoiler",)])
def test_a_model_reads_its_inputs_by_name_on_another_flight(aircraft, inputs):
    """It had read the first input of that file, whatever it is called."""
    rng, time = np.random.default_rng(3), 0.1 * np.arange(300)

    def flown(names):
        model = {"CZ": [1, "alpha", "trim_tab"]} if "trim_tab" in names else {"CZ": [1, "alpha"]}
        plane = aircraft_from_dict({**aircraft.source, "inputs": dict.fromkeys(names), "model": model})
        signals, measured = rng.standard_normal((len(time), SIGNAL_COUNT)), np.zeros((len(time), 6))
        flight = FlightData(plane, time, measured, signals, 0.1)
        tab = flight.signal("trim_tab") if "trim_tab" in names else 0.0
        measured[:, AXES.index("CZ")] = -0.3 - 4.0 * flight.signal("alpha") + 0.5 * tab
        return flight

    fit = SimpleNamespace(parameters=np.array([-0.3, -4.0, 0.5]))
    model = SimpleNamespace(flight=flown(("trim_tab",)), axes={"CZ": SimpleNamespace(fit=fit)})
    error = _predicted(model, flown(inputs), "CZ")
    assert error == pytest.approx(0.0, abs=1e-9) if "trim_tab" in inputs else np.isnan(error)


@pytest.mark.long
def test_what_cannot_stand_side_by_side(runs, capsys, tmp_path):
    assert "is given twice" in refused(capsys, "compare", runs["monday"], "--with", runs["monday"])
    said = refused(capsys, "compare", runs["monday"], "--with", "nobody")
    assert "there is no run nobody, and" in said and "has no model 'nobody': it has" in said
    assert "leave one out" in refused(capsys, "compare", runs["monday"], runs["tuesday"], "--with", runs["loaded"])
    assert "is not a run" in refused(capsys, "compare", runs["monday"], "--with", tmp_path / "nothing")


@pytest.mark.long
def test_samples_know_their_run(runs):
    parts = [read_samples(runs[name]) for name in ("monday", "tuesday")]
    cut = [part[(np.arange(len(part)) // 4000) < 2] for part in parts]
    half = len(cut[0]) // 2
    several, _ = joined([cut[0][:half], cut[0][half:]])  # a run of two manoeuvres
    body = with_run_numbers(joined([several, cut[1]])[0], [len(several), len(cut[1])])
    assert len(manoeuvres(body)) == 3
    assert run_of_manoeuvres(body).tolist() == [0, 0, 1]
    last = body.stamp[body.kind != Kind.SEAM][-1:]
    assert run_of_manoeuvres(body)[manoeuvre_at(body, last)].tolist() == [1]
    assert run_of_manoeuvres(samples_of(Kind.IMU, [0], np.zeros((1, 6)))).tolist() == [0]


# -- what is refused -----------------------------------------------------------------------------------------------


@pytest.mark.long
def test_another_aeroplane_is_refused_and_the_key_named(runs, folder, capsys):
    other = shutil.copytree(runs["tuesday"], folder / "other")
    file = yaml.safe_load((other / "aircraft.yaml").read_text())
    file["inertia"]["yy"] *= 1.5
    file["name"] = "the same by another name"
    (other / "aircraft.yaml").write_text(yaml.safe_dump(file, explicit_end=True))
    said = refused(capsys, "diagnose", runs["monday"], other)
    assert "not runs of one aeroplane: inertia.yy is" in said and said.endswith("replay both with one aircraft file")


@pytest.mark.long
def test_a_name_alone_makes_no_other_aeroplane(runs, folder):
    other = shutil.copytree(runs["tuesday"], folder / "renamed")
    file = yaml.safe_load((other / "aircraft.yaml").read_text())
    (other / "aircraft.yaml").write_text(yaml.safe_dump({**file, "name": "renamed"}, explicit_end=True))
    assert join_runs([runs["monday"], other]).names == ("monday", "renamed")


@pytest.mark.long
def test_another_model_is_refused(runs, folder, capsys):
    other = shutil.copytree(runs["tuesday"], folder / "extended")
    ask("add", other, "CZ: alpha**3")
    said = refused(capsys, "diagnose", runs["monday"], other)
    assert "extended has the model" in said and said.endswith("give them the same model with add and remove")


@pytest.mark.long
def test_the_same_flight_twice_is_refused(runs, folder, capsys):
    assert "is given twice" in refused(capsys, "diagnose", runs["monday"], runs["monday"])
    copy = shutil.copytree(runs["monday"], folder / "copy")
    assert "hold the same IMU samples" in refused(capsys, "diagnose", runs["tuesday"], runs["monday"], copy)
