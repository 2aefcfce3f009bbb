"""What the bridges publish: messages of our topics from what an assembler gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from aircraft_sysid_msgs.msg import AirData, ControlSurfaces
from rclpy.qos import QoSProfile

from aircraft_sysid_ros.mavlink.assembler import ALL_TOPICS, KNOWN_TOPICS, Output, only_known_topics
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping, load_servo_mapping
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.nodes.options import NodeOption
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC

_VECTORS = {3: ("x", "y", "z"), 4: ("x", "y", "z", "w")}
_DEPTH = 100


def listed(values: Sequence[str]) -> list[str]:
    """Strings of a ROS array, which has one that is empty where there are none."""
    return [value for value in values if value]


def check_topics(topics: Sequence[str]) -> None:
    """Raises InputError for a topic that no bridge publishes."""
    only_known_topics(listed(topics), "the parameter topics names")


def servo_options(option: Callable[..., NodeOption]) -> dict[str, NodeOption]:
    """The parameters that name the file of the servos, by its name and by the one that `calibrate` writes has, too."""
    return {
        "servo_file": option(
            "", "Path of the file that says which output turns which surface (YAML); without one, no control surfaces.",
            check=_check_mapping,
        ),
        "calibration_file": option("", "The old name of servo_file.", check=_check_mapping),
    }  # fmt: skip


def _check_mapping(path: str) -> None:
    if path:
        load_servo_mapping(path)


def servo_mapping(values: Mapping[str, Any], warn: Callable[[str], Any]) -> ServoMapping:
    """What ``servo_options`` name; raises InputError where it cannot be read."""
    if values["calibration_file"]:
        warn("calibration_file of a bridge is now called servo_file: it is another file than the one of the estimators")
    path = values["servo_file"] or values["calibration_file"]
    return load_servo_mapping(path) if path else ServoMapping()


class BridgeTopics:
    """Publishers of a node, from its configuration to its cleanup."""

    def __init__(self, node: Any, topics: Sequence[str], mapping: ServoMapping) -> None:
        """``topics``: these alone; empty: all that there may be."""
        self._node = node
        self.names = set(listed(topics)) or {*ALL_TOPICS, *([INPUTS_TOPIC] if mapping.inputs else [])}
        self._made = {
            topic: node.create_lifecycle_publisher(
                common.message_class(KNOWN_TOPICS[topic]), topic, QoSProfile(depth=_DEPTH)
            )
            for topic in sorted(self.names)
        }

    def publish(self, output: Output) -> None:
        """The messages of an output, if its topic is among those."""
        if output.topic not in self.names:
            return
        for i, stamp in enumerate(output.stamp):
            message = common.message_class(output.type_name)()
            if isinstance(message, (AirData, ControlSurfaces)):
                _forget_numbers(message)
            for name, column in output.fields.items():
                _set(message, name, column[i])
            message.header.frame_id = output.frame_id
            self._made[output.topic].publish(common.stamp_of(message, int(stamp)))

    def close(self) -> None:
        """Publish no more."""
        for publisher in self._made.values():
            self._node.destroy_lifecycle_publisher(publisher)
        self._made.clear()


def _forget_numbers(message: Any) -> None:
    """In our own messages what is not measured is NaN, and ROS begins with 0."""
    for name, kind in message.get_fields_and_field_types().items():
        if kind == "double":
            setattr(message, name, float("nan"))


def _set(message: Any, name: str, value: Any) -> None:
    """Set a field by its dotted name; a row of 3 or 4 goes into a vector or quaternion."""
    *path, last = name.split(".")
    for part in path:
        message = getattr(message, part)
    target = getattr(message, last)
    if np.ndim(value) == 1 and hasattr(target, "x"):
        for axis, component in zip(_VECTORS[len(value)], value, strict=True):
            setattr(target, axis, float(component))
    elif np.ndim(value) and not isinstance(target, np.ndarray):  # of any length: a list
        setattr(message, last, value.tolist())
    else:
        setattr(message, last, value if np.ndim(value) else value.item())
