"""Flights that several tests look at."""

import pytest

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


@pytest.fixture(scope="session")
def aircraft():
    return load_aircraft(config_path(DEFAULT_AIRCRAFT))


@pytest.fixture(scope="session")
def flight(aircraft):
    return simulate_samples(aircraft, seed=3, duration=120.0)
