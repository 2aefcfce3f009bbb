"""Motion that is recorded after the surfaces that make it: by how much is found, and parameters are freed of it."""

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight.replay_notes import delay_notes
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.identification.late_motion import LAG, LateMotion
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.identification.undescribed_sensors import derivatives_of
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.found_noise import completed_file
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

SHAPE = ("name", "mass", "wing_area", "span", "chord", "inertia", "imu_position", "air_data_position", "gps_position")
RECORDED = 0.04  # [s] surfaces before the motion


def of_shape(aircraft: Aircraft, **more: object) -> Aircraft:
    return aircraft_from_dict({key: aircraft.source[key] for key in SHAPE} | more)


def early(samples: Samples, by: float) -> Samples:
    """The surfaces as commands are: ahead of what they do."""
    stamp = samples.stamp.copy()
    stamp[samples.kind == Kind.CONTROLS] -= round(by * 1e9)
    order = np.argsort(stamp, kind="stable")
    return Samples(stamp[order], samples.kind[order], samples.values[order])


def flown(aircraft: Aircraft, samples: Samples) -> Pipeline:
    pipeline = Pipeline(aircraft)
    pipeline.push(samples)
    pipeline.flush()
    return pipeline


@pytest.mark.parametrize(("turbulence", "late"), [("none", RECORDED), ("moderate", 0.0)])
def test_lateness_is_found_and_what_is_in_use_holds_the_truth(turbulence: str, late: float) -> None:
    flight = simulate_samples(default_aircraft(), 43, 60.0, turbulence=turbulence, manoeuvres="varied")
    pipeline = flown(of_shape(flight.aircraft), early(flight.samples, late))
    found = pipeline.parameters.learning.undescribed.late_motion
    assert found is not None
    assert found[1] < 0.01
    assert found[0] == pytest.approx(late, abs=3.0 * found[1])
    used = {p.name: p for p in pipeline.parameters.snapshot().parameters if p.status is Trust.USE}
    assert len(used) >= 12
    z = {name: (p.value - flight.coefficients[name]) / p.std for name, p in used.items()}
    assert max(map(abs, z.values())) < 3.5
    assert np.mean(np.abs([*z.values()]) < 1.96) > 0.85


def test_the_delay_is_said_and_the_completed_file_has_it() -> None:
    flight = simulate_samples(default_aircraft(), 44, 60.0)
    for late in (RECORDED, 0.0):
        pipeline = flown(of_shape(flight.aircraft), early(flight.samples, late))
        said = delay_notes(pipeline.parameters)
        learnt = completed_file(pipeline.state, pipeline.parameters.learning.undescribed.delay_of_surfaces)
        delay = learnt["sensors"].get("control_surfaces", {}).get("delay")
        assert bool(said) == (delay is not None) == (late > 0.0)
        if late:
            assert delay == pytest.approx(-late, abs=0.008)
            assert f"delay: {delay:.3f}" in said[0]


def test_a_file_that_says_when_is_believed() -> None:
    flight = simulate_samples(default_aircraft(), 43, 40.0)
    samples = early(flight.samples, RECORDED)
    believed = flown(of_shape(flight.aircraft, sensors={"control_surfaces": {"delay": 0.0}}), samples)
    assert believed.parameters.learning.undescribed.late_motion is None
    told = flown(of_shape(flight.aircraft, sensors={"control_surfaces": {"delay": -RECORDED}}), samples)
    truth = flight.coefficients["Cl_p"]
    by = {p.name: p.value for p in believed.parameters.snapshot().parameters}
    right = {p.name: p.value for p in told.parameters.snapshot().parameters}
    assert abs(by["Cl_p"] / truth - 1.0) > 0.2  # roll dies out in little more than that
    assert abs(right["Cl_p"] / truth - 1.0) < 0.1


def test_nothing_is_known_before_it_moves() -> None:
    model = default_aircraft().model
    motion = LateMotion()
    motion.adopt(model.offsets, [derivatives_of(model, axis) for axis in range(6)])
    motion.look(0.0)
    assert (motion.late, motion.variance) == (0.0, pytest.approx(LAG**2))
