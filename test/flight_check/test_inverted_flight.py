"""Gravity in a flight that is inverted for most of the time: what the accelerometers show there is right."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import contradictions
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples


@pytest.fixture(scope="module")
def upright() -> Samples:
    samples = simulate_samples(default_aircraft(), 52, 100.0, sensors=SensorOptions(attitude=True)).samples
    return samples[~np.isin(samples.kind, (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.CONTROLS))]


def rolled(samples: Samples, begin: float) -> Samples:
    """The same motion in an aeroplane that makes half a roll at a time [s], for 2 s, and stays inverted."""
    time, values = (samples.stamp - samples.stamp.min()) * 1e-9 - begin, samples.values.copy()
    share = np.clip(time / 2.0, 0.0, 1.0)
    angle = np.pi * share**2 * (3.0 - 2.0 * share)
    for first in (1, 4):
        rows = samples.kind == Kind.IMU
        (y, z), (sine, cosine) = samples.values[rows, first : first + 2].T, (np.sin(angle[rows]), np.cos(angle[rows]))
        values[rows, first], values[rows, first + 1] = cosine * y + sine * z, cosine * z - sine * y
    values[rows, 3] += np.pi * 3.0 * share[rows] * (1.0 - share[rows])
    rows = samples.kind == Kind.ATTITUDE
    (w, x, y, z), (sine, cosine) = samples.values[rows, :4].T, (np.sin(0.5 * angle[rows]), np.cos(0.5 * angle[rows]))
    values[rows, :4] = np.column_stack([
        cosine * w - sine * x, cosine * x + sine * w, cosine * y + sine * z, cosine * z - sine * y,
    ])  # fmt: skip
    return Samples(samples.stamp, samples.kind, values)


def reversed_signals(samples: Samples) -> list[str]:
    found, _, _ = contradictions(flight_of(samples, samples.stamp))
    return [name for finding in found if finding.kind == "sign" for name in finding.signals]


def test_most_of_a_flight_inverted_is_no_reversed_accelerometer(upright):
    """An aerobatic flight had the error that specific_force.z goes against gravity."""
    assert reversed_signals(rolled(upright, 30.0)) == []


def test_a_reversed_accelerometer_is_named_in_inverted_flight_too(upright):
    for samples in (upright, rolled(upright, 30.0)):
        values = samples.values.copy()
        values[samples.kind == Kind.IMU, 2] *= -1.0
        assert reversed_signals(Samples(samples.stamp, samples.kind, values)) == ["specific_force.z"]


def test_a_body_that_is_always_upside_down_is_none_that_flies_inverted(upright):
    """Forward, left and up in all sensors of the body: they agree with each other."""
    assert "specific_force.z" in reversed_signals(rolled(upright, -5.0))
