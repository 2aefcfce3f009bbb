"""An MCAP file behind the rosbag2 writer of rosbags: all messages at once, with checksums of everything.

The records are those of the mcap library, but for messages and their indices: that library writes them one by one, and
a recording has a hundred thousand. https://mcap.dev/spec
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any, cast
from zlib import crc32

import numpy as np
import numpy.typing as npt
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer

from aircraft_sysid_ros.recordings.mcap_file import MAGIC
from aircraft_sysid_ros.recordings.mcap_records import MESSAGE, MESSAGE_HEADER, RECORD_HEADER

Integers = npt.NDArray[np.int64]
Bytes = npt.NDArray[np.uint8]

#: [bytes] A chunk with a wrong bit is lost as a whole: some seconds of flight.
_CHUNK_SIZE = 128 * 1024
_HEADER = np.dtype(
    [("kind", "u1"), ("size", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_INDEX = struct.Struct("<BQHI")  # kind, length, channel, bytes of the pairs
_PAIR = 16  # bytes of a log time and an offset


@dataclass(frozen=True)
class Batch:
    """Serialised messages (n, length) of a topic and their log times [ns] (n,)."""

    topic: str
    log_time: Integers
    messages: Bytes


@dataclass(frozen=True)
class _Sequence:
    """n message records one after the other, in order of log time."""

    data: Bytes
    start: Integers  # (n + 1,) of each in the data, and their end
    log_time: Integers  # (n,)
    channel: Integers  # (n,)


def _in_order(batches: list[Batch], channels: dict[str, int]) -> _Sequence:
    """Messages as records; ties of log time in the order of the batches."""
    counts = [len(batch.log_time) for batch in batches]
    log_time = np.concatenate([batch.log_time for batch in batches])
    length = np.repeat([_HEADER.itemsize + batch.messages.shape[1] for batch in batches], counts)
    channel = np.repeat([channels[batch.topic] for batch in batches], counts)
    order = np.argsort(log_time, kind="stable")
    start = np.concatenate([[0], np.cumsum(length[order])])
    at = np.empty_like(order)
    at[order] = start[:-1]
    data = np.empty(start[-1], np.uint8)
    for batch, end in zip(batches, accumulate(counts), strict=True):
        _put(batch, channels[batch.topic], at[end - len(batch.log_time) : end], data)
    return _Sequence(data, start, log_time[order], channel[order])


def _put(batch: Batch, channel: int, at: Integers, data: Bytes) -> None:
    """Write the messages of a batch as records at the places ``at`` (n,) of the data."""
    size = batch.messages.shape[1]
    table = np.zeros(len(at), np.dtype([("header", _HEADER), ("content", np.void, max(size, 1))]))
    header = table["header"]
    header["kind"], header["size"], header["channel"] = MESSAGE, MESSAGE_HEADER + size, channel
    header["log"] = header["publish"] = batch.log_time
    if size:
        table["content"] = np.ascontiguousarray(batch.messages).view(np.dtype((np.void, size))).ravel()
    whole = np.dtype((np.void, _HEADER.itemsize + size))
    rows = np.ndarray(len(at), whole, table, strides=(table.itemsize,))
    # An overlapping view with a record from every byte on: writing to it copies each once.
    np.ndarray(len(data) - whole.itemsize + 1, whole, data, strides=(1,))[at] = rows


class _McapStorage:
    """What the rosbag2 writer of rosbags asks of a storage."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        self.path = path / f"{path.name}.mcap"
        self._file = self.path.open("xb")
        self._checksum = 0  # of the data section so far
        self._schemas: dict[str, records.Schema] = {}
        self._channels: dict[int, records.Channel] = {}
        self._described: list[records.McapRecord] = []  # schemas and channels for the next chunk
        self._chunks: list[records.ChunkIndex] = []
        self._statistics = records.Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
        self._add(MAGIC)
        self._add(_written(records.Header("ros2", "aircraft_sysid_ros")))

    def add_msgtype(self, connection: Any) -> None:
        """The definition of a type."""
        encoding = {"MSG": "ros2msg", "IDL": "ros2idl"}[connection.msgdef.format.name]
        definition, number = connection.msgdef.data.encode(), len(self._schemas) + 1
        self._schemas[connection.msgtype] = records.Schema(number, definition, encoding, connection.msgtype)
        self._described.append(self._schemas[connection.msgtype])

    def add_connection(self, connection: Any, offered_qos_profiles: str) -> None:
        """A topic."""
        about = {"offered_qos_profiles": offered_qos_profiles, "topic_type_hash": connection.digest}
        encoding, schema = connection.ext.serialization_format, self._schemas[connection.msgtype].id
        self._channels[connection.id] = records.Channel(connection.id, connection.topic, encoding, about, schema)
        self._described.append(self._channels[connection.id])

    def write(self, connection: Any, timestamp: int, data: bytes) -> None:
        """One message; ``write_all`` writes them together."""
        raise NotImplementedError

    def write_all(self, batches: list[Batch]) -> None:
        """Messages, of which none may be earlier than those of the call before."""
        if not batches:
            return
        messages = _in_order(batches, {channel.topic: channel.id for channel in self._channels.values()})
        head = b"".join(map(_written, self._described))
        self._described.clear()
        first, count = 0, len(messages.log_time)
        while first < count:  # a message that makes a chunk too large ends it
            full = messages.start[first] + _CHUNK_SIZE - len(head)
            last = min(int(np.searchsorted(messages.start, full, side="right")), count)
            self._add_chunk(head, messages, slice(first, last))
            head, first = b"", last
        about = self._statistics
        for channel, number in _counts(messages.channel).items():
            about.channel_message_counts[channel] = about.channel_message_counts.get(channel, 0) + number
        if not about.message_count:
            about.message_start_time = int(messages.log_time[0])
        about.message_end_time = int(messages.log_time[-1])
        about.message_count += count

    def _add_chunk(self, head: bytes, messages: _Sequence, part: slice) -> None:
        begin, end = int(messages.start[part.start]), int(messages.start[part.stop])
        data = head + messages.data[begin:end].tobytes()
        times, channels = messages.log_time[part], messages.channel[part]
        first, last, place = int(times[0]), int(times[-1]), self._file.tell()
        chunk = _written(records.Chunk("", data, last, first, crc32(data), len(data)))
        self._add(chunk)
        offsets: dict[int, int] = {}
        indices: list[bytes] = []
        at = self._file.tell()
        for channel in _counts(channels):
            rows = np.flatnonzero(channels == channel)
            pairs = np.stack([times[rows], messages.start[part][rows] - begin + len(head)], axis=1).astype("<u8")
            offsets[channel] = at + sum(len(index) for index in indices)
            size = _PAIR * len(rows)
            index = _INDEX.pack(Opcode.MESSAGE_INDEX, _INDEX.size - RECORD_HEADER + size, channel, size)
            indices.append(index + pairs.tobytes())
        self._add(b"".join(indices))
        length = self._file.tell() - at
        self._chunks.append(
            records.ChunkIndex(len(chunk), place, "", len(data), last, length, offsets, first, len(data))
        )

    def _add(self, data: bytes) -> None:
        self._checksum = crc32(data, self._checksum)
        self._file.write(data)

    def close(self, version: int, metadata: str) -> None:
        """Write what stands at the end."""
        place, text = self._file.tell(), records.Metadata("rosbag2", {"serialized_metadata": metadata})
        self._add(_written(text))
        index = records.MetadataIndex(place, self._file.tell() - place, "rosbag2")
        self._file.write(_written(records.DataEnd(self._checksum)))
        about = self._statistics
        about.schema_count, about.channel_count = len(self._schemas), len(self._channels)
        about.chunk_count, about.metadata_count = len(self._chunks), 1
        groups: dict[Opcode, Iterable[records.McapRecord]] = {
            Opcode.SCHEMA: self._schemas.values(),
            Opcode.CHANNEL: self._channels.values(),
            Opcode.STATISTICS: [about],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: [index],
        }
        self._write_summary(groups)
        self._file.close()

    def _write_summary(self, groups: dict[Opcode, Iterable[records.McapRecord]]) -> None:
        start = at = self._file.tell()
        parts, offsets = [], []
        for kind, members in groups.items():
            parts.append(b"".join(map(_written, members)))
            offsets.append(_written(records.SummaryOffset(kind, at, len(parts[-1]))))
            at += len(parts[-1])
        summary = b"".join([*parts, *offsets])
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, at)
        self._file.write(summary)
        self._file.write(_written(records.Footer(start, at, crc32(footer, crc32(summary)))))
        self._file.write(MAGIC)

    def abort(self) -> None:
        """Close after an error."""
        self._file.close()


def _counts(channels: Integers) -> dict[int, int]:
    """Messages by channel, in the order in which they first appear."""
    numbers, first, counts = np.unique(channels, return_index=True, return_counts=True)
    order = np.argsort(first)
    return dict(zip(numbers[order].tolist(), counts[order].tolist(), strict=True))


def _written(record: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # of mcap: without a return type


class BagWriter(Writer):
    """Writes a rosbag2 folder with one MCAP file: checksums of chunks, data section and summary, and statistics."""

    STORAGE_PLUGINS = cast("Any", {StoragePlugin.MCAP: _McapStorage})

    def __init__(self, path: Path) -> None:
        super().__init__(path, version=9, storage_plugin=StoragePlugin.MCAP)

    def write_all(self, batches: list[Batch]) -> None:
        """Messages of topics that have been added, in any order; none earlier than those of the call before."""
        batches = [batch for batch in batches if len(batch.log_time)]
        cast("_McapStorage", self.storage).write_all(batches)
        numbers = {connection.topic: connection.id for connection in self.connections}
        for batch in batches:
            self.counts[numbers[batch.topic]] += len(batch.log_time)
            self.min_timestamp = min(self.min_timestamp, int(batch.log_time.min()))
            self.max_timestamp = max(self.max_timestamp, int(batch.log_time.max()))
