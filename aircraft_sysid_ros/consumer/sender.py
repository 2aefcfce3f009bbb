"""Whose messages are followed: those of one sender, by one clock.

A message that is late is refused. One whose stamp leaps, back or ahead, may be of a clock that started over, of another
sender, or wrong alone: such messages are refused until CONFIRMING of them have come running, each newer than the one
before, with none of the old clock in between. So is a model that comes back right after another has replaced it.
"""

from __future__ import annotations

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.stamps import NANOSECONDS

#: A stamp that is off by this [s] or more leaps; a model that was replaced more lately has not come back by itself.
LEAP = 10.0
#: Messages running after which they are believed.
CONFIRMING = 3
_ONE = "give each aircraft a namespace and one parameter_estimator"


class Sender:
    """Which messages are followed."""

    def __init__(self) -> None:
        self._stamp: int | None = None  # [ns] of the newest message that is followed
        self._model = ""
        self._leapt = (0, 0)  # of the messages running that leapt: newest stamp [ns], and how many
        self._mixed = False  # what leapt and what did not came by turns
        self._replaced: dict[str, int] = {}  # models that were, with the stamp [ns] of their newest message
        self._returned = 0  # messages running of one of them

    def follow(self, stamp: int, model: str, asked: int | None) -> bool:
        """Whether the clock starts over with a message; InputError for one that is not to be followed.

        ``stamp`` and ``asked``, the time of the newest question, in ns: after a silence a message is much newer than
        the last one, but not than the question.
        """
        if self._stamp is None:
            self._stamp, self._model = stamp, model
            return False
        behind = (self._stamp - stamp) / NANOSECONDS
        ahead = (stamp - max(self._stamp, self._stamp if asked is None else asked)) / NANOSECONDS
        if behind >= LEAP or ahead >= LEAP:
            self._confirm_leap(stamp, f"{behind:g} s older" if behind > 0.0 else f"{ahead:g} s newer")
            self._replaced.clear()
        else:
            self._mixed, self._leapt = self._mixed or self._leapt[1] > 0, (0, 0)
            if behind >= 0.0:
                raise InputError(f"a message {behind:g} s older than the last came after it")
            self._confirm_model(stamp, model)
        self._stamp, self._model, self._returned = stamp, model, 0
        return behind >= LEAP

    def _confirm_leap(self, stamp: int, what: str) -> None:
        before, count = self._leapt
        self._leapt = (stamp, count + 1 if count and stamp > before else 1)
        if self._leapt[1] < CONFIRMING:
            why = f"a new clock is accepted after {CONFIRMING} messages in a row"
            if self._mixed:
                why = f"two senders in turn: {_ONE}"
            raise InputError(f"a message {what} than the last: {why}")
        self._leapt, self._mixed = (0, 0), False

    def _confirm_model(self, stamp: int, model: str) -> None:
        if model == self._model:
            return
        left = self._replaced.get(model)
        if left is not None and stamp - left < LEAP * NANOSECONDS:
            self._replaced[model] = stamp
            self._returned += 1
            if self._returned < CONFIRMING:
                raise InputError(f"two senders in turn, of the models {self._model} and {model}: {_ONE}")
        assert self._stamp is not None
        self._replaced.pop(model, None)
        self._replaced[self._model] = self._stamp
