"""Excitation signals have the properties that they are named for, and the plan excites every parameter."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.simulation.flight import prepare
from aircraft_sysid_ros.simulation.manoeuvres import (
    THROTTLE,
    doublet,
    flight_plan,
    low_peak_phases,
    orthogonal_multisines,
    sweep,
    three_two_one_one,
)
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

STEP = 1.0 / 400.0


def times(seconds):
    return np.arange(round(seconds / STEP)) * STEP


def test_a_doublet_goes_up_and_down_and_leaves_nothing():
    wave = doublet(times(5.0) - 1.0, 0.5)
    assert wave.sum() == 0.0
    assert wave[round(1.2 / STEP)] == 1.0
    assert wave[round(1.7 / STEP)] == -1.0
    assert not wave[: round(1.0 / STEP)].any()
    assert not wave[round(2.0 / STEP) :].any()


def test_three_two_one_one_has_those_widths():
    wave = three_two_one_one(times(10.0), 0.5)
    edges = np.flatnonzero(np.diff(wave)) + 1
    np.testing.assert_allclose(np.diff(edges, prepend=0) * STEP / 0.5, [3, 2, 1, 1], atol=2 * STEP)
    assert np.sign(wave[edges - 1]).tolist() == [1, -1, 1, -1]


def test_a_sweep_passes_from_low_to_high_frequency():
    wave = sweep(times(20.0), 20.0, 0.2, 4.0)
    crossings = np.flatnonzero(np.diff(np.sign(wave)) != 0) * STEP
    frequency = 0.5 / np.diff(crossings)
    assert frequency[0] == pytest.approx(0.2, rel=0.35)
    assert frequency[-1] == pytest.approx(4.0, rel=0.1)
    assert np.all(np.diff(frequency) > -0.05)
    assert not sweep(np.array([-1.0, 20.0, 25.0]), 20.0, 0.2, 4.0).any()


def test_multisines_are_orthogonal_over_a_period():
    period = 20.0
    waves = orthogonal_multisines(times(period), period, 2.0)
    correlation = np.corrcoef(waves.T)
    np.testing.assert_allclose(correlation, np.eye(4), atol=1e-10)


def test_multisines_share_no_frequency_and_stay_in_band():
    period = 20.0
    power = np.abs(np.fft.rfft(orthogonal_multisines(times(period), period, 2.0), axis=0)) > 1e-6
    assert power.sum(axis=1).max() == 1
    frequency = np.fft.rfftfreq(round(period / STEP), STEP)
    assert frequency[power.any(axis=1)].max() <= 2.1
    assert frequency[power[:, THROTTLE]].max() <= 0.6
    assert not power[0].any()  # no constant part


def test_multisines_have_low_peaks_and_begin_at_rest():
    period = 20.0
    waves = orthogonal_multisines(times(period), period, 2.0)
    peaks = np.max(np.abs(waves), axis=0)
    np.testing.assert_allclose(peaks, 1.0, atol=0.02)
    relative_peak_factor = peaks / (np.sqrt(2.0) * waves.std(axis=0))
    assert np.all(relative_peak_factor[:THROTTLE] < 1.3)
    assert np.all(np.abs(waves[0]) < 0.05)


def test_chosen_phases_are_better_than_equal_ones():
    harmonics = np.arange(2, 30, dtype=np.int64)
    angle = np.linspace(0.0, 2.0 * np.pi, 2000)[:, None] * harmonics
    best = np.abs(np.cos(angle + low_peak_phases(harmonics)).sum(axis=1)).max()
    equal = np.abs(np.cos(angle).sum(axis=1)).max()
    assert best < 0.4 * equal


@pytest.mark.parametrize("seconds", [60.0, 120.0, 300.0])
def test_a_plan_moves_every_control_and_ends_in_cruise(aircraft, seconds):
    plan = flight_plan(times(seconds), prepare(aircraft).excitation)
    assert np.all(np.abs(plan.controls).max(axis=0) > 0.0)
    assert np.abs(plan.bank).max() > 0.5
    assert plan.airspeed.max() > 1.2 * plan.airspeed.min()
    end = plan.time > seconds - 4.0
    assert not plan.controls[end].any()
    assert not plan.bank[end].any()


def test_two_cycles_have_opposite_signs(aircraft):
    plan = flight_plan(times(240.0), prepare(aircraft).excitation)
    half = len(plan.time) // 2
    aileron = plan.controls[:, 1]
    np.testing.assert_allclose(aileron[:half], -aileron[half:], atol=0.15)
    assert np.corrcoef(aileron[:half], aileron[half:])[0, 1] < -0.95


@pytest.mark.long_after_the_first
@pytest.mark.parametrize(
    ("seconds", "turbulence", "seeds"),
    [
        (60.0, "none", 1),
        (120.0, "light", 1),
        *(
            pytest.param(*flights, marks=pytest.mark.long)
            for flights in ((60.0, "none", 3), (120.0, "light", 3), (600.0, "light", 1))
        ),
    ],
)
def test_flights_stay_where_the_model_holds(aircraft, seconds, turbulence, seeds):
    for seed in range(seeds):
        truth = simulate_samples(aircraft, seed, seconds, turbulence=turbulence).truth
        assert np.degrees(np.abs(truth.alpha)).max() < 12.0
        assert np.degrees(np.abs(truth.beta)).max() < 12.0
        assert truth.height.min() > 60.0
        assert truth.height.max() < 250.0


@pytest.mark.long
def test_every_parameter_can_be_told_from_the_others(aircraft, flight):
    """No regressor is nearly a combination of those beside it, and noise of the sensors does not hide it."""
    truth = flight.truth[::8]
    scale = 0.5 * truth.density * truth.airspeed**2 * aircraft.wing_area
    half_span = aircraft.span / (2.0 * truth.airspeed)
    signals = {
        "alpha": truth.alpha, "beta": truth.beta, "p": truth.rates[:, 0] * half_span,
        "q": truth.rates[:, 1] * aircraft.chord / truth.airspeed, "r": truth.rates[:, 2] * half_span,
        "de": truth.controls[:, 0], "da": truth.controls[:, 1], "dr": truth.controls[:, 2],
        "Tc": truth.controls[:, 5] / scale,
    }  # fmt: skip
    accelerometer = aircraft.sensors["accelerometer"].noise[0] * aircraft.mass / scale.mean()
    for axis in ("CX", "CY", "CZ"):
        regressors = aircraft.model.regressors(axis, signals)
        assert np.linalg.cond(regressors / np.linalg.norm(regressors, axis=0)) < 60.0
        deviation = accelerometer * np.sqrt(np.diag(np.linalg.inv(regressors.T @ regressors)))
        names = aircraft.model.parameter_names[aircraft.model.axis_slice(axis)]
        values = np.abs([aircraft.coefficients[name] for name in names])
        assert np.all(deviation < 0.12 * values), dict(zip(names, deviation / values, strict=True))


def without(aircraft, *signals):
    """The aeroplane, made symmetric, without terms of some signals."""
    terms = {axis: [t for t in texts if t not in signals] for axis, texts in aircraft.model.terms.items()}
    sideways = dict.fromkeys(("CY_0", "Cl_0", "Cn_0"), 0.0)
    return aircraft_from_dict(
        {**aircraft.source, "model": terms, "coefficients": {**aircraft.coefficients, **sideways}}
    )


@pytest.mark.parametrize("signal", ["da", "p"])
def test_an_aeroplane_that_the_autopilot_cannot_bank_is_refused(aircraft, signal):
    with pytest.raises(InputError, match=f"cannot be simulated.*Cl_{signal}"):
        prepare(without(aircraft, signal))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("signals", [("dr",), ("dr", "beta")])
def test_a_flying_wing_without_a_rudder_has_none_that_moves(aircraft, signals):
    assert prepare(without(aircraft, *signals)).excitation.rudder == 0.0
