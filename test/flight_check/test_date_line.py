"""A flight over the meridian of 180 degrees: its longitude goes from one end of its range to the other."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.samples import Kind, Samples
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
