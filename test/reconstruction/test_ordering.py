"""Time order: what is late takes its own place, what is too late is counted, and stamps alone decide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.reconstruction.ordering import TimeOrder
from aircraft_sysid_ros.samples import Kind, Samples, concatenate, samples_of
from aircraft_sysid_ros.stamps import NANOSECONDS

EPOCH = 1_700_000_000 * NANOSECONDS


def imu(times) -> Samples:
    stamps = EPOCH + np.rint(np.atleast_1d(times) * NANOSECONDS).astype(np.int64)
    return samples_of(Kind.IMU, stamps, np.tile([0.0, 0.0, -9.8, 0.0, 0.0, 0.0], (len(stamps), 1)))


def gps(times) -> Samples:
    stamps = EPOCH + np.rint(np.atleast_1d(times) * NANOSECONDS).astype(np.int64)
    return samples_of(Kind.GPS_VELOCITY, stamps, np.tile([1.0, 2.0, 3.0], (len(stamps), 1)))


def released(order: TimeOrder, *batches: Samples, flush: bool = True) -> tuple[list[tuple[float, int]], int]:
    """Times [s] and kinds in the order of release, and how often the clock started over."""
    parts = [part for batch in batches for part in order.push(batch)]
    parts += list(order.flush()) if flush else []
    out = [
        (round((int(t) - EPOCH) / NANOSECONDS, 6), int(k))
        for part in parts
        for t, k in zip(part.samples.stamp, part.samples.kind, strict=True)
    ]
    return out, sum(part.restarted for part in parts)


def shuffled_arrival(seed: int, lateness: float) -> Samples:
    """100 Hz IMU and 5 Hz GPS over 20 s, each sample late by up to ``lateness`` [s]."""
    random = np.random.default_rng(seed)
    times_imu, times_gps = np.arange(0.0, 20.0, 0.01), np.arange(0.1003, 20.0, 0.2)
    samples = concatenate([imu(times_imu), gps(times_gps)])
    arrival = np.concatenate([times_imu, times_gps + random.uniform(0.0, lateness, len(times_gps))])
    return samples[np.argsort(arrival, kind="stable")]


def test_late_samples_take_their_own_place() -> None:
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    out, _ = released(order, shuffled_arrival(1, 0.49))
    assert [t for t, _ in out] == sorted(t for t, _ in out)
    assert len(out) == 2000 + 100
    assert order.counts.late.sum() == 0


@pytest.mark.long
@pytest.mark.parametrize("block", [1, 7, 500, 100_000])
def test_release_does_not_depend_on_how_samples_are_handed_over(block: int) -> None:
    samples = shuffled_arrival(2, 0.8)  # some are too late
    delays = np.zeros(len(Kind))
    delays[Kind.GPS_VELOCITY] = 0.15
    one, other = TimeOrder(0.5, delays), TimeOrder(0.5, delays)
    expected, _ = released(one, samples)
    parts = [samples[i : i + block] for i in range(0, len(samples), block)]
    assert released(other, *parts)[0] == expected
    assert np.array_equal(one.counts.late, other.counts.late)


@pytest.mark.parametrize("block", [1, 7, 100_000])
def test_what_comes_again_counts_once(block: int) -> None:
    """A topic that was recorded twice made every standard error too small."""
    samples = shuffled_arrival(3, 0.3)
    once, order = TimeOrder(0.5, np.zeros(len(Kind))), TimeOrder(0.5, np.zeros(len(Kind)))
    expected, _ = released(once, samples)
    thrice = samples[np.repeat(np.arange(len(samples)), 3)]
    assert released(order, *(thrice[i : i + block] for i in range(0, len(thrice), block)))[0] == expected
    assert order.counts.repeated[Kind.IMU] == 4000 and order.counts.repeated[Kind.GPS_VELOCITY] == 200
    assert "4000 of 6000 of imu" in order.counts.repeated_in_words and once.counts.repeated_in_words == ""
    assert order.counts.stamps_in_words == "", "the stamps advance"


def test_of_one_stamp_other_values_are_another_sample() -> None:
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    twice = gps([0.1, 0.1])
    twice.values[1, 0] += 1.0
    out, _ = released(order, concatenate([imu(np.arange(0.0, 0.1, 0.01)), twice, imu(np.arange(0.1, 1.0, 0.01))]))
    assert sum(kind == Kind.GPS_VELOCITY for _, kind in out) == 2
    assert order.counts.repeated.sum() == 0


def test_too_late_is_dropped_and_counted() -> None:
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    out, _ = released(order, imu(np.arange(0.0, 3.0, 0.01)), gps([2.0]), gps([2.6]))
    assert (2.6, Kind.GPS_VELOCITY) in out and (2.0, Kind.GPS_VELOCITY) not in out
    assert order.counts.late[Kind.GPS_VELOCITY] == 1


@pytest.mark.parametrize(("period", "stands"), [(10**9, True), (2 * 10**7, False), (10**7, False)])
def test_an_imu_whose_stamps_stand_still_is_said(period, stands) -> None:
    """In whole seconds, or not at all; two sensors under one name have each stamp twice."""
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    stamps = np.arange(0, 10 * 10**9, 10**7) // period * period
    noise = np.random.default_rng(4)
    for part in np.array_split(stamps, 40):
        list(order.push(samples_of(Kind.IMU, part, noise.normal(size=(len(part), 6)))))
    assert ("the stamps of the IMU do not advance: 990 of 1000" in order.counts.stamps_in_words) == stands
    assert bool(order.counts.stamps_in_words) == stands


def test_what_no_horizon_waits_for_is_told_from_what_one_does() -> None:
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    list(order.push(samples_of(Kind.IMU, np.arange(0, 20 * 10**9, 10**7), np.zeros((2000, 6)))))
    for kind, stamp in ((Kind.AIRSPEED, 19 * 10**9), (Kind.SIDESLIP, 10**9)):
        list(order.push(samples_of(kind, [stamp], [1.0])))
    assert order.counts.late[Kind.AIRSPEED] == order.counts.late[Kind.SIDESLIP] == 1
    assert order.counts.far_behind(5.0) == {Kind.SIDESLIP: pytest.approx(18.5, abs=0.1)}


def test_sensor_delay_moves_a_sample_to_when_it_was_true() -> None:
    delays = np.zeros(len(Kind))
    delays[Kind.GPS_VELOCITY] = 0.23
    out, _ = released(TimeOrder(0.5, delays), imu(np.arange(0.0, 2.0, 0.01)), gps([1.5]))
    assert (1.27, Kind.GPS_VELOCITY) in out


def test_nothing_is_released_before_the_horizon() -> None:
    out, _ = released(TimeOrder(0.5, np.zeros(len(Kind))), imu(np.arange(0.0, 2.0, 0.01)), flush=False)
    assert out[-1][0] == pytest.approx(1.99 - 0.5 - 0.01)


def test_samples_with_nan_are_counted_and_left_out() -> None:
    bad = imu([0.5])
    bad.values[0, 2] = np.nan
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    out, _ = released(order, imu([0.4]), bad, imu([0.6]))
    assert [t for t, _ in out] == [0.4, 0.6]
    assert order.counts.invalid[Kind.IMU] == 1


def test_a_single_wrong_stamp_does_no_harm() -> None:
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    for wrong in (-1000.0, 5000.0):
        out, restarts = released(order, imu([1.0, 1.01]), imu([wrong]), imu([1.02, 1.03]))
        assert restarts == 0 and wrong not in [t for t, _ in out]
    assert order.counts.wrong_stamp[Kind.IMU] == 2


@pytest.mark.parametrize("leap", [-1000.0, 5000.0])
@pytest.mark.parametrize("block", [1, 1000])
def test_a_restart_of_the_clock_is_believed_when_confirmed(leap: float, block: int) -> None:
    samples = concatenate([imu(np.arange(10.0, 12.0, 0.01)), imu(leap + np.arange(10.0, 12.0, 0.01))])
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    out, restarts = released(order, *[samples[i : i + block] for i in range(0, len(samples), block)])
    assert restarts == 1 == order.counts.restarts
    assert len(out) == 400
    assert order.counts.late.sum() == 0


def test_a_stamp_in_the_future_is_dropped_and_counted() -> None:
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    out, _ = released(order, imu(np.arange(0.0, 1.0, 0.01)), gps([4000.0]), imu(np.arange(1.0, 2.0, 0.01)))
    assert len(out) == 200
    assert order.counts.wrong_stamp[Kind.GPS_VELOCITY] == 1


@pytest.mark.parametrize("block", [1, 1000])
@pytest.mark.parametrize(("ahead", "left_out"), [(1.0, 0), (18.0, 20), (25.0, 20)])
def test_gps_that_is_stamped_ahead_of_all_other_sensors_is_left_out_and_told(ahead, left_out, block) -> None:
    """Stamps of GPS time are 18 s ahead of UTC: it had been fused with a motion 18 s later, and a wind of 36 m/s."""
    time = np.arange(1000) * 0.01
    arrivals = [(t, imu([t])) for t in time] + [(t + 0.001, gps([t + ahead])) for t in time[::50]]
    samples = concatenate([each for _, each in sorted(arrivals, key=lambda pair: pair[0])])
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    released(order, *[samples[i : i + block] for i in range(0, len(samples), block)])
    assert order.counts.wrong_stamp[Kind.GPS_VELOCITY] == left_out
    words = order.counts.gps_in_words
    assert (f"20 of 20 samples of the GPS are stamped {ahead:.1f} s or more ahead" in words) is bool(left_out)
    assert ("GPS time is ahead of UTC" in words) is (ahead == 18.0)


@pytest.mark.parametrize("block", [1, 1000])
@pytest.mark.parametrize(
    ("ahead", "late_imu", "is_told"), [(3.0, 0.0, True), (0.0, 0.3, False), (3.0, 0.3, True), (-3.0, 0.0, False)]
)
def test_a_sensor_whose_clock_is_ahead_of_that_of_the_imu_is_told(ahead, late_imu, is_told, block) -> None:
    """Air data stamped 3 s ahead were used 3 s too late: all was HOLD, and nothing named the clock."""
    time = np.arange(1000) * 0.01
    air = replace(gps(time[::5] + ahead), kind=np.full(200, Kind.AIRSPEED))
    arrivals = [(t + late_imu, imu([t])) for t in time] + [(t, air[[i]]) for i, t in enumerate(time[::5])]
    samples = concatenate([each for _, each in sorted(arrivals, key=lambda pair: pair[0])])
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    released(order, *[samples[i : i + block] for i in range(0, len(samples), block)])
    words = order.counts.ahead_in_words
    assert bool(words) is is_told and ("airspeed by 3." in words) is is_told
    assert order.counts.wrong_stamp.sum() == 0


def test_what_came_before_the_imu_with_no_stamp_is_of_no_clock() -> None:
    """GPS without a stamp that came first was taken for GPS that is there, and no state was ever begun."""
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    unstamped = replace(gps([0.0]), stamp=np.array([0]))
    out, restarts = released(order, unstamped, gps([-1.0]), imu(np.arange(0.0, 1.0, 0.01)), unstamped)
    assert out[0] == (-1.0, Kind.GPS_VELOCITY) and len(out) == 101 and restarts == 0
    assert (order.counts.wrong_stamp[Kind.GPS_VELOCITY], order.counts.late[Kind.GPS_VELOCITY]) == (1, 1)


def test_gps_that_runs_on_while_the_imu_is_silent_is_not_ahead_of_the_rest() -> None:
    arrivals = [imu(np.arange(0.0, 1.0, 0.01))]
    for t in np.arange(1.0, 20.0, 0.1):
        arrivals += [replace(gps([t]), kind=np.array([Kind.AIRSPEED])), gps([t])]
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    released(order, concatenate([*arrivals, imu(np.arange(20.0, 22.0, 0.01))]))
    assert order.counts.wrong_stamp.sum() == 0 and not order.counts.gps_in_words


def test_memory_is_bounded_without_an_imu() -> None:
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    for start in range(0, 500_000, 50_000):
        list(order.push(gps((start + np.arange(50_000)) * 0.001)))
    assert len(order._held) <= 200_000


@pytest.mark.parametrize("value", [1e300, -1e10, np.inf])
def test_absurd_numbers_are_counted_and_left_out(value: float) -> None:
    bad = gps([0.5])
    bad.values[0, 1] = value
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    out, _ = released(order, imu([0.4]), bad, imu([0.6]))
    assert [t for t, _ in out] == [0.4, 0.6]
    assert order.counts.invalid[Kind.GPS_VELOCITY] == 1


def test_leaps_of_the_clock_are_not_flight_time() -> None:
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    released(order, imu(np.arange(0.0, 2.005, 0.01)), imu(5000.0 + np.arange(0.0, 3.005, 0.01)))
    assert order.elapsed == pytest.approx(5 * NANOSECONDS, abs=NANOSECONDS // 50)


@pytest.mark.parametrize("block", [1, 10_000])
def test_after_a_change_of_the_horizon_time_still_runs_forwards(block: int) -> None:
    """A longer horizon waits for what comes from then on; it does not bring back a time that has been used."""
    order = TimeOrder(0.2, np.zeros(len(Kind)))
    first, later = imu(np.arange(0.0, 2.0, 0.01)), imu(np.arange(2.0, 4.0, 0.01))
    late = concatenate([gps([1.505]), gps([1.905])])  # the first is of a time that has been used

    def pushed(samples: Samples) -> list[float]:
        parts = [samples[i : i + block] for i in range(0, len(samples), block)]
        return [t for t, _ in released(order, *parts, flush=False)[0]]

    before = pushed(first)
    order.change_horizon(1.0)
    after = pushed(concatenate([late, later]))
    order.change_horizon(0.1)
    end = pushed(imu([4.0]))
    assert np.all(np.diff(before + after + end) > 0)
    assert before[-1] == pytest.approx(1.78) and after[-1] == pytest.approx(2.98) and end[-1] == pytest.approx(3.89)
    assert 1.905 in after and order.counts.late[Kind.GPS_VELOCITY] == 1


def test_what_comes_after_a_flush_and_is_older_is_late() -> None:
    order = TimeOrder(0.5, np.zeros(len(Kind)))
    out, _ = released(order, imu(np.arange(0.0, 1.0, 0.01)))
    more, _ = released(order, gps([0.9]), imu(np.arange(1.0, 2.0, 0.01)))
    assert out[-1][0] == 0.99 and more[0][0] == 1.0
    assert order.counts.late[Kind.GPS_VELOCITY] == 1
