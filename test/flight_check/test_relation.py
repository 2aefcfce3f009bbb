"""The fewest faults that explain what contradicts itself, on relations whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.explain import scales
from aircraft_sysid_ros.flight_check.grid import Comparison, Grid, compare
from aircraft_sysid_ros.flight_check.relation import Relation, lag_faults, scale_faults, sign_faults


def relation(first, second, *, ratio=1.0, lag=0.0, r=0.95, **known) -> Relation:
    size = abs(ratio)
    comparison = Comparison(float(np.copysign(r, ratio)), 0.97 * size, 1.03 * size, lag, 0.002, 500.0, 100.0)
    return Relation(first, second, comparison, "a law", **known)


def test_the_signal_that_contradicts_two_is_wrong_and_not_one_that_agrees_with_a_third():
    relations = [relation("p", "roll", ratio=-1.0), relation("roll", "turn"), relation("p", "da", ratio=-1.0)]
    assert [fault.signal for fault in sign_faults(relations, {})] == ["p"]
    relations[1] = relation("roll", "turn", ratio=-1.0)
    relations[2] = relation("p", "da")
    assert [fault.signal for fault in sign_faults(relations, {})] == ["roll"]


def test_a_relation_of_three_turns_with_each():
    relations = [relation("roll", "", ratio=-1.0, also=("north", "east")), relation("north", "latitude", ratio=-1.0)]
    assert [fault.signal for fault in sign_faults(relations, {})] == ["north"]


def test_two_wrong_signals_hide_nothing():
    relations = [relation("a", "b"), relation("a", "c", ratio=-1.0), relation("b", "d", ratio=-1.0)]
    relations += [relation("c", "e"), relation("d", "f"), relation("e", "f")]
    assert sorted(fault.signal for fault in sign_faults(relations, {})) == ["a", "b"]


def test_signals_that_one_fault_reverses_stand_for_three_and_not_for_two():
    group = ("q", "r", "y", "z")
    two = [relation("q", "alpha", ratio=-1.0), relation("z", "gravity", ratio=-1.0)]
    two += [relation("beta", "r"), relation("beta", "y"), relation("r", "y")]
    assert sorted(fault.signal for fault in sign_faults(two, {}, [group])) == ["q", "z"]
    three = [*two[:2], relation("beta", "r", ratio=-1.0), relation("beta", "y", ratio=-1.0), two[4]]
    (fault,) = sign_faults(three, {}, [group])
    assert (fault.signal, *fault.also) == group
    assert sorted(fault.signal for fault in sign_faults(three, {})) != [*group]


def test_a_unit_is_found_on_the_signal_with_the_size_of_its_factor():
    known = {"scale_tolerance": 0.05}
    relations = [relation("v", "p", ratio=1.944, **known), relation("tas", "v", ratio=1 / 1.944, **known)]
    (fault,) = scale_faults(relations, {})
    assert fault.signal == "v" and np.exp(fault.size) == pytest.approx(1.944, rel=0.01)


def test_a_ratio_within_the_tolerance_is_no_fault():
    assert scale_faults([relation("v", "p", ratio=1.06, scale_tolerance=0.05)], {}) == []


def test_two_streams_that_are_equally_late_are_both_named():
    relations = [relation("velocity", "imu", lag=0.2), relation("velocity", "position"), relation("imu", "attitude")]
    relations += [relation("imu", "vane")]
    faults = {fault.signal: fault.size for fault in lag_faults(relations, {}, lambda signal: signal)}
    assert faults == pytest.approx({"velocity": 0.2, "position": 0.2}, abs=0.005)


@pytest.mark.parametrize(("lag", "named"), [(0.055, 0), (0.075, 1)])
def test_a_lag_that_is_hardly_beyond_what_the_law_allows_is_none(lag, named):
    """Three surfaces share a clock: one whose effect fell to a half seemed late by that, the others were not."""
    relations = [relation("controls", "p", lag=lag, r=0.99), relation("controls", "q", lag=0.5 * lag, r=0.99)]
    relations = [replace(each, lag_tolerance=0.048) for each in relations]
    assert len(lag_faults(relations, {}, lambda signal: signal)) == named


def test_the_lag_and_the_ratio_of_two_series_are_found_within_their_errors():
    """White noise, smoothed, against itself late and scaled with noise: 40 draws, errors of the stated size."""
    grid, misses = Grid(0.0, 0.02, 5000), 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x = grid.smooth(rng.standard_normal(grid.count), 0.5)
        y = np.interp(grid.time - 0.07, grid.time, np.nan_to_num(x)) * 1.3
        y = y + grid.smooth(0.5 * rng.standard_normal(grid.count), 0.1)
        found = compare(y, x, grid.step)
        assert found is not None and found.correlation > 0.5
        misses += abs(found.lag - 0.07) > 3.0 * found.lag_std + 0.004
        assert found.low < 1.3 < found.high
    assert misses <= 2


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_sign_of_a_series_is_found(sign):
    grid, rng = Grid(0.0, 0.02, 3000), np.random.default_rng(3)
    x = grid.smooth(rng.standard_normal(grid.count), 0.5)
    found = compare(sign * x, x, grid.step)
    assert found is not None and np.sign(found.correlation) == sign and found.is_sure


@pytest.mark.long
def test_independent_series_are_not_related():
    """Of 200 pairs of independent coloured noises none is sure."""
    grid = Grid(0.0, 0.02, 3000)
    for seed in range(200):
        rng = np.random.default_rng(seed)
        x, y = (grid.smooth(rng.standard_normal(grid.count), 1.0) for _ in range(2))
        found = compare(y, x, grid.step)
        assert found is not None and not found.is_sure


def test_a_gap_is_nan_on_the_grid_and_an_average_over_it_too():
    time = np.concatenate([np.arange(0.0, 5.0, 0.02), np.arange(7.0, 10.0, 0.02)])
    grid = Grid(0.0, 0.02, 500)
    placed = grid.put(time, time**2)[:, 0]
    inside = (grid.time > 4.99) & (grid.time < 6.99)
    away = (grid.time < 4.97) | ((grid.time > 7.01) & (grid.time < 9.97))
    assert np.isnan(placed[inside]).all() and np.isfinite(placed[away]).all()
    assert np.isnan(grid.smooth(placed, 0.5)[(grid.time > 4.8) & (grid.time < 7.2)]).all()
    assert grid.slope(placed)[100] == pytest.approx(2.0 * grid.time[100], rel=1e-9)


@pytest.mark.parametrize(("low", "high", "told"), [(1.042, 1.236, False), (1.10, 1.17, True)])
def test_a_scale_that_noise_leaves_further_open_than_it_is_from_one_is_not_told(low, high, told):
    """A stranger's vibrating, sound gyro was "1.135 times what it should be"."""
    follows = Comparison(np.sqrt(low / high), low, high, 0.0, 0.01, 1000.0, 400.0)
    found = scales([Relation("angular_velocity.y", "attitude.pitch", follows, "the derivative of the attitude", 0.04)])
    assert [each.finding.signals for each in found] == ([("angular_velocity.y",)] if told else [])
