"""Means and slopes over a window: both sides of dw/dt = y are treated alike, whatever the frequency."""

from itertools import pairwise

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.window_average import window_average


def averages(times, columns, center, half_width, sparse=False):
    """Means and slopes of columns (n, m) by the rows that just span the window."""
    first = int(np.searchsorted(times, center - half_width, side="right")) - 1
    last = int(np.searchsorted(times, center + half_width))
    means, slopes = (
        np.full(columns.shape[1], 7.0),
        np.full(columns.shape[1], 7.0),
    )  # what was there is replaced
    window_average(np.ascontiguousarray(times), columns, first, last, center, half_width, means, slopes, sparse)
    return means, slopes


def sample_times(kind):
    times = np.arange(0.0, 2.0, 0.01)
    if kind == "jittered":
        times = times + np.random.default_rng(0).uniform(-0.004, 0.004, len(times))
    if kind == "with a gap":
        times = np.delete(times, [96, 97])
    return times


TIMES = pytest.mark.parametrize("kind", ["even", "jittered", "with a gap"])
WINDOWS = pytest.mark.parametrize(("center", "half_width"), [(1.0, 0.08), (0.9937, 0.08), (1.003, 0.03), (0.8, 0.5)])


@TIMES
@WINDOWS
def test_a_constant_is_its_own_mean_and_has_no_slope(kind, center, half_width):
    times = sample_times(kind)
    means, slopes = averages(times, np.full((len(times), 2), [3.0, -1e6]), center, half_width)
    np.testing.assert_allclose(means, [3.0, -1e6], rtol=1e-14)  # the weights sum to one
    assert slopes.tolist() == [0.0, 0.0]


@TIMES
@WINDOWS
def test_the_slope_of_a_straight_line_is_exact(kind, center, half_width):
    times = sample_times(kind)
    _, slopes = averages(times, (5.0 - 2.5 * times)[:, None], center, half_width)
    assert slopes[0] == pytest.approx(-2.5, rel=1e-11)


@pytest.mark.parametrize("half_width", [0.04, 0.08, 0.5])
def test_the_mean_of_a_straight_line_on_even_samples_about_the_center_is_exact(half_width):
    times = 1.0 + 0.01 * np.arange(-60.0, 61.0)
    means, _ = averages(times, (5.0 - 2.5 * times)[:, None], 1.0, half_width)
    assert means[0] == pytest.approx(2.5, rel=1e-13)


@TIMES
@WINDOWS
@pytest.mark.parametrize("frequency", [0.3, 1.0, 3.0, 8.0])
def test_the_mean_of_a_derivative_is_the_slope_of_its_signal(kind, center, half_width, frequency):
    times, omega = sample_times(kind), 2.0 * np.pi * frequency
    w, y = np.sin(omega * times + 0.4), omega * np.cos(omega * times + 0.4)
    means, slopes = averages(times, np.column_stack([w, y]), center, half_width)
    # Between two samples the slope of w is the mean of y, for which the trapezoidal rule errs by at most
    # dt^2 / 12 max|y''|; a weighted mean of such errors with weights that sum to one is no larger.
    near = (times > center - half_width - 0.04) & (times < center + half_width + 0.04)
    bound = np.diff(times[near]).max() ** 2 / 12.0 * omega**3
    assert abs(means[1] - slopes[0]) <= bound * (1.0 + 1e-9) + 1e-12
    if kind == "even" and frequency == 8.0 and half_width == 0.08:
        pointwise = np.abs(y - np.gradient(w, times))[near].max()  # what differences at a point would err by
        assert pointwise > 1.5 * bound > 0.0


def test_the_error_falls_with_the_square_of_the_sample_time():
    errors = []
    for step in (0.02, 0.01, 0.005):
        times = np.arange(0.0, 2.0, step)
        w, y = np.sin(20.0 * times), 20.0 * np.cos(20.0 * times)
        means, slopes = averages(times, np.column_stack([w, y]), 1.0, 0.08)
        errors.append(abs(means[1] - slopes[0]))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.15)


def test_an_equation_linear_in_its_signals_holds_for_the_means_of_a_mix_of_frequencies():
    rng = np.random.default_rng(1)
    times = sample_times("jittered")
    w, y = np.zeros(len(times)), np.zeros(len(times))
    bound = 0.0
    for frequency in (0.5, 1.7, 4.1, 7.9):
        omega, phase, size = 2.0 * np.pi * frequency, rng.uniform(0.0, 6.0), rng.uniform(0.2, 1.0)
        w += size * np.sin(omega * times + phase)
        y += size * omega * np.cos(omega * times + phase)
        bound += np.diff(times).max() ** 2 / 12.0 * size * omega**3
    for center in np.arange(0.3, 1.7, 0.04):
        means, slopes = averages(times, np.column_stack([w, y]), center, 0.08)
        assert abs(means[1] - slopes[0]) <= bound


def test_the_slope_is_that_of_the_least_squares_line_when_samples_are_dense():
    times = np.linspace(0.9, 1.1, 4001)
    w = np.exp(3.0 * times)
    _, slopes = averages(times, w[:, None], 1.0, 0.08)
    inside = np.abs(times - 1.0) <= 0.08
    assert slopes[0] == pytest.approx(
        np.polyfit(times[inside], w[inside], 1)[0], rel=2e-4
    )  # to a sample over the window
    means, _ = averages(times, w[:, None], 1.0, 0.08)
    tau = np.linspace(-0.08, 0.08, 20001)
    window = 3.0 * (0.08**2 - tau**2) / (4.0 * 0.08**3)
    assert means[0] == pytest.approx(np.trapezoid(window * np.exp(3.0 * (1.0 + tau)), tau), rel=1e-6)


# -- samples that are not dense ---------------------------------------------------------------------------------


@TIMES
@WINDOWS
def test_sparse_means_and_slopes_are_exact_integrals_of_the_straight_lines(kind, center, half_width):
    times = sample_times(kind)[::3]
    values = np.random.default_rng(3).normal(size=len(times))
    means, slopes = averages(times, values[:, None], center, half_width, sparse=True)
    tau, weights = np.polynomial.legendre.leggauss(4)
    mean = slope = 0.0
    edges = np.unique(np.clip(times, center - half_width, center + half_width))
    for a, b in pairwise(edges):
        at = 0.5 * (a + b) + 0.5 * (b - a) * tau
        window = 0.75 * (half_width**2 - (at - center) ** 2) / half_width**3
        shares = 0.5 * (b - a) * weights * window
        mean += shares @ np.interp(at, times, values)
        slope += shares.sum() * (np.interp(b, times, values) - np.interp(a, times, values)) / (b - a)
    assert means[0] == pytest.approx(mean, abs=1e-12)
    assert slopes[0] == pytest.approx(slope, rel=1e-9)


def derivative_of_means(step, frequency, sparse, half_width=0.08):
    """Slope of a sine over the mean of its derivative, by least squares over many windows and phases."""
    times, omega = step * np.arange(2000), 2.0 * np.pi * frequency
    columns = np.column_stack([np.sin(omega * times), omega * np.cos(omega * times)])
    windows = [averages(times, columns, center, half_width, sparse) for center in np.arange(1.0, 60.0, 0.0371)]
    found = np.array([[means[1], slopes[0]] for means, slopes in windows])
    return float(found[:, 0] @ found[:, 1] / (found[:, 0] @ found[:, 0]))


@pytest.mark.parametrize("step", [0.04, 0.08, 0.1])
@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0])
def test_sparse_samples_bias_no_derivative(step, frequency):
    x = np.pi * frequency * step
    too_large = np.tan(x) / x - 1.0
    assert derivative_of_means(step, frequency, sparse=False) == pytest.approx(1.0 + too_large, rel=0.02)
    assert derivative_of_means(step, frequency, sparse=True) == pytest.approx(1.0, abs=0.1 * too_large + 1e-3)
