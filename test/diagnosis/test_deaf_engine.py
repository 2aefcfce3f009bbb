"""An engine that no longer follows its throttle, and an airspeed that steps: what forces and GPS say without vanes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.diagnosis import flight_answer
from aircraft_sysid_ros.diagnosis.failures.airspeed_step import airspeed_step
from aircraft_sysid_ros.diagnosis.failures.axis_relation import ENGINE, Acting, AxisRelation
from aircraft_sysid_ros.diagnosis.failures.episode import Times
from aircraft_sysid_ros.diagnosis.failures.failure import Failure, FailureReport, described
from aircraft_sysid_ros.diagnosis.failures.failure_search import FailureSearch
from aircraft_sysid_ros.diagnosis.failures.failures import _deaf, _Form, _frozen
from aircraft_sysid_ros.diagnosis.failures.interval_search import CONSTANT, FROZEN, NIL
from aircraft_sysid_ros.diagnosis.failures.unrecorded_change import UnrecordedChange
from aircraft_sysid_ros.diagnosis.failures.verdict import named
from aircraft_sysid_ros.diagnosis.failures.words import sentence_of, sentence_of_airspeed
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of

STEP, COUNT, DEAD = 0.4, 900, 600
#: Throttle below which a propeller in flight does not pull.
NO_THRUST = 0.45


def flight(dead):
    """C_X of a propeller that pulls above NO_THRUST, in waves of its throttle; it windmills once it is dead."""
    rng, time = np.random.default_rng(4), STEP * np.arange(COUNT)
    throttle = 0.62 + 0.08 * np.sin(time / 5.0) + 0.03 * rng.standard_normal(COUNT)
    throttle[DEAD:] = 0.97 + 0.04 * np.sin(time[DEAD:] / 4.0)
    throttle[300:330] = 0.3  # a descent
    thrust = np.maximum(throttle - NO_THRUST, -0.03)
    if dead:
        thrust[DEAD:] = -0.03
    noise = np.convolve(rng.standard_normal(COUNT + 4), np.ones(5) / 5.0, "valid")
    polar = rng.standard_normal(COUNT)
    response = -0.05 + 0.02 * polar + 0.3 * thrust + 0.008 * noise
    columns = np.column_stack([np.ones(COUNT), polar, throttle])
    mean = float(np.mean(throttle))
    one = np.ones((COUNT, 1))
    acting = Acting((2,), mean * one, 0.0 * one, one, mean, throttle)
    search = FailureSearch(
        {"CX": AxisRelation("CX", response, columns, ("1", "alpha", "Tc"), {ENGINE: acting}, ())}, STEP
    )
    return _Form(SimpleNamespace(time=time), search, 20.0)


def test_a_dead_engine_is_named_though_its_propeller_pulls_only_above_some_throttle():
    form = flight(dead=True)
    tried = _frozen(form.search, ENGINE)
    judged = max((tried, *_deaf(form, tried)), key=lambda each: each.score)
    failure = described(form.balance, form.search, judged)
    assert judged.hypothesis.kind == FROZEN and failure.is_deaf and failure.is_loss_of_thrust
    (times,) = failure.times  # the descent, in which nothing was asked of it, is none
    assert times.begin == pytest.approx(DEAD * STEP, abs=1.5) and times.end is None
    assert named(failure, judged, form.search.best(ENGINE, CONSTANT)) is not None
    assert "no longer follows its throttle" in sentence_of(failure)


def test_an_engine_that_lives_is_not():
    form = flight(dead=False)
    tried = _frozen(form.search, ENGINE)
    for judged in (tried, *_deaf(form, tried)):
        failure = described(form.balance, form.search, judged)
        assert judged.evidence < form.least or named(failure, judged, form.search.best(ENGINE, CONSTANT)) is None


@pytest.mark.parametrize(
    ("changed", "lost"),
    [
        ({}, True), ({"level": 0.9}, False), ({"left": 0.4}, False), ({"left_std": 0.3}, False),
        ({"moved": 0.01}, False), ({"kind": NIL, "level": 0.0}, True), ({"name": "de"}, False),
    ],
)  # fmt: skip
def test_when_an_engine_is_deaf(changed, lost):
    failure = Failure(
        name=ENGINE, kind=FROZEN, left=-0.05, left_std=0.02, level=0.43, asked=0.99, asked_for=149.0, usual=0.05,
        moved=0.045, beyond=0.0, times=(Times(230.0, None, 0.5, np.nan),), evidence=500.0, gains={"CX": 500.0},
        main_axis="CX", size=0.6, errors={"CX": (0.6, 0.3)},
    )  # fmt: skip
    assert replace(failure, **changed).is_loss_of_thrust is lost


def circling(scale, gusts, seed=0, dead=200.0):
    """Airspeed and GPS of circles in wind; the airspeed reads ``scale`` of the truth from 200 s on."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 400.0, 0.2)
    course, speed = time / 9.0, 20.0 + 2.0 * np.sin(time / 17.0)
    slow = np.convolve(rng.standard_normal(len(time) + 24), np.ones(25) / 5.0, "valid")
    velocity = np.column_stack([speed * np.cos(course) + 4.0 + gusts * slow, speed * np.sin(course) - 3.0, 0.0 * time])
    read = speed * np.where(time > dead, scale, 1.0) + 0.3 * rng.standard_normal(len(time))
    stamps = (time * 1e9).astype(np.int64)
    still = np.zeros((6, len(time)))
    return concatenate([
        samples_of(Kind.IMU, stamps, *still), samples_of(Kind.AIRSPEED, stamps, read),
        samples_of(Kind.GPS_VELOCITY, stamps, *velocity.T),
    ])  # fmt: skip


@pytest.mark.parametrize("times", [Times(200.0, None, 0.5, np.nan), Times(0.0, 200.0, 0.5, 0.5)])
def test_an_airspeed_that_reads_less_since_then_is_told_by_gps(times):
    step = airspeed_step(circling(0.88, 1.0), [times])
    ratio = 0.88 if times.end is None else 1.0 / 0.88
    assert step is not None and step.ratio == pytest.approx(ratio, abs=max(4.0 * step.std, 0.01))
    assert step.times == (times,) and "check the pitot tube" in sentence_of_airspeed(step)


def test_an_airspeed_tells_itself_since_when_it_reads_less():
    """A blocked pitot had been a rudder that does something else, from 43 s after it."""
    step = airspeed_step(circling(0.7, 1.0), [Times(243.0, None, 25.0, np.nan)])
    assert step is not None and step.ratio == pytest.approx(0.7, abs=max(4.0 * step.std, 0.01))
    assert step.times[0].begin == pytest.approx(200.0, abs=6.0) and step.times[0].end is None
    assert " s (± 5.0 s) to the end of the flight" in sentence_of_airspeed(step)


def test_a_stamp_of_0_does_not_move_the_times_of_an_airspeed():
    samples, times = circling(0.88, 1.0), [Times(200.0, None, 0.5, np.nan)]
    stamp = samples.stamp + 1_760_000_000 * 10**9
    begun = replace(samples, stamp=np.where(np.arange(len(stamp)) == 9, 0, stamp))
    assert airspeed_step(begun, times) == airspeed_step(begun, times, zero=int(stamp[0])) is not None


@pytest.mark.parametrize(("asked", "error"), [(240.0, 45.0), (215.0, 30.0), (240.0, 1.0)])
def test_of_two_dates_that_of_the_speeds_is_the_sharper(asked, error):
    step = airspeed_step(circling(0.88, 0.2), [Times(asked, None, error, np.nan)])
    assert step is not None and step.ratio == pytest.approx(0.88, abs=max(4.0 * step.std, 0.01))
    assert step.times[0].begin == pytest.approx(200.0, abs=10.0)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("gusts", [0.5, 2.0])
def test_one_that_does_not_is_not(gusts, seed):
    assert airspeed_step(circling(1.0, gusts, seed), [Times(200.0, None, 0.5, np.nan)]) is None


@pytest.mark.parametrize("second", [np.pi / 4.0, np.pi / 2.0])
@pytest.mark.parametrize("seed", range(6))
def test_straight_legs_do_not_tell_it(second, seed):
    """Of a wind along one leg and along another the ratio could be 0.05 or 20, each sure to a tenth."""
    samples = circling(1.0, 1.0, seed)
    rows = samples.kind == Kind.GPS_VELOCITY
    time = (samples.stamp[rows] - samples.stamp.min()) * 1e-9
    course, gusts = np.where(time > 200.0, second, 0.0), samples.values[rows, :2] * 0.05
    samples.values[rows, 0] = 20.0 * np.cos(course) + 6.0 + gusts[:, 0]
    samples.values[rows, 1] = 20.0 * np.sin(course) + gusts[:, 1]
    assert airspeed_step(samples, [Times(200.0, None, 0.5, np.nan)]) is None


def test_it_is_said_in_the_place_of_the_moment(monkeypatch, aircraft):
    """By the whole answer, which had searched the library and forgotten it."""
    samples = circling(0.88, 0.5)
    times = (Times(200.0, None, 0.5, np.nan),)
    changed = UnrecordedChange(
        times=times, evidence=200.0, gains={"Cm": 200.0}, main_axis="Cm", size=0.3, errors={"Cm": (0.5, 0.4)}
    )
    balance = SimpleNamespace(begin=0, recorded_from=0, wind=None, aircraft=aircraft)
    report = FailureReport(
        (), changed, (), ("de",), frozenset({"de"}), ("Cm",), {}, balance, airspeed_step(samples, times)
    )
    monkeypatch.setattr(flight_answer, "by_forces", lambda *_: report)
    said = flight_answer.answer(aircraft, samples)
    (candidate,) = said["candidates"]
    assert said["verdict"] == "missing" and candidate["effect"] == "airspeed_scale" and candidate["found"]
    assert not candidate["is_to_add"] and candidate["terms"] == {} and "from 200.0 s" in candidate["where"]
    assert candidate["input"] is None and candidate["inner"] == {"t0": 200.0}
    assert said["advice"].startswith("By GPS and a steady wind the airspeed reads 0.8")
    assert "pitching moment" not in said["advice"]


def test_without_gps_or_airspeed_nothing_is_said():
    samples, times = circling(0.88, 0.5), [Times(200.0, None, 0.5, np.nan)]
    for kind in (Kind.AIRSPEED, Kind.GPS_VELOCITY, Kind.IMU):
        assert airspeed_step(samples[samples.kind != kind], times) is None
    assert airspeed_step(samples, [Times(395.0, None, 0.5, np.nan)]) is None, "five seconds are too few"
