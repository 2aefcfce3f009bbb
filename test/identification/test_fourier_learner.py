"""The estimator ``fourier``: exact without noise, covered with it, standing still where it should."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from test_parameter_estimator import EPOCH, learn, perfect_inputs

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.estimators.fourier import kept_by_interpolation
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Kind, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

FOURIER = ParameterOptions(estimator="fourier")
MAIN = ("CY_beta", "CZ_alpha", "Cl_beta", "Cl_p", "Cl_da", "Cm_alpha", "Cm_q", "Cm_de", "Cn_beta", "Cn_r", "Cn_dr")


def with_rate(aircraft, rate):
    """The aircraft whose surfaces are recorded at ``rate`` [Hz]."""
    surfaces = replace(aircraft.sensors["control_surfaces"], rate=rate)
    return replace(aircraft, sensors={**aircraft.sensors, "control_surfaces": surfaces})


@pytest.fixture(scope="module")
def inputs(flight):
    return perfect_inputs(flight)


@pytest.fixture(scope="module")
def exact(flight, inputs):
    return learn(with_rate(flight.aircraft, 100.0), *inputs, FOURIER)


def values(estimator):
    return np.array([p.value for p in estimator.snapshot().parameters])


@pytest.mark.long
def test_perfect_states_give_the_true_parameters(exact, flight):
    """Nearer than the time domain comes at 100 Hz (1 %): nothing is differentiated."""
    for p in exact[0].snapshot().parameters:
        assert p.value == pytest.approx(flight.aircraft.coefficients[p.name], rel=4e-3, abs=1e-3), p.name


@pytest.mark.long
def test_lever_arms_and_an_offset_reference_are_transformed_the_same_way(flight, inputs):
    """Moments about another point: M_ref = M_cg - r x F, so C_m there is C_m - (z X - x Z) / chord."""
    reference = np.array([0.05, 0.0, 0.0])
    moved = replace(with_rate(flight.aircraft, 100.0), aerodynamic_reference=reference)
    found = {p.name: p.value for p in learn(moved, *inputs, FOURIER)[0].snapshot().parameters}
    truth = flight.aircraft.coefficients
    expected = truth["Cm_alpha"] + reference[0] / moved.chord * truth["CZ_alpha"]
    assert abs(expected - truth["Cm_alpha"]) > 0.5
    assert found["Cm_alpha"] == pytest.approx(expected, rel=4e-3)
    assert found["Cn_beta"] == pytest.approx(truth["Cn_beta"] - reference[0] / moved.span * truth["CY_beta"], rel=4e-3)


@pytest.mark.long
def test_surfaces_recorded_at_half_the_rate_are_made_good(flight, inputs):
    rows, controls = inputs
    slower = controls[np.arange(0, len(controls), 2)]
    right, _ = learn(with_rate(flight.aircraft, 50.0), rows, slower, FOURIER)
    wrong, _ = learn(with_rate(flight.aircraft, 100.0), rows, slower, FOURIER)
    for name in ("Cl_da", "Cn_dr", "Cm_q"):
        j, truth = flight.aircraft.model.parameter_names.index(name), flight.aircraft.coefficients[name]
        assert abs(values(right)[j] / truth - 1.0) < 0.6 * abs(values(wrong)[j] / truth - 1.0), name
    w = 2.0 * np.pi * np.array([0.0, 1.0, 2.0])
    kept = kept_by_interpolation(with_rate(flight.aircraft, 50.0), w)
    np.testing.assert_allclose(kept, np.cos(0.005 * w) ** 2, rtol=1e-12)  # [1/4 1/2 1/4] between the samples
    assert (kept_by_interpolation(with_rate(flight.aircraft, 200.0), w) == 1.0).all()


@pytest.mark.long
def test_errors_are_covered_and_small_over_flights(aircraft):
    """6 flights of 60 s in calm air with the noise of the aircraft file: 192 errors, three binomial sigma, 2 %."""
    z, relative = [], []
    for seed in range(6):
        flight = simulate_samples(aircraft, 100 + seed, 60.0)
        pipeline = Pipeline(aircraft, None, FOURIER)
        pipeline.push(flight.samples)
        pipeline.flush()
        found = pipeline.parameters.snapshot()
        assert np.linalg.eigvalsh(found.covariance)[0] > -1e-15
        z += [(p.value - aircraft.coefficients[p.name]) / p.std for p in found.parameters]
        relative.append([p.value / aircraft.coefficients[p.name] - 1.0 for p in found.parameters if p.name in MAIN])
        main = [p for p in found.parameters if p.name in MAIN]
        assert all(p.status == Trust.USE for p in main)
        assert all(e.nrmse < 0.25 for e in pipeline.parameters.model_error())
    inside = np.mean(np.abs(z) < 1.96)
    assert abs(inside - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 192) + 0.02
    assert np.all(np.abs(np.mean(relative, axis=0)) < 0.015)


@pytest.mark.long
def test_batches_of_any_size_give_the_same_numbers(flight, inputs):
    rows, controls = inputs[0][:2500], inputs[1]
    one, points = learn(flight.aircraft, rows, controls, FOURIER, block=7)
    other, same = learn(flight.aircraft, rows, controls, FOURIER, block=1000)
    assert np.array_equal(values(one), values(other))
    assert np.array_equal(points, same, equal_nan=True)


@pytest.mark.long
def test_predictions_are_those_of_the_chosen_estimator_before_it_saw_the_sample(flight, exact):
    estimator, points = exact
    rls, _ = learn(flight.aircraft, *perfect_inputs(flight), None)
    assert (points[:20, CoefficientSample.PREDICTED] == 0.0).all()  # nothing was known
    last = points[-1]
    theta, pitch = values(estimator), flight.aircraft.model.axis_slice("Cm")
    predicted = last[CoefficientSample.TERMS :][pitch] @ theta[pitch]
    assert last[CoefficientSample.PREDICTED][4] == pytest.approx(predicted, rel=1e-2)
    assert not np.array_equal(values(rls), theta)


@pytest.mark.long
def test_cruise_is_held_to_the_last_bit(inputs, exact):
    estimator = copy.deepcopy(exact[0])
    row, control = inputs[0][-1:].copy(), inputs[1][-1:]
    row[:, StateField.ANGULAR_VELOCITY] = 0.0
    rows = np.repeat(row, 6000, axis=0)
    rows[:, StateField.TIME] += 0.01 * np.arange(1, 6001)
    stamp = np.rint(rows[:, StateField.TIME] * 1e9).astype(np.int64)
    estimator.push_samples(samples_of(Kind.CONTROLS, stamp, np.repeat(control.values[:, :7], 6000, axis=0)), EPOCH)
    estimator.push_states(rows[:2000])
    settled = values(estimator)  # the motion before has gone out of the running means
    estimator.push_states(rows[2000:])
    assert np.array_equal(values(estimator), settled)


@pytest.mark.long
@pytest.mark.parametrize(
    "what",
    [
        ("gap", "ground", "diverged", "no number", "clock"),  # one after the other
        *(
            pytest.param((what,), marks=pytest.mark.long)
            for what in ("gap", "ground", "dead control", "diverged", "no number", "clock")
        ),
    ],
    ids=" and ".join,
)
def test_what_cannot_be_learnt_from_does_not_corrupt(flight, inputs, what):
    rows, controls = inputs[0].copy(), inputs[1]
    kept = np.ones(len(rows), np.bool_)
    for number, each in enumerate(what):
        bad = slice(6000 - 1500 * number, 6600 - 1500 * number)
        if each == "gap":
            kept[bad] = False
        elif each == "ground":
            rows[bad, StateField.AIRSPEED] = 0.5
        elif each == "dead control":
            controls = controls[(controls.stamp < 60_500_000_000) | (controls.stamp > 66_500_000_000)]
        elif each == "diverged":
            rows[bad, StateField.CONSISTENCY] = 100.0
            rows[bad, StateField.ANGULAR_VELOCITY] += 3.0
        elif each == "no number":
            rows[bad, StateField.SPECIFIC_FORCE] = np.nan
            rows[bad, StateField.ANGLE_OF_ATTACK] = np.nan
    rows = rows[kept]
    estimator = Identifier(with_rate(flight.aircraft, 100.0), FOURIER)
    estimator.push_samples(controls, EPOCH)
    estimator.push_states(rows[:8000])
    if "clock" in what:
        late = rows[8000:].copy()
        late[:, StateField.TIME] -= 50.0
        estimator.flush()
        estimator.push_states(late[:1])
        shift = controls.stamp >= 80_000_000_000
        moved = samples_of(Kind.CONTROLS, controls.stamp[shift] - 50_000_000_000, controls.values[shift])
        estimator.push_samples(moved, EPOCH)
        estimator.push_states(late[1:])
    else:
        estimator.push_states(rows[8000:])
    estimator.flush()
    for name, value in zip(flight.aircraft.model.parameter_names, values(estimator), strict=True):
        assert value == pytest.approx(flight.aircraft.coefficients[name], rel=0.01, abs=1.5e-3), name


@pytest.mark.long
def test_what_is_not_excited_is_on_hold_and_a_reset_forgets(flight, inputs, exact):
    rows, controls = inputs
    without_rudder = controls.values[:, :7] * np.array([1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    still = samples_of(Kind.CONTROLS, controls.stamp, without_rudder)
    estimator, _ = learn(flight.aircraft, rows, still, FOURIER)
    found = {p.name: p for p in estimator.snapshot().parameters}
    assert found["Cn_dr"].status == found["Cl_dr"].status == Trust.HOLD
    assert found["Cm_de"].status == Trust.USE
    estimator.reset()
    assert np.isnan(values(estimator)).all()


@pytest.mark.long
def test_a_model_without_constants_does_not_use_means(flight, inputs):
    model = model_from_terms({"Cl": ["beta", "p", "r", "da", "dr"]})
    aircraft = replace(with_rate(flight.aircraft, 100.0), model=model)
    rows = inputs[0].copy()
    found = {p.name: p.value for p in learn(aircraft, rows, inputs[1], FOURIER)[0].snapshot().parameters}
    for name in ("Cl_beta", "Cl_p", "Cl_da"):
        assert found[name] == pytest.approx(flight.aircraft.coefficients[name], rel=0.02)


@pytest.mark.long
def test_a_mass_that_changes_in_flight_is_followed(flight, inputs):
    """The moments of the second half belong to twice the inertia: half the angular acceleration, the same C_m."""
    rows, controls = inputs
    aircraft = with_rate(flight.aircraft, 100.0)
    heavier = [2.0 * aircraft.mass, *(2.0 * np.diag(aircraft.inertia)), -2.0 * aircraft.inertia[0, 2], 0.0, 0.0, 0.0]
    estimator = Identifier(aircraft, FOURIER)
    estimator.push_samples(controls, EPOCH)
    estimator.push_samples(samples_of(Kind.MASS, 60_000_000_000, np.array([heavier])), EPOCH)
    estimator.push_states(rows[:5900])
    before = values(estimator)
    estimator.reset()  # or what is learnt now would be held: nothing that breaks doubles all moments
    estimator.push_states(rows[6100:])
    estimator.flush()
    moments = flight.aircraft.model.parameter_names.index("Cm_q")
    assert before[moments] == pytest.approx(flight.aircraft.coefficients["Cm_q"], rel=0.02)
    assert values(estimator)[moments] == pytest.approx(2.0 * flight.aircraft.coefficients["Cm_q"], rel=0.05)


def test_bad_options_are_answered_with_a_sentence(aircraft):
    with pytest.raises(InputError, match="must be one of auto, rls, fourier or rml"):
        Identifier(aircraft, ParameterOptions(estimator="best"))
    with pytest.raises(InputError, match="band"):
        Identifier(aircraft, ParameterOptions(estimator="fourier", lowest_frequency=3.0))
