"""The story that the demo tells, on a short flight and without ROS."""

from __future__ import annotations

import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands import demo_story
from aircraft_sysid_ros.commands.demo_story import flown_errors, story_json, story_text, tell
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.effects import BY_ID, LIBRARY
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.report.story_figure import story_figure
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import true_values, truth_document

SOME = [BY_ID[n] for n in ("alpha_scale", "dihedral_alpha", "sideslip_drag", "stall", "adverse_yaw", "control_damage")]


@pytest.fixture(scope="module")
def flight(aircraft):
    """A flight of 45 s in which the dihedral effect depends on lift."""
    hidden = [("dihedral_alpha", 1.0)]
    return simulate_samples(aircraft, 1, 45.0, hidden=hidden, manoeuvres="standard", rate=200.0)


@pytest.fixture
def run(flight, aircraft, tmp_path):
    """Its run folder."""
    pipeline, path = Pipeline(aircraft), tmp_path / "run"
    with RunWriter(path, aircraft) as writer:
        for rows, points in (pipeline.push(flight.samples), pipeline.flush()):
            writer.add_rows(rows)
            writer.add_points(points)
        writer.add_samples(flight.samples)
        writer.finish(pipeline.state, pipeline.parameters, pipeline.state.flight_time, time.perf_counter())
    return path


@pytest.mark.long
@pytest.mark.parametrize("library", [SOME, pytest.param(LIBRARY, marks=pytest.mark.long)], ids=["some", "all"])
def test_the_hidden_effect_is_found_added_and_the_error_falls_to_the_noise(
    run, flight, library, pictures, monkeypatch, tmp_path
) -> None:
    monkeypatch.setattr(demo_story, "diagnose_flight", partial(diagnose_flight, library=library))
    said: list[str] = []
    story = tell(run, said.append, replicas=2)
    told = story_json(story, truth_document(flight))
    assert told["hidden"] == told["found"] == ["dihedral_alpha"]
    assert told["verdict"] == "missing" and told["failing_axis"] == "Cl"
    errors = told["axes"]
    assert errors["Cl"]["error_before"] > 5.0 * errors["Cl"]["error_after"]
    assert errors["Cl"]["error_after"] < 1.3 * errors["Cl"]["noise_floor"]
    assert errors["Cl"]["flown_before"] > 3.0 * errors["Cl"]["flown_after"]
    for axis in set(AXES) - {"Cl"}:
        assert errors[axis]["error_after"] == pytest.approx(errors[axis]["error_before"], rel=1e-6)
    (new,) = (p for p in told["parameters"] if p["name"] in told["new_parameters"])
    assert new["truth"] == flight.hidden[0].terms[0].value
    assert abs(new["value"] - new["truth"]) < 3.0 * new["std"] < 0.5 * abs(new["truth"])
    assert told["judged"] == 33 and told["within_3_standard_errors"] >= 31
    assert open_run(run).current.identifier == told["model"]
    text = "\n".join([*said, *story_text(told)])
    assert "C_l, " in text and "times the noise" in text and "Dihedral effect that depends on lift" in text
    picture = story_figure(story.before, story.after, "Cl", tmp_path / "story.png", ("before", "after"))
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_where_nothing_is_found_nothing_is_added(run, flight, monkeypatch) -> None:
    nothing = {"verdict": "none", "candidates": [], "advice": "Nothing is missing."}
    monkeypatch.setattr(demo_story, "diagnose_flight", lambda *_, **__: SimpleNamespace(json=nothing))
    said: list[str] = []
    story = tell(run, said.append)
    told = story_json(story, truth_document(flight))
    assert told["found"] == [] and told["model"] is None and told["judged"] == 32
    assert "  Nothing is missing." in said
    assert "found by the program   nothing" in list(story_text(told))
    assert open_run(run).current.changes == {}


def test_truth_of_terms_has_the_names_of_parameters_and_adds_to_them() -> None:
    terms = [
        {"axis": "Cl", "expression": "beta * alpha", "value": -0.7},
        {"axis": "CX", "expression": "alpha**2", "value": -0.5},
    ]
    truth = {"coefficients": {"CX_alpha2": 3.0}, "hidden": [{"terms": terms}]}
    assert true_values(truth) == {"CX_alpha2": 2.5, "Cl_beta*alpha": -0.7}


def test_error_in_flight_is_that_of_the_second_half_where_it_is_valid() -> None:
    time_ = np.arange(100.0)
    measured = np.tile(np.sin(time_)[:, None], (1, 6))
    predicted = measured.copy()
    predicted[:50] += 10.0  # still learning
    predicted[50:, 3] += 0.1
    valid = np.ones((100, 6), dtype=bool)
    predicted[60, 4], valid[60, 4] = 99.0, False
    errors = flown_errors(time_, measured, predicted, valid)
    assert errors["Cl"] == pytest.approx(0.1 / np.std(np.sin(time_[50:])))
    assert errors["Cm"] == errors["CX"] == 0.0
