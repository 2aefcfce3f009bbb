"""What every importer makes of a foreign log, and how it becomes a recording with a report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.segment_list import Span, add_segments
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, TOPICS
from aircraft_sysid_ros.samples import first_and_last
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]

#: GPS time starts on 1980-01-06; the logs that use it have 16 leap seconds (2012-07 to 2015-06).
GPS_EPOCH = 315_964_800
LEAP_SECONDS = 16
SECONDS_PER_WEEK = 604_800
#: [ns] The last second that a stamp of ROS can have.
LATEST = (2**31 - 1) * NANOSECONDS


@dataclass(frozen=True)
class ImportedTopic:
    """n messages of a topic: stamps [ns] (n,), flat fields, and which columns of the log they are made of."""

    topic: str
    stamp: npt.NDArray[np.int64]
    fields: Mapping[str, Any]
    source: str
    frame_id: str = "base_link"
    type_name: str = ""  # default: that of TOPICS


@dataclass(frozen=True)
class ImportedLog:
    """All topics of a log, what it does not have, and what its user should know."""

    format: str
    topics: list[ImportedTopic]
    missing: dict[str, str]  # topic or quantity: why
    notes: list[str] = field(default_factory=list)
    #: Messages of the log by name: how many, and whether they are mapped; empty where a log has no messages.
    found: dict[str, dict[str, Any]] = field(default_factory=dict)
    manoeuvres: list[Span] = field(default_factory=list)  # that the log names by itself


def gps_seconds(week: int, time_of_week: float) -> float:
    """Unix time [s] of GPS time."""
    return GPS_EPOCH + week * SECONDS_PER_WEEK + time_of_week - LEAP_SECONDS


def stamps(start: float, seconds: Array) -> npt.NDArray[np.int64]:
    """Stamps [ns] (n,) of times of a log [s] (n,) whose zero is the Unix time ``start`` [s]."""
    return round(start * NANOSECONDS) + np.round(seconds * NANOSECONDS).astype(np.int64)


def write_log(log: ImportedLog, source: str | Path, out: str | Path, *, overwrite: bool = False) -> dict[str, Any]:
    """Write the recording and return the report (JSON-able); messages arrive when they are stamped.

    Raises InputError where it cannot be written, or nothing in it has a time.
    """
    topics = [topic for topic in map(_timed, log.topics) if len(topic.stamp)]
    if not topics:
        raise InputError(f"no message of {source} has a time from 1970 to 2038: it is damaged, or no log of a flight")
    timeless = sum(len(topic.stamp) for topic in log.topics) - sum(len(topic.stamp) for topic in topics)
    notes = [*log.notes, *([f"{timeless} messages with times outside of 1970 to 2038 left out"] if timeless else [])]
    with RecordingWriter(out, overwrite=overwrite) as writer:
        for topic in topics:
            if topic.topic == INPUTS_TOPIC:
                names, positions = topic.fields["name"][0].tolist(), topic.fields["position"]
                writer.write_inputs(topic.stamp, names, positions, frame_id=topic.frame_id)
                continue
            type_name = topic.type_name or TOPICS[topic.topic]
            writer.write(topic.topic, type_name, topic.stamp, topic.fields, frame_id=topic.frame_id)
        notes += _manoeuvres(log.manoeuvres, topics, writer)
    start, end = first_and_last(np.concatenate([topic.stamp for topic in topics]))
    return {
        "log": str(source),
        "format": log.format,
        "out": str(out),
        "start": datetime.fromtimestamp(start / NANOSECONDS, timezone.utc).isoformat(timespec="seconds"),
        "duration": (end - start) / NANOSECONDS,
        "topics": {topic.topic: _describe(topic) for topic in topics},
        "found": log.found,
        "missing": log.missing,
        "notes": notes,
    }


def _manoeuvres(spans: list[Span], topics: list[ImportedTopic], writer: RecordingWriter) -> list[str]:
    """A list of segments beside the recording, of what lies in it."""
    imu = next((topic.stamp for topic in topics if topic.topic == "imu/data"), None)
    first, last = (0, 0) if imu is None else first_and_last(imu)
    inside = [span for span in spans if span.begin < last and span.end > first]
    if not inside:
        return []
    cut = [Span(s.name, max(s.begin, first), min(s.end, last)) for s in inside]
    path = add_segments(writer, cut, first)
    return [f"System ID flew {len(cut)} sweep{'s' * (len(cut) > 1)}, for replay --segments {path}"]


def _timed(topic: ImportedTopic) -> ImportedTopic:
    """Without messages whose time a header cannot hold."""
    rows = (topic.stamp >= 0) & (topic.stamp <= LATEST)
    if rows.all():
        return topic
    fields = {name: np.asarray(values)[rows] for name, values in topic.fields.items()}
    return replace(topic, stamp=topic.stamp[rows], fields=fields)


def _describe(topic: ImportedTopic) -> dict[str, Any]:
    count = len(topic.stamp)
    first, last = first_and_last(topic.stamp)
    duration = (last - first) / NANOSECONDS
    rate = (count - 1) / duration if duration > 0.0 else 0.0
    return {"messages": count, "rate": round(rate, 2), "source": topic.source}
