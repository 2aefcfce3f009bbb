"""What a command says of its picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.report.picture import picture

__all__ = ["picture", "picture_lines"]


def picture_lines(result: Mapping[str, Any]) -> list[str]:
    """The notes of a result and where its figure is, for people."""
    figure = [f"figure {result['figure']}"] if result["figure"] else []
    return [*note_lines(result["notes"]), *figure]
