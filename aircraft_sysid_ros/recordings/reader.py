"""A recording as samples: rosbag2 in, everything that the estimators use out, in order of arrival."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import losses
from aircraft_sysid_ros.recordings.raw_messages import Channel, Integers, RawMessages, printable
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.recordings.tables import names_of_inputs, table_of
from aircraft_sysid_ros.ros_messages.conversion import (
    INPUTS_TOPIC,
    INPUTS_TYPE,
    TOPICS,
    USED_FIELDS,
    samples_and_rows,
    topics_of,
)
from aircraft_sysid_ros.samples import Samples, concatenate, first_and_last, with_mass_in_flight
from aircraft_sysid_ros.stamps import NANOSECONDS

#: No message holds more samples than this.
_SAMPLES_PER_MESSAGE = 8


@dataclass(frozen=True)
class Recording:
    """The samples of a recording in order of arrival, and what it holds."""

    path: Path
    samples: Samples
    topics: dict[str, int]  # messages by topic, relative names as in TOPICS
    ignored: dict[str, int]  # messages by the full name of the topics that are not used
    skipped: dict[str, int]  # messages by topic that could not be decoded
    arrival: Integers  # (n,) [ns] when each sample was received: the log time of its message
    notes: tuple[str, ...] = ()  # what was wrong with it, for the user
    unnamed: tuple[str, ...] = ()  # inputs that it holds and the aircraft file does not name

    @property
    def start(self) -> int:
        """Earliest stamp [ns] that can be right."""
        return first_and_last(self.samples.stamp)[0]

    @property
    def end(self) -> int:
        """Latest stamp [ns] that can be right."""
        return first_and_last(self.samples.stamp)[1]

    @property
    def duration(self) -> float:
        """Time between those two [s]."""
        return (self.end - self.start) / NANOSECONDS

    def require(self, topics: Iterable[str]) -> None:
        """Raises InputError that names the topics that are missing and what was found."""
        missing = [topic for topic in topics if not self.topics.get(topic)]
        if missing:
            found = [*self.topics, *self.ignored]
            raise InputError(
                f"the recording {self.path} lacks {', '.join('/' + topic for topic in missing)}: it holds "
                f"{', '.join('/' + topic.lstrip('/') for topic in found)}"
            )


def read_recording(path: str | Path, inputs: Sequence[NamedInput] = ()) -> Recording:
    """Read a rosbag2 folder (MCAP or sqlite3) or a bare .mcap, .db3 or .bag file.

    A topic counts with or without a namespace before it: /uav1/imu/data is imu/data. ``inputs`` are those that the
    aircraft file names. Raises InputError for what is not a recording and for a recording without any of TOPICS.
    """
    raw = read_raw(path)
    wanted, notes = _wanted_channels(raw, topics_of(inputs))
    topics: dict[str, int] = {}
    skipped: dict[str, int] = {}
    batches: list[Samples] = []
    orders: list[Integers] = []
    arrivals: list[Integers] = []
    for key, topic in wanted.items():
        table = table_of(raw, key, USED_FIELDS[topic])
        topics[topic] = topics.get(topic, 0) + len(table.rows)
        skipped[topic] = skipped.get(topic, 0) + table.skipped
        if not len(table.rows):
            continue
        with np.errstate(invalid="ignore"):  # what a damaged message holds may be no number
            converted = samples_and_rows(topic, table.stamp, table.fields, inputs)
        for place, (samples, rows) in enumerate(converted):
            batches.append(samples)
            orders.append(table.rows[rows] * _SAMPLES_PER_MESSAGE + place)
            arrivals.append(table.log_time[rows])
    _require_samples(path, batches, raw, skipped)
    skipped = {topic: count for topic, count in skipped.items() if count}
    notes += [note for topic, count in skipped.items() for note in losses.undecoded_notes(count, "/" + topic)]
    ignored = _counts(raw, raw.channels.keys() - wanted.keys())
    order = np.argsort(np.concatenate(orders), kind="stable")
    samples = with_mass_in_flight(_in_order(concatenate(batches), order))
    arrival = np.concatenate(arrivals)[order]
    unnamed = _unnamed(raw, inputs)
    return Recording(Path(path), samples, topics, ignored, skipped, arrival, (*raw.notes, *notes), unnamed)


def _unnamed(raw: RawMessages, inputs: Sequence[NamedInput]) -> tuple[str, ...]:
    """Inputs of a recording that are not among those that the aircraft file names."""
    named, topic = {item.name for item in inputs}, _namespace(raw) + INPUTS_TOPIC
    channels = [key for key, c in raw.channels.items() if (c.topic.strip("/"), c.type) == (topic, INPUTS_TYPE)]
    found = dict.fromkeys(name for key in channels for name in names_of_inputs(raw, key))
    return tuple(printable(name) for name in found if name not in named)


def _in_order(samples: Samples, order: Integers) -> Samples:
    """Samples (n,) in an order; ``take`` copies rows several times faster than an index."""
    return Samples(samples.stamp[order], samples.kind[order], samples.values.take(order, axis=0))


def _counts(raw: RawMessages, keys: Iterable[int]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for key in sorted(keys):
        topic = raw.channels[key].topic
        counts[topic] = counts.get(topic, 0) + len(raw.rows(key))
    return counts


def _wanted_channels(raw: RawMessages, known: Mapping[str, str]) -> tuple[dict[int, str], list[str]]:
    """Relative topic by channel for those that are used, and notes on those that should be but are not.

    ``known``: types of topics.
    """
    namespace = _namespace(raw)
    wanted: dict[int, str] = {}
    notes = []
    others = []
    for key, channel in raw.channels.items():
        topic = channel.topic.strip("/").removeprefix(namespace)
        if not len(raw.rows(key)):
            continue
        if topic not in known:
            others.append(channel)
        elif channel.type == known[topic]:
            wanted[key] = topic
        else:
            notes.append(f"{channel.topic} is ignored: its type is {channel.type}, not {known[topic]}")
    found = set(wanted.values())
    return wanted, notes + _name_notes(others, found) + _namespace_notes(namespace, others, found)


def _name_notes(others: Iterable[Channel], found: Collection[str]) -> list[str]:
    """That a topic has the type of one that the recording lacks: its name may be wrong, or one bit of it."""
    lacking = {type_name: topic for topic, type_name in TOPICS.items() if topic not in found}
    return [
        f"{channel.topic} is ignored: it has the type of /{lacking[channel.type]}, but another name"
        for channel in others
        if channel.type in lacking
    ]


def _namespace_notes(namespace: str, others: Iterable[Channel], found: Collection[str]) -> list[str]:
    """That topics which are read are there once more in other namespaces, as those of another aircraft."""
    placed = ((channel.type, _placed(channel)) for channel in others)
    beside = {where[0] for kind, where in placed if where and where[1] in found and kind == TOPICS[where[1]]}
    if not beside:
        return []
    left_out = ", ".join(f"/{prefix}" for prefix in sorted(beside))
    return [
        f"topics of several namespaces: those under /{namespace} are read, those under {left_out} are not; "
        "`ros2 bag convert` makes a recording of one aircraft"
    ]


def _namespace(raw: RawMessages) -> str:
    """What stands before the most known topics with messages, as "uav1/"; of equal ones none, then the alphabet."""
    namespaces: dict[str, int] = {}
    for key, channel in raw.channels.items():
        if (placed := _placed(channel)) and len(raw.rows(key)):
            namespaces[placed[0]] = namespaces.get(placed[0], 0) + 1
    return min(namespaces, key=lambda prefix: (-namespaces[prefix], prefix), default="")


def _placed(channel: Channel) -> tuple[str, str] | None:
    """Namespace and relative name of a topic that ends as one of TOPICS does."""
    name = channel.topic.strip("/")
    topic = next((topic for topic in TOPICS if name == topic or name.endswith("/" + topic)), None)
    return None if topic is None else (name.removesuffix(topic), topic)


def _require_samples(path: str | Path, batches: list[Samples], raw: RawMessages, skipped: Mapping[str, int]) -> None:
    if any(len(batch) for batch in batches):
        return
    if any(skipped.values()):
        raise InputError(f"no message of the recording {path} could be decoded: it is damaged or of another version")
    needed = ", ".join("/" + topic for topic in TOPICS)
    of_autopilot = any(c.type.startswith("px4_msgs/") or "mavros/" in c.topic for c in raw.channels.values())
    remedy = (
        f"; `aircraft-sysid import {path} --out BAG` makes a recording of an autopilot's topics"
        if of_autopilot
        else f"; `aircraft-sysid import {path} --guess MAP.yaml` begins a map of topics with other names"
    )
    raise InputError(f"the recording {path} has none of the topics {needed}: it holds {raw.topic_names()}{remedy}")
