"""A vane that is lost in flight where there is one alone."""

import pytest

from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

VANES = {Kind.ANGLE_OF_ATTACK: ("Cm_alpha", "angle of attack"), Kind.SIDESLIP: ("Cn_beta", "sideslip")}


@pytest.mark.parametrize("kind", VANES)
def test_what_rests_on_the_only_vane_is_held_once_it_is_lost(aircraft, kind):
    (other,) = VANES.keys() - {kind}
    samples = simulate_samples(aircraft, seed=8, duration=40.0).samples
    samples = samples[samples.kind != other]
    lost = int(samples.stamp[0]) + 30 * 10**9
    pipeline = Pipeline(aircraft)
    pipeline.push(samples[samples.stamp < lost])
    before = {p.name: p for p in pipeline.parameters.snapshot().parameters}
    pipeline.push(samples[(samples.stamp >= lost) & (samples.kind != kind)])
    pipeline.flush()
    after = {p.name: p for p in pipeline.parameters.snapshot().parameters}
    name, angle = VANES[kind]
    assert before[name].status is Trust.USE
    assert after[name].status is Trust.HOLD and f"no {angle}" in after[name].reason
