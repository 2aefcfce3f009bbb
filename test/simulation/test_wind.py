"""Wind: the walk has its intensity, turbulence the variance and correlation that its source states."""

import numpy as np
import pytest

from aircraft_sysid_ros.simulation.wind import (
    FEET,
    VERTICAL_RETURN,
    Turbulence,
    dryden_gusts,
    low_altitude_turbulence,
    random_walk,
    wind_series,
)

AIRSPEED, STEP = 17.0, 0.05
GUSTS = Turbulence((1.5, 1.2, 0.8), (60.0, 50.0, 30.0))


@pytest.fixture(scope="module")
def gusts():
    """Five hours: thousands of correlation times."""
    return dryden_gusts(np.random.default_rng(1), 360_000, STEP, AIRSPEED, GUSTS)


@pytest.mark.long
def test_gusts_have_the_stated_standard_deviation(gusts):
    np.testing.assert_allclose(gusts.std(axis=0), GUSTS.sigma, rtol=0.05)
    np.testing.assert_allclose(gusts.mean(axis=0), 0.0, atol=0.1)


@pytest.mark.long
def test_gusts_begin_in_their_stationary_distribution():
    starts = np.array([dryden_gusts(np.random.default_rng(s), 2, STEP, AIRSPEED, GUSTS)[0] for s in range(1500)])
    np.testing.assert_allclose(starts.std(axis=0), GUSTS.sigma, rtol=0.08)


def test_gusts_have_the_correlation_of_dryden(gusts):
    """exp(-x) along and (1 - x/2) exp(-x) across, x = V t / L: the transforms of the spectra."""
    for axis, length in enumerate(GUSTS.length):
        series = gusts[:, axis]
        for lag in (5, 20, 60, 120):
            x = lag * STEP * AIRSPEED / length
            expected = np.exp(-x) * (1.0 if axis == 0 else 1.0 - 0.5 * x)
            actual = np.mean(series[lag:] * series[:-lag]) / np.mean(series**2)
            assert actual == pytest.approx(expected, abs=0.04)


@pytest.mark.long
def test_gusts_do_not_depend_on_the_step_of_the_simulation():
    """Exact discretisation: sampled ten times as often, differences over a time are as large."""
    fine = dryden_gusts(np.random.default_rng(2), 400_000, 0.005, AIRSPEED, GUSTS)
    coarse = dryden_gusts(np.random.default_rng(3), 400_000, 0.05, AIRSPEED, GUSTS)
    changes = [(fine[10:] - fine[:-10]).std(axis=0), (coarse[1:] - coarse[:-1]).std(axis=0)]
    np.testing.assert_allclose(changes[0], changes[1], rtol=0.05)


def test_axes_of_gusts_are_independent(gusts):
    np.testing.assert_allclose(np.corrcoef(gusts.T), np.eye(3), atol=0.05)


def test_low_altitude_turbulence_meets_the_isotropic_model_at_1000_feet():
    """MIL-F-8785C: there all three intensities are equal, and so are the lengths, which are 1000 ft."""
    found = low_altitude_turbulence(1000.0 * FEET, 20.0)
    np.testing.assert_allclose(found.sigma, 2.0, rtol=1e-3)
    np.testing.assert_allclose(found.length, 1000.0 * FEET, rtol=1e-3)


def test_turbulence_near_the_ground_is_flat_and_short():
    low, high = low_altitude_turbulence(20.0, 10.0), low_altitude_turbulence(200.0, 10.0)
    assert low.sigma[0] > high.sigma[0] > high.sigma[2]
    assert low.sigma[2] == high.sigma[2] == pytest.approx(1.0)
    assert low.length[2] == pytest.approx(20.0)
    assert low_altitude_turbulence(0.0, 10.0) == low_altitude_turbulence(10.0 * FEET, 10.0)


@pytest.mark.long
def test_the_walk_grows_with_the_root_of_time_and_returns_downwards():
    ends = np.array([random_walk(np.random.default_rng(s), 2401, 0.1, 0.1)[[600, 2400]] for s in range(800)])
    np.testing.assert_allclose(ends[:, 0, :2].std(axis=0), 0.1 * np.sqrt(60.0), rtol=0.08)
    np.testing.assert_allclose(ends[:, 1, :2].std(axis=0), 0.1 * np.sqrt(240.0), rtol=0.08)
    steady = 0.1 * np.sqrt(0.5 * VERTICAL_RETURN)
    assert ends[:, 1, 2].std() == pytest.approx(steady, rel=0.08)


def test_walk_begins_at_the_mean_wind():
    wind = wind_series(np.random.default_rng(0), 10, 0.1, (3.0, -2.0, 0.5), 0.1, AIRSPEED, None)
    np.testing.assert_array_equal(wind[0], [3.0, -2.0, 0.5])


def test_gusts_are_aligned_with_the_mean_wind():
    """Wind to the east: the long gusts are east-west and the difference between u and v shows."""
    uneven = Turbulence((2.0, 0.5, 0.1), (50.0, 50.0, 50.0))
    wind = wind_series(np.random.default_rng(4), 100_000, STEP, (0.0, 5.0, 0.0), 0.0, AIRSPEED, uneven)
    np.testing.assert_allclose(wind.std(axis=0), [0.5, 2.0, 0.1], rtol=0.1)
    np.testing.assert_allclose(wind.mean(axis=0), [0.0, 5.0, 0.0], atol=0.15)
