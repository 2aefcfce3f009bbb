"""MCAP files read whole, at memory speed, and as far as they go: a recorder may have died in flight.

A file is a row of records: one byte of kind, eight of length, content. Messages lie in it directly or in
chunks, which are such rows themselves, compressed or not. One jitted walk finds the records of both; Python
sees only chunks, channels and schemas. The index at the end of a file is not needed and not read.
https://mcap.dev/spec
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from zlib import crc32

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.raw_messages import Channel, RawMessages

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_KIND, _START, _LENGTH = range(3)  # columns of what find_records returns
_RECORD_HEADER = 9  # bytes of kind and length
_MESSAGE_HEADER = 22  # channel u16, sequence u32, log time u64, publish time u64
_LOG_TIME = 6  # where in it
_CHUNK_CHECKSUM = 24  # of the chunk, after start u64, end u64 and size u64
_CHUNK_HEADER = 28  # bytes of a chunk before the name of its compression


@njit(cache=True)
def _unsigned(data, at, size):
    value = np.int64(0)
    for i in range(size):
        value |= np.int64(data[at + i]) << (8 * i)
    return value


@njit(cache=True)
def find_records(data, start, stop):
    """Records in ``data[start:stop]``: rows of kind, start and length of the content, shape (n, 3).

    A last record that is cut short is not among them; the walk ends where the last whole record ends.
    """
    records = np.empty((1024, 3), dtype=np.int64)
    count, at = 0, start
    while at + _RECORD_HEADER <= stop:
        length = _unsigned(data, at + 1, 8)
        if length < 0 or length > stop - at - _RECORD_HEADER:
            break
        if count == len(records):
            records = np.concatenate((records, np.empty_like(records)))
        records[count, 0], records[count, 1], records[count, 2] = data[at], at + _RECORD_HEADER, length
        count += 1
        at += _RECORD_HEADER + length
    return records[:count].copy()


@njit(cache=True)
def _message_table(data, records):
    """Channel, log time [ns], start and length of the content of each message, shape (n, 4)."""
    table = np.empty((len(records), 4), dtype=np.int64)
    for i in range(len(records)):
        start = records[i, 1]
        table[i, 0] = _unsigned(data, start, 2)
        table[i, 1] = _unsigned(data, start + _LOG_TIME, 8)
        table[i, 2] = start + _MESSAGE_HEADER
        table[i, 3] = records[i, 2] - _MESSAGE_HEADER
    return table


def read_mcap(path: Path) -> RawMessages:
    """All messages of an MCAP file, or those before the place where it breaks off, which its notes then say.

    Raises InputError for what is not an MCAP file or holds no messages.
    """
    data = np.fromfile(path, dtype=np.uint8)
    if data[: len(MAGIC)].tobytes() != MAGIC:
        raise InputError(f"{path} is not an MCAP file: it is empty, damaged or something else")
    contents = _Contents(path)
    contents.add_file(data)
    return contents.messages()


class _Contents:
    """What was found so far: buffers (the file, then decompressed chunks) and where in them messages are."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.buffers: list[npt.NDArray[np.uint8]] = []
        self.tables: list[npt.NDArray[np.int64]] = []
        self.schemas: dict[int, tuple[str, str, str]] = {}
        self.channels: dict[int, Channel] = {}
        self.size = 0
        self.notes: list[str] = []

    def add_file(self, data: npt.NDArray[np.uint8]) -> None:
        self._add_buffer(data)
        records = find_records(data, len(MAGIC), len(data))
        ends = np.flatnonzero(np.isin(records[:, _KIND], (_FOOTER, _DATA_END)))
        whole = len(ends) > 0
        self._add_records(data, records[: ends[0]] if whole else records, 0)
        if not whole:
            self._rescue(data, records)

    def _add_buffer(self, data: npt.NDArray[np.uint8]) -> int:
        """Keep a buffer; returns where it begins in all of them together."""
        self.buffers.append(data)
        self.size += len(data)
        return self.size - len(data)

    def _add_records(self, data: npt.NDArray[np.uint8], records: npt.NDArray[np.int64], base: int) -> None:
        """Messages, channels and chunks among the records, in their order."""
        for kind, start, length in records[records[:, _KIND] != _MESSAGE]:
            if kind in (_SCHEMA, _CHANNEL):
                try:
                    self._add_description(kind, data[start : start + length].tobytes())
                except Exception:  # the reader of such records fails in many ways on damaged ones
                    raise InputError("the recording is damaged: it has a topic that cannot be read") from None
            elif kind == _CHUNK:
                self._add_chunk(data, start, start + length, base)
        messages = records[(records[:, _KIND] == _MESSAGE) & (records[:, _LENGTH] >= _MESSAGE_HEADER)]
        if len(messages):
            table = _message_table(data, messages)
            table[:, 2] += base
            self.tables.append(table)

    def _add_description(self, kind: int, content: bytes) -> None:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel as ChannelRecord
        from mcap.records import Schema

        stream = ReadDataStream(BytesIO(content))
        if kind == _SCHEMA:
            schema = Schema.read(stream)
            self.schemas[schema.id] = (schema.name, schema.encoding, schema.data.decode("utf-8", "replace"))
        else:
            channel = ChannelRecord.read(stream)
            name, encoding, text = self.schemas.get(channel.schema_id, ("", "", ""))
            self.channels[channel.id] = Channel(channel.topic, name, encoding, text)

    def _add_chunk(self, data: npt.NDArray[np.uint8], start: int, stop: int, base: int) -> None:
        """Records of a chunk in ``data[start:stop]``; an uncompressed one is not copied."""
        compression, inside = _chunk_content(data, start)
        try:
            chunk = np.frombuffer(_decompress(compression, data[inside:stop]), np.uint8)
            _check(chunk, int(_unsigned(data, start + _CHUNK_CHECKSUM, 4)))
        except Exception as error:  # each compressor raises its own
            self.notes.append(f"the chunk at byte {start} is damaged and left out ({error})")
            return
        if compression:
            self._add_records(chunk, find_records(chunk, 0, len(chunk)), self._add_buffer(chunk))
        else:
            self._add_records(data, find_records(data, inside, stop), base)

    def _rescue(self, data: npt.NDArray[np.uint8], records: npt.NDArray[np.int64]) -> None:
        """The file has no end: note it and read what there is of the chunk that was being written."""
        self.notes.append("the recording breaks off (the recorder did not finish it): read up to there")
        at = int(records[-1, _START] + records[-1, _LENGTH]) if len(records) else len(MAGIC)
        if at + _RECORD_HEADER + _CHUNK_HEADER + 12 > len(data) or data[at] != _CHUNK:
            return
        compression, inside = _chunk_content(data, at + _RECORD_HEADER)
        if not compression:
            self._add_records(data, find_records(data, inside, len(data)), 0)

    def messages(self) -> RawMessages:
        """Everything in order of log time, ties in the order of the file."""
        table = np.concatenate(self.tables) if self.tables else np.empty((0, 4), np.int64)
        table = table[np.argsort(table[:, 1], kind="stable")]
        data = self.buffers[0] if len(self.buffers) == 1 else np.concatenate(self.buffers)
        channel, log_time, start, length = table.T.copy()
        return RawMessages(data, channel, log_time, start, length, self.channels, tuple(self.notes))


def _chunk_content(data: npt.NDArray[np.uint8], start: int) -> tuple[str, int]:
    """Name of the compression of the chunk whose content starts at ``start``, and where its records start."""
    at = start + _CHUNK_HEADER
    size = int(_unsigned(data, at, 4))
    name = data[at + 4 : at + 4 + size].tobytes().decode("utf-8", "replace")
    return name, at + 4 + size + 8  # after it, the compressed size


def _decompress(compression: str, content: npt.NDArray[np.uint8]) -> bytes | npt.NDArray[np.uint8]:
    if not compression:
        return content
    if compression == "zstd":
        import zstandard

        return zstandard.ZstdDecompressor().decompressobj().decompress(content.tobytes())
    if compression == "lz4":
        import lz4.frame

        return bytes(lz4.frame.decompress(content.tobytes()))
    raise ValueError(f"unknown compression {compression}")


def _check(content: npt.NDArray[np.uint8], checksum: int) -> None:
    """Raises ValueError where the checksum is there (not 0) and wrong."""
    if checksum and crc32(content.data) != checksum:
        raise ValueError("wrong checksum")
