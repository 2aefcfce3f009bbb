"""A receiver that is late: position and velocity as one, with the time by which they are."""

from __future__ import annotations

import re

import numpy as np
import pytest
from test_relation import relation

from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.relation import lag_faults
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

RECEIVER = (Kind.GPS_POSITION, Kind.GPS_VELOCITY)


@pytest.fixture(scope="module", params=[57, 58])
def flown(request) -> Samples:
    options = {"manoeuvres": "varied", "turbulence": "light", "sensors": SensorOptions(attitude=True)}
    return simulate_samples(default_aircraft(), request.param, 90.0, **options).samples


@pytest.mark.long
@pytest.mark.parametrize("late", [0.0, 0.08, 0.1, 0.2])
def test_a_late_receiver_is_found_with_its_time(flown, late):
    """Velocity alone had been 0.04 s late of 0.1: it was to agree with a position that is as late."""
    stamp = flown.stamp + round(late * 1e9) * np.isin(flown.kind, RECEIVER)
    samples = Samples(stamp, flown.kind, flown.values)
    found = {f.signals[0]: f for f in check(flight_of(samples, stamp)).findings if f.kind == "offset"}
    assert found.keys() == ({"velocity.north", "latitude"} if late else set())
    for finding in found.values():
        told = re.search(r"comes (\d\.\d+) s", finding.sentence)
        assert told is not None and float(told[1]) == pytest.approx(late, abs=0.02)


def test_a_velocity_that_is_late_by_itself_is_not_laid_to_the_position():
    relations = [relation("velocity", "imu", lag=0.1), relation("velocity", "position", lag=0.1)]
    relations += [relation("imu", "attitude"), relation("imu", "vane")]
    together = (("velocity", "position"),)
    faults = {f.signal: f.size for f in lag_faults(relations, {}, lambda signal: signal, together)}
    assert faults == pytest.approx({"velocity": 0.1}, abs=0.005)
    relations[1] = relation("velocity", "position")
    faults = {f.signal: f.size for f in lag_faults(relations, {}, lambda signal: signal, together)}
    assert faults == pytest.approx({"velocity": 0.1, "position": 0.1}, abs=0.005)
