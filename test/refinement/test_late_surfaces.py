"""refine on a run whose file says nothing of the servos: it takes the lag that the flight shows, and says so."""

import json

import pytest
from aircraft_files import of_shape

from aircraft_sysid_ros.after_flight.compare import compare_run
from aircraft_sysid_ros.after_flight.refine import refine_run, with_late_surfaces
from aircraft_sysid_ros.after_flight.replay import replay
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run, run_data
from aircraft_sysid_ros.refinement.refined_file import METHODS
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("servos")
    flight = simulate_samples(default_aircraft(), 47, 60.0, sensors=SensorOptions(command_lag=0.06))
    write_flight(flight, folder / "bag")
    replay([str(folder / "bag")], of_shape(default_aircraft()), folder / "run")
    return folder / "run"


def test_the_lag_that_the_flight_shows_is_taken_and_said(run):
    opened = open_run(run)
    data = run_data(opened, opened.current)
    late, notes = with_late_surfaces(data, opened.late_surfaces(data.aircraft))
    assert late.aircraft.sensors["control_surfaces"].lag == pytest.approx(0.06, abs=0.012)
    assert "a lag of 0.0" in notes[0]
    said = aircraft_from_dict({**data.aircraft.source, "sensors": {"control_surfaces": {"lag": 0.0}}})
    assert opened.late_surfaces(said) == opened.late_surfaces(opened.root)  # no other number than the run's
    other = aircraft_from_dict({**data.aircraft.source, "sensors": {"control_surfaces": {"lag": 0.05}}})
    assert opened.late_surfaces(other) == {}
    assert with_late_surfaces(data, {}) == (data, [])


@pytest.mark.long
def test_compare_export_and_gains_say_it(run, tmp_path, capsys):
    def told_by(*words):
        assert main([*map(str, words), "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    assert any("with a lag of 0.0" in note for note in compare_run(run).notes)
    out = tmp_path / "table.csv"
    told = told_by("export", run, "--to", "csv", "--out", out)
    assert any("give the servos of the other program the same" in note for note in told["notes"])
    loops = told_by("gains", run, "--to", "px4", "--full-deflection", "25,20,30")
    lag = open_run(run).late_surfaces(open_run(run).root)["lag"][0]
    assert any(f"an actuator lag of {1e3 * lag:.0f} ms" in note for note in loops["notes"])


@pytest.mark.long
def test_what_is_refined_is_right(run):
    result = refine_run(run, lambda *_: (None, []), METHODS[0])
    truth = default_aircraft().coefficients
    by = {p["name"]: p["value"] for p in result["parameters"]}
    for name in ("Cl_p", "Cl_da", "Cm_de"):
        assert by[name] == pytest.approx(truth[name], rel=0.15)
    assert any("a lag of 0.0" in note for note in result["notes"])


@pytest.mark.long
def test_who_says_another_lag_than_the_flight_has_is_told(run, tmp_path):
    """Of a lag of 0.06 s: none, a third, what is there, and twice as much."""
    shape = open_run(run).root.source
    told = {}
    for lag in (0.0, 0.02, 0.06, 0.12):
        said = aircraft_from_dict({**shape, "sensors": {"control_surfaces": {"lag": lag}}})
        found = replay([str(run.parent / "bag")], said, tmp_path / f"{lag}")
        told[lag] = [note for note in found["notes"] if "the value of the file is used" in note]
    assert "no delay and no lag" in told[0.0][0]
    assert "a lag of 0.02 s" in told[0.02][0] and "later than that" in told[0.02][0]
    assert told[0.06] == []
    assert "earlier than that" in told[0.12][0]
