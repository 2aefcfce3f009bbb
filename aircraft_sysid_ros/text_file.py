"""Files and folders that are there in full or not at all."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from aircraft_sysid_ros.errors import InputError


def write_whole(path: Path, content: str | bytes) -> None:
    """Write beside the file and rename, so that whoever reads it finds all of it; raises OSError."""
    with _beside(path, content) as part:
        os.replace(part, path)


@contextlib.contextmanager
def _beside(path: Path, content: str | bytes) -> Iterator[Path]:
    """A file beside with the content, gone afterwards; an OSError is that of ``path``: nobody knows its name."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(content.encode() if isinstance(content, str) else content)
        yield part
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """While what is in a folder is changed: others who do so wait. Raises OSError where the folder is not there."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):  # some network file systems lock no folders
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def put_in_place(new: Path, target: Path, aside: Path, check: Callable[[], None]) -> None:
    """Give a new file or folder its name; what had it before goes ``aside``.

    ``check`` raises InputError where the name may not be taken: it was free when the work began, and another process
    may have been faster. Raises OSError, and then everything is as before.
    """
    with locked(target.parent):
        try:
            check()
        except InputError:
            sentence = "another process has written there meanwhile, which is kept; give another name"
            raise FileExistsError(errno.EEXIST, sentence) from None
        was_there = target.exists()
        if was_there:
            target.rename(aside)
        try:
            shutil.move(new, target)
        except OSError:
            if was_there:
                aside.rename(target)
            raise


def write_new(path: Path, content: str | bytes) -> None:
    """``write_whole`` where nothing is yet: raises FileExistsError for whatever is there, a link to nowhere as well."""
    with _beside(path, content) as part:
        try:
            os.link(part, path)
        except FileExistsError:
            raise
        except OSError:  # a file system without links
            _reserve(path)
            try:
                os.replace(part, path)
            except OSError:
                path.unlink(missing_ok=True)
                raise


def _reserve(path: Path) -> None:
    """Take a name with an empty file. Raises FileExistsError where it is taken."""
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
