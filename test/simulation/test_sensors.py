"""Sensors: bias, noise, rate, delay, place and arrival are those of the aircraft file."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft import earth
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.frames import (
    quaternion_conjugate,
    quaternion_log,
    quaternion_product,
    rotation_matrix,
)
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.sensors.five_hole_probe import ProbeCalibration
from aircraft_sysid_ros.sensors.sensor_models import (
    EPOCH,
    SensorOptions,
    air_data_at,
    arrived,
    measure,
    specific_force_at,
    stamps_of,
)
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.stamps import NANOSECONDS

EXACT = SensorOptions(
    noise_scale=0.0, accelerometer_bias=0.0, gyro_bias=0.0,
    attitude=True, magnetometer=True, five_hole_probe=True, height_above_ground=True,
)  # fmt: skip


@pytest.fixture(scope="module")
def still(aircraft):
    """The aircraft without random walks of its biases."""
    return replace(aircraft, process_noise={**aircraft.process_noise, "accelerometer_bias": 0.0, "gyro_bias": 0.0})


@pytest.fixture(scope="module")
def exact(still, flight):
    """Samples without errors, and the times of their stamps by kind."""
    streams, _ = measure(still, flight.truth, 0, EXACT)
    return arrived(streams)


def of_kind(samples, kind):
    rows = samples.kind == kind
    return (samples.stamp[rows] - EPOCH) / NANOSECONDS, samples.values[rows]


@pytest.mark.long
def test_errors_are_bias_and_noise_of_the_stated_size(aircraft, flight):
    time, values = of_kind(flight.samples, Kind.IMU)
    truth = flight.truth.at(time)
    force = values[:, :3] - specific_force_at(truth, aircraft.imu_position)
    rates = values[:, 3:6] - truth.rates
    for errors, bias, sensor in (
        (force, flight.biases.accelerometer, "accelerometer"),
        (rates, flight.biases.gyro, "gyro"),
    ):
        noise = errors - bias
        sigma = aircraft.sensors[sensor].noise[0]
        np.testing.assert_allclose(noise.std(axis=0), sigma, rtol=0.05)
        np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=4.0 * sigma / np.sqrt(len(noise)))
        lag_one = np.mean(noise[1:] * noise[:-1], axis=0) / sigma**2
        np.testing.assert_allclose(lag_one, 0.0, atol=4.0 / np.sqrt(len(noise)))
    np.testing.assert_allclose(values[:, 6:8] ** 0.5, np.tile([0.03, 0.002], (len(values), 1)))


@pytest.mark.long
def test_biases_differ_by_seed_and_walk_with_the_process_noise(aircraft, flight):
    drawn = [measure(aircraft, flight.truth[:400], seed, SensorOptions())[1] for seed in range(300)]
    assert np.std([b.accelerometer[0] for b in drawn]) == pytest.approx(0.15, rel=0.08)
    assert np.std([b.gyro[0] for b in drawn]) == pytest.approx(0.01, rel=0.08)
    steps = np.diff(flight.biases.gyro, axis=0) / np.sqrt(0.01)
    assert steps.std() == pytest.approx(aircraft.process_noise["gyro_bias"], rel=0.03)


@pytest.mark.parametrize(
    ("kind", "column", "sensor"),
    [
        (Kind.AIRSPEED, 0, "airspeed"),
        (Kind.ANGLE_OF_ATTACK, 1, "angle_of_attack"),
        (Kind.SIDESLIP, 2, "sideslip"),
    ],
)
def test_air_data_noise(aircraft, flight, kind, column, sensor):
    time, values = of_kind(flight.samples, kind)
    error = values[:, 0] - air_data_at(flight.truth.at(time), aircraft.air_data_position)[:, column]
    assert error.std() == pytest.approx(aircraft.sensors[sensor].noise[0], rel=0.05)
    assert abs(error.mean()) < 4.0 * error.std() / np.sqrt(len(error))


def test_rates_are_those_of_the_file_and_phases_differ(aircraft, flight):
    starts = set()
    for stream in flight.streams:
        sensor = {
            "imu/data": "gyro",
            "gps/fix": "gps_position",
            "gps/vel": "gps_velocity",
            "air_data": "airspeed",
        }
        rate = aircraft.sensors[sensor.get(stream.topic, "control_surfaces")].rate
        np.testing.assert_allclose(np.diff(stream.stamp), NANOSECONDS / rate, atol=1)
        starts.add(stream.stamp[0])
    assert len(starts) == 4  # both GPS messages belong together


@pytest.mark.long
def test_the_accelerometer_reads_the_acceleration_of_its_place(flight, still, exact):
    """Twice the derivative of the way of the IMU through space, less gravity."""
    time, values = of_kind(exact, Kind.IMU)
    position = np.array([0.3, -0.2, 0.1])
    truth = flight.truth
    place = truth.position + np.array([rotation_matrix(q) @ position for q in truth.quaternion])
    step = truth.time[1] - truth.time[0]
    acceleration = (place[2:] - 2.0 * place[1:-1] + place[:-2]) / step**2
    gravity = np.array([0.0, 0.0, earth.gravity(truth.origin[0], truth.origin[2])])
    expected = np.array(
        [rotation_matrix(q).T @ (a - gravity) for q, a in zip(truth.quaternion[1:-1], acceleration, strict=True)]
    )
    error = specific_force_at(truth, position)[1:-1] - expected
    assert np.percentile(np.abs(error), 99) < 0.05
    without = truth.specific_force[1:-1] - expected
    assert np.percentile(np.abs(without), 99) > 0.5
    np.testing.assert_allclose(values[:, :3], specific_force_at(truth.at(time), still.imu_position), atol=1e-12)


@pytest.mark.long
def test_a_sample_shows_what_was_true_one_delay_before(aircraft, flight):
    source = dict(aircraft.source)
    source["sensors"] = {
        **source["sensors"],
        "airspeed": {"noise": 0.15, "rate": 50, "delay": 0.08},
        "gps_velocity": {"noise": 0.1, "rate": 5, "delay": 0.2},
    }
    late = aircraft_from_dict(source)
    streams, _ = measure(late, flight.truth, 0, SensorOptions(noise_scale=0.2))
    samples = arrived(streams)
    assert (samples.stamp.min() - EPOCH) / NANOSECONDS >= 0.2  # nothing is stamped before its truth began

    def misfit(kind, true, lag):
        time, values = of_kind(samples, kind)
        return np.mean((values[:, 0] - true(flight.truth.at(time - lag))) ** 2)

    lags = np.arange(0.0, 0.4, 0.01)
    airspeed = [misfit(Kind.AIRSPEED, lambda t: air_data_at(t, late.air_data_position)[:, 0], x) for x in lags]
    velocity = [misfit(Kind.GPS_VELOCITY, lambda t: t.velocity[:, 0], x) for x in lags]
    assert lags[np.argmin(airspeed)] == pytest.approx(0.08, abs=0.011)
    assert lags[np.argmin(velocity)] == pytest.approx(0.2, abs=0.011)


def test_gps_without_noise_is_its_antenna(flight, still, exact):
    time, values = of_kind(exact, Kind.GPS_POSITION)
    truth = flight.truth.at(time)
    antenna = truth.position + np.array([rotation_matrix(q) @ still.gps_position for q in truth.quaternion])
    ned = earth.ned_along(np.array(values), truth.origin)
    np.testing.assert_allclose(ned, antenna, atol=1e-5)
    _, velocity = of_kind(exact, Kind.GPS_VELOCITY)
    arm = np.array([rotation_matrix(q) @ np.cross(w, still.gps_position)
                    for q, w in zip(truth.quaternion, truth.rates, strict=True)])  # fmt: skip
    np.testing.assert_allclose(velocity[:, :3], truth.velocity + arm, atol=1e-9)


def test_attitude_field_height_and_air_without_noise(flight, still, exact):
    time, values = of_kind(exact, Kind.AIR)
    truth = flight.truth.at(time)
    np.testing.assert_allclose(values[:, 0], truth.density, rtol=1e-12)
    np.testing.assert_allclose(values[:, 1], truth.static_pressure, rtol=1e-12)
    time, values = of_kind(exact, Kind.HEIGHT)
    np.testing.assert_allclose(values[:, 0], flight.truth.at(time).height, rtol=1e-6)  # Range holds float32
    time, values = of_kind(exact, Kind.MAGNETIC_FIELD)
    level = np.array(
        [rotation_matrix(q) @ v[:3] for q, v in zip(flight.truth.at(time).quaternion, values, strict=True)]
    )
    np.testing.assert_allclose(np.arctan2(level[:, 1], level[:, 0]), still.magnetic_declination, atol=1e-12)


def test_attitude_noise_is_a_turn_of_the_stated_size(aircraft, flight):
    streams, _ = measure(aircraft, flight.truth, 0, SensorOptions(attitude=True))
    time, values = of_kind(arrived(streams), Kind.ATTITUDE)
    true = flight.truth.at(time).quaternion
    errors = np.array(
        [quaternion_log(quaternion_product(quaternion_conjugate(q), v[:4])) for q, v in zip(true, values, strict=True)]
    )
    np.testing.assert_allclose(errors.std(axis=0), aircraft.sensors["attitude"].noise[0], rtol=0.05)


def test_probe_pressures_give_the_flow_back_by_its_calibration(still, flight):
    """(36) of the two-stage paper forwards, from the pressures that were made backwards."""
    probe = ProbeCalibration(4.2, 3.7, 0.05, 0.3, -0.04, 0.02, 0.06, -0.03)
    streams, _ = measure(still, flight.truth, 0, replace(EXACT, probe=probe))
    time, values = of_kind(arrived(streams), Kind.FIVE_HOLE)
    truth = flight.truth.at(time)
    impact = values[:, 1]
    airspeed = (1.0 + 0.05) * np.sqrt(2.0 * impact / truth.density) + 0.3
    alpha = (1.0 - 0.04) * values[:, 2] / (4.2 * impact) + 0.02
    beta = (1.0 + 0.06) * values[:, 3] / (3.7 * impact) - 0.03
    flow = air_data_at(truth, still.air_data_position)
    np.testing.assert_allclose(np.column_stack([airspeed, alpha, beta]), flow, atol=1e-9)


def test_controls_have_the_signs_that_the_recording_has(still, flight):
    turned = replace(still, surface_signs={**still.surface_signs, "rudder": -1.0})
    streams, _ = measure(turned, flight.truth, 0, EXACT)
    time, values = of_kind(arrived(streams), Kind.CONTROLS)
    truth = flight.truth.at(time).controls
    np.testing.assert_allclose(values[:, 2], -truth[:, 2], atol=1e-12)
    np.testing.assert_allclose(values[:, [0, 1, 4, 5]], truth[:, [0, 1, 4, 5]], atol=1e-12)


def test_messages_arrive_in_order_of_arrival_and_not_of_stamps(flight):
    stamps = flight.samples.stamp
    assert np.any(np.diff(stamps) < 0)
    for kind in (Kind.IMU, Kind.AIRSPEED, Kind.GPS_POSITION):
        assert np.all(np.diff(stamps[flight.samples.kind == kind]) > 0)
    for stream in flight.streams:
        assert np.all(stream.arrival > stream.stamp)


def test_without_transport_messages_arrive_as_they_are_stamped(aircraft, flight):
    streams, _ = measure(aircraft, flight.truth, 0, SensorOptions(transport_scale=0.0))
    assert np.all(np.diff(arrived(streams).stamp) >= 0)


@pytest.mark.long
def test_the_same_seed_gives_the_same_bits_and_another_does_not(aircraft):
    first, again, other = (simulate_samples(aircraft, seed, 30.0, turbulence="light") for seed in (5, 5, 6))
    for name in ("stamp", "kind", "values"):
        np.testing.assert_array_equal(getattr(first.samples, name), getattr(again.samples, name))
    assert not np.array_equal(first.truth.wind, other.truth.wind)
    assert not np.array_equal(first.biases.gyro, other.biases.gyro)


def test_more_sensors_do_not_change_the_others(aircraft, flight):
    more = SensorOptions(attitude=True, magnetometer=True, five_hole_probe=True, height_above_ground=True)
    streams, _ = measure(aircraft, flight.truth, flight.seed, more)
    samples = arrived(streams)
    for kind in (Kind.IMU, Kind.GPS_POSITION, Kind.CONTROLS):
        np.testing.assert_array_equal(of_kind(samples, kind)[1], of_kind(flight.samples, kind)[1])


def test_stamps_are_whole_nanoseconds_of_the_epoch():
    assert stamps_of([0.0, 0.0131, 100.25]).tolist() == [EPOCH, EPOCH + 13_100_000, EPOCH + 100_250_000_000]
