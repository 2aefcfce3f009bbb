"""Laws of rigid-body mechanics, for (6.14)-(6.19) of docs/references.md and their inverses."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft import rigid_body
from aircraft_sysid_ros.aircraft.configuration import inertia_matrix
from aircraft_sysid_ros.aircraft.frames import quaternion_exp, quaternion_product, rotation_matrix

INERTIA = inertia_matrix(0.07, 0.09, 0.15, 0.014)
RNG = np.random.default_rng(1)
AREA, SPAN, CHORD, QBAR = 0.31, 1.27, 0.25, 170.0


def derivative(state):
    """d/dt of attitude (4) and rates (3) of a body without moments, (6.19)."""
    attitude, rates = state[:4], state[4:]
    turn = 0.5 * quaternion_product(attitude, np.array([0.0, *rates]))
    return np.concatenate([turn, rigid_body.angular_acceleration(np.zeros(3), rates, INERTIA)])


def spin(rates, step, seconds):
    """Attitudes and rates (n, 7) by the classical Runge-Kutta method."""
    history = [np.array([1.0, 0.0, 0.0, 0.0, *rates])]
    for _ in range(round(seconds / step)):
        state = history[-1]
        k1 = derivative(state)
        k2 = derivative(state + 0.5 * step * k1)
        k3 = derivative(state + 0.5 * step * k2)
        k4 = derivative(state + step * k3)
        history.append(state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
    return np.array(history)


def test_torque_free_motion_keeps_angular_momentum_and_energy():
    history = spin(np.array([1.0, 0.3, -2.0]), 1e-3, 5.0)
    momentum = np.array([rotation_matrix(x[:4]) @ INERTIA @ x[4:] for x in history])
    energy = np.array([x[4:] @ INERTIA @ x[4:] for x in history])
    assert np.ptp(history[:, 4:], axis=0).min() > 0.1  # it tumbles, so that the law says something
    np.testing.assert_allclose(energy, energy[0], rtol=1e-10)
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (len(momentum), 1)), atol=1e-10)


def test_a_body_that_spins_about_a_principal_axis_keeps_spinning():
    moments, axes = np.linalg.eigh(INERTIA)
    for axis in axes.T:
        np.testing.assert_allclose(rigid_body.angular_acceleration(np.zeros(3), 3.0 * axis, INERTIA), 0.0, atol=1e-12)
    assert np.ptp(moments) > 0.01


@pytest.mark.long
def test_moment_of_motion_is_the_inverse_of_angular_acceleration():
    for _ in range(20):
        moment, rates = RNG.normal(size=3), RNG.normal(size=3)
        acceleration = rigid_body.angular_acceleration(moment, rates, INERTIA)
        np.testing.assert_allclose(rigid_body.moment_of_motion(acceleration, rates, INERTIA), moment, rtol=1e-10)


def test_inertia_is_solved_as_by_a_general_solver():
    vector = RNG.normal(size=3)
    np.testing.assert_allclose(rigid_body.solve_inertia(INERTIA, vector), np.linalg.solve(INERTIA, vector), rtol=1e-12)


def test_coefficients_and_forces_are_inverses():
    coefficients = RNG.normal(size=6)
    force, moment = rigid_body.forces_and_moments(coefficients, QBAR, AREA, SPAN, CHORD)
    np.testing.assert_allclose(
        rigid_body.coefficients_of(force, moment, QBAR, AREA, SPAN, CHORD), coefficients, rtol=1e-14
    )


def test_moments_scale_with_span_and_chord():
    _, moment = rigid_body.forces_and_moments(np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]), QBAR, AREA, SPAN, CHORD)
    np.testing.assert_allclose(moment, QBAR * AREA * np.array([SPAN, CHORD, SPAN]))


@pytest.mark.parametrize("qbar", [0.0, -1.0])
def test_coefficients_without_dynamic_pressure_are_not_numbers(qbar):
    assert np.isnan(rigid_body.coefficients_of(np.ones(3), np.ones(3), qbar, AREA, SPAN, CHORD)).all()


def test_moment_moves_as_that_of_forces_at_points():
    reference = np.array([-0.02, 0.01, 0.05])
    points, forces = RNG.normal(size=(5, 3)), RNG.normal(size=(5, 3))  # about the centre of gravity
    about_cg = np.cross(points, forces).sum(axis=0)
    about_reference = np.cross(points - reference, forces).sum(axis=0)
    total = forces.sum(axis=0)
    np.testing.assert_allclose(
        rigid_body.moment_at_centre_of_gravity(about_reference, total, reference), about_cg, rtol=1e-12
    )
    np.testing.assert_allclose(rigid_body.moment_at_reference(about_cg, total, reference), about_reference, rtol=1e-12)


def test_body_velocity_derivative_is_that_of_the_world_seen_from_a_turning_body():
    attitude, rates = quaternion_exp(np.array([0.3, -0.4, 1.0])), np.array([0.5, -1.0, 0.8])
    velocity_n, force = np.array([15.0, -3.0, 2.0]), np.array([1.0, 0.5, -9.0])
    gravity_n = np.array([0.0, 0.0, 9.8])
    to_world = rotation_matrix(attitude)
    step = 1e-5

    def body_velocity(t):
        turned = quaternion_product(attitude, quaternion_exp(rates * t))
        return rotation_matrix(turned).T @ (velocity_n + t * (to_world @ force + gravity_n))

    expected = (body_velocity(step) - body_velocity(-step)) / (2.0 * step)
    actual = rigid_body.body_velocity_derivative(force, rates, to_world.T @ velocity_n, to_world.T @ gravity_n)
    np.testing.assert_allclose(actual, expected, atol=1e-6)
