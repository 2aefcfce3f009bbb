"""Where an IMU sits, told by forces: the kinematics of a rigid body, and what must not be taken for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.expression import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.imu_columns import columns_of, turning_of, unsaid_columns
from aircraft_sysid_ros.diagnosis.flight.motion_coefficients import coefficients_of_motion
from aircraft_sysid_ros.diagnosis.imu_place import setting_of_forces, sideways_of_forces
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.effects import BY_ID

STEP = 0.04


def waves(time, seed, count, size):
    """Smooth series (n, count)."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(0.5, 6.0, (12, count)), rng.uniform(0.0, 6.3, (12, count)), rng.normal(size=(12, count))
    return size * np.sum(at[2] * np.sin(at[0] * time[:, None, None] + at[1]), axis=1) / 3.0


def flight(aircraft, place=(0.0, 0.0, 0.0), of_beta=0.0, seed=1):
    """90 s whose gusts turn the aeroplane: the turning is what it is, and the force that of a linear model."""
    time = np.arange(0.0, 90.0, STEP)
    rates = waves(time, seed, 3, 0.3)
    turning = np.gradient(rates, STEP, axis=0, edge_order=2)
    signals = np.zeros((len(time), SIGNAL_COUNT))
    pressure = 0.6 * (25.0 + waves(time, seed + 1, 1, 2.0)[:, 0]) ** 2
    known = {"V": np.sqrt(pressure / 0.6), "qbar": pressure, "time": time, "height": 100.0 + 0.0 * time}
    known |= dict(zip("pqr", rates.T, strict=True))
    known |= dict(zip(("alpha", "beta", "de", "da", "dr", "Tc"), waves(time, seed + 2, 6, 0.05).T, strict=True))
    known["beta"] = turning[:, 2] / 20.0 + 0.2 * known["beta"]  # yaw stiffness
    for name, values in known.items():
        signals[:, SIGNAL_INDEX[name]] = values
    rng = np.random.default_rng(seed)
    force = np.column_stack([0.3 * known["alpha"], -0.5 * known["beta"], -5.0 * known["alpha"] - 0.4])
    force = force * (pressure * aircraft.wing_area / aircraft.mass)[:, None]
    arm = np.array(place) * aircraft.span
    force = force + np.cross(turning, arm) + np.cross(rates, np.cross(rates, arm)) + 0.05 * rng.normal(size=force.shape)
    measured = coefficients_of_motion(aircraft, force, rates, turning, pressure)
    measured[:, 0] += of_beta * known["beta"]
    return FlightData(aircraft, time, measured, signals, STEP), turning


def test_an_accelerometer_away_from_the_centre_feels_the_second_derivative_of_its_way(aircraft):
    """Of a body that only turns: the way of the point, R(t) d, differentiated twice, in body axes."""
    step, axis, d = 1e-3, np.array([0.3, -0.5, 0.8]), np.array([0.2, -0.4, 0.1])
    angle = np.arange(0.0, 1.0, step) ** 2  # about a fixed axis, faster and faster
    unit = axis / np.linalg.norm(axis)
    turns = [rotation_matrix(np.array([np.cos(a / 2), *(np.sin(a / 2) * unit)])) for a in angle]
    way = np.array([turn @ d for turn in turns])
    pushed = np.gradient(np.gradient(way, step, axis=0), step, axis=0)
    felt = np.array([turn.T @ a for turn, a in zip(turns, pushed, strict=True)])
    rates = np.gradient(angle, step)[:, None] * unit
    signals, pressure = np.zeros((len(angle), SIGNAL_COUNT)), np.full(len(angle), 300.0)
    signals[:, [SIGNAL_INDEX[name] for name in ("p", "q", "r")]] = rates
    signals[:, SIGNAL_INDEX["qbar"]] = pressure
    measured = coefficients_of_motion(
        aircraft, np.zeros_like(rates), rates, np.full((len(angle), 1), 2.0) * unit, pressure
    )
    data = FlightData(aircraft, np.arange(len(angle)) * step, measured, signals, step)
    expected = coefficients_of_motion(aircraft, felt, rates, 2.0 * np.ones((len(angle), 1)) * unit, pressure)
    made = np.column_stack([column @ d for column in columns_of(data).values()])
    np.testing.assert_allclose(made[10:-10], expected[10:-10, :3], atol=2e-3 * np.abs(expected[10:-10, :3]).max())


def test_the_measured_moments_say_how_it_turns(aircraft):
    data, turning = flight(aircraft)
    np.testing.assert_allclose(turning_of(data), turning, atol=1e-9 * np.abs(turning).max())


@pytest.mark.parametrize("aside", [0.04, -0.03])
def test_an_imu_aside_is_found_wherever_else_it_is(aircraft, aside):
    data, _ = flight(aircraft, (0.02, aside, 0.03))
    told = sideways_of_forces(data)
    assert told is not None and told[0] == pytest.approx(aside, abs=0.004) and told[1] > 1.0
    setting = setting_of_forces(data, BY_ID["imu_offset"])
    assert setting is not None and setting.variant.setting == ("imu_position", "y")
    assert setting.value == pytest.approx(aside, abs=0.004)


def test_what_is_no_place_is_none(aircraft):
    """Neither a clean flight, nor a drag that goes with sideslip, and so with the yaw acceleration: one force only."""
    for seed in (1, 11, 21):
        assert sideways_of_forces(flight(aircraft, seed=seed)[0]) is None
        assert sideways_of_forces(flight(aircraft, of_beta=0.3, seed=seed)[0]) is None


def test_a_place_that_nobody_said_explains_the_forces_before_an_expression_may(aircraft):
    """An IMU a tenth of the span below where a silent file has it leaves no p' in C_Y to be named."""
    silent = replace(aircraft, unsaid=frozenset(("imu_position", at) for at in "xyz"))
    there, below = (flight(silent, place)[0] for place in ((0.0, 0.0, 0.0), (0.0, 0.0, 0.1)))
    columns, names = unsaid_columns(below, "CY")
    assert names == ["CY_place_x", "CY_place_y", "CY_place_z"]
    np.testing.assert_array_equal(columns, columns_of(below)["CY"])
    said = replace(below, aircraft=aircraft)
    errors = [CandidateEvaluator(data).fits["CY"].nrmse_held_out for data in (there, below, said)]
    assert errors[1] < 1.2 * errors[0] and errors[2] > 3.0 * errors[0]
    assert unsaid_columns(below, "Cm")[1] == [] and unsaid_columns(said, "CY")[1] == []
