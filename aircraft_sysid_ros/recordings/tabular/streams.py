"""The mapped columns of all tables as streams on disk: what is in memory is one piece of a table, never all of it."""

from __future__ import annotations

import itertools
import mmap
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.flight_check.signals import interpolated_length
from aircraft_sysid_ros.recordings.imported_log import LATEST
from aircraft_sysid_ros.recordings.tabular.clock import (
    NO_TIME,
    Stamps,
    days_later,
    first_of_day,
    goes_on_past_midnight,
    stamps_of,
)
from aircraft_sysid_ros.recordings.tabular.column_map import ColumnMap, MappedSignal, TableMap
from aircraft_sysid_ros.recordings.tabular.signals import place_in_vector, unit_of, vector_of, wild_beyond
from aircraft_sysid_ros.recordings.tabular.source import Source, natural_order
from aircraft_sysid_ros.recordings.tabular.table import Piece, Table, numbers
from aircraft_sysid_ros.samples import PAUSE
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]
ROWS = 50_000  # of a piece
#: [ns] between manoeuvres of which each begins at its own time 0: longer than anything in a filter remembers.
_PAUSE = int(PAUSE * NANOSECONDS)
_FEWEST_ROWS = 3  # between restarts of a time
#: Commands may stand still, and so does warm air; of everything else that repeats itself most of the time only what is
#: new was measured.
_MAY_STAND_STILL = ("controls", "inputs", "mass", "air_temperature")
#: A GPS measures these at once; its height, or its climb, may come from another sensor that is faster.
_OVER_GROUND = ("latitude", "longitude", "position.north", "position.east", "velocity.north", "velocity.east")
_DAY = 86_400.0  # [s]
_EPOCH = datetime.fromtimestamp(0, timezone.utc)
_HELD_SHARE, _FEWEST_NEW = 0.45, 10  # fewer new ones are no sensor but a constant
_LONGEST_HELD = 2.5  # times the usual number of rows, of nine in ten
#: A slow sensor whose value stands still for so long [s], and for so many of its steps, is said to; and so many times.
_STANDSTILL, _STANDSTILLS_OF_STEPS, _MOST_STANDSTILLS = 1.0, 10.0, 3
_SLOWEST = 5.0 * NANOSECONDS  # usual time between new values: what is slower has been rounded off


@dataclass(eq=False)
class Stream:
    """One vector or number of one table: stamps [ns] (n,) and values in SI (n, k), in files.

    Components are in the order of VECTORS, as far as they are there.
    """

    name: str
    signals: tuple[str, ...]
    source: str
    folder: Path
    count: int = 0
    repeated: int = 0
    repeated_over_ground: int = 0  # rows with the same values of _OVER_GROUND as the one before
    measured: set[str] = field(default_factory=set)  # signals that have a value anywhere
    marks: list[int] = field(default_factory=list, repr=False)  # stamp [ns] of every ROWS-th row
    newest: int = 0  # stamp [ns]
    _number: int = field(default_factory=itertools.count().__next__)
    _steps: dict[int, float] = field(default_factory=dict)
    _last: Array | None = field(default=None, repr=False)
    _opened: tuple[mmap.mmap, ...] = field(default=(), repr=False)

    @property
    def _files(self) -> tuple[Path, Path]:
        return self.folder / f"{self._number}.stamps", self.folder / f"{self._number}.values"

    def add(self, stamp: Stamps, values: Array) -> None:
        """Rows (n, k) in which anything is measured."""
        there = np.isfinite(values)
        self.measured.update(self.signals[i] for i in np.flatnonzero(there.any(axis=0)))
        measured = there.any(axis=1)
        stamp, values = stamp[measured], values[measured]
        if not len(stamp):
            return
        before = np.full((1, values.shape[1]), np.nan) if self._last is None else self._last
        rows = np.concatenate([before, values])
        same = (rows[1:] == rows[:-1]) | (np.isnan(rows[1:]) & np.isnan(rows[:-1]))
        self.repeated += int(same.all(axis=1).sum())
        if columns := self._over_ground:
            self.repeated_over_ground += int((rows[1:, columns] == rows[:-1, columns]).all(axis=1).sum())
        self.marks += stamp[-self.count % ROWS :: ROWS].tolist()
        self.newest = int(stamp[-1])
        self.count += len(stamp)
        self._last = values[-1:]
        for file, content in zip(self._files, (stamp, values), strict=True):
            with file.open("ab") as out:
                np.ascontiguousarray(content).tofile(out)

    @property
    def _over_ground(self) -> list[int]:
        """The columns of _OVER_GROUND."""
        return [i for i, signal in enumerate(self.signals) if signal in _OVER_GROUND]

    @property
    def held(self) -> list[int]:
        """The columns of which most rows repeat the one before; none where no slow sensor is in the rows of a fast one.

        What was rounded off repeats itself, too, but for as long as the flight has it: an altitude in whole feet.
        """
        every = list(range(len(self.signals)))
        if self._is_held(self.repeated, every):
            return every
        return self._over_ground if self._is_held(self.repeated_over_ground, self._over_ground) else []

    def _is_held(self, repeated: int, columns: list[int]) -> bool:
        """Whether most rows repeat the one before in some columns, for about as many rows each time."""
        is_slow = repeated > _HELD_SHARE * self.count and self.count - repeated >= _FEWEST_NEW
        if not is_slow or self.name in _MAY_STAND_STILL:
            return False
        runs = np.diff(np.flatnonzero(np.concatenate([fresh for _, fresh in self._fresh(columns)])))
        usual, longer = np.percentile(runs, (50, 90))
        return bool(usual >= 2 and longer <= _LONGEST_HELD * usual and usual * self.step <= _SLOWEST)

    @property
    def stamp(self) -> Stamps:
        """All stamps (n,), mapped from the file."""
        return self._mapped()[0]

    @property
    def values(self) -> Array:
        """All values (n, k), mapped from the file."""
        return self._mapped()[1]

    @property
    def step(self) -> float:
        """Typical time [ns] between two rows."""
        stamp = self.stamp
        return float(np.median(np.diff(stamp[: 4 * ROWS]))) if len(stamp) > 1 else np.inf

    def step_of(self, component: int) -> float:
        """Typical time [ns] between two rows in which a component is measured."""
        if component not in self._steps:
            measured = self.stamp[: 4 * ROWS][np.isfinite(self.values[: 4 * ROWS, component])]
            self._steps[component] = float(np.median(np.diff(measured))) if len(measured) > 1 else np.inf
        return self._steps[component]

    def is_on_the_stamps_of(self, other: Stream) -> bool:
        """Whether its rows have the times of those of another one."""
        if self is other or self.count != other.count:
            return self is other
        for first in range(0, self.count, ROWS):
            if not np.array_equal(self.stamp[first : first + ROWS], other.stamp[first : first + ROWS]):
                return False
            self.forget()
            other.forget()
        return True

    @property
    def interpolated(self) -> int:
        """How many rows stand for one that was measured, where those between lie on straight lines; else 1."""
        if self.name in _MAY_STAND_STILL:
            return 1
        time = (self.stamp[: 4 * ROWS] - self.stamp[0]) * 1e-9
        return round(min(interpolated_length(time, values) for values in self.values[: 4 * ROWS].T))

    def every(self, number: int) -> Stream:
        """The first of so many rows."""
        new = Stream(self.name, self.signals, self.source, self.folder)
        for first in range(0, self.count, ROWS):
            rows = slice(first + -first % number, first + ROWS, number)
            new.add(np.array(self.stamp[rows]), np.array(self.values[rows]))
            self.forget()
        return new

    def without_repeats(self, columns: list[int]) -> Stream:
        """The rows that differ from the one before in some columns."""
        new = Stream(self.name, self.signals, self.source, self.folder)
        for first, fresh in self._fresh(columns):
            rows = slice(first, first + ROWS)
            new.add(self.stamp[rows][fresh], self.values[rows][fresh])
            self.forget()
        return new

    def _fresh(self, columns: list[int]) -> Iterator[tuple[int, npt.NDArray[np.bool_]]]:
        """Piece by piece its first row, and which of its rows differ from the one before in some columns."""
        last = np.full((1, len(columns)), np.inf)
        for first in range(0, self.count, ROWS):
            values = np.array(self.values[first : first + ROWS, columns])
            rows = np.concatenate([last, values])
            same = (rows[1:] == rows[:-1]) | (np.isnan(rows[1:]) & np.isnan(rows[:-1]))
            last = values[-1:]
            self.forget()
            yield first, ~same.all(axis=1)

    def forget(self) -> None:
        """Take what was read out of memory: pages of a mapped file count as this process's until they are given up."""
        for opened in self._opened:
            opened.madvise(mmap.MADV_DONTNEED)

    def _mapped(self) -> tuple[Stamps, Array]:
        if not self._opened:
            self._opened = tuple(_map(file) for file in self._files)
        stamps, values = self._opened
        shape = (self.count, len(self.signals))
        return np.frombuffer(stamps, np.int64), np.frombuffer(values, np.float64).reshape(shape)


def _map(path: Path) -> mmap.mmap:
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


@dataclass
class Collected:
    """All streams of a source, and what its user should know."""

    streams: list[Stream]
    notes: list[str]
    unmapped: int  # columns that the tables have besides
    manoeuvres: list[tuple[int, int]] = field(default_factory=list)  # first and last stamp [ns] between restarts


def collect(source: Source, colmap: ColumnMap, folder: Path) -> Collected:
    """Read every mapped column into ``folder``; raises InputError."""
    collected, of_tables = Collected([], [], 0), []
    for table_map in colmap.tables:
        known = len(collected.streams)
        try:
            _collect_table(source, table_map, colmap, folder, collected)
        except InputError as error:
            raise InputError(f"the table in line {table_map.line} of the map: {error}") from None
        of_tables.append((table_map.line, [stream for stream in collected.streams[known:] if stream.count]))
    collected.notes += _apart(of_tables)
    collected.streams = [_settled(stream, collected.notes) for stream in collected.streams if stream.count]
    return collected


def _apart(of_tables: list[tuple[int, list[Stream]]]) -> list[str]:
    """That tables, each with its line of the map, have no time in common; raises InputError where days are between."""
    spans = [(line, min(s.marks[0] for s in of), max(s.newest for s in of)) for line, of in of_tables if of]
    line, start, end = max(spans, key=lambda span: span[2] - span[1], default=(0, 0, 0))
    found = []
    for other, begin, stop in spans:
        apart = max(begin - end, start - stop) / NANOSECONDS
        if apart > _DAY:
            raise InputError(
                f"the tables in lines {line} and {other} of the map are {apart / _DAY:.0f} days apart: set 'clock', or "
                "the 'offset' of one of their times"
            )
        if apart > 0.0:
            found.append(
                f"the tables in lines {line} and {other} of the map have no time in common, {apart:.6g} s are between "
                "them: set the 'offset' of one of their times"
            )
    return found


def _settled(stream: Stream, notes: list[str]) -> Stream:
    if not (held := stream.held):
        if (number := stream.interpolated) < 2:
            return stream
        new = stream.every(number)
        notes.append(
            f"{stream.name}: its rows lie on straight lines between one of {number} and the next, {new.count} of "
            f"{stream.count} are kept"
        )
        return new
    new = stream.without_repeats(held)
    alone = "" if len(held) == len(stream.signals) else f" in {' and '.join(stream.signals[i] for i in held)}"
    notes.append(
        f"{stream.name}: {stream.count - new.count} of {stream.count} rows only repeat the one before{alone} "
        "and are left out"
    )
    notes += [
        f"{stream.name}: its value does not change from {begin:.1f} to {end:.1f} s: it is stuck there, or nothing "
        "came; that time is a gap"
        for begin, end in _standstills(stream, new)
    ]
    return new


def _standstills(stream: Stream, fresh: Stream) -> list[tuple[float, float]]:
    """From where to where [s, from the first row on] rows only repeat for long, of ``fresh`` without repeats: the
    longest, three at most. Where there are no rows at all is a gap of the log.
    """
    stamps = np.append(fresh.stamp, stream.stamp[-1])  # it may stand still to the end
    between = np.diff(stamps)
    rows = np.diff(np.searchsorted(stream.stamp, stamps)) * stream.step  # time that rows fill
    least = max(_STANDSTILL * NANOSECONDS, _STANDSTILLS_OF_STEPS * float(np.median(between)))
    lasting = np.where(rows > 0.5 * between, between, 0)
    longest = sorted(np.argsort(-lasting)[:_MOST_STANDSTILLS])
    time = (stamps - stream.stamp[0]) * 1e-9
    found = [(float(time[i]), float(time[i + 1])) for i in longest if lasting[i] > least]
    fresh.forget()
    stream.forget()
    return found


def _collect_table(source: Source, table_map: TableMap, colmap: ColumnMap, folder: Path, collected: Collected) -> None:
    tables = source.tables(table_map.file)
    by_vector: dict[str, list[MappedSignal]] = {}
    for signal in sorted(table_map.signals, key=lambda signal: place_in_vector(signal.name)):
        by_vector.setdefault(vector_of(signal.name), []).append(signal)
    streams = {
        name: Stream(name, tuple(s.name for s in signals), " ".join(dict.fromkeys(s.source for s in signals)), folder)
        for name, signals in by_vector.items()
    }
    reader = _TableReader(table_map, colmap, collected.notes)
    for table in reader.in_order(tables):
        for stamp, values in reader.rows(table):
            for name, signals in by_vector.items():
                streams[name].add(stamp, np.stack([values[s.name] for s in signals], axis=1))
    collected.manoeuvres += reader.manoeuvres
    used = {column for signal in table_map.signals for column in signal.columns} | {table_map.time.column}
    collected.unmapped += sum(len([name for name in table.columns if name]) for table in tables) - len(used) * len(
        tables
    )
    collected.streams += streams.values()
    empty = [s.name for name, signals in by_vector.items() for s in signals if s.name not in streams[name].measured]
    if empty and len(empty) == len(table_map.signals):
        raise InputError(f"{', '.join(table.name for table in tables)} holds no values of the mapped columns")
    collected.notes += [f"{name}: what it is mapped to holds no number: check that line" for name in empty]


@dataclass
class _Wild:
    """Values of a signal that were never measured."""

    signal: str
    source: str
    unit: str
    limit: float
    count: int = 0
    largest: float = 0.0

    def __str__(self) -> str:
        beyond = f"{self.limit:g} {'' if self.unit == '1' else self.unit}".rstrip()
        found = f"{self.count} value{'s' * (self.count > 1)} of {self.signal} from {echo(self.source)} beyond {beyond}"
        return f"{found}, the largest {self.largest:.3g}, {'are' if self.count > 1 else 'is'} taken as not measured"


class _TableReader:
    """Reads rows of tables that follow one another, with checks that go over all of them."""

    def __init__(self, table_map: TableMap, colmap: ColumnMap, notes: list[str]) -> None:
        self.map, self.clock, self.notes = table_map, colmap.clock, notes
        self.columns = list(
            dict.fromkeys([table_map.time.column, *(c for signal in table_map.signals for c in signal.columns)])
        )
        self._last: int | None = None
        self._last_table = ""
        self._read: int | None = None  # stamp [ns] of the newest row, as its clock shows it
        self._days = 0  # [ns] since that clock passed midnight
        self._shift = 0  # [ns] by which what follows restarts of the time is later
        self._wild: dict[str, _Wild] = {}  # by signal, of the table that is read
        self._begins: list[int] = []
        self._ends: list[int] = []
        self._rows = 0  # since the last restart

    @property
    def manoeuvres(self) -> list[tuple[int, int]]:
        """First and last stamp [ns] of what is between restarts; nothing where the time may not restart."""
        if not self.map.time.restarts or self._last is None:
            return []
        return list(zip(self._begins, [*self._ends, self._last], strict=True))

    def in_order(self, tables: list[Table]) -> list[Table]:
        """Tables of one pattern by their first time, past midnight too, or by their names where each starts over."""
        for table in tables:
            table.position(self.map.time.column)
            for signal in self.map.signals:
                self._check_columns(table, signal)
        if len(tables) < 2:
            return tables
        if self.map.time.restarts:
            return sorted(tables, key=lambda table: natural_order(table.name))

        begins = np.array([next(self._shown(table, 1000), (LATEST,))[0] for table in tables])
        tables, begins = [tables[i] for i in np.argsort(begins, kind="stable")], np.sort(begins)
        first = first_of_day(begins)
        if not first:
            return tables
        *_, (_, end) = self._shown(tables[-1], ROWS)
        return tables[first:] + tables[:first] if goes_on_past_midnight(end, int(begins[0])) else tables

    def _shown(self, table: Table, rows: int) -> Iterator[tuple[int, ...]]:
        """First and last time [ns] of pieces of a table as its clock shows them: since midnight, or since 1970."""
        time = replace(self.map.time, offset=0.0)
        for piece in table.read([time.column], rows):
            stamp = stamps_of(piece[time.column], time, _EPOCH, self._time_of(table))
            stamp = stamp[stamp != NO_TIME]
            if len(stamp):
                yield int(stamp[0]), int(stamp[-1])

    def _check_columns(self, table: Table, signal: MappedSignal) -> None:
        for column in signal.columns:
            try:
                table.position(column)
            except InputError as error:
                raise InputError(f"{signal.name} in line {signal.line}: {error}") from None

    def rows(self, table: Table) -> Iterator[tuple[Stamps, dict[str, Array]]]:
        """Stamps (n,) that rise, and values of every signal in SI (n,), piece by piece."""
        read = unnumbered = timeless = doubled = 0
        for piece in table.read(self.columns, ROWS):
            stamp = self._stamps(piece, table)
            timed = stamp != NO_TIME
            self._go_on_past_midnight(stamp, timed, table)
            timeless += int((~timed).sum())
            if self.map.time.restarts:
                stamp = self._run_on(stamp, timed)
            self._check_order(stamp, timed, table, read)
            kept = timed & self._differs(stamp, timed)
            doubled += int((timed & ~kept).sum())
            read += len(stamp)
            columns, bad = _as_numbers(piece, kept, self.map.time.column)
            unnumbered += bad
            if kept.any():
                self._last, self._last_table = int(stamp[kept][-1]), table.name
                yield stamp[kept], {signal.name: self._measured(signal, columns) for signal in self.map.signals}
        for wild in self._wild.values():
            self.notes.append(f"{table.name}: {wild}")
        self._wild.clear()
        self.notes += [f"{table.name}: {text}" for text in table.said]
        self._note(table, unnumbered, f"{'is' if unnumbered == 1 else 'are'} not a number and left out", "cell")
        self._note(table, timeless, "without a time left out", "row")
        self._note(table, doubled, "with the time of the row before left out", "row")

    def _measured(self, signal: MappedSignal, columns: dict[str, Array]) -> Array:
        """Values (n,) in SI, without those that nothing has."""
        values = _value(signal, columns)
        limit = wild_beyond(signal.name)
        wild = np.abs(values) > limit
        if wild.any():
            new = _Wild(signal.name, signal.source, unit_of(signal.name) or "", limit)
            found = self._wild.setdefault(signal.name, new)
            found.count += int(wild.sum())
            found.largest = max(found.largest, float(np.abs(values[wild]).max()))
            values = np.where(wild, np.nan, values)
        return values

    def _note(self, table: Table, count: int, what: str, thing: str) -> None:
        if count:
            self.notes.append(f"{table.name}: {count} {thing}{'s' * (count > 1)} {what}")

    def _stamps(self, piece: Piece, table: Table) -> Stamps:
        column = self.map.time.column
        return stamps_of(piece[column], self.map.time, self.clock, self._time_of(table))

    def _time_of(self, table: Table) -> str:
        return f"the time column '{self.map.time.column}' of {table.name}"

    def _go_on_past_midnight(self, stamp: Stamps, timed: npt.NDArray[np.bool_], table: Table) -> None:
        """Make stamps (n,) of a clock of a day go on where it passed midnight."""
        there = stamp[timed]
        if not len(there):
            return
        before = int(there[0]) if self._read is None else self._read
        later = days_later(there, before)
        self._read = int(there[-1])
        if later[-1]:
            self.notes.append(f"{table.name}: its clock passed midnight, and goes on from there")
        stamp[timed] = there + self._days + later
        self._days += int(later[-1])

    def _check_order(self, stamp: Stamps, timed: npt.NDArray[np.bool_], table: Table, read: int) -> None:
        rows = np.flatnonzero(timed)
        if not len(rows):
            return
        there = stamp[rows]
        if there.min() < 0 or there.max() > LATEST:
            raise InputError(
                f"the time of {table.name} is outside of 1970 to 2038: check its unit, and with 'clock' what time 0 is"
            )
        before = np.concatenate([[there[0] if self._last is None else self._last], there[:-1]])
        back = np.flatnonzero(there < before)
        if not len(back):
            return
        i = back[0]
        row, seconds = read + int(rows[i]) + 1, (before[i] - there[i]) / NANOSECONDS
        if i == 0 and self._last_table not in ("", table.name):
            raise InputError(
                f"{table.name} begins {seconds:g} s before {self._last_table} ends: map them as two tables"
            )
        raise InputError(
            f"the time of {table.name} goes back by {seconds:g} s at data row {row}: "
            "sort the rows, or write restarts: true into its time in the map "
            "where every manoeuvre starts over"
        )

    def _run_on(self, stamp: Stamps, timed: npt.NDArray[np.bool_]) -> Stamps:
        """Stamps (n,) that go on after every restart, a pause later."""
        out, rows = stamp.copy(), np.flatnonzero(timed)
        if not len(rows):
            return out
        there = stamp[rows] + self._shift
        before = np.concatenate([[there[0] if self._last is None else self._last], there[:-1]])
        again = there < before
        self._check_lengths(np.flatnonzero(again), len(rows))
        out[rows] = there + np.cumsum(np.where(again, before - there + _PAUSE, 0))
        self._shift += int(out[rows[-1]] - there[-1])
        self._begins += ([] if self._begins else [int(out[rows[0]])]) + out[rows[again]].tolist()
        self._ends += (out[rows[again]] - _PAUSE).tolist()
        return out

    def _check_lengths(self, again: npt.NDArray[np.intp], rows: int) -> None:
        """Refuse a time that goes back after a row or two: no manoeuvre is as short."""
        shortest = min(np.diff([-self._rows, *again]).tolist(), default=_FEWEST_ROWS)
        if shortest < _FEWEST_ROWS:
            unit = "row" if shortest == 1 else "rows"
            raise InputError(
                f"the time column '{self.map.time.column}' goes back after {shortest} {unit}, and restarts: true takes "
                "that for a manoeuvre: sort the rows, or map another column as the time"
            )
        self._rows = rows - int(again[-1]) if len(again) else self._rows + rows

    def _differs(self, stamp: Stamps, timed: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Rows whose time differs from that of the timed row before."""
        differs = np.ones(len(stamp), dtype=bool)
        rows = np.flatnonzero(timed)
        if len(rows):
            before = np.concatenate([[NO_TIME if self._last is None else self._last], stamp[rows][:-1]])
            differs[rows] = stamp[rows] != before
        return differs


def _as_numbers(piece: Piece, kept: npt.NDArray[np.bool_], time: str) -> tuple[dict[str, Array], int]:
    columns: dict[str, Array] = {}
    bad = 0
    for name, values in piece.items():
        columns[name], count = numbers(values[kept])
        bad += count if name != time else 0
    return columns, bad


def _value(signal: MappedSignal, columns: dict[str, Array]) -> Array:
    if signal.expression:
        raw = signal.expression.evaluate({name: columns[name] for name in signal.expression.columns})
    else:
        raw = columns[str(signal.column)]
    if signal.offset:
        raw = raw + signal.offset
    with np.errstate(over="ignore"):  # said of what is beyond any number
        converted = signal.convert(raw)
    return np.asarray(-converted if signal.sign < 0.0 else converted, dtype=np.float64)
