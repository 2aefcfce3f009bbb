"""What gusts alone have moved is not known yet: they turn an aeroplane by more than what its sensors show."""

from __future__ import annotations

import pytest

from aircraft_sysid_ros.flight_check.laws import turns
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

AXES = ("Cl", "Cn")


def of_axes(pipeline: Pipeline) -> dict:
    found = pipeline.parameters.snapshot().parameters
    return {p.name: p for p in found if p.name[:2] in AXES and not p.name.endswith("_0")}


def test_before_aileron_and_rudder_have_moved_nothing_of_roll_and_yaw_is_to_be_used(aircraft):
    """C_l,p was -0.33 with a standard error of 5 %, and is -0.45; what came after was held against it."""
    samples = simulate_samples(aircraft, 10_150_124, 70.0, turbulence="moderate", manoeuvres="flaps").samples
    early = samples.stamp < samples.stamp.min() + 22 * 10**9
    pipeline = Pipeline(aircraft)
    pipeline.push(samples[early])
    before = of_axes(pipeline)
    assert not any(p.status is Trust.USE for p in before.values())
    assert before["Cl_p"].reason == "so far only gusts move Cl: move the aileron"
    pipeline.push(samples[~early])
    pipeline.flush()
    after = of_axes(pipeline)
    for name in ("Cl_p", "Cl_da", "Cn_beta"):
        assert after[name].status is Trust.USE
        assert after[name].value == pytest.approx(aircraft.coefficients[name], rel=0.2)
    assert not pipeline.parameters.learning.integrity.count


@pytest.mark.long
def test_in_straight_flight_the_nose_turns_into_gusts_and_the_course_with_them(aircraft):
    """No yaw goes against the course by that: the gyros of a sound flight had been held for it."""
    options = SensorOptions(attitude=True, height_above_ground=True)
    straight = simulate_samples(
        aircraft, 10_150_061, 125.0, turbulence="moderate", manoeuvres="low_passes", sensors=options
    ).samples
    straight = straight[straight.stamp > straight.stamp.min() + 40 * 10**9]
    turning = simulate_samples(aircraft, 7, 90.0, turbulence="light", sensors=options).samples
    found = [
        {r.first: r.sign for r in turns.relations(Motion(flight_of(samples, samples.stamp))) if r.comparison.is_sure}
        for samples in (straight, turning)
    ]
    assert not {"attitude.yaw", "angular_velocity.z"} & found[0].keys()
    assert found[1]["attitude.yaw"] == found[1]["angular_velocity.z"] == 1.0
