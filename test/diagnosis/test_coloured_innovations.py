"""Innovations count as often as they are independent: an attitude with an error of its own proves no scale."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis.flight.reconstruction import Likelihood, log_likelihood
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples


@pytest.fixture(scope="module")
def flight():
    """A minute at 100 Hz in steady wind."""
    return simulate_samples(default_aircraft(), 71, 60.0, sensors=SensorOptions(attitude=True))


def overstated(samples, sigma):
    """The same flight whose attitude says that it has noise of ``sigma`` [rad]."""
    values = samples.values.copy()
    values[samples.kind == Kind.ATTITUDE, 4:7] = sigma**2
    return Samples(samples.stamp, samples.kind, values)


def test_where_the_noise_is_that_of_the_file_almost_all_count(flight):
    found = log_likelihood(flight.aircraft, flight.samples).independent
    kinds = (Kind.GPS_POSITION, Kind.GPS_VELOCITY, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
    assert min(found[kind] for kind in kinds) > 0.7


def test_a_noise_that_stands_for_more_than_noise_makes_few_independent_innovations(flight):
    """Told ten times the noise that it has, the filter follows it slowly, and what is left has a colour."""
    bare = {k: v for k, v in flight.aircraft.source.items() if k not in ("sensors", "process_noise")}
    aircraft, samples = aircraft_from_dict(bare), overstated(flight.samples, 0.05)
    true = log_likelihood(aircraft, samples)
    assert true.independent[Kind.ATTITUDE] < 0.2 < 0.5 < true.independent[Kind.ANGLE_OF_ATTACK]
    for scale in (0.9, 1.1):
        wrong = log_likelihood(with_setting(aircraft, ("sensors", "airspeed", "scale"), scale), samples)
        assert wrong.over(true) < 0.0 < true.over(wrong)


def test_a_sensor_counts_as_white_as_the_whiter_of_two_hypotheses_has_it():
    """The fault itself colours innovations: what is right about the sensor must not be discounted for that."""
    wrong = Likelihood(np.array([-100.0, -50.0]), np.array([0.1, 1.0]), 0.0)
    right = Likelihood(np.array([-40.0, -55.0]), np.array([1.0, 0.5]), 0.0)
    assert right.over(wrong) == pytest.approx(60.0 - 5.0) and wrong.over(right) == pytest.approx(-55.0)
    lost = Likelihood(np.full(2, -np.inf), np.zeros(2), 0.0)
    assert lost.over(right) == -np.inf
