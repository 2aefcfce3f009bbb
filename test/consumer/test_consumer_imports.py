"""The library is numpy alone; ROS is in subscriber.py and nowhere else."""

import json
import subprocess
import sys


def test_without_the_subscriber_nothing_of_ros_nor_a_compiler_is_loaded():
    code = "import json, sys; import aircraft_sysid_ros.consumer; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in json.loads(done.stdout)}
    assert "numpy" in loaded and "aircraft_sysid_ros" in loaded
    assert not loaded & {"aircraft_sysid_msgs", "numba", "scipy", "rosbags", "yaml"}
