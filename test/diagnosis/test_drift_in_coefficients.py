"""A sensor that drifts moves every coefficient that reads it, in gusts too, where the wind hides it from the filter."""

from dataclasses import replace

import numpy as np
import pytest
from test_tied_fit import flight_of

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.diagnosis.flight_diagnosis import _name, _p_value, diagnose_flight
from aircraft_sysid_ros.diagnosis.measurement import setting
from aircraft_sysid_ros.diagnosis.measurement.setting import Setting, setting_of
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects import BY_ID, LIBRARY
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

RATE = 4e-4
DRIFTS = ("alpha_drift", "beta_drift", "airspeed_drift")


def drifting(aircraft, effect, rate=RATE):
    """The random motion with a sensor that drifts, from the definition: what it shows is in the signals."""
    data = flight_of(aircraft)
    name, time = effect.partition("_")[0], data.signal("time")
    if name == "airspeed":
        data.measured[:] /= ((1.0 + rate * time) ** 2)[:, None]  # a force over the dynamic pressure that is shown
        data.signals[:, SIGNAL_INDEX["Tc"]] /= (1.0 + rate * time) ** 2  # and so is the thrust
        for rotation in "pqr":
            data.signals[:, SIGNAL_INDEX[rotation]] /= 1.0 + rate * time
    else:
        data.signals[:, SIGNAL_INDEX[name]] += rate * time
    return data


@pytest.mark.parametrize("effect", DRIFTS)
def test_the_one_number_of_its_terms_is_the_rate_of_the_drift(aircraft, effect):
    bench = CandidateEvaluator(drifting(aircraft, effect))
    trial = bench.best_of(BY_ID[effect].as_terms)
    found = setting_of(trial, LIBRARY, aircraft, 5.0)
    assert found.variant.setting[-1] == "drift" and found.of_coefficients
    assert found.value == pytest.approx(RATE, rel=0.12)
    others = [bench.best_of(BY_ID[other].as_terms) for other in DRIFTS if other != effect]
    assert trial.score > 1.5 * max(other.score for other in others)


@pytest.mark.parametrize("effect", DRIFTS)
def test_a_sensor_that_does_not_drift_explains_nothing(aircraft, effect):
    trial = CandidateEvaluator(flight_of(aircraft)).best_of(BY_ID[effect].as_terms)
    assert trial.score <= trial.price


def test_slopes_of_the_model_are_those_of_its_formula(aircraft):
    """{CZ_alpha} of terms that are none but straight: by complex step, at every point."""
    bench = CandidateEvaluator(flight_of(aircraft))
    for axis in AXES:
        for name in ("alpha", "beta"):
            (slope,) = bench.data.columns(bench.data.parsed([bench.base[f"{axis}_{name}"]])).T
            values = {signal: bench.data.signal(signal).astype(complex) for signal in SIGNAL_INDEX}
            values[name] = values[name] + 1e-20j
            names = aircraft.model.parameter_names[aircraft.model.axis_slice(axis)]
            with np.errstate(invalid="ignore"):
                terms = zip(names, aircraft.model.terms[axis], strict=True)
                total = sum(bench.parameters[k] * eval(t, {"__builtins__": {}}, values) for k, t in terms)
            expected = np.broadcast_to(np.imag(total) / 1e-20, slope.shape)
            np.testing.assert_allclose(slope, expected, rtol=1e-3, atol=1e-6)


@pytest.mark.long
def test_a_vane_that_bends_in_gusts_is_told_by_forces_and_moments(aircraft):
    flown = simulate_samples(aircraft, 41, 45.0, turbulence="light", hidden=[("alpha_drift", 2.0)])
    ((_, rate),) = flown.hidden[0].settings
    library = [BY_ID[name] for name in ("alpha_drift", "icing", "landing_gear")]
    found = diagnose_flight(aircraft, flown.samples, library, 2)
    assert not found.is_calm
    (first,) = (each for each in found.json["candidates"] if each["found"])
    assert (found.verdict, first["effect"]) == ("missing", "alpha_drift")
    assert first["inner"]["drift"] == pytest.approx(rate, rel=0.2)
    assert "fits forces and moments better" in first["where"]


@pytest.mark.long
def test_a_drift_that_grows_to_less_than_what_matters_is_none(monkeypatch, aircraft):
    """The flight of the test above, of which forces and moments show the drift; a limit beyond it refuses the name."""
    flown = simulate_samples(aircraft, 41, 45.0, turbulence="light", hidden=[("alpha_drift", 2.0)])
    beyond = 1.2 * abs(flown.hidden[0].settings[0][1]) * 45.0
    monkeypatch.setattr(setting, "THRESHOLDS", replace(THRESHOLDS, least_offset=beyond))
    found = diagnose_flight(aircraft, flown.samples, [BY_ID["alpha_drift"], BY_ID["icing"]], 2)
    assert "alpha_drift" not in [each["effect"] for each in found.json["candidates"] if each["found"]]


def test_a_verdict_on_a_sensor_needs_the_level_of_a_verdict():
    """Evidence 1 is the level of the list, five in a hundred; a name takes one in a hundred."""
    effect = BY_ID["beta_scale"]
    at = [Setting(effect, effect.variants[0], 1.0, 0.85, 20.0 * e, e, 0.01) for e in (1.0, 1.15, 1.5)]
    p_values = [_p_value(each, 16) for each in at]
    assert p_values[0] == pytest.approx(THRESHOLDS.false_alarm)
    assert p_values[1] > THRESHOLDS.verdict > p_values[2]


def test_a_place_has_three_numbers_and_each_is_tried():
    place, lag = BY_ID["imu_offset"], BY_ID["air_data_lag"]
    settings = [Setting(effect, v, 0.0, 0.1, 40.0, 2.0, 0.01) for effect in (place, lag) for v in effect.variants]
    assert len({_name(each) for each in settings}) == len(place.variants) + 1
