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
