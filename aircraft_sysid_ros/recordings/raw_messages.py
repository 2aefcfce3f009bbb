"""The messages of a recording as they were recorded: bytes, in the order in which they arrived."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]


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

    def __len__(self) -> int:
        return len(self.log_time)

    def __getitem__(self, i: int) -> bytes:
        """The serialised message i."""
        return self.data[self.start[i] : self.start[i] + self.length[i]].tobytes()

    def topic_names(self) -> str:
        """The topics, for messages to the user."""
        return ", ".join(sorted({channel.topic for channel in self.channels.values()})) or "no topics"

    def rows(self, channel: int) -> Integers:
        """Which messages are of a channel, in order."""
        return np.flatnonzero(self.channel == channel)

    def block(self, rows: Integers) -> npt.NDArray[np.uint8] | None:
        """The bytes of the messages in ``rows`` as (m, length), or None when they are not equally long."""
        length = int(self.length[rows[0]]) if len(rows) else 0
        if length == 0 or np.any(self.length[rows] != length):
            return None
        # An overlapping view with a row from every byte on: picking rows from it copies each message once.
        windows = np.ndarray(
            len(self.data) - length + 1, np.dtype((np.void, length)), self.data, strides=(1,)
        )
        return windows[self.start[rows]].view(np.uint8).reshape(len(rows), length)
