"""The first step in flight: as accurate as it says, and what a pilot wants when sensors fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.frames import quaternion_conjugate, quaternion_log, quaternion_product
from aircraft_sysid_ros.reconstruction.smoother_history import SmootherHistory
from aircraft_sysid_ros.reconstruction.state import StateField, Status
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples

GPS = (Kind.GPS_POSITION, Kind.GPS_VELOCITY)
AIR_DATA = (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.AIR)
ATTITUDE_STD = slice(StateField.STANDARD_DEVIATIONS.start + 6, StateField.STANDARD_DEVIATIONS.start + 9)
WIND_STD = slice(StateField.STANDARD_DEVIATIONS.stop - 3, StateField.STANDARD_DEVIATIONS.stop)


def run(aircraft, samples: Samples, block: int = 5000) -> tuple[StateEstimator, np.ndarray]:
    estimator = StateEstimator(aircraft)
    rows = [estimator.push(samples[i : i + block]) for i in range(0, len(samples), block)]
    return estimator, np.vstack([*rows, estimator.flush()])


def seconds_of_flight(flight, samples: Samples) -> np.ndarray:
    return (samples.stamp - flight.biases.stamp[0]) * 1e-9


def without(flight, kinds, start: float, end: float) -> Samples:
    time = seconds_of_flight(flight, flight.samples)
    gone = np.isin(flight.samples.kind, kinds) & (time >= start) & (time < end)
    return flight.samples[~gone]


def true_rows(flight, estimator: StateEstimator, rows: np.ndarray):
    offset = (estimator.epoch - flight.biases.stamp[0]) * 1e-9
    return flight.truth.at(rows[:, StateField.TIME] + offset), rows[:, StateField.TIME] + offset


def attitude_error(rows: np.ndarray, truth) -> np.ndarray:
    return np.array(
        [
            quaternion_log(quaternion_product(quaternion_conjugate(q), t))
            for q, t in zip(rows[:, StateField.ATTITUDE], truth.quaternion, strict=True)
        ]
    )


def test_errors_are_as_large_as_the_standard_deviations_say(flight, aircraft) -> None:
    estimator, rows = run(aircraft, flight.samples)
    truth, time = true_rows(flight, estimator, rows)
    settled = time > 60.0
    errors = {
        "attitude": (attitude_error(rows, truth), rows[:, ATTITUDE_STD]),
        "wind": (truth.wind - rows[:, StateField.WIND], rows[:, WIND_STD]),
        "velocity": (truth.velocity - rows[:, StateField.VELOCITY], rows[:, StateField.STANDARD_DEVIATIONS][:, :3]),
    }
    for name, (error, std) in errors.items():
        z = (error / std)[settled]
        assert np.abs(z).max() < 5.0, name
        assert np.sqrt(np.mean(z**2)) < 2.0, name
    for kind, nis in estimator.innovation_consistency().items():
        assert nis == pytest.approx(1.0, abs=0.15), kind  # 1200 samples or more: 4 sigma


@pytest.mark.long
def test_every_block_size_gives_the_same_bits(flight, aircraft) -> None:
    samples = flight.samples[:8000]
    _, expected = run(aircraft, samples, 8000)
    for block in (1, 137):
        _, rows = run(aircraft, samples, block)
        assert np.array_equal(rows, expected, equal_nan=True)


def test_late_arrival_gives_the_same_bits(flight, aircraft) -> None:
    """GPS late by up to 0.45 s is fused at its own time: as if it had not been late."""
    samples = flight.samples[:8000]
    late = np.where(np.isin(samples.kind, GPS), 450_000_000, 0)
    order = np.argsort(samples.stamp + late, kind="stable")
    in_order = samples[np.argsort(samples.stamp, kind="stable")]
    _, expected = run(aircraft, in_order)
    estimator, rows = run(aircraft, samples[order], 50)
    assert estimator.order.counts.late.sum() == 0
    assert np.array_equal(rows[:, : StateField.FUSED], expected[:, : StateField.FUSED], equal_nan=True)


def test_fused_at_its_own_time_is_better_than_at_arrival(flight, aircraft) -> None:
    """A delay that the aircraft file states is taken out; unstated, it makes innovations larger."""
    samples = flight.samples[:20000]
    shift = np.where(np.isin(samples.kind, GPS), 300_000_000, 0)
    delayed = Samples(samples.stamp + shift, samples.kind, samples.values)
    sensors = dict(aircraft.sensors)
    for name in ("gps_position", "gps_velocity"):
        sensors[name] = replace(sensors[name], delay=0.3)
    stated, _ = run(replace(aircraft, sensors=sensors), delayed)
    unstated, _ = run(aircraft, delayed)
    assert stated.innovation_consistency()["gps_velocity"] < 1.2
    assert unstated.innovation_consistency()["gps_velocity"] > 1.5


@pytest.mark.parametrize(
    ("kinds", "status"),
    [
        ((Kind.IMU,), None),
        (GPS, Status.NO_GPS),
        (AIR_DATA, Status.NO_AIR_DATA),
        ((Kind.ANGLE_OF_ATTACK,), Status.OK),
        ((Kind.SIDESLIP,), Status.OK),
        ((Kind.GPS_POSITION,), Status.OK),
        ((Kind.GPS_VELOCITY,), Status.OK),
    ],
)
def test_a_gap_of_ten_seconds_in_each_sensor(kinds, status, flight, aircraft) -> None:
    estimator, rows = run(aircraft, without(flight, kinds, 50.0, 60.0))
    truth, time = true_rows(flight, estimator, rows)
    assert np.all(np.isfinite(rows[:, : StateField.AIRSPEED + 1]))
    inside = (time > 53.0) & (time < 60.0)
    if status is None:
        assert not inside.any() and estimator.realignments == 1
    else:
        assert np.all(rows[inside, StateField.STATUS] == status)
        assert estimator.realignments == 0
    after = time > 75.0
    assert np.all(rows[after, StateField.STATUS] == Status.OK)
    z = attitude_error(rows[after], truth[after]) / rows[after][:, ATTITUDE_STD]
    assert np.abs(z).max() < 6.0
    assert np.abs((rows[:, StateField.AIRSPEED] - truth.airspeed)[after]).max() < 0.5


@pytest.mark.parametrize(
    ("kind", "column"), [(Kind.ANGLE_OF_ATTACK, StateField.ANGLE_OF_ATTACK), (Kind.SIDESLIP, StateField.SIDESLIP)]
)
def test_an_angle_without_its_vane_is_not_measured(kind, column, flight, aircraft) -> None:
    """NaN, never a guess: parameters must not be learnt from an angle that rests on the wind staying as it was."""
    estimator, rows = run(aircraft, without(flight, (kind,), 50.0, 60.0))
    _, time = true_rows(flight, estimator, rows)
    assert np.all(np.isnan(rows[(time > 52.5) & (time < 59.5), column]))
    assert np.all(np.isfinite(rows[(time < 49.0) | (time > 61.0), column]))


def test_gps_lost_for_a_minute(flight, aircraft) -> None:
    """Air data and IMU carry on: attitude, airspeed stay good, position says how uncertain it gets."""
    estimator, rows = run(aircraft, without(flight, GPS, 50.0, 110.0))
    truth, time = true_rows(flight, estimator, rows)
    lost = (time > 55.0) & (time < 109.0)
    assert np.all(rows[lost, StateField.STATUS] == Status.NO_GPS)
    assert np.degrees(np.abs(attitude_error(rows[lost], truth[lost]))).max() < 5.0
    assert np.abs(rows[lost, StateField.AIRSPEED] - truth.airspeed[lost]).max() < 0.5
    at = int(np.flatnonzero(lost)[-1])
    position_std = rows[at, StateField.STANDARD_DEVIATIONS][3:5]
    assert np.all(position_std > 3.0)
    assert rows[-1, StateField.STATUS] == Status.OK
    assert estimator.counts()["gps_position"]["rejected"] <= 3


@pytest.mark.parametrize("kind", [Kind.IMU, Kind.GPS_POSITION, Kind.GPS_VELOCITY, Kind.AIRSPEED])
def test_nan_samples_are_counted_and_harmless(kind, flight, aircraft) -> None:
    samples = flight.samples[:15000]
    chosen = np.flatnonzero(samples.kind == kind)[50::7]
    values = samples.values.copy()
    values[chosen, 0] = np.nan
    estimator, rows = run(aircraft, Samples(samples.stamp, samples.kind, values))
    assert np.all(np.isfinite(rows[:, : StateField.STATUS]))
    assert estimator.counts()[kind.name.lower()]["invalid"] == len(chosen)


@pytest.mark.long
def test_stamps_that_go_backwards_for_good_are_a_restart(flight, aircraft) -> None:
    """The autopilot reboots at 40 s, its clock starts over: the filter aligns again, keeps its biases."""
    time = seconds_of_flight(flight, flight.samples)
    shift = np.where(time > 40.0, 3000 * 10**9, 0)
    samples = flight.samples
    estimator, rows = run(aircraft, Samples(samples.stamp - shift, samples.kind, samples.values))
    assert estimator.order.counts.restarts == 1
    assert estimator.realignments == 1
    assert np.all(np.isfinite(rows[:, : StateField.STATUS]))
    gyro = np.array(estimator.summary()["gyro_bias"])
    assert np.abs(gyro - flight.biases.gyro[-1]).max() < 0.002


@pytest.mark.parametrize("kind", [Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP])
def test_a_sensor_that_lies_is_rejected_by_the_gate(kind: Kind, flight, aircraft) -> None:
    samples = flight.samples
    time = seconds_of_flight(flight, samples)
    chosen = np.flatnonzero((samples.kind == kind) & (time > 60.0) & (time < 65.0))
    values = samples.values.copy()
    values[chosen, 0] += 15.0 if kind == Kind.AIRSPEED else 0.5
    estimator, rows = run(aircraft, Samples(samples.stamp, samples.kind, values))
    assert estimator.counts()[kind.name.lower()]["rejected"] > 0.9 * len(chosen)
    truth, at = true_rows(flight, estimator, rows)
    during = (at > 60.0) & (at < 70.0)
    assert np.abs(rows[during, StateField.AIRSPEED] - truth.airspeed[during]).max() < 1.0


def test_without_gps_and_airspeed_the_filter_waits_and_says_so(flight, aircraft) -> None:
    estimator, rows = run(aircraft, without(flight, (*GPS, Kind.AIRSPEED), -1.0, 1000.0)[:5000])
    assert len(rows) == 0
    assert estimator.status == Status.WAITING
    assert estimator.summary()["wind_ned"] == [None] * 3


@pytest.mark.long
@pytest.mark.parametrize("turbulence", [pytest.param("light", marks=pytest.mark.long), "moderate"])
def test_gusts_do_not_corrupt_attitude_and_biases(turbulence: str, aircraft) -> None:
    """The aircraft file promises a nearly steady wind; the filter finds out that it is not, and stays honest."""
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

    gusty = simulate_samples(aircraft, seed=7, turbulence=turbulence)
    estimator, rows = run(aircraft, gusty.samples)
    truth, time = true_rows(gusty, estimator, rows)
    settled = time > 30.0
    z = (attitude_error(rows, truth) / rows[:, ATTITUDE_STD])[settled]
    assert np.sqrt(np.mean(z**2)) < 2.0
    summary = estimator.summary()
    bias_error = np.array(summary["accelerometer_bias"]) - gusty.biases.accelerometer[-1]
    assert np.all(np.abs(bias_error) < 4.0 * np.array(summary["accelerometer_bias_std"]))
    assert estimator.memory.wind_walk[0] > 3.0 * aircraft.process_noise["wind"]


def test_calm_air_is_found_calm(flight, aircraft) -> None:
    """The allowance for gusts at the start is gone when the air data do not need it."""
    estimator, _ = run(aircraft, flight.samples)
    assert estimator.memory.wind_walk[0] < 1.5 * aircraft.process_noise["wind"]


def test_a_state_that_contradicts_gps_is_given_up(flight, aircraft) -> None:
    """GPS is elsewhere and faster from 50 s on: after some seconds the filter starts over there, nothing kept."""
    samples = flight.samples
    time = seconds_of_flight(flight, samples)
    values = samples.values.copy()
    values[(samples.kind == Kind.GPS_POSITION) & (time > 50.0), 0] += 0.01  # 64 km north
    values[(samples.kind == Kind.GPS_VELOCITY) & (time > 50.0), 1] += 30.0
    estimator, rows = run(aircraft, Samples(samples.stamp, samples.kind, values))
    assert estimator.realignments == 1
    after = rows[rows[:, StateField.TIME] > rows[-1, StateField.TIME] - 20.0]
    assert np.all(np.isfinite(after[:, : StateField.STATUS]))
    assert np.median(after[:, StateField.WIND][:, 1]) == pytest.approx(30.0 + flight.truth.wind[-1, 1], abs=5.0)


def test_a_position_that_leaps_for_good_is_followed(flight, aircraft) -> None:
    """As when a receiver finds a better fix: 30 m further north from 50 s on. Velocity and all else stay."""
    samples, time = flight.samples, seconds_of_flight(flight, flight.samples)
    values = samples.values.copy()
    values[(samples.kind == Kind.GPS_POSITION) & (time > 50.0), 0] += 30.0 / 6.37e6
    with SmootherHistory() as tape:
        estimator = StateEstimator(aircraft, tape=tape)
        filtered = np.vstack([estimator.push(Samples(samples.stamp, samples.kind, values)), estimator.flush()])
        for rows in (filtered, estimator.smooth().copy()):
            truth, time = true_rows(flight, estimator, rows)
            off = rows[:, StateField.POSITION] - (truth.position - truth.position[0])
            north = off[:, 0] - np.median(off[time < 50.0, 0])
            assert np.abs(north[time < 49.0]).max() < 5.0
            assert np.abs(north[time > 60.0] - 30.0).max() < 5.0
            error = truth.velocity - rows[:, StateField.VELOCITY]
            assert np.abs(error / rows[:, StateField.STANDARD_DEVIATIONS][:, :3])[time > 20.0].max() < 5.0
    assert estimator.realignments == 0
    assert estimator.counts()["gps_position"]["rejected"] < 40  # 5 Hz
