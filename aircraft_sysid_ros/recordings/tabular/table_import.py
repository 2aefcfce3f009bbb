"""``import SOURCE --map MAP --out BAG``: a stranger's tables as a recording with our topics."""

from __future__ import annotations

import tempfile
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.segment_list import Span, add_segments
from aircraft_sysid_ros.recordings.tabular.clock import start_note
from aircraft_sysid_ros.recordings.tabular.column_map import ColumnMap
from aircraft_sysid_ros.recordings.tabular.joining import windows
from aircraft_sysid_ros.recordings.tabular.signals import INPUTS
from aircraft_sysid_ros.recordings.tabular.source import open_source
from aircraft_sysid_ros.recordings.tabular.streams import collect
from aircraft_sysid_ros.recordings.tabular.topics import Messages, Plan, type_of
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, frame_of
from aircraft_sysid_ros.samples import PAUSE
from aircraft_sysid_ros.stamps import NANOSECONDS


def import_tables(path: Path, colmap: ColumnMap, out: str | Path, *, overwrite: bool = False) -> dict[str, Any]:
    """Write the recording ``out``; returns the report of every import. Raises InputError.

    The tables are read piece by piece, and messages leave for the disk as soon as none can come before them: what
    is in memory does not grow with the flight.
    """
    source = open_source(path)
    if path.resolve() == Path(out).resolve():
        raise InputError("--out must be another place than the tables")
    with (
        RecordingWriter(out, overwrite=overwrite) as writer,
        _beside(Path(out)) as folder,
    ):
        collected = collect(source, colmap, Path(folder))
        plan = Plan(collected.streams)
        counts = _Counts()
        for window in windows(plan.streams):
            for messages in plan.messages(window):
                _write(writer, messages, plan)
                counts.add(messages)
            writer.release(window.end)
            for stream in plan.streams:
                stream.forget()
        if not counts.topics:
            raise InputError(
                f"nothing in {path} can be carried over: {'; '.join(f'{k}: {v}' for k, v in plan.missing.items())}"
            )
        segments = _add_segments(writer, collected.manoeuvres, counts)
    notes = [*source.notes, *start_note(colmap), *collected.notes, *plan.notes, *segments]
    if collected.unmapped > 0:
        notes.append(f"{collected.unmapped} columns of these tables are not mapped")
    return {
        "log": str(path),
        "format": source.formats(),
        "out": str(out),
        "start": datetime.fromtimestamp(counts.start / NANOSECONDS, timezone.utc).isoformat(timespec="seconds"),
        "duration": (counts.end - counts.start) / NANOSECONDS,
        "topics": counts.report(plan.sources),
        "found": {},
        "missing": plan.missing,
        "notes": notes,
    }


def _add_segments(writer: RecordingWriter, manoeuvres: list[tuple[int, int]], counts: _Counts) -> list[str]:
    """A list of segments beside the recording, for manoeuvres that each began at a time 0 of their own."""
    if len(manoeuvres) < 2:
        return []
    zero = counts.topics.get("imu/data", (0, counts.start, 0))[1]
    spans = [Span(f"manoeuvre {number}", *span) for number, span in enumerate(manoeuvres, 1)]
    path = add_segments(writer, spans, zero)
    return [
        f"its time restarts {len(spans) - 1} times: {len(spans)} manoeuvres, each {PAUSE:g} s after the one before, "
        f"for replay --segments {path}"
    ]


def _beside(out: Path) -> tempfile.TemporaryDirectory[str]:
    """A folder for what waits, on the disk that takes the recording: that of the system may be memory."""
    place = next(folder for folder in out.absolute().parents if folder.is_dir())
    try:
        return tempfile.TemporaryDirectory(dir=place, prefix=f".{out.name}.")
    except OSError as error:
        raise InputError(f"cannot write the recording {out}: {error.strerror or error}") from None


class _Counts:
    """Messages and times by topic."""

    def __init__(self) -> None:
        self.topics: dict[str, tuple[int, int, int]] = {}

    def add(self, messages: Messages) -> None:
        """Count messages."""
        count, start, _ = self.topics.get(messages.topic, (0, int(messages.stamp[0]), 0))
        self.topics[messages.topic] = count + len(messages.stamp), start, int(messages.stamp[-1])

    @property
    def start(self) -> int:
        """First stamp [ns]."""
        return min(start for _, start, _ in self.topics.values())

    @property
    def end(self) -> int:
        """Last stamp [ns]."""
        return max(end for _, _, end in self.topics.values())

    def report(self, sources: dict[str, str]) -> dict[str, Any]:
        """By topic: messages, rate and source."""
        return {
            topic: {
                "messages": count,
                "rate": round((count - 1) * NANOSECONDS / (end - start), 2) if end > start else 0.0,
                "source": sources[topic],
            }
            for topic, (count, start, end) in sorted(self.topics.items())
        }


def _write(writer: RecordingWriter, messages: Messages, plan: Plan) -> None:
    if messages.topic != INPUTS_TOPIC:
        fields = messages.fields
        writer.write(messages.topic, type_of(messages.topic), messages.stamp, fields, frame_id=frame_of(messages.topic))
        return
    names = [name.removeprefix(INPUTS) for name in plan.inputs]
    writer.write_inputs(messages.stamp, names, messages.fields["position"], frame_id=frame_of(messages.topic))
