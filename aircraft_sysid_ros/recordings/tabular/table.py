"""What every reader gives: tables with named columns, read in pieces."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.recordings.tabular.signals import near

#: Columns of a piece of a table by name: numbers, times or objects, each (n,).
Piece = dict[str, npt.NDArray[Any]]
#: Texts that stand for a value that is not there.
EMPTY = (
    "",
    "-",
    "--",
    "---",
    "*",
    "**",
    "?",
    "nan",
    "NaN",
    "NAN",
    "NA",
    "N/A",
    "n/a",
    "null",
    "NULL",
    "None",
    "none",
    "#N/A",
)


@dataclass(frozen=True)
class Table(ABC):
    """A table: its name as ``file`` of a MAP means it, its columns, and what its header says of units."""

    name: str
    columns: tuple[str, ...]
    units: Mapping[str, str] = field(default_factory=dict)
    note: str = ""  # where its names come from, if they are not its own
    time: str = field(default="", kw_only=True)  # the column that its format has for its time, if it has one

    @property
    def said(self) -> list[str]:
        """What the last reading has found to be wrong with it."""
        return []

    @abstractmethod
    def pieces(self, positions: Sequence[int], rows: int) -> Iterator[list[npt.NDArray[Any]]]:
        """The columns at ``positions``, at most ``rows`` rows at a time."""

    def position(self, column: str) -> int:
        """Where a column is; raises InputError with the nearest names, or where two have the name."""
        for plain in (str, _bare):
            found = [i for i, name in enumerate(self.columns) if plain(name) == plain(column)]
            if len(found) > 1:
                raise InputError(f"{self.name} has {len(found)} columns '{column}': rename all but one")
            if found:
                return found[0]
        if column.isdigit() and 1 <= int(column) <= len(self.columns) and not any(n.isdigit() for n in self.columns):
            return int(column) - 1
        raise InputError(f"{self.name} has no column '{column}': {near(column, [n for n in self.columns if n])}")

    def read(self, columns: Sequence[str], rows: int) -> Iterator[Piece]:
        """The named columns in pieces of at most ``rows`` rows."""
        positions = [self.position(column) for column in columns]
        for arrays in self.pieces(positions, rows):
            yield dict(zip(columns, arrays, strict=True))


def _bare(name: str) -> str:
    """A name without the marks of a comment, quotes and white space that stand around it in some files."""
    return name.strip().lstrip("#%").strip().strip("\"'").strip()


@dataclass(frozen=True)
class ArrayTable(Table):
    """A table that is in memory, or in a file that reads slices of arrays; the columns may differ in length."""

    arrays: tuple[Any, ...] = ()

    def pieces(self, positions: Sequence[int], rows: int) -> Iterator[list[npt.NDArray[Any]]]:
        """See Table."""
        lengths = {len(self.arrays[i]) for i in positions}
        if len(lengths) > 1:
            told = ", ".join(f"{self.columns[i]} {len(self.arrays[i])}" for i in positions)
            raise InputError(f"the columns of {self.name} differ in length ({told}): give each length its own table")
        for first in range(0, lengths.pop(), rows):
            yield [np.asarray(self.arrays[i][first : first + rows]) for i in positions]


def numbers(values: npt.NDArray[Any]) -> tuple[npt.NDArray[np.float64], int]:
    """A column (n,) as numbers, NaN where there is none, and how many texts are none."""
    if values.dtype.kind in "fiub":
        return values.astype(np.float64), 0
    if values.dtype.kind in "mM":
        return np.full(len(values), np.nan), len(values)
    found = np.full(len(values), np.nan)
    bad = 0
    for i, value in enumerate(values):
        if value is None or (isinstance(value, str) and value.strip() in EMPTY):
            continue
        try:
            found[i] = float(value)
        except (TypeError, ValueError):
            bad += 1
    return found, bad


def imported(module: str) -> Any:
    """A package of the extra ``tables``."""
    from importlib import import_module

    try:
        return import_module(module)
    except ImportError:
        raise MissingExtra("tables of other programs", module.split(".", maxsplit=1)[0], "tables") from None
