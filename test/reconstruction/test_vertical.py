"""Two loopings: through straight up, inverted and straight down, where angles of Euler have no meaning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.earth import gravity
from aircraft_sysid_ros.aircraft.frames import (
    euler_from_quaternion,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_from_euler,
    quaternion_log,
    quaternion_product,
    rotation_matrix,
)
from aircraft_sysid_ros.reconstruction.state import StateField, Status
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions, arrived, measure, turned
from aircraft_sysid_ros.sensors.truth import Truth

AIRSPEED, PITCH_RATE, WIND = 24.0, 1.2, np.array([3.0, -2.0, 0.0])
BEGIN, RAMP, LEVEL_AFTER, STEPS = 20.0, 0.5, 4.0, 400.0
END = BEGIN + 4.0 * np.pi / PITCH_RATE + RAMP
ATTITUDE_STD = slice(StateField.STANDARD_DEVIATIONS.start + 6, StateField.STANDARD_DEVIATIONS.start + 9)
SEEDS = range(4)


@pytest.fixture(scope="module")
def looping() -> Truth:
    """Level flight, two loopings at constant speed straight into the flow, level flight; exact kinematics."""
    time = np.arange(round((END + LEVEL_AFTER) * STEPS) + 1) / STEPS
    n, zeros = len(time), np.zeros(len(time))
    rates = np.zeros((n, 3))
    rates[:, 1] = PITCH_RATE * np.clip(np.minimum(time - BEGIN, END - time) / RAMP, 0.0, 1.0)
    quaternion = np.empty((n, 4))
    quaternion[0] = quaternion_from_euler(0.0, 0.0, 0.6)
    for i in range(1, n):
        turn = quaternion_exp(0.5 * (rates[i - 1] + rates[i]) / STEPS)
        quaternion[i] = quaternion_product(quaternion[i - 1], turn)
    air = np.tile([AIRSPEED, 0.0, 0.0], (n, 1))
    velocity = turned(quaternion, air) + WIND
    position = np.zeros((n, 3))
    position[1:] = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) / STEPS, axis=0)
    origin = np.array([0.78, -1.6, 450.0])
    weight = np.array([0.0, 0.0, gravity(origin[0], origin[2])])
    force = np.cross(rates, air) - np.array([rotation_matrix(q).T @ weight for q in quaternion])
    return Truth(
        time=time, position=position, velocity=velocity, quaternion=quaternion, rates=rates,
        angular_acceleration=np.gradient(rates, 1.0 / STEPS, axis=0), specific_force=force, air_velocity=air,
        airspeed=zeros + AIRSPEED, alpha=zeros, beta=zeros, density=zeros + 1.2, static_pressure=zeros + 98000.0,
        height=150.0 - position[:, 2], controls=np.zeros((n, 7)), inputs=np.zeros((n, 0)), wind=np.tile(WIND, (n, 1)),
        coefficients=np.zeros((n, 6)), origin=origin,
    )  # fmt: skip


@dataclass
class Flown:
    """What the filter made of a flight: times, errors of the attitude and their standard deviations [deg]."""

    estimator: StateEstimator
    rows: np.ndarray
    time: np.ndarray
    error: np.ndarray
    std: np.ndarray
    nose: np.ndarray  # true height of the nose, 1 straight up


def flown(aircraft, truth: Truth, seed: int, **sensors: bool) -> Flown:
    streams, biases = measure(aircraft, truth, seed, SensorOptions(**sensors))
    estimator = StateEstimator(aircraft)
    rows = np.vstack([estimator.push(arrived(streams)), estimator.flush()])
    time = rows[:, StateField.TIME] + (estimator.epoch - biases.stamp[0]) * 1e-9
    true = truth.at(time).quaternion
    pairs = zip(rows[:, StateField.ATTITUDE], true, strict=True)
    error = [quaternion_log(quaternion_product(quaternion_conjugate(q), t)) for q, t in pairs]
    nose = -turned(true, np.array([1.0, 0.0, 0.0]))[:, 2]
    return Flown(estimator, rows, time, np.degrees(error), np.degrees(rows[:, ATTITUDE_STD]), nose)


def check_unbroken(flight: Flown) -> None:
    assert np.all(np.isfinite(flight.rows[:, : StateField.STATUS]))
    assert np.all(flight.rows[:, StateField.STATUS] == Status.OK)
    assert np.all(np.diff(flight.time) < 0.011) and flight.time[-1] > END + LEVEL_AFTER - 0.1
    assert flight.estimator.realignments == 0


def test_the_looping_is_one(looping) -> None:
    pitch = np.array([euler_from_quaternion(q)[1] for q in looping.quaternion])
    assert np.degrees(pitch.max()) > 89.5 and np.degrees(pitch.min()) < -89.5
    moved = np.diff(looping.velocity, axis=0) * STEPS
    force = turned(looping.quaternion, looping.specific_force)
    weight = np.array([0.0, 0.0, gravity(looping.origin[0], looping.origin[2])])
    assert np.abs(moved - 0.5 * (force[1:] + force[:-1]) - weight).max() < 0.1


@pytest.mark.parametrize("seed", SEEDS)
def test_the_attitude_stays_right_through_the_vertical(seed, looping, aircraft) -> None:
    flight = flown(aircraft, looping, seed)
    check_unbroken(flight)
    assert flight.rows[-1, StateField.REJECTED] == 0
    vertical, second = np.abs(flight.nose) > np.cos(np.radians(5.0)), flight.time > BEGIN + 2.0 * np.pi / PITCH_RATE
    assert np.sum(vertical & second) > 20
    size = np.linalg.norm(flight.error, axis=1)
    assert size[vertical].max() < 3.0 and size[vertical & second].max() < 0.5
    turning = flight.time > BEGIN
    assert np.sqrt(np.mean((flight.error / flight.std)[turning] ** 2)) < 1.6
    assert np.abs((flight.error / flight.std)[turning]).max() < 5.0
    assert flight.rows[-1, StateField.WIND] == pytest.approx(WIND, abs=0.3)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_measured_attitude_agrees_through_the_vertical(seed, looping, aircraft) -> None:
    with_it, without = flown(aircraft, looping, seed, attitude=True), flown(aircraft, looping, seed)
    check_unbroken(with_it)
    counts = with_it.estimator.counts()["attitude"]
    assert counts["fused"] > 3000 and counts["rejected"] == counts["skipped"] == 0
    assert with_it.estimator.innovation_consistency()["attitude"] == pytest.approx(1.0, abs=0.06)  # 10 000 outputs
    assert np.abs(with_it.error[with_it.time > BEGIN]).max() < 0.5
    level = (with_it.time > BEGIN - 5.0) & (with_it.time < BEGIN)
    assert np.abs(with_it.error[level, 2]).max() < 0.3 * np.abs(without.error[level, 2]).max()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_magnetometer_does_no_harm_after_the_vertical(seed, looping, aircraft) -> None:
    flight = flown(aircraft, looping, seed, magnetometer=True)
    check_unbroken(flight)
    counts = flight.estimator.counts()["magnetic_field"]
    assert counts["fused"] > 300 and counts["skipped"] == 0
    assert np.linalg.norm(flight.error, axis=1)[flight.time > BEGIN + 2.0 * np.pi / PITCH_RATE].max() < 1.0


@pytest.fixture(scope="module")
def straight(looping, aircraft) -> dict[bool, tuple[np.ndarray, np.ndarray]]:
    """Errors and standard deviations (8, n, 3) in straight flight, by whether there is a magnetometer."""
    found = {}
    for magnetometer in (False, True):
        flights = [flown(aircraft, looping, seed, magnetometer=magnetometer) for seed in range(8)]
        chosen = [(flight.time > BEGIN - 10.0) & (flight.time < BEGIN) for flight in flights]
        errors = [flight.error[rows] for flight, rows in zip(flights, chosen, strict=True)]
        found[magnetometer] = (
            np.stack(errors),
            np.stack([flight.std[rows] for flight, rows in zip(flights, chosen, strict=True)]),
        )
    return found


@pytest.mark.long
def test_a_magnetometer_gives_the_heading_of_straight_flight(straight) -> None:
    """Without one the heading rests on the wind, which straight flight does not tell."""
    heading = {there: np.sqrt(np.mean(error[:, :, 2] ** 2)) for there, (error, _) in straight.items()}
    assert heading[True] < 0.8 * heading[False]


@pytest.mark.long
def test_straight_flight_is_as_uncertain_as_it_says(straight) -> None:
    error, std = straight[False]
    assert np.sqrt(np.mean((error / std) ** 2, axis=(0, 1))).max() < 1.5
    assert np.abs(np.mean(error[:, :, :2], axis=(0, 1))).max() < 1.0


def test_the_noise_of_a_magnetometer_tilts_nothing_and_is_counted(straight) -> None:
    """In a field of 70 deg, whose heading is three times as noisy as its direction."""
    error, std = straight[True]
    assert np.abs(np.mean(error, axis=(0, 1))[:2]).max() < 1.0
    assert np.sqrt(np.mean((error / std) ** 2, axis=(0, 1))).max() < 1.5
