"""One wrong bit anywhere in a recording: what is read is right, or it is said that something is not."""

import shutil
import sqlite3
import struct
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml
import zstandard

from aircraft_sysid_ros.after_flight.log_import import import_log
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import losses, mcap_file, mcap_records, mcap_storage
from aircraft_sysid_ros.recordings.message_types import known_types
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS, gps_velocity_fields, imu_fields

START = 1_700_000_000_000_000_000
#: [s] of processor time for one reading: never a hang.
LONGEST = 20.0


def write_flight(path, n=60):
    """Random IMU samples every 10 ms, air data with every second, GPS velocity with every fifth."""
    random = np.random.default_rng(5)
    stamp = START + np.arange(n) * 10_000_000
    with RecordingWriter(path) as writer:
        writer.write("imu/data", TOPICS["imu/data"], stamp, imu_fields(*random.normal(size=(2, n, 3))), frame_id="imu")
        writer.write("gps/vel", TOPICS["gps/vel"], stamp[::5], gps_velocity_fields(random.normal(size=(n, 3))[::5]))
        air = {"true_airspeed": random.normal(20.0, 1.0, n)[::2], "sideslip": random.normal(0.0, 0.1, n)[::2]}
        writer.write("air_data", TOPICS["air_data"], stamp[::2], air)
    return path


def write_with_rosbags(source, path, plugin, mode):
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    raw = read_raw(source)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[plugin])
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        connections = {
            key: writer.add_connection(channel.topic, channel.type, typestore=known_types())
            for key, channel in raw.channels.items()
        }
        for i in range(len(raw)):
            writer.write(connections[int(raw.channel[i])], int(raw.log_time[i]), raw[i])


def write_with_mcap(source, path, compression, **options):
    from mcap.writer import CompressionType, Writer

    raw = read_raw(source)
    path.mkdir()
    with (path / "file.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=4000, compression=CompressionType[compression], **options)
        writer.start("ros2", "test")
        channels = {}
        for key, channel in raw.channels.items():
            schema = writer.register_schema(channel.type, "ros2msg", channel.definition.encode())
            channels[key] = writer.register_channel(channel.topic, "cdr", schema)
        for i in range(len(raw)):
            at = int(raw.log_time[i])
            writer.add_message(channels[int(raw.channel[i])], at, raw[i], at)
        writer.finish()


NO_SUMMARY = {
    "enable_crcs": False, "use_statistics": False, "use_summary_offsets": False,
    "repeat_channels": False, "repeat_schemas": False,
}  # fmt: skip
WRITERS = {
    "ours": lambda source, path: shutil.copytree(source, path),  # noqa: PLW0108
    "chunks": lambda s, p: write_with_mcap(s, p, "NONE"),
    "chunks zstd": lambda s, p: write_with_mcap(s, p, "ZSTD"),
    "chunks lz4": lambda s, p: write_with_mcap(s, p, "LZ4"),
    "chunks lz4 without checksums": lambda s, p: write_with_mcap(s, p, "LZ4", enable_crcs=False),
    "no chunks": lambda s, p: write_with_mcap(s, p, "NONE", use_chunking=False),
    "no chunks, no summary": lambda s, p: write_with_mcap(s, p, "NONE", use_chunking=False, **NO_SUMMARY),
    "MCAP of rosbags": lambda s, p: write_with_rosbags(s, p, "MCAP", "NONE"),
    "MCAP of rosbags, chunks compressed": lambda s, p: write_with_rosbags(s, p, "MCAP", "STORAGE"),
    "MCAP of rosbags, messages compressed": lambda s, p: write_with_rosbags(s, p, "MCAP", "MESSAGE"),
    "MCAP of rosbags, file compressed": lambda s, p: write_with_rosbags(s, p, "MCAP", "FILE"),
    "sqlite3": lambda s, p: write_with_rosbags(s, p, "SQLITE3", "NONE"),
    "sqlite3, messages compressed": lambda s, p: write_with_rosbags(s, p, "SQLITE3", "MESSAGE"),
    "sqlite3, file compressed": lambda s, p: write_with_rosbags(s, p, "SQLITE3", "FILE"),
}


@pytest.fixture
def flight(tmp_path, monkeypatch):
    """In five chunks."""
    monkeypatch.setattr(mcap_storage, "_CHUNK_SIZE", 5000)
    return write_flight(tmp_path / "flight")


def flip(file, bit):
    data = bytearray(file.read_bytes())
    data[bit // 8] ^= 1 << bit % 8
    file.write_bytes(data)


def is_same(found, whole):
    """Whether two recordings have the same samples."""
    one, other = found.samples, whole.samples
    return all(
        np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in ((one.stamp, other.stamp), (one.kind, other.kind), (one.values, other.values))
    )


def verdict(path, whole):
    """What became of a recording: refused, said in a note, the same; unseen inside a message without a checksum."""
    started = time.process_time()
    try:
        found = read_recording(path)
    except InputError as error:
        assert "\n" not in str(error)
        return "refused"
    finally:
        assert time.process_time() - started < LONGEST
    if set(found.notes) - set(whole.notes):
        return "said"
    if is_same(found, whole):
        return "same"
    return "unseen" if losses.NO_CHECKSUMS in whole.notes and found.topics == whole.topics else "silent"


def after_flip(path, file, bit, whole):
    flip(file, bit)
    try:
        return verdict(path, whole)
    finally:
        flip(file, bit)


def fuzz(path, count, seed):
    """Verdicts by (file, bit) of flips at random places of all files of a recording."""
    whole = read_recording(path)
    random = np.random.default_rng(seed)
    files = sorted(file for file in path.iterdir() if file.is_file())
    places = []
    for _ in range(count):
        file = files[int(random.integers(len(files)))]
        places.append((file, int(random.integers(8 * file.stat().st_size))))
    return {(file.name, bit): after_flip(path, file, bit, whole) for file, bit in places}


@pytest.mark.parametrize("writer", ["no chunks", "sqlite3"])
def test_names_that_are_damaged_are_shown_on_one_line(flight, tmp_path, writer):
    WRITERS[writer](flight, tmp_path / "bag")
    (file,) = (path for path in (tmp_path / "bag").iterdir() if path.suffix != ".yaml")
    data = file.read_bytes()
    for name in (b"imu/data", b"gps/vel", b"air_data"):
        data = data.replace(b"/" + name, b"/" + name[:3] + b"\n" + name[4:])
    file.write_bytes(data)
    with pytest.raises(InputError) as error:
        read_recording(tmp_path / "bag")
    assert "it holds /air\N{REPLACEMENT CHARACTER}data, /gps" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.long
@pytest.mark.parametrize("writer", WRITERS)
def test_a_wrong_bit_anywhere_is_never_silent(flight, tmp_path, writer):
    """Also in summary, footer, indexes, schemas, channels and metadata.yaml; without a traceback or a hang."""
    WRITERS[writer](flight, tmp_path / "bag")
    verdicts = fuzz(tmp_path / "bag", 150, list(WRITERS).index(writer))
    assert "silent" not in verdicts.values(), [place for place, found in verdicts.items() if found == "silent"]
    assert {"said", "same"} <= set(verdicts.values()), "the flips hit nothing, or the same file is not read the same"


@pytest.mark.long
def test_a_wrong_bit_in_a_recording_of_ours_is_always_said(flight):
    """Every byte of the file is under a checksum."""
    whole = read_recording(flight)
    assert whole.notes == ()
    file = flight / "flight.mcap"
    random = np.random.default_rng(1)
    for bit in random.integers(8 * file.stat().st_size, size=300).tolist():
        assert after_flip(flight, file, bit, whole) in ("said", "refused"), bit


@pytest.mark.long
def test_a_wrong_bit_in_a_first_message_does_not_decide_for_its_topic(flight, tmp_path):
    """The layout of all is read off the first: its lengths of texts are not to be trusted."""
    path = tmp_path / "bag"
    WRITERS["no chunks"](flight, path)
    whole, raw = read_recording(path), read_raw(path)
    file = path / "file.mcap"
    for key in raw.channels:
        begin = 8 * int(raw.start[raw.rows(key)[0]])
        for bit in [*range(begin, begin + 32), *range(begin + 96, begin + 128)]:  # representation, length of the frame
            assert after_flip(path, file, bit, whole) in ("same", "unseen", "said"), bit
            flip(file, bit)
            found = read_recording(path).topics
            flip(file, bit)
            assert sum(found.values()) >= len(raw) - 1


def message_headers(file):
    """Offsets of kind and length of all messages of an MCAP file whose chunks are not compressed."""
    data = np.frombuffer(file.read_bytes(), np.uint8)
    records = mcap_records.find_records(data, 8, len(data), mcap_records.IN_DATA)
    for kind, start, length, *_ in records.tolist():
        if kind == mcap_records.CHUNK:
            inside = mcap_records.find_records(data, start + 40, start + length, mcap_records.IN_CHUNK)
            records = np.concatenate((records, inside))
    messages = records[records[:, mcap_records.KIND] == mcap_records.MESSAGE]
    return (messages[:, mcap_records.START] - mcap_records.RECORD_HEADER).tolist()


@pytest.mark.parametrize("writer", ["MCAP of rosbags", "no chunks", "no chunks, no summary"])
def test_a_wrong_length_without_checksums_costs_its_message_and_not_those_behind(flight, tmp_path, writer):
    path = tmp_path / "bag"
    WRITERS[writer](flight, path)
    whole, raw = read_recording(path), read_raw(path)
    file = next(path.glob("*.mcap"))
    headers = message_headers(file)
    assert len(headers) == len(raw) == 60 + 12 + 30
    random = np.random.default_rng(2)
    for at in random.choice(headers, 40).tolist():
        bit = 8 * at + int(random.integers(8 * mcap_records.RECORD_HEADER))
        assert after_flip(path, file, bit, whole) == "said"
        flip(file, bit)
        assert len(raw) - 2 <= len(read_raw(path)) <= len(raw), bit
        flip(file, bit)


@pytest.mark.long
def test_a_length_that_leaps_over_thousands_of_messages_costs_one_or_two(tmp_path):
    """Where it lands, bytes may look like a record of an unknown kind: that is no proof of the leap."""
    write_with_rosbags(write_flight(tmp_path / "flight", n=3000), tmp_path / "bag", "MCAP", "NONE")
    file, whole = tmp_path / "bag" / "bag.mcap", read_raw(tmp_path / "bag")
    headers = message_headers(file)
    random = np.random.default_rng(3)
    for at in random.choice(headers[: len(headers) // 2], 60).tolist():
        bit = 8 * (at + 1) + int(random.integers(10, 19))
        flip(file, bit)
        raw = read_raw(tmp_path / "bag")
        flip(file, bit)
        assert len(whole) - 2 <= len(raw) <= len(whole), bit
        assert any("are not records: messages may be missing from " in note for note in raw.notes)


def chunks(file):
    """Start of the content, and the messages by topic, of every chunk, by the reader of the mcap package."""
    from mcap.records import Channel, Chunk, Message
    from mcap.stream_reader import StreamReader, breakup_chunk

    data, topics, found, at = file.read_bytes(), {}, [], 0
    with file.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if not isinstance(record, Chunk):
                continue
            at = data.index(struct.pack("<QQQI", record.message_start_time, record.message_end_time,
                                        record.uncompressed_size, record.uncompressed_crc), at)  # fmt: skip
            counts = {}
            for inner in breakup_chunk(record):
                if isinstance(inner, Channel):
                    topics[inner.id] = inner.topic
                elif isinstance(inner, Message):
                    counts[topics[inner.channel_id]] = counts.get(topics[inner.channel_id], 0) + 1
            found.append((at, counts, record.message_start_time, record.message_end_time))
    return found


def test_checksums_and_statistics_of_ours_hold_for_the_mcap_package(flight):
    from mcap.reader import make_reader
    from mcap.records import Chunk, DataEnd
    from mcap.stream_reader import StreamReader

    file = flight / "flight.mcap"
    with file.open("rb") as stream:
        statistics = make_reader(stream, validate_crcs=True).get_summary().statistics
        assert sorted(statistics.channel_message_counts.values()) == [12, 30, 60]
        assert statistics.message_count == 102
        stream.seek(0)
        records = list(StreamReader(stream, emit_chunks=True, validate_crcs=True).records)
    checksums = [r.uncompressed_crc for r in records if isinstance(r, Chunk)]
    assert len(checksums) > 3 and all(checksums)
    assert next(r.data_section_crc for r in records if isinstance(r, DataEnd)) != 0
    assert struct.unpack("<I", file.read_bytes()[-12:-8])[0] != 0  # of the summary


def test_a_damaged_chunk_says_what_is_missing_and_from_when_to_when(flight):
    whole = read_raw(flight)
    file = flight / "flight.mcap"
    start, lost, first, last = chunks(file)[2]
    flip(file, 8 * (start + 200))
    raw = read_raw(flight)
    assert whole.counts() - raw.counts() == lost == raw.missing
    place, counts = raw.notes
    what, times = place.split(": messages may be missing from ")
    assert what == f"the chunk at byte {start} of the file has a wrong checksum"
    begin, end = (float(word) for word in times.replace(" s", "").split(" to "))
    assert begin <= (first - START) / 1e9 and (last - START) / 1e9 <= end <= begin + 0.3
    assert counts.startswith(f"{sum(lost.values())} of the 102 messages that its summary counts could not be read: ")
    assert f"/imu/data {lost['/imu/data']}" in counts
    assert is_subsequence(raw, whole)


def is_subsequence(raw, whole):
    """Whether the messages of a recording are those of another, in order, with gaps."""
    messages = iter((whole.log_time[i], whole[i]) for i in range(len(whole)))
    return all((raw.log_time[i], raw[i]) in messages for i in range(len(raw)))


@pytest.mark.parametrize("kind", [0x86, 0x16, 0x07, 0x04, 0x02])
def test_a_chunk_of_another_kind_is_not_dropped_in_silence(flight, tmp_path, kind):
    """Unknown kinds must be skipped, which is said; what is behind a kind that cannot stand there is found again."""
    for writer in ("ours", "chunks zstd", "chunks lz4 without checksums"):
        path = tmp_path / f"{writer} {kind}"
        WRITERS[writer](flight, path)
        file = next(path.glob("*.mcap"))
        before = read_raw(path)
        start, lost, *_ = chunks(file)[2]
        data = bytearray(file.read_bytes())
        data[start - mcap_records.RECORD_HEADER] = kind
        file.write_bytes(data)
        raw = read_raw(path)
        assert set(raw.notes) - set(before.notes)
        assert before.counts() - raw.counts() in ({}, lost)
        assert any("could not be read" in note for note in raw.notes) == (raw.counts() != before.counts())


@pytest.mark.parametrize(
    ("offset", "content", "reason"),
    [
        (32, b"zst4", "has the unknown compression 'zst4'"),
        (16, struct.pack("<Q", 2**62), "announces more than a file of this size can hold"),
        (16, struct.pack("<Q", 6_400_000_000), "announces more than a file of this size can hold"),
        (16, struct.pack("<Q", 2**27), "does not have the length that it announces"),
        (16, struct.pack("<Q", 17), "does not have the length that it announces"),
        (44, b"\xff" * 4, "cannot be decompressed"),
    ],
)
def test_chunks_that_cannot_be_decompressed_are_named(flight, tmp_path, offset, content, reason):
    write_with_mcap(flight, tmp_path / "bag", "ZSTD")
    file = tmp_path / "bag" / "file.mcap"
    start, lost, *_ = chunks(file)[1]
    data = bytearray(file.read_bytes())
    data[start + offset : start + offset + len(content)] = content
    file.write_bytes(data)
    raw = read_raw(tmp_path / "bag")
    assert any(note.startswith(f"the chunk at byte {start} of the file {reason}: ") for note in raw.notes), raw.notes
    assert raw.missing == lost


def test_bytes_behind_the_records_of_a_chunk_are_said(flight, tmp_path):
    """The records must fill their chunk; here its checksum is right, but the last length is not."""
    from zlib import crc32

    file = flight / "flight.mcap"
    data = bytearray(file.read_bytes())
    start, _, _, _ = chunks(file)[0]
    size = struct.unpack_from("<Q", data, start + 16)[0]
    last = max(at for at in message_headers(file) if at < start + 40 + size)
    data[last + 1] -= 1
    struct.pack_into("<I", data, start + 24, crc32(data[start + 40 : start + 40 + size]))
    (tmp_path / "changed.mcap").write_bytes(data)
    raw = read_raw(tmp_path / "changed.mcap")
    assert any(note.startswith("1 bytes at byte ") and "are not records" in note for note in raw.notes), raw.notes


def test_recordings_without_checksums_say_so_once(flight, tmp_path):
    for writer in ("MCAP of rosbags", "sqlite3", "no chunks"):
        path = tmp_path / writer
        WRITERS[writer](flight, path)
        assert read_raw(path).notes.count(losses.NO_CHECKSUMS) == 1
    for writer in ("ours", "chunks zstd"):
        path = tmp_path / f"{writer} with"
        WRITERS[writer](flight, path)
        assert losses.NO_CHECKSUMS not in read_raw(path).notes


def test_a_damaged_end_loses_no_message(flight):
    whole = read_raw(flight)
    file = flight / "flight.mcap"
    size = file.stat().st_size
    for at in (size - 1, size - 10, size - 14, size - 30, size - 36, size - 60):
        flip(file, 8 * at)
        raw = read_raw(flight)
        assert raw.counts() == whole.counts() and is_subsequence(raw, whole)
        assert raw.notes == (mcap_file.DAMAGED_END,)
        flip(file, 8 * at)


def test_a_recorder_that_died_while_it_compressed(flight, tmp_path):
    write_with_mcap(flight, tmp_path / "bag", "ZSTD")
    file = tmp_path / "bag" / "file.mcap"
    whole = read_raw(tmp_path / "bag")
    start = chunks(file)[3][0]
    file.write_bytes(file.read_bytes()[: start + 300])
    raw = read_raw(tmp_path / "bag")
    assert raw.notes == ("metadata.yaml is missing: read without it", losses.NOT_FINISHED)
    assert 0 < len(raw) < len(whole) and is_subsequence(raw, whole)


def test_damage_in_a_recording_that_breaks_off_is_said_too(flight, tmp_path):
    write_with_mcap(flight, tmp_path / "bag", "ZSTD")
    file = tmp_path / "bag" / "file.mcap"
    found = chunks(file)
    data = bytearray(file.read_bytes()[: found[4][0] + 100])
    data[found[2][0] - 8 + 2] ^= 0x10  # the length of the chunk
    file.write_bytes(data)
    notes = read_raw(tmp_path / "bag").notes
    assert losses.NOT_FINISHED in notes
    assert any("are not records: messages may be missing from" in note for note in notes)


# -- folders ------------------------------------------------------------------------------------------------


def change_metadata(path, change):
    file = path / "metadata.yaml"
    content = yaml.safe_load(file.read_text())
    change(content["rosbag2_bagfile_information"])
    file.write_text(yaml.safe_dump(content))


def test_numbers_of_metadata_that_are_not_those_of_the_files_are_said(flight):
    def more(information):
        information["topics_with_message_count"][0]["message_count"] += 8
        information["message_count"] += 8

    change_metadata(flight, more)
    assert read_raw(flight).notes == ("8 of the 110 messages that metadata.yaml counts could not be read: /imu/data 8",)
    change_metadata(flight, lambda information: information.update(message_count=3))
    assert "metadata.yaml contradicts itself: it counts 3 messages in all, 110 by topic" in read_raw(flight).notes


@pytest.mark.parametrize("content", ["{: not yaml", "a: 1", "", "rosbag2_bagfile_information: 3"])
def test_damaged_metadata_are_not_needed(flight, content):
    whole = read_raw(flight)
    (flight / "metadata.yaml").write_text(content)
    raw = read_raw(flight)
    assert raw.notes == ("metadata.yaml is damaged: read without it",)
    assert len(raw) == len(whole) and is_subsequence(raw, whole)


def split(tmp_path, folder):
    """Three recordings of 1 s as one in three files."""
    folder.mkdir()
    parts = [write_flight(tmp_path / f"part{i}", n=20 * (i + 1)) for i in range(3)]
    information = None
    for i, part in enumerate(parts):
        shutil.copy(part / f"part{i}.mcap", folder / f"split_{i}.mcap")
        content = yaml.safe_load((part / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        if information is None:
            information = {**content, "relative_file_paths": []}
        else:
            pairs = zip(information["topics_with_message_count"], content["topics_with_message_count"], strict=True)
            for one, other in pairs:
                one["message_count"] += other["message_count"]
            information["message_count"] += content["message_count"]
        information["relative_file_paths"].append(f"split_{i}.mcap")
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
    return folder


def test_a_split_recording_with_a_missing_or_damaged_file(tmp_path):
    folder = split(tmp_path, tmp_path / "split")
    whole = read_raw(folder)
    assert whole.notes == () and whole.counts() == {"/imu/data": 120, "/gps/vel": 24, "/air_data": 60}
    middle = folder / "split_1.mcap"
    content = middle.read_bytes()
    middle.write_bytes(b"nothing" + content)
    damaged = read_raw(folder)
    middle.unlink()
    missing = read_raw(folder)
    topics = "/imu/data 40, /air_data 20, /gps/vel 8"
    counts = f"68 of the 204 messages that metadata.yaml counts could not be read: {topics}"
    assert missing.notes == ("its file split_1.mcap is missing", counts)
    assert damaged.notes == (f"{middle} is not an MCAP file: it is empty, damaged or something else", counts)
    assert len(missing) == len(damaged) == 204 - 68
    for part in folder.glob("*.mcap"):
        part.unlink()
    with pytest.raises(InputError, match=r"split_0\.mcap is missing; its file split_1\.mcap is missing"):
        read_raw(folder)


# -- sqlite3 and compressed files ---------------------------------------------------------------------------


def test_sqlite3_reads_around_pages_that_are_damaged(tmp_path):
    write_with_rosbags(write_flight(tmp_path / "flight", n=600), tmp_path / "bag", "SQLITE3", "NONE")
    whole = read_raw(tmp_path / "bag")
    file = tmp_path / "bag" / "bag.db3"
    data = bytearray(file.read_bytes())
    page = int.from_bytes(data[16:18], "big")
    at = data.index(whole[510]) // page * page
    data[at : at + page] = bytes(page)
    file.write_bytes(data)
    raw = read_raw(tmp_path / "bag")
    assert is_subsequence(raw, whole) and 0 < len(whole) - len(raw) < 40
    place, damage, counts, _ = raw.notes
    assert place.startswith("pages of the database cannot be read: messages may be missing from ")
    begin, end = (float(word) for word in place.split("missing from ")[1].replace(" s", "").split(" to "))
    assert begin - 0.2 <= (whole.log_time[510] - START) / 1e9 <= end + 0.2 and end - begin < 0.5
    assert damage.startswith("SQLite finds the recording damaged (")
    assert counts.startswith(f"{len(whole) - len(raw)} of the {len(whole)} messages that its table of metadata counts")


def test_a_file_of_sqlite_says_what_it_lacks_and_that_it_has_no_checksums(tmp_path):
    """The file alone, without metadata.yaml: what was deleted is missing from its own count, and from the numbers."""
    write_with_rosbags(write_flight(tmp_path / "flight", n=60), tmp_path / "bag", "SQLITE3", "NONE")
    file = tmp_path / "bag" / "bag.db3"
    whole = read_raw(file)
    assert whole.notes == (losses.NO_CHECKSUMS,)
    with sqlite3.connect(file) as database:
        database.execute("DELETE FROM messages WHERE id BETWEEN 20 AND 22")
    database.close()
    counts, gaps, checksums = read_raw(file).notes
    assert counts.startswith(f"3 of the {len(whole)} messages that its table of metadata counts could not be read: ")
    assert gaps == "the numbers of its messages are not consecutive: some were deleted, or the file is damaged"
    assert checksums == losses.NO_CHECKSUMS
    with sqlite3.connect(file) as database:
        database.execute("UPDATE metadata SET metadata = ?", ["[" * 100_000])
    database.close()
    assert read_raw(file).notes == (gaps, checksums)


def test_the_journal_of_a_recorder_that_died_is_applied_and_not_touched(flight, tmp_path):
    """What is in the write-ahead log only belongs to the recording too."""
    write_with_rosbags(flight, tmp_path / "bag", "SQLITE3", "NONE")
    whole = read_raw(tmp_path / "bag")
    file = tmp_path / "bag" / "bag.db3"
    (tmp_path / "bag" / "metadata.yaml").unlink()
    insert = "INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, timestamp + 1, data FROM messages"
    died = f"""
import os, sqlite3, sys
database = sqlite3.connect(sys.argv[1])
database.execute("PRAGMA journal_mode=WAL")
database.execute("{insert}")
database.commit()
os._exit(9)
"""
    assert subprocess.run([sys.executable, "-c", died, file], check=False).returncode == 9
    files = {path.name: path.read_bytes() for path in file.parent.iterdir() if not path.name.endswith("-shm")}
    assert "bag.db3-wal" in files
    raw = read_raw(file.parent)
    assert len(raw) == 2 * len(whole)
    assert losses.NOT_FINISHED in raw.notes
    after = {path.name: path.read_bytes() for path in file.parent.iterdir() if not path.name.endswith("-shm")}
    assert after == files


@pytest.mark.parametrize("plugin", ["MCAP", "SQLITE3"])
def test_a_compressed_file_that_is_cut_is_read_up_to_there(tmp_path, plugin):
    write_with_rosbags(write_flight(tmp_path / "flight", n=6000), tmp_path / "bag", plugin, "FILE")
    whole = read_raw(tmp_path / "bag")
    file = next((tmp_path / "bag").glob("*.zstd"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 9 // 10])
    raw = read_raw(tmp_path / "bag")
    assert any(note == f"{file.name} cannot be decompressed to its end: read up to there" for note in raw.notes)
    assert len(whole) // 2 < len(raw) < len(whole) and is_subsequence(raw, whole)
    lost = whole.counts() - raw.counts()
    assert any(f"/imu/data {lost['/imu/data']}, /air_data {lost['/air_data']}, " in note for note in raw.notes)


def test_a_database_without_its_tables_is_refused(flight, tmp_path):
    file = tmp_path / "other.db3"
    with sqlite3.connect(file) as database:
        database.execute("CREATE TABLE others(id)")
    with pytest.raises(
        InputError, match=r"cannot read the recording .*other\.db3: it is a database, but holds no topics"
    ):
        read_raw(file)


def test_an_empty_database_is_called_empty(tmp_path):
    (tmp_path / "nothing.db3").touch()
    with pytest.raises(InputError, match=r"nothing\.db3: the file is empty: the recorder wrote nothing into it$"):
        read_raw(tmp_path / "nothing.db3")


@pytest.mark.parametrize("content", [b"[" * 200_000, b"- " * 100_000, b"{a: " * 100_000])
def test_metadata_that_are_nested_without_end_do_not_end_the_program(flight, tmp_path, content):
    """libyaml composes them until the stack is full, and the process is gone."""
    write_with_mcap(flight, tmp_path / "bag", "ZSTD")
    (tmp_path / "bag" / "metadata.yaml").write_bytes(content)
    assert "metadata.yaml is damaged: read without it" in read_raw(tmp_path / "bag").notes


def test_a_file_that_holds_more_than_its_size_can_is_refused(tmp_path, monkeypatch):
    from aircraft_sysid_ros import archives

    monkeypatch.setattr(archives, "_ALWAYS", 1 << 20)
    content = zstandard.ZstdCompressor(level=19).compress(bytes(64 << 20))
    (tmp_path / "bag.mcap.zstd").write_bytes(content)
    with pytest.raises(InputError, match="holds more than a file of its size can: it is not a recording"):
        read_raw(tmp_path / "bag.mcap.zstd")


def test_of_the_notes_of_a_recording_some_say_that_part_of_it_is_lost():
    from aircraft_sysid_ros.recordings import losses

    times = np.arange(10) * 10**9
    (lost,) = losses.damage_notes([losses.Damage("a chunk is broken", 4)], times)
    assert losses.losses([losses.NO_CHECKSUMS, losses.NOT_FINISHED, lost]) == [losses.NOT_FINISHED, lost]


@pytest.mark.parametrize(
    ("content", "in_folder", "said"),
    [
        (b"", False, "{file} is not an MCAP file: it is empty, damaged or something else"),
        (b"", True, "{file} is not an MCAP file: it is empty, damaged or something else, and metadata.yaml is missing"),
        (
            mcap_file.MAGIC, False,
            "the recording {file} holds no messages that can be read: "
            "the recording breaks off (the recorder did not finish it)",
        ),
    ],
)  # fmt: skip
def test_of_a_file_without_messages_one_sentence_says_why(tmp_path, content, in_folder, said):
    """That metadata.yaml is missing followed behind a semicolon, "read up to there" behind a colon, and import began
    with the name of the file twice."""
    (tmp_path / "bag").mkdir()
    file = tmp_path / "bag" / "a.mcap"
    file.write_bytes(content)
    path = file.parent if in_folder else file
    for read in (read_raw, lambda path: import_log(path, tmp_path / "out")):
        with pytest.raises(InputError) as refused:
            read(path)
        assert str(refused.value) == said.format(file=file)
