"""Discretisation against the printed series, quadrature, closed forms, and composition of steps."""

import numpy as np
import pytest
from scipy.integrate import quad_vec

from aircraft_sysid_ros.estimation.discretisation import (
    discretise,
    held_input,
    noise_covariance,
    transition_matrix,
)


def random_system(seed, n=4, m=2):
    rng = np.random.default_rng(seed)
    f = rng.normal(size=(n, n)) - 0.5 * np.eye(n)
    root = rng.normal(size=(m, m))
    return f, rng.normal(size=(n, 3)), rng.normal(size=(n, m)), root @ root.T


def series(f, dt, terms=40):
    """(3.9) as printed."""
    total, term = np.eye(len(f)), np.eye(len(f))
    for k in range(1, terms):
        term = term @ f * (dt / k)
        total = total + term
    return total


@pytest.mark.parametrize("dt", [0.0, 0.01, 0.3, 1.5])
def test_transition_is_the_series_and_the_rest_the_integrals(dt):
    f, b, g, q = random_system(1)
    discrete = discretise(f, b, g, q, dt)
    np.testing.assert_allclose(discrete.transition, series(f, dt), rtol=1e-10, atol=1e-12)
    psi, _ = quad_vec(lambda s: series(f, s) @ b, 0.0, dt, epsabs=1e-12)
    np.testing.assert_allclose(discrete.input_matrix, psi, rtol=1e-9, atol=1e-11)
    w, _ = quad_vec(lambda s: series(f, s) @ g @ q @ g.T @ series(f, s).T, 0.0, dt, epsabs=1e-12)
    np.testing.assert_allclose(discrete.noise, w, rtol=1e-9, atol=1e-11)
    np.testing.assert_array_equal(discrete.noise, discrete.noise.T)
    if dt:  # two outside noises reach all four states, which one factor of G would not
        assert np.linalg.eigvalsh(discrete.noise).min() > 0.0


def test_an_integrator_chain_has_the_closed_form():
    f, g, dt, q = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), 0.02, np.array([[3.0]])
    expected = 3.0 * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    np.testing.assert_allclose(noise_covariance(f, g, q, dt), expected, rtol=1e-13)
    np.testing.assert_allclose(held_input(f, g, dt), [[dt**2 / 2.0], [dt]], rtol=1e-13)


def test_two_steps_are_one():
    f, b, g, q = random_system(2)
    one, two = discretise(f, b, g, q, 0.4), discretise(f, b, g, q, 0.8)
    phi = one.transition
    np.testing.assert_allclose(two.transition, phi @ phi, rtol=1e-11)
    np.testing.assert_allclose(two.input_matrix, phi @ one.input_matrix + one.input_matrix, rtol=1e-11)
    np.testing.assert_allclose(two.noise, phi @ one.noise @ phi.T + one.noise, rtol=1e-11)


@pytest.mark.parametrize("dt", [1e-9, 1.0, 50.0, 1e4])
def test_fast_stable_and_slow_states_together(dt):
    """Rates of 100/s and 0.01/s: closed form a = q (1 - exp(-2 r t)) / 2r; Van Loan alone overflows at F dt = 5000."""
    rates = np.array([100.0, 0.01])
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    f = -turn @ np.diag(rates) @ turn.T
    q = np.diag([2.0, 5.0])
    expected = turn @ np.diag(np.diag(q) * -np.expm1(-2.0 * rates * dt) / (2.0 * rates)) @ turn.T
    np.testing.assert_allclose(noise_covariance(f, turn, q, dt), expected, rtol=1e-8, atol=1e-12 * expected.max())
    expected = turn @ np.diag(np.exp(-rates * dt)) @ turn.T
    np.testing.assert_allclose(transition_matrix(f, dt), expected, rtol=1e-9, atol=1e-12)
    expected = turn @ np.diag(-np.expm1(-rates * dt) / rates) @ turn.T
    np.testing.assert_allclose(held_input(f, np.eye(2), dt), expected, rtol=1e-8)


def test_the_printed_series_loses_all_digits_where_the_exponential_does_not():
    f = np.array([[-40.0, 3.0], [0.0, -41.0]])
    exact = np.array([[np.exp(-40.0), 3.0 * (np.exp(-40.0) - np.exp(-41.0))], [0.0, np.exp(-41.0)]])
    np.testing.assert_allclose(transition_matrix(f, 1.0), exact, rtol=1e-9)
    assert np.abs(series(f, 1.0, 200) - exact).max() > 1e6 * exact.max()


@pytest.mark.parametrize(("f", "dt"), [([[np.nan]], 0.1), ([[1.0]], -0.1), ([[1.0]], np.inf)])
def test_what_is_no_step_is_an_error(f, dt):
    for call in (lambda: transition_matrix(np.array(f), dt), lambda: held_input(np.array(f), np.eye(1), dt)):
        with pytest.raises(ValueError, match="must be finite"):
            call()
