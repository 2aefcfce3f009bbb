"""A bag of ROS 1 (.bag) as the messages of ROS 2 that it holds, by the rosbags library."""

from __future__ import annotations

import contextlib
import io
import tempfile
from pathlib import Path

from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.recordings.mcap_file import read_mcap
from aircraft_sysid_ros.recordings.raw_messages import RawMessages

ENDING = ".bag"
#: Types of messages that nothing here reads, and that make up most of a bag with cameras.
LARGE = (
    "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/PointCloud", "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/CameraInfo",
    "theora_image_transport/msg/Packet",
)  # fmt: skip


def read_ros1(path: Path) -> RawMessages:
    """Its messages, without pictures and clouds of points. Raises InputError for what is no bag of ROS 1."""
    from rosbags.convert.converter import ConverterError, convert

    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "bag"
        said = io.StringIO()
        try:
            with contextlib.redirect_stdout(said):
                convert([path], target, "mcap", 9, None, "file", None, None, [], [], list(LARGE), [])
        except (ConverterError, AssertionError) as error:
            why = echo(str(error).partition(": ")[2].replace(str(path), path.name).rstrip("."))
            raise InputError(f"{path} is not a readable bag of ROS 1 ({why}): try `rosbag reindex` on it") from None
        files = sorted(target.glob("*.mcap"))
        if not files:
            raise InputError(f"the recording {path} holds no messages")
        return read_mcap(files[0])
