"""The picture beside an answer: the answer is worth more than its picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.installation import MissingExtra


def picture(draw: Callable[[], Any]) -> tuple[str | None, list[str]]:
    """The file that ``draw`` wrote and no note, or None and a note that says why there is no picture."""
    try:
        return str(draw()), []
    except MissingExtra as error:
        return None, [f"no picture: {error}"]
    except OSError as error:
        return None, [f"no picture: {error.filename} cannot be written: {error.strerror}"]


def picture_lines(result: Mapping[str, Any]) -> list[str]:
    """The notes of a result and where its figure is, for people."""
    figure = [f"figure {result['figure']}"] if result["figure"] else []
    return [*note_lines(result["notes"]), *figure]
