"""config/params.yaml: every parameter of every node with its default, from where it is declared in the code."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Mapping
from typing import Any

from node_tables import WORDS, allowed

from aircraft_sysid_ros.nodes import (
    estimator_node,
    mavlink_bridge,
    overview,
    parameter_estimator,
    px4_bridge,
    state_estimator,
)
from aircraft_sysid_ros.nodes.options import NodeOption

NODES: dict[str, Mapping[str, NodeOption]] = {
    "state_estimator": {**estimator_node.COMMON, **state_estimator.OPTIONS},
    "parameter_estimator": {**estimator_node.COMMON, **parameter_estimator.OPTIONS},
    "mavlink_bridge": mavlink_bridge.OPTIONS,
    "px4_bridge": px4_bridge.OPTIONS,
    "overview": overview.OPTIONS,
}
HEAD = """\
# Parameters of the nodes with their defaults. Copy it, keep the lines that you change, and
#     ros2 launch aircraft_sysid_ros live.launch.py params_file:=my_params.yaml
# What is given on the line of the launch goes before the file. /** stands for any namespace: /uav1/state_estimator is
# the node of one aeroplane alone. Written by docs/build.py from what the nodes declare.
"""


def _written(value: Any) -> str:
    """A value in YAML; numbers that are not whole in the code stay so, since ROS keeps types apart."""
    return f"{value:.1e}" if isinstance(value, float) and abs(value) >= 1e6 else json.dumps(value)


def _comment(option: NodeOption) -> str:
    told = [f"in {option.unit}" if option.unit else "", allowed(option), WORDS[option.when]]
    text = f"{option.sentence} ({'; '.join(filter(None, told))})"
    return textwrap.fill(text, 112, initial_indent="    # ", subsequent_indent="    # ")


def params_file() -> str:
    """The content."""
    parts = [HEAD.rstrip()]
    for node, options in NODES.items():
        parts.append(f"\n/**/{node}:\n  ros__parameters:")
        parts += [f"{_comment(option)}\n    {name}: {_written(option.default)}" for name, option in options.items()]
    return "\n".join(parts) + "\n"
