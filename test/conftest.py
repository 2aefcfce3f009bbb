"""What several tests share: a simulated flight, and a ROS domain of our own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Before any rclpy import: traffic stays on this machine and runs do not hear each other.
os.environ.setdefault("ROS_DOMAIN_ID", str(60 + os.getpid() % 40))
if "PYTEST_XDIST_WORKER" in os.environ:  # nor workers of one run
    os.environ["ROS_DOMAIN_ID"] = str(60 + os.getpid() % 40)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
# Killed processes leave segments of shared memory behind, which make later ones deaf.
os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")

REPOSITORY = Path(__file__).resolve().parents[1]


def pytest_collection_modifyitems(items):
    """Tests with nodes share one worker: two at a time would wait for each other's processor time."""
    for item in items:
        if "nodes" in item.path.parts or "demo" in item.path.name:
            item.add_marker(pytest.mark.xdist_group("nodes"))


@pytest.fixture(scope="session")
def aircraft_file() -> Path:
    """The aircraft file of simulated flights."""
    return REPOSITORY / "config" / "ultra_stick_25e.yaml"


@pytest.fixture(scope="session")
def aircraft(aircraft_file):
    """The aircraft of simulated flights."""
    from aircraft_sysid_ros.aircraft.configuration import load_aircraft

    return load_aircraft(aircraft_file)


@pytest.fixture(scope="session")
def flight(aircraft):
    """One simulated flight of 120 s with known truth."""
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

    return simulate_samples(aircraft, seed=5)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real flights; tests that need it are skipped where it is absent."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the real flights are not here")
    return folder
