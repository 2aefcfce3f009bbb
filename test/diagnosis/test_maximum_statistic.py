"""The p-value of a whole search, by count of flights in which nothing is missing, whatever scores look like."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from aircraft_sysid_ros.diagnosis.significance.maximum_statistic import Null

FAMILIES, REPLICAS = 36, 10


def normal(random):
    return np.abs(random.normal(0.0, 0.02, (FAMILIES, REPLICAS + 1)))


def skewed(random):
    """Many zeros and a long tail: what a search that keeps the best finds in noise."""
    return np.maximum(random.gamma(0.7, 0.03, (FAMILIES, REPLICAS + 1)) - 0.01, 0.0)


def heavy(random):
    return np.maximum(0.02 * random.standard_t(4, (FAMILIES, REPLICAS + 1)), 0.0)


def alike(random):
    """Families of many sizes, which rise and fall together."""
    usual = random.uniform(0.005, 0.05, (FAMILIES, 1)) * np.exp(0.3 * random.normal(size=(1, REPLICAS + 1)))
    return usual * random.gamma(2.0, 0.5, (FAMILIES, REPLICAS + 1))


def null_of(scores):
    return Null({str(i): row[1:] for i, row in enumerate(scores)})


def smallest(scores):
    """The p-value of a flight whose scores are the first column."""
    null = null_of(scores)
    return min(null.test(str(i), own[0])[2] for i, own in enumerate(scores))


@pytest.mark.long
@pytest.mark.parametrize("draw", [normal, skewed, heavy, alike])
def test_of_flights_in_which_nothing_is_missing_few_are_significant(draw: Callable) -> None:
    random = np.random.default_rng(5)
    found = np.array([smallest(draw(random)) for _ in range(250)])
    assert np.mean(found < 0.05) < 0.10
    assert np.mean(found < 0.01) < 0.03


@pytest.mark.long
@pytest.mark.parametrize("draw", [normal, skewed, heavy, alike])
def test_what_is_far_beyond_the_replicas_is_significant(draw: Callable) -> None:
    random, sure = np.random.default_rng(6), 0
    for _ in range(50):
        scores = draw(random)
        scores[3, 0] = 1.0
        sure += smallest(scores) < 0.01
    assert sure > 45


def test_what_a_replica_shows_as_well_is_no_less_probable_than_that() -> None:
    """One of ten replicas has more in some effect than the flight in another: that is chance in 2 of 11 flights."""
    scores = normal(np.random.default_rng(8))
    scores[3, 0] = 0.25
    alone = smallest(scores)
    scores[5, 4] = 0.3
    assert alone < 0.01 and smallest(scores) == pytest.approx(2.0 / (REPLICAS + 1))


def related(random):
    """Squares of what has a few causes in common."""
    causes = random.normal(size=(FAMILIES, 8))
    scores = causes @ random.normal(size=(8, 2 * REPLICAS + 1))
    return 0.005 * (scores / np.linalg.norm(causes, axis=1)[:, None]) ** 2


def test_of_related_scores_5_percent_are_below_5_percent() -> None:
    random = np.random.default_rng(9)
    found = np.array([smallest(related(random)) for _ in range(150)])
    assert np.mean(found < 0.05) < 0.08  # 0.12 without the count


def test_few_replicas_never_make_as_sure_as_many() -> None:
    scores = normal(np.random.default_rng(7))
    scores[3, 0] = 0.3
    assert smallest(scores[:, :4]) > smallest(scores[:, :6]) > smallest(scores)


def test_an_effect_whose_signals_are_not_measured_does_not_silence_the_others() -> None:
    null = Null({"flaps": np.full(3, np.nan), "dihedral": np.array([0.01, 0.02, 0.0])})
    _, evidence, p_value = null.test("dihedral", 3.0)
    assert evidence > 10.0 and p_value < 0.05
    assert null.test("flaps", 3.0)[2] == 1.0
    assert Null({}).test("flaps", 3.0)[2] == 1.0
