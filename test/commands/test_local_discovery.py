"""Nodes of the commands are discovered on this machine only, unless the user says otherwise."""

import os

import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import DISCOVERY
from aircraft_sysid_ros.simulation.simulated_flight import SHORTEST, simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight
from aircraft_sysid_ros.workbench import live_link


@pytest.fixture
def ranges(monkeypatch):
    """What ROS would see of the range each time that it is started; it is not."""
    rclpy, _ = pytest.importorskip("rclpy"), pytest.importorskip("aircraft_sysid_msgs.msg")
    seen = []

    def init(*_, **__):
        seen.append(os.environ.get(DISCOVERY))
        raise InputError("ROS is not started here")

    monkeypatch.setattr(rclpy, "init", init)
    monkeypatch.setenv(DISCOVERY, "")
    monkeypatch.delenv("ROS_LOCALHOST_ONLY", raising=False)
    return seen


@pytest.fixture
def start(tmp_path, aircraft, aircraft_file, monkeypatch):
    """Start a command as a user does, or the process behind `workbench --live`."""

    def start_one(command):
        if command == "workbench":
            monkeypatch.setattr(live_link.signal, "signal", lambda *_: None)
            with pytest.raises(InputError, match="not started here"):
                live_link._serve(None, "")
            return
        words = {"live": ["--aircraft", str(aircraft_file)], "bridge": ["udp:127.0.0.1:14599"]}.get(command)
        if command == "play":
            write_flight(simulate_samples(aircraft, seed=1, duration=SHORTEST), tmp_path / "flight")
            words = [str(tmp_path / "flight")]
        assert main([command, *words]) == 2

    return start_one


@pytest.mark.parametrize("command", ["live", "bridge", "play", "workbench"])
def test_nodes_are_found_on_this_machine_only(command, start, ranges):
    start(command)
    assert ranges == ["LOCALHOST"]


@pytest.mark.parametrize("command", ["live", "bridge", "workbench"])
def test_who_says_how_far_is_obeyed(command, start, ranges, monkeypatch):
    monkeypatch.setenv(DISCOVERY, "SUBNET")
    start(command)
    assert ranges == ["SUBNET"]


def test_who_says_it_the_old_way_is_left_alone(start, ranges, monkeypatch):
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    start("bridge")
    assert ranges == [""]
