"""What a flight in progress leaves on disk: a crash or a power cut loses seconds and not the flight.

RUN.flying/aircraft.yaml  the aircraft file
RUN.flying/flight.json    format, when it began, and the options of both steps
RUN.flying/samples.bin    every sample as it arrived, one record each; the operating system has it at once, the disk
                          within ``FLUSHED``; what was cut off at the end is passed over

Who flies holds a lock on the samples, so that nobody recovers a flight that still goes on.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
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

FLIGHT, RECORDS = "flight.json", "samples.bin"
#: Longest time [s] until what has come is on the disk itself.
FLUSHED = 2.0
_FORMAT = "aircraft_sysid_ros flight 1"
#: Begins and ends every record: blocks that a power cut left empty hold zeros.
_MARK = 0xA5
RECORD = np.dtype([("begin", "u1"), ("kind", "u1"), ("stamp", "<i8"), ("values", "<f8", (WIDTH,)), ("end", "u1")])


class FlightJournal:
    """Samples of a flight in progress, on disk instead of in memory; in place of a list of them."""

    def __init__(self, run: str | Path, aircraft: Aircraft, options: Mapping[str, Any]) -> None:
        """``options``: those of both steps, for ``recover``. Raises InputError where it cannot be written, or holds a
        flight that was cut off.
        """
        self.path = journal_path(run)
        if self.path.exists():
            raise InputError(f"{self.path} {_what_to_do(self.path, run)}")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.mkdir()
            content = yaml.safe_dump(aircraft.source, sort_keys=False, explicit_end=True)
            write_whole(self.path / AIRCRAFT, content)
            write_whole(self.path / FLIGHT, json_text({"format": _FORMAT, **options}) + "\n")
            self._file = os.open(self.path / RECORDS, os.O_CREAT | os.O_APPEND | os.O_RDWR, 0o644)
        except OSError as error:
            raise InputError(f"cannot write {self.path}: {error.strerror}") from None
        fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self.note = ""
        self._size, self._in_memory = 0, list[Samples]()
        self._ended = threading.Event()
        self._flusher = threading.Thread(target=self._flush, daemon=True)
        self._flusher.start()

    @property
    def is_open(self) -> bool:
        """Neither closed nor cleared."""
        return not self._ended.is_set()

    def append(self, samples: Samples) -> None:
        """New samples, in the order of arrival. Where the disk takes no more they go to memory: the flight goes on."""
        if self._in_memory:
            self._in_memory.append(samples)
            return
        records = np.empty(len(samples), RECORD)
        records["begin"], records["end"], records["kind"] = _MARK, _MARK, samples.kind
        records["stamp"], records["values"] = samples.stamp, samples.values
        content = records.tobytes()
        try:
            while content:
                content = content[os.write(self._file, content) :]
        except OSError as error:
            os.ftruncate(self._file, self._size)
            self._in_memory.append(samples)
            count = self._size // RECORD.itemsize
            self.note = f"the disk took no more after {count} samples ({error.strerror}): the rest was in memory alone"
        else:
            self._size += records.nbytes

    def __iter__(self) -> Iterator[Samples]:
        samples = _read(self.path / RECORDS)
        if len(samples):
            yield samples
        yield from self._in_memory

    def clear(self) -> None:
        """Forget the flight: its run has been written, or there was none."""
        self.close()
        shutil.rmtree(self.path, ignore_errors=True)

    def close(self) -> None:
        """Write no more; what has come stays."""
        if self.is_open:
            self._ended.set()
            self._flusher.join()
            os.close(self._file)

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
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be recovered ({error}): its samples had not begun to come") from None
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise InputError(f"{path / FLIGHT} is none of this version of the program: recover it with that which flew")
    if not len(samples):
        raise InputError(f"{path} holds no samples: nothing had come when it was cut off; delete it")
    return content, path / AIRCRAFT, samples


def _what_to_do(path: Path, run: str | Path) -> str:
    if _is_held(path):
        return "is being flown by another process: give this run another name"
    return f"holds a flight that was cut off: recover it with aircraft-sysid recover {run}, or delete it"


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
    records: npt.NDArray[Any] = np.memmap(path, RECORD, "r", shape=(count,))
    wrong = np.flatnonzero((records["begin"] != _MARK) | (records["end"] != _MARK) | (records["kind"] >= len(Kind)))
    records = records[: wrong[0]] if len(wrong) else records
    return Samples(records["stamp"], records["kind"].astype(np.int64), records["values"])
