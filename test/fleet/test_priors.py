"""What a fleet expects of the next flight, against flights that are drawn one longer than it knows."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.fleet_prior import prior_from_dict, read_prior
from aircraft_sysid_ros.fleet.changes import Series
from aircraft_sysid_ros.fleet.priors import LEAST, expected_of, priors_of, write_priors

DRIFT = {"kind": "drift", "number": 0}


def drawn(rng, flights=8, mean=-1.0, std=0.02, between=0.1, slope=0.0, jump=0.0, at=5):
    """A series, and the true value of the flight after it."""
    number = np.arange(flights + 1)
    true = mean + slope * number + jump * (number >= at) + between * rng.normal(size=flights + 1)
    value = true[:-1] + std * rng.normal(size=flights)
    return Series(number[:-1], value, np.full(flights, std), np.full(flights, 20.0)), float(true[-1])


@pytest.mark.long
@pytest.mark.parametrize(
    ("more", "change"),
    [
        ({}, None),
        ({"slope": 0.05, "flights": 12}, DRIFT),
        ({"jump": -0.5, "flights": 12}, {"kind": "jump", "number": 5}),
    ],
)
def test_the_next_flight_is_in_its_interval(more, change):
    rng = np.random.default_rng(11)
    inside = 0
    for _ in range(300):
        series, true = drawn(rng, **more)
        value, std = expected_of(series, change, len(series))
        inside += abs(true - value) <= 1.96 * std
    assert 0.92 * 300 <= inside <= 0.99 * 300


def test_it_weighs_no_more_than_one_flight_and_a_twentieth():
    number, std = np.arange(6), np.full(6, 0.2)
    series = Series(number, np.full(6, -1.0), std, np.full(6, 20.0))
    assert expected_of(series, None, 6)[1] >= 0.2
    surely = Series(number, np.full(6, -1.0), 1e-4 * std, np.full(6, 20.0))
    assert expected_of(surely, None, 6) == (pytest.approx(-1.0), pytest.approx(LEAST))


def test_a_drift_goes_on_through_flights_that_told_nothing():
    """The last three of ten were to HOLD, and the value of flight 7 was expected of flight 10."""
    number = np.arange(7)
    series = Series(number, -0.8 + 0.01 * number, np.full(7, 1e-4), np.full(7, 20.0))
    assert expected_of(series, DRIFT, 10)[0] == pytest.approx(-0.7, abs=1e-3)
    assert expected_of(series, None, 10)[0] == pytest.approx(-0.77, abs=1e-3)


@pytest.mark.parametrize(("flights", "change"), [(2, None), (3, DRIFT)])
def test_too_few_flights_expect_nothing(flights, change):
    assert expected_of(drawn(np.random.default_rng(1), flights)[0], change, flights) is None


def test_what_a_fleet_writes_is_read(tmp_path):
    rng = np.random.default_rng(5)
    series = {(f"N{k}", "Cm_de"): drawn(rng, mean=-1.0 + 0.3 * k)[0] for k in range(4)}
    series["N9", "Cm_de"] = drawn(rng, flights=2)[0]
    write_priors(tmp_path, priors_of(series, [], Counter(dict.fromkeys([*(f"N{k}" for k in range(4)), "N9"], 8))))
    assert [*json.loads((tmp_path / "prior.json").read_text())["airframes"]] == ["N0", "N1", "N2", "N3"]
    own = prior_from_dict(read_prior(tmp_path, "N2", "x"))
    assert own.flights == "8 flights of N2" and own.parameters["Cm_de"][0] == pytest.approx(-0.4, abs=0.15)
    common = prior_from_dict(read_prior(tmp_path, None, "another"))
    assert common.flights == "flights of 4 other airframes"
    assert common.parameters["Cm_de"][1] > 0.3 > own.parameters["Cm_de"][1]  # airframes differ by more than flights
