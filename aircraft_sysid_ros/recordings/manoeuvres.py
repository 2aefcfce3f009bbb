"""Many manoeuvres as one body of data: whole recordings, or segments of them that a file names.

The file is a list in YAML, ``[{recording, start, stop, name}, …]`` with seconds from the first IMU sample of a
recording. Manoeuvres follow each other in the order given, with a pause between them and a seam in it
(``samples.joined``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.reader import Recording, read_recording
from aircraft_sysid_ros.samples import SHORTEST, Kind, Samples, concatenate, joined, same_imu, sound_stamps, span
from aircraft_sysid_ros.stamps import NANOSECONDS
from aircraft_sysid_ros.yaml_file import read_yaml

KEYS = ("recording", "start", "stop", "name")
#: A segment may end so much [s] after its recording: people round.
_ROUNDED = 0.5


@dataclass(frozen=True)
class Segment:
    """A part of a recording: seconds from its first IMU sample."""

    recording: Path  # as the user gave it
    start: float
    stop: float
    name: str


@dataclass(frozen=True)
class Manoeuvre:
    """A manoeuvre of the body."""

    segment: Segment
    samples: Samples  # stamps as recorded
    offset: int = 0  # [ns] that the body adds to them

    @property
    def duration(self) -> float:
        """Time [s] between its first and last IMU sample; 0 where it has none."""
        stamps = self.samples.stamp[self.samples.kind == Kind.IMU]
        return float(np.ptp(sound_stamps(stamps))) / NANOSECONDS if len(stamps) else 0.0

    @property
    def json(self) -> dict[str, Any]:
        """For state.json; ``offset`` [s] is what was added to the stamps of the recording."""
        s = self.segment
        return {
            "name": s.name,
            "recording": str(s.recording),
            "start": s.start,
            "stop": s.stop,
            "offset": self.offset / NANOSECONDS,
        }


@dataclass(frozen=True)
class Body:
    """What is replayed: one recording as it is, or manoeuvres that were joined."""

    recording: Recording
    manoeuvres: tuple[Manoeuvre, ...] = ()  # none: the recording as it is


def read_body(
    paths: Sequence[str],
    segments: str | None,
    inputs: Sequence[NamedInput] = (),
    prepare: Callable[[Recording], Recording] = lambda recording: recording,
) -> Body:
    """Read recordings and join them, or the segments of a file; ``prepare`` checks and corrects each recording.

    ``inputs`` are those that the aircraft file names. Raises InputError for a recording that is given twice, for
    segments that are not in their recordings or overlap, and where no manoeuvre is long enough.
    """
    given = [Path(path) for path in paths]
    _check_twice(given)
    wanted = None if segments is None else read_segments(segments, given)
    used = [path for path in given if wanted is None or any(s.recording == path for s in wanted)]
    recordings = {path: prepare(read_recording(path, inputs)) for path in used}
    _check_same_flight(recordings)
    if wanted is None and len(given) == 1:
        return Body(recordings[given[0]])
    whole = [] if wanted is not None else [_whole(path, recordings[path], given) for path in given]
    found = whole or [_cut(recordings[s.recording], s) for s in wanted or []]
    notes = [f"the recording {path} has no segment and is not used" for path in given if path not in used]
    notes += [f"{path}: {note}" for path, recording in recordings.items() for note in recording.notes]
    kept = [m for m in found if m.duration >= SHORTEST]
    notes += [
        f"the manoeuvre '{m.segment.name}' is left out: it has {m.duration:.1f} s of IMU samples, and {SHORTEST:g} s "
        "are needed for a filter to start"
        for m in found
        if m.duration < SHORTEST
    ]
    if not kept:
        raise InputError(
            f"no manoeuvre is long enough: the longest has {max(m.duration for m in found):.1f} s of IMU samples, and "
            f"{SHORTEST:g} s are needed"
        )
    return _joined(recordings, kept, notes)


def _check_twice(given: Sequence[Path]) -> None:
    for first, second in combinations(given, 2):
        if first.resolve() == second.resolve():
            raise InputError(f"the recording {second} is given twice: name it once")


def _check_same_flight(recordings: Mapping[Path, Recording]) -> None:
    """Raises InputError where two recordings hold the same IMU samples: what was fitted would be held out."""
    for (first, a), (second, b) in combinations(recordings.items(), 2):
        if same_imu(a.samples, b.samples):
            raise InputError(f"the recordings {first} and {second} hold the same IMU samples: give one of them")


def _joined(recordings: Mapping[Path, Recording], kept: Sequence[Manoeuvre], notes: Sequence[str]) -> Body:
    samples, offsets = joined([m.samples for m in kept])
    topics: Counter[str] = Counter()  # messages in the manoeuvres, by their share of the time
    ignored: Counter[str] = Counter()
    skipped: Counter[str] = Counter()
    for path, recording in recordings.items():
        time = sum(m.duration for m in kept if m.segment.recording == path)
        share = min(time / max(_length(recording.samples), 1e-9), 1.0)
        topics.update({topic: round(share * count) for topic, count in recording.topics.items()})
        ignored.update(recording.ignored)
        skipped.update(recording.skipped)
    first = next(iter(recordings.values()))
    unnamed = tuple(dict.fromkeys(name for recording in recordings.values() for name in recording.unnamed))
    body = Recording(
        first.path, samples, dict(topics), dict(ignored), dict(skipped), samples.stamp, tuple(notes), unnamed
    )
    return Body(body, tuple(replace(m, offset=o) for m, o in zip(kept, offsets, strict=True)))


def _whole(path: Path, recording: Recording, given: Sequence[Path]) -> Manoeuvre:
    """All of a recording, by its name, or by its path where another one has the same."""
    same = sum(other.stem == path.stem for other in given) > 1
    samples = recording.samples
    segment = Segment(path, 0.0, _length(samples), str(path) if same else path.stem)
    return Manoeuvre(segment, samples)


def _length(samples: Samples) -> float:
    first, last = span(samples)
    return (last - first) / NANOSECONDS


def _cut(recording: Recording, segment: Segment) -> Manoeuvre:
    """The samples of a segment by their stamps, and the newest mass properties from before it."""
    samples, length = recording.samples, _length(recording.samples)
    if segment.stop > length + _ROUNDED or segment.start >= length:
        raise InputError(
            f"the segment '{segment.name}' goes from {segment.start:g} to {segment.stop:g} s, but the recording "
            f"{segment.recording} has {length:.1f} s: correct its start and stop"
        )
    begin = span(samples)[0]
    low, high = (begin + round(t * NANOSECONDS) for t in (segment.start, segment.stop))
    inside = samples[(samples.stamp >= low) & (samples.stamp <= high)]
    masses = samples[(samples.kind == Kind.MASS) & (samples.stamp < low)]
    if len(masses):
        newest = masses[np.argsort(masses.stamp, kind="stable")[-1:]]
        inside = concatenate([Samples(np.array([low]), newest.kind, newest.values), inside])
    return Manoeuvre(segment, inside)


# -- the file of segments --------------------------------------------------------------------------------------------


def read_segments(path: str, given: Sequence[Path]) -> list[Segment]:
    """Segments of the recordings ``given``, in the order of the file. Raises InputError."""
    content = read_yaml(path, "segments file")
    if not isinstance(content, list) or not content:
        raise InputError(f"segments file {path}: it must be a list of segments with {', '.join(KEYS)}")
    found = [_segment(f"segments file {path}: entry {number}", entry, Path(path).parent, given)
             for number, entry in enumerate(content, 1)]  # fmt: skip
    for first, second in combinations(found, 2):
        if first.name == second.name:
            raise InputError(f"segments file {path}: two segments have the name '{first.name}': give each its own")
        if first.recording == second.recording and first.start < second.stop and second.start < first.stop:
            raise InputError(
                f"segments file {path}: '{first.name}' and '{second.name}' overlap, and what was fitted would be held "
                "out: cut them apart"
            )
    return found


def _segment(where: str, entry: Any, folder: Path, given: Sequence[Path]) -> Segment:
    if not isinstance(entry, dict):
        raise InputError(f"{where} is not a segment: give it {', '.join(KEYS)}")
    unknown = [str(key) for key in entry if key not in KEYS]
    if unknown:
        raise InputError(f"{where} has the unknown key '{unknown[0][:60]}': a segment has {', '.join(KEYS)}")
    start, stop = (_seconds(where, entry, key) for key in ("start", "stop"))
    if stop <= start:
        raise InputError(f"{where} stops at {stop:g} s, which is not after its start at {start:g} s")
    recording = _recording(where, entry.get("recording"), folder, given)
    name = entry.get("name", f"{recording.stem} {start:g} to {stop:g} s")
    if not isinstance(name, str | int | float) or not str(name).strip():
        raise InputError(f"{where} has a name that is not text")
    return Segment(recording, start, stop, " ".join(str(name).split()))


def _seconds(where: str, entry: Mapping[str, Any], key: str) -> float:
    value = entry.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value) or value < 0.0:
        raise InputError(f"{where} needs a {key} in seconds from the start of the recording, 0 or more")
    return float(value)


def _recording(where: str, named: Any, folder: Path, given: Sequence[Path]) -> Path:
    """The recording that is meant: by its path, from the folder of the file or from here, or by its name."""
    if named is None:
        if len(given) == 1:
            return given[0]
        raise InputError(f"{where} names no recording, and {len(given)} are given: say which")
    text = str(named)
    places = {(folder / text).resolve(), Path(text).resolve()}
    found = [path for path in given if path.resolve() in places] or [p for p in given if text in (p.name, p.stem)]
    if len(found) != 1:
        listed = ", ".join(map(str, given))
        wrong = "is the name of more than one" if found else "is not among the recordings"
        raise InputError(f"{where}: '{text[:200]}' {wrong} that are given: {listed}")
    return found[0]
