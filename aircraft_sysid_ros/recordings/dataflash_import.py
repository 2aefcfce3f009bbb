"""ArduPilot's DataFlash log (.bin, or as text .log), read with pymavlink.

Its columns are decoded at once where pymavlink found them.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import string
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.mavlink.dataflash_table import DATAFLASH, instances
from aircraft_sysid_ros.mavlink.quantities import FIX_3D, Batch
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.recordings.autopilot_log import NO_DATE, LogContent, gps_nanoseconds, import_content
from aircraft_sysid_ros.recordings.dataflash_text import LETTERS, TEXT, write_as_binary
from aircraft_sysid_ros.recordings.imported_log import GPS_EPOCH, LATEST, SECONDS_PER_WEEK, ImportedLog
from aircraft_sysid_ros.recordings.injections import MESSAGES, injections
from aircraft_sysid_ros.recordings.losses import NO_CHECKSUMS
from aircraft_sysid_ros.stamps import NANOSECONDS

#: What stood before the number of an output up to ArduPilot 3.3.
_OLD_OUTPUT = re.compile(r"^(Ch|Chan)(?=\d+$)")
_MAGIC = b"\xa3\x95"
_HEADER = 3
#: A message that says how others are laid out: their length, name, letters of types, and columns.
_FORMAT = re.compile(rb"\xa3\x95\x80.(.)(.{4})(.{16})(.{64})", re.DOTALL)
#: Functions of servo outputs (SERVOn_FUNCTION) that a calibration file may want to know of.
FUNCTIONS = {
    2: "flaps", 3: "flaps", 4: "aileron", 19: "elevator", 21: "rudder", 24: "left_flaperon", 25: "right_flaperon",
    70: "throttle", 77: "left_elevon", 78: "right_elevon", 79: "left_vtail", 80: "right_vtail",
}  # fmt: skip


def import_dataflash(path: Path, mapping: ServoMapping | None = None) -> ImportedLog:
    """A DataFlash log as our topics; raises InputError for what is not one."""
    return import_content(read_dataflash(path), DATAFLASH, mapping)


def read_dataflash(path: Path) -> LogContent:
    """All messages that the table has, stamped in Unix time where a GPS knew it."""
    with path.open("rb") as file:
        is_text = file.read(len(TEXT)) == TEXT
    if not is_text:
        return _read_binary(path)
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder) / "log.bin"
        unread = write_as_binary(path, binary)
        content = _read_binary(binary)
    lost = [f"{unread} lines of the text could not be read"] if unread else []
    return replace(content, format="DataFlash as text (ArduPilot)", notes=[*lost, *content.notes])


def _read_binary(path: Path) -> LogContent:
    try:
        from pymavlink.DFReader import DFReader_binary
    except ImportError:
        raise MissingExtra("DataFlash logs", "pymavlink", "logs") from None
    with path.open("rb") as file:
        if file.read(2) != _MAGIC:
            raise InputError("it is not a DataFlash log: it does not begin with A3 95")
    try:
        with _without_complaints() as complaints:
            reader, damaged = _opened(path, DFReader_binary)
    except Exception as error:  # pymavlink lets struct.error, KeyError and its own through
        raise InputError(f"it is not a readable DataFlash log ({error})") from None
    content = np.frombuffer(reader.data_map, np.uint8)
    wanted = {
        name: (np.asarray(reader.offsets[number], dtype=np.int64), reader.formats[number])
        for name, number in reader.name_to_id.items()
        if len(reader.offsets[number]) and name in (*DATAFLASH, *MESSAGES, "PARM")
    }
    (begin, end), boots = _longest_boot(content, *wanted["IMU"]) if "IMU" in wanted else ((0, len(content)), 1)
    tables = {
        name: _as_today(_columns(content, offsets[(offsets >= begin) & (offsets < end)], form))
        for name, (offsets, form) in wanted.items()
    }
    found = {name: int(reader.counts[n]) for name, n in reader.name_to_id.items() if reader.counts[n]}
    ends = [int(reader.offsets[n][-1]) + form.len for n, form in reader.formats.items() if len(reader.offsets[n])]
    last = max(ends, default=0)
    breaks_off = last > len(content) or bool(content[last:].any())  # zeros fill the last block of a card
    del content
    reader.close()
    start, notes = _start(tables)
    if boots > 1:
        notes.append(f"the clock of the log starts over, so that it holds {boots} boots: the longest is what was read")
    if "IMU" not in found and {"ACC", "GYR"} <= found.keys():
        notes.append("ACC and GYR, which IMU_RAW of LOG_BITMASK writes, are not read: set IMU, which writes both")
    if breaks_off:
        notes.append("the log breaks off in the middle of a message: what came before it was read")
    if complaints:
        notes.append("the file is damaged in places: what could be read was")
    if damaged:
        names = ", ".join(damaged)
        notes.append(f"what the file says about the layout of {names} is damaged: none of those could be read")
    notes += _instance_notes(tables)
    notes += _output_notes(tables.get("PARM"))
    batches = [
        Batch(name, start + _time(fields), fields)
        for name, fields in tables.items()
        if name in DATAFLASH and _has_time(fields)
    ]
    flown = injections(tables, start)
    return LogContent("DataFlash (ArduPilot)", batches, found, [*notes, NO_CHECKSUMS], flown)


def _opened(path: Path, open_log: Callable[[str], Any]) -> tuple[Any, list[str]]:
    """The reader of a log, and the messages whose format nobody can read."""
    try:
        return open_log(str(path)), []
    except Exception:
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / path.name
            if not (damaged := _with_readable_formats(path, copy)):
                raise
            return open_log(str(copy)), damaged  # which keeps the copy until it is closed


def _with_readable_formats(path: Path, copy: Path) -> list[str]:
    """Write a copy in which formats that nobody can read are of columns without a meaning, of the same length.

    One of them is enough that pymavlink reads nothing, and without them it loses its way. Returns the messages that
    they are of. A name or columns that can be read tell a format from other bytes.
    """
    content, damaged = bytearray(path.read_bytes()), []
    for match in _FORMAT.finditer(content):
        name, letters, columns = (part.rstrip(b"\0") for part in match.groups()[1:])
        is_right = all(letter in LETTERS for letter in letters.decode("latin1"))
        if not is_right and (re.fullmatch(rb"[A-Z0-9]+", name) or re.fullmatch(rb"[ -~]+", columns)):
            damaged.append(name.decode("ascii", "replace"))
            meaningless = _letters_of(match[1][0] - _HEADER)
            names = ",".join(string.ascii_lowercase[: len(meaningless)])
            for at, text, width in ((3, meaningless, 16), (4, names, 64)):
                content[match.start(at) : match.end(at)] = text.encode().ljust(width, b"\0")
    copy.write_bytes(content)
    return damaged


def _letters_of(size: int) -> str:
    """Letters of types that have a size [bytes] together."""
    letters = ""
    for letter, width in (("Z", 64), ("N", 16), ("n", 4), ("B", 1)):
        letters += letter * (size // width)
        size %= width
    return letters


#: A clock that goes back by so much [ns], between so many IMU messages in order, has started over.
_BOOT, _SOME = 1_000_000_000, 50
#: Of GPS that a stamp can have: what is after it is damaged.
_LAST_WEEK = int((LATEST // NANOSECONDS - GPS_EPOCH) // SECONDS_PER_WEEK)


@contextlib.contextmanager
def _without_complaints() -> Iterator[list[str]]:
    """Keeps what the reader says, a line for every wrong byte, some of it from C, off the terminal: in the list."""
    said: list[str] = []
    stream = io.StringIO()
    before = os.dup(2)
    try:
        with tempfile.TemporaryFile() as file, contextlib.redirect_stderr(stream), contextlib.redirect_stdout(stream):
            os.dup2(file.fileno(), 2)
            try:
                yield said
            finally:
                os.dup2(before, 2)
                if stream.getvalue() or os.fstat(file.fileno()).st_size:
                    said.append(stream.getvalue())
    finally:
        os.close(before)


def _columns(content: npt.NDArray[np.uint8], offsets: npt.NDArray[np.int64], form: Any) -> dict[str, npt.NDArray[Any]]:
    """Columns (n,) of the messages of one format; none where the format is not understood."""
    letters = form.format.decode() if isinstance(form.format, bytes) else str(form.format)
    letters = letters.rstrip("\x00")
    if any(letter not in LETTERS for letter in letters) or len(letters) != len(form.columns):
        return {}
    layout = np.dtype([(name, LETTERS[letter][0]) for name, letter in zip(form.columns, letters, strict=True)])
    offsets = offsets[offsets + _HEADER + layout.itemsize <= len(content)] + _HEADER
    rows = content[offsets[:, None] + np.arange(layout.itemsize)]
    table = np.ascontiguousarray(rows).view(layout)[:, 0]
    columns: dict[str, npt.NDArray[Any]] = {}
    for name, letter in zip(form.columns, letters, strict=True):
        factor = LETTERS[letter][1]
        columns[name] = table[name].copy() if factor is None else table[name] * factor
    return columns


def _as_today(columns: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Columns by today's names: up to ArduPilot 3.2 the TimeMS of GPS was that of its week, and T since the start."""
    columns = {_OLD_OUTPUT.sub("C", name): values for name, values in columns.items()}
    if not {"Week", "T"} <= columns.keys():
        return columns
    of_week = "GPSTimeMS" if "GPSTimeMS" in columns else "TimeMS"
    return columns | {"GWk": columns["Week"], "GMS": columns[of_week], "TimeMS": columns["T"]}


def _longest_boot(
    content: npt.NDArray[np.uint8], offsets: npt.NDArray[np.int64], form: Any
) -> tuple[tuple[int, int], int]:
    """Where in the file the longest part begins and ends in which the clock of the IMU goes on, of how many parts.

    A stamp that is damaged is no boot: after one the clock goes on from there.
    """
    fields = _columns(content, offsets, form)
    if not fields or not _has_time(fields):
        return (0, len(content)), 1
    time = _time(fields)
    back = np.flatnonzero(np.diff(time) < -_BOOT) + 1
    boots = [i for i in back.tolist() if _goes_on(time[max(i - _SOME, 0) : i]) and _goes_on(time[i : i + _SOME])
             and time[i : i + _SOME].max() < time[max(i - _SOME, 0)]]  # fmt: skip
    edges = [0, *boots, len(time)]
    longest = max(pairwise(edges), key=lambda part: int(time[part[1] - 1] - time[part[0]]))
    begin = 0 if longest[0] == 0 else int(offsets[longest[0]])
    end = len(content) if longest[1] == len(time) else int(offsets[longest[1]])
    return (begin, end), len(boots) + 1


def _goes_on(time: npt.NDArray[np.int64]) -> bool:
    return len(time) >= _SOME and bool((np.diff(time) > -_BOOT).all())


def _has_time(fields: dict[str, npt.NDArray[Any]]) -> bool:
    return "TimeUS" in fields or "TimeMS" in fields


def _time(fields: dict[str, npt.NDArray[Any]]) -> npt.NDArray[np.int64]:
    """Time since start [ns] (n,)."""
    if "TimeUS" in fields:
        return np.asarray(fields["TimeUS"], dtype=np.int64) * 1000
    return np.asarray(fields["TimeMS"], dtype=np.int64) * 1_000_000


def _start(tables: dict[str, dict[str, npt.NDArray[Any]]]) -> tuple[int, list[str]]:
    """Unix time [ns] of time 0: median over fixes of GPS time less time since start."""
    gps = tables.get("GPS", {})
    if not {"GWk", "GMS", "Status"} <= gps.keys() or not _has_time(gps):
        return NO_DATE * NANOSECONDS, ["no GPS time in the log: it is stamped from 2000-01-01"]
    good = np.flatnonzero((gps["Status"] >= FIX_3D) & (gps["GWk"] > 0) & (gps["GWk"] <= _LAST_WEEK))
    if not len(good):
        return NO_DATE * NANOSECONDS, ["no GPS fix in the log: it is stamped from 2000-01-01"]
    since = _time(gps)
    unix = np.array([gps_nanoseconds(int(gps["GWk"][i]), int(gps["GMS"][i])) for i in good], dtype=np.int64)
    offset = unix - since[good]
    return int(offset[0]) + int(np.median(offset - offset[0])), []


def _instance_notes(tables: dict[str, dict[str, npt.NDArray[Any]]]) -> list[str]:
    """Which GPS receiver, and which instance of another sensor, is read where it is not the first."""
    notes = []
    for name in DATAFLASH:
        fields = tables.get(name, {})
        read, *others = instances(fields) if len(fields.get("I", ())) else [0]
        first = min([read, *others])
        if read == first:
            continue
        if name == "GPS":
            notes.append(f"GPS receiver {read} is read: it has more fixes than receiver {first}")
        elif name != "RPM":  # whose instances are engines
            notes.append(f"{name} {read} is read: it is healthy more often than {name} {first}")
    return notes


def _output_notes(parameters: dict[str, npt.NDArray[Any]] | None) -> list[str]:
    """Which output moves what, as the parameters say: what a calibration file begins with."""
    if not parameters or not {"Name", "Value"} <= parameters.keys():
        return []
    pairs = zip(parameters["Name"], parameters["Value"], strict=True)
    values = {name.decode("ascii", "replace"): float(value) for name, value in pairs}
    outputs = {n: FUNCTIONS.get(int(values.get(f"SERVO{n}_FUNCTION", 0))) for n in range(1, 17)}
    texts = [_output_text(n, name, values) for n, name in outputs.items() if name is not None]
    return [f"outputs by their parameters: {'; '.join(texts)}"] if texts else []


def _output_text(number: int, name: str, values: dict[str, float]) -> str:
    pulses = [values.get(f"SERVO{number}_{end}") for end in ("MIN", "TRIM", "MAX")]
    text = f"{number} {name}"
    if all(pulse is not None for pulse in pulses):
        text += " " + "/".join(f"{pulse:g}" for pulse in pulses) + " us"
    return text + (" reversed" if values.get(f"SERVO{number}_REVERSED") else "")
