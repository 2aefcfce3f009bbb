"""The topics of a bag as tables: whatever its messages are called, a MAP says which of their numbers are signals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.message_types import channel_types
from aircraft_sysid_ros.recordings.ros1_bag import ENDING
from aircraft_sysid_ros.recordings.storage import METADATA, read_raw
from aircraft_sysid_ros.recordings.tables import Table as Messages
from aircraft_sysid_ros.recordings.tables import table_of
from aircraft_sysid_ros.recordings.tabular.table import ArrayTable, Table

_ENDINGS = (".mcap", ".db3")
#: Column with the time [ns] of each message.
STAMP = "stamp"
_MOST_COMPONENTS = 64
_HEADER = "header."
#: Units of the fields of common types, which their definitions state.
_UNITS = {
    "sensor_msgs/msg/Imu": {"linear_acceleration": "m/s^2", "angular_velocity": "rad/s"},
    "sensor_msgs/msg/NavSatFix": {"latitude": "deg", "longitude": "deg", "altitude": "m"},
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
}


def is_bag(path: Path) -> bool:
    """Whether a folder or a file is called as a bag is."""
    if path.is_dir():
        return (path / METADATA).exists() or any(file.suffix in _ENDINGS for file in path.iterdir())
    return path.suffix in (*_ENDINGS, ENDING)


def bag_tables(path: Path, name: str) -> tuple[str, list[Table]]:
    """A table for every topic whose messages hold numbers, called as it is; raises InputError where there is none."""
    raw = read_raw(path)
    tables: list[Table] = []
    for key, channel in raw.channels.items():
        if not len(raw.rows(key)) or channel.type not in channel_types(channel).fielddefs:
            continue
        messages = table_of(raw, key)
        if len(messages.rows):
            tables.append(_table(channel.topic.lstrip("/"), channel.type, messages))
    tables = [table for table in tables if len(table.columns) > 1]
    if not tables:
        raise InputError(f"{name} has no topic whose messages hold numbers: it holds {raw.topic_names()[:300]}")
    return "bag", tables


def _table(topic: str, type_name: str, messages: Messages) -> ArrayTable:
    """A column for each number of the messages; one that is alone is called as its topic is."""
    said = _UNITS.get(type_name, {})
    columns: dict[str, npt.NDArray[np.generic]] = {}
    units = {STAMP: "ns"}
    for field, values in messages.fields.items():
        if field.startswith(_HEADER) or "covariance" in field or values.dtype.kind not in "fiub":
            continue
        parts = _components(field, values)
        columns |= parts
        units |= dict.fromkeys(parts, said[field]) if field in said else {}
    own = [name for name in columns if name not in ("variance", "layout.data_offset")]
    if len(own) == 1:
        columns, unit = {topic: columns[own[0]]}, units.get(own[0])
        units = {STAMP: "ns", topic: unit} if unit else {STAMP: "ns"}
    times = messages.stamp if messages.stamp.any() else messages.log_time  # nobody has filled in the header
    return ArrayTable(topic, (STAMP, *columns), units, arrays=(times, *columns.values()))


def _components(field: str, values: npt.NDArray[np.generic]) -> dict[str, npt.NDArray[np.generic]]:
    """The columns of a field (n,) or (n, k), by name."""
    if values.ndim == 1:
        return {field: values}
    if values.ndim != 2 or values.shape[1] > _MOST_COMPONENTS:
        return {}
    count = values.shape[1]
    if count == 3 or (count == 4 and field.endswith("orientation")):
        return {f"{field}.{axis}": values[:, i] for i, axis in enumerate("xyzw"[:count])}
    return {f"{field}[{i}]": values[:, i] for i in range(count)}
