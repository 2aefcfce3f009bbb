"""Bags of MAVROS topics and of px4_msgs, decoded by the definitions that the bag brings along."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.mavros_table import MAVROS
from aircraft_sysid_ros.mavlink.px4_listener import CONFIRMING, CONFIRMING_SPAN
from aircraft_sysid_ros.mavlink.px4_table import PX4, sample_time
from aircraft_sysid_ros.mavlink.quantities import Batch, Stamps
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.recordings.autopilot_log import LogContent, import_content
from aircraft_sysid_ros.recordings.imported_log import ImportedLog
from aircraft_sysid_ros.recordings.message_types import channel_types
from aircraft_sysid_ros.recordings.raw_messages import Channel, RawMessages
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.recordings.tables import Table as Columns
from aircraft_sysid_ros.recordings.tables import table_of
from aircraft_sysid_ros.ros_messages.conversion import TOPICS
from aircraft_sysid_ros.stamps import NANOSECONDS

_PX4 = "px4_msgs/"
_OURS = {type_name for type_name in TOPICS.values() if type_name.startswith("aircraft_sysid_msgs/")}
_FROM_AUTOPILOT = re.compile("fmu/out/|mavros/")
_UNIX = 10**18  # [ns] 2001: more is Unix time, which uXRCE-DDS makes of the autopilot's when it synchronises


def import_autopilot_bag(path: Path, mapping: ServoMapping | None = None) -> ImportedLog:
    """A bag as our topics; raises InputError for one that has neither MAVROS topics nor px4_msgs."""
    raw = read_raw(path)
    px4 = _px4_names({key: channel for key, channel in raw.channels.items() if channel.type.startswith(_PX4)})
    mavros = {key: name for key, c in raw.channels.items() if (name := _mavros_name(c.topic))[1] in MAVROS}
    if not px4 and not mavros:
        raise InputError(
            f"it has neither topics of MAVROS nor px4_msgs, and needs --map MAP.yaml, which `aircraft-sysid import "
            f"{path} --guess MAP.yaml` begins: it holds {raw.topic_names()[:300]}"
        )
    if len(px4) >= len(mavros):
        content = _content(raw, "bag of px4_msgs", px4, set(PX4))
        return import_content(_with_sample_times(content), PX4, mapping)
    content = _content(raw, "bag of MAVROS topics", mavros, set(MAVROS))
    if _is_ours(raw):
        content.notes.append(
            "this is a recording with our topics: check, replay and explain take it as it is; what MAVROS has no names "
            "for, such as vanes and surfaces, is left out here"
        )
    return import_content(content, MAVROS, mapping)


def is_autopilot_bag(path: Path) -> bool:
    """Whether a bag is of MAVROS or px4_msgs; raises InputError as a bag does.

    Some names of MAVROS are ours, too, so that a part of such a bag can be read as it is. What only we write, or an IMU
    by our name that is not of MAVROS, makes a recording of it, whatever else it holds.
    """
    channels = [*read_raw(path).channels.values()]
    others = [c for c in channels if not (c.type.startswith(_PX4) or "mavros/" in c.topic)]
    is_recording = any(c.type in _OURS or f"/{c.topic.lstrip('/')}".endswith("/imu/data") for c in others)
    return len(others) < len(channels) and not is_recording


def _is_ours(raw: RawMessages) -> bool:
    """Whether a bag holds what only we read, and nothing from under MAVROS, some of whose names are ours, too."""
    of_mavros = any("mavros/" in channel.topic for channel in raw.channels.values())
    return not of_mavros and any(channel.type in _OURS for channel in raw.channels.values())


def _content(raw: RawMessages, form: str, named: dict[int, tuple[str, str]], known: set[str]) -> LogContent:
    """Batches of the known channels of one vehicle; ``named``: namespaces and names."""
    batches: dict[str, Batch] = {}
    names, other_vehicles = _of_one_vehicle(raw, named, known)
    notes = [*raw.notes, *other_vehicles]
    for key, name in names.items():
        if name not in known:
            continue
        channel = raw.channels[key]
        if channel.type not in channel_types(channel).fielddefs:
            notes.append(f"{channel.topic} is left out: the bag has no definition of {channel.type}")
            continue
        table = table_of(raw, key)
        if table.skipped:
            notes.append(f"{table.skipped} messages of {channel.topic} could not be decoded")
        if len(table.rows):
            batches[name] = Batch(name, table.stamp, _plain(table))
    found = {names.get(key, c.topic): len(raw.rows(key)) for key, c in raw.channels.items() if len(raw.rows(key))}
    return LogContent(form, list(batches.values()), found, notes)


def _of_one_vehicle(
    raw: RawMessages, named: dict[int, tuple[str, str]], known: set[str]
) -> tuple[dict[int, str], list[str]]:
    """Names by channel of the vehicle with the most known ones, then the most messages, and a note on the others.

    Of two channels with one name that counts which comes from the autopilot, then the first.
    """
    count = {key: len(raw.rows(key)) for key in named}
    vehicles: dict[str, dict[str, int]] = {}
    for key in sorted(named, key=lambda key: not _FROM_AUTOPILOT.search(raw.channels[key].topic)):
        if count[key]:
            vehicle, name = named[key]
            vehicles.setdefault(vehicle, {}).setdefault(name, key)
    use = {v: [count[key] for name, key in keys.items() if name in known] for v, keys in vehicles.items()}
    first, *others = sorted(vehicles, key=lambda v: (-len(use[v]), -sum(use[v]), v)) or [""]
    under = {vehicle: f"/{vehicle}/" if vehicle else "/" for vehicle in vehicles}
    left_out = ", ".join(under[vehicle] for vehicle in others if use[vehicle])
    note = f"topics of several vehicles: those under {under.get(first)} are read, those under {left_out} are not"
    names = {key: name for name, key in vehicles.get(first, {}).items()}
    return names, [note] if left_out else []


def _mavros_name(topic: str) -> tuple[str, str]:
    """Namespace of a vehicle, and name relative to that of MAVROS in it."""
    before, found, name = topic.strip("/").partition("mavros/")
    return (before.strip("/"), name) if found else ("", before)


def _px4_names(channels: dict[int, Channel]) -> dict[int, tuple[str, str]]:
    """Namespaces of vehicles, and names; without ``fmu/`` folders that have no known topic twice are of one vehicle.

    Such are /drone/imu/sensor_combined and /drone/gps/sensor_gps. Vehicles are told apart as high up as that goes.
    """
    named = {key: _px4_name(channel) for key, channel in channels.items()}
    if any("fmu/" in channel.topic for channel in channels.values()):
        return named
    known = {space_and_name for space_and_name in named.values() if space_and_name[1] in PX4}
    for depth in range(max((space.count("/") + 1 for space, _ in known), default=0)):
        vehicles = {(_cut(space, depth), name) for space, name in known}
        if len(vehicles) == len(known):
            return {key: (_cut(space, depth), name) for key, (space, name) in named.items()}
    return named


def _cut(space: str, depth: int) -> str:
    return "/".join(space.split("/")[:depth])


def _px4_name(channel: Channel) -> tuple[str, str]:
    """Namespace of a vehicle, and uORB topic by the type: px4_msgs/msg/SensorCombined is sensor_combined."""
    before, found, _ = channel.topic.strip("/").partition("fmu/")
    name = re.sub(r"(?<!^)(?=[A-Z])", "_", channel.type.rsplit("/", 1)[-1]).lower()
    return before.strip("/") if found else before.rpartition("/")[0], name


def _plain(table: Columns) -> dict[str, npt.NDArray[Any]]:
    """Columns of numbers: sequences of numbers padded with NaN, speeds of engines taken out of their messages."""
    fields: dict[str, npt.NDArray[Any]] = {}
    for name, column in table.fields.items():
        if column.dtype != object:
            fields[name] = column
        elif name in ("esc", "esc_status"):
            speeds = _padded([[getattr(e, "esc_rpm", getattr(e, "rpm", np.nan)) for e in row] for row in column])
            fields["rpm"] = speeds
            fields.update({f"{name}[{i}].esc_rpm": speeds[:, i] for i in range(speeds.shape[1])})
        else:
            numbers = [np.asarray(row) for row in column]
            if all(row.dtype.kind in "iuf" for row in numbers):
                fields[name] = _padded(numbers)
    return fields


def _padded(rows: list[Any]) -> npt.NDArray[np.float64]:
    """Rows of different lengths as (n, k)."""
    width = min(max((len(row) for row in rows), default=0), 64)
    values = np.full((len(rows), width), np.nan)
    for i, row in enumerate(rows):
        values[i, : min(len(row), width)] = np.asarray(row, dtype=np.float64)[:width]
    return values


def _with_sample_times(content: LogContent) -> LogContent:
    """Stamps from the messages' own times; of those that count from a start, by the least delay to the recorder.

    px4_msgs have no header: the stamps so far are the times of recording.
    """
    if not content.batches:
        return content
    own = [sample_time(batch.fields) for batch in content.batches]
    begins, offsets = _starts(np.concatenate([batch.stamp for batch in content.batches]), np.concatenate(own))
    batches = []
    for batch, time in zip(content.batches, own, strict=True):
        offset = offsets[np.searchsorted(begins, batch.stamp, side="right")]
        batches.append(replace(batch, stamp=np.where(time < _UNIX, time + offset, time)))
    restarts = [f"the autopilot restarted {len(begins)} times"] if len(begins) else []
    return replace(content, batches=batches, notes=[*content.notes, *restarts])


def _starts(recorded: Stamps, own: Stamps) -> tuple[Stamps, Stamps]:
    """When each start after the first was recorded [ns], and for each start the least of that time less the own [ns].

    After a restart several messages have own times that have gone back, and no message is as quick as those before;
    after one that was late others are.
    """
    order = np.argsort(recorded, kind="stable")
    recorded, own = recorded[order], own[order]
    newest = np.maximum.accumulate(own)
    recorded, own, newest = (times[(own > 0) & (own < _UNIX)] for times in (recorded, own, newest))
    if not len(own):
        return recorded, np.zeros(1, np.int64)
    least = np.minimum.accumulate((recorded - own)[::-1])[::-1]
    padded = np.append(own, np.full(CONFIRMING - 1, _UNIX))
    soon = np.lib.stride_tricks.sliding_window_view(padded, CONFIRMING).max(axis=1)  # newest of each and those after it
    again = np.flatnonzero((np.diff(least) > NANOSECONDS) & (soon[1:] < newest[1:])) + 1
    last = np.append(again[1:], len(own)) - 1
    again = again[(last - again >= CONFIRMING - 1) & (recorded[last] - recorded[again] >= CONFIRMING_SPAN)]
    return recorded[again], least[np.append(0, again)]
