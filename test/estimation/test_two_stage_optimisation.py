"""Stage 2 of the two-stage paper: variable projection and all unknowns, bounds, and R in turn."""

from dataclasses import replace

import numpy as np
import pytest
from five_hole_like import BOUNDS1, BOUNDS2, NOISE, five_hole_like

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.least_squares import weighted_least_squares
from aircraft_sysid_ros.estimation.two_stage.covariance import cost_gradient
from aircraft_sysid_ros.estimation.two_stage.linear import linear_stage
from aircraft_sysid_ros.estimation.two_stage.optimisation import (
    alternate,
    at_bound,
    optimise,
    residual_noise,
    within_bounds,
)
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

TRUTH = np.array([-0.17, 2.0, -5.0, 4.0, -0.7, 0.3, -0.04, -0.25, -0.02, -0.13])
START = np.zeros(5), np.array([0.0, 0.0, 0.0, 0.0, 0.05])
R = NOISE**2


@pytest.fixture(scope="module")
def problem():
    return five_hole_like(600, TRUTH, seed=1)


def projected_cost(problem, xi2):
    a, b = problem.evaluate(xi2)
    return 0.5 * linear_stage(a, problem.kept - b, R).squares


def test_the_gradient_of_the_projected_cost_is_the_partial_one(problem):
    """Golub and Pereyra: with xi1 at its optimum the total derivative is that at fixed xi1."""
    xi2 = TRUTH[5:] + 0.05
    a, b = problem.evaluate(xi2)
    xi1 = linear_stage(a, problem.kept - b, R).xi1
    gradient = cost_gradient(problem, xi1, xi2, R)
    np.testing.assert_allclose(gradient[:5], 0.0, atol=1e-7)
    for j in range(5):
        step = 1e-5 * np.eye(5)[j]
        expected = (projected_cost(problem, xi2 + step) - projected_cost(problem, xi2 - step)) / 2e-5
        assert gradient[5 + j] == pytest.approx(expected, rel=1e-6)


def test_xi2_alone_and_all_unknowns_reach_the_same_minimum(problem):
    one, both = (optimise(problem, *START, R, alone=alone) for alone in (True, False))
    assert one.converged and both.converged
    std = np.sqrt(np.diag(np.linalg.inv(_normal_matrix(problem, one))))
    difference = np.concatenate([one.xi1 - both.xi1, one.xi2 - both.xi2])
    assert np.all(np.abs(difference) < 0.005 * std)
    assert one.cost == pytest.approx(both.cost, abs=1e-5)
    assert np.all(np.abs(np.concatenate([one.xi1, one.xi2]) - TRUTH) < 4.0 * std)


def test_it_is_a_minimum_of_the_cost(problem):
    found = optimise(problem, *START, R, alone=True)
    std = np.sqrt(np.diag(np.linalg.inv(_normal_matrix(problem, found))))
    gradient = cost_gradient(problem, found.xi1, found.xi2, R)
    assert np.linalg.norm(gradient * std) < 0.02


def _normal_matrix(problem, at):
    a, _ = problem.evaluate(at.xi2)
    h = np.concatenate([a, problem.slopes(at.xi1, at.xi2)], axis=2) / np.sqrt(R)[:, None]
    return np.einsum("kmi,kmj->ij", h, h)


@pytest.mark.parametrize("alone", [True, False])
def test_a_linear_problem_is_weighted_least_squares(alone):
    """A constant, b linear in xi2: one system with R of its own residuals, the fixed point of (26)."""
    rng = np.random.default_rng(2)
    a, g, b = rng.normal(size=(300, 2, 3)), rng.normal(size=(300, 2, 2)), rng.normal(size=(300, 2))
    z = a @ [1.0, -2.0, 0.5] + g @ [0.3, -0.4] + b + rng.normal(size=(300, 2)) * [0.1, 2.0]
    wide = [[-9.0, 9.0]]
    problem = Problem(z, lambda x: (a, b + g @ x), ("p", "q", "r"), ("s", "t"), wide * 3, wide * 2)
    found = alternate(problem, np.zeros(3), np.zeros(2), alone=alone, tolerance=1e-9)
    w = np.broadcast_to(found.noise, z.shape)
    expected = weighted_least_squares(np.concatenate([a, g], axis=2), z - b, w)
    std = np.sqrt(np.diag(expected.covariance))
    assert np.all(np.abs(np.concatenate([found.xi1, found.xi2]) - expected.estimate) < 2e-3 * std)
    np.testing.assert_allclose(found.noise, np.mean(expected.residuals**2, axis=0), rtol=1e-5)
    unweighted = weighted_least_squares(np.concatenate([a, g], axis=2), z - b)
    assert np.any(np.abs(unweighted.estimate - expected.estimate) > 0.1 * std)


def test_r_settles_where_the_likelihood_is_greatest(problem):
    """(6) as a function of R too: within 5 % of the fixed point after (26), at it with a small tolerance."""
    quick, exact = (alternate(problem, *START, alone=True, tolerance=t) for t in (0.05, 1e-8))
    np.testing.assert_allclose(quick.noise, exact.noise, rtol=0.01)
    np.testing.assert_allclose(exact.noise, residual_noise(problem, exact.xi1, exact.xi2), rtol=1e-6)
    np.testing.assert_allclose(np.sqrt(exact.noise), NOISE, rtol=0.1)
    assert quick.alternations < exact.alternations
    for factor in (0.97, 1.03):
        other = optimise(problem, exact.xi1, exact.xi2, exact.noise * [factor, 1.0, 1.0], alone=True)
        assert other.cost > exact.cost


def test_bounds_hold_and_are_told(problem):
    tight1, tight2 = BOUNDS1.copy(), BOUNDS2.copy()
    tight1[2], tight2[3] = [-4.0, 4.0], [-0.01, 0.1]  # truth -5 and -0.02
    bounded = replace(problem, bounds1=tight1, bounds2=tight2)
    both = alternate(bounded, *START, alone=False)
    assert both.xi1[2] == -4.0 and both.xi2[3] == -0.01
    np.testing.assert_array_equal(np.flatnonzero(at_bound(bounded, both.xi1, both.xi2)), [2, 8])
    gradient = cost_gradient(bounded, both.xi1, both.xi2, both.noise)
    assert gradient[2] > 0.0 and gradient[8] > 0.0  # the cost falls beyond both lower bounds
    one = alternate(bounded, *START, alone=True)
    assert one.xi2[3] == -0.01 and one.xi1[2] < -4.0
    assert within_bounds(bounded, both) and not within_bounds(bounded, one)


@pytest.mark.parametrize("alone", [True, False])
def test_without_noise_the_truth_is_found(problem, alone):
    a, b = problem.model(TRUTH[5:])
    exact = replace(problem, measured=a @ TRUTH[:5] + b)
    found = alternate(exact, *START, alone=alone)
    np.testing.assert_allclose(np.concatenate([found.xi1, found.xi2]), TRUTH, atol=1e-7)
    assert np.all(found.noise > 0.0)


def test_a_start_without_a_value_is_refused():
    t = np.linspace(1.0, 2.0, 20)
    problem = Problem(
        t[:, None], lambda x: (t[:, None, None], (np.sqrt(x[0]) * t**2)[:, None]), ("a",), ("b",), [[-1, 1]], [[-1, 1]]
    )
    with pytest.raises(InputError, match="not finite at the start"):
        optimise(problem, np.zeros(1), np.array([-0.5]), np.ones(1), alone=False)
