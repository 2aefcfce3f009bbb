"""The session: one job at a time, in another process, and what becomes of jobs that fail or are stopped."""

from __future__ import annotations

import time

import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.versions import open_run
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench.session import Session
from aircraft_sysid_ros.workbench.worker import ADD, DIAGNOSE, REMOVE, Job


@pytest.fixture
def session(run):
    """An open session on a copy of the run."""
    opened = Session(run)
    try:
        opened.wait(120.0)
        yield opened
    finally:
        opened.close()


def until(true, seconds: float = 90.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_jobs_one_at_a_time_and_the_folder_is_watched(session, run) -> None:
    first = session.view.current
    assert session.start(Job(ADD, "Cl: alpha*beta"))
    assert not session.start(Job(REMOVE, "Cl: alpha*beta"))  # one is under way
    session.wait(120.0)
    assert session.view.current == open_run(run).current.identifier != first
    assert session.sentence.startswith("the held-out error falls") and not session.is_bad
    session.start(Job(ADD, "Cl: alpha*beta"))
    session.wait(120.0)
    assert session.is_bad and "already" in session.sentence
    session.start(Job(DIAGNOSE))
    until(lambda: session.told.what and session.elapsed > 0.5)
    session.stop()
    until(lambda: session.sentence == "stopped: the run is as it was")
    session.wait(120.0)
    assert session.view.current == open_run(run).current.identifier and not (run / "diagnosis.json").exists()
    assert main(["remove", str(run), "Cl: alpha*beta"]) == 0  # another program changes the run
    until(lambda: session.view.current == first)


def test_a_folder_that_is_no_run_is_one_sentence(tmp_path) -> None:
    session = Session(tmp_path)
    try:
        with pytest.raises(InputError, match="is no run"):
            session.wait(120.0)
    finally:
        session.close()
