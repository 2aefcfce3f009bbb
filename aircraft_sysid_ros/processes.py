"""Processes on all cores, each with the memory of this one."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from aircraft_sysid_ros.errors import InputError

T = TypeVar("T")
R = TypeVar("R")

_PR_SET_PDEATHSIG = 1
#: Environment variable with the number of processes at a time, where it is not that of the cores.
CORES = "AIRCRAFT_SYSID_CORES"
#: One thread of linear algebra in each process, where numpy is loaded afterwards: what is solved here is small, cores
#: are shared by processes, and threads that wait for each other spin (diagnosis of half an hour took five times as much
#: processor time). What is computed depends on the number of threads besides.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def cores() -> int:
    """Processes that may work at a time."""
    said = os.environ.get(CORES, "")
    return int(said) if said.isdecimal() and int(said) else len(os.sched_getaffinity(0))


def worker_pool(workers: int) -> ProcessPoolExecutor:
    """Processes that share what is in memory now, and that end with this one, however it ends."""
    context = multiprocessing.get_context("fork")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=end_with, initargs=(os.getpid(),))


def in_parallel(function: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
    """``function`` of each item, in order, on all cores.

    Processes inherit both as they are in memory now; only results are sent. On one core this one does it. Where it ends
    before, as by Ctrl-C or since an item is refused, nobody waits for what the others are at.
    """
    workers = min(len(items), cores())
    if workers < 2:
        yield from map(function, items)
        return
    context, work = multiprocessing.get_context("fork"), (os.getpid(), function, items)
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=work) as pool:
        waiting = [pool.submit(_of_number, number) for number in range(len(items))][::-1]
        try:
            while waiting:
                yield waiting.pop().result()
        except BaseException:  # nothing is cancelled: the pool would say so of what it cannot end any more
            for process in set(multiprocessing.active_children()) - others:
                process.kill()
            raise


@contextlib.contextmanager
def beside(function: Callable[[], R]) -> Iterator[Callable[[], R]]:
    """``function`` in a process of its own, one more than ``cores`` says, while this one does other work.

    What is yielded waits for its result. The process inherits what it needs as it is in memory now; only the result is
    sent, or the InputError. It ends with the context, whether it is done or not. Where it is ended before, as for want
    of memory, and on one core, the function is called where its result is asked for.
    """
    if cores() < 2:
        yield function
        return
    context = multiprocessing.get_context("fork")
    hears, says = context.Pipe(duplex=False)
    process = context.Process(target=_beside, args=(os.getpid(), function, says))
    process.start()
    says.close()

    def result() -> R:
        try:
            found, refused = hears.recv()
        except EOFError:
            return function()
        if refused is not None:
            raise refused
        value: R = found
        return value

    try:
        yield result
    finally:
        process.kill()
        process.join()
        hears.close()


def _beside(parent: int, function: Callable[[], R], says: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other one ends it
    _join(parent)
    try:
        says.send((function(), None))
    except InputError as error:
        says.send((None, InputError(str(error))))


#: What a process of ``in_parallel`` does: the function and all items.
_WORK: list[Any] = []


def _join(parent: int) -> None:
    """Begin as one of the processes that share the work of another."""
    end_with(parent)
    os.environ[CORES] = "1"  # the others have theirs
    gc.freeze()  # what was there before is neither looked through nor, by that, copied


def _begin(parent: int, function: Callable[[T], R], items: Sequence[T]) -> None:
    _join(parent)
    _WORK[:] = function, items


def _of_number(number: int) -> Any:
    function, items = _WORK
    return function(items[number])


def end_with(parent: int) -> None:
    """Let the kernel end this process when its parent ends, also when that is killed (Linux)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
