"""Standard errors with residuals that are correlated, and parameters that a flight does not excite."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.calibration.procedure import Task, reduced_problem, solve
from aircraft_sysid_ros.calibration.report import _no_answers
from aircraft_sysid_ros.calibration.standard_errors import (
    AttitudeErrors,
    jackknife,
    standard_errors,
    window_length,
)
from aircraft_sysid_ros.estimation.two_stage.covariance import separated
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

N = 600


def straight_line(noise):
    """z = xi1 x + xi2 + v, x slow: the plainest problem with an answer by hand."""
    x = np.sin(np.linspace(0.0, 6.0, N))
    model = lambda xi2: (x[:, None, None], np.full((N, 1), xi2[0]))  # noqa: E731
    return Problem((0.5 * x + 0.2 + noise)[:, None], model, ("a",), ("b",), np.array([[-2.0, 2.0]]),
                   np.array([[-2.0, 2.0]]))  # fmt: skip


def coloured(rng, r=0.9):
    out = np.zeros(N)
    for i in range(1, N):
        out[i] = r * out[i - 1] + 0.1 * rng.standard_normal()
    return out


@pytest.mark.long
@pytest.mark.parametrize("by_piece", [False, True])
def test_coloured_residuals_are_counted(by_piece):
    """300 seeds: the spread of the estimates is that which the standard errors say, and white ones are far below."""
    rng, piece = np.random.default_rng(0), np.arange(N) // 50
    found = []
    for _ in range(300):
        problem = straight_line(coloured(rng))
        x = problem.evaluate(np.zeros(1))[0][:, 0, 0]
        a, b = np.linalg.lstsq(np.column_stack([x, np.ones(N)]), problem.measured[:, 0])[0]
        noise = np.array([np.mean((problem.measured[:, 0] - a * x - b) ** 2)])
        every, zero = np.ones(2, dtype=bool), np.zeros(N, dtype=np.int64)
        made = (
            jackknife(problem, np.array([a]), np.array([b]), noise, piece, every)
            if by_piece
            else standard_errors(problem, np.array([a]), np.array([b]), noise, zero, every)
        )
        found.append([a - 0.5, b - 0.2, *made.std, *np.sqrt(np.diag(made.white))])
    rows = np.array(found)
    ratio = rows[:, :2].std(axis=0) / np.sqrt(np.mean(rows[:, 2:4] ** 2, axis=0))
    assert np.all(ratio > 0.75) and np.all(ratio < 1.25)
    assert np.all(rows[:, :2].std(axis=0) > 2.0 * np.median(rows[:, 4:], axis=0))


@pytest.mark.long
@pytest.mark.parametrize("by_piece", [False, True])
@pytest.mark.parametrize("by_instruments", [False, True])
def test_what_is_taken_as_nominal_is_in_the_errors_of_the_others(by_piece, by_instruments):
    """200 seeds: a bias that no flight is fitted for lies somewhere about zero, and moves the scale beside it."""
    rng, usual = np.random.default_rng(7), 0.3
    x, free = np.sin(np.linspace(0.0, 6.0, N)), np.array([True, False, True])
    a = np.stack([x, x**2 + 0.5 * x], axis=1)[:, None, :]
    slopes = np.concatenate([a, np.ones((N, 1, 1))], axis=2)
    left = slopes[:, 0, free]
    found = []
    for _ in range(200):
        shown = 0.5 * x + a[:, 0, 1] * usual * rng.standard_normal() + 0.2 + 0.01 * rng.standard_normal(N)
        problem = Problem(shown[:, None], lambda xi2: (a, np.full((N, 1), xi2[0])), ("a", "c"), ("b",),
                          np.array([[-2.0, 2.0]] * 2), np.array([[-2.0, 2.0]]))  # fmt: skip
        task = Task(problem, np.arange(N) // 50, np.zeros(3), by_piece=by_piece, usual=np.array([0.0, usual, 0.0]),
                    instruments=(lambda xi: slopes) if by_instruments else None)  # fmt: skip
        at = np.zeros(3)
        at[free] = np.linalg.lstsq(left, shown)[0]
        noise = np.array([np.mean((shown - left @ at[free]) ** 2)])
        errors = task.errors(at, noise, free)
        known = replace(task, usual=None).errors(at, noise, free)
        assert errors.std[1] == 0.0 and np.all(errors.std >= known.std)
        found.append([at[0] - 0.5, at[2] - 0.2, *errors.std[free]])
    rows = np.array(found)
    ratio = rows[:, :2].std(axis=0) / np.sqrt(np.mean(rows[:, 2:] ** 2, axis=0))
    assert np.all(ratio > 0.75) and np.all(ratio < 1.15), ratio


def test_few_pieces_are_not_believed():
    """Three say nothing, four whatever they agree on no more than white residuals; the t factor is (G - 1)/(G - 3)."""
    problem, every = straight_line(0.01 * np.random.default_rng(4).standard_normal(N)), np.ones(2, dtype=bool)
    of = lambda pieces: jackknife(problem, np.array([0.5]), np.array([0.2]), np.array([1e-4]),  # noqa: E731
                                  np.arange(N) * pieces // N, every)  # fmt: skip
    assert np.all(np.isinf(of(3).std))
    for pieces in (4, 5, 20):
        made = of(pieces)
        assert np.all(made.std >= np.sqrt(np.diag(made.white)) * (1.0 - 1e-9)) and np.all(np.isfinite(made.std))


def test_window_grows_with_the_correlation_and_stays_in_its_piece():
    rng = np.random.default_rng(1)
    piece = np.zeros(N, dtype=np.int64)
    assert window_length(rng.standard_normal((N, 1)), piece) < 8 < window_length(coloured(rng)[:, None], piece)
    rows = separated(np.ones((4, 1)), np.array([0, 0, 1, 1]), 3)
    np.testing.assert_array_equal(rows[:, 0], [1, 1, 0, 0, 0, 1, 1])


def test_a_constant_error_of_the_attitude_is_not_averaged_away():
    """An error that lasts longer than the flight moves b by its own size, whatever the number of samples."""
    time = np.linspace(0.0, 1e-3, N)
    errors = AttitudeErrors(time, np.full((N, 3), [0.01, 0.0, 0.0]), np.ones((N, 1, 3)))
    covariance = errors.covariance(np.ones((N, 1, 1)), np.ones(1), np.array([[1.0 / N]]))
    np.testing.assert_allclose(np.sqrt(covariance[0, 0]), 0.01, rtol=1e-3)


def test_what_is_not_excited_is_nominal_and_the_rest_is_found():
    answer = solve(Task(two_biases(), np.zeros(N, dtype=np.int64), np.zeros(3)), 64)
    assert answer.determined.tolist() == [True, True, False]
    assert answer.values["c"] == 0.0 and np.isinf(answer.std[2])
    assert abs(answer.values["b"] - 0.2) < 4.0 * answer.std[1]
    (row,) = answer.parameters(("c",), {}, {"c": "circles"})
    assert "not excited" in row["reason"] and "circles" in row["reason"]


def test_the_last_of_a_set_is_not_an_answer_where_the_flight_does_not_tell_it():
    """Both stages need an unknown of each set, however little is known of it."""
    noise = 40.0 * np.random.default_rng(4).standard_normal(N)
    answer = solve(Task(straight_line(noise), np.zeros(N, dtype=np.int64), np.zeros(2)), 16)
    assert answer.vague == ("a", "b")
    told = answer.without(_no_answers(answer))
    assert not told.determined.any() and np.all(told.xi == 0.0)
    (row,) = told.parameters(("b",), {}, {"b": "circles"})
    assert "not excited" in row["reason"] and not row["determined"]


def two_biases():
    """Two parameters, b and c, that do almost the same."""
    x = np.linspace(-1.0, 1.0, N)
    noise = 0.05 * np.random.default_rng(3).standard_normal(N)
    model = lambda xi2: (x[:, None, None], (xi2[0] + (1.0 + 1e-3 * x**2) * xi2[1])[:, None])  # noqa: E731
    return Problem((0.5 * x + 0.2 + noise)[:, None], model, ("a",), ("b", "c"), np.array([[-2.0, 2.0]]),
                   np.array([[-2.0, 2.0], [-0.5, 0.5]]))  # fmt: skip


@pytest.mark.long
def test_the_reduced_problem_is_the_same_at_the_nominal_values(probe_made):
    problem = probe_made.data.problem()
    free = np.ones(10, dtype=bool)
    free[[1, 8]] = False
    xi = np.array([0.1, -0.7, 3.0, 1.0, 0.2, 0.05, 0.01, -0.1, 0.02, 0.1])
    reduced = reduced_problem(problem, xi, free)
    a, b = problem.evaluate(xi[5:])
    c, d = reduced.evaluate(xi[5:][free[5:]])
    np.testing.assert_allclose(a @ xi[:5] + b, c @ xi[:5][free[:5]] + d, atol=1e-12)
    reduced.check_gradient(xi[5:][free[5:]])
