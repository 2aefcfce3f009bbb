"""Node of the second step: reconstructed state and controls in, aerodynamic parameters out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from aircraft_sysid_msgs.msg import AircraftState, AxisError, ModelError, Parameter, Parameters
from aircraft_sysid_msgs.srv import LoadModel, Reset, SaveModel
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.modelling import error_window as modelling
from aircraft_sysid_ros.modelling.model_file import load_model, save_model
from aircraft_sysid_ros.modelling.parameter_estimator import ParameterEstimator, ParameterOptions
from aircraft_sysid_ros.modelling.parameter_set import ParameterSet
from aircraft_sysid_ros.modelling.trust import Trust
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.nodes.common import Option
from aircraft_sysid_ros.reconstruction.state import Column
from aircraft_sysid_ros.reconstruction.state_estimator import epoch_of, nanoseconds, seconds
from aircraft_sysid_ros.recordings.output_messages import (
    model_error_content,
    parameters_content,
    row_from_state,
)
from aircraft_sysid_ros.recordings.ros_conversion import TOPICS, message_fields, to_samples

INPUTS = ("control_surfaces", "height_above_ground", "mass_properties")
OPTIONS = {
    "half_width": Option("Half-width [s] of the differentiating window: its delay.", 0.01, 1.0),
    "step": Option("Time [s] between evaluations.", 0.005, 1.0),
    "forgetting_time": Option("Seconds of motion that the estimates rest on.", 1.0, 1e6),
    "excitation": Option("How many sigma of its noise a term must move before its axis learns.", 0.0, 100.0),
    "settle": Option("How much later [s] than the state a control sample may come.", 0.0, 5.0),
    "largest_gap": Option("Longest time [s] between states inside a window.", 0.01, 1.0),
    "lag_time": Option("Time [s] over which residuals may be correlated.", 0.1, 10.0),
    "error_window": Option("Length [s] of the sliding window of the model error.", 1.0, 600.0),
}
#: Time of flight [s] between messages of parameters and of model error.
PERIOD = 1.0


class ParameterEstimatorNode(LifecycleNode):
    """Lifecycle node that owns a ParameterEstimator while it is configured."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("parameter_estimator", **arguments)
        common.declare_common(self)
        common.declare_options(self, ParameterOptions(), OPTIONS)
        self.estimator: ParameterEstimator | None = None
        self.received = dict.fromkeys(INPUTS, 0)
        self.states_received = 0
        self.on_points: Callable[[Any], None] | None = None  # `live --out` keeps both for the run folder
        self.on_parameters: Callable[[Any, Any], None] | None = None
        self.newest_state = -np.inf
        self._epoch: int | None = None
        self._inputs: list[Any] = []
        self._due = -np.inf

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the aircraft file, create publishers and services."""
        try:
            aircraft = common.configured_aircraft(self)
            self._quality = common.input_quality(self)
        except InputError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self.estimator = ParameterEstimator(aircraft, common.read_options(self, ParameterOptions, OPTIONS))
        self.estimator.warm_up()
        self._parameters_publisher = self.create_lifecycle_publisher(Parameters, "~/parameters", 10)
        self._model_error_publisher = self.create_lifecycle_publisher(ModelError, "~/model_error", 10)
        self._diagnostics_publisher = self.create_lifecycle_publisher(DiagnosticArray, "/diagnostics", 10)
        self._offered = [
            self.create_service(Reset, "~/reset", self._on_reset),
            self.create_service(SaveModel, "~/save_model", self._on_save),
            self.create_service(LoadModel, "~/load_model", self._on_load),
        ]
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen."""
        self._process_times = common.process_times()
        listen = self.create_subscription
        for topic in INPUTS:
            kind, receive = common.message_class(TOPICS[topic]), partial(self._on_message, topic)
            self._inputs.append(listen(kind, topic, receive, self._quality))
        quality = common.state_quality()
        self._inputs.append(listen(AircraftState, "state_estimator/state", self._on_state, quality))
        self._timer = self.create_timer(common.DIAGNOSTICS_PERIOD, self._publish_diagnostics)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop listening; use what was held back."""
        self.finish()
        for subscription in self._inputs:
            self.destroy_subscription(subscription)
        self._inputs.clear()
        self.destroy_timer(self._timer)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the flight."""
        publishers = (self._parameters_publisher, self._model_error_publisher, self._diagnostics_publisher)
        common.stop_offering(self, publishers, self._offered)
        self.estimator = self._epoch = None
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, from whatever state."""
        return self.on_deactivate(state) if self._inputs else TransitionCallbackReturn.SUCCESS

    def finish(self) -> None:
        """Learn from the states that still wait for controls, and publish the result."""
        if self.estimator is not None and self._epoch is not None:
            self._due = -np.inf
            self._take(self.estimator.flush())
            self._publish_due()

    def _on_message(self, topic: str, message: Any) -> None:
        assert self.estimator is not None
        self.received[topic] += 1
        stamp, fields = message_fields(topic, message)
        if self._epoch is None:
            self._epoch = epoch_of(int(stamp[0]))
        for samples in to_samples(topic, stamp, fields):
            self.estimator.push_samples(samples, self._epoch)

    def _on_state(self, message: AircraftState) -> None:
        assert self.estimator is not None
        self.states_received += 1
        time = message.header.stamp
        stamp = np.array([time.sec * common.NANOSECONDS + time.nanosec], dtype=np.int64)
        if self._epoch is None:
            self._epoch = epoch_of(int(stamp[0]))
        row = row_from_state(message, float(seconds(stamp, self._epoch)[0]))
        self.newest_state = float(row[0, Column.TIME])
        self._take(self.estimator.push_states(row))
        self._publish_due()

    def _take(self, points: Any) -> None:
        if self.on_points is not None and len(points):
            self.on_points(points)

    def _publish_due(self) -> None:
        """Publish when the time of flight says so, so that playback at any speed gives the same messages."""
        assert self.estimator is not None
        if self.estimator.newest_point is None:
            return
        now = float(self.estimator.newest_point[0])
        if not self._due - PERIOD <= now < self._due:
            self._due = now + PERIOD
            estimates, errors = self.estimator.snapshot(), self.estimator.model_error()
            if self.on_parameters is not None:
                self.on_parameters(estimates, errors)
            self._publish_parameters(now, estimates)
            self._publish_model_error(now, errors)

    def _stamp(self, time: float) -> int:
        assert self._epoch is not None
        return int(nanoseconds(np.array(time), self._epoch))

    def _publish_parameters(self, now: float, estimates: ParameterSet) -> None:
        content = parameters_content(estimates)
        content["parameters"] = [Parameter(**p) for p in content["parameters"]]
        message = common.stamp_of(common.fill(Parameters(), content), self._stamp(now))
        self._parameters_publisher.publish(message)

    def _publish_model_error(self, now: float, errors: list[modelling.AxisError]) -> None:
        assert self.estimator is not None
        estimator = self.estimator
        content = model_error_content(estimator.model.identifier, estimator.options.error_window, errors)
        content["axes"] = [AxisError(**axis) for axis in content["axes"]]
        message = common.stamp_of(common.fill(ModelError(), content), self._stamp(now))
        self._model_error_publisher.publish(message)

    def _publish_diagnostics(self) -> None:
        assert self.estimator is not None
        times = common.process_times()
        values: dict[str, Any] = {"cpu_share": f"{common.cpu_share(self._process_times, times):.3f}"}
        self._process_times = times
        values["states_received"] = self.states_received
        values["controls_received"] = self.received["control_surfaces"]
        values["controls_late"] = self.estimator.late
        statuses = [p.status for p in self.estimator.snapshot().parameters]
        values.update({trust.name: statuses.count(trust) for trust in Trust})
        learning = self.estimator.newest_point is not None
        level = DiagnosticStatus.OK[0] if learning else DiagnosticStatus.WARN[0]
        text = "ok" if learning else "waiting for states in flight"
        self._diagnostics_publisher.publish(common.diagnostics(self, level, text, values))

    def _on_reset(self, _request: Reset.Request, response: Reset.Response) -> Reset.Response:
        assert self.estimator is not None
        self.estimator.reset()
        response.success, response.message = True, "the parameters start anew"
        return response

    def _on_save(self, request: SaveModel.Request, response: SaveModel.Response) -> SaveModel.Response:
        assert self.estimator is not None
        try:
            if not request.path:
                raise InputError("the path is empty: give that of the file to write")
            save_model(self.estimator, request.path)
            response.success, response.message = True, f"written to {request.path}"
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_load(self, request: LoadModel.Request, response: LoadModel.Response) -> LoadModel.Response:
        assert self.estimator is not None
        try:
            response.model = load_model(self.estimator, request.path)
            response.success, response.message = True, f"read from {request.path}"
        except InputError as error:
            response.success, response.message = False, str(error)
        return response


def main() -> None:
    """Executable ``parameter_estimator``."""
    sys.exit(common.run_node(ParameterEstimatorNode))


if __name__ == "__main__":
    main()
