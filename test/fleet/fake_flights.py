"""What workers do in tests in place of a flight: each is known by its name alone."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import psutil

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra


@dataclass(frozen=True)
class FakeJob:
    """A job of a fleet."""

    key: str
    started: Path  # a file of this job's name, with the number of its process, is there as soon as it has begun


def work(job: FakeJob, folder: Path) -> dict[str, object]:
    """An answer, or what goes wrong in flights."""
    made = job.started / f".{job.key}"
    made.write_text(str(os.getpid()), encoding="utf8")
    made.rename(job.started / job.key)
    kind = job.key.split("-")[0]
    if kind == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if kind == "hang":
        time.sleep(1000.0)
    if kind == "damaged":
        raise InputError("the recording is damaged")
    if kind == "bare":
        raise MissingExtra("ULog files", "pyulog", "logs")
    if kind == "full":
        with open("/dev/full", "w", encoding="utf8") as full:
            full.write("x")
    if kind == "greedy":
        return {"size": len(bytearray(1 << 40))}
    if kind == "wait":
        until((job.started / "go").exists)
    (folder / "scratch").write_text(job.key, encoding="utf8")
    return {"key": job.key, "number": 0.1 + 0.2}


def until(is_so: Callable[[], bool]) -> None:
    """Wait for a fact, not for ever."""
    for _ in range(30_000):
        if is_so():
            return
        time.sleep(0.01)
    raise AssertionError("it never came")


def below(pid: int) -> list[int]:
    """Processes below one, whichever of its threads began them."""
    try:
        return [child.pid for child in psutil.Process(pid).children(recursive=True)]
    except psutil.Error:
        return []


def words_of(pid: int) -> str:
    """The command of a process; nothing of one that has ended."""
    try:
        return " ".join(psutil.Process(pid).cmdline())
    except psutil.Error:
        return ""
