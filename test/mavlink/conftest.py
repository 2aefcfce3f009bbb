"""A short flight of the stand-in, shared by the tests of the MAVLink side."""

from pathlib import Path

import pytest

from aircraft_sysid_ros.mavlink.calibration import load_calibration

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def calibration():
    """That of the stand-in."""
    return load_calibration(REPOSITORY / "config" / "stand_in_calibration.yaml")


@pytest.fixture(scope="session")
def events(aircraft):
    """Samples of 45 s of simulated flight."""
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
    from aircraft_sysid_ros.simulation.stand_in.sensors import FlightSensors, pieces

    flight = simulate_samples(aircraft, seed=4, duration=45.0)
    sensors = FlightSensors(aircraft, 4)
    return [event for piece in pieces(flight.truth) for event in sensors.events(piece)]
