"""Flights that several tests look at."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft import rigid_body
from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


@pytest.fixture(scope="session")
def aircraft():
    return load_aircraft(config_path(DEFAULT_AIRCRAFT))


@pytest.fixture(scope="session")
def flight(aircraft):
    return simulate_samples(aircraft, seed=3, duration=120.0)


@pytest.fixture(scope="session")
def measured_coefficients():
    """Function of aircraft and truth that works the coefficients out of the motion."""
    return coefficients_of_motion


def coefficients_of_motion(aircraft, truth):
    """Coefficients from mass, specific force, rates and angular acceleration: (6.14)-(6.19) backwards."""
    rows = []
    for i in range(len(truth)):
        force = aircraft.mass * truth.specific_force[i]
        moment = rigid_body.moment_of_motion(truth.angular_acceleration[i], truth.rates[i], aircraft.inertia)
        moment = rigid_body.moment_at_reference(moment, force, aircraft.aerodynamic_reference)
        qbar = 0.5 * truth.density[i] * truth.airspeed[i] ** 2
        rows.append(rigid_body.coefficients_of(force, moment, qbar, aircraft.wing_area, aircraft.span, aircraft.chord))
    return np.array(rows)
