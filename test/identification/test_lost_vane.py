"""A vane that is lost in flight where there is one alone."""

import pytest
from aircraft_files import of_shape

from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.sensor_faults import with_fault
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


def test_what_is_known_of_a_vane_that_nobody_described_is_enough_to_see_a_change(aircraft):
    """Its scale is in doubt, and the same all flight long: with that in the standard errors nothing was surely known,
    so that nothing contradicted it.
    """
    flight = simulate_samples(aircraft, seed=8, duration=30.0, manoeuvres="varied")
    pipeline = Pipeline(of_shape(aircraft))
    pipeline.push(flight.samples)
    learning = pipeline.parameters.learning
    kept = learning.integrity.checkpoints.newest()
    names = pipeline.parameters.model.parameter_names
    surely = dict(zip(names, learning.integrity.known_before.is_known, strict=True))
    at = names.index("CZ_alpha")
    assert surely["CZ_alpha"]
    assert kept.said[1, at] > THRESHOLDS.known_surely * abs(kept.said[0, at])  # by what is published it is not
    assert (kept.within_flight[1] <= kept.said[1]).all()


@pytest.mark.long
@pytest.mark.parametrize("seed", [8, 9, 11])
def test_no_value_is_wrong_after_a_vane_stuck_that_nobody_described(aircraft, seed):
    """What was learnt of C_X and C_m with the dead vane had USE for half a minute, many standard errors off."""
    flight = simulate_samples(aircraft, seed=seed, duration=100.0, turbulence="light", manoeuvres="varied")
    samples = with_fault(flight.samples, "alpha_stuck_noisy", 40.0, 65.0)
    pipeline, first = Pipeline(of_shape(aircraft)), int(samples.stamp[0])
    for end in range(65, 106, 5):
        due = samples.stamp < first + end * 10**9
        pipeline.push(samples[due])
        samples = samples[~due]
        used = [p for p in pipeline.parameters.snapshot().parameters if p.status is Trust.USE]
        assert all(abs(p.value - flight.coefficients[p.name]) < 4.0 * p.std for p in used)
    assert len(used) > 15
