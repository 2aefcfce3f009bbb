"""Drift and jumps of known size in tables that are drawn, and silence where nothing changes."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.fleet.changes import DRIFT, JUMP, Mean, Series, change_of, difference, mean_of, named

FLIGHTS = 24


def series(rng, drift=0.0, jump=0.0, at=FLIGHTS, flights=FLIGHTS, airspeed=None):
    """Standard errors of very different size, and a spread between flights of half of them."""
    std = np.exp(rng.normal(0.0, 0.4, flights))
    number = np.arange(flights)
    value = rng.normal(size=flights) * std + rng.normal(0.0, 0.5, flights) + drift * number + jump * (number >= at)
    return Series(number, value - 4.0, std, np.full(flights, 20.0) if airspeed is None else airspeed)


@pytest.mark.long
def test_healthy_airframes_are_left_alone():
    """A fleet of 40 healthy series is one false alarm in at most 1 of 20 fleets; these rules are stricter."""
    rng = np.random.default_rng(90)
    alarms = sum(named([change_of(series(rng)).p_value for _ in range(40)]).any() for _ in range(8))
    assert alarms <= 1


def test_a_drift_is_found_with_its_rate():
    rng = np.random.default_rng(91)
    found = [change_of(series(rng, drift=0.35)) for _ in range(20)]
    assert all(c.p_value < 1e-3 for c in found)
    assert sum(c.kind == DRIFT and c.number == 0 for c in found) >= 18
    assert sum(abs(c.size - 0.35) < 2.0 * c.std for c in found if c.kind == DRIFT) >= 16


def test_a_jump_is_found_with_its_date():
    rng = np.random.default_rng(92)
    dates = rng.integers(4, FLIGHTS - 4, 20)
    found = [change_of(series(rng, jump=7.0, at=at)) for at in dates]
    assert all(c.p_value < 1e-3 and c.kind == JUMP for c in found)
    assert all(abs(c.number - at) <= 1 for c, at in zip(found, dates, strict=True))
    assert sum(abs(c.size - 7.0) < 2.0 * c.std for c in found) >= 17


@pytest.mark.parametrize("place", [0, 1, -2, -1])
@pytest.mark.parametrize("off", [10.0, 30.0])
def test_one_bad_flight_is_no_jump(place, off):
    """Two flights lie on either side of a jump, but one of them alone had named it: of 50 flights with the last one
    far off, a jump from the last but one with p = 4e-6.
    """
    rng = np.random.default_rng([95, place % 50, int(off)])
    for _ in range(10):
        healthy = series(rng, flights=50)
        healthy.value[place] += off * healthy.std[place]
        assert change_of(healthy).p_value > 1e-3


@pytest.mark.parametrize("at", [2, 48])
def test_a_jump_that_two_flights_show_is_found(at):
    rng = np.random.default_rng([96, at])
    found = [change_of(series(rng, jump=15.0, at=at, flights=50)) for _ in range(10)]
    assert all(c.p_value < 1e-3 and c.kind == JUMP and c.number == at for c in found)


def test_faster_flights_are_no_drift():
    """The parameter depends on airspeed, which rises from flight to flight: that is no change of the aeroplane."""
    rng = np.random.default_rng(93)
    for _ in range(5):
        airspeed = np.linspace(18.0, 26.0, FLIGHTS) * (1.0 + 0.02 * rng.normal(size=FLIGHTS))
        made = series(rng, airspeed=airspeed)
        tilted = Series(made.number, made.value + 40.0 * (airspeed / 22.0 - 1.0), made.std, airspeed)
        assert change_of(tilted).p_value > 0.01
        alone = Series(tilted.number, tilted.value, tilted.std, np.full(FLIGHTS, 22.0))
        assert change_of(alone).p_value < 1e-3


@pytest.mark.parametrize("flights", range(6, 10))
def test_of_a_few_flights_faster_ones_are_no_change(flights):
    """Airspeed counted from ten flights on: of eight that flew faster and faster three in four seemed to change."""
    rng = np.random.default_rng([97, flights])
    airspeed = [np.linspace(18.0, 24.0, flights) * (1.0 + 0.03 * rng.normal(size=flights)) for _ in range(20)]
    made = [series(rng, flights=flights, airspeed=each) for each in airspeed]
    tilted = [Series(one.number, one.value + 3.0 * one.airspeed, one.std, one.airspeed) for one in made]
    assert sum(change_of(one).p_value < 0.05 for one in tilted) <= 3


@pytest.mark.parametrize("flights", range(6))
def test_too_few_flights_say_nothing(flights):
    assert change_of(series(np.random.default_rng(0), flights=flights)) is None


def test_the_false_discovery_rate_is_that_of_benjamini_and_hochberg():
    """Their own example (1995, section 3.2): 15 p-values, of which the first four are named at 5 %."""
    p_values = [
        0.0001, 0.0004, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.3240, 0.4262, 0.5719, 0.6528,
        0.7590, 1.0,
    ]  # fmt: skip
    assert named(p_values).tolist() == [True] * 4 + [False] * 11
    assert named([]).tolist() == []


def test_an_airframe_that_is_not_like_the_others():
    others = [Mean(value, 0.01, 0.02, 20) for value in (1.0, 1.1, 0.9, 1.05, 0.95, 1.0, 1.02)]
    value, _, far = difference(Mean(2.0, 0.01, 0.02, 20), others)
    assert value == pytest.approx(1.0, abs=0.05) and far < 1e-4
    assert difference(Mean(1.12, 0.01, 0.02, 20), others)[2] > 0.05  # as far as they are from each other
    assert difference(Mean(1.12, 0.01, 0.02, 20), others[:1])[2] < 1e-3  # two alone are just compared


def mean_by_chance(rng, flights, spread, at=0.0):
    """The mean of flights with standard errors of 1 and a spread between them."""
    value = rng.normal(at, np.hypot(spread, 1.0), flights)
    return mean_of(Series(np.arange(flights), value, np.ones(flights), np.full(flights, np.nan)))


def test_an_airframe_of_two_flights_that_agree_by_chance_is_like_the_others():
    """Two values near each other had said that it scatters little, though all the others scatter ten times as much:
    in one of ten parameters a new airframe was not like the others with a p-value below one of a thousand.
    """
    rng = np.random.default_rng(94)
    others = [mean_by_chance(rng, 20, 10.0) for _ in range(20)]
    p_values = np.array([difference(mean_by_chance(rng, 2, 10.0), others)[2] for _ in range(100)])
    assert np.mean(p_values < 0.05) < 0.1 and not np.any(p_values < 1e-3)
    assert all(difference(mean_by_chance(rng, 2, 10.0, at=120.0), others)[2] < 1e-4 for _ in range(20))


def test_of_three_airframes_the_two_that_are_alike_are_not_named():
    """The mean of another one and of its like, with no spread, was as far from it as from any aeroplane."""
    a, b, other = (Mean(value, 0.001, 0.002, 10) for value in (-0.723, -0.724, -0.820))
    assert difference(other, [a, b])[2] < 1e-6
    for one, rest in ((a, [b, other]), (b, [a, other])):
        value, std, p_value = difference(one, rest)
        assert p_value > 0.05 and abs(value - rest[0].value) < 2.0 * std and abs(value - rest[1].value) < 2.0 * std
