"""(5.4)-(5.13) on a linear system whose likelihood is known, against differences and Monte Carlo."""

import numpy as np
import pytest
from numba import njit

from aircraft_sysid_ros.estimation.maximum_likelihood import (
    Expansion,
    covariance_of,
    fisher_information,
    minimise,
    negative_log_likelihood,
    newton_expansion,
    newton_step,
    sandwich_covariance,
    score,
)

TRUE = np.array([0.8, 0.5, np.log(0.3), np.log(0.2)])  # pole, input, levels of process and output noise
STEPS = np.full(4, 1e-5)
N = 120
H = np.array([[1.0], [-0.5]])
OUTER = H @ H.T
INPUT = np.where(np.arange(N) // 10 % 2, 1.0, -1.0)


def simulate(runs, seed):
    """Outputs (runs, N, 2) of x(k+1) = a x(k) + b u(k) + w, y = H x + v."""
    random = np.random.default_rng(seed)
    a, b, q, r = TRUE[0], TRUE[1], np.exp(TRUE[2]), np.exp(TRUE[3])
    x, y = random.normal(size=runs), np.empty((runs, N, 2))
    for k in range(N):
        y[:, k] = x[:, None] * H[:, 0] + r * random.normal(size=(runs, 2))
        x = a * x + b * INPUT[k] + q * random.normal(size=runs)
    return y


@njit(cache=True)
def innovations(theta, y):
    """Kalman filter over many runs at once: innovations (runs, N, 2) and their covariance (N, 2, 2)."""
    a, b, q, r = theta[0], theta[1], np.exp(theta[2]), np.exp(theta[3])
    x, p = np.zeros(len(y)), 1.0
    e, covariance = np.empty(y.shape), np.empty((N, 2, 2))
    for k in range(N):
        covariance[k] = OUTER * p + r * r * np.eye(2)
        for m in range(len(y)):
            e[m, k] = y[m, k] - x[m] * H[:, 0]
        s = covariance[k]
        determinant = s[0, 0] * s[1, 1] - s[0, 1] * s[1, 0]
        first, second = s[1, 1] * H[0, 0] - s[0, 1] * H[1, 0], s[0, 0] * H[1, 0] - s[1, 0] * H[0, 0]
        gain = p / determinant * np.array([first, second])
        for m in range(len(y)):
            x[m] += e[m, k, 0] * gain[0] + e[m, k, 1] * gain[1]
        p -= p * (gain[0] * H[0, 0] + gain[1] * H[1, 0])
        x, p = a * x + b * INPUT[k], a * a * p + q * q
    return e, covariance


def derivatives(theta, y):
    """Central differences: (n, runs, N, 2) and (n, N, 2, 2)."""
    by_e, by_s = [], []
    for i, step in enumerate(STEPS):
        up, down = theta.copy(), theta.copy()
        up[i] += step
        down[i] -= step
        (e1, s1), (e0, s0) = innovations(up, y), innovations(down, y)
        by_e.append((e1 - e0) / (2.0 * step))
        by_s.append((s1 - s0) / (2.0 * step))
    return np.array(by_e), np.array(by_s)


def cost_of(y):
    def cost(theta):
        e, s = innovations(theta, y[None])
        return negative_log_likelihood(e[0], s)

    return cost


def gradient_of(y):
    def gradient(theta):
        e, s = innovations(theta, y[None])
        by_e, by_s = derivatives(theta, y[None])
        return score(e[0], s, by_e[:, 0], by_s).sum(axis=0)

    return gradient


def gauss_newton(y):
    def expand(theta):
        e, s = innovations(theta, y[None])
        by_e, by_s = derivatives(theta, y[None])
        terms = score(e[0], s, by_e[:, 0], by_s)
        return Expansion(negative_log_likelihood(e[0], s), terms.sum(axis=0), fisher_information(s, by_e[:, 0], by_s))

    return expand


@pytest.mark.long
def test_the_density_of_54_has_two_pi_to_the_number_of_outputs():
    """Its integral is one. With the printed exponent, the number of parameters, it would be (2 pi)^-1 here."""
    axis = np.linspace(-8.0, 8.0, 161)
    e = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    covariance = np.array([[1.0, 0.6], [0.6, 2.0]])
    v = [negative_log_likelihood(one[None], covariance[None], constant=True) for one in e[::1]]
    assert np.sum(np.exp(-np.array(v))) * (axis[1] - axis[0]) ** 2 == pytest.approx(1.0, rel=1e-4)


@pytest.mark.long
def test_cost_and_gradient_against_differences():
    y, theta = simulate(1, 1)[0], TRUE + [0.05, -0.1, 0.2, -0.1]
    cost = cost_of(y)
    expected = [(cost(theta + d) - cost(theta - d)) / 2e-5 for d in 1e-5 * np.eye(4)]
    np.testing.assert_allclose(gradient_of(y)(theta), expected, rtol=1e-5)


@pytest.mark.long
def test_one_output_after_the_other_is_the_same_cost_and_gradient():
    """Decorrelated innovations and their variances as arrays (N, q): V and its gradient are those of the vector."""
    y, theta = simulate(1, 2)[0], TRUE + [0.02, 0.1, -0.1, 0.1]

    def decorrelated(at):
        e, s = innovations(at, y[None])
        lower = np.linalg.cholesky(s)
        root = np.diagonal(lower, axis1=1, axis2=2)
        return np.linalg.solve(lower, e[0][..., None])[..., 0] * root, root**2

    e, s = decorrelated(theta)
    plain, full = innovations(theta, y[None])
    assert negative_log_likelihood(e, s) == pytest.approx(negative_log_likelihood(plain[0], full), rel=1e-12)
    by = [
        [(u - d) / 2e-5 for u, d in zip(decorrelated(theta + m), decorrelated(theta - m), strict=True)]
        for m in 1e-5 * np.eye(4)
    ]
    by_e, by_s = np.array([b[0] for b in by]), np.array([b[1] for b in by])
    np.testing.assert_allclose(score(e, s, by_e, by_s).sum(axis=0), gradient_of(y)(theta), rtol=1e-5, atol=1e-5)
    e[3, 1] = s[3, 1] = np.nan  # not measured: takes its own terms away and nothing else
    by_e[:, 3, 1] = by_s[:, 3, 1] = np.nan
    terms = score(e, s, by_e, by_s)
    assert np.all(np.isfinite(terms)) and np.all(np.isfinite(fisher_information(s, by_e, by_s)))


@pytest.mark.long
def test_fisher_information_is_the_covariance_of_the_score_and_the_mean_hessian():
    """400 runs: each element within 5 standard errors of its Monte Carlo mean."""
    y = simulate(400, 3)
    e, s = innovations(TRUE, y)
    by_e, by_s = derivatives(TRUE, y)
    information = np.mean([fisher_information(s, by_e[:, m], by_s) for m in range(100)], axis=0)
    scores = np.array([score(e[m], s, by_e[:, m], by_s).sum(axis=0) for m in range(400)])
    products = np.einsum("mi,mj->mij", scores, scores)
    error = np.std(products, axis=0) / np.sqrt(len(y))
    assert np.all(np.abs(products.mean(axis=0) - information) < 5.0 * error)
    hessians = [newton_expansion(lambda t: 0.0, gradient_of(one), TRUE, np.full(4, 1e-3)).matrix for one in y[:40]]
    error = np.std(hessians, axis=0) / np.sqrt(len(hessians))
    assert np.all(np.abs(np.mean(hessians, axis=0) - information) < 5.0 * error)


@pytest.mark.long
def test_the_printed_form_of_511_is_wrong_for_two_outputs():
    """Two independent outputs, each with its own variance: knowing one says nothing of the other."""
    random = np.random.default_rng(4)
    t = np.array([0.3, -0.5])
    e = random.normal(size=(4000, 100, 2)) * np.exp(0.5 * t)
    covariance = np.tile(np.diag(np.exp(t)), (100, 1, 1))
    by_e, by_s = np.zeros((2, 100, 2)), np.zeros((2, 100, 2, 2))
    for i in range(2):
        by_s[i, :, i, i] = np.exp(t[i])
    scores = np.array([score(one, covariance, by_e, by_s).sum(axis=0) for one in e])
    monte_carlo = scores.T @ scores / len(e)
    information = fisher_information(covariance, by_e, by_s)
    np.testing.assert_allclose(information, 50.0 * np.eye(2), rtol=1e-12)
    np.testing.assert_allclose(monte_carlo, information, atol=5.0)
    eta = np.trace(np.linalg.solve(covariance[None], by_s), axis1=2, axis2=3)
    printed = 0.5 * eta @ eta.T
    assert np.linalg.matrix_rank(printed) == 1 and np.abs(printed - monte_carlo).max() > 40.0


def test_newton_and_gauss_newton_find_the_same_minimum():
    y = simulate(1, 5)[0]
    start = TRUE + [-0.1, 0.1, 0.3, -0.2]
    cost, gradient = cost_of(y), gradient_of(y)
    gauss = minimise(cost, gauss_newton(y), start, tolerance=1e-3)
    newton = minimise(cost, lambda t: newton_expansion(cost, gradient, t, np.full(4, 1e-4)), start, tolerance=1e-3)
    assert gauss.converged and newton.converged
    errors = np.sqrt(np.diag(covariance_of(gauss.expansion.matrix)))
    assert np.all(np.abs(gauss.theta - newton.theta) < 0.01 * errors)
    assert np.all(np.abs(gauss.theta - TRUE) < 4.0 * errors)
    short = minimise(cost, gauss_newton(y), start, tolerance=1e-3, maximum_iterations=1)
    assert not short.converged and "1 iterations" in short.reason


def test_the_estimate_has_the_covariance_of_the_inverse_information():
    """40 runs: the mean of z^2 over four parameters is 1 within 5 standard errors."""
    square = []
    for y in simulate(40, 6):
        found = minimise(cost_of(y), gauss_newton(y), TRUE)
        square.append((found.theta - TRUE) ** 2 / np.diag(covariance_of(found.expansion.matrix)))
    assert abs(np.mean(square) - 1.0) < 5.0 * np.sqrt(2.0 / 160.0)


def test_the_sandwich_knows_coloured_residuals():
    """Mean of an AR(1) series taken for white: F^-1 is (1 + rho) / (1 - rho) times too small."""
    random, rho, n = np.random.default_rng(7), 0.8, 4000
    estimates, sandwich, white = [], [], []
    for _ in range(100):
        noise = random.normal(size=n)
        for k in range(1, n):
            noise[k] += rho * noise[k - 1]
        e = (noise - noise.mean())[:, None]
        s, by_e = np.full((n, 1), np.var(noise)), -np.ones((1, n, 1))
        information = fisher_information(s, by_e, np.zeros((1, n, 1)))
        terms = score(e, s, by_e, np.zeros((1, n, 1)))
        estimates.append(noise.mean())
        sandwich.append(sandwich_covariance(information, [terms], 60)[0, 0])
        white.append(covariance_of(information)[0, 0])
    truth = np.var(estimates)
    assert np.mean(sandwich) == pytest.approx(truth, rel=0.35)
    assert np.mean(white) < 0.2 * truth


def test_the_sandwich_is_the_weighted_sum_of_lagged_products():
    random, lags = np.random.default_rng(8), 3
    terms = random.normal(size=(50, 2))
    expected = sum(
        (1.0 - abs(lag) / (lags + 1.0)) * np.outer(terms[k], terms[k - lag])
        for k in range(50) for lag in range(-lags, lags + 1) if 0 <= k - lag < 50
    )  # fmt: skip
    np.testing.assert_allclose(sandwich_covariance(np.eye(2), [terms], lags), expected, rtol=1e-9)
    np.testing.assert_allclose(sandwich_covariance(np.eye(2), [terms], 0), terms.T @ terms, rtol=1e-9)


def test_directions_without_information_and_indefinite_matrices():
    """A parameter that nothing depends on is not moved; a saddle gives a direction of descent."""
    step = newton_step(np.diag([2.0, 0.0]), np.array([1.0, 0.0]))
    np.testing.assert_allclose(step, [-0.5, 0.0])
    gradient = np.array([1.0, 0.5])
    assert gradient @ newton_step(np.array([[1.0, 3.0], [3.0, 1.0]]), gradient) < 0.0
    covariance = covariance_of(np.diag([4.0, 0.0]))
    assert covariance[0, 0] == pytest.approx(0.25) and np.isnan(covariance[1, 1])
    with pytest.raises(np.linalg.LinAlgError):
        negative_log_likelihood(np.zeros((1, 1)), np.zeros((1, 1)))
