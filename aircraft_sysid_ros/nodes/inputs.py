"""What a node hears: topics that can be emptied when it stops, with a count of what was lost on the way.

Messages are counted by the numbers that the middleware gives them at their publisher: a number that is left out is a
message that was lost, wherever that was. What was lost after the last that came cannot be seen.

Where a process is behind, the oldest of a fast topic are dropped, while a slow topic has room for all of its own: taken
in turn, the fast one would run ahead by all that was dropped, and every sample of the slow one (GPS) would be too late.
Therefore what came before a message is received before it, whatever its topic. An executor that is behind would come to
services and timers when all that it was ever told of is worked off: they have their turn with the messages, too.
"""

from __future__ import annotations

import inspect
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

#: Time [ns] after which a message that waits says that the process is behind.
_BEHIND = 20_000_000
#: Messages that a process that is behind receives before its services and timers have their turn.
_MOST_AT_ONCE = 200
#: So often it receives what has come meanwhile: who is always behind must hear that it is to stop.
_MOST_TURNS = 20
#: Of so many messages of a topic that is heard twice it is known that they came.
_MOST_KNOWN = 100
#: A message and its information.
_Taken = tuple[Any, dict[str, Any]]


class Numbers:
    """Counts the numbers that are missing in what one or several publishers of a topic sent."""

    def __init__(self, publishers: Callable[[], frozenset[bytes]]) -> None:
        """``publishers`` tells which publishers of the topic there are now."""
        self.missing = 0
        self.turns = 0  # messages that went on from one that was not the newest: several publishers send by turns
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
        elif before != self._newest[0]:
            self.turns += 1
        if before in self._newest:
            self._newest.remove(before)  # of one of them, where two publishers are as far
        self._newest = [number, *self._newest][: max(len(self._known), 1)]


class Input:
    """A subscription of ``node``; ``receive`` gets each message, after those that came before it to ``beside``.

    Where the process is behind, ``others`` is called between messages: what else has waited for its turn. What its
    ``twin``, of the same topic with another quality of service, has received is not received again.
    """

    def __init__(
        self,
        node: Any,
        kind: Any,
        topic: str,
        receive: Callable[[Any], None],
        quality: Any,
        beside: Callable[[], Sequence[Input]] = lambda: (),
        others: Callable[[], None] = lambda: None,
        twin: Input | None = None,
    ) -> None:
        from rclpy.event_handler import SubscriptionEventCallbacks  # `live` says what is missing where there is no ROS

        self.topic = topic
        self._known: deque[int] | None = None  # when the newest messages were sent [ns]
        if twin is not None:
            self._known = twin._known = deque(maxlen=_MOST_KNOWN)
        self._beside, self._others = beside, others
        self._node, self._receive = node, receive
        self._next: _Taken | None = None  # taken, and it is not its turn yet
        self._is_closed = False
        # What does not match a twin matches the other: ROS would warn that nothing will be received.
        events = SubscriptionEventCallbacks(use_default_callbacks=twin is None)
        self.subscription = node.create_subscription(kind, topic, _Both(self._come), quality, event_callbacks=events)
        self._numbers = Numbers(self._publishers)

    @property
    def lost(self) -> int:
        """Messages that were sent and did not come."""
        return self._numbers.missing

    def take_turns(self) -> int:
        """Messages, since this was last asked, between which another publisher sent one."""
        turns, self._numbers.turns = self._numbers.turns, 0
        return turns

    def waiting(self, now: int) -> Iterator[tuple[int, Callable[[], None]]]:
        """What had come by ``now`` [ns] and was not received yet: when it was sent [ns], and what receives it."""
        sent = 0
        while (taken := self._look()) is not None and taken[1]["received_timestamp"] <= now:
            self._next, sent = None, max(sent, taken[1]["source_timestamp"])
            yield sent, partial(self._take, *taken)

    def close(self) -> None:
        """Hear no more."""
        self._is_closed = True
        self._node.destroy_subscription(self.subscription)

    def _publishers(self) -> frozenset[bytes]:
        found = self._node.get_publishers_info_by_topic(self.subscription.topic_name)
        return frozenset(bytes(info.endpoint_gid) for info in found)

    def _look(self) -> _Taken | None:
        """The message that is next, with its information; None where none waits."""
        if self._next is None:
            handle = self.subscription.handle
            with handle:
                self._next = handle.take_message(self.subscription.msg_type, False)
        return self._next

    def _come(self, message: Any, info: dict[str, Any]) -> None:
        """The executor gives a message: first what came before it, where the process is behind."""
        if self._is_closed:  # the executor had it in hand
            return
        came, now = info["received_timestamp"], time.time_ns()  # 0: the middleware does not say
        if came and now - came > _BEHIND:
            self._next = message, info
            for _ in range(_MOST_TURNS):  # what comes meanwhile has its place among them, too
                now = time.time_ns()
                while _catch_up(self._all(), now):
                    self._others()
                self._others()
                if time.time_ns() - now < _BEHIND:
                    break
            _receive_held(self._all())
        else:
            self._take(message, info)

    def _all(self) -> Sequence[Input]:
        return self._beside() or (() if self._is_closed else (self,))

    def _take(self, message: Any, info: dict[str, Any]) -> None:
        self._numbers.take(info["publication_sequence_number"])
        if self._known is not None:
            if (sent := info["source_timestamp"]) in self._known:
                return
            self._known.append(sent)
        self._receive(message)


def _catch_up(inputs: Sequence[Input], now: int) -> bool:
    """Receive what came by ``now`` [ns], the oldest first, or a part of it; returns whether there may be more."""
    for _ in range(_MOST_AT_ONCE):
        heads = [(taken, each) for each in inputs if (taken := each._look())]
        taken, first = min(heads, key=lambda head: head[0][1]["received_timestamp"], default=(None, None))
        if taken is None or first is None or taken[1]["received_timestamp"] > now:
            return False
        first._next = None
        first._take(*taken)
    return True


def _receive_held(inputs: Sequence[Input]) -> None:
    """What was taken to see how old it is is received at the end, since the executor knows no more of it.

    Sooner, one message of a sensor that had been silent would set the clock ahead of all that still waits.
    """
    held = [(each._next, each) for each in inputs if each._next]
    for taken, each in sorted(held, key=lambda head: head[0][1]["received_timestamp"]):
        each._next = None
        each._take(*taken)


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
    remedy = "run fewer programs beside it, raise input_depth, or set input_reliability to reliable"
    return f"messages were lost on the way: {listed} ({remedy})"
