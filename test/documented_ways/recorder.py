"""A recorder, as `ros2 bag record` is: what is published on some topics, byte for byte, into a bag of rosbags."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import HistoryPolicy, QoSProfile
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from aircraft_sysid_ros.nodes.common import message_class
from aircraft_sysid_ros.recordings.message_definitions import message_definitions

KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)


class Recorder:
    """Hears topics {name: type} while it is asked to spin."""

    def __init__(self, topics: dict[str, str]) -> None:
        self._types = topics
        self._heard: list[tuple[str, int, bytes]] = []
        self._context = rclpy.Context()

    def __enter__(self) -> Recorder:
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("recorder", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        for topic, kind in self._types.items():
            self._node.create_subscription(message_class(kind), topic, partial(self._hear, topic), KEEP_ALL, raw=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _hear(self, topic: str, message: bytes, information: dict[str, Any]) -> None:
        self._heard.append((topic, information["source_timestamp"], message))

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic so far."""
        return dict(Counter(topic for topic, _, _ in self._heard))

    def spin_until(self, done: Callable[[], bool], patience: float) -> None:
        """Hear until ``done()``; fails when patience [s] is at its end."""
        deadline = time.monotonic() + patience
        while not done():
            assert time.monotonic() < deadline, f"only heard {self.counts}"
            self._executor.spin_once(timeout_sec=0.1)

    def write(self, path: Path) -> None:
        """The bag."""
        store = get_typestore(Stores.ROS2_JAZZY)
        for name, text in message_definitions().items():
            store.register(get_types_from_msg(text, name))
        with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
            connections = {t: bag.add_connection(t, kind, typestore=store) for t, kind in self._types.items()}
            for topic, time_sent, message in sorted(self._heard, key=lambda heard: heard[1]):
                bag.write(connections[topic], time_sent, message)
