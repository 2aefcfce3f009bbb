"""A fast IMU, averaged for the likelihood of the sensors: means, gaps, and the same likelihoods."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.diagnosis.flight import reconstruction
from aircraft_sysid_ros.diagnosis.flight.reconstruction import likelihood_as_learnt, log_likelihood
from aircraft_sysid_ros.diagnosis.flight.slower_imu import with_slower_imu
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

MILLISECOND = 1_000_000


@pytest.fixture(scope="module")
def aircraft():
    return load_aircraft(config_path("ultra_stick_25e.yaml"))


def imu(stamps, rng=None):
    """Samples of the IMU at stamps [ms]."""
    stamp = np.asarray(stamps, dtype=np.int64) * MILLISECOND
    values = np.arange(6.0 * len(stamp)).reshape(-1, 6) if rng is None else rng.normal(size=(len(stamp), 6))
    return samples_of(Kind.IMU, stamp, values)


def test_neighbours_are_one_at_the_middle_of_their_times(aircraft):
    samples = imu(range(0, 80, 5))
    changed, slower = with_slower_imu(aircraft, samples)
    assert slower.stamp.tolist() == [7_500_000, 27_500_000, 47_500_000, 67_500_000]
    np.testing.assert_allclose(slower.values[:, :6], samples.values[:, :6].reshape(4, 4, 6).mean(axis=1))
    for name in ("accelerometer", "gyro"):
        half = np.array(aircraft.sensors[name].noise) / 2.0
        np.testing.assert_allclose(changed.sensors[name].noise, half)


@pytest.mark.parametrize("rate", [10, 25, 50, 60, 90])
def test_a_slow_imu_stays_as_it_is(aircraft, rate):
    samples = imu(np.arange(40) * (1000 // rate))
    changed, slower = with_slower_imu(aircraft, samples)
    assert changed is aircraft and slower is samples


def test_no_mean_reaches_over_a_gap_a_seam_or_a_step_back(aircraft):
    first, after_gap, before = imu(range(0, 30, 10)), imu(range(100, 150, 10)), imu(range(60, 100, 10))
    seam = samples_of(Kind.SEAM, [99 * MILLISECOND])
    samples = concatenate([first, after_gap, before, seam, imu(range(100, 130, 10))])
    _, slower = with_slower_imu(aircraft, samples)
    found = (slower.stamp[slower.kind == Kind.IMU] / MILLISECOND).tolist()
    assert found == [5.0, 20.0, 105.0, 125.0, 140.0, 65.0, 85.0, 105.0, 120.0]
    assert np.sum(slower.kind == Kind.SEAM) == 1


def test_what_is_no_measurement_is_in_no_mean(aircraft):
    samples = imu(range(0, 60, 10))
    samples.values[1, 2], samples.values[2, 0], samples.values[4:6, 3] = np.nan, 1e30, np.inf
    _, slower = with_slower_imu(aircraft, samples)
    np.testing.assert_array_equal(slower.values[0, :6], samples.values[0, :6])
    np.testing.assert_array_equal(slower.values[1, :6], samples.values[3, :6])
    assert slower.stamp.tolist()[:2] == [0, 30 * MILLISECOND]
    assert not np.isfinite(slower.values[2, :6]).all()  # and the filter rejects it, as it would have


def test_of_a_fast_attitude_one_in_so_many_is_left(aircraft):
    stamp = np.arange(0, 100, 5) * MILLISECOND
    attitude = samples_of(Kind.ATTITUDE, stamp, np.tile([1.0, 0.0, 0.0, 0.0], (20, 1)))
    _, slower = with_slower_imu(aircraft, concatenate([imu(range(0, 100, 5)), attitude]))
    assert slower.stamp[slower.kind == Kind.ATTITUDE].tolist() == stamp[::4].tolist()


@pytest.mark.long
@pytest.mark.parametrize("rate", [100, 200])
def test_likelihoods_of_settings_are_those_of_all_samples(aircraft, monkeypatch, rate):
    """Of a scale, an offset, a place and delays that the flight has or has not: to 3 %, or to 1 of what decides."""
    known = aircraft.source["sensors"]
    fast = {name: {**known[name], "rate": rate} for name in ("accelerometer", "gyro")}
    known = aircraft_from_dict({**aircraft.source, "sensors": {**known, **fast}})
    gps = {name: {**known.source["sensors"][name], "delay": 0.12} for name in ("gps_position", "gps_velocity")}
    flown = aircraft_from_dict({**known.source, "sensors": {**known.source["sensors"], **gps}})
    samples = simulate_samples(flown, 31, 60.0).samples
    settings = [
        (("sensors", "gps", "delay"), 0.12), (("sensors", "airspeed", "scale"), 1.05),
        (("sensors", "angle_of_attack", "offset"), 0.02), (("imu_position", "x"), 0.1),
        (("sensors", "air_data", "delay"), 0.03), (("sensors", "imu", "delay"), 0.03),
    ]  # fmt: skip

    def gains():
        before = likelihood_as_learnt(known, samples)
        found = [log_likelihood(with_setting(known, *s), samples, before.noise).over(before) for s in settings]
        return np.array(found)

    slower = gains()
    monkeypatch.setattr(reconstruction, "with_slower_imu", lambda file, all_samples: (file, all_samples))
    fast_imu = gains()
    assert fast_imu[0] > 100.0 and fast_imu.min() < -20.0  # they say something
    np.testing.assert_allclose(slower, fast_imu, rtol=0.03, atol=1.0)
