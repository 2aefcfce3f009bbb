"""Errors of the air data as states: derivatives, what is known at the start, and flights with wrong sensors."""

from dataclasses import replace

import numpy as np
import pytest
from filter_setups import setup_of
from test_jacobians import aircraft, random_state, setup  # noqa: F401

from aircraft_sysid_ros.after_flight.replay_notes import air_data_error_notes
from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.aircraft.frames import air_data_from_velocity, rotation_matrix, velocity_from_air_data
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.reconstruction.air_data_errors import (
    COUNT,
    NAMES,
    StartValues,
    extended,
    settle,
    with_start,
    without_errors,
)
from aircraft_sysid_ros.reconstruction.error_state import retract
from aircraft_sysid_ros.reconstruction.fusion import fuse
from aircraft_sysid_ros.reconstruction.measurements import residual_and_jacobian
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state import (
    AIR_VELOCITY,
    ATTITUDE,
    ERROR_SIZE,
    STATE_SIZE,
    StateField,
    new_memory,
)
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.reconstruction.state_row import wind_jacobian, wind_of
from aircraft_sysid_ros.records import replaced
from aircraft_sysid_ros.samples import WIDTH, Kind
from aircraft_sysid_ros.sensors.instrument_errors import OutputErrors
from aircraft_sysid_ros.simulation.calibration_flight import calibration_flight, drawn_errors

ERRORS = np.array([0.2, -1.0, -0.1, 0.03, 0.15, -0.02])
AIR_DATA = (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
WITH_ERRORS = StateOptions(air_data_errors=True)


@pytest.mark.parametrize("kind", [*AIR_DATA, Kind.GPS_VELOCITY])
def test_rows_are_derivatives(kind, setup):  # noqa: F811
    x = np.concatenate([random_state(3, 0.2), ERRORS])
    values, rate = np.zeros(WIDTH), np.array([0.3, -0.2, 0.4])
    residual, h = np.empty(3), np.empty((3, ERROR_SIZE + COUNT))

    def residual_at(delta):
        count = residual_and_jacobian(int(kind), values, retract(x, delta), rate, setup, residual, h)
        return residual[:count].copy()

    steps = 1e-6 * np.eye(ERROR_SIZE + COUNT)
    expected = np.stack([(residual_at(-s) - residual_at(s)) / 2e-6 for s in steps], axis=1)
    count = len(residual_at(np.zeros(len(steps))))
    np.testing.assert_allclose(h[:count], expected, atol=2e-6)


def test_the_sensor_shows_what_its_correction_undoes(setup):  # noqa: F811
    """(36) of the two-stage paper, of what h(x) shows is the flow without errors."""
    x, rate = random_state(4, 0.1), np.zeros(3)
    for kind in AIR_DATA:
        plain, shown = np.empty(3), np.empty(3)
        values, h = np.zeros(WIDTH), np.empty((3, ERROR_SIZE + COUNT))
        residual_and_jacobian(int(kind), values, x, rate, setup, plain, h[:, :ERROR_SIZE].copy())
        residual_and_jacobian(int(kind), values, np.concatenate([x, ERRORS]), rate, setup, shown, h)
        seen = np.full(WIDTH, -shown[0])
        assert without_errors(int(kind), seen, ERRORS)[0] == pytest.approx(-plain[0], abs=1e-12)
    assert without_errors(int(Kind.IMU), values, ERRORS) is values


def test_the_air_velocity_of_a_start_moves_with_the_errors():
    """Covariance of u and of the errors, by differences of what u is made of."""
    flow = np.array([20.0, 0.1, -0.05])
    covariance = np.diag([0.04, 1.0, 0.01, 0.002, 0.02, 0.001])
    raw = (flow - ERRORS[1::2]) / (1.0 + ERRORS[0::2])
    of = lambda e: velocity_from_air_data(*((1.0 + e[0::2]) * raw + e[1::2]))  # noqa: E731
    moves = np.stack([(of(ERRORS + d) - of(ERRORS - d)) / 2e-6 for d in 1e-6 * np.eye(COUNT)], axis=1)
    x, p = extended(np.zeros(STATE_SIZE), np.eye(ERROR_SIZE), ERRORS, covariance, flow)
    np.testing.assert_allclose(p[15:18, 15:18], np.eye(3) + moves @ covariance @ moves.T, atol=1e-6)
    np.testing.assert_allclose(p[15:18, ERROR_SIZE:], moves @ covariance, atol=1e-7)
    np.testing.assert_allclose(p[ERROR_SIZE:, ERROR_SIZE:], covariance)
    _, without_vane = extended(x[:STATE_SIZE], np.eye(ERROR_SIZE), ERRORS, covariance, np.array([20.0, np.nan, np.nan]))
    assert np.all(without_vane[15:18, ERROR_SIZE + 2 :] == 0.0)
    _, apart = extended(x[:STATE_SIZE], np.eye(ERROR_SIZE), ERRORS, covariance, None)
    assert np.all(apart[:ERROR_SIZE, ERROR_SIZE:] == 0.0)


def test_a_start_in_flight_is_the_wind_and_the_errors_with_their_covariance():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(9, 9))
    start = StartValues(np.array([5.0, -6.0, 0.5]), ERRORS, root @ root.T)
    half = rng.normal(size=(ERROR_SIZE + COUNT,) * 2)
    x = np.concatenate([random_state(5, 0.3), np.zeros(COUNT)])
    before = half @ half.T
    x, p = with_start(x, before, rotation_matrix(x[ATTITUDE]), start)
    np.testing.assert_allclose(wind_of(x), start.wind, atol=1e-12)
    np.testing.assert_array_equal(x[STATE_SIZE:], ERRORS)
    jacobian = np.zeros((9, ERROR_SIZE + COUNT))
    jacobian[:3, :ERROR_SIZE], jacobian[3:, ERROR_SIZE:] = wind_jacobian(x), np.eye(COUNT)
    np.testing.assert_allclose(jacobian @ p @ jacobian.T, start.covariance, atol=1e-9)
    np.testing.assert_allclose(p[:15, :15], before[:15, :15], atol=1e-9)
    assert np.linalg.eigvalsh(p)[0] > -1e-9


@pytest.fixture(scope="module")
def wrong():
    """A flight whose airspeed is wrong by a scale of 20 % and alpha by 3 deg, in 8 m/s of wind."""
    errors = replace(
        drawn_errors(1),
        outputs=OutputErrors({"V": 0.25}, {"V": -0.5, "alpha": 0.05, "beta": -0.03}),
    )
    flight = calibration_flight(7, 130.0, wind=np.array([-5.0, 6.2, 0.2]), errors=errors)
    return without_magnetometer(flight)


def without_magnetometer(flight):
    """It is wrong, too: it carries hard iron."""
    return replace(flight, streams=[s for s in flight.streams if "mag" not in s.topic])


def flown(flight, options=None, start=None, until=None):
    estimator = StateEstimator(flight.aircraft, options)
    if start is not None:
        estimator.take_start(start)
    samples = flight.samples if until is None else flight.samples[:until]
    return estimator, np.vstack([estimator.push(samples), estimator.flush()])


def test_states_that_are_known_change_nothing():
    """With a variance of 1e-300 the larger filter gives the numbers of the smaller one, which iterates a little."""
    known = StartValues(covariance=np.diag([36.0, 36.0, 1.0, *[1e-300] * COUNT]))
    right = calibration_flight(7, 40.0, errors=replace(drawn_errors(1), outputs=OutputErrors({}, {})))
    right = without_magnetometer(right)
    _, plain = flown(right, until=12000)
    _, more = flown(right, WITH_ERRORS, known, until=12000)
    assert len(plain) > 1000
    apart = np.abs(plain - more)[:, StateField.AIR_VELOCITY.start : StateField.WIND.stop]
    assert np.max(apart) < 0.02 and np.max(apart[-1]) < 1e-3
    np.testing.assert_allclose(
        more[:, StateField.STANDARD_DEVIATIONS], plain[:, StateField.STANDARD_DEVIATIONS], rtol=0.01
    )


def test_an_update_is_one_of_what_the_sensors_show():
    """Air velocity and covariance by hand through V, alpha, beta as shown, whose derivatives are differences."""
    rng = np.random.default_rng(2)
    half = rng.normal(size=(ERROR_SIZE + COUNT,) * 2)
    x = np.concatenate([random_state(6, 0.1), ERRORS])
    delta = 0.01 * rng.normal(size=ERROR_SIZE + COUNT)
    delta[15:18] *= 30.0
    of = lambda s, e: velocity_from_air_data(*((1.0 + e[0::2]) * s + e[1::2]))  # noqa: E731

    def frame(s, e):
        steps = 1e-6 * np.eye(9)
        moved = [(of(s + d[:3], e + d[3:]) - of(s - d[:3], e - d[3:])) / 2e-6 for d in steps]
        return np.block([[np.stack(moved, axis=1)], [np.zeros((COUNT, 3)), np.eye(COUNT)]])

    v = x[AIR_VELOCITY]
    true = np.array(air_data_from_velocity(v))
    shown = (true - ERRORS[1::2]) / (1.0 + ERRORS[0::2])
    before = frame(shown, ERRORS)
    step = np.linalg.solve(before, delta[15:])
    after = frame(shown + step[:3], ERRORS + step[3:])
    p, moved = half @ half.T, retract(x, delta)
    turn = np.eye(len(p))
    turn[15:, 15:] = after @ np.linalg.inv(before)
    expected = turn @ p @ turn.T
    settle(tuple(v), x, delta, moved, p)
    np.testing.assert_allclose(moved[AIR_VELOCITY], of(shown + step[:3], ERRORS + step[3:]), atol=1e-6)
    np.testing.assert_allclose(p, expected, atol=1e-4 * np.max(np.abs(expected)))
    still, kept = x.copy(), p.copy()
    settle((0.1, 0.0, 0.0), x, delta, still, kept)  # on the ground angles mean nothing
    np.testing.assert_array_equal(still, x)
    np.testing.assert_array_equal(kept, p)


def test_straight_flight_tells_nothing_of_the_scale():
    """Noise of the airspeed alone must not: without ``settle`` lambda_V is known to 0.02 after these 5 s, wrongly."""
    x = np.concatenate([np.zeros(STATE_SIZE), np.zeros(COUNT)])
    x[ATTITUDE.start], x[AIR_VELOCITY.start] = 1.0, 20.0
    x, p = extended(x[:STATE_SIZE], np.diag(np.repeat([1.0, 1.0, 0.01, 0.01, 1e-4, 4.0], 3)), np.zeros(COUNT),
                    np.diag([0.04, 1e-12, *[1e-12] * 4]), np.array([20.0, 0.0, 0.0]))  # fmt: skip
    rng, values, memory = np.random.default_rng(3), np.zeros(WIDTH), new_memory(len(Kind), 0.1)
    made = replaced(setup_of(load_aircraft(config_path(DEFAULT_AIRCRAFT))), probe_from_imu=0.0)
    for _ in range(250):
        p[15:18, 15:18] += 0.02 * np.eye(3)  # what a wind that walks adds
        values[0] = 20.0 + rng.normal(0.0, 0.3)
        fuse(int(Kind.AIRSPEED), values, x, p, np.zeros(3), 0.0, made, memory)
    assert np.sqrt(p[ERROR_SIZE, ERROR_SIZE]) > 0.19 and abs(x[STATE_SIZE]) < 0.02


@pytest.mark.long
def test_a_wrong_scale_is_found_in_the_wind(wrong):
    """y = 1.25 V - 0.5 is (36) with lambda = 1/1.25 - 1 = -0.2, b = 0.4; the vanes' offsets change their signs."""
    estimator, rows = flown(wrong, WITH_ERRORS)
    found, truth = estimator.air_data_errors, dict.fromkeys(NAMES, 0.0)
    truth |= {"lambda_V": -0.2, "b_V": 0.4, "b_alpha": -0.05, "b_beta": 0.03}
    assert set(found) == set(NAMES) == set(estimator.summary()["air_data_errors"])
    for name, value in truth.items():
        assert abs(found[name]["value"] - value) < 4.0 * found[name]["std"], (name, found[name])
    assert abs(found["lambda_V"]["value"] + 0.2) < 0.02 and found["lambda_V"]["std"] < 0.02
    assert np.linalg.norm(rows[-1, StateField.WIND][:2] - [-5.0, 6.2]) < 0.5
    _, plain = flown(wrong)
    assert np.linalg.norm(plain[-1, StateField.WIND][:2] - [-5.0, 6.2]) > 1.0


@pytest.mark.long
def test_errors_outlast_a_gap(wrong):
    """The IMU is silent for 2 s: aligned anew, the scale is as before, and still known."""
    samples = wrong.samples
    time = (samples.stamp - samples.stamp[0]) * 1e-9
    estimator = StateEstimator(wrong.aircraft, WITH_ERRORS)
    estimator.push(samples[time < 90.0])
    before = estimator.air_data_errors["lambda_V"]
    estimator.push(samples[(time > 92.0) & (time < 96.0)])
    after = estimator.air_data_errors["lambda_V"]
    assert estimator.realignments == 1
    assert abs(after["value"] - before["value"]) < 3.0 * before["std"] and after["std"] <= 1.01 * before["std"]


def test_without_the_option_there_are_none(wrong):
    estimator, _ = flown(wrong, until=4000)
    assert estimator.air_data_errors == {} and "air_data_errors" not in estimator.summary()


def test_an_error_that_no_sensor_has_is_not_to_be_believed(aircraft):  # noqa: F811
    """Gusts had been taken for a scale of the angle of attack of 1.86 ± 0.03, and nothing was said."""
    assert air_data_error_notes(StateEstimator(aircraft)) == []
    estimator = StateEstimator(aircraft, WITH_ERRORS)
    estimator._x = np.concatenate([random_state(5, 0.1), ERRORS])
    estimator._p = 0.03**2 * np.eye(ERROR_SIZE + COUNT)
    assert len(air_data_error_notes(estimator)) == 1
    estimator._x[STATE_SIZE + NAMES.index("lambda_alpha")] = 0.86
    told = air_data_error_notes(estimator)[1]
    assert told.startswith("lambda_alpha = 0.860 ± 0.030 ") and "do not use" in told
