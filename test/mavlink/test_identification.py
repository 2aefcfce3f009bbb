"""In small: parameters through the MAVLink simulator, its link and its clock are those of the direct topics."""

import numpy as np
import pytest

from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.mavlink.session import Session
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.mavlink_simulator.autopilot import Faults, MavlinkSimulator
from aircraft_sysid_ros.simulation.mavlink_simulator.flight import START, Link, bridged, samples_of_outputs
from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import direct_samples

LINK = Link(least=0.004, jitter=0.006)


@pytest.fixture(scope="module")
def both(events, mapping):
    """Samples of the direct topics, and of the bridge over a link with jitter, from a clock that drifts."""
    outputs = bridged(events, MavlinkSimulator(mapping, Faults(drift=40e-6)), Session(mapping), LINK)
    return direct_samples(events, START), samples_of_outputs(outputs)


def nearest(stamps, wanted):
    """For each wanted stamp the number of the nearest one."""
    right = np.clip(np.searchsorted(stamps, wanted), 1, len(stamps) - 1)
    return np.where(wanted - stamps[right - 1] <= stamps[right] - wanted, right - 1, right)


@pytest.mark.long
def test_samples_are_the_same_but_for_rounding(both):
    """Stamps within 3 ms; values within what MAVLink's integers round to."""
    direct, bridge = both
    kinds = {  # tolerance and number of values; the vertical velocity is another sample, of the autopilot's filter
        Kind.IMU: (1e-5, 6), Kind.GPS_VELOCITY: (0.01, 2), Kind.AIRSPEED: (1e3, 1), Kind.ANGLE_OF_ATTACK: (1e-7, 1),
        Kind.SIDESLIP: (1e-7, 1),
    }  # fmt: skip
    for kind, (tolerance, width) in kinds.items():
        a, b = direct[direct.kind == kind], bridge[bridge.kind == kind]
        order = nearest(a.stamp, b.stamp)
        late = b.stamp > START + 5 * 10**9
        assert np.abs(a.stamp[order] - b.stamp)[late].max() < (13e6 if kind == Kind.AIRSPEED else 3e6)
        # VFR_HUD has no time: it is stamped like the message before it, and which sample it is nobody knows
        np.testing.assert_allclose(b.values[late, :width], a.values[order][late, :width], atol=tolerance)
    surfaces = [s[s.kind == Kind.CONTROLS] for s in both]
    order = nearest(surfaces[0].stamp, surfaces[1].stamp)
    pulse = np.radians(60.0 / 1000.0)
    difference = surfaces[1].values[:, :3] - surfaces[0].values[order, :3]
    assert np.abs(difference[50:]).max() <= 0.51 * pulse
    thrust = surfaces[1].values[50:, 5] - surfaces[0].values[order, 5][50:]
    assert np.nanmedian(np.abs(thrust)) < 0.01  # [N] of 2.5; a named float comes after the servos of its sample


@pytest.mark.long
def test_parameters_are_the_same_within_their_standard_errors(both, aircraft):
    found = []
    for samples in both:
        pipeline = Pipeline(aircraft)
        pipeline.push(samples)
        pipeline.flush()
        found.append(pipeline.parameters.snapshot().parameters)
    used = [(a, b) for a, b in zip(*found, strict=True) if Trust.USE in (a.status, b.status)]
    z = np.array([(b.value - a.value) / a.std for a, b in used])
    assert len(z) > 20
    assert np.sqrt(np.mean(z**2)) < 1.0 and np.abs(z).max() < 3.0
