"""The list of flights of a fleet: from recordings, logs, folders, globs, and files that list flights.

The airframe of a flight is the first folder below the SOURCE in which it was found: of ``flights/N1/may/7.mcap`` in the
source ``flights`` it is N1. A flight that lies in the source itself has the name of that folder. A list says its own.
A folder of tables that say themselves what they are (ulog2csv, rostopic) is one flight.
"""

from __future__ import annotations

import csv
import glob
import itertools
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime, timezone
from pathlib import Path
from types import MappingProxyType
from typing import Any

from aircraft_sysid_ros.after_flight.log_import import BAGS as RECORDINGS
from aircraft_sysid_ros.after_flight.log_import import holds_known_tables, holds_tables
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.raw_messages import printable
from aircraft_sysid_ros.run_reader import PARAMETERS
from aircraft_sysid_ros.yaml_file import read_yaml

AUTOPILOTS = (".ulg", ".ulog", ".bin", ".tlog")
LOGS = (*AUTOPILOTS, ".mat", ".data")
TABLES = (".csv", ".tsv", ".txt", ".parquet", ".h5", ".hdf5", ".xlsx")
LISTS = (".yaml", ".yml", ".csv")
_LONGEST_HEAD = 4096
_UTF8 = "utf-8-sig"  # with a byte-order mark, or without
#: What a list says of a flight; only the recording must be there.
KEYS = ("recording", "name", "airframe", "aircraft", "start", "map", "servos", "calm_air")
#: What stands for the airframe in the names of files.
AIRFRAME = "{airframe}"
_YES_OR_NO = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
_METADATA = "metadata.yaml"
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


@dataclass(frozen=True)
class Flight:
    """One flight: where it is recorded, and what it flew."""

    name: str
    airframe: str
    recording: Path  # or log
    aircraft: Path
    start: int | None = None  # [ns] UTC; None: the first stamp of the recording
    map: Path | None = None  # columns of tables
    servos: Path | None = None  # what the outputs of an autopilot mean
    calm_air: bool = False  # the speed over ground stands for an airspeed that is not measured

    @property
    def is_log(self) -> bool:
        """Whether it must be imported before it can be replayed."""
        if self.recording.is_dir():
            return not _is_bag(self.recording) and holds_tables(self.recording)
        return self.recording.suffix.lower() not in RECORDINGS


@dataclass(frozen=True)
class Files:
    """What flights go with, unless a list says otherwise; ``{airframe}`` in a name stands for that of each."""

    aircraft: str | None
    map: str | None = None
    servos: str | None = None
    calm_air: bool = False


def flights_of(sources: Sequence[str], files: Files, out: Path) -> list[Flight]:
    """All flights, by airframe and name. Raises InputError where there are none, and for a name that two have.

    What two sources find alike, or a list says twice, is one flight. ``out`` is not searched. With a map every table
    is a flight.
    """
    if any(Path(source).resolve() == out.resolve() for source in sources):
        raise InputError(
            f"--out {out} is the SOURCE itself, and what a fleet writes is not searched for flights: give --out a "
            f"folder of its own, such as {out / 'fleet'}"
        )
    try:
        found = list(dict.fromkeys(flight for source in sources for flight in _of_source(source, files, out)))
    except OSError as error:
        raise InputError(f"cannot look for flights in {error.filename}: {error.strerror or error}") from None
    if not found:
        raise InputError(
            f"no flight is in {' '.join(sources)}: give recordings (rosbag2), logs ({' '.join(LOGS)}), folders or "
            "patterns that hold some, or a list (docs/fleet.md)"
        )
    found.sort(key=lambda flight: (flight.airframe, flight.name))
    by_name: dict[str, Flight] = {}
    for flight in found:
        other = by_name.setdefault(flight.name, flight)
        if other is not flight:
            raise InputError(
                f"two flights have the name {flight.name}, {other.recording} and {flight.recording}: "
                f"{_how_to_tell_apart(flight.recording, other.recording)}give them names in a list (docs/fleet.md)"
            )
    checked: set[Path] = set()
    for flight in found:
        _check_files(flight, checked)
    return found


def _how_to_tell_apart(one: Path, other: Path) -> str:
    """What a user may do about two recordings with one name, but for a list."""
    if one.stem != other.stem:  # a list has given both the name
        return ""
    if one.parent == other.parent:
        return f"take one kind of file alone by a pattern in quotes, such as '**/*{one.suffix}', or "
    return "give the folder above both as SOURCE, or "


def check_run_folders(flights: Sequence[Flight]) -> None:
    """Raises InputError where the run of one flight would lie in that of another, as N1/7 in N1."""
    parts = sorted((Path(flight.name).parts, flight.name) for flight in flights)
    for (outer, name), (inner, other) in itertools.pairwise(parts):
        if inner[: len(outer)] == outer:
            raise InputError(
                f"with --runs the run of {other} would lie in that of {name}: give them other names in a list "
                "(docs/fleet.md), or leave out --runs"
            )


def _check_files(flight: Flight, checked: set[Path]) -> None:
    for what, file in (("aircraft file", flight.aircraft), ("map", flight.map), ("file of servos", flight.servos)):
        if file is not None and file not in checked and not file.is_file():
            raise InputError(f"the {what} {file} of the airframe {flight.airframe} is not there")
        checked |= {file} if file is not None else set()


def _of_source(source: str, files: Files, out: Path) -> Iterator[Flight]:
    """Flights of one SOURCE."""
    path, endings = Path(source), (*RECORDINGS, *LOGS, *(TABLES if files.map else ()))
    if path.is_file() and path.suffix.lower() in LISTS and (path.suffix.lower() not in endings or _is_list(path)):
        yield from _of_list(path, files)
        return
    if path.exists():
        bases = [(path, path if path.is_dir() and not _is_bag(path) else path.absolute().parent)]
    else:
        base = _fixed_part(source)
        bases = [(Path(match), base) for match in sorted(glob.glob(source, recursive=True))]
        if not bases:
            raise InputError(f"there is no flight {source}: give a recording, a log, a folder, a pattern or a list")
    seen: set[Path] = set()
    for place, base in bases:
        for recording in _recordings(place.absolute(), out.absolute(), endings):
            if recording not in seen:
                seen.add(recording)
                yield _found(recording, base.absolute(), files)


def _is_list(path: Path) -> bool:
    """Whether a table lists recordings and is none."""
    try:
        with path.open(encoding=_UTF8, errors="replace") as file:
            line = file.readline(_LONGEST_HEAD)
            return KEYS[0] in _lower(next(csv.reader([line], delimiter=_separator(line)), []))
    except (OSError, csv.Error):  # said where it is read
        return False


def _fixed_part(pattern: str) -> Path:
    """The folder of a glob before its first wildcard."""
    parts = Path(pattern).parts
    fixed = [part for k, part in enumerate(parts) if not any(map(glob.has_magic, parts[: k + 1]))]
    return Path(*fixed) if fixed else Path()


def _is_bag(folder: Path) -> bool:
    return (folder / _METADATA).is_file()


def _recordings(place: Path, out: Path, endings: Sequence[str], above: tuple[Path, ...] = ()) -> Iterator[Path]:
    """Recordings and logs at or below a place, in the order of their names; runs and hidden folders are no flights.

    ``above``: the folders that the search came through, of which a link may lead to one.
    """
    if place.is_dir() and not _is_bag(place):
        folder = place.resolve()
        if place == out or folder in above or (place / PARAMETERS).is_file():
            return
        if endings[-1] not in TABLES and holds_known_tables(place):
            yield place
            return
        for entry in sorted(place.iterdir()):
            if not entry.name.startswith(".") and (entry.is_dir() or entry.suffix.lower() in endings):
                yield from _recordings(entry, out, endings, (*above, folder))
    elif place.is_dir() or place.suffix.lower() in endings:
        yield place


def _found(recording: Path, base: Path, files: Files) -> Flight:
    """A flight that was found below a folder, or is that folder: one of tables, named as a bag in its place."""
    base = base.parent if recording == base else base
    inside = recording.relative_to(base) if recording.is_relative_to(base) else Path(recording.name)
    airframe = inside.parts[0] if len(inside.parts) > 1 else base.resolve().name or "fleet"
    name = str(inside if recording.is_dir() else inside.with_suffix(""))
    return _with_files(Flight(printable(name), printable(airframe), recording, Path()), files)


def _with_files(flight: Flight, files: Files, said: Mapping[str, str] = MappingProxyType({})) -> Flight:
    """A flight with its files, of which a list may have ``said`` others."""

    def place(key: str) -> Path | None:
        name = said.get(key) or getattr(files, key)
        return Path(name.replace(AIRFRAME, flight.airframe)).absolute() if name else None

    if (aircraft := place("aircraft")) is None:
        raise InputError(f"no aircraft file is named for {flight.recording}: give --aircraft, or a list that names one")
    calm_air = _YES_OR_NO[said["calm_air"]] if "calm_air" in said else files.calm_air
    return replace(flight, aircraft=aircraft, map=place("map"), servos=place("servos"), calm_air=calm_air)


# -- lists ---------------------------------------------------------------------------------------------------


def _of_list(path: Path, files: Files) -> Iterator[Flight]:
    """Flights of a list in YAML or CSV; places are from its folder."""
    for number, entry in enumerate(_entries(path), 1):
        where = f"list of flights {path}: entry {number}"
        if not isinstance(entry, Mapping):
            raise InputError(f"{where} is not a flight: give it {', '.join(KEYS)}")
        unknown = [str(key) for key in entry if key not in KEYS]
        if unknown:
            raise InputError(f"{where} has the unknown key '{unknown[0][:60]}': a flight has {', '.join(KEYS)}")
        said = {key: value for key, value in entry.items() if value not in (None, "")}
        yield _listed(where, said, path.absolute().parent, files)


def _entries(path: Path) -> Sequence[Any]:
    entries: Any = _entries_of_table(path) if path.suffix.lower() == ".csv" else read_yaml(path, "list of flights")
    if not isinstance(entries, list) or not entries:
        raise InputError(f"list of flights {path}: it must be a list of flights with {', '.join(KEYS)}")
    return entries


def _entries_of_table(path: Path) -> list[dict[str, str]]:
    """Entries of a CSV file, as spreadsheets write it: with a byte-order mark, semicolons or tabs, and empty rows."""
    try:
        lines = path.read_text(encoding=_UTF8).splitlines(keepends=True)
        reader = csv.reader(lines, delimiter=_separator("".join(lines[:1])), strict=True)
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (OSError, UnicodeDecodeError) as error:
        reason = (error.strerror or error) if isinstance(error, OSError) else "it is not text in UTF-8"
        raise InputError(f"cannot read the list of flights {path}: {reason}") from None
    except csv.Error as error:
        raise InputError(f"list of flights {path}: line {reader.line_num} is no row of a table: {error}") from None
    names = _lower(rows[0][1]) if rows else []
    for name in filter(None, names):
        if names.count(name) > 1:
            raise InputError(f"list of flights {path}: the first line names {name[:60]} twice")
    for number, row in rows:
        if any(row[len(names) :]):
            raise InputError(f"list of flights {path}: line {number} has more values than names")
    named = [{name: cell for name, cell in zip(names, row, strict=False) if name or cell} for _, row in rows[1:]]
    return [entry for entry in named if any(entry.values())]


def _separator(line: str) -> str:
    """What is between the names in the first line of a CSV file."""
    return max(",;\t", key=line.count)


def _lower(names: Sequence[str]) -> list[str]:
    return [name.strip().lower() for name in names]


def _listed(where: str, entry: Mapping[str, Any], folder: Path, files: Files) -> Flight:
    if "recording" not in entry:
        raise InputError(f"{where} names no recording")
    recording = folder / str(entry["recording"])
    airframe = str(entry.get("airframe", recording.parent.name))
    name = str(entry.get("name", f"{airframe}/{recording.stem}"))
    for what, text in (("airframe", airframe), ("name", name)):
        if not text.isprintable() or text.startswith("/") or ".." in Path(text).parts or not text.strip():
            raise InputError(f"{where} has the {what} '{text[:60]}', which cannot be that of a folder: give another")
    start = _nanoseconds(where, entry["start"]) if "start" in entry else None
    said = {name: str(folder / str(entry[name])) for name in ("aircraft", "map", "servos") if name in entry}
    if "calm_air" in entry:
        said["calm_air"] = str(entry["calm_air"]).strip().lower()
        if said["calm_air"] not in _YES_OR_NO:
            raise InputError(f"{where} has calm_air '{said['calm_air'][:20]}': write true or false")
    return _with_files(Flight(name, airframe, Path(os.path.normpath(recording)), Path(), start), files, said)


def _nanoseconds(where: str, value: Any) -> int:
    """A date or time of ISO 8601 as [ns] UTC; one without a zone is UTC."""
    try:
        if isinstance(value, str):
            value = datetime.fromisoformat(value.strip().replace("Z", "+00:00"))
        elif isinstance(value, date) and not isinstance(value, datetime):
            value = datetime(value.year, value.month, value.day)
        utc = value if value.tzinfo is not None else value.replace(tzinfo=timezone.utc)
        since = utc - _EPOCH
    except (ValueError, AttributeError, TypeError):
        raise InputError(f"{where} has a start that is not a time: write it as 2026-05-31T14:30:00Z") from None
    return (since.days * 86400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000
