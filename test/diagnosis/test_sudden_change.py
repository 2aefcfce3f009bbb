"""A change at one moment is found whatever its cause, and an effect that explains less is not named in its place."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from test_tied_fit import flight_of as random_flight

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.commands.diagnose import render
from aircraft_sysid_ros.diagnosis.diagnose import diagnose
from aircraft_sysid_ros.diagnosis.finding import explains_more
from aircraft_sysid_ros.diagnosis.flight.reconstruction import fit_sensor_noise, reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.diagnosis.model_versions.requests import parse_request
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.search.sudden_change import sudden_change
from aircraft_sysid_ros.diagnosis.search_round import SearchRound, null_of
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.simulation.dynamics import Effect as Term
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

MOMENT = 52.0
STEP = f"max(sign(time-{MOMENT}),0)"
#: A fin that comes loose: it carries less side force, and yaws and rolls the aeroplane less. No effect is all of this.
LOOSE = (Term("CY", f"{STEP}*dr", -0.08), Term("Cn", f"{STEP}*beta", -0.04), Term("Cl", f"{STEP}*alpha", -0.05))
CHANGES = [BY_ID[n] for n in ("control_damage", "stuck_control", "parameter_change", "cg_shift", "landing_gear")]


def bench_of(aircraft):
    samples = simulate_samples(aircraft, seed=5, duration=100.0).samples
    seen = fit_sensor_noise(aircraft, samples)
    return CandidateEvaluator(settled_flight(reconstruct(seen, samples, with_covariance=False)))


@pytest.fixture(scope="module")
def loose_fin(aircraft):
    samples = simulate_samples(aircraft, seed=5, duration=100.0, effects=LOOSE).samples
    return diagnose_flight(aircraft, samples, CHANGES, replicas=2)


@pytest.fixture(scope="module")
def bench_of_loose_fin(loose_fin):
    return CandidateEvaluator(loose_fin.flight)


@pytest.mark.long
def test_moment_axes_and_terms_are_those_of_the_simulation(bench_of_loose_fin):
    change = sudden_change(bench_of_loose_fin)
    assert change is not None
    assert change.candidate.moment == pytest.approx(MOMENT, abs=1.5)  # no better than the inputs about it tell
    found = {(axis, terms[0]) for axis, terms in change.candidate.changed.items()}
    assert {("Cn", "beta"), ("Cl", "alpha")} <= found
    sizes = {a: g.parameters[0] for a, g in change.gains.items()}
    assert sizes["Cn"] == pytest.approx(-0.04, rel=0.1) and sizes["Cl"] == pytest.approx(-0.05, rel=0.1)


@pytest.mark.long
def test_a_flight_in_which_nothing_changes_has_none_of_size(aircraft):
    change = sudden_change(bench_of(aircraft))
    assert change is None or change.score < 0.5


@pytest.mark.parametrize("begin", [5.0, 60.0])
def test_what_is_there_nearly_from_the_beginning_is_no_change(aircraft, begin):
    """An effect that the model lacks is best explained from the earliest time on that is tried: it has no moment."""

    def lacking(c, after, f):
        c[:, 3] -= 0.1 * f["alpha"] * (f["time"] > begin)
        return c

    change = sudden_change(CandidateEvaluator(random_flight(aircraft, lacking)))
    assert (change is None) == (begin < 10.0)
    assert change is None or dict(change.candidate.inner)["t0"] == pytest.approx(begin, abs=3.0)


@pytest.mark.long
def test_no_effect_is_named_for_a_change_that_the_library_does_not_know(loose_fin):
    said = loose_fin.json
    assert said["verdict"] == "unexplained"
    first = said["candidates"][0]
    assert first["effect"] is None and {"Cn", "Cl"} <= set(first["axes"])
    assert re.search("from 5[123] s on", said["advice"]) and "C_n has a part in beta" in said["advice"]
    assert first["error_after"] < 0.5 * first["error_before"]


@pytest.mark.long
def test_the_expression_of_a_change_can_be_added(loose_fin):
    terms = parse_request(loose_fin.json["candidates"][0]["expression"])
    assert {"Cn", "Cl"} <= set(terms) and all("time" in text for texts in terms.values() for text in texts)


@pytest.mark.long
def test_the_command_prints_what_is_to_be_added(loose_fin):
    said = loose_fin.json
    printed = render({"model": "base", "notes": [], **said})
    assert f'to add: "{said["candidates"][0]["expression"]}"' in printed


@pytest.mark.long
def test_controls_that_are_not_measured_or_do_not_move_are_no_terms(bench_of_loose_fin):
    """A flying wing has no rudder, and here its ailerons stay where they are."""
    data = bench_of_loose_fin.data
    signals = data.signals.copy()
    signals[:, SIGNAL_INDEX["dr"]], signals[:, SIGNAL_INDEX["da"]] = np.nan, 0.017
    names = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
    terms = {axis: [t for t in data.model.terms[axis] if t not in ("dr", "da")] for axis in names}
    wing = replace(data.aircraft, model=model_from_terms(terms))
    change = sudden_change(CandidateEvaluator(replace(data, aircraft=wing, signals=signals)))
    assert change is not None and change.candidate.moment == pytest.approx(MOMENT, abs=2.0)
    changed = change.candidate.changed
    assert "Cn" in changed and not {"dr", "da"} & {term for axis in changed.values() for term in axis}


@pytest.mark.long
def test_a_change_is_nobody_s_company(loose_fin):
    for candidate in loose_fin.json["candidates"]:
        assert set(candidate["confounded_with"]) <= set(BY_ID)


@pytest.mark.long
def test_a_change_that_the_library_knows_keeps_its_name(aircraft):
    """Half of an elevator lost: the same share of moment and lift, roll in proportion to it, and no more."""
    lost = [
        Term("Cm", f"{STEP}*de", 0.25),
        Term("CZ", f"{STEP}*de", 0.25 * 0.0983 / 0.8488),
        Term("Cl", f"{STEP}*de", 0.02),
    ]
    samples = simulate_samples(aircraft, seed=6, duration=100.0, effects=lost).samples
    said = diagnose_flight(aircraft, samples, CHANGES, replicas=3).json
    assert (said["verdict"], said["candidates"][0]["effect"]) == ("missing", "control_damage")
    assert said["candidates"][0]["label"] == "control_damage (one half of the elevator)"


@pytest.mark.long
def test_a_change_takes_nothing_with_it_that_was_always_there(aircraft):
    """Flaps go out, and the throttle with them: the torque of the propeller is no part of what happened."""
    flight = random_flight(aircraft)
    signals, measured = flight.signals.copy(), flight.measured.copy()
    power = 0.3 * (flight.time > 60.0) + 0.02 * np.sin(flight.time)
    signals[:, SIGNAL_INDEX["Tc"]] += power
    measured[:, [0, 3]] += np.outer(power, [1.0, 0.0]) + np.outer(signals[:, SIGNAL_INDEX["Tc"]], [0.0, -0.1])
    measured[flight.time > 60.0, 2] -= 0.2
    measured[flight.time > 60.0, 4] -= 0.05
    measured[:, 4] += 0.5 * signals[:, SIGNAL_INDEX["r"]]
    bench = CandidateEvaluator(replace(flight, signals=signals, measured=measured))
    swept = sudden_change(bench).candidate.changed
    assert {"CZ", "Cm", "Cl"} <= set(swept) and "r" in swept["Cm"]

    def of(*library):
        first = {axis: fit.nrmse_held_out for axis, fit in bench.fits.items()}
        null = null_of([], [BY_ID[name] for name in library], tuple(bench.fits))
        return SearchRound(bench, [], null, [BY_ID[name] for name in library], lambda share: None, None, first, {})

    assert {axis: [*terms] for axis, terms in of("propeller_torque")._change().candidate.changed.items()} == {
        "CZ": ["1"], "Cm": ["1"]
    }  # fmt: skip
    assert "Cl" in of("stall")._change().candidate.changed


@pytest.mark.long
def test_an_expression_must_explain_clearly_more(loose_fin):
    """The change against itself explains nothing more; against one of its axes alone it does."""
    bench = CandidateEvaluator(loose_fin.flight)
    change = sudden_change(bench)
    assert not explains_more(change, change)
    part = bench.best_of(BY_ID["parameter_change"])
    assert explains_more(change, part) and not explains_more(part, change)


@pytest.mark.long
def test_a_library_that_knows_nothing_of_it_says_nothing_of_it(loose_fin):
    """The change is a rival of names: where no effect is significant, none is refused."""
    found = diagnose(CandidateEvaluator(loose_fin.flight), loose_fin.replicas, [BY_ID["propeller_torque"]])
    assert all(f.trial.candidate.effect is None for f in found.found)
    assert np.isfinite(list(found.floor.values())).all()
