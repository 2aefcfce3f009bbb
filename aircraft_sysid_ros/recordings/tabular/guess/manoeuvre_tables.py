"""Tables with the same columns, a manoeuvre each: one ``file`` of the MAP, a pattern, stands for all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import pairwise, takewhile
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.recordings.tabular.guess.names import TIME, guess_name
from aircraft_sysid_ros.recordings.tabular.source import natural_order
from aircraft_sysid_ros.recordings.tabular.table import Table, numbers

#: Signals of so many sorts make a table a flight of its own, and no sensor among others.
_FEWEST_SORTS = 4
#: Tables side by side of which columns follow one another as closely as this are two recorders of one flight.
_SAME_MOTION = 0.8
_ROWS = 20_000  # of each table that are compared

Named = tuple[str | None, Table]
Columns = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class ManoeuvreTables(Table):
    """Tables with the same columns as one, after one another."""

    parts: tuple[Table, ...] = ()

    def pieces(self, positions: Sequence[int], rows: int) -> Iterator[list[npt.NDArray[Any]]]:
        """See Table."""
        waiting: list[list[npt.NDArray[Any]]] = []
        count = 0
        for part in self.parts:
            there = [part.columns.index(self.columns[i]) for i in positions]
            for arrays in part.pieces(there, rows - count):
                waiting.append(arrays)
                count += len(arrays[0])
                if count >= rows:
                    yield _joined(waiting)
                    waiting, count = [], 0
        if waiting:
            yield _joined(waiting)


def _joined(waiting: list[list[npt.NDArray[Any]]]) -> list[npt.NDArray[Any]]:
    """The same columns of several pieces after one another; those of different kinds as objects."""
    columns = []
    for arrays in zip(*waiting, strict=True):
        kinds = {array.dtype.kind for array in arrays}
        columns.append(np.concatenate(arrays if len(kinds) == 1 else [array.astype(object) for array in arrays]))
    return columns


def joined_manoeuvres(tables: list[Named], has_time: Callable[[str, Table], bool]) -> list[Named]:
    """Tables with their names in the MAP, those that are manoeuvres of one layout as one under a pattern.

    They are, where the times of all of them go on, or start over with each: where ``has_time`` says so of the whole.
    """
    by_columns: dict[tuple[str, ...], list[Named]] = {}
    for name, table in tables:
        by_columns.setdefault(tuple(sorted(table.columns)), []).append((name, table))
    out: list[Named] = []
    for columns, group in by_columns.items():
        pattern = _pattern([str(name) for name, _ in group], [str(name) for name, _ in tables])
        if len(group) > 1 and pattern is not None and _is_flight(columns, group[0][1]) and not _side_by_side(group):
            parts = [table for _, table in sorted(group, key=lambda named: natural_order(str(named[0])))]
            whole = ManoeuvreTables(pattern, parts[0].columns, parts[0].units, parts[0].note, tuple(parts))
            if has_time(pattern, whole):
                group = [(pattern, whole)]
        out += group
    return out


def _pattern(names: list[str], of_all: list[str]) -> str | None:
    """A pattern of these names and of no others; None where there is none."""
    begin, end = _common(names), _common([name[::-1] for name in names])[::-1]
    shortest = min(map(len, names))
    pattern = begin + "*" + end[len(end) - min(len(end), shortest - len(begin)) :]
    if any(letter in begin + end for letter in "*?["):
        return None
    return pattern if [name for name in of_all if fnmatchcase(name, pattern)] == names else None


def _common(names: list[str]) -> str:
    """The letters with which all names begin."""
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    return "".join(letters[0] for letters in alike)


def _is_flight(columns: Sequence[str], table: Table) -> bool:
    """Whether a time and signals of several sorts are among the columns, by their names."""
    guesses = [guess_name(name, table.units.get(name, ""), table.name) for name in columns if name]
    sorts = {guess.signal.partition(".")[0] for guess in guesses if guess is not None}
    return TIME in sorts and len(sorts - {TIME}) >= _FEWEST_SORTS


def _side_by_side(group: list[Named]) -> bool:
    """Whether two tables that follow one another hold the same motion: they are two recorders, no manoeuvres."""
    names = [name for name in group[0][1].columns if name and (guess := guess_name(name)) and guess.signal != TIME]
    contents = (next(table.read(names, _ROWS), None) for _, table in group)
    return any(_same_motion(names, one, other) for one, other in pairwise(contents))


def _same_motion(names: list[str], first: Columns | None, second: Columns | None) -> bool:
    if first is None or second is None:
        return True
    alike = []
    for name in names:
        a, b = numbers(first[name])[0], numbers(second[name])[0]
        rows = min(len(a), len(b))
        known = np.isfinite(a[:rows]) & np.isfinite(b[:rows])
        a, b = a[:rows][known], b[:rows][known]
        if len(a) > 2 and np.ptp(a) > 0.0 and np.ptp(b) > 0.0:
            alike.append(abs(float(np.corrcoef(a, b)[0, 1])))
    return not alike or float(np.median(alike)) > _SAME_MOTION
