"""Where the navigation starts again in flight without GPS positions."""

import numpy as np

from aircraft_sysid_ros.calibration.navigation import navigate
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


def test_the_place_is_known_though_its_gps_was_lost(aircraft) -> None:
    """Of the last state it was not, and so was the field of the earth, by which a magnetometer is calibrated."""
    samples = simulate_samples(aircraft, 3, 26.0).samples
    time = (samples.stamp - samples.stamp[0]) * 1e-9
    lost = (time > 10.0) & (samples.kind == Kind.GPS_POSITION)
    found = navigate(samples[~lost & ~((time > 15.0) & (time < 16.0))], aircraft)
    assert found.time[-1] - found.time[0] > 24.0
    assert np.isfinite(found.origin).all()
