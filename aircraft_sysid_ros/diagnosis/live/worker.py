"""The search for missing effects in a process of its own, so that no sample waits for it.

``python -m aircraft_sysid_ros.diagnosis.live.worker`` reads windows from its standard input and writes verdicts to
its standard output, pickled, one after another, on one core at low priority. It ends when its input does, so that it
does not outlive the node that started it.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any, BinaryIO, NamedTuple, cast

from aircraft_sysid_ros.diagnosis.live.search_in_flight import LiveFlight, diagnose_live
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import ONE_THREAD

_NICENESS = 10


class Answer(NamedTuple):
    """What came of one search."""

    content: Mapping[str, Any] | None  # fields of MissingEffects; None where it failed
    processor_time: float  # [s]
    failure: str = ""


class LiveWorker:
    """One search at a time in another process; nothing here waits for it. One that has died is replaced."""

    def __init__(self) -> None:
        self._process = _start()
        self._thread: threading.Thread | None = None
        self._answer: Answer | None = None

    @property
    def busy(self) -> bool:
        """Whether a search is under way or its answer has not been taken."""
        return self._thread is not None

    def submit(self, flights: list[LiveFlight]) -> None:
        """Begin a search; only while not busy."""
        if self._process.poll() is not None:
            self._close_pipes()
            self._process = _start()
        self._thread = threading.Thread(target=self._ask, args=(flights,), daemon=True)
        self._thread.start()

    def answer(self) -> Answer | None:
        """The answer of the last search, once."""
        if self._thread is None or self._thread.is_alive():
            return None
        self._thread = None
        return self._answer

    def close(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.wait()
        if self._thread is not None:
            self._thread.join()
        self._close_pipes()

    def _close_pipes(self) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):  # what it never read
                cast(BinaryIO, pipe).close()

    def _ask(self, flights: list[LiveFlight]) -> None:
        questions, answers = cast(BinaryIO, self._process.stdin), cast(BinaryIO, self._process.stdout)
        try:
            pickle.dump(flights, questions)
            questions.flush()
            self._answer = Answer(*pickle.load(answers))
        except (OSError, EOFError, ValueError, pickle.UnpicklingError) as error:
            self._answer = Answer(None, 0.0, f"the search for missing effects ended: {type(error).__name__}")


def _start() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "aircraft_sysid_ros.diagnosis.live.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, **ONE_THREAD},
        start_new_session=True,  # Ctrl-C is for the node
    )


def answer_to(flights: list[LiveFlight]) -> Answer:
    """Search, with the processor time that it took."""
    began = time.process_time()
    try:
        content, failure = diagnose_live(flights).content, ""
    except InputError as error:
        content, failure = None, str(error)
    return Answer(content, time.process_time() - began, failure)


def main() -> None:
    """Answer until the input ends."""
    os.nice(_NICENESS)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not get among the answers
    while True:
        try:
            flights = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        pickle.dump(tuple(answer_to(flights)), answers)  # a class of __main__ is another one elsewhere
        answers.flush()


if __name__ == "__main__":
    main()
