"""The estimator chooses itself: least squares, and rml where gusts make angles late for which no vane can stand."""

from itertools import pairwise

import numpy as np
import pytest

from aircraft_sysid_ros.identification.coefficients.layout import FLYING, TERM, VANE_NOISE, CoefficientBatch
from aircraft_sysid_ros.identification.coefficients.pace import Pace
from aircraft_sysid_ros.identification.estimators import choice
from aircraft_sysid_ros.identification.flight_memory import SampleMemory
from aircraft_sysid_ros.identification.model_change import change_model, with_terms
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField, Status
from aircraft_sysid_ros.samples import Kind, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

VANES = (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
SLOT = 0.2


def push(pipeline, samples, block=1000):
    for first in range(0, len(samples), block):
        pipeline.push(samples[first : first + block])


def flown(aircraft, samples, block=1000, **options):
    pipeline = Pipeline(aircraft, None, ParameterOptions(**options))
    push(pipeline, samples, block)
    pipeline.flush()
    return pipeline.parameters


def numbers(found):
    return [(p.value, p.std, p.status, p.age, p.excitation) for p in found.snapshot().parameters]


@pytest.fixture(scope="module")
def gusty(aircraft):
    return simulate_samples(aircraft, 91002, 75.0, wind=(3.0, 2.0, 0.0), turbulence="light")


def with_slow_vanes(samples):
    """A tenth of the samples of the vanes is left: 5 Hz."""
    kept = np.ones(len(samples), np.bool_)
    for kind in VANES:
        own = np.flatnonzero(samples.kind == kind)
        kept[np.delete(own, slice(None, None, 10))] = False
    return samples[kept]


@pytest.fixture(scope="module")
def slow_vanes(gusty):
    return with_slow_vanes(gusty.samples)


@pytest.mark.long
def test_it_is_the_default_and_least_squares_where_vanes_are_on_time(aircraft, gusty):
    found, asked = flown(aircraft, gusty.samples), flown(aircraft, gusty.samples, estimator="rls")
    assert found.learning.published["asked"] == "auto" and found.learning.published["published"] == "rls"
    np.testing.assert_array_equal(numbers(found), numbers(asked))
    assert not any("by rml" in p.reason for p in found.snapshot().parameters)


@pytest.mark.long
def test_least_squares_stays_in_calm_air_with_slow_vanes_and_without_vanes_in_gusts(aircraft, gusty):
    slow = with_slow_vanes(simulate_samples(aircraft, 91003, 60.0).samples)
    none = gusty.samples[~np.isin(gusty.samples.kind, VANES)]
    for samples in (slow, none):
        learning = flown(aircraft, samples).learning
        assert learning.published["published"] == "rls" and learning.choice.successor is None


@pytest.fixture(scope="module")
def chosen(aircraft, slow_vanes):
    """Pipeline at the end, and what was published after each block: estimator and parameters."""
    pipeline, seen = Pipeline(aircraft), []
    for first in range(0, len(slow_vanes), 1000):
        pipeline.push(slow_vanes[first : first + 1000])
        seen.append((pipeline.parameters.learning.published, pipeline.parameters.snapshot().parameters))
    pipeline.flush()
    return pipeline.parameters, seen


@pytest.mark.long
def test_in_gusts_with_slow_vanes_rml_takes_over_and_says_why(chosen, gusty):
    found, seen = chosen
    names = [published["published"] for published, _ in seen]
    assert names == sorted(names) and {*names} == {"rls", "rml"}  # once
    why = found.learning.published["why"]
    assert "gusts" in why and "vanes at 5 Hz" in why
    used = [p for p in found.snapshot().parameters if p.status == Trust.USE]
    assert len(used) > 15 and all(f"by rml: {why}" in p.reason for p in used)
    pitch = {p.name: p for p in found.snapshot().parameters}["Cm_q"]
    before = {p.name: p for p in seen[names.index("rml") - 1][1]}["Cm_q"]
    truth = gusty.coefficients["Cm_q"]
    assert abs(pitch.value - truth) < abs(before.value - truth)  # the angles of the filter are late


@pytest.mark.long
def test_nothing_that_was_known_is_lost_when_it_changes(chosen):
    known = [[np.isfinite(p.value) for p in parameters] for _, parameters in chosen[1]]
    assert all(now >= before for pair in pairwise(known) for before, now in zip(*pair, strict=True))
    waiting = [published for published, _ in chosen[1] if published["why"].startswith("until rml knows")]
    assert waiting and all(published["published"] == "rls" for published in waiting)


@pytest.mark.long
def test_how_samples_come_does_not_matter_and_another_model_or_a_reset_begin_with_least_squares(
    aircraft, slow_vanes, chosen
):
    other = flown(aircraft, slow_vanes, block=61)
    learning = other.learning
    assert learning.published == chosen[0].learning.published
    np.testing.assert_array_equal(numbers(other), numbers(chosen[0]))
    change_model(other, with_terms(aircraft, {"CZ": ("alpha**2",)}, {}), SampleMemory().newest())
    assert learning.published["published"] == "rls" and not learning.integrity.joint
    other.reset()
    assert learning.choice.why == "nothing calls for another: calm air, or vanes in the regressors, or no vane at all"


# -- the rule alone --------------------------------------------------------------------------------------------------


class Sky:
    """A choice that is told how late the filter is and how fast the vane comes, slot by slot."""

    def __init__(self, aircraft, rate=5.0):
        self.pace, self.time, self.rate = Pace(), 0.0, rate
        self.choice = choice.EstimatorChoice(aircraft, ParameterOptions(), self.pace)
        self.noise = aircraft.sensors["angle_of_attack"].noise[0]

    def fly(self, seconds, late=100.0, used=0.0, trusted=True, status=Status.OK):
        for _ in range(round(seconds / SLOT)):
            stamp = np.int64(self.time * 1e9)
            if self.rate:
                values = np.random.default_rng(int(stamp)).normal(size=1)
                self.choice.push_samples(samples_of(Kind.ANGLE_OF_ATTACK, np.array([stamp]), values[:, None]), 0)
            row, history = np.zeros((1, StateField.WIDTH)), np.zeros((1, TERM))
            row[0, StateField.TIME], row[0, StateField.STATUS] = self.time, status
            row[0, StateField.AIRSPEED] = 1.0
            row[0, StateField.AIR_VELOCITY_STD] = self.noise * np.sqrt(late)
            history[0, FLYING], history[0, VANE_NOISE] = 1.0, used
            nothing = np.empty((0, 0))
            self.choice.consider(CoefficientBatch(row, history, None, *(nothing,) * 4), SLOT, trusted)
            self.time += SLOT
        return self.choice.successor is not None


def test_gusts_have_to_last_and_calm_air_counts_against_them(aircraft):
    assert not Sky(aircraft).fly(THRESHOLDS.gusts_last - 1.0)
    assert Sky(aircraft).fly(THRESHOLDS.gusts_last + 3.0)
    sky = Sky(aircraft)
    assert not any(sky.fly(10.0) or sky.fly(10.0, late=0.1) for _ in range(5))
    assert Sky(aircraft).fly(100.0) and not Sky(aircraft).fly(100.0, late=0.3)


@pytest.mark.parametrize("facts", [{"used": 0.1}, {"trusted": False}, {"status": Status.INFERRED_ANGLES}])
def test_it_stays_with_a_vane_in_the_regressors_a_sensor_that_is_suspected_or_no_vane(aircraft, facts):
    assert not Sky(aircraft).fly(60.0, **facts)
    assert not Sky(aircraft, rate=0.0).fly(60.0)


def test_a_model_that_rml_cannot_have_stays_with_least_squares_and_says_so(aircraft):
    sky = Sky(with_terms(aircraft, {"CZ": ("lag(alpha, 0.2)",)}, {}))
    assert not sky.fly(60.0)
    assert "rml cannot be used" in sky.choice.why
