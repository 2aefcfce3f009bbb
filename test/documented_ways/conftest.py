"""A user in a folder of their own, and a bench of ROS nodes."""

import sys

import pytest
from documented_commands import ROOT
from user import User

sys.path.insert(0, str(ROOT / "test" / "nodes"))  # the bench


@pytest.fixture
def user(request, tmp_path):
    """Types the commands of the module's WAY, all of them."""
    user, failed = User(tmp_path, request.module.WAY), request.session.testsfailed
    yield user
    if request.session.testsfailed == failed:
        user.check_done()


@pytest.fixture
def bench(aircraft_file):
    """Listens and calls, as `ros2 topic echo` and `ros2 service call` do."""
    bench = pytest.importorskip("bench").Bench(aircraft_file)
    yield bench
    bench.close()
