"""Progress of long work, on standard error, so that standard output stays for results."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from aircraft_sysid_ros.after_flight.progress import Tell
from aircraft_sysid_ros.errors import InputError

#: Where there is no terminal to show a bar, how far long work has come is said every so many seconds.
TOLD_EVERY = 30.0
#: Time [s] between looks whether there is something to say.
_LOOK = 1.0


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar on a terminal, nothing in a pipe."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield progress


@contextmanager
def telling(what: str = "") -> Iterator[Tell]:
    """A bar that hears what is being done and its share; where there is no terminal, a line now and then."""
    with progress_bar() as progress, _now_and_then(progress) as say:
        task = progress.add_task(what, total=1.0)

        def tell(now: str, share: float) -> None:
            progress.update(task, description=now or what, completed=share)
            say(f"{now or what}: {100.0 * share:.0f} %")

        yield tell


@contextmanager
def counting(what: str) -> Iterator[Callable[[str, int, int], None]]:
    """The same for what is counted: what is being done, how much of it is, and of how much, 0 where nobody knows."""
    with progress_bar() as progress, _now_and_then(progress) as say:
        task = progress.add_task(what, total=None)

        def tell(now: str, done: int, of: int) -> None:
            progress.update(task, description=now, completed=done, total=of or None)
            say(f"{now}: {done} of {of}" if of else now)

        yield tell


@contextmanager
def _now_and_then(progress: Progress) -> Iterator[Callable[[str], None]]:
    """What says how far long work has come where its bar is not shown, as in the log of a batch system.

    Also while one step of it lasts, as where kernels are compiled.
    """
    said, newest, ended, one = time.monotonic(), "", threading.Event(), threading.Lock()

    def say_if_due() -> None:
        nonlocal said
        if progress.disable and newest and time.monotonic() - said >= TOLD_EVERY:
            said = time.monotonic()
            print(newest, file=sys.stderr, flush=True)

    def say(text: str) -> None:
        nonlocal newest
        with one:
            newest = text
            say_if_due()

    def say_again() -> None:
        while not ended.wait(_LOOK):
            with one, suppress(OSError):  # nobody reads it any more: the work says so
                say_if_due()

    speaker = threading.Thread(target=say_again, daemon=True)
    if progress.disable:
        speaker.start()
    try:
        yield say
    finally:
        ended.set()
        if speaker.is_alive():
            speaker.join()


def say_ready(path: str | None) -> None:
    """Create the file of --ready-file. Raises InputError."""
    if path:
        try:
            Path(path).touch()
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror}") from None
