"""How large a finding is said to be, against what was hidden: kilograms, centimetres, shares, degrees and newtons."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.term_values import evaluate
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.how_large import AddedTerms, Fitted, added_terms, how_large
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate, with_inner
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.effects import effect_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

NUMBER = r"(-?[\d.]+) ± ([\d.]+)"


def told(aircraft, identifier, seed, strength=1.0):
    """What is said of the true candidate of a flight that hides an effect, its trial, and what was hidden."""
    flown = simulate_samples(aircraft, seed, 60.0, hidden=[(identifier, strength)])
    (hidden,) = flown.hidden
    data = settled_flight(reconstruct(aircraft, flown.samples, with_covariance=False))
    bench, effect = CandidateEvaluator(data), effect_of(identifier)
    variant = next(each for each in effect.variants if each.name == hidden.variant)
    trial = bench.trial(with_inner(effect, variant, {"t0": hidden.inner["t0"]}, bench.base))
    assert trial is not None
    return how_large(added_terms(data, trial)), trial, hidden, data


def numbers_of(text):
    return [(float(value), float(std)) for value, std in re.findall(NUMBER, text)]


def test_a_mass_is_said_in_kilograms(aircraft):
    text, _, hidden, _ = told(aircraft, "mass_change", 3)
    ((value, _std),) = numbers_of(text)
    assert value == pytest.approx((1.0 - hidden.mass_factor) * aircraft.mass, rel=0.15)
    assert f"{text.split(' kg ')[1].split(' ')[0]}" == "less"


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long), pytest.param(5, marks=pytest.mark.long)])
def test_a_shift_of_the_centre_of_gravity_is_said_in_centimetres(aircraft, seed):
    text, _, hidden, _ = told(aircraft, "cg_shift", seed)
    value = float(re.search(r"about ([\d.]+) cm", text)[1])
    along = hidden.variant == "along the fuselage"
    moved = hidden.cg_shift[0] if along else hidden.cg_shift[1]
    way = ("aft" if moved < 0.0 else "forward") if along else ("to the right" if moved > 0.0 else "to the left")
    assert value == pytest.approx(100.0 * abs(moved), rel=0.25) and f"cm {way}" in text


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.long), pytest.param(7, marks=pytest.mark.long)])
def test_of_a_surface_a_share_is_lost_and_it_stands_at_an_angle(aircraft, seed):
    text, trial, hidden, _ = told(aircraft, "stuck_control", seed)
    share, angle = numbers_of(text)
    axis, signal = next(
        (a, t) for a in trial.gains for t in ("de", "da", "dr") if trial.candidate.ties[a][0].of.endswith(t)
    )
    (term,) = (t for t in hidden.terms if t.axis == axis)
    one, none = (evaluate([parse_expression(term.expression)], {"time": 1e6, signal: x})[0, 0] for x in (1.0, 0.0))
    slope, stuck = float(one - none), -float(none) / float(one - none)
    whole = dict(aircraft.coefficients)[f"{axis}_{signal}"]
    assert share[0] == pytest.approx(-100.0 * slope * term.value / whole, abs=max(4.0 * share[1], 3.0))
    assert angle[0] == pytest.approx(np.degrees(stuck), abs=max(4.0 * angle[1], 0.3))


def test_newtons_are_those_of_what_was_hidden(aircraft):
    text, trial, hidden, data = told(aircraft, "control_damage", 4)
    ((share, std),) = numbers_of(text)
    assert 0.0 < std < share
    axis = trial.main_axis
    term = next(t for t in hidden.terms if t.axis == axis)
    length = {"Cl": aircraft.span, "Cm": aircraft.chord, "Cn": aircraft.span}.get(axis, 1.0)
    part = data.columns(data.parsed([term.expression]))[:, 0] * term.value
    part = part * data.signal("qbar") * aircraft.wing_area * length
    rms = np.sqrt(np.mean(part[np.isfinite(part) & (part != 0.0)] ** 2))
    assert float(re.search(r"makes ([\d.]+) N", text)[1]) == pytest.approx(rms, rel=0.1)


@pytest.mark.parametrize(
    ("terms", "said"),
    [
        ([Fitted(0.1, 0.01), Fitted(0.004, 0.001)], ["50.0 ± 5.1 %", "stands at -2.29 ± 0.62 deg"]),
        ([Fitted(0.1, 0.01), Fitted(np.nan, np.nan)], ["50.0 ± 5.1 %"]),
        ([Fitted(0.1, 0.01), Fitted(0.004, 0.05)], ["50.0 ± 5.1 %"]),  # to 29 degrees
        ([Fitted(-0.1, 0.01), Fitted(np.nan, np.nan)], []),  # more of it
        ([Fitted(0.1, 0.09), Fitted(0.004, 0.001)], []),
        ([Fitted(np.nan, np.nan), Fitted(np.nan, np.nan)], []),
    ],
)
def test_what_the_flight_does_not_determine_is_not_said(aircraft, terms, said):
    """C_l += C_l,da (a da + b) with C_l,da = -0.2."""
    variant = next(each for each in effect_of("stuck_control").variants if each.name == "aileron")
    texts = ("max(sign(time-30),0)*da", "max(sign(time-30),0)")
    candidate = Candidate(effect_of("stuck_control"), "aileron", (("t0", 30.0),), {"Cl": texts}, ties=variant.ties)
    nothing = np.full(5, np.nan)
    flight = SimpleNamespace(
        aircraft=aircraft,
        parsed=list,
        columns=lambda programs: np.ones((5, len(programs))),
        signal=lambda name: nothing,
    )
    model = {"Cl_da": Fitted(-0.2, 0.004)}
    text = how_large(AddedTerms(flight, candidate, "Cl", {"Cl": terms}, model))
    assert "nan" not in text and text.count("±") == len(said)
    for each in said:
        assert each in text, text


def test_a_mass_that_falls_little_by_little_is_that_at_the_end(aircraft):
    candidate = Candidate(effect_of("mass_change"), "", (("t0", 20.0), ("full", 90.0)), {"CZ": ("ramp",)})
    time = np.arange(0.0, 120.0)
    ramp = np.clip((time - 20.0) / 70.0, 0.0, 1.0)
    flight = SimpleNamespace(
        aircraft=aircraft, parsed=list, signal=lambda name: time if name == "time" else np.full(120, 200.0),
        columns=lambda programs: np.column_stack([-0.5 * ramp if p == "ramp" else np.ones(120) for p in programs]),
        model=SimpleNamespace(terms={"CZ": ("1", "ramp")}, programs=[(), (), ("1", "ramp")]),
    )  # fmt: skip
    model = {"CZ_0": Fitted(-0.5, 0.001), "CZ_ramp": Fitted(0.25, 0.005)}
    text = how_large(AddedTerms(flight, candidate, "CZ", {"CZ": [Fitted(0.25, 0.005)]}, model))
    (value, _std), *_ = numbers_of(text)
    assert value == pytest.approx(aircraft.mass * (1.0 - 1.0 / 1.25), rel=0.02) and "less" in text
