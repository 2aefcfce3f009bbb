"""The model errors of the newest seconds: which call for a hold, and what older parameters would have made of them.

The mean square error of the newest WINDOW samples of motion of each axis, each predicted before it is learnt from, is
compared with what is usual (``residuals``, ``error_levels``). An alarm is none where the error is that of parameters
which were not known (``news``); a slight one is one where what was known ``worse_since`` (``thresholds``) seconds ago
predicts far better.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, MEASURED, PREDICTED, CoefficientSample
from aircraft_sysid_ros.identification.history import Checkpoints, ParameterCheckpoint, SampleHistory
from aircraft_sysid_ros.identification.monitoring.error_levels import error_levels
from aircraft_sysid_ros.identification.monitoring.isolation import Explanation, explanations
from aircraft_sysid_ros.identification.monitoring.known_before import KnownBefore
from aircraft_sysid_ros.identification.monitoring.news import is_news
from aircraft_sysid_ros.identification.monitoring.residuals import WINDOW, ResidualMonitor
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_TIME = CoefficientSample.TIME


class ErrorWatch:
    """The errors of all axes, and since when they are too large."""

    def __init__(
        self,
        aircraft: Aircraft,
        step: float,
        half_width: float,
        history: SampleHistory,
        checkpoints: Checkpoints,
        known_before: KnownBefore,
    ) -> None:
        """``step`` [s] between evaluations, ``half_width`` [s] of their windows."""
        self._model: AerodynamicModel = aircraft.model
        self._chord_over_span = aircraft.chord / aircraft.span
        self._history, self._checkpoints, self._known_before = history, checkpoints, known_before
        self._window = THRESHOLDS.window_spread * WINDOW * step  # [s]
        self._overlap = max(2.0 * half_width / step, 1.0)
        self.monitor = ResidualMonitor(step)
        self.restart()

    def restart(self) -> None:
        """The clock started over."""
        self._raised = np.zeros(len(AXES), np.int64)
        self._uneasy_since = np.full(len(AXES), np.nan)
        self._released = np.full(len(AXES), -np.inf)  # [s] when the newest hold of each axis ended
        self._levels, self._flags = np.full(len(AXES), np.nan), np.zeros((len(AXES), 3), np.bool_)

    def end_hold(self, axis: int, now: float) -> None:
        """The hold of an axis ended ``now`` [s]: what its errors were does not count."""
        self._released[axis], self._raised[axis], self._uneasy_since[axis] = now, 0, np.nan
        self.monitor.skip(axis)

    def released(self, axis: int) -> float:
        """Time [s] when the newest hold of an axis ended."""
        return float(self._released[axis])

    def uneasy_since(self, axis: int) -> float:
        """Time [s] since which an axis has been uneasy; NaN: it is not."""
        return float(self._uneasy_since[axis])

    def begin(self, now: float) -> float:
        """Time [s] of the oldest sample that the newest window may hold."""
        return now - self._window

    def high_axes(self, now: float, known: Bools, held: Bools) -> list[int]:
        """Axes whose error calls for a hold, of those that are ``known`` or ``held`` (6,)."""
        asked, begin = known | held, self.begin(now)
        error_levels(
            self._history.since(0),
            np.maximum(begin, self._released),
            self.monitor.one_summary,
            self._levels,
            self._flags,
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
            high = (alarming[axis] and not self._is_news(axis, begin)) or (
                slight[axis] and not held[axis] and self._is_worse(axis, now)
            )
            self._raised[axis] = self._raised[axis] + 1 if high else 0
        return np.flatnonzero(asked & (self._raised >= THRESHOLDS.alarm_looks)).tolist()

    def _is_news(self, axis: int, begin: float) -> bool:
        """Whether an error since ``begin`` [s] is that of what the axis did not know before."""
        if not self.has_known(axis, begin):
            return True
        past, samples = self._checkpoints.before(begin, axis), self._history.since(0)
        samples = samples[(samples[:, _TIME] > begin) & (samples[:, LEARNT + axis] > 0.0)]
        if past is None or not len(samples):
            return False
        return is_news(self._model, axis, past, samples, float(self._levels[axis]), self.monitor.usual(axis))

    def has_known(self, axis: int, time: float) -> bool:
        """Whether anything of an axis was to be used at a time [s], or was surely known: else there is nothing to lose.

        What moves by its noise alone has parameters that are wrong, and for that reason HOLD; the first motion says so.
        """
        past, part = self._checkpoints.before(time, axis), self._model.axis_slice(AXES[axis])
        if past is None or np.isnan(past.time) or self._known_before.is_known[part].any():  # NaN: it came from a file
            return True
        moving = self._model.constants[axis] == 0.0
        used = [p.status == Trust.USE for p in past.found.parameters[part]]
        return bool((moving & np.array(used, np.bool_)).any())

    def _is_worse(self, axis: int, now: float) -> bool:
        """Whether what was known some time ago predicts far better."""
        past = self._checkpoints.before(now - THRESHOLDS.worse_since, axis)
        if past is None or not self.has_known(axis, now - THRESHOLDS.worse_since):
            return False
        most = THRESHOLDS.evidence
        times, squares = self.of(axis, self._released[axis], most)
        old = self.of(axis, self._released[axis], most, past.theta)[1]
        if len(times) < most or not squares.mean() > THRESHOLDS.worse * old.mean():
            return False
        bar = THRESHOLDS.decides * self._overlap  # windows overlap: so many are worth one
        return float(np.sum(squares - old)) > bar * self.monitor.usual(axis)[0]

    # -- what the errors are ----------------------------------------------------------------------------------------

    def of(self, axis: int, since: float, most: int, theta: Array | None = None) -> tuple[Array, Array]:
        """Times and squared errors of the newest samples that an axis learnt from, of the newest or of ``theta``."""
        samples = self._history.since(0)
        samples = samples[np.searchsorted(samples[:, _TIME], since, side="right") :]
        samples = samples[np.flatnonzero(samples[:, LEARNT + axis] > 0.0)[-most:]]
        predicted = samples[:, PREDICTED + axis]
        if theta is not None:
            part = self._model.axis_slice(AXES[axis])
            terms = slice(CoefficientSample.TERMS + part.start, CoefficientSample.TERMS + part.stop)
            predicted = samples[:, terms] @ theta[part]
        return samples[:, _TIME], (samples[:, MEASURED + axis] - predicted) ** 2

    def exceeds(self, axis: int, level: float, limits: tuple[float, float]) -> bool:
        """Whether a mean square error is above what is usual and above the largest block, by factors of the rms."""
        mean, largest = self.monitor.usual(axis)
        return bool(level > limits[0] ** 2 * mean and level > limits[1] ** 2 * largest)

    def is_far_better(self, axis: int, since: float, good: ParameterCheckpoint) -> bool:
        """Whether the newest predict clearly better than the good for long, though worse than was usual."""
        most = THRESHOLDS.long_evidence
        newest, old = self.of(axis, since, most)[1], self.of(axis, since, most, good.theta)[1]
        return len(newest) == most and float(old.mean()) > THRESHOLDS.worse * float(newest.mean())

    def are_alike(self, axis: int, samples: int, good: ParameterCheckpoint) -> bool:
        """Whether so many samples of motion as before the good parameters would not tell them from the newest."""
        newest, part = self._checkpoints.newest(), self._model.axis_slice(AXES[axis])
        if newest is None:
            return True
        apart, sums = newest.theta[part] - good.theta[part], good.least_squares.sums[axis, 0]
        n = len(apart)
        square = float(apart @ sums[:n, :n] @ apart) / max(float(sums[n + 1, n + 1]), 1e-300)
        return not samples * square > THRESHOLDS.decides * self.monitor.usual(axis)[0]

    def over_usual(self) -> Array:
        """Rms error of the newest second of motion of each axis over the usual (6,)."""
        return np.sqrt(self._levels / np.maximum(self._usual(), 1e-300))

    def _usual(self) -> Array:
        """Usual mean square error of each axis (6,)."""
        return np.array([self.monitor.usual(axis)[0] for axis in range(len(AXES))])

    def explanation(self, since: float) -> Explanation | None:
        """The one thing that best explains what came since a time [s]; None where there is no error, or no known."""
        samples = self._history.since(0)
        samples = samples[np.searchsorted(samples[:, _TIME], since, side="right") :]
        known = [None if kept is None else kept.theta for kept in map(self._known_before.of, range(len(AXES)))]
        found = explanations(
            self._model, samples, known, self._known_before.is_known, self._usual(), self._chord_over_span
        )
        return found[0] if found and found[0].before > THRESHOLDS.least_error else None
