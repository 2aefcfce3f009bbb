"""PX4's ULog, read with pyulog."""

from __future__ import annotations

import re
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.mavlink.px4_table import PX4, TIMES, sample_time
from aircraft_sysid_ros.mavlink.quantities import FIX_3D, Batch, first_of_most
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.recordings.autopilot_log import NO_DATE, LogContent, import_content
from aircraft_sysid_ros.recordings.imported_log import LATEST, ImportedLog
from aircraft_sysid_ros.recordings.losses import NO_CHECKSUMS
from aircraft_sysid_ros.stamps import NANOSECONDS

_ELEMENT = re.compile(r"^(\w+)\[(\d+)\]$")
_GPS = ("sensor_gps", "vehicle_gps_position")

#: Bytes before the first message, and before the content of each.
_FILE_HEADER, _MESSAGE_HEADER = 16, 3


def import_ulog(path: Path, mapping: ServoMapping | None = None) -> ImportedLog:
    """A ULog as our topics; raises InputError for what is not one."""
    return import_content(read_ulog(path), PX4, mapping)


def read_ulog(path: Path) -> LogContent:
    """All messages of one instance of every topic, stamped in Unix time where a GPS knew it."""
    try:
        from pyulog import ULog
    except ImportError:
        raise MissingExtra("ULog files", "pyulog", "logs") from None
    try:
        log = ULog(str(path))
    except Exception as error:  # pyulog raises TypeError, struct.error and its own
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"it is not a readable ULog ({reason})") from None
    items = {(item.name, item.multi_id): item.data for item in log.data_list if TIMES[1] in item.data}
    read: dict[str, int] = {}
    receivers = []
    for name in dict.fromkeys(name for name, _ in items):
        instances = sorted(instance for other, instance in items if other == name)
        read[name] = instances[first_of_most([_fixes(name, items[name, instance]) for instance in instances])]
        if read[name] != instances[0]:
            receivers.append(f"{name}[{read[name]}] is read: it has more fixes than {name}[{instances[0]}]")
    data = {name: columns for (name, instance), columns in items.items() if instance == read[name]}
    start, notes = _start(data)
    notes += receivers
    batches = [_batch(name, columns, start) for name, columns in data.items() if name in PX4]
    found = {
        name if instance == read[name] else f"{name}[{instance}]": len(columns[TIMES[1]])
        for (name, instance), columns in items.items()
    }
    if not log.file_corruption and _breaks_off(path):
        notes.append("the log breaks off in the middle of a message: what came before it was read")
    if log.file_corruption or any(TIMES[1] not in item.data for item in log.data_list):
        notes.append("the file is damaged in places: what could be read was")
    if log.dropouts:
        lost = sum(dropout.duration for dropout in log.dropouts) / 1000.0
        notes.append(f"the logger lost {len(log.dropouts)} pieces, {lost:.1f} s in all")
    return LogContent("ULog (PX4)", batches, found, [*notes, NO_CHECKSUMS])


def _breaks_off(path: Path) -> bool:
    """Whether the last message of a ULog is longer than what is there of it: each begins with its size and its kind."""
    at = _FILE_HEADER
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        while at < len(content):
            at += _MESSAGE_HEADER + int.from_bytes(content[at : at + 2], "little")
        return at != len(content)


def _fixes(name: str, columns: dict[str, npt.NDArray[Any]]) -> int:
    """How many fixes a topic has if it is of a GPS receiver: of several the first is read, unless another has more."""
    return int(np.sum(columns.get("fix_type", np.zeros(0)) >= FIX_3D)) if name in _GPS else 0


def _start(data: dict[str, dict[str, npt.NDArray[Any]]]) -> tuple[int, list[str]]:
    """Unix time [ns] of the autopilot's time 0: median over fixes of UTC less time since start."""
    for name in _GPS:
        columns = data.get(name, {})
        utc = np.asarray(columns.get("time_utc_usec", np.zeros(0)), dtype=np.int64)
        known = (utc > 0) & (utc < LATEST // 1000) & (np.asarray(columns.get("fix_type", utc)) >= FIX_3D)
        if known.any():
            since = np.asarray(columns["timestamp"], dtype=np.int64)
            return int(np.median(utc[known] - since[known])) * 1000, []
    return NO_DATE * NANOSECONDS, ["no GPS time in the log: it is stamped from 2000-01-01"]


def _batch(name: str, columns: dict[str, npt.NDArray[Any]], start: int) -> Batch:
    """Columns with array elements (``q[0]`` …) joined, at the time when the sample was taken."""
    fields: dict[str, npt.NDArray[Any]] = dict(columns)
    elements: dict[str, dict[int, npt.NDArray[Any]]] = {}
    for key, column in columns.items():
        match = _ELEMENT.match(key)
        if match is not None:
            elements.setdefault(match.group(1), {})[int(match.group(2))] = column
    for key, parts in elements.items():
        fields[key] = np.stack([parts[i] for i in sorted(parts)], axis=1)
    return Batch(name, start + sample_time(fields), fields)
