"""Samples are pushed together, so that a message costs little; none waits for longer than it should."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from aircraft_sysid_ros.reconstruction.ordering import OrderCounts

MILLISECOND = 1_000_000


class Recorder:
    """Stands for the estimator: what was pushed, by push."""

    def __init__(self, estimator):
        self.estimator, self.pushed, self.epoch = estimator, [], 0
        self.status, self.realignments = 0, 0
        self.order = SimpleNamespace(counts=OrderCounts())

    def push(self, samples):
        self.pushed.append([int(stamp) // MILLISECOND for stamp in samples.stamp])
        return np.empty((0, 60))

    def __getattr__(self, name):
        return getattr(self.estimator, name)

    def flush(self):
        return np.empty((0, 60))

    def counts(self):
        return {}


@pytest.fixture
def node(bench):
    from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode

    def make(horizon):
        from aircraft_sysid_ros.nodes.common import start

        made = bench.node(StateEstimatorNode, horizon=horizon)
        assert start(made)
        made.estimator = Recorder(made.estimator)
        return made

    return make


def imu(milliseconds):
    from sensor_msgs.msg import Imu

    message = Imu()
    message.header.stamp.sec, rest = divmod(milliseconds, 1000)
    message.header.stamp.nanosec = rest * MILLISECOND
    return message


def velocity(milliseconds):
    from geometry_msgs.msg import TwistStamped

    message = TwistStamped()
    message.header.stamp.sec, rest = divmod(milliseconds, 1000)
    message.header.stamp.nanosec = rest * MILLISECOND
    return message


def test_imu_samples_wait_for_a_small_part_of_the_horizon_and_keep_their_order(node):
    made = node(0.5)
    for time in range(10_000, 10_025, 5):
        made.take("imu/data", imu(time))
        made.take("gps/vel", velocity(time + 1))
    assert made.estimator.pushed == [[10_000], [10_001, 10_005, 10_006, 10_010], [10_011, 10_015, 10_016, 10_020]]


def test_without_a_horizon_every_imu_sample_is_pushed_at_once(node):
    made = node(0.0)
    for time in (10_000, 10_010, 10_020):
        made.take("imu/data", imu(time))
    assert made.estimator.pushed == [[10_000], [10_010], [10_020]]


def test_a_leap_of_the_clock_is_pushed_at_once_and_a_dead_imu_holds_nothing_back_for_ever(node):
    made = node(0.5)
    made.take("imu/data", imu(10_000))
    made.take("imu/data", imu(5_000))
    assert made.estimator.pushed == [[10_000], [5_000]]
    for time in range(100):
        made.take("gps/vel", velocity(5_000 + time))
    assert len(made.estimator.pushed[-1]) == 100


def test_diagnostics_and_the_end_count_what_was_waiting(node):
    made = node(0.5)
    made.take("imu/data", imu(10_000))
    made.take("imu/data", imu(10_005))
    made.condition()
    assert made.estimator.pushed == [[10_000], [10_005]]
    made.take("imu/data", imu(10_010))
    made.finish()
    assert made.estimator.pushed[-1] == [10_010]
