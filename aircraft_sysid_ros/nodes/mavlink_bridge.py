"""Node of the MAVLink side: an autopilot's messages onto our input topics; wind and parameters back to it."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from aircraft_sysid_msgs.msg import Parameter, Parameters
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.back_channel import BackChannel, Known, Wind
from aircraft_sysid_ros.mavlink.back_options import BackOptions
from aircraft_sysid_ros.mavlink.bridge import STEP, Bridge
from aircraft_sysid_ros.mavlink.session import Session
from aircraft_sysid_ros.mavlink.signing import load_key
from aircraft_sysid_ros.mavlink.transport import Transport, parse_address
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.nodes.bridge_topics import BridgeTopics, check_topics, listed, servo_mapping, servo_options
from aircraft_sysid_ros.nodes.options import AUTOSTART, ConfigurableNode, NodeOption, When, node_options
from aircraft_sysid_ros.option import options_of
from aircraft_sysid_ros.ros_messages.conversion import ned_from_enu
from aircraft_sysid_ros.spelling import did_you_mean

#: Topics that the node hears for the way back.
WIND, PARAMETERS = "state_estimator/wind", "parameter_estimator/parameters"


#: Time [s] after which it is said that no parameters come that could go back.
_PATIENCE = 20.0
#: Share of the packets from which on it is said that they are lost: a radio loses some.
_MUCH = 0.05
#: Options of what goes back begin with it.
_BACK = "back_"
_of_link = partial(NodeOption, fixed="the link is opened with it", when=When.CONFIGURED)
OPTIONS: dict[str, NodeOption] = {
    "connection": _of_link(
        "udp:0.0.0.0:14550",
        "udp:HOST:PORT listens; udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD.",
        check=parse_address,
    ),
    **servo_options(_of_link),
    "peer": _of_link("", "The only host that is heard on UDP; empty: whoever sends the vehicle's first heartbeat."),
    "signing_key_file": _of_link(
        "",
        "Path of the key of signed MAVLink, 64 hexadecimal digits or a passphrase; empty: nothing is signed.",
        check=lambda path: load_key(path) if path else None,
    ),
    "system": _of_link(0, "System id of the vehicle; 0 is the first that is heard.", low=0, high=255),
    "topics": _of_link([""], "Publish these topics only, such as air_data; empty: all.", check=check_topics),
    **{_BACK + name: each for name, each in node_options(BackOptions).items()},
    "autostart": AUTOSTART,
}
OPTIONS["back_parameters"] = replace(OPTIONS["back_parameters"], default=[""])  # ROS has no empty array of strings


class MavlinkBridgeNode(ConfigurableNode):
    """Lifecycle node; a thread of its own reads the link while it is active, so that arrivals are timed well."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("mavlink_bridge", OPTIONS, **arguments)
        self.bridge: Bridge | None = None
        self.failure: BaseException | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._topics: BridgeTopics | None = None
        self._heard: dict[str, Any] = {}
        self._unknown: list[str] = []  # parameters that are to go back and that the model does not have
        self._waits_since: float | None = None  # [s] for the first message of parameters; None: it does not

    @property
    def link(self) -> Session | None:
        """The session with the autopilot, while configured."""
        return None if self.bridge is None else self.bridge.session

    # -- lifecycle -------------------------------------------------------------------------------------------

    def configure(self, values: Mapping[str, Any]) -> None:
        """Read the calibration, open the connection, create publishers."""
        self.failure = None
        mapping = servo_mapping(values, self.get_logger().warning)
        transport = Transport(parse_address(values["connection"]), values["peer"])
        key = load_key(values["signing_key_file"]) if values["signing_key_file"] else None
        session = Session(mapping, values["system"] or None, key)
        back = BackChannel(_back_options(values))
        try:
            transport.open()
        except InputError as error:
            self.failure = error  # for who started the node in this process
            raise
        self._seen = (0, 0)  # packets that came and that are missing, at the last look
        self.bridge = Bridge(transport, session, back, lambda: self.get_clock().now().nanoseconds)
        self._topics = BridgeTopics(self, values["topics"], mapping)
        self._diagnostics = self.create_lifecycle_publisher(DiagnosticArray, "/diagnostics", 10)

    def check_together(self, values: Mapping[str, Any]) -> None:
        """What goes back must fit into its messages."""
        _back_options(values)

    def use_options(self, values: Mapping[str, Any]) -> None:
        """Send other things back, or at other rates, from now on."""
        if self.bridge is not None:
            self.bridge.back.options = _back_options(values)
            if self.is_active:
                self._hear(self.bridge.back.options)

    def activate(self) -> None:
        """Read the link; hear what goes back."""
        assert self.bridge is not None
        self._hear(self.bridge.back.options)
        self._timer = common.steady_timer(self, common.DIAGNOSTICS_PERIOD, self._publish_diagnostics)
        self._process_times = common.process_times()
        self.failure, self._stop = None, threading.Event()  # of this thread: the one before may hang, and ends then
        self._thread = threading.Thread(target=self._read, args=(self._stop,), name="mavlink", daemon=True)
        self._thread.start()
        self.get_logger().info(f"active, and reads {self.get_parameter('connection').value}")

    def deactivate(self, left: Callable[[int], None]) -> None:
        """Stop reading."""
        self._end_thread()
        for subscription in self._heard.values():
            self.destroy_subscription(subscription)
        self._heard.clear()
        self.destroy_timer(self._timer)

    def _hear(self, options: BackOptions) -> None:
        """Subscribe to what goes back, and to no more."""
        wanted: dict[str, tuple[Any, Any]] = {}
        if options.wind_rate > 0.0:
            wanted[WIND] = (TwistWithCovarianceStamped, self._on_wind)
        if options.parameters:
            wanted[PARAMETERS] = (Parameters, self._on_parameters)
        for topic in self._heard.keys() - wanted.keys():
            self.destroy_subscription(self._heard.pop(topic))
        self._unknown = []
        if PARAMETERS in wanted.keys() - self._heard.keys():
            self._waits_since = time.monotonic()
        for topic in wanted.keys() - self._heard.keys():
            kind, receive = wanted[topic]
            self._heard[topic] = self.create_subscription(kind, topic, receive, 10)

    def forget(self) -> None:
        """Close the connection."""
        if self._topics is not None:
            self._topics.close()
        self.destroy_lifecycle_publisher(self._diagnostics)
        self._close()

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, from whatever state."""
        self.end()
        self._close()
        return TransitionCallbackReturn.SUCCESS

    def destroy_node(self) -> None:
        """End the thread too."""
        self._end_thread()
        self._close()
        super().destroy_node()

    def _end_thread(self) -> None:
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=2.0)
            self._thread = None

    def _close(self) -> None:
        if self.bridge is not None:
            self.bridge.transport.close()
            self.bridge = None

    # -- the link --------------------------------------------------------------------------------------------

    def _read(self, stop: threading.Event) -> None:
        assert self.bridge is not None and self._topics is not None
        bridge, topics = self.bridge, self._topics
        try:
            while not stop.is_set():
                for output in bridge.step(STEP):
                    topics.publish(output)
                for note in bridge.session.take_notes():
                    self.get_logger().info(note)
        except Exception as error:  # a thread that dies in silence would look like a silent vehicle
            self.failure = error
            self.get_logger().fatal(f"the link failed: {' '.join(str(error).split())}")

    # -- back ------------------------------------------------------------------------------------------------

    def _on_wind(self, message: TwistWithCovarianceStamped) -> None:
        if self.bridge is None:
            return
        twist, covariance = message.twist.twist.linear, message.twist.covariance
        north, east, down = ned_from_enu(np.array([twist.x, twist.y, twist.z])).tolist()
        variance = (float(covariance[7]), float(covariance[0]), float(covariance[14]))
        self.bridge.back.wind = Wind((north, east, down), variance)

    def _on_parameters(self, message: Parameters) -> None:
        self._waits_since = None
        if self.bridge is not None:
            self._say_unknown([p.name for p in message.parameters])
            self.bridge.back.parameters = tuple(
                Known(p.name, p.value, p.standard_deviation, p.status == Parameter.USE) for p in message.parameters
            )

    def _say_unknown(self, names: Sequence[str]) -> None:
        """Which of the parameters that are to go back the model does not have; each time that they are others."""
        assert self.bridge is not None
        unknown = [name for name in self.bridge.back.options.parameters if name not in names]
        if unknown and unknown != self._unknown:
            hint = did_you_mean(unknown[0], names)
            words = f"the model has no parameter {' and no '.join(unknown)}: not sent back"
            self.get_logger().warning(f"{words}{hint and f'; {hint}'}")
        self._unknown = unknown

    def _say_nothing_comes(self, session: Session) -> None:
        """That no parameters have come that could go back, once, some time after the vehicle was heard."""
        now = time.monotonic()
        if self._waits_since is None:
            return
        if session.condition:
            self._waits_since = now
        elif now - self._waits_since > _PATIENCE:
            self._waits_since = None
            topic = self._heard[PARAMETERS].topic_name
            self.get_logger().warning(f"no parameters have come on {topic} yet, so that none are sent back")

    def _lost_in_words(self, session: Session) -> str:
        """That much of what the vehicle sent since the last look did not come."""
        before, self._seen = self._seen, (session.received.total(), session.missing)
        came, missing = (now - then for now, then in zip(self._seen, before, strict=True))
        share = missing / max(came + missing, 1)
        return f"{100.0 * share:.0f} % of the packets of the autopilot are lost on the way" if share > _MUCH else ""

    def _publish_diagnostics(self) -> None:
        if self.bridge is None:
            return
        session = self.bridge.session
        if PARAMETERS in self._heard:
            self._say_nothing_comes(session)
        times = common.process_times()
        share = common.cpu_share(self._process_times, times)
        self._process_times = times
        problems = (
            "the link failed" if self.failure else session.condition,
            session.outputs_condition,
            self._lost_in_words(session),
        )
        problem = "; ".join(part for part in problems if part)
        level = DiagnosticStatus.WARN[0] if problem else DiagnosticStatus.OK[0]
        foreign = self.bridge.transport.foreign
        values = {"cpu_share": f"{share:.3f}", "sent_back": self.bridge.back.sent, "foreign": foreign}
        for name, value in session.summary().items():
            parts = value if isinstance(value, dict) else {"": value}
            values.update({f"{name}.{key}".rstrip("."): v for key, v in parts.items()})
        self._diagnostics.publish(common.diagnostics(self, level, problem or "ok", values))


def _back_options(values: Mapping[str, Any]) -> BackOptions:
    found = {name: values[_BACK + name] for name in options_of(BackOptions)}
    return BackOptions(**found | {"parameters": tuple(listed(found["parameters"]))})


def main() -> None:
    """Executable ``mavlink_bridge``."""
    sys.exit(common.run_node(MavlinkBridgeNode))


if __name__ == "__main__":
    main()
