"""The noise floor: against Monte Carlo through the windows, and against flights without any missing effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, MOMENTS
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.diagnosis.compare import compare
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.search.fit import fits_of
from aircraft_sysid_ros.diagnosis.significance.noise_floor import (
    NoiseFloor,
    Source,
    noise_floor,
    noise_seen,
    response_sources,
    variance_of,
    window_weights,
)
from aircraft_sysid_ros.estimation.window_average import window_average
from aircraft_sysid_ros.identification.coefficients.body import body_of
from aircraft_sysid_ros.identification.coefficients.evaluation import measured_coefficients
from aircraft_sysid_ros.identification.coefficients.layout import CENTRIPETAL, FORCE, GYROSCOPIC, QBAR, RATE
from aircraft_sysid_ros.simulation.simulated_flight import hidden_flight, simulate_samples


def flight_without_missing_effects(aircraft, seed: int, turbulence: str = "none") -> FlightData:
    samples = simulate_samples(aircraft, seed, 60.0, turbulence=turbulence).samples
    return settled_flight(reconstruct(aircraft, samples))


@pytest.mark.parametrize("interval, kept", [(0.01, 0.0), (0.02, 0.0), (0.01, 0.9)])
def test_variance_of_points_is_that_of_drawn_noise(interval: float, kept: float) -> None:
    """10000 windows of noise, of which a sample keeps a share; fourth differences of points as well."""
    random = np.random.default_rng(0)
    weights, slopes = window_weights(interval)
    step = 0.04
    per_step = round(step / interval)
    noise = random.normal(size=10_000 * per_step)
    for i in range(1, len(noise)):
        noise[i] = kept * noise[i - 1] + np.sqrt(1.0 - kept**2) * noise[i]
    for slope, w in enumerate((weights, slopes)):
        points = np.convolve(noise, w, "valid")[::per_step]
        source = Source(np.ones(1), interval, bool(slope), kept)
        assert np.var(points) == pytest.approx(source.of_points(np.ones(1), step), rel=0.1)
        stencil = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
        fast = np.convolve(points, stencil, "valid")
        assert np.var(fast) == pytest.approx(source.of_points(stencil, step), rel=0.1)
        floor = NoiseFloor((source,), (), np.zeros((1, 0)), 1.0, step)
        lag = np.mean(points[2:] * points[:-2]) / np.var(points)
        assert floor.correlation(2)[2] == pytest.approx(lag, abs=0.05)


@pytest.mark.parametrize("interval, kept", [(0.1, 0.0), (0.037, 0.0), (0.1, 0.7)])
def test_variance_of_points_of_sparse_samples_is_that_of_drawn_noise(interval: float, kept: float) -> None:
    """Windows anywhere between samples that are further apart than they are wide."""
    random, step, count = np.random.default_rng(3), 0.04, 12_000
    times = interval * np.arange(int(count * step / interval) + 20)
    noise = random.normal(size=len(times))
    for i in range(1, len(noise)):
        noise[i] = kept * noise[i - 1] + np.sqrt(1.0 - kept**2) * noise[i]
    found, mean, slope = np.empty((count, 2)), np.empty(1), np.empty(1)
    for out, center in zip(found, 0.5 + step * np.arange(count) + 1e-5, strict=True):
        first = int(np.searchsorted(times, center - 0.08, side="right")) - 1
        last = int(np.searchsorted(times, center + 0.08))
        window_average(times, noise[:, None], first, last, center, 0.08, mean, slope, True)
        out[:] = mean[0], slope[0]
    stencil = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
    for points, is_slope in zip(found.T, (False, True), strict=True):
        source = Source(np.ones(1), interval, is_slope, kept, sparse=True)
        assert np.var(points) == pytest.approx(source.of_points(np.ones(1), step), rel=0.1)
        assert np.var(np.convolve(points, stencil, "valid")) == pytest.approx(source.of_points(stencil, step), rel=0.1)
        lag = np.mean(points[2:] * points[:-2]) / np.var(points)
        assert NoiseFloor((source,), (), np.zeros((1, 0)), 1.0, step).correlation(2)[2] == pytest.approx(lag, abs=0.05)


def test_response_is_the_noise_of_the_measured_coefficients(aircraft) -> None:
    """White noise on the sensors of an aeroplane at rest in all else, through the very functions of the regression."""
    aircraft = replace(aircraft, aerodynamic_reference=np.array([0.03, 0.0, -0.02]))
    body, random, qbar = body_of(aircraft), np.random.default_rng(1), 177.0
    times = 0.01 * np.arange(21)
    found = np.empty((2000, 6))
    history = np.zeros((len(times), GYROSCOPIC + 3))
    means, slopes = np.empty(history.shape[1]), np.empty(history.shape[1])
    for out in found:
        history[:, QBAR] = qbar
        history[:, FORCE : FORCE + 3] = aircraft.mass * 0.03 * random.normal(size=(len(times), 3))
        history[:, RATE : RATE + 3] = 0.002 * random.normal(size=(len(times), 3))
        assert not history[:, CENTRIPETAL:].any()
        window_average(times, history, 0, len(times) - 1, 0.1, 0.08, means, slopes, False)
        measured_coefficients(means, slopes, body, out)
    for index in range(6):
        std = np.sqrt(variance_of(response_sources(aircraft, (0.03, 0.002), np.array([qbar]), index)))[0]
        assert np.std(found[:, index]) == pytest.approx(std, rel=0.07), AXES[index]


@pytest.mark.long
@pytest.mark.parametrize("seed, turbulence", [(5, "none"), (8, "light")])
def test_flights_without_missing_effects_reach_the_floor(aircraft, seed: int, turbulence: str) -> None:
    """Within 20 %, 25 % in turbulence; the residual is noise; nothing is said of the sensors."""
    comparison = compare(flight_without_missing_effects(aircraft, seed, turbulence))
    bound = 1.2 if turbulence == "none" else 1.25
    for name, axis in comparison.axes.items():
        assert 1.0 / bound < axis.fit.nrmse_held_out / axis.floor.nrmse < bound, name
        assert axis.fit.nrmse_fit <= axis.fit.nrmse_held_out
    assert comparison.notes == []
    assert sum(axis.whiteness.white is False for axis in comparison.axes.values()) <= 2
    assert all(place.excess < 2.5 for place in comparison.worst)


@pytest.mark.long
def test_a_bias_that_nothing_shows_is_part_of_the_floor_where_speeds_differ(aircraft) -> None:
    """Level and without an attitude the bias across looks like a bank: at three speeds it is no constant of C_Y."""
    flown = hidden_flight("textbook", None, seed=23, duration=90.0, turbulence="none", noise_scale=1.0, strength=1.0)
    flight = settled_flight(reconstruct(flown.aircraft, flown.samples))
    axis, of_noise = compare(flight).axes["CY"], compare(replace(flight, bias_std=None)).axes["CY"]
    assert axis.fit.nrmse_held_out == of_noise.fit.nrmse_held_out > 1.5 * of_noise.floor.nrmse
    assert 0.7 < axis.fit.nrmse_held_out / axis.floor.nrmse < 1.3
    assert of_noise.places and not axis.places
    stands = axis.floor.bias[:, 0]
    assert np.abs(axis.floor.without_bias(stands)).max() < 0.05 * np.abs(stands).max()


@pytest.mark.long
def test_at_one_speed_a_bias_is_the_constant(aircraft) -> None:
    flight = flight_without_missing_effects(aircraft, 5)
    steady = flight.signals.copy()
    steady[:, SIGNAL_INDEX["qbar"]] = 150.0
    steady = replace(flight.with_signals(steady), bias_std=np.array([0.1, 0.1, 0.1]))
    fits, _ = fits_of(steady)
    for axis, fit in fits.items():
        bias = noise_floor(steady, axis, fit.fit).bias
        assert bias.shape == (len(flight.time), 0) if axis in MOMENTS else np.abs(bias[:, 0]).max() < 1e-9, axis


@pytest.mark.long
def test_sensors_noisier_than_the_file_are_noticed(aircraft) -> None:
    """An accelerometer with four times the noise: seen in the fast part of C_X and C_Y, by about as much."""
    quiet = {**aircraft.sensors, "accelerometer": replace(aircraft.sensors["accelerometer"], noise=(0.0075,))}
    flight = flight_without_missing_effects(aircraft, 5)
    comparison = compare(replace(flight, aircraft=replace(aircraft, sensors=quiet)))
    assert comparison.axes["CY"].noise_seen > 1.8
    assert any("CY" in note for note in comparison.notes)


def test_fast_part_of_drawn_noise_is_one() -> None:
    random, step = np.random.default_rng(2), 0.04
    weights, _ = window_weights(0.01)
    points = np.convolve(random.normal(size=20_000), weights, "valid")[::4]
    floor = NoiseFloor((Source(np.ones(len(points)), 0.01),), (), np.zeros((len(points), 0)), 1.0, step)
    time = step * np.arange(len(points))
    assert noise_seen(floor, time, 3.0 * points) == pytest.approx(3.0, rel=0.1)
    slow = 5.0 * np.sin(2.0 * time)
    assert noise_seen(floor, time, points + slow) == pytest.approx(1.0, rel=0.1)
