"""Runs of short simulated flights, without folders."""

import numpy as np
import pytest

from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.model_file import parameters_json
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.refinement.run_data import RunData
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.stamps import nanoseconds


def run_of(flight):
    """What a run folder of the flight holds."""
    pipeline = Pipeline(flight.aircraft)
    points = np.vstack([pipeline.push(flight.samples)[1], pipeline.flush()[1]])
    state = pipeline.state.summary()
    return RunData(
        flight.aircraft,
        flight.samples,
        {p["name"]: p for p in parameters_json(pipeline.parameters)["parameters"]},
        np.array([*state["accelerometer_bias"], *state["gyro_bias"]]),
        nanoseconds(points[:, CoefficientSample.TIME], pipeline.state.epoch),
        points[:, CoefficientSample.MEASURED],
        points[:, CoefficientSample.TERMS :],
        noise=pipeline.parameters.learning.noise_of(points),
    )


@pytest.fixture(scope="session")
def make_run():
    """``run_of``, for tests with flights of their own."""
    return run_of


@pytest.fixture(scope="session")
def still_flight(aircraft):
    """Steady wind."""
    return simulate_samples(aircraft, seed=4, duration=30.0, wind_walk=0.0)


@pytest.fixture(scope="session")
def still_run(still_flight):
    """Its run."""
    return run_of(still_flight)


@pytest.fixture(scope="session")
def gusty_flight(aircraft):
    """Light turbulence."""
    return simulate_samples(aircraft, seed=3, duration=30.0, turbulence="light")


@pytest.fixture(scope="session")
def gusty_run(gusty_flight):
    """Its run."""
    return run_of(gusty_flight)
