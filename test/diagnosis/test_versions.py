"""Model versions: add lowers the held-out error to the floor, remove restores, and nothing is left half-done."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.diagnosis.compare import compare_axis
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    Reconstruction,
    fit_sensor_noise,
    reconstruct,
    reconstruct_as_flown,
)
from aircraft_sysid_ros.diagnosis.measurement.faults import measurement_faults
from aircraft_sysid_ros.diagnosis.model_versions import additions, versions
from aircraft_sysid_ros.diagnosis.model_versions.additions import add, remove
from aircraft_sysid_ros.diagnosis.model_versions.requests import parse_request
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run, version_identifier, version_with
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis, held_out_error
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import Effect, ShapeParameter, with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.refinement.run_data import load_run
from aircraft_sysid_ros.samples import Kind

TRUE_VALUE = 60.0


@pytest.fixture
def run(hidden_run, tmp_path, monkeypatch) -> Path:
    """A copy of the run; its flight is reconstructed once for all tests."""
    path = tmp_path / "run"
    shutil.copytree(hidden_run, path)
    monkeypatch.setattr(versions, "reconstruct_as_flown", _once)
    return path


_made: dict[str, tuple[Reconstruction, bool]] = {}


def _once(aircraft, samples, calm_air=False):
    key = str(samples.stamp.sum()) + repr(aircraft.sensors) + repr(aircraft.imu_position) + str(len(samples))
    if key not in _made:
        _made[key] = reconstruct_as_flown(aircraft, samples, calm_air=calm_air)
    made, calm = _made[key]
    return replace(made, aircraft=aircraft), calm


def snapshot(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in sorted(path.rglob("*")) if p.is_file()}


@pytest.mark.long
def test_the_missing_term_lowers_the_error_to_the_floor(run) -> None:
    outcome = add(run, "CZ: alpha ** 3")
    errors = outcome.axes["CZ"]
    assert list(outcome.axes) == ["CZ"] and outcome.improved
    assert errors["error_before"] > 3.0 * errors["noise_floor"]
    assert errors["error_after"] < 1.2 * errors["noise_floor"]
    (term,) = outcome.parameters
    assert term["name"] == "CZ_alpha3" and term["value"] == pytest.approx(TRUE_VALUE, abs=4.0 * term["std"])
    assert term["std"] < 0.1 * TRUE_VALUE and term["status"] == "USE"
    assert "falls" in outcome.verdict


@pytest.mark.long
def test_the_noise_floor_is_of_the_noise_that_the_flight_had(run, monkeypatch) -> None:
    """Not of that of an aircraft file that says twice as much; the file of the version stays as it is."""
    monkeypatch.setattr(versions, "reconstruct_as_flown", reconstruct_as_flown)
    opened, sensor = open_run(run), ("sensors", "accelerometer", "noise")
    noisy = with_setting(opened.root, sensor, 2.0 * opened.root.sensors["accelerometer"].noise[0])
    flights = [opened.flight(aircraft) for aircraft in (opened.root, noisy)]
    floors = [compare_axis(flight, fit_axis(flight, "CX")).floor.nrmse for flight in flights]
    assert floors[1] == pytest.approx(floors[0], rel=0.05)
    assert flights[1].aircraft.source == noisy.source
    assert flights[1].under(opened.root).aircraft.sensors == flights[1].aircraft.sensors


@pytest.mark.long
def test_the_version_is_a_folder_that_other_commands_read(run, aircraft) -> None:
    outcome = add(run, "CZ: alpha**3")
    folder = run / "models" / outcome.version.identifier
    written = load_aircraft(folder / "aircraft.yaml")
    assert written.model.terms["CZ"] == (*aircraft.model.terms["CZ"], "alpha**3")
    assert written.model.identifier == outcome.version.identifier
    assert written.coefficients["CZ_alpha3"] == pytest.approx(TRUE_VALUE, rel=0.1)  # it can be simulated
    assert written.coefficients["CZ_alpha"] == pytest.approx(aircraft.coefficients["CZ_alpha"], rel=0.05)
    content = json.loads((folder / "version.json").read_text())
    assert content["parents"] == [aircraft.model.identifier]
    listed = json.loads((folder / "parameters.json").read_text())
    assert [p["name"] for p in listed["parameters"]] == list(written.model.parameter_names)
    assert json.loads((run / "model.json").read_text()) == {"model": outcome.version.identifier}
    assert open_run(run).current.aircraft.model.terms == written.model.terms
    assert not list(run.glob(".version*"))


@pytest.mark.long
def test_remove_restores_the_id_and_the_errors(run, aircraft) -> None:
    added = add(run, "CZ: alpha**3")
    removed = remove(run, "CZ: alpha**3")
    assert removed.version.identifier == aircraft.model.identifier
    assert removed.axes["CZ"]["error_after"] == pytest.approx(added.axes["CZ"]["error_before"], rel=1e-12)
    assert removed.axes["CZ"]["error_before"] == pytest.approx(added.axes["CZ"]["error_after"], rel=1e-12)
    assert not removed.improved and open_run(run).current.changes == {}


@pytest.mark.long
def test_a_version_that_comes_back_keeps_its_place_in_the_history(run, aircraft) -> None:
    """An undo had made it from what was made from it, and the history went round in a circle."""
    first = add(run, "CZ: alpha**3").version.identifier
    second = add(run, "Cm: alpha**2").version.identifier
    assert remove(run, "Cm: alpha**2").version.identifier == first == open_run(run).current.identifier
    root = aircraft.model.identifier
    found = [(version.identifier, version.parents) for version in versions.versions_of(open_run(run))[0]]
    assert found == [(root, ()), (first, (root,)), (second, (first,))]


@pytest.mark.long
def test_the_constant_of_a_force_is_known_no_better_than_the_bias_of_the_accelerometer(run, aircraft) -> None:
    """It was said to be 5 to 11 times better, to USE, and was 7 standard errors off."""
    version = add(run, "CZ: alpha**3").version
    parameters = json.loads((run / "models" / version.identifier / "parameters.json").read_text())["parameters"]
    known = {p["name"]: (p["value"], p["std"]) for p in parameters}
    stated = json.loads((run / "state.json").read_text())["accelerometer_bias_std"]
    per_bias = aircraft.mass / (float(np.median(open_run(run).flight().signal("qbar"))) * aircraft.wing_area)
    for axis, of_bias in zip(("CX", "CY", "CZ"), stated, strict=True):
        value, std = known[f"{axis}_0"]
        assert std >= per_bias * of_bias > 0.0
        assert abs(value - aircraft.coefficients[f"{axis}_0"]) < 3.0 * std


@pytest.mark.long
def test_what_is_added_in_one_axis_makes_no_other_parameter_surer(run) -> None:
    """All had come from least squares, 3 to 12 times as sure, with USE in the place of every reason for HOLD."""
    before = json.loads((run / "parameters.json").read_text())["parameters"]
    version = add(run, "CZ: alpha**3").version
    after = json.loads((run / "models" / version.identifier / "parameters.json").read_text())["parameters"]
    by_name = {p["name"]: p for p in after}
    others = [p for p in before if not p["name"].startswith("CZ")]
    assert len(others) > 20 and {p["status"] for p in before} == {"USE", "HOLD"}
    for p in others:
        new = by_name[p["name"]]
        assert (new["status"], bool(new["reason"])) == (p["status"], bool(p["reason"]))
        assert new["std"] == pytest.approx(p["std"], rel=0.02) and abs(new["value"] - p["value"]) < 0.1 * p["std"]


@pytest.mark.long
def test_a_needless_term_is_said_to_be_one(run) -> None:
    outcome = add(run, "Cl: alpha*beta")
    errors = outcome.axes["Cl"]
    assert not outcome.improved and "does not lower the held-out error" in outcome.verdict
    assert errors["error_after"] == pytest.approx(errors["error_before"], rel=0.02)


@pytest.mark.long
def test_a_term_without_values_at_some_points_does_not_gain_by_leaving_them_out(run) -> None:
    """Each error is that of ``compare``, over the points of its own model; the verdict is on those that both have."""
    before = held_out_error(open_run(run).flight(), "CZ")
    outcome = add(run, "CZ: sqrt(beta)")  # without values in sideslip to the left
    after = open_run(run).flight()
    assert outcome.axes["CZ"]["error_before"] == before
    assert outcome.axes["CZ"]["error_after"] == held_out_error(after, "CZ") != before
    assert not outcome.improved and "in CZ where both models have values" in outcome.verdict
    shared = fit_axis(after, "CZ").rows
    known = fit_axis(replace(after, aircraft=open_run(run).root), "CZ").on(shared)
    assert f"({100 * known.nrmse_held_out:.1f} % to" in outcome.verdict


@pytest.mark.long
def test_additions_build_on_each_other(run, aircraft) -> None:
    first = add(run, "CZ: alpha**3")
    second = add(run, "Cm: alpha**2; Cl: alpha*da")
    assert second.version.parents == (first.version.identifier,)
    model = open_run(run).current.aircraft.model
    assert "alpha**3" in model.terms["CZ"] and "alpha**2" in model.terms["Cm"] and "alpha*da" in model.terms["Cl"]
    assert sorted(second.axes) == ["Cl", "Cm"]
    remove(run, "Cm: alpha**2")  # one of two terms
    model = open_run(run).current.aircraft.model
    assert model.terms["Cm"] == aircraft.model.terms["Cm"] and "alpha*da" in model.terms["Cl"]


@pytest.mark.long
def test_a_term_of_the_first_model_goes_and_comes_back(run, aircraft) -> None:
    without = remove(run, "CZ: de")
    assert "de" not in open_run(run).current.aircraft.model.terms["CZ"]
    back = add(run, "CZ: de")
    assert (
        back.version.identifier == aircraft.model.identifier and without.version.identifier != back.version.identifier
    )


@pytest.mark.long
def test_an_effect_brings_its_terms_with_inner_numbers_fitted(run) -> None:
    outcome = add(run, "stall")
    assert outcome.improved and outcome.axes["CZ"]["error_after"] < 0.6 * outcome.axes["CZ"]["error_before"]
    assert all(re.search(r"alpha-\(?0\.\d+", term) for term in outcome.change.terms["CZ"])
    assert remove(run, "stall").axes.keys() == outcome.axes.keys()


@pytest.mark.long
@pytest.mark.parametrize(
    "absent", ["control_damage", "stuck_control", "loss_of_thrust", "parameter_change", "cg_shift"]
)
def test_times_that_are_free_lower_an_error_a_little_and_are_no_reason(run, absent: str) -> None:
    """What is missing is in the model; in a clean flight 9 of 35 absent effects had lowered an error by 1 %."""
    assert add(run, "CZ: alpha**3").improved
    outcome = add(run, absent)
    assert not outcome.improved and outcome.verdict.endswith("this flight gives no reason to keep it")


@pytest.mark.long
def test_a_measurement_effect_changes_a_setting_and_gets_an_id_of_its_own(run, aircraft, monkeypatch) -> None:
    """All surfaces were recorded 80 ms after they moved, which the file does not say."""
    _shift(run, Kind.CONTROLS, 80_000_000)
    delay = BY_ID["actuator_lag"].variants[:1]
    early = {"inner": (ShapeParameter("delay", "s", 0.0, 0.2, 5),), "variants": delay}
    effect = Effect(**{**vars(BY_ID["actuator_lag"]), **early})
    monkeypatch.setattr(additions, "parse_request", lambda text, inputs: effect)
    before = open_run(run)
    outcome = add(run, "actuator_lag")
    ((key, value),) = outcome.change.settings
    assert key == ("sensors", "control_surfaces", "delay") and value == pytest.approx(0.08, abs=0.01)
    assert outcome.improved and "fits forces and moments better than 0" in outcome.verdict
    version = outcome.version
    surfaces = version.aircraft.sensors["control_surfaces"]
    assert surfaces.delay == value and surfaces.late_std > 0.005  # it was found, and is not said
    assert version.aircraft.model.terms == aircraft.model.terms
    assert version.identifier != aircraft.model.identifier
    assert version.identifier == version_identifier(version.aircraft, before.root)
    with pytest.raises(InputError, match="in the model already"):
        add(run, "actuator_lag")
    assert version_with(before, {}, ()).identifier == aircraft.model.identifier


@pytest.mark.long
def test_add_and_diagnose_find_the_same_lag_of_the_air_data(run, monkeypatch) -> None:
    """What ``diagnose`` would name is what ``add`` sets, and lags that are not there are not believed in."""
    _shift(run, Kind.AIRSPEED, 100_000_000)
    _shift(run, Kind.ANGLE_OF_ATTACK, 100_000_000)
    _shift(run, Kind.SIDESLIP, 100_000_000)
    opened = open_run(run)
    flight = reconstruct(
        fit_sensor_noise(opened.current.aircraft, opened.samples), opened.samples, with_covariance=False
    )
    effect = BY_ID["air_data_lag"]
    effect = Effect(**{**vars(effect), "variants": effect.variants[:1]})
    monkeypatch.setattr(additions, "parse_request", lambda text, inputs: effect)
    named = measurement_faults(flight, [effect], True)[0]
    outcome = add(run, "air_data_lag")
    ((key, value),) = outcome.change.settings
    assert key == named.variant.setting and value == pytest.approx(named.value, rel=1e-3)
    assert key[1] == "air_data" and value == pytest.approx(0.1, abs=0.02) and outcome.improved


@pytest.mark.long
def test_a_scale_that_is_right_is_not_believed_to_be_wrong(run) -> None:
    try:
        outcome = add(run, "beta_scale")
    except InputError as error:
        assert "is not missing" in str(error)
    else:
        assert not outcome.improved and "no more than chance" in outcome.verdict


def _shift(run: Path, kind: Kind, nanoseconds: int) -> None:
    """Samples of one kind later than they were."""
    with np.load(run / "samples.npz") as stored:
        arrays = {name: stored[name] for name in stored.files}
    arrays["stamp"][arrays["kind"] == kind] += nanoseconds
    order = np.argsort(arrays["stamp"], kind="stable")
    np.savez(run / "samples.npz", **{name: values[order] for name, values in arrays.items()})
    _made.clear()


@pytest.mark.long_after_the_first
@pytest.mark.parametrize(
    "text, words",
    [
        ("stal", "did you mean stall"),
        ("icing (growing on one wing)", "did you mean icing"),
        ("CZ alpha", "not an effect"),
        ("CQ: alpha", "'CQ' is not an axis: the axes are CX CY CZ Cl Cm Cn"),
        ("CL: alpha**2", "'CL' is not an axis of the model: for lift write CZ"),
        ("C_L: alpha**2", "'C_L' is not an axis of the model: for lift write CZ"),
        ("cl: beta**3", "and for the rolling moment Cl"),
        ("CD: alpha**2", "'CD' is not an axis of the model: for drag write CX"),
        ("CN: alpha**2", "and for the yawing moment Cn"),
        ("CZ: wing", "'wing' in 'wing' is not a signal"),
        ("CZ: alpha**", "is not an expression"),
        ("CZ: __import__('os')", "not allowed"),
        ("CZ: alpha", "'alpha' in CZ already"),
        ("CZ: 3*alpha", "does not determine"),
        ("CZ: max(alpha-2,0)", "does not determine"),
        ("CZ: propeller_speed**2/0", "is never a number, whatever the aeroplane does"),
        ("CZ: alpha**2; CZ: alpha**2", "twice"),
        ("", "nothing is named: give an effect such as stall"),
        ("CZ: alpha/max(alpha-2,0)", "is not finite at any point"),
    ],
)
def test_bad_requests_are_one_sentence_and_change_nothing(run, text: str, words: str) -> None:
    before = snapshot(run)
    with pytest.raises(InputError) as error:
        add(run, text)
    assert words in str(error.value) and "\n" not in str(error.value)
    assert snapshot(run) == before


@pytest.mark.long
def test_a_signal_that_the_flight_lacks_is_named(run) -> None:
    with np.load(run / "samples.npz") as stored:
        arrays = {name: stored[name] for name in stored.files}
    arrays["values"][arrays["kind"] == Kind.CONTROLS, 3] = np.nan  # flaps
    np.savez(run / "samples.npz", **arrays)
    _made.clear()
    with pytest.raises(InputError, match="needs flaps, which this flight does not have"):
        add(run, "CZ: flaps")
    with pytest.raises(InputError, match="'flaps' needs flaps"):
        add(run, "flaps")
    _made.clear()


def test_remove_says_what_there_is(run) -> None:
    with pytest.raises(InputError, match="has no term 'alpha\\*\\*3' in CZ: it has 1 alpha q de"):
        remove(run, "CZ: alpha**3")
    with pytest.raises(InputError, match="'stall' is not in the model"):
        remove(run, "stall")


@pytest.mark.long
def test_what_is_no_run_or_damaged_is_said(run, tmp_path) -> None:
    with pytest.raises(InputError, match="is not a run"):
        add(tmp_path / "nothing", "stall")
    with pytest.raises(InputError, match="is not a run"):
        open_run(tmp_path)
    add(run, "CZ: alpha**3")
    (run / "model.json").write_text('{"model": "unknown"}')
    with pytest.raises(InputError, match=r"damaged: remove model.json"):
        open_run(run)
    (run / "model.json").unlink()
    (run / "model.json").mkdir()
    with pytest.raises(InputError, match=r"damaged: remove model.json"):
        open_run(run)


@pytest.mark.long
def test_a_version_is_in_its_run_and_nowhere_else(run, tmp_path) -> None:
    """A run that somebody sends cannot make other folders of this machine its model."""
    identifier = add(run, "CZ: alpha**3").version.identifier
    outside = tmp_path / "outside"
    shutil.copytree(run / "models" / identifier, outside)
    (run / "models" / "link").symlink_to(outside)
    for named in ("../../outside", str(outside), "link", "..", "", "." + identifier):
        (run / "model.json").write_text(json.dumps({"model": named}))
        with pytest.raises(InputError, match=r"damaged: remove model.json"):
            open_run(run)
    (run / "model.json").write_text(json.dumps({"model": identifier}))
    found, notes = versions.versions_of(open_run(run))
    assert [v.identifier for v in found][1:] == [identifier] and "link is left out" in notes[0]
    (run / "model.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match=r"damaged: remove model.json"):
        open_run(run)


@pytest.mark.long
def test_an_aircraft_file_that_is_cut_off_is_no_smaller_aircraft_file(run) -> None:
    """Cut after any line, it is refused, though the first lines alone are a valid file."""
    path = run / "aircraft.yaml"
    lines = path.read_text().splitlines(keepends=True)
    accepted = []
    for count in range(len(lines)):
        path.write_text("".join(lines[:count]))
        with contextlib.suppress(InputError):
            open_run(run)
            accepted.append(count)
        with contextlib.suppress(InputError):
            load_run(run)
            accepted.append(count)
    assert not accepted
    path.write_text("".join(lines))
    open_run(run)


@pytest.mark.long
def test_a_failed_write_leaves_the_run_as_it_was(run, monkeypatch) -> None:
    add(run, "CZ: alpha**3")
    before = snapshot(run)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match="No space left"):
        add(run, "Cm: alpha**2")
    after = snapshot(run)
    assert {k: v for k, v in after.items() if k in before} == before
    monkeypatch.undo()
    assert open_run(run).current.aircraft.model.terms["CZ"][-1] == "alpha**3"


def _add_one(run: Path, text: str) -> None:
    additions.add(run, text)


@pytest.mark.long
def test_two_programs_wait_for_each_other(run) -> None:
    """Both terms are in the model at the end: the second builds on the first."""
    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=_add_one, args=(run, text)) for text in ("CZ: alpha**3", "Cm: alpha**2")]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60)
        assert process.exitcode == 0
    assert set(open_run(run).current.changes) == {"CZ: alpha**3", "Cm: alpha**2"}


def test_axes_may_be_written_as_in_books() -> None:
    assert parse_request("C_Z: alpha**2; cm:q*alpha") == {"CZ": ("alpha**2",), "Cm": ("q*alpha",)}
    assert parse_request("C_l: alpha**2; cy:beta**3") == {"Cl": ("alpha**2",), "CY": ("beta**3",)}
