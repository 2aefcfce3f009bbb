"""The launch file for MAVROS: its remappings are to topics that exist."""

import ast
from pathlib import Path

from aircraft_sysid_ros.mavlink.mavros_table import MAVROS
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, TOPICS

FILE = Path(__file__).resolve().parents[2] / "launch" / "mavros.launch.py"


def constant(name):
    tree = ast.parse(FILE.read_text(encoding="utf8"))
    (value,) = [n.value for n in tree.body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == name]
    return ast.literal_eval(value)


def test_it_remaps_our_topics_to_those_that_import_knows():
    assert set(constant("REMAPPED")) <= TOPICS.keys() and set(constant("REMAPPED").values()) <= MAVROS.keys()
    assert set(constant("BRIDGED")) == {"air_data", "control_surfaces", INPUTS_TOPIC}  # all that a calibration names
    scripts = (FILE.parents[1] / "setup.py").read_text(encoding="utf8")
    for name in (*constant("NODES"), "mavlink_bridge"):
        assert f'"{name} = aircraft_sysid_ros.nodes.{name}:main"' in scripts
