"""What a flight cannot show, from its signals alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_tied_fit import flight_of

from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.diagnosis.cannot_show import out_of_reach
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.effects import LIBRARY
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of

AIR = concatenate([samples_of(kind, [1, 2], [0.0, 0.1]) for kind in (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK)])


def unseen(flight, samples=AIR, is_calm=True):
    found = out_of_reach(CandidateEvaluator(flight), LIBRARY, samples, is_calm)
    return {each.effect.identifier: each.why for each in found}


def test_what_is_listed_with_evidence_was_shown(flight):
    """Where the sideslip is inferred, adverse_yaw had stood among the candidates and among what cannot be shown."""
    without = {
        each.effect.identifier for each in out_of_reach(CandidateEvaluator(flight), LIBRARY, AIR, True, {"flaps"})
    }
    assert without == unseen(flight).keys() - {"flaps"}


def with_signals(flight, **columns):
    signals = flight.signals.copy()
    for name, values in columns.items():
        signals[:, SIGNAL_INDEX[name]] = values
    return replace(flight, signals=signals)


@pytest.fixture(scope="module")
def flight(aircraft):
    return flight_of(aircraft)


def test_a_signal_that_is_not_there_or_stands_still_shows_nothing(flight):
    assert unseen(flight)["flaps"] == "flaps is not measured"
    assert unseen(with_signals(flight, flaps=0.2))["flaps"] == "flaps does not move"
    neither = unseen(with_signals(flight, Tc=np.nan, throttle=np.nan))["thrust_offset"]
    assert neither == "neither thrust nor throttle is measured"
    moved = {"throttle": 0.5 + 0.3 * np.sin(flight.time), "V": 18.0, "qbar": 200.0}
    assert "thrust_offset" not in unseen(with_signals(flight, Tc=np.nan, **moved))
    moved = np.where(flight.time > 60.0, 0.3, 0.0)
    assert "flaps" not in unseen(with_signals(flight, flaps=moved))


def test_a_control_that_moves_only_where_nothing_is_judged_shows_nothing(flight):
    """Noise of its sensor is no motion: flaps that were out in the first minute, which is left out."""
    noisy = with_signals(flight, flaps=1e-3 * np.random.default_rng(0).normal(size=len(flight.time)))
    controls = np.zeros((2, AIR.values.shape[1]))
    controls[1, 3] = 0.3
    moved = concatenate([AIR, samples_of(Kind.CONTROLS, [1, 2], *controls[:, :7].T)])
    assert unseen(noisy, moved)["flaps"] == "flaps moves only in a part of the flight that is left out"
    assert "flaps" not in unseen(noisy)


def test_an_effect_that_acts_elsewhere_is_named_with_how_near_the_flight_gets(flight):
    slow = unseen(with_signals(flight, mach=0.12))
    assert slow["compressibility"] == "it acts from a Mach number of 0.3 on, and the flight stays below 0.12"
    high = unseen(with_signals(flight, height=np.linspace(50.0, 90.0, len(flight.time))))
    assert high["ground_effect"].startswith("it acts below a height of 2 spans, and the flight stays above")


def test_what_moves_with_the_model_is_not_told_from_it(flight):
    following = with_signals(flight, Tc=flight.signal("alpha"))
    assert unseen(following)["thrust_offset"] == "it moves together with what the model has"


def test_what_shows_in_other_axes_too_is_not_out_of_reach_without_a_vane(flight):
    blind = with_signals(flight, beta=np.nan)
    assert not {"mass_change", "cg_shift", "icing"} & set(unseen(replace(blind, inferred=("beta",))))
    assert unseen(replace(blind, inferred=("beta",)))["sideslip_drag"] == "sideslip is not measured"


def test_without_a_vane_nothing_of_its_axes_can_be_named(flight):
    blind = unseen(replace(flight, inferred=("beta",)))
    assert blind["dihedral_alpha"] == blind["adverse_yaw"] == "sideslip is not measured"
    assert "mass_change" not in blind and "stall" not in blind


def test_scales_are_out_of_reach_in_gusts_and_without_their_sensor(flight):
    assert unseen(flight)["beta_scale"] == "sideslip is not measured"
    assert not {"alpha_scale", "airspeed_scale"} & set(unseen(flight))
    assert {"alpha_scale", "airspeed_scale"} <= set(unseen(flight, is_calm=False))
