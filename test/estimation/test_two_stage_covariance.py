"""Hessian and covariances: derivatives, Monte Carlo, coloured noise."""

from dataclasses import replace

import numpy as np
import pytest
from five_hole_like import NOISE, five_hole_like
from scipy.signal import lfilter

from aircraft_sysid_ros.estimation.two_stage.covariance import (
    cost_gradient,
    cost_hessian,
    covariances,
    smallest_scaled_eigenvalue,
)
from aircraft_sysid_ros.estimation.two_stage.optimisation import alternate
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

TRUTH = np.array([-0.17, 2.0, -5.0, 4.0, -0.7, 0.3, -0.04, -0.25, -0.02, -0.13])
R = NOISE**2


def cost(problem, xi):
    a, b = problem.evaluate(xi[5:])
    return 0.5 * np.sum((problem.kept - b - a @ xi[:5]) ** 2 / R)


def test_gradient_and_hessian_are_those_of_the_cost():
    problem, xi = five_hole_like(200, TRUTH), TRUTH + 0.03
    step = 1e-4
    moved = [(xi + d, xi - d) for d in step * np.eye(10)]
    gradient = [(cost(problem, up) - cost(problem, down)) / (2 * step) for up, down in moved]
    np.testing.assert_allclose(cost_gradient(problem, xi[:5], xi[5:], R), gradient, rtol=1e-5, atol=1e-4)
    columns = [
        (cost_gradient(problem, up[:5], up[5:], R) - cost_gradient(problem, down[:5], down[5:], R)) / (2 * step)
        for up, down in moved
    ]
    hessian = cost_hessian(problem, xi[:5], xi[5:], R)
    np.testing.assert_allclose(hessian, np.stack(columns), rtol=1e-5, atol=1e-3)
    np.testing.assert_array_equal(hessian, hessian.T)


def test_a_matrix_that_is_not_positive_is_told():
    assert smallest_scaled_eigenvalue(np.diag([1e6, 1e-6])) == pytest.approx(1.0)
    assert smallest_scaled_eigenvalue(np.array([[1.0, 2.0], [2.0, 1.0]])) < 0.0
    assert smallest_scaled_eigenvalue(np.diag([1.0, 0.0])) < 0.0
    assert smallest_scaled_eigenvalue(np.array([[np.nan]])) < 0.0


def sine(noise):
    """z = (1 + a) cos(eta (1 + b) + c) + d + v, example 2 of the paper."""
    truth, eta = np.array([1.0, 1.0, 0.05, 0.1]), np.linspace(1.0, 10.0, len(noise))

    def model(xi2):
        cosine = np.cos(eta * (1.0 + xi2[0]) + xi2[1])
        return np.stack([cosine, np.ones(len(eta))], axis=1)[:, None, :], cosine[:, None]

    a, b = model(truth[2:])
    z = a @ truth[:2] + b + noise[:, None]
    free, near = [[-np.inf, np.inf]] * 2, [[-0.2, 0.3], [-1.0, 1.0]]
    return Problem(z, model, ("a", "d"), ("b", "c"), free, near), truth


def fitted(noise, lags=1):
    problem, truth = sine(noise)
    found = alternate(problem, truth[:2], truth[2:], alone=True)
    by_kind = covariances(problem, found.xi1, found.xi2, found.noise, lags)
    return np.concatenate([found.xi1, found.xi2]) - truth, by_kind


@pytest.mark.long
def test_standard_errors_are_the_spread_of_the_estimates():
    """400 runs: their spread is known to 3.5 %, so 12 % is more than three standard errors."""
    rng = np.random.default_rng(7)
    runs = [fitted(rng.normal(0.0, 0.3, 100)) for _ in range(400)]
    errors = np.array([error for error, _ in runs])
    assert all(by_kind.hessian_positive for _, by_kind in runs)
    for kind in ("gauss_newton", "hessian", "coloured"):
        covariance = np.mean([getattr(by_kind, kind) for _, by_kind in runs], axis=0)
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)), errors.std(axis=0), rtol=0.12)
    scaled = np.einsum("ri,rij,rj->r", errors, [np.linalg.inv(b.hessian) for _, b in runs], errors)
    assert np.mean(scaled) == pytest.approx(4.0, rel=0.12)  # chi square of four numbers


@pytest.mark.long
def test_correlated_noise_needs_the_coloured_covariance():
    """First-order noise of correlation 0.8: the white standard errors are too small, the others nearly right."""
    rng = np.random.default_rng(8)
    runs = []
    for _ in range(150):
        v = lfilter([0.18], [1.0, -0.8], rng.normal(size=1300))
        runs.append(fitted(v[300:], lags=60))
    spread = np.std([error for error, _ in runs], axis=0)
    white, coloured = (
        np.sqrt(np.mean([np.diag(getattr(b, kind)) for _, b in runs], axis=0)) for kind in ("hessian", "coloured")
    )
    assert np.all(white < 0.6 * spread)
    np.testing.assert_allclose(coloured, spread, rtol=0.25)  # 6 % of Monte Carlo, and the window takes some off


def test_lags_are_rows_of_the_record_not_of_what_is_left():
    """Where every second row is missing, or each is a piece of its own, no product is one row apart."""
    rng = np.random.default_rng(9)
    problem, truth = sine(lfilter([0.18], [1.0, -0.8], rng.normal(size=300)))
    coloured = lambda p, *more: covariances(p, truth[:2], truth[2:], np.ones(1), *more).coloured  # noqa: E731
    alone = np.arange(300)
    np.testing.assert_allclose(coloured(problem, 2, alone), coloured(problem, 1), rtol=1e-12)
    holes = replace(problem, usable=alone % 2 == 0)
    np.testing.assert_allclose(coloured(holes, 2), coloured(holes, 1), rtol=1e-12)
    assert np.max(np.abs(coloured(problem, 2) / coloured(problem, 1) - 1.0)) > 0.1
