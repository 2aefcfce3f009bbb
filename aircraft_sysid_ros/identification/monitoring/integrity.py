"""Checks before USE, and the way back to the last good parameters: one bad minute must not reach a controller.

At every evaluation each axis is asked whether its parameters may be believed:

- The model error of the newest second of motion against what it was, and against the error of what was known some time
  ago (``error_watch``). Where it is too large, something is wrong: with a sensor or with the aeroplane.
- Whether the model explains the coefficient, and agrees with what was known before (``doubts``): if not, the axis goes
  on learning, with HOLD.
- ``sensor_faults``: where the first step contradicts its sensors, all axes are held at once. So they are where the wind
  that explains the air data leaps together with a model error.

An axis that is held has the status HOLD and the values from before the first sign (a checkpoint of ``history``), while
learning goes on unseen, until ``hold_end`` says how that ends. While an axis is being learnt anew
(``covariance_reset``) what is published are its own values.

An axis that is not held, but surely says what contradicts what was known of it, is held as well: what comes slowly
raises no error.

The monitor changes no estimator: it returns commands (``Restore``), and the facade carries them out.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.history import Carry, Checkpoints, ParameterCheckpoint, SampleHistory
from aircraft_sysid_ros.identification.monitoring.coefficient_noise import CoefficientNoise
from aircraft_sysid_ros.identification.monitoring.doubts import OF_LIFT, Doubts
from aircraft_sysid_ros.identification.monitoring.error_watch import ErrorWatch
from aircraft_sysid_ros.identification.monitoring.hold import Hold, Release, Restore, with_holds
from aircraft_sysid_ros.identification.monitoring.hold_end import HoldEnd, Signs
from aircraft_sysid_ros.identification.monitoring.isolation import noisy_records, wrong_gyros
from aircraft_sysid_ros.identification.monitoring.known_before import KnownBefore, cause
from aircraft_sysid_ros.identification.monitoring.sensor_faults import CAUSES, LOST, SensorFaultDetector, Sign
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.reconstruction.state_row import SENSOR_TIMEOUT

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

#: Time [s] between looks at what is known, where values alone show no change.
NOTED = 5.0


def _more_precise(sign: Sign, found: list[Sign]) -> Sign:
    """The same sign with the sensor named, if it is among those that were found; else as it is."""
    return sign if sign.suspect else next((more for more in found if more.what == sign.what), sign)


class IntegrityMonitor:
    """State of all axes."""

    def __init__(
        self, aircraft: Aircraft, step: float, half_width: float, forgetting: float, joint: bool, history: SampleHistory
    ) -> None:
        """``step`` [s] between evaluations, ``half_width`` [s] of their windows, ``forgetting`` per evaluation.

        ``joint``: the published estimator goes back as a whole, so that all axes are released together, and is compared
        with recursive least squares instead of that with itself.
        """
        self._step, self._half_width, self._forgetting = step, half_width, forgetting
        self.joint, self._history = joint, history
        self.noise = CoefficientNoise(aircraft, half_width)
        self._signs = Signs()
        self.adopt(aircraft)

    def adopt(self, aircraft: Aircraft) -> None:
        """Start over, with another model or none learnt."""
        self.model: AerodynamicModel = aircraft.model
        self.sensors = SensorFaultDetector(aircraft)
        self.known_before = KnownBefore(aircraft.model)
        self.checkpoints = Checkpoints()
        self.errors = ErrorWatch(
            aircraft, self._step, self._half_width, self._history, self.checkpoints, self.known_before
        )
        self.doubts = Doubts(aircraft.model, self.errors.monitor, self._forgetting)
        self._end = HoldEnd(aircraft.model, self._history, self.checkpoints, self.known_before, self.errors)
        self.holds: list[Hold | None] = [None] * len(AXES)
        self.count = 0  # how often axes were held
        self.restart()

    def change_model(self, aircraft: Aircraft, carry: Carry | None) -> None:
        """Go on with another model: what was known before is ``carry`` of it, what is wrong with sensors still is, and
        axes whose terms stay are explained as little as they were.

        Without ``carry`` nothing was known before.
        """
        sensors, signs, count, before = self.sensors, self._signs, self.count, self.checkpoints
        of_sensors = [hold if hold is not None and hold.sensor else None for hold in self.holds]
        lacked = self.doubts.of_other_terms(aircraft.model)
        self.adopt(aircraft)
        self.doubts.remember(lacked)
        self.sensors, self._signs, self.count = sensors, signs, count
        if carry is not None:
            self.checkpoints.go_on(before, carry)
        goods = [carry(hold.good) if hold and hold.good and carry else None for hold in of_sensors]
        self.holds = [hold and replace(hold, good=good) for hold, good in zip(of_sensors, goods, strict=True)]

    def know(self, kept: ParameterCheckpoint) -> None:
        """Something was known before the first sample: what is published while sensors are wrong from then on."""
        for axis in range(len(AXES)):
            self.checkpoints.begin_anew(axis, -np.inf, kept)

    def forget_at(self, forgetting: float) -> None:
        """What is compared is forgotten at another rate, per evaluation, from now on."""
        self._forgetting = forgetting
        self.doubts.agreement.forget_at(forgetting)

    def restart(self) -> None:
        """The clock started over."""
        self.sensors.restart()
        self.known_before.restart_clock()
        self.checkpoints.clear()
        self.errors.restart()
        self.doubts.restart()
        self._seen = self._history.count
        self._signs = Signs()
        self._noted = -np.inf  # [s] when what is known was last remembered
        self._before: dict[int, ParameterCheckpoint] = {}  # what was good before a hold that ended with the newest
        for hold in self.holds:
            if hold is not None:
                hold.restart_clock()

    # -- evaluation -------------------------------------------------------------------------------------------------

    def evaluate(self, now: float, known: Bools, misread: Sequence[str] = ()) -> list[Restore]:
        """Axes that are to go back at ``now`` [s], as commands.

        ``known`` axes (6,) have learnt long enough to have a usual error; ``misread``: what is wrong with controls.
        """
        signs = [*self.sensors.evaluate(), *map(Sign, misread)]
        held = self._held()
        self._follow(known & ~held)
        high = self.errors.high_axes(now, known, held)
        if self.sensors.agitated and high:
            signs.append(Sign("air data and model contradict each other"))
        for axis in high:
            self._hold(axis, now)
        if signs:
            self._distrust(now, signs, sure=bool(misread) or signs[-1].what in CAUSES)
        elif any(hold is not None and hold.sensor for hold in self.holds) and self.sensors.are_too_quiet():
            self._signs.last = now
        return self._release(now) if any(self.holds) else []

    def was_known(self, axis: int, now: float) -> bool:
        """Whether anything of an axis was to be used, or was surely known, some time before ``now`` [s]."""
        return self.errors.has_known(axis, now - THRESHOLDS.worse_since)

    def note_change(self, axis: int, now: float, is_news: bool) -> None:
        """An axis is being learnt anew since ``now`` [s], for a change of the aeroplane, or for ``is_news``: nothing of
        it was known."""
        self.doubts.forget(axis, goes_back=not is_news)  # it may, until the hold ends
        if not is_news:
            self._hold(axis, now)
        elif self.holds[axis] is None and not self.joint:  # usual errors are those of an axis that hardly moved
            self.errors.monitor.forget(axis)

    def _held(self) -> Bools:
        return np.array([hold is not None for hold in self.holds])

    def _follow(self, free: Bools) -> None:
        """Take what came since the last evaluation, for the axes (6,) that are known and free."""
        first, self._seen = self._seen, self._history.count
        if self._seen == first:
            return
        new = self._history.since(first)
        noise = self.noise.variances(new, self._history.weights(first))
        self.errors.monitor.add(new, new[:, CoefficientSample.PREDICTED], free, noise)
        self.doubts.add(free, new)

    # -- holding ----------------------------------------------------------------------------------------------------

    def _hold(self, axis: int, now: float, since: float | None = None, sign: Sign | None = None) -> None:
        hold = self.holds[axis]
        if hold is None:
            begin = self.errors.uneasy_since(axis) if since is None else since
            begin = self.errors.begin(now) if np.isnan(begin) else begin
            good = self.checkpoints.before(begin, axis)
            if good is not None and self.known_before.changes(good, range(axis, axis + 1)):
                good = self.known_before.of(axis)
            is_sensor = sign is not None
            hold = Hold(float(begin), now, sign.words if sign else "model error", good, is_sensor, high=not is_sensor)
            hold.told = sign is not None and sign.tells_sensor
            self.holds[axis] = hold
            self.count += 1
        elif sign is None:
            hold.high = True

    def _distrust(self, now: float, found: list[Sign], sure: bool) -> None:
        """Hold all axes: sensors are at odds; ``sure``: the last of the signs says which one."""
        signs = self._signs
        if now - signs.last > THRESHOLDS.clear:
            signs.newest, signs.first = found[0], now
        if sure:
            signs.newest = found[-1]
        before, signs.newest = signs.newest, _more_precise(signs.newest, found)
        signs.last = now
        for axis in range(len(AXES)):
            uneasy = self.errors.uneasy_since(axis)
            since = now - THRESHOLDS.before_sign if np.isnan(uneasy) else min(uneasy, now - THRESHOLDS.before_sign)
            self._hold(axis, now, since, signs.newest)
            hold = self.holds[axis]
            if hold is not None and (not hold.sensor or sure or hold.words == before.words):
                hold.sensor, hold.words, hold.sure = True, signs.newest.words, sure
                hold.told = signs.newest.tells_sensor
            if hold is not None and hold.words in LOST and np.isnan(hold.last_heard):
                hold.last_heard = now - SENSOR_TIMEOUT

    def _release(self, now: float) -> list[Restore]:
        """End the holds that are to end; returns those that go back."""
        self._follow_stuck(now)
        self._follow_lift(now)
        held = {axis: hold for axis, hold in enumerate(self.holds) if hold is not None}
        ends = {
            axis: self._end.decide(axis, hold, now, self._signs, self.joint)
            for axis, hold in held.items()
            if hold.leader is None
        }
        ends |= {axis: ends.get(hold.leader, Release.BACK) for axis, hold in held.items() if hold.leader is not None}
        patient = now - self._signs.last < THRESHOLDS.clear + THRESHOLDS.patience or self.joint
        waits = patient and any(hold.sensor and not hold.stuck and not ends[axis] for axis, hold in held.items())
        restores = []
        for axis, hold in held.items():
            if ends[axis] is None or (waits and hold.sensor):
                continue
            good = hold.good if ends[axis] is Release.BACK else None
            self._let_go(axis, now, good)
            self._before.pop(axis, None)
            if good is None and hold.good is not None and hold.high:
                self._before[axis] = hold.good
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

    def _follow_lift(self, now: float) -> None:
        """Hold C_X with C_Z, which is nearly all of its lift: what it learns with a wrong angle of attack is wrong, and
        may be too little for an alarm.
        """
        leader, axis = AXES.index("CZ"), AXES.index("CX")
        hold, follower = self.holds[leader], self.holds[axis]
        if hold is None or not hold.high or hold.sure or hold.leader is not None:
            return
        if follower is None and (good := self.checkpoints.before(hold.since, axis)) is not None:
            follower = Hold(hold.since, now, "", good, sensor=False, high=False, leader=leader)
            self.holds[axis] = follower
        if follower is not None and follower.leader == leader and not (follower.sensor or follower.stuck):
            follower.words = f"{OF_LIFT}{hold.what}"

    def _let_go(self, axis: int, now: float, good: ParameterCheckpoint | None) -> None:
        hold, self.holds[axis] = self.holds[axis], None
        self.checkpoints.begin_anew(axis, now, good or self.checkpoints.newest())
        self.doubts.forget(axis, goes_back=good is not None or hold is None or not hold.high)
        self.errors.end_hold(axis, now)

    # -- once a second ----------------------------------------------------------------------------------------------

    def keep(self, kept: ParameterCheckpoint) -> None:
        """What is known now; whether it explains the coefficients, and agrees with before, is looked at, too."""
        self.checkpoints.keep(kept)
        self._compare_with_before(kept)
        self._name_causes(kept.time)
        self.noise.note(kept, self.model, self.errors.monitor.fits()[:, 1].tolist())
        self.doubts.look(kept, self.holds, self.joint)

    def _compare_with_before(self, kept: ParameterCheckpoint) -> None:
        """Hold axes that are no more what they were known to be; remember what is known of the others."""
        is_due = not kept.time < self._noted + NOTED
        self._noted = kept.time if is_due else self._noted
        asked = ~self._held() & (is_due | self.known_before.may_differ(kept))
        for axis in np.flatnonzero(asked).tolist():
            changes = self.known_before.changes(kept, range(axis, axis + 1), strict=axis in self._before)
            if changes and not self.known_before.accept_alike(changes, kept):
                good = self.known_before.of(axis)
                hold = Hold(kept.time, kept.time, cause(changes), good, sensor=False, high=True, contradicts=True)
                self.holds[axis] = hold
                self.count += 1
            elif not changes:
                self.known_before.note(axis, kept)
        self._doubt_together(kept)

    def _doubt_together(self, kept: ParameterCheckpoint) -> None:
        """Hold axes whose newest values came with those of one that contradicts what was known, by a record for both.

        When all say for long (``sure`` of the thresholds) what was known, or an aeroplane that is believed, they are as
        before. Those that are held beside another do not hold others in their turn: two would keep each other held.
        """
        held = self._held()
        doubted = [hold for hold in self.holds if hold is not None and hold.contradicts and not hold.is_beside]
        for axis, good in [*self._before.items()]:
            released = self.errors.released(axis)
            if held[axis] or (not doubted and kept.time - released > THRESHOLDS.sure):
                del self._before[axis]
            elif doubted and released > doubted[0].since - THRESHOLDS.sure:
                hold = Hold(kept.time, kept.time, doubted[0].words, good, sensor=True, high=True, contradicts=True)
                self.holds[axis] = replace(hold, is_beside=True)
                self.count += 1
                del self._before[axis]

    def _name_causes(self, now: float) -> None:
        """Say of axes whose error is large what one thing explains it ``now`` [s], if one does."""
        asked = [hold for hold in self.holds if hold is not None and hold.high and not hold.stuck]
        if not asked:
            return
        best = self.errors.explanation(now - THRESHOLDS.explained_time)
        since = min(hold.since for hold in asked)
        if gyros := wrong_gyros(self._signs.newest.suspect, self.errors.over_usual()):
            for hold in asked:
                if not hold.sure:
                    hold.words, hold.told = gyros, False
        elif noisy := noisy_records(self.model, self._history.since(0), since):
            for hold in asked:
                hold.rename(noisy)
        elif best is not None and best.is_sure:
            for hold in asked:
                hold.rename(best.words)

    # -- what is published ------------------------------------------------------------------------------------------

    def summary(self) -> dict[str, Any]:
        """For the diagnostics: axes that are held, why, and how often axes were."""
        held = {AXES[axis]: hold.what for axis, hold in enumerate(self.holds) if hold is not None}
        words = ", ".join(sorted(set(held.values())))
        return {"holds": self.count, "held": f"{' '.join(held)}: {words}" if held else ""}

    def gates(self) -> Gates:
        """The gates as they are now, which nobody changes any more."""
        holds = [None if hold is None else replace(hold) for hold in self.holds]
        return Gates(self.model, copy(self.doubts), dict(self.known_before.changed), holds)

    def gated(self, found: ParameterSet, changed: Array, start: float) -> ParameterSet:
        """What is published of ``found``, see ``Gates``."""
        return Gates(self.model, self.doubts, self.known_before.changed, self.holds).gated(found, changed, start)

    def land(self, now: float, kept: ParameterCheckpoint) -> list[Restore]:
        """On the ground ``now`` [s]: all axes go back to what was ``kept`` in the air, or to what was good before."""
        self._signs = Signs()
        self._before.clear()
        restores = []
        for axis, hold in enumerate(self.holds):
            good = kept if hold is None or hold.good is None or hold.since > kept.time else hold.good
            self._let_go(axis, now, good)
            restores.append(Restore(axis, good))
        return restores


class Gates(NamedTuple):
    """What stands between an estimate and what is published of it."""

    model: AerodynamicModel
    doubts: Doubts
    was: dict[int, tuple[str, float]]  # of parameters of an aeroplane that changed: words, and what they were
    holds: list[Hold | None]

    def gated(self, found: ParameterSet, changed: Array, start: float) -> ParameterSet:
        """What is published of ``found``; ``changed`` (6,) [s] when axes changed last, ``start`` [s] of the flight."""
        parameters = self.doubts.gated(found.parameters)
        for i, (words, before) in self.was.items():
            p = parameters[i]
            if p.status == Trust.USE and abs(p.value - before) > THRESHOLDS.contradicts_share * abs(before):
                parameters[i] = replace(p, reason=words)
        found = replace(found, parameters=tuple(parameters))
        return with_holds(found, self.holds, self.model, changed, start)
