"""Every Jacobian of the first step against central differences, at random states and near singular ones."""

from __future__ import annotations

import numpy as np
import pytest
from filter_setups import setup_of

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.frames import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_from_euler,
    quaternion_log,
    quaternion_product,
    rotation_matrix,
)
from aircraft_sysid_ros.reconstruction.error_state import retract
from aircraft_sysid_ros.reconstruction.measurements import residual_and_jacobian
from aircraft_sysid_ros.reconstruction.process import add_process_noise, propagate_state, transition_matrix
from aircraft_sysid_ros.reconstruction.state import ATTITUDE, ERROR_SIZE, STATE_SIZE, Setup
from aircraft_sysid_ros.reconstruction.state_row import wind_jacobian, wind_of
from aircraft_sysid_ros.records import replaced
from aircraft_sysid_ros.samples import GPS_NED, WIDTH, Kind

GRAVITY = 9.81
PITCHES = [0.1, -0.4, np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-7]


@pytest.fixture(scope="module")
def aircraft() -> Aircraft:
    return aircraft_from_dict(
        {
            "name": "test",
            "mass": 2.0,
            "wing_area": 0.3,
            "span": 1.3,
            "chord": 0.25,
            "inertia": {"xx": 0.07, "yy": 0.09, "zz": 0.15, "xz": 0.01},
            "imu_position": [0.1, 0.02, -0.03],
            "air_data_position": [0.3, 0.5, 0.1],
            "gps_position": [-0.3, 0.1, -0.2],
            "magnetic_declination": 0.05,
        }
    )


@pytest.fixture(scope="module")
def setup(aircraft: Aircraft) -> Setup:
    return setup_of(aircraft)


def random_state(seed: int, pitch: float) -> np.ndarray:
    random = np.random.default_rng(seed)
    x = random.normal(size=STATE_SIZE)
    x[0:3] *= 10.0
    x[3:6] *= 100.0
    x[ATTITUDE] = quaternion_from_euler(random.uniform(-3, 3), pitch, random.uniform(-3, 3))
    x[10:16] *= 0.1
    x[16:19] = [17.0, 1.5, 2.0] + random.normal(size=3)
    return x


def difference(after: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Error (18,) that takes ``before`` to ``after``."""
    turn = quaternion_log(quaternion_product(quaternion_conjugate(before[ATTITUDE]), after[ATTITUDE]))
    return np.concatenate([after[:6] - before[:6], turn, after[10:] - before[10:]])


def numerical(function, x: np.ndarray, step: float = 1e-6) -> np.ndarray:
    columns = []
    for i in range(ERROR_SIZE):
        delta = np.zeros(ERROR_SIZE)
        delta[i] = step
        columns.append((function(retract(x, delta)) - function(retract(x, -delta))) / (2.0 * step))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("pitch", PITCHES)
def test_transition_matrix_is_the_derivative_of_the_propagation(pitch: float) -> None:
    x, dt = random_state(1, pitch), 0.01
    force, rate = np.array([1.0, -2.0, -12.0]), np.array([1.5, -0.7, 0.4])

    def propagated(state: np.ndarray) -> np.ndarray:
        moved = state.copy()
        propagate_state(moved, force, rate, dt, GRAVITY)
        return difference(moved, end)

    end = x.copy()
    propagate_state(end, force, rate, dt, GRAVITY)
    expected = numerical(propagated, x)
    assert np.allclose(transition_matrix(x, force, rate, dt, GRAVITY), expected, rtol=0, atol=2e-5)


def test_transition_error_falls_with_the_square_of_the_step() -> None:
    """(3.9) is kept to second order: what is left must fall at least fourfold when the step is halved."""
    x = random_state(2, 0.3)
    force, rate = np.array([1.0, -2.0, -12.0]), np.array([2.5, -1.7, 0.9])

    def worst(dt: float) -> float:
        end = x.copy()
        propagate_state(end, force, rate, dt, GRAVITY)

        def propagated(state: np.ndarray) -> np.ndarray:
            moved = state.copy()
            propagate_state(moved, force, rate, dt, GRAVITY)
            return difference(moved, end)

        return float(np.abs(transition_matrix(x, force, rate, dt, GRAVITY) - numerical(propagated, x)).max())

    assert worst(0.1) < worst(0.2) / 3.5


def test_steady_wind_stays_in_propagation() -> None:
    x = random_state(3, 0.2)
    wind = wind_of(x)
    for _ in range(500):
        propagate_state(x, np.array([0.5, 0.3, -9.0]), np.array([0.8, 0.3, -0.5]), 0.01, GRAVITY)
    assert np.allclose(wind_of(x), wind, atol=1e-9)


def test_process_noise_is_what_noisy_inputs_do(setup: Setup) -> None:
    """Sample covariance of propagation with noisy IMU samples against the noise matrix."""
    x, dt = random_state(4, 0.1), 0.01
    force, rate = np.array([1.0, -2.0, -9.0]), np.array([0.5, -0.2, 0.3])
    quiet = replaced(setup, accelerometer_walk=0.0, gyro_walk=0.0, wind_walk=0.0)
    end = x.copy()
    propagate_state(end, force, rate, dt, GRAVITY)
    random = np.random.default_rng(0)
    errors, std = [], np.array([0.2, 0.1, 0.3, 0.05, 0.02, 0.04])  # of each axis another one
    for _ in range(20000):
        moved = x.copy()
        noisy_force, noisy_rate = force + std[:3] * random.normal(size=3), rate + std[3:] * random.normal(size=3)
        propagate_state(moved, noisy_force, noisy_rate, dt, GRAVITY)
        errors.append(difference(moved, end))
    sampled = np.cov(np.array(errors).T)
    expected = np.zeros((ERROR_SIZE, ERROR_SIZE))
    add_process_noise(expected, end, dt, std**2 * dt, 0.0, quiet)
    moving = [0, 1, 2, 6, 7, 8, 15, 16, 17]
    scale = np.sqrt(np.diag(expected)[moving])
    assert np.allclose(
        (sampled - expected)[np.ix_(moving, moving)] / np.outer(scale, scale), 0.0, atol=0.05
    )  # 7 sigma of 20 000 samples


@pytest.mark.parametrize("pitch", PITCHES)
@pytest.mark.parametrize(
    "kind",
    [
        Kind.ATTITUDE,
        Kind.MAGNETIC_FIELD,
        Kind.GPS_POSITION,
        Kind.GPS_VELOCITY,
        Kind.AIRSPEED,
        Kind.ANGLE_OF_ATTACK,
        Kind.SIDESLIP,
    ],
)
def test_measurement_jacobians(kind: Kind, pitch: float, setup: Setup) -> None:
    x, rate = random_state(int(kind), pitch), np.array([1.0, -0.5, 0.8])
    values = np.full(WIDTH, np.nan)
    if kind == Kind.ATTITUDE:
        values[:4] = quaternion_product(x[ATTITUDE], quaternion_exp(np.array([0.3, -0.8, 0.5])))
    elif kind == Kind.GPS_POSITION:
        values[GPS_NED] = [140.0, -90.0, -30.0]
    elif kind == Kind.MAGNETIC_FIELD:  # in the predicted direction, at which its Jacobian is taken
        north, east = np.cos(setup.declination), np.sin(setup.declination)
        values[:3] = rotation_matrix(x[ATTITUDE]).T @ [0.4 * north, 0.4 * east, 0.8]
    else:
        values[:3] = [0.3, 0.2, 0.4]
    h, scratch = np.empty((3, ERROR_SIZE)), np.empty((3, ERROR_SIZE))
    residual = np.empty(3)
    count = residual_and_jacobian(int(kind), values, x, rate, setup, residual, h)

    def predicted(state: np.ndarray) -> np.ndarray:
        out = np.empty(3)
        residual_and_jacobian(int(kind), values, state, rate, setup, out, scratch)
        return -out[:count].copy()

    assert count == (3 if kind in (Kind.ATTITUDE, Kind.GPS_POSITION, Kind.GPS_VELOCITY) else 1)
    assert np.allclose(h[:count], numerical(predicted, x), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("pitch", PITCHES)
def test_wind_jacobian(pitch: float) -> None:
    x = random_state(9, pitch)
    assert np.allclose(wind_jacobian(x), numerical(wind_of, x), atol=1e-5)
