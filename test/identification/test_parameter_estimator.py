"""The second step: exact without noise, honest with it, holding what is not excited, surviving bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, model_from_terms
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.body import body_of, body_with
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.flight_memory import SampleMemory
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.model_change import change_model, with_terms
from aircraft_sysid_ros.identification.model_file import load_model, parameters_json, save_model
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Kind, Samples, samples_of
from aircraft_sysid_ros.sensors.sensor_models import specific_force_at

EPOCH = 0


def perfect_inputs(flight, rate: float = 100.0) -> tuple[np.ndarray, Samples]:
    """Rows of StateField and controls as a first step without any error would give them."""
    time = np.arange(0.5, flight.truth.time[-1] - 0.5, 1.0 / rate)
    truth = flight.truth.at(time)
    rows = np.zeros((len(time), StateField.WIDTH))
    rows[:, StateField.TIME] = time
    rows[:, StateField.AIR_VELOCITY] = truth.air_velocity
    rows[:, StateField.POSITION] = truth.position
    rows[:, StateField.VELOCITY] = truth.velocity
    rows[:, StateField.ATTITUDE] = truth.quaternion
    rows[:, StateField.SPECIFIC_FORCE] = specific_force_at(truth, flight.aircraft.imu_position)
    rows[:, StateField.ANGULAR_VELOCITY] = truth.rates
    rows[:, StateField.AIRSPEED] = truth.airspeed
    rows[:, StateField.ANGLE_OF_ATTACK] = truth.alpha
    rows[:, StateField.SIDESLIP] = truth.beta
    rows[:, StateField.AIR_DENSITY] = truth.density
    rows[:, StateField.AIR_VELOCITY_STD] = 0.02  # what a good first step says of itself
    rows[:, StateField.STATUS] = 1.0
    rows[:, StateField.ORIGIN] = truth.origin
    stamp = np.rint(time * 1e9).astype(np.int64)
    return rows, samples_of(Kind.CONTROLS, stamp, truth.controls)


def learn(aircraft, rows, controls, options=None, block: int = 500) -> tuple[Identifier, np.ndarray]:
    estimator = Identifier(aircraft, options)
    estimator.push_samples(controls, EPOCH)
    points = [estimator.push_states(rows[i : i + block]) for i in range(0, len(rows), block)]
    return estimator, np.vstack([*points, estimator.flush()])


@pytest.mark.long
def test_samples_and_time_change_with_the_last_state_until_news_alone(flight):
    rows, controls = perfect_inputs(flight)
    rows = np.delete(rows[:3000], slice(1500, 1800), axis=0)  # with a pause in which what is known becomes stale
    estimator, number, parts = Identifier(flight.aircraft), 0, []
    estimator.push_samples(controls, EPOCH)
    while number < len(rows):
        count = estimator.states_until_news(rows[number:, StateField.TIME])
        before = estimator.time
        for row in rows[number : number + count - 1]:
            assert not len(estimator.push_states(row[None], EPOCH))
            np.testing.assert_equal(estimator.time, before)
        estimator.push_states(rows[number + count - 1 : number + count], EPOCH)
        parts.append(count)
        number += count
    assert np.median(parts) == 4  # states at 100 Hz, samples at 25 Hz


@pytest.fixture(scope="module")
def replayed(flight) -> Pipeline:
    pipeline = Pipeline(flight.aircraft)
    pipeline.push(flight.samples)
    pipeline.flush()
    return pipeline


@pytest.mark.long
def test_perfect_states_give_the_true_parameters(flight) -> None:
    """All 32, each as near as sampling at 100 Hz allows: the differentiator treats both sides alike."""
    estimator, points = learn(flight.aircraft, *perfect_inputs(flight))
    snapshot = estimator.snapshot()
    assert len(snapshot.parameters) == 32
    for p in snapshot.parameters:
        truth = flight.aircraft.coefficients[p.name]
        assert p.value == pytest.approx(truth, rel=0.01, abs=1e-3), p.name
    for i, axis in enumerate(AXES):
        measured, predicted = points[1000:, 1 + i], points[1000:, 7 + i]  # every manoeuvre was flown once
        assert np.sqrt(np.mean((measured - predicted) ** 2)) < 0.01 * np.std(measured), axis


@pytest.mark.long
def test_measured_coefficients_are_those_of_the_simulator(flight) -> None:
    """Independent of the regression: window means of the simulator's own coefficients, with lever arms."""
    _, points = learn(flight.aircraft, *perfect_inputs(flight, 400.0))
    offsets = np.linspace(-1.0, 1.0, 81) * ParameterOptions().half_width
    weight = 1.0 - np.linspace(-1.0, 1.0, 81) ** 2
    for point in points[50::200]:
        around = flight.truth.at(point[CoefficientSample.TIME] + offsets)
        qbar = 0.5 * around.density * around.airspeed**2
        expected = (weight * qbar) @ around.coefficients / (weight @ qbar)
        scale = np.std(flight.truth.coefficients, axis=0)
        assert np.all(np.abs(point[CoefficientSample.MEASURED] - expected) < 0.02 * scale)


@pytest.mark.long
def test_errors_are_covered_by_standard_errors(replayed: Pipeline, flight) -> None:
    """A flight of the benchmark: at most 2 of 32 parameters beyond 3 standard errors, none beyond 5."""
    z = np.array(
        [(p.value - flight.aircraft.coefficients[p.name]) / p.std for p in replayed.parameters.snapshot().parameters]
    )
    assert np.sum(np.abs(z) > 3.0) <= 2
    assert np.abs(z).max() < 5.0


@pytest.mark.long
def test_main_derivatives_are_trusted_and_right(replayed: Pipeline, flight) -> None:
    estimates = {p.name: p for p in replayed.parameters.snapshot().parameters}
    longitudinal = ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de")
    for name in (*longitudinal, "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr", "CY_beta"):
        assert estimates[name].status == Trust.USE, estimates[name].reason
        assert estimates[name].value == pytest.approx(flight.aircraft.coefficients[name], rel=0.05), name


def test_covariance_is_symmetric_and_positive(replayed: Pipeline) -> None:
    covariance = replayed.parameters.snapshot().covariance
    assert np.allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0.0


@pytest.mark.long
def test_cruise_holds_what_was_learnt(flight, replayed: Pipeline) -> None:
    """Ten minutes without motion but with noise: nothing drifts, nothing blows up, ages grow."""
    rows, controls = perfect_inputs(flight)
    estimator, _ = learn(flight.aircraft, rows, controls)
    before = estimator.snapshot()
    random = np.random.default_rng(0)
    n = 60_000
    time = rows[-1, StateField.TIME] + 0.01 * np.arange(1, n + 1)
    cruise = np.tile(rows[50], (n, 1))
    cruise[:, StateField.TIME] = time
    cruise[:, StateField.AIR_VELOCITY_STD] = 0.05
    cruise[:, StateField.ANGLE_OF_ATTACK] += 0.003 * random.normal(size=n)
    cruise[:, StateField.SIDESLIP] += 0.003 * random.normal(size=n)
    cruise[:, StateField.ANGULAR_VELOCITY] = 0.002 * random.normal(size=(n, 3))
    cruise[:, StateField.SPECIFIC_FORCE] += 0.03 * random.normal(size=(n, 3))
    held = np.tile(controls.values[50], (n, 1))
    held[:, :3] += 0.0005 * random.normal(size=(n, 3))
    estimator.push_samples(Samples(np.rint(time * 1e9).astype(np.int64), np.full(n, int(Kind.CONTROLS)), held), EPOCH)
    for i in range(0, n, 1000):
        estimator.push_states(cruise[i : i + 1000])
    after = estimator.snapshot()
    for old, new in zip(before.parameters, after.parameters, strict=True):
        assert new.value == pytest.approx(old.value, rel=0.02, abs=2e-3), old.name
        learnt_of_noise = 0.05 * max(abs(old.value), 0.01)  # in the first 2 s
        assert new.std <= 1.2 * old.std + learnt_of_noise, old.name
    ages = [p.age for p in after.parameters if p.name.split("_")[1] in ("alpha", "beta", "p", "q", "r")]
    assert min(ages) > 500.0


@pytest.mark.long
def test_a_change_in_flight_is_followed(flight) -> None:
    """Elevator effectiveness halves at 60 s: what rests on 4 s of motion has forgotten it at the end."""
    rows, controls = perfect_inputs(flight)
    halved = controls.values.copy()
    halved[len(halved) // 2 :, 0] *= 2.0  # the same motion from twice the deflection
    controls = Samples(controls.stamp, controls.kind, halved)
    estimator, _ = learn(flight.aircraft, rows, controls, ParameterOptions(forgetting_time=4.0))
    value = {p.name: p.value for p in estimator.snapshot().parameters}["Cm_de"]
    assert value == pytest.approx(0.5 * flight.aircraft.coefficients["Cm_de"], rel=0.1)


def test_no_controls_no_parameters_and_a_reason(flight) -> None:
    rows, _ = perfect_inputs(flight)
    estimator, _ = learn(flight.aircraft, rows[:3000], samples_of(Kind.CONTROLS, [], np.empty((0, 7))))
    for p in estimator.snapshot().parameters:
        assert p.status == Trust.HOLD and np.isnan(p.value)
        assert "not measured" in p.reason


def test_thrust_not_measured_holds_only_its_axis(flight) -> None:
    rows, controls = perfect_inputs(flight)
    controls.values[:, 5] = np.nan
    estimator, _ = learn(flight.aircraft, rows, controls)
    for p in estimator.snapshot().parameters:
        if p.name.startswith("CX"):
            assert p.status == Trust.HOLD and "Tc" in p.reason
        else:
            assert np.isfinite(p.value)


def test_a_rudder_that_does_not_move_is_held(flight) -> None:
    """Its derivatives are not estimated from noise: HOLD with the reason."""
    rows, controls = perfect_inputs(flight)
    still = controls.values.copy()
    still[:, 2] = 0.0005 * np.random.default_rng(1).normal(size=len(still))
    estimator, _ = learn(flight.aircraft, rows, Samples(controls.stamp, controls.kind, still))
    for p in estimator.snapshot().parameters:
        if p.name.endswith("_dr"):
            assert p.status == Trust.HOLD and p.reason, p.name


@pytest.mark.long
def test_impossible_values_are_rejected(flight) -> None:
    """An accelerometer mounted upside down gives a lift slope that no aeroplane has."""
    rows, controls = perfect_inputs(flight)
    rows[:, StateField.SPECIFIC_FORCE.stop - 1] *= -1.0
    estimator, _ = learn(flight.aircraft, rows, controls)
    lift_slope = {p.name: p for p in estimator.snapshot().parameters}["CZ_alpha"]
    assert lift_slope.status == Trust.REJECT and "outside" in lift_slope.reason


def test_gaps_and_nan_in_controls_are_passed_over(flight) -> None:
    rows, controls = perfect_inputs(flight)
    time = controls.stamp * 1e-9
    values = controls.values.copy()
    values[(time > 30.0) & (time < 32.0)] = np.nan
    kept = ~((time > 50.0) & (time < 60.0))
    heard = Samples(controls.stamp[kept], controls.kind[kept], values[kept])
    estimator, points = learn(flight.aircraft, rows, heard)
    assert np.all(np.isfinite([p.value for p in estimator.snapshot().parameters]))
    silent = (points[:, CoefficientSample.TIME] > 50.4) & (points[:, CoefficientSample.TIME] < 59.6)
    assert not points[silent, CoefficientSample.VALID].any()


@pytest.mark.long
def test_every_block_size_gives_the_same_bits(flight) -> None:
    rows, controls = perfect_inputs(flight)
    one, points = learn(flight.aircraft, rows[:4000], controls, block=4000)
    other, same = learn(flight.aircraft, rows[:4000], controls, block=1)
    assert np.array_equal(points, same, equal_nan=True)
    assert np.array_equal(one.learning.least_squares.state.theta, other.learning.least_squares.state.theta)
    assert np.array_equal(one.snapshot().covariance, other.snapshot().covariance, equal_nan=True)


@pytest.mark.long
def test_mass_that_changes_is_used(flight) -> None:
    """Half the mass in the message halves the measured force coefficients, and NaN leaves the rest."""
    rows, controls = perfect_inputs(flight)
    estimator = Identifier(flight.aircraft)
    estimator.push_samples(controls, EPOCH)
    half = samples_of(Kind.MASS, [20 * 10**9], 0.5 * flight.aircraft.mass)
    estimator.push_samples(half, EPOCH)
    points = np.vstack([estimator.push_states(rows), estimator.flush()])
    _, whole = learn(flight.aircraft, rows, controls)
    late = whole[:, CoefficientSample.TIME] > 21.0
    assert np.allclose(points[late, 3], 0.5 * whole[late, 3], rtol=1e-9)
    assert np.allclose(points[late, 5], whole[late, 5], rtol=1e-9)
    early = whole[:, CoefficientSample.TIME] < 19.0
    assert np.array_equal(points[early, 3], whole[early, 3])


def test_mass_counts_beside_an_inertia_that_none_has(flight) -> None:
    """The whole message was passed over, while a note said that forces are worked out with its mass."""
    before = body_of(flight.aircraft)
    values = np.array([2.0 * before.mass, 0.1, 0.1, 0.1, 0.5, np.nan, np.nan, np.nan])
    after = body_with(flight.aircraft, before, values)
    assert after.mass == 2.0 * before.mass
    assert np.array_equal(after.inertia, before.inertia) and np.array_equal(after.imu, before.imu)


def test_any_model_of_the_aircraft_file(flight) -> None:
    """Terms are data: a model with other terms gets its own parameters and nothing else."""
    terms = {"CZ": ["1", "alpha", "alpha**3", "q", "de"], "Cl": ["p", "beta", "da", "dr", "r", 1]}
    model = model_from_terms(terms)
    rows, controls = perfect_inputs(flight)
    estimator, _ = learn(replace(flight.aircraft, model=model), rows, controls)
    names = [p.name for p in estimator.snapshot().parameters]
    assert names[:5] == ["CZ_0", "CZ_alpha", "CZ_alpha3", "CZ_q", "CZ_de"]
    assert names[5:] == ["Cl_p", "Cl_beta", "Cl_da", "Cl_dr", "Cl_r", "Cl_0"]
    values = {p.name: p.value for p in estimator.snapshot().parameters}
    assert values["Cl_p"] == pytest.approx(flight.aircraft.coefficients["Cl_p"], rel=0.02)


def test_signals_of_a_point(flight) -> None:
    """The flight condition that is published with the parameters is that of the simulator."""
    _, points = learn(flight.aircraft, *perfect_inputs(flight))
    truth = flight.truth.at(points[:, CoefficientSample.TIME])
    signals = points[:, CoefficientSample.SIGNALS]
    aircraft = flight.aircraft
    expected = {
        "alpha": truth.alpha,
        "p": truth.rates[:, 0] * aircraft.span / (2.0 * truth.airspeed),
        "q": truth.rates[:, 1] * aircraft.chord / truth.airspeed,
        "Tc": truth.controls[:, 5] / (0.5 * truth.density * truth.airspeed**2 * aircraft.wing_area),
        "V": truth.airspeed,
    }
    for name, value in expected.items():
        error = signals[:, SIGNAL_INDEX[name]] - value
        assert np.sqrt(np.mean(error**2)) < 0.1 * np.std(value), name
    alpha_rate = np.gradient(flight.truth.alpha, flight.truth.time)
    rate = np.interp(points[:, CoefficientSample.TIME], flight.truth.time, alpha_rate)
    expected_rate = rate * aircraft.chord / truth.airspeed
    error = signals[:, SIGNAL_INDEX["alpha_dot"]] - expected_rate
    assert np.sqrt(np.mean(error**2)) < 0.35 * np.std(expected_rate)  # the window smooths one of the two


def test_saved_model_goes_on_where_it_stopped(flight, tmp_path) -> None:
    rows, controls = perfect_inputs(flight)
    whole, _ = learn(flight.aircraft, rows[:6000], controls)
    save_model(whole, tmp_path / "model.json")
    other = Identifier(flight.aircraft)
    assert load_model(other, tmp_path / "model.json") == flight.aircraft.model.identifier
    assert [p["value"] for p in parameters_json(other)["parameters"]] == [
        p["value"] for p in parameters_json(whole)["parameters"]
    ]


def test_a_saved_model_keeps_what_its_standard_errors_rest_on(flight, tmp_path) -> None:
    """The share that sparse samples take, the doubt of the bias, and what was known before an axis changed."""
    rows, controls = perfect_inputs(flight)
    (estimator, _), other = learn(flight.aircraft, rows[:6000], controls), Identifier(flight.aircraft)
    state = estimator.learning.least_squares.state
    state.sampling[:], state.bias_variance[:], state.prior_variance[2] = 6e-4, 1e-6, 1e-5
    state.prior[2] = np.diag(np.diag(state.p[2]))
    save_model(estimator, tmp_path / "model.json")
    load_model(other, tmp_path / "model.json")
    found = other.learning.least_squares.state
    for name in ("sampling", "bias_variance", "prior", "prior_variance", "vane_covariance"):
        np.testing.assert_array_equal(getattr(found, name), getattr(state, name))
    for axis in range(6):
        before, after = (e.learning.least_squares.estimate(axis).covariance for e in (estimator, other))
        np.testing.assert_allclose(after, before, rtol=1e-9)


def test_a_saved_model_keeps_that_it_does_not_explain_an_axis(flight, tmp_path) -> None:
    """It had USE again until some ten seconds of motion had shown it anew, in cruise for ever."""
    rows, controls = perfect_inputs(flight)
    estimator, _ = learn(flight.aircraft, rows[:6000], controls)
    words = "the model explains 30% of Cm"
    estimator.learning.integrity.doubts.remember({"Cm": words})
    assert "Cm_de" in used_of(estimator, status=Trust.HOLD)
    for name in ("first.json", "second.json"):  # and one that is saved again
        save_model(estimator, tmp_path / name)
        estimator = Identifier(flight.aircraft)
        load_model(estimator, tmp_path / name)
        found = {p.name: p for p in estimator.snapshot().parameters}
        assert found["Cm_de"].status is Trust.HOLD and found["Cm_de"].reason == f"when it was saved: {words}"
        assert found["CZ_alpha"].status is Trust.USE
    estimator.push_samples(controls, EPOCH)
    estimator.push_states(rows)
    assert {"Cm_de", "Cm_q"} <= used_of(estimator)


def test_an_axis_that_is_not_explained_is_not_so_either_once_another_has_one_more_term(flight) -> None:
    """add_effect let go what was in doubt of all axes, until ten seconds of motion had shown it anew."""
    rows, controls = perfect_inputs(flight)
    memory = SampleMemory()
    estimator, points = learn(flight.aircraft, rows[:6000], controls)
    memory.add(points, np.zeros(3), 1.0)
    words = {axis: f"the model explains 30% of {axis}" for axis in ("CZ", "Cl", "Cm")}
    estimator.learning.integrity.doubts.remember(words | {"CX": "contains the lift that CZ has: " + words["CZ"]})
    assert {"CZ_alpha", "Cl_p", "Cm_de", "Cn_p"} <= used_of(estimator, status=Trust.HOLD)
    change_model(estimator, with_terms(flight.aircraft, {"CZ": ("alpha**3",)}, {}), memory.newest())
    found = {p.name: p for p in estimator.snapshot().parameters}
    assert found["Cm_de"].status is Trust.HOLD and found["Cm_de"].reason == words["Cm"]
    assert found["Cn_p"].status is Trust.HOLD and words["Cl"] in found["Cn_p"].reason
    assert "the model explains" not in found["CZ_alpha"].reason + found["CX_alpha"].reason


def used_of(estimator: Identifier, status: Trust = Trust.USE) -> set[str]:
    return {p.name for p in estimator.snapshot().parameters if p.status is status}


@pytest.mark.parametrize("damage", ["", "{}", "[1]", '{"format": "aircraft_sysid_ros model 1"}', "truncated"])
def test_damaged_model_file_changes_nothing(damage: str, flight, tmp_path) -> None:
    rows, controls = perfect_inputs(flight)
    estimator, _ = learn(flight.aircraft, rows[:3000], controls)
    path = tmp_path / "model.json"
    save_model(estimator, path)
    path.write_text(path.read_text()[:500] if damage == "truncated" else damage)
    before = estimator.learning.least_squares.state.theta.copy()
    with pytest.raises(InputError, match=r"model"):
        load_model(estimator, path)
    assert np.array_equal(estimator.learning.least_squares.state.theta, before)


@pytest.mark.long
def test_reset_forgets(flight) -> None:
    estimator, _ = learn(flight.aircraft, *perfect_inputs(flight))
    estimator.reset()
    assert all(np.isnan(p.value) and p.status == Trust.HOLD for p in estimator.snapshot().parameters)
