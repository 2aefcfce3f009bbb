"""``fly.py``: what it refuses, what it says of a flight in which something ended, and that nothing outlives it."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from waiting import LONGEST

linux = pytest.mark.skipif(sys.platform != "linux", reason="/proc, and word that a parent ended, are of Linux")
EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "adaptive_controller"
sys.path.insert(0, str(EXAMPLE))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--seed", "-1"], "--seed must be from 0 to 4294967295, not -1"),
        (["--seed", "99999999999999999999"], "--seed must be from 0 to 4294967295"),
        (["--rate", "nan"], "--rate must be 0 or from 0.1 to 100"),
        (["--rate", "0.01"], "--rate must be 0 or from 0.1 to 100"),
        (["--seconds", "inf"], "--seconds from 1 to 3600"),
    ],
)
def test_bad_options_are_one_line(monkeypatch, capfd, arguments, text):
    import fly

    monkeypatch.setattr(sys, "argv", ["fly.py", *arguments])
    assert fly.main() == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert text in line


def flight(silent=False, taken=8, unanswered=3):
    """An aeroplane and a controller after a flight."""
    aeroplane = SimpleNamespace(log=[None] * 100, unanswered=unanswered)
    controller = SimpleNamespace(
        look=lambda: None, messages=SimpleNamespace(is_silent=silent),
        source=SimpleNamespace(taken=taken), age_of_parameters=17.04,
    )  # fmt: skip
    return aeroplane, controller


def processes(*statuses):
    """The estimators; None: it runs."""
    return [SimpleNamespace(poll=lambda status=status: status, returncode=status) for status in statuses]


def test_what_ended_in_flight_is_said():
    import fly

    assert fly.problems(*flight(), processes(None, None)) == []
    assert fly.problems(*flight(silent=True), processes(None, -9)) == [
        "parameter_estimator ended in flight (exit status -9)",
        "the parameters stopped: the newest message is 17.0 s old",
    ]
    assert fly.problems(*flight(silent=True, taken=0), processes(None, None)) == [
        "the parameters stopped: none came in 17.0 s of flight"
    ]
    (late,) = fly.problems(*flight(unanswered=60), processes(None, None))
    assert late.startswith("60 of 100 samples had no answer")


def test_a_flight_with_a_problem_has_status_1(monkeypatch, capfd):
    import fly

    for problems, status in (([], 0), (["it stopped"], 1)):
        monkeypatch.setattr(fly, "fly", lambda *_, found=problems: {"case": "none", "problems": found})
        monkeypatch.setattr(sys, "argv", ["fly.py", "--json"])
        assert fly.main() == status
        captured = capfd.readouterr()
        assert json.loads(captured.out)["problems"] == problems and captured.err.splitlines() == problems


def test_the_end_says_what_was_seen_and_whether_learning_helped():
    import fly

    flown = {"case": "elevator", "lost_at": None, "tracking_error_deg_before": 1.0, "tracking_error_deg_after": 2.0}
    assert fly.seen(flown, "live", 4.0).endswith("learning helped (-50 %).")
    assert "the newest parameters are 26 s old" in fly.seen({**flown, "age_of_newest_message": 26.0}, "live", 2.0)
    late = fly.seen({**flown, "age_of_newest_message": 26.0}, "live", 2.0)
    assert "does not tell" in late and "helped" not in late and "harm" not in late
    busy = fly.seen({**flown, "unanswered": 673, "commands": 6800}, "live", 4.0)
    assert "For 9% of the samples no command came in time" in busy
    assert fly.seen(flown, "live", 2.05).endswith("it made no difference (-2 %).")
    assert fly.seen(flown, "live", 1.0).endswith("learning did harm (+100 %).")
    assert "loses the aeroplane: learning helped" in fly.seen(flown, "live", None)
    assert "the elevator lost half of its effect" in fly.seen(flown, "fixed", None)
    assert fly.seen({**flown, "lost_at": 31.0}, "live", None) == "The aeroplane was lost after 31.0 s."
    assert "before anything happened" in fly.seen({**flown, "tracking_error_deg_after": None}, "live", None)
    assert fly.EVENTS.keys() == fly.CASES.keys()


def test_people_read_numbers_and_no_python():
    import fly

    result = {"case": "none", "lost_at": None, "tracking_error_deg_before": 1.9193517684873722, "refused": 0}
    lines = fly.lines_of({**result, "problems": [], "seen": "Nothing was lost."})
    assert lines == ["case: none", "lost at: -", "tracking error deg before: 1.92", "refused: 0", "Nothing was lost."]


def is_running(pid):
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(done, seconds):
    deadline = time.monotonic() + seconds
    while not done() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert done()


@pytest.mark.long
@linux
def test_what_it_starts_ends_with_it_even_when_it_is_killed():
    script = (
        "import fly, os, signal, subprocess\n"
        "print(subprocess.Popen(['sleep', '60'], preexec_fn=fly._end_with_parent).pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=EXAMPLE, stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == -signal.SIGKILL
    wait_for(lambda: not is_running(int(done.stdout)), 10.0)


@pytest.fixture
def hangup_not_ignored():
    """Under nohup, as these tests may run, a hangup is ignored by what they start, too."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.long
@linux
def test_a_closed_terminal_ends_the_flight_and_both_estimators(hangup_not_ignored):
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [sys.executable, str(EXAMPLE / "fly.py"), "--case", "none"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as flying:
        children = Path(f"/proc/{flying.pid}/task/{flying.pid}/children")
        wait_for(lambda: flying.poll() is not None or len(children.read_text().split()) == 2, LONGEST)
        started = [int(pid) for pid in children.read_text().split()]
        flying.send_signal(signal.SIGHUP)
        _, said = flying.communicate(timeout=LONGEST)
    assert flying.returncode == 2 and "stopped before the end of the flight" in said and "Traceback" not in said
    assert len(started) == 2 and not any(map(is_running, started))
