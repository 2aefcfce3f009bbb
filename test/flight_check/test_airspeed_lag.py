"""The time of the airspeed by the GPS speed less the wind: told by many changes of the speed, and not by one."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.finding import INFO
from aircraft_sysid_ros.flight_check.grid import Grid, compare
from aircraft_sysid_ros.flight_check.laws import airspeed
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

STEP = 0.05


@pytest.mark.long
@pytest.mark.parametrize("seed", [51, 53])
def test_an_airspeed_that_is_late_is_found_with_its_time(seed):
    """By the GPS alone, without a vane that would tell it by the accelerometers."""
    calm = {"wind": np.zeros(3), "sensors": SensorOptions(attitude=True)}
    flown = simulate_samples(default_aircraft(), seed, 100.0, **calm).samples
    late = Samples(flown.stamp + (flown.kind == Kind.AIRSPEED) * 300_000_000, flown.kind, flown.values)
    late = late[late.kind != Kind.ANGLE_OF_ATTACK]
    (found,) = [f for f in check(flight_of(late, late.stamp)).findings if f.severity != INFO]
    assert (found.signals, found.kind) == (("true_airspeed",), "offset")
    told = re.match(
        r"it comes (\S+) s .* later than velocity.north, by the (?:changes of the )?GPS speed", found.sentence
    )
    assert told is not None and float(told[1]) == pytest.approx(0.3, abs=0.05)


def changes(seed: int, times, lag: float = 0.0, gust: float = 0.1, shear: float = 0.0):
    """Speeds (n,) [m/s] by the airspeed and over ground less one wind, which fall or rise by 6 m/s at some times [s].

    With gusts in the former, and from 75 s on a wind that differs by ``shear`` [m/s], seen in circles of 15 s.
    """
    rng, time = np.random.default_rng(seed), np.arange(0.0, 160.0, STEP)
    blown = np.zeros(len(time))
    for k in range(1, len(time)):  # a gust lasts for 4 s
        blown[k] = (1.0 - STEP / 4.0) * blown[k - 1] + gust * np.sqrt(2.0 * STEP / 4.0) * rng.normal()
    circles = np.sin(2.0 * np.pi * time / 15.0 + np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi))

    def flown(at):
        return 20.0 + sum(way * 3.0 * np.tanh((at - when) / 3.0) for when, way in times)

    return flown(time - lag) + blown + shear * circles * (time > 75.0), flown(time)


def laws(seeds, times, **more) -> list[Relation]:
    """What the law says of each flight."""
    return [law(*changes(seed, times, **more)) for seed in seeds]


def law(y, x) -> Relation:
    (found,) = airspeed._slow(SimpleNamespace(grid=Grid(0.0, STEP, len(x)), gps_width=1.0), y, x, "", None)
    return found


def tells(relation: Relation) -> bool:
    low, high = relation.lag
    return not low < 0.0 < high


def test_a_speed_that_falls_once_tells_no_lag():
    """An engine that was cut: of an airspeed in time it had been said that it comes 0.42 s (± 0.19) late."""
    assert not any(map(tells, laws(range(20), [(80.0, -1.0)], shear=0.6)))


def test_a_speed_that_changes_often_tells_one():
    times = [(10.0 * k + 5.0, (-1.0) ** k) for k in range(15)]
    told = laws(range(10), times, lag=0.3)
    assert all(map(tells, told)) and np.mean([r.comparison.lag for r in told]) == pytest.approx(0.3, abs=0.02)
    assert not any(map(tells, laws(range(20), times, shear=0.6)))


def test_gusts_that_are_answered_are_no_lag():
    """Who flies at a constant airspeed slows down in a gust: the airspeed then seems late by what it answers."""
    lags = []
    for seed in range(20):
        y, x = changes(seed, [(10.0 * k + 5.0, (-1.0) ** k) for k in range(15)], gust=1.5)
        answered = np.zeros(len(x))
        for k in range(1, len(x)):  # with a bandwidth of 0.15 rad/s
            answered[k] = answered[k - 1] - STEP * 0.15 * (y[k - 1] - x[k - 1] + answered[k - 1])
        y, x = y + answered, x + answered
        assert not tells(law(y, x))
        grid = Grid(0.0, STEP, len(x))
        lags.append(compare(*(grid.band(v, *airspeed._CHANGES) for v in (y, x)), STEP, 2.0).lag)
    assert np.mean(lags) > 0.2


def test_noise_of_both_tells_no_lag():
    """A speed that hardly changes, by two noisy sensors: noise has quick changes that say nothing of the time."""
    lags = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        _, x = changes(seed, [(30.0, 0.3), (60.0, -0.3), (100.0, 0.3)])
        grid = Grid(0.0, STEP, len(x))
        y, x = (grid.band(x + 0.5 * rng.normal(size=len(x)), *airspeed._CHANGES) for _ in range(2))
        found = compare(y, x, STEP, 1.0)
        lags.append(found.lag / found.lag_std)
    assert np.sqrt(np.mean(np.square(lags))) < 1.3
