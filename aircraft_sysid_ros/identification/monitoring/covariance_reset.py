"""When the aeroplane has changed: what an axis knew becomes a prior, and it learns again from what was since.

With theta_0, P_0 (in units of the noise variance s^2, as ``rls_update`` has it) from just before the change, opened to
any change as ``estimators.reset_prior`` says, I_0 the information of that prior and S = sum x x' of the data since,
M = I_0 + S, the estimate has the covariance

    M^-1 [ sum_l w_l R_e(l) sum_k x(k) x(k-l)' + s^2 I_0 ] M^-1,

that of ``lagged_moments`` for coloured residuals with the prior as one more, exact, observation.

A change may take its time, as flaps do, and what is learnt while it goes on is of neither aeroplane. So the axis is
asked again after it: where its samples of the newest seconds, with the prior, say surely another level of the
coefficient than those before them have, it starts over from them.

A surface that has changed acts in more than one axis, and in the others it may not be enough for an alarm: C_Z hardly
shows that an elevator does half as much, and of what it does then and did before the mean is neither. So what
surfaces do in the other axes of the same plane is opened as well, and nothing else of them.

Whether the aeroplane has changed is asked of the errors of recursive least squares, whichever estimator is published:
it always runs, knows its parameters first, and does not explain errors by noise.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SURFACE_WORDS
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.estimators.contract import AxisEstimate, AxisReset
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import RlsState, least_squares
from aircraft_sysid_ros.identification.estimators.reset_prior import (
    MEMORY,
    changed_variance,
    information,
    spread_of_terms,
)
from aircraft_sysid_ros.identification.history import SampleHistory
from aircraft_sysid_ros.identification.monitoring.residuals import ResidualMonitor
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.undescribed.moved_surfaces import COUNT, FIRST, derivatives_of
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]

#: Parameters from this long [s] before the first window that the change is in are those from before it.
_MARGIN = 0.1
#: Half-widths from the change to the first window that is all after it, one of them for the error of its time.
_STRADDLE = 2.0
#: Time [s] for which errors are alike.
_ALIKE = 1.0
_TIME = CoefficientSample.TIME
#: Axes of one plane, in which the same surfaces act.
_PLANES = (("CX", "CZ", "Cm"), ("CY", "Cl", "Cn"))


class ChangeDetector:
    """Finds axes that have changed, by the errors of least squares and its parameters of the newest seconds."""

    def __init__(self, step: float, half_width: float, history: SampleHistory) -> None:
        """``step`` [s] between evaluations, ``half_width`` [s] of their windows."""
        self.monitor = ResidualMonitor(step)
        self._half_width, self._history = half_width, history
        self.since = np.full(len(AXES), -np.inf)  # [s] as in CoefficientSample.TIME: newest change of each axis
        self.times = np.full(len(AXES), np.nan)  # [s] of flight: the same
        self.counts = np.zeros(len(AXES), np.int64)  # alarms of each axis
        self._settling: dict[int, tuple[AxisReset, float]] = {}  # axes that changed, and when [s] they are asked again
        self.restart()

    def restart(self) -> None:
        """The clock or the model is another one: drop the memory."""
        self._begin = self._seen = self._history.count
        self._unsound: deque[tuple[int, int]] = deque()  # samples, by number, that do not count
        self._newest = -np.inf  # [s] of the newest that does
        self._at_odds = False
        self._parameters: deque[tuple[float, Array, Array]] = deque()
        self._settling.clear()
        self.monitor.skip()

    def restart_clock(self) -> None:
        """The clock started over."""
        self.restart()
        self.since[:] = -np.inf

    def forget(self, axes: Iterable[int] = range(len(AXES))) -> None:
        """Another flight, or other terms in some axes: which errors are usual is still to be seen."""
        for axis in axes:
            self.monitor.forget(axis)

    def alarms(self) -> list[tuple[str, float, int]]:
        """Axes that have changed: when last [s of flight], and how often."""
        known = np.flatnonzero(np.isfinite(self.times))  # not those that have been undone
        return [(AXES[axis], float(self.times[axis]), int(self.counts[axis])) for axis in known]

    def summary(self) -> dict[str, Any]:
        """Number of alarms, and the newest: time [s] of flight and axes."""
        newest = np.nanmax(self.times) if np.isfinite(self.times).any() else np.nan
        axes = [AXES[axis] for axis in np.flatnonzero(self.times == newest)]
        return {"changes": int(self.counts.sum()), "last_change": " ".join([f"{newest:.1f} s", *axes] if axes else [])}

    def undo(self, axis: int, times: Array) -> None:
        """An axis has gone back to what it knew before; ``times`` (2,) as it then had them: since, times."""
        self.since[axis], self.times[axis] = times
        self._settling.pop(axis, None)
        self.monitor.forget(axis)
        self._begin = self._history.count
        self._newest = -np.inf
        self._parameters.clear()

    def add_states(self, rows: Array) -> None:
        """States (n, StateField.WIDTH) that samples come from."""
        if not self._at_odds:
            self._at_odds = bool((rows[:, StateField.CONSISTENCY] > THRESHOLDS.change_at_odds).any())

    def _follow(self, state: RlsState) -> None:
        """What came since the last evaluation, all at once, so that it does not matter in what portions it came."""
        first, self._seen = self._seen, self._history.count
        at_odds, self._at_odds = self._at_odds, False
        if at_odds:
            self.monitor.skip()
            if self._seen > first:
                self._unsound.append((first, self._seen))
        if at_odds or self._seen == first:
            return
        samples = self._history.since(first)
        self.monitor.add(samples, self._history.by_least_squares(first), state.updates >= THRESHOLDS.change_known)
        self._newest = float(samples[-1, _TIME])

    def evaluate(
        self,
        model: AerodynamicModel,
        state: RlsState,
        start: float,
        was_known: Callable[[int], bool],
        lateness: float = 0.0,
    ) -> list[AxisReset]:
        """Axes that have changed, as commands; ``state`` is that of least squares, ``start`` [s] of the flight.

        Where nothing of an axis ``was_known`` before, the first motion contradicts what noise and gusts made of
        it in quiet flight: it starts over as well, and that is no change of the aeroplane.

        ``lateness``: one sigma [s] of how late surfaces may be recorded, which is no change of the aeroplane. Axes with
        terms in time change by those: such a step and a constant that is opened at that moment are one column, and each
        was given half of the change.
        """
        self._follow(state)
        resets = self._settled(model) if self._settling else []
        if self.monitor.is_quiet():
            return resets
        for axis in range(len(AXES)):
            if "time" in model.signals_of_axes[axis]:
                continue
            if self.monitor.has_changed(axis, partial(self._explained, axis, model, state, lateness)):
                reset = self._reset_of(axis, model, state)
                self.monitor.forget(axis)
                self.since[axis] = reset.since
                if was_known(axis):
                    self.counts[axis] += 1
                    self.times[axis] = reset.since - start
                else:
                    reset = reset._replace(is_news=True)
                self._settling[axis] = reset, reset.since + THRESHOLDS.change_asked[0]
                resets = [*(other for other in resets if other.axis != axis), reset]
        return [*resets, *self._beside(resets, model, state)]

    def _beside(self, resets: list[AxisReset], model: AerodynamicModel, state: RlsState) -> list[AxisReset]:
        """What surfaces do in axes that have not changed, opened where another axis of the plane has."""
        changed = {AXES[reset.axis] for reset in resets if not (reset.is_again or reset.is_news)}
        others = {name for plane in _PLANES if changed.intersection(plane) for name in plane}
        beside = [axis for axis in range(len(AXES)) if AXES[axis] in others - {AXES[r.axis] for r in resets}]
        return [self._opened(axis, model, state) for axis in beside if state.updates[axis] >= THRESHOLDS.change_known]

    def _opened(self, axis: int, model: AerodynamicModel, state: RlsState) -> AxisReset:
        """The command that opens what surfaces do in an axis; ``covariance`` is what is added to that of now."""
        n = len(model.terms[AXES[axis]])
        theta, nothing = state.theta[axis, :n], np.zeros(n)
        moved = [bool(program.signals & SURFACE_WORDS.keys()) for program in model.programs[axis]]
        variance = max(self.monitor.variance(axis), 1e-300)
        change = np.diag(np.where(moved, changed_variance(theta, nothing), 0.0)) / variance
        none = self._since(np.inf)
        return AxisReset(axis, np.nan, nothing, theta, change, change, variance, *none, is_beside=True)

    def _settled(self, model: AerodynamicModel) -> list[AxisReset]:
        """Of axes that changed and are asked again, those that start over since the change had gone on."""
        resets = []
        for axis, (reset, due) in [*self._settling.items()]:
            if self._newest < due:
                continue
            again = self._gone_on(reset, model)
            if again is not None:
                resets.append(again)
            later = [reset.since + age for age in THRESHOLDS.change_asked if reset.since + age > self._newest]
            if later:
                self._settling[axis] = again or reset, later[0]
            else:
                del self._settling[axis]
        return resets

    def _gone_on(self, reset: AxisReset, model: AerodynamicModel) -> AxisReset | None:
        """The reset with the newest samples alone, where those before them surely have another level."""
        axis, part, n = reset.axis, model.axis_slice(AXES[reset.axis]), len(reset.theta)
        samples, weights = self._since(reset.begin, np.inf)
        learnt = samples[:, CoefficientSample.LEARNT.start + axis] > 0.0
        is_late = samples[:, _TIME] >= self._newest - THRESHOLDS.change_newest
        x = samples[:, CoefficientSample.TERMS + part.start : CoefficientSample.TERMS + part.stop]
        y = samples[:, CoefficientSample.MEASURED.start + axis]
        late, early = learnt & is_late, learnt & ~is_late
        if late.sum() <= n or early.sum() <= n:
            return None
        inverse = np.linalg.inv(reset.information + x[late].T @ x[late])
        theta = inverse @ (reset.information @ reset.theta + x[late].T @ y[late])
        left, level = y[late] - x[late] @ theta, float(np.mean(y[early] - x[early] @ theta))
        mean = x[early].mean(axis=0)
        alike = _ALIKE * (1.0 / THRESHOLDS.change_newest + 1.0 / max(float(np.ptp(samples[early, _TIME])), _ALIKE))
        variance = reset.variance * float(mean @ inverse @ mean) + float(np.mean(left**2)) * alike
        if level**2 < THRESHOLDS.change_surely**2 * variance:
            return None
        since = self._newest - THRESHOLDS.change_newest
        return reset._replace(samples=samples[is_late], weights=weights[is_late], begin=since, is_again=True)

    def remember(self, state: RlsState) -> None:
        """Keep the parameters as they are now, after resets."""
        if self._newest > -np.inf:
            self._parameters.append((self._newest, state.theta.copy(), state.p.copy()))
        while self._parameters and self._parameters[0][0] < self._parameters[-1][0] - MEMORY:
            self._parameters.popleft()

    def relearnt(self, axis: int, model: AerodynamicModel, state: RlsState) -> AxisEstimate | None:
        """What recursive least squares knows of an axis that changed, once its standard errors are small again."""
        known, sums = least_squares(model, axis, state)
        if known.samples < THRESHOLDS.samples:
            return None
        std, n = np.sqrt(np.diag(known.covariance)), len(known.theta)
        small = np.maximum(
            THRESHOLDS.relative_error * np.abs(known.theta), THRESHOLDS.negligible * spread_of_terms(sums[0])
        )
        return known if n and np.all(std <= small) else None

    def _explained(self, axis: int, model: AerodynamicModel, state: RlsState, lateness: float) -> float:
        """What explains a window without a change: variance of its predictions, by the covariance from before it.

        A window whose error is no larger than noise of the terms makes is explained, too, or surfaces that are as late
        as they may be.
        """
        begin, n = self.monitor.window_begin(axis), len(model.terms[AXES[axis]])
        theta, p = self._before(begin - _MARGIN, axis, state)
        part = model.axis_slice(AXES[axis])
        noise = float(theta[:n] ** 2 @ state.noise_square[part])
        samples = self._since(begin)[0]
        learnt = samples[samples[:, CoefficientSample.LEARNT.start + axis] > 0.0]
        x = learnt[:, CoefficientSample.TERMS + part.start : CoefficientSample.TERMS + part.stop]
        if not len(x):
            return np.inf
        shares = np.einsum("ki,ij,kj->k", x, p[:n, :n], x)
        late = (THRESHOLDS.change_late * lateness) ** 2 * _moved_by_surfaces(
            learnt, theta[:n], derivatives_of(model, axis)
        )
        return self.monitor.variance(axis) * float(shares.mean()) + (noise + late) / THRESHOLDS.change_ratio**2

    def _reset_of(self, axis: int, model: AerodynamicModel, state: RlsState) -> AxisReset:
        begun = self.monitor.change_time(axis)
        since = begun + self._half_width
        variance = self.monitor.variance(axis)
        theta, p = self._before(begun - self._half_width - _MARGIN, axis, state)
        n = len(model.terms[AXES[axis]])
        theta, p = theta[:n], p[:n, :n]
        spread = spread_of_terms(state.sums[axis, 0, : n + 2, : n + 2])
        opened = p + np.diag(changed_variance(theta, spread) / max(variance, 1e-300))
        begin = since + _STRADDLE * self._half_width
        after = self._since(begin)
        return AxisReset(axis, since, spread, theta, opened, information(opened), variance, *after, begin)

    def _before(self, time: float, axis: int, state: RlsState) -> tuple[Array, Array]:
        """Newest parameters of an axis that are not younger than ``time`` [s], or the oldest that there are."""
        kept = [s for s in self._parameters if s[0] <= time] or [*self._parameters][:1]
        _, theta, p = kept[-1] if kept else (time, state.theta.copy(), state.p.copy())
        return theta[axis], p[axis]

    def _since(self, time: float, longest: float = MEMORY) -> tuple[Array, Array]:
        """Samples (n, …) from a time [s] on that count, of the ``longest`` [s], and their weights."""
        first = max(self._begin, self._history.first)
        samples, weights = self._history.since(first), self._history.weights(first)
        chosen = samples[:, _TIME] >= max(time, self._newest - longest)
        for low, high in self._unsound:
            chosen[max(low - first, 0) : max(high - first, 0)] = False
        while self._unsound and self._unsound[0][1] <= first:
            self._unsound.popleft()
        return samples[chosen], weights[chosen]


def _moved_by_surfaces(samples: Array, theta: Array, derivatives: npt.NDArray[np.int64]) -> float:
    """Mean square of the rate [1/s] that the surfaces give a coefficient in some samples, with its parameters (n,)."""
    times = samples[:, _TIME]
    known = derivatives >= 0
    if len(times) < 3 or not known.any() or not np.all(np.diff(times) > 0.0):
        return 0.0
    first = CoefficientSample.SIGNALS.start + FIRST
    rates = np.gradient(samples[:, first : first + COUNT][:, known], times, axis=0)
    return float(np.nanmean((rates @ theta[derivatives[known]]) ** 2)) if np.isfinite(rates).any() else 0.0
