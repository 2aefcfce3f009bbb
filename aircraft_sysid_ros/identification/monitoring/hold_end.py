"""How a hold ends: learning goes back to the good parameters, on from the newest, or the axis stays held.

There must have been no sign for some seconds (``clear`` of the thresholds) and, where the error of the axis was large,
so many samples of motion since then (``evidence``), which say which set is right. With e_g the errors of the good
checkpoint, e of the newest, s^2 what is usual,

    D = sum (e_g^2 - e^2) / s^2

is twice the log likelihood of the newest over the good. After a sensor the good parameters stand unless D speaks
against them for long (``sure``), and learning goes back to them, in all axes at once. Without any sign of a sensor the
newest stand unless D speaks against them, and go back where D surely does, or where both would predict alike whatever
moves: while a surface that lost effect is not moved, they do so in all that is seen. Either way they are believed only
where they are what was known before, or an aeroplane of which one surface lost effect or the centre of gravity moved
(``known_before``, ``isolation``); else the
axis stays at the good parameters until those predict again. A surface of which nothing is left is taken for one that
is stuck: its axis stays at the good parameters, and so do all others in which that surface has a term. So they do
where the record of a surface stopped to the last bit when the error rose: then only motion after it goes on says which
is right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX, SURFACE_WORDS
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.history import Checkpoints, ParameterCheckpoint, SampleHistory
from aircraft_sysid_ros.identification.monitoring.error_watch import ErrorWatch
from aircraft_sysid_ros.identification.monitoring.hold import Hold, Release
from aircraft_sysid_ros.identification.monitoring.known_before import KnownBefore, cause
from aircraft_sysid_ros.identification.monitoring.sensor_faults import Sign
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust


@dataclass
class Signs:
    """The newest signs that sensors are at odds."""

    first: float = -np.inf  # [s]
    last: float = -np.inf  # [s]
    newest: Sign = Sign("")  # noqa: RUF009 - it is a tuple


@dataclass(frozen=True)
class HoldEnd:
    """What decides it."""

    model: AerodynamicModel
    history: SampleHistory
    checkpoints: Checkpoints
    known_before: KnownBefore
    errors: ErrorWatch

    def decide(self, axis: int, hold: Hold, now: float, signs: Signs, joint: bool) -> Release | None:
        """How the hold of an axis ends, None while it does not; ``joint``: all axes would go back for one."""
        if now - signs.last < THRESHOLDS.clear:
            return None
        if not hold.high:  # a short contradiction that no axis felt spoils nothing
            return Release.ON if signs.last - signs.first < THRESHOLDS.brief else Release.BACK
        if not hold.sensor and self._stands_still(axis, hold):
            hold.still = now
            return None
        quiet = max(hold.begun, signs.last + THRESHOLDS.settled, hold.still + THRESHOLDS.settled)
        times, newest = self.errors.of(axis, quiet, THRESHOLDS.most_evidence)
        if len(times) < THRESHOLDS.evidence:
            return None
        is_normal = not self.errors.exceeds(axis, float(newest[-THRESHOLDS.evidence :].mean()), THRESHOLDS.normal)
        if hold.good is None:
            return Release.ON if is_normal else None
        good = self.errors.of(axis, quiet, THRESHOLDS.most_evidence, hold.good.theta)[1]
        bar = THRESHOLDS.decides if hold.sensor else -THRESHOLDS.decides
        better = float(np.sum(good - newest))  # D s^2
        newest_better = better > bar * self.errors.monitor.usual(axis)[0]
        if not newest_better and joint and not hold.sensor:
            return Release.ON if is_normal and self._is_believed(axis, hold, quiet) else None
        if not newest_better:
            stays = self.errors.exceeds(axis, float(good.mean()), THRESHOLDS.normal)
            no_sign = signs.last < hold.since or np.isinf(signs.last)  # none since, nor since the clock started over
            unseen = no_sign and self._is_unseen(axis, better, len(times), hold.good)
            return None if stays or unseen else Release.BACK
        hold.stuck = self._stuck(axis, hold.good)
        if hold.stuck or (hold.sensor and now - signs.last < THRESHOLDS.sure):
            return None
        if not is_normal and (hold.sensor or not self.errors.is_far_better(axis, quiet, hold.good)):
            return None
        if not self._is_believed(axis, hold, quiet):
            return None
        if not is_normal:
            self.errors.monitor.forget(axis)  # what is usual is another now
        return Release.ON

    def _is_unseen(self, axis: int, better: float, samples: int, good: ParameterCheckpoint) -> bool:
        """Whether so many samples leave open which set is right, of two that are apart where the axis moves as it did.

        ``better``: D s^2 of the samples. A surface that lost effect may not have been moved since.
        """
        surely_good = better < -THRESHOLDS.decides * self.errors.monitor.usual(axis)[0]
        return not surely_good and not self.errors.are_alike(axis, samples, good)

    def _is_believed(self, axis: int, hold: Hold, quiet: float) -> bool:
        """Whether the newest are what was known, or an aeroplane that lost something; else says what may be wrong."""
        newest = self.checkpoints.newest()
        assert newest is not None  # since there is a good one
        changes, best = self.known_before.changes(newest, strict=True), self.errors.explanation(quiet)
        if not changes and (best is None or not best.is_sure or self.known_before.regain(newest)):
            return True
        if best is not None and best.is_aeroplane and not hold.sensor:
            mixed = {c.axis for c in changes if not best.touches(c.axis, c.label)}  # of what was and what is
            new = [c for c in changes if c.axis not in mixed]
            moved = len(self.errors.of(axis, quiet, THRESHOLDS.confirmed)[0])
            if not new or axis in mixed or moved < THRESHOLDS.confirmed:
                return False
            self.known_before.accept(new, newest, best.words)
            return True
        hold.sensor = True
        hold.rename(cause(changes, best))
        return False

    def _stands_still(self, axis: int, hold: Hold) -> bool:
        """Whether the record of a surface of the axis stopped when the trouble began, and still stands; notes which."""
        samples = self.history.since(0)
        times = samples[:, CoefficientSample.TIME]
        for surface in SURFACE_WORDS if len(samples) else ():  # none yet after a restart
            if surface not in self.model.terms[AXES[axis]]:
                continue
            record = samples[:, CoefficientSample.SIGNALS.start + SIGNAL_INDEX[surface]]
            moved = np.flatnonzero(np.abs(record - record[-1]) > THRESHOLDS.still)
            last = times[moved[-1]] if len(moved) else -np.inf
            began = hold.stuck == surface and hold.still > -np.inf
            if times[-1] - last > THRESHOLDS.still_time and (began or abs(last - hold.since) < THRESHOLDS.still_since):
                hold.stuck = surface
                return True
        return False

    def _stuck(self, axis: int, good: ParameterCheckpoint) -> str:
        """The surface of which nothing is left in an axis, or nothing."""
        newest = self.checkpoints.newest()
        assert newest is not None  # since there is a good one
        for i in range(*self.model.axis_slice(AXES[axis]).indices(len(good.theta))):
            surface = self.model.parameter_names[i].partition("_")[2]
            before, now = good.found.parameters[i], newest.found.parameters[i]
            known = before.status == Trust.USE and now.std < THRESHOLDS.stuck_known * abs(before.value)
            is_lost = now.value * np.sign(before.value) < THRESHOLDS.stuck * abs(before.value)
            if surface in SURFACE_WORDS and known and is_lost:
                return surface
        return ""
