"""What a flight in progress leaves on disk: a crash or a power cut loses seconds and not the flight.

RUN.flying/aircraft.yaml  the aircraft file
RUN.flying/flight.json    format, when it began, and the options of both steps
RUN.flying/samples.bin    every sample as it arrived, one record each; the operating system has it at once, the disk
                          within ``FLUSHED``; what was cut off at the end is passed over
RUN.flying/states-*.bin, points-*.bin, parameters.bin
                          what was estimated, so that memory does not grow with the flight; ``recover`` makes it anew

Who flies holds a lock on the samples, so that nobody recovers a flight that still goes on.
"""

from __future__ import annotations

import fcntl
import json
import os
import pickle
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.run_reader import AIRCRAFT, journal_path
from aircraft_sysid_ros.samples import WIDTH, Kind, Samples
from aircraft_sysid_ros.text_file import write_whole

Array = npt.NDArray[np.float64]

FLIGHT, RECORDS = "flight.json", "samples.bin"
#: Longest time [s] until what has come is on the disk itself.
FLUSHED = 2.0
#: Time [s] between tries to write to a disk that was full.
_AGAIN = 10.0
_FORMAT = "aircraft_sysid_ros flight 1"
#: Begins and ends every record: blocks that a power cut left empty hold zeros.
_MARK = 0xA5
RECORD = np.dtype([("begin", "u1"), ("kind", "u1"), ("stamp", "<i8"), ("values", "<f8", (WIDTH,)), ("end", "u1")])


class OnDisk:
    """Records of one kind, appended to a file; where the disk takes no more they go to memory: the flight goes on."""

    def __init__(self, path: Path, kind: np.dtype[Any], *, in_flight: bool = False) -> None:
        """Raises OSError where there can be no file, but ``in_flight``: then all goes to memory."""
        self.path, self.kind = path, kind
        self.count, self.wrong = 0, ""  # records in the file; why it takes no more
        self._in_memory: list[npt.NDArray[Any]] = []
        self.file: int | None = None  # closed
        try:
            self.file = os.open(path, os.O_CREAT | os.O_APPEND | os.O_RDWR, 0o644)
        except OSError as error:
            if not in_flight:
                raise
            self.wrong = error.strerror or str(error)

    def append(self, records: npt.NDArray[Any]) -> None:
        """New records (n,), in order."""
        if self.wrong or self.file is None:
            self.wrong = self.wrong or "it was closed"
            self._in_memory.append(records.copy())
            return
        content = records.tobytes()
        try:
            while content:
                content = content[os.write(self.file, content) :]
        except OSError as error:
            self._cut_back()
            self.wrong = error.strerror or str(error)
            self._in_memory.append(records.copy())
        else:
            self.count += len(records)

    def _cut_back(self) -> bool:
        """Take half a record off the end of the file; whether there is none now."""
        if self.file is not None:
            try:
                os.ftruncate(self.file, self.count * self.kind.itemsize)
            except OSError:
                return False
        return True

    def try_again(self) -> None:
        """Perhaps there is room on the disk again: what is in memory goes there, as far as it does."""
        if not self._cut_back():
            return  # what came next would begin in the middle of a record
        self.wrong, waiting, self._in_memory = "", self._in_memory, []
        for records in waiting:
            self.append(records)

    def __iter__(self) -> Iterator[npt.NDArray[Any]]:
        if self.count:
            yield np.memmap(self.path, self.kind, "r", shape=(self.count,))
        yield from self._in_memory

    def close(self) -> None:
        """Write no more; what has come stays."""
        if self.file is not None:
            os.close(self.file)
            self.file = None

    def discard(self) -> None:
        """Forget all, and give the room back."""
        self.close()
        with suppress(OSError):
            self.path.unlink()
        self.count, self._in_memory = 0, []


class RowsOnDisk:
    """Rows (n, width) of numbers, in place of a list of them; another width begins another file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._parts: list[OnDisk] = []

    def append(self, rows: Array) -> None:
        """New rows, in order."""
        if not self._parts or self._parts[-1].kind["values"].shape != rows.shape[1:]:
            name = f"{self._path.name}-{len(self._parts)}.bin"
            kind = np.dtype([("values", "<f8", rows.shape[1:])])
            self._parts.append(OnDisk(self._path.with_name(name), kind, in_flight=True))
        records = np.empty(len(rows), self._parts[-1].kind)
        records["values"] = rows
        self._parts[-1].append(records)

    def __iter__(self) -> Iterator[Array]:
        for part in self._parts:
            for records in part:
                yield records["values"]

    def __bool__(self) -> bool:
        return bool(self._parts)

    def close(self) -> None:
        """Write no more."""
        for part in self._parts:
            part.close()

    def discard(self) -> None:
        """Forget all, and give the room back."""
        for part in self._parts:
            part.discard()
        self._parts = []


class ObjectsOnDisk:
    """Objects in place of a list of them, for the process that wrote them alone."""

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, path.open("w+b")
        self._end = 0
        self._in_memory: list[Any] = []

    def append(self, item: Any) -> None:
        """A new object."""
        try:
            if not self._in_memory:
                self._file.seek(self._end)
                pickle.dump(item, self._file)
                self._file.flush()
                self._end = self._file.tell()
                return
        except OSError:  # the journal says so of the samples
            pass
        self._in_memory.append(item)

    def __iter__(self) -> Iterator[Any]:
        self._file.seek(0)
        while self._file.tell() < self._end:
            yield pickle.load(self._file)
        yield from self._in_memory

    def close(self) -> None:
        """Write no more."""
        with suppress(OSError):
            self._file.close()

    def discard(self) -> None:
        """Forget all, and give the room back."""
        self.close()
        with suppress(OSError):
            self._path.unlink()
        self._end, self._in_memory = 0, []


class FlightJournal:
    """A flight in progress, on disk instead of in memory; in place of a list of its samples."""

    def __init__(
        self,
        run: str | Path,
        aircraft: Aircraft,
        options: Mapping[str, Any],
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        """``options``: those of both steps, for ``recover``. ``say``: is told in flight when the disk is full.

        Raises InputError where it cannot be written, or is flown. A flight of that name that was cut off is kept under
        another one.
        """
        self.path, self._run, self._say, self._due = journal_path(run), run, say, 0.0
        #: What became of a flight that had been cut off, in words; empty: there was none.
        self.kept = _kept_aside(self.path, run) if self.path.exists() else ""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.mkdir()
            content = yaml.safe_dump(aircraft.source, sort_keys=False, explicit_end=True)
            write_whole(self.path / AIRCRAFT, content)
            write_whole(self.path / FLIGHT, json_text({"format": _FORMAT, **options}) + "\n")
            self._records = OnDisk(self.path / RECORDS, RECORD)
        except OSError as error:
            raise InputError(f"cannot write {self.path}: {error.strerror}") from None
        assert self._records.file is not None  # just opened
        self._file = self._records.file
        fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        #: What was estimated, for the run that this process writes.
        self.rows, self.points = RowsOnDisk(self.path / "states"), RowsOnDisk(self.path / "points")
        self.parameters = ObjectsOnDisk(self.path / "parameters.bin")
        self._ended = threading.Event()
        self._flusher = threading.Thread(target=self._flush, daemon=True)
        self._flusher.start()

    @property
    def is_open(self) -> bool:
        """Neither closed nor cleared."""
        return not self._ended.is_set()

    @property
    def holds_a_flight(self) -> bool:
        """Whether a sample has come."""
        return self._records.count > 0 or bool(self._records.wrong)

    @property
    def note(self) -> str:
        """What the disk did not take, in words."""
        if not self._records.wrong:
            return ""
        what = f"the disk took no more after {self._records.count} samples ({self._records.wrong})"
        return f"{what}: the rest is in memory alone"

    def append(self, samples: Samples) -> None:
        """New samples, in the order of arrival."""
        records = np.empty(len(samples), RECORD)
        records["begin"], records["end"], records["kind"] = _MARK, _MARK, samples.kind
        records["stamp"], records["values"] = samples.stamp, samples.values
        was_full = bool(self._records.wrong)
        if was_full and time.monotonic() >= self._due:
            self._due = time.monotonic() + _AGAIN
            self._records.try_again()
        self._records.append(records)
        if self._records.wrong and not was_full:
            self._due = time.monotonic() + _AGAIN
            self._tell(f"{self.note}: make room in {self.path.parent.absolute()}, or it is lost with the process")

    def __iter__(self) -> Iterator[Samples]:
        return map(_samples, self._records)

    def clear(self) -> None:
        """Forget the flight: its run has been written, or there was none."""
        self.close()
        shutil.rmtree(self.path, ignore_errors=True)

    def keep(self) -> str:
        """End without a run; returns what is kept, in words.

        What ``recover`` makes anew makes room for samples that the disk had not taken.
        """
        if self.is_open and self._records.wrong:
            for part in (self.rows, self.points, self.parameters):
                part.discard()
            self._records.try_again()
        kept, whole = self._records.count, sum(len(part) for part in self._records)
        self.close()
        if not kept:
            return f"nothing of its flight is kept: {self.note}"
        what = "its flight is kept" if kept == whole else f"of its flight the first {kept} of {whole} samples are kept"
        return f"{what}: aircraft-sysid recover {self._run}"

    def end(self) -> None:
        """``keep``, which says what is lost."""
        kept = self.keep()
        if self.note:
            self._tell(kept)

    def _tell(self, text: str) -> None:
        """Say it, if anybody can hear it: the log may be on the same disk, and nothing ends a flight."""
        with suppress(OSError, ValueError):
            self._say(text)

    def close(self) -> None:
        """Write no more; what has come stays."""
        if self.is_open:
            self._ended.set()
            self._flusher.join()
            for part in (self._records, self.rows, self.points, self.parameters):
                part.close()

    def _flush(self) -> None:
        while not self._ended.wait(0.5 * FLUSHED):
            with suppress(OSError):  # the next write says it, too
                os.fsync(self._file)


def recovered(run: str | Path) -> tuple[dict[str, Any], Path, Samples]:
    """Options, aircraft file and samples of a flight that was cut off. Raises InputError where there is none."""
    path = journal_path(run)
    if not path.is_dir():
        raise InputError(f"{path} is not there: no flight of this name was cut off")
    if _is_held(path):
        raise InputError(f"{path} is being flown: end that flight with Ctrl-C, and the run is written")
    try:
        content = json.loads((path / FLIGHT).read_text(encoding="utf8"))
        samples = _read(path / RECORDS)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path} cannot be recovered ({error}): its samples had not begun to come") from None
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise InputError(f"{path / FLIGHT} is of another version of the program: recover it with the version that flew")
    if not len(samples):
        raise InputError(f"{path} holds no samples: nothing had come when it was cut off; delete it")
    return content, path / AIRCRAFT, samples


def _kept_aside(path: Path, run: str | Path) -> str:
    """Give a flight that was cut off a name of its own; what to do with it, in words. Raises InputError."""
    if _is_held(path):
        raise InputError(f"{path} is being flown by another process: give this run another name")
    for number in count(1):
        other = Path(f"{run}-{number}")
        if other.exists() or journal_path(other).exists():
            continue
        try:
            path.rename(journal_path(other))
        except OSError as error:
            raise InputError(
                f"{path} holds a flight that was cut off, and cannot be renamed: {error.strerror}"
            ) from None
        return (
            f"{path} held a flight that was cut off, and is now {journal_path(other)}: aircraft-sysid recover {other} "
            "makes a run of it"
        )
    raise AssertionError("numbers do not end")


def _is_held(path: Path) -> bool:
    """Whether a process that flies holds it."""
    try:
        file = os.open(path / RECORDS, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    else:
        return False
    finally:
        os.close(file)


def _read(path: Path) -> Samples:
    """Whole records up to the first that is none. Raises OSError."""
    count = path.stat().st_size // RECORD.itemsize
    if not count:
        return Samples(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, WIDTH)))
    records = np.memmap(path, RECORD, "r", shape=(count,))
    wrong = np.flatnonzero((records["begin"] != _MARK) | (records["end"] != _MARK) | (records["kind"] >= len(Kind)))
    return _samples(records[: wrong[0]] if len(wrong) else records)


def _samples(records: npt.NDArray[Any]) -> Samples:
    return Samples(records["stamp"], records["kind"].astype(np.int64), records["values"])
