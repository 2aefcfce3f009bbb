"""One running parameter node, for all browsers that look at it: what it said, and the one request that is under way."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench.live_flight import LiveFlight
from aircraft_sysid_ros.workbench.live_link import ANSWER, INPUTS, NO_ROS, NODE, PRESENCE, READY, VERDICT, start_link
from aircraft_sysid_ros.workbench.worker import Job

#: Longest wait [s] for something in the pipe before it is seen whether the session is closed.
_LOOK = 0.5
#: Time [s] between a link that ended and the next.
_REST = 1.0


class LiveSession:
    """A link to a node and the last that came through it. ``revision`` rises with everything but messages."""

    def __init__(self, namespace: str = "") -> None:
        self.namespace = "/" + namespace.strip("/") if namespace.strip("/") else ""
        self.flight = LiveFlight()
        self.job: Job | None = None
        self.sentence, self.is_bad = "", False  # what came of the last request
        self.problem = ""  # why ROS cannot be used
        self.revision = 0
        self._ready, self._closed, self._lock = threading.Event(), False, threading.Lock()
        self._process, self._pipe = start_link(self.namespace)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    @property
    def node(self) -> str:
        """Full name of the parameter node."""
        return f"{self.namespace}/{NODE}"

    def start(self, job: Job) -> bool:
        """Ask the node to ADD or REMOVE; False where another request is under way."""
        with self._lock:
            if self.job is not None or self._closed:
                return False
            self.job = job
        self.sentence, self.is_bad = "", False
        self.revision += 1
        try:
            self._pipe.send((job.kind, job.text))
        except OSError:
            self._lost()
        return True

    def close(self) -> None:
        """End the link."""
        self._closed = True
        self._process.kill()
        self._process.join()
        self._thread.join(timeout=2.0)

    def wait(self, timeout: float, tell: Callable[[str, float], None] = lambda what, share: None) -> None:
        """Block until the link listens; ``tell`` hears of it. Raises InputError with the sentence where it cannot."""
        tell("starting ROS 2", 0.0)
        if not self._ready.wait(timeout):
            raise InputError(f"ROS 2 did not start within {timeout:g} s")
        if self.problem:
            raise InputError(self.problem)

    def _listen(self) -> None:
        """Hear the link until the session is closed."""
        while not self._closed:
            try:
                if self._pipe.poll(_LOOK):
                    self._hear(*self._pipe.recv())
            except (EOFError, OSError):
                if not self._closed and not self.problem:
                    self._restart()
                elif self.problem:
                    return

    def _hear(self, kind: str, content: object) -> None:
        if kind == NO_ROS:
            self.problem = str(content)
        if kind in (NO_ROS, READY):
            self._ready.set()
        elif kind == PRESENCE:
            self._of_flight(lambda: self.flight.presence(bool(content)))
            return
        elif kind == ANSWER:
            self._answered(content)
        elif kind == INPUTS:
            self.flight.inputs = content  # type: ignore[assignment]
        elif kind == VERDICT:
            self.flight.verdict = str(content)
        else:
            self._of_flight(lambda: self.flight.take(kind, content))  # type: ignore[arg-type]
            return
        self.revision += 1

    def _of_flight(self, hear: Callable[[], None]) -> None:
        """Hear something of the flight; what came of the last request is none of another flight's."""
        number = self.flight.number
        hear()
        if self.flight.number != number and self.sentence:
            self.sentence, self.is_bad = "", False
            self.revision += 1

    def _answered(self, content: object) -> None:
        assert isinstance(content, dict)
        if content["success"]:
            self.flight.granted(content["kind"], content["text"], content["model"])
        self.sentence, self.is_bad = content["message"], not content["success"]
        self.job = None

    def _lost(self) -> None:
        """The link has ended: a request that it had will not be answered."""
        if self.job is not None:
            self.sentence, self.is_bad = "the link to ROS ended before the node answered: ask again", True
            self.job = None
        self.revision += 1

    def _restart(self) -> None:
        self._process.join()
        self.flight.presence(False)
        self._lost()
        time.sleep(_REST)
        self._process, self._pipe = start_link(self.namespace)
