"""Where the records of an MCAP file lie, also in a file that is damaged in places.

A record is a byte of kind, eight bytes of length, and its content. One wrong bit in a length would take everything
behind it along, so the walk does not trust a length alone: a record must be of a kind that is allowed where it
stands, and its fields must fit into it. Where that is not so, the walk looks for the next place from which whole
records follow one another, first inside the record before, whose length may be the wrong one; the bytes between
become a gap, which is never silent.
https://mcap.dev/spec
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit

Bytes = npt.NDArray[np.uint8]
Records = npt.NDArray[np.int64]
Integer = int | np.int64

#: Kinds of records. A gap is not one of the format: it stands for bytes that are no records.
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)
GAP = -1
LAST_KNOWN = DATA_END
#: Columns of what find_records returns; the last two are of messages only.
KIND, START, LENGTH, MESSAGE_CHANNEL, LOG_TIME = range(5)
COLUMNS = 5

#: Kinds that may stand in the data section, in a chunk and in the summary, a bit for each. A kind after LAST_KNOWN
#: may stand everywhere: readers skip it.
IN_CHUNK = 1 << SCHEMA | 1 << CHANNEL | 1 << MESSAGE
IN_DATA = IN_CHUNK | 1 << HEADER | 1 << CHUNK | 1 << MESSAGE_INDEX | 1 << ATTACHMENT | 1 << METADATA | 1 << DATA_END
IN_SUMMARY = (
    1 << SCHEMA | 1 << CHANNEL | 1 << CHUNK_INDEX | 1 << ATTACHMENT_INDEX
    | 1 << STATISTICS | 1 << METADATA_INDEX | 1 << SUMMARY_OFFSET
)  # fmt: skip
#: What whole records can follow one another from: these have fields to check.
_ANCHORS = IN_CHUNK | 1 << CHUNK | 1 << DATA_END

RECORD_HEADER = 9  # bytes of kind and length
MESSAGE_HEADER = 22  # channel u16, sequence u32, log time u64, publish time u64
_LOG_TIME_AT = 6  # where in it
CHUNK_HEADER = 28  # start u64, end u64, size u64, checksum u32, then the name of the compression
_MESSAGE_COUNTS = 42  # where they begin in the statistics
#: A later version of the format may append fields to a record, but not more bytes than this.
_LONGEST_ADDITION = 1024
#: So many records in a row are no coincidence.
_CHAIN = 3


@njit(cache=True)
def unsigned(data: Bytes, at: Integer, size: Integer) -> Integer:
    """Little-endian number of ``size`` bytes; negative where it does not fit into int64."""
    value = np.int64(0)
    for i in range(size):
        value |= np.int64(data[at + i]) << (8 * i)
    return value


@njit(cache=True)
def _after_fields(
    data: Bytes, at: Integer, stop: Integer, texts: Integer, long_texts: Integer, rest: Integer
) -> Integer:
    """Where the fields from ``at`` on end: texts with lengths of four and of eight bytes, and ``rest`` more bytes.

    -1 where they reach beyond ``stop``.
    """
    for i in range(texts + long_texts):
        width = 4 if i < texts else 8
        if at + width > stop:
            return -1
        size = unsigned(data, at, width)
        if size < 0 or size > stop - at - width:
            return -1
        at += width + size
    return at + rest if at + rest <= stop else -1


@njit(cache=True)
def _end_of_fields(data: Bytes, kind: Integer, start: Integer, stop: Integer) -> Integer:
    """Where the known fields of a record with the content ``data[start:stop]`` end, -1 where they do not fit."""
    if kind == SCHEMA:
        return _after_fields(data, start + 2, stop, 3, 0, 0)
    if kind == CHANNEL:
        return _after_fields(data, start + 4, stop, 3, 0, 0)
    if kind == MESSAGE:
        return stop if stop - start >= MESSAGE_HEADER else -1
    if kind == CHUNK:
        return _after_fields(data, start + CHUNK_HEADER, stop, 1, 1, 0)
    if kind == MESSAGE_INDEX:
        return _after_fields(data, start + 2, stop, 1, 0, 0)
    if kind == ATTACHMENT:
        return _after_fields(data, start + 16, stop, 2, 1, 4)
    if kind == STATISTICS:
        return _after_fields(data, start + _MESSAGE_COUNTS, stop, 1, 0, 0)
    if kind == HEADER or kind == METADATA:
        return _after_fields(data, start, stop, 2, 0, 0)
    if kind == DATA_END:
        return stop if stop - start == 4 else -1
    return stop


@njit(cache=True)
def _length_at(data: Bytes, at: Integer, stop: Integer) -> Integer:
    """Length of the content of the record at ``at``, -1 where it reaches beyond ``stop``."""
    if at + RECORD_HEADER > stop:
        return -1
    length = unsigned(data, at + 1, 8)
    return length if length <= stop - at - RECORD_HEADER else -1


@njit(cache=True)
def _can_stand(data: Bytes, kind: Integer, start: Integer, stop: Integer, allowed: Integer, before: Integer) -> bool:
    """Whether ``data[start:stop]`` can be the content of a record, no message, behind one of the kind ``before``."""
    if kind == 0 or (kind <= LAST_KNOWN and not allowed >> kind & 1):
        return False
    if (kind == HEADER and before != 0) or (kind == MESSAGE_INDEX and before != CHUNK and before != MESSAGE_INDEX):
        return False
    end = _end_of_fields(data, kind, start, stop)
    return bool(end >= 0 and stop - end <= _LONGEST_ADDITION)


@njit(cache=True)
def _is_anchor(data: Bytes, at: Integer, stop: Integer, allowed: Integer) -> bool:
    """Whether whole records follow one another from ``at`` on, each filled by its fields."""
    wanted = allowed & _ANCHORS
    for _ in range(_CHAIN):
        length, kind = _length_at(data, at, stop), np.int64(data[at])
        if length < 0 or kind > LAST_KNOWN or not wanted >> kind & 1:
            return False
        at += RECORD_HEADER + length
        if _end_of_fields(data, kind, at - length, at) != at:
            return False
        if at == stop:
            return True
        wanted = allowed & ~(1 << HEADER)
    return True


@njit(cache=True)
def _find_anchor(data: Bytes, start: Integer, limit: Integer, stop: Integer, allowed: Integer) -> Integer:
    """First place in ``data[start:limit]`` from which whole records follow, ``limit`` where there is none."""
    for at in range(start, limit):
        if _is_anchor(data, at, stop, allowed):
            return at
    return limit


@njit(cache=True)
def _is_doubtful(data: Bytes, record: Records) -> bool:
    """Whether nothing confirms the length of a record (its row): its fields do not fill it, or are of any length."""
    kind, start, stop = record[KIND], record[START], record[START] + record[LENGTH]
    return kind == MESSAGE or kind > LAST_KNOWN or (kind != GAP and _end_of_fields(data, kind, start, stop) != stop)


@njit(cache=True)
def _look_back(
    data: Bytes, records: Records, count: Integer, at: Integer, stop: Integer, allowed: Integer
) -> tuple[Integer, Integer]:
    """Where records follow one another inside the last ones, behind which none begins at ``at``, and how many are left.

    ``at`` and ``count`` where there are none: the records before are then as they should be.
    """
    found, left, limit = at, count, at
    while count and _is_doubtful(data, records[count - 1]):
        count -= 1
        anchor = _find_anchor(data, records[count, START], limit, stop, allowed)
        if anchor < limit:
            found, left = anchor, count
        elif records[count, KIND] <= LAST_KNOWN:
            break
        limit = records[count, START] - RECORD_HEADER  # a record that was none is no proof of the one before
    return found, left


@njit(cache=True)
def find_records(data: Bytes, start: Integer, stop: Integer, allowed: Integer) -> Records:
    """Records and gaps that fill ``data[start:stop]``: rows of kind, start and length of the content, shape (n, 5).

    Rows of messages have channel and log time [ns] too. A gap has no header: its start and length are those of the
    bytes themselves. The end of the data section ends the walk.
    """
    records = np.zeros((1024, COLUMNS), dtype=np.int64)
    count: Integer = 0
    at, kind = start, np.int64(0)
    while at < stop and kind != DATA_END:
        if count == len(records):
            records = np.concatenate((records, np.zeros_like(records)))
        before, begin, end = kind, at + RECORD_HEADER, at + RECORD_HEADER + _length_at(data, at, stop)
        kind = np.int64(data[at])
        if kind == MESSAGE and allowed >> MESSAGE & 1:  # nearly all: checked here, since a call costs more
            is_record = end - begin >= MESSAGE_HEADER
        else:
            is_record = end >= begin and _can_stand(data, kind, begin, end, allowed, before)
        if not is_record:
            begin, end = at, at
            kind = np.int64(GAP)
            end, count = _look_back(data, records, count, at, stop, allowed)
            if end < at:
                begin = records[count, START] - RECORD_HEADER
            else:
                end = _find_anchor(data, at + 1, stop, stop, allowed)
        elif kind == MESSAGE:
            records[count, MESSAGE_CHANNEL] = unsigned(data, begin, 2)
            records[count, LOG_TIME] = unsigned(data, begin + _LOG_TIME_AT, 8)
        records[count, KIND], records[count, START], records[count, LENGTH] = kind, begin, end - begin
        count += 1
        at = end
    return records[:count].copy()
