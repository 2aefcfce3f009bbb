"""Node of the MAVLink side: an autopilot's messages onto our input topics; wind and parameters back to it."""

from __future__ import annotations

import sys
import threading
from typing import Any

import numpy as np
from aircraft_sysid_msgs.msg import AirData, ControlSurfaces, Parameter, Parameters
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TwistWithCovarianceStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.assembler import ALL_TOPICS, Output
from aircraft_sysid_ros.mavlink.back_channel import BackChannel, BackOptions, Known, Wind
from aircraft_sysid_ros.mavlink.bridge import STEP, Bridge
from aircraft_sysid_ros.mavlink.calibration import Calibration, load_calibration
from aircraft_sysid_ros.mavlink.session import Session
from aircraft_sysid_ros.mavlink.transport import Transport, parse_address
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.recordings.ros_conversion import ned_from_enu

#: Topics that the node hears for the way back.
WIND, PARAMETERS = "state_estimator/wind", "parameter_estimator/parameters"
_VECTORS = {3: ("x", "y", "z"), 4: ("x", "y", "z", "w")}
_DEPTH = 100
_PARAMETERS: dict[str, tuple[Any, str]] = {
    "connection": ("udp:0.0.0.0:14550", "udp:HOST:PORT listens; udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD."),
    "calibration_file": ("", "Path of the calibration file (YAML); without one, no control surfaces."),
    "system": (0, "System id of the vehicle; 0 is the first that is heard."),
    "topics": ([""], "Publish these topics only, such as air_data; empty: all."),
    "back_parameters": ([""], "Names of the parameters to send to the autopilot."),
    "back_form": ("named", "named: NAMED_VALUE_FLOAT; array: DEBUG_FLOAT_ARRAY with their standard errors."),
    "back_wind_rate": (1.0, "Rate [Hz] of WIND_COV; 0: none."),
    "back_parameter_rate": (1.0, "Rate [Hz] of the parameters; 0: none."),
    "autostart": (True, "Configure and activate at the start, without a manager."),
}


class MavlinkBridgeNode(LifecycleNode):
    """Lifecycle node; a thread of its own reads the link while it is active, so that arrivals are timed well."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("mavlink_bridge", **arguments)
        for name, (default, text) in _PARAMETERS.items():
            self.declare_parameter(name, default, ParameterDescriptor(description=text))
        self.bridge: Bridge | None = None
        self.failure: BaseException | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._topics: set[str] = set()
        self._made: dict[str, Any] = {}
        self._heard: list[Any] = []

    def _value(self, name: str) -> Any:
        value = self.get_parameter(name).value
        return [item for item in value if item] if isinstance(value, (list, tuple)) else value

    # -- lifecycle -------------------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the calibration, open the connection, create publishers."""
        try:
            self._make_bridge()
        except InputError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        for topic in sorted(self._topics):
            kind = common.message_class(ALL_TOPICS[topic])
            self._made[topic] = self.create_lifecycle_publisher(kind, topic, QoSProfile(depth=_DEPTH))
        self._diagnostics = self.create_lifecycle_publisher(DiagnosticArray, "/diagnostics", 10)
        return TransitionCallbackReturn.SUCCESS

    def _make_bridge(self) -> None:
        path = self._value("calibration_file")
        calibration = load_calibration(path) if path else Calibration()
        topics = set(self._value("topics"))
        for topic in topics - ALL_TOPICS.keys():
            raise InputError(f"the parameter topics names {topic}: known are {', '.join(ALL_TOPICS)}")
        options = BackOptions(
            tuple(self._value("back_parameters")), self._value("back_form"),
            float(self._value("back_wind_rate")), float(self._value("back_parameter_rate")),
        )  # fmt: skip
        back, transport = BackChannel(options), Transport(parse_address(self._value("connection")))
        session = Session(calibration, self._value("system") or None)
        transport.open()
        self.bridge = Bridge(transport, session, back, lambda: self.get_clock().now().nanoseconds)
        self._topics = topics or set(ALL_TOPICS)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the link; hear what goes back."""
        result = super().on_activate(state)
        if self._value("back_wind_rate") > 0.0:
            self._heard.append(self.create_subscription(TwistWithCovarianceStamped, WIND, self._on_wind, 10))
        if self._value("back_parameters"):
            self._heard.append(self.create_subscription(Parameters, PARAMETERS, self._on_parameters, 10))
        self._timer = self.create_timer(common.DIAGNOSTICS_PERIOD, self._publish_diagnostics)
        self._process_times = common.process_times()
        self._stop.clear()
        self._thread = threading.Thread(target=self._read, name="mavlink", daemon=True)
        self._thread.start()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop reading."""
        self._end_thread()
        for subscription in self._heard:
            self.destroy_subscription(subscription)
        self._heard.clear()
        self.destroy_timer(self._timer)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the connection."""
        for publisher in (*self._made.values(), self._diagnostics):
            self.destroy_lifecycle_publisher(publisher)
        self._made.clear()
        self._close()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, from whatever state."""
        self._end_thread()
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

    def _read(self) -> None:
        assert self.bridge is not None
        bridge = self.bridge
        try:
            while not self._stop.is_set():
                for output in bridge.step(STEP):
                    if output.topic in self._topics:
                        self._publish(output)
                for note in bridge.session.take_notes():
                    self.get_logger().info(note)
        except Exception as error:  # a thread that dies in silence would look like a silent vehicle
            self.failure = error
            self.get_logger().fatal(f"the link failed: {' '.join(str(error).split())}")

    def _publish(self, output: Output) -> None:
        for i, stamp in enumerate(output.stamp):
            message = common.message_class(output.type_name)()
            if isinstance(message, (AirData, ControlSurfaces)):
                _forget_numbers(message)
            for name, column in output.fields.items():
                _set(message, name, column[i])
            message.header.frame_id = output.frame_id
            self._made[output.topic].publish(common.stamp_of(message, int(stamp)))

    # -- back ------------------------------------------------------------------------------------------------

    def _on_wind(self, message: TwistWithCovarianceStamped) -> None:
        if self.bridge is None:
            return
        twist, covariance = message.twist.twist.linear, message.twist.covariance
        north, east, down = ned_from_enu(np.array([twist.x, twist.y, twist.z])).tolist()
        variance = (float(covariance[7]), float(covariance[0]), float(covariance[14]))
        self.bridge.back.wind = Wind((north, east, down), variance)

    def _on_parameters(self, message: Parameters) -> None:
        if self.bridge is not None:
            self.bridge.back.parameters = tuple(
                Known(p.name, p.value, p.standard_deviation, p.status == Parameter.USE) for p in message.parameters
            )

    def _publish_diagnostics(self) -> None:
        if self.bridge is None:
            return
        session = self.bridge.session
        times = common.process_times()
        share = common.cpu_share(self._process_times, times)
        self._process_times = times
        problem = "the link failed" if self.failure else session.condition
        level = DiagnosticStatus.WARN[0] if problem else DiagnosticStatus.OK[0]
        values = {"cpu_share": f"{share:.3f}", "sent_back": self.bridge.back.sent}
        for name, value in session.summary().items():
            parts = value if isinstance(value, dict) else {"": value}
            values.update({f"{name}.{key}".rstrip("."): v for key, v in parts.items()})
        self._diagnostics.publish(common.diagnostics(self, level, problem or "ok", values))


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
    else:
        setattr(message, last, value if np.ndim(value) else value.item())


def main() -> None:
    """Executable ``mavlink_bridge``."""
    sys.exit(common.run_node(MavlinkBridgeNode))


if __name__ == "__main__":
    main()
