"""The rosbag2 writer of rosbags with the MCAP writer of mcap behind it: that one writes checksums of everything."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer

#: [bytes] A chunk with a wrong bit is lost as a whole: some seconds of flight.
_CHUNK_SIZE = 128 * 1024


class _McapStorage:
    """What the rosbag2 writer of rosbags asks of a storage."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        self.path = path / f"{path.name}.mcap"
        self._file = self.path.open("xb")
        self._writer = McapWriter(self._file, _CHUNK_SIZE, CompressionType.NONE, enable_data_crcs=True)
        self._writer.start("ros2", "aircraft_sysid_ros")
        self._schemas: dict[str, int] = {}
        self._channels: dict[int, int] = {}

    def add_msgtype(self, connection: Any) -> None:
        encoding = {"MSG": "ros2msg", "IDL": "ros2idl"}[connection.msgdef.format.name]
        definition = connection.msgdef.data.encode()
        self._schemas[connection.msgtype] = self._writer.register_schema(connection.msgtype, encoding, definition)

    def add_connection(self, connection: Any, offered_qos_profiles: str) -> None:
        self._channels[connection.id] = self._writer.register_channel(
            connection.topic,
            connection.ext.serialization_format,
            self._schemas[connection.msgtype],
            {"offered_qos_profiles": offered_qos_profiles, "topic_type_hash": connection.digest},
        )

    def write(self, connection: Any, timestamp: int, data: bytes) -> None:
        self._writer.add_message(self._channels[connection.id], timestamp, data, timestamp)

    def close(self, version: int, metadata: str) -> None:
        self._writer.add_metadata("rosbag2", {"serialized_metadata": metadata})
        self._writer.finish()  # type: ignore[no-untyped-call]  # of mcap: without a return type
        self._file.close()

    def abort(self) -> None:
        self._file.close()


class BagWriter(Writer):
    """Writes a rosbag2 folder with one MCAP file: checksums of chunks, data section and summary, and statistics."""

    STORAGE_PLUGINS = cast("Any", {StoragePlugin.MCAP: _McapStorage})

    def __init__(self, path: Path) -> None:
        super().__init__(path, version=9, storage_plugin=StoragePlugin.MCAP)
