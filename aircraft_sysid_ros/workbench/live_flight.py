"""What a running parameter node has said lately, in bounded memory: plain dictionaries in, rows for the views out.

Times are seconds of flight since the first error or state that was heard of this flight; stamps are those of the
messages. The newest parameters and findings are said again to whoever comes later: they tell no time of flight.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from aircraft_sysid_ros.stamps import NANOSECONDS
from aircraft_sysid_ros.workbench.worker import ADD

#: Newest messages that are kept: ten minutes of errors at one a second, five of states at four a second.
MOST_ERRORS, MOST_STATES = 600, 1200
#: Requests that were granted and can be taken back.
_MOST_ADDED = 100
#: A stamp that is older than the last by more than this [s] is of another flight.
_BACK = 1.0
ERRORS, PARAMETERS, MISSING, STATE = "errors", "parameters", "missing", "state"
_SAID_AGAIN = (PARAMETERS, MISSING)


@dataclass
class Added:
    """A request that the node granted; ``names`` are the parameters that came with it, once they are published."""

    text: str
    model: str  # that it led to
    before: frozenset[str]  # names of the parameters before it
    names: frozenset[str] = frozenset()


@dataclass
class LiveFlight:
    """The newest of each kind of message, and a window of those that are drawn. ``heard`` counts them by kind."""

    clock: Callable[[], float] = time.monotonic
    errors: deque[Mapping[str, Any]] = field(default_factory=lambda: deque(maxlen=MOST_ERRORS))
    states: deque[Mapping[str, Any]] = field(default_factory=lambda: deque(maxlen=MOST_STATES))
    parameters: Mapping[str, Any] | None = None
    missing: Mapping[str, Any] | None = None
    heard: dict[str, int] = field(default_factory=lambda: dict.fromkeys((ERRORS, PARAMETERS, MISSING, STATE), 0))
    added: list[Added] = field(default_factory=list)
    changes: deque[float] = field(default_factory=lambda: deque(maxlen=MOST_ERRORS))  # times [s] of a new model
    before: Mapping[str, float] = field(default_factory=dict)  # errors by axis of the model before the last change
    inputs: tuple[str, ...] = ()  # that the node's aircraft file names
    verdict: str = ""  # of the node's newest search, or why there was none, as its diagnostics say; empty: not known
    is_there: bool = False
    was_there: bool = False
    last_heard: float | None = None  # time of the clock [s]
    number: int = 0  # of the flight: rises where another one begins
    _zero: float | None = None
    _newest: dict[str, float] = field(default_factory=dict)

    @property
    def model(self) -> str:
        """Model version of the newest message; empty before the first."""
        return str(self.errors[-1]["model"]) if self.errors else str((self.parameters or {}).get("model", ""))

    @property
    def found_earlier(self) -> bool:
        """Whether what was found missing is of another model, or the node no longer knows of it.

        It was started again, or its model was changed and changed back.
        """
        found = self.missing
        return found is not None and (found["model"] != self.model or self.verdict not in ("", found["verdict"]))

    @property
    def silent(self) -> float | None:
        """Time [s] since the parameter node said something new; None before the first."""
        return None if self.last_heard is None else self.clock() - self.last_heard

    def take(self, kind: str, content: Mapping[str, Any]) -> None:
        """One message."""
        stamp = content["stamp"] / NANOSECONDS
        newest = self._newest.get(kind, stamp)
        if kind in _SAID_AGAIN and stamp < newest:
            return
        if stamp < newest - _BACK:
            self._restart()
        self._newest[kind] = stamp
        if kind not in _SAID_AGAIN:
            self._zero = stamp if self._zero is None else self._zero
            content = {**content, "time": stamp - self._zero}
        if kind == ERRORS:  # with which the parameters come
            self.last_heard = self.clock()
        {ERRORS: self._errors, PARAMETERS: self._parameters, MISSING: self._missing, STATE: self.states.append}[kind](
            content
        )
        self.heard[kind] += 1  # at the end: a page that sees a new count must find what is new

    def presence(self, is_there: bool) -> None:
        """Whether anybody publishes as the parameter node; one that comes back is another node."""
        self.number += is_there and not self.is_there and self.was_there
        self.is_there = is_there
        self.was_there |= is_there

    def granted(self, kind: str, text: str, model: str) -> None:
        """The node has added (ADD) or taken out what was asked for."""
        if kind == ADD:
            names = frozenset(_names(self.parameters))
            self.added = [*self.added[1 - _MOST_ADDED :], Added(text, model, names)]
        else:
            self.added = [item for item in self.added if item.text != text]

    def _restart(self) -> None:
        """Another flight: nothing of the last one may stand beside it."""
        self.number += 1
        self.errors.clear()
        self.states.clear()
        self.changes.clear()
        self.added, self.before, self.parameters, self.missing = [], {}, None, None
        self._zero = None
        self._newest.clear()

    def _errors(self, content: Mapping[str, Any]) -> None:
        if self.errors and content["model"] != self.errors[-1]["model"]:
            self.before = {axis: values["nrmse"] for axis, values in self.errors[-1]["axes"].items()}
            self.changes.append(content["time"])
        self.errors.append(content)

    def _parameters(self, content: Mapping[str, Any]) -> None:
        """Keep the newest, and forget what was added but is not in the model any more."""
        self.parameters, there = content, frozenset(_names(content))
        for item in self.added:
            if item.model == content["model"] and not item.names:
                item.names = there - item.before
        self.added = [item for item in self.added if not item.names or item.names & there]

    def _missing(self, content: Mapping[str, Any]) -> None:
        self.missing, self.verdict = content, content["verdict"]


def _names(content: Mapping[str, Any] | None) -> Iterable[str]:
    return [p["name"] for p in content["parameters"]] if content else []
