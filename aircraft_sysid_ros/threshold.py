"""Thresholds, declared once in a record: value and reason.

    @dataclass(frozen=True)
    class Thresholds:
        most_noise: float = threshold(4.0, "Largest noise of a sensor, over that of the file. A judgement.")

The tables of the docs are made of what ``thresholds_of`` reads there.
"""

from __future__ import annotations

from dataclasses import field, fields
from typing import Any


def threshold(value: Any, *why: str) -> Any:
    """The field of a threshold in a frozen dataclass; ``why`` are the lines of what it is, its unit and its reason."""
    return field(default=value, metadata={"why": " ".join(why)})


def thresholds_of(record: Any) -> list[tuple[str, Any, str]]:
    """Name, value and reason of each threshold of a record."""
    return [(each.name, getattr(record, each.name), each.metadata["why"]) for each in fields(record)]
