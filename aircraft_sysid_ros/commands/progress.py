"""Progress of long work, on standard error, so that standard output stays for results."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from aircraft_sysid_ros.errors import InputError


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar on a terminal, nothing in a pipe."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield progress


def say_ready(path: str | None) -> None:
    """Create the file of --ready-file. Raises InputError."""
    if path:
        try:
            Path(path).touch()
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror}") from None
