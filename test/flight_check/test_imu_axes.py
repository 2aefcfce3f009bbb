"""An IMU that is turned by a quarter is said in one sentence, where gyros and accelerometers both show it."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.finding import ERROR, INFO
from aircraft_sysid_ros.flight_check.signals import NAMES, flight_of
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

AXES = "xyz"


@pytest.fixture(scope="module")
def samples() -> Samples:
    return simulate_samples(default_aircraft(), 52, 100.0, sensors=SensorOptions(attitude=True)).samples


def with_imu(samples: Samples, follows: dict[int, tuple[int, float]], vectors=("force", "gyro")) -> Samples:
    """Each axis shows another one, with a sign."""
    values, rows = samples.values.copy(), samples.kind == Kind.IMU
    for vector in vectors:
        first = 0 if vector == "force" else 3
        for axis, (other, sign) in follows.items():
            values[rows, first + axis] = sign * samples.values[rows, first + other]
    return Samples(samples.stamp, samples.kind, values)


def findings(samples: Samples):
    found = check(flight_of(samples, samples.stamp, surface_noise=0.0005)).findings
    return [f for f in found if f.severity != INFO]


@pytest.mark.long
@pytest.mark.parametrize(("first", "second", "sign"), [(0, 1, 1.0), (0, 1, -1.0), (1, 2, 1.0), (0, 2, -1.0)])
def test_a_turn_is_one_sentence_and_the_rest_is_judged_without_it(samples, first, second, sign):
    (found,) = findings(with_imu(samples, {first: (second, sign), second: (first, -sign)}))
    names = NAMES[Kind.IMU]
    assert found.signals == tuple(names[first + k] for k in (0, second - first, 3, 3 + second - first))
    i, j, about = AXES[first], AXES[second], AXES[3 - first - second]
    minus = "minus " if sign < 0.0 else ""
    assert found.severity == ERROR and found.sentence.startswith(
        f"the IMU is turned by 90 deg about its {about} axis: {i} follows {minus}what {j} should be"
    )
    remedy = f"take {j} for {i} and minus {i} for {j}" if sign < 0.0 else f"take minus {j} for {i} and {i} for {j}"
    assert found.sentence.endswith(f"of both {remedy}")


@pytest.mark.parametrize("about", [0, pytest.param(2, marks=pytest.mark.long)])
def test_half_a_turn_is_one_sentence(samples, about):
    """An IMU with forward-right-down axes under a topic of ROS: the sideslip and the rudder were to be reversed."""
    without_attitude = samples[samples.kind != Kind.ATTITUDE]
    first, second = (k for k in range(3) if k != about)
    (found,) = findings(with_imu(without_attitude, {first: (first, -1.0), second: (second, -1.0)}))
    names = NAMES[Kind.IMU]
    assert found.signals == tuple(names[k] for k in (first, second, 3 + first, 3 + second))
    i, j, axis = AXES[first], AXES[second], AXES[about]
    assert found.severity == ERROR and found.sentence.startswith(f"the IMU is turned by 180 deg about its {axis} axis")
    assert found.sentence.endswith(f"reverse {i} and {j} of both")


@pytest.mark.long
def test_what_is_exchanged_in_one_sensor_alone_is_no_turn(samples):
    for vectors in (("gyro",), ("force",)):
        sentences = [f.sentence for f in findings(with_imu(samples, {0: (1, 1.0), 1: (0, -1.0)}, vectors))]
        assert sentences and not any("is turned" in text for text in sentences)
    mirrored = [f.sentence for f in findings(with_imu(samples, {0: (1, 1.0), 1: (0, 1.0)}))]
    assert mirrored and not any("is turned" in text for text in mirrored)


def test_without_gps_the_gyros_alone_are_named(samples):
    turned = with_imu(samples, {0: (1, 1.0), 1: (0, -1.0)})
    of_gps = np.isin(turned.kind, (Kind.GPS_VELOCITY, Kind.GPS_POSITION))
    sentences = [f.sentence for f in findings(turned[~of_gps])]
    assert any("the axes are swapped" in text for text in sentences)
    assert not any("is turned" in text for text in sentences)


@pytest.mark.parametrize(("factor", "blames_attitude"), [(1.09, True), (0.9, False)])
def test_a_gyro_that_turns_more_than_the_attitude_may_be_right(samples, factor, blames_attitude):
    """A complementary filter that leans on the accelerometers follows nine tenths of a quick roll."""
    values, rows = samples.values.copy(), samples.kind == Kind.IMU
    values[rows, 3] *= factor
    (found,) = findings(Samples(samples.stamp, samples.kind, values))
    assert found.kind == "scale" and found.signals == ("angular_velocity.x",)
    assert found.sentence.endswith("the attitude filter smooths it") is blames_attitude
