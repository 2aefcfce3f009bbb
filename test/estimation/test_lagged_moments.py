"""Standard errors that are right when residuals are coloured, and the running sums under them."""

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.lagged_moments import (
    add_sample,
    coloured_covariance,
    residual_autocovariance,
)

LAGS = 5


def accumulate(rows, lags=LAGS, forgetting=1.0, breaks=()):
    """Sums of rows (k, m), as the estimator builds them; data are missing before the rows ``breaks``."""
    sums = np.zeros((lags, rows.shape[1], rows.shape[1]))
    recent = np.full((lags, rows.shape[1]), np.nan)
    for k, row in enumerate(rows):
        if k in breaks:
            recent[:] = np.nan
        add_sample(sums, recent, row, forgetting)
    return sums


def with_one(x, y, root_weight=None):
    rows = np.column_stack([x, y, np.ones(len(y))])
    return rows if root_weight is None else rows * root_weight[:, None]


def coloured_noise(rng, correlation, count, size=()):
    """Stationary AR(1) of variance 1, shape (count, *size)."""
    out = np.empty((count, *size))
    out[0] = rng.normal(size=size)
    for k in range(1, count):
        out[k] = correlation * out[k - 1] + np.sqrt(1.0 - correlation**2) * rng.normal(size=size)
    return out


@pytest.mark.parametrize("forgetting", [1.0, 0.9])
@pytest.mark.parametrize("breaks", [(), (10,), (7, 9, 30)])
def test_sums_are_the_weighted_sums_of_lagged_products(forgetting, breaks):
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(40, 4))
    segment = np.cumsum(np.isin(np.arange(40), breaks))
    expected = np.zeros((LAGS, 4, 4))
    for lag in range(LAGS):
        for k in range(lag, 40):
            if segment[k] == segment[k - lag]:  # no product reaches over a break
                expected[lag] += forgetting ** (39 - k) * np.outer(rows[k], rows[k - lag])
    np.testing.assert_allclose(accumulate(rows, forgetting=forgetting, breaks=breaks), expected, atol=1e-12)


def test_residual_autocovariance_is_that_of_the_residuals_of_any_estimate():
    rng = np.random.default_rng(1)
    x, root_weight = rng.normal(size=(60, 2)), rng.uniform(0.3, 1.0, 60)
    y = x @ [1.0, -2.0] + coloured_noise(rng, 0.7, 60)
    sums = accumulate(with_one(x, y, root_weight))
    for theta in (np.array([1.0, -2.0]), np.array([0.3, 0.5])):
        e = root_weight * (y - x @ theta)
        expected = [
            np.sum(e[lag:] * e[: len(e) - lag]) / np.sum(root_weight[lag:] * root_weight[: len(e) - lag])
            for lag in range(LAGS)
        ]
        np.testing.assert_allclose(residual_autocovariance(sums, theta), expected, rtol=1e-9, atol=1e-12)


def test_without_data_there_is_no_autocovariance():
    assert residual_autocovariance(np.zeros((LAGS, 4, 4)), np.zeros(2)).tolist() == [0.0] * LAGS
    sums = accumulate(np.ones((2, 4)))
    assert np.count_nonzero(residual_autocovariance(sums, np.zeros(2))) == 2  # two samples know two lags


def test_with_one_lag_the_coloured_covariance_is_the_white_one_of_4_7():
    rng = np.random.default_rng(2)
    x = rng.normal(size=(80, 3))
    y = x @ [1.0, 2.0, 3.0] + 0.1 * rng.normal(size=80)
    theta = np.linalg.lstsq(x, y, rcond=None)[0]
    coloured, white, autocovariance = coloured_covariance(accumulate(with_one(x, y), lags=1), theta)
    expected = np.mean((y - x @ theta) ** 2) * np.linalg.inv(x.T @ x)
    np.testing.assert_allclose(white, expected, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(coloured, expected, rtol=1e-9, atol=1e-15)
    assert autocovariance[0] == pytest.approx(np.mean((y - x @ theta) ** 2))


def test_the_coloured_covariance_is_its_formula():
    rng = np.random.default_rng(3)
    x = coloured_noise(rng, 0.8, 70, (2,))
    y = x @ [1.0, -1.0] + coloured_noise(rng, 0.8, 70)
    theta = np.linalg.lstsq(x, y, rcond=None)[0]
    e, middle = y - x @ theta, np.zeros((2, 2))
    for lag in range(-LAGS + 1, LAGS):
        m = abs(lag)
        taper = 0.5 * (1.0 + np.cos(np.pi * m / LAGS))
        product = x[m:].T @ x[: 70 - m] if lag >= 0 else x[: 70 - m].T @ x[m:]
        middle += taper * np.mean(e[m:] * e[: 70 - m]) * product
    inverse = np.linalg.inv(x.T @ x)
    coloured, _, _ = coloured_covariance(accumulate(with_one(x, y)), theta)
    np.testing.assert_allclose(coloured, inverse @ middle @ inverse, rtol=1e-9)


def test_intervals_of_95_percent_cover_the_truth_when_residuals_are_coloured_and_white_ones_do_not():
    repetitions, count, lags, truth = 300, 600, 50, np.array([1.0, -2.0])
    rng = np.random.default_rng(4)
    x = coloured_noise(rng, 0.9, count, (repetitions, 2))
    y = x @ truth + coloured_noise(rng, 0.9, count, (repetitions,))
    inside = {"coloured": 0, "white": 0}
    for i in range(repetitions):
        theta = np.linalg.lstsq(x[:, i], y[:, i], rcond=None)[0]
        coloured, white, _ = coloured_covariance(accumulate(with_one(x[:, i], y[:, i]), lags), theta)
        for name, covariance in (("coloured", coloured), ("white", white)):
            inside[name] += np.count_nonzero(np.abs(theta - truth) < 1.96 * np.sqrt(np.diag(covariance)))
    assert 0.90 <= inside["coloured"] / (2 * repetitions) <= 0.98
    assert inside["white"] / (2 * repetitions) < 0.85


def test_a_regressor_that_is_zero_or_that_others_explain_has_no_standard_error_and_the_rest_keeps_its_own():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 200))
    y = a + 0.1 * rng.normal(size=200)
    alone, _, _ = coloured_covariance(accumulate(with_one(np.column_stack([a]), y)), np.array([1.0]))
    for x, dead in (
        (np.column_stack([a, np.zeros(200)]), [1]),
        (np.column_stack([a, b, 3.0 * b]), [1, 2]),
        (np.column_stack([a, np.ones(200), np.full(200, 0.2)]), [1, 2]),  # flaps that never move
    ):
        theta = np.zeros(x.shape[1])
        theta[0] = 1.0
        for covariance in coloured_covariance(accumulate(with_one(x, y)), theta)[:2]:
            assert np.isnan(covariance[dead]).all() and np.isnan(covariance[:, dead]).all()
            assert covariance[0, 0] == pytest.approx(alone[0, 0], rel=0.2)
    nothing = coloured_covariance(np.zeros((LAGS, 4, 4)), np.zeros(2))
    assert np.isnan(nothing[0]).all() and np.isnan(nothing[1]).all()


def test_regressors_that_are_only_nearly_dependent_keep_their_standard_errors():
    rng = np.random.default_rng(6)
    a, b = rng.normal(size=(2, 400))
    x = np.column_stack([a, a + 1e-3 * b])
    y = x @ [1.0, 1.0] + 0.1 * rng.normal(size=400)
    theta = np.linalg.lstsq(x, y, rcond=None)[0]
    _, white, _ = coloured_covariance(accumulate(with_one(x, y)), theta)
    expected = np.mean((y - x @ theta) ** 2) * np.linalg.inv(x.T @ x)
    np.testing.assert_allclose(white, expected, rtol=1e-4)
