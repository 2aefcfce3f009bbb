"""A model that is changed in flight knows what it had known if it had been so from the beginning."""

import copy
import functools
import subprocess
import sys

import numpy as np
import pytest
from aircraft_files import of_shape
from waiting import LONGEST

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.recursive_least_squares import rls_update
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import PRIOR_VARIANCE
from aircraft_sysid_ros.identification.flight_memory import BLOCK, MOST_BLOCKS, WHOLE, SampleMemory
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.model_change import change_model, extended, reduced, with_terms
from aircraft_sysid_ros.identification.model_file import load_model, save_model
from aircraft_sysid_ros.identification.monitoring.hold import Hold, Restore
from aircraft_sysid_ros.identification.monitoring.sensor_faults import Sign
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import D_ACCELEROMETER_BIAS, StateField
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

BIAS = StateField.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS
HIDDEN = {"CZ": ("alpha**3",)}


def recursion(x, y, theta=None, p=None, forgetting=1.0):
    n = x.shape[1]
    theta = np.zeros(n) if theta is None else theta.copy()
    p = PRIOR_VARIANCE * np.eye(n) if p is None else p.copy()
    for row, value in zip(x, y, strict=True):
        p /= forgetting
        rls_update(theta, p, row, value, 1.0)
    return theta, p


@pytest.fixture
def problem():
    """Regressors of which the fourth lies near the others, and what they make with noise."""
    rng = np.random.default_rng(4)
    x = rng.standard_normal((600, 4))
    x[:, 3] = 0.8 * x[:, 0] - 0.5 * x[:, 1] + 0.3 * rng.standard_normal(600)
    return x, x @ [1.0, -2.0, 0.5, 0.7] + 0.1 * rng.standard_normal(600)


# -- the algebra -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("forgetting", [1.0, 0.99])
def test_extended_is_the_recursion_that_had_the_term_from_the_beginning(problem, forgetting):
    x, y = problem
    known = recursion(x[:, :3], y, forgetting=forgetting)
    fade = forgetting ** (0.5 * np.arange(len(x))[::-1])
    theta, p = extended(*known, fade[:, None] * x[:, :3], fade[:, None] * x[:, 3:], fade * y, ("late",))
    truth = recursion(x, y, forgetting=forgetting)
    assert theta == pytest.approx(truth[0], abs=1e-6)  # the prior of the others was seen through the past
    assert p == pytest.approx(truth[1], rel=1e-5, abs=1e-9)


def test_later_data_keep_both_recursions_together(problem):
    x, y = problem
    known = recursion(x[:300, :3], y[:300])
    change = extended(*known, x[:300, :3], x[:300, 3:], y[:300], ("late",))
    assert recursion(x[300:], y[300:], *change)[0] == pytest.approx(recursion(x, y)[0], abs=1e-6)


def test_keeping_the_old_covariance_alone_would_not_do(problem):
    """The obvious way, P of the old terms and a new diagonal element, holds the old terms where they are wrong."""
    x, y = problem
    theta, p = recursion(x[:300, :3], y[:300])
    plain = np.append(theta, 0.0), np.block([[p, np.zeros((3, 1))], [np.zeros((1, 3)), PRIOR_VARIANCE * np.eye(1)]])
    after = recursion(x[300:330], y[300:330], *plain)[0]
    joint = recursion(x[300:330], y[300:330], *extended(theta, p, x[:300, :3], x[:300, 3:], y[:300]))[0]
    truth = np.array([1.0, -2.0, 0.5, 0.7])
    assert np.abs(joint - truth).max() < 0.05 < 4.0 * 0.05 < np.abs(after - truth).max()


def test_without_a_past_the_term_starts_at_zero_with_the_prior(problem):
    x, y = problem
    theta, p = recursion(x[:, :3], y)
    more, joint = extended(theta, p, x[:5, :3], x[:5, 3:], y[:5])
    assert (more == np.append(theta, 0.0)).all()
    assert joint[:3, :3] == pytest.approx(p, abs=0.0)
    assert joint[3, 3] == pytest.approx(PRIOR_VARIANCE)
    assert not joint[3, :3].any()


def test_a_term_that_has_not_moved_yet_waits_for_its_time(problem):
    x, y = problem
    known = recursion(x[:, :3], y)
    theta, p = extended(*known, x[:, :3], np.zeros((600, 1)), y, ("flaps",))
    assert (theta == np.append(known[0], 0.0)).all()
    assert p[3, 3] == pytest.approx(PRIOR_VARIANCE)


def test_terms_that_others_explain_are_refused(problem):
    x, y = problem
    known = recursion(x[:, :3], y)
    with pytest.raises(InputError, match="'2\\*a' is explained by the other terms"):
        extended(*known, x[:, :3], 2.0 * x[:, :1] - x[:, 1:2], y, ("2*a",))
    with pytest.raises(InputError, match="'b' is explained"):
        extended(*known, x[:, :3], x[:, [3, 3]], y, ("a", "b"))


def test_reduced_is_the_recursion_without_the_term(problem):
    x, y = problem
    keep = np.array([True, True, False, True])
    theta, p = reduced(*recursion(x, y), keep)
    truth = recursion(x[:, keep], y)
    assert theta == pytest.approx(truth[0], abs=1e-6)
    assert p == pytest.approx(truth[1], rel=1e-6, abs=1e-12)


def test_the_covariance_stays_positive_with_scales_far_apart(problem):
    x, y = problem
    x = x * [1.0, 1e-4, 1e3, 1e-6]
    theta, p = extended(*recursion(x[:, :3], y), x[:, :3], x[:, 3:], y, ("late",))
    scale = np.sqrt(np.diag(p))
    assert (p == p.T).all()
    assert np.linalg.eigvalsh(p / np.outer(scale, scale)).min() > 0.0
    small = reduced(theta, p, np.array([False, True, True, True]))[1]
    assert np.linalg.eigvalsh(small / np.sqrt(np.outer(np.diag(small), np.diag(small)))).min() > 0.0


# -- an estimator in flight ------------------------------------------------------------------------------


class Flown:
    """The rows and samples of a flight, for estimators that take them one by one."""

    def __init__(self, flight):
        pipeline = Pipeline(flight.aircraft)
        self.samples, self.aircraft = flight.samples, flight.aircraft
        self.rows = np.vstack([pipeline.push(flight.samples)[0], pipeline.flush()[0]])
        self.epoch = pipeline.state.epoch

    def estimator(self, aircraft=None, **options):
        estimator = Identifier(aircraft or self.aircraft, ParameterOptions(**options))
        estimator.push_samples(self.samples, self.epoch)
        return estimator

    def fly(self, estimator, begin, end, memory=None):
        points = []
        for row in self.rows[int(begin * 100) : int(end * 100)]:
            new = estimator.push_states(row[None, :], self.epoch)
            points.append(new)
            if memory is not None:
                memory.add(new, row[BIAS : BIAS + 3], float(row[StateField.AIR_VELOCITY_STD]))
        return np.vstack([p[:, : CoefficientSample.TERMS] for p in points])


@pytest.fixture(scope="module")
def flown(aircraft):
    return Flown(simulate_samples(aircraft, 11, 110.0, effects=[Effect("CZ", "alpha**3", 60.0)]))


@pytest.fixture(scope="module")
def plain_at_fifty(flown):
    """By name, the parameters of an estimator whose model was never changed, after 50 s."""

    @functools.cache
    def parameters(name):
        estimator = flown.estimator(estimator=name)
        estimator.push_states(flown.rows[:5000], flown.epoch)
        return {p.name: p for p in estimator.snapshot().parameters}

    return parameters


@pytest.fixture(scope="module")
def at_sixty(flown):
    """An estimator and its memory after 60 s; tests copy them."""
    estimator, memory = flown.estimator(), SampleMemory()
    flown.fly(estimator, 0.0, 60.0, memory)
    return estimator, memory


def rms(points, axis):
    return float(np.sqrt(np.mean((points[:, 1 + axis] - points[:, 7 + axis]) ** 2)))


@pytest.mark.long
def test_the_error_falls_at_once_and_other_axes_do_not_notice(flown, at_sixty):
    estimator, memory = copy.deepcopy(at_sixty)
    plain = copy.deepcopy(estimator)
    change = change_model(estimator, with_terms(estimator.aircraft, HIDDEN, {}), memory.newest())
    assert change.axes == ("CZ",) and not change.restarted
    assert change.model == estimator.model.identifier != plain.model.identifier
    before, after = ({p.name: (p.value, p.std) for p in e.snapshot().parameters} for e in (plain, estimator))
    assert set(after) - set(before) == {"CZ_alpha3"}
    assert all(after[name] == before[name] for name in before if not name.startswith("CZ"))
    later, without = flown.fly(estimator, 60.0, 90.0), flown.fly(plain, 60.0, 90.0)
    assert rms(later, 2) < 0.5 * rms(without, 2)
    others = [i for i in range(6) if i != 2]
    for block in (CoefficientSample.PREDICTED, CoefficientSample.MEASURED, CoefficientSample.LEARNT):
        assert np.array_equal(later[:, block][:, others], without[:, block][:, others], equal_nan=True)


@pytest.fixture(scope="module")
def of_servos():
    """A flight of commands, whose servos nobody has described: an estimator after 60 s, and its memory."""
    slow = SensorOptions(command_lag=0.06)
    flown = Flown(simulate_samples(default_aircraft(), 59, 75.0, manoeuvres="varied", sensors=slow))
    estimator, memory = flown.estimator(of_shape(flown.aircraft)), SampleMemory()
    flown.fly(estimator, 0.0, 60.0, memory)
    return flown, estimator, memory


def in_use(estimator):
    return {p.name: (p.value, p.std) for p in estimator.snapshot().parameters if p.status is Trust.USE}


def farthest(used, truth):
    """Of values in use, in standard errors."""
    return max((abs(value - truth[name]) / std for name, (value, std) in used.items() if name in truth), default=0.0)


@pytest.mark.long
def test_what_was_found_of_servos_stays_in_axes_that_are_not_changed(of_servos):
    """It was forgotten: values were published as least squares has them, half as large, with USE."""
    flown, estimator, memory = of_servos[0], *copy.deepcopy(of_servos[1:])
    before = in_use(estimator)
    assert estimator.learning.undescribed.are_late and len(before) > 15
    change_model(estimator, with_terms(estimator.aircraft, HIDDEN, {}), memory.newest())
    after = in_use(estimator)
    assert {n: v for n, v in after.items() if n[:2] != "CZ"} == {n: v for n, v in before.items() if n[:2] != "CZ"}
    assert estimator.learning.undescribed.are_late
    for second in range(60, 74):
        flown.fly(estimator, second, second + 1)
        assert farthest(in_use(estimator), flown.aircraft.coefficients) < 4.0


@pytest.mark.long
def test_a_term_that_a_user_takes_out_is_no_change_of_the_aeroplane(flown, at_sixty):
    """The error of an axis that lost its elevator grows: what it had learnt was dropped for that."""
    estimator, memory = copy.deepcopy(at_sixty)
    for second in range(60, 66):
        if second in (61, 64):
            terms = ({}, {"Cm": ("de",)}) if second == 61 else ({"Cm": ("de",)}, {})
            change_model(estimator, with_terms(estimator.aircraft, *terms), memory.newest())
        flown.fly(estimator, second, second + 1, memory)
    assert estimator.learning.changes.alarms() == []
    known = {p.name: p for p in estimator.snapshot().parameters}["Cm_de"]
    assert abs(known.value - flown.aircraft.coefficients["Cm_de"]) < 4.0 * known.std < 0.1


@pytest.mark.long
def test_a_hold_because_of_a_sensor_outlives_a_change_of_the_model(of_servos):
    """So do the values from before it: all of them were lost, of axes too that were not changed."""
    estimator, memory = copy.deepcopy(of_servos[1:])
    monitor = estimator.learning.integrity
    since = estimator.time - 5.0
    good = monitor.checkpoints.before(since, 0)
    for axis in range(6):
        monitor.holds[axis] = Hold(since, since, "vanes", good, sensor=True, high=axis == 0)
    monitor.holds[4] = Hold(since, since, "model error", good, sensor=False, high=True)
    before = {p.name: p for p in estimator.snapshot().parameters}
    change_model(estimator, with_terms(estimator.aircraft, HIDDEN, {"Cn": ("da",)}), memory.newest())
    assert [hold.words if hold else "" for hold in monitor.holds] == ["vanes"] * 4 + ["", "vanes"]
    assert {name[:2] for name in in_use(estimator)} <= {"Cm"}
    after = {p.name: p for p in estimator.snapshot().parameters}
    for name, p in before.items():
        if name[:2] != "Cm" and name != "Cn_da":
            assert (after[name].value, after[name].std) == pytest.approx((p.value, p.std), nan_ok=True), name
    assert np.isnan(after["CZ_alpha3"].value) and "Cn_da" not in after
    assert sum(np.isfinite(p.value) for p in after.values()) > 20


@pytest.mark.long
def test_an_axis_goes_back_to_what_it_knew_before_the_model_was_changed(of_servos):
    flown, (estimator, memory) = of_servos[0], copy.deepcopy(of_servos[1:])
    monitor = estimator.learning.integrity
    change_model(estimator, with_terms(estimator.aircraft, HIDDEN, {}), memory.newest())
    known, state = in_use(estimator), estimator.learning.least_squares.state
    now, part = estimator.time, estimator.model.axis_slice("Cl")
    wanted = monitor.checkpoints.before(now - 0.5, 3)
    assert wanted is not None and now - 8.0 < wanted.time < now - 4.0  # nothing is known to have gone wrong after it
    state.theta[3] *= 2.0  # as a fault of a sensor leaves it
    estimator.learning._restore([Restore(3, wanted)])
    names = estimator.model.parameter_names[part]
    after = in_use(estimator)
    for name in set(names) & known.keys() & after.keys():
        assert abs(after[name][0] - known[name][0]) < 4.0 * after[name][1], name
    assert "Cl_da" in after
    flown.fly(estimator, 60.0, 64.0)
    assert farthest(in_use(estimator), flown.aircraft.coefficients) < 4.0


@pytest.mark.long
def test_what_is_held_is_saved_as_it_was_before(of_servos, tmp_path):
    """What the monitor had withdrawn came back with USE when it was loaded."""
    estimator = copy.deepcopy(of_servos[1])
    monitor, state = estimator.learning.integrity, estimator.learning.least_squares.state
    right = state.theta.copy()
    since = estimator.time - 2.0
    good = monitor.checkpoints.before(since, 3)
    for axis, known in ((3, good), (5, None)):
        monitor.holds[axis] = Hold(since, since, "the sideslip is wrong", known, sensor=True, high=True)
        state.theta[axis] *= 1.5
    save_model(estimator, tmp_path / "model.json")
    load_model(estimator, tmp_path / "model.json")
    loaded = estimator.learning.least_squares.state
    np.testing.assert_array_equal(loaded.theta[3], good.least_squares.theta[3])
    np.testing.assert_allclose(loaded.theta[3], right[3], rtol=0.05, atol=0.02)
    assert loaded.updates[5] == 0 and not loaded.theta[5].any()


def loaded_in_flight(of_servos, tmp_path):
    """The flight, and an estimator that has flown 5 s of it and then loaded what the other one had learnt."""
    flown, saved, _ = of_servos
    save_model(saved, tmp_path / "model.json")
    estimator = flown.estimator(of_shape(flown.aircraft))
    flown.fly(estimator, 0.0, 5.0)
    load_model(estimator, tmp_path / "model.json")
    return flown, estimator


@pytest.mark.long
def test_what_was_loaded_is_published_while_a_sensor_is_wrong_from_the_start(of_servos, tmp_path):
    """Nothing was."""
    flown, estimator = loaded_in_flight(of_servos, tmp_path)
    loaded = estimator.estimates().parameters
    flown.fly(estimator, 5.0, 7.0)
    estimator.learning.integrity._distrust(estimator.time, [Sign("air data")], sure=True)
    published = estimator.snapshot().parameters
    assert {p.status for p in published} == {Trust.HOLD}
    np.testing.assert_array_equal([(p.value, p.std) for p in published], [(p.value, p.std) for p in loaded])
    assert sum(np.isfinite(p.value) for p in published) > 25


@pytest.mark.long
def test_what_another_flight_has_learnt_waits_until_the_sensors_of_this_one_have_shown_themselves(of_servos, tmp_path):
    """It was published as least squares has it, with USE."""
    flown, estimator = loaded_in_flight(of_servos, tmp_path)
    assert in_use(estimator) == {}
    for second in range(5, 30):
        flown.fly(estimator, second, second + 1)
        of_bias = {
            name for name in in_use(estimator) if name.endswith("_0")
        }  # which is found anew, and of one flight twice
        used = {name: known for name, known in in_use(estimator).items() if name not in of_bias}
        assert farthest(used, flown.aircraft.coefficients) < 4.0
    assert len(used) > 10


@pytest.mark.long
@pytest.mark.parametrize("places", [True, False])
def test_a_file_of_mass_and_shape_takes_it_too(flown, places):
    """What nobody has described is followed through the change."""
    estimator, memory = flown.estimator(of_shape(flown.aircraft, places)), SampleMemory()
    flown.fly(estimator, 0.0, 40.0, memory)
    change_model(estimator, with_terms(estimator.aircraft, HIDDEN, {}), memory.newest())
    before = estimator.learning.undescribed.lateness
    later = flown.fly(estimator, 40.0, 60.0)
    known = {p.name: p for p in estimator.snapshot().parameters}
    assert abs(known["CZ_alpha3"].value - 60.0) < 3.0 * known["CZ_alpha3"].std
    assert rms(later, 2) < 0.1
    assert 0.0 < estimator.learning.undescribed.lateness <= before


@pytest.mark.long
def test_it_is_what_an_estimator_with_the_term_from_the_beginning_knows(flown, at_sixty):
    estimator, memory = copy.deepcopy(at_sixty)
    aircraft = with_terms(estimator.aircraft, HIDDEN, {})
    early = flown.estimator(aircraft)
    flown.fly(early, 0.0, 60.0)
    change_model(estimator, aircraft, memory.newest())
    for end in (60.0, 110.0):
        if end > 60.0:
            flown.fly(early, 60.0, end)
            flown.fly(estimator, 60.0, end)
        for ours, theirs in zip(estimator.snapshot().parameters, early.snapshot().parameters, strict=True):
            assert ours.name == theirs.name
            assert abs(ours.value - theirs.value) < 0.5 * theirs.std, (end, ours, theirs)
            assert ours.std == pytest.approx(theirs.std, rel=0.1), (end, ours, theirs)
            assert ours.status == theirs.status
    assert estimator.snapshot().parameters[-1].age == early.snapshot().parameters[-1].age


@pytest.mark.long
def test_removed_again_all_is_as_before(flown, at_sixty):
    estimator, memory = copy.deepcopy(at_sixty)
    was, before = estimator.model, estimator.snapshot()
    change_model(estimator, with_terms(estimator.aircraft, HIDDEN, {}), memory.newest())
    change_model(estimator, with_terms(estimator.aircraft, {}, HIDDEN), memory.newest())
    assert estimator.model.identifier == was.identifier
    for new, old in zip(estimator.snapshot().parameters, before.parameters, strict=True):
        # P of the recursion forgets in a direction, the past does so evenly: that is the difference, also in how much
        # of the pull of the vanes' noise is put right
        assert abs(new.value - old.value) < 1e-6 * abs(old.value) + 1e-2 * old.std, new.name
    flown.fly(estimator, 60.0, 70.0)


@pytest.mark.long
def test_the_longest_axis_may_grow(flown, at_sixty):
    estimator, memory = copy.deepcopy(at_sixty)
    added = {"Cl": ("alpha*beta", "alpha*da"), "CZ": ("alpha**3",)}
    change_model(estimator, with_terms(estimator.aircraft, added, {}), memory.newest())
    assert estimator.learning.least_squares.state.theta.shape[1] == 8
    flown.fly(estimator, 60.0, 65.0)
    for i in range(6):
        n = int(np.diff(estimator.model.offsets)[i])
        p = estimator.learning.least_squares.state.p[i, :n, :n]
        scale = np.sqrt(np.diag(p))
        assert np.linalg.eigvalsh(p / np.outer(scale, scale)).min() > 0.0


@pytest.mark.long
@pytest.mark.parametrize("name", ["fourier", pytest.param("rml", marks=pytest.mark.long)])
def test_another_learner_begins_anew_and_says_so(flown, name):
    estimator, memory = flown.estimator(estimator=name, rml_rate=25.0), SampleMemory()
    flown.fly(estimator, 0.0, 20.0, memory)
    change = change_model(estimator, with_terms(estimator.aircraft, HIDDEN, {}), memory.newest())
    assert change.restarted
    flown.fly(estimator, 20.0, 24.0)
    assert [p.name for p in estimator.snapshot().parameters].count("CZ_alpha3") == 1


@pytest.mark.long
@pytest.mark.long_after_the_first
@pytest.mark.parametrize(("term", "words"), [
    ("sqrt(alpha - 1.2)", "is not a number"), ("1/max(alpha - 1.2, 0)", "is not a number"),
    ("max(alpha - 1.2, 0)", "not enough motion yet"),
])  # fmt: skip
@pytest.mark.parametrize("name", ["rls", "fourier"])
def test_a_term_that_says_nothing_holds_no_other_one(flown, plain_at_fifty, name, term, words):
    """Nothing could be known of it when it was added; its axis learnt no more, and was held to the end."""
    truth, estimator = plain_at_fifty(name), flown.estimator(estimator=name)
    change_model(estimator, with_terms(flown.aircraft, {"Cm": (term,)}, {}), SampleMemory().newest())
    estimator.push_states(flown.rows[:5000], flown.epoch)
    found = {p.name: p for p in estimator.snapshot().parameters}
    (new,) = found.keys() - truth.keys()
    assert found[new].status == Trust.HOLD and words in found[new].reason
    assert truth["Cm_alpha"].status == Trust.USE
    for key, p in truth.items():
        assert (found[key].status, found[key].age) == (p.status, p.age), key
        assert found[key].value == pytest.approx(p.value, abs=0.01 * p.std), key
        assert found[key].std == pytest.approx(p.std, rel=0.01), key


@pytest.mark.long
def test_a_term_that_is_a_number_at_times_is_held_meanwhile(flown):
    estimator = flown.estimator(estimator="rls")
    change_model(estimator, with_terms(flown.aircraft, {"Cm": ("sqrt(30 - time)",)}, {}), SampleMemory().newest())
    held = []
    for end in (25.0, 45.0):
        flown.fly(estimator, 25.0 if held else 0.0, end)
        found = {p.name: p for p in estimator.snapshot().parameters}
        held.append("not a number" in found["Cm_sqrt(30-time)"].reason)
    assert held == [False, True]
    assert found["Cm_alpha"].status == Trust.USE and found["Cm_alpha"].age < 1.0


@pytest.mark.long
def test_changes_that_make_no_sense_are_refused_and_change_nothing(at_sixty):
    estimator, memory = copy.deepcopy(at_sixty)
    aircraft, before = estimator.aircraft, estimator.learning.least_squares.state
    for added, removed, text in (
        ({"CZ": ("alpha",)}, {}, "has the term 'alpha' in CZ already"),
        ({}, {"CZ": ("beta",)}, "has no term 'beta' in CZ"),
        ({}, {"CZ": ("1", "alpha", "q", "de")}, "last term of CZ"),
    ):
        with pytest.raises(InputError, match=text):
            with_terms(aircraft, added, removed)
    with pytest.raises(InputError, match="explained by the other terms"):
        change_model(estimator, with_terms(aircraft, {"CX": ("alpha**3",), "CZ": ("2*alpha",)}, {}), memory.newest())
    assert estimator.aircraft is aircraft
    assert estimator.learning.least_squares.state is before


# -- the memory ------------------------------------------------------------------------------------------


def fill(memory, begin, end, step=0.2):
    for time in np.arange(begin, end, step):
        point = np.full((1, CoefficientSample.TERMS + 3), time)
        memory.add(point, np.zeros(3), 1.0)


def test_the_memory_is_bounded_and_covers_all_of_a_long_flight():
    memory = SampleMemory()
    fill(memory, 0.0, 7200.0)
    kept, newest = memory.flight(), memory.newest()
    assert len(kept.time) <= (WHOLE + MOST_BLOCKS * BLOCK) / 0.2 + 1
    assert (np.diff(kept.time) > 0.0).all()
    assert len(newest.time) == pytest.approx(WHOLE / 0.2, abs=1)
    older = np.unique(kept.time[kept.time < newest.time[0]] // BLOCK)
    assert older[0] == 0 and older[-1] > 1200  # from the beginning to the newest
    assert set(np.unique(older % 4)) == {0.0, 1.0, 2.0, 3.0}  # every fold of the held-out blocks
    assert len(memory.newest(10.0).time) == pytest.approx(50, abs=1)


def test_a_clock_that_begins_anew_begins_a_new_memory():
    memory = SampleMemory()
    fill(memory, 100.0, 120.0)
    fill(memory, 5.0, 8.0)
    assert memory.flight().time[0] == 5.0


# -- a run whose model changed on the way ------------------------------------------------------------------


def test_a_run_with_a_change_is_one_of_its_last_model(aircraft, tmp_path):
    import time

    from aircraft_sysid_ros.refinement.run_data import load_run
    from aircraft_sysid_ros.run_writer import RunWriter

    samples = simulate_samples(aircraft, 2, 24.0, rate=200.0).samples
    pipeline = Pipeline(aircraft)
    with RunWriter(tmp_path / "run", aircraft) as writer:
        for part in np.array_split(np.arange(len(samples.stamp)), 2):
            rows, points = pipeline.push(samples[part])
            writer.add_rows(rows)
            writer.add_points(points)
            if pipeline.parameters.model is aircraft.model:
                change_model(pipeline.parameters, with_terms(aircraft, HIDDEN, {}), SampleMemory().newest())
        writer.add_samples(samples)
        writer.finish(pipeline.state, pipeline.parameters, 24.0, time.perf_counter())
    run = load_run(tmp_path / "run")
    assert run.aircraft.model.identifier == pipeline.parameters.model.identifier
    names = run.aircraft.model.parameter_names
    alpha, cubed = run.terms[:, names.index("CZ_alpha")], run.terms[:, names.index("CZ_alpha3")]
    assert cubed == pytest.approx(alpha**3, abs=1e-9)


@pytest.mark.long
def test_nothing_is_compiled_in_flight_when_the_model_is_changed():
    """The first term with memory held up a node for five seconds, and samples were lost."""
    script = """
import gc
import numpy as np
from numba.core.dispatcher import Dispatcher
from aircraft_sysid_ros.identification import model_change
from aircraft_sysid_ros.identification.flight_memory import SampleMemory
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

def compiled():
    every = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {(each.py_func.__module__, each.py_func.__name__, s) for each in every for s in each.signatures}

flight = simulate_samples(default_aircraft(), 3, 30.0, manoeuvres="varied")
pipeline, memory, half = Pipeline(flight.aircraft), SampleMemory(), len(flight.samples) // 2
pipeline.warm_up()
model_change.warm_up(flight.aircraft, ParameterOptions())
memory.add(pipeline.push(flight.samples[:half])[1], np.zeros(3), 0.1)
before = compiled()
for added in ({"CZ": ("alpha**3",)}, {"CZ": ("lag(alpha, 0.2)",)}, {"Cm": ("limited(da, 0.5)",)}):
    aircraft = model_change.with_terms(pipeline.parameters.aircraft, added, {})
    model_change.change_model(pipeline.parameters, aircraft, memory.newest())
pipeline.push(flight.samples[half:])
print(*sorted({(module, name) for module, name, _ in compiled() - before if "postfix" in module or "term" in module
               or "model_change" in module or "coefficients" in module}))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=LONGEST, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""
