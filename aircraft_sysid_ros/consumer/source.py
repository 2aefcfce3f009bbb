"""What a controller flies on: the last good value of every parameter, or what was known before the flight.

Per parameter, at every question:

| origin | when |
|---|---|
| LIVE | the newest message is fresh and says USE, and its axis fits together |
| HELD | it says HOLD, or is silent; the flight condition is not known: the value of the newest message that said USE |
| PRIOR | never USE so far; REJECT now; the good value is too old; flown too far from where it was learnt |

Stamps are those of sensor samples, and questions are asked by their clock: fresh is a stamp within ``silence`` of the
question, before or after it, and too old a good value that is ``longest_hold`` away, before or after it. What a new
model does not have, and all that was good by a clock that started over, is forgotten.

Parameters of one axis are learnt together: those with USE are right only beside what the message says of the others. So
an axis is taken only while what is kept of it agrees with what is published of it, to CONTRADICTION standard errors. A
vane that sticks makes C_m,0 take over what C_m,alpha explained; C_m,0 of that message and C_m,alpha of before would
count it twice.

What is answered moves to that by v' = (target - v) / blend_time, all parameters alike, so that gains do not jump and a
consistent set is left along the straight line to the next. What is still to be moved counts into the standard error.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.consumer.condition_table import ConditionTable
from aircraft_sysid_ros.consumer.flown_condition import FlownCondition, in_words
from aircraft_sysid_ros.consumer.sender import LEAP, Sender
from aircraft_sysid_ros.consumer.snapshot import Condition, Snapshot, snapshot_of
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.rounding import with_error
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

_NEVER = np.iinfo(np.int64).min
_NO_PLACE = "the table of flight conditions is not used: the newest message came without a flight condition"
#: Time [s] of questions after which what none has had is said.
_EARLY = 5.0
#: Standard errors of the difference by which a kept value may be off the published one.
CONTRADICTION = 3.0


class Origin(IntEnum):
    """Where a value comes from."""

    PRIOR = 0
    HELD = 1
    LIVE = 2


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter before the flight, one sigma."""

    value: float
    std: float


@dataclass(frozen=True)
class Rules:
    """When a value is good, and how fast the next one takes over; InputError unless numbers of at least 0."""

    silence: float = 3.0  # [s] a newest message that is older, or newer, is not live
    longest_hold: float = 600.0  # [s] after which a held value is too old
    airspeed_margin: float = 2.0  # [m/s] beyond the learnt flight condition
    angle_margin: float = 0.05  # [rad] the same of alpha and beta
    blend_time: float = 1.0  # [s]; 0: at once; finite
    longest_gap: float = 1.0  # [s] for which airspeed, alpha and beta each stay known after a question that had it

    def __post_init__(self) -> None:
        """Raises InputError."""
        for name, value in vars(self).items():
            if not value >= 0.0 or (name == "blend_time" and not np.isfinite(value)):
                raise InputError(f"the rule {name} must be a number of at least 0, not {value:g}")


@dataclass(frozen=True)
class Answer:
    """One parameter as it may be used now."""

    name: str
    value: float
    std: float
    origin: Origin
    reason: str


@dataclass(frozen=True)
class Values:
    """All parameters at one instant, in the order of the source's names."""

    names: tuple[str, ...]
    values: Array  # (n,)
    std: Array  # (n,)
    origin: Integers  # (n,) of Origin, that of the target where it is still moved to
    reasons: tuple[str, ...]
    model: str  # id of the model of the newest message; empty: none came

    def __getitem__(self, name: str) -> Answer:
        """One of them; KeyError for a name that the source does not have."""
        if name not in self.names:
            raise KeyError(f"no parameter {name}: the source was made for {' '.join(self.names)}")
        i = self.names.index(name)
        return Answer(name, float(self.values[i]), float(self.std[i]), Origin(int(self.origin[i])), self.reasons[i])


def priors_of(coefficients: Mapping[str, float], share: float = 0.25, least: float = 0.01) -> dict[str, Prior]:
    """A-priori values from the ``coefficients`` of an aircraft file, one sigma a share of each, at least ``least``."""
    return {name: Prior(value, max(share * abs(value), least)) for name, value in coefficients.items()}


class ParameterSource:
    """Takes snapshots, from any thread, and answers with values; bad messages are refused and change nothing."""

    def __init__(
        self, priors: Mapping[str, Prior], rules: Rules | None = None, table: ConditionTable | None = None
    ) -> None:
        """The names of ``priors`` are those that are answered. Raises InputError for a prior that is not finite.

        With a ``table`` good values are interpolated over the flight conditions that they were learnt in.
        """
        for name, prior in priors.items():
            if not (np.isfinite(prior.value) and np.isfinite(prior.std) and prior.std >= 0.0):
                raise InputError(f"the a-priori value of {name} must be finite, not {prior.value:g} ± {prior.std:g}")
        self.names = tuple(priors)
        self.rules, self.table = rules or Rules(), table
        if table is not None and table.names != self.names:
            raise InputError("the table of flight conditions must be made for the names of the source")
        self.newest: Snapshot | None = None
        self.taken = self.refused = 0
        self.refusal = ""  # the sentence of the newest refused message
        self.warning = ""  # why the table is not used for the newest message
        self._lock = threading.Lock()
        self._prior = np.array([p.value for p in priors.values()])
        self._prior_std = np.array([p.std for p in priors.values()])
        self._status = np.full(len(self.names), int(Trust.HOLD))
        self._texts = [""] * len(self.names)
        n = len(self.names)
        self._good, self._good_std = np.full(n, np.nan), np.full(n, np.nan)
        self._good_stamp = np.full(n, _NEVER, dtype=np.int64)
        self._low, self._high = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
        self._value = self._prior.copy()
        self._asked: int | None = None  # stamp [ns] of the newest question
        self._asked_for = 0.0  # [s] that questions have come for; where their clock leaps it does not count
        self._sender, self._has_place = Sender(), False
        self._flown = FlownCondition(self.rules.longest_gap)

    # -- what comes in ---------------------------------------------------------------------------------------

    def offer(self, stamp: int, content: Mapping[str, Any], condition: Condition | None = None) -> str:
        """Take a message's content stamped ``stamp`` [ns]; returns "", or the sentence why it is refused."""
        try:
            self.take(snapshot_of(stamp, content), condition)
        except InputError as error:
            self.refused, self.refusal = self.refused + 1, str(error)
            return self.refusal
        return ""

    def take(self, snapshot: Snapshot, condition: Condition | None = None) -> None:
        """Take a snapshot, learnt lately in ``condition``. InputError for one of another ``Sender``, or late."""
        with self._lock:
            before = self.newest
            if self._sender.follow(snapshot.stamp, snapshot.model, self._asked):
                self._forget(())  # stamps of the old clock say nothing of age any more
            elif before is not None and before.model != snapshot.model:
                self._forget(snapshot.names)
            self.newest, self.taken = snapshot, self.taken + 1
            now = snapshot.stamp if self._asked is None else max(self._asked, snapshot.stamp)
            flown = self._flown.at(now, condition)
            self._note(snapshot, Condition(*flown.tolist()))

    def _forget(self, kept: tuple[str, ...]) -> None:
        """What was good, but for some names; what is answered moves on from where it is."""
        gone = ~np.isin(self.names, kept)
        self._good[gone] = self._good_std[gone] = self._low[gone] = self._high[gone] = np.nan
        self._good_stamp[gone] = _NEVER
        if self.table is not None:
            self.table.clear()

    def _note(self, s: Snapshot, condition: Condition) -> None:
        own = {name: i for i, name in enumerate(self.names)}
        pairs = np.array([(own[name], j) for j, name in enumerate(s.names) if name in own], np.int64).reshape(-1, 2)
        self._status[:], self._texts = int(Trust.HOLD), [f"the model {s.model} does not have it"] * len(self.names)
        for i, j in pairs:
            self._status[i], self._texts[i] = s.status[j], s.reasons[j]
        self._hold_axes(s, pairs, condition)
        mine, theirs = pairs[self._status[pairs[:, 0]] == Trust.USE].T
        self._good[mine], self._good_std[mine] = s.values[theirs], s.std[theirs]
        self._good_stamp[mine] = s.stamp
        self._low[mine], self._high[mine] = s.low, s.high
        if self.table is not None:
            age = np.full(len(self.names), np.inf)
            age[mine] = s.age[theirs]
            self._has_place = self.table.add(self._good, self._good_std, age, condition)
            self.warning = "" if self._has_place else _NO_PLACE

    def _hold_axes(self, s: Snapshot, pairs: Integers, condition: Condition) -> None:
        """USE becomes HOLD in axes of which what is kept contradicts what is published."""
        flown = np.array(condition)
        kept, kept_std, _ = self._kept(self._doubts(s.stamp, flown), flown)
        for i, j in pairs[~s.usable[pairs[:, 1]]]:
            off = abs(kept[i] - s.values[j])
            if off > CONTRADICTION * np.hypot(kept_std[i], s.std[j]):  # never with NaN
                published = with_error(float(s.values[j]), float(s.std[j]))
                words = f"{self.names[i]} is kept at {kept[i]:.3g} and published as {published}"
                for k, name in enumerate(self.names):
                    if name.split("_")[0] == self.names[i].split("_")[0] and self._status[k] == Trust.USE:
                        self._status[k], self._texts[k] = int(Trust.HOLD), f"its axis does not fit together: {words}"

    # -- what is asked ---------------------------------------------------------------------------------------

    def at(self, now: int, condition: Condition | None) -> Values:
        """All parameters at a time ``now`` [ns], of the clock of the stamps, flown in ``condition``.

        None, and NaN in it, are not known; what an earlier question knew of it stays for ``Rules.longest_gap``. Raises
        InputError for a time that is not a finite number.
        """
        if not np.isfinite(now):
            raise InputError(f"the time of a question must be a number of nanoseconds, not {now}")
        with self._lock:
            flown = self._flown.at(now, condition)
            target, std, origin, reasons = self._target(now, flown)
            elapsed = 0.0 if self._asked is None else max(now - self._asked, 0) / NANOSECONDS
            blend = self.rules.blend_time
            share = 1.0 if blend <= 0.0 else float(-np.expm1(-elapsed / blend))
            self._asked = now
            self._asked_for += elapsed if elapsed < LEAP else 0.0
            self._value = self._value + share * (target - self._value)
            value = self._value.copy()
            model = "" if self.newest is None else self.newest.model
        return Values(self.names, value, np.hypot(std, value - target), origin, reasons, model)

    @property
    def blind(self) -> str:
        """Which part of the flight condition no question has ever had, in words; empty: none, or it is early yet."""
        with self._lock:
            needed = (np.isfinite(self._low) | np.isfinite(self._high)).any(axis=0)
            lacking = in_words(self._flown.never & needed)
            early = self._asked_for < _EARLY
        if early or not lacking:
            return ""
        return f"no {lacking} in any question so far: what was learnt between limits of it is not LIVE without it"

    def _target(self, now: int, condition: Array) -> tuple[Array, Array, Integers, tuple[str, ...]]:
        """Where the values are going: value, std, origin (n,) and reasons."""
        status, texts = self._status, self._texts.copy()
        fresh = self.newest is not None and abs(now - self.newest.stamp) <= self.rules.silence * NANOSECONDS
        said = np.isfinite(self._low) | np.isfinite(self._high)
        unknown = np.any(np.isnan(condition) & said, axis=1)
        known, old, outside = doubts = self._doubts(now, condition)
        value, std, is_good = self._kept(doubts, condition)
        is_live = is_good & (status == Trust.USE) & fresh & ~unknown
        origin = np.where(is_live, int(Origin.LIVE), np.where(is_good, int(Origin.HELD), int(Origin.PRIOR)))
        for i in np.flatnonzero(~is_live).tolist():
            texts[i] = self._reason(i, Trust(int(status[i])), texts[i], now, (known[i], old[i], outside[i], unknown[i]))
        return value, std, origin, tuple(texts)

    def _doubts(self, now: int, condition: Array) -> tuple[Bools, Bools, Bools]:
        """Of which parameters (n,) there is a good value, which is too old, and which was learnt too far away."""
        known = self._good_stamp != _NEVER
        age = (now - np.where(known, self._good_stamp, now)) / NANOSECONDS
        return known, np.abs(age) > self.rules.longest_hold, self._outside(condition)

    def _kept(self, doubts: tuple[Bools, Bools, Bools], condition: Array) -> tuple[Array, Array, Bools]:
        """Good values in a condition, or those of before the flight, with standard errors; which (n,) are good ones."""
        known, old, outside = doubts
        is_good = known & (self._status != Trust.REJECT) & ~old & ~outside
        good, good_std = self._good, self._good_std
        if self.table is not None and self._has_place:
            good, good_std = self.table.at(condition, good, good_std)
        return np.where(is_good, good, self._prior), np.where(is_good, good_std, self._prior_std), is_good

    def _outside(self, condition: Array) -> Bools:
        """Which good values (n,) were learnt too far from ``condition`` (3,); limits that are NaN limit nothing."""
        margin = np.array([self.rules.airspeed_margin, self.rules.angle_margin, self.rules.angle_margin])
        return np.any((condition < self._low - margin) | (condition > self._high + margin), axis=1)

    def _reason(self, i: int, status: Trust, text: str, now: int, found: tuple[np.bool_, ...]) -> str:
        known, old, outside, unknown = found
        if self.newest is None:
            return "no message came"
        if not known or status == Trust.REJECT:
            return f"{'rejected' if known else 'never learnt'}: {text}" if text else "never learnt"
        early = (self.newest.stamp - now) / NANOSECONDS
        if early > self.rules.silence:
            return f"the newest message is {early:g} s in the future: it is from another clock, or its stamp is wrong"
        if old:
            return "the last good value is too old"
        if outside:
            (v0, a0, b0), (v1, a1, b1) = self._low[i], self._high[i]
            angles = f"alpha {a0:.2f} to {a1:.2f}, beta {b0:.2f} to {b1:.2f} rad"
            return f"flown outside of where it was learnt: {v0:.1f} to {v1:.1f} m/s, {angles}"
        if early < -self.rules.silence:
            return "no message lately"
        if unknown and status == Trust.USE:
            return f"the flight condition is not known: {self._flown.lacking(now)}"
        return text
