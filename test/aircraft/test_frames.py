"""Laws of rotations: what any right implementation must satisfy, at the singular points and beside them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aircraft_sysid_ros.aircraft import frames

LAWS = settings(max_examples=200, deadline=None, derandomize=True)
ANGLE = st.floats(-np.pi, np.pi)
NUMBER = st.floats(-1.0, 1.0)


def unit(values):
    norm = np.linalg.norm(values)
    return np.array(values) / norm if norm > 1e-3 else np.array([1.0, 0.0, 0.0, 0.0])


QUATERNION = st.tuples(NUMBER, NUMBER, NUMBER, NUMBER).map(unit)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER).map(np.array)
SHORT_ROTATION = st.tuples(VECTOR, st.floats(0.0, 3.14)).map(lambda a: a[1] * a[0] / max(np.linalg.norm(a[0]), 1.0))


def assert_same_turn(a, b, tolerance):
    """Two quaternions of one attitude, which q and -q are."""
    np.testing.assert_allclose(a * np.sign(a @ b), b, atol=tolerance)


def printed_matrix(phi, theta, psi):
    """(6.23) as printed."""
    s, c = np.sin, np.cos
    return np.array(
        [
            [
                c(theta) * c(psi),
                s(phi) * s(theta) * c(psi) - c(phi) * s(psi),
                c(phi) * s(theta) * c(psi) + s(phi) * s(psi),
            ],
            [
                c(theta) * s(psi),
                s(phi) * s(theta) * s(psi) + c(phi) * c(psi),
                c(phi) * s(theta) * s(psi) - s(phi) * c(psi),
            ],
            [-s(theta), s(phi) * c(theta), c(phi) * c(theta)],
        ]
    )


@LAWS
@given(QUATERNION)
def test_a_rotation_matrix_is_orthonormal_and_right_handed(q):
    c = frames.rotation_matrix(q)
    np.testing.assert_allclose(c @ c.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(c) == pytest.approx(1.0, abs=1e-14)


@LAWS
@given(QUATERNION, QUATERNION)
def test_the_product_of_quaternions_is_the_product_of_their_matrices(a, b):
    product = frames.quaternion_product(a, b)
    np.testing.assert_allclose(
        frames.rotation_matrix(product), frames.rotation_matrix(a) @ frames.rotation_matrix(b), atol=1e-14
    )


@LAWS
@given(QUATERNION)
def test_a_turn_and_its_conjugate_are_no_turn(q):
    np.testing.assert_allclose(
        frames.quaternion_product(q, frames.quaternion_conjugate(q)), [1.0, 0.0, 0.0, 0.0], atol=1e-15
    )


@LAWS
@given(VECTOR, VECTOR)
def test_the_cross_matrix_multiplies_as_the_vector_product(v, w):
    np.testing.assert_allclose(frames.cross_matrix(v) @ w, np.cross(v, w), atol=1e-15)


@LAWS
@given(ANGLE, st.floats(-np.pi / 2, np.pi / 2), ANGLE)
def test_the_matrix_is_6_23_as_printed(roll, pitch, yaw):
    q = frames.quaternion_from_euler(roll, pitch, yaw)
    np.testing.assert_allclose(frames.rotation_matrix(q), printed_matrix(roll, pitch, yaw), atol=1e-15 * 4)


def test_a_nose_up_pitch_points_the_nose_up_and_a_right_roll_the_right_wing_down():
    up = frames.rotation_matrix(frames.quaternion_from_euler(0.0, 0.1, 0.0)) @ np.array([1.0, 0.0, 0.0])
    down = frames.rotation_matrix(frames.quaternion_from_euler(0.1, 0.0, 0.0)) @ np.array([0.0, 1.0, 0.0])
    east = frames.rotation_matrix(frames.quaternion_from_euler(0.0, 0.0, np.pi / 2)) @ np.array([1.0, 0.0, 0.0])
    assert up[2] == pytest.approx(-np.sin(0.1)) and down[2] == pytest.approx(np.sin(0.1))
    np.testing.assert_allclose(east, [0.0, 1.0, 0.0], atol=1e-15)


@LAWS
@given(QUATERNION)
def test_a_quaternion_comes_back_from_its_matrix(q):
    assert_same_turn(frames.quaternion_from_matrix(frames.rotation_matrix(q)), q, 1e-14)


@pytest.mark.parametrize("axis", range(3))
def test_half_turns_come_back_from_their_matrices(axis):
    q = np.zeros(4)
    q[1 + axis] = 1.0
    assert_same_turn(frames.quaternion_from_matrix(frames.rotation_matrix(q)), q, 1e-15)


@LAWS
@given(SHORT_ROTATION)
def test_log_is_the_inverse_of_exp(v):
    np.testing.assert_allclose(frames.quaternion_log(frames.quaternion_exp(v)), v, atol=1e-14)


@LAWS
@given(QUATERNION)
def test_exp_is_the_inverse_of_log_and_the_shorter_way_round(q):
    v = frames.quaternion_log(q)
    assert np.linalg.norm(v) <= np.pi + 1e-15
    assert_same_turn(frames.quaternion_exp(v), q, 1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 0.99e-5, 1.01e-5, 1e-3])
def test_exp_and_log_are_exact_at_and_beside_zero(angle):
    v = angle * np.array([0.6, 0.0, -0.8])
    q = frames.quaternion_exp(v)
    assert q @ q == pytest.approx(1.0, abs=4e-16)
    np.testing.assert_allclose(q[1:], 0.5 * v * np.sinc(angle / (2.0 * np.pi)), rtol=4e-16, atol=0.0)
    np.testing.assert_allclose(frames.quaternion_log(q), v, rtol=1e-11, atol=0.0)


def test_exp_of_zero_is_no_turn():
    assert frames.quaternion_exp(np.zeros(3)).tolist() == [1.0, 0.0, 0.0, 0.0]
    assert frames.quaternion_log(np.array([1.0, 0.0, 0.0, 0.0])).tolist() == [0.0, 0.0, 0.0]
    assert frames.quaternion_log(np.array([-1.0, 0.0, 0.0, 0.0])).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("angle", [0.0, 1e-7, 0.99e-4, 1.01e-4, 0.3, 2.0, np.pi - 1e-6, np.pi - 1e-3])
def test_right_jacobian_against_finite_differences(angle):
    v = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    step = 1e-5
    columns = []
    for d in step * np.eye(3):
        ahead = frames.quaternion_product(
            frames.quaternion_conjugate(frames.quaternion_exp(v)), frames.quaternion_exp(v + d)
        )
        behind = frames.quaternion_product(
            frames.quaternion_conjugate(frames.quaternion_exp(v)), frames.quaternion_exp(v - d)
        )
        columns.append((frames.quaternion_log(ahead) - frames.quaternion_log(behind)) / (2.0 * step))
    # Central differences: truncation step^2, rounding 1e-16 / step.
    np.testing.assert_allclose(frames.right_jacobian(v), np.array(columns).T, atol=1e-10)


@LAWS
@given(ANGLE, st.floats(-1.57, 1.57), ANGLE)
def test_euler_angles_come_back(roll, pitch, yaw):
    back = frames.euler_from_quaternion(frames.quaternion_from_euler(roll, pitch, yaw))
    difference = back - np.array([roll, pitch, yaw])
    difference[[0, 2]] = np.angle(np.exp(1j * difference[[0, 2]]))
    # The angles lose as many digits as cos(pitch) is small: 8e-4 at 1.57.
    np.testing.assert_allclose(difference, 0.0, atol=1e-15 * 10 / np.cos(pitch))


@LAWS
@given(QUATERNION)
def test_euler_angles_are_in_their_ranges_and_rebuild_the_rotation(q):
    roll, pitch, yaw = frames.euler_from_quaternion(q)
    assert abs(roll) <= np.pi and abs(pitch) <= np.pi / 2 and abs(yaw) <= np.pi
    rebuilt = frames.rotation_matrix(frames.quaternion_from_euler(roll, pitch, yaw))
    # Within 1.4e-6 rad of the vertical roll is set to 0, which is wrong by no more than that.
    np.testing.assert_allclose(rebuilt, frames.rotation_matrix(q), atol=3e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("beside", [0.0, 1e-9, 1e-6, 1.3e-6, 1.5e-6, 1e-5, 1e-3])
@pytest.mark.parametrize(("roll", "yaw"), [(0.0, 0.0), (0.7, -2.0), (-2.5, 3.0), (3.1, -3.1), (-3.0, 0.1)])
def test_euler_angles_rebuild_the_rotation_at_and_beside_the_vertical(sign, beside, roll, yaw):
    q = frames.quaternion_from_euler(roll, sign * (np.pi / 2 - beside), yaw)
    for attitude in (q, -q):
        angles = frames.euler_from_quaternion(attitude)
        assert abs(angles[2]) <= np.pi
        rebuilt = frames.rotation_matrix(frames.quaternion_from_euler(*angles))
        exact = beside == 0.0 or beside > 1.45e-6
        np.testing.assert_allclose(rebuilt, frames.rotation_matrix(q), atol=1e-9 if exact else 2.0 * beside + 1e-9)


def euler_rates(roll, pitch, rates):
    """(6.20)-(6.22) as printed."""
    p, q, r = rates
    return np.array(
        [
            p + q * np.sin(roll) * np.tan(pitch) + r * np.cos(roll) * np.tan(pitch),
            q * np.cos(roll) - r * np.sin(roll),
            (q * np.sin(roll) + r * np.cos(roll)) / np.cos(pitch),
        ]
    )


@LAWS
@given(st.floats(-3.0, 3.0), st.floats(-1.3, 1.3), st.floats(-3.0, 3.0), VECTOR)
def test_quaternion_kinematics_give_the_euler_rates_of_6_20_to_6_22(roll, pitch, yaw, rates):
    q, step = frames.quaternion_from_euler(roll, pitch, yaw), 1e-5
    ahead = frames.euler_from_quaternion(frames.quaternion_product(q, frames.quaternion_exp(step * rates)))
    behind = frames.euler_from_quaternion(frames.quaternion_product(q, frames.quaternion_exp(-step * rates)))
    measured = (ahead - behind) / (2.0 * step)
    np.testing.assert_allclose(measured, euler_rates(roll, pitch, rates), atol=1e-7)


@LAWS
@given(st.floats(0.1, 100.0), st.floats(-3.1, 3.1), st.floats(-1.5, 1.5))
def test_air_data_and_air_velocity_are_inverses(speed, alpha, beta):
    velocity = frames.velocity_from_air_data(speed, alpha, beta)
    np.testing.assert_allclose(frames.air_data_from_velocity(velocity), (speed, alpha, beta), rtol=1e-12, atol=1e-12)


def test_air_data_signs_and_rest():
    speed, alpha, beta = frames.air_data_from_velocity(np.array([20.0, 1.0, 2.0]))
    assert speed == pytest.approx(np.sqrt(405.0))
    assert alpha == pytest.approx(np.arctan(0.1)) and beta > 0.0  # nose up, and wind from the right
    assert frames.air_data_from_velocity(np.zeros(3)) == (0.0, 0.0, 0.0)
