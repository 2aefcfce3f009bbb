"""Weighted least squares: the minimum of (4.5), its covariance, what is not determined, and convergence."""

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.least_squares import (
    central_differences,
    iterated_least_squares,
    parzen,
    weighted_least_squares,
)

TRUE = np.array([0.4, -4.5, -0.8])
W = np.array([[0.5, 0.2], [0.2, 2.0]])


def vector_problem(seed=0, count=60):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, 2, 3))
    w = W * rng.uniform(0.5, 2.0, count)[:, None, None]
    noise = np.stack([np.linalg.cholesky(wk) @ rng.normal(size=2) for wk in w])
    return rows, rows @ TRUE + noise, w


def test_it_is_the_minimum_of_the_weighted_cost_with_matrices_w():
    rows, y, w = vector_problem()
    fit = weighted_least_squares(rows, y, w)
    z = y - rows @ fit.estimate
    gradient = sum(h.T @ np.linalg.solve(wk, zk) for h, wk, zk in zip(rows, w, z, strict=True))
    np.testing.assert_allclose(gradient, 0.0, atol=1e-11)
    information = sum(h.T @ np.linalg.solve(wk, h) for h, wk in zip(rows, w, strict=True))
    np.testing.assert_allclose(fit.covariance @ information, np.eye(3), atol=1e-12)  # (4.7)
    np.testing.assert_allclose(fit.residuals, z, atol=1e-14)


def test_scalar_weights_are_matrices_on_the_diagonal_and_one_output_needs_no_axis():
    rows, y, _ = vector_problem()
    variances = np.random.default_rng(1).uniform(0.1, 3.0, y.shape)
    matrices = np.stack([np.diag(v) for v in variances])
    one, other = weighted_least_squares(rows, y, variances), weighted_least_squares(rows, y, matrices)
    np.testing.assert_allclose(one.estimate, other.estimate, rtol=1e-12)
    flat = weighted_least_squares(rows.reshape(-1, 3), y.ravel(), variances.ravel())
    np.testing.assert_allclose(flat.estimate, one.estimate, rtol=1e-12)


def test_nearly_dependent_columns_keep_the_digits_that_the_normal_equations_lose():
    t = np.linspace(0.0, 1.0, 200)
    rows = np.stack([np.ones_like(t), t, t + 1e-9 * t**2], axis=1)
    y = rows @ TRUE
    fit = weighted_least_squares(rows, y)
    assert fit.determined.all()
    np.testing.assert_allclose(rows @ fit.estimate, y, atol=1e-14)
    assert abs(fit.estimate[0] - TRUE[0]) < 1e-9 and abs(fit.estimate[1:].sum() - TRUE[1:].sum()) < 1e-8
    normal = np.linalg.eigvalsh(rows.T @ rows)
    assert normal[0] < 1e-15 * normal[-1]  # (4.6) as it is printed cannot tell this from collinear


def test_collinear_columns_are_named_and_the_others_hold_with_their_full_covariance():
    rng = np.random.default_rng(2)
    x = rng.normal(size=(100, 3))
    x[:, 2] += 0.8 * x[:, 0]
    rows = np.column_stack([x, -2.5 * x[:, 0], np.zeros(100)])
    y = x @ TRUE + 0.1 * rng.normal(size=100)
    fit, without = weighted_least_squares(rows, y, lags=4), weighted_least_squares(x, y, lags=4)
    np.testing.assert_array_equal(fit.determined, [False, True, True, False, False])
    np.testing.assert_allclose(fit.estimate[1:3], without.estimate[1:], rtol=1e-10)
    for name in ("covariance", "coloured_covariance"):
        part, whole = getattr(fit, name), getattr(without, name)
        np.testing.assert_allclose(part[1:3, 1:3], whole[1:, 1:], rtol=1e-8)
        assert np.isnan(part[0]).all() and np.isnan(part[:, 3:]).all()
    assert fit.variance == pytest.approx(without.variance)
    assert fit.estimate[4] == 0.0 and np.linalg.norm(fit.estimate[[0, 3]]) < abs(TRUE[0])  # minimum norm


def test_no_information_at_all_determines_nothing():
    fit = weighted_least_squares(np.zeros((5, 2)), np.ones(5))
    assert not fit.determined.any() and np.all(fit.estimate == 0.0) and np.isnan(fit.covariance).all()


def test_a_sample_that_is_not_complete_says_nothing():
    rows, y, w = vector_problem()
    y[7, 1], rows[9, 0, 2] = np.nan, np.inf
    keep = np.ones(len(y), bool)
    keep[[7, 9]] = False
    fit, clean = weighted_least_squares(rows, y, w), weighted_least_squares(rows[keep], y[keep], w[keep])
    np.testing.assert_allclose(fit.estimate, clean.estimate, rtol=1e-12)
    assert fit.variance == pytest.approx(clean.variance)


@pytest.mark.parametrize("w", [np.zeros(4), -np.ones(4), np.tile(np.array([[1.0, 2.0], [2.0, 1.0]]), (4, 1, 1))])
def test_weights_that_are_not_positive_are_refused(w):
    with pytest.raises(ValueError, match="positive"):
        weighted_least_squares(np.ones((4, 2, 1)), np.ones((4, 2)), w[:, None] if w.ndim == 1 else w)


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="do not fit"):
        weighted_least_squares(np.ones((4, 2)), np.ones(5))


@pytest.mark.long
def test_the_coloured_covariance_covers_where_4_7_is_too_small():
    """300 runs with residuals correlated over 20 samples and slow regressors: 95 % within 3 binomial sigma + 2 %."""
    rng = np.random.default_rng(3)
    t = np.arange(1500)
    rows = np.stack([np.ones(1500), np.sin(t / 60.0), np.cos(t / 37.0)], axis=1)
    inside, white = [], []
    for _ in range(300):
        e = np.convolve(rng.normal(size=1519), np.ones(20) / 20, mode="valid")
        fit = weighted_least_squares(rows, rows @ TRUE + e, lags=100)
        error = np.abs(fit.estimate - TRUE)
        inside.append(error < 1.96 * np.sqrt(np.diag(fit.coloured_covariance)))
        white.append(error < 1.96 * np.sqrt(np.diag(fit.covariance) * fit.variance))
        assert np.linalg.eigvalsh(fit.coloured_covariance)[0] > 0.0
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 300) + 0.02)
    assert np.all(np.mean(white, axis=0) < 0.6)


def test_the_lag_window_has_a_positive_spectrum():
    w = np.array([parzen(lag / 40) for lag in range(41)])
    assert w[0] == 1.0 and w[40] == 0.0
    spectrum = w[0] + 2.0 * np.cos(np.outer(np.linspace(0.0, np.pi, 2000), np.arange(1, 41))) @ w[1:]
    assert spectrum.min() > -1e-12


# -- nonlinear --------------------------------------------------------------------------------------------


def decay(p):
    return p[0] * np.exp(-p[1] * np.linspace(0.0, 3.0, 40)) + p[2]


@pytest.mark.long
def test_the_iteration_finds_the_minimum_and_its_covariance_covers():
    rng = np.random.default_rng(4)
    true, z = np.array([2.0, 1.3, 0.5]), []
    for _ in range(150):
        w = rng.uniform(0.5, 2.0, 40) * 1e-4
        y = decay(true) + np.sqrt(w) * rng.normal(size=40)
        fit = iterated_least_squares(decay, np.array([1.0, 0.5, 0.0]), y, w)
        assert fit.converged and np.all(np.diff(fit.costs) < 0.0) and len(fit.costs) == fit.iterations + 1
        z.append((fit.estimate - true) / np.sqrt(np.diag(fit.linear.covariance)))
    assert np.all(np.abs(np.std(z, axis=0) - 1.0) < 0.2) and np.all(np.abs(np.mean(z, axis=0)) < 0.3)


def test_without_noise_it_is_exact_and_one_linear_step_solves_a_linear_problem():
    true = np.array([2.0, 1.3, 0.0])
    fit = iterated_least_squares(decay, np.array([1.0, 0.5, 1.0]), decay(true))
    assert fit.converged
    np.testing.assert_allclose(fit.estimate, true, atol=1e-9)
    rows = np.random.default_rng(5).normal(size=(20, 3))
    linear = iterated_least_squares(lambda p: rows @ p, np.zeros(3), rows @ TRUE, jacobian=lambda p: rows)
    np.testing.assert_allclose(linear.estimate, TRUE, rtol=1e-12)
    assert linear.converged and linear.iterations <= 2


def test_where_gauss_newton_diverges_halved_steps_converge():
    """arctan from 10: the full step goes to -1.5e3 and away."""
    shifted = iterated_least_squares(lambda p: np.arctan(p - 1.0).repeat(3), np.array([11.0]), np.zeros(3))
    assert shifted.converged
    np.testing.assert_allclose(shifted.estimate, 1.0, atol=1e-6)
    full = 10.0 - np.arctan(10.0) * 101.0
    assert abs(full) > 100.0


def test_a_model_that_is_infinite_beyond_a_wall_is_not_entered_and_none_at_the_start_is_refused():
    def model(p):
        return np.sqrt(p[0] - 0.5) * np.array([1.0, 2.0])

    fit = iterated_least_squares(model, np.array([4.0]), model(np.array([0.6])))
    assert fit.converged
    np.testing.assert_allclose(fit.estimate, 0.6, atol=1e-6)
    with pytest.raises(ValueError, match="at the start"):
        iterated_least_squares(model, np.array([0.0]), np.ones(2))


def test_it_says_when_it_has_not_converged():
    fit = iterated_least_squares(decay, np.array([1.0, 0.5, 0.0]), decay(np.array([2.0, 1.3, 0.5])), most_iterations=1)
    assert not fit.converged and "1 iterations" in fit.reason


def test_parameters_without_effect_stay_where_they_were():
    true = np.array([2.0, 1.3, 0.5])
    fit = iterated_least_squares(lambda p: decay([p[0], *true[1:]]), np.array([1.0, 7.0]), decay(true))
    assert fit.converged and fit.estimate[1] == 7.0
    np.testing.assert_array_equal(fit.linear.determined, [True, False])


def test_central_differences_are_those_of_the_model():
    p = np.array([2.0, 1.3, 0.5])
    t = np.linspace(0.0, 3.0, 40)
    exact = np.stack([np.exp(-1.3 * t), -2.0 * t * np.exp(-1.3 * t), np.ones(40)], axis=1)
    np.testing.assert_allclose(central_differences(decay, p), exact, atol=1e-9)
