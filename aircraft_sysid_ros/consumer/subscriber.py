"""``~/parameters`` and ``air_data`` of ROS 2 for a ParameterSource: the only file of the library that knows ROS."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from aircraft_sysid_msgs.msg import AirData, Parameters
from rclpy.qos import qos_profile_sensor_data

from aircraft_sysid_ros.consumer.flown_condition import FlownCondition
from aircraft_sysid_ros.consumer.snapshot import Condition
from aircraft_sysid_ros.consumer.source import ParameterSource, Rules
from aircraft_sysid_ros.ros_messages.conversion import nanoseconds_of

TOPIC, AIR_DATA = "parameter_estimator/parameters", "air_data"
_LIMITS = ("airspeed_min", "airspeed_max", "alpha_min", "alpha_max", "beta_min", "beta_max")
_FIELDS = ("name", "value", "standard_deviation", "status", "reason", "age")


def content_of(message: Any) -> dict[str, Any]:
    """Content of a message Parameters as ``snapshot_of`` takes it."""
    return {
        "model": message.model,
        "parameters": [{name: getattr(p, name) for name in _FIELDS} for p in message.parameters],
        "covariance": message.covariance,
        **{name: getattr(message, name) for name in _LIMITS},
    }


class ParameterSubscriber:
    """Keeps a source fed while its node spins, in whatever thread.

    Logged are what is refused and more than one sender, at most every 10 s, and once that a table is not used, or that
    no question has had a part of the flight condition.
    """

    def __init__(
        self,
        node: Any,
        source: ParameterSource,
        topic: str = TOPIC,
        condition: Callable[[], Condition | None] = lambda: None,
    ) -> None:
        """``condition`` tells the flight condition now: a source with a table needs it."""
        self._node = node
        self.source, self._condition, self._logger = source, condition, node.get_logger()
        self.subscription = node.create_subscription(Parameters, topic, self._on_message, 10)

    def _on_message(self, message: Parameters) -> None:
        stamp = nanoseconds_of(message)
        refusal = self.source.offer(stamp, content_of(message), self._condition())
        if refusal:
            self._logger.warning(f"parameters refused: {refusal}", throttle_duration_sec=10.0)
        if self.source.warning:
            self._logger.warning(self.source.warning, once=True)
        if blind := self.source.blind:
            self._logger.warning(blind, once=True)
        topic = self.subscription.topic_name
        senders = self._node.count_publishers(topic)
        if senders > 1:
            text = f"{senders} nodes publish {topic}: give each aircraft a namespace and one parameter_estimator"
            self._logger.warning(text, throttle_duration_sec=10.0)


class AirDataSubscriber:
    """The flight condition by ``air_data``, whose messages may each hold a part of it."""

    def __init__(self, node: Any, topic: str = AIR_DATA, longest: float = Rules().longest_gap) -> None:
        """The last finite value of each part is taken for ``longest`` [s]."""
        self._flown, self._newest = FlownCondition(longest), 0
        self.subscription = node.create_subscription(AirData, topic, self._on_message, qos_profile_sensor_data)

    def condition(self, now: int | None = None) -> Condition:
        """What is known at a time ``now`` [ns] of the clock of the stamps, or at the newest message; NaN: it is not."""
        return Condition(*self._flown.at(self._newest if now is None else now, None).tolist())

    def _on_message(self, message: AirData) -> None:
        self._newest = nanoseconds_of(message)
        part = Condition(message.true_airspeed, message.angle_of_attack, message.sideslip)
        self._flown.at(self._newest, part)
