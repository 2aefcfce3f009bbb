"""``explain``: the most important thing first, nothing stated that is not known, and nothing half-written."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight.check import CheckedRecording
from aircraft_sysid_ros.after_flight.explanation import instruments
from aircraft_sysid_ros.after_flight.explanation.aeroplane import Fact, Learnt, apparent_mass, facts_of, known_modes
from aircraft_sysid_ros.after_flight.explanation.explain import (
    _lacking,
    _with_flight,
    _with_outputs,
    _without_what_is_checked,
    with_gps_in_time,
)
from aircraft_sysid_ros.after_flight.explanation.first_sentence import Evidence, Said, what_matters
from aircraft_sysid_ros.after_flight.explanation.instruments import LONGEST_BOOM, as_diagnosed, instrument_errors
from aircraft_sysid_ros.after_flight.explanation.next_flight import next_flights
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.commands import explain as explain_command
from aircraft_sysid_ros.commands.explain import _mode_line
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.compare import compare
from aircraft_sysid_ros.diagnosis.flight.constant_errors import Offset, air_data_errors, offset_of
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.words import headline
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_check.check import Checked
from aircraft_sysid_ros.flight_check.finding import ABSENT, Finding
from aircraft_sysid_ros.flight_check.identifiable import Identifiability
from aircraft_sysid_ros.identification.coefficients.as_loaded import as_loaded
from aircraft_sysid_ros.identification.conditions import TELL_FLOW, throttle_instead
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.reconstruction.state import contradiction_text
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS
from aircraft_sysid_ros.samples import Kind, samples_of
from aircraft_sysid_ros.simulation.calibration_flight import calibration_flight
from aircraft_sysid_ros.workbench import explain_page

USED = {"used": (30, 32)}


def check_json(*findings, shown: int = 32) -> dict:
    """What a check says."""
    return {
        "findings": [dict(zip(("signal", "kind", "severity", "sentence"), each, strict=True)) for each in findings],
        "identifiable": {f"Cm_{k}": k < shown for k in range(32)},
    }


def candidate(effect: str, kind: str, **more) -> dict:
    """What a diagnosis has found."""
    return {
        "effect": effect, "kind": kind, "name": effect, "label": effect, "found": True, "confounded_with": [],
        "main_axis": "CZ", "error_before": 0.3, "error_after": 0.1, "where": "0 to 5 s", "manoeuvre": "", **more,
    }  # fmt: skip


WRONG_UNIT = ("angle_of_attack", "unit", "error", "it is in degrees")
REPEATED = ("rudder", "held", "warning", "each value is repeated 2.0 times")
LATE = ("elevator", "offset", "warning", "it comes 0.15 s late")
FOLLOWS = ("latitude", "offset", "warning", "it keeps time with elevator, which comes 0.15 s later than it should")
STALL = {"candidates": [candidate("stall", "aerodynamic")], "advice": "", "unknown": {}}
DIHEDRAL = {"candidates": [candidate("dihedral_alpha", "aerodynamic", main_axis="Cl", axes=["Cl"])]}
SLOW_SERVO = {"candidates": [candidate("rate_limit", "aerodynamic", main_axis="Cl", axes=["Cl"])]}
NO_VANES = [(name, "missing", "info", f"{ABSENT}: fly without") for name in ("angle_of_attack", "sideslip")]
SCALE = {"candidates": [candidate("airspeed_scale", "measurement")], "advice": "", "unknown": {}}
CUT = {"candidates": [candidate("loss_of_thrust", "change in flight")], "advice": "No thrust.", "replicas": 0}
HELD = {"candidates": [candidate("stuck_control", "change in flight")], "advice": "It is held.", "replicas": 0}
NO_AIR = ("true_airspeed", "missing", "warning", "not in the recording: dynamic pressure is unknown")
SMALL_MARGIN = Fact("static_margin", "stability", "static margin", 2.0, 0.3, "%", "stable in pitch")


@pytest.mark.parametrize(
    ("evidence", "kinds"),
    [
        (Evidence(check_json(WRONG_UNIT, LATE), (3, 32), diagnosis=STALL), ["check unit", "check offset"]),
        (Evidence(check_json(shown=5), (4, 32)), ["motion"]),
        (Evidence(check_json(LATE, shown=5), (0, 32), diagnosis=CUT), ["loss_of_thrust", "motion", "check offset"]),
        (Evidence(check_json(shown=5), (4, 32), diagnosis=STALL), ["stall", "motion"]),
        (Evidence(check_json(NO_AIR, shown=5), (0, 32)), ["check missing"]),
        (Evidence(check_json(NO_AIR, shown=5), (0, 32), calm_air=True), ["calm air"]),
        (Evidence(check_json(WRONG_UNIT, NO_AIR), (0, 32)), ["check unit", "check missing"]),
        (Evidence(check_json(WRONG_UNIT, NO_AIR), (0, 32), calm_air=True), ["check unit"]),
        (Evidence(check_json(LATE), **USED, diagnosis=STALL), ["check offset", "stall"]),
        (Evidence(check_json(LATE), **USED, diagnosis=HELD), ["stuck_control"]),
        (Evidence(check_json(REPEATED), **USED, diagnosis=STALL), ["stall", "check held"]),
        (Evidence(check_json(REPEATED, WRONG_UNIT), **USED), ["check unit", "check held"]),
        (Evidence(check_json(LATE), **USED, diagnosis=SLOW_SERVO), ["check offset"]),
        (Evidence(check_json(), **USED, diagnosis=SLOW_SERVO), ["rate_limit"]),
        (Evidence(check_json(LATE, FOLLOWS), **USED), ["check offset"]),
        (Evidence(check_json(FOLLOWS), **USED), ["check offset"]),
        (Evidence(check_json(), **USED, diagnosis=SCALE, facts=[SMALL_MARGIN]), ["airspeed_scale", "balance"]),
        (Evidence(check_json(), **USED, diagnosis=STALL, mass=(2.0, 1.6, 0.02)), ["stall", "mass"]),
        (Evidence(check_json(), **USED, diagnosis=DIHEDRAL, mass=(2.0, 1.6, 0.02)), ["mass", "dihedral_alpha"]),
        (Evidence(check_json(*NO_VANES, shown=5), (4, 32)), ["vanes"]),
        (Evidence(check_json(*NO_VANES, LATE, shown=5), (4, 32)), ["check offset", "vanes"]),
        (Evidence(check_json(), **USED, mass=(2.0, 1.95, 0.001), facts=[SMALL_MARGIN]), ["balance"]),
        (Evidence(check_json(), **USED, facts=[replace(SMALL_MARGIN, reason="HOLD")]), ["nothing"]),
        (Evidence(check_json(), **USED), ["nothing"]),
    ],
)
def test_what_makes_the_rest_wrong_comes_first(evidence, kinds):
    said = what_matters(evidence)
    assert [each.kind for each in said] == kinds
    assert all(each.sentence.endswith((".", ". ")) for each in said)


@pytest.mark.parametrize(("published", "corrected"), [("rls", True), ("rml", False)])
def test_that_parameters_are_corrected_for_late_surfaces_is_said_of_those_that_are(published, corrected):
    """Of a flight in gusts, of which rml was published, the page said both."""
    late = {"delay": (-0.06, 0.003)}
    (said,) = what_matters(Evidence(check_json(), **USED, late=late, published=published))
    assert said.sentence.startswith("Surfaces follow their records 0.060 ± 0.006 s later, as this flight shows: ")
    assert ("parameters are corrected for that" in said.sentence) is corrected
    assert ("parameters of rml are not corrected for that, their standard" in said.sentence) is not corrected


def test_what_the_flight_showed_of_a_sensor_is_said_where_the_check_of_the_log_says_nothing():
    leaks = {"signal": "true_airspeed", "kind": "scale", "severity": "error", "sentence": "it reads 0.83 ± 0.03"}
    heading = {"signal": "attitude.yaw", "kind": "offset", "severity": "warning", "sentence": "it is off by 22°"}
    said = what_matters(
        Evidence(_with_flight(check_json(), {"findings": [leaks, heading]}, []), **USED, diagnosis=STALL)
    )
    assert [each.kind for each in said] == ["check scale", "check offset"], "nothing of what the model lacks"
    assert said[0].sentence == "The log is wrong in true_airspeed: it reads 0.83 ± 0.03."
    known = check_json(("true_airspeed", "unit", "error", "it is in knots"))
    assert _with_flight(known, {"findings": [leaks]}, [])["findings"] == known["findings"], "each signal once"
    gaps = check_json(("true_airspeed", "gap", "warning", "2 gaps of up to 8 s"))
    assert _with_flight(gaps, {"findings": [leaks]}, [])["findings"][-1] == leaks, "samples that are lost are no scale"
    scale = SimpleNamespace(signal="true_airspeed")
    assert _with_flight(check_json(), {"findings": [leaks]}, [scale])["findings"] == []


def _minute(samples):
    return samples[samples.stamp < samples.stamp.min() + 60 * 10**9]


@pytest.fixture(scope="module")
def learnt(aircraft, flight):
    """The model of a minute of the shared flight, all of its parameters to USE."""
    data = settled_flight(reconstruct(aircraft, _minute(flight.samples), with_covariance=True))
    comparison = compare(data)
    return Learnt(comparison, {name: ("USE", "") for name in aircraft.model.parameter_names}), comparison


@pytest.mark.long
def test_the_aeroplane_is_as_its_coefficients_say(learnt, aircraft):
    """Against the truth of the simulation, each within four of its own standard deviations, or 1 %."""
    c = aircraft.coefficients
    facts = {fact.key: fact for fact in facts_of(learnt[0])}
    truth = {
        "static_margin": 100.0 * c["Cm_alpha"] / c["CZ_alpha"], "Cm_alpha": c["Cm_alpha"], "Cn_beta": c["Cn_beta"],
        "Cl_beta": c["Cl_beta"], "Cm_q": c["Cm_q"], "Cl_p": c["Cl_p"], "Cn_r": c["Cn_r"],
        "rudder": -c["Cn_dr"] / c["Cn_beta"],
    }  # fmt: skip
    for key, value in truth.items():
        assert not facts[key].reason
        assert facts[key].value == pytest.approx(value, abs=max(4.0 * facts[key].std, 0.01 * abs(value))), key
    assert (facts["static_margin"].words, facts["Cn_beta"].words) == ("stable in pitch", "the nose turns into the wind")
    assert facts["stall_margin"].words.startswith("at least") and facts["stall_margin"].value > 1.0
    mass, std = apparent_mass(learnt[0])
    assert mass == pytest.approx(aircraft.mass, abs=max(4.0 * std, 0.02 * aircraft.mass))


@pytest.mark.long
def test_modes_have_an_error_and_are_within_it(learnt, aircraft):
    """The truth is the same linearisation with the coefficients that flew; test_modes.py checks that one."""
    found = {mode.name: mode for mode in known_modes(learnt[0])}
    true = Learnt(learnt[1], {})
    true.values = np.array([aircraft.coefficients[name] for name in aircraft.model.parameter_names])
    true.draws, true.unknown = true.draws[:0], dict.fromkeys(true.unknown, "")
    true.draws = np.tile(true.values, (3, 1))
    from aircraft_sysid_ros.after_flight.explanation import aeroplane

    model = aeroplane.flight_model_of(aircraft, 9.80665)
    for mode in aeroplane._modes(true, model, true.values):
        known = found[mode.name]
        assert not known.reason and known.std_frequency > 0.0
        assert known.frequency == pytest.approx(mode.frequency, abs=4.0 * known.std_frequency + 0.02 * mode.frequency)
        assert known.damping == pytest.approx(mode.damping, abs=4.0 * known.std_damping + 0.03)


def test_a_mode_that_cannot_swing_has_a_time_constant_and_no_damping(learnt):
    """Of one eigenvalue the damping is 1 by definition: a number with an error of 0 would be no finding."""
    modes = {mode.name: mode.json for mode in known_modes(learnt[0])}
    for name in ("roll", "spiral"):
        mode = modes[name]
        assert mode["std"]["damping"] is None and abs(mode["growth"]) == pytest.approx(1.0 / mode["time_constant"])
        said = re.search(r"time constant (\S+) ± (\S+) s", _mode_line(mode))
        assert said is not None and "damping" not in _mode_line(mode)
        value, error = map(float, said.groups())
        assert abs(value - mode["time_constant"]) <= error < 0.1 * value  # its digits end where the error does
    assert modes["Dutch roll"]["time_constant"] is None and "damping" in _mode_line(modes["Dutch roll"])


def test_of_an_unstable_aeroplane_no_period_and_no_damping_is_said(learnt):
    """It had a short period of 2.7 rad/s with a damping of 0.9 that doubled in 0.6 s, and pulses to match."""
    names = learnt[0].model.parameter_names
    unstable = Learnt(learnt[1], {name: ("USE", "") for name in names})
    unstable.values, unstable.draws = unstable.values.copy(), unstable.draws.copy()
    k = names.index("Cm_alpha")
    unstable.draws[:, k] += 0.4 - unstable.values[k]
    unstable.values[k] = 0.4
    modes = known_modes(unstable)
    mode = next(mode for mode in modes if mode.growth > 0.1 and not mode.is_first_order)
    told = mode.json
    assert not mode.reason and mode.words.startswith("grows")
    assert told["frequency"] is told["damping"] is told["std"]["frequency"] is told["std"]["damping"] is None
    assert "grows" in _mode_line(told) and "rad/s" not in _mode_line(told)
    assert json.loads(json_text(told)) == told
    unstable.unknown["Cm_q"] = "no motion"
    (sentence,) = (text for text in next_flights(check_json(), unstable, modes, None) if "Cm_q" in text)
    assert "short period" not in sentence


def test_of_an_aeroplane_that_may_be_unstable_no_frequency_is_said(learnt):
    """Its standard error was that of the draws which are stable, as small as if the others were none."""
    names = learnt[0].model.parameter_names
    doubtful = Learnt(learnt[1], {name: ("USE", "") for name in names})
    k = names.index("Cm_alpha")
    doubtful.draws[::3, k] += 0.4 - doubtful.values[k]  # of a third of the draws
    split = [mode for mode in known_modes(doubtful) if mode.name in ("short period", "phugoid")]
    finite = [mode for mode in split if np.isfinite(mode.frequency)]
    assert len(finite) < len(split) and all(mode.json["frequency"] is None for mode in split if mode not in finite)


def test_a_period_has_its_standard_error(learnt):
    """It stood beside a frequency with one as if it were known to three digits."""
    mode = next(mode for mode in known_modes(learnt[0]) if mode.name == "Dutch roll")
    assert mode.period == pytest.approx(2.0 * np.pi / (mode.frequency * np.sqrt(1.0 - mode.damping**2)))
    assert 0.5 < mode.std_period / mode.period / (mode.std_frequency / mode.frequency) < 3.0
    (roll,) = (mode for mode in known_modes(learnt[0]) if mode.name == "roll")
    assert np.isnan(roll.period) and np.isnan(roll.std_period)


def test_what_is_not_to_use_is_not_stated(learnt, aircraft):
    verdicts = {name: ("USE", "") for name in aircraft.model.parameter_names} | {"Cm_q": ("HOLD", "no motion")}
    some = Learnt(learnt[1], verdicts)
    damping = next(fact for fact in facts_of(some) if fact.key == "Cm_q")
    assert damping.reason == "Cm_q is HOLD: no motion" and damping.json["value"] is None
    modes = {mode.name: mode for mode in known_modes(some)}
    assert modes["short period"].json["frequency"] is None and "no motion" in modes["short period"].reason
    assert modes["Dutch roll"].json["frequency"] > 0.0
    (sentence,) = (text for text in next_flights(check_json(), some, list(modes.values()), None) if "Cm_q" in text)
    assert sentence.startswith("Fly elevator doublets")
    blind = next_flights(check_json(("elevator", "missing", "warning", ABSENT)), some, list(modes.values()), None)
    assert blind[0].startswith("Record elevator") and not any("elevator doublets" in text for text in blind)


def test_inputs_of_an_aeroplane_of_its_own_are_among_what_to_fly(learnt, aircraft):
    """Nothing more was needed for a wing of whose elevons nothing was known."""
    elevons = {"Cl": ["1", "p", "left - right"], "Cm": ["1", "q", "left + right"]}
    wing = aircraft_from_dict({**aircraft.source, "inputs": {"left": None, "right": None}, "model": elevons})
    unknown = dict.fromkeys(wing.model.parameter_names, "")
    own = SimpleNamespace(unknown=unknown, aircraft=wing, model=wing.model, flight=learnt[0].flight)
    assert not any("left" in text for text in next_flights(check_json(), own, (), None))
    unknown |= {"Cl_left-right": "not excited", "Cm_left+right": "not excited"}
    (sentence,) = next_flights(check_json(), own, (), None)
    assert sentence.startswith("Fly doublets of left and right, one by one: this flight does not show ")
    assert sentence.endswith(" Cl_left-right and Cm_left+right.")


def test_an_aeroplane_without_rudder_is_told_what_it_can_fly():
    names = {name: False for name in ("Cn_beta", "Cn_r", "Cn_da")}
    without = next_flights({"findings": [], "identifiable": names}, None, (), None)
    assert without[0].startswith("Fly aileron doublets") and not any("rudder" in text for text in without)
    with_one = next_flights({"findings": [], "identifiable": names | {"Cn_dr": True}}, None, (), None)
    assert with_one[0].startswith("Fly rudder doublets")


def test_what_the_model_lacks_is_added_before_anything_is_flown_for_its_axis():
    """Doublets for what the flight shows to a few thousandths, once the model has the effect, had been the advice."""
    names = {name: False for name in ("Cl_beta", "Cl_p", "Cn_beta")}
    check = {"findings": [], "identifiable": names}
    said = next_flights(check, None, (), DIHEDRAL | {"advice": ""})
    assert said[0] == "Add dihedral_alpha to the model (`aircraft-sysid add`) before anything is flown for C_l."
    assert any("Cn_beta" in text for text in said) and not any("Cl_" in text for text in said)


def test_where_nothing_tells_the_angles_of_flow_no_manoeuvre_is_asked_for(aircraft):
    """In a stranger's flights full of doublets, without vanes, more doublets had been asked for."""
    absent = ("angle_of_attack", "missing", "info", "not in the recording: it must come from attitude and flight path")
    unknown, model = dict.fromkeys(aircraft.model.parameter_names, "too uncertain"), aircraft.model

    def said(seconds, *findings, lasts=300.0):
        flight = SimpleNamespace(time=np.arange(0.0, seconds, 0.1), signal=lambda name: np.array([15.0, 16.0]))
        few = SimpleNamespace(unknown=unknown, aircraft=aircraft, model=model, flight=flight)
        return " ".join(next_flights(check_json(*findings) | {"duration": lasts}, few, (), None))

    assert "doublets" in said(300.0, absent) and TELL_FLOW not in said(300.0, absent)
    assert "doublets" not in said(4.0, absent) and TELL_FLOW in said(4.0, absent)
    assert "doublets" in said(4.0, absent, lasts=9.0)  # the flight is short, whatever tells them
    assert "doublets" in said(4.0)  # vanes tell them


def test_what_a_diagnosis_counts_with_is_added_first():
    """Effects alone left 48 % of C_m of a stranger's jet where 18 % was promised with the lag of its servos."""
    late = {"effect": "actuator_lag", "kind": "measurement", "found": True, "axes": [], "confounded_with": []}
    refused = {**late, "effect": "airspeed_scale", "found": False, "terms": {"CX": ["1"]}}  # asked of the forces
    diagnosis = {**DIHEDRAL, "candidates": [late, refused, *DIHEDRAL["candidates"]], "advice": ""}
    first, second, *_ = next_flights({"findings": [], "identifiable": {}}, None, (), diagnosis)
    assert first.startswith("Add actuator_lag first (") and second.startswith("Add dihedral_alpha to the model")


def test_where_nothing_tells_whether_the_airspeed_is_right_circles_are_to_be_flown():
    """In straight flight an airspeed that is 12 % off is a head wind, and `explain` had said that sensors agree."""
    said, untold, sure, unasked, wrong = (
        next_flights(check_json(*each), None, (), None, reads)
        for each, reads in (
            ((), [0.7, 1.3]), ((), [0.65, 9.9]), ((), [0.95, 1.05]), ((), None), ((WRONG_UNIT,), [0.7, 1.3])
        )
    )  # fmt: skip
    assert "this flight shows almost nothing about whether the airspeed is right" in untold[-1]
    assert said[-1].startswith("Fly two full circles with GPS") and " 0.70 to 1.30 of what it should" in said[-1]
    assert not any("circles" in text for text in (*sure, *unasked, *wrong))


def test_of_a_log_that_is_wrong_nothing_is_told_apart():
    found = candidate("stall", "aerodynamic", confounded_with=["icing"], manoeuvre="Slow flight.")
    diagnosis = {"candidates": [found], "advice": "gusts"}
    sound, wrong = (next_flights(check_json(*each), None, (), diagnosis) for each in ((), (WRONG_UNIT,)))
    assert any("Icing" in text or "calm air" in text for text in sound)
    assert not any("Icing" in text or "calm air" in text for text in wrong)


def test_where_a_sensor_holds_all_it_is_to_be_mended_and_nothing_to_be_flown(learnt, aircraft):
    """A vane out on the wing: the same doublets once more, in all axes, had been the advice."""
    verdicts = dict.fromkeys(aircraft.model.parameter_names, ("HOLD", f"{contradiction_text(7)} since 26.1 s"))
    said = next_flights(check_json(), Learnt(learnt[1], verdicts), [], None)
    (text,) = said
    assert text.startswith("Correct that first") and "of the angle of attack contradict" in text
    said = next_flights(check_json(), Learnt(learnt[1], verdicts | {"Cm_q": ("HOLD", "no motion")}), [], None)
    assert [text[:4] for text in said] == ["Corr", "Fly "] and "Cm_q" in said[1]


def test_of_axes_of_which_the_model_lacks_something_nothing_is_stated(learnt, aircraft):
    """A centre of gravity that had moved made the phugoid of the whole flight grow, and ice another mass."""
    used = {name: ("USE", "") for name in aircraft.model.parameter_names}
    some = Learnt(learnt[1], used, lacking={"Cm": "shift of the centre of gravity"})
    facts = {fact.key: fact for fact in facts_of(some)}
    assert facts["Cm_alpha"].reason == "the model of C_m lacks shift of the centre of gravity: add it"
    assert not facts["Cn_beta"].reason and apparent_mass(some) is not None
    modes = {mode.name: mode for mode in known_modes(some)}
    assert {name for name, mode in modes.items() if mode.reason} == {"short period", "phugoid"}
    assert apparent_mass(Learnt(learnt[1], used, lacking={"CX": "icing"})) is None


def test_a_recorded_mass_counts_and_not_that_of_the_file(learnt, aircraft):
    """Coefficients were those of the recorded mass, and what followed from them was that of the file's."""
    used, inertia = {name: ("USE", "") for name in aircraft.model.parameter_names}, aircraft.inertia
    recorded = [1.2 * aircraft.mass, *(1.5 * np.diag(inertia)), -1.5 * inertia[0, 2]]
    flight = learnt[1].flight
    loaded = replace(flight, aircraft=as_loaded(flight.aircraft, samples_of(Kind.MASS, 0, recorded)))
    own, heavy = (Learnt(replace(learnt[1], flight=each), used) for each in (flight, loaded))
    assert apparent_mass(heavy)[0] == pytest.approx(1.2 * apparent_mass(own)[0])
    power = [next(fact.value for fact in facts_of(each) if fact.key == "elevator") for each in (own, heavy)]
    assert power[0] == pytest.approx(1.5 * power[1])
    roll = [next(mode.time_constant for mode in known_modes(each) if mode.name == "roll") for each in (own, heavy)]
    assert roll[1] == pytest.approx(1.5 * roll[0], rel=0.05)
    (said,) = what_matters(Evidence(check_json(), **USED, mass=(2.4, 2.0, 0.02), states_mass="the recording"))
    assert "and the recording says 2.4 kg" in said.sentence


@pytest.mark.parametrize(("kind", "after", "axes"), [("change in flight", 0.1, ["Cl", "Cm"]), ("measurement", 0.1, []),
                                                     ("aerodynamic", 0.25, [])])  # fmt: skip
def test_what_the_model_lacks_is_an_effect_that_explains_much(kind, after, axes):
    found = candidate("icing", kind, axes=["Cl", "Cm"], error_after=after)
    assert [*_lacking({"candidates": [found, {**found, "found": False, "axes": ["CX"]}]})] == axes


@pytest.mark.parametrize(("inner", "said"), [({"t0": 99.0}, "(from 99 s on)"), ({}, "(from 99 s on; C_Z, 5 to 10 s)")])
def test_of_what_happened_at_a_time_that_is_said(inner, said):
    found = candidate("damage", "change in flight", where="from 99 s on; C_Z, 5 to 10 s", inner=inner)
    diagnosis = {"candidates": [found], "advice": "", "unknown": {}}
    assert said in what_matters(Evidence(check_json(), diagnosis=diagnosis, **USED))[0].sentence


def test_what_was_nearly_named_is_said_where_nothing_is():
    """A slipstream over the tail with p = 1e-14 that came in two of four parts was "nothing is missing"."""
    near = candidate("propwash", "aerodynamic", found=False, p_value=1e-9, refused="it comes in 2 of 4",
                     nested={"parts": 4, "same": 2, "others": ["", ""], "error_after": 0.2})  # fmt: skip
    said = {}
    for name, one in {"near": near, "chance": {**near, "p_value": 0.2}, "often": {**near, "nested": None}}.items():
        diagnosis = {"candidates": [one], "advice": "", "unknown": {}}
        said[name] = what_matters(Evidence(check_json(), diagnosis=diagnosis, **USED))[0].sentence
    assert said["near"].startswith(
        "Nothing is clearly missing. propwash would remove 67 % of the error of C_Z, but it comes"
    )
    assert said["chance"] == said["often"] and said["chance"].startswith(
        "Nothing is missing that this flight could show"
    )


def test_where_what_explains_most_cannot_be_it_something_else_is_there():
    """A lift slope that steps at a speed, 26 % of the error of C_Z, p = 8e-9: "nothing is missing"."""
    open_one = candidate("alpha_dot", "aerodynamic", found=False, p_value=8e-9, error_before=0.27, error_after=0.2,
                         refused="its derivative of C_Z is outside its possible range", ruled_out=True)  # fmt: skip
    said = {}
    others = {"chance": {"p_value": 0.2}, "small": {"error_after": 0.26}, "it is it": {"ruled_out": False}}
    for name, more in {"open": {}, **others}.items():
        diagnosis = {"candidates": [{**open_one, **more}], "advice": "", "unknown": {}}
        said[name] = what_matters(Evidence(check_json(), diagnosis=diagnosis, **USED))[0].sentence
    assert said.pop("open").startswith(
        "Nothing is clearly missing. alpha_dot would remove 26 % of the error of C_Z, but its derivative of C_Z is "
        "outside"
    )
    assert all(each.startswith("Nothing is missing that this flight could show") for each in said.values())


def test_the_headline_does_not_say_more_than_the_advice():
    said = {"verdict": "none", "advice": "Nothing is clearly missing: alpha_dot would explain 26% of", "replicas": 20}
    assert headline(said) == "nothing is clearly missing"
    assert headline({**said, "advice": "Nothing is missing that this flight could show: no"}) == "nothing is missing"


def test_standard_errors_are_at_least_those_of_the_parameters(learnt):
    """Least squares know the noise alone: what was learnt in flight knows of times that are off as well."""
    values = dict(zip(learnt[0].model.parameter_names, learnt[0].values, strict=True))
    own, wide = learnt[0], Learnt(learnt[1], {}, {"Cl_p": (values["Cl_p"], 0.03), "Cn_r": (values["Cn_r"], 1e-9)})
    stds = [dict(zip(each.model.parameter_names, each.draws.std(axis=0), strict=True)) for each in (own, wide)]
    assert stds[0]["Cl_p"] < 0.01 and stds[1]["Cl_p"] == pytest.approx(0.03, rel=0.15)
    for name in ("Cn_r", "CZ_alpha"):
        assert stds[1][name] == pytest.approx(stds[0][name], rel=1e-6)


def test_what_two_ways_say_differently_is_not_stated(learnt):
    """Slow changes of trim made a pitch stiffness of 0.24 look like 0.02 to least squares over half an hour."""
    used = {name: ("USE", "") for name in learnt[0].model.parameter_names}
    value = dict(zip(learnt[0].model.parameter_names, learnt[0].values, strict=True))["Cm_alpha"]
    for times, is_known in ((2.0, True), (5.0, False)):
        some = Learnt(learnt[1], used, {"Cm_alpha": (value - times * 0.05, 0.05)})
        stiffness = next(fact for fact in facts_of(some) if fact.key == "Cm_alpha")
        assert (stiffness.reason == "") == is_known
    assert "as learnt in flight, but" in stiffness.reason
    assert next(fact for fact in facts_of(some) if fact.key == "Cn_beta").reason == ""


@pytest.mark.parametrize(
    ("forward", "down", "keys"),
    [
        (0.25, 0.0, ("static_margin", "Cm_alpha", "Cm_q", "Cn_beta", "Cn_r", "elevator", "rudder")),
        (0.0, 0.4, ("Cl_beta", "Cl_p", "aileron")),
    ],
)
def test_stability_does_not_go_with_the_point_of_the_moments_in_the_file(learnt, aircraft, forward, down, keys):
    """One aeroplane, its coefficients about the centre of gravity and about another point."""
    model, chord, span = aircraft.model, aircraft.chord, aircraft.span
    used = {name: ("USE", "") for name in model.parameter_names}
    moved = Learnt(learnt[1], used)
    moved.aircraft = replace(aircraft, aerodynamic_reference=chord * np.array([forward, 0.0, down]))
    turn = np.eye(len(moved.values))
    for name in model.parameter_names:
        axis, term = name.split("_")
        of = {"Cm": ("CZ", forward), "Cn": ("CY", -forward * chord / span), "Cl": ("CY", down * chord / span)}
        if axis in of and f"{of[axis][0]}_{term}" in model.parameter_names:
            turn[model.parameter_names.index(name), model.parameter_names.index(f"{of[axis][0]}_{term}")] = of[axis][1]
    moved.values, moved.draws = turn @ moved.values, moved.draws @ turn.T
    facts, same = ({fact.key: fact for fact in facts_of(each)} for each in (learnt[0], moved))
    for key in keys:
        assert (same[key].value, same[key].std) == pytest.approx((facts[key].value, facts[key].std), rel=1e-6), key
        assert not same[key].reason


def test_a_moment_about_the_centre_of_gravity_is_not_stated_where_its_force_is_not_known(learnt, aircraft):
    verdicts = {name: ("USE", "") for name in aircraft.model.parameter_names} | {"CZ_alpha": ("HOLD", "no motion")}
    at, moved = Learnt(learnt[1], verdicts), Learnt(learnt[1], verdicts)
    assert not next(fact for fact in facts_of(at) if fact.key == "Cm_alpha").reason
    moved.aircraft = replace(aircraft, aerodynamic_reference=np.array([0.25 * aircraft.chord, 0.0, 0.0]))
    facts = {fact.key: fact for fact in facts_of(moved)}
    assert facts["Cm_alpha"].reason == "CZ_alpha is HOLD: no motion" and not facts["elevator"].reason


def test_a_stall_below_ordinary_flight_is_no_margin(learnt):
    usual = np.median(learnt[1].flight.signal("alpha"))
    margins = [next(f for f in facts_of(learnt[0], usual + x) if f.key == "stall_margin") for x in (0.1, -0.01)]
    assert margins[0].value == pytest.approx(np.degrees(0.1)) and not margins[0].reason
    assert margins[1].reason and margins[1].json["value"] is None


@pytest.mark.long
def test_a_table_is_taken_with_its_map(tmp_path):
    from aircraft_sysid_ros.after_flight.explanation import explain as module

    rows = [f"{0.02 * i:.2f},{i % 7}.5,-1.0{i % 3}" for i in range(60)]
    (tmp_path / "flight.csv").write_text("\n".join(["Time,P,Nz", *rows]))
    (tmp_path / "map.yaml").write_text(
        "tables:\n  - time: {column: Time, unit: s}\n    signals:\n      angular_velocity.x: {column: P, unit: deg/s}\n"
    )
    options = module.ExplainOptions(columns=str(tmp_path / "map.yaml"))
    recording, notes = module._recording(tmp_path / "flight.csv", tmp_path / "out", options)
    assert len(read_recording(recording).samples) == 60
    assert any("true_airspeed" in note for note in notes)


def test_the_recording_of_an_imported_log_is_named_where_it_stays(monkeypatch, tmp_path, aircraft):
    """The check had named the folder beside it in which the recording is made, which is gone."""
    from aircraft_sysid_ros.after_flight.explanation import explain as module

    def begin(recording, *_):
        raise InputError(f"{recording} never flies")

    def write(log, target, **_):
        target.mkdir()
        return {"missing": {}, "notes": []}

    finding = Finding(("angle_of_attack",), "unit", "error", "it is in degrees")
    checked = CheckedRecording("", 60.0, Checked((finding,), {}, (), None, ()), ())
    monkeypatch.setattr(module, "import_log", write)
    monkeypatch.setattr(module, "check_recording", lambda recording, *_: replace(checked, path=str(recording)))
    monkeypatch.setattr(module, "replay", lambda recordings, *_: begin(*recordings))
    log, out = tmp_path / "flight.ulg", tmp_path / "out"
    log.touch()
    found = module.explain(log, aircraft, out, page=lambda _: "page")
    assert found.json["check"]["recording"] == str(out / "flight") and (out / "flight").is_dir()
    assert found.why_not == f"{out / 'flight'} never flies"
    monkeypatch.setattr(module, "_recording", lambda log, *_: (log, []))
    found = module.explain(log, aircraft, out, module.ExplainOptions(overwrite=True), page=lambda _: "page")
    assert found.json["check"]["recording"] == str(log)  # one that is a recording stays where it is


def test_outputs_of_which_nothing_says_what_they_move_are_not_to_be_recorded(aircraft):
    """The first run of who has not written a calibration file said to record what was in the log."""
    findings = [Finding(("elevator", "aileron"), "missing", "warning", "not in the recording: no derivatives"),
                Finding(("true_airspeed",), "missing", "warning", "not in the recording: none")]  # fmt: skip
    found = Checked(tuple(findings), {}, (), None, ())
    checked = _with_outputs(CheckedRecording("log", 60.0, found, ()))
    said = next_flights({**checked.json, "identifiable": {}}, None, (), None)
    assert said[0] == "Record true_airspeed: no manoeuvre makes up for what is not in the log."
    assert "--servos" in said[1] and "elevator and aileron" in said[1]


def test_what_would_let_an_axis_be_compared_stands_beside_it_and_not_in_the_notes(aircraft):
    throttle = throttle_instead(aircraft.model.terms)
    notes = (
        "the map has no clock",
        f"under 'model' of the aircraft file {throttle}",
        f"so {TELL_FLOW}",
        "not searched: CX",
    )
    check = SimpleNamespace(checked=SimpleNamespace(findings=[Finding(("true_airspeed",), "offset", "warning", "…")]))
    found = SimpleNamespace(aircraft=aircraft, compared=None, why_not="", notes=notes, check=check)
    assert explain_page._notes(found) == list(notes)
    found.why_not = f"no axis can be compared: CX ({throttle}); for alpha {TELL_FLOW}"
    assert explain_page._notes(found) == ["the map has no clock", "not searched: CX"]
    found.notes += (f"the library was not searched: no axis of the model can be judged: {found.why_not[25:]}",)
    assert explain_page._notes(found) == ["the map has no clock", "not searched: CX"]
    compared = SimpleNamespace(comparison=SimpleNamespace(reasons={"CX": f"({throttle})"}))
    found = SimpleNamespace(aircraft=aircraft, compared=compared, why_not="", notes=notes, check=check)
    assert explain_page._notes(found) == [notes[0], *notes[2:]]
    found.notes += ("true_airspeed: it comes 0.27 s late", "true_airspeed_2: not read")
    assert explain_page._notes(found) == [notes[0], *notes[2:], "true_airspeed_2: not read"]


def test_an_axis_that_lacks_a_signal_is_no_want_of_motion():
    from aircraft_sysid_ros.after_flight.explanation import explain as module

    held = [Identifiability(f"CX_{k}", False, 9.0, 0.1, "thrust is not measured", is_held=True) for k in range(3)]
    checked = CheckedRecording(
        "flight", 60.0, Checked((), {}, (), None, (*held[:2], replace(held[2], is_held=False))), ()
    )
    assert list(module._of_motion(checked)["identifiable"].values()) == [True, True, False]
    assert not any(checked.json["identifiable"].values())


def test_a_run_that_cannot_be_compared_is_diagnosed(monkeypatch, tmp_path):
    """Inputs that failed can be told where no model can be compared: without vanes, with slow inputs."""
    from aircraft_sysid_ros.after_flight.explanation import explain as module

    def refuse(*_):
        raise InputError("the controls come at 3 Hz")

    monkeypatch.setattr(module, "compare_run", refuse)
    monkeypatch.setattr(module, "diagnose", lambda *_: CUT)
    found = module._judged(tmp_path, module.ExplainOptions(), lambda *_: None)
    assert found == (None, CUT, "the controls come at 3 Hz")
    monkeypatch.setattr(module, "diagnose", refuse)
    assert module._judged(tmp_path, module.ExplainOptions(), lambda *_: None)[1:] == (None, "the controls come at 3 Hz")


def test_what_is_not_recorded_is_to_be_recorded_before_anything_is_flown():
    lacking, damaged = "not in the recording: no derivatives", "3 messages could not be decoded"
    check = check_json(
        ("elevator", "missing", "warning", lacking), ("sideslip", "missing", "info", lacking),
        ("/imu/data", "missing", "warning", damaged), shown=30,
    )  # fmt: skip
    assert next_flights(check, None, (), None)[0].startswith("Record elevator: ")


@pytest.mark.long
def test_a_vane_that_is_off_is_found_and_a_sound_one_is_not(aircraft, flight):
    assert instrument_errors(aircraft, flight.samples) == []
    values = flight.samples.values.copy()
    values[flight.samples.kind == Kind.SIDESLIP, 0] -= np.radians(1.5)
    (error,) = instrument_errors(aircraft, replace(flight.samples, values=values))
    assert (error.signal, error.kind) == ("sideslip", "offset")
    assert error.value == pytest.approx(-1.5, abs=4.0 * error.std)
    assert f"add {-error.value:.1f}°" in error.words  # and not: take -1.5° off


def test_a_stamp_of_zero_does_not_move_the_middle_of_a_flight(monkeypatch, aircraft, flight):
    """The second half was all of it, and no constant that moved was found."""
    monkeypatch.setattr(instruments, "air_data_errors", lambda aircraft, half: {})
    samples = replace(flight.samples, stamp=np.append(0, flight.samples.stamp[1:]))
    first, second = (len(half) for half, _ in instruments._halves(aircraft, samples))
    assert first == pytest.approx(second, rel=0.1)


@pytest.mark.parametrize(("ahead", "said"), [(-0.05, []), (0.03, ["off"])])
def test_of_a_vane_that_nobody_has_placed_a_zero_is_off_wherever_it_is(monkeypatch, aircraft, flight, ahead, said):
    """On the boom of a jet, of which the file said nothing, a sound vane showed 2.4° too much."""
    offsets = {0.0: 0.05, round(LONGEST_BOOM * aircraft.span, 6): ahead}

    def errors(placed, samples):
        zero = offsets[round(float(placed.air_data_position[0]), 6)]
        known = {
            f"{name}_{of}": {"value": 0.0, "std": 1e-3} for name in ("b", "lambda") for of in ("V", "alpha", "beta")
        }
        return known | {"b_alpha": {"value": zero, "std": 1e-3}}

    monkeypatch.setattr(instruments, "air_data_errors", errors)
    bare = aircraft_from_dict({k: v for k, v in aircraft.source.items() if not k.endswith("_position")})
    found = instrument_errors(bare, flight.samples)
    assert [error.value for error in found] == pytest.approx([np.degrees(-0.03)] * len(said))
    assert all(error.std > np.degrees(0.5 * (0.05 - ahead)) for error in found)


@pytest.mark.parametrize(
    ("late", "stated", "taken"), [(0.16, {}, True), (0.16, {"gps_velocity": {"delay": 0.1}}, False), (2.0, {}, False)]
)
def test_a_gps_that_is_late_is_taken_in_time_and_that_is_said(aircraft, late, stated, taken):
    """A receiver is; a clock that is wrong by seconds, or that the file has, is told and left."""
    velocity = Finding(("velocity.north", "velocity.east", "velocity.down"), "offset", "warning", "it comes late", late)
    place = Finding(("latitude", "longitude", "altitude"), "offset", "warning", "it keeps time with it", late)
    other = Finding(("attitude.roll",), "offset", "warning", "it comes late", 0.1)
    checked = CheckedRecording("log", 100.0, Checked((velocity, place, other), {}, (), None, ()), ())
    known = aircraft_from_dict({**aircraft.source, "sensors": {"gyro": {"noise": 0.01}, **stated}})
    better, without, notes = with_gps_in_time(known, checked)
    severities = [finding.severity for finding in without.checked.findings]
    if not taken:
        assert (better, without, notes) == (known, checked, [])
        return
    assert severities == ["info", "info", "warning"]
    assert better.sensors["gps_velocity"].delay == better.sensors["gps_position"].delay == 0.16
    assert "0.16 s late" in notes[0] and "`gps: {delay: 0.16}`" in notes[0]


def test_the_zero_of_a_vane_is_looked_for_with_the_lateness_that_a_diagnosis_found():
    """In circles an aeroplane pitches all the time, and a vane that is 20 ms late is off by 0.8 deg."""
    flown = calibration_flight(duration=200.0)
    late = np.isin(flown.samples.kind, [Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP])
    stamp = flown.samples.stamp + np.where(late, 20_000_000, 0)
    samples = replace(flown.samples, stamp=stamp)[np.argsort(stamp, kind="stable")]
    named = {"sensors.air_data.delay": 0.02, "sensors.angle_of_attack.scale": 1.3, "sensors.control_surfaces.lag": 0.1}
    counted = as_diagnosed(flown.aircraft, [{"settings": named}, {"effect": "stall"}])

    def zero(aircraft, recorded):
        return offset_of(air_data_errors(aircraft, recorded), recorded, Kind.ANGLE_OF_ATTACK).value

    truth = zero(flown.aircraft, flown.samples)
    assert abs(zero(flown.aircraft, samples) - truth) > np.radians(0.4)
    assert abs(zero(counted, samples) - truth) < np.radians(0.05)


def test_what_the_check_has_of_a_signal_is_not_said_again_with_another_number():
    """Of ALFA's late GPS the check had 0.24 ± 0.05 s, and the replay in its turn 0.27 ± 0.10 s."""
    late = [Finding((f"velocity.{axis}",), "offset", "warning", "it comes 0.24 s late") for axis in ("north", "east")]
    slow = Finding(("throttle",), "rate", "info", "2.5 Hz")
    notes = ["velocity.{north,east}: it comes 0.27 s late", "throttle: it is off", "thrust is not measured: so"]
    assert _without_what_is_checked(notes, [*late, slow]) == notes[1:]


@pytest.mark.parametrize(("scale", "said"), [(0.3, 1), (1.8, 0)])
def test_a_zero_beside_a_scale_that_no_vane_has_is_that_of_gusts(monkeypatch, aircraft, flight, scale, said):
    """A sound vane in slow gusts showed 6.5 ± 0.8° too much, and a third of the angle of attack."""
    none = {f"{name}_{of}": {"value": 0.0, "std": 1e-3} for name in ("b", "lambda") for of in ("V", "alpha", "beta")}
    found = {"b_alpha": {"value": -0.12, "std": 1e-3}, "lambda_alpha": {"value": scale, "std": 0.08}}
    monkeypatch.setattr(instruments, "air_data_errors", lambda placed, samples: none | found)
    assert len(instrument_errors(aircraft, flight.samples)) == said


def test_of_a_vane_that_is_bent_in_flight_no_zero_is_given(aircraft, flight):
    values, stamps = flight.samples.values.copy(), flight.samples.stamp
    late = stamps > stamps.min() + 0.5 * np.ptp(stamps)
    values[(flight.samples.kind == Kind.SIDESLIP) & late, 0] += np.radians(4.0)
    (error,) = instrument_errors(aircraft, replace(flight.samples, values=values))
    assert (error.signal, error.kind) == ("sideslip", "offset that moves")
    assert error.value == pytest.approx(4.0, abs=4.0 * error.std)
    assert "fasten it" in error.words and "set its zero" not in error.words


def test_an_instrument_error_ends_where_its_standard_error_does():
    """Of a vane that was 2° off it was said that it reads 2.0 ± 0.0° too high."""
    degree = np.pi / 180.0
    words = instruments._offset("alpha", "It", -2.0123 * degree, 0.0321 * degree).words
    assert words == "It reads 2.012 ± 0.032° too high: set its zero, or take 2.0° off"
    assert "4.762 ± 0.018 % too low" in instruments._scale("V", "It", 0.05, 0.0002).words
    halves = (Offset(value * degree, 0.0321 * degree, 0.0) for value in (1e-4, -2.0123))
    assert "by 0.000 ± 0.032° in the first half of the flight and by +2.012 ± 0.032° in" in (
        instruments._moved("alpha", "It", *halves).words
    )


def test_a_number_ends_where_its_error_does():
    fact = {"title": "pitch damping", "value": -6.7271, "std": 0.0822, "unit": "per rad", "words": "damped"}
    assert "−6.727 ± 0.082 per rad" in explain_command._fact_line(fact)
    assert "3.3 deg" in explain_command._fact_line({**fact, "value": 3.341, "std": None, "unit": "deg"})


@pytest.mark.parametrize(
    ("kinds", "findings", "begin"),
    [
        (
            ["instrument offset"],
            [],
            "With care: something is wrong with 1 sensor, or with what the aircraft file says of it.",
        ),
        (
            ["instrument offset", "instrument scale"],
            [],
            "With care: something is wrong with 2 sensors, or with what the aircraft file says of them.",
        ),
        (["airspeed_scale", "stall"], [], "With care: something is wrong with 1 sensor, or"),
        (["stall"], [], "Yes"),
        (["stall"], [Finding(("elevator",), "sign", "warning", "…")], "With care: 1 warning,"),
        (["check unit"], [Finding(("sideslip",), "unit", "error", "…")], "Not as it is: 1 error "),
    ],
)
def test_a_log_is_trusted_as_far_as_its_sensors(kinds, findings, begin):
    found = SimpleNamespace(
        said=[Said(kind, kind) for kind in kinds],
        check=SimpleNamespace(duration=60.0, checked=SimpleNamespace(findings=findings)),
        why_not="", used=(30, 32), replayed={},
    )  # fmt: skip
    assert explain_page._trust(found)[0].startswith(begin)
    assert (explain_page._sensors(found) == ["None that could be seen: what they show fits together."]) == (
        kinds == ["stall"]
    )


class Page(HTMLParser):
    """Text of a page, and the elements that it opens and closes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words, self.open, self.opened = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.opened.append(tag)
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


@pytest.mark.long
def test_a_log_that_breaks_off_at_once_is_not_trusted(aircraft_file, tmp_path, capsys):
    """It had been: its sensors did not contradict each other, and other manoeuvres were to be flown."""
    assert main(["simulate", "--out", str(tmp_path / "whole"), "--duration", "30"]) == 0
    (whole,) = (tmp_path / "whole").glob("*.mcap")
    (tmp_path / "log.mcap").write_bytes(whole.read_bytes()[:200_000])
    capsys.readouterr()
    command = ["explain", str(tmp_path / "log.mcap"), "--aircraft", str(aircraft_file), "--out", str(tmp_path / "out")]
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["check"]["duration"] < 5.0 and found["said"][0]["kind"] == "short"
    assert "too little to say anything" in found["first"] and "breaks off" in found["first"]
    words = " ".join(" ".join(Page((tmp_path / "out" / "explain.html").read_text()).words).split())
    assert words.count("That cannot be said: too short to say") == 2 and "Yes: its sensors" not in words


def without_setting(text):
    """Words without spaces and underscores: a page sets C_Z with a subscript."""
    return re.sub(r"[\s_]", "", text)


@pytest.mark.long
def test_a_log_without_controls_is_explained_as_far_as_it_goes(flight, aircraft_file, tmp_path, capsys):
    """What the check and the filter say; of the aeroplane nothing, with the reason."""
    streams = [stream for stream in flight.streams if stream.topic != "control_surfaces"]
    log, out = tmp_path / "log.mcap", tmp_path / "out"
    with RecordingWriter(log) as writer:
        for stream in streams:
            first = stream.stamp < stream.stamp[0] + 30 * 10**9
            fields = {name: values[first] for name, values in stream.fields.items()}
            writer.write(stream.topic, TOPICS[stream.topic], stream.stamp[first], fields)
    assert main(["explain", str(log), "--aircraft", str(aircraft_file), "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["compare"] is None and found["aeroplane"] == [] and found["modes"] == []
    assert found["said"][0]["kind"] == "check missing" and (out / "run" / "state.json").is_file()
    words = " ".join(" ".join(Page((out / "explain.html").read_text()).words).split())
    assert found["first"] in words and "What the aeroplane is like" not in words


@pytest.fixture(scope="module")
def explained(run_with_hidden_effect, aircraft_file, tmp_path_factory):
    """The answer about a flight with a hidden term, and the folder; its aeroplane has a name that is no markup."""
    folder = tmp_path_factory.mktemp("explained")
    file = folder / "aircraft.yaml"
    file.write_text(aircraft_file.read_text().replace("Ultra Stick 25e\nmass", "'<u>Stick</u> & Co'\nmass"))
    bag, out, answer = run_with_hidden_effect.parent / "flight", folder / "out", folder / "answer.json"
    import contextlib
    import io

    said = io.StringIO()
    words = ["explain", str(bag), "--aircraft", str(file), "--out", str(out), "--replicas", "2", "--json"]
    with contextlib.redirect_stdout(said):
        assert main(words) == 0
    answer.write_text(said.getvalue())
    return json.loads(said.getvalue()), out


@pytest.mark.long
def test_one_command_makes_a_run_and_a_page(explained, capsys):
    found, out = explained
    assert {"check", "compare", "diagnose", "modes", "next", "first"} <= set(found)
    assert (found["run"], found["page"]) == (str(out / "run"), str(out / "explain.html"))
    assert {"name", "frequency", "damping", "std"} <= set(found["modes"][0])
    assert found["next"] and all(isinstance(text, str) for text in found["next"])
    assert found["diagnose"]["verdict"] != "none" and found["said"][0]["sentence"] == found["first"]
    assert main(["compare", found["run"], "--json"]) == 0  # a run like any other
    again = json.loads(capsys.readouterr().out)
    assert again["axes"] == found["compare"]["axes"]
    assert not [item for item in out.parent.iterdir() if item.name.startswith(".")]


@pytest.mark.long
def test_the_page_is_one_file_that_escapes_what_is_in_it(explained):
    found, out = explained
    text = (out / "explain.html").read_text(encoding="utf8")
    page = Page(text)
    words = " ".join(" ".join(page.words).split())
    assert page.open == [] and "u" not in page.opened  # of the name
    assert "<u>Stick</u> & Co" in words and without_setting(found["first"]) in without_setting(words)
    places = [[len(n.partition(".")[2]) for n in pair] for pair in re.findall(r"([\d.]+) ± ([\d.]+)", words)]
    assert places and all(of_value == of_error for of_value, of_error in places)
    assert "http" not in text.replace("http-equiv", "") and "prefers-color-scheme" in text
    for title in ("First of all", "Can this log be trusted?", "What the aeroplane is like", "What to fly next"):
        assert title in words
    for fact in found["aeroplane"]:
        assert without_setting(fact["reason"] or fact["words"]) in without_setting(words)


@pytest.fixture
def refused(capsys):
    """The sentence with which a command refuses."""

    def call(*words) -> str:
        capsys.readouterr()
        assert main([*map(str, words)]) == 2
        out, err = capsys.readouterr()
        assert out == "" and err.strip().count("\n") == 0 and "Traceback" not in err
        return err

    return call


def test_bad_input_is_one_sentence_and_leaves_nothing(refused, run_with_hidden_effect, aircraft_file, tmp_path):
    bag, out, stranger, full = (tmp_path / name for name in ("flight", "out", "log.xyz", "full"))
    bag.mkdir()
    full.mkdir()
    (full / "something").touch()
    stranger.write_text("hello")
    file = ("--aircraft", aircraft_file)
    there = tmp_path / "explained"
    there.mkdir()
    (there / "explain.html").touch()
    assert "there is no log" in refused("explain", tmp_path / "nothing", *file, "--out", out)
    assert "cannot be imported" in refused("explain", stranger, *file, "--out", out)
    assert "which aeroplane is it?" in refused("explain", bag, "--out", out)
    for replicas in (-1, 1, 51):
        assert "must be from 2 to 50" in refused("explain", bag, *file, "--out", out, "--replicas", replicas)
    recording = run_with_hidden_effect.parent / "flight"
    assert "is for logs of autopilots" in refused("explain", recording, *file, "--out", out, "--servos", file[1])
    assert "unknown key 'name' of the map" in refused("explain", recording, *file, "--out", out, "--map", file[1])
    assert "--chord X --inertia" in refused("explain", bag, "--mass", 2, "--span", 1, "--wing-area", 1, "--out", out)
    assert "--mass does not go with --aircraft" in refused("explain", bag, *file, "--mass", 2, "--out", out)
    shape = ("--mass", 2, "--span", 1, "--wing-area", 1, "--chord", 1)
    assert "must be Ixx,Iyy,Izz" in refused("explain", bag, *shape, "--inertia", "1,2", "--out", out)
    assert "must be a number in kg" in refused(
        "explain", bag, *shape[2:], "--mass", "two", "--inertia", "1,2,3", "--out", out
    )
    assert "already there" in refused("explain", bag, *file, "--out", there)
    assert "is a file" in refused("explain", bag, *file, "--out", stranger)
    assert "holds something else" in refused("explain", bag, *file, "--out", full, "--overwrite")
    assert "cannot write" in refused("explain", bag, *file, "--out", "/proc/nowhere/out")
    below = stranger / "out" / "x"
    assert "log.xyz is a file and cannot hold a folder" in refused("explain", bag, *file, "--out", below)
    assert "LOG is empty: give a recording" in refused("explain", "", *file, "--out", out)
    assert "--out is empty" in refused("explain", bag, *file, "--out", "")
    run = run_with_hidden_effect
    assert f"{run} is a run: give the recording or the log" in refused("explain", run, *file, "--out", out)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["explained", "flight", "full", "log.xyz"]
    assert isinstance(out, Path)
