"""The launch file for MAVROS: read as text everywhere, and made where ROS 2's launch is installed."""

import ast
import importlib.util
from pathlib import Path

import pytest

from aircraft_sysid_ros.mavlink.mavros_table import MAVROS
from aircraft_sysid_ros.ros_messages.conversion import TOPICS

FILE = Path(__file__).resolve().parents[2] / "launch" / "mavros.launch.py"


def constant(name):
    tree = ast.parse(FILE.read_text(encoding="utf8"))
    (value,) = [n.value for n in tree.body if isinstance(n, ast.Assign) and n.targets[0].id == name]
    return ast.literal_eval(value)


def test_it_remaps_our_topics_to_those_that_import_knows():
    assert set(constant("REMAPPED")) <= TOPICS.keys() and set(constant("REMAPPED").values()) <= MAVROS.keys()
    assert set(constant("BRIDGED")) == {"air_data", "control_surfaces"}
    scripts = (FILE.parents[1] / "setup.py").read_text(encoding="utf8")
    for name in (*constant("NODES"), "mavlink_bridge"):
        assert f'"{name} = aircraft_sysid_ros.nodes.{name}:main"' in scripts


def test_the_description_is_made_where_launch_is_installed():
    pytest.importorskip("launch_ros.actions")
    spec = importlib.util.spec_from_file_location("mavros_launch", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    entities = module.generate_launch_description().entities
    assert sum(type(entity).__name__ == "LifecycleNode" for entity in entities) == 3
