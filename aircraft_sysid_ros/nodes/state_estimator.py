"""Node of the first step: sensor topics in, reconstructed state and wind out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from aircraft_sysid_msgs.msg import AircraftState
from aircraft_sysid_msgs.srv import Reset
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.nodes.common import Option
from aircraft_sysid_ros.reconstruction.state import STATUS_TEXT, Column, Status
from aircraft_sysid_ros.reconstruction.state_estimator import (
    StateEstimator,
    StateOptions,
    nanoseconds,
    warm_up,
)
from aircraft_sysid_ros.recordings.output_messages import state_fields, wind_fields
from aircraft_sysid_ros.recordings.ros_conversion import TOPICS, message_fields, to_samples
from aircraft_sysid_ros.samples import concatenate

INPUTS = ("imu/data", "imu/mag", "gps/fix", "gps/vel", "air_data")
OPTIONS = {
    "horizon": Option("How late [s] a sample may come and still be fused at its own time.", 0.0, 5.0),
    "gate": Option("Innovations beyond this many sigma are rejected.", 2.0, 100.0),
    "maximum_iterations": Option("Cap on the iterations of one measurement update.", 1, 50),
    "tolerance": Option("The update has converged when it moves by less than this many sigma.", 1e-9, 1.0),
    "maximum_gap": Option(
        "Longest silence [s] of the IMU that is integrated; after more the filter aligns anew.", 0.05, 5.0
    ),
    "divergence_time": Option("GPS rejected for this long [s] without a break: align anew.", 1.0, 60.0),
}


class StateEstimatorNode(LifecycleNode):
    """Lifecycle node that owns a StateEstimator while it is configured."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("state_estimator", **arguments)
        common.declare_common(self)
        common.declare_options(self, StateOptions(), OPTIONS)
        self.estimator: StateEstimator | None = None
        self.received = dict.fromkeys(INPUTS, 0)
        self.rows_published = 0
        self.on_rows: Callable[[Any], None] | None = None  # `live --out` keeps the rows for the run folder
        self._inputs: list[Any] = []

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the aircraft file, compile, create publishers."""
        try:
            aircraft = common.configured_aircraft(self)
            self._quality = common.input_quality(self)
        except InputError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self.get_logger().info("preparing the filter; the first start compiles it, up to a minute")
        warm_up(aircraft)
        self.estimator = StateEstimator(aircraft, common.read_options(self, StateOptions, OPTIONS))
        quality = common.state_quality()
        self._state_publisher = self.create_lifecycle_publisher(AircraftState, "~/state", quality)
        self._wind_publisher = self.create_lifecycle_publisher(TwistWithCovarianceStamped, "~/wind", 10)
        self._diagnostics_publisher = self.create_lifecycle_publisher(DiagnosticArray, "/diagnostics", 10)
        self._offered = [self.create_service(Reset, "~/reset", self._on_reset)]
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen."""
        self._process_times = common.process_times()
        for topic in INPUTS:
            kind, receive = common.message_class(TOPICS[topic]), partial(self._on_message, topic)
            self._inputs.append(self.create_subscription(kind, topic, receive, self._quality))
        self._timer = self.create_timer(common.DIAGNOSTICS_PERIOD, self._publish_diagnostics)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop listening; publish what was held back."""
        self.finish()
        for subscription in self._inputs:
            self.destroy_subscription(subscription)
        self._inputs.clear()
        self.destroy_timer(self._timer)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the flight."""
        publishers = (self._state_publisher, self._wind_publisher, self._diagnostics_publisher)
        common.stop_offering(self, publishers, self._offered)
        self.estimator = None
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, from whatever state."""
        return self.on_deactivate(state) if self._inputs else TransitionCallbackReturn.SUCCESS

    def finish(self) -> None:
        """Publish the states that still wait for late samples."""
        if self.estimator is not None:
            self._publish(self.estimator.flush())

    def _on_message(self, topic: str, message: Any) -> None:
        assert self.estimator is not None
        self.received[topic] += 1
        samples = to_samples(topic, *message_fields(topic, message))
        if samples:
            self._publish(self.estimator.push(concatenate(samples)))

    def _publish(self, rows: Any) -> None:
        if not len(rows):
            return
        assert self.estimator is not None and self.estimator.epoch is not None
        self.rows_published += len(rows)
        if self.on_rows is not None:
            self.on_rows(rows)
        stamps = nanoseconds(rows[:, Column.TIME], self.estimator.epoch)
        fields, wind = state_fields(rows), wind_fields(rows[-1:])
        for i, stamp in enumerate(stamps):
            content = {name: _plain(values[i]) for name, values in fields.items()}
            message = common.fill(AircraftState(), content)
            message.status_text = STATUS_TEXT[message.status]
            self._state_publisher.publish(common.stamp_of(message, int(stamp)))
        self._publish_wind(wind, int(stamps[-1]))

    def _publish_wind(self, wind: dict[str, Any], stamp: int) -> None:
        message = TwistWithCovarianceStamped()
        for part in ("linear", "angular"):
            vector = getattr(message.twist.twist, part)
            vector.x, vector.y, vector.z = (float(v) for v in wind[f"twist.twist.{part}"][0])
        message.twist.covariance = wind["twist.covariance"][0]
        self._wind_publisher.publish(common.stamp_of(message, stamp))

    def _publish_diagnostics(self) -> None:
        assert self.estimator is not None
        times = common.process_times()
        values: dict[str, Any] = {"cpu_share": f"{common.cpu_share(self._process_times, times):.3f}"}
        self._process_times = times
        for kind, counts in self.estimator.counts().items():
            values.update({f"{kind}.{name}": n for name, n in counts.items() if n})
        values["realignments"] = self.estimator.realignments
        values["restarts"] = self.estimator.order.counts.restarts
        status = self.estimator.status
        level = DiagnosticStatus.OK[0] if status == Status.OK else DiagnosticStatus.WARN[0]
        text = STATUS_TEXT[status] or "ok"
        self._diagnostics_publisher.publish(common.diagnostics(self, level, text, values))

    def _on_reset(self, _request: Reset.Request, response: Reset.Response) -> Reset.Response:
        assert self.estimator is not None
        self.estimator = StateEstimator(self.estimator.aircraft, self.estimator.options)
        response.success, response.message = True, "the state starts anew"
        return response


def _plain(value: Any) -> Any:
    """Python numbers for scalar fields; arrays stay."""
    return value if isinstance(value, np.ndarray) else value.item()


def main() -> None:
    """Executable ``state_estimator``."""
    sys.exit(common.run_node(StateEstimatorNode))


if __name__ == "__main__":
    main()
