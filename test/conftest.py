"""What several tests share: a simulated flight, and ROS domains that nobody else on the machine uses."""

from __future__ import annotations

import fcntl
import gc
import os
import signal
import tempfile
from pathlib import Path

import pytest

#: Ports of higher domains are in the range that the system gives out to others.
DOMAINS = range(1, 101)


def claim_domain():
    """The number of a ROS domain and the lock by which no other run or worker takes it, until it is closed."""
    for number in DOMAINS:
        lock = open(Path(tempfile.gettempdir()) / f"aircraft_sysid_ros_domain_{number}", "a")  # noqa: SIM115
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
        else:
            return number, lock
    raise RuntimeError("every ROS domain is taken by tests that run")


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a suite in the background, whose children could not be stopped
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Before any rclpy import: traffic stays on this machine; runs, and workers of one, do not hear each other.
NUMBER, *LOCKS = claim_domain()
os.environ["ROS_DOMAIN_ID"] = str(NUMBER)
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    os.environ["AIRCRAFT_SYSID_CORES"] = "1"  # the other workers have theirs; with more: test_in_parallel.py
os.environ["PYTHONFAULTHANDLER"] = "1"  # a child that hangs and is ended shows where, see waiting.py
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
# Killed processes leave segments of shared memory behind, which make later ones deaf.
os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")

REPOSITORY = Path(__file__).resolve().parents[1]


gc.disable()  # until all tests are collected, see below

#: Folders with the groups that take longest: these begin first, so that all workers end together.
LONGEST_FIRST = (
    "nodes",
    "workbench",
    "documented_ways",
    "test",
    "diagnosis",
    "commands",
    "refinement",
    "identification",
)

#: Other files with nodes than those of their folder.
WITH_NODES = ("test_drone_developer", "test_ros_developer")

#: Files whose recordings are played to processes: about half of the time of all files with nodes.
PLAYED = ("test_calibrated_live", "test_inputs_named_live", "test_live_equals_replay", "test_stopping")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """In which order, and which of several parameters are left to `make test-long`."""
    begun = set()
    for item in items:
        if item.get_closest_marker("long_after_the_first"):
            name = (item.path, item.originalname)
            if name in begun:
                item.add_marker("long")
            begun.add(name)
    rank = {name: number for number, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: rank.get(item.path.parent.name, len(rank)))


def pytest_collection_finish():
    """Half a million objects stay to the end: the collector of this process and of its children leaves them alone."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Workers take groups of tests. Not by marks: xdist 3.8 loses those of `--dist loadgroup` with pytest 9.2."""
    from xdist.scheduler import LoadScopeScheduling

    class Groups(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            return group_of(Path(nodeid.partition("::")[0]))

    config.option.loadscopereorder = False
    return Groups(config, log)


def group_of(path):
    """Tests of a file share a worker, or what they share would be made twice; and those of the page share a server.

    Tests with nodes wait for half of their time: two of them at a time take what one core has, more would wait for
    each other.
    """
    page = "workbench" in path.parts
    if path.stem in PLAYED:
        return "played"
    if "nodes" in path.parts or path.stem in WITH_NODES or (page and "live" in path.name):
        return "nodes"
    return "workbench" if page else path.stem


@pytest.fixture(scope="module")
def domain():
    """A ROS domain of this module's own for child processes; nodes of other tests do not hear it."""
    number, lock = claim_domain()
    LOCKS.append(lock)  # what hangs on may still be heard there: nobody else gets the number
    before, os.environ["ROS_DOMAIN_ID"] = os.environ["ROS_DOMAIN_ID"], str(number)
    yield str(number)
    os.environ["ROS_DOMAIN_ID"] = before


@pytest.fixture(scope="session", autouse=True)
def drawing():
    """How matplotlib writes a picture. In this process none is drawn, which takes longer than what it stands beside."""
    from matplotlib.figure import Figure

    with pytest.MonkeyPatch.context() as patch:
        draw = Figure.savefig
        patch.setattr(Figure, "savefig", lambda self, path, **options: Path(path).touch())
        yield draw


@pytest.fixture
def pictures(drawing, monkeypatch):
    """For tests that look at pictures: they are drawn, as in every other process."""
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", drawing)


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
