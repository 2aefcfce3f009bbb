"""Faults put into a clean flight are named, one at a time, and a clean flight has none: the benchmark in small."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import flight_check
from flight_check import INJECTIONS, checked, judge, serious


@pytest.fixture(scope="module")
def clean():
    """A flight of 100 s with an attitude."""
    return simulate_samples(default_aircraft(), 51, 100.0, sensors=SensorOptions(attitude=True)).samples


CHOSEN = (
    "specific_force.z reversed", "angular_velocity.x reversed", "attitude.roll reversed", "velocity.north reversed",
    "sideslip reversed", "elevator reversed", "yaw from east", "x and y of the gyros swapped", "north and east swapped",
    "gyros in deg/s", "forces in g", "angle_of_attack in degrees", "airspeed in km/h", "altitude in feet",
    "pressure in hPa", "angular_velocity.x times 1.1", "attitude 0.05 s late", "GPS velocity 0.2 s late",
    "angle of attack 0.1 s late", "controls 0.2 s early", "gyros held", "gyro saturated", "GPS velocity gap of 8 s",
    "one in ten IMU samples lost", "IMU stamps jittered", "spikes in the airspeed", "no GPS velocity",
)  # fmt: skip


@pytest.mark.long
def test_a_clean_flight_has_neither_warning_nor_error(clean):
    assert serious(checked(clean)) == set()


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [n if i % 3 == 0 else pytest.param(n, marks=pytest.mark.long) for i, n in enumerate(CHOSEN)]
)
def test_a_fault_is_named_where_it_is_and_little_else(clean, name):
    injection = next(i for i in INJECTIONS if i.name == name)
    record = judge(clean, injection, set())
    assert record is not None
    assert record["named"], record
    assert len(record["others"]) <= 1, record


def test_every_kind_has_an_injection_or_a_test_of_its_own():
    from aircraft_sysid_ros.flight_check.finding import KINDS

    assert {i.kind for i in INJECTIONS} | {"rate"} == set(KINDS)


@pytest.mark.long
def test_a_rate_that_halves_in_flight_is_found(clean):
    from aircraft_sysid_ros.samples import Kind

    middle = (int(clean.stamp.min()) + int(clean.stamp.max())) // 2
    rows = flight_check.np.flatnonzero((clean.kind == Kind.AIRSPEED) & (clean.stamp > middle))
    kept = flight_check.np.ones(len(clean), dtype=bool)
    kept[rows[::2]] = False
    assert ("true_airspeed", "rate") in serious(checked(clean[kept]))


def test_an_imu_that_is_too_slow_for_any_filter_is_an_error(clean):
    """As of a time in ms that was taken as s."""
    from aircraft_sysid_ros.samples import Kind

    rows = flight_check.np.flatnonzero(clean.kind == Kind.IMU)
    kept = clean.kind != Kind.IMU
    kept[rows[::40]] = True  # 2.5 Hz
    found = [f for f in checked(clean[kept]).findings if f.kind == "rate" and f.severity == "error"]
    assert len(found) == 1
    assert "angular_velocity.x" in found[0].signals and "at most 0.25 s apart" in found[0].sentence


@pytest.mark.long
def test_a_gps_that_was_interpolated_to_the_rate_of_others_is_found(clean):
    """Errors that count four times make settings of the sensors significant that are none."""
    from aircraft_sysid_ros.samples import Kind, concatenate, samples_of

    rows = clean.kind == Kind.GPS_VELOCITY
    stamp = clean.stamp[rows]
    dense = flight_check.np.arange(stamp[0], stamp[-1], 50_000_000)
    columns = [flight_check.np.interp(dense - stamp[0], stamp - stamp[0], v) for v in clean.values[rows, :3].T]
    joined = concatenate([clean[~rows], samples_of(Kind.GPS_VELOCITY, dense, *columns)])
    found = serious(checked(joined))
    assert ("velocity.north", "held") in found and {kind for _, kind in found} == {"held"}


@pytest.mark.long
def test_one_axis_without_numbers_for_a_fifth_of_the_flight_is_named(clean):
    """A sample is used whole or not at all: the other five axes are lost with it, and nothing else had said so."""
    from aircraft_sysid_ros.samples import Kind, Samples

    values, rows = clean.values.copy(), flight_check.np.flatnonzero(clean.kind == Kind.IMU)
    some = rows[len(rows) // 3 :][: len(rows) // 5]
    values[some, 4] = flight_check.np.nan
    found = checked(Samples(clean.stamp, clean.kind, values)).findings
    (finding,) = [f for f in found if "not numbers" in f.sentence]
    assert finding.signals == ("angular_velocity.y",) and finding.kind == "missing"
    assert f"{len(some)} of {len(rows)}" in finding.sentence
