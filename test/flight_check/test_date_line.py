"""Flights over the meridian of 180 degrees, where the longitude leaps, and far to the north, where meridians meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.earth import geodetic_along
from aircraft_sysid_ros.flight_check.check import check, contradictions
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.samples import Kind, Samples, concatenate, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


@pytest.fixture(scope="module")
def flown(aircraft):
    return simulate_samples(aircraft, 1, 60.0).samples


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_nothing_more_is_found_where_it_is_crossed(flown, share):
    """It lies at a share of the longitudes of the flight, which goes along it and across it."""
    values, fix = flown.values.copy(), flown.kind == Kind.GPS_POSITION
    east = values[fix, 1] - np.quantile(values[fix, 1], share)
    values[fix, 1] = (east + 2.0 * np.pi) % (2.0 * np.pi) - np.pi
    assert np.ptp(values[fix, 1]) > 6.0
    moved = Samples(flown.stamp, flown.kind, values)
    here, there = (check(flight_of(samples, samples.stamp)) for samples in (flown, moved))
    assert [f.sentence for f in there.findings] == [f.sentence for f in here.findings]
    np.testing.assert_allclose(there.motion.position, here.motion.position, atol=0.1)


def test_fixes_without_an_altitude_have_a_place(flown):
    """North and east had gone with the altitude."""
    values, fix = flown.values.copy(), np.flatnonzero(flown.kind == Kind.GPS_POSITION)
    values[fix[len(fix) // 2 :], 2] = np.nan
    here, there = (check(flight_of(s, s.stamp)).motion.position for s in (flown, replace(flown, values=values)))
    np.testing.assert_allclose((there - there[100])[:, :2], (here - here[100])[:, :2], atol=0.1)
    assert np.isnan(there[-500:, 2]).all() and np.isfinite(there[500:1000, 2]).all()


def test_velocity_east_is_that_of_positions_a_thousand_kilometres_further_north():
    """950 km from 45 degrees on, straight at first, then in turns: a degree of longitude has become a sixth shorter."""
    seconds, rng = np.arange(0.0, 4000.0, 0.2), np.random.default_rng(0)
    course = np.where(seconds > 2800.0, 0.4 * np.sin(2.0 * np.pi * seconds / 40.0), 0.0)
    velocity = 240.0 * np.column_stack([np.cos(course), np.sin(course), np.zeros_like(course)])
    way = np.vstack([np.zeros(3), np.cumsum(0.1 * (velocity[1:] + velocity[:-1]), axis=0)])
    places = geodetic_along(way, [np.radians(45.0), 0.1, 8000.0])
    stamp = np.rint(seconds * 1e9).astype(np.int64)
    shown = velocity + rng.normal(0.0, 0.1, velocity.shape)
    samples = concatenate([samples_of(Kind.GPS_POSITION, stamp, places), samples_of(Kind.GPS_VELOCITY, stamp, shown)])
    assert not contradictions(flight_of(samples, samples.stamp))[0]
