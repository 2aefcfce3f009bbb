"""Manoeuvres as one stream of samples: where they lie, and that nothing but what is meant goes from one to the next."""

from itertools import pairwise

import numpy as np
import pytest

from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.smoother_history import SmootherHistory
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import (
    PAUSE,
    SAME_FLIGHT,
    Kind,
    Samples,
    fewer_manoeuvres,
    flights,
    joined,
    manoeuvre_at,
    manoeuvres,
)
from aircraft_sysid_ros.stamps import epoch_of

SECOND = 10**9
DAY = 86_400.0


def part(flight, start: float, stop: float, later: float = 0.0) -> Samples:
    """Samples of a flight from a time to another [s], as if flown some time [s] later."""
    stamp = flight.samples.stamp
    begin = stamp.min() + round(start * SECOND)
    inside = flight.samples[(stamp >= begin) & (stamp < begin + round((stop - start) * SECOND))]
    return Samples(inside.stamp + round(later * SECOND), inside.kind, inside.values)


@pytest.fixture(scope="module")
def three(flight):
    """The second on the next day, the third before the first."""
    return [part(flight, 40.3, 50.0), part(flight, 60.0, 72.7, DAY), part(flight, 20.1, 30.0)]


@pytest.mark.long
def test_manoeuvres_follow_each_other_with_a_pause_and_whole_seconds(three):
    body, shifts = joined(three)
    assert shifts[0] == 0 and all(shift % SECOND == 0 for shift in shifts)
    found = manoeuvres(body)
    for one, given, shift in zip(found, three, shifts, strict=True):
        assert np.array_equal(one.stamp - shift, given.stamp) and np.array_equal(one.kind, given.kind)
        assert np.array_equal(one.values, given.values, equal_nan=True)
    for before, after in pairwise(found):
        pause = after.stamp[after.kind == Kind.IMU].min() - before.stamp[before.kind == Kind.IMU].max()
        assert PAUSE * SECOND <= pause <= (PAUSE + 1.0) * SECOND
    for number, one in enumerate(found):
        assert set(manoeuvre_at(body, one.stamp).tolist()) == {number}


@pytest.mark.long
def test_a_seam_says_how_long_there_really_was_between_them(three):
    body, _ = joined(three)
    since = body.values[body.kind == Kind.SEAM, 0]
    assert since == pytest.approx(
        [DAY + 10.0, DAY + 30.0], abs=0.1
    )  # the third ends 30 s, and a day, before the second
    assert [len(manoeuvres(one)) for one in flights(body)] == [1, 1, 1]
    same, _ = joined([three[0], three[2]])
    assert len(flights(same)) == 1 and same.values[same.kind == Kind.SEAM, 0] == pytest.approx(10.3, abs=0.1)


def test_of_clocks_that_overlap_nobody_knows_it(flight):
    body, _ = joined([part(flight, 40.0, 50.0), part(flight, 45.0, 55.0)])
    assert np.isnan(body.values[body.kind == Kind.SEAM, 0]).all() and len(flights(body)) == 2


def test_fewer_of_them_lie_evenly(flight):
    body, _ = joined([part(flight, 10.0 * k, 10.0 * k + 8.0) for k in range(1, 11)])
    kept = fewer_manoeuvres(body, 30.0)
    assert len(manoeuvres(kept)) == 4  # every third of ten
    assert set(manoeuvre_at(body, kept.stamp[kept.kind != Kind.SEAM]).tolist()) == {0, 3, 6, 9}


def states(aircraft, samples: Samples, epoch: int) -> np.ndarray:
    """Rows of a filter that is given samples in portions of 700."""
    state = StateEstimator(aircraft)
    state.epoch = epoch
    return np.vstack([*(state.push(samples[i : i + 700]) for i in range(0, len(samples), 700)), state.flush()])


def test_on_another_day_the_filter_knows_nothing_of_the_day_before(aircraft, three):
    body, _ = joined(three[:2])
    epoch = epoch_of(int(body.stamp[0]))
    rows = states(aircraft, body, epoch)
    alone = states(aircraft, manoeuvres(body)[1], epoch)  # at the same place on the clock: the same to the bit
    assert len(alone) > 900
    counts = StateField.LATE, StateField.REJECTED, StateField.FUSED  # which go on
    same = np.delete(np.arange(StateField.WIDTH), counts)
    assert np.array_equal(rows[-len(alone) :, same], alone[:, same], equal_nan=True)


def test_in_the_same_flight_it_knows_the_biases_and_how_far_they_can_have_walked(aircraft, flight):
    first, second = part(flight, 10.0, 40.0), part(flight, 70.0, 80.0)
    state = StateEstimator(aircraft)
    state.push(first)
    state.flush()
    before, std = state.summary()["accelerometer_bias"], np.array(state.summary()["accelerometer_bias_std"])
    state.begin_anew(30.0)
    walked = np.array(state.summary()["accelerometer_bias_std"])
    assert state.summary()["accelerometer_bias"] == before
    assert walked**2 - std**2 == pytest.approx(np.full(3, 30.0 * aircraft.process_noise["accelerometer_bias"] ** 2))
    state.push(second)
    assert state.has_been_aligned and np.all(np.array(state.summary()["accelerometer_bias_std"]) < 0.1)
    state.begin_anew(SAME_FLIGHT + 1.0)
    assert state.summary()["accelerometer_bias"] == [None] * 3


def test_no_window_reaches_across_a_seam_and_what_was_learnt_stays(aircraft, three):
    body, _ = joined(three)
    pipeline = Pipeline(aircraft)
    points = np.vstack([pipeline.push(body)[1], pipeline.flush()[1]])
    epoch, half = pipeline.state.epoch, pipeline.parameters.options.half_width
    for one in manoeuvres(body):
        imu = (one.stamp[one.kind == Kind.IMU] - epoch) / SECOND
        inside = points[(points[:, 0] > imu.min() - 5.0) & (points[:, 0] < imu.max() + 5.0), 0]
        assert len(inside) > 100
        assert inside.min() - half > imu.min() - 0.011 and inside.max() + half < imu.max() + 0.011
    alone = Pipeline(aircraft)
    alone.push(three[0])
    alone.flush()
    first, last = (p.parameters.learning.least_squares.state.updates for p in (alone, pipeline))
    assert np.all(last > first)


def test_the_numbers_do_not_depend_on_the_portions(aircraft, three):
    body, _ = joined([three[0], three[2]])
    whole, portions = Pipeline(aircraft), Pipeline(aircraft)
    at_once = np.vstack([whole.push(body)[1], whole.flush()[1]])
    parts = [portions.push(body[i : i + 333])[1] for i in range(0, len(body), 333)]
    assert np.array_equal(at_once, np.vstack([*parts, portions.flush()[1]]), equal_nan=True)


def test_the_smoother_has_a_segment_of_its_own_for_each(aircraft, three):
    body, _ = joined(three)
    with SmootherHistory() as tape:
        state = StateEstimator(aircraft, tape=tape)
        count = len(state.push(body)) + len(state.flush())
        assert len(list(tape.segments())) == 3
        assert len(state.smooth()) == count
