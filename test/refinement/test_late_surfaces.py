"""refine on a run whose file says nothing of the servos: it takes the lag that the flight shows, and says so."""

import dataclasses

import pytest

from aircraft_sysid_ros.after_flight.refine import refine_run, with_late_surfaces
from aircraft_sysid_ros.after_flight.replay import replay
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run, run_data
from aircraft_sysid_ros.refinement.refine import METHODS
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

SHAPE = ("name", "mass", "wing_area", "span", "chord", "inertia", "imu_position", "air_data_position", "gps_position")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("servos")
    flight = simulate_samples(default_aircraft(), 47, 60.0, sensors=SensorOptions(command_lag=0.06))
    write_flight(flight, folder / "bag")
    shape = {key: default_aircraft().source[key] for key in SHAPE}
    replay([str(folder / "bag")], aircraft_from_dict(shape), folder / "run")
    return folder / "run"


def test_the_lag_that_the_flight_shows_is_taken_and_said(run):
    opened = open_run(run)
    data = run_data(opened, opened.current)
    late, notes = with_late_surfaces(data)
    assert late.aircraft.sensors["control_surfaces"].lag == pytest.approx(0.06, abs=0.012)
    assert "a lag of 0.0" in notes[0]
    said = aircraft_from_dict({**data.aircraft.source, "sensors": {"control_surfaces": {"lag": 0.0}}})
    of_file = dataclasses.replace(data, aircraft=said)
    assert with_late_surfaces(of_file) == (of_file, [])


@pytest.mark.long
def test_what_is_refined_is_right(run):
    result = refine_run(run, lambda *_: (None, []), METHODS[0])
    truth = default_aircraft().coefficients
    by = {p["name"]: p["value"] for p in result["parameters"]}
    for name in ("Cl_p", "Cl_da", "Cm_de"):
        assert by[name] == pytest.approx(truth[name], rel=0.15)
    assert any("a lag of 0.0" in note for note in result["notes"])
