"""All intervals of a change at once: against the fit with the column itself, and where single steps mislead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.search.intervals import _AxisSums, best_intervals
from aircraft_sysid_ros.effects import effect_of
from aircraft_sysid_ros.effects.effect import PULSE, fill

STEP, SPAN = 0.1, (251.0, 513.0)


def flight_of(aircraft, seed: int, with_flaps: bool = True) -> FlightData:
    """A quarter of an hour of steady flight at one speed after another, with some doublets, and flaps out for a while.

    Lift carries the weight: with the flaps out the angle of attack is less, and C_Z is what it was.
    """
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 900.0, STEP)
    legs = np.repeat(random.choice([80.0, 90.0, 100.0, 110.0], 18), round(50.0 / STEP))[: len(time)]
    speed = np.convolve(np.pad(legs, 50, mode="edge"), np.ones(101) / 101, mode="valid")[: len(time)]
    out = ((time >= SPAN[0]) & (time < SPAN[1])) * with_flaps
    flaps = np.convolve(np.pad(out.astype(float), (20, 0), mode="edge"), np.ones(21) / 21, mode="valid")
    lift = -0.4 * (95.0 / speed) ** 2 + 0.01 * np.sin(0.3 * time) * random.normal()
    elevator = 0.03 * np.sign(np.sin(2.1 * time)) * (np.mod(time, 90.0) < 12.0) + 0.002 * random.normal(size=len(time))
    alpha = (lift + 0.1 + 0.25 * flaps + 0.7 * elevator) / -5.0
    signals = np.full((len(time), SIGNAL_COUNT), np.nan)
    rate = 0.02 * np.gradient(alpha, STEP)
    for name, values in {
        "alpha": alpha, "q": rate, "de": elevator, "V": speed, "qbar": 0.5 * speed**2, "time": time,
        "Tc": 0.03 + 0.01 * np.sin(0.05 * time),
    }.items():  # fmt: skip
        signals[:, SIGNAL_INDEX[name]] = values
    measured = np.full((len(time), 6), np.nan)
    exact = {
        0: -0.03 + 2.0 * alpha**2 - 0.012 * flaps + signals[:, SIGNAL_INDEX["Tc"]], 2: lift,
        4: 0.03 - 0.6 * alpha - 9.0 * rate - 1.1 * elevator - 0.02 * flaps,
    }  # fmt: skip
    for axis, values in exact.items():
        measured[:, axis] = values + 0.004 * random.normal(size=len(time))
    return FlightData(aircraft, time, measured, signals, STEP)


@pytest.mark.parametrize("texts", [("1",), ("1", "alpha")])
def test_the_gain_of_an_interval_is_that_of_the_fit_with_its_column(aircraft, texts):
    flight = flight_of(aircraft, 1)
    fit = CandidateEvaluator(flight).fits["CZ"]
    spans = np.array([[100.3, 171.2], [251.0, 513.0], [33.0, 880.0], [600.0, 611.0]])
    found = _AxisSums(flight, fit, texts, {}).log_ratios(*spans.T)
    for (begin, end), ratio in zip(spans, found, strict=True):
        pulse = fill(PULSE, {"t0": begin, "t1": end})
        gain = fit.gain(flight.columns(flight.parsed([f"{pulse}*({text})" for text in texts])))
        assert ratio == pytest.approx(np.log(gain.fitted_before / gain.fitted_after), rel=1e-6)


def test_flaps_that_steady_flight_hides_are_found_by_their_two_edges(aircraft):
    """Angle of attack and speed stand for them but for the seconds in which they move."""
    for seed in (1, 2):
        bench = CandidateEvaluator(flight_of(aircraft, seed))
        best = bench.best_of(effect_of("unrecorded_flaps"))
        inner = dict(best.candidate.inner)
        assert (inner["t0"], inner["t1"]) == pytest.approx((SPAN[0] + 1.0, SPAN[1] + 1.0), abs=1.5)  # they take 2 s
        assert best.gains["CZ"].parameters[0] == pytest.approx(-0.25, rel=0.1)
        assert best.score > 1.5 * bench.best_of(effect_of("stall")).score


def test_the_best_interval_comes_first_and_none_is_shorter_than_can_be_judged(aircraft):
    flight = flight_of(aircraft, 3)
    bench, (variant,) = CandidateEvaluator(flight), effect_of("unrecorded_flaps").variants
    found = list(best_intervals(flight, bench.fits, variant, bench.base))
    assert 1 <= len(found) <= 3 and all(each["t1"] - each["t0"] >= 10.0 for each in found)
    assert (found[0]["t0"], found[0]["t1"]) == pytest.approx((SPAN[0] + 1.0, SPAN[1] + 1.0), abs=1.5)
    assert not list(best_intervals(flight, {}, variant, bench.base))


@pytest.mark.parametrize("since_start", [0.0, 777.0])
def test_times_count_from_the_start_of_the_recording(aircraft, since_start):
    """The flight that is judged may begin long after it."""
    flight = flight_of(aircraft, 3)
    signals = flight.signals.copy()
    signals[:, SIGNAL_INDEX["time"]] += since_start
    bench = CandidateEvaluator(flight.with_signals(signals))
    (variant,) = effect_of("unrecorded_flaps").variants
    (first, *_) = best_intervals(bench.data, bench.fits, variant, bench.base)
    assert (first["t0"], first["t1"]) == pytest.approx(
        (SPAN[0] + 1.0 + since_start, SPAN[1] + 1.0 + since_start), abs=1.5
    )


def test_a_change_that_is_not_undone_in_what_was_measured_has_no_end(aircraft):
    """Beginnings are found to the second together with an end; without it the same change has a number less."""
    for begin in (311.37, 412.8, 500.1):
        flight = flight_of(aircraft, 5, with_flaps=False)
        measured = flight.measured.copy()
        measured[:, 2] -= 0.25 * (flight.time >= begin)
        measured[:, 4] -= 0.02 * (flight.time >= begin)
        measured[flight.time > 880.0] = np.nan
        best = CandidateEvaluator(replace(flight, measured=measured)).best_of(effect_of("unrecorded_flaps"))
        assert dict(best.candidate.inner) == {"t0": pytest.approx(begin, abs=0.25)}
