"""Stage 1 of the two-stage paper: linear least squares at samples, conditions (17) and (18), and the decision."""

import os
from dataclasses import replace

import numpy as np
import pytest
from five_hole_like import BOUNDS2, five_hole_like

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage import conditions as cond
from aircraft_sysid_ros.estimation.two_stage.conditions import Conditions, Verdict
from aircraft_sysid_ros.estimation.two_stage.decision import decide
from aircraft_sysid_ros.estimation.two_stage.linear import linear_stage
from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import candidates, local_minima, sample_residuals
from aircraft_sysid_ros.estimation.two_stage.sampling import Prior

TRUTH = np.array([-0.17, 2.0, -5.0, 4.0, -0.7, 0.3, -0.04, -0.25, -0.02, -0.13])
ETA = np.linspace(1.0, 10.0, 100)
FREE = [[-np.inf, np.inf]]


def wave(b_bounds, *, sign=1.0, noise=0.1, truth=(2.0, 0.5), bounds1=FREE):
    """z = amplitude cos(eta + b) + v."""
    z = truth[0] * np.cos(ETA + truth[1]) + np.random.default_rng(0).normal(0.0, noise, 100)

    def model(xi2):
        return sign * np.cos(ETA + xi2[0])[:, None, None], np.zeros((100, 1))

    return Problem(sign * z[:, None], model, ("amplitude",), ("phase",), bounds1, [b_bounds])


def first_stage(problem, samples, conditions=None):
    samples, chosen = candidates(problem, sample_residuals(problem, samples), conditions or Conditions())
    return samples, chosen, decide(problem, samples, chosen)


@pytest.mark.parametrize("count", [20, 383, 384, 2001])
def test_blocks_give_the_least_squares_solution(count):
    rng = np.random.default_rng(count)
    a, z, noise = rng.normal(size=(count, 3, 4)), rng.normal(size=(count, 3)), np.array([0.5, 1.0, 7.0])
    weighted = a / np.sqrt(noise)[:, None], z / np.sqrt(noise)
    expected, squares, _, _ = np.linalg.lstsq(weighted[0].reshape(-1, 4), weighted[1].ravel(), rcond=None)
    found = linear_stage(a, z, noise)
    np.testing.assert_allclose(found.xi1, expected, rtol=1e-10, atol=1e-12)
    assert found.squares == pytest.approx(float(squares[0]), rel=1e-10)


def test_trace_is_the_mean_square_of_the_residuals_and_threads_do_not_change_it(monkeypatch):
    problem = five_hole_like(500, TRUTH)
    xi2 = Prior().samples(BOUNDS2, 32, 0)
    told = []
    found = sample_residuals(problem, xi2, lambda *words: told.append(words))
    for i in (0, 17):
        a, b = problem.evaluate(xi2[i])
        v = problem.kept - b - a @ found.xi1[i]
        assert found.trace[i] == pytest.approx(np.sum(v**2) / 500, rel=1e-12)
        np.testing.assert_allclose(np.einsum("kmi,km->i", a, v), 0.0, atol=1e-8)
    assert told[-1] == ("stage 1", 32, 32) and len(told) == 32
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    np.testing.assert_array_equal(sample_residuals(problem, xi2).trace, found.trace)


def test_local_minima_are_the_hollows_of_the_samples():
    problem = wave([-1.0, 5.0])
    samples = sample_residuals(problem, np.linspace(-1.0, 5.0, 49)[:, None])
    hollows = samples.xi2[local_minima(samples), 0]
    np.testing.assert_allclose(np.sort(hollows), [0.5, 0.5 + np.pi], atol=0.13)


def test_condition_17_is_the_relative_change_within_reach():
    problem = wave([0.0, 1.0])
    reach, at = np.array([0.2]), np.array([0.3])
    expected = 0.2 * np.linalg.norm(np.sin(ETA + 0.3)) / np.linalg.norm(np.cos(ETA + 0.3))
    assert cond.linear_change(problem, at, reach)[0] == pytest.approx(expected, rel=1e-6)
    few = np.linspace(0.0, 1.0, 4)[:, None]
    samples, _, _ = first_stage(problem, few, Conditions(t1=1.001 * expected))  # reach of 4 samples is 0.125
    assert samples.count(Verdict.NOT_LINEAR) == 0
    with pytest.raises(InputError, match="4 as not linear and 0 not convex"):
        first_stage(problem, few, Conditions(t1=0.01))


def test_a_vanishing_b_does_not_fail_17():
    """As printed the second part of (17) would divide by ||b|| = 0 at the sample that is right."""
    t = np.linspace(0.0, 1.0, 30)
    z = 2.0 * t + np.random.default_rng(0).normal(0.0, 0.01, 30)
    problem = Problem(
        z[:, None], lambda x: (t[:, None, None], (x[0] * np.sin(9.0 * t))[:, None]), ("a",), ("b",), FREE, [[-1.0, 1.0]]
    )
    assert np.linalg.norm(problem.evaluate(np.zeros(1))[1]) == 0.0
    _, chosen, decision = first_stage(problem, np.linspace(-1.0, 1.0, 11)[:, None])
    assert decision.unique
    assert decision.minima[0].xi2[0] == pytest.approx(0.0, abs=0.02)
    assert chosen == [5]


def test_condition_18_as_printed_depends_on_the_sign_of_the_outputs_and_ours_does_not():
    at, xi1 = np.array([0.5]), np.array([2.0])
    plus, minus = wave([0.0, 1.0]), wave([0.0, 1.0], sign=-1.0)
    printed = [cond.summed_curvature(p, at)[0][0, 0] for p in (plus, minus)]
    assert printed[0] == pytest.approx(-printed[1]) and printed[0] != 0.0
    assert all(cond.cost_is_convex(p, xi1, at) for p in (plus, minus))
    assert printed[0] == pytest.approx(-np.sum(np.cos(ETA + 0.5)), rel=1e-5)


def test_samples_at_the_top_of_the_cost_are_not_convex():
    problem = wave([0.0, 3.0])
    top = sample_residuals(problem, np.array([[0.5 + np.pi / 2.0]]))
    assert cond.judge(problem, top.xi1[0], top.xi2[0], np.array([0.1]), Conditions()) == Verdict.NOT_CONVEX
    with pytest.raises(InputError, match="0 as not linear and 1 not convex"):
        candidates(problem, top, Conditions(t1=np.inf))


def test_columns_that_cannot_be_told_apart_are_named():
    t = np.linspace(0.0, 1.0, 50)

    def model(xi2):
        return np.stack([t, 2.0 * t, np.ones(50)], axis=1)[:, None, :], (xi2[0] * t**2)[:, None]

    problem = Problem(t[:, None], model, ("one", "two", "three"), ("b",), FREE * 3, [[-1.0, 1.0]])
    with pytest.raises(InputError, match="do not determine one, two at any of 8 samples"):
        sample_residuals(problem, Prior().samples(problem.bounds2, 8, 0))


def test_samples_where_the_model_has_no_value_are_left_out():
    """sqrt(b) for b < 0, and the whole range there."""
    t = np.linspace(1.0, 2.0, 40)
    z = 3.0 * t**1.5 + 2.0 * np.sqrt(0.5) * t

    def model(xi2):
        return (t**1.5)[:, None, None], (2.0 * np.sqrt(xi2[0]) * t)[:, None]

    problem = Problem(z[:, None], model, ("a",), ("b",), FREE, [[-1.0, 1.0]])
    samples, _, decision = first_stage(problem, np.linspace(-0.95, 0.95, 20)[:, None])
    assert samples.count(Verdict.NOT_FINITE) == 10
    assert decision.minima[0].xi2[0] == pytest.approx(0.5, abs=1e-6)
    with pytest.raises(InputError, match="not finite at any of 5"):
        sample_residuals(problem, np.linspace(-0.9, -0.1, 5)[:, None])


def test_one_clear_minimum():
    _, _, decision = first_stage(wave([0.0, 1.0]), np.linspace(0.0, 1.0, 21)[:, None])
    assert decision.unique and decision.reason.startswith("one clear minimum")
    assert decision.minima[0].xi2[0] == pytest.approx(0.5, abs=0.03)


def test_two_equal_minima_are_both_kept():
    """Half a period on, the amplitude has the other sign."""
    _, _, decision = first_stage(wave([-1.0, 6.0]), np.linspace(-1.0, 6.0, 57)[:, None])
    assert not decision.unique and decision.reason.startswith("2 minima")
    assert abs(decision.minima[0].xi2[0] - decision.minima[1].xi2[0]) == pytest.approx(np.pi, abs=1e-3)


def two_hollows(offset):
    """z = offset + e(b) cos(eta) + v."""
    z = offset + np.random.default_rng(0).normal(0.0, 0.05, (100, 1))

    def model(xi2):
        e = 0.3 * xi2[0] * ((xi2[0] - 2.5) ** 2 + 0.2)
        return np.ones((100, 1, 1)), e * np.cos(ETA)[:, None]

    return Problem(z, model, ("c",), ("b",), FREE, [[-1.0, 3.0]])


def test_a_lower_minimum_beside_a_higher_one_is_unique():
    """The residual is e(b) cos(eta): e crosses zero at 0 and comes near to it again at 2.46."""
    _, chosen, decision = first_stage(two_hollows(1.0), np.linspace(-1.0, 3.0, 41)[:, None])
    assert len(chosen) == 2
    assert decision.unique and decision.minima[0].xi2[0] == pytest.approx(0.0, abs=0.02)


def test_one_start_is_no_hollow_of_samples():
    problem = two_hollows(1.0)
    decision = decide(problem, sample_residuals(problem, np.array([[0.1]])), [0])
    assert decision.unique and "it was followed from one start" in decision.reason and "e+" not in decision.reason


def test_a_rejected_sample_that_is_lower_than_all_others_is_followed_too():
    """Without the offset z is small there, and (17) rejects the sample beside the right minimum."""
    samples, chosen, decision = first_stage(two_hollows(0.0), np.linspace(-1.0, 3.0, 41)[:, None])
    assert samples.verdict[10] == Verdict.NOT_LINEAR and 10 not in chosen
    assert decision.minima[0].xi2[0] == pytest.approx(0.0, abs=0.02)
    assert "rejected" in decision.reason


def test_a_flat_direction_is_named():
    problem = five_hole_like(500, TRUTH)
    narrow = BOUNDS2 * [[1.0], [1.0], [1.0], [0.02], [1.0]] - np.array([[0.0], [0.0], [0.0], [0.02], [0.0]])
    _, _, decision = first_stage(replace(problem, bounds2=narrow), Prior().samples(narrow, 64, 0))
    assert not decision.unique
    assert "flat" in decision.reason and "offset_beta" in decision.reason


@pytest.mark.parametrize(
    ("bounds2", "bounds1", "name"), [([0.6, 1.0], FREE, "phase"), ([0.0, 1.0], [[-1.0, 1.0]], "amplitude")]
)
def test_a_minimum_at_a_bound_needs_all_unknowns(bounds2, bounds1, name):
    problem = wave(bounds2, bounds1=bounds1)
    _, _, decision = first_stage(problem, np.linspace(*bounds2, 21)[:, None], Conditions(curvature="none"))
    assert not decision.unique
    assert f"bounds of {name}" in decision.reason
