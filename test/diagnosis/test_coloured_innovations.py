"""Innovations count as often as they are independent: an attitude with an error of its own proves no scale."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis.flight.reconstruction import Likelihood, likelihood_as_learnt, log_likelihood
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.reconstruction.state import LearntNoise
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

#: Of a filter that nobody runs.
NOISE = LearntNoise(np.ones((1, 3)), np.ones((7, 6)), np.ones(1))


@pytest.fixture(scope="module")
def flight():
    """A minute at 100 Hz in steady wind."""
    return simulate_samples(default_aircraft(), 71, 60.0, sensors=SensorOptions(attitude=True))


def bare(aircraft):
    """What is said of an aircraft without noise."""
    return aircraft_from_dict({k: v for k, v in aircraft.source.items() if k not in ("sensors", "process_noise")})


def overstated(samples, sigma):
    """The same flight whose attitude says that it has noise of ``sigma`` [rad]."""
    values = samples.values.copy()
    values[samples.kind == Kind.ATTITUDE, 4:7] = sigma**2
    return Samples(samples.stamp, samples.kind, values)


def tilting(samples, size, period):
    """The same flight whose attitude rolls to and fro by ``size`` [rad] in ``period`` [s], which it does not."""
    values, at = samples.values.copy(), samples.kind == Kind.ATTITUDE
    time = (samples.stamp[at] - samples.stamp[0]) * 1e-9
    tilt = Rotation.from_rotvec(np.outer(size * np.sin(2.0 * np.pi * time / period), [1.0, 0.0, 0.0]))
    values[at, :4] = (Rotation.from_quat(values[at, :4], scalar_first=True) * tilt).as_quat(scalar_first=True)
    return Samples(samples.stamp, samples.kind, values)


@pytest.mark.long
def test_where_the_noise_is_that_of_the_file_almost_all_count(flight):
    found = log_likelihood(flight.aircraft, flight.samples).independent
    kinds = (Kind.GPS_POSITION, Kind.GPS_VELOCITY, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
    assert min(found[kind] for kind in kinds) > 0.7


def test_a_noise_that_stands_for_more_than_noise_makes_few_independent_innovations(flight):
    """Told ten times the noise that it has, the filter follows it slowly, and what is left has a colour."""
    aircraft, samples = bare(flight.aircraft), overstated(flight.samples, 0.05)
    true = likelihood_as_learnt(aircraft, samples)
    # of a fast attitude every second sample is left, of which twice the share is independent
    assert true.independent[Kind.ATTITUDE] < 0.4 < 0.5 < true.independent[Kind.ANGLE_OF_ATTACK]
    for scale in (0.9, 1.1):
        wrong = log_likelihood(with_setting(aircraft, ("sensors", "airspeed", "scale"), scale), samples, true.noise)
        assert wrong.over(true) < 0.0 < true.over(wrong)


def test_a_sensor_counts_as_white_as_the_whiter_of_two_hypotheses_has_it():
    """The fault itself colours innovations: what is right about the sensor must not be discounted for that."""
    wrong = Likelihood(np.array([-100.0, -50.0]), np.array([0.1, 1.0]), 0.0, NOISE)
    right = Likelihood(np.array([-40.0, -55.0]), np.array([1.0, 0.5]), 0.0, NOISE)
    assert right.over(wrong) == pytest.approx(60.0 - 5.0) and wrong.over(right) == pytest.approx(-55.0)
    lost = Likelihood(np.full(2, -np.inf), np.zeros(2), 0.0, NOISE)
    assert lost.over(right) == -np.inf


@pytest.mark.long
@pytest.mark.parametrize("delay", [0.04, 0.08, 0.14])
def test_an_attitude_says_nothing_of_a_late_probe(flight, delay):
    """A filter that starts later learns another noise of an attitude that errs, and its likelihood jumps."""
    aircraft, samples = bare(flight.aircraft), tilting(flight.samples, 0.06, 13.0)
    late = with_setting(aircraft, ("sensors", "air_data", "delay"), delay)
    before, by_itself = likelihood_as_learnt(aircraft, samples), log_likelihood(aircraft, samples)
    of_attitude = [
        after.parts[Kind.ATTITUDE] - without.parts[Kind.ATTITUDE]
        for after, without in (
            (log_likelihood(late, samples, before.noise), before),
            (log_likelihood(late, samples), by_itself),
        )
    ]
    assert abs(of_attitude[0]) < 8.0 and abs(of_attitude[0]) < 0.6 * abs(of_attitude[1])


def test_a_filter_that_is_told_the_noise_learns_none(flight):
    learnt = log_likelihood(bare(flight.aircraft), flight.samples).noise
    told = log_likelihood(
        bare(flight.aircraft), flight.samples[flight.samples.kind != Kind.ANGLE_OF_ATTACK], learnt
    ).noise
    assert not np.all(learnt.scales == 1.0)
    np.testing.assert_array_equal(told.scales, learnt.scales)
    np.testing.assert_array_equal(told.imu, learnt.imu)
