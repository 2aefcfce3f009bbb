"""What a vane that nobody has described makes of coefficients by being late is no memory of the flow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis.finding import Finding
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.late_vane import delay_that_explains
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator, expressions
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.dynamics import Effect as Added
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

LATE = 0.04  # [s]


def without_sensors(aircraft):
    return aircraft_from_dict({key: value for key, value in aircraft.source.items() if key != "sensors"})


def bench_of(aircraft, samples):
    return CandidateEvaluator(settled_flight(reconstruct(aircraft, samples, with_covariance=False)))


@pytest.fixture(scope="module")
def samples(aircraft):
    flown = simulate_samples(aircraft, 21, 60.0).samples
    late = np.isin(flown.kind, [Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP])
    return replace(flown, stamp=flown.stamp + np.where(late, round(LATE * 1e9), 0))


@pytest.fixture(scope="module")
def bench(aircraft, samples):
    """Of a flight whose vanes are late, which the aircraft file does not say."""
    return bench_of(without_sensors(aircraft), samples)


def expression(bench, axis, text):
    return bench.trial(next(c for c in expressions(bench.data) if c.terms.get(axis) == (text,)))


@pytest.mark.long
@pytest.mark.parametrize(("axis", "text"), [("Cn", "V*beta_dot"), ("Cm", "alpha_dot")])
def test_a_rate_of_an_angle_is_its_vane(bench, axis, text):
    trial = expression(bench, axis, text)
    first = bench.fits[axis].nrmse_held_out
    late = delay_that_explains(bench, trial, first)
    assert 0.5 * LATE < late < 1.4 * LATE  # the pull of noise in the rate is towards less
    finding = Finding(trial, bench.data, 99.0, 9.0, 0.0, 0.5, 9.0, late_vane=late)
    assert "ms late explains it as well" in finding.refusal(first=True) and not finding.matters


@pytest.mark.long
def test_a_vane_that_is_described_is_as_it_says(aircraft, samples):
    said = {**aircraft.source, "sensors": {"air_data": {"delay": 0.0}}}
    bench = bench_of(aircraft_from_dict(said), samples)
    first = bench.fits["Cn"].nrmse_held_out
    assert np.isnan(delay_that_explains(bench, expression(bench, "Cn", "V*beta_dot"), first))


@pytest.mark.long
def test_a_memory_that_the_lift_does_not_share_is_none_of_the_vane(aircraft):
    """The downwash reaches the tail late, which is in the moment: as late a vane would be in the lift, too."""
    lag = [Added("Cm", "alpha_dot", -12.0)]
    bench = bench_of(without_sensors(aircraft), simulate_samples(aircraft, 21, 60.0, effects=lag).samples)
    trial = expression(bench, "Cm", "alpha_dot")
    assert np.isnan(delay_that_explains(bench, trial, bench.fits["Cm"].nrmse_held_out))


@pytest.mark.long
@pytest.mark.parametrize(("axis", "value", "refused"), [("CZ", 18.0, True), ("Cm", 4.0, True), ("Cm", -6.0, False)])
def test_a_lag_of_the_downwash_has_the_sign_and_the_size_of_one(aircraft, axis, value, refused):
    added = [Added(axis, "alpha_dot", value)]
    bench = bench_of(aircraft, simulate_samples(aircraft, 22, 60.0, effects=added).samples)
    said = Finding(bench.best_of(BY_ID["alpha_dot"]), bench.data, 9.0, 9.0, 0.0, 0.5, 9.0).impossible
    assert said == (f"its derivative of {axis[0]}_{axis[1]} is outside its possible range" if refused else "")


def test_numbers_at_their_limits_are_those_of_something_else(bench):
    """A stall at 5 degrees, as wide and as quick as it may be, was what was left of a vane and of a curved lift."""
    trial = bench.best_of(BY_ID["dynamic_stall"])
    onset = dict(trial.candidate.inner)["onset"]
    for width, lag, words in ((0.075, 0.1, "its width and lag are at their limits"), (0.04, 0.4, "")):
        inner = (("onset", onset), ("width", width), ("lag", lag))
        there = replace(trial, candidate=replace(trial.candidate, inner=inner))
        edges = Finding(there, bench.data, 9.0, 9.0, 0.0, 0.5, 9.0)._at_edges
        assert ("width" in edges and "lag" in edges) == bool(words)


def test_beside_a_sideslip_that_nothing_shows_the_rate_is_that_of_the_vane(bench):
    """The motion gives no rate of the angle of attack then: the search of the whole library had ended there."""
    names = bench.data.model.signal_names
    signals = bench.data.signals.copy()
    signals[:, [names.index(name) for name in ("beta", "alpha_dot", "beta_dot")]] = np.nan
    blind = CandidateEvaluator(bench.data.with_signals(signals))
    trial = blind.trial(Candidate(None, "", (), {"Cm": ("lag(alpha, 0.1)",)}))
    late = delay_that_explains(blind, trial, blind.fits["Cm"].nrmse_held_out)
    assert 0.5 * LATE < late < 1.4 * LATE
    signals[:, names.index("alpha")] = np.where(np.arange(len(signals)) % 2, np.nan, signals[:, names.index("alpha")])
    apart = CandidateEvaluator(bench.data.with_signals(signals))
    assert np.isnan(delay_that_explains(apart, apart.trial(Candidate(None, "", (), {"Cm": ("V",)})), 1.0))
