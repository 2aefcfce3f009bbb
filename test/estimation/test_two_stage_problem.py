"""Problems of the two-stage estimator: what is refused, rows that are left out, derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from five_hole_like import BOUNDS2, five_hole_like

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.estimate import estimate
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

TRUTH = np.array([-0.17, 2.0, -5.0, 4.0, -0.7, 0.3, -0.04, -0.25, -0.02, -0.13])


def line(measured, **changes):
    """z = xi1 t + xi2 t^2."""
    t = np.arange(len(measured)) / 10.0

    def model(xi2):
        return t[:, None, None], (xi2[0] * t**2)[:, None]

    fields = {"bounds1": [[-5.0, 5.0]], "bounds2": [[-5.0, 5.0]], **changes}
    return Problem(np.asarray(measured, dtype=float)[:, None], model, ("a",), ("b",), **fields)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: line([1.0, 2.0]), "record longer"),
        (lambda: line([1.0, np.nan, 2.0, 3.0]), "not finite"),
        (lambda: line(np.ones(9), bounds2=[[1.0, -1.0]]), "bounds of b"),
        (lambda: line(np.ones(9), bounds1=[[1.0, 1.0]]), "bounds of a"),
        (lambda: line(np.ones(9), bounds1=[[1.0, 2.0], [0.0, 1.0]]), "shape"),
        (lambda: line(np.ones(9), usable=np.ones(3, bool)), "one entry"),
        (lambda: replace(line(np.ones(9)), names1=(), bounds1=np.empty((0, 2))), "at least one"),
        (lambda: line(np.ones(9)).__class__(np.ones(9), None, ("a",), ("b",), [[0, 1]], [[0, 1]]), "array"),
        (lambda: replace(line(np.ones(9)), names1=("a", "c"), bounds1=np.ones((2, 2)) * [0, 1]).evaluate(np.zeros(1)),
         "the model gives"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_a_sentence(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_rows_that_are_not_usable_may_hold_anything():
    problem = five_hole_like(400, TRUTH)
    usable = np.arange(400) % 3 > 0
    holes = np.where(usable[:, None], problem.measured, np.nan)

    def model(xi2):
        a, b = problem.model(xi2)
        return np.where(usable[:, None, None], a, np.nan), np.where(usable[:, None], b, np.nan)

    found = estimate(replace(problem, measured=holes, model=model, usable=usable), 40)
    short = five_hole_like(400, TRUTH)
    cut = Problem(
        short.measured[usable], lambda x: tuple(part[usable] for part in short.model(x)), short.names1, short.names2,
        short.bounds1, short.bounds2, lambda x: tuple(part[usable] for part in short.gradient(x)),
    )  # fmt: skip
    np.testing.assert_array_equal(found.xi, estimate(cut, 40).xi)


@pytest.mark.parametrize("corner", ["inside", "lower", "upper"])
def test_differences_agree_with_the_gradient_and_stay_inside_the_bounds(corner):
    exact = five_hole_like(50, TRUTH)
    xi2 = {"inside": TRUTH[5:], "lower": BOUNDS2[:, 0], "upper": BOUNDS2[:, 1]}[corner]

    def guarded(x):
        assert np.all((x >= BOUNDS2[:, 0]) & (x <= BOUNDS2[:, 1]))
        return exact.model(x)

    differenced = replace(exact, model=guarded, gradient=None)
    for one, other in zip(exact.derivatives(xi2), differenced.derivatives(xi2), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7)
    np.testing.assert_allclose(exact.slopes(TRUTH[:5], xi2), differenced.slopes(TRUTH[:5], xi2), atol=1e-7)
    exact.check_gradient(xi2)


def test_a_wrong_gradient_is_found():
    problem = five_hole_like(50, TRUTH)

    def wrong(xi2):
        da, db = problem.gradient(xi2)
        return da, db * [1.0, 1.0, 1.0, 1.01, 1.0]

    with pytest.raises(InputError, match="offset_beta disagrees"):
        estimate(replace(problem, gradient=wrong), 20)
    with pytest.raises(InputError, match="the gradient gives"):
        replace(problem, gradient=lambda xi2: (problem.gradient(xi2)[0], np.zeros((50, 3)))).check_gradient(TRUTH[5:])


def test_rounding_of_large_values_is_no_wrong_gradient():
    """A column of 1e5 that does not depend on xi2: its differences are not zero, its gradient is."""
    t = np.linspace(1.0, 2.0, 30)

    def model(xi2):
        return np.stack([1e5 * t + 1e5 * xi2[0] - 1e5 * xi2[0], t**2], axis=1)[:, None, :], (xi2[0] * t)[:, None]

    problem = Problem(
        t[:, None], model, ("a", "c"), ("b",), [[-1, 1]] * 2, [[-1, 1]],
        lambda xi2: (np.zeros((30, 1, 2, 1)), t[:, None, None]),
    )  # fmt: skip
    problem.check_gradient(np.array([0.3]))
