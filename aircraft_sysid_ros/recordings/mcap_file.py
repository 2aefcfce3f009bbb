"""MCAP files read whole, at memory speed, and as far as they go: a recorder may have died, a bit may have flipped.

Messages lie in the data section directly or in chunks, compressed or not. What checksums there are, are checked: that
of the data section, which holds for everything in it, else those of the chunks, and that of the summary. A chunk
whose checksum is wrong is left out, everything else is read, and the statistics of the summary say what is missing.
https://mcap.dev/spec
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.archives import allowed_size
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import losses
from aircraft_sysid_ros.recordings import mcap_records as mcap
from aircraft_sysid_ros.recordings.decompression import Undecompressible, decompress
from aircraft_sysid_ros.recordings.raw_messages import Channel, Integers, RawMessages, printable

Bytes = npt.NDArray[np.uint8]

MAGIC = b"\x89MCAP0\r\n"
_DATA_END = struct.Struct("<BQI")  # kind, length, checksum of the data section
_FOOTER = struct.Struct("<BQQQI")  # kind, length, starts of summary and summary offsets, checksum of the summary
_CHUNK = struct.Struct("<QQQI")  # first and last log time, size of the records, their checksum
_STATISTICS = struct.Struct("<QHIIIIQQI")  # messages, five other counts, first and last log time, bytes of the map
_COUNT = struct.Struct("<HQ")  # channel and its messages in that map
_CHECKSUM = 4  # bytes, the last ones of the footer

DAMAGED_END = "the end of the recording is damaged: the numbers of messages that it states there are not used"
SUMMARY = "its summary"


def read_mcap(path: Path) -> RawMessages:
    """All messages of an MCAP file that can be read; its notes say what could not.

    Raises InputError for what is not an MCAP file.
    """
    return read_mcap_data(np.fromfile(path, dtype=np.uint8), path)


def read_mcap_data(data: Bytes, path: Path) -> RawMessages:
    """The same of the content of a file; ``path`` is what it is called in messages."""
    if data[: len(MAGIC)].tobytes() != MAGIC:
        raise InputError(f"{path} is not an MCAP file: it is empty, damaged or something else")
    data = data.view()
    data.flags.writeable = False  # as what is decompressed: the kernels are compiled for one kind of array
    summary = _read_summary(data)
    contents = _Contents(data)
    if summary is not None and summary.is_checked:  # what it says of the topics goes before what the data say
        contents.add_descriptions(summary.records)
    contents.add_data_section(summary)
    if summary is not None and not summary.is_checked:
        contents.add_descriptions(summary.records)
    return contents.messages(summary)


@dataclass(frozen=True)
class _Summary:
    """What stands behind the data section: where that ends, and the records as of find_records."""

    start: int
    records: Integers
    is_checked: bool  # by its checksum


def _read_summary(data: Bytes) -> _Summary | None:
    """None where the end of the file is missing or damaged."""
    footer = len(data) - len(MAGIC) - _FOOTER.size
    if footer < len(MAGIC) + _DATA_END.size:
        return None
    kind, length, start, _, checksum = _FOOTER.unpack_from(data.data, footer)
    start = start or footer  # 0: no summary
    is_there = (kind, length) == (mcap.FOOTER, _FOOTER.size - mcap.RECORD_HEADER)
    if not is_there or not len(MAGIC) + _DATA_END.size <= start <= footer:
        return None
    if checksum:
        is_right = crc32(data[start : footer + _FOOTER.size - _CHECKSUM].data) == checksum
    else:
        is_right = _DATA_END.unpack_from(data.data, start - _DATA_END.size)[:2] == (mcap.DATA_END, _CHECKSUM)
    records = mcap.find_records(data, start, footer, mcap.IN_SUMMARY) if is_right else None
    return None if records is None else _Summary(start, records, checksum != 0)


def _data_checksum_holds(data: Bytes, end: int) -> bool | None:
    """Of a data section whose last record has its content at ``end``; None where it has no checksum."""
    checksum = int(mcap.unsigned(data, end, _CHECKSUM))
    stop = end - mcap.RECORD_HEADER
    if checksum == 0:
        return None
    if crc32(data[:stop].data) == checksum:
        return True
    first = mcap.find_records(data, len(MAGIC), stop, mcap.IN_DATA)[0]  # some writers begin behind the header
    return crc32(data[first[mcap.START] + first[mcap.LENGTH] : stop].data) == checksum


def _chosen(table: Integers, is_chosen: npt.NDArray[np.bool_]) -> Integers:
    """Rows that are chosen; nothing is copied where all are."""
    return table if is_chosen.all() else table[is_chosen]


def _in_order(table: Integers) -> Integers:
    """Rows by log time, ties as they are; nothing is copied where they are in order."""
    log_time = table[:, mcap.LOG_TIME]
    is_ordered = bool(np.all(log_time[1:] >= log_time[:-1]))
    return table if is_ordered else table.take(np.argsort(log_time, kind="stable"), axis=0)


def _without_cut_ends(data: Bytes, records: Integers) -> Integers:
    """Without the gaps that a recorder leaves which dies: the head of the chunk that it was writing, the last bytes."""
    is_gap, is_chunk = records[:, mcap.KIND] == mcap.GAP, records[:, mcap.KIND] == mcap.CHUNK
    last_chunk = np.flatnonzero(is_chunk).max(initial=-1)
    was_chunk = [i for i in np.flatnonzero(is_gap) if i > last_chunk and data[records[i, mcap.START]] == mcap.CHUNK]
    cut = [*was_chunk[-1:], *np.flatnonzero(is_gap[-1:]) + len(records) - 1]
    return np.delete(records, cut, axis=0)


class _Contents:
    """What was found so far in a file: buffers (itself, then decompressed chunks) and where in them messages are."""

    def __init__(self, data: Bytes) -> None:
        self.data = data
        self.buffers = [data]
        self.size = len(data)  # of all buffers
        self.left = allowed_size(len(data))  # bytes that chunks may still decompress to
        self.tables: list[Integers] = []  # rows of find_records that are messages, in the order of the file
        self.count = 0  # messages in them
        self.unchecked = 0  # those whose bytes no checksum confirms
        self.schemas: dict[int, tuple[str, str, str]] = {}  # name, encoding, definition
        self.channels: dict[int, tuple[int, str]] = {}  # schema and topic
        self.is_cut = False  # whether the recorder left the file without an end
        self.holds: bool | None = None  # whether the checksum of the data section is right, None where it has none
        self.damages: list[losses.Damage] = []
        self.notes: list[str] = []  # further ones
        self.unknown: Counter[int] = Counter()  # records by kind that the format does not have

    def add_data_section(self, summary: _Summary | None) -> None:
        """Everything in the file but the summary."""
        stop = len(self.data) if summary is None else summary.start
        records = mcap.find_records(self.data, len(MAGIC), stop, mcap.IN_DATA)
        if len(records) and records[-1, mcap.KIND] == mcap.DATA_END:
            self.holds = _data_checksum_holds(self.data, int(records[-1, mcap.START]))
        elif summary is None:
            self.is_cut = True
            records = _without_cut_ends(self.data, records)
        self._add_records(self.data, records[records[:, mcap.KIND] != mcap.MESSAGE_INDEX], 0, self.holds is True)

    def _add_records(self, data: Bytes, records: Integers, base: int, is_checked: bool) -> None:
        """Messages, descriptions and chunks among the records, in their order; ``base``: where the buffer begins."""
        at = 0
        for i in np.flatnonzero(records[:, mcap.KIND] != mcap.MESSAGE).tolist():
            self._add_messages(records[at:i], base, is_checked)
            kind, start, length = records[i, : mcap.LENGTH + 1].tolist()
            if kind == mcap.CHUNK:
                self._add_chunk(data, start, is_checked)
            elif kind == mcap.GAP:
                where = "a chunk" if base else "the file"
                self._add_damage(f"{length} bytes at byte {start} of {where} are not records")
            else:
                self._add_description(kind, data[start : start + length].tobytes())
            at = i + 1
        self._add_messages(records[at:], base, is_checked)

    def _add_messages(self, records: Integers, base: int, is_checked: bool) -> None:
        records[:, mcap.START] += base
        self.tables.append(records)
        self.count += len(records)
        self.unchecked += 0 if is_checked else len(records)

    def _add_chunk(self, data: Bytes, start: int, is_checked: bool) -> None:
        """Records of the chunk whose content begins at ``start`` of the file; an uncompressed one is not copied."""
        *_, size, checksum = _CHUNK.unpack_from(data.data, start)
        compression, at = _text(data, start + _CHUNK.size)
        stop = at + 8 + int(mcap.unsigned(data, at, 8))
        at += 8
        try:
            content = data[at:stop]
            if compression:
                content = np.frombuffer(decompress(compression, content.tobytes(), size, self.left), np.uint8)
            elif size != len(content):
                raise Undecompressible("does not have the length that it announces")
            if checksum and (compression or not is_checked) and crc32(content.data) != checksum:
                raise Undecompressible("has a wrong checksum")
        except Undecompressible as error:
            self._add_damage(f"the chunk at byte {start} of the file {error}")
            return
        is_checked = is_checked or checksum != 0
        if compression:
            self.buffers.append(content)
            self.size += len(content)
            self.left -= len(content)
            records = mcap.find_records(content, 0, len(content), mcap.IN_CHUNK)
            self._add_records(content, records, self.size - len(content), is_checked)
        else:
            self._add_records(data, mcap.find_records(data, at, stop, mcap.IN_CHUNK), 0, is_checked)

    def _add_damage(self, what: str) -> None:
        self.damages.append(losses.Damage(what, self.count))

    def add_descriptions(self, records: Integers) -> None:
        """Schemas and channels of the summary."""
        for kind, start, length, *_ in records.tolist():
            if kind == mcap.GAP:
                self.notes.append("the summary at the end of the recording is damaged")
            else:
                self._add_description(kind, self.data[start : start + length].tobytes())

    def _add_description(self, kind: int, content: bytes) -> None:
        """A schema or a channel; of two with the same number the first counts."""
        number = int.from_bytes(content[:2], "little")
        if kind == mcap.SCHEMA and number:
            name, at = _text(content, 2)
            encoding, at = _text(content, at)
            schema = (printable(name), encoding, _text(content, at)[0])
            if self.schemas.setdefault(number, schema) != schema:
                self.notes.append(f"the type {self.schemas[number][0]} is defined in two ways: the first counts")
        elif kind == mcap.CHANNEL:
            channel = (int.from_bytes(content[2:4], "little"), printable(_text(content, 4)[0]))
            first = self.channels.setdefault(number, channel)
            if first != channel:
                self.notes.append(f"{first[1]} is described in two ways, also as {channel[1]}: the first counts")
        elif kind > mcap.LAST_KNOWN:
            self.unknown[kind] += 1

    def messages(self, summary: _Summary | None) -> RawMessages:
        """Everything in order of log time, ties in the order of the file."""
        in_file = np.concatenate([np.empty((0, mcap.COLUMNS), np.int64), *self.tables])
        is_described = np.zeros(1 << 16, dtype=np.bool_)  # by the number of the channel
        is_described[list(self.channels)] = True
        table = _in_order(_chosen(in_file, is_described[in_file[:, mcap.MESSAGE_CHANNEL]]))
        raw = RawMessages(
            self.data if len(self.buffers) == 1 else np.concatenate(self.buffers),
            channel=table[:, mcap.MESSAGE_CHANNEL].copy(),
            log_time=table[:, mcap.LOG_TIME].copy(),
            start=table[:, mcap.START] + mcap.MESSAGE_HEADER,
            length=table[:, mcap.LENGTH] - mcap.MESSAGE_HEADER,
            channels=self._described_channels(),
        )
        statistics = _statistics(self.data, summary)
        notes = [
            *self._end_notes(summary),
            *losses.damage_notes(self.damages, in_file[:, mcap.LOG_TIME]),
            *self.notes,
            *losses.undescribed_notes(len(in_file) - len(raw)),
            *(f"{n} records of the unknown kind {kind:#04x} were skipped" for kind, n in self.unknown.items()),
            *(statistics.notes(raw) if statistics else ()),
            *self._checksum_notes(),
        ]
        missing = losses.missing_messages(statistics.by_topic(raw), raw.counts()) if statistics else {}
        return replace(raw, missing=missing).with_notes(notes)

    def _described_channels(self) -> dict[int, Channel]:
        schemas = {**self.schemas, 0: ("", "", "")}
        return {key: Channel(topic, *schemas.get(schema, schemas[0])) for key, (schema, topic) in self.channels.items()}

    def _end_notes(self, summary: _Summary | None) -> list[str]:
        if self.is_cut:
            return [losses.NOT_FINISHED]
        is_whole = summary is not None and self.data[-len(MAGIC) :].tobytes() == MAGIC
        return [] if is_whole else [DAMAGED_END]

    def _checksum_notes(self) -> list[str]:
        if self.holds is not False:
            return losses.checksum_notes(self.unchecked, self.count)
        if self.unchecked:
            return [f"the checksum of the recording is wrong: {self.unchecked} of its messages may be damaged"]
        located = self.damages or self.notes
        return [] if located else ["the checksum of the recording is wrong, but those of all its messages are right"]


@dataclass(frozen=True)
class _Statistics:
    """Messages in all and by channel, and first and last log time [ns], as the summary states them."""

    count: int
    messages: dict[int, int]
    first: int
    last: int

    def notes(self, raw: RawMessages) -> list[str]:
        """How they differ from the messages that were read."""
        outside = int(np.sum((raw.log_time < self.first) | (raw.log_time > self.last)))
        times = [f"{outside} messages have log times outside of those that its summary states"] if outside else []
        if not self.messages:
            return [*losses.count_notes(SUMMARY, {"in all": self.count}, {"in all": len(raw)}), *times]
        return [*losses.count_notes(SUMMARY, self.by_topic(raw), raw.counts()), *times]

    def by_topic(self, raw: RawMessages) -> Counter[str]:
        """Messages by topic."""
        counted: Counter[str] = Counter()
        for key, count in self.messages.items():
            counted[raw.channels[key].topic if key in raw.channels else f"channel {key}"] += count
        return counted


def _statistics(data: Bytes, summary: _Summary | None) -> _Statistics | None:
    for kind, start, length, *_ in summary.records.tolist() if summary else ():
        if kind == mcap.STATISTICS:
            content = data[start : start + length].tobytes()
            count, *_, first, last, size = _STATISTICS.unpack_from(content)
            counts = content[_STATISTICS.size :][: size - size % _COUNT.size]
            return _Statistics(count, dict(_COUNT.iter_unpack(counts)), first, last)
    return None


def _text(data: Bytes | bytes, at: int) -> tuple[str, int]:
    """The text whose length stands at ``at``, and where it ends."""
    start = at + 4
    end = start + int.from_bytes(bytes(data[at:start]), "little")
    return bytes(data[start:end]).decode("utf-8", "replace"), end
