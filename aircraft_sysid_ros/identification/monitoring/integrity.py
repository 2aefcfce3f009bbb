"""Checks before USE, and the way back to the last good parameters: one bad minute must not reach a controller.

At every evaluation each axis is asked whether its parameters may be believed:

- The model error of the newest second of motion, each sample predicted before it is learnt from, against what it was
  (``residuals``). Where it is ALARM times that, something is wrong: with a sensor or with the aeroplane; unless the
  error is that of parameters which were not known, as when an axis moves for the first time.
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
newest stand unless D speaks against them. Either way they are believed only where they are what was known before, or
an aeroplane of which one surface lost effect or the centre of gravity moved (``known_before``, ``isolation``); else the
axis stays at the good parameters until those predict again. While an axis is being learnt anew (``covariance_reset``)
what is published are its own values. A surface of which nothing is left is taken for one that is stuck: its axis stays
at the good parameters, and so do all others in which that surface has a term. So they do where the record of a surface
stopped to the last bit when the error rose: then only motion after it goes on says which is right.

An axis that is not held, but surely says what contradicts what was known of it, is held as well: what comes slowly
raises no error.

The monitor changes no estimator: it returns commands (``Restore``), and the facade carries them out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.expression import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, MEASURED, PREDICTED, CoefficientSample
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import least_squares
from aircraft_sysid_ros.identification.history import Checkpoints, ParameterCheckpoint, SampleHistory
from aircraft_sysid_ros.identification.monitoring.agreement import SplitHalfAgreement
from aircraft_sysid_ros.identification.monitoring.coefficient_noise import CoefficientNoise
from aircraft_sysid_ros.identification.monitoring.error_levels import NORMAL, error_levels
from aircraft_sysid_ros.identification.monitoring.hold import SURFACES, Hold, Release, Restore, held, with_holds
from aircraft_sysid_ros.identification.monitoring.isolation import (
    Explanation,
    explanations,
    noisy_records,
    wrong_gyros,
)  # fmt: skip
from aircraft_sysid_ros.identification.monitoring.known_before import SHARE, KnownBefore, cause
from aircraft_sysid_ros.identification.monitoring.news import is_news
from aircraft_sysid_ros.identification.monitoring.residuals import SPREAD, WINDOW, ResidualMonitor
from aircraft_sysid_ros.identification.monitoring.sensor_faults import CAUSES, SensorFaultDetector
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.trust import Trust, lack_of_fit

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]

#: Looks in a row that make an alarm.
LOOKS = 2
#: Learning made it worse: mean square error over that of what was known LAG [s] ago.
WORSE, LAG = 2.0, 10.0
#: Time [s] without a sign after which sensors are sound; points from SETTLED [s] on are asked which set is right.
CLEAR, SETTLED, EVIDENCE, MOST_EVIDENCE = 5.0, 2.0, 50, 100
#: Points of motion that confirm that the aeroplane has changed.
CONFIRMED = 125
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
#: Time [s] between looks at what is known, where values alone show no change.
NOTED = 5.0
#: One thing is asked for that explains the errors of so many seconds, if their mean square is so many times the usual.
EXPLAINED, LEAST_ERROR = 4.0, 3.0
#: Share of its effectiveness below which a surface is taken for stuck.
STUCK = 0.2
_TIME = CoefficientSample.TIME


def _more_precise(words: str, found: list[str]) -> str:
    """The same sign with the sensor named, if it is among those that were found; else the words as they are."""
    return next((more for more in found if more.startswith(f"{words}:")), words)


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
        self._overlap = max(2.0 * half_width / step, 1.0)
        self.noise = CoefficientNoise(aircraft, half_width)
        self.adopt(aircraft)

    def adopt(self, aircraft: Aircraft) -> None:
        """Begin anew, with another model or none learnt."""
        self.model: AerodynamicModel = aircraft.model
        self._chord_over_span = aircraft.chord / aircraft.span
        self.monitor = ResidualMonitor(self._step)
        self.agreement = SplitHalfAgreement(self.model, self._forgetting)
        self.sensors = SensorFaultDetector(aircraft)
        self.known_before = KnownBefore(aircraft.model)
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
        self.known_before.restart_clock()
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
        self._noted = -np.inf  # [s] when what is known was last remembered
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
        if self._has_known(axis, now - LAG):
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
            high = (alarming[axis] and not self._is_news(axis, begin)) or (slight[axis] and self._is_worse(axis, now))
            self._raised[axis] = self._raised[axis] + 1 if high else 0
        return np.flatnonzero(asked & (self._raised >= LOOKS)).tolist()

    def _is_news(self, axis: int, begin: float) -> bool:
        """Whether an error since ``begin`` [s] is that of what the axis did not know before."""
        if not self._has_known(axis, begin):
            return True
        past, samples = self.checkpoints.before(begin, axis), self._history.since(0)
        samples = samples[(samples[:, _TIME] > begin) & (samples[:, LEARNT + axis] > 0.0)]
        if past is None or not len(samples):
            return False
        return is_news(self.model, axis, past, samples, float(self._levels[axis]), self.monitor.usual(axis))

    def _has_known(self, axis: int, time: float) -> bool:
        """Whether anything of an axis was to be used at a time [s], or was surely known: else there is nothing to lose.

        What moves by its noise alone has parameters that are wrong, and for that reason HOLD; the first motion says so.
        """
        past, part = self.checkpoints.before(time, axis), self.model.axis_slice(AXES[axis])
        if past is None or self.known_before.is_known[part].any():
            return True
        moving = self.model.constants[axis] == 0.0
        used = [p.status == Trust.USE for p in past.found.parameters[part]]
        return bool((moving & np.array(used, np.bool_)).any())

    def _is_worse(self, axis: int, now: float) -> bool:
        """Whether what was known some time ago predicts far better."""
        past = None if self.holds[axis] is not None else self.checkpoints.before(now - LAG, axis)
        if past is None or not self._has_known(axis, now - LAG):
            return False
        times, squares = self._errors(axis, self._released[axis], EVIDENCE)
        old = self._errors(axis, self._released[axis], EVIDENCE, past.theta)[1]
        surely = DECIDES * self._overlap * self.monitor.usual(axis)[0]  # windows overlap: so many are worth one
        return len(times) == EVIDENCE and squares.mean() > WORSE * old.mean() and float(np.sum(squares - old)) > surely

    # -- holding ----------------------------------------------------------------------------------------------------

    def _hold(self, axis: int, now: float, since: float | None = None, words: str = "") -> None:
        hold = self.holds[axis]
        if hold is None:
            begin = self._uneasy_since[axis] if since is None else since
            begin = now - SPREAD * WINDOW * self._step if np.isnan(begin) else begin
            good = self.checkpoints.before(begin, axis)
            if good is not None and self.known_before.changes(good, range(axis, axis + 1)):
                good = self.known_before.of(axis)
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
        before, self._sign_words = self._sign_words, _more_precise(self._sign_words, words)
        self._last_sign = now
        for axis in range(len(AXES)):
            uneasy = self._uneasy_since[axis]
            since = now - BEFORE if np.isnan(uneasy) else min(uneasy, now - BEFORE)
            self._hold(axis, now, since, self._sign_words)
            hold = self.holds[axis]
            if hold is not None and (not hold.sensor or sure or hold.words == before):
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
            # all axes would have to go back for one
            return Release.ON if is_normal and self._is_believed(axis, hold, quiet) else None
        if not newest_better:
            return None if self._exceeds(axis, float(good.mean()), NORMAL) else Release.BACK
        hold.stuck = self._stuck(axis, hold.good)
        if hold.stuck or (hold.sensor and now - self._last_sign < SURE):
            return None
        if not is_normal and (hold.sensor or not self._is_far_better(axis, quiet, hold.good)):
            return None
        if not self._is_believed(axis, hold, quiet):
            return None
        if not is_normal:
            self.monitor.forget(axis)  # what is usual is another now
        return Release.ON

    def _is_believed(self, axis: int, hold: Hold, quiet: float) -> bool:
        """Whether the newest are what was known, or an aeroplane that lost something; else says what may be wrong."""
        newest = self.checkpoints.newest()
        assert newest is not None  # since there is a good one
        changes, best = self.known_before.changes(newest, strict=True), self._explanation(quiet)
        if not changes and (best is None or not best.is_sure or self.known_before.regain(newest)):
            return True
        if best is not None and best.is_aeroplane and not hold.sensor:
            mixed = {c.axis for c in changes if not best.touches(c.axis, c.label)}  # of what was and what is
            new = [c for c in changes if c.axis not in mixed]
            if not new or axis in mixed or len(self._errors(axis, quiet, CONFIRMED)[0]) < CONFIRMED:
                return False
            self.known_before.accept(new, newest, best.words)
            return True
        hold.sensor = True
        hold.rename(cause(changes, best))
        return False

    def _explanation(self, since: float) -> Explanation | None:
        """The one thing that best explains what came since a time [s]; None where there is no error, or no known."""
        samples = self._history.since(0)
        samples = samples[np.searchsorted(samples[:, _TIME], since, side="right") :]
        known = [None if kept is None else kept.theta for kept in map(self.known_before.of, range(len(AXES)))]
        found = explanations(
            self.model, samples, known, self.known_before.is_known, self._usual(), self._chord_over_span
        )
        return found[0] if found and found[0].before > LEAST_ERROR else None

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
        self._compare_with_before(kept)
        self.noise.note(kept, self.model)
        for axis, name in enumerate(AXES):
            if words := lack_of_fit(name, self.monitor.unexplained(axis), self.monitor.over_noise(axis)):
                self._misfits[axis] = words
                if (hold := self.holds[axis]) is not None and hold.contradicts:
                    hold.lacks = words
            if self.joint or self.holds[axis] or not self.agreement.are_apart(axis):
                continue
            part = self.model.axis_slice(name)
            std = np.sqrt(np.diag(least_squares(self.model, axis, kept.least_squares)[0].covariance))
            found = self.agreement.disagreeing(axis, std, kept.least_squares.noise_square[part])
            for j, (now, before) in found.items():
                words = f"the newest motion says {now:.3g}, what was before it {before:.3g}"
                self._disagreeing[part.start + j] = words

    def _compare_with_before(self, kept: ParameterCheckpoint) -> None:
        """Hold axes that are no more what they were known to be; remember what is known of the others."""
        is_due = not kept.time < self._noted + NOTED
        self._noted = kept.time if is_due else self._noted
        for axis in np.flatnonzero(~self._held()).tolist():
            if not is_due and not self.known_before.may_differ(axis, kept):
                continue
            changes = self.known_before.changes(kept, range(axis, axis + 1))
            if changes:
                good = self.known_before.of(axis)
                hold = Hold(kept.time, kept.time, cause(changes), good, sensor=False, high=True, contradicts=True)
                self.holds[axis] = hold
                self.count += 1
            else:
                self.known_before.note(axis, kept)
        asked = [hold for hold in self.holds if hold is not None and hold.high and not hold.stuck]
        best = self._explanation(kept.time - EXPLAINED) if asked else None
        if not asked:
            return
        since = min(hold.since for hold in asked)
        if gyros := wrong_gyros(self._sign_words, self._over_usual()):
            for hold in asked:
                hold.words = hold.words if hold.sure else gyros
        elif noisy := noisy_records(self.model, self._history.since(0), since):
            for hold in asked:
                hold.rename(noisy)
        elif best is not None and best.is_sure:
            for hold in asked:
                hold.rename(best.words)

    def _over_usual(self) -> Array:
        """Rms error of the newest second of motion of each axis over the usual (6,)."""
        return np.sqrt(self._levels / np.maximum(self._usual(), 1e-300))

    def _usual(self) -> Array:
        """Usual mean square error of each axis (6,)."""
        return np.array([self.monitor.usual(axis)[0] for axis in range(len(AXES))])

    def gated(self, found: ParameterSet, changed: Array, start: float) -> ParameterSet:
        """What is published of ``found``; ``changed`` (6,) [s] when axes changed last, ``start`` [s] of the flight."""
        parameters = list(found.parameters)
        for i, words in self._disagreeing.items():
            parameters[i] = held(parameters[i], words)
        for axis, words in self._misfits.items():
            part = self.model.axis_slice(AXES[axis])
            parameters[part] = [held(p, words) for p in parameters[part]]
        for i, (words, before) in self.known_before.changed.items():
            p = parameters[i]
            if p.status == Trust.USE and abs(p.value - before) > SHARE * abs(before):
                parameters[i] = replace(p, reason=words)
        found = replace(found, parameters=tuple(parameters))
        return with_holds(found, self.holds, self.model, changed, start)
