"""A list of segments beside a recording: manoeuvres that its log names by itself, for ``replay --segments``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.stamps import NANOSECONDS


class Span(NamedTuple):
    """One manoeuvre of a log: its name, and from when to when [ns]."""

    name: str
    begin: int
    end: int


def add_segments(writer: RecordingWriter, spans: Sequence[Span], zero: int) -> Path:
    """Write the list with the recording; ``zero`` [ns] is the stamp of its first IMU sample."""
    path = writer.path.with_name(f"{writer.path.name}.segments.yaml")
    lines = [
        f"- {{name: {span.name}, start: {max((span.begin - zero) / NANOSECONDS, 0.0):.3f}, "
        f"stop: {(span.end - zero) / NANOSECONDS:.3f}}}"
        for span in spans
    ]
    writer.add_file(path, ("\n".join(lines) + "\n").encode())
    return path
