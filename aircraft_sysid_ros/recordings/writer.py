"""Writes recordings: rosbag2 folders with one MCAP file, or a bare MCAP file, readable without this package.

Messages are kept until the end, or until they are released, put in order of log time and written beside the target,
which then takes the new name at once: an error or a kill leaves no half-written recording behind.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import cdr_layout, joint_states
from aircraft_sysid_ros.recordings.message_definitions import PACKAGE
from aircraft_sysid_ros.recordings.message_types import known_types, message_from_dict
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, INPUTS_TYPE
from aircraft_sysid_ros.stamps import NANOSECONDS
from aircraft_sysid_ros.text_file import put_in_place

_FRAME = "header.frame_id"


@dataclass(frozen=True)
class _Batch:
    """Serialised messages (n, length) of a connection and their log times (n,)."""

    connection: tuple[str, str]
    log_time: npt.NDArray[np.int64]
    messages: npt.NDArray[np.uint8]

    def part(self, rows: npt.NDArray[np.bool_]) -> _Batch:
        """Some of its messages, by rows (n,)."""
        return self if rows.all() else _Batch(self.connection, self.log_time[rows], self.messages[rows])


class RecordingWriter:
    """Context manager that writes a recording to a folder (rosbag2) or to a file when the path ends in .mcap.

    Raises InputError where the path is taken; ``overwrite`` replaces a recording, but never another folder.
    """

    def __init__(self, path: str | Path, *, overwrite: bool = False) -> None:
        self.path = Path(path)
        self._batches: list[_Batch] = []
        self._connections: dict[str, str] = {}
        self._bag: _OpenBag | None = None
        self._files: dict[Path, bytes] = {}
        self._check = partial(_check_target, self.path, overwrite)
        self._check()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            if error is None:
                self._finish()
        finally:
            if self._bag is not None:
                self._bag.discard()

    def write(
        self,
        topic: str,
        type_name: str,
        stamp: npt.ArrayLike,
        fields: Mapping[str, Any],
        *,
        log_time: npt.ArrayLike | None = None,
        frame_id: str = "",
    ) -> None:
        """n messages of fixed layout: ``stamp`` [ns] (n,) and flat fields (n,) or (n, k), or one for all.

        A text may be one for all or a sequence of n. Numbers that are not given are 0, as in ROS, but NaN in
        our own messages. ``log_time`` [ns] (n,) is when they arrived, by default their stamps. Raises
        KeyError for a field that the type does not have.
        """
        stamps = np.atleast_1d(np.asarray(stamp, dtype=np.int64))
        arrivals = stamps if log_time is None else np.atleast_1d(np.asarray(log_time, dtype=np.int64))
        columns = {
            _FRAME: frame_id,
            "header.stamp.sec": stamps // NANOSECONDS,
            "header.stamp.nanosec": stamps % NANOSECONDS,
            **fields,
        }
        connection = self._connection(topic, type_name)
        for rows in _equal_texts(columns, len(stamps)):
            part = {name: _rows_of(value, rows, len(stamps)) for name, value in columns.items()}
            missing = np.nan if type_name.startswith(PACKAGE) else 0.0
            table = cdr_layout.encode(known_types().fielddefs, type_name, len(rows), part, missing)
            messages = table.view(np.uint8).reshape(len(rows), -1)
            self._batches.append(_Batch(connection, arrivals[rows], messages))

    def write_inputs(
        self,
        stamp: npt.NDArray[np.int64],
        names: Sequence[str],
        values: npt.NDArray[np.float64],
        *,
        log_time: npt.NDArray[np.int64] | None = None,
        frame_id: str = "",
    ) -> None:
        """n messages of the topic of named inputs: ``stamp`` [ns] (n,) and values (n, k) of k names."""
        connection = self._connection(INPUTS_TOPIC, INPUTS_TYPE)
        messages = joint_states.encode(stamp, frame_id, names, values)
        self._batches.append(_Batch(connection, stamp if log_time is None else log_time, messages))

    def write_message(self, topic: str, type_name: str, log_time: int, message: Any) -> None:
        """One message of any type: a mapping of fields (a time is int [ns]) or an object with them."""
        if isinstance(message, Mapping):
            message = message_from_dict(type_name, message)
        content = np.frombuffer(known_types().serialize_cdr(message, type_name), np.uint8)
        times = np.array([log_time], dtype=np.int64)
        self._batches.append(_Batch(self._connection(topic, type_name), times, content[None, :]))

    def _connection(self, topic: str, type_name: str) -> tuple[str, str]:
        topic = "/" + topic.lstrip("/")
        if self._connections.setdefault(topic, type_name) != type_name:
            raise ValueError(f"{topic} already has the type {self._connections[topic]}")
        return topic, type_name

    def release(self, before: int) -> None:
        """Write all messages with a log time before that [ns], which no later one may precede, and forget them."""
        try:
            if self._bag is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._bag = _OpenBag(self.path)
            early = [batch.part(batch.log_time < before) for batch in self._batches]
            late = [batch.part(batch.log_time >= before) for batch in self._batches]
            self._batches = [batch for batch in late if len(batch.log_time)]
            self._bag.write([batch for batch in early if len(batch.log_time)], self._connections)
        except OSError as error:
            raise InputError(f"cannot write the recording {self.path}: {error.strerror or error}") from None

    def add_file(self, path: Path, content: bytes) -> None:
        """A file in the folder of the recording, or beside it: it is there with the recording or not at all."""
        self._files[path] = content

    def _finish(self) -> None:
        self.release(np.iinfo(np.int64).max)
        assert self._bag is not None
        try:
            self._bag.put_in_place(self.path, self._files, self._check)
        except OSError as error:
            raise InputError(f"cannot write the recording {self.path}: {error.strerror or error}") from None


class _OpenBag:
    """A recording that grows in a folder beside its target; nothing of it stays unless it is put in place."""

    def __init__(self, target: Path) -> None:
        from aircraft_sysid_ros.recordings.mcap_storage import BagWriter

        self._folder = tempfile.TemporaryDirectory(dir=target.parent, prefix=f".{target.name}.")
        self._bag = Path(self._folder.name) / target.stem
        self._writer = BagWriter(self._bag)
        try:
            self._writer.open()
        except OSError:
            self._folder.cleanup()
            raise
        self._open: set[str] = set()  # topics

    def write(self, batches: list[_Batch], connections: Mapping[str, str]) -> None:
        """All messages of the batches, in order of log time."""
        from aircraft_sysid_ros.recordings.mcap_storage import Batch

        for topic, type_name in connections.items():
            if topic not in self._open:
                self._writer.add_connection(topic, type_name, typestore=known_types())
                self._open.add(topic)
        self._writer.write_all([Batch(batch.connection[0], batch.log_time, batch.messages) for batch in batches])

    def put_in_place(self, target: Path, files: Mapping[Path, bytes], check: Callable[[], None]) -> None:
        """Finish it and give it the name of the target, and the files that belong to it theirs."""
        self._writer.close()
        new = next(self._bag.glob("*.mcap")) if target.suffix == ".mcap" else self._bag
        folder = Path(self._folder.name)
        beside = {path: folder / f"beside.{path.name}" for path in files if path.parent != target}
        for path, content in files.items():  # all of them before any has its name
            beside.get(path, self._bag / path.name).write_bytes(content)
        put_in_place(new, target, folder / "replaced", check)
        for path, staged in beside.items():
            os.replace(staged, path)

    def discard(self) -> None:
        """Leave nothing behind but what was put in place."""
        with self._folder:
            self._writer.abort()


def _check_target(path: Path, overwrite: bool) -> None:
    if not path.exists():
        return
    if not overwrite:
        raise InputError(f"{path} is already there: give another name or overwrite it (--overwrite)")
    is_file = path.suffix == ".mcap"
    is_recording = path.is_file() if is_file else path.is_dir() and _is_replaceable(path)
    if not is_recording:
        raise InputError(f"{path} is not a recording and is not overwritten: give another name")


def _is_replaceable(folder: Path) -> bool:
    """An empty folder or a rosbag2: nothing else is ever deleted."""
    contents = list(folder.iterdir())
    return not contents or (folder / "metadata.yaml").exists()


def _is_texts(value: Any) -> bool:
    return not isinstance(value, str) and np.asarray(value).dtype.kind == "U"


def _equal_texts(columns: Mapping[str, Any], count: int) -> list[npt.NDArray[np.int64]]:
    """Rows in groups within which every text is the same, so that the messages of a group have one layout."""
    texts = [np.asarray(value) for value in columns.values() if _is_texts(value)]
    if not texts:
        return [np.arange(count)]
    _, group = np.unique(np.stack(texts, axis=1), axis=0, return_inverse=True)
    group = group.reshape(count)
    return [np.flatnonzero(group == g) for g in range(group.max(initial=-1) + 1)]


def _rows_of(value: Any, rows: npt.NDArray[np.int64], count: int) -> Any:
    if _is_texts(value):
        return str(np.asarray(value)[rows[0]])
    if isinstance(value, str) or np.ndim(value) == 0 or len(value) != count:
        return value
    return np.asarray(value)[rows]
