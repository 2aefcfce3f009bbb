"""Random effects against the textbook's likelihood, and laws that any such fit obeys."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from aircraft_sysid_ros.fleet.random_effects import fit


def drawn(seed, n=12, tau=0.7):
    rng = np.random.default_rng(seed)
    s = rng.uniform(0.2, 1.5, n)
    x = np.column_stack([np.ones(n), np.arange(n) - (n - 1) / 2])
    return x @ [3.0, 0.2] + rng.normal(0.0, tau, n) + s * rng.normal(size=n), s, x


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_the_spread_has_the_greatest_likelihood_of_the_error_contrasts(seed):
    """Patterson and Thompson's definition: the likelihood of what the fit cannot change, N(0, K'VK)."""
    y, s, x = drawn(seed)
    contrasts = null_space(x.T)
    grid = np.linspace(0.0, 3.0, 3001)
    likelihood = [
        multivariate_normal.logpdf(contrasts.T @ y, cov=contrasts.T @ np.diag(s**2 + tau**2) @ contrasts)
        for tau in grid
    ]
    assert fit(y, s, x).between == pytest.approx(grid[np.argmax(likelihood)], abs=2e-3)


def test_flights_that_agree_have_no_spread_and_the_error_of_their_weighted_mean():
    s = np.array([1.0, 2.0, 4.0, 2.0])
    found = fit(np.array([5.0, 5.1, 4.9, 5.0]), s, np.ones((4, 1)))
    assert found.between == 0.0
    assert found.std[0] == pytest.approx(np.sum(s**-2.0) ** -0.5)


def test_shift_and_scale():
    y, s, x = drawn(7)
    one, other = fit(y, s, x), fit(10.0 * y + 30.0, 10.0 * s, x)
    assert other.value == pytest.approx(10.0 * one.value + [30.0, 0.0], rel=1e-6)
    assert other.std == pytest.approx(10.0 * one.std, rel=1e-3)
    assert other.p_value() == pytest.approx(one.p_value(), rel=1e-2)


def test_equal_flights_without_spread_of_any_kind():
    found = fit(np.full(6, 2.0), np.full(6, 0.1), np.ones((6, 1)))
    assert found.value[0] == pytest.approx(2.0) and found.between == 0.0


@pytest.mark.long
def test_intervals_hold_the_truth():
    """95 % of them, within what 300 draws can tell, whether or not flights differ."""
    from scipy.stats import t as student

    for tau in (0.0, 0.7):
        inside = 0
        for seed in range(300):
            found = fit(*drawn(1000 + seed, tau=tau))
            inside += abs(found.value[1] - 0.2) < student.ppf(0.975, found.freedom) * found.std[1]
        assert inside >= 273  # 99.9 % of binomial(300, 0.95) is above
