"""The measurement update: equal to its definition where that is known, and sound where numbers are bad."""

import numpy as np
import pytest
from scipy.optimize import minimize

from aircraft_sysid_ros.estimation.iterated_ekf import (
    cholesky,
    gain,
    iterated_update,
    joseph_update,
    solve_factored,
    symmetrise,
)

BEACONS = np.array([[0.0, 0.0], [10.0, 0.0]])


def random_covariance(rng, n, condition=100.0):
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    p = q @ np.diag(np.geomspace(1.0, 1.0 / condition, n)) @ q.T
    return 0.5 * (p + p.T)


def ranges(x):
    """Distances from the beacons, (2,)."""
    return np.linalg.norm(x - BEACONS, axis=1)


def ranges_jacobian(x):
    return (x - BEACONS) / ranges(x)[:, None]


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_factor_and_solution_are_those_of_numpy(n):
    rng = np.random.default_rng(n)
    a, b = random_covariance(rng, n), rng.normal(size=n)
    np.testing.assert_allclose(cholesky(a), np.linalg.cholesky(a), atol=1e-13)
    np.testing.assert_allclose(solve_factored(cholesky(a), b), np.linalg.solve(a, b), rtol=1e-10)


def test_the_factor_of_what_is_not_positive_is_nan():
    for a in (
        [[1.0, 2.0], [2.0, 1.0]],
        [[-1.0, 0.0], [0.0, 1.0]],
        [[0.0, 0.0], [0.0, 0.0]],
        [[np.nan, 0.0], [0.0, 1.0]],
    ):
        assert np.isnan(np.diag(cholesky(np.array(a)))).any()


@pytest.mark.parametrize(("n", "m"), [(1, 1), (4, 2), (15, 3), (6, 6)])
def test_the_gain_is_that_of_3_14(n, m):
    rng = np.random.default_rng(10 * n + m)
    p, h, r = random_covariance(rng, n), rng.normal(size=(m, n)), rng.uniform(0.1, 1.0, m)
    innovation = h @ p @ h.T + np.diag(r)
    k_gain, factor = gain(p, h, r)
    np.testing.assert_allclose(k_gain, np.linalg.solve(innovation, h @ p).T, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(factor @ factor.T, innovation, rtol=1e-12, atol=1e-14)


def test_one_iteration_is_the_kalman_filter_on_a_linear_system():
    rng = np.random.default_rng(3)
    p, h, r = random_covariance(rng, 4), rng.normal(size=(2, 4)), np.array([0.3, 0.7])
    x, y = rng.normal(size=4), rng.normal(size=2)
    update = iterated_update(x, p, y, lambda s: h @ s, lambda s: h, r, maximum_iterations=1)
    innovation = h @ p @ h.T + np.diag(r)
    k = p @ h.T @ np.linalg.inv(innovation)
    np.testing.assert_allclose(update.state, x + k @ (y - h @ x), rtol=1e-11)
    np.testing.assert_allclose(update.covariance, (np.eye(4) - k @ h) @ p, atol=1e-13)
    np.testing.assert_allclose(update.innovation, y - h @ x)
    expected = (y - h @ x) @ np.linalg.solve(innovation, y - h @ x)
    assert update.normalised_innovation_squared == pytest.approx(expected, rel=1e-10)
    again = iterated_update(x, p, y, lambda s: h @ s, lambda s: h, r)
    np.testing.assert_allclose(again.state, update.state, rtol=1e-11)  # iterating changes nothing
    assert again.converged and again.iterations == 2 and update.iterations == 1


def test_a_scalar_update_by_hand():
    # P = 4, R = 1, y = 5, x = 0: K = 0.8, x = 4, P = 0.8
    one = np.eye(1)
    update = iterated_update(np.zeros(1), 4.0 * one, np.array([5.0]), lambda s: s, lambda s: one, np.ones(1))
    assert update.state[0] == pytest.approx(4.0) and update.covariance[0, 0] == pytest.approx(0.8)
    assert update.normalised_innovation_squared == pytest.approx(5.0)


def test_iterating_finds_the_minimum_of_the_cost_2_5_2_6_and_one_step_does_not():
    x, p = np.array([4.0, 3.0]), np.diag([4.0, 9.0])
    variances, y = np.array([0.01, 0.01]), ranges(np.array([6.5, 7.0]))

    def cost(s):
        a, b = s - x, y - ranges(s)
        return 0.5 * a @ np.linalg.solve(p, a) + 0.5 * b @ (b / variances)

    best = minimize(cost, x, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-14, "maxiter": 2000}).x
    iterated = iterated_update(x, p, y, ranges, ranges_jacobian, variances)
    once = iterated_update(x, p, y, ranges, ranges_jacobian, variances, maximum_iterations=1)
    assert iterated.converged and 2 < iterated.iterations < 20
    np.testing.assert_allclose(iterated.state, best, atol=1e-6)  # a minimum is only seen to the root of rounding
    gradient = np.linalg.solve(p, iterated.state - x) - ranges_jacobian(iterated.state).T @ (
        (y - ranges(iterated.state)) / variances
    )
    np.testing.assert_allclose(gradient, 0.0, atol=1e-5)
    assert np.linalg.norm(once.state - best) > 0.1 and cost(once.state) > cost(best) + 1.0
    # the covariance is that of the last nominal state: information adds up
    h = ranges_jacobian(iterated.state)
    information = np.linalg.inv(p) + h.T @ np.diag(1.0 / variances) @ h
    np.testing.assert_allclose(np.linalg.inv(iterated.covariance), information, rtol=1e-6)


def test_inputs_are_not_written_to_and_a_short_iteration_says_so():
    x, p, y = np.array([4.0, 3.0]), np.diag([4.0, 9.0]), ranges(np.array([6.5, 7.0]))
    update = iterated_update(x, p, y, ranges, ranges_jacobian, np.full(2, 0.01), maximum_iterations=2)
    assert not update.converged and update.iterations == 2
    assert x.tolist() == [4.0, 3.0] and p.tolist() == [[4.0, 0.0], [0.0, 9.0]]


@pytest.mark.parametrize("p", [[[-2.0, 0.0], [0.0, 1.0]], [[np.nan, 0.0], [0.0, 1.0]]])
def test_a_covariance_that_is_not_positive_is_an_error(p):
    h = np.array([[1.0, 0.0]])
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        iterated_update(np.zeros(2), np.array(p), np.zeros(1), lambda s: h @ s, lambda s: h, np.ones(1))


def test_the_joseph_form_is_3_18_for_any_gain():
    rng = np.random.default_rng(5)
    p, h, r = random_covariance(rng, 5), rng.normal(size=(2, 5)), np.array([0.2, 0.5])
    k = rng.normal(size=(5, 2))
    updated = p.copy()
    joseph_update(updated, k, h, r)
    left = np.eye(5) - k @ h
    np.testing.assert_allclose(updated, left @ p @ left.T + k @ np.diag(r) @ k.T, atol=1e-13)
    np.testing.assert_array_equal(updated, updated.T)


@pytest.mark.parametrize("error", [-1e-6, 0.0, 1e-6])
def test_an_ill_conditioned_covariance_stays_positive_for_a_gain_that_is_a_millionth_wrong(error):
    rng = np.random.default_rng(11)
    lowest_of_short = []
    for _ in range(50):
        p = 1e7 * random_covariance(rng, 4, condition=1e14)  # from 1e-7 to 1e7
        h, r = rng.normal(size=(2, 4)), np.array([1e-4, 1e-4])
        k_gain = gain(p, h, r)[0] * (1.0 + error)
        joseph = p.copy()
        joseph_update(joseph, k_gain, h, r)
        np.testing.assert_array_equal(joseph, joseph.T)
        assert np.linalg.eigvalsh(joseph).min() > 0.0
        short = (np.eye(4) - k_gain @ h) @ p  # (3.13)
        lowest_of_short.append(np.linalg.eigvalsh(0.5 * (short + short.T)).min())
    if error > 0.0:  # a gain too large takes away more than there is
        assert max(lowest_of_short) < -1.0


@pytest.mark.long
def test_a_hundred_thousand_steps_leave_the_covariance_symmetric_positive_and_settled():
    step, r = 0.01, np.array([0.04])
    phi = np.array([[1.0, step, 0.0], [0.0, 1.0, step], [0.0, 0.0, 1.0]])
    q = np.diag([0.0, 1e-12, 1e-12])
    h = np.array([[1.0, 0.0, 0.0]])
    p = np.diag([1e6, 1e4, 1e2])
    for _ in range(100_000):
        p = phi @ p @ phi.T + q
        k_gain, _ = gain(p, h, r)
        joseph_update(p, k_gain, h, r)
    np.testing.assert_array_equal(p, p.T)
    assert np.linalg.eigvalsh(p).min() > 0.0
    # the steady state of the Riccati equation
    predicted = phi @ p @ phi.T + q
    k = predicted @ h.T / (predicted[0, 0] + r[0])
    np.testing.assert_allclose((np.eye(3) - k @ h) @ predicted, p, rtol=1e-3)


def test_symmetrise_takes_the_mean():
    p = np.array([[1.0, 2.0], [4.0, 3.0]])
    symmetrise(p)
    assert p.tolist() == [[1.0, 3.0], [3.0, 3.0]]
