"""The messages of one topic as columns: decoded at once where they share a layout, else one by one."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import cdr_layout, joint_states
from aircraft_sysid_ros.recordings.message_types import channel_types, flat_fields
from aircraft_sysid_ros.recordings.raw_messages import Integers, RawMessages
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, INPUTS_TYPE, USED_FIELDS
from aircraft_sysid_ros.stamps import NANOSECONDS

_OF_INPUTS = set(USED_FIELDS[INPUTS_TOPIC])
_LOOKED_AT = 50
_SECONDS, _NANOSECONDS = "header.stamp.sec", "header.stamp.nanosec"


@dataclass(frozen=True)
class Table:
    """n messages: ``log_time`` and ``stamp`` [ns] (n,), and flat fields (n,) or (n, k) by dotted name."""

    log_time: Integers
    stamp: Integers  # of the header; the log time where the type has no header
    fields: dict[str, npt.NDArray[Any]]
    rows: Integers  # which messages of the recording they are
    skipped: int = 0  # messages that could not be decoded
    notes: tuple[str, ...] = ()  # what could not be read of the recording


def read_table(path: str | Path, topic: str) -> Table:
    """All messages of one topic with all their fields; texts are str, sequences are arrays of objects.

    ``topic`` is the name as recorded, with or without the leading slash. Raises InputError without the topic.
    """
    raw = read_raw(path)
    for key, channel in raw.channels.items():
        if channel.topic.lstrip("/") == topic.lstrip("/") and len(raw.rows(key)):
            return replace(table_of(raw, key), notes=raw.notes)
    raise InputError(f"the recording {path} has no messages of {topic}: it holds {raw.topic_names()}")


def table_of(raw: RawMessages, key: int, names: Collection[str] | None = None) -> Table:
    """The fields ``names`` (default all) of the messages of a channel.

    Raises InputError where the type of the recording does not have them all.
    """
    table = _decoded_at_once(raw, key, names) or _decoded_one_by_one(raw, key)
    missing = set(names or ()) - table.fields.keys()
    if missing and len(table.rows):
        channel = raw.channels[key]
        raise InputError(f"the recording has another {channel.type} on {channel.topic}: without {sorted(missing)[0]}")
    return table


def names_of_inputs(raw: RawMessages, key: int) -> list[str]:
    """Names that messages of a channel of inputs hold, in the order in which they come; some messages are looked at."""
    types, rows = channel_types(raw.channels[key]), raw.rows(key)
    found: dict[str, None] = {}
    for row in rows[:: max(len(rows) // _LOOKED_AT, 1)]:
        try:
            message: Any = types.deserialize_cdr(raw[row], INPUTS_TYPE)
        except Exception:  # damaged bytes raise all kinds
            continue
        found |= dict.fromkeys(message.name)
    return list(found)


def _decoded_at_once(raw: RawMessages, key: int, names: Collection[str] | None) -> Table | None:
    channel, rows = raw.channels[key], raw.rows(key)
    block = raw.block(rows)
    if block is None:
        return None
    if channel.type == INPUTS_TYPE and set(names or ()) == _OF_INPUTS:
        found = joint_states.decode(block)
        if found is None:
            return None
        return Table(raw.log_time[rows], _stamp(found, found.keys(), raw.log_time[rows]), found, rows)
    structured = cdr_layout.decode(channel_types(channel).fielddefs, channel.type, block)
    if structured is None:
        return None
    columns = {name.removeprefix(cdr_layout.LENGTH_OF) for name in structured.dtype.names or ()}
    wanted = columns if names is None else columns & set(names)
    fields = {name: _column(structured, name) for name in wanted}
    return Table(raw.log_time[rows], _stamp(structured, columns, raw.log_time[rows]), fields, rows)


def _decoded_one_by_one(raw: RawMessages, key: int) -> Table:
    """The slow way, which says the same (a test compares them) and also takes what has no common layout."""
    channel, rows = raw.channels[key], raw.rows(key)
    types = channel_types(channel)
    decoded: list[dict[str, Any]] = []
    good: list[int] = []
    for row in rows:
        try:
            message = types.deserialize_cdr(raw[row], channel.type)
        except Exception:  # damaged bytes raise all kinds: it is counted
            continue
        decoded.append(flat_fields(types.fielddefs, channel.type, message))
        good.append(row)
    kept = np.array(good, dtype=np.int64)
    names = decoded[0].keys() if decoded else ()
    fields = {name: _stacked([fields[name] for fields in decoded]) for name in names}
    stamp = _stamp(fields, fields.keys(), raw.log_time[kept])
    return Table(raw.log_time[kept], stamp, fields, kept, len(rows) - len(kept))


def _stacked(values: list[Any]) -> npt.NDArray[Any]:
    """Values of one field as a column; sequences, whose lengths may differ, as objects."""
    if isinstance(values[0], list):
        column = np.empty(len(values), dtype=object)
        column[:] = values
        return column
    shapes = {np.shape(value) for value in values}
    if len(shapes) == 1:
        return np.array(values)
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column


def _column(table: npt.NDArray[Any], name: str) -> npt.NDArray[Any]:
    if name not in (table.dtype.names or ()):
        return np.full(len(table), "")  # a text without a byte has a length only
    values = table[name]
    return np.char.decode(values, "utf8", "replace") if values.dtype.kind == "S" else np.ascontiguousarray(values)


def _stamp(table: Any, columns: Collection[str], log_time: Integers) -> Integers:
    if _SECONDS not in columns:
        return log_time
    return np.asarray(table[_SECONDS], np.int64) * NANOSECONDS + np.asarray(table[_NANOSECONDS], np.int64)
