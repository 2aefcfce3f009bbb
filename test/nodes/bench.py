"""A bench for nodes: nodes in this process or in others, and whoever listens and calls, on one executor."""

from __future__ import annotations

import contextlib
import time

import pytest

#: The first start compiles the filter.
PATIENCE = 300.0
#: [s] A service that is not found or does not answer is tried again, by another client, after so long.
TRIES = (1.0, 2.0, 4.0, 8.0, 15.0, 30.0, 60.0, 120.0)


class Bench:
    """Nodes on one executor, and messages of a recording onto their topics."""

    def __init__(self, aircraft_file):
        import rclpy

        from aircraft_sysid_ros.nodes.common import make_executor

        rclpy.init()
        self.aircraft_file = str(aircraft_file)
        self.helper = rclpy.create_node("helper")
        self.executor = make_executor([self.helper])
        self.nodes = [self.helper]
        self.publishers = {}

    def node(self, kind, **parameters):
        """A node of ours that is not configured yet; parameters as for its executable."""
        from rclpy.parameter import Parameter

        values = {"aircraft_file": self.aircraft_file, "input_reliability": "reliable", "input_depth": 5000}
        values |= parameters
        node = kind(parameter_overrides=[Parameter(name, value=value) for name, value in values.items()])
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def spin_until(self, done, timeout=PATIENCE):
        """Run callbacks until ``done()``, as the executables do; fails after the timeout."""
        from aircraft_sysid_ros.nodes.common import spin_until

        deadline = time.monotonic() + timeout
        spin_until(self.executor, lambda: done() or time.monotonic() > deadline)
        assert done(), "nothing came in time"

    def say_until(self, say, done):
        """Say something again and again, ten times a second, until ``done()``; said faster nobody gets to answer."""
        next_at = 0.0

        def done_or_said():
            nonlocal next_at
            if done():
                return True
            if time.monotonic() >= next_at:
                say()
                next_at = time.monotonic() + 0.1
            return False

        self.spin_until(done_or_said)

    def listen(self, kind, topic, quality=None):
        """The list that receives the messages of a topic."""
        from rclpy.qos import QoSProfile

        messages = []
        self.helper.create_subscription(kind, topic, messages.append, quality or QoSProfile(depth=5000))
        return messages

    def call(self, kind, name, **request):
        """The response of a service of a lifecycle node.

        A node that does not know a client yet answers it in vain. It learns of clients in the order in which they are
        made: once it has answered a later one, which may be asked again, it knows the first.
        """
        from lifecycle_msgs.srv import GetState

        with self._client(kind, name) as client:
            self._ask(GetState, f"{name.rpartition('/')[0]}/get_state")
            future = client.call_async(kind.Request(**request))
            self.spin_until(future.done)
            return future.result()

    def _ask(self, kind, name):
        """The response to an empty request that changes nothing: asked again by another client until it comes."""
        from aircraft_sysid_ros.nodes.common import spin_until

        for patience in TRIES:
            with self._client(kind, name) as client:
                future = client.call_async(kind.Request())
                deadline = time.monotonic() + patience
                spin_until(self.executor, lambda: future.done() or time.monotonic() > deadline)  # noqa: B023
                if future.done():
                    return future.result()
        return pytest.fail(f"{name} does not answer")

    @contextlib.contextmanager
    def _client(self, kind, name):
        """A client of a service that is there; made anew where it does not find it, since the middleware loses some."""
        from aircraft_sysid_ros.nodes.common import spin_until

        for patience in TRIES:
            client = self.helper.create_client(kind, name)
            try:
                deadline = time.monotonic() + patience
                spin_until(self.executor, lambda: client.service_is_ready() or time.monotonic() > deadline)  # noqa: B023
                if client.service_is_ready():
                    yield client
                    return
            finally:
                self.helper.destroy_client(client)
        pytest.fail(f"{name} is not offered")

    def publisher(self, kind, topic):
        """A reliable publisher with a subscriber."""
        from rclpy.qos import QoSProfile

        if topic not in self.publishers:
            self.publishers[topic] = self.helper.create_publisher(kind, topic, QoSProfile(depth=5000))
        publisher = self.publishers[topic]
        self.spin_until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def play(self, raw, begin, end, node):
        """Messages of a recording between two times of flight [s]; returns when the state node has them."""
        from aircraft_sysid_ros.nodes.common import message_class

        heard = {topic for other in self.nodes for topic in getattr(other, "received", ())}
        chosen = [
            (self.publisher(message_class(channel.type), channel.topic.strip("/")), raw[i])
            for i, channel in ((i, raw.channels[int(raw.channel[i])]) for i in range(len(raw)))
            if channel.topic.strip("/") in heard and begin <= (raw.log_time[i] - raw.log_time[0]) * 1e-9 < end
        ]
        wanted = sum(publisher.topic_name.strip("/") in node.received for publisher, _ in chosen)
        wanted += sum(node.received.values())
        for i, (publisher, content) in enumerate(chosen):
            publisher.publish(content)
            if i % 50 == 0:
                self.executor.spin_once(timeout_sec=0.0)
        self.spin_until(lambda: sum(node.received.values()) >= wanted)

    def close(self):
        """End of all nodes. The executor goes last and wholly: what it holds on to would stay in the graph."""
        import rclpy

        for node in self.nodes:
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        del self.executor
        rclpy.try_shutdown()
