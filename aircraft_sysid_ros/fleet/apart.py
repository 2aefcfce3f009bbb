"""Work in a process of its own, which may crash, hang or take all the memory without harm to others.

The process is forked from one that has loaded the kernels and does nothing else, so that it starts at once. It ends
with the worker that waits for it, however that ends.
"""

from __future__ import annotations

import errno
import fcntl
import multiprocessing
import os
import resource
import signal
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from aircraft_sysid_ros.errors import InputError, one_line
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.processes import CORES, ONE_THREAD, end_with

#: How often a process is restarted that was killed from outside.
TRIES = 3
#: What the system refuses at times: it says nothing of the flight.
_OF_THE_MACHINE = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.ENOMEM, errno.EMFILE, errno.ENFILE, errno.EROFS)
#: Exit status of a process whose forkserver was ended.
_ORPHANED = 255


@dataclass(frozen=True)
class Limits:
    """What one flight may take."""

    time: float  # [s]
    memory: int | None = None  # [bytes]


class Failed(Exception):
    """A flight has no answer: one sentence, and whether it would have none the next time either."""

    def __init__(self, sentence: str, lasting: bool = True, took_all_time: bool = False) -> None:
        super().__init__(sentence)
        self.sentence, self.lasting, self.took_all_time = one_line(sentence), lasting, took_all_time


def run_apart(work: Callable[..., Mapping[str, Any]], *args: Any, limits: Limits, preload: Sequence[str] = ()) -> Any:
    """``work(*args)``, a mapping, from a process of its own that has imported ``preload``. Raises Failed."""
    multiprocessing.current_process().daemon = False  # one of Dask's may have no children otherwise
    os.environ.update(ONE_THREAD)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(preload))
    for _ in range(TRIES):
        reader, writer = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(writer, limits, work, *args), daemon=False)
        try:
            process.start()
            writer.close()
            answered = reader.poll(limits.time)
            if not answered:
                sentence = f"it took longer than the {limits.time:g} s that a flight may take (--time-limit)"
                raise Failed(sentence, took_all_time=True)
            found = reader.recv()
        except (EOFError, ConnectionError):  # it ended without an answer
            process.join()
            if process.exitcode not in (-signal.SIGKILL, _ORPHANED):
                raise Failed(f"its process {_end_of(process.exitcode or 0)}") from None
            continue
        finally:
            reader.close()
            if process.is_alive():
                process.kill()
            if process.pid is not None:
                process.join()
        if isinstance(found, Failed):
            raise found
        return found
    raise Failed(f"its process was killed {TRIES} times: there may be too little memory", lasting=False)


def _end_of(status: int) -> str:
    if status >= 0:
        return f"ended with status {status} and no answer"
    try:
        name = signal.Signals(-status).name
    except ValueError:
        name = str(-status)
    return f"crashed ({name})"


def _work(writer: Connection, limits: Limits, work: Callable[..., Mapping[str, Any]], *args: Any) -> None:
    """In the process: the answer into the pipe, or why there is none."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever waits is told
    end_with(os.getppid())
    _end_with_worker()
    os.environ[CORES] = "1"  # flights are many: each takes one
    with open(os.devnull, "w", encoding="utf8") as nowhere:  # progress is shown of the fleet
        for stream in (1, 2):
            os.dup2(nowhere.fileno(), stream)
    if limits.memory is not None:
        resource.setrlimit(resource.RLIMIT_DATA, (limits.memory, limits.memory))
    answer: Any
    try:
        answer = dict(work(*args))
    except Exception as error:
        answer = _failure(error)
    writer.send(answer)


def _end_with_worker() -> None:
    """Let the kernel end this process (SIGIO) when the worker closes its end of a pipe, which it does when it ends."""
    worker = multiprocessing.parent_process()
    if worker is None:
        return
    fcntl.fcntl(worker.sentinel, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(worker.sentinel, fcntl.F_SETFL, fcntl.fcntl(worker.sentinel, fcntl.F_GETFL) | os.O_ASYNC)
    if not worker.is_alive():
        os._exit(1)


def _failure(error: Exception) -> Failed:
    """What is said of an error, and whether it comes back."""
    cause = error if isinstance(error, OSError) else error.__context__
    of_machine = isinstance(cause, OSError) and cause.errno in _OF_THE_MACHINE
    lasting = not (of_machine or isinstance(error, MissingExtra))
    if isinstance(error, Failed):
        return error
    if isinstance(error, InputError):
        return Failed(str(error), lasting)
    if isinstance(error, MemoryError | BrokenProcessPool):
        return Failed("it needs more memory than a worker has", lasting=False)
    if isinstance(error, OSError):
        where = f" {error.filename}" if error.filename else ""
        return Failed(f"the system refused{where}: {error.strerror or error}", lasting)
    return Failed(f"failed, {type(error).__name__}: {error}")
