"""A setting of a sensor is a fault where replicas of the flight, whose sensors are right, do not feign as much."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct_as_flown
from aircraft_sysid_ros.diagnosis.flight_diagnosis import _beyond_chance
from aircraft_sysid_ros.diagnosis.measurement import in_file, measurement_faults
from aircraft_sysid_ros.diagnosis.significance import setting_replicas
from aircraft_sysid_ros.diagnosis.significance.setting_replicas import chance_of, gains_in_replicas
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


@pytest.fixture(scope="module")
def offset(aircraft):
    """A calm flight whose vane is mounted 2 degrees wrong, the setting that says so, and the flight mended with it."""
    samples = simulate_samples(aircraft, 31, 45.0, hidden=[("alpha_offset", 2.0)]).samples
    flight, calm = reconstruct_as_flown(aircraft, samples, with_covariance=False)
    (found,) = measurement_faults(flight, [BY_ID["alpha_offset"]], calm)
    mended, _ = reconstruct_as_flown(in_file(found, aircraft), samples, with_covariance=False)
    return flight, calm, found, mended


def test_replicas_have_sensors_that_are_right(offset):
    _, calm, found, mended = offset
    assert max(gains_in_replicas(found, mended, calm, 3)) < 0.1 * found.gain
    assert chance_of(found, mended, calm, 20, 3) < 0.01


def test_what_replicas_feign_as_well_is_no_fault(aircraft, offset, monkeypatch):
    flight, calm, found, _ = offset
    said = []

    def told():
        return _beyond_chance([found], aircraft, aircraft, flight, calm, 20, 3, lambda what, _: said.append(what))

    aircraft_then, _, _, finding = told()
    assert finding.matters and finding.setting is found and aircraft_then.sensors["angle_of_attack"].offset
    feigned = np.array([0.5, 0.9, 1.2]) * found.gain
    monkeypatch.setattr(setting_replicas, "gains_in_replicas", lambda *_: feigned)
    assert told() is None
    monkeypatch.setattr(setting_replicas, "gains_in_replicas", lambda *_: np.full(3, np.nan))
    assert told() is None
    assert set(said) == {"look at the measurement in replicas"}
