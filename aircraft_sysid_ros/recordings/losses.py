"""What could not be read of a recording, in words: one wording for every format and every command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.recordings.raw_messages import Integers
from aircraft_sysid_ros.stamps import NANOSECONDS

NO_CHECKSUMS = "the recording carries no checksums: a wrong bit inside a message cannot be seen"
NOT_FINISHED = "the recording breaks off (the recorder did not finish it): read up to there"
_MISSING = "messages may be missing"
#: Places, and topics in a sentence, that are named one by one.
_MOST_PLACES, _MOST_TOPICS = 5, 8


@dataclass(frozen=True)
class Damage:
    """A place that could not be read: what is wrong there, and how many messages of the file were read before it."""

    what: str
    messages_before: int


def damage_notes(damages: Sequence[Damage], log_times: Integers) -> list[str]:
    """A sentence for each place: what is wrong, and from when to when messages may be missing.

    ``log_times`` (n,) [ns] are those of the messages that were read, in the order of the file.
    """
    if not damages:
        return []
    seconds = (log_times - log_times.min(initial=2**63 - 1)) / NANOSECONDS
    notes = [damage.what + _span(damage.messages_before, seconds) for damage in damages[:_MOST_PLACES]]
    more = len(damages) - len(notes)
    return [*notes, f"{more} more places of the recording are damaged"] if more else notes


def _span(before: int, seconds: npt.NDArray[np.float64]) -> str:
    if not len(seconds):
        return ""
    first = f" from {seconds[before - 1]:.2f} s" if before else ""
    last = f" to {seconds[before]:.2f} s" if before < len(seconds) else ""
    return f": {_MISSING}{first}{last}"


def losses(notes: Sequence[str]) -> list[str]:
    """Those notes of a recording that say that part of it could not be read."""
    return [note for note in notes if NOT_FINISHED in note or _MISSING in note]


def undescribed_notes(count: int) -> list[str]:
    """That messages are left out whose topic is not known, if there are any."""
    return [f"{count} messages are of topics that the recording does not describe"] if count else []


def undecoded_notes(count: int, what: str) -> list[str]:
    """That messages of ``what`` are left out, if there are any."""
    return [f"{count} messages of {what} could not be decoded"] if count else []


def missing_messages(counted: Mapping[str, int], found: Mapping[str, int]) -> dict[str, int]:
    """Messages by topic that were counted but are not found."""
    return {topic: n - found.get(topic, 0) for topic, n in counted.items() if n > found.get(topic, 0)}


def count_notes(
    source: str, counted: Mapping[str, int], found: Mapping[str, int], said: Mapping[str, int] | None = None
) -> list[str]:
    """How the messages by topic that ``source``, a part of the recording, has counted differ from those found.

    Nothing where it has not counted any; what is missing is not said again where it is ``said``.
    """
    if not counted:
        return []
    notes = []
    missing = missing_messages(counted, found)
    if missing and missing != said:
        lost, total = sum(missing.values()), sum(counted.values())
        notes.append(f"{lost} of the {total} messages that {source} counts could not be read: {_listed(missing)}")
    if more := missing_messages(found, counted):
        notes.append(f"{source} counts fewer messages than there are: {_listed(more)} more")
    return notes


def _listed(counts: Mapping[str, int]) -> str:
    """Topics with their numbers, the largest first."""
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    named = [f"{topic} {count}" for topic, count in ordered[:_MOST_TOPICS]]
    rest = sum(count for _, count in ordered[_MOST_TOPICS:])
    return ", ".join([*named, f"other topics {rest}"] if rest else named)


def checksum_notes(unchecked: int, total: int) -> list[str]:
    """That messages were read whose bytes no checksum confirms, if there are any."""
    if unchecked == 0:
        return []
    if unchecked == total:
        return [NO_CHECKSUMS]
    return [f"{unchecked} of {total} messages have no checksum: a wrong bit inside them cannot be seen"]
