"""One run that is open, for all browsers that look at it: what is shown, and the one job that is under way."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from pathlib import Path

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.run_reader import AIRCRAFT
from aircraft_sysid_ros.workbench.calibration_view import CalibrationFolder, newest_of_run
from aircraft_sysid_ros.workbench.run_view import NO_TRUTH, FlightRecord, RunView, TruthView, signature_of
from aircraft_sysid_ros.workbench.views.words import readable
from aircraft_sysid_ros.workbench.worker import (
    ADD,
    CALIBRATE,
    DIAGNOSE,
    LOAD,
    NAME,
    RECORD,
    REFINE,
    REMOVE,
    RETURN,
    UNDO,
    UNNAME,
    Done,
    Failed,
    Job,
    Made,
    Told,
    start_worker,
)

#: Time [s] between looks at the folder: the command line may have changed it.
_LOOK = 1.0
#: Jobs that nobody asks for and that change nothing.
READS = (LOAD, RECORD)
WORDS = {
    LOAD: "reading {}", RECORD: "reading what was estimated in flight", DIAGNOSE: "looking for what is missing",
    ADD: "adding", REMOVE: "taking away", NAME: "naming", UNNAME: "taking the name back", REFINE: "refining",
    CALIBRATE: "calibrating", UNDO: "putting back what was there",
    RETURN: "going to a version",
}  # fmt: skip
#: What was under way when the worker ended and nobody had stopped it.
ENDED = "{} was ended by the system, perhaps for lack of memory: {}"
#: A run that is shown, and whose folder somebody has taken away.
GONE = "the run {} is gone: it was deleted or moved; what stands here is the last that was read of it"


class Session:
    """A worker and the last that it said. ``revision`` rises with everything that a page shows; pages poll it."""

    def __init__(
        self, path: str | Path, truth: TruthView = NO_TRUTH, calibration: CalibrationFolder | None = None
    ) -> None:
        self.path, self.truth, self.calibration = Path(path), truth, calibration
        self._given = calibration  # what the page was started with
        self.view: RunView | None = None
        self.record: FlightRecord | None = None
        self.record_problem = ""
        self.job: Job | None = None
        self.waiting: Job | None = None  # asked for while the folder is read, begun then
        self.began = 0.0
        self.told = Told("", 0.0)
        self.sentence, self.is_bad = "", False  # what is said of the last job
        self.damage = ""  # why the folder cannot be read any more
        self.revision = 0
        self._closed, self._lock = False, threading.Lock()
        self._damaged_at: tuple[int, ...] = ()
        self._is_stopped = False  # by a user
        self.made = ""  # what is said of the job under way, where it is done and the run is still read
        self._process, self._pipe = start_worker(self.path)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        self.start(Job(LOAD))

    @property
    def name(self) -> str:
        """Name of the folder, which may have been given as "."."""
        return readable(self.path.resolve().name)

    @property
    def busy(self) -> bool:
        """Whether a job is under way that changes or reads the run."""
        return self.job is not None or self.waiting is not None

    @property
    def is_working(self) -> bool:
        """Whether a job is under way that somebody has asked for."""
        return any(job is not None and job.kind not in READS for job in (self.job, self.waiting))

    @property
    def elapsed(self) -> float:
        """Time [s] since the job under way began."""
        return time.monotonic() - self.began

    def start(self, job: Job) -> bool:
        """Begin a job, or let it wait while the folder is read; False where another one is asked for, or closed."""
        with self._lock:
            if self._closed or self.waiting is not None:
                return False
            if self.job is not None:
                if self.job.kind in READS and job.kind not in READS:
                    self.waiting = job
                return self.waiting is job
            self._take(job)
        return self._send(job)

    def _take(self, job: Job) -> None:
        """From now on a job is under way."""
        self.job, self.began, self.made = job, time.monotonic(), ""
        self.told = Told(WORDS[job.kind].format(self.path), 0.0)
        if job.kind not in READS:
            self.sentence, self.is_bad = "", False
        self.revision += 1

    def _send(self, job: Job) -> bool:
        try:
            self._pipe.send(job)
        except OSError:  # the worker has ended, which the listener notices
            return False
        return True

    def stop(self) -> None:
        """End the job under way, at once; the run is as it was before, unless the job is done and the run is read."""
        if self.job is not None and self.job.kind not in READS:
            self._is_stopped = True
            self._process.kill()  # the listener notices and starts another worker

    def close(self) -> None:
        """End the worker."""
        self._closed = True
        self._process.kill()
        self._process.join()
        self._thread.join(timeout=2.0)

    def wait(self, timeout: float, tell: Callable[[str, float], None] = lambda what, share: None) -> None:
        """Block until no job is under way; ``tell`` hears of it, as of Told.

        Raises InputError with the sentence where the run cannot be read.
        """
        deadline = time.monotonic() + timeout
        while self.busy:
            tell(self.told.what, self.told.share)
            if time.monotonic() > deadline:
                raise InputError(f"{self.path} could not be read within {timeout:g} s")
            time.sleep(0.02)
        if self.view is None:
            raise InputError(self.damage or self.sentence)

    def _listen(self) -> None:
        """Hear the worker until the session is closed."""
        while not self._closed:
            try:
                if self._pipe.poll(_LOOK):
                    self._hear(self._pipe.recv())
                elif not self.busy and (
                    self.view is None or self.damage or signature_of(self.path) != self.view.signature
                ):  # a file that was put back may be as old as it was
                    self._look_again()
            except (EOFError, OSError):
                if not self._closed:
                    self._restart()

    def _look_again(self) -> None:
        """The folder was changed by another program."""
        if not self.damage or signature_of(self.path) != self._damaged_at:
            self.start(Job(LOAD))

    def _hear(self, answer: Told | Made | Done | Failed) -> None:
        if isinstance(answer, Told):
            self.told = answer
        elif isinstance(answer, Made):
            self.made = answer.sentence
        elif isinstance(answer, Done):
            self._done(answer)
        else:
            self._failed(answer)
        self.revision += 1

    def _done(self, answer: Done) -> None:
        if answer.view is not None:
            if self.view is not None and not self.view.is_of_flight(answer.view.signature):
                self.record, self.record_problem = None, ""  # of the flight that was there before
                self.sentence, self.is_bad = "", False
            self.view, self.damage = answer.view, ""
        is_calibrated = CALIBRATE in (answer.job.kind, answer.job.text.partition(" ")[0])  # or taken back
        if answer.view is not None and (is_calibrated or self.calibration is None):
            self._find_calibration()
        if answer.record is not None:
            self.record, self.record_problem = answer.record, ""
        if answer.sentence:
            self.sentence, self.is_bad = answer.sentence, False
        self._go_on()

    def _find_calibration(self) -> None:
        """What was calibrated from the samples of this run last, or what was given."""
        folder = newest_of_run(self.path)
        if folder is None:
            self.calibration = self._given
            return
        with contextlib.suppress(InputError):  # damaged: calibrate again
            self.calibration = CalibrationFolder(folder)

    def _go_on(self) -> None:
        """After a job: what waits, or the record of the flight where it was not read yet."""
        with self._lock:
            needs_record = self.record is None and not (self.record_problem or self.damage)
            following, self.waiting, self.job = self.waiting or (Job(RECORD) if needs_record else None), None, None
            if following is not None:
                self._take(following)
        if following is not None:
            self._send(following)

    def _failed(self, answer: Failed) -> None:
        if answer.job.kind == LOAD:
            is_gone = self.view is not None and not (self.path / AIRCRAFT).is_file()
            self.damage = GONE.format(self.path) if is_gone else answer.sentence
            self._damaged_at = signature_of(self.path)
        elif answer.job.kind == RECORD:
            self.record_problem = answer.sentence
        else:
            self.sentence, self.is_bad = answer.sentence, True
        self._go_on()

    def _restart(self) -> None:
        """Begin another worker; what ended the last one by being read is not read again."""
        self._process.join()
        self._process, self._pipe = start_worker(self.path)
        lost, self.job, self.waiting = self.job, None, None
        remedy = "close other programs, and start the workbench again"
        is_stopped, self._is_stopped = self._is_stopped, False
        if lost is not None and self.made:
            self.sentence, self.is_bad = self.made, False
        elif is_stopped and (lost is None or lost.kind in READS):
            pass  # it was done just then, and is said
        elif is_stopped:
            self.sentence, self.is_bad = "stopped: the run is as it was", False
        elif lost is not None and lost.kind == LOAD:
            self.damage, self._damaged_at = ENDED.format(f"reading {self.path}", remedy), signature_of(self.path)
        elif lost is not None and lost.kind == RECORD:
            self.record_problem = ENDED.format("reading what was estimated in flight", remedy)
        elif lost is not None:
            self.sentence, self.is_bad = ENDED.format("the work", "the run is as it was"), True
        self.revision += 1
        if not self.damage:
            self.start(Job(LOAD))
