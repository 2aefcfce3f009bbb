"""`live` that can estimate no state says why when it is stopped: which sensor did not come, or was of no use."""

import re
import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from processes import live
from sensor_msgs.msg import Imu, NavSatFix, NavSatStatus
from waiting import LONGEST

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
