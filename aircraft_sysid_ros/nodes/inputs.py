"""What a node hears: topics that can be emptied when it stops, with a count of what was lost on the way.

Messages are counted by the numbers that the middleware gives them at their publisher: a number that is left out is a
message that was lost, wherever that was. What was lost after the last that came cannot be seen.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any


class Numbers:
    """Counts the numbers that are missing in what one or several publishers of a topic sent."""

    def __init__(self, publishers: Callable[[], frozenset[bytes]]) -> None:
        """``publishers`` tells which publishers of the topic there are now."""
        self.missing = 0
        self._publishers = publishers
        self._known: frozenset[bytes] = frozenset()
        self._newest: list[int] = []  # one of each publisher

    def take(self, number: int | None) -> None:
        """Number of the message that came; None where the middleware gives none."""
        if number is None:
            return
        before = number - 1
        if before not in self._newest:
            publishers = self._publishers()
            older = [n for n in self._newest if n < number]
            if older and publishers == self._known:  # else it may be the first from another publisher
                before = max(older)
                self.missing += number - 1 - before
            self._known = publishers
        self._newest = [number, *(n for n in self._newest if n != before)][: max(len(self._known), 1)]


class Input:
    """A subscription of ``node``; ``receive`` gets each message."""

    def __init__(self, node: Any, kind: Any, topic: str, receive: Callable[[Any], None], quality: Any) -> None:
        self.topic = topic
        self._node, self._receive = node, receive
        self.subscription = node.create_subscription(kind, topic, _Both(self._take), quality)
        self._numbers = Numbers(self._publishers)

    @property
    def lost(self) -> int:
        """Messages that were sent and did not come."""
        return self._numbers.missing

    def waiting(self, now: int) -> Iterator[tuple[int, Callable[[], None]]]:
        """What had come by ``now`` [ns] and was not received yet: when it was sent [ns], and what receives it."""
        sent, handle, kind = 0, self.subscription.handle, self.subscription.msg_type
        with handle:
            while (taken := handle.take_message(kind, False)) is not None:
                if taken[1]["received_timestamp"] > now:
                    return
                sent = max(sent, taken[1]["source_timestamp"])
                yield sent, partial(self._take, *taken)

    def close(self) -> None:
        """Hear no more."""
        self._node.destroy_subscription(self.subscription)

    def _publishers(self) -> frozenset[bytes]:
        found = self._node.get_publishers_info_by_topic(self.subscription.topic_name)
        return frozenset(bytes(info.endpoint_gid) for info in found)

    def _take(self, message: Any, info: dict[str, Any]) -> None:
        self._numbers.take(info["publication_sequence_number"])
        self._receive(message)


class _Both:
    """A callback for message and information; the events executor of Jazzy gives them as one argument."""

    __signature__ = inspect.signature(lambda message, info: None)

    def __init__(self, take: Callable[[Any, dict[str, Any]], None]) -> None:
        self._take = take

    def __call__(self, *taken: Any) -> None:
        self._take(*(taken if len(taken) == 2 else taken[0]))


def drain(inputs: Iterable[Input], tell: Callable[[int], None] = lambda left: None) -> None:
    """Receive what has come for ``inputs`` by now, in the order in which it was sent; tells how much is left.

    Where a process is slow the middleware sends again what it missed, topic by topic: the order of arrival would make
    whole topics late.
    """
    now = time.time_ns()
    waiting = sorted((entry for each in inputs for entry in each.waiting(now)), key=lambda entry: entry[0])
    for done, (_, receive) in enumerate(waiting):
        tell(len(waiting) - done)
        receive()


def lost_in_words(lost: Mapping[str, int]) -> str:
    """How many messages were lost on the way, by topic; empty if none."""
    if not lost:
        return ""
    listed = ", ".join(f"{count} of {topic}" for topic, count in sorted(lost.items()))
    return f"messages were lost on the way: {listed}"
