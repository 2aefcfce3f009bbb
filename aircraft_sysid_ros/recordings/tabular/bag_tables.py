"""The topics of a bag as tables: whatever its messages are called, a MAP says which of their numbers are signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import losses
from aircraft_sysid_ros.recordings.message_types import channel_types
from aircraft_sysid_ros.recordings.raw_messages import Channel, Integers, RawMessages
from aircraft_sysid_ros.recordings.ros1_bag import ENDING, LARGE
from aircraft_sysid_ros.recordings.storage import METADATA, read_raw
from aircraft_sysid_ros.recordings.tables import Table as Messages
from aircraft_sysid_ros.recordings.tables import table_of
from aircraft_sysid_ros.recordings.tabular.table import ArrayTable, Table
from aircraft_sysid_ros.stamps import NANOSECONDS

_ENDINGS = (".mcap", ".db3")
#: Column with the time [ns] of each message.
STAMP = "stamp"
_MOST_COMPONENTS = 64
_HEADER = "header."
#: Stamps that differ by less [ns] from the recorder's are of one clock; and so many messages in a row may be late.
_ONE_CLOCK = 120 * NANOSECONDS
_MOST_LATE = 10
#: Units of the fields of common types, which their definitions state.
_UNITS = {
    "sensor_msgs/msg/Imu": {"linear_acceleration": "m/s^2", "angular_velocity": "rad/s"},
    "sensor_msgs/msg/NavSatFix": {"latitude": "deg", "longitude": "deg", "altitude": "m"},
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
}


def is_bag(path: Path) -> bool:
    """Whether a folder is a bag for sure, or a file is called as one is."""
    return (path / METADATA).exists() if path.is_dir() else path.suffix in (*_ENDINGS, ENDING)


def holds_bag(folder: Path) -> bool:
    """Whether files of a bag are in a folder, which may hold others beside them."""
    return any(file.suffix in _ENDINGS for file in folder.iterdir())


@dataclass(frozen=True)
class BagTable(ArrayTable):
    """The messages of a topic, and what is wrong with them and with their bag."""

    lost: tuple[str, ...] = ()
    of_bag: tuple[str, ...] = ()

    @property
    def said(self) -> list[str]:
        """See Table."""
        return list(self.lost)


def bag_tables(path: Path, name: str) -> tuple[str, list[Table]]:
    """A table for every topic whose messages hold numbers, called as it is; raises InputError where there is none."""
    raw = _with_one_channel_each(read_raw(path))
    topics: list[_Topic] = []
    notes = list(raw.notes)
    for key, channel in raw.channels.items():
        if not len(raw.rows(key)) or channel.type in LARGE:
            continue
        if channel.type not in channel_types(channel).fielddefs:
            notes.append(f"{channel.topic} is left out: nothing says what {channel.type} holds")
            continue
        messages = table_of(raw, key)
        columns, units = _columns(channel.topic.lstrip("/"), channel.type, messages)
        if columns:
            is_twice = any(topic.name == channel.topic.lstrip("/") for topic in topics)
            title = channel.topic.lstrip("/") + (f" of {channel.type}" if is_twice else "")
            topics.append(_Topic(title, columns, units, messages))
    if not topics:
        raise InputError(f"{name} has no topic whose messages hold numbers: it holds {raw.topic_names()[:300]}")
    shifts = _shifts([topic.messages for topic in topics])
    return "bag", [_table(topic, shift, tuple(notes)) for topic, shift in zip(topics, shifts, strict=True)]


def _with_one_channel_each(raw: RawMessages) -> RawMessages:
    """The same messages, of which those that two publishers wrote alike are of one channel."""
    first: dict[Channel, int] = {}
    number = np.zeros(max(raw.channels, default=0) + 1, dtype=np.int64)
    for key, channel in raw.channels.items():
        number[key] = first.setdefault(channel, key)
    return replace(raw, channel=number[raw.channel], channels={key: channel for channel, key in first.items()})


class _Topic(NamedTuple):
    name: str
    columns: dict[str, npt.NDArray[np.generic]]
    units: dict[str, str]
    messages: Messages


def _columns(
    topic: str, type_name: str, messages: Messages
) -> tuple[dict[str, npt.NDArray[np.generic]], dict[str, str]]:
    """A column for each number of the messages, and units; one that is alone is called as its topic is."""
    said = _UNITS.get(type_name, {})
    columns: dict[str, npt.NDArray[np.generic]] = {}
    units: dict[str, str] = {}
    for field, values in messages.fields.items():
        if field.startswith(_HEADER) or "covariance" in field or values.dtype.kind not in "fiub":
            continue
        parts = _components(field, values)
        columns |= parts
        units |= dict.fromkeys(parts, said[field]) if field in said else {}
    own = [name for name in columns if name not in ("variance", "layout.data_offset")]
    if len(own) != 1:
        return columns, units
    unit = units.get(own[0])
    return {topic: columns[own[0]]}, {topic: unit} if unit else {}


def _shifts(topics: Sequence[Messages]) -> list[int]:
    """By how much [ns] the stamps of each are moved, so that all count from the same time.

    Where some count from the start of a sensor or of a simulation and others from 1970, or have no header, they are
    set beside the times of the recorder by the least delay, the same for all that count alike.
    """
    delays = [(each.log_time - each.stamp)[each.stamp != 0] for each in topics]
    usual = [int(np.median(delay)) if len(delay) else 0 for delay in delays]
    order = np.argsort(usual, kind="stable")
    clock = np.empty(len(order), dtype=np.int64)
    clock[order] = np.concatenate([[0], np.cumsum(np.diff(np.array(usual)[order]) > _ONE_CLOCK)])
    if not clock.any():
        return [0] * len(topics)
    least = np.zeros(len(topics), dtype=np.int64)
    for k in np.unique(clock):
        alike = [delay.min() for delay, of in zip(delays, clock, strict=True) if of == k and len(delay)]
        least[clock == k] = min(alike, default=0)
    return [int(by) if abs(by) > _ONE_CLOCK and len(delay) else 0 for by, delay in zip(least, delays, strict=True)]


def _table(topic: _Topic, shift: int, of_bag: tuple[str, ...]) -> BagTable:
    messages, lost = topic.messages, losses.undecoded_notes(topic.messages.skipped, "/" + topic.name)
    rows = np.flatnonzero(messages.stamp)
    if not len(rows):  # nobody has filled in the header
        rows, times = np.arange(len(messages.stamp)), messages.log_time
    else:
        times = messages.stamp[rows] + shift
        if left := len(messages.stamp) - len(rows):
            lost.append(f"{left} messages have no stamp, as others do, and are left out")
    if shift:
        lost.append(
            "its stamps count from another time than those of other topics, and are moved by "
            f"{shift / NANOSECONDS:.3f} s, which is the least delay to the recorder"
        )
    behind = times < np.maximum.accumulate(times)
    if behind.any() and _are_late(times, behind):
        order = np.argsort(times, kind="stable")
        rows, times = rows[order], times[order]
        lost.append(f"{int(behind.sum())} messages came late, and stand where their stamps say")
    columns = {**{name: values[rows] for name, values in topic.columns.items()}, STAMP: times}
    units, arrays = {**topic.units, STAMP: "ns"}, tuple(columns.values())
    return BagTable(topic.name, tuple(columns), units, arrays=arrays, time=STAMP, lost=tuple(lost), of_bag=of_bag)


def _are_late(times: Integers, behind: npt.NDArray[np.bool_]) -> bool:
    """Whether times (n,) that are behind others are those of a few late messages, and of no clock that was set back."""
    steps = np.diff(np.concatenate([[0], behind.astype(np.int64), [0]]))
    longest = int((np.flatnonzero(steps < 0) - np.flatnonzero(steps > 0)).max())
    return longest <= _MOST_LATE and int((np.maximum.accumulate(times) - times).max()) < NANOSECONDS


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
