"""The aeroplane that is flown step by step: its sensors, its damage, its faults."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.earth import ned_along
from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.closed_loop import (
    ATTITUDE_TOPIC,
    DAMAGES,
    STEP,
    TRAILING,
    Reading,
    SteppedAeroplane,
    damage_of,
    samples_of_sensed,
)
from aircraft_sysid_ros.simulation.closed_loop_faults import FAULTS, LEAKED, fault_of
from aircraft_sysid_ros.simulation.dynamics import CONTROLS, STATE_SIZE, airframe_of, motion


def flown(aircraft, steps=300, **options):
    """Readings (n, …) and samples of a flight with moving surfaces."""
    aeroplane = SteppedAeroplane(aircraft, 1, steps * STEP, **options)
    readings, sensed = [], []
    for k in range(steps):
        reading, now = aeroplane.look()
        readings.append(reading)
        sensed += now
        wave = 0.03 * np.sin(k * STEP * np.array([5.0, 7.0, 6.0, 0.0]))
        aeroplane.advance(aeroplane.setup.trim.controls + wave)
    return np.array(readings), sensed, aeroplane


@pytest.fixture(scope="module")
def calm(aircraft):
    return flown(aircraft, turbulence=0.0)


def test_trimmed_it_flies_on(aircraft):
    still = replace(aircraft, process_noise={**aircraft.process_noise, "wind": 0.0})
    aeroplane = SteppedAeroplane(still, 0, 5.0, turbulence=0.0)
    for _ in range(500):
        aeroplane.advance(aeroplane.setup.trim.controls)
    reading, _ = aeroplane.look()
    trim = aeroplane.setup.trim
    assert reading[Reading.TRUE_AIR] == pytest.approx([17.0, trim.alpha, trim.beta], abs=1e-3)
    assert reading[Reading.HEIGHT] == pytest.approx(120.0, abs=0.1)


def test_the_imu_moves_as_the_antenna_and_its_lever_arm_say(aircraft, calm):
    """Velocity of the IMU differentiated in the world is its specific force and gravity, by central differences."""
    readings, _, aeroplane = calm
    turn = np.array([rotation_matrix(q) for q in readings[:, Reading.QUATERNION]])
    arm = aircraft.imu_position - aircraft.gps_position
    velocity = readings[:, Reading.VELOCITY] + np.einsum("kij,kj->ki", turn, np.cross(readings[:, Reading.RATES], arm))
    measured = np.einsum("kij,kj->ki", turn, readings[:, Reading.FORCE]) + [0.0, 0.0, aeroplane.setup.place.gravity]
    difference = (velocity[2:] - velocity[:-2]) / (2.0 * STEP)
    assert np.abs(measured).max() > 1.0
    assert difference == pytest.approx(measured[1:-1], abs=0.05)


def test_the_probe_shows_the_air_at_its_place(aircraft, calm):
    readings, _, _ = calm
    v, alpha, beta = readings[:, Reading.TRUE_AIR].T
    flow = np.stack([v * np.cos(alpha) * np.cos(beta), v * np.sin(beta), v * np.sin(alpha) * np.cos(beta)], axis=1)
    flow += np.cross(readings[:, Reading.RATES], aircraft.air_data_position)
    assert np.linalg.norm(flow, axis=1) == pytest.approx(readings[:, 6], rel=1e-12)
    assert np.arctan2(flow[:, 2], flow[:, 0]) == pytest.approx(readings[:, 7], abs=1e-12)


def test_samples_have_the_noise_and_the_rates_of_the_file(aircraft):
    readings, sensed, aeroplane = flown(aircraft, 1000)
    by = {topic: np.array([s.values for s in sensed if s.topic == topic]) for topic in {s.topic for s in sensed}}
    assert {topic: len(rows) for topic, rows in by.items()} == {
        "imu/data": 1000, ATTITUDE_TOPIC: 1000, "air_data": 500, "control_surfaces": 500, "gps/fix": 50, "gps/vel": 50,
    }  # fmt: skip
    error = by["imu/data"] - readings[:, :6]
    assert error.mean(axis=0) == pytest.approx(aeroplane.sensors.biases[:6], abs=0.004)
    assert error[:, :3].std() == pytest.approx(0.03, rel=0.2) or error[:, 0].std() == pytest.approx(0.03, rel=0.1)
    assert (by["air_data"][:, 1] - readings[::2, 7]).std() == pytest.approx(0.003, rel=0.1)
    assert (by["control_surfaces"][:, 0] - readings[::2, 21]).std() == pytest.approx(0.0005, rel=0.1)
    position = ned_along(np.array(by["gps/fix"]), aeroplane.setup.origin)
    assert np.abs(position - readings[::20, Reading.POSITION]).max() < 6.0
    samples = samples_of_sensed(sensed)
    assert np.bincount(samples.kind)[int(Kind.ANGLE_OF_ATTACK)] == 500 and not np.any(np.diff(samples.stamp) < 0)
    again = samples_of_sensed(flown(aircraft, 1000)[1])
    assert np.array_equal(samples.values, again.values, equal_nan=True)


@pytest.mark.parametrize("name", DAMAGES)
def test_apparent_coefficients_move_the_aeroplane_as_the_damaged_one_moves(aircraft, name):
    damage = damage_of(aircraft, name)
    aeroplane = SteppedAeroplane(aircraft, 0, 1.0, damage=damage, change_time=0.0)
    apparent = airframe_of(replace(aircraft, coefficients=damage.apparent(aircraft)))
    rng = np.random.default_rng(2)
    for _ in range(20):
        sizes = np.repeat([0.0, 2.0, 0.1, 0.5, 0.1], [3, 3, 4, 3, 4])
        state = aeroplane.state + sizes * rng.standard_normal(STATE_SIZE)
        state[CONTROLS + 3] = 0.5
        state[6:10] /= np.linalg.norm(state[6:10])
        really, seen = (motion(a, aeroplane.setup.place, state, np.zeros(3), 0.0) for a in (aeroplane._after, apparent))
        assert really.angular_acceleration == pytest.approx(seen.angular_acceleration, rel=1e-9, abs=1e-9)
        assert really.specific_force == pytest.approx(seen.specific_force, rel=1e-12)


def test_damage_is_what_it_is_called(aircraft):
    before = aircraft.coefficients
    elevator, aileron, aft = (damage_of(aircraft, n).apparent(aircraft) for n in ("elevator", "aileron", "cg_aft"))
    assert elevator["Cm_de"] == 0.5 * before["Cm_de"] and elevator["Cm_alpha"] == before["Cm_alpha"]
    at_rest = aileron["Cl_0"] + aileron["Cl_da"] * TRAILING  # with both halves where the lost one is, all is as before
    assert at_rest == pytest.approx(before["Cl_0"] + before["Cl_da"] * TRAILING)
    assert aft["Cm_alpha"] == pytest.approx(before["Cm_alpha"] - 0.06 * before["CZ_alpha"])
    assert aft["Cm_alpha"] > before["Cm_alpha"]  # less stable
    with pytest.raises(InputError, match="unknown damage 'wing'"):
        damage_of(aircraft, "wing")


def test_damage_begins_at_its_time(aircraft):
    aeroplane = SteppedAeroplane(aircraft, 0, 1.0, damage=damage_of(aircraft, "elevator"), change_time=0.05)
    assert aeroplane.setup.airframe is aeroplane._before
    flags = []
    for _ in range(10):
        flags.append(aeroplane.is_changed)
        aeroplane.advance(aeroplane.setup.trim.controls)
    assert flags == [False] * 5 + [True] * 5


@pytest.mark.parametrize(
    ("sensor", "key", "value"),
    [("gps_velocity", "delay", 0.2), ("control_surfaces", "lag", 0.05), ("angle_of_attack", "scale", 1.1)],
)
def test_errors_of_sensors_that_are_not_simulated_are_refused(aircraft, sensor, key, value):
    """The estimators would allow for what is not there."""
    with pytest.raises(InputError, match=f"takes {sensor} as without error: .* {key} "):
        SteppedAeroplane(with_setting(aircraft, ("sensors", sensor, key), value), 0, 1.0)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_changes_what_it_is_called_from_its_time_on(aircraft, name):
    steps, time = 900, 3.0
    sound = flown(aircraft, steps)[1]
    faulty = flown(aircraft, steps, fault=fault_of(name, time, seed=1))[1]
    rows = lambda sensed, topic: {s.stamp: s.values for s in sensed if s.topic == topic}  # noqa: E731
    for topic in ("imu/data", "air_data", "control_surfaces", "gps/fix", "gps/vel", ATTITUDE_TOPIC):
        a, b = rows(sound, topic), rows(faulty, topic)
        begin = min(a) + round(time * 1e9)
        assert all(np.array_equal(a[t], b[t]) for t in a if t < begin)
        after = [t for t in a if t >= begin]
        if topic.startswith("gps/") and name == "gps_lost":
            assert not any(t in b for t in after)
            continue
        change = np.array([b[t] - a[t] for t in after])
        moved = set(np.flatnonzero(np.any(change != 0.0, axis=0)))
        expected = {"airspeed_blocked": {0}, "alpha_vane_stuck": {1}}.get(name, set()) if topic == "air_data" else set()
        assert moved == (set(range(6)) if topic == "imu/data" and name == "imu_bias_jump" else expected)
    if name == "airspeed_blocked":
        shown = rows(faulty, "air_data")
        stamps = sorted(shown)
        at_begin = shown[max(t for t in stamps if t < min(stamps) + round(time * 1e9))][0]
        assert shown[stamps[-1]][0] == pytest.approx(LEAKED * at_begin)
