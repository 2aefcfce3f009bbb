"""Tables in texts: CSV, TSV, columns between blanks, and messages of Paparazzi, one a line."""

from __future__ import annotations

import gzip
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.tabular.header import (
    PROSE,
    TextLayout,
    listed_names,
    splitter,
    text_layout,
    with_point,
)
from aircraft_sysid_ros.recordings.tabular.table import EMPTY, Table, imported

_HEAD = 1 << 18  # bytes that show the layout
_MESSAGE = re.compile(r"(\d+\.\d+) (\d+) ([A-Z][A-Z0-9_]+)(?: (.*))?$")
#: Endings of tables in text.
_OF_TEXTS = ("csv", "tsv", "txt", "dat", "log")
_CONTROL = re.compile("[\1-\10\16-\32]")  # no text has them
_LONGEST_LINE = 1_000_000
_LONGEST_LIST = 1 << 16  # bytes of a list of names
_TAIL = 1 << 16  # bytes that show how the last lines end


def text_tables(path: Path, name: str) -> tuple[str, list[Table]]:
    """What a text file is, and its tables; raises InputError."""
    encoding, lines = _head(path)
    if lines and sum(bool(_MESSAGE.match(line)) for line in lines[:20]) > 0.8 * len(lines[:20]):
        return "messages of Paparazzi", _message_tables(path)
    layout = text_layout(lines, name)
    header, note = layout.header, ""
    if not header.is_named and (found := names_beside(path, len(header.names))):
        header, note = replace(header, names=found[1], units=found[2]), f"the columns of {name} are named by {found[0]}"
    table = TextTable(name, header.names, header.units, note, path=path, layout=layout, encoding=encoding)
    return f"text with {layout.separator_name}" + (" and decimal commas" if layout.decimal == "," else ""), [table]


def names_beside(path: Path, count: int) -> tuple[str, tuple[str, ...], dict[str, str]] | None:
    """The one file beside a table without a header that lists as many names, one a line; its names and units."""
    found = []
    for file in sorted(path.parent.iterdir()):
        if file == path or not file.is_file() or file.stat().st_size > _LONGEST_LIST:
            continue
        try:
            lines = [line.strip() for line in _head(file)[1] if line.strip()]
        except InputError:
            continue
        if len(lines) == count and (listed := listed_names(lines)):
            found.append((file.name, *listed))
    return found[0] if len(found) == 1 else None


@dataclass(frozen=True)
class TextTable(Table):
    """A text with separators, read by pandas."""

    path: Path = Path()
    layout: TextLayout | None = None
    encoding: str = "utf-8"

    @property
    def said(self) -> list[str]:
        """See Table."""
        rows = self._long_rows()
        found = ["it breaks off in the middle of its last line, which is left out"] if self._breaks_off else []
        if not rows:
            return found
        many, which = (f"{len(rows)} rows have", "the first is data row") if rows[1:] else ("1 row has", "data row")
        return [
            *found,
            f"{many} more cells than the table has columns, {which} {rows[0]}: the cells beyond are left out, "
            "and where an extra separator comes before them the row is wrong",
        ]

    @cached_property  # each reading of columns asks
    def _breaks_off(self) -> bool:
        """Whether the last line has no end, and fewer cells than the one before: its last number may be half of one."""
        assert self.layout is not None
        size = self.path.stat().st_size
        if self.path.suffix.lower() == ".gz" or (size > _TAIL and self.encoding == "utf-16"):
            return False
        with self.path.open("rb") as file:
            file.seek(max(0, size - _TAIL))
            tail = file.read().decode(self.encoding, errors="replace")
        lines = [line for line in tail.splitlines() if line.strip()]
        if len(lines) < 3 or tail.endswith(("\n", "\r", "\0")):
            return False
        split = splitter(self.layout.separator)
        return len(split(lines[-1])) < len(split(lines[-2]))

    def _long_rows(self) -> list[int]:
        """Rows of the data, from 1, with cells beyond the last column; the reader drops those and says nothing."""
        assert self.layout is not None
        separator, found, row = self.layout.separator, [], 0
        split = splitter(separator)
        with _opened(self.path, self.encoding) as file:
            for line in itertools.islice(file, self.layout.header.first_row, None):
                if not line.strip():
                    continue
                row += 1
                if len(separator) > 1 or line.count(separator) >= len(self.columns):
                    found += [row] if any(cell.strip() for cell in split(line)[len(self.columns) :]) else []
        return found

    def pieces(self, positions: Sequence[int], rows: int) -> Iterator[list[npt.NDArray[Any]]]:
        """See Table."""
        pandas = imported("pandas")
        layout = self.layout
        assert layout is not None
        chosen = sorted(set(positions))
        try:
            reader = pandas.read_csv(
                self.path,
                sep=layout.separator,
                decimal=layout.decimal,
                header=None,
                skiprows=layout.header.first_row,
                names=range(len(self.columns)),
                index_col=False,
                usecols=chosen,
                chunksize=rows,
                encoding=self.encoding,
                encoding_errors="replace",
                na_values=list(EMPTY),
                skipinitialspace=True,
                float_precision="round_trip",
                **({"engine": "python"} if layout.separator == PROSE else {"engine": "c", "low_memory": False}),
            )
            with reader:
                for frame, after in itertools.pairwise(itertools.chain(reader, [None])):
                    whole = frame.iloc[:-1] if after is None and self._breaks_off else frame
                    yield [_cleaned(whole[i].to_numpy(), layout.decimal) for i in positions]
        except (ValueError, OSError, EOFError) as error:  # ParserError is a ValueError
            raise InputError(f"{self.name} cannot be read: {error}") from None


@dataclass(frozen=True)
class MessageTable(Table):
    """The messages of one name and aircraft, one a line: time, aircraft, name, fields between blanks or commas."""

    path: Path = Path()
    aircraft: str = ""

    @property
    def said(self) -> list[str]:
        """See Table."""
        return [self.note] if self.note else []

    def pieces(self, positions: Sequence[int], rows: int) -> Iterator[list[npt.NDArray[Any]]]:
        """See Table."""
        found: list[list[float]] = []
        for values in _messages(self.path, self.aircraft, self.name):
            values += [np.nan] * (len(self.columns) - len(values))
            found.append([values[i] for i in positions])
            if len(found) >= rows:
                yield list(np.array(found).T)
                found = []
        if found:
            yield list(np.array(found).T)


def _message_tables(path: Path) -> list[Table]:
    """The messages of the aircraft that has most of them: a ground station logs all that it hears."""
    widths: dict[str, dict[str, int]] = {}
    counts: Counter[str] = Counter()
    with _opened(path) as file:
        for line in file:
            match = _MESSAGE.match(line)
            if match:
                _, aircraft, name, text = match.groups()
                fields = len(re.split(r"[ ,]+", text.strip())) if text else 0
                of_aircraft = widths.setdefault(aircraft, {})
                of_aircraft[name] = max(of_aircraft.get(name, 0), fields)
                counts[aircraft] += 1
    chosen, *others = sorted(counts, key=lambda aircraft: (-counts[aircraft], int(aircraft)))
    left_out = f"the messages of aircraft {chosen} are read, and those of {', '.join(others)} are left out"
    return [
        MessageTable(
            name, ("time", *(str(i + 1) for i in range(width))), {"time": "s"}, left_out * bool(others), path, chosen
        )
        for name, width in sorted(widths[chosen].items())
    ]


def _messages(path: Path, aircraft: str, name: str) -> Iterator[list[float]]:
    with _opened(path) as file:
        for line in file:
            match = _MESSAGE.match(line)
            if match and match.group(2, 3) == (aircraft, name):
                yield [
                    float(match.group(1)),
                    *(_number(text) for text in re.split(r"[ ,]+", (match.group(4) or "").strip())),
                ]


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _is_binary(text: str) -> bool:
    """Whether zero bytes stand in it otherwise than in a few blocks, as a recorder leaves that lost its power."""
    blocks = len(re.findall("\0+", text))
    return blocks > 1 + text.count("\n") // 10 or (blocks > 0 and _CONTROL.search(text) is not None)


def _cleaned(values: npt.NDArray[Any], decimal: str) -> npt.NDArray[Any]:
    """A column (n,) whose texts have no zero bytes, and decimal points: one cell that is no number makes all texts."""
    if values.dtype.kind not in "OTU":
        return values
    texts = [v.replace("\0", "") if isinstance(v, str) else v for v in values]
    if decimal == ",":
        texts = [with_point(v) if isinstance(v, str) else v for v in texts]
    return np.array(texts, dtype=object)


def _opened(path: Path, encoding: str = "utf-8") -> IO[str]:
    if path.suffix.lower() == ".gz":
        return gzip.open(path, "rt", encoding=encoding, errors="replace")
    return path.open(encoding=encoding, errors="replace")


def _head(path: Path) -> tuple[str, list[str]]:
    """Encoding and first lines of a text; raises InputError for what is no text."""
    try:
        with gzip.open(path, "rb") if path.suffix.lower() == ".gz" else path.open("rb") as file:
            start = file.read(_HEAD)
    except (OSError, EOFError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    whole = len(start) < _HEAD
    for encoding in ("utf-16",) if start[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "cp1252"):
        try:
            text = start.decode(encoding)
        except UnicodeDecodeError as error:
            if whole or error.start < len(start) - 4:
                continue
            text = start[: error.start].decode(encoding)
        if _is_binary(text):
            break
        lines = text.replace("\0", "").splitlines()
        if len(max(lines, default="", key=len)) > _LONGEST_LINE:
            break
        return encoding, lines if whole else lines[:-1]
    named = path.name.lower().removesuffix(".gz").rpartition(".")[2] in _OF_TEXTS
    what = "is damaged: it is named as a text file, but holds no text; write it again, or" if named else "is not text:"
    raise InputError(f"{path} {what} give it the ending of its format, such as .parquet, .h5, .mat or .xlsx")
