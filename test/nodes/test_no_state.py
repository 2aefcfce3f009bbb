"""Who can estimate no state says why: which sensor did not come, or was of no use."""

import itertools
import re
import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from processes import live
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import Imu, NavSatFix, NavSatStatus
from waiting import LONGEST

from aircraft_sysid_ros.nodes import state_estimator
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode
from aircraft_sysid_ros.ros_messages.conversion import NO_FIX


@pytest.fixture
def run(tmp_path):
    """Name of a run that must not be written."""
    yield tmp_path / "run"
    assert not (tmp_path / "run").exists()


def stopped(process):
    """What is said after Ctrl-C."""
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=LONGEST)
    assert process.returncode == 2 and "Traceback" not in errors
    return errors


def test_diagnostics_say_that_nobody_publishes_the_imu_and_how_often_the_others_come(bench):
    """As after a wrong remap: GPS comes at 20 Hz of its own stamps, with a gap of half a second."""
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    node = bench.node(StateEstimatorNode)
    assert node.trigger_configure() == node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    gps, stamps = bench.publisher(NavSatFix, "gps/fix"), itertools.count(1)

    def say():
        message, number = NavSatFix(latitude=45.0, longitude=-93.0, altitude=300.0), next(stamps)
        message.header.stamp.sec, tick = divmod(number + (number > 3) * 9, 20)
        message.header.stamp.nanosec = tick * 50_000_000
        gps.publish(message)

    def values():
        statuses = [status for message in diagnostics for status in message.status if status.name == node.get_name()]
        return [(status.message, {each.key: each.value for each in status.values}) for status in statuses]

    bench.say_until(say, lambda: any(float(v.get("gps_position.largest_gap", 0.0)) > 0.4 for _, v in values()))
    words, found = next((m, v) for m, v in values() if float(v.get("gps_position.largest_gap", 0.0)) > 0.4)
    assert "no IMU has come on /imu/data, which nobody publishes: check its name and the remaps" in words
    assert found["gps_position.largest_gap"] == "0.5" and 1.0 < float(found["gps_position.rate"]) < 20.0
    assert "imu.rate" not in found


def test_diagnostics_say_that_the_imu_has_fallen_silent(bench, monkeypatch):
    """The link is lost in flight: what the last state rested on was said for as long as nothing came, as if it did."""
    monkeypatch.setattr(state_estimator, "SILENT", 0.5)
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    node = bench.node(StateEstimatorNode)
    assert node.trigger_configure() == node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    imu = bench.publisher(Imu, "imu/data")

    def say():
        message = Imu()
        message.header.stamp = bench.helper.get_clock().now().to_msg()
        imu.publish(message)

    def told():
        return [status.message for message in diagnostics for status in message.status]

    bench.say_until(say, lambda: told() and node.received["imu/data"] > 3)
    assert not any("no IMU for" in words for words in told())
    bench.spin_until(lambda: any("no IMU for" in words for words in told()))


def test_diagnostics_say_that_the_imu_sends_no_numbers(bench, monkeypatch):
    """A broken driver went on to send NaN: there was no state any more, and /diagnostics was ok."""
    monkeypatch.setattr(state_estimator, "SILENT", 0.5)
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    node = bench.node(StateEstimatorNode)
    assert node.trigger_configure() == node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    imu, broken = bench.publisher(Imu, "imu/data"), Imu()
    broken.linear_acceleration.z = float("nan")

    def say():
        broken.header.stamp = bench.helper.get_clock().now().to_msg()
        imu.publish(broken)

    def told():
        return [status.message for message in diagnostics for status in message.status]

    wanted = "s on /imu/data, and no state without it"
    bench.say_until(say, lambda: any(wanted in words for words in told()))
    assert any("no IMU but samples of no usable numbers for" in words for words in told())


@pytest.mark.long
def test_nobody_is_there(run, aircraft_file):
    with live(run, aircraft_file) as process:
        assert "no message came: the drivers or `bridge` must run" in stopped(process)


def test_a_gps_that_has_no_fix(run, aircraft_file, bench):
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    without = NavSatFix(status=NavSatStatus(status=NO_FIX), latitude=45.0, longitude=-93.0, altitude=300.0)
    with live(run, aircraft_file) as process:
        imu, gps = bench.publisher(Imu, "imu/data"), bench.publisher(NavSatFix, "gps/fix")

        def is_known():
            for publisher, message in ((imu, Imu()), (gps, without)):
                message.header.stamp = bench.helper.get_clock().now().to_msg()
                publisher.publish(message)
            values = [value for message in diagnostics for status in message.status for value in status.values]
            return any(value.key == "gps_position.invalid" and int(value.value) > 0 for value in values)

        bench.spin_until(is_known)
        said = stopped(process)
    assert re.search(r"of (\d+) samples of the GPS position \1 have no fix", said)
    assert "no GPS velocity came on gps/vel" in said
