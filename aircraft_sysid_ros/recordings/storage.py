"""Which kind of recording is it? rosbag2 folders and bare files, MCAP and sqlite3, whole or damaged; bags of ROS 1."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from aircraft_sysid_ros.archives import allowed_size
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import losses
from aircraft_sysid_ros.recordings.decompression import ZSTD_MAGIC, Undecompressible, decompress_prefix
from aircraft_sysid_ros.recordings.mcap_file import read_mcap, read_mcap_data
from aircraft_sysid_ros.recordings.message_types import as_written
from aircraft_sysid_ros.recordings.raw_messages import Channel, Integers, RawMessages
from aircraft_sysid_ros.recordings.ros1_bag import ENDING, read_ros1
from aircraft_sysid_ros.recordings.sqlite_file import counts_by_topic, read_sqlite
from aircraft_sysid_ros.yaml_file import parse_yaml

METADATA = "metadata.yaml"
_READERS = {".mcap": read_mcap, ".db3": read_sqlite}
_COMPRESSED = ".zstd"
_MOST_REASONS = 3  # why nothing can be read
_LOOKED_AT = 5  # messages that show their layout, of a topic whose type is not defined


def read_raw(path: str | Path) -> RawMessages:
    """Messages of a rosbag2 folder (MCAP or sqlite3) or of one .mcap, .db3 or .bag file, as far as can be.

    The notes say what could not. Raises InputError, one sentence, for what is missing, empty or not a recording, and
    where nothing of it can be read.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"there is no recording {path}")
    try:
        messages = _read_folder(path) if path.is_dir() else _read_file(path)
    except OSError as error:
        raise InputError(f"cannot read the recording {path}: {error.strerror or error}") from None
    if len(messages) == 0:
        reasons = [note.partition(": read ")[0] for note in messages.notes if note != losses.NO_CHECKSUMS]
        why = f" that can be read: {'; '.join(reasons[:_MOST_REASONS])}" if reasons else ""
        raise InputError(f"the recording {path} holds no messages{why}")
    notes = tuple(sorted(messages.notes, key=losses.NO_CHECKSUMS.__eq__))
    return replace(messages, channels=_defined(messages), notes=notes)


def _defined(messages: RawMessages) -> dict[int, Channel]:
    """The channels, with definitions of an older ROS where the recording has none and its messages are of that."""
    return {
        key: channel
        if channel.encoding
        else as_written(channel, [messages[i] for i in messages.rows(key)[:_LOOKED_AT].tolist()])
        for key, channel in messages.channels.items()
    }


def _read_file(path: Path) -> RawMessages:
    """One file, which rosbag2 may have compressed."""
    if path.suffix == ENDING:
        return read_ros1(path)
    if path.suffix in _READERS:
        return _READERS[path.suffix](path)
    inner = Path(path.stem)
    if path.suffix != _COMPRESSED or inner.suffix not in _READERS:
        raise InputError(f"{path} is not a recording: give a rosbag2 folder, an .mcap, a .db3 or a .bag file")
    compressed = path.read_bytes()
    try:
        content, is_whole = decompress_prefix(compressed, allowed_size(len(compressed)))
    except Undecompressible as error:
        raise InputError(f"{path} {error}: it is not a recording") from None
    notes = [] if is_whole else [f"{path.name} cannot be decompressed to its end: read up to there"]
    if inner.suffix == ".mcap":
        return read_mcap_data(np.frombuffer(content, np.uint8), path).with_notes(notes)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / inner
        file.write_bytes(content)
        return read_sqlite(file).with_notes(notes)


@dataclass(frozen=True)
class _Metadata:
    """What metadata.yaml says: the files, messages in all and by topic, whether each message is compressed alone."""

    files: tuple[str, ...] = ()
    count: int = 0
    counted: Counter[str] = field(default_factory=Counter)
    is_compressed: bool = False

    def notes(self, messages: RawMessages) -> list[str]:
        """How its numbers differ from the messages that were read, unless their files have said the same."""
        notes = losses.count_notes(METADATA, self.counted, messages.counts(), messages.missing)
        by_topic = self.counted.total()
        if self.count != by_topic:
            notes.append(f"{METADATA} contradicts itself: it counts {self.count} messages in all, {by_topic} by topic")
        return notes


def _read_folder(folder: Path) -> RawMessages:
    metadata, problems = _read_metadata(folder / METADATA)
    notes = [f"{problem}: read without it" for problem in problems]
    files = [folder / name for name in metadata.files]
    missing = [f"its file {file.name} is missing" for file in files if not file.exists()]
    if missing or not files:
        files = _recording_files(folder)
    if not files:
        reasons = "; ".join([*problems, *missing])
        raise InputError(f"{folder} is not a recording: {reasons}, and it holds no .mcap or .db3 file")
    parts, failures = _read_files(files)
    if not parts:
        raise InputError(", and ".join([failures[0], *problems, *missing]))
    messages = _join(parts, failures)
    if metadata.is_compressed or (len(messages) and messages[0].startswith(ZSTD_MAGIC)):
        messages = _decompressed(messages)
    return messages.with_notes([*notes, *missing], metadata.notes(messages))


def _read_metadata(path: Path) -> tuple[_Metadata, list[str]]:
    """The content, and what is wrong with it."""
    import yaml

    if not path.exists():  # rosbag2 writes it last
        return _Metadata(), [f"{path.name} is missing"]
    try:
        content = parse_yaml(path.read_bytes())
        information = content["rosbag2_bagfile_information"]
        mode = str(information.get("compression_mode") or "none").lower()
        counted = counts_by_topic(information)
        files = tuple(Path(name).name for name in information["relative_file_paths"])
        metadata = _Metadata(files, int(information["message_count"]), counted, mode == "message")
    except (yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError, OverflowError):
        metadata, mode = _Metadata(), ""
    if mode not in ("none", "file", "message"):
        return _Metadata(), [f"{path.name} is damaged"]
    return metadata, []


def _recording_files(folder: Path) -> list[Path]:
    """What is there, when nothing says what should be; a file that is there uncompressed is not read twice."""
    files = {path.name: path for path in folder.iterdir() if path.is_file()}
    plain = [path for name, path in files.items() if path.suffix in _READERS]
    others = [path for name, path in files.items() if path.suffix == _COMPRESSED and path.stem not in files]
    return sorted(plain + [path for path in others if Path(path.stem).suffix in _READERS])


def _read_files(files: Sequence[Path]) -> tuple[list[RawMessages], list[str]]:
    """Those that can be read, their notes with their names where they are many, and why the others cannot."""
    parts, failures = [], []
    for file in files:
        try:
            part = _read_file(file)
        except InputError as error:
            failures.append(str(error))
            continue
        if len(files) > 1:
            named = (note if note == losses.NO_CHECKSUMS else f"{file.name}: {note}" for note in part.notes)
            part = replace(part, notes=tuple(named))
        parts.append(part)
    return parts, failures


def _decompressed(messages: RawMessages) -> RawMessages:
    """Messages that rosbag2 compressed one by one."""
    left, places, parts = allowed_size(len(messages.data)), [], []
    for i in range(len(messages)):
        try:
            content, is_whole = decompress_prefix(messages[i], left)
        except Undecompressible:
            continue
        left -= len(content)
        if is_whole:
            places.append((int(messages.channel[i]), int(messages.log_time[i])))
            parts.append(content)
    found = RawMessages.of_parts(messages.channels, places, parts)
    notes = losses.undecoded_notes(len(messages) - len(parts), "the recording")
    return replace(found, notes=messages.notes, missing=messages.missing).with_notes(notes)


def _join(files: list[RawMessages], notes: Sequence[str]) -> RawMessages:
    """The files of one recording as one, alike channels too; ties of log time in the order of files."""
    if len(files) == 1:
        return files[0].with_notes(notes)
    numbers: dict[Channel, int] = {}
    columns: list[tuple[Integers, Integers, Integers, Integers]] = []
    missing: Counter[str] = Counter()
    size = 0
    for file in files:
        number = np.zeros(max(file.channels, default=0) + 1, np.int64)
        for key, channel in file.channels.items():
            number[key] = numbers.setdefault(channel, len(numbers))
        columns.append((number[file.channel], file.log_time, file.start + size, file.length))
        missing.update(file.missing)
        size += len(file.data)
    of_channel, log_time, start, length = (np.concatenate(column) for column in zip(*columns, strict=True))
    order = np.argsort(log_time, kind="stable")
    data = np.concatenate([file.data for file in files])
    channels = {number: channel for channel, number in numbers.items()}
    places = (of_channel[order], log_time[order], start[order], length[order])
    joined = RawMessages(data, *places, channels, missing=missing)
    return joined.with_notes((*notes, *(note for file in files for note in file.notes)))
