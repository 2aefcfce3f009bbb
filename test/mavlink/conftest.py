"""A short flight of the MAVLink simulator, shared by the tests of the MAVLink side."""

from pathlib import Path

import pytest

from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def mapping():
    """That of the MAVLink simulator."""
    return load_servo_mapping(REPOSITORY / "config" / "mavlink_simulator_servos.yaml")


@pytest.fixture(scope="session")
def events(aircraft):
    """Samples of 45 s of simulated flight."""
    from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import FlightSensors, pieces
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

    flight = simulate_samples(aircraft, seed=4, duration=45.0)
    sensors = FlightSensors(aircraft, 4)
    return [event for piece in pieces(flight.truth) for event in sensors.events(piece)]
