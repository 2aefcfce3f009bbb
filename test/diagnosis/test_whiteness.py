"""The test of whiteness: its false alarms, and what it must see."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz

from aircraft_sysid_ros.diagnosis.significance.noise_floor import NoiseFloor, Source, window_weights
from aircraft_sysid_ros.diagnosis.significance.whiteness import LAGS, ORDER, on_grid, prediction, whiteness_of

INTERVAL, STEP, EVERY = 0.01, 0.04, 4


def windowed(random: np.random.Generator, points: int, kept: float = 0.0) -> np.ndarray:
    """Noise at 100 Hz that keeps a share per sample, as points at 25 Hz through the windows of the regression."""
    weights, _ = window_weights(INTERVAL)
    noise = random.normal(size=4 * points + len(weights) + 2000)
    if kept:
        for i in range(1, len(noise)):
            noise[i] += kept * noise[i - 1]
        noise = noise[2000:]
    return np.convolve(noise, weights, "valid")[::4][:points]


def known_correlation(kept: float = 0.0) -> np.ndarray:
    source = Source(np.ones(1), INTERVAL, correlation=kept)
    return NoiseFloor((source,), (), np.zeros((1, 0)), 1.0, STEP).correlation(ORDER, EVERY)


@pytest.mark.long
@pytest.mark.parametrize("points", [500, 3000])
def test_false_alarms_on_white_noise_through_the_windows(points: int) -> None:
    """5 % in 2000 flights; the bounds are 4 standard errors of the count."""
    random, known = np.random.default_rng(points), known_correlation()
    n = points // EVERY
    p = [whiteness_of(windowed(random, points)[::EVERY], np.ones(n), known).p_value for _ in range(2000)]
    assert 0.03 <= np.mean(np.array(p) < 0.05) <= 0.07


@pytest.mark.long
def test_false_alarms_with_the_slow_error_of_a_filter_and_with_gaps() -> None:
    random, kept, false = np.random.default_rng(1), 0.96, []
    known = known_correlation(kept)
    for _ in range(300):
        z = windowed(random, 2000, kept)[::EVERY]
        z[100:130] = np.nan
        false.append(whiteness_of(z, np.ones(len(z)), known).white is False)
    assert 0.02 <= np.mean(false) <= 0.09


def test_neighbouring_windows_are_not_taken_for_white() -> None:
    """Every point instead of every fourth: overlapping windows would always be called coloured."""
    z = windowed(np.random.default_rng(2), 3000)
    no_correlation = np.eye(1, ORDER + 1)[0]
    assert whiteness_of(z, np.ones(len(z)), no_correlation).p_value < 1e-6


def test_a_small_slow_term_is_seen() -> None:
    """A tenth of the variance that the model lacks, in flights of two minutes: mostly."""
    random, seen = np.random.default_rng(3), []
    for _ in range(40):
        z = windowed(random, 3000)
        z += 0.45 * np.std(z) * np.sin(0.8 * STEP * np.arange(3000))
        seen.append(whiteness_of(z[::EVERY], np.ones(750), known_correlation()).white is False)
    assert np.mean(seen) > 0.8


@pytest.mark.long
def test_a_noise_that_changes_its_size_is_white() -> None:
    random, z = np.random.default_rng(4), []
    for _ in range(200):
        std = np.where(np.arange(750) < 200, 10.0, 1.0)
        z.append(whiteness_of(std * windowed(random, 3000)[::EVERY], std, known_correlation()).white)
    assert np.mean(z) > 0.9


def test_too_short_says_nothing() -> None:
    result = whiteness_of(np.ones(30), np.ones(30), known_correlation())
    assert result.white is None and np.isnan(result.correlation).all() and len(result.correlation) == LAGS


def test_prediction_solves_the_normal_equations() -> None:
    correlation = 0.9 ** np.arange(9) * np.cos(0.4 * np.arange(9))
    coefficients, left = prediction(correlation)
    assert np.allclose(coefficients, solve_toeplitz(correlation[:-1], correlation[1:]))
    assert left == pytest.approx(1.0 - coefficients @ correlation[1:])


def test_grid_has_holes_where_there_are_no_points() -> None:
    time = np.array([0.0, 0.04, 0.08, 0.2])
    assert np.array_equal(on_grid(time, np.arange(4.0), STEP, 1), [0, 1, 2, np.nan, np.nan, 3], equal_nan=True)
