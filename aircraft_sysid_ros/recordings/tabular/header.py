"""Where the data of a text or a sheet begin, and what stands above them: names, then units."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.tabular.table import EMPTY
from aircraft_sysid_ros.recordings.tabular.units import is_unit

_COMMENT = re.compile(r"^\s*(#|%|//|!|;)\s*")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
_TIME_LIKE = re.compile(r"[-+]?\d[\d\-/:.,TtZ +]*")
_IN_BRACKETS = re.compile(r"^(.*?)(\s*)[\[({]\s*([^\[\](){}]{0,20})\s*[\])}]\s*$")
_SENTENCE = re.compile(r"(\S+\s+){3,}\S*[.!?:]$")
#: Between columns whose names hold single blanks.
PROSE = r"\s{2,}"
_ALIKE = 3  # rows after the first of the data that must look like it
_SEPARATORS: tuple[tuple[str, str], ...] = (
    ("\t", "tabs"), (";", "semicolons"), (",", "commas"), ("|", "bars"), (PROSE, "blanks"), (r"\s+", "blanks"),
)  # fmt: skip


@dataclass(frozen=True)
class Header:
    """Names and units of the columns, and the row at which the data begin (rows counted as given)."""

    names: tuple[str, ...]
    units: dict[str, str]
    first_row: int

    @property
    def is_named(self) -> bool:
        """Whether the columns have names; else they are counted from 1."""
        return self.names != tuple(str(i + 1) for i in range(len(self.names)))


@dataclass(frozen=True)
class TextLayout:
    """How a text is split, and its header; ``separator`` is a character or an expression for blanks."""

    header: Header
    separator: str
    decimal: str
    separator_name: str


def text_layout(lines: Sequence[str], name: str) -> TextLayout:
    """The layout of a text from its first lines; raises InputError where no table is in it."""
    found: TextLayout | None = None
    for separator, separator_name in _SEPARATORS:
        split = splitter(separator)
        decimal = "," if separator != "," and _has_decimal_commas([split(line) for line in lines]) else "."
        rows = [[with_point(cell) if decimal == "," else cell for cell in split(line)] for line in lines]
        header = find_header(rows, prose=len(separator) > 1)
        if header is None or len(header.names) < 2:
            continue
        if not header.is_named and (found is not None or separator == PROSE):
            continue
        found = TextLayout(header, separator, decimal, separator_name)
        if header.is_named:
            return found
    if found is not None:
        return found
    if not any(line.strip() for line in lines):
        raise InputError(f"{name} is empty")
    if sum(bool(line.strip()) for line in lines) == 1:
        raise InputError(f"{name} has one line and no data below it")
    raise InputError(
        f"{name} holds no table: no rows of at least two numbers, with the same separator, follow one another"
    )


def with_point(cell: str) -> str:
    """A number with a decimal comma as one with a point; any other text as it is."""
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell.strip()) else cell


def find_header(rows: Sequence[Sequence[str]], *, prose: bool = False) -> Header | None:
    """The header of rows of texts, or None where no data follow; ``prose`` where any text splits into cells."""
    filled = [list(_without_tail(row)) for row in rows]
    for i, row in enumerate(rows):
        following = [other for other in rows[i + 1 : i + 1 + _ALIKE] if any(cell.strip() for cell in other)]
        if _is_data(row) and all(_is_data(other) and len(other) == len(row) for other in following):
            return _above(filled[:i], len(row), i, prose=prose)
    return None


def split_unit(name: str) -> tuple[str, str]:
    """A name and the unit that it ends with in brackets, "" without."""
    match = _IN_BRACKETS.match(name)
    if match and match.group(1) and (match.group(2) or not match.group(3).isdigit()):  # xyz[0] is an element
        return match.group(1).strip(), match.group(3).strip()
    return name, ""


def listed_names(lines: Sequence[str]) -> tuple[tuple[str, ...], dict[str, str]] | None:
    """Names and units of a list, one a line, such as ``3  p  deg/s`` or ``p [deg/s]``; None for what is no list.

    Sentences and lines of a program are none.
    """
    names: list[str] = []
    units: dict[str, str] = {}
    for line in lines:
        if "=" in line or _SENTENCE.match(line.strip()):
            return None
        words = re.split(r"[\s,;]+", re.sub(r"^\d+\s*[.):,;]?\s+", "", line.strip().strip(",;")))
        name, unit = split_unit(" ".join(words))
        if not is_unit(unit) and len(words) > 1 and is_unit(words[1]):  # brackets may hold a remark
            name, unit = words[0], words[1]
        if not re.search(r"[^\W\d]", name) or _is_data(re.split(r"[\s,;]+", line)):
            return None
        names.append(name)
        units |= {name: unit} if unit else {}
    return (tuple(names), units) if len(set(names)) == len(names) else None


def _above(rows: list[list[str]], count: int, first_row: int, *, prose: bool) -> Header:
    """Names and units from the rows above the data, which have ``count`` columns.

    Names are the first row that has a text for most columns, the last of them too if there is such a row, or, where
    ``prose`` may have as many words, the last.
    """
    fitted = [row for each in rows if (row := _fitted(each, count)) is not None]
    most = max((sum(bool(cell) for cell in row) for row in fitted), default=0)
    full = [row for row in fitted if sum(bool(cell) for cell in row) >= (1.0 if prose else 0.6) * most]
    of_units = [row for i, row in enumerate(full) if _is_of_units(row, certain=i == 0 or prose)]
    of_names = [row for row in full if row not in of_units] or full
    of_names = [row for row in of_names if row[-1]] or of_names
    if not of_names:
        return Header(tuple(str(i + 1) for i in range(count)), {}, first_row)
    names = tuple(of_names[-1 if prose else 0])
    units = {name: unit for name in names if (unit := split_unit(name)[1])}
    for row in of_units[:1]:
        units |= {name: cell.strip("[](){} ") for name, cell in zip(names, row, strict=True) if cell}
    return Header(names, units, first_row)


def _is_of_units(row: list[str], *, certain: bool) -> bool:
    """Whether a row reads as units; names such as p, V, a do, too, but none is there twice."""
    cells = [cell.strip("[](){} ") for cell in row if cell]
    return (len(set(cells)) < len(cells) or not certain) and sum(is_unit(cell) for cell in cells) >= 0.6 * len(cells)


def _fitted(row: list[str], count: int) -> list[str] | None:
    """A row above the data as ``count`` cells, without the mark of a comment, where it can be one."""
    row = [cell.strip() for cell in row]
    if row and len(row) == count + 1 and _COMMENT.fullmatch(row[0] + " "):
        row = row[1:]
    elif row and row[0][:1] == "#":
        row[0] = _COMMENT.sub("", row[0])
    if not count - 1 <= len(row) <= count:
        row += [""] * (count - len(row)) if 0.5 * count < len(row) < count else []
    if len(row) > count or len(row) < max(count - 1, 1):
        return None
    return row + [""] * (count - len(row))


def _without_tail(row: Sequence[str]) -> Sequence[str]:
    end = len(row)
    while end and not row[end - 1].strip():
        end -= 1
    return row[:end]


def _is_data(row: Sequence[str]) -> bool:
    """Whether at least one cell is a number and most of those that say anything are numbers or times."""
    cells = [cell.strip().strip('"') for cell in row]
    said = [cell for cell in cells if cell not in EMPTY]
    number = sum(_is_number(cell) for cell in said)
    time_like = sum(bool(_TIME_LIKE.fullmatch(cell)) for cell in said if not _is_number(cell))
    return number > 0 and number + time_like >= 0.5 * len(said)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _has_decimal_commas(rows: Sequence[Sequence[str]]) -> bool:
    cells = [cell.strip() for row in rows for cell in row]
    return sum(bool(_DECIMAL_COMMA.fullmatch(cell)) for cell in cells) > sum(
        "." in cell and _is_number(cell) for cell in cells
    )


def splitter(separator: str) -> Callable[[str], list[str]]:
    """What splits a line at a separator of ``TextLayout``."""
    if len(separator) > 1:
        return lambda line: re.split(separator, line.strip())
    return lambda line: next(csv.reader([line], delimiter=separator), [])
