"""A line of the MAP of a table whose columns are known."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class KnownLine:
    """What a column of such a file is."""

    signal: str
    column: str
    unit: str
    sign: float = 1.0
    expression: str = ""
    kind: str = ""
    time: str = ""
    time_unit: str = ""
    is_unix: bool = False
    why: str = ""
    unless_zero: bool = False  # some drivers leave 0 where nothing is measured
    time_offset: float = 0.0  # in the unit of the time
    doubt: str = ""  # why it is left to the user
