"""Why no state was estimated, as ``replay`` and ``live`` say it."""

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight.replay_notes import why_no_start
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.ros_messages.conversion import NO_FIX, gps_fix_fields, to_samples
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of

SECOND = 10**9


def imu(count, rate=100):
    """At rest."""
    stamp = np.arange(count) * SECOND // rate
    still = [np.zeros((count, 2)), np.full((count, 1), -9.81), np.zeros((count, 3)), np.full((count, 2), np.nan)]
    return samples_of(Kind.IMU, stamp, *still)


def fixes(stamp, status):
    n = len(stamp)
    fields = gps_fix_fields(np.full(n, 0.8), np.full(n, -1.6), np.full(n, 300.0), status=status)
    unknown = {"position_covariance": np.zeros((n, 9)), "position_covariance_type": np.zeros(n, np.uint8)}
    return to_samples("gps/fix", stamp, {**fields, **unknown})


@pytest.fixture
def said(aircraft):
    """What is said of samples."""

    def say(*batches):
        state, samples = StateEstimator(aircraft), concatenate(list(batches))
        state.push(samples[np.argsort(samples.stamp, kind="stable")])
        state.flush()
        assert state.last_row is None
        return why_no_start(state)

    return say


def test_every_sensor_that_is_missing_is_named_with_its_topic(said):
    lacking = "no GPS position came on gps/fix; no GPS velocity came on gps/vel; no airspeed came on air_data"
    assert said(imu(300)).startswith(
        f"{lacking}: record the airspeed or GPS; with GPS and no airspeed calm_air (--calm"
    )
    assert said(*fixes(np.arange(10) * SECOND // 5, 0)) == "no IMU came on imu/data"


def test_an_imu_that_lacks_an_axis_is_said_to_need_all(said):
    """Of a table without gyros it was said only that its samples 'have no usable numbers'."""
    samples = imu(300)
    samples.values[:, 3:6] = np.nan
    text = said(samples, *fixes(np.arange(10) * SECOND // 5, 0))
    assert text.startswith(
        "of 300 samples of the IMU 300 have no usable numbers (all three of its accelerations and of"
    )


def test_a_gps_without_a_fix_is_said_with_its_numbers(said):
    stamp = np.arange(10) * SECOND // 5
    velocity = samples_of(Kind.GPS_VELOCITY, stamp, np.zeros((10, 3)))
    text = said(imu(300), *fixes(stamp, NO_FIX), velocity)
    assert text.startswith("of 10 samples of the GPS position 10 have no fix (status -1, ")
    assert "velocity" not in text


def test_a_gps_on_another_clock_does_not_fit_the_imu(said):
    stamp = np.arange(10) * SECOND // 5
    velocity = samples_of(Kind.GPS_VELOCITY, stamp, np.zeros((10, 3)))
    text = said(imu(300), *fixes(stamp + 10_000 * SECOND, 0), velocity)
    assert text == "of 10 samples of the GPS position 10 have a stamp that does not fit the IMU"


def test_an_imu_that_is_too_slow_for_a_start_is_named_with_its_rate(said):
    stamp = np.arange(60) * SECOND // 5
    velocity = samples_of(Kind.GPS_VELOCITY, stamp, np.zeros((60, 3)))
    text = said(imu(36, rate=3), *fixes(stamp, 0), velocity)
    assert text == "the IMU comes at 3 Hz: it needs samples that are at most 0.25 s apart"


def test_its_rate_is_that_of_samples_that_count(said):
    """A topic that was recorded twice came at twice its rate, by these words."""
    stamp = np.arange(60) * SECOND // 5
    velocity = samples_of(Kind.GPS_VELOCITY, stamp, np.zeros((60, 3)))
    text = said(imu(36, rate=3), imu(36, rate=3), *fixes(stamp, 0), velocity)
    assert text == "the IMU comes at 3 Hz: it needs samples that are at most 0.25 s apart"


def test_so_is_one_whose_gaps_are_a_little_too_long_every_time(said):
    """4 Hz, as autopilots send unasked: the mean is as short as it must be, and it was motion that seemed to lack."""
    stamp = np.arange(100) * SECOND // 5
    velocity = samples_of(Kind.GPS_VELOCITY, stamp, np.full((100, 3), 20.0))
    slow = imu(81, rate=4)
    slow.stamp[1::2] += SECOND // 100
    text = said(slow, *fixes(stamp, 0), velocity)
    assert text == "the IMU comes at 4 Hz: it needs samples that are at most 0.25 s apart"


def test_nothing_is_said_of_the_rate_of_an_imu_that_has_only_begun(aircraft):
    before, after = StateEstimator(aircraft), StateEstimator(aircraft)
    before.push(imu(1000))
    after.follow(before)
    samples = imu(1400)
    for part in (samples[1000:1010], samples[1010:]):
        after.push(part)
        assert after.imu_in_words == ""


def test_where_every_sensor_works_it_is_motion_that_lacks(said):
    stamp = np.arange(10) * SECOND // 5
    velocity = samples_of(Kind.GPS_VELOCITY, stamp, np.zeros((10, 3)))
    assert "motion of more than" in said(imu(300), *fixes(stamp, 0), velocity)
