"""A flight whose record is made from the truth, without the chain between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.atmosphere import speed_of_sound
from aircraft_sysid_ros.aircraft.earth import gravity
from aircraft_sysid_ros.flight_model.layout import (
    INPUT_SIZE,
    REFERENCE,
    STATE_SIZE,
    FlightModel,
    flight_model_of,
    make_theta,
)
from aircraft_sysid_ros.sensors.sensor_models import air_data_at, specific_force_at, turned
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

BIASES = np.array([0.1, -0.05, 0.08, 0.004, -0.006, 0.002])


@dataclass
class TrueRecord:
    """States, inputs and outputs without noise of a simulated flight at some times."""

    model: FlightModel
    theta: np.ndarray[Any, Any]
    time: np.ndarray[Any, Any]
    states: np.ndarray[Any, Any]
    inputs: np.ndarray[Any, Any]
    outputs: np.ndarray[Any, Any]


def record_of(flight, rate: float, begin: float = 0.0, end: float = np.inf) -> TrueRecord:
    """Truth at ``rate`` [Hz] between two times [s], as the flight model has it."""
    aircraft, truth = flight.aircraft, flight.truth
    every = round(400.0 / rate)
    t = truth[(truth.time >= begin) & (truth.time <= end)][slice(None, None, every)]
    states = np.empty((len(t), STATE_SIZE))
    states[:, 0:3], states[:, 3:6], states[:, 6:10] = t.velocity, t.position, t.quaternion
    states[:, 10:13], states[:, 13:16] = t.rates, t.wind
    inputs = np.zeros((len(t), INPUT_SIZE))
    inputs[:, 0:7], inputs[:, 7], inputs[:, 8] = t.controls, t.density, t.height
    inputs[:, 9] = [speed_of_sound(truth.origin[2] - down) for down in t.position[:, 2]]
    inputs[:, 10], inputs[:, REFERENCE] = t.time, t.quaternion
    y = np.zeros((len(t), 18))
    y[:, 0:3] = specific_force_at(t, aircraft.imu_position) + BIASES[:3]
    y[:, 3:6] = t.rates + BIASES[3:]
    y[:, 6:9] = t.position + turned(t.quaternion, aircraft.gps_position)
    y[:, 9:12] = t.velocity + turned(t.quaternion, np.cross(t.rates, aircraft.gps_position))
    y[:, 15:18] = air_data_at(t, aircraft.air_data_position)
    g = float(gravity(truth.origin[0], truth.origin[2]))
    model = flight_model_of(aircraft, g)
    coefficients = np.array([aircraft.coefficients[name] for name in aircraft.model.parameter_names])
    return TrueRecord(model, make_theta(model, coefficients, BIASES), t.time.copy(), states, inputs, y)


@pytest.fixture(scope="session")
def calm_flight(aircraft):
    """Steady wind from the side, all manoeuvres."""
    return simulate_samples(aircraft, seed=2, duration=60.0, wind_walk=0.0)


@pytest.fixture(scope="session")
def record(calm_flight):
    """Its truth at 50 Hz."""
    return record_of(calm_flight, 50.0)


@pytest.fixture(scope="session")
def fast_record(calm_flight):
    """Ten seconds of it at 200 Hz: so fast that controls are linear between samples."""
    return record_of(calm_flight, 200.0, 10.0, 20.0)
