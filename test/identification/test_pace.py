"""The rate of states from their times: the same in any portions, through jitter, lost samples and another rate."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.pace import BLOCK, Pace, interval_of, why_airspeed_too_slow
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of


def paces(times: np.ndarray, portion: int) -> np.ndarray:
    """The interval that each time met."""
    pace, found = Pace(), np.full(len(times), np.nan)
    for at in range(0, len(times), portion):
        part = times[at : at + portion]
        for piece in pace.follow(part):
            found[at : at + portion][piece] = pace.interval
    return found


def stamps(rate: float, count: int, jitter: float = 0.0, lost: float = 0.0, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    times = (np.arange(count) + random.uniform(-jitter, jitter, count)) / rate
    return times[random.uniform(size=count) >= lost]


@pytest.mark.parametrize("portion", [1, 2, 7, BLOCK, 100])
def test_portions_do_not_matter_and_only_the_past_counts(portion: int) -> None:
    times = np.concatenate([stamps(10.0, 70, 0.2, 0.1), 8.0 + stamps(100.0, 500), 14.0 + stamps(20.0, 90, 0.2)])
    whole = paces(times, len(times))
    np.testing.assert_array_equal(paces(times, portion), whole)
    for known in (20, 100, 300, len(times) - 5):
        np.testing.assert_array_equal(paces(times[:known], known), whole[:known])


@pytest.mark.parametrize("rate", [10.0, 12.5, 20.0, 33.3])
@pytest.mark.parametrize("seed", range(5))
def test_a_sparse_rate_is_found_through_jitter_and_lost_samples(rate: float, seed: int) -> None:
    found = paces(stamps(rate, 400, jitter=0.2, lost=0.1, seed=seed), 50)
    assert np.all(found[: BLOCK + 1] == 0.0)
    assert np.all(np.abs(found[BLOCK + 1 :] * rate - 1.0) < 0.25)
    assert len(np.unique(found[BLOCK + 1 :])) <= 2  # and kept


@pytest.mark.parametrize("rate", [50.0, 100.0, 400.0])
def test_dense_is_dense_through_jitter_and_lost_samples(rate: float) -> None:
    assert np.all(paces(stamps(rate, 4000, jitter=0.2, lost=0.1), 64) == 0.0)


def test_another_rate_is_known_within_two_blocks() -> None:
    times = np.concatenate([stamps(100.0, 500), 5.1 + stamps(10.0, 100), 15.1 + stamps(25.0, 200)])
    found = paces(times, 33)
    assert np.all(found[:500] == 0.0) and np.all(np.abs(found[500 + 2 * BLOCK : 600] - 0.1) < 1e-9)
    assert np.all(np.abs(found[600 + 2 * BLOCK :] - 0.04) < 1e-9)


def test_below_ten_hertz_everything_is_a_gap(aircraft: Aircraft) -> None:
    for rate, slow in ((5.0, True), (7.5, True), (9.0, False), (10.0, False), (100.0, False)):
        pace = Pace()
        pace.take(stamps(rate, 100))
        assert pace.is_too_slow == slow
        assert (pace.largest_gap(0.1) == 0.0) == slow
    assert pace.seen_by(aircraft) is aircraft and pace.sampling_error == 0.0
    pace.take(10.0 + stamps(10.0, 50))
    assert pace.largest_gap(0.1) == pytest.approx(0.15)  # a lost sample makes a gap
    seen = pace.seen_by(aircraft)
    assert [seen.sensors[s].rate for s in ("accelerometer", "gyro", "control_surfaces")] == pytest.approx([10.0] * 3)
    assert seen.sensors["airspeed"] is aircraft.sensors["airspeed"]


def test_a_clock_that_begins_anew_keeps_the_rate() -> None:
    pace = Pace()
    pace.take(100.0 + stamps(10.0, 50))
    pace.restart()
    pace.take(stamps(10.0, 5))
    assert pace.rate == pytest.approx(10.0)


def test_samples_of_one_time_are_one() -> None:
    """Air data that came twice, as two players of a recording send them, had no time between them to divide by."""
    times = np.rint(stamps(20.0, 40) * 1e9).astype(np.int64)
    once = samples_of(Kind.AIRSPEED, times, np.full(40, 20.0))
    assert interval_of(concatenate([once, once, once]), Kind.AIRSPEED) == pytest.approx(0.05)
    standing = samples_of(Kind.AIRSPEED, np.zeros(40, np.int64), np.full(40, 20.0))
    assert np.isnan(interval_of(standing, Kind.AIRSPEED)) and why_airspeed_too_slow(standing) == ""
