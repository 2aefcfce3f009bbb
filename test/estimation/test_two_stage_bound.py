"""The bound on the cost of stage 1."""

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.two_stage.bound import (
    cost_bound,
    error_bound,
    error_term,
    lipschitz_constants,
    lower_bound,
)
from aircraft_sysid_ros.estimation.two_stage.linear import linear_stage
from aircraft_sysid_ros.estimation.two_stage.optimisation import optimise
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

ETA = np.linspace(1.0, 10.0, 100)
ONE = np.ones(1)


def example(noise):
    """Example 1 of the paper."""
    z = 2.0 * np.cos(ETA + 0.1) + 1.0 + np.random.default_rng(0).normal(0.0, noise, 100)

    def model(xi2):
        cosine = np.cos(ETA + xi2[0])
        return np.stack([cosine, np.ones(100)], axis=1)[:, None, :], cosine[:, None]

    free = [[-np.inf, np.inf]] * 2
    return Problem(z[:, None], model, ("a", "c"), ("b",), free, [[-0.5, 0.7]])


@pytest.mark.parametrize("noise", [0.0, 0.3, 2.0])
def test_the_optimum_lies_between_the_bounds_and_e_below_its_own(noise):
    problem = example(noise)
    dense = np.linspace(-0.5, 0.7, 60)[:, None]
    lipschitz = lipschitz_constants(problem, dense, ONE)
    for xi2p in dense[::6]:
        best = optimise(problem, np.zeros(2), np.array([0.1]), ONE, alone=True)
        bound = cost_bound(problem, best.xi1, best.xi2, xi2p, ONE, lipschitz)
        assert bound.optimum == pytest.approx(best.cost)
        assert bound.lower_by_constants <= bound.lower <= bound.optimum + 1e-9
        assert bound.optimum <= bound.stage_1 + 1e-9
        assert bound.error <= bound.error_bound * (1.0 + 1e-9)


def test_lipschitz_constants_of_the_cosine():
    """dA/db = (-sin, 0), per half range 0.6."""
    problem = example(0.0)
    largest = 0.6 * np.max(np.abs(np.sin(ETA + 0.2)))
    np.testing.assert_allclose(lipschitz_constants(problem, np.array([[0.2]]), ONE), [largest] * 2, rtol=1e-6)


def test_the_printed_bound_7_does_not_hold_in_general():
    """z = (3, 0), b on the unit circle: J* = 2 at angle 0; at 90 degrees Jp = 5 and E = 1, and 5 - 1 is not below 2."""
    z = np.array([[3.0, 0.0], [0.0, 0.0]])

    def model(xi2):
        circle = np.array([[np.cos(xi2[0]), np.sin(xi2[0])], [0.0, 0.0]])
        return np.array([[[0.0], [0.0]], [[1.0], [1.0]]]), circle

    problem = Problem(z, model, ("a",), ("angle",), [[-1.0, 1.0]], [[-2.0, 2.0]])
    noise, at, sample = np.ones(2), np.zeros(1), np.array([np.pi / 2.0])
    cost = lambda xi2: 0.5 * linear_stage(problem.evaluate(xi2)[0], z - problem.evaluate(xi2)[1], noise).squares  # noqa: E731
    assert optimise(problem, np.zeros(1), np.array([0.4]), noise, alone=True).cost == pytest.approx(2.0, abs=1e-6)
    assert (cost(at), cost(sample)) == pytest.approx((2.0, 5.0))
    error = error_term(problem, np.zeros(1), at, sample, noise)
    assert error == pytest.approx(1.0)
    assert cost(sample) - error > cost(at)
    assert lower_bound(cost(sample), error) == pytest.approx((np.sqrt(5.0) - 1.0) ** 2)
    assert lower_bound(cost(sample), error) < cost(at)


def test_13_for_constants_that_are_given():
    assert error_bound(100, 0.1, 0.2, 3.0, 0.5) == pytest.approx(50.0 * 0.25**2)


def test_an_error_larger_than_the_cost_bounds_nothing():
    assert lower_bound(1.0, 4.0) == 0.0
