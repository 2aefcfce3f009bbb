"""/tf: off by default, one sentence where tf2_msgs are missing, and the pose of the odometry where they are there."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from message_packages import environment
from nav_msgs.msg import Odometry
from rclpy.lifecycle import TransitionCallbackReturn
from waiting import LONGEST

from aircraft_sysid_ros.nodes.common import start
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode

INSIDE = "TEST_HAS_TF2_MSGS"
HERE = Path(__file__).resolve()


@pytest.mark.skipif(INSIDE in os.environ, reason="tf2_msgs are there")
def test_without_tf2_msgs_it_is_one_sentence(bench, capfd):
    node = bench.node(StateEstimatorNode, publish_tf=True)
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "ERROR" in line]
    assert "publish_tf needs tf2_msgs, which is not in this environment" in line


@pytest.mark.parametrize("prefix", ["/uav1/", "two words/"])
def test_a_prefix_that_begins_no_frame_is_refused(bench, capfd, prefix):
    node = bench.node(StateEstimatorNode, frame_prefix=prefix)
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert "frame_prefix begins a frame" in capfd.readouterr().err


@pytest.mark.long
@pytest.mark.skipif(INSIDE in os.environ, reason="this is the process that it starts")
def test_with_tf2_msgs():
    """The test below, in a process that has the package."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "", "-k", "odometry", str(HERE)]
    done = subprocess.run(
        command,
        env=environment("tf2_msgs") | {INSIDE: "1"},
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
    )
    assert done.returncode == 0 and done.stdout.startswith(". "), done.stdout + done.stderr  # it ran


@pytest.mark.skipif(INSIDE not in os.environ, reason="test_with_tf2_msgs starts it")
def test_the_pose_of_the_odometry_goes_to_tf(bench, raw):
    from tf2_msgs.msg import TFMessage

    node = bench.node(StateEstimatorNode, publish_tf=True, frame_prefix="uav1/")
    sent, poses = bench.listen(TFMessage, "/tf"), bench.listen(Odometry, "state_estimator/odometry")
    assert start(node)
    bench.play(raw, 0.0, 8.0, node)
    node.finish()
    bench.spin_until(lambda: poses and len(sent) == len(poses))
    for message, pose in zip(sent, poses, strict=True):
        (transform,) = message.transforms
        assert transform.header == pose.header and pose.header.frame_id == "uav1/map"
        assert transform.child_frame_id == pose.child_frame_id == "uav1/base_link"
        place, there = transform.transform.translation, pose.pose.pose.position
        assert (place.x, place.y, place.z) == (there.x, there.y, there.z)
        assert transform.transform.rotation == pose.pose.pose.orientation
