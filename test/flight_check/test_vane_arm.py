"""A vane on a boom: it moves ahead of the air at the IMU, which is no delay of it where the file says where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.finding import ERROR, WARNING
from aircraft_sysid_ros.flight_check.in_flight import watch_of
from aircraft_sysid_ros.flight_check.laws import flow_angles
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.signals import flight_of, vane_arm
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

BOOM, OF_A_JET = 1.6, 0.55  # [m] at 17 m/s, and of the span


@pytest.fixture(scope="module")
def boomed():
    source = {**default_aircraft().source, "air_data_position": [BOOM, 0.0, 0.0]}
    return aircraft_from_dict(source)


@pytest.fixture(scope="module")
def flown(boomed):
    return simulate_samples(boomed, 31, 100.0)


def lags(flown, aircraft) -> list[float]:
    """Times [s] that the vanes seem late by, as far as the law is sure."""
    motion = Motion(flight_of(flown.samples, flown.samples.stamp, arm=vane_arm(aircraft)))
    found = [r for r in flow_angles.relations(motion) if r.has_lag and r.comparison.is_sure]
    assert len(found) == 2
    return [max(low, -high, 0.0) for low, high in (r.lag for r in found)]


@pytest.mark.long
def test_a_boom_that_the_file_states_is_no_delay(flown, boomed):
    assert lags(flown, boomed) == [0.0, 0.0]
    assert max(lags(flown, replace(boomed, air_data_position=np.zeros(3)))) > 0.0  # said to be in the middle


def test_a_boom_that_no_file_states_is_no_delay_either(boomed):
    source = {**boomed.source, "air_data_position": [OF_A_JET * boomed.span, 0.0, 0.0]}
    flown = simulate_samples(aircraft_from_dict(source), 32, 100.0)
    bare = {k: v for k, v in source.items() if not k.endswith("_position")}
    assert lags(flown, aircraft_from_dict(bare)) == [0.0, 0.0]


@pytest.mark.long
def test_neither_the_check_nor_that_in_flight_names_a_vane(flown, boomed):
    flight = flight_of(flown.samples, flown.samples.stamp, surface_noise=0.0005, arm=vane_arm(boomed))
    findings = check(flight).findings
    assert not [
        f for f in findings if f.severity in (ERROR, WARNING) and {"angle_of_attack", "sideslip"} & {*f.signals}
    ]
    pipeline = Pipeline(boomed)
    pipeline.push(flown.samples)
    pipeline.flush()
    assert pipeline.check.findings == ()
    assert watch_of(boomed).findings == ()
