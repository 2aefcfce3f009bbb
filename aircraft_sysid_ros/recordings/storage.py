"""Which kind of recording is it? rosbag2 folders and bare files, MCAP and sqlite3, whole or damaged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.mcap_file import read_mcap
from aircraft_sysid_ros.recordings.raw_messages import Channel, Integers, RawMessages


def read_raw(path: str | Path) -> RawMessages:
    """Messages of a rosbag2 folder (MCAP or sqlite3) or of one .mcap or .db3 file.

    Raises InputError, one sentence, for what is missing, empty or not a recording.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"there is no recording {path}")
    try:
        messages = _read(path)
    except OSError as error:
        raise InputError(f"cannot read the recording {path}: {error.strerror or error}") from None
    if len(messages) == 0:
        reason = "; ".join(messages.notes)
        raise InputError(f"the recording {path} holds no messages" + (f" ({reason})" if reason else ""))
    return messages


def _read(path: Path) -> RawMessages:
    if path.is_file():
        if path.suffix == ".mcap":
            return read_mcap(path)
        if path.suffix == ".db3":
            return _read_with_rosbags(path)
        raise InputError(f"{path} is not a recording: give a rosbag2 folder, an .mcap or a .db3 file")
    if not (path / "metadata.yaml").exists():
        return _read_without_metadata(path)
    files = _plain_mcap_files(path)
    return _join([read_mcap(file) for file in files]) if files else _read_with_rosbags(path)


def _plain_mcap_files(folder: Path) -> list[Path]:
    """The files of a rosbag2 folder when they are MCAP that is not compressed once more by rosbag2."""
    import yaml

    metadata = folder / "metadata.yaml"
    try:
        content = yaml.load(
            metadata.read_text(encoding="utf8"), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        )
        information = content["rosbag2_bagfile_information"]
        names = [Path(name).name for name in information["relative_file_paths"]]
        plain = information["storage_identifier"] == "mcap" and not information.get("compression_format")
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError):
        raise InputError(f"{metadata} is damaged: delete it to read the files beside it without it") from None
    if not plain:
        return []
    missing = [name for name in names if not (folder / name).exists()]
    if missing or not names:
        raise InputError(
            f"the recording {folder} is not complete: its file {missing[0] if missing else ''} is missing"
        )
    return [folder / name for name in names]


def _read_without_metadata(folder: Path) -> RawMessages:
    """rosbag2 writes metadata.yaml last: without it, the recorder died."""
    files = sorted(folder.glob("*.mcap"))
    if files:
        return _join([read_mcap(file) for file in files], "metadata.yaml is missing: read without it")
    files = sorted(folder.glob("*.db3"))
    if files:
        return _join(
            [_read_with_rosbags(file) for file in files], "metadata.yaml is missing: read without it"
        )
    raise InputError(f"{folder} is not a recording: it has no metadata.yaml and no .mcap or .db3 file")


def _read_with_rosbags(path: Path) -> RawMessages:
    """sqlite3, and whatever rosbag2 compressed, by way of rosbags."""
    from rosbags.rosbag2 import Reader

    channels: dict[int, Channel] = {}
    table: list[tuple[int, int]] = []
    parts: list[bytes] = []
    try:
        with Reader(path) as reader:
            channels = {c.id: _channel(c) for c in reader.connections}
            for connection, log_time, content in reader.messages():
                table.append((connection.id, log_time))
                parts.append(bytes(content))
    except OSError:
        raise
    except Exception as error:  # rosbags lets errors of yaml, sqlite3, zstd and struct through
        raise InputError(f"cannot read the recording {path}: {' '.join(str(error).split())}") from None
    return _raw_messages(channels, table, parts)


def _raw_messages(
    channels: dict[int, Channel], table: list[tuple[int, int]], parts: list[bytes]
) -> RawMessages:
    length = np.array([len(part) for part in parts], dtype=np.int64)
    channel, log_time = np.array(table, dtype=np.int64).reshape(-1, 2).T
    order = np.argsort(log_time, kind="stable")
    start = np.cumsum(length) - length
    data = np.frombuffer(b"".join(parts), np.uint8)
    return RawMessages(data, channel[order], log_time[order], start[order], length[order], channels)


def _channel(connection: Any) -> Channel:
    encodings = {"MSG": "ros2msg", "IDL": "ros2idl"}
    encoding = encodings.get(connection.msgdef.format.name, "")
    return Channel(connection.topic, connection.msgtype, encoding, connection.msgdef.data if encoding else "")


def _join(files: list[RawMessages], *notes: str) -> RawMessages:
    """The files of one recording as one: channels numbered anew; ties of log time in the order of files."""
    if len(files) == 1:
        return _with_notes(files[0], notes)
    channels: dict[int, Channel] = {}
    columns: list[tuple[Integers, Integers, Integers, Integers]] = []
    size = 0
    for file in files:
        shift = max(channels, default=-1) + 1
        channels.update({shift + key: channel for key, channel in file.channels.items()})
        columns.append((file.channel + shift, file.log_time, file.start + size, file.length))
        size += len(file.data)
    channel, log_time, start, length = (np.concatenate(column) for column in zip(*columns, strict=True))
    order = np.argsort(log_time, kind="stable")
    data = np.concatenate([file.data for file in files])
    joined = RawMessages(data, channel[order], log_time[order], start[order], length[order], channels)
    return _with_notes(joined, (*notes, *dict.fromkeys(note for file in files for note in file.notes)))


def _with_notes(messages: RawMessages, notes: tuple[str, ...]) -> RawMessages:
    from dataclasses import replace

    return replace(messages, notes=(*notes, *messages.notes))
