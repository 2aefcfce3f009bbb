"""After a change of the aeroplane: noticed soon, never without one, learnt anew, and honest about it on the way."""

from __future__ import annotations

import argparse
import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from aircraft_files import of_shape

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.commands.options import add_estimator_options, estimator_options
from aircraft_sysid_ros.estimation.lagged_moments import add_sample
from aircraft_sysid_ros.estimation.recursive_least_squares import rls_update
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.estimators import fourier_prior
from aircraft_sysid_ros.identification.estimators.likelihood_restore import WIDENING, Past, take_axis
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import (
    RecursiveLeastSquares,
    accumulate,
    variance_with_prior,
)
from aircraft_sysid_ros.identification.estimators.reset_prior import (
    MEMORY,
    SHARE,
    changed_variance,
    information,
    spread_of_terms,
    within_prior,
)
from aircraft_sysid_ros.identification.history import SampleHistory
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.model_file import parameters_json
from aircraft_sysid_ros.identification.monitoring.covariance_reset import ChangeDetector
from aircraft_sysid_ros.identification.monitoring.hold import _since
from aircraft_sysid_ros.identification.monitoring.integrity import IntegrityMonitor
from aircraft_sysid_ros.identification.monitoring.residuals import WINDOW, ResidualMonitor
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation import simulated_flight
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.manoeuvres import Excitation, Plan
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

AT, CM = 70.0, 4  # [s] of the loss; its axis
STEP = 0.04
KNOWN = np.ones(6, np.bool_)


def points_of(errors: np.ndarray, begin: float = 0.0) -> np.ndarray:
    """Points whose errors of C_m are those given (m,), learnt from in all axes."""
    points = np.zeros((len(errors), CoefficientSample.TERMS))
    points[:, CoefficientSample.TIME] = begin + STEP * np.arange(len(errors))
    points[:, CoefficientSample.MEASURED.start + CM] = errors
    points[:, CoefficientSample.LEARNT] = 1.0
    return points


def add(monitor: ResidualMonitor, points: np.ndarray) -> None:
    """Samples with the predictions that they hold, of axes that are all known."""
    monitor.add(points, points[:, CoefficientSample.PREDICTED], KNOWN)


def look_through(
    monitor: ResidualMonitor, points: np.ndarray, block: int = 5, uncertainty: float = 0.0
) -> float | None:
    """Time of the first alarm, looked for after every block."""
    for at in range(0, len(points), block):
        add(monitor, points[at : at + block])
        if monitor.has_changed(CM, lambda: uncertainty):
            return float(points[min(at + block, len(points)) - 1, CoefficientSample.TIME])
    return None


# -- the monitor ----------------------------------------------------------------------------------------------------


def test_half_an_hour_of_coloured_noise_gives_no_alarm():
    """Errors that are correlated over windows, and twice as large in every third minute: no model is as good always."""
    rng = np.random.default_rng(1)
    white = rng.standard_normal(45_000 + 4)
    errors = np.convolve(white, np.ones(5) / np.sqrt(5.0), mode="valid")
    minutes = (STEP * np.arange(len(errors)) // 60).astype(int)
    assert look_through(ResidualMonitor(STEP), points_of(errors * np.where(minutes % 3 == 2, 2.0, 1.0))) is None


@pytest.mark.parametrize("size", [10.0, 30.0])
def test_a_change_is_noticed_within_a_second_and_dated(size):
    errors = np.random.default_rng(2).standard_normal(2000)
    errors[1500:] *= size
    monitor = ResidualMonitor(STEP)
    alarm = look_through(monitor, points_of(errors))
    assert 1500 * STEP < alarm < 1500 * STEP + 1.0
    assert monitor.change_time(CM) == pytest.approx(1500 * STEP, abs=0.13)
    assert monitor.variance(CM) == pytest.approx(1.0, abs=0.15)  # without the second of the change


def test_gusts_that_set_in_are_no_change_but_three_axes_at_once_are():
    rng = np.random.default_rng(2)
    for axes, alarm in ((range(6), False), (range(1, 6), False), (range(3, 6), True)):
        points = points_of(rng.standard_normal(2000))
        points[:, CoefficientSample.MEASURED] = rng.standard_normal((2000, 6))
        for axis in axes:
            points[1500:, CoefficientSample.MEASURED.start + axis] *= 30.0
        assert (look_through(ResidualMonitor(STEP), points) is not None) == alarm


def test_evaluations_that_are_scattered_over_a_cruise_are_no_second_of_motion():
    errors = np.random.default_rng(2).standard_normal(2000)
    errors[1500:] *= 30.0
    points = points_of(errors)
    points[1500:, CoefficientSample.TIME] += 3.0 * STEP * np.arange(500)
    assert look_through(ResidualMonitor(STEP), points) is None


def test_what_the_parameters_may_be_wrong_by_is_no_change():
    errors = np.random.default_rng(2).standard_normal(2000)
    errors[1500:] *= 10.0
    assert (
        look_through(ResidualMonitor(STEP), points_of(errors), uncertainty=100.0 / THRESHOLDS.change_ratio**2) is None
    )


def test_there_is_no_alarm_before_the_errors_are_known_nor_where_the_axis_does_not_learn():
    early = THRESHOLDS.least_blocks * WINDOW - 10
    errors = np.random.default_rng(2).standard_normal(2000)
    errors[early:] *= 30.0
    assert look_through(ResidualMonitor(STEP), points_of(errors)) is None
    errors[early:1500] /= 30.0
    points = points_of(errors)
    points[1500:, CoefficientSample.LEARNT] = 0.0
    assert look_through(ResidualMonitor(STEP), points) is None


def test_after_an_alarm_and_after_a_contradiction_of_sensors_errors_are_counted_anew():
    errors = np.random.default_rng(2).standard_normal(2000)
    monitor = ResidualMonitor(STEP)
    assert look_through(monitor, points_of(errors)) is None
    monitor.skip()
    add(monitor, points_of(30.0 * errors[: WINDOW - 1]))
    assert not monitor.has_changed(CM, lambda: 0.0)
    monitor.forget(CM)
    assert look_through(monitor, points_of(30.0 * errors)) is None  # as large as ever since


# -- the prior ------------------------------------------------------------------------------------------------------


def test_information_is_the_inverse_at_scales_far_apart():
    rng = np.random.default_rng(3)
    root = rng.standard_normal((4, 4))
    scale = np.array([1.0, 1e-5, 1e4, 1e-2])
    covariance = (root @ root.T + np.eye(4)) * np.outer(scale, scale)
    assert information(covariance) @ covariance == pytest.approx(np.eye(4), abs=1e-6)


def test_a_change_may_be_a_share_of_the_value_or_of_the_spread():
    rng = np.random.default_rng(3)
    x = np.column_stack([np.ones(5000), 0.1 * rng.standard_normal(5000), np.zeros(5000)])
    rows = np.column_stack([x, x @ [0.0, 2.0, 1.0], np.ones(5000)])
    spread = spread_of_terms(rows.T @ rows)
    assert spread == pytest.approx([0.2, 2.0, 0.0], rel=0.05)  # a term that never moved has no say
    assert np.sqrt(changed_variance(np.array([0.0, 40.0, 1.0]), spread))[1] == pytest.approx(SHARE * 40.0, rel=1e-3)


def relearnt(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Recursive least squares from a prior that was drawn around the truth, on coloured noise: error, P, covariance."""
    n, steps, theta = 3, 200, np.array([1.0, -2.0, 0.5])
    prior = np.diag([0.5, 0.3, 0.4]) ** 2
    x = np.zeros((steps, n))
    for k in range(1, steps):  # motion that is as slow as the noise
        x[k] = 0.9 * x[k - 1] + rng.standard_normal(n) * [1.0, 1.0, 0.05]
    noise = np.convolve(rng.standard_normal(steps + 4), np.ones(5) / np.sqrt(5.0), mode="valid")
    estimate, p = rng.multivariate_normal(theta, prior), prior.copy()
    sums, recent = np.zeros((15, n + 2, n + 2)), np.full((15, n + 2), np.nan)
    for row, e in zip(x, noise, strict=True):
        y = float(row @ theta + e)
        rls_update(estimate, p, row, y, 1.0)
        add_sample(sums, recent, np.array([*row, y, 1.0]), 1.0)
    variance, widening = variance_with_prior(sums, estimate, np.linalg.inv(prior), 1.0)
    return estimate - theta, p, variance * p * np.outer(widening, widening)


@pytest.mark.long
def test_standard_errors_with_a_prior_are_those_of_the_errors_in_coloured_noise():
    """300 draws: rms of error over standard error, which without the colour is far above one."""
    rng = np.random.default_rng(4)
    draws = [relearnt(rng) for _ in range(300)]
    z = np.array([error / np.sqrt(np.diag(covariance)) for error, _, covariance in draws])
    white = np.array([error / np.sqrt(np.diag(p)) for error, p, _ in draws])
    assert np.sqrt(np.mean(z**2, axis=0)) == pytest.approx(1.0, abs=0.25)
    assert np.sqrt(np.mean(white[:, :2] ** 2)) > 1.35


def test_no_standard_error_is_larger_than_that_of_the_prior():
    covariance = np.array([[4.0, 1.0], [1.0, 0.01]])
    covariance[0, 1] = covariance[1, 0] = 0.1
    bounded = within_prior(covariance, np.diag([1.0, 1.0]))
    assert np.sqrt(np.diag(bounded)) == pytest.approx([1.0, 0.1])
    assert np.linalg.eigvalsh(bounded).min() > 0.0


@pytest.mark.parametrize("strength", [1e-9, 1e9])
def test_in_the_frequency_domain_the_prior_counts_as_much_as_it_says(strength):
    """Without weight least squares is left, with all weight the prior itself."""
    from aircraft_sysid_ros.estimation.recursive_fourier import Window, spectral_least_squares

    rng = np.random.default_rng(5)
    window = Window(2.0 * np.pi * np.arange(0.1, 2.0, 0.02), 240.0, 20.0)
    m, theta = len(window.frequencies), np.array([1.0, -2.0])
    x = rng.standard_normal((m, 2)) + 1j * rng.standard_normal((m, 2))
    noise = 0.1 * (rng.standard_normal(m) + 1j * rng.standard_normal(m))
    spectrum = np.full(m, 0.02 / window.energy(0.0).real)
    prior = fourier_prior.Prior(np.array([3.0, 3.0]), strength * np.eye(2), spectrum)
    fit = fourier_prior.fit_with_prior(x, x @ theta + noise, window, prior)
    std = np.sqrt(np.diag(fourier_prior.covariance_with_prior(fit, x, window, prior)))
    plain = spectral_least_squares(x, x @ theta + noise, window).solution.estimate
    if strength > 1.0:
        assert fit.solution.estimate == pytest.approx(prior.theta, abs=1e-4)
        assert std == pytest.approx(strength**-0.5, rel=1e-3)
    else:
        assert fit.solution.estimate == pytest.approx(plain, abs=0.02)
        assert np.all(np.abs(fit.solution.estimate - theta) < 4.0 * std)


# -- flights --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lossy(aircraft):
    """Half of the elevator goes at AT."""
    text = f"max(sign(time-{AT}),0)*de"
    effects = tuple(Effect(axis, text, -0.5 * aircraft.coefficients[f"{axis}_de"]) for axis in ("Cm", "CZ"))
    return simulate_samples(aircraft, 3, 120.0, effects=effects)


def fly(flight, block: int = 500, **options) -> tuple[Pipeline, list]:
    """A flight through the chain, and what was published on the way."""
    pipeline, sets = Pipeline(flight.aircraft, None, ParameterOptions(**options)), []
    for at in range(0, len(flight.samples), block):
        pipeline.push(flight.samples[at : at + block])
        sets.append(pipeline.parameters.snapshot())
    pipeline.flush()
    return pipeline, [*sets, pipeline.parameters.snapshot()]


@pytest.fixture(scope="module")
def flown(lossy):
    """The flight with the loss by estimator, flown once for all tests that only look."""
    return cache(lambda estimator: fly(lossy, estimator=estimator))


def bits(parameters: Identifier) -> np.ndarray:
    return np.array([(p.value, p.std, p.status) for p in parameters.snapshot().parameters])


def test_a_change_that_was_undone_is_told_of_no_more():
    changes = ChangeDetector(STEP, 0.08, SampleHistory(CoefficientSample.TERMS, 250))
    before = np.array([changes.since, changes.times])
    changes.since[CM], changes.times[CM], changes.counts[CM] = 12.0, 11.0, 1
    assert [axis for axis, *_ in changes.alarms()] == ["Cm"]
    changes.undo(CM, before[:, CM])
    assert changes.alarms() == []
    assert changes.summary()["last_change"] == ""


@pytest.mark.long
def test_the_first_motion_after_a_quiet_cruise_is_no_change(aircraft, monkeypatch):
    """What gusts and noise had made of Cl was on HOLD throughout; the first aileron contradicted it, which was told as
    a change of the aeroplane."""
    plan_of, quiet = simulated_flight.plan_of, 60.0

    def late_plan(name: str, time: np.ndarray, excitation: Excitation, seed: int) -> Plan:
        plan, first = plan_of(name, time, excitation, seed), int(np.searchsorted(time, quiet))
        moved = ("controls", "bank", "airspeed", "height", "flaps")
        later = {key: np.concatenate([np.repeat(was[:1], first, axis=0), was[: len(time) - first]])
                 for key, was in ((key, getattr(plan, key)) for key in moved)}  # fmt: skip
        return replace(plan, **later)

    monkeypatch.setattr(simulated_flight, "plan_of", late_plan)
    sensors = SensorOptions(noise_scale=4.0, attitude=True)
    flight = simulate_samples(aircraft, 31, quiet + 15.0, turbulence="light", sensors=sensors)
    begun_anew, note = [], IntegrityMonitor.note_change

    def noted(self: IntegrityMonitor, axis: int, now: float, is_news: bool) -> None:
        begun_anew.append((axis, is_news))
        note(self, axis, now, is_news)

    monkeypatch.setattr(IntegrityMonitor, "note_change", noted)
    pipeline, sets = fly(replace(flight, aircraft=of_shape(aircraft)))
    assert (AXES.index("Cl"), True) in begun_anew and all(is_news for _, is_news in begun_anew)
    assert pipeline.parameters.learning.changes.alarms() == []
    assert not pipeline.parameters.learning.changes.counts.any()
    assert not [p for s in sets for p in s.parameters if "since a change" in p.reason]
    assert not parameters_json(pipeline.parameters)["changes"]
    last = {p.name: p for p in sets[-1].parameters}
    for name in ("Cl_da", "Cl_p"):
        assert abs(last[name].value - aircraft.coefficients[name]) < 4.0 * last[name].std


@pytest.mark.long
@pytest.mark.parametrize("estimator", ["rls", *(pytest.param(e, marks=pytest.mark.long) for e in ("fourier", "rml"))])
def test_a_lost_elevator_is_noticed_and_learnt_anew_and_never_wild_in_use(lossy, flown, estimator):
    pipeline, sets = flown(estimator)
    changes, truth = pipeline.parameters.learning.changes, 0.5 * lossy.aircraft.coefficients["Cm_de"]
    assert changes.counts.tolist() == [0, 0, 0, 0, 1, 0]
    assert AT - 1.5 < changes.times[CM] < AT + 0.2  # of a flight that begins when the filter does
    begin = changes.since[CM] - AT
    path = [(s.time - begin, p) for s in sets for p in s.parameters if p.name == "Cm_de"]
    words = f"relearning since a change at {changes.times[CM]:.1f} s: "
    relearning = [p for _, p in path if p.reason.startswith(words)]
    assert len(relearning) > 3 and all(p.status == Trust.HOLD for p in relearning)
    after = [p for time, p in path if time > AT + 1.0]
    assert not [p for p in after if p.status == Trust.USE and not 0.6 < p.value / truth < 1.4]
    assert after[-1].status == Trust.USE
    assert after[-1].value == pytest.approx(truth, rel=0.1)
    for p in after:  # within the reach of the prior, always
        assert abs(p.value - 2.0 * truth) < 3.0 * SHARE * abs(2.0 * truth)


@pytest.mark.long
def test_without_relearning_the_old_and_the_new_are_mixed(lossy):
    truth = 0.5 * lossy.aircraft.coefficients["Cm_de"]
    pipeline, sets = fly(lossy, relearn=False)
    last = next(p for p in sets[-1].parameters if p.name == "Cm_de")
    assert not 0.7 < last.value / truth < 1.3
    assert not pipeline.parameters.learning.changes.counts.any()


@pytest.mark.long
@pytest.mark.parametrize("estimator", ["rls", pytest.param("fourier", marks=pytest.mark.long)])
def test_a_change_is_the_same_in_blocks_of_any_size(lossy, flown, estimator):
    """Of 97 samples, and of 500 with which it was flown."""
    runs = [flown(estimator)[0].parameters, fly(lossy, 97, estimator=estimator)[0].parameters]
    assert runs[0].learning.changes.counts.any()
    assert np.array_equal(bits(runs[0]), bits(runs[1]), equal_nan=True)


@pytest.mark.long
@pytest.mark.parametrize("air", [pytest.param("none", marks=pytest.mark.long), "light"])
def test_a_flight_without_a_change_is_the_same_to_the_last_bit(aircraft, air):
    flight = simulate_samples(aircraft, 6, 90.0, turbulence=air)
    ours, theirs = (fly(flight, relearn=relearn)[0].parameters for relearn in (True, False))
    assert not ours.learning.changes.counts.any()
    assert np.array_equal(bits(ours), bits(theirs), equal_nan=True)


RAMP = "min(max((time-60)/5,0),1)"


@pytest.fixture(scope="module")
def flaps(aircraft):
    """Flaps that nobody recorded go out from 60 to 65 s."""
    sizes = {"CZ": -0.25, "CX": -0.03, "Cm": -0.05}
    return simulate_samples(aircraft, 11, 110.0, effects=tuple(Effect(a, RAMP, size) for a, size in sizes.items()))


def worst_in_use(sets, truth: dict[str, float], since: float) -> dict[str, float]:
    """Largest error of each parameter with USE, in standard errors, from a time [s] on."""
    worst: dict[str, float] = {}
    for found in sets:
        for p in found.parameters:
            if found.time > since and p.status == Trust.USE and p.name in truth:
                worst[p.name] = max(worst.get(p.name, 0.0), abs(p.value - truth[p.name]) / p.std)
    return worst


@pytest.mark.long
def test_what_is_learnt_while_a_change_goes_on_is_forgotten_after_it(flaps):
    pipeline, sets = fly(flaps)
    sizes = {"CZ_0": -0.25, "CX_0": -0.03, "Cm_0": -0.05}
    truth = {name: value + sizes.get(name, 0.0) for name, value in flaps.aircraft.coefficients.items()}
    changes = pipeline.parameters.learning.changes
    assert changes.counts[[2, CM]].tolist() == [1, 1]
    begin = changes.since[CM] - changes.times[CM]  # of the flight, by the time of sets
    worst = worst_in_use(sets, {name: v for name, v in truth.items() if name[:2] in ("CZ", "Cm")}, begin + 75.0)
    assert {"CZ_0", "CZ_alpha", "Cm_0", "Cm_alpha", "Cm_de"} <= set(worst)
    assert max(worst.values()) < 5.5  # 70 and more where what was learnt meanwhile stays
    last = {p.name: p for p in sets[-1].parameters}
    for name in ("CZ_0", "CZ_alpha", "Cm_alpha", "Cm_de"):
        assert last[name].status == Trust.USE
        assert last[name].value == pytest.approx(truth[name], rel=0.1)


@pytest.mark.long
def test_a_change_that_goes_on_is_the_same_in_blocks_of_any_size(flaps):
    runs = [fly(flaps)[0].parameters, fly(flaps, 97)[0].parameters]
    assert np.array_equal(bits(runs[0]), bits(runs[1]), equal_nan=True)


@pytest.mark.long
def test_users_are_told_of_it(flown):
    estimator = copy.deepcopy(flown("rls")[0].parameters)
    (change,) = parameters_json(estimator)["changes"]
    assert change["axis"] == "Cm" and change["count"] == 1
    assert change["time"] == pytest.approx(AT, abs=1.5)
    assert estimator.learning.changes.summary() == {"changes": 1, "last_change": f"{change['time']:.1f} s Cm"}
    estimator.reset()
    assert estimator.learning.changes.summary() == {"changes": 0, "last_change": ""}


def test_it_can_be_switched_off_on_the_command_line():
    parser = argparse.ArgumentParser()
    add_estimator_options(parser)
    assert estimator_options(parser.parse_args([]))[1].relearn
    assert not estimator_options(parser.parse_args(["--no-relearn"]))[1].relearn


# -- recursive maximum likelihood -----------------------------------------------------------------------------------


@pytest.fixture
def recursion(aircraft):
    estimator = Identifier(aircraft, ParameterOptions(estimator="rml"))
    recursion = estimator.learning.estimator.recursion
    recursion.root[:] = np.tril(0.01 * np.random.default_rng(7).standard_normal(recursion.root.shape)) + recursion.root
    return recursion


def test_the_past_is_what_was_before_the_time(recursion):
    past, first = Past(), recursion.theta.copy()
    for time in np.arange(0.0, 10.0, 0.2):
        past.keep(float(time), recursion)
        recursion.theta[0] += 0.02
    past.restore(8.3, recursion)
    assert 8.3 - 0.8 <= 10.0 * (recursion.theta[0] - first[0]) <= 8.3
    past.restore(0.0, recursion)  # further back than is remembered: the oldest
    assert 10.0 - MEMORY - 1.5 <= 10.0 * (recursion.theta[0] - first[0]) <= 10.0 - MEMORY


def test_an_axis_that_is_taken_over_leaves_the_others_as_they_were(recursion, aircraft):
    part = aircraft.model.axis_slice("Cm")
    rest = np.setdiff1d(np.arange(len(recursion.root)), np.arange(part.start, part.stop))
    before = recursion.root @ recursion.root.T
    theta, covariance = np.array([0.01, -0.5, -10.0, -0.4]), np.diag([1e-4, 1e-2, 1.0, 1e-3])
    take_axis(recursion, part, theta, covariance)
    after = recursion.root @ recursion.root.T
    assert after[np.ix_(rest, rest)] == pytest.approx(before[np.ix_(rest, rest)], rel=1e-9, abs=1e-12)
    assert after[part, part] == pytest.approx(WIDENING**2 * covariance, rel=1e-9, abs=1e-12)
    assert not np.abs(after[np.ix_(rest, np.arange(part.start, part.stop))]).max() > 1e-12
    assert recursion.theta[part] == pytest.approx(theta)


@pytest.mark.long
def test_a_step_that_the_model_has_is_not_learnt_by_a_constant_besides(aircraft):
    """The constant was opened at that moment, and each was given half of the change, 9 standard errors off, to USE.

    Another axis, whose stiffness loses a third, is.
    """
    term, true = "max(sign(time-49),0)", -0.2  # flaps that take 2 s; the filter starts after one
    lost = Effect("Cm", "max(sign(time-60),0)*alpha", -0.35 * aircraft.coefficients["Cm_alpha"])
    source = copy.deepcopy(aircraft.source)
    del source["coefficients"]
    source["model"] = {**aircraft.model.terms, "CZ": [*aircraft.model.terms["CZ"], term]}
    flaps = Effect("CZ", "min(max(time-49,0),2)/2", true)
    samples = simulate_samples(aircraft, 13, 90.0, effects=[flaps, lost]).samples
    pipeline = Pipeline(aircraft_from_dict(source))
    pipeline.push(samples)
    pipeline.flush()
    found = {p["name"]: p for p in parameters_json(pipeline.parameters)["parameters"]}
    for name, value in ((f"CZ_{term}", true), ("CZ_0", aircraft.coefficients["CZ_0"])):
        assert found[name]["status"] == "USE"
        assert abs(found[name]["value"] - value) < 0.02, found[name]
    changed = {axis: time for axis, time, _ in pipeline.parameters.learning.changes.alarms()}
    assert "CZ" not in changed and 58.0 < changed["Cm"] < 66.0
    assert found["Cm_alpha"]["value"] == pytest.approx(0.65 * aircraft.coefficients["Cm_alpha"], rel=0.1)


@pytest.mark.parametrize("left", [1e-18, 1e-200])
def test_an_axis_that_changed_is_still_told_after_a_surface_has_stood_for_an_hour(aircraft, left):
    """The flaps stay down: what they do and the constant are one column, and the prior that told them apart fades. In
    every other draw that ended with an error of NumPy, and so did the node.
    """
    n, axis = 4, AXES.index("Cm")
    truth = np.array([aircraft.coefficients[f"Cm_{term}"] for term in ("0", "alpha", "q", "de")])
    opened = np.diag(changed_variance(truth, np.zeros(n)) / 1e-6)
    noise = np.full(int(aircraft.model.offsets[-1]), 1e-5)
    for seed in range(6):
        estimator, rng = RecursiveLeastSquares(aircraft, ParameterOptions()), np.random.default_rng(seed)
        state = estimator.state
        state.theta[axis, :n], state.p[axis, :n, :n], state.prior_variance[axis] = truth, opened, 1e-6
        state.prior[axis, :n, :n] = left * information(opened)
        for k in range(1000):
            x = np.array([1.0, 0.1 * rng.standard_normal(), 0.01 * rng.standard_normal(), -0.0523])
            y, weight = float(x @ truth) + 1e-3 * rng.standard_normal(), rng.uniform(0.3, 1.0)
            rls_update(state.theta[axis, :n], state.p[axis, :n, :n], weight * x, weight * y, 1.0)
            accumulate(axis, 0.04 * k, weight * x, weight * y, weight, noise, state, estimator.tuning)
        found = estimator.estimate(axis)
        std = np.sqrt(np.diag(found.covariance))
        np.testing.assert_allclose(found.theta[1:3], truth[1:3], rtol=0.02)
        assert (std[1:3] < 0.02 * abs(truth[1:3])).all()
        assert not std[3] < 0.25 * abs(truth[3])


def test_a_hold_from_before_the_clock_started_over_says_so():
    """ "since nan s"."""
    assert _since(12.34, 2.0) == "10.3 s" and _since(np.nan, 2.0) == "before this manoeuvre or clock"
