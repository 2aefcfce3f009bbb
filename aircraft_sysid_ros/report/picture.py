"""The picture beside an answer: the answer is worth more than its picture."""

from __future__ import annotations

from collections.abc import Callable
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
