"""The flight that JSBSim flew is consistent with itself in our axes, units and definitions."""

import sys

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft import rigid_body
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.frames import continuous, rotation_matrix
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.simulation.jsbsim_flight import (
    FOOT,
    MODELS,
    jsbsim_aircraft_file,
    prepare_jsbsim,
    trimmed,
)
from aircraft_sysid_ros.simulation.simulated_flight import simulate_jsbsim_samples

jsbsim = pytest.importorskip("jsbsim")


@pytest.fixture(scope="module")
def flight():
    return simulate_jsbsim_samples("c172p", seed=1, duration=60.0)


@pytest.mark.parametrize("name", MODELS)
def test_aeroplanes_trim_and_answer_their_controls(name):
    setup = prepare_jsbsim(name)
    assert np.all(np.isfinite(setup.autopilot[3:]))
    assert setup.slopes.pitch_stiffness < 0.0
    assert setup.slopes.roll_damping < 0.0
    assert setup.slopes.yaw_stiffness > 0.0
    assert setup.slopes.pitch_control * setup.autopilot.pitch_gain > 0.0


@pytest.mark.long
def test_moments_of_the_motion_are_those_that_jsbsim_reports(flight, measured_coefficients):
    """Inertia, rates and accelerations in our axes give back the moments behind the coefficients."""
    aircraft, truth = flight.aircraft, flight.truth[::10]
    error = measured_coefficients(aircraft, truth) - truth.coefficients
    np.testing.assert_allclose(error[:, :3], 0.0, atol=1e-12)
    # JSBSim has products of inertia xy and yz of a crew of one, which an aircraft file does not
    assert np.all(error[:, 3:].std(axis=0) < 0.02 * truth.coefficients[:, 3:].std(axis=0))


@pytest.mark.long
def test_forces_are_the_curvature_of_the_way(flight):
    truth = flight.truth
    step = truth.time[1] - truth.time[0]
    acceleration = (truth.velocity[2:] - truth.velocity[:-2]) / (2.0 * step)
    force = np.array([rotation_matrix(q) @ f for q, f in zip(truth.quaternion, truth.specific_force, strict=True)])
    weight = np.median(acceleration - force[1:-1], axis=0)
    np.testing.assert_allclose(weight, [0.0, 0.0, 9.803], atol=0.012)  # within Coriolis acceleration


def test_position_is_the_integral_of_velocity(flight):
    truth = flight.truth
    step = truth.time[1] - truth.time[0]
    speed = (truth.position[2:] - truth.position[:-2]) / (2.0 * step)
    np.testing.assert_allclose(speed[:, :2], truth.velocity[1:-1, :2], atol=0.05)
    # 3 km away the plane of the origin is half a mrad off level
    np.testing.assert_allclose(speed[:, 2], truth.velocity[1:-1, 2], atol=0.05)


def test_the_flow_is_motion_less_wind(flight):
    truth = flight.truth[::50]
    flow = [
        rotation_matrix(q).T @ (v - w) for q, v, w in zip(truth.quaternion, truth.velocity, truth.wind, strict=True)
    ]
    np.testing.assert_allclose(truth.air_velocity, flow, atol=1e-6)
    np.testing.assert_allclose(truth.wind[0], [3.0, -2.0, 0.0], atol=1e-9)


def test_reported_forces_are_air_and_propeller(flight):
    """Lift carries the weight, and the recorded thrust explains the axial force with a plausible drag."""
    aircraft, truth = flight.aircraft, flight.truth
    cruise = truth.time < 3.0
    lift = -truth.specific_force[cruise, 2].mean()
    assert lift == pytest.approx(9.8, abs=0.5)
    qbar = 0.5 * truth.density * truth.airspeed**2
    axial = aircraft.mass * truth.specific_force[:, 0] - truth.controls[:, 5]
    drag = -axial[cruise] / (qbar[cruise] * aircraft.wing_area)
    assert 0.01 < drag.mean() < 0.08


def test_every_control_moves_and_the_flight_stays_near_its_condition(flight):
    truth = flight.truth
    assert np.all(np.ptp(truth.controls[:, :3], axis=0) > 0.05)
    assert np.ptp(truth.controls[:, 4]) > 0.3
    assert np.degrees(np.abs(truth.alpha)).max() < 12.0
    assert np.degrees(np.abs(truth.beta)).max() < 14.0
    assert np.abs(truth.position[:, 2]).max() < 60.0


def test_mass_and_shape_are_those_of_a_light_aeroplane():
    aircraft = aircraft_from_dict(jsbsim_aircraft_file("c172p"))
    assert aircraft.wing_area == pytest.approx(16.2, abs=0.1)
    assert aircraft.span == pytest.approx(10.9, abs=0.1)
    assert 700.0 < aircraft.mass < 1200.0
    assert not aircraft.coefficients
    assert aircraft.aerodynamic_reference[2] < 0.0  # the wing is above the centre of gravity


@pytest.mark.parametrize("name", ["c172p", "c182"])
def test_the_aerodynamic_reference_is_that_of_jsbsim(name):
    """About it the moment of the air is the sum of the terms in JSBSim's own aeroplane, in all three axes."""
    executive = trimmed(name)
    reference = np.array(jsbsim_aircraft_file(name)["aerodynamic_reference"]) / FOOT
    force = np.array([executive[f"forces/fb{axis}-aero-lbs"] for axis in "xyz"])
    moment = np.array([executive[f"moments/{axis}-aero-lbsft"] for axis in "lmn"])
    terms = [line.split()[0] for line in executive.query_property_catalog("aero/coefficient/").split("\n") if line]
    own = [sum(executive[t] for t in terms if t.startswith(f"aero/coefficient/{axis}")) for axis in ("Cl", "Cm", "Cn")]
    np.testing.assert_allclose(rigid_body.moment_at_reference(moment, force, reference), own, rtol=1e-9)


def test_attitudes_without_jumps():
    q = np.array([[1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [-0.6, 0.8, 0.0, 0.0], [0.6, -0.8, 0.0, 0.0]])
    smooth = continuous(q)
    assert np.all(np.sum(smooth[1:] * smooth[:-1], axis=1) > 0.0)
    np.testing.assert_array_equal(np.abs(smooth), np.abs(q))


def test_unknown_aeroplanes_and_a_missing_simulator_are_said(monkeypatch):
    with pytest.raises(InputError, match="use one of c172p"):
        prepare_jsbsim("spitfire")
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    with pytest.raises(InputError, match=r"need jsbsim.*aircraft_sysid_ros\[simulation\]"):
        prepare_jsbsim("c172p")


def test_nothing_is_written_into_the_working_directory(tmp_path, monkeypatch):
    """Some models of JSBSim come with an output file."""
    monkeypatch.chdir(tmp_path)
    trimmed("c172p")
    assert not list(tmp_path.iterdir())
