"""Flights that lack a sensor: the filter starts with what is there, is as good as it says, and loses no sample."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from aircraft_sysid_ros.aircraft.atmosphere import pressure
from aircraft_sysid_ros.aircraft.frames import (
    quaternion_conjugate,
    quaternion_from_euler,
    quaternion_log,
    quaternion_product,
    rotation_matrix,
)
from aircraft_sysid_ros.reconstruction.absences import absences
from aircraft_sysid_ros.reconstruction.alignment import Alignment
from aircraft_sysid_ros.reconstruction.error_state import retract
from aircraft_sysid_ros.reconstruction.filter_setup import CALM_STD, gate_thresholds, new_setup
from aircraft_sysid_ros.reconstruction.found_noise import found_noise
from aircraft_sysid_ros.reconstruction.gps_wait import PATIENCE
from aircraft_sysid_ros.reconstruction.measurements import residual_and_jacobian
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.pseudo_measurements import (
    PERIOD,
    count_heading_from_now,
    hold_wind,
    no_wind,
)
from aircraft_sysid_ros.reconstruction.state import (
    D_ATTITUDE,
    D_POSITION,
    ERROR_SIZE,
    GUST_STD,
    NO_GUIDE,
    STATE_SIZE,
    StateField,
    Status,
)
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.reconstruction.state_row import wind_jacobian
from aircraft_sysid_ros.samples import Kind, samples_of
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

GPS = (Kind.GPS_POSITION, Kind.GPS_VELOCITY)
VANES = (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
STD = StateField.STANDARD_DEVIATIONS
SECOND = 10**9


def lacking(samples, *kinds):
    return samples[~np.isin(samples.kind, kinds)]


def run(aircraft, samples, block=5000, **options):
    estimator = StateEstimator(aircraft, StateOptions(**options))
    rows = [estimator.push(samples[i : i + block]) for i in range(0, len(samples), block)]
    return estimator, np.vstack([*rows, estimator.flush()])


def truth_of(flight, estimator, rows):
    time = rows[:, StateField.TIME] + (estimator.epoch - flight.biases.stamp[0]) * 1e-9
    return flight.truth.at(time), time


def in_sigma(flight, estimator, rows, after=30.0):
    """Errors over standard deviations, by name: of tilt, which has no heading in it, airspeed, angles and biases."""
    truth, time = truth_of(flight, estimator, rows)
    late = np.flatnonzero(time > after)[::20]
    tilt = []
    for i in late:
        turned = rotation_matrix(
            quaternion_product(quaternion_conjugate(rows[i, StateField.ATTITUDE]), truth.quaternion[i])
        )
        down = rotation_matrix(rows[i, StateField.ATTITUDE])[2]
        true_down = turned @ rotation_matrix(truth.quaternion[i]).T[:, 2]
        axis = np.cross(down, np.array([1.0, 0.0, 0.0]))
        axis = axis / np.linalg.norm(axis)  # about pitch: across the vertical
        spread = rows[i, STD][6:9]
        tilt.append(float(axis @ np.cross(down, true_down)) / np.sqrt(np.sum((axis * spread) ** 2)))
    std = rows[late, StateField.AIR_VELOCITY_STD]
    return {
        "tilt": np.array(tilt),
        "alpha": (rows[late, StateField.ANGLE_OF_ATTACK] - truth.alpha[late]) * rows[late, StateField.AIRSPEED] / std,
        "beta": (rows[late, StateField.SIDESLIP] - truth.beta[late]) * rows[late, StateField.AIRSPEED] / std,
        "accelerometer bias": (rows[late, StateField.ACCELEROMETER_BIAS] - flight.biases.accelerometer[-1])
        / rows[late, STD][:, 9:12],
        "gyro bias": (rows[late, StateField.GYRO_BIAS] - flight.biases.gyro[-1]) / rows[late, STD][:, 12:15],
    }


@pytest.fixture(scope="module")
def with_attitude(aircraft):
    return simulate_samples(aircraft, seed=31, duration=90.0, sensors=SensorOptions(attitude=True))


@pytest.mark.parametrize(
    ("kinds", "status", "said"),
    [
        ((Kind.GPS_VELOCITY,), Status.OK, "no GPS velocity"),
        ((Kind.GPS_POSITION,), Status.OK, "no GPS position"),
        (GPS, Status.WITHOUT_GPS, "no GPS: wind is not estimated"),
        ((*GPS, Kind.AIR), Status.WITHOUT_GPS, "the air density is the standard one at 290 m"),
    ],
)
def test_errors_are_as_large_as_the_filter_says(flight, aircraft, kinds, status, said):
    estimator, rows = run(aircraft, lacking(flight.samples, *kinds))
    truth, time = truth_of(flight, estimator, rows)
    assert time[0] < 1.5 and estimator.realignments == 0
    assert set(rows[time > 3.0, StateField.STATUS]) == {status}
    for name, z in in_sigma(flight, estimator, rows).items():
        assert np.sqrt(np.mean(z**2)) < 2.2, name
        assert np.abs(z).max() < 6.0, name
    settled = time > 20.0
    assert np.abs(rows[settled, StateField.AIRSPEED] - truth.airspeed[settled]).max() < 0.3
    for kind, nis in estimator.innovation_consistency().items():
        assert nis == pytest.approx(1.0, abs=0.15), kind
    assert any(said in note for note in absences(estimator))


def test_position_alone_still_finds_wind_and_heading(flight, aircraft):
    estimator, rows = run(aircraft, lacking(flight.samples, Kind.GPS_VELOCITY))
    truth, _ = truth_of(flight, estimator, rows)
    found, std = rows[-1, StateField.WIND], rows[-1, STD][15:]
    assert np.abs((found - truth.wind[-1]) / std).max() < 5.0 and std.max() < 0.5
    heading = quaternion_log(
        quaternion_product(quaternion_conjugate(rows[-1, StateField.ATTITUDE]), truth.quaternion[-1])
    )
    assert np.abs(heading / rows[-1, STD][6:9]).max() < 5.0


def test_vanes_of_another_flight_are_none_of_this_one(flight, aircraft):
    """Flown without vanes after a flight that had some: angles were those of vanes that are lost, and so NaN."""
    with_vanes, without = flight.samples, lacking(flight.samples, *VANES)
    alone, after = StateEstimator(aircraft), StateEstimator(aircraft)
    after.push(with_vanes[with_vanes.stamp < with_vanes.stamp.min() + 10 * 10**9])
    after.begin_anew(np.nan)
    counts = after.counts()
    expected, found = (np.vstack([each.push(without), each.flush()]) for each in (alone, after))
    assert set(found[:, StateField.STATUS]) == set(expected[:, StateField.STATUS]) == {Status.INFERRED_ANGLES}
    known, wanted = (np.isfinite(rows[:, StateField.ANGLE_OF_ATTACK]).mean() for rows in (found, expected))
    assert wanted > 0.3 and abs(known - wanted) < 0.1
    total = after.counts()
    assert total["angle_of_attack"] == counts["angle_of_attack"] and counts["angle_of_attack"]["fused"] > 100
    fused = sum(each["fused"] for each in total.values())
    assert found[-1, StateField.FUSED] == fused > sum(each["fused"] for each in counts.values())
    assert "angle_of_attack" in {each.name for each in found_noise(after)}


def test_without_gps_the_wind_is_no_number_and_what_is_unknown_stays_bounded(flight, aircraft):
    """NaN, never 0. The velocity is relative to the air, and its uncertainty that of gusts, after any time."""
    estimator, rows = run(aircraft, lacking(flight.samples, *GPS))
    assert np.all(np.isnan(rows[:, StateField.WIND])) and np.all(np.isnan(rows[:, STD][:, 15:]))
    assert np.all(np.isnan(rows[:, StateField.ORIGIN][:, :2]))
    summary = estimator.summary()
    assert summary["wind_ned"] == [None] * 3 and summary["wind_ned_std"] == [None] * 3
    truth, time = truth_of(flight, estimator, rows)
    speed = np.linalg.norm(rows[:, StateField.VELOCITY], axis=1)
    assert np.abs(speed - truth.airspeed)[time > 5.0].max() < 1.5
    assert rows[:, STD][:, :3].max() < 1.5 * GUST_STD[0]
    assert np.linalg.eigvalsh(estimator.covariance).min() > -1e-12
    height = rows[:, StateField.ORIGIN.stop - 1] - rows[:, StateField.POSITION.stop - 1]
    climbed = truth.position[:, 2] - truth.position[0, 2]
    assert np.std(height + climbed) < 0.5  # the barometer, up to a constant


@pytest.mark.long
def test_an_attitude_gives_the_heading_without_gps(with_attitude, aircraft):
    estimator, rows = run(aircraft, lacking(with_attitude.samples, *GPS))
    truth, time = truth_of(with_attitude, estimator, rows)
    z = [
        quaternion_log(quaternion_product(quaternion_conjugate(q), true)) / std
        for q, true, std in zip(rows[:, StateField.ATTITUDE], truth.quaternion, rows[:, STD][:, 6:9], strict=True)
    ]
    late = np.array(z)[time > 20.0]
    assert np.sqrt(np.mean(late**2)) < 1.5 and np.abs(late).max() < 5.0
    assert not any("heading" in note for note in absences(estimator))


@pytest.mark.long
def test_without_vanes_and_gps_angles_need_an_attitude(with_attitude, flight, aircraft):
    """With it they are inferred as well as is said; without it nothing is claimed."""
    estimator, rows = run(aircraft, lacking(with_attitude.samples, *GPS, *VANES))
    truth, time = truth_of(with_attitude, estimator, rows)
    assert set(rows[time > 3.0, StateField.STATUS]) == {Status.WITHOUT_GPS_ANGLES}
    for column, true in ((StateField.ANGLE_OF_ATTACK, truth.alpha), (StateField.SIDESLIP, truth.beta)):
        given = np.isfinite(rows[:, column]) & (time > 3.0)
        assert given[time > 60.0].all()
        z = (
            (rows[given, column] - true[given])
            * rows[given, StateField.AIRSPEED]
            / rows[given, StateField.AIR_VELOCITY_STD]
        )
        assert np.sqrt(np.mean(z**2)) < 1.6 and np.abs(z).max() < 4.0
    estimator, rows = run(aircraft, lacking(flight.samples, *GPS, *VANES))
    assert np.all(np.isnan(rows[300:, StateField.ANGLE_OF_ATTACK])) and np.all(np.isfinite(rows[:, :20]))
    assert any("without GPS and attitude" in note for note in absences(estimator))


def test_calm_air_is_taken_only_on_request(aircraft):
    still = simulate_samples(aircraft, seed=32, duration=60.0, wind=(0.0, 0.0, 0.0), wind_walk=0.0)
    samples = lacking(still.samples, Kind.AIRSPEED, *VANES)
    estimator, rows = run(aircraft, samples, calm_air=True)
    truth, time = truth_of(still, estimator, rows)
    late = time > 20.0
    assert set(rows[late, StateField.STATUS]) == {Status.CALM_AIR_ANGLES}
    assert np.abs(rows[late, StateField.AIRSPEED] - truth.airspeed[late]).max() < 3.0 * CALM_STD[0]
    given = late & np.isfinite(rows[:, StateField.ANGLE_OF_ATTACK])
    assert np.mean(given[late]) > 0.5
    assert np.degrees(np.abs(rows[given, StateField.ANGLE_OF_ATTACK] - truth.alpha[given])).max() < 1.5
    assert any("is taken as calm" in note for note in absences(estimator))
    estimator, rows = run(aircraft, samples)
    assert np.all(np.isnan(rows[300:, StateField.ANGLE_OF_ATTACK]))
    assert any("no parameter is learnt" in note and "--calm-air" in note for note in absences(estimator))


# -- waiting for GPS --------------------------------------------------------------------------------------------------


def since(flight, samples):
    return (samples.stamp - flight.biases.stamp[0]) * 1e-9


@pytest.mark.long
def test_nothing_depends_on_how_samples_come_and_nothing_is_lost_while_gps_is_waited_for(flight, aircraft):
    """GPS that is never there, and GPS that comes when it was given up: the same bits from blocks of any size."""
    time = since(flight, flight.samples)
    late = flight.samples[(time < 14.0) & ~(np.isin(flight.samples.kind, GPS) & (time < PATIENCE + 4.0))]
    for samples, statuses in (
        (lacking(flight.samples[time < 9.0], *GPS), [Status.WITHOUT_GPS]),
        (late, [Status.WITHOUT_GPS, Status.OK]),
    ):
        estimator, expected = run(aircraft, samples, len(samples))
        assert since(flight, samples)[0] + 1.5 > truth_of(flight, estimator, expected)[1][0]
        _, first = np.unique(expected[:, StateField.STATUS], return_index=True)
        assert expected[np.sort(first), StateField.STATUS].tolist() == statuses
        assert np.isfinite(expected[-1, StateField.WIND]).all() == (Status.OK in statuses)
        for block in (1, 137):
            _, rows = run(aircraft, samples, block)
            assert np.array_equal(rows, expected, equal_nan=True)


@pytest.mark.parametrize(("lost", "status"), [(GPS[:1], Status.OK), (GPS[1:], Status.OK), (GPS, Status.WITHOUT_GPS)])
def test_after_a_gap_the_filter_starts_with_the_gps_that_is_left(flight, aircraft, lost, status):
    """All of it had to be there again: where one of two topics had died, a flight had no state any more."""
    time = since(flight, flight.samples)
    cut, back = (time > 18.0) & np.isin(flight.samples.kind, lost), 40.0
    samples = flight.samples[(time < 50.0) & ~(cut & (time < back)) & ~((time > 25.0) & (time < 26.0))]
    estimator, rows = run(aircraft, samples)
    truth, when = truth_of(flight, estimator, rows)
    between, after = (when > 26.5) & (when < back - 0.5), when > back + 3.0
    assert between.sum() > 0.95 * 100 * (back - 27.0) and after.sum() > 0.95 * 100 * 7.0
    assert set(rows[between, StateField.STATUS]) == {status} and set(rows[after, StateField.STATUS]) == {Status.OK}
    assert np.isnan(rows[between, StateField.ORIGIN.start]).all() == (Kind.GPS_POSITION in lost)
    assert np.abs(rows[between, StateField.AIRSPEED] - truth.airspeed[between]).max() < 1.0
    assert len(np.unique(rows[after, StateField.ORIGIN], axis=0)) == 1
    assert np.array_equal(rows[-1, StateField.ORIGIN], rows[0, StateField.ORIGIN])
    assert np.abs(rows[after, StateField.POSITION] - truth.position[after]).max() < 10.0
    assert not any("no GPS" in note for note in absences(estimator))
    _, again = run(aircraft, samples, 137)
    assert np.array_equal(rows, again, equal_nan=True)


def test_nor_is_anything_lost_where_the_flight_ends_while_gps_that_was_lost_is_waited_for(flight, aircraft):
    """Up to five seconds after the gap had no state."""
    time = since(flight, flight.samples)
    cut = (time > 18.0) & (flight.samples.kind == Kind.GPS_POSITION)
    estimator, rows = run(aircraft, flight.samples[(time < 30.0) & ~cut & ~((time > 25.0) & (time < 26.0))])
    _, when = truth_of(flight, estimator, rows)
    assert (when > 26.0).sum() > 0.95 * 100 * 3.0


@pytest.mark.parametrize("lost", GPS)
def test_one_kind_of_gps_that_is_rejected_for_long_is_enough_where_the_other_is_silent(flight, aircraft, lost):
    """The state was off by 30 m/s for the rest of a flight, since the other one did not contradict it."""
    time = since(flight, flight.samples)
    values = flight.samples.values.copy()
    values[(flight.samples.kind == Kind.IMU) & (time > 25.0) & (time < 25.5), 0] += 60.0  # it has struck something
    shaken = replace(flight.samples, values=values)[(time < 45.0) & ~((time > 18.0) & (flight.samples.kind == lost))]
    estimator, rows = run(aircraft, shaken)
    truth, when = truth_of(flight, estimator, rows)
    off = np.linalg.norm(rows[:, StateField.VELOCITY] - truth.velocity, axis=1)
    assert estimator.realignments == 1 and off[(when > 26.0) & (when < 29.0)].min() > 10.0
    assert off[when > 40.0].max() < 2.0


def test_gps_that_comes_a_little_late_is_waited_for(flight, aircraft):
    time = since(flight, flight.samples)
    samples = flight.samples[(time < 12.0) & ~(np.isin(flight.samples.kind, GPS) & (time < PATIENCE - 1.0))]
    _, rows = run(aircraft, samples)
    assert set(rows[:, StateField.STATUS]) == {Status.OK}


def test_a_manoeuvre_shorter_than_the_wait_is_reconstructed_whole(flight, aircraft):
    samples = lacking(flight.samples[since(flight, flight.samples) < PATIENCE - 1.0], *GPS)
    estimator, rows = run(aircraft, samples)
    imu = np.sum(samples.kind == Kind.IMU)
    assert len(rows) > imu - 110 and estimator.status == Status.WITHOUT_GPS


def test_on_the_ground_nothing_starts_without_gps(aircraft):
    """Air data at rest are no flight."""
    stamp = np.arange(0, 20 * SECOND, SECOND // 50)
    still = np.tile([0.0, 0.0, -9.81, 0.0, 0.0, 0.0, np.nan, np.nan], (len(stamp), 1))
    samples = [samples_of(Kind.IMU, stamp, still), samples_of(Kind.AIRSPEED, stamp + 1, np.full(len(stamp), 0.8))]
    estimator = StateEstimator(aircraft)
    for part in samples[::-1]:
        assert not len(estimator.push(part))
    assert not len(estimator.flush()) and estimator.status == Status.WAITING


# -- parts ------------------------------------------------------------------------------------------------------------


def test_tilt_comes_from_the_accelerometer_in_a_turn_too(aircraft):
    """Level, 40 degrees of bank, at constant airspeed: the specific force stands across the wings."""
    speed, bank, gravity = 17.0, np.radians(40.0), 9.80665
    turn = gravity * np.tan(bank) / speed
    rate = rotation_matrix(quaternion_from_euler(bank, 0.0, 0.0)).T @ np.array([0.0, 0.0, turn])
    force = np.array([0.0, 0.0, -gravity / np.cos(bank)])
    alignment = Alignment(gravity, aircraft.minimum_airspeed, None, 0.0)
    for time in np.arange(0.0, 1.2, 0.02):
        alignment.take(time, Kind.AIRSPEED, np.array([speed]))
        alignment.take(time, Kind.ANGLE_OF_ATTACK, np.array([0.0]))
        alignment.take(time, Kind.SIDESLIP, np.array([0.0]))
        alignment.take(time, Kind.IMU, np.concatenate([force, rate]))
    x, p = alignment.start_with(frozenset(), np.zeros(3), np.ones(3))
    down = rotation_matrix(x[6:10])[2]
    assert np.degrees(np.arctan2(down[1], down[2])) == pytest.approx(40.0, abs=0.5)
    assert np.degrees(np.arcsin(-down[0])) == pytest.approx(0.0, abs=0.5)
    assert np.linalg.eigvalsh(p).min() > 0.0
    wind = wind_jacobian(x)
    np.testing.assert_allclose(wind @ p @ wind.T, np.diag(GUST_STD**2), atol=1e-9)


def a_state():
    x = np.zeros(STATE_SIZE)
    x[0:3], x[3:6] = (15.0, -4.0, 1.2), (200.0, -50.0, -30.0)
    x[6:10] = quaternion_from_euler(0.3, -0.1, 0.7)
    x[16:19] = 16.0, 1.5, 0.9
    return x


def a_covariance(seed=3):
    root = np.random.default_rng(seed).standard_normal((ERROR_SIZE, ERROR_SIZE))
    return root @ root.T


@pytest.mark.parametrize("axis", range(3))
def test_the_row_of_a_wind_that_is_held_is_its_derivative(axis):
    x, h, other = a_state(), np.zeros((1, ERROR_SIZE)), np.zeros((1, ERROR_SIZE))
    residual = no_wind(axis, x, h)
    assert residual == pytest.approx(-(x[:3] - rotation_matrix(x[6:10]) @ x[16:19])[axis])
    for i in range(ERROR_SIZE):
        delta = np.zeros(ERROR_SIZE)
        delta[i] = 1e-6
        slope = (no_wind(axis, retract(x, delta), other) - no_wind(axis, retract(x, -delta), other)) / 2e-6
        assert slope == pytest.approx(-h[0, i], abs=1e-7)


def test_a_held_wind_is_as_uncertain_as_it_is_said_to_be_after_any_time():
    """Walk and pseudo-measurement are in balance at the given deviation: neither known, nor without bound."""
    x, std, walk = a_state(), 1.5, 0.3
    p = np.diag(np.full(ERROR_SIZE, 1e-10))
    p[0:3, 0:3] = np.eye(3) * 400.0
    c = rotation_matrix(x[6:10])
    seen = []
    for _ in range(400):
        p[15:, 15:] += c.T @ c * walk**2 * PERIOD
        hold_wind(2, x, p, std, walk)
        jacobian = wind_jacobian(x)
        seen.append(float(jacobian[2] @ p @ jacobian[2]))
    assert np.sqrt(seen[-1]) == pytest.approx(std, rel=0.05)


def test_counting_the_heading_from_now_changes_nothing_else(aircraft):
    """The variance of the heading is gone; tilt, biases, air velocity, height and speed are as uncertain as before."""
    x, before = a_state(), a_covariance()
    after = before.copy()
    count_heading_from_now(x, after)
    down = np.zeros(ERROR_SIZE)
    down[D_ATTITUDE : D_ATTITUDE + 3] = rotation_matrix(x[6:10])[2]
    assert down @ after @ down == pytest.approx(0.0, abs=1e-9 * (down @ before @ down))
    kept = []
    for vector in (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
        tilt = np.zeros(ERROR_SIZE)
        tilt[D_ATTITUDE : D_ATTITUDE + 3] = np.cross(down[D_ATTITUDE : D_ATTITUDE + 3], vector)
        kept.append(tilt)
    speed = np.zeros(ERROR_SIZE)
    speed[0:3] = x[0:3]
    kept += [speed, np.eye(ERROR_SIZE)[D_POSITION + 2], *np.eye(ERROR_SIZE)[9:18]]
    kept = np.array(kept)
    np.testing.assert_allclose(kept @ after @ kept.T, kept @ before @ kept.T, rtol=1e-9, atol=1e-7)


def test_static_pressure_is_that_of_the_height(aircraft):
    x, delta = a_state(), 0.01
    setup = new_setup(
        aircraft, StateOptions(), gate_thresholds(5.0), np.array([np.nan, np.nan, 400.0]), np.full(8, np.nan), NO_GUIDE
    )
    assert setup.gravity == pytest.approx(9.806, abs=0.03)
    residual, h = np.empty(1), np.zeros((1, ERROR_SIZE))
    values = np.array([np.nan, pressure(430.0) + 5.0])
    assert residual_and_jacobian(int(Kind.AIR), values, x, np.zeros(3), setup, residual, h) == 1
    assert residual[0] == pytest.approx(5.0, abs=1e-6)
    lower = x.copy()
    lower[5] += delta
    changed = np.empty(1)
    residual_and_jacobian(int(Kind.AIR), values, lower, np.zeros(3), setup, changed, np.zeros((1, ERROR_SIZE)))
    assert (residual[0] - changed[0]) / delta == pytest.approx(h[0, D_POSITION + 2], rel=1e-3)


@pytest.mark.parametrize("sigma", [2.0, 3.0, 5.0, 9.0, 30.0])
def test_each_number_of_outputs_is_rejected_as_often_as_one(sigma):
    """As the tails of the distributions of chi squared are, which SciPy has from other sources."""
    chance = 2.0 * norm.sf(sigma)
    assert tuple(gate_thresholds(sigma)) == pytest.approx((0.0, *(chi2.isf(chance, m) for m in (1, 2, 3))), rel=1e-9)


def test_a_gate_that_nothing_could_pass_by_chance_is_open():
    assert gate_thresholds(100.0).tolist() == [0.0, np.inf, np.inf, np.inf]


def test_a_density_that_is_measured_no_more_follows_the_height(aircraft):
    """On a hot day: as far below the standard atmosphere as it was, at the height that it is now."""
    samples = simulate_samples(aircraft, seed=3, duration=25.0).samples
    of_air, values = samples.kind == Kind.AIR, samples.values.copy()
    values[of_air, 0] *= 0.9
    kept = ~of_air | (samples.stamp < samples.stamp[0] + 12 * SECOND)
    measured = estimated(aircraft, replace(samples, values=values))
    rows = estimated(aircraft, replace(samples, values=values)[kept])
    late = rows[:, StateField.TIME] > rows[0, StateField.TIME] + 16.0
    density = rows[late, StateField.AIR_DENSITY]
    np.testing.assert_allclose(density, measured[late, StateField.AIR_DENSITY], rtol=1e-3)  # noise of the last sample
    assert len(np.unique(density)) > 0.9 * len(density)


def estimated(aircraft, samples):
    estimator = StateEstimator(aircraft)
    return np.vstack([estimator.push(samples), estimator.flush()])
