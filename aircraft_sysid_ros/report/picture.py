"""The picture beside an answer: the answer is worth more than its picture."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.installation import MissingExtra


def picture(draw: Callable[[], Any]) -> tuple[str | None, list[str]]:
    """The file that ``draw`` wrote and no note, or None and a note that says why there is no picture."""
    try:
        return str(draw()), []
    except MissingExtra as error:
        return None, [f"no picture: {error}"]
    except OSError as error:
        return None, [f"no picture: {error.filename} cannot be written: {error.strerror}"]


def whole_picture(path: Path, save: Callable[[Path], Any]) -> tuple[str | None, list[str]]:
    """The same of a PNG file that ``save`` writes, which is there whole or not at all."""
    return picture(lambda: _whole(path, save))


def _whole(path: Path, save: Callable[[Path], Any]) -> Path:
    part = path.with_name(f".{path.name}.part.png")
    try:
        save(part)
        os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise
    return path
