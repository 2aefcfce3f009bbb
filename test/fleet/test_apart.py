"""A flight in a process of its own: whatever it does, the one who asked goes on and can say what happened."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from fake_flights import FakeJob, below, until, work

from aircraft_sysid_ros.fleet.apart import Failed, Limits, run_apart

HERE = Path(__file__).parent


def flown(kind, folder, time=60.0, memory=None):
    return run_apart(work, FakeJob(kind, folder), folder, limits=Limits(time, memory))


def test_an_answer_comes_back(tmp_path):
    assert flown("sound", tmp_path) == {"key": "sound", "number": 0.1 + 0.2}


@pytest.mark.parametrize(
    ("kind", "said", "lasting"),
    [
        ("crash", "its process crashed (SIGSEGV)", True),
        ("damaged", "the recording is damaged", True),
        ("bare", "python3 -m pip install 'aircraft_sysid_ros[logs]'", False),
        ("full", "No space left on device", False),
        ("greedy", "more memory", False),
    ],
)
def test_what_goes_wrong_is_one_sentence(kind, said, lasting, tmp_path):
    with pytest.raises(Failed) as caught:
        flown(kind, tmp_path, memory=8 << 30)
    assert said in caught.value.sentence and "\n" not in caught.value.sentence
    assert caught.value.lasting is lasting and not caught.value.took_all_time


def test_what_hangs_is_ended(tmp_path):
    with pytest.raises(Failed) as caught:
        flown("hang", tmp_path, time=1.0)
    assert caught.value.took_all_time and "--time-limit" in caught.value.sentence


def test_one_that_was_killed_is_begun_again(tmp_path):
    """Not by its own doing: killed once, it has its answer all the same."""
    found = []
    thread = threading.Thread(target=lambda: found.append(flown("wait", tmp_path)))
    thread.start()
    until((tmp_path / "wait").exists)
    process = int((tmp_path / "wait").read_text())
    (tmp_path / "wait").unlink()
    os.kill(process, signal.SIGKILL)
    until((tmp_path / "wait").exists)
    (tmp_path / "go").touch()
    thread.join()
    assert found[0]["key"] == "wait"


def test_it_ends_with_the_worker_that_waits_for_it(tmp_path):
    """However that ends: nothing goes on in the background."""
    script = (
        "import sys; from pathlib import Path; from fake_flights import FakeJob, below, until, work\n"
        "from aircraft_sysid_ros.fleet.apart import Limits, run_apart\n"
        "folder = Path(sys.argv[1]); run_apart(work, FakeJob('wait', folder), folder, limits=Limits(600.0))"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), *sys.path])}
    with subprocess.Popen([sys.executable, "-c", script, str(tmp_path)], env=environment) as worker:
        until((tmp_path / "wait").exists)
        group = below(worker.pid)
        worker.kill()
    assert group
    until(lambda: all(map(_is_over, group)))


def _is_over(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True
