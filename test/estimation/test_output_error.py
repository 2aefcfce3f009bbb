"""The output-error method on a linear system with a start of its own in every record."""

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.output_error import Linearised, concentrated_cost, estimate, residual_variance

TRUE = np.array([0.95, 0.4])
NOISE = np.array([0.1, 0.3])
LENGTH, RECORDS = 80, 4


class Response:
    """x(k+1) = a x + b u from x(0) = eta, y = (x, 2 x); derivatives by differences."""

    def __init__(self, seed, coloured=0.0):
        random = np.random.default_rng(seed)
        self.inputs = [np.sign(np.sin(0.2 * np.arange(LENGTH) + g)) for g in range(RECORDS)]
        self.starts = random.normal(size=(RECORDS, 1))
        self.y = []
        for g in range(RECORDS):
            noise = random.normal(size=(LENGTH, 2))
            for k in range(1, LENGTH):
                noise[k] = coloured * noise[k - 1] + np.sqrt(1.0 - coloured**2) * noise[k]
            self.y.append(self.outputs(TRUE, self.starts[g], g) + NOISE * noise)
            self.y[g][5::7, 1] = np.nan

    def outputs(self, theta, eta, g):
        x, out = float(eta[0]), np.empty((LENGTH, 2))
        for k in range(LENGTH):
            out[k] = x, 2.0 * x
            x = theta[0] * x + theta[1] * self.inputs[g][k]
        return out

    def residuals(self, theta, nuisances):
        return [self.y[g] - self.outputs(theta, nuisances[g], g) for g in range(RECORDS)]

    def linearise(self, theta, nuisances):
        records = []
        for g, residual in enumerate(self.residuals(theta, nuisances)):

            def slope(dt, de, g=g):
                up = self.outputs(theta + dt, nuisances[g] + de, g)
                return (up - self.outputs(theta - dt, nuisances[g] - de, g)) / 2e-6

            by_theta = np.array([slope(d, 0.0) for d in 1e-6 * np.eye(2)])
            records.append(Linearised(residual, by_theta, np.array([slope(np.zeros(2), 1e-6)])))
        return records


def fit(model, **options):
    return estimate(
        model, TRUE + [-0.05, 0.2], np.zeros((RECORDS, 1)), variance=np.ones(2), precision=np.array([1e-6]),
        floor=np.full(2, 1e-6), **options,
    )  # fmt: skip


def test_it_finds_parameters_starts_and_noise():
    model = Response(1)
    found = fit(model)
    assert found.converged and found.reason == "converged"
    errors = np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(found.theta - TRUE) < 4.0 * errors)
    np.testing.assert_allclose(found.nuisances, model.starts, atol=0.3)
    np.testing.assert_allclose(np.sqrt(found.variance), NOISE, rtol=0.2)


def test_it_is_the_minimum_and_its_covariance_that_of_the_whole_problem():
    """Against differences of V over theta and all eta together: elimination by Schur complement loses nothing."""
    model = Response(2)
    found = fit(model, tolerance=1e-5)
    at = np.concatenate([found.theta, found.nuisances[:, 0]])

    def cost(z):
        return concentrated_cost(model.residuals(z[:2], z[2:, None]), found.variance)

    h = 1e-4
    eye = h * np.eye(len(at))
    gradient = np.array([(cost(at + d) - cost(at - d)) / (2.0 * h) for d in eye])
    assert np.abs(gradient[:2]) @ np.sqrt(np.diag(found.covariance)) < 0.01
    hessian = np.array(
        [[(cost(at + d + f) - cost(at + d - f) - cost(at - d + f) + cost(at - d - f)) / (4 * h * h) for f in eye]
         for d in eye]
    )  # fmt: skip
    np.testing.assert_allclose(np.linalg.inv(hessian)[:2, :2], found.covariance, rtol=0.25, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize(("coloured", "low", "high"), [(0.0, 0.6, 1.5), (0.8, 0.0, 1.8)])
def test_standard_errors_cover_the_truth(coloured, low, high):
    """Mean of z^2 over 40 runs; with coloured residuals the sandwich holds and F^-1 does not."""
    z, plain = [], []
    for seed in range(40):
        found = fit(Response(100 + seed, coloured), lags=20)
        error = found.theta - TRUE
        z.append(error**2 / np.diag(found.coloured_covariance))
        plain.append(error**2 / np.diag(found.covariance))
    assert low < np.mean(z) < high
    if coloured:
        assert np.mean(plain) > 2.0 * np.mean(z)


def test_an_output_that_is_never_there_has_no_variance():
    residuals = [np.array([[1.0, np.nan], [-1.0, np.nan]])]
    variance = residual_variance(residuals, np.full(2, 1e-9))
    assert variance[0] == 1.0 and np.isnan(variance[1])
    assert concentrated_cost(residuals, variance) == pytest.approx(1.0)
    assert residual_variance([np.zeros((3, 1))], np.array([0.5]))[0] == 0.5  # a perfect fit keeps the floor


def test_it_stops_where_it_may_not_go_on():
    found = fit(Response(3), maximum_iterations=1)
    assert not found.converged and "1 iterations" in found.reason
