"""A run says what sensors that no aircraft file describes do to whoever takes them as they are, as ``refine`` does."""

import numpy as np
import pytest
from aircraft_files import of_shape

from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.model_file import parameters_json
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, default_aircraft, simulate_samples


@pytest.fixture(scope="module")
def flight() -> SimulatedFlight:
    return simulate_samples(default_aircraft(), 41, 20.0)


def flown(aircraft, flight: SimulatedFlight) -> Identifier:
    pipeline = Pipeline(aircraft)
    pipeline.push(flight.samples)
    pipeline.flush()
    return pipeline.parameters


@pytest.mark.parametrize("sensors", [{"control_surfaces": {"delay": 0.0}}, {}], ids=["vanes", "surfaces, too"])
def test_what_sensors_do_that_nobody_described_is_told(flight: SimulatedFlight, sensors: dict[str, object]) -> None:
    """What least squares is freed of, and what is left of it; also of surfaces that may be late, and are not surely."""
    identifier = flown(of_shape(flight.aircraft, places=False, sensors=sensors), flight)
    told, learning = parameters_json(identifier)["std_of_sensors"], identifier.learning
    assert not learning.late_surfaces
    described = learning._describe(learning.least_squares.state, identifier.time, learning.fleet.axes)
    square = np.concatenate([np.diag(found.covariance + found.found) for found in described.of_sensors()])
    std = np.array([told[name] for name in identifier.model.parameter_names])
    np.testing.assert_allclose(std**2, square, rtol=1e-9)
    shift = np.concatenate([found.shift for found in described.of_sensors()])
    assert np.abs(shift).max() > 0.0 and np.all(np.sqrt(3.0) * std > np.abs(shift))  # of two angles and surfaces


def test_described_sensors_leave_nothing_in_doubt(flight: SimulatedFlight) -> None:
    assert "std_of_sensors" not in parameters_json(flown(flight.aircraft, flight))
