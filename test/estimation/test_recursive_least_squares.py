"""Recursive least squares: the batch solution if nothing is forgotten, held values if nothing moves."""

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.recursive_least_squares import rls_update

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
    batch = np.linalg.solve(
        information, sum(hk.T @ np.linalg.solve(w, yk) for hk, yk in zip(h, y, strict=True))
    )

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


def test_a_million_samples_of_cruise_are_held_where_exponential_forgetting_blows_up():
    rng = np.random.default_rng(3)
    forgetting, sigma = 0.999, 0.05
    rows = rng.normal(size=(5000, 3))
    theta, p = run(
        np.zeros(3), 1e8 * np.eye(3), rows, rows @ TRUE + sigma * rng.normal(size=5000), forgetting
    )
    before, p_before = theta.copy(), p.copy()

    x = np.array([1.0, 0.05, -0.02])  # nothing moves any more
    truth, noise = float(x @ TRUE), sigma * rng.normal(size=1_000_000)
    for e in noise:
        rls_update(theta, p, x, truth + e, forgetting)
    np.testing.assert_array_equal(p, p.T)
    assert np.linalg.eigvalsh(p).min() > 0.0
    assert np.linalg.eigvalsh(p).max() < 3.0 * np.linalg.eigvalsh(p_before).max()  # n = 3 shared one memory
    assert x @ p @ x == pytest.approx(
        1.0 / forgetting - 1.0, rel=1e-6
    )  # memory of 1000 samples, no more, no less
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
