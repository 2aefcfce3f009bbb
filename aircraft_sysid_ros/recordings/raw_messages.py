"""The messages of a recording as they were recorded: bytes, in the order in which they arrived."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]


def printable(text: str) -> str:
    """A text of a recording, which may be damaged, for one line of a message to the user."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text)


@dataclass(frozen=True)
class Channel:
    """A topic with its type and the definition of the type in the recording ("" when there is none)."""

    topic: str
    type: str
    encoding: str = ""
    definition: str = ""


@dataclass(frozen=True)
class RawMessages:
    """n messages in order of log time: where in ``data`` each lies, and the channel that it belongs to."""

    data: npt.NDArray[np.uint8]
    channel: Integers  # (n,) key of channels
    log_time: Integers  # (n,) [ns]
    start: Integers  # (n,)
    length: Integers  # (n,)
    channels: dict[int, Channel] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # what was wrong with the recording
    #: Messages by topic that the writer of the recording counted and that could not be read.
    missing: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of_parts(
        cls, channels: dict[int, Channel], places: Sequence[tuple[int, int]], parts: Sequence[bytes]
    ) -> RawMessages:
        """From n serialised messages with their channels and log times [ns], in any order."""
        length = np.array([len(part) for part in parts], dtype=np.int64)
        channel, log_time = np.array(places, dtype=np.int64).reshape(-1, 2).T
        order = np.argsort(log_time, kind="stable")
        start = np.cumsum(length) - length
        data = np.frombuffer(b"".join(parts), np.uint8)
        return cls(data, channel[order], log_time[order], start[order], length[order], channels)

    def __len__(self) -> int:
        return len(self.log_time)

    def __getitem__(self, i: int) -> bytes:
        """The serialised message i."""
        return self.data[self.start[i] : self.start[i] + self.length[i]].tobytes()

    def with_notes(self, before: Iterable[str] = (), after: Iterable[str] = ()) -> RawMessages:
        """The same with more notes before and after its own, each once."""
        return replace(self, notes=tuple(dict.fromkeys((*before, *self.notes, *after))))

    def topic_names(self) -> str:
        """The topics, for messages to the user."""
        return ", ".join(sorted({channel.topic for channel in self.channels.values()})) or "no topics"

    def counts(self) -> Counter[str]:
        """Number of messages by topic."""
        of_channel = np.bincount(self.channel, minlength=max(self.channels, default=0) + 1)
        counts: Counter[str] = Counter()
        for key, channel in self.channels.items():
            counts[channel.topic] += int(of_channel[key])
        return counts

    def rows(self, channel: int) -> Integers:
        """Which messages are of a channel, in order."""
        return np.flatnonzero(self.channel == channel)

    def block(self, rows: Integers) -> npt.NDArray[np.uint8] | None:
        """The bytes of the messages in ``rows`` as (m, length), or None when they are not equally long."""
        length = int(self.length[rows[0]]) if len(rows) else 0
        if length == 0 or np.any(self.length[rows] != length):
            return None
        # An overlapping view with a row from every byte on: picking rows from it copies each message once.
        windows = np.ndarray(len(self.data) - length + 1, np.dtype((np.void, length)), self.data, strides=(1,))
        return windows[self.start[rows]].view(np.uint8).reshape(len(rows), length)
