"""``import SOURCE --guess MAP``: the columns of a source, what they may be, and the MAP that says so."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.recordings.autopilot_log import NO_DATE
from aircraft_sysid_ros.recordings.tabular.column_map import TEXT_TIMES, ColumnMap, parse_column_map
from aircraft_sysid_ros.recordings.tabular.guess.ground_track import ground_track_columns
from aircraft_sysid_ros.recordings.tabular.guess.known_kinds import known_lines
from aircraft_sysid_ros.recordings.tabular.guess.known_line import KnownLine
from aircraft_sysid_ros.recordings.tabular.guess.magnitudes import SURFACES, reads_gravity
from aircraft_sysid_ros.recordings.tabular.guess.manoeuvre_tables import joined_manoeuvres
from aircraft_sysid_ros.recordings.tabular.guess.names import (
    TIME,
    guess_name,
    in_company,
    is_asked_for,
    is_command,
    is_elsewhere,
)
from aircraft_sysid_ros.recordings.tabular.guess.quaternions import quaternion_columns
from aircraft_sysid_ros.recordings.tabular.guess.resolve import resolve
from aircraft_sysid_ros.recordings.tabular.guess.series import Column
from aircraft_sysid_ros.recordings.tabular.guess.times import TimeGuess, guess_time, why_no_time
from aircraft_sysid_ros.recordings.tabular.guess.two_sides import two_sided_columns
from aircraft_sysid_ros.recordings.tabular.source import Source, open_source
from aircraft_sysid_ros.recordings.tabular.table import Table, numbers
from aircraft_sysid_ros.text_file import write_whole

_ROWS, _CELLS = 400_000, 24_000_000  # that are looked at, of a table, at most
_MOST_COLUMNS = 400
#: After all other columns, of whatever names.
_OF_ANOTHER = 10_000
#: Day 0 of spreadsheets.
SPREADSHEET = "1899-12-30T00:00:00Z"


@dataclass
class Line:
    """A line of the MAP: a signal, what it is made of, and how sure it is; inactive lines stay commented out."""

    signal: str
    column: str
    expression: str
    unit: str
    sign: float
    offset: float
    active: bool
    certainty: str  # sure, likely, undecided
    evidence: str


@dataclass
class TablePart:
    """What is guessed of one table."""

    file: str | None
    time: TimeGuess | None
    lines: list[Line] = field(default_factory=list)
    unmapped: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class FirstMap:
    """The whole guess."""

    clock: str | None
    parts: list[TablePart]
    notes: list[str]


def guess_map(path: Path, mapping: ServoMapping | None = None) -> FirstMap:
    """What the columns of a file or folder may be; raises InputError where it holds no tables.

    ``mapping``: what the outputs of an autopilot move, for tables of a known kind.
    """
    source = open_source(path)
    tables, notes = _tables(source)
    known = known_lines(source, [table for _, table in tables], mapping)
    if known is not None:
        noted = dict.fromkeys(table.note for _, table in tables if table.note)
        return _of_known_kind(tables, known[0], [*notes, *noted, *known[1]])
    if mapping is not None:
        raise InputError(f"--servos is for logs of autopilots, and {path} is not one that is known")
    notes += [note for _, table in tables if (note := table.note or _without_names(table))]
    looked_at: dict[str | None, tuple[dict[str, npt.NDArray[Any]], TimeGuess | None]] = {}

    def look(file: str | None, table: Table) -> tuple[dict[str, npt.NDArray[Any]], TimeGuess | None]:
        if file not in looked_at:
            content = _content(table)
            looked_at[file] = content, guess_time(table, content)
        return looked_at[file]

    parts, columns = [], []
    for file, table in joined_manoeuvres(tables, lambda pattern, table: look(pattern, table)[1] is not None):
        content, time = look(file, table)
        if time is None:
            notes.append(why_no_time(table, content))
        part = TablePart(file, time)
        parts.append(part)
        named, of_several = _named_columns(table, content, time) if time is not None else ([], set())
        taken = {column.name for column in named} | of_several | ({time.column} if time is not None else set())
        part.unmapped = [name for name in table.columns if name and name not in taken]
        for column in named:
            _weigh_table(column, source.is_bag)
        columns += [(part, column) for column in named]
    _weigh_gravity([column for _, column in columns])
    _count_as_import(parts, columns)
    best = _best_by_signal(columns)
    resolve(best)
    for part, column in columns:
        chosen = best[column.signal]
        part.lines.append(_line(column) if chosen is column else _passed_over(column, chosen))
    parts = [part for part in parts if part.time is not None]
    if not parts:
        raise InputError(f"nothing of {path} can be guessed: {notes[0]}")
    notes += _doubled(tables) + _apart(parts)
    return FirstMap(_clock(parts), parts, notes)


def _without_names(table: Table) -> str:
    """What to do where columns have numbers for names."""
    if table.columns != tuple(str(i + 1) for i in range(len(table.columns))):
        return ""
    return (
        f"the columns of {table.name} have no names, their numbers stand for them: list the names, one a line, in a "
        "text file beside it and guess again, or map the numbers"
    )


def _doubled(tables: list[tuple[str | None, Table]]) -> list[str]:
    """Names that two columns of a table have, of which neither is looked at."""
    return [
        f"{table.name} has several columns '{name}': rename all but one"
        for _, table in tables
        for name in dict.fromkeys(table.columns)
        if name and table.columns.count(name) > 1
    ]


def _count_as_import(parts: list[TablePart], columns: list[tuple[TablePart, Column]]) -> None:
    """Count times that are texts from the time 0 of numbers where the MAP will have no clock, as import does."""
    times = [part.time for part in parts if part.time is not None]
    if _clock(parts) is not None or all(time.unit in TEXT_TIMES for time in times):
        return
    of_columns = [(part.time, column.time) for part, column in columns if part.time is not None]
    for time, seconds in [*((time, time.seconds) for time in times), *of_columns]:
        if time.unit in TEXT_TIMES:
            seconds -= NO_DATE


def _apart(parts: list[TablePart]) -> list[str]:
    """That tables were not recorded at the same time, as their clocks have it: nothing is compared between them."""
    timed = [
        (part.file, part.time, *np.nanpercentile(part.time.seconds, (0, 100)).tolist())
        for part in sorted(parts, key=lambda part: -sum(line.active for line in part.lines))
        if part.time is not None
    ]
    first, _, first_start, first_end = timed[0]
    return [
        f"the clock of {file} ({start:.9g} to {end:.9g} s) does not overlap with that of {first} ({first_start:.9g} to "
        f"{first_end:.9g} s): nothing is compared between them, set the offset of one time, "
        f"{time.in_its_unit(first_start - start)} of {file} if both began together"
        for file, time, start, end in timed[1:]
        if start > first_end or end < first_start
    ]


def known_map(path: Path, mapping: ServoMapping | None = None) -> tuple[ColumnMap, list[str]] | None:
    """The MAP of a source of a known kind, whose columns say what they are, and what it leaves out; None of others."""
    source = open_source(path)
    tables, notes = _tables(source)
    known = known_lines(source, [table for _, table in tables], mapping)
    if known is None:
        return None
    first = _of_known_kind(tables, known[0], notes + known[1])
    return parse_column_map(map_text(first, path)), first.notes


def is_known(path: Path) -> bool:
    """Whether a source is of a known kind."""
    source = open_source(path)
    return known_lines(source, [table for _, table in _tables(source)[0]]) is not None


def _tables(source: Source) -> tuple[list[tuple[str | None, Table]], list[str]]:
    """Tables with the name that ``file`` of a MAP gives them; what cannot be read is a note."""
    if not source.is_folder:
        tables = source.tables("*")
        notes = [*source.notes, *(f"{table.name}: {text}" for table in tables for text in table.said)]
        return [(None if len(tables) == 1 else table.name, table) for table in tables], notes
    found: list[tuple[str | None, Table]] = []
    notes = []
    for file in source.files:
        try:
            tables = source.tables(file.name) if not _is_book(file) else source.tables(f"{file.name}/*")
        except InputError as error:
            notes.append(f"{file.name} is left out: {error}")
            continue
        found += [
            (table.name if table.name == file.name or len(tables) == 1 else f"{file.name}/{table.name}", table)
            for table in tables
        ]
    if not found:
        raise InputError(f"no file in {source.path} holds a table: {notes[0]}")
    return found, notes


def _is_book(file: Path) -> bool:
    return file.suffix.lower() in (".xlsx", ".xlsm", ".mat", ".h5", ".hdf5", ".hdf", ".he5", ".data")


def _content(table: Table) -> dict[str, npt.NDArray[Any]]:
    """The columns of a table by name, as far as they are looked at; those that are there twice are left out."""
    names = [name for name in table.columns if name and table.columns.count(name) == 1][:_MOST_COLUMNS]
    rows = min(_ROWS, _CELLS // max(len(names), 1))
    try:
        pieces = [next(table.read(names, rows), None)] if names else []
    except InputError:  # columns of different length: each alone
        pieces = [{name: next(table.read([name], rows))[name] for name in names}]
    return next((piece for piece in pieces if piece is not None), {})


def _named_columns(
    table: Table, content: dict[str, npt.NDArray[Any]], time: TimeGuess
) -> tuple[list[Column], set[str]]:
    """Columns whose names say what they are, and the names of those that do so together: a quaternion, a track."""
    found = []
    for name, raw in content.items():
        if name == time.column or len(raw) != len(time.seconds):
            continue
        guess = guess_name(in_company(name, content), table.units.get(name, ""), table.name)
        if guess is None or guess.signal == TIME:
            continue
        values, bad = numbers(raw)
        if bad > 0.2 * len(raw):
            continue
        timed = np.isfinite(time.seconds)
        column = Column(
            table.name, name, guess.signal, values[timed], time.seconds[timed], guess.unit, guess.sign, guess.distance
        )
        found.append(column)
    angles, four = quaternion_columns(table.name, content, time.seconds, found)
    velocity, two = ground_track_columns(table.name, content, table.units, time.seconds)
    pairs, sides = two_sided_columns(table.name, content, table.units, time.seconds)
    for column in (*found, *pairs):
        if is_command(column.name):
            _take_as_command(column)
    alone = [column for column in found if column.name not in four]
    return [*alone, *angles, *velocity, *pairs], four | two | sides


def _take_as_command(column: Column) -> None:
    column.sure = False
    column.evidence.append("a command, which the surface follows later")


def _weigh_table(column: Column, is_topic: bool) -> None:
    """What the name of its table says of a column: the topics of a bag hold demands and cameras beside the aeroplane.

    Files are called in many ways, as that of a flight after its target: they only come after others then.
    """
    asked_for = is_asked_for(column.table)
    if not asked_for and not is_elsewhere(column.table, column.signal):
        return
    column.distance += _OF_ANOTHER
    if asked_for and column.signal in (*SURFACES, "throttle"):
        _take_as_command(column)
    elif is_topic:
        column.doubt = f"its topic is called as {'what is asked for' if asked_for else 'that of another body'}"


def _weigh_gravity(columns: list[Column]) -> None:
    """Of columns that may be a_z those come first that read gravity: others are accelerations without it."""
    down = [column for column in columns if column.signal == "specific_force.z"]
    without = [column for column in down if not reads_gravity(column)]
    for column in without if len(without) < len(down) else ():
        column.distance += _OF_ANOTHER


def _best_by_signal(columns: list[tuple[TablePart, Column]]) -> dict[str, Column]:
    best: dict[str, Column] = {}
    for _, column in columns:
        there = best.get(column.signal)
        if there is None or (column.distance, -len(column.values)) < (there.distance, -len(there.values)):
            best[column.signal] = column
    return best


def _line(column: Column) -> Line:
    certainty = "undecided" if not column.is_known else "sure" if column.sure else "likely"
    evidence = "; ".join([*([column.doubt] if column.doubt else []), *column.evidence])
    unit = column.unit or column.said_unit or "?"
    sign = column.sign or column.custom or 1.0
    return Line(
        column.signal, column.name, column.expression, unit, sign, column.offset, column.is_known, certainty, evidence
    )


def _passed_over(column: Column, chosen: Column) -> Line:
    """The line of a column that stays commented out, since another one is taken."""
    of_table = f" of {chosen.table}" if chosen.table != column.table else ""
    told = f"{column.signal} is taken from {chosen.name}{of_table}"
    unit, sign = column.said_unit or "?", column.custom or 1.0
    return Line(column.signal, column.name, column.expression, unit, sign, 0.0, False, "undecided", told)


def _clock(parts: list[TablePart]) -> str | None:
    timed = [part.time for part in parts if part.time is not None]
    if timed and all(time.is_unix for time in timed) and any(time.unit not in TEXT_TIMES for time in timed):
        return "utc"
    if timed and all(time.unit == "days" and _counts_as_spreadsheets(time) for time in timed):
        return SPREADSHEET
    return None


def _counts_as_spreadsheets(time: TimeGuess) -> bool:
    """Whether days are those since SPREADSHEET, from 1982 to 2064."""
    first = float(np.nanmin(time.seconds)) / 86_400.0 if np.isfinite(time.seconds).any() else np.nan
    return 30_000.0 < first < 60_000.0


def _of_known_kind(
    tables: list[tuple[str | None, Table]], known: dict[str, list[KnownLine]], notes: list[str]
) -> FirstMap:
    parts = []
    clock = None
    for file, table in tables:
        lines = known.get(table.name)
        if not lines:
            continue
        first = lines[0]
        evidence, offset = [first.kind], first.time_offset
        time = TimeGuess(first.time, first.time_unit, np.empty(0), first.is_unix, True, evidence, offset=offset)
        clock = "utc" if first.is_unix else clock
        part = TablePart(file, time)
        for line in lines:
            sure, why = "undecided" if line.doubt else "sure", line.doubt or line.why
            part.lines.append(
                Line(line.signal, line.column, line.expression, line.unit, line.sign, 0.0, not line.doubt, sure, why)
            )
        parts.append(part)
        notes = [*notes, *(f"{table.name} is not taken: {doubt}" for doubt in _doubts(lines))]
    return FirstMap(clock, parts, notes)


def _doubts(lines: list[KnownLine]) -> list[str]:
    return list(dict.fromkeys(line.doubt for line in lines if line.doubt))


def write_map(first: FirstMap, path: Path, source: Path) -> None:
    """The guess as a MAP to be checked and edited. Raises InputError where it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, map_text(first, source))
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None


def render_guess(report: dict[str, Any]) -> str:
    """The lines of a guess for people, as report_of gives it."""
    lines = []
    counts = {"sure": 0, "likely": 0, "undecided": 0}
    for table in report["tables"]:
        time = table["time"]
        told = "no time" if time is None else f"time {time['column']} [{time['unit']}]"
        lines.append(f"{table['file'] or report['source']}: {told}")
        for line in table["lines"]:
            counts[line["certainty"]] += 1
            sign = "-" if line["sign"] < 0 else ""
            column = f"{sign}{line['column']} [{line['unit']}]"
            lines.append(f"  {line['certainty']:<9} {line['signal']:<20} {column}  {line['evidence']}")
        if table["not_mapped"]:
            lines.append(f"  no signal by their names: {', '.join(table['not_mapped'])[:500]}")
    lines += [f"note: {note}" for note in report["notes"]]
    if not any(counts.values()):
        lines.append(
            f"no name says what a column is: write into {report['map']} which signals they are (docs/import.md has "
            f"their names), then import with --map {report['map']}"
        )
        return "\n".join(lines)
    lines.append(
        f"{counts['sure']} sure, {counts['likely']} likely, {counts['undecided']} undecided and commented out: "
        f"check {report['map']}, then import with --map {report['map']}"
    )
    return "\n".join(lines)


def map_text(first: FirstMap, source: Path) -> str:
    """The MAP as a text."""
    lines = [
        f"# Guessed from {source}: check every line, and decide those that are commented out.",
        "# Value = sign * (column + offset), in the unit of the column; axes forward-right-down and north-east-down.",
    ]
    lines += [f"# {note}" for note in first.notes]
    if first.clock:
        why = "days are counted as spreadsheets do" if first.clock == SPREADSHEET else "the times are Unix times"
        lines.append(f"clock: {first.clock}  # {why}")
    else:
        lines.append("# clock: 2024-05-31T14:05:00Z  # undecided: what time 0 is")
    lines.append("tables:")
    for part in first.parts:
        lines += _part_text(part)
    return "\n".join(lines) + "\n"


def _part_text(part: TablePart) -> list[str]:
    active = [line for line in part.lines if line.active]
    dead = "" if active and part.time is not None else "# "
    lines = [f"  {dead}- file: {_scalar(part.file)}" if part.file is not None else f"  {dead}-"]
    if part.time is None:
        return []
    evidence = "; ".join(part.time.evidence) + (
        f"; {', '.join(part.time.others)} could be it, too" if part.time.others else ""
    )
    certainty = "sure" if part.time.sure else "likely"
    offset = f", offset: {part.time.offset:.15g}" if part.time.offset else ""
    restarts = ", restarts: true" if part.time.restarts else ""
    time = f"{{column: {_scalar(part.time.column)}, unit: {part.time.unit}{offset}{restarts}}}"
    lines.append(f"  {dead}  time: {time}  # {certainty}: {evidence}")
    if part.file is None:
        lines = [f"  {dead}- {lines[1].split(dead + '  ', 1)[1] if dead else lines[1].strip()}"]
    lines.append(f"  {dead}  signals:")
    for line in part.lines:
        mark = "" if line.active or dead else "# "
        lines.append(f"    {dead}  {mark}{_signal_text(line)}  # {line.certainty}: {line.evidence}")
    if part.unmapped:
        lines.append(f"      # no signal by their names: {', '.join(part.unmapped)[:2000]}")
    return lines


def _signal_text(line: Line) -> str:
    what = f"expression: {_scalar(line.expression)}" if line.expression else f"column: {_scalar(line.column)}"
    sign = ", sign: -1" if line.sign < 0.0 else ""
    offset = f", offset: {line.offset:.10g}" if line.offset else ""
    return f"{line.signal}: {{{what}, unit: {_scalar(line.unit)}{sign}{offset}}}"


def _scalar(text: Any) -> str:
    return str(yaml.safe_dump(str(text), default_style='"', width=10_000, allow_unicode=True)).strip()


def report_of(first: FirstMap, source: Path, path: Path) -> dict[str, Any]:
    """The guess as JSON."""
    return {
        "source": str(source),
        "map": str(path),
        "clock": first.clock,
        "tables": [
            {
                "file": part.file,
                "time": None if part.time is None else {"column": part.time.column, "unit": part.time.unit},
                "lines": [
                    {
                        "signal": line.signal, "column": line.column or line.expression, "unit": line.unit,
                        "sign": int(line.sign), "offset": line.offset, "active": line.active,
                        "certainty": line.certainty, "evidence": line.evidence,
                    }
                    for line in part.lines
                ],
                "not_mapped": part.unmapped,
            }
            for part in first.parts
        ],
        "notes": first.notes,
    }  # fmt: skip
