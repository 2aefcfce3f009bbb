"""A file or a folder as tables by name, opened when they are asked for."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.tabular.bag_tables import BagTable, bag_tables, holds_bag, is_bag
from aircraft_sysid_ros.recordings.tabular.binary_files import excel_tables, hdf5_tables, mat_tables, parquet_tables
from aircraft_sysid_ros.recordings.tabular.signals import near
from aircraft_sysid_ros.recordings.tabular.table import Table
from aircraft_sysid_ros.recordings.tabular.text_files import text_tables

_Reader = Callable[[Path, str], tuple[str, list[Table]]]
_READERS: dict[str, _Reader] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".data", ".asc", ".tab", ".gz"), text_tables),
    **dict.fromkeys((".parquet", ".pq"), parquet_tables),
    **dict.fromkeys((".h5", ".hdf5", ".hdf", ".he5"), hdf5_tables),
    ".mat": mat_tables,
    **dict.fromkeys((".xlsx", ".xlsm"), excel_tables),
}
ENDINGS = tuple(_READERS)


@dataclass(frozen=True)
class Source:
    """A file, or the files of a folder that can hold tables."""

    path: Path
    files: tuple[Path, ...]
    is_bag: bool = False

    @property
    def is_folder(self) -> bool:
        """Whether tables are named by files."""
        return self.files != (self.path,)

    @cached_property
    def _bag(self) -> tuple[str, list[Table]]:
        """Its only reading: a bag is decoded as a whole."""
        return bag_tables(self.path, self.path.name)

    def _opened(self) -> tuple[str, list[Table]]:
        return self._bag if self.is_bag else open_file(self.path)

    @property
    def notes(self) -> list[str]:
        """What is wrong with a bag as a whole."""
        tables = self._bag[1] if self.is_bag else []
        return [note for table in tables[:1] if isinstance(table, BagTable) for note in table.of_bag]

    def formats(self) -> str:
        """What it is, for a report."""
        if self.is_folder:
            return f"folder of {len(self.files)} files"
        return self._opened()[0]

    def tables(self, pattern: str | None) -> list[Table]:
        """The tables that ``file`` of a MAP names; raises InputError where there are none, or too many to choose."""
        found = self._all(pattern)
        if pattern is not None:
            return found
        if len(found) > 1:
            names = ", ".join(table.name for table in found[:20])
            raise InputError(f"{self.path} holds several tables ({names}): say with 'file' which one is meant")
        return found

    def _all(self, pattern: str | None) -> list[Table]:
        if not self.is_folder:
            tables = self._opened()[1]
            if pattern is None or pattern == self.path.name:
                return tables
            outer, _, inner = pattern.partition("/")
            if inner and fnmatchcase(self.path.name, outer):  # as in a folder that holds it
                pattern = inner
            return _matching(tables, pattern, str(self.path))
        names = [file.name for file in self.files]
        outer, _, inner = (pattern or "*").partition("/")
        chosen = [file for file in self.files if file.name == outer]
        chosen = chosen or [file for file in self.files if fnmatchcase(file.name, outer)]
        if not chosen:
            raise InputError(f"{self.path} has no file '{outer}': {near(outer, names)}")
        found: list[Table] = []
        for file in chosen:
            tables = open_file(file)[1]
            found += _matching(tables, inner, file.name) if inner else tables
            if not inner and len(tables) > 1 and pattern is not None:
                raise InputError(
                    f"{file.name} holds several tables ({', '.join(table.name for table in tables[:20])}): "
                    f"name one like {file.name}/{tables[0].name}"
                )
        return found


def open_source(path: Path) -> Source:
    """A file, folder or bag; raises InputError where nothing in it can hold a table."""
    if is_bag(path):
        return Source(path, (path,), is_bag=True)
    if path.is_dir():
        files = tuple(sorted(file for file in path.iterdir() if file.is_file() and _reader(file) is not None))
        if not files and holds_bag(path):
            return Source(path, (path,), is_bag=True)
        if not files:
            raise InputError(f"{path} has no tables: files that hold some end in {' '.join(ENDINGS)}")
        return Source(path, files)
    if _reader(path) is None:
        raise InputError(f"{path} cannot hold a table: files that do end in {' '.join(ENDINGS)}")
    return Source(path, (path,))


def open_file(path: Path) -> tuple[str, list[Table]]:
    """Format and tables of a file; raises InputError."""
    reader = _reader(path)
    if reader is None:
        raise InputError(f"{path} cannot hold a table")
    if not path.stat().st_size:
        raise InputError(f"{path} is empty")
    return reader(path, path.name)


def natural_order(name: str) -> tuple[tuple[int, int, str], ...]:
    """A key that has 2 before 10."""
    parts = re.findall(r"\d+|\D+", name)
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts)


def is_table_file(path: Path) -> bool:
    """Whether a file has the ending of one that can hold tables."""
    return _reader(path) is not None


def _reader(path: Path) -> _Reader | None:
    return _READERS.get(path.suffix.lower())


def _matching(tables: list[Table], pattern: str, where: str) -> list[Table]:
    found = [table for table in tables if table.name == pattern]
    found = found or [table for table in tables if fnmatchcase(table.name, pattern)]
    if not found:
        raise InputError(f"{where} has no table '{pattern}': {near(pattern, [table.name for table in tables])}")
    return found
