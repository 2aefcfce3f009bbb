"""A bench for nodes, and a recording to play to them."""

from __future__ import annotations

import pytest
from bench import Bench

pytest.importorskip("rclpy")
pytest.importorskip("aircraft_sysid_msgs.msg")


@pytest.fixture
def bench(aircraft_file):
    """A bench of its own for a test."""
    bench = Bench(aircraft_file)
    yield bench
    bench.close()


@pytest.fixture
def helper(domain):
    """A node of the test's own among the processes of its module's domain, and its executor."""
    import rclpy

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(domain))
    node = rclpy.create_node("helper", context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, executor
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture(scope="session")
def recording(aircraft, tmp_path_factory):
    """A simulated flight of 28 s as a bag."""
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
    from aircraft_sysid_ros.simulation.truth_files import write_flight

    path = tmp_path_factory.mktemp("recording") / "flight"
    write_flight(simulate_samples(aircraft, seed=3, duration=28.0), path)
    return path


@pytest.fixture(scope="session")
def raw(recording):
    """Its messages."""
    from aircraft_sysid_ros.recordings.storage import read_raw

    return read_raw(recording)
