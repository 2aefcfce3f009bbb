"""Recursive maximum likelihood, live: true parameters and noise levels, the same bits in any blocks, no wild value."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, TEXTBOOK_TERMS, model_from_terms
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.identification.coefficients.body import body_of, body_with
from aircraft_sysid_ros.identification.estimators import likelihood_state as state
from aircraft_sysid_ros.identification.estimators.maximum_likelihood import _model_with
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


def values_and_stds(pipeline: Pipeline) -> tuple[np.ndarray, np.ndarray]:
    parameters = pipeline.parameters.snapshot().parameters
    return np.array([p.value for p in parameters]), np.array([p.std for p in parameters])


def quick(aircraft, rate: float = 25.0) -> Pipeline:
    """A chain whose learner takes fewer samples and starts after 1 s with coefficients that are 5 % off."""
    pipeline = Pipeline(aircraft, None, ParameterOptions(estimator="rml", rml_rate=rate))
    learner = pipeline.parameters.learning.estimator
    learner._tuning = learner._tuning._replace(start_time=1.0, longest_start=1.0)
    recursion = learner.recursion
    for i, name in enumerate(aircraft.model.parameter_names):
        truth = aircraft.coefficients.get(name, 0.0)
        recursion.theta[i] = 1.05 * truth
        recursion.root[i, i] = 0.02 * abs(truth) + 0.001
    return pipeline


def fly(pipeline: Pipeline, samples: Samples, block: int = 1000) -> Pipeline:
    for at in range(0, len(samples), block):
        pipeline.push(samples[at : at + block])
    return pipeline


@pytest.fixture(scope="module")
def gusty(aircraft):
    """Light turbulence: gusts that the aircraft file says nothing of."""
    return simulate_samples(aircraft, seed=5, duration=75.0, turbulence="light")


@pytest.fixture(scope="module")
def short(aircraft):
    return simulate_samples(aircraft, seed=2, duration=26.0)


@pytest.fixture(scope="module")
def learnt(gusty) -> Pipeline:
    pipeline = Pipeline(gusty.aircraft, None, ParameterOptions(estimator="rml"))
    pipeline.push(gusty.samples)
    pipeline.flush()
    return pipeline


@pytest.fixture(scope="module")
def clean(aircraft, short) -> Pipeline:
    """The short flight as it was; who changes what was learnt takes a copy."""
    return fly(quick(aircraft), short.samples)


# -- right, and as right as it says ---------------------------------------------------------------------------------


@pytest.mark.long
def test_parameters_in_turbulence_are_covered_by_their_standard_errors(learnt, gusty):
    """One flight of the benchmark: at least 24 of 32 within 1.96 standard errors, all within 5."""
    value, std = values_and_stds(learnt)
    truth = np.array([gusty.aircraft.coefficients[name] for name in gusty.aircraft.model.parameter_names])
    z = (value - truth) / std
    assert np.sum(np.abs(z) < 1.96) >= 24, np.round(z, 1)
    assert np.all(np.abs(z) < 5.0), np.round(z, 1)
    for name in ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr", "CY_beta"):
        i = gusty.aircraft.model.parameter_names.index(name)
        assert value[i] == pytest.approx(truth[i], rel=0.06), name


@pytest.mark.long
def test_noise_levels_are_found_with_the_parameters(learnt):
    """Sensors are as the file says; the gusts, which the file puts at 0.03, are those of turbulence."""
    levels = learnt.parameters.learning.estimator.noise_levels()
    for name in ("specific_force", "airspeed", "angle_of_attack", "sideslip", "position"):
        assert levels[name] == pytest.approx(1.0, abs=0.12), name
    assert 0.2 < levels["gusts_vertical"] < 1.0 and 0.2 < levels["gusts_horizontal"] < 1.0


@pytest.mark.long
def test_in_turbulence_it_is_nearer_than_least_squares_on_the_states(learnt, gusty):
    """C_m, where angles that are late bend most in turbulence: sum of the relative errors of its four parameters."""
    other = Pipeline(gusty.aircraft, None, ParameterOptions(measured_angles=False))
    other.push(gusty.samples)
    other.flush()
    part = gusty.aircraft.model.axis_slice("Cm")
    truth = np.array([gusty.aircraft.coefficients[name] for name in gusty.aircraft.model.parameter_names])[part]
    ours, theirs = values_and_stds(learnt)[0][part], values_and_stds(other)[0][part]
    assert np.abs(ours / truth - 1.0).sum() < 0.7 * np.abs(theirs / truth - 1.0).sum()


@pytest.mark.long
def test_covariance_is_symmetric_and_positive_and_verdicts_are_given(learnt):
    snapshot = learnt.parameters.snapshot()
    np.testing.assert_allclose(snapshot.covariance, snapshot.covariance.T)
    assert np.linalg.eigvalsh(snapshot.covariance).min() > 0.0
    used = {p.name for p in snapshot.parameters if p.status == Trust.USE}
    assert {"CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_dr"} <= used
    assert all(p.age < 60.0 for p in snapshot.parameters)


# -- deterministic --------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("block", [1, pytest.param(37, marks=pytest.mark.long)])
def test_live_in_any_blocks_equals_replay(aircraft, short, block):
    samples = short.samples[: 2 * len(short.samples) // 3]
    runs = [fly(quick(aircraft), samples, size) for size in (block, 10**6)]
    first = runs[0].parameters.learning.estimator
    assert first.recursion.clock[state.LEARNT] > 8.0
    for run in runs[1:]:
        recursion = run.parameters.learning.estimator.recursion
        assert np.array_equal(recursion.theta, first.recursion.theta)
        assert np.array_equal(recursion.root, first.recursion.root)
        assert np.array_equal(recursion.states, first.recursion.states)
        assert np.array_equal(recursion.scores.lagged, first.recursion.scores.lagged)


# -- nothing wild ---------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_term_that_never_moves_is_held(aircraft, short):
    terms = dict(TEXTBOOK_TERMS) | {"CZ": (*TEXTBOOK_TERMS["CZ"], "flaps")}
    pipeline = fly(quick(replace(aircraft, model=model_from_terms(terms))), short.samples)
    flaps = next(p for p in pipeline.parameters.snapshot().parameters if p.name == "CZ_flaps")
    learner = pipeline.parameters.learning.estimator
    assert abs(flaps.value) < 0.1 * flaps.std and flaps.status == Trust.HOLD
    assert flaps.std > 0.004 and np.isnan(learner.estimate(AXES.index("CZ")).last_learnt[-1])
    assert all(np.isfinite(p.value) for p in pipeline.parameters.snapshot().parameters)


def faulty(samples: Samples) -> Samples:
    """2 s without any sample, no air data for 2 s, controls that are NaN for 1 s, and air data far off."""
    time = (samples.stamp - samples.stamp[0]) * 1e-9
    values = samples.values.copy()
    values[(samples.kind == Kind.CONTROLS) & (time > 15.0) & (time < 16.0)] = np.nan
    values[(samples.kind == Kind.ANGLE_OF_ATTACK) & (np.arange(len(samples)) % 40 == 0), 0] = 1.2
    values[(samples.kind == Kind.GPS_VELOCITY) & (time > 18.0) & (time < 19.0), :3] = 900.0
    air = np.isin(samples.kind, (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)) & (time > 12.0) & (time < 14.0)
    gap = (time > 20.0) & (time < 22.0)
    kept = ~(air | gap)
    return Samples(samples.stamp[kept], samples.kind[kept], values[kept])


@pytest.mark.long
def test_gaps_dead_sensors_and_absurd_values_do_no_harm(aircraft, short, clean):
    pipeline = fly(quick(aircraft), faulty(short.samples))
    (value, std), (other, other_std) = values_and_stds(clean), values_and_stds(pipeline)
    assert np.all(np.isfinite(other)) and np.all(other_std > 0.0)
    assert pipeline.parameters.learning.estimator.restarts <= 1
    assert np.mean(np.abs(other - value) < 3.0 * np.hypot(std, other_std)) > 0.8


def test_without_controls_nothing_is_learnt_and_nothing_moves(aircraft, short):
    samples = short.samples
    pipeline = fly(quick(aircraft), samples[samples.kind != Kind.CONTROLS])
    assert pipeline.parameters.learning.estimator.recursion.clock[state.LEARNT] == 0.0
    assert all(p.status == Trust.HOLD and np.isnan(p.value) for p in pipeline.parameters.snapshot().parameters)


@pytest.mark.long
def test_lost_filters_begin_anew_with_what_was_learnt(aircraft, short):
    samples = short.samples
    half = int(np.searchsorted(samples.stamp, samples.stamp[0] + int(18e9)))
    pipeline = fly(quick(aircraft), samples[:half])
    learner = pipeline.parameters.learning.estimator
    before, learnt = learner.recursion.theta.copy(), learner.recursion.clock[state.LEARNT]
    learner.recursion.states[3, 0] = np.nan
    pipeline.push(samples[half : half + 60])
    assert learner.restarts == 1
    assert np.all(np.isfinite(learner.recursion.theta)) and np.all(np.isfinite(learner.recursion.states))
    fly(pipeline, samples[half + 60 :])
    assert learner.restarts == 1 and learner.recursion.clock[state.LEARNT] > learnt
    n = len(aircraft.model.parameter_names)
    moved = np.abs(learner.recursion.theta - before)[:n]
    assert np.all(moved < 0.2 * (learner.recursion.high - learner.recursion.low)[:n])


@pytest.mark.long
def test_a_model_that_explains_nothing_is_given_up(aircraft, short):
    """Noise levels out of all proportion: parameters are NaN and HOLD until a new start."""
    samples = short.samples
    half = int(np.searchsorted(samples.stamp, samples.stamp[0] + int(20e9)))
    pipeline = fly(quick(aircraft), samples[:half])
    learner = pipeline.parameters.learning.estimator
    learner.recursion.theta[-3] = np.log(9.0)
    pipeline.push(samples[half : half + 60])
    assert learner.restarts == 1 and learner.recursion.clock[state.STARTED] == 0.0
    assert all(p.status == Trust.HOLD and np.isnan(p.value) for p in pipeline.parameters.snapshot().parameters)


@pytest.mark.long
def test_reset_forgets_and_a_new_clock_does_not(aircraft, clean):
    learner = copy.deepcopy(clean.parameters.learning.estimator)
    theta = learner.recursion.theta.copy()
    learner.restart_clock()
    assert np.array_equal(learner.recursion.theta, theta)
    learner.reset()
    assert learner.estimate(0).samples == 0 and not learner.recursion.theta[: len(aircraft.model.parameter_names)].any()


def test_a_shifted_centre_of_gravity_moves_every_sensor(aircraft):
    """All positions are from the centre of gravity: 2 cm forward and every sensor stands 2 cm further back."""
    learner = quick(aircraft).parameters.learning.estimator
    origin = np.array([0.8, 0.2, 300.0])
    before = _model_with(learner._model, aircraft, body_of(aircraft), origin)
    values = np.full(10, np.nan)
    values[0], values[5:8] = 2.5, [0.02, 0.0, 0.0]
    after = _model_with(learner._model, aircraft, body_with(aircraft, body_of(aircraft), values), origin)
    assert (before.mass, after.mass) == (aircraft.mass, 2.5)
    for name in ("imu", "gps", "probe", "reference"):
        moved = np.subtract(getattr(after, name), getattr(before, name))
        np.testing.assert_allclose(moved, [-0.02, 0.0, 0.0], atol=1e-15, err_msg=name)


@pytest.mark.parametrize("again", [False, True])
def test_stated_errors_of_the_air_data_are_taken_off(aircraft, short, again):
    """Sensors that show too little, aside, or drift: with a file that says so, as much is learnt as of right ones.

    ``again``: a second manoeuvre of the same flight begins after half of it; the drift goes on.
    """
    samples, file = short.samples[: 2 * len(short.samples) // 3], aircraft
    vane, speed = samples.kind == Kind.ANGLE_OF_ATTACK, samples.kind == Kind.AIRSPEED
    first = Pipeline(aircraft)
    begin = first.push(samples)[0][0, StateField.TIME] + first.state.epoch * 1e-9
    values = samples.values.copy()
    values[vane, 0] = 0.85 * (values[vane, 0] + 0.03)
    values[speed, 0] *= 1.0 + 0.01 * np.maximum(samples.stamp[speed] * 1e-9 - begin, 0.0)
    stated = {("angle_of_attack", "scale"): 0.85, ("angle_of_attack", "offset"): 0.03, ("airspeed", "drift"): 0.01}
    stated["angle_of_attack", "noise"] = 0.85 * aircraft.sensors["angle_of_attack"].noise[0]
    for key, value in stated.items():
        file = with_setting(file, ("sensors", *key), value)
    learnt = []
    for flown, shown in ((aircraft, samples), (file, replace(samples, values=values))):
        pipeline, half = quick(flown), len(shown) // 2
        fly(pipeline, shown[:half])
        if again:
            pipeline.begin_anew(0.01)
        learnt.append(values_and_stds(fly(pipeline, shown[half:])))
    (expected, std), (found, _) = learnt
    assert np.isfinite(std).sum() > 20
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)
