"""Long work on a run, in a process of its own: reading, diagnosing, adding, taking away.

The process answers one job after another through a pipe, and ends when the other end of the pipe does. A change of
the run is made by the functions of the command line, which leave the run as it was when they are killed.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.errors import InputError

LOAD, RECORD, DIAGNOSE, ADD, REMOVE = "load", "record", "diagnose", "add", "remove"
NAME, UNNAME, REFINE, CALIBRATE, UNDO = "name", "unname", "refine", "calibrate", "undo"
RETURN = "return"  # to a version that there is


@dataclass(frozen=True)
class Job:
    """What is to be done; ``text`` is what is added, taken away or named, with ``more`` that belongs to it."""

    kind: str
    text: str = ""
    more: tuple[str, ...] = ()


@dataclass(frozen=True)
class Told:
    """How far a job is, from 0 to 1."""

    what: str
    share: float


@dataclass(frozen=True)
class Made:
    """The work of a job is done and written, and what is to be said of it; the run is still to be read."""

    sentence: str


@dataclass(frozen=True)
class Done:
    """A job is done: a new RunView where the run was read, what is to be said, or a FlightRecord."""

    job: Job
    view: Any = None
    record: Any = None
    sentence: str = ""


@dataclass(frozen=True)
class Failed:
    """A job was not done, in one sentence."""

    job: Job
    sentence: str


def start_worker(path: str | Path) -> tuple[Any, Connection]:
    """The process and the pipe to it."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, str(path)), daemon=False)
    process.start()
    theirs.close()
    return process, ours


def _serve(pipe: Connection, path: str) -> None:
    """Do jobs until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server
    desk = Desk(path, lambda what, share: pipe.send(Told(what, share)), lambda sentence: pipe.send(Made(sentence)))
    while True:
        try:
            job = pipe.recv()
            try:
                answer: Done | Failed = desk.do(job)
            except InputError as error:
                answer = Failed(job, str(error))
            except OSError as error:
                if isinstance(error, BrokenPipeError):
                    return
                refused = f"the system refused {error.filename or path}: {error.strerror or error}"
                answer = Failed(job, refused if Path(path).exists() else f"the run {path} is gone, and this with it")
            except Exception as error:  # said on the page as the command line says it
                answer = Failed(job, f"failed, {type(error).__name__}: {' '.join(str(error).split())}")
            pipe.send(answer)
        except (EOFError, BrokenPipeError):
            return


class Desk:
    """Does jobs on one run; comparisons of versions that it has made are kept."""

    def __init__(
        self, path: str, progress: Callable[[str, float], None], made: Callable[[str], None] = lambda sentence: None
    ) -> None:
        self.path, self.progress, self.made = path, progress, made
        self._view: Any = None

    def do(self, job: Job) -> Done:
        """One job. Raises InputError where it cannot be done."""
        from aircraft_sysid_ros.workbench.run_view import load_flight_record

        if job.kind == RECORD:
            return Done(job, record=load_flight_record(self.path, self._view.zero))
        work = {
            DIAGNOSE: self._diagnose, ADD: self._add, REMOVE: self._remove, NAME: self._name, UNNAME: self._take_back,
            REFINE: self._refine, CALIBRATE: self._calibrate, UNDO: self._undo,
            RETURN: self._return,
        }.get(job.kind, self._nothing)  # fmt: skip
        sentence = work(job)
        if sentence:
            self.made(sentence)
        return Done(job, view=self._read(), sentence=sentence)

    def _read(self) -> Any:
        from aircraft_sysid_ros.workbench.run_view import load_run_view

        self._view = load_run_view(self.path, self._view, self.progress)
        return self._view

    def _nothing(self, job: Job) -> str:
        return ""

    def _diagnose(self, job: Job) -> str:
        from aircraft_sysid_ros.after_flight.diagnose import diagnose
        from aircraft_sysid_ros.json_text import without_nan

        found = diagnose([self.path], tell=self.progress)
        if found["file"] is not None:
            return str(found["advice"])
        if self._view is not None:
            self._view = replace(self._view, unwritten=without_nan(found))
        return f"{found['advice']} The run cannot be written to, so the page alone has this."

    def _add(self, job: Job) -> str:
        from aircraft_sysid_ros.diagnosis.model_versions.additions import add

        return add(self.path, job.text, lambda share: self.progress(f"add {job.text}", share)).verdict

    def _remove(self, job: Job) -> str:
        from aircraft_sysid_ros.diagnosis.model_versions.additions import remove

        self.progress(f"remove {job.text}", 0.2)
        return remove(self.path, job.text).verdict

    def _name(self, job: Job) -> str:
        from aircraft_sysid_ros.diagnosis.model_versions.naming import name_version

        identifier, label = name_version(self.path, job.text, *job.more)
        return f"version {identifier} is called '{label.name}'" if label.name else f"version {identifier} has no name"

    def _take_back(self, job: Job) -> str:
        from aircraft_sysid_ros.diagnosis.model_versions.naming import take_name_back

        identifier, label = take_name_back(self.path, job.text)
        return (
            f"version {identifier} is called '{label.name}' again"
            if label.name
            else (f"version {identifier} has no name again")
        )

    def _return(self, job: Job) -> str:
        from aircraft_sysid_ros.diagnosis.model_versions.versions import make_current

        return f"version {make_current(self.path, job.text).identifier} is the current one"

    def _refine(self, job: Job) -> str:
        from aircraft_sysid_ros.after_flight.refine import refine_run, refined_sentences
        from aircraft_sysid_ros.report.refined_figure import draw_refined

        def tell(what: str, share: float) -> None:
            self.progress(f"refining by {what}", share)

        with self._undoable(job):
            return ". ".join(refined_sentences(refine_run(self.path, draw_refined, job.text, tell=tell)))

    def _calibrate(self, job: Job) -> str:
        from aircraft_sysid_ros.after_flight.calibrate import CalibrationOptions, calibrate
        from aircraft_sysid_ros.report.calibration_figures import draw_calibration
        from aircraft_sysid_ros.workbench.calibration_view import of_run

        out = str(of_run(self.path, job.text))
        options = CalibrationOptions(job.text, self.path, out=out, overwrite=True)
        with self._undoable(job):
            result = calibrate(
                options,
                draw_calibration,
                lambda stage, done, of: self.progress(f"calibrate {job.text}: {stage}", done / of if of else 0.05),
            )
        said = f"stage 1: {result['decision']}; stage 2: {result['stage_2']}; kept in {out}"
        return "; ".join([said, *result["notes"]])

    @contextmanager
    def _undoable(self, job: Job) -> Iterator[None]:
        """Keep what work writes over, when it is done."""
        from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
        from aircraft_sysid_ros.workbench.undo import written

        target = written(open_run(self.path)).get(f"{job.kind} {job.text}")
        before = {} if target is None else target.read()
        yield
        with suppress(OSError):  # a full disk: what was done is done, and cannot be undone
            if target is not None:
                target.keep(before)

    def _undo(self, job: Job) -> str:
        from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
        from aircraft_sysid_ros.workbench.undo import written

        target = written(open_run(self.path)).get(job.text)
        if target is None:
            raise InputError("there is nothing to undo")
        return f"{job.text}: {'what was there before is back' if target.put_back() else 'taken back'}"
