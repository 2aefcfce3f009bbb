"""A flight far from its first fix: the level there is not the level of the origin, and nothing may come of it."""

import numpy as np
import pytest

from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import EPOCH
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

GONE, BACK = 20.0, 40.0  # [s] nothing is recorded
AWAY = np.radians([2.0, 1.5])  # 222 km north, 110 km east


@pytest.fixture(scope="module")
def flown(aircraft):
    """Taken off at home, the rest of the flight 250 km away, with its truth."""
    flight = simulate_samples(aircraft, seed=8, duration=130.0, rate=200.0)
    samples, time = flight.samples, (flight.samples.stamp - flight.samples.stamp.min()) * 1e-9
    values = samples.values.copy()
    far = (samples.kind == Kind.GPS_POSITION) & (time > GONE)
    values[far, :2] += AWAY
    kept = (time < GONE) | (time > BACK)
    pipeline = Pipeline(aircraft)
    rows, _ = pipeline.push(Samples(samples.stamp, samples.kind, values)[kept])
    rest, _ = pipeline.flush()
    return flight, pipeline, np.vstack([rows, rest])


@pytest.mark.long
def test_height_and_speed_of_climb_are_true(flown):
    flight, pipeline, rows = flown
    settled = rows[rows[:, StateField.TIME] > BACK + 20.0]
    begin = (pipeline.state.epoch - EPOCH) * 1e-9
    truth = flight.truth.at(settled[:, StateField.TIME] + begin)
    altitude = settled[:, StateField.ORIGIN.stop - 1] - settled[:, StateField.POSITION.stop - 1]
    climb = settled[:, StateField.VELOCITY.stop - 1] - truth.velocity[:, 2]
    assert abs(float(np.mean(altitude - truth.origin[2] + truth.position[:, 2]))) < 3.0
    assert abs(float(np.mean(climb))) < 0.05


@pytest.mark.long
def test_position_and_velocity_agree(flown):
    _, pipeline, _ = flown
    consistency = pipeline.state.innovation_consistency()
    assert consistency["gps_position"] < 2.0 and consistency["gps_velocity"] < 2.0


def test_the_main_derivatives_are_right(flown):
    flight, pipeline, _ = flown
    found = {p.name: p for p in pipeline.parameters.snapshot().parameters}
    for name in ("CZ_alpha", "Cm_alpha", "Cm_de", "Cl_da", "Cn_beta"):
        assert found[name].value == pytest.approx(flight.aircraft.coefficients[name], rel=0.04), name
