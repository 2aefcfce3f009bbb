"""Where a model fails: found when it is there, silent when it is not."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.significance.error_regions import failing_places, independent_share

STEP, N = 0.04, 3000


def slow(random: np.random.Generator, width: int) -> np.ndarray:
    noise = np.convolve(random.normal(size=N + 2 * width), np.ones(width), "same")[width : width + N]
    return noise / np.std(noise)


def flight_of(aircraft, random: np.random.Generator) -> FlightData:
    signals = np.full((N, len(SIGNALS)), np.nan)
    for name in ("alpha", "beta", "de", "p", "q", "r"):
        signals[:, SIGNAL_INDEX[name]] = 0.05 * slow(random, 50)
    signals[:, SIGNAL_INDEX["height"]] = 120.0
    return FlightData(aircraft, STEP * np.arange(N), np.zeros((N, 6)), signals, STEP)


def test_false_alarms_in_coloured_noise(aircraft) -> None:
    """Residuals with a second of memory: in 5 % of the flights at most there is a place, over 60 flights 4 sigma."""
    found = 0
    for seed in range(60):
        random = np.random.default_rng(seed)
        found += bool(failing_places(flight_of(aircraft, random), "CZ", slow(random, 10), np.ones(N), 10.0))
    assert found <= 9


def test_a_stretch_of_time_is_found(aircraft) -> None:
    random = np.random.default_rng(0)
    flight, residual = flight_of(aircraft, random), random.normal(size=N)
    flight.signals[:, SIGNAL_INDEX["alpha"]] = np.where((flight.time > 62) & (flight.time < 71), 0.25, 0.05)
    flight.signals[:, SIGNAL_INDEX["alpha"]] += 0.02 * random.normal(size=N)
    residual[(flight.time > 62.0) & (flight.time < 71.0)] *= 3.0
    places = failing_places(flight, "CZ", residual, np.ones(N), 10.0)
    stretch = next(place for place in places if not place.is_cell)
    assert stretch.t_start == pytest.approx(62.0, abs=1.0) and stretch.t_end == pytest.approx(71.0, abs=1.0)
    assert stretch.conditions.startswith("alpha above") and stretch.text.startswith("C_Z, 62 to 71 s, alpha above")
    assert stretch.nrmse == pytest.approx(0.3, rel=0.1) and stretch.excess == pytest.approx(3.0, rel=0.1)


def test_times_are_those_of_the_recording(aircraft) -> None:
    """The first point of a flight may come long after the filter has started: the signal ``time`` knows."""
    random = np.random.default_rng(0)
    flight, residual = flight_of(aircraft, random), random.normal(size=N)
    flight.signals[:, SIGNAL_INDEX["time"]] = flight.time + 33.0
    residual[(flight.time > 62.0) & (flight.time < 71.0)] *= 3.0
    places = failing_places(flight, "CZ", residual, np.ones(N), 10.0)
    stretch = next(place for place in places if not place.is_cell)
    assert flight.begin == pytest.approx(33.0)
    assert stretch.t_start == pytest.approx(95.0, abs=1.0) and stretch.t_end == pytest.approx(104.0, abs=1.0)
    assert stretch.text.startswith("C_Z, 95 to 104 s")


def test_a_cell_of_the_envelope_is_found_with_its_edge(aircraft) -> None:
    random = np.random.default_rng(1)
    flight, residual = flight_of(aircraft, random), random.normal(size=N)
    beta = flight.signal("beta")
    residual += np.where(beta < -0.08, 6.0, 0.0)
    places = failing_places(flight, "Cn", residual, np.ones(N), 10.0)
    assert places[0].is_cell and places[0].text.startswith("C_n, beta below")
    assert places[0].conditions.endswith(" deg")
    edge = float(places[0].conditions.split()[-2])
    assert -8.0 < edge < -3.0
    assert [p.nrmse for p in places] == sorted((p.nrmse for p in places), reverse=True)


def test_what_is_twice_as_noisy_as_stated_everywhere_is_said(aircraft) -> None:
    random = np.random.default_rng(2)
    places = failing_places(flight_of(aircraft, random), "Cm", 2.0 * random.normal(size=N), np.ones(N), 10.0)
    assert places and all(place.excess > 1.5 for place in places)


def test_a_surface_at_its_stop_has_no_cell_beyond(aircraft) -> None:
    random = np.random.default_rng(3)
    flight = flight_of(aircraft, random)
    flight.signals[:, SIGNAL_INDEX["de"]] = np.clip(flight.signal("de"), -0.02, 0.02)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = failing_places(flight, "Cm", random.normal(size=N), np.ones(N), 10.0)
    assert found == []  # white noise of the size that is expected


def test_no_judged_points_no_places(aircraft) -> None:
    random = np.random.default_rng(3)
    assert failing_places(flight_of(aircraft, random), "Cm", np.full(N, np.nan), np.ones(N), 1.0) == []


def test_independent_squares() -> None:
    """A first-order process: 1 / (1 + 2 sum a^2l) = (1 - a^2) / (1 + a^2), Bartlett (1946)."""
    random, a = np.random.default_rng(4), 0.8
    z = random.normal(size=40_000)
    for i in range(1, len(z)):
        z[i] += a * z[i - 1]
    assert independent_share(z, STEP) == pytest.approx((1 - a * a) / (1 + a * a), rel=0.15)
    z[::7] = np.nan
    assert independent_share(z, STEP) == pytest.approx((1 - a * a) / (1 + a * a), rel=0.2)
