"""A wind of half of the airspeed, and short pieces: nothing is wrong there, and nothing is found."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import check, contradictions
from aircraft_sysid_ros.flight_check.grid import compare
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

SECOND = 10**9


def serious(findings):
    return [finding.sentence for finding in findings if finding.severity != "info"]


@pytest.mark.parametrize("wind", [(-8.5, 0.0, 0.0), (-10.5, 0.0, 0.0), (9.0, 0.0, 0.0)])
def test_a_straight_flight_against_it_or_with_it_is_sound(aircraft, wind):
    """17 m/s through the air, 7 to 26 over ground: an airspeed in knots, and in flight, after half a minute."""
    options = SensorOptions(attitude=True)
    flown = simulate_samples(aircraft, 3, 40.0, wind=wind, turbulence="light", sensors=options).samples
    assert not serious(check(flight_of(flown, flown.stamp)).findings)
    begun = flown[flown.stamp < flown.stamp.min() + 33 * SECOND]
    assert not serious(contradictions(flight_of(begun, begun.stamp))[0])


def test_what_flies_slowly_over_ground_flies(aircraft):
    """Standing, then upwind at 3 m/s over ground, then downwind at 27 m/s."""
    seconds = np.arange(0, 180, 0.2)
    stamp = np.rint(seconds * SECOND).astype(np.int64)
    stands, upwind = seconds < 40.0, (seconds >= 40.0) & (seconds < 120.0)
    ground = np.where(stands, 0.05, np.where(upwind, 3.0, 27.0))
    air = np.where(stands, 12.0, 15.0) + 0.3 * np.sin(seconds)  # the wind blows into the pitot
    along = np.column_stack([ground, np.zeros_like(ground), np.zeros_like(ground)])
    samples = [samples_of(Kind.GPS_VELOCITY, stamp, along), samples_of(Kind.AIRSPEED, stamp, air[:, None])]
    joined = concatenate(samples)
    motion = Motion(flight_of(joined, joined.stamp))
    time = motion.grid.step * np.arange(motion.grid.count)
    assert not motion.in_air[(time > 5.0) & (time < 35.0)].any()
    assert motion.in_air[(time > 50.0) & (time < 170.0)].all()


def test_pieces_that_hardly_overlap_at_a_lag_do_not_agree():
    """Three of 0.8 s with 19 s between them, of noise: at lags of half a second a point or two is left of each."""
    step, sure = 0.02, 0
    for seed in range(60):
        draws = np.random.default_rng(seed)
        x, y = draws.normal(size=(2, 2000))
        kept = np.zeros(2000, np.bool_)
        for begin in (0, 990, 1960):
            kept[begin : begin + 40] = True
        found = compare(np.where(kept, y, np.nan), np.where(kept, x, np.nan), step, longest_lag=0.78)
        sure += found is not None and found.is_sure
    assert sure == 0
