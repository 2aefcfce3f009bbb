"""Processes on all cores, each with the memory of this one."""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor

_PR_SET_PDEATHSIG = 1
#: Environment variable with the number of processes at a time, where it is not that of the cores.
CORES = "AIRCRAFT_SYSID_CORES"


def cores() -> int:
    """Processes that may work at a time."""
    said = os.environ.get(CORES, "")
    return int(said) if said.isdecimal() and int(said) else len(os.sched_getaffinity(0))


def worker_pool(workers: int) -> ProcessPoolExecutor:
    """Processes that share what is in memory now, and that end with this one, however it ends."""
    context = multiprocessing.get_context("fork")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=end_with, initargs=(os.getpid(),))


def end_with(parent: int) -> None:
    """Let the kernel end this process when its parent ends, also when that is killed (Linux)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
