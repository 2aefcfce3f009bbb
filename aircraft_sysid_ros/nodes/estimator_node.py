"""What both nodes are: lifecycle nodes that own an estimator while configured and listen while active."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.recordings.ros_conversion import TOPICS


class EstimatorNode(LifecycleNode):
    """Lifecycle, inputs, diagnostics; a node adds its estimator and what it publishes."""

    def __init__(
        self,
        name: str,
        inputs: tuple[str, ...],
        defaults: Any,
        options: Mapping[str, common.Option | common.Choice],
        **arguments: Any,
    ) -> None:
        super().__init__(name, **arguments)
        common.declare_common(self)
        common.declare_options(self, defaults, options)
        self.estimator: Any = None
        self.received = dict.fromkeys(inputs, 0)
        self.numerical_faults = 0
        self._option_kind, self._described = type(defaults), options
        self._offered_publishers: list[Any] = []
        self._offered_services: list[Any] = []
        self._heard: list[Any] = []

    # -- what a node adds ------------------------------------------------------------------------------------

    def make_estimator(self, aircraft: Aircraft, options: Any) -> Any:
        """The estimator, compiled and ready."""
        raise NotImplementedError

    def offer(self) -> None:
        """Create publishers and services with ``publisher`` and ``service``."""
        raise NotImplementedError

    def take(self, topic: str, message: Any) -> None:
        """One input message."""
        raise NotImplementedError

    def finish(self) -> None:
        """Use and publish what is still held back."""
        raise NotImplementedError

    def begin_anew(self) -> None:
        """Forget what was estimated and go on."""
        raise NotImplementedError

    def condition(self) -> tuple[str, dict[str, Any]]:
        """What is wrong in words, empty when nothing is, and values for the diagnostics."""
        raise NotImplementedError

    # -- lifecycle -------------------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the aircraft file, compile, create publishers and services."""
        try:
            aircraft = common.configured_aircraft(self)
            self._quality = common.input_quality(self)
            options = common.read_options(self, self._option_kind, self._described)
        except InputError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self.get_logger().info("preparing; the first start compiles, up to a minute")
        self.estimator = self.make_estimator(aircraft, options)
        self.offer()
        self._diagnostics_publisher = self.publisher(DiagnosticArray, "/diagnostics", 10)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen."""
        self._process_times = common.process_times()
        for topic in self.received:
            self.hear(common.message_class(TOPICS[topic]), topic, partial(self._receive, topic), self._quality)
        diagnose = partial(self._survive, self._publish_diagnostics)
        self._timer = self.create_timer(common.DIAGNOSTICS_PERIOD, diagnose)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop listening; use what was held back."""
        self.finish()
        for subscription in self._heard:
            self.destroy_subscription(subscription)
        self._heard.clear()
        self.destroy_timer(self._timer)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the flight."""
        for publisher in self._offered_publishers:
            self.destroy_lifecycle_publisher(publisher)
        for service in self._offered_services:
            self.destroy_service(service)
        self._offered_publishers.clear()
        self._offered_services.clear()
        self.estimator = None
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, from whatever state."""
        return self.on_deactivate(state) if self._heard else TransitionCallbackReturn.SUCCESS

    # -- for the nodes ---------------------------------------------------------------------------------------

    def publisher(self, kind: Any, topic: str, quality: Any) -> Any:
        """A publisher that lives from configure to cleanup."""
        self._offered_publishers.append(self.create_lifecycle_publisher(kind, topic, quality))
        return self._offered_publishers[-1]

    def service(self, kind: Any, name: str, answer: Callable[[Any, Any], Any]) -> None:
        """A service that lives from configure to cleanup."""
        self._offered_services.append(self.create_service(kind, name, answer))

    def hear(self, kind: Any, topic: str, receive: Callable[[Any], None], quality: Any) -> None:
        """A subscription that lives while the node is active."""
        self._heard.append(self.create_subscription(kind, topic, partial(self._survive, receive), quality))

    def _survive(self, work: Callable[..., None], *arguments: Any) -> None:
        """Do some work; a matrix that cannot be solved costs what was estimated, and not the node in flight."""
        try:
            work(*arguments)
        except np.linalg.LinAlgError as error:
            self.numerical_faults += 1
            self.get_logger().error(f"numerical fault ({error}): what was estimated is forgotten, and begins anew")
            self.begin_anew()

    def _receive(self, topic: str, message: Any) -> None:
        self.received[topic] += 1
        self.take(topic, message)

    def _publish_diagnostics(self) -> None:
        times = common.process_times()
        share = f"{common.cpu_share(self._process_times, times):.3f}"
        self._process_times = times
        problem, values = self.condition()
        level = DiagnosticStatus.WARN[0] if problem else DiagnosticStatus.OK[0]
        values = {"cpu_share": share, "numerical_faults": self.numerical_faults, **values}
        message = common.diagnostics(self, level, problem or "ok", values)
        self._diagnostics_publisher.publish(message)
