"""Prior samples of the two-stage estimator."""

import numpy as np
import pytest
from scipy.stats import kstest, norm, qmc

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.sampling import Prior

BOUNDS = np.array([[-1.0, 3.0], [0.0, 0.5], [10.0, 20.0]])
NORMAL = Prior("normal", np.array([0.0, 0.25, 15.0]), np.array([1.0, 0.5, 0.1]))
PRIORS = [Prior("sobol"), Prior("uniform"), Prior("grid"), NORMAL]


@pytest.mark.parametrize("prior", PRIORS, ids=lambda p: p.kind)
@pytest.mark.parametrize("count", [64, 100])
def test_samples_are_inside_the_bounds_and_follow_the_seed(prior, count):
    samples = prior.samples(BOUNDS, count, seed=3)
    assert samples.shape == (64 if prior.kind == "grid" else count, 3)
    assert np.all((samples >= BOUNDS[:, 0]) & (samples <= BOUNDS[:, 1]))
    np.testing.assert_array_equal(samples, prior.samples(BOUNDS, count, seed=3))
    assert prior.kind == "grid" or not np.array_equal(samples, prior.samples(BOUNDS, count, seed=4))


def test_a_grid_has_the_corners():
    samples = Prior("grid").samples(BOUNDS, 30, 0)
    assert len(samples) == 27
    for corner in np.stack(np.meshgrid(*BOUNDS), axis=-1).reshape(-1, 3):
        assert np.any(np.all(samples == corner, axis=1))


def test_sobol_samples_are_more_even_than_uniform_ones():
    unit = np.array([[0.0, 1.0]] * 5)
    even, random = (qmc.discrepancy(Prior(kind).samples(unit, 512, 1)) for kind in ("sobol", "uniform"))
    assert even < 0.2 * random


def test_normal_samples_are_cut_off_not_heaped_at_the_bounds():
    samples = NORMAL.samples(BOUNDS, 4000, 0)
    low, high = norm.cdf([-1.0, 3.0])
    assert kstest(samples[:, 0], lambda x: (norm.cdf(x) - low) / (high - low)).pvalue > 0.01
    assert len(np.unique(samples[:, 1])) == 4000
    assert np.std(samples[:, 2]) == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize(
    ("prior", "bounds", "count", "words"),
    [
        (Prior("sobol"), [[-np.inf, 1.0]], 10, "finite bounds"),
        (Prior("normal"), [[0.0, 1.0]], 10, "standard deviations"),
        (Prior("normal", np.zeros(1), np.array([-1.0])), [[0.0, 1.0]], 10, "positive"),
        (Prior("grid"), [[0.0, 1.0]] * 5, 20, "at least 32"),
        (Prior("halton"), [[0.0, 1.0]], 10, "no halton"),
        (Prior(), [[0.0, 1.0]], 0, "at least one"),
    ],
)
def test_what_cannot_be_sampled_is_refused(prior, bounds, count, words):
    with pytest.raises(InputError, match=words):
        prior.samples(np.array(bounds), count, 0)
