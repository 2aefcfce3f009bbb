"""Flights with a slow IMU: what compare and diagnose say of them, with an aircraft file that does not know the rate."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from slow_flights import all_thinned, fast_flight, file_of_users, thinned

from aircraft_sysid_ros.diagnosis.compare import Comparison, compare
from aircraft_sysid_ros.diagnosis.flight.reconstruction import fit_sensor_noise, flying, reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.flight.sensor_rates import with_recorded_rates, with_sparse_rates
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.diagnosis.significance.bootstrap_flight import KNOWN_SHARE, world_of
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import fitted_parameters
from aircraft_sysid_ros.effects import LIBRARY
from aircraft_sysid_ros.effects.effect import Effect
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.samples import Kind, Samples, without_repeats
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import hidden_effects

SEED = 7
#: A part of the library, for a search that does not take so long.
EVERY_FOURTH = [effect for i, effect in enumerate(LIBRARY) if i % 4 == 0 or effect.identifier == "p_factor"]


def compared(samples: Samples) -> Comparison:
    seen = fit_sensor_noise(file_of_users(), samples)
    return compare(settled_flight(reconstruct(seen, samples, with_covariance=True)))


@pytest.mark.long
def test_rates_are_those_of_the_stamps_where_the_imu_is_sparse() -> None:
    aircraft, samples = file_of_users(), fast_flight(SEED).samples
    dense = thinned(samples, 100.0, air=20.0)
    assert with_sparse_rates(aircraft, dense) is aircraft
    assert with_recorded_rates(aircraft, dense).sensors["airspeed"].rate == pytest.approx(20.0)
    slow = with_sparse_rates(aircraft, thinned(samples, 12.5, air=20.0, jitter=0.2, lost=0.1))
    rates = {name: slow.sensors[name].rate for name in ("gyro", "accelerometer", "angle_of_attack", "control_surfaces")}
    expected = {"gyro": 12.5, "accelerometer": 12.5, "angle_of_attack": 20.0, "control_surfaces": 50.0}
    assert rates == pytest.approx(expected, rel=0.1)


def test_a_topic_that_was_recorded_twice_makes_no_sensor_faster() -> None:
    """Rates were infinite, so that no replica could be flown, and noise half of what it is."""
    aircraft, samples = file_of_users(), simulate_samples(file_of_users(), SEED, 20.0).samples
    twice = samples[np.repeat(np.arange(len(samples)), 2)]
    assert with_recorded_rates(aircraft, twice).sensors == with_recorded_rates(aircraft, samples).sensors
    once = without_repeats(twice)
    for name in ("stamp", "kind", "values"):
        np.testing.assert_array_equal(getattr(once, name), getattr(samples, name))
    other = replace(twice, values=twice.values + np.arange(len(twice))[:, None])
    assert without_repeats(other) is other


@pytest.mark.long
def test_motion_between_sparse_samples_is_not_taken_for_noise() -> None:
    """Third differences at 10 Hz are motion: the noise of the file stands, and that of fast air data is still read."""
    aircraft, samples = file_of_users(), fast_flight(SEED).samples
    seen = fit_sensor_noise(aircraft, thinned(samples, 10.0, air=100.0))
    assert [seen.sensors[s].noise for s in ("gyro", "accelerometer")] == [
        aircraft.sensors[s].noise for s in ("gyro", "accelerometer")
    ]
    assert seen.sensors["airspeed"].noise[0] == pytest.approx(aircraft.sensors["airspeed"].noise[0], rel=0.1)
    slow = fit_sensor_noise(aircraft, all_thinned(samples, 10.0))
    assert slow.sensors["airspeed"] == aircraft.sensors["airspeed"]


@pytest.mark.long
def test_at_25_hz_a_flight_without_missing_effects_reaches_its_floor() -> None:
    comparison = compared(thinned(fast_flight(SEED).samples, 25.0))
    ratio = {name: axis.fit.nrmse_held_out / axis.floor.nrmse for name, axis in comparison.axes.items()}
    assert all(1.0 / 1.25 < r < 1.25 for r in ratio.values()), ratio
    assert comparison.notes == [
        "the IMU comes at 25 Hz: the floor is the noise of the sensors alone, and what happens between two samples, "
        "mostly in quick manoeuvres, is in the errors above it"
    ]


@pytest.mark.long
def test_at_10_hz_the_sensors_are_not_blamed() -> None:
    """Motion between the samples is in the fast part of the residuals: the rate is named, and no noise of a sensor."""
    comparison = compared(thinned(fast_flight(SEED).samples, 10.0))
    assert max(axis.noise_seen for axis in comparison.axes.values()) > 1.6
    assert len(comparison.notes) == 1 and comparison.notes[0].startswith("the IMU comes at 10 Hz: ")
    assert all(axis.floor.nrmse < 1.1 * axis.fit.nrmse_held_out for axis in comparison.axes.values())


def test_a_replica_of_a_sparse_flight_is_as_sparse_and_holds_no_more_motion_than_was_seen() -> None:
    samples = thinned(fast_flight(SEED).samples, 10.0)
    made = reconstruct(file_of_users(), samples, with_covariance=False)
    rows = flying(made.rows, made.aircraft.minimum_airspeed)
    parameters = fitted_parameters(settled_flight(made))
    world = world_of(replace(made, gusts=0.05), [rows], parameters, seed=0)
    stamps = np.sort((again := world.samples(0)).stamp[again.kind == Kind.IMU])
    assert np.median(np.diff(stamps)) == pytest.approx(1e8, rel=0.01)
    rates = world.truth.rates - world.truth.rates.mean(axis=0)
    power = np.abs(np.fft.rfft(rates, axis=0)) ** 2
    fast = np.fft.rfftfreq(len(rates), 0.01) > 2.0 * KNOWN_SHARE * 10.0
    assert power[fast].sum() < 1e-3 * power.sum()


@pytest.mark.parametrize("air", [(50.0, 10.0, 10.0), (10.0, 50.0, 25.0), (50.0, 35.0, 20.0)])
def test_sensors_of_a_replica_are_as_fast_as_each_of_the_flight(air: tuple[float, float, float]) -> None:
    """Vanes at 10 Hz beside an airspeed at 50 Hz had 50 Hz in replicas, whose errors were two thirds of true ones."""
    rates = dict(zip((Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP), air, strict=True)) | {Kind.ATTITUDE: 20.0}
    samples = simulate_samples(file_of_users(), SEED, 25.0, sensors=SensorOptions(attitude=True)).samples
    keep, stamp = np.ones(len(samples), np.bool_), samples.stamp.copy()
    for kind, rate in rates.items():
        at = np.flatnonzero(samples.kind == kind)
        keep[at], count = False, round(25.0 * rate)
        at = at[np.linspace(0, len(at) - 1, count).round().astype(int)]
        keep[at], stamp[at] = True, np.linspace(stamp[at[0]], stamp[at[-1]], count).astype(np.int64)
    samples = replace(samples, stamp=stamp)
    made = reconstruct(file_of_users(), samples[keep], with_covariance=False)
    rows = flying(made.rows, made.aircraft.minimum_airspeed)
    again = world_of(replace(made, gusts=0.05), [rows], fitted_parameters(settled_flight(made)), seed=0).samples(0)
    found = {k: 1e9 / np.mean(np.diff(np.sort(again.stamp[again.kind == k]))) for k in rates}
    assert found == pytest.approx(rates, rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "library"),
    [("p_factor", EVERY_FOURTH), *(pytest.param(e, LIBRARY, marks=pytest.mark.long) for e in ("p_factor", None))],
)
def test_at_10_hz_an_effect_is_named_and_nothing_else(effect: str | None, library: Sequence[Effect]) -> None:
    flight = hidden_effects.hidden_flight("textbook", effect, seed=2000, duration=60.0)
    slow = hidden_effects.with_slow_imu(flight, 10.0)
    assert np.sum(slow.samples.kind == Kind.IMU) == pytest.approx(600, abs=2)
    said = diagnose_flight(slow.aircraft, slow.samples, library, replicas=2).json
    found = [candidate["effect"] for candidate in said["candidates"] if candidate["found"]]
    assert (said["verdict"], found) == (("missing", ["p_factor"]) if effect else ("none", []))


@pytest.mark.long_after_the_first
@pytest.mark.parametrize(
    ("rate", "controls", "words"),
    [
        (5.0, 50.0, "the IMU comes at 5 Hz: derivatives need at least 10 Hz"),
        (100.0, 3.0, "the controls come at 3 Hz: at least 10 Hz are needed"),
    ],
)
def test_what_is_too_slow_is_the_reason(rate: float, controls: float, words: str) -> None:
    samples = thinned(fast_flight(SEED).samples, rate, controls=controls)
    with pytest.raises(InputError) as error:
        diagnose_flight(file_of_users(), samples[: len(samples) // 2])
    assert str(error.value) == f"the flight cannot be judged: {words}"
