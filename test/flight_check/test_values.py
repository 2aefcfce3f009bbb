"""Values of one signal that no aeroplane has, and vanes in gusts that it follows."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, WARNING
from aircraft_sysid_ros.flight_check.laws.flow_angles import _bias_of_gusts
from aircraft_sysid_ros.flight_check.signals import ATTITUDE, GYRO, VELOCITY, flight_of, interpolated_length
from aircraft_sysid_ros.samples import CONTROL_COLUMNS, Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples


@pytest.fixture(scope="module")
def flown():
    return simulate_samples(default_aircraft(), 61, 60.0).samples


def said(samples, name):
    findings = check(flight_of(samples, samples.stamp)).findings
    return [(f.kind, f.severity, f.sentence) for f in findings if name in f.signals]


def with_column(samples, kind, column, change):
    values = samples.values.copy()
    rows = samples.kind == kind
    values[rows, column] = change(values[rows, column])
    return Samples(samples.stamp, samples.kind, values)


def test_a_half_of_the_stamps_that_is_0_leaves_the_other(flown):
    """Nothing was near to the middle between them: an error of NumPy."""
    part = flown[:8000]
    stamps = np.where(np.arange(8000) < 4000, 0, part.stamp)
    judged = flight_of(Samples(stamps, part.kind, part.values), part.stamp)
    assert judged.duration == pytest.approx(float(np.ptp(part.stamp[4000:])) * 1e-9)


def test_a_recording_with_every_message_twice_is_said_to_be_that(flown):
    """Stamps were too coarse, and values held at half of their rate."""
    twice = flown[np.repeat(np.arange(len(flown)), 2)]
    for name in ("specific_force.z", "true_airspeed", "elevator"):
        once, found = said(flown, name), said(twice, name)
        (new,) = [each for each in found if each not in once]
        assert new[:2] == ("jitter", WARNING) and "count once" in new[2]


def test_samples_of_one_stamp_are_an_error_that_says_so(flown):
    """As where nobody sets the stamps of the headers: they were too coarse for nan Hz, a warning."""
    stamps = np.where(flown.kind == Kind.IMU, flown.stamp, flown.stamp[0])
    (found,) = said(Samples(stamps, flown.kind, flown.values), "true_airspeed")
    assert found[:2] == ("jitter", ERROR) and "samples have the same stamp" in found[2]
    none = Samples(np.zeros_like(flown.stamp), flown.kind, flown.values)
    assert [each[1] for each in said(none, "specific_force.z")] == [ERROR]


def test_an_airspeed_below_zero_is_an_error_and_noise_at_rest_is_none(flown):
    east = with_column(flown, Kind.AIRSPEED, 0, lambda v: 15.0 * np.sin(np.arange(len(v)) / 300.0))
    kind, severity, sentence = next(each for each in said(east, "true_airspeed") if each[0] == "sign")
    assert severity == ERROR and "below zero" in sentence and kind == "sign"
    rng = np.random.default_rng(1)
    resting = with_column(
        flown, Kind.AIRSPEED, 0, lambda v: np.where(np.arange(len(v)) < 300, rng.normal(size=len(v)), v)
    )
    assert not [each for each in said(resting, "true_airspeed") if each[0] == "sign"]


@pytest.mark.parametrize(("value", "severity"), [(np.radians(1.5), WARNING), (0.0, INFO)])
def test_a_surface_that_never_moves_is_said(flown, value, severity):
    still = with_column(flown, Kind.CONTROLS, CONTROL_COLUMNS.index("dr"), lambda v: np.full(len(v), value))
    (found,) = [each for each in said(still, "rudder") if each[0] == "held"]
    assert found[1] == severity and "all the time" in found[2]
    assert not [each for each in said(flown, "rudder") if each[0] == "held"]


@pytest.fixture(scope="module")
def with_attitude():
    return simulate_samples(default_aircraft(), 61, 60.0, sensors=SensorOptions(attitude=True)).samples


@pytest.mark.parametrize(
    ("kind", "columns", "value", "names"),
    [
        (Kind.AIRSPEED, slice(0, 1), 0.0, ("true_airspeed",)),  # nothing is connected
        (Kind.AIRSPEED, slice(0, 1), 2.0, ("true_airspeed",)),
        (Kind.GPS_VELOCITY, slice(0, 3), -0.0, VELOCITY),
        (Kind.AIR, slice(1, 2), 0.0, ("static_pressure",)),
        (Kind.IMU, slice(3, 6), 0.0, GYRO),
        (Kind.IMU, slice(5, 6), 0.0, GYRO[2:]),
        (Kind.ATTITUDE, slice(0, 4), [1.0, 0.0, 0.0, 0.0], ATTITUDE),
    ],
)
def test_a_sensor_that_stays_at_one_value_is_stuck_and_not_compared(with_attitude, kind, columns, value, names):
    """A zero airspeed or velocity ended the check; a gyro or an airspeed had others seem late, or in another unit."""
    values = with_attitude.values.copy()
    values[with_attitude.kind == kind, columns] = value
    found = check(flight_of(Samples(with_attitude.stamp, with_attitude.kind, values), with_attitude.stamp)).findings
    told = {name: f for f in found for name in f.signals if f.severity in (ERROR, WARNING)}
    assert sorted(told) == sorted(names)
    assert all(f.kind == "held" and "all the time: the sensor is stuck" in f.sentence for f in told.values())
    assert not any("-0 " in f.sentence for f in told.values())


def test_two_angles_of_an_attitude_that_stay_are_said(with_attitude):
    values, rows = with_attitude.values.copy(), with_attitude.kind == Kind.ATTITUDE
    yaw = np.linspace(0.0, 3.0, int(rows.sum()))
    values[rows, :4] = np.column_stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)])
    still = Samples(with_attitude.stamp, with_attitude.kind, values)
    held = {name for name in ATTITUDE if any("stays at 0°" in each[2] for each in said(still, name))}
    assert held == {"attitude.roll", "attitude.pitch"}


@pytest.mark.parametrize(("column", "name", "step"), [(1, "static_pressure", 10.0), (0, "air_density", 1e-3)])
def test_the_pressure_of_a_parked_aeroplane_is_not_the_end_of_a_range(flown, column, name, step):
    def parked(values):
        steps = np.round(values / step) * step
        return np.where(np.arange(len(values)) < len(values) // 3, steps.max() + step, steps)

    resting = with_column(flown, Kind.AIR, column, parked)
    assert not [each for each in said(resting, name) if each[0] == "saturated"]
    cut = with_column(flown, Kind.AIR, column, lambda v: np.maximum(v, np.percentile(v, 40)))
    assert [each for each in said(cut, name) if each[0] == "saturated"]


@pytest.mark.parametrize("follows", [-0.4, 0.0, 0.4])
@pytest.mark.parametrize("gust", [0.2, 0.7, 1.5])
def test_a_factor_in_gusts_that_are_followed_is_within_the_room_for_them(follows, gust):
    """y = x + g with correlated x and g: the factor of the fit is not further from 1 than is said."""
    rng = np.random.default_rng(3)
    x, other = rng.standard_normal((2, 200_000))
    y = x + gust * (follows * x + np.sqrt(1.0 - follows**2) * other)
    factor, correlation = float(x @ y / (x @ x)), float(np.corrcoef(x, y)[0, 1])
    assert abs(np.log(factor)) <= np.log1p(_bias_of_gusts(abs(correlation))) + 0.01


def test_legs_between_regular_turns_are_not_one_measured_position_a_turn():
    """A latitude without noise, of another simulator: `import` would have kept one of 47 positions."""
    time = np.arange(0.0, 150.0, 0.2)
    turning = np.where(time % 9.4 < 1.0, 1.0, 0.003 * np.sin(time))
    latitude = np.cumsum(np.cumsum(turning * np.where(time // 9.4 % 2, -1.0, 1.0))) * 1e-8
    assert interpolated_length(time, latitude) == 1.0
    once_a_second = np.interp(time, time[::5], latitude[::5])
    assert interpolated_length(time, once_a_second) == pytest.approx(5.0, abs=1.5)


@pytest.fixture(scope="module")
def slow():
    """A flight of which a recorder kept the IMU ten times a second."""
    flown = simulate_samples(default_aircraft(), 53, 90.0).samples
    rows = np.flatnonzero(flown.kind == Kind.IMU)
    step = round(0.1e9 / float(np.median(np.diff(flown.stamp[rows]))))
    return flown[np.sort(np.concatenate([np.flatnonzero(flown.kind != Kind.IMU), rows[::step]]))]


def test_quick_motion_of_a_slow_recorder_is_no_fault_of_transmission(slow):
    """A doublet of the elevator was over between two samples, and 'remove sensor or transmission faults' was said."""
    assert not [each for each in said(slow, "angular_velocity.y") if each[0] == "noise"]
    faulty = with_column(
        slow, Kind.IMU, 4, lambda v: np.where(np.isin(np.arange(len(v)), (200, 500, 640)), 6.0 * v.max(), v)
    )
    (found,) = [each for each in said(faulty, "angular_velocity.y") if each[0] == "noise"]
    assert "3 single values jump" in found[2]
