"""Node beside PX4 without MAVLink: topics of the uXRCE-DDS agent (px4_msgs) onto our input topics.

px4_msgs is found when the node is configured, as the classes of any package are. A topic is heard as soon as somebody
publishes it; of one message in several versions the one that the px4_msgs here define.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.exceptions import InvalidTopicNameException
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.validate_full_topic_name import validate_full_topic_name

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.px4_listener import FMU_OUT, PACKAGE, Px4Listener, named, wanted_fields
from aircraft_sysid_ros.mavlink.px4_table import PX4
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.nodes.bridge_topics import BridgeTopics, check_topics, servo_mapping, servo_options
from aircraft_sysid_ros.nodes.options import AUTOSTART, ConfigurableNode, NodeOption, When

#: The agent publishes best effort; so many messages of a topic may wait.
_QUALITY = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
#: Period [s] of looks for topics that have appeared.
_LOOK = 0.5
_of_topics = partial(NodeOption, fixed="the topics are heard with it", when=When.CONFIGURED)
OPTIONS: dict[str, NodeOption] = {
    "prefix": _of_topics(
        FMU_OUT,
        "Where the agent publishes, relative to the node's namespace; with a leading / from the root: /px4_1/fmu/out.",
    ),
    **servo_options(_of_topics),
    "topics": _of_topics([""], "Publish these topics only, such as air_data; empty: all.", check=check_topics),
    "autostart": AUTOSTART,
}


class Px4BridgeNode(ConfigurableNode):
    """Lifecycle node; hears topics of PX4 while it is active."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("px4_bridge", OPTIONS, **arguments)
        self.link: Px4Listener | None = None
        self.failure: InputError | None = None  # for who started the node in this process
        self._topics: BridgeTopics | None = None
        self._heard: dict[str, Any] = {}  # subscriptions by topic
        self._refused: set[str] = set()

    # -- lifecycle -------------------------------------------------------------------------------------------

    def configure(self, values: Mapping[str, Any]) -> None:
        """Find the messages, read the calibration, create publishers."""
        try:
            self._prefix = whole_prefix(self.get_namespace(), values["prefix"])
            check_definitions()
        except InputError as error:
            self.failure = error
            raise
        mapping = servo_mapping(values, self.get_logger().warning)
        self.link = Px4Listener(mapping, lambda: self.get_clock().now().nanoseconds)
        self._topics = BridgeTopics(self, values["topics"], mapping)
        self._diagnostics = self.create_lifecycle_publisher(DiagnosticArray, "/diagnostics", 10)

    def activate(self) -> None:
        """Hear what is there, and what appears."""
        self._process_times = common.process_times()
        self._refused.clear()
        self.get_logger().info(f"active, and hears what PX4 publishes under {self._prefix}")
        self._look()
        self._timers = [
            common.steady_timer(self, _LOOK, self._look),
            common.steady_timer(self, common.DIAGNOSTICS_PERIOD, self._publish_diagnostics),
        ]

    def deactivate(self, left: Callable[[int], None]) -> None:
        """Hear no more."""
        for timer in self._timers:
            self.destroy_timer(timer)
        for subscription in self._heard.values():
            self.destroy_subscription(subscription)
        self._heard.clear()

    def forget(self) -> None:
        """Forget the vehicle."""
        if self._topics is not None:
            self._topics.close()
        self.destroy_lifecycle_publisher(self._diagnostics)
        self.link = self._topics = None

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, from whatever state."""
        self.end()
        return TransitionCallbackReturn.SUCCESS

    # -- topics ----------------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Hear topics of PX4 that have appeared."""
        for topic, kinds in self.get_topic_names_and_types():
            folder, _, _ = topic.rpartition("/")
            name, version = named(topic)
            new = topic not in self._heard and topic not in self._refused
            if folder == self._prefix and name in PX4 and new and self.count_publishers(topic):
                self._hear(topic, name, version, kinds)

    def _hear(self, topic: str, name: str, version: int, kinds: list[str]) -> None:
        why, kind = "", None
        try:
            kind = common.message_class(kinds[0])
        except (ImportError, AttributeError, ValueError):
            why = f"{kinds[0]} is not in the {PACKAGE} of this environment"
        ours = getattr(kind, "MESSAGE_VERSION", 0)
        if kind is not None and ours != version:
            why = f"it is version {version} of {kinds[0]}, and the {PACKAGE} of this environment have version {ours}"
        if why:
            self._refused.add(topic)
            remedy = "take the branch of the firmware's release, or run PX4's translation node"
            self.get_logger().error(f"{topic} is not heard: {why}: {remedy}")
            return
        fields = wanted_fields(name) & set(kind.get_fields_and_field_types())  # type: ignore[union-attr]
        receive = partial(self._receive, name, sorted(fields | _nested(name, kind)))
        self._heard[topic] = self.create_subscription(kind, topic, receive, _QUALITY)
        self.get_logger().info(f"hearing {topic}")

    def _receive(self, name: str, fields: list[str], message: Any) -> None:
        if self.link is None or self._topics is None:
            return
        content: dict[str, Any] = {}
        for field in fields:
            value = getattr(message, field)
            if isinstance(value, list) and value and hasattr(value[0], "esc_rpm"):
                content |= {f"{field}[{i}].esc_rpm": np.array([float(each.esc_rpm)]) for i, each in enumerate(value)}
            else:
                content[field] = np.array([value])
        for output in self.link.receive(name, content):
            self._topics.publish(output)
        for note in self.link.take_notes():
            self.get_logger().info(note)

    def _publish_diagnostics(self) -> None:
        if self.link is None:
            return
        times = common.process_times()
        values: dict[str, Any] = {"cpu_share": f"{common.cpu_share(self._process_times, times):.3f}"}
        self._process_times = times
        problem = self.link.condition
        level = DiagnosticStatus.WARN[0] if problem else DiagnosticStatus.OK[0]
        for name, value in self.link.summary().items():
            parts = value if isinstance(value, dict) else {"": value}
            values.update({f"{name}.{key}".rstrip("."): v for key, v in parts.items()})
        self._diagnostics.publish(common.diagnostics(self, level, problem or "ok", values))


def whole_prefix(namespace: str, prefix: str) -> str:
    """The prefix from the root; raises InputError for what no topic begins with."""
    name = prefix if prefix.startswith("/") else f"{namespace}/{prefix}"
    whole = "/" + "/".join(part for part in name.split("/") if part)
    try:
        validate_full_topic_name(f"{whole}/sensor_combined".replace("//", "/"))
    except InvalidTopicNameException as error:
        reason = str(error).splitlines()[0].removeprefix("Invalid topic name: ").rstrip(":")
        raise InputError(f"no topic begins with the prefix '{prefix}': {reason}") from None
    return whole.rstrip("/")


def check_definitions() -> None:
    """Raises InputError where there are no px4_msgs."""
    try:
        importlib.import_module(f"{PACKAGE}.msg")
    except ImportError:
        raise InputError(
            f"the package {PACKAGE} is not in this environment: build the branch of your firmware's release "
            "(github.com/PX4/px4_msgs) and source its workspace"
        ) from None


def _nested(name: str, kind: Any) -> set[str]:
    """Fields that hold the speeds of engines."""
    return {"esc"} & set(kind.get_fields_and_field_types()) if name == "esc_status" else set()


def main() -> None:
    """Executable ``px4_bridge``."""
    sys.exit(common.run_node(Px4BridgeNode))


if __name__ == "__main__":
    main()
