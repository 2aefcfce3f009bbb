"""Recursive maximum likelihood: gradient and information of the exact likelihood, convergence, honest errors."""

import numpy as np
import pytest
from numba import njit

from aircraft_sysid_ros.estimation.recursive_maximum_likelihood import (
    add_score,
    close_block,
    coloured_covariance,
    innovation_rows,
    learn_rows,
    new_scores,
    scalar_innovation_rows,
)

Q, M = 4, 3
_RNG = np.random.default_rng(7)
_MEAN, _BASE, _TURN = _RNG.normal(size=(M, Q)), _RNG.normal(size=(M, M)), _RNG.normal(size=(Q, M, M))
THETA = np.array([0.3, -0.2, 0.5, 0.1])


def innovation(theta, y):
    """A smooth nonlinear model: e = y - h(theta)."""
    return y - np.sin(_MEAN @ theta)


def covariance(theta):
    """L(theta), all of it dependent on all of theta, with correlated outputs."""
    a = _BASE + np.tensordot(np.tanh(theta), _TURN, 1) * 0.4
    return a @ a.T + 0.5 * np.eye(M)


def derivative(function, theta, h=1e-6):
    """Central differences (q, ...) of an array-valued function."""
    steps = h * np.eye(len(theta))
    return np.array([(function(theta + s) - function(theta - s)) / (2.0 * h) for s in steps])


def cost(theta, y):
    """One term of (5.7)."""
    e, lam = innovation(theta, y), covariance(theta)
    return 0.5 * (e @ np.linalg.solve(lam, e) + np.linalg.slogdet(lam)[1])


def rows_at(theta, y):
    return innovation_rows(
        innovation(theta, y),
        covariance(theta),
        derivative(lambda t: innovation(t, y), theta),
        derivative(covariance, theta),
    )


@pytest.mark.long
def test_gradient_is_that_of_the_exact_likelihood():
    for y in np.random.default_rng(0).normal(size=(5, M)):
        rows, residuals = rows_at(THETA, y)
        expected = derivative(lambda t, y=y: cost(t, y), THETA, 1e-5)
        np.testing.assert_allclose(rows.T @ residuals, expected, rtol=1e-6, atol=1e-7)


def expected_cost(theta):
    """Mean of (5.7) over y from the model at THETA: its Hessian there is the Fisher information."""
    lam, mean = covariance(theta), innovation(theta, np.zeros(M)) - innovation(THETA, np.zeros(M))
    spread = covariance(THETA) + np.outer(mean, mean)
    return 0.5 * (np.trace(np.linalg.solve(lam, spread)) + np.linalg.slogdet(lam)[1])


@pytest.mark.long
def test_information_is_the_expected_hessian_and_the_printed_5_11_is_not():
    rows, _ = rows_at(THETA, np.zeros(M))
    hessian = derivative(lambda t: derivative(expected_cost, t, 1e-4), THETA, 1e-4)
    np.testing.assert_allclose(rows.T @ rows, hessian, rtol=1e-4, atol=1e-4)

    lam, d_lam = covariance(THETA), derivative(covariance, THETA)
    d_e = derivative(lambda t: innovation(t, np.zeros(M)), THETA)
    eta = np.array([np.trace(np.linalg.solve(lam, d)) for d in d_lam])
    printed = d_e @ np.linalg.solve(lam, d_e.T) + 0.5 * np.outer(eta, eta)
    assert np.abs(printed - hessian).max() > 0.1 * np.abs(hessian).max()


def test_one_output_is_the_special_case_and_there_the_printed_form_holds():
    e, lam, d_e, d_lam = 0.7, 2.3, np.array([0.4, 0.0, -1.0]), np.array([0.0, 1.1, 0.5])
    rows, residuals = np.empty((2, 3)), np.empty(2)
    scalar_innovation_rows(e, lam, d_e, d_lam, rows, residuals)
    general = innovation_rows(np.array([e]), np.array([[lam]]), d_e[:, None], d_lam[:, None, None])
    np.testing.assert_allclose(rows, general[0])
    np.testing.assert_allclose(residuals, general[1])
    printed = np.outer(d_e, d_e) / lam + 0.5 * np.outer(d_lam, d_lam) / lam**2
    np.testing.assert_allclose(rows.T @ rows, printed)


def sequential(theta, y):
    """Innovations and variances of the outputs taken one after the other: e = C D^-1 (...), L = C C'."""
    c = np.linalg.cholesky(covariance(theta))
    return np.diag(c) * np.linalg.solve(c, innovation(theta, y)), np.diag(c) ** 2


def test_outputs_taken_one_after_the_other_give_the_same_gradient():
    for y in np.random.default_rng(1).normal(size=(5, M)):
        e, variances = sequential(THETA, y)
        d_e = derivative(lambda t, y=y: sequential(t, y)[0], THETA)
        d_variances = derivative(lambda t, y=y: sequential(t, y)[1], THETA)
        rows, residuals = np.empty((2 * M, Q)), np.empty(2 * M)
        for k in range(M):
            pair = slice(2 * k, 2 * k + 2)
            scalar_innovation_rows(e[k], variances[k], d_e[:, k], d_variances[:, k], rows[pair], residuals[pair])
        whole, whole_residuals = rows_at(THETA, y)
        np.testing.assert_allclose(rows.T @ residuals, whole.T @ whole_residuals, rtol=1e-6, atol=1e-7)


def test_linear_regression_is_batch_least_squares_with_the_prior():
    """e = y - x' theta with a known variance: d e = -x, and the recursion is (4.10) to the last digits."""
    rng = np.random.default_rng(2)
    x, variance = rng.normal(size=(300, 3)), 0.4
    y = x @ [1.0, -2.0, 0.5] + np.sqrt(variance) * rng.normal(size=300)
    theta, root, rows, residuals = np.zeros(3), np.diag([1.0, 3.0, 2.0]), np.empty((2, 3)), np.empty(2)
    for xk, yk in zip(x, y, strict=True):
        scalar_innovation_rows(yk - xk @ theta, variance, -xk, np.zeros(3), rows, residuals)
        learn_rows(theta, root, rows, residuals, 1.0, np.full(3, np.inf))
    information = np.diag([1.0, 1.0 / 9.0, 0.25]) + x.T @ x / variance
    np.testing.assert_allclose(theta, np.linalg.solve(information, x.T @ y / variance), rtol=1e-9)
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(information), rtol=1e-9, atol=1e-13)


@njit(cache=True)
def filter_flight(noise, truth, start, forgetting, early, root, scores, block):
    """x(k+1) = a x(k) + w, y = x + v with theta = (a, ln q, ln r): Kalman filter with exact sensitivities."""
    theta, bound = start.copy(), np.array([0.05, 0.2, 0.2])
    x, state, p = 0.0, 0.0, 1.0
    d_state, d_p = np.zeros(3), np.zeros(3)
    rows, residuals = np.empty((2, 3)), np.empty(2)
    for k in range(len(noise)):
        x = truth[0] * x + np.exp(0.5 * truth[1]) * noise[k, 0]
        y = x + np.exp(0.5 * truth[2]) * noise[k, 1]
        a, q, r = theta[0], np.exp(theta[1]), np.exp(theta[2])
        d_state, d_p = a * d_state, a * a * d_p
        d_state[0] += state
        d_p[0] += 2.0 * a * p
        d_p[1] += q
        state, p = a * state, a * a * p + q
        lam = p + r
        d_lam = d_p.copy()
        d_lam[2] += r
        scalar_innovation_rows(y - state, lam, -d_state, d_lam, rows, residuals)
        gain, d_gain = p / lam, d_p / lam - p * d_lam / lam**2
        d_state += d_gain * (y - state) - gain * d_state
        state += gain * (y - state)
        d_p = d_p * (1.0 - gain) - d_gain * p
        p *= 1.0 - gain
        add_score(scores, rows, residuals)
        if (k + 1) % block == 0:
            close_block(scores, 1.0)
        learn_rows(theta, root, rows, residuals, forgetting if k > early else 0.99, bound)
        theta[0] = min(max(theta[0], -0.99), 0.99)
    return theta


@pytest.mark.long
def test_state_space_model_with_unknown_noise_levels_converges_with_honest_errors():
    """100 runs: no bias beyond 4 standard errors of the mean and 0.1 of one, 95 % intervals cover at least 88 %."""
    rng = np.random.default_rng(3)
    truth, start = np.array([0.9, np.log(0.5), np.log(1.0)]), np.array([0.5, np.log(2.0), np.log(0.3)])
    runs, errors, z = 100, [], []
    for _ in range(runs):
        root, scores = np.diag([0.5, 1.5, 1.5]), new_scores(3, 10)
        theta = filter_flight(rng.normal(size=(6000, 2)), truth, start, 1.0, 800, root, scores, 20)
        errors.append(theta - truth)
        z.append((theta - truth) / np.sqrt(np.diag(coloured_covariance(root, scores))))
    errors, z = np.array(errors), np.array(z)
    spread = errors.std(axis=0)
    assert np.all(np.abs(errors.mean(axis=0)) < 4.0 * spread / np.sqrt(runs) + 0.1 * spread)
    assert np.all(spread < [0.02, 0.15, 0.08])  # learnt, not held at the prior
    inside = np.mean(np.abs(z) < 1.96, axis=0)
    assert np.all(inside >= 0.88), inside
    assert np.all(z.std(axis=0) > 0.6)  # and not by standard errors that are far too large


@njit(cache=True)
def regression_flight(x, y, root, scores, block):
    theta, bound = np.zeros(2), np.full(2, np.inf)
    rows, residuals = np.empty((2, 2)), np.empty(2)
    for k in range(len(y)):
        e = y[k] - x[k] @ theta
        scalar_innovation_rows(e, 1.0, -x[k], np.zeros(2), rows, residuals)
        add_score(scores, rows, residuals)
        if (k + 1) % block == 0:
            close_block(scores, 1.0)
        learn_rows(theta, root, rows, residuals, 1.0, bound)
    return theta


def slow(rng, pole, size):
    """AR(1) series of unit variance."""
    out = np.empty(size)
    drive = rng.normal(size=size) * np.sqrt(1.0 - pole**2)
    out[0] = rng.normal()
    for k in range(1, size):
        out[k] = pole * out[k - 1] + drive[k]
    return out


@pytest.mark.long
def test_standard_errors_allow_for_coloured_innovations():
    """Errors and regressor that wander slowly: the plain interval covers little, the widened one what it says."""
    rng = np.random.default_rng(4)
    plain, widened = [], []
    for _ in range(100):
        x = np.column_stack([slow(rng, 0.95, 4000), rng.normal(size=4000)])
        y = x @ [1.0, 2.0] + slow(rng, 0.95, 4000)
        root, scores = 10.0 * np.eye(2), new_scores(2, 10)
        error = regression_flight(x, y, root, scores, 20) - [1.0, 2.0]
        plain.append(np.abs(error) < 1.96 * np.sqrt(np.diag(root @ root.T)))
        widened.append(np.abs(error) < 1.96 * np.sqrt(np.diag(coloured_covariance(root, scores))))
    assert np.mean(plain, axis=0)[0] < 0.6
    assert np.all(np.mean(widened, axis=0) > 0.87), np.mean(widened, axis=0)


@njit(cache=True)
def long_run(rows, residuals, root, forgetting, steps):
    theta, bound = np.zeros(rows.shape[1]), np.full(rows.shape[1], 1.0)
    for k in range(steps):
        i = k % len(rows)
        learn_rows(theta, root, rows[i : i + 1], residuals[i : i + 1], forgetting, bound)
    return theta


@pytest.mark.long
def test_covariance_stays_positive_and_bounded_over_a_million_steps():
    """Nearly collinear rows of very different size, one parameter never seen."""
    rng = np.random.default_rng(5)
    base = rng.normal(size=(997, 1))
    rows = np.hstack([1e3 * base, 1e3 * base + 1e-4 * rng.normal(size=(997, 1)), rng.normal(size=(997, 1)) * 1e-3])
    rows = np.hstack([rows, np.zeros((997, 1))])
    root = np.diag([1e3, 1e3, 10.0, 2.0])
    theta = long_run(rows, rng.normal(size=997), root, 0.999, 1_000_000)
    p = root @ root.T
    assert np.all(np.isfinite(theta)) and np.all(np.isfinite(p))
    assert np.linalg.eigvalsh(p / np.sqrt(np.outer(np.diag(p), np.diag(p)))).min() > 0.0
    assert np.all(np.diag(p)[:3] < [1e6, 1e6, 1e4])
    assert theta[3] == 0.0 and p[3, 3] == 4.0


def test_what_is_not_excited_is_held_while_the_rest_is_tracked():
    """The second parameter moves for 500 samples, then only noise is left of it; the first jumps later."""
    rng = np.random.default_rng(6)
    x = rng.normal(size=(20_500, 2))
    x[500:, 1] *= 1e-3
    level = np.where(np.arange(20_500) < 15_000, 1.0, 1.2)
    y = x[:, 0] * level + x[:, 1] * 2.0 + 0.1 * rng.normal(size=20_500)
    root = 10.0 * np.eye(2)
    rows, residuals, theta = -x / 0.1, y / 0.1, np.zeros(2)
    held, variance = np.nan, np.nan
    for k in range(len(y)):
        learn_rows(theta, root, rows[k : k + 1], residuals[k : k + 1] + rows[k] @ theta, 0.998, np.full(2, np.inf))
        if k == 500:
            held, variance = theta[1], (root @ root.T)[1, 1]
    after = (root @ root.T)[1, 1]
    assert after <= variance * (1.0 + 1e-9) and after > 0.1 * variance
    assert abs(theta[1] - held) < 3.0 * np.sqrt(variance)
    assert theta[0] == pytest.approx(1.2, abs=0.02)


def test_no_parameter_moves_further_than_its_bound():
    theta, root = np.zeros(3), np.diag([100.0, 100.0, 100.0])
    rows = np.array([[-1.0, -2.0, 0.0], [0.0, 0.0, -1.0]])
    learn_rows(theta, root, rows, np.array([50.0, 0.3]), 1.0, np.array([1.0, 30.0, 1.0]))
    np.testing.assert_allclose(theta, [1.0, 20.0, 0.3], rtol=1e-3)


@pytest.mark.parametrize("row", [[np.nan, 1.0], [np.inf, 1.0], [0.0, 0.0], [1e-200, 0.0]])
def test_row_that_says_nothing_changes_nothing(row):
    theta, root, scores = np.array([1.0, 2.0]), np.eye(2), new_scores(2, 3)
    before = root.copy()
    learn_rows(theta, root, np.array([row]), np.array([3.0]), 0.99, np.full(2, np.inf))
    assert np.array_equal(theta, [1.0, 2.0]) and np.array_equal(root, before)
    add_score(scores, np.array([row]), np.array([np.nan]))
    assert not scores.block.any() and not scores.information.any()


def test_covariance_that_is_not_positive_teaches_nothing():
    theta, root = np.zeros(2), np.eye(2)
    indefinite = np.array([[1.0, 2.0], [2.0, 1.0]])
    rows, residuals = innovation_rows(np.ones(2), indefinite, np.ones((2, 2)), np.ones((2, 2, 2)))
    learn_rows(theta, root, rows, residuals, 1.0, np.full(2, np.inf))
    pair, values = np.empty((2, 2)), np.empty(2)
    scalar_innovation_rows(1.0, 0.0, np.ones(2), np.ones(2), pair, values)
    learn_rows(theta, root, pair, values, 1.0, np.full(2, np.inf))
    assert np.array_equal(theta, [0.0, 0.0])
    assert np.all(np.isfinite(root)) and np.linalg.eigvalsh(root @ root.T).max() <= 1.0 + 1e-12


def test_without_scores_nothing_is_widened():
    root = np.array([[2.0, 0.0], [1.0, 3.0]])
    np.testing.assert_allclose(coloured_covariance(root, new_scores(2, 4)), root @ root.T)
