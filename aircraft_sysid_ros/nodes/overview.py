"""Node that sums up one aeroplane for rqt and Foxglove: state, sensors, parameters, model, as one tree of diagnostics.

It hears what both estimators publish and the diagnostics of its own namespace, and publishes ``/diagnostics_agg`` and
``/diagnostics_toplevel_state``, the topics of diagnostic_aggregator, once a second.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

from aircraft_sysid_msgs.msg import AircraftState, MissingEffects, ModelError, Parameters
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy

from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.nodes.options import AUTOSTART, ConfigurableNode, NodeOption, When
from aircraft_sysid_ros.nodes.overview_content import (
    OK,
    STALE,
    Leaf,
    absent_leaf,
    missing_leaf,
    model_leaves,
    node_leaf,
    parameter_leaves,
    sensor_leaves,
    state_leaf,
    tree,
)

AGGREGATED, TOP_LEVEL = "/diagnostics_agg", "/diagnostics_toplevel_state"
OPTIONS: dict[str, NodeOption] = {
    "name": NodeOption(
        "",
        "Name of the aircraft at the root of the tree; empty: the node's namespace, or aeroplane.",
        fixed="what was published stands under it",
        when=When.CONFIGURED,
    ),
    "patience": NodeOption(3.0, "Time without a message after which a status is stale.", "s", 0.5, 60.0),
    "autostart": AUTOSTART,
}
STATE_NODE = "state_estimator"
MISSING = "parameter_estimator/missing_effects"
#: An aeroplane has them; others, such as a bridge, are shown where they are.
EXPECTED = (STATE_NODE, "parameter_estimator")


class OverviewNode(ConfigurableNode):
    """Lifecycle node; remembers the newest of each topic."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("overview", OPTIONS, **arguments)
        self._leaves: dict[str, tuple[float, list[Leaf]]] = {}  # by topic or node: when it came, and what it says
        self._counts: dict[str, str] = {}  # of the samples, at the newest diagnostics of the first step
        self._found = self._verdict = ""  # on missing effects: in the newest message, and in the newest diagnostics

    def configure(self, values: Mapping[str, Any]) -> None:
        """Create publishers."""
        self._aeroplane = values["name"].strip("/") or self.get_namespace().strip("/") or "aeroplane"
        self._aggregated = self.create_lifecycle_publisher(DiagnosticArray, AGGREGATED, 10)
        self._top = self.create_lifecycle_publisher(DiagnosticStatus, TOP_LEVEL, 10)

    def activate(self) -> None:
        """Listen, and sum up once a second."""
        self._leaves.clear()
        self._counts.clear()
        self._found = self._verdict = ""
        self._began = time.monotonic()
        newest = common.newest_quality()
        sensor = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._heard = [
            self.create_subscription(kind, topic, self._keeper(topic, said), quality)
            for kind, topic, said, quality in (
                (AircraftState, "state_estimator/state", lambda m: [state_leaf(m)], sensor),
                (Parameters, "parameter_estimator/parameters", parameter_leaves, newest),
                (ModelError, "parameter_estimator/model_error", model_leaves, 10),
                (MissingEffects, MISSING, self._on_finding, newest),
            )
        ]
        self._heard.append(self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100))
        self._timer = common.steady_timer(self, common.DIAGNOSTICS_PERIOD, self.sum_up)
        self.get_logger().info(f"active, and sums up {self._aeroplane} on {AGGREGATED}")

    def deactivate(self, left: Callable[[int], None]) -> None:
        """Listen no more."""
        for subscription in self._heard:
            self.destroy_subscription(subscription)
        self.destroy_timer(self._timer)

    def forget(self) -> None:
        """Destroy the publishers."""
        for publisher in (self._aggregated, self._top):
            self.destroy_lifecycle_publisher(publisher)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, from whatever state."""
        self.end()
        return TransitionCallbackReturn.SUCCESS

    # -- in and out ------------------------------------------------------------------------------------------

    def _keeper(self, topic: str, said: Callable[[Any], list[Leaf]]) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            self._leaves[topic] = (time.monotonic(), said(message))

        return keep

    def _on_finding(self, message: MissingEffects) -> list[Leaf]:
        self._found = message.verdict
        return [missing_leaf(message)]

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Statuses of nodes in this namespace; those of the first step count its samples."""
        namespace = self.get_namespace().strip("/")
        for status in message.status:
            folder, _, name = status.name.strip("/").rpartition("/")
            if folder != namespace:
                continue
            values = {each.key: each.value for each in status.values}
            leaves = [node_leaf(name, status.level[0], status.message, values)]
            if name == STATE_NODE:
                leaves += sensor_leaves(values, self._counts)
                self._counts = values
            self._verdict = values.get("missing_effects", self._verdict)
            self._leaves[f"diagnostics of {name}"] = (time.monotonic(), leaves)

    def sum_up(self) -> None:
        """Publish the tree, and its root for lamps that show one colour."""
        oldest = time.monotonic() - self.get_parameter("patience").value
        absent = EXPECTED if self._began < oldest else ()
        leaves = {leaf.path: leaf for leaf in map(absent_leaf, absent)}
        leaves |= {leaf.path: _aged(leaf, came < oldest) for came, said in self._leaves.values() for leaf in said}
        if self._verdict not in ("", self._found):  # found for another model, or by a node that was started again
            leaves["missing effects"] = Leaf("missing effects", OK, self._verdict)
        statuses = [_status(leaf) for leaf in tree(leaves.values(), self._aeroplane)]
        message = common.stamp_of(DiagnosticArray(status=statuses), self.get_clock().now().nanoseconds)
        self._aggregated.publish(message)
        self._top.publish(statuses[0])


def _aged(leaf: Leaf, is_old: bool) -> Leaf:
    """What has not come for long is stale; what comes seldom, the search for missing effects, never is."""
    if not is_old or leaf.path == "missing effects":
        return leaf
    return Leaf(leaf.path, STALE, f"nothing comes; it was: {leaf.message}", leaf.values)


def _status(leaf: Leaf) -> DiagnosticStatus:
    values = [KeyValue(key=key, value=value) for key, value in leaf.values.items()]
    return DiagnosticStatus(
        level=bytes([leaf.level]), name=leaf.path, message=leaf.message, hardware_id="aircraft_sysid_ros", values=values
    )


def main() -> None:
    """Executable ``overview``."""
    sys.exit(common.run_node(OverviewNode))


if __name__ == "__main__":
    main()
