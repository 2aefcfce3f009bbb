"""SQLite files of rosbag2, row by row, from both ends where pages between cannot be read.

SQLite has no checksums: its own check finds damaged pages and indexes, but no wrong bit inside a message.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from yaml import YAMLError

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import losses
from aircraft_sysid_ros.recordings.raw_messages import Channel, RawMessages, printable
from aircraft_sysid_ros.yaml_file import parse_yaml

_ROWS = "SELECT id, topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id"
#: What a recorder that died leaves beside the file.
_JOURNALS = ("-wal", "-journal")
#: The table in which newer recorders state how much they wrote.
METADATA_TABLE = "its table of metadata"
GAPS = "the numbers of its messages are not consecutive: some were deleted, or the file is damaged"
_LONGEST_REASON = 100  # characters of what SQLite says
#: What SQLite raises, and what Python does when SQLite names damaged text in an error.
_ERRORS = (sqlite3.Error, UnicodeDecodeError)
Row = tuple[Any, ...]


def read_sqlite(path: Path) -> RawMessages:
    """All messages of a .db3 file that can be read; its notes say what could not.

    Raises InputError for what is not such a file, and for one without topics.
    """
    journals = [journal for end in _JOURNALS if (journal := Path(f"{path}{end}")).exists() and journal.stat().st_size]
    try:
        with _opened(path, journals) as database:
            channels = _channels(database)
            rows, before = _rows(database)
            problems = _problems(database)
            counted, is_gapless = _counted(database), _is_gapless(database)
    except _ERRORS as error:
        raise InputError(f"cannot read the recording {path}: {_reason(path, error)}") from None
    number = {topic: i for i, topic in enumerate(channels)}
    known = [row for row in rows if _is_message(row) and row[0] in number]
    undescribed = sum(_is_message(row) for row in rows) - len(known)
    places = [(number[row[0]], row[1]) for row in known]
    raw = RawMessages.of_parts(dict(enumerate(channels.values())), places, [row[2] for row in known])
    notes = [
        *([losses.NOT_FINISHED] if journals else []),
        *(_gap_notes(rows, before) if before is not None else ()),
        *problems,
        *losses.undescribed_notes(undescribed),
        *losses.undecoded_notes(len(rows) - len(known) - undescribed, "the recording"),
        *losses.count_notes(METADATA_TABLE, counted, raw.counts()),
        *([] if is_gapless or before is not None else [GAPS]),
        *losses.checksum_notes(len(raw), len(raw)),
    ]
    return replace(raw, missing=losses.missing_messages(counted, raw.counts())).with_notes(notes)


def _reason(path: Path, error: Exception) -> str:
    """Why nothing can be read, in words of a recording where SQLite has some of databases."""
    if path.stat().st_size == 0:
        return "the file is empty: the recorder wrote nothing into it"
    if "no such table" in str(error):
        return "it is a database, but holds no topics and messages as rosbag2 writes them"
    return str(error)


@contextmanager
def _opened(path: Path, journals: list[Path]) -> Iterator[sqlite3.Connection]:
    """The database, read only; with a journal a copy of it, to which SQLite applies the journal."""
    with tempfile.TemporaryDirectory() as folder:
        options = "?mode=ro&immutable=1"
        if journals:
            path, options = Path(shutil.copy(path, folder)), ""
            for journal in journals:
                shutil.copy(journal, folder)
        with closing(sqlite3.connect(f"file:{quote(str(path.absolute()))}{options}", uri=True)) as database:
            database.execute("PRAGMA writable_schema=ON")  # reads files that are cut short; writes nothing
            database.text_factory = lambda text: text.decode("utf-8", "replace")
            yield database


def _channels(database: sqlite3.Connection) -> dict[Any, Channel]:
    """By the number that the rows of messages name."""
    try:
        definitions = {
            name: (str(encoding), str(text))
            for name, encoding, text in database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
        }
    except _ERRORS:  # older recordings have none
        definitions = {}
    topics = database.execute("SELECT id, name, type FROM topics").fetchall()
    return {
        key: Channel(printable(str(name)), printable(str(type_)), *definitions.get(type_, ("", "")))
        for key, name, type_ in topics
    }


def _rows(database: sqlite3.Connection) -> tuple[list[Row], int | None]:
    """Topic, time and content of the rows that can be read; how many stand before those that cannot, if any."""
    first: dict[int, Row] = {}
    last: dict[int, Row] = {}
    try:
        for key, *row in database.execute(_ROWS):
            first.setdefault(key, tuple(row))
        return list(first.values()), None
    except _ERRORS:
        pass
    try:
        for key, *row in database.execute(f"{_ROWS} DESC"):
            if key in first:
                break
            last[key] = tuple(row)
    except _ERRORS:
        pass
    return [*first.values(), *reversed(last.values())], len(first)


def _gap_notes(rows: list[Row], before: int) -> list[str]:
    """That there are pages between the rows which cannot be read, the first ``before`` and the others."""
    good = [_is_message(row) for row in rows]
    times = np.array([row[1] for row, is_good in zip(rows, good, strict=True) if is_good], dtype=np.int64)
    return losses.damage_notes([losses.Damage("pages of the database cannot be read", sum(good[:before]))], times)


def counts_by_topic(information: Any) -> Counter[str]:
    """Messages by topic as rosbag2's metadata state them; LookupError, TypeError or ValueError where they do not."""
    counted: Counter[str] = Counter()
    for topic in information["topics_with_message_count"]:
        counted[str(topic["topic_metadata"]["name"])] += int(topic["message_count"])
    return counted


def _counted(database: sqlite3.Connection) -> Counter[str]:
    """Messages by topic as the file states them; of a recording of several files it states those of all."""
    try:
        ((text,),) = database.execute("SELECT metadata FROM metadata ORDER BY id DESC LIMIT 1")
        information = parse_yaml(str(text).encode())
        if len(information["relative_file_paths"]) == 1:
            return +counts_by_topic(information)
    except (*_ERRORS, YAMLError, LookupError, TypeError, ValueError):  # older recordings have none
        pass
    return Counter()


def _is_gapless(database: sqlite3.Connection) -> bool:
    """Whether the numbers of the messages are in a row, as a recorder writes them."""
    try:
        ((first, last, count),) = database.execute("SELECT min(id), max(id), count(id) FROM messages NOT INDEXED")
        return bool(count == 0 or last - first + 1 == count)
    except (*_ERRORS, TypeError):  # said otherwise
        return True


def _is_message(row: Row) -> bool:
    """Whether the columns have their types: SQLite accepts every type in every column."""
    topic, time, content = row
    return isinstance(topic, int) and isinstance(time, int) and isinstance(content, bytes)


def _problems(database: sqlite3.Connection) -> list[str]:
    """What SQLite finds wrong with the file, in one note."""
    try:
        found = [str(text) for (text,) in database.execute("PRAGMA integrity_check(1)")]
    except _ERRORS as error:
        found = [str(error)]
    reasons = (" ".join(text.split())[:_LONGEST_REASON] for text in found if text != "ok")
    return [f"SQLite finds the recording damaged ({reason})" for reason in reasons]
