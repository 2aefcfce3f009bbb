"""Motion that is recorded after the surfaces that make it: by how much is found, and parameters are freed of it."""

import numpy as np
import pytest
from aircraft_files import of_shape

from aircraft_sysid_ros.after_flight.delay_notes import delay_notes
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.identification.coefficients.layout import SIGNALS_OF_SAMPLE
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.identification.undescribed.late_motion import LateMotion
from aircraft_sysid_ros.identification.undescribed.moved_surfaces import (
    COUNT,
    DELAY,
    FIRST,
    LAG,
    MovedSurfaces,
    derivatives_of,
    look_ahead,
)
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.found_noise import completed_file
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

RECORDED = 0.04  # [s] surfaces before the motion


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


@pytest.mark.long
@pytest.mark.parametrize(("turbulence", "late"), [("none", RECORDED), ("moderate", 0.0)])
def test_lateness_is_found_and_what_is_in_use_holds_the_truth(turbulence: str, late: float) -> None:
    flight = simulate_samples(default_aircraft(), 43, 60.0, turbulence=turbulence, manoeuvres="varied")
    pipeline = flown(of_shape(flight.aircraft), early(flight.samples, late))
    found = pipeline.parameters.learning.undescribed.late_motion
    assert found is not None
    assert found.variance < 0.01**2
    assert found.time == pytest.approx(late, abs=3.0 * np.sqrt(found.variance))
    used = {p.name: p for p in pipeline.parameters.snapshot().parameters if p.status is Trust.USE}
    assert len(used) >= 12
    z = {name: (p.value - flight.coefficients[name]) / p.std for name, p in used.items()}
    assert max(map(abs, z.values())) < 3.5
    assert np.mean(np.abs([*z.values()]) < 1.96) > 0.85


#: A servo's lag [s] and a dead time [s] before it; how far off [s] the lag may be found, and each main derivative.
SERVOS = [
    (0.05, 0.0, 0.008, 0.12),
    pytest.param(0.08, 0.0, 0.012, 0.12, marks=pytest.mark.long),
    (0.1, 0.03, 0.02, 0.15),
]


@pytest.mark.long
@pytest.mark.parametrize(("lag", "dead_time", "far", "off"), SERVOS)
@pytest.mark.parametrize("turbulence", [pytest.param("none", marks=pytest.mark.long), "moderate"])
def test_of_commands_the_lag_of_the_servos_is_found_and_parameters_are_freed_of_it(
    turbulence: str, lag: float, dead_time: float, far: float, off: float
) -> None:
    sensors = SensorOptions(command_lag=lag, command_dead_time=dead_time)
    flight = simulate_samples(default_aircraft(), 45, 90.0, turbulence=turbulence, manoeuvres="varied", sensors=sensors)
    pipeline = flown(of_shape(flight.aircraft), flight.samples)
    parameters = pipeline.parameters
    way = parameters.learning.undescribed.late_motion
    assert way is not None
    assert way.course.is_lag
    assert way.course.dead_time == dead_time
    assert way.time == pytest.approx(lag, abs=far)
    assert "lag" in delay_notes(parameters)[0]
    known = {p.name: p for p in parameters.snapshot().parameters}
    for name in ("Cl_p", "Cl_da", "Cm_alpha", "Cm_q", "Cm_de", "Cn_beta", "Cn_r", "Cn_dr"):
        assert known[name].value == pytest.approx(flight.coefficients[name], rel=off), name
        assert abs(known[name].value - flight.coefficients[name]) < 2.0 * known[name].std, name


@pytest.mark.long
def test_the_delay_is_said_and_the_completed_file_has_it() -> None:
    flight = simulate_samples(default_aircraft(), 44, 60.0)
    for late in (RECORDED, 0.0):
        pipeline = flown(of_shape(flight.aircraft), early(flight.samples, late))
        said = delay_notes(pipeline.parameters)
        learnt = completed_file(pipeline.state, pipeline.parameters.learning.undescribed.late_surfaces)
        written = learnt["sensors"].get("control_surfaces", {}).get("delay")
        assert bool(said) == (written is not None) == (late > 0.0)
        if late:
            delay, std = map(float, written.split("±"))
            assert delay == pytest.approx(-late, abs=3.0 * std)
            assert std < 0.004
            assert f"delay: {delay:.3f}" in said[0]


@pytest.mark.long
def test_the_completed_file_has_the_lag_as_far_as_it_was_found() -> None:
    flight = simulate_samples(default_aircraft(), 46, 60.0, sensors=SensorOptions(command_lag=0.05))
    pipeline = flown(of_shape(flight.aircraft), flight.samples)
    learnt = completed_file(pipeline.state, pipeline.parameters.learning.undescribed.late_surfaces)
    lag, std = map(float, learnt["sensors"]["control_surfaces"]["lag"].split("±"))
    assert lag == pytest.approx(0.05, abs=3.0 * std)
    again = aircraft_from_dict(learnt)
    assert (again.sensors["control_surfaces"].lag, again.sensors["control_surfaces"].late_std) == (lag, std)
    told = flown(again, flight.samples).parameters
    left = told.learning.undescribed.late_motion
    assert left is not None
    assert abs(left.whole) < 0.012  # and still in doubt
    used = [p for p in told.snapshot().parameters if p.status is Trust.USE]
    assert len(used) >= 12
    assert max(abs(p.value - flight.coefficients[p.name]) / p.std for p in used) < 3.0
    by = {p.name: p.value for p in told.snapshot().parameters}
    assert by["Cl_p"] == pytest.approx(flight.coefficients["Cl_p"], rel=0.1)


@pytest.mark.parametrize("unsaid", [{"lag": None}, {"delay": None, "noise": 0.002}, {"lag": "0.00 ± 0.02"}, {}])
def test_what_is_null_or_was_found_is_not_said(unsaid) -> None:
    learning = Identifier(of_shape(default_aircraft(), sensors={"control_surfaces": unsaid})).learning
    assert learning.undescribed.late_motion is not None
    said = Identifier(of_shape(default_aircraft(), sensors={"controls": {"lag": 0.0}})).learning
    assert said.undescribed.late_motion is None


@pytest.mark.long
def test_a_file_that_says_when_is_believed() -> None:
    flight = simulate_samples(default_aircraft(), 43, 40.0)
    samples = early(flight.samples, RECORDED)
    believed = flown(of_shape(flight.aircraft, sensors={"control_surfaces": {"delay": 0.0}}), samples)
    assert believed.parameters.learning.undescribed.late_motion is None
    mean, std = believed.parameters.learning.undescribed.contradicted
    assert mean == pytest.approx(RECORDED, abs=max(3.0 * std, 0.01))
    told = flown(of_shape(flight.aircraft, sensors={"control_surfaces": {"delay": -RECORDED}}), samples)
    assert told.parameters.learning.undescribed.contradicted is None
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
    assert (motion.best.time, motion.best.variance) == (0.0, pytest.approx(THRESHOLDS.motion_late**2))


def test_forms_of_a_surface_are_what_a_delay_and_a_servo_make_of_it() -> None:
    time = np.arange(0.0, 4.0, 0.04)
    samples = np.zeros((len(time), SIGNALS_OF_SAMPLE + FIRST + COUNT))
    samples[:, 0] = time
    samples[:, SIGNALS_OF_SAMPLE + FIRST] = np.sin(3.0 * time)
    surfaces = MovedSurfaces()
    parts = [surfaces.follow(samples[begin : begin + 7]) for begin in range(0, len(samples), 7)]
    whole = MovedSurfaces().follow(samples)
    assert np.array_equal(np.concatenate(parts), whole)
    look_ahead(samples, whole)
    forms, settled = whole[:, 0], slice(40, len(samples) - 1)
    for at, form in zip(DELAY.times, DELAY.forms, strict=True):
        assert forms[settled, form] == pytest.approx(np.sin(3.0 * (time[settled] - at)), abs=2e-3)
    for lag, form in zip(LAG.times, LAG.forms, strict=True):
        size, turn = 1.0 / np.hypot(1.0, 3.0 * lag), np.arctan(3.0 * lag)
        assert forms[settled, form] == pytest.approx(size * np.sin(3.0 * time[settled] - turn), abs=3e-3)


def test_between_forms_the_parabola_goes_through_them() -> None:
    for time in (0.0, 0.013, 0.03, 0.07, 0.19):
        near = LAG.between(time)
        at = LAG.times[[list(LAG.forms).index(form) for form in near.forms]]
        for power in range(3):
            assert near.shares @ at**power == pytest.approx(time**power)
            assert near.slopes @ at**power == pytest.approx(
                power * time ** max(power - 1, 0) if power else 0.0, abs=1e-9
            )
