"""Recursive least squares: the batch solution if nothing is forgotten, held values if nothing moves."""

import numpy as np
import pytest
from numba import njit

from aircraft_sysid_ros.estimation.least_squares import weighted_least_squares
from aircraft_sysid_ros.estimation.recursive_least_squares import (
    gain_update,
    information_solution,
    information_update,
    rls_update,
    square_root_solution,
    square_root_update,
)

TRUE = np.array([0.4, -4.5, -0.8])


def run(theta, p, rows, values, forgetting=1.0):
    for x, y in zip(rows, values, strict=True):
        rls_update(theta, p, x, y, forgetting)
    return theta, p


def test_without_forgetting_it_is_batch_weighted_least_squares_with_the_prior():
    rng = np.random.default_rng(0)
    rows, weights = rng.normal(size=(200, 3)), rng.uniform(0.1, 3.0, 200)  # W of (4.5), each scalar
    values = rows @ TRUE + np.sqrt(weights) * rng.normal(size=200)
    prior, before = np.diag([2.0, 5.0, 1.0]), np.array([0.1, 0.2, 0.3])
    root = np.sqrt(weights)
    theta, p = run(before.copy(), prior.copy(), rows / root[:, None], values / root)
    information = np.linalg.inv(prior) + rows.T @ (rows / weights[:, None])
    expected = np.linalg.solve(information, np.linalg.solve(prior, before) + rows.T @ (values / weights))
    np.testing.assert_allclose(theta, expected, rtol=1e-9)
    np.testing.assert_allclose(p, np.linalg.inv(information), rtol=1e-9, atol=1e-12)


def test_the_prediction_error_is_that_before_the_update():
    theta, p = np.array([1.0, 2.0]), np.eye(2)
    assert rls_update(theta, p, np.array([1.0, 1.0]), 5.0, 1.0) == 2.0
    # k = P x / (1 + x' P x) = [1, 1] / 3
    np.testing.assert_allclose(theta, [1.0 + 2.0 / 3.0, 2.0 + 2.0 / 3.0])
    np.testing.assert_allclose(p, [[2.0 / 3.0, -1.0 / 3.0], [-1.0 / 3.0, 2.0 / 3.0]])


def test_vector_measurements_need_4_14_without_the_weight_that_is_printed_too_many():
    rng = np.random.default_rng(1)
    w = np.array([[0.5, 0.2], [0.2, 2.0]])
    h = rng.normal(size=(30, 2, 3))
    y = h @ TRUE + rng.multivariate_normal(np.zeros(2), w, size=30)
    prior = 10.0 * np.eye(3)
    information = np.linalg.inv(prior) + sum(hk.T @ np.linalg.solve(w, hk) for hk in h)
    batch = np.linalg.solve(information, sum(hk.T @ np.linalg.solve(w, yk) for hk, yk in zip(h, y, strict=True)))

    theta, ours = np.zeros(3), prior.copy()
    right, printed = prior.copy(), prior.copy()
    root = np.linalg.cholesky(w)
    for hk, yk in zip(h, y, strict=True):
        # rows divided by the root of W are independent scalars, one rls_update each
        run(theta, ours, np.linalg.solve(root, hk), np.linalg.solve(root, yk))
        right = right - right @ hk.T @ np.linalg.solve(hk @ right @ hk.T + w, hk) @ right
        inner = np.linalg.inv(w) @ np.linalg.inv(hk @ printed @ hk.T + w)
        printed = printed - printed @ hk.T @ inner @ hk @ printed
    np.testing.assert_allclose(theta, batch, rtol=1e-9)
    np.testing.assert_allclose(ours, np.linalg.inv(information), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(right, np.linalg.inv(information), rtol=1e-9, atol=1e-12)
    assert not np.allclose(printed, np.linalg.inv(information), rtol=0.2, atol=0.0)


@pytest.mark.parametrize("forgetting", [0.9, 0.99, 0.9997])
def test_one_sample_leaves_the_stated_information_along_its_regressor_and_all_of_it_across(forgetting):
    rng = np.random.default_rng(2)
    a, x = rng.normal(size=(3, 3)), rng.normal(size=3)
    before = a @ a.T + np.eye(3)
    p, theta, r = before.copy(), np.zeros(3), x @ before @ x
    rls_update(theta, p, x, 1.0, forgetting)
    assert x @ p @ x == pytest.approx(r / (forgetting * (1.0 + r)), rel=1e-12)
    across = np.linalg.svd((before @ x)[None, :])[2][1:]  # v with v' P x = 0
    np.testing.assert_allclose(across @ p, across @ before, atol=1e-13)
    np.testing.assert_allclose(across @ theta, 0.0, atol=1e-15)


@pytest.mark.long
def test_a_million_samples_of_cruise_are_held_where_exponential_forgetting_blows_up():
    rng = np.random.default_rng(3)
    forgetting, sigma = 0.999, 0.05
    rows = rng.normal(size=(5000, 3))
    theta, p = run(np.zeros(3), 1e8 * np.eye(3), rows, rows @ TRUE + sigma * rng.normal(size=5000), forgetting)
    before, p_before = theta.copy(), p.copy()

    x = np.array([1.0, 0.05, -0.02])  # nothing moves any more
    truth, noise = float(x @ TRUE), sigma * rng.normal(size=1_000_000)
    for e in noise:
        rls_update(theta, p, x, truth + e, forgetting)
    np.testing.assert_array_equal(p, p.T)
    assert np.linalg.eigvalsh(p).min() > 0.0
    assert np.linalg.eigvalsh(p).max() < 3.0 * np.linalg.eigvalsh(p_before).max()  # n = 3 shared one memory
    assert x @ p @ x == pytest.approx(1.0 / forgetting - 1.0, rel=1e-6)  # memory of 1000 samples, no more, no less
    across = np.linalg.svd((p_before @ x)[None, :])[2][1:]
    np.testing.assert_allclose(across @ theta, across @ before, atol=1e-9)  # held
    np.testing.assert_allclose(across @ p, across @ p_before, rtol=1e-6, atol=1e-9)
    # the level is still averaged: noise of an exponential memory of 1000 samples, five sigma
    assert abs(x @ theta - truth) < 5.0 * sigma * np.sqrt(0.5 * (1.0 - forgetting))
    np.testing.assert_allclose(theta, TRUE, atol=0.05)

    exponential = p_before.copy()
    for _ in range(20_000):
        px = exponential @ x
        exponential = (exponential - np.outer(px, px) / (forgetting + x @ px)) / forgetting
    growth = np.linalg.eigvalsh(exponential).max() / np.linalg.eigvalsh(p_before).max()
    assert growth > 0.5 * forgetting**-20_000 > 1e8  # in 2 % of the time


def test_a_large_prior_and_nearly_dependent_regressors_keep_the_covariance_positive():
    rng = np.random.default_rng(4)
    theta, p = np.zeros(4), 1e8 * np.eye(4)
    for _ in range(50_000):
        a, b = rng.normal(size=2)
        x = np.array([1.0, a, b, a + 1e-4 * b])
        rls_update(theta, p, x, float(x @ [1.0, 2.0, 3.0, 4.0]) + 0.01 * rng.normal(), 0.9995)
    np.testing.assert_array_equal(p, p.T)
    assert np.linalg.eigvalsh(p).min() > 0.0 and np.all(np.isfinite(theta))
    assert theta[1] + theta[3] == pytest.approx(6.0, abs=0.02)  # what the data do tell


def test_a_step_of_the_parameters_is_followed_within_its_time_when_excited():
    rng = np.random.default_rng(5)
    forgetting, n = 0.99, 3
    rows = rng.normal(size=(6000, n))
    theta, p = run(np.zeros(n), 1e6 * np.eye(n), rows[:3000], rows[:3000] @ TRUE, forgetting)
    np.testing.assert_allclose(theta, TRUE, atol=1e-6)
    changed = TRUE * np.array([1.0, 0.5, 1.0])  # half of one parameter breaks off
    # A direction is forgotten only when it is excited, so that n parameters take n times as long as one:
    # after 3 n / (1 - forgetting) samples, three time constants, a twentieth is left; twice that is allowed.
    count = 3 * n * 100
    run(theta, p, rows[3000 : 3000 + count], rows[3000 : 3000 + count] @ changed, forgetting)
    np.testing.assert_allclose(theta, changed, atol=0.1 * 2.25)
    run(theta, p, rows[3000 + count :], rows[3000 + count :] @ changed, forgetting)
    np.testing.assert_allclose(theta, changed, atol=1e-2)


def test_without_forgetting_the_same_step_is_not_followed():
    rng = np.random.default_rng(6)
    rows = rng.normal(size=(4000, 3))
    theta, p = run(np.zeros(3), 1e6 * np.eye(3), rows[:3000], rows[:3000] @ TRUE)
    run(theta, p, rows[3000:], rows[3000:] @ (0.5 * TRUE))
    assert abs(theta[1] + 4.5 * 0.5) > 1.5


@pytest.mark.parametrize("forgetting", [1.0, 0.99])
@pytest.mark.parametrize(
    ("x", "y"),
    [
        ([0.0, 0.0], 1.0),
        ([1e-155, 0.0], 1.0),  # x' P x is next to nothing
        ([1e-160, 0.0], 1.0),
        ([1e-162, 1e-162], 1.0),
        ([np.nan, 1.0], 1.0),
        ([1.0, 1.0], np.nan),
        ([1.0, 1.0], np.inf),
    ],
)
def test_a_sample_that_says_nothing_is_harmless(x, y, forgetting):
    theta, p = np.array([1.0, 2.0]), np.diag([3.0, 4.0])
    rls_update(theta, p, np.array(x), y, forgetting)
    np.testing.assert_allclose(theta, [1.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(p, np.diag([3.0, 4.0]), rtol=1e-15)


# -- vector measurements: gain form (4.14), information form (4.11)-(4.13), square-root form ---------------------


def vector_problem(seed=7, count=40):
    rng = np.random.default_rng(seed)
    h = rng.normal(size=(count, 2, 3))
    w = np.array([[0.5, 0.2], [0.2, 2.0]]) * rng.uniform(0.5, 2.0, count)[:, None, None]
    y = h @ TRUE + np.stack([np.linalg.cholesky(wk) @ rng.normal(size=2) for wk in w])
    return h, y, w


@pytest.mark.long
def test_all_three_forms_are_the_batch_solution_with_any_w():
    h, y, w = vector_problem()
    prior = 1e3 * np.eye(3)
    theta, p = np.zeros(3), prior.copy()
    information, vector, root = np.zeros((3, 3)), np.zeros(3), np.zeros((4, 4))
    for hk, yk, wk in zip(h, y, w, strict=True):
        gain_update(theta, p, hk, yk, wk)
        information_update(information, vector, hk, yk, wk)
        square_root_update(root, hk, yk, wk, 1.0)
    batch = weighted_least_squares(h, y, w)
    for solution in (information_solution(information, vector), square_root_solution(root)):
        np.testing.assert_allclose(solution.estimate, batch.estimate, rtol=1e-11)
        np.testing.assert_allclose(solution.covariance, batch.covariance, rtol=1e-10, atol=1e-14)
    cost = sum(z @ np.linalg.solve(wk, z) for z, wk in zip(batch.residuals, w, strict=True))
    assert root[3, 3] ** 2 == pytest.approx(cost, rel=1e-12)
    rows, values = np.concatenate([h, np.eye(3)[:, None, :].repeat(2, axis=1)]), np.concatenate([y, np.zeros((3, 2))])
    both = np.concatenate([w, np.tile(2.0 * prior[:2, :2], (3, 1, 1))])  # the prior as measurements, each twice
    with_prior = weighted_least_squares(rows, values, both)
    np.testing.assert_allclose(theta, with_prior.estimate, rtol=1e-9)
    np.testing.assert_allclose(p, with_prior.covariance, rtol=1e-9, atol=1e-13)


@pytest.mark.long
def test_the_printed_4_14_gives_another_covariance_than_4_13():
    h, y, w = vector_problem(count=1)
    prior = np.diag([2.0, 5.0, 1.0])
    expected = np.linalg.inv(np.linalg.inv(prior) + h[0].T @ np.linalg.solve(w[0], h[0]))  # (4.13)
    theta, p = np.zeros(3), prior.copy()
    gain_update(theta, p, h[0], y[0], w[0])
    np.testing.assert_allclose(p, expected, rtol=1e-12, atol=1e-14)
    inner = np.linalg.inv(w[0]) @ np.linalg.inv(h[0] @ prior @ h[0].T + w[0])
    printed = prior - prior @ h[0].T @ inner @ h[0] @ prior
    assert np.abs(printed - expected).max() > 0.1


@njit(cache=True)
def many_updates(theta, p, root, rows, y, w, count):
    for k in range(count):
        gain_update(theta, p, rows[k % len(rows)], y[k % len(rows)], w)
        square_root_update(root, rows[k % len(rows)], y[k % len(rows)], w, 1.0)


@pytest.mark.long
def test_a_million_vector_steps_stay_symmetric_and_positive():
    h, y, w = vector_problem()
    theta, p, root = np.zeros(3), 1e8 * np.eye(3), np.zeros((4, 4))
    many_updates(theta, p, root, h, y, w[0], 1_000_000)
    np.testing.assert_array_equal(p, p.T)
    assert np.linalg.eigvalsh(p)[0] > 0.0
    batch = weighted_least_squares(h, y, np.tile(w[0], (len(h), 1, 1)))
    np.testing.assert_allclose(theta, batch.estimate, rtol=1e-6)
    np.testing.assert_allclose(p * 25_000.0, batch.covariance, rtol=1e-6, atol=1e-9)
    solution = square_root_solution(root)
    np.testing.assert_allclose(solution.estimate, batch.estimate, rtol=1e-10)
    np.testing.assert_allclose(solution.covariance * 25_000.0, batch.covariance, rtol=1e-9, atol=1e-12)


@pytest.mark.long
def test_the_square_root_keeps_digits_that_the_covariance_and_the_information_lose():
    """Two regressors that differ by 1e-7: the information has a condition of 1e14, its root 1e7."""
    rng = np.random.default_rng(8)
    a, b = rng.normal(size=(2, 400))
    rows = np.stack([a, a + 1e-7 * b], axis=1)
    true, one = np.array([3.0, -1.0]), np.eye(1)
    theta, p = np.zeros(2), 1e16 * np.eye(2)
    information, vector, root = np.zeros((2, 2)), np.zeros(2), np.zeros((3, 3))
    for row in rows[:, None, :]:
        y = row @ true
        gain_update(theta, p, row, y, one)
        information_update(information, vector, row, y, one)
        square_root_update(root, row, y, one, 1.0)
    solution = square_root_solution(root)
    assert solution.determined.all()
    np.testing.assert_allclose(solution.estimate, true, rtol=1e-6)
    assert np.abs(theta - true).max() > 1e-4
    squared = information_solution(information, vector)
    assert not squared.determined.all() or np.abs(squared.estimate - true).max() > 1e-4


def test_collinear_regressors_are_named_by_the_square_root_and_the_information_form():
    rng = np.random.default_rng(9)
    information, vector, root = np.zeros((3, 3)), np.zeros(3), np.zeros((4, 4))
    for _ in range(50):
        a, b = rng.normal(size=2)
        row = np.array([[a, b, -2.0 * a]])
        information_update(information, vector, row, row @ TRUE, np.eye(1))
        square_root_update(root, row, row @ TRUE, np.eye(1), 1.0)
    for solution in (information_solution(information, vector), square_root_solution(root)):
        np.testing.assert_array_equal(solution.determined, [False, True, False])
        assert solution.estimate[1] == pytest.approx(TRUE[1], rel=1e-12)
        assert np.isnan(solution.covariance[0, 0]) and solution.covariance[1, 1] > 0.0
    assert not square_root_solution(np.zeros((4, 4))).determined.any()


def test_the_square_root_forgets_as_weighted_least_squares_does():
    h, y, w = vector_problem()
    root = np.zeros((4, 4))
    for hk, yk, wk in zip(h, y, w, strict=True):
        square_root_update(root, hk, yk, wk, 0.9)
    age = np.arange(len(h))[::-1, None, None]
    batch = weighted_least_squares(h, y, w / 0.9**age)
    np.testing.assert_allclose(square_root_solution(root).estimate, batch.estimate, rtol=1e-11)


@pytest.mark.parametrize("spoil", ["y", "h", "w"])
def test_a_vector_measurement_that_is_not_usable_changes_nothing(spoil):
    h, y, w = (part[0].copy() for part in vector_problem())
    if spoil == "w":
        w[:] = [[1.0, 2.0], [2.0, 1.0]]
    else:
        {"y": y, "h": h}[spoil].flat[1] = np.nan
    theta, p, information, vector = np.ones(3), np.eye(3), np.eye(3), np.ones(3)
    root = np.triu(np.ones((4, 4)))
    gain_update(theta, p, h, y, w)
    information_update(information, vector, h, y, w)
    square_root_update(root, h, y, w, 0.5)
    assert (theta == 1.0).all() and (p == np.eye(3)).all() and (information == np.eye(3)).all()
    assert (vector == 1.0).all() and (root == np.triu(np.ones((4, 4)))).all()
