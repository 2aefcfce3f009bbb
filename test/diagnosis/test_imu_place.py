"""Where an IMU sits, told by forces: the kinematics of a rigid body, and what must not be taken for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.motion_coefficients import coefficients_of_motion
from aircraft_sysid_ros.diagnosis.flight.place_columns import columns_of, rates_of, turning_of, unsaid_columns
from aircraft_sysid_ros.diagnosis.measurement.imu_place import setting_of_forces, sideways_of_forces
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.search_round import SearchRound, outside_in
from aircraft_sysid_ros.diagnosis.significance.maximum_statistic import Null
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
    half = np.array([0.5 * aircraft.span, aircraft.chord, 0.5 * aircraft.span])
    known |= dict(zip("pqr", (rates * half).T / known["V"], strict=True))
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
    half = np.array([0.5 * aircraft.span, aircraft.chord, 0.5 * aircraft.span])
    signals[:, [SIGNAL_INDEX[name] for name in ("p", "q", "r")]] = rates * half / 20.0
    signals[:, SIGNAL_INDEX["V"]] = 20.0
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


def test_what_a_place_that_nobody_said_explains_as_well_is_no_expression(aircraft):
    """An IMU ahead of where a silent file has it measures r' + p q in C_Y."""
    silent = replace(aircraft, unsaid={("imu_position", at): np.nan for at in "xyz"})
    ahead = flight(silent, (0.3, 0.0, 0.0))[0]
    columns, names = unsaid_columns(ahead, "CY")
    assert names == ["CY_place_imu_x", "CY_place_imu_y", "CY_place_imu_z"] and unsaid_columns(ahead, "Cm")[1] == []
    np.testing.assert_array_equal(columns, columns_of(ahead)["CY"])

    def named(data):
        bench = CandidateEvaluator(data)
        null = Null({outside_in("CY"): np.array([0.001, 0.002, 0.003, 0.002])})
        first = {axis: fit.nrmse_held_out for axis, fit in bench.fits.items()}
        search = SearchRound(bench, [], null, [], lambda share: None, None, first, {})
        return [finding.trial.main_axis for finding in search.findings([])]

    assert named(replace(ahead, aircraft=aircraft)) == ["CY"] and named(ahead) == []


def test_so_is_what_a_vane_that_is_elsewhere_shows_too_much(aircraft):
    silent = replace(aircraft, unsaid={("air_data_position", at): np.nan for at in "xyz"})
    data, rates = flight(silent)[0], rates_of(flight(silent)[0])
    columns, names = unsaid_columns(data, "Cm")
    assert names == ["Cm_place_vane_x", "Cm_place_vane_y"]
    np.testing.assert_allclose(columns, np.column_stack([-rates[:, 1], rates[:, 0]]) / data.signal("V")[:, None])
    assert unsaid_columns(data, "Cn")[1] == ["Cn_place_vane_x", "Cn_place_vane_z"]
