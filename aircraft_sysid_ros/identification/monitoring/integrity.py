"""Checks before USE, and the way back to the last good parameters: one bad minute must not reach a controller.

At every evaluation each axis is asked whether its parameters may be believed:

- The model error of the newest second of motion, each sample predicted before it is learnt from, against what it was
  (``residuals``). Where it is ALARM times that, something is wrong: with a sensor or with the aeroplane.
- The same against the error of what was known LAG seconds ago, over the same samples: learning must not make it worse.
- The error over the spread of the coefficient (``residuals.unexplained``): a model that explains less than three
  quarters of its variance lacks something, for which its parameters then stand. The axis goes on learning, with HOLD.
  So it does where the error is BEYOND_NOISE times what noise makes of it (``coefficient_noise``).
- ``sensor_faults``: where the first step contradicts its sensors, all axes are held at once. So they are where the wind
  that explains the air data leaps together with a model error.

An axis that is held has the status HOLD and the values from before the first sign (a checkpoint of ``history``), while
learning goes on unseen. It comes back when there has been no sign for CLEAR seconds, and, if its error was large, when
EVIDENCE samples of motion since then say which is right. With e_g the errors of the good checkpoint, e of the newest,
s^2 what is usual,

    D = sum (e_g^2 - e^2) / s^2

is twice the log likelihood of the newest over the good. After a sensor the good parameters stand unless D speaks
against them for SURE seconds, and learning goes back to them, in all axes at once. Without any sign of a sensor the
aeroplane has changed: the newest stand unless D speaks against them. While such an axis is being learnt anew
(``covariance_reset``) what is published are its own values. A surface of which nothing is left is taken for one that is
stuck: its axis stays at the good parameters, and so do all others in which that surface has a term. So they do where
the record of a surface stopped to the last bit when the error rose: then only motion after it goes on says which is
right.

The monitor changes no estimator: it returns commands (``Restore``), and the facade carries them out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.expression import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, MEASURED, PREDICTED, CoefficientSample
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import least_squares
from aircraft_sysid_ros.identification.history import Checkpoints, ParameterCheckpoint, SampleHistory
from aircraft_sysid_ros.identification.monitoring.agreement import SplitHalfAgreement
from aircraft_sysid_ros.identification.monitoring.coefficient_noise import CoefficientNoise
from aircraft_sysid_ros.identification.monitoring.residuals import SPREAD, WINDOW, ResidualMonitor, Summary
from aircraft_sysid_ros.identification.monitoring.sensor_faults import CAUSES, SensorFaultDetector
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate, ParameterSet
from aircraft_sysid_ros.identification.trust import Trust, lack_of_fit

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]

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
#: Share of its effectiveness below which a surface is taken for stuck.
STUCK = 0.2
SURFACES = {"de": "elevator", "da": "aileron", "dr": "rudder", "flaps": "flaps"}
_TIME = CoefficientSample.TIME
#: Errors above these many times the usual, as of a slight unease.
_SLIGHT = (1.5, 1.0)


@njit(cache=True)
def _exceeds(level: float, usual: float, largest: float, common: float, limits: tuple[float, float]) -> bool:
    """Whether a mean square error is above what is usual and above the largest block, by factors of the rms."""
    return level > limits[0] ** 2 * (common * usual) and level > limits[1] ** 2 * (common * largest)


@njit(cache=True)
def error_levels(samples: Array, since: Array, summary: Summary, levels: Array, flags: Bools) -> None:
    """Mean square error of the newest WINDOW samples of motion of each axis, and what it says.

    samples (n, …) ascending; ``since`` (6,) [s] from when they count; ``levels`` (6,) NaN where there are too few;
    ``flags`` (6, 3): above SIGN, above ALARM, above the slight unease at which older parameters are compared.
    """
    common = summary.common[0]
    for axis in range(6):
        total, count = 0.0, 0
        for i in range(len(samples) - 1, -1, -1):
            if not samples[i, _TIME] > since[axis] or count == WINDOW:
                break
            if samples[i, LEARNT + axis] > 0.0:
                total += (samples[i, MEASURED + axis] - samples[i, PREDICTED + axis]) ** 2
                count += 1
        levels[axis] = total / WINDOW if count == WINDOW else np.nan
        usual, largest = summary.usual[axis, 0], summary.usual[axis, 1]
        flags[axis, 0] = _exceeds(levels[axis], usual, largest, common, SIGN)
        flags[axis, 1] = _exceeds(levels[axis], usual, largest, common, ALARM)
        flags[axis, 2] = _exceeds(levels[axis], usual, largest, common, _SLIGHT)


@dataclass
class Hold:
    """Why an axis is held."""

    since: float  # [s] first sign
    begun: float  # [s] when it was held
    words: str
    good: ParameterCheckpoint | None  # what is published; None: nothing was known before
    sensor: bool  # a sensor is suspected
    high: bool  # its error was too large
    stuck: str = ""  # a surface of which nothing is left, or whose record stands still: "de" and so on
    still: float = -np.inf  # [s] when its record was last seen to stand still
    sure: bool = False  # the words say which sensor it is
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


class Restore(NamedTuple):
    """Command: an axis is to know again what it knew at a checkpoint, and nothing of what came since."""

    axis: int
    checkpoint: ParameterCheckpoint


class IntegrityMonitor:
    """State of all axes."""

    def __init__(
        self, aircraft: Aircraft, step: float, half_width: float, forgetting: float, joint: bool, history: SampleHistory
    ) -> None:
        """``step`` [s] between evaluations, ``half_width`` [s] of their windows, ``forgetting`` per evaluation.

        ``joint``: the published estimator goes back as a whole, so that all axes are released together, and is compared
        with recursive least squares instead of that with itself.
        """
        self._step, self._forgetting, self.joint, self._history = step, forgetting, joint, history
        self.noise = CoefficientNoise(aircraft, half_width)
        self.adopt(aircraft)

    def adopt(self, aircraft: Aircraft) -> None:
        """Begin anew, with another model or none learnt."""
        self.model: AerodynamicModel = aircraft.model
        self.monitor = ResidualMonitor(self._step)
        self.agreement = SplitHalfAgreement(self.model, self._forgetting)
        self.sensors = SensorFaultDetector(aircraft)
        self.checkpoints = Checkpoints()
        self.holds: list[Hold | None] = [None] * len(AXES)
        self.count = 0  # how often axes were held
        self.restart()

    def forget_at(self, forgetting: float) -> None:
        """What is compared is forgotten at another rate, per evaluation, from now on."""
        self._forgetting = forgetting
        self.agreement.forget_at(forgetting)

    def restart(self) -> None:
        """The clock began anew."""
        self.sensors.restart()
        self.checkpoints.clear()
        self._seen = self._history.count
        self._raised = np.zeros(len(AXES), np.int64)
        self._uneasy_since = np.full(len(AXES), np.nan)
        self._released = np.full(len(AXES), -np.inf)  # [s] when the newest hold of each axis ended
        self._levels, self._flags = np.full(len(AXES), np.nan), np.zeros((len(AXES), 3), np.bool_)
        self._first_sign = self._last_sign = -np.inf
        self._sign_words = ""
        self._disagreeing: dict[int, str] = {}
        self._misfits: dict[int, str] = {}
        for hold in self.holds:
            if hold is not None:
                hold.since, hold.begun = np.nan, -np.inf
                if hold.good is not None:
                    hold.good = hold.good.without_time()

    # -- evaluation -------------------------------------------------------------------------------------------------

    def evaluate(self, now: float, known: Bools, misread: Sequence[str] = ()) -> list[Restore]:
        """Axes that are to go back at ``now`` [s], as commands.

        ``known`` axes (6,) have learnt long enough to have a usual error; ``misread``: what is wrong with controls.
        """
        words = [*self.sensors.evaluate(), *misread]
        self._follow(known)
        high = self._high_axes(now, known | self._held())
        if self.sensors.agitated and high:
            words.append("air data and model contradict each other")
        for axis in high:
            self._hold(axis, now)
        if words:
            self._distrust(now, words, sure=bool(misread) or words[-1] in CAUSES)
        elif any(hold is not None and hold.sensor for hold in self.holds) and self.sensors.are_too_quiet():
            self._last_sign = now
        return self._release(now) if any(self.holds) else []

    def note_change(self, axis: int, now: float) -> None:
        """An axis is being learnt anew since ``now`` [s], for a change of the aeroplane."""
        self.agreement.forget(axis)
        self._hold(axis, now)

    def _release(self, now: float) -> list[Restore]:
        """End the holds that are to end; returns those that go back."""
        self._follow_stuck(now)
        held = {axis: hold for axis, hold in enumerate(self.holds) if hold is not None}
        ends = {axis: self._decide(axis, hold, now) for axis, hold in held.items() if hold.leader is None}
        ends |= {axis: ends.get(hold.leader, Release.BACK) for axis, hold in held.items() if hold.leader is not None}
        patient = now - self._last_sign < CLEAR + PATIENCE or self.joint
        waits = patient and any(hold.sensor and not hold.stuck and not ends[axis] for axis, hold in held.items())
        restores = []
        for axis, hold in held.items():
            if ends[axis] is None or (waits and hold.sensor):
                continue
            good = hold.good if ends[axis] is Release.BACK else None
            self._end(axis, now, good)
            if good is not None:
                restores.append(Restore(axis, good))
        return restores

    def _follow_stuck(self, now: float) -> None:
        """Where a surface is stuck, hold the other axes that have it."""
        for leader, hold in enumerate(self.holds):
            if hold is None or not hold.stuck or hold.leader is not None:
                continue
            for axis, name in enumerate(AXES):
                if self.holds[axis] is None and hold.stuck in self.model.terms[name]:
                    good = self.checkpoints.before(hold.since, axis)
                    follower = Hold(hold.since, now, hold.words, good, sensor=False, high=False)
                    self.holds[axis] = replace(follower, stuck=hold.stuck, still=hold.still, leader=leader)

    def _held(self) -> Bools:
        return np.array([hold is not None for hold in self.holds])

    def _follow(self, known: Bools) -> None:
        """Take what came since the last evaluation."""
        first, self._seen = self._seen, self._history.count
        if self._seen == first:
            return
        new, free = self._history.since(first), known & ~self._held()
        noise = self.noise.variances(new, self._history.weights(first))
        self.monitor.add(new, new[:, CoefficientSample.PREDICTED], free, noise)
        self.agreement.add(free, new)

    def _errors(self, axis: int, since: float, most: int, theta: Array | None = None) -> tuple[Array, Array]:
        """Times and squared errors of the newest samples that an axis learnt from, of the newest or of ``theta``."""
        samples = self._history.since(0)
        samples = samples[np.searchsorted(samples[:, _TIME], since, side="right") :]
        samples = samples[np.flatnonzero(samples[:, LEARNT + axis] > 0.0)[-most:]]
        predicted = samples[:, PREDICTED + axis]
        if theta is not None:
            part = self.model.axis_slice(AXES[axis])
            terms = slice(CoefficientSample.TERMS + part.start, CoefficientSample.TERMS + part.stop)
            predicted = samples[:, terms] @ theta[part]
        return samples[:, _TIME], (samples[:, MEASURED + axis] - predicted) ** 2

    def _exceeds(self, axis: int, level: float, limits: tuple[float, float]) -> bool:
        mean, largest = self.monitor.usual(axis)
        return bool(level > limits[0] ** 2 * mean and level > limits[1] ** 2 * largest)

    def _high_axes(self, now: float, asked: Bools) -> list[int]:
        """Axes whose error calls for a hold; keeps since when each has been uneasy."""
        begin = now - SPREAD * WINDOW * self._step
        error_levels(
            self._history.since(0), np.maximum(begin, self._released), self.monitor.summary, self._levels, self._flags
        )
        if not self._flags.any():
            self._uneasy_since[asked], self._raised[asked] = np.nan, 0
            return []
        uneasy, alarming, slight = self._flags.T
        for axis in np.flatnonzero(asked).tolist():
            if not uneasy[axis]:
                self._uneasy_since[axis] = np.nan
            elif np.isnan(self._uneasy_since[axis]):
                self._uneasy_since[axis] = begin
            high = alarming[axis] or (slight[axis] and self._is_worse(axis, now))
            self._raised[axis] = self._raised[axis] + 1 if high else 0
        return np.flatnonzero(asked & (self._raised >= LOOKS)).tolist()

    def _is_worse(self, axis: int, now: float) -> bool:
        """Whether what was known some time ago predicts far better."""
        past = None if self.holds[axis] is not None else self.checkpoints.before(now - LAG, axis)
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
            good = self.checkpoints.before(begin, axis)
            self.holds[axis] = Hold(float(begin), now, words or "model error", good, bool(words), not words)
            self.count += 1
        elif not words:
            hold.high = True

    def _distrust(self, now: float, words: list[str], sure: bool) -> None:
        """Hold all axes: sensors are at odds; ``sure``: the last of the words say which one."""
        if now - self._last_sign > CLEAR:
            self._sign_words, self._first_sign = words[0], now
        if sure:
            self._sign_words = words[-1]
        self._last_sign = now
        for axis in range(len(AXES)):
            uneasy = self._uneasy_since[axis]
            since = now - BEFORE if np.isnan(uneasy) else min(uneasy, now - BEFORE)
            self._hold(axis, now, since, self._sign_words)
            hold = self.holds[axis]
            if hold is not None and (not hold.sensor or sure):
                hold.sensor, hold.words, hold.sure = True, self._sign_words, sure

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
        samples = self._history.since(0)
        times = samples[:, _TIME]
        for surface in SURFACES if len(samples) else ():  # none yet after a restart
            if surface not in self.model.terms[AXES[axis]]:
                continue
            record = samples[:, CoefficientSample.SIGNALS.start + SIGNAL_INDEX[surface]]
            moved = np.flatnonzero(np.abs(record - record[-1]) > STILL)
            last = times[moved[-1]] if len(moved) else -np.inf
            began = hold.stuck == surface and hold.still > -np.inf
            if times[-1] - last > STILL_TIME and (began or abs(last - hold.since) < STILL_SINCE):
                hold.stuck = surface
                return True
        return False

    def _is_far_better(self, axis: int, since: float, good: ParameterCheckpoint) -> bool:
        """Whether the newest predict clearly better than the good for long, though worse than was usual."""
        newest = self._errors(axis, since, LONG)[1]
        old = self._errors(axis, since, LONG, good.theta)[1]
        return len(newest) == LONG and float(old.mean()) > WORSE * float(newest.mean())

    def _stuck(self, axis: int, good: ParameterCheckpoint) -> str:
        """The surface of which nothing is left in an axis, or nothing."""
        newest = self.checkpoints.newest()
        assert newest is not None  # since there is a good one
        for i in range(*self.model.axis_slice(AXES[axis]).indices(len(good.theta))):
            surface = self.model.parameter_names[i].partition("_")[2]
            before, now = good.found.parameters[i], newest.found.parameters[i]
            known = before.status == Trust.USE and now.std < 0.25 * abs(before.value)
            if surface in SURFACES and known and now.value * np.sign(before.value) < STUCK * abs(before.value):
                return surface
        return ""

    def _end(self, axis: int, now: float, good: ParameterCheckpoint | None) -> None:
        self.holds[axis], self._released[axis] = None, now
        self._raised[axis], self._uneasy_since[axis] = 0, np.nan
        self.checkpoints.begin_anew(axis, now, good or self.checkpoints.newest())
        self.agreement.forget(axis)
        self.monitor.skip(axis)

    # -- what is published ------------------------------------------------------------------------------------------

    def summary(self) -> dict[str, Any]:
        """For the diagnostics: axes that are held, why, and how often axes were."""
        held = {AXES[axis]: hold.what for axis, hold in enumerate(self.holds) if hold is not None}
        words = ", ".join(sorted(set(held.values())))
        return {"holds": self.count, "held": f"{' '.join(held)}: {words}" if held else ""}

    def keep(self, kept: ParameterCheckpoint) -> None:
        """What is known now; whether it explains the coefficients, and agrees with before, is looked at, too."""
        self.checkpoints.keep(kept)
        self._disagreeing, self._misfits = {}, {}
        self.noise.note(kept, self.model)
        for axis, name in enumerate(AXES):
            if words := lack_of_fit(name, self.monitor.unexplained(axis), self.monitor.over_noise(axis)):
                self._misfits[axis] = words
            if self.joint or self.holds[axis] or not self.agreement.are_apart(axis):
                continue
            part = self.model.axis_slice(name)
            std = np.sqrt(np.diag(least_squares(self.model, axis, kept.least_squares)[0].covariance))
            found = self.agreement.disagreeing(axis, std, kept.least_squares.noise_square[part])
            for j, (now, before) in found.items():
                words = f"the newest motion says {now:.3g}, what was before it {before:.3g}"
                self._disagreeing[part.start + j] = words

    def gated(self, found: ParameterSet, changed: Array, start: float) -> ParameterSet:
        """What is published of ``found``; ``changed`` (6,) [s] when axes changed last, ``start`` [s] of the flight."""
        parameters, covariance = list(found.parameters), found.covariance.copy()
        for i, words in self._disagreeing.items():
            parameters[i] = held(parameters[i], words)
        for axis, words in self._misfits.items():
            part = self.model.axis_slice(AXES[axis])
            parameters[part] = [held(p, words) for p in parameters[part]]
        found = replace(found, parameters=())
        for axis in np.flatnonzero(self._held()).tolist():
            hold, part = self.holds[axis], self.model.axis_slice(AXES[axis])
            assert hold is not None
            words = f"{hold.what} since {max(hold.since - start, 0.0):.1f} s"
            if changed[axis] > hold.since - 1.0 and not (hold.sensor or hold.stuck):
                parameters[part] = [held(p, words) for p in parameters[part]]
                continue
            parameters[part] = rolled_back(parameters[part], part, hold.good, found.time, words)
            if hold.sure:
                parameters[part] = [replace(p, status=Trust.HOLD, reason=words) for p in parameters[part]]
            covariance[part, part] = np.nan if hold.good is None else hold.good.found.covariance[part, part]
            if hold.sensor and hold.good is not None:
                was = hold.good.found
                found = replace(found, airspeed=was.airspeed, alpha=was.alpha, beta=was.beta)
        return replace(found, parameters=tuple(parameters), covariance=covariance)


def held(estimate: ParameterEstimate, words: str) -> ParameterEstimate:
    """HOLD instead of USE."""
    return replace(estimate, status=Trust.HOLD, reason=words) if estimate.status == Trust.USE else estimate


def rolled_back(
    newest: list[ParameterEstimate], part: slice, good: ParameterCheckpoint | None, now: float, words: str
) -> list[ParameterEstimate]:
    """Parameters of one axis as they were in the good set, not known where there is none; never USE."""
    if good is None:
        nan = float("nan")
        words += ", nothing was known before"
        return [ParameterEstimate(p.name, nan, nan, Trust.HOLD, words, nan, p.excitation) for p in newest]
    words += ": the values are those from before it"
    elapsed = now - good.found.time
    return [held(replace(p, age=p.age + elapsed), words) for p in good.found.parameters[part]]
