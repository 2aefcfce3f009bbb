"""MAP: which column is which signal, with unit, sign and clock. Read strictly: nothing in it is ignored or guessed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NoReturn

import yaml

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.tabular.column_expression import ColumnExpression, parse_column_expression
from aircraft_sysid_ros.recordings.tabular.signals import check_signal, near, unit_of
from aircraft_sysid_ros.recordings.tabular.units import Conversion, conversion

UTC, GPS = "utc", "gps"
#: Unit of a time of day in one number, as receivers of GPS write it: 140530.2 is 14:05:30.2.
HHMMSS = "hhmmss"
#: Units of a time that is a text or a time of day: date-times or times of day, day of the year:hour:minute:second.
TEXT_TIMES = ("iso", "irig", HHMMSS)
_LARGEST_MAP = 1_000_000  # characters
_LONGEST_SOURCE = 60


@dataclass(frozen=True)
class TimeBase:
    """The clock of a table: time [ns] is (column + offset) in ``unit``; of a text, offset is in seconds.

    restarts: it may go back, where another manoeuvre begins.
    """

    column: str
    unit: str
    offset: float
    line: int
    restarts: bool = False


@dataclass(frozen=True)
class MappedSignal:
    """A signal in SI is ``sign`` times the conversion of (column or expression + ``offset``), which is in ``unit``."""

    name: str
    column: str | None
    expression: ColumnExpression | None
    convert: Conversion
    unit: str
    sign: float
    offset: float
    line: int

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that it reads."""
        return self.expression.columns if self.expression else (str(self.column),)

    @property
    def source(self) -> str:
        """What it is made of, for a report: of a long expression its columns."""
        if self.expression is None:
            return str(self.column)
        return self.expression.text if len(self.expression.text) <= _LONGEST_SOURCE else " ".join(self.columns)


@dataclass(frozen=True)
class TableMap:
    """What one table, or several of one pattern, give."""

    file: str | None
    time: TimeBase
    signals: tuple[MappedSignal, ...]
    line: int


@dataclass(frozen=True)
class ColumnMap:
    """A whole MAP; ``clock`` is UTC, GPS, the moment of time 0, or None where nobody knows."""

    clock: str | datetime | None
    tables: tuple[TableMap, ...]


def load_column_map(path: str | Path) -> ColumnMap:
    """Read and check a MAP; raises InputError that names the file, the line and what to correct."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
        raise InputError(f"cannot read the map {path}: {reason}") from None
    try:
        return parse_column_map(text)
    except InputError as error:
        raise InputError(f"map {path}: {error}") from None


def parse_column_map(text: str) -> ColumnMap:
    """A MAP from its text; raises InputError with the line."""
    if len(text) > _LARGEST_MAP:
        raise InputError("it is not a map: it is larger than 1 MB")
    try:
        node = yaml.compose(text, yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        raise InputError(f"it is not valid YAML{f' at line {mark.line + 1}' if mark else ''}") from None
    except RecursionError:
        raise InputError("it is not valid YAML: it is nested too deeply") from None
    if node is None:
        raise InputError("it is empty: write the key 'tables'")
    top = _mapping(node, "the map", ("clock", "tables"))
    tables = _required(top, "tables", node)
    if not isinstance(tables, yaml.SequenceNode) or not tables.value:
        _fail(tables, "'tables' must be a list of tables, each with 'time' and 'signals'")
    clock = _clock(top["clock"]) if "clock" in top else None
    return ColumnMap(clock, _without_repeats([_table(each) for each in tables.value]))


def _without_repeats(tables: list[TableMap]) -> tuple[TableMap, ...]:
    seen: dict[str, int] = {}
    for table in tables:
        for signal in table.signals:
            if signal.name in seen:
                raise InputError(
                    f"line {signal.line}: {signal.name} is mapped twice, first in line {seen[signal.name]}: remove one"
                )
            seen[signal.name] = signal.line
    again = [table.time for table in tables if table.time.restarts]
    if len(again) > 1:
        raise InputError(f"line {again[1].line}: the time of one table alone may have 'restarts': join the tables")
    return tuple(tables)


def _clock(node: Any) -> str | datetime:
    text = _text(node, "clock")
    if text.lower() in (UTC, GPS):
        return text.lower()
    try:
        moment = datetime.fromisoformat(re.sub(r"[zZ]$", "+00:00", text.strip()))
    except ValueError:
        _fail(node, f"clock '{text}' is not known: write utc, gps, or when time 0 was, such as 2024-05-31T14:05:00Z")
    return moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)


def _table(node: Any) -> TableMap:
    keys = _mapping(node, "a table", ("file", "time", "signals"))
    file = _text(keys["file"], "file") if "file" in keys else None
    signals = _required(keys, "signals", node)
    mapped = tuple(_signal(key, value) for key, value in _items(signals, "signals"))
    if not mapped:
        _fail(signals, "'signals' is empty: name at least one")
    return TableMap(file, _time(_required(keys, "time", node)), mapped, node.start_mark.line + 1)


def _time(node: Any) -> TimeBase:
    if isinstance(node, yaml.SequenceNode):
        _fail(node, "a table has one time column: leave the others out")
    keys = _mapping(node, "time", ("column", "unit", "offset", "restarts"))
    column = _text(_required(keys, "column", node), "column")
    unit = _text(_required(keys, "unit", node), "unit")
    if unit.lower() in TEXT_TIMES:
        unit = unit.lower()
    else:
        try:
            conversion(unit, "s")
        except InputError as error:
            _fail(keys["unit"], f"time: {error}; for times as text write iso or irig, for 140530.2 hhmmss")
    offset, restarts = _number(keys.get("offset"), "offset", 0.0), _truth(keys.get("restarts"), "restarts")
    return TimeBase(column, unit, offset, node.start_mark.line + 1, restarts)


def _signal(key: Any, node: Any) -> MappedSignal:
    name = str(key.value)
    try:
        check_signal(name)
    except InputError as error:
        _fail(key, str(error))
    keys = _mapping(node, name, ("column", "expression", "unit", "sign", "offset"))
    if ("column" in keys) == ("expression" in keys):
        _fail(node, f"{name} needs either 'column' or 'expression'")
    unit = _text(_required(keys, "unit", node), "unit")
    try:
        convert = conversion(unit, unit_of(name))
        expression = parse_column_expression(_text(keys["expression"], "expression")) if "expression" in keys else None
    except InputError as error:
        _fail(node, f"{name}: {error}")
    sign = _number(keys.get("sign"), "sign", 1.0)
    if sign not in (1.0, -1.0):
        _fail(keys["sign"], f"sign of {name} must be 1 or -1: a scale belongs into the unit or an expression")
    column = _text(keys["column"], "column") if "column" in keys else None
    offset = _number(keys.get("offset"), "offset", 0.0)
    return MappedSignal(name, column, expression, convert, unit, sign, offset, key.start_mark.line + 1)


def _items(node: Any, what: str) -> Iterator[tuple[Any, Any]]:
    """Keys and values of a mapping, each key once."""
    if not isinstance(node, yaml.MappingNode):
        _fail(node, f"{what} must be a mapping of keys to values")
    seen: dict[str, int] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            _fail(key, f"a key of {what} is not text")
        if key.value in seen:
            _fail(key, f"the key '{key.value}' is there twice, first in line {seen[key.value]}: remove one")
        seen[key.value] = key.start_mark.line + 1
        yield key, value


def _mapping(node: Any, what: str, known: tuple[str, ...]) -> dict[str, Any]:
    found = {}
    for key, value in _items(node, what):
        if key.value not in known:
            _fail(key, f"unknown key '{key.value}' of {what}: {near(key.value, known)}")
        found[key.value] = value
    return found


def _required(keys: dict[str, Any], key: str, node: Any) -> Any:
    if key not in keys:
        _fail(node, f"the key '{key}' is missing: add it")
    return keys[key]


def _text(node: Any, key: str) -> str:
    if not isinstance(node, yaml.ScalarNode) or node.tag == "tag:yaml.org,2002:null":
        _fail(node, f"'{key}' must be a text")
    return str(node.value)


def _number(node: Any, key: str, default: float) -> float:
    if node is None:
        return default
    try:
        value = float(node.value)
    except (TypeError, ValueError, AttributeError):
        _fail(node, f"'{key}' must be a number")
    if not abs(value) < 1e300:
        _fail(node, f"'{key}' must be finite")
    return value


def _truth(node: Any, key: str) -> bool:
    if node is None:
        return False
    if getattr(node, "value", None) not in ("true", "false"):
        _fail(node, f"'{key}' must be true or false")
    return bool(node.value == "true")


def _fail(node: Any, sentence: str) -> NoReturn:
    raise InputError(f"line {node.start_mark.line + 1}: {sentence}")
