"""Progress of long work, on standard error, so that standard output stays for results."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from aircraft_sysid_ros.after_flight.progress import Tell
from aircraft_sysid_ros.errors import InputError


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar on a terminal, nothing in a pipe."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield progress


@contextmanager
def telling(what: str = "") -> Iterator[Tell]:
    """A bar that hears what is being done and its share."""
    with progress_bar() as progress:
        task = progress.add_task(what, total=1.0)
        yield lambda now, share: progress.update(task, description=now or what, completed=share)


def say_ready(path: str | None) -> None:
    """Create the file of --ready-file. Raises InputError."""
    if path:
        try:
            Path(path).touch()
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror}") from None
