"""A process that the system ends, as where memory runs out, is not begun again and again, and is not called stopped."""

from __future__ import annotations

import multiprocessing
import threading
import time

import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench import session as sessions
from aircraft_sysid_ros.workbench.session import Session
from aircraft_sysid_ros.workbench.worker import ADD, DIAGNOSE, LOAD, RECORD, Done, Job, Made


class Process:
    """One that ends with its pipe."""

    def __init__(self, pipe) -> None:
        self.pipe = pipe

    def kill(self) -> None:
        """Its pipe ends."""
        self.pipe.close()

    def join(self) -> None:
        """It is over."""


class View:
    """A run that was read."""

    signature = ()

    def is_of_flight(self, signature: tuple[int, ...]) -> bool:
        return True


@pytest.fixture
def fatal(monkeypatch):
    """Kinds of jobs that end the worker, and how many workers were started; other jobs are done at once."""
    kinds, started = set(), []

    def serve(pipe) -> None:
        try:
            while (job := pipe.recv()).kind not in kinds:
                if job.kind == ADD:  # it is written, and the run is read for long
                    pipe.send(Made("added"))
                    while True:
                        time.sleep(0.01)
                        pipe.poll()  # an error once it is killed
                pipe.send(
                    Done(job, view=View() if job.kind == LOAD else None, record="read" if job.kind == RECORD else None)
                )
            pipe.close()
        except (EOFError, OSError):
            return

    def start_worker(path):
        ours, theirs = multiprocessing.Pipe()
        started.append(path)
        threading.Thread(target=serve, args=(theirs,), daemon=True).start()
        return Process(theirs), ours

    monkeypatch.setattr(sessions, "start_worker", start_worker)
    monkeypatch.setattr(sessions, "signature_of", lambda path: ())
    return kinds, started


def settled(session: Session, started: list) -> None:
    """Wait until no worker is started any more."""
    count = -1
    while count != len(started):
        count = len(started)
        time.sleep(0.5)
        assert count < 20, "it begins again and again"


@pytest.mark.parametrize("kind", [LOAD, RECORD])
def test_a_run_that_cannot_be_read_in_memory_is_said(fatal, tmp_path, kind) -> None:
    kinds, started = fatal
    kinds.add(kind)
    session = Session(tmp_path)
    try:
        settled(session, started)
        assert "memory" in (session.damage if kind == LOAD else session.record_problem)
        if kind == LOAD:
            with pytest.raises(InputError, match="memory"):
                session.wait(1.0)
    finally:
        session.close()


def test_work_that_nobody_has_stopped_is_not_called_stopped(fatal, tmp_path) -> None:
    kinds, started = fatal
    kinds.add(DIAGNOSE)
    session = Session(tmp_path)
    try:
        session.wait(5.0)
        session.start(Job(DIAGNOSE))
        settled(session, started)
        assert "memory" in session.sentence and "the run is as it was" in session.sentence and session.is_bad
    finally:
        session.close()


def test_work_that_is_done_when_it_is_stopped_is_not_called_undone(fatal, tmp_path) -> None:
    """While the new version was read Stop said that the run is as it was, and the version was there."""
    _, started = fatal
    session = Session(tmp_path)
    try:
        session.wait(5.0)
        settled(session, started)
        session.start(Job(ADD, "stall"))
        deadline = time.monotonic() + 5.0
        while not session.made and time.monotonic() < deadline:
            time.sleep(0.01)
        session.stop()
        settled(session, started)
        assert session.sentence == "added" and not session.is_bad and not session.busy
    finally:
        session.close()
