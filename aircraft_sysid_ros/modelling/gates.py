"""Gates before USE, and the way back to the last good set: one bad minute must not reach a controller.

Every LOOK seconds of flight each axis is asked whether its parameters may be believed:

- The model error of the newest second of motion, each point predicted before it is learnt from, against what it was
  (``change_monitor``). Where it is ALARM times that, something is wrong: with a sensor or with the aeroplane.
- The same against the error of what was known LAG seconds ago, over the same points: learning must not make it worse.
- ``sensor_signs``: where the first step contradicts its sensors, all axes are held at once. So they are where the wind
  that explains the air data leaps together with a model error.

An axis that is held has the status HOLD and the values from before the first sign (``good_sets``), while learning goes
on unseen. It comes back when there has been no sign for CLEAR seconds, and, if its error was large, when EVIDENCE
points of motion since then say which is right. With e_g the errors of the good set, e of the newest, s^2 what is usual,

    D = sum (e_g^2 - e^2) / s^2

is twice the log likelihood of the newest over the good. After a sensor the good set stands unless D speaks against it
for SURE seconds, and learning goes back to it, in all axes at once. Without any sign of a sensor the aeroplane has
changed: the newest stands unless D speaks against it. While such an axis is being learnt anew (``relearning``) what is
published are its own values. A surface of which nothing is left is taken for one that is stuck: its axis stays at the
good set, and so do all others in which that surface has a term. So they do where the record of a surface stopped to the
last bit when the error rose: then only motion after it goes on says which set is right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.expression import SIGNAL_INDEX
from aircraft_sysid_ros.modelling.change_monitor import SPREAD, WINDOW, ChangeMonitor
from aircraft_sysid_ros.modelling.consistency import NowAndBefore
from aircraft_sysid_ros.modelling.good_sets import GoodSets, KnownSet
from aircraft_sysid_ros.modelling.parameter_set import ParameterEstimate, ParameterSet, least_squares
from aircraft_sysid_ros.modelling.regression import Point
from aircraft_sysid_ros.modelling.sensor_signs import SensorSigns
from aircraft_sysid_ros.modelling.trust import Trust

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

#: Rms error over the usual and over the largest block of it: alarm (looks in a row), first sign, and normal again.
ALARM, LOOKS, SIGN, NORMAL = (3.0, 2.0), 2, (2.0, 1.3), (2.0, 1.3)
#: Learning made it worse: mean square error over that of what was known LAG [s] ago.
WORSE, LAG = 2.0, 10.0
#: Time [s] without a sign after which sensors are sound; points from SETTLED [s] on are asked which set is right.
CLEAR, SETTLED, EVIDENCE, MOST_EVIDENCE = 5.0, 2.0, 50, 100
#: So many are enough for newest that are WORSE times better than the good, but not as good as was usual.
LONG = 250
#: Signs that last for less time [s] than this do not make learning go back.
BRIEF = 3.0
#: Time [s] without a sign after which the newest may stand after a sensor, and for which axes wait for each other.
SURE, PATIENCE = 20.0, 30.0
#: D that decides.
DECIDES = 30.0
#: A sensor has been wrong for so long [s] before the first step says so.
BEFORE = 4.0
#: A record [rad] that moves less than this for so long [s], and stopped so near [s] to the first sign, stands still.
STILL, STILL_TIME, STILL_SINCE = 1e-6, 2.0, 3.0
#: Points [s] that are remembered.
MEMORY = 20.0
#: Share of its effectiveness below which a surface is taken for stuck.
STUCK = 0.2
SURFACES = {"de": "elevator", "da": "aileron", "dr": "rudder", "flaps": "flaps"}
_MEASURED, _PREDICTED, _LEARNT = Point.MEASURED.start, Point.PREDICTED.start, Point.LEARNT.start


@dataclass
class Hold:
    """Why an axis is held."""

    since: float  # [s] first sign
    begun: float  # [s] when it was held
    words: str
    good: KnownSet | None  # what is published; None: nothing was known before
    sensor: bool  # a sensor is suspected
    high: bool  # its error was too large
    stuck: str = ""  # a surface of which nothing is left, or whose record stands still: "de" and so on
    still: float = -np.inf  # [s] when its record was last seen to stand still
    leader: int | None = None  # the axis that found it stuck, whose end is the end of this one

    @property
    def what(self) -> str:
        """What is wrong, in words."""
        if not self.stuck:
            return self.words
        recorded = self.still > -np.inf
        surface = SURFACES[self.stuck]
        return f"the record of the {surface} stands still" if recorded else f"the {surface} is stuck or lost"


class Release(Enum):
    """How a hold ends: learning goes back to the good set, or on from what is newest."""

    BACK = 1
    ON = 2


class Gates:
    """State of all axes."""

    def __init__(self, aircraft: Aircraft, step: float, forgetting: float, joint: bool) -> None:
        """``step`` [s] between evaluations, ``forgetting`` per evaluation.

        ``joint``: a learner beside recursive least squares is published. It goes back as a whole, so that all axes are
        released together, and is compared with recursive least squares instead of that with itself.
        """
        self._step, self._forgetting, self.joint = step, forgetting, joint
        self.adopt(aircraft)

    def adopt(self, aircraft: Aircraft) -> None:
        """Begin anew, with another model or none learnt."""
        self.model: AerodynamicModel = aircraft.model
        self.monitor = ChangeMonitor(self._step)
        self.now_and_before = NowAndBefore(self.model, self._forgetting)
        self.signs = SensorSigns(aircraft)
        self.sets = GoodSets()
        self.holds: list[Hold | None] = [None] * len(AXES)
        self.count = 0  # how often axes were held
        self.restart()

    def forget_at(self, forgetting: float) -> None:
        """What is compared is forgotten at another rate, per evaluation, from now on."""
        self._forgetting = forgetting
        self.now_and_before.forget_at(forgetting)

    def restart(self) -> None:
        """The clock began anew."""
        self.signs.restart()
        self.sets.clear()
        self._waiting: list[Array] = []
        self._points = np.empty((0, Point.TERMS + len(self.model.parameter_names)))
        self._raised = np.zeros(len(AXES), np.int64)
        self._uneasy_since = np.full(len(AXES), np.nan)
        self._released = np.full(len(AXES), -np.inf)  # [s] when the newest hold of each axis ended
        self._first_sign = self._last_sign = -np.inf
        self._sign_words = ""
        self._disagreeing: dict[int, str] = {}
        for hold in self.holds:
            if hold is not None:
                hold.since, hold.begun = np.nan, -np.inf
                if hold.good is not None:
                    hold.good = hold.good.without_time()

    def take(self, points: Array) -> None:
        """New points (m, …), predicted by what is published."""
        self._waiting.append(points.copy())

    # -- looking ----------------------------------------------------------------------------------------------------

    def look(self, now: float, known: Bools) -> list[tuple[int, KnownSet]]:
        """Axes whose learning is to go back at ``now`` [s], each with the set that it goes back to.

        ``known`` axes (6,) have learnt long enough to have a usual error.
        """
        words = self.signs.look()
        self._follow(known)
        asked = known | self._held()
        high = [axis for axis in range(len(AXES)) if asked[axis] and self._is_high(axis, now)]
        if self.signs.agitated and high:
            words.append("air data and model contradict each other")
        for axis in high:
            self._hold(axis, now)
        if words:
            self._distrust(now, words)
        elif any(hold is not None and hold.sensor for hold in self.holds) and self.signs.are_too_quiet():
            self._last_sign = now
        return self._release(now)

    def note_change(self, axis: int, now: float) -> None:
        """An axis is being learnt anew since ``now`` [s], for a change of the aeroplane."""
        self.now_and_before.forget(axis)
        self._hold(axis, now)

    def _release(self, now: float) -> list[tuple[int, KnownSet]]:
        """End the holds that are to end; returns those that go back."""
        self._follow_stuck(now)
        held = {axis: hold for axis, hold in enumerate(self.holds) if hold is not None}
        ends = {axis: self._decide(axis, hold, now) for axis, hold in held.items() if hold.leader is None}
        ends |= {axis: ends.get(hold.leader, Release.BACK) for axis, hold in held.items() if hold.leader is not None}
        patient = now - self._last_sign < CLEAR + PATIENCE or self.joint
        waits = patient and any(hold.sensor and not hold.stuck and not ends[axis] for axis, hold in held.items())
        back = []
        for axis, hold in held.items():
            if ends[axis] is None or (waits and hold.sensor):
                continue
            good = hold.good if ends[axis] is Release.BACK else None
            self._end(axis, now, good)
            if good is not None:
                back.append((axis, good))
        return back

    def _follow_stuck(self, now: float) -> None:
        """Where a surface is stuck, hold the other axes that have it."""
        for leader, hold in enumerate(self.holds):
            if hold is None or not hold.stuck or hold.leader is not None:
                continue
            for axis, name in enumerate(AXES):
                if self.holds[axis] is None and hold.stuck in self.model.terms[name]:
                    good = self.sets.before(hold.since, axis)
                    follower = Hold(hold.since, now, hold.words, good, sensor=False, high=False)
                    self.holds[axis] = replace(follower, stuck=hold.stuck, still=hold.still, leader=leader)

    def _held(self) -> Bools:
        return np.array([hold is not None for hold in self.holds])

    def _follow(self, known: Bools) -> None:
        """Take what came since the last look."""
        if not self._waiting:
            return
        new, self._waiting = np.vstack(self._waiting), []
        free = known & ~self._held()
        self.monitor.add(new, free)
        for axis in np.flatnonzero(free):
            learnt = new[new[:, _LEARNT + axis] > 0.0]
            if len(learnt):
                self.now_and_before.take(int(axis), learnt)
        points = np.vstack([self._points, new])
        self._points = points[np.searchsorted(points[:, Point.TIME], points[-1, Point.TIME] - MEMORY) :]

    def _errors(self, axis: int, since: float, most: int, theta: Array | None = None) -> tuple[Array, Array]:
        """Times and squared errors of the newest points that an axis learnt from, of the newest or of ``theta``."""
        points = self._points[np.searchsorted(self._points[:, Point.TIME], since, side="right") :]
        points = points[np.flatnonzero(points[:, _LEARNT + axis] > 0.0)[-most:]]
        predicted = points[:, _PREDICTED + axis]
        if theta is not None:
            part = self.model.axis_slice(AXES[axis])
            predicted = points[:, Point.TERMS + part.start : Point.TERMS + part.stop] @ theta[part]
        return points[:, Point.TIME], (points[:, _MEASURED + axis] - predicted) ** 2

    def _level(self, axis: int, now: float) -> float:
        """Mean square error of the newest second of motion; NaN where there is none just now."""
        since = max(now - SPREAD * WINDOW * self._step, self._released[axis])
        times, squares = self._errors(axis, since, WINDOW)
        return float(squares.mean()) if len(times) == WINDOW else np.nan

    def _exceeds(self, axis: int, level: float, limits: tuple[float, float]) -> bool:
        mean, largest = self.monitor.usual(axis)
        return bool(level > limits[0] ** 2 * mean and level > limits[1] ** 2 * largest)

    def _is_high(self, axis: int, now: float) -> bool:
        """Whether the error of an axis calls for a hold; keeps since when it has been uneasy."""
        level = self._level(axis, now)
        if not self._exceeds(axis, level, SIGN):
            self._uneasy_since[axis] = np.nan
        elif np.isnan(self._uneasy_since[axis]):
            self._uneasy_since[axis] = now - SPREAD * WINDOW * self._step
        high = self._exceeds(axis, level, ALARM) or self._is_worse(axis, now, level)
        self._raised[axis] = self._raised[axis] + 1 if high else 0
        return bool(self._raised[axis] >= LOOKS)

    def _is_worse(self, axis: int, now: float, level: float) -> bool:
        """Whether what was known some time ago predicts far better."""
        if self.holds[axis] is not None or not self._exceeds(axis, level, (1.5, 1.0)):
            return False
        past = self.sets.before(now - LAG, axis)
        if past is None:
            return False
        times, squares = self._errors(axis, self._released[axis], EVIDENCE)
        old = self._errors(axis, self._released[axis], EVIDENCE, past.theta)[1]
        return bool(len(times) == EVIDENCE and squares.mean() > WORSE * old.mean())

    # -- holding ----------------------------------------------------------------------------------------------------

    def _hold(self, axis: int, now: float, since: float | None = None, words: str = "") -> None:
        hold = self.holds[axis]
        if hold is None:
            begin = self._uneasy_since[axis] if since is None else since
            begin = now - SPREAD * WINDOW * self._step if np.isnan(begin) else begin
            good = self.sets.before(begin, axis)
            self.holds[axis] = Hold(float(begin), now, words or "model error", good, bool(words), not words)
            self.count += 1
        elif not words:
            hold.high = True

    def _distrust(self, now: float, words: list[str]) -> None:
        """Hold all axes: sensors are at odds."""
        if now - self._last_sign > CLEAR:
            self._sign_words, self._first_sign = words[0], now
        self._last_sign = now
        for axis in range(len(AXES)):
            uneasy = self._uneasy_since[axis]
            since = now - BEFORE if np.isnan(uneasy) else min(uneasy, now - BEFORE)
            self._hold(axis, now, since, self._sign_words)
            hold = self.holds[axis]
            if hold is not None and not hold.sensor:
                hold.sensor, hold.words = True, self._sign_words

    def _decide(self, axis: int, hold: Hold, now: float) -> Release | None:
        """How the hold of an axis ends, None while it does not."""
        if now - self._last_sign < CLEAR:
            return None
        if not hold.high:  # a short contradiction that no axis felt spoils nothing
            return Release.ON if self._last_sign - self._first_sign < BRIEF else Release.BACK
        if not hold.sensor and self._stands_still(axis, hold):
            hold.still = now
            return None
        quiet = max(hold.begun, self._last_sign + SETTLED, hold.still + SETTLED)
        times, newest = self._errors(axis, quiet, MOST_EVIDENCE)
        if len(times) < EVIDENCE:
            return None
        is_normal = not self._exceeds(axis, float(newest[-EVIDENCE:].mean()), NORMAL)
        if hold.good is None:
            return Release.ON if is_normal else None
        good = self._errors(axis, quiet, MOST_EVIDENCE, hold.good.theta)[1]
        bar = DECIDES if hold.sensor else -DECIDES
        newest_better = float(np.sum(good - newest)) > bar * self.monitor.usual(axis)[0]
        if not newest_better and self.joint and not hold.sensor:
            return Release.ON if is_normal else None  # all axes would have to go back for one
        if not newest_better:
            return None if self._exceeds(axis, float(good.mean()), NORMAL) else Release.BACK
        hold.stuck = self._stuck(axis, hold.good)
        if hold.stuck or (hold.sensor and now - self._last_sign < SURE):
            return None
        if not is_normal and not hold.sensor and self._is_far_better(axis, quiet, hold.good):
            self.monitor.forget(axis)  # what is usual is another now
            return Release.ON
        return Release.ON if is_normal else None

    def _stands_still(self, axis: int, hold: Hold) -> bool:
        """Whether the record of a surface of the axis stopped when the trouble began, and still stands; notes which."""
        times = self._points[:, Point.TIME]
        for surface in SURFACES:
            if surface not in self.model.terms[AXES[axis]]:
                continue
            record = self._points[:, Point.SIGNALS.start + SIGNAL_INDEX[surface]]
            moved = np.flatnonzero(np.abs(record - record[-1]) > STILL)
            last = times[moved[-1]] if len(moved) else -np.inf
            began = hold.stuck == surface and hold.still > -np.inf
            if times[-1] - last > STILL_TIME and (began or abs(last - hold.since) < STILL_SINCE):
                hold.stuck = surface
                return True
        return False

    def _is_far_better(self, axis: int, since: float, good: KnownSet) -> bool:
        """Whether the newest predict clearly better than the good for long, though worse than was usual."""
        newest = self._errors(axis, since, LONG)[1]
        old = self._errors(axis, since, LONG, good.theta)[1]
        return len(newest) == LONG and float(old.mean()) > WORSE * float(newest.mean())

    def _stuck(self, axis: int, good: KnownSet) -> str:
        """The surface of which nothing is left in an axis, or nothing."""
        newest = self.sets.newest()
        assert newest is not None  # since there is a good one
        for i in range(*self.model.axis_slice(AXES[axis]).indices(len(good.theta))):
            surface = self.model.parameter_names[i].partition("_")[2]
            before, now = good.found.parameters[i], newest.found.parameters[i]
            known = before.status == Trust.USE and now.std < 0.25 * abs(before.value)
            if surface in SURFACES and known and now.value * np.sign(before.value) < STUCK * abs(before.value):
                return surface
        return ""

    def _end(self, axis: int, now: float, good: KnownSet | None) -> None:
        self.holds[axis], self._released[axis] = None, now
        self._raised[axis], self._uneasy_since[axis] = 0, np.nan
        self.sets.begin_anew(axis, now, good or self.sets.newest())
        self.now_and_before.forget(axis)
        self.monitor.skip(axis)

    # -- what is published ------------------------------------------------------------------------------------------

    def summary(self) -> dict[str, Any]:
        """For the diagnostics: axes that are held, why, and how often axes were."""
        held = {AXES[axis]: hold.what for axis, hold in enumerate(self.holds) if hold is not None}
        words = ", ".join(sorted(set(held.values())))
        return {"holds": self.count, "held": f"{' '.join(held)}: {words}" if held else ""}

    def keep(self, kept: KnownSet) -> None:
        """What is known now; whether now and before agree is looked at, too."""
        self.sets.keep(kept)
        self._disagreeing = {}
        for axis, name in enumerate(AXES):
            if self.joint or self.holds[axis] or not self.now_and_before.are_apart(axis):
                continue
            part = self.model.axis_slice(name)
            std = np.sqrt(np.diag(least_squares(self.model, axis, kept.learning)[0].covariance))
            found = self.now_and_before.disagreeing(axis, std, kept.learning.noise_square[part])
            for j, (now, before) in found.items():
                words = f"the newest motion says {now:.3g}, what was before it {before:.3g}"
                self._disagreeing[part.start + j] = words

    def gated(self, found: ParameterSet, changed: Array, start: float) -> ParameterSet:
        """What is published of ``found``; ``changed`` (6,) [s] when axes changed last, ``start`` [s] of the flight."""
        parameters, covariance = list(found.parameters), found.covariance.copy()
        for i, words in self._disagreeing.items():
            parameters[i] = held(parameters[i], words)
        found = replace(found, parameters=())
        for axis in np.flatnonzero(self._held()).tolist():
            hold, part = self.holds[axis], self.model.axis_slice(AXES[axis])
            assert hold is not None
            words = f"{hold.what} since {hold.since - start:.1f} s"
            if changed[axis] > hold.since - 1.0 and not (hold.sensor or hold.stuck):
                parameters[part] = [held(p, words) for p in parameters[part]]
                continue
            parameters[part] = rolled_back(parameters[part], part, hold.good, found.time, words)
            covariance[part, part] = np.nan if hold.good is None else hold.good.found.covariance[part, part]
            if hold.sensor and hold.good is not None:
                was = hold.good.found
                found = replace(found, airspeed=was.airspeed, alpha=was.alpha, beta=was.beta)
        return replace(found, parameters=tuple(parameters), covariance=covariance)


def held(estimate: ParameterEstimate, words: str) -> ParameterEstimate:
    """HOLD instead of USE."""
    return replace(estimate, status=Trust.HOLD, reason=words) if estimate.status == Trust.USE else estimate


def rolled_back(
    newest: list[ParameterEstimate], part: slice, good: KnownSet | None, now: float, words: str
) -> list[ParameterEstimate]:
    """Parameters of one axis as they were in the good set, not known where there is none; never USE."""
    if good is None:
        nan = float("nan")
        words += ", nothing was known before"
        return [ParameterEstimate(p.name, nan, nan, Trust.HOLD, words, nan, p.excitation) for p in newest]
    words += ": the values are those from before it"
    elapsed = now - good.found.time
    return [held(replace(p, age=p.age + elapsed), words) for p in good.found.parameters[part]]
