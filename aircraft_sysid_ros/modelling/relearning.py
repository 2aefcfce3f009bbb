"""When the aeroplane has changed: what an axis knew becomes a prior, and it learns again from what was since.

With theta_0, P_0 (in units of the noise variance s^2, as ``rls_update`` has it) from just before the change, the prior
says that any parameter may have changed by a share of itself, and by what a share of the coefficient's spread is:

    theta ~ (theta_0, s^2 (P_0 + diag(d_j^2) / s^2)),    d_j^2 = (SHARE theta_0j)^2 + (SPREAD spread / rms x_j)^2.

So no value leaves the reach of the prior, whatever the first second of data says. With I_0 the information of the prior
and S = sum x x' of the data since, M = I_0 + S, the estimate has the covariance

    M^-1 [ sum_l w_l R_e(l) sum_k x(k) x(k-l)' + s^2 I_0 ] M^-1,

that of ``lagged_moments`` for coloured residuals with the prior as one more, exact, observation.

Whether the aeroplane has changed is asked of the errors of recursive least squares, whichever learner is published: it
always runs, knows its parameters first, and does not explain errors by noise.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.expression import SIGNAL_INDEX
from aircraft_sysid_ros.estimation.recursive_least_squares import rls_update
from aircraft_sysid_ros.modelling.change_monitor import RATIO, ChangeMonitor
from aircraft_sysid_ros.modelling.learner import AxisEstimate, Opening
from aircraft_sysid_ros.modelling.parameter_set import least_squares
from aircraft_sysid_ros.modelling.regression import LARGEST_CONSISTENCY, Learning, Point, Tuning, accumulate
from aircraft_sysid_ros.modelling.trust import TrustRules
from aircraft_sysid_ros.reconstruction.state import Column

Array = npt.NDArray[np.float64]

#: Time [s] between looks at the model errors.
LOOK = 0.2
#: Evaluations that an axis has learnt from before its errors are looked at.
KNOWN = 250
#: One sigma of a change: share of the parameter, and share of the spread of its coefficient that the term may do.
SHARE, SPREAD = 0.75, 0.2
#: Time [s] for which points and parameters are remembered: from before the change to its alarm.
MEMORY = 5.0
#: Parameters from this long [s] before the first window that the change is in are those from before it.
_MARGIN = 0.1
#: Half-widths from the change to the first window that is all after it, one of them for the error of its time.
_STRADDLE = 2.0
_QBAR = Point.SIGNALS.start + SIGNAL_INDEX["qbar"]
_MEASURED, _LEARNT, _TERMS = Point.MEASURED.start, Point.LEARNT.start, Point.TERMS


class Changes:
    """Monitor of all axes with what relearning needs: the points and the parameters of the newest seconds."""

    def __init__(self, step: float) -> None:
        """``step`` [s] between evaluations."""
        self.monitor = ChangeMonitor(step)
        self.since = np.full(6, -np.inf)  # [s] as in Point.TIME: newest change of each axis
        self.times = np.full(6, np.nan)  # [s] of flight: the same
        self.counts = np.zeros(6, np.int64)  # alarms of each axis
        self.restart()

    def restart(self) -> None:
        """The clock or the model is another one: drop the memory."""
        self._waiting: list[Array] = []
        self._at_odds = False
        self._points: deque[Array] = deque()
        self._snapshots: deque[tuple[float, Array, Array]] = deque()
        self._slot = -np.inf
        self.monitor.skip()

    def alarms(self) -> list[tuple[str, float, int]]:
        """Axes that have changed: when last [s of flight], and how often."""
        told = np.flatnonzero(np.isfinite(self.times))  # not those that have been undone
        return [(AXES[axis], float(self.times[axis]), int(self.counts[axis])) for axis in told]

    def summary(self) -> dict[str, Any]:
        """Number of alarms, and the newest: time [s] of flight and axes."""
        newest = np.nanmax(self.times) if np.isfinite(self.times).any() else np.nan
        axes = [AXES[axis] for axis in np.flatnonzero(self.times == newest)]
        return {"changes": int(self.counts.sum()), "last_change": " ".join([f"{newest:.1f} s", *axes] if axes else [])}

    def parts(self, times: Array) -> Iterator[slice]:
        """Times [s] (n,) cut where a look is due, so that every batch is cut at the same times."""
        cuts = np.flatnonzero(np.diff(np.floor(times / LOOK))) + 1
        edges = [0, *cuts.tolist(), len(times)]
        yield from map(slice, edges[:-1], edges[1:])

    def is_due(self, time: float) -> bool:
        """Whether a look is due before what is at ``time`` [s] is learnt from."""
        before, self._slot = self._slot, float(np.floor(time / LOOK))
        return bool(self._slot != before)

    def undo(self, axis: int, times: Array) -> None:
        """An axis has gone back to what it knew before; ``times`` (2,) as it then had them: since, times."""
        self.since[axis], self.times[axis] = times
        self.monitor.forget(axis)
        self._points.clear()
        self._snapshots.clear()

    def take(self, points: Array) -> None:
        """New points (m, …) of ``Point``, predicted by recursive least squares."""
        self._waiting.append(points.copy())

    def take_rows(self, rows: Array) -> None:
        """Rows (n, Column.WIDTH) of the first step that points come from."""
        self._at_odds |= bool(np.any(rows[:, Column.CONSISTENCY] > 0.5 * LARGEST_CONSISTENCY))

    def _follow(self, learning: Learning) -> None:
        """What came since the last look, all at once, so that it does not matter in what portions it came."""
        points, at_odds, self._waiting, self._at_odds = self._waiting, self._at_odds, [], False
        if at_odds:
            self.monitor.skip()
        if at_odds or not points:
            return
        table = np.vstack(points)
        self.monitor.add(table, learning.updates >= KNOWN)
        self._points.extend(table)
        while self._points[0][Point.TIME] < self._points[-1][Point.TIME] - MEMORY:
            self._points.popleft()

    def look(self, model: AerodynamicModel, learning: Learning, tuning: Tuning, area: float) -> list[Opening]:
        """Axes that have changed; recursive least squares has begun to learn them anew, a learner is to do so."""
        self._follow(learning)
        found = [
            self._relearn(axis, model, learning, tuning, area)
            for axis in range(6)
            if self.monitor.look(axis, partial(self._explained, axis, model, learning))
        ]
        if self._points:
            self._snapshots.append((float(self._points[-1][Point.TIME]), learning.theta.copy(), learning.p.copy()))
        while self._snapshots and self._snapshots[0][0] < self._snapshots[-1][0] - MEMORY:
            self._snapshots.popleft()
        return found

    def relearnt(self, axis: int, model: AerodynamicModel, learning: Learning) -> AxisEstimate | None:
        """What recursive least squares knows of an axis that changed, once its standard errors are small again."""
        known, sums = least_squares(model, axis, learning)
        rules = TrustRules()
        if known.samples < rules.samples:
            return None
        std, n = np.sqrt(np.diag(known.covariance)), len(known.theta)
        small = np.maximum(rules.relative_error * np.abs(known.theta), rules.negligible * spread_of_terms(sums[0]))
        return known if n and np.all(std <= small) else None

    def _explained(self, axis: int, model: AerodynamicModel, learning: Learning) -> float:
        """What explains a window without a change: variance of its predictions, by the covariance from before it.

        A window whose error is no larger than noise of the terms makes is explained, too.
        """
        begin, n = self.monitor.window_begin(axis), len(model.terms[AXES[axis]])
        theta, p = self._before(begin - _MARGIN, axis, learning)
        noise = float(theta[:n] ** 2 @ learning.noise_square[model.axis_slice(AXES[axis])])
        x = self._terms(self._since(begin), axis, model)
        shares = np.einsum("ki,ij,kj->k", x, p[:n, :n], x)
        return self.monitor.variance(axis) * float(shares.mean()) + noise / RATIO**2 if len(x) else np.inf

    def _relearn(self, axis: int, model: AerodynamicModel, learning: Learning, tuning: Tuning, area: float) -> Opening:
        begun = self.monitor.change_time(axis)
        since = begun + tuning.half_width
        variance = self.monitor.variance(axis)
        theta, p = self._before(begun - tuning.half_width - _MARGIN, axis, learning)
        n = len(model.terms[AXES[axis]])
        theta, p = theta[:n], p[:n, :n]
        spread = spread_of_terms(learning.sums[axis, 0, : n + 2, : n + 2])
        opened = p + np.diag(changed_variance(theta, spread) / max(variance, 1e-300))
        learning.prior[axis, :n, :n], learning.prior_variance[axis] = information(opened), variance
        learning.theta[axis, :n], learning.p[axis, :n, :n] = theta, opened
        learning.sums[axis], learning.recent[axis], learning.updates[axis] = 0.0, np.nan, 0
        learning.last_valid[axis] = -np.inf
        after = self._since(since + _STRADDLE * tuning.half_width)
        learn_again(axis, after, area, learning, tuning)
        self.monitor.forget(axis)
        self.counts[axis] += 1
        self.since[axis] = since
        return Opening(axis, since, spread)

    def _before(self, time: float, axis: int, learning: Learning) -> tuple[Array, Array]:
        """Newest parameters of an axis that are not younger than ``time`` [s], or the oldest that there are."""
        kept = [s for s in self._snapshots if s[0] <= time] or [*self._snapshots][:1]
        _, theta, p = kept[-1] if kept else (time, learning.theta.copy(), learning.p.copy())
        return theta[axis], p[axis]

    def _since(self, time: float) -> Array:
        kept = [point for point in self._points if point[Point.TIME] >= time]
        return np.array(kept) if kept else np.empty((0, Point.TERMS))

    def _terms(self, points: Array, axis: int, model: AerodynamicModel) -> Array:
        learnt = points[points[:, Point.LEARNT.start + axis] > 0.0]
        part = model.axis_slice(AXES[axis])
        return learnt[:, Point.TERMS + part.start : Point.TERMS + part.stop]


def spread_of_terms(sums: Array) -> Array:
    """Value (n,) of each parameter that would spread its coefficient as the flight did, from sums (n + 2, n + 2)."""
    n = len(sums) - 2
    moments = sums / max(sums[n + 1, n + 1], 1e-300)
    spread = np.sqrt(max(moments[n, n] - moments[n, n + 1] ** 2, 0.0))
    size = np.sqrt(np.diag(moments)[:n])
    return np.asarray(np.where(size > 0.0, spread / np.where(size > 0.0, size, 1.0), 0.0))


def changed_variance(theta: Array, spread: Array) -> Array:
    """Variance (n,) of what a change may do to parameters (n,), see the module; ``spread`` as of spread_of_terms."""
    return (SHARE * theta) ** 2 + (SPREAD * spread) ** 2


def information(covariance: Array) -> Array:
    """Inverse (n, n) of a positive covariance, scaled and through its factor."""
    scale = np.sqrt(np.diag(covariance))
    half = np.linalg.solve(np.linalg.cholesky(covariance / np.outer(scale, scale)), np.diag(1.0 / scale))
    return half.T @ half


@njit(cache=True)
def learn_again(axis: int, points: Array, area: float, learning: Learning, tuning: Tuning) -> None:
    """Learn from remembered points (m, …) of ``Point`` as ``regression.learn`` did, on theta and p as they are now."""
    first, last = learning.offsets[axis], learning.offsets[axis + 1]
    n, noise = last - first, np.sqrt(learning.noise_square)
    for point in points:
        if point[_LEARNT + axis] > 0.0:
            known = (tuning.force_noise / (point[_QBAR] * area)) ** 2
            root_weight = np.sqrt(known / (known + learning.doubt[axis]))
            x = root_weight * point[_TERMS + first : _TERMS + last]
            y = root_weight * point[_MEASURED + axis]
            rls_update(learning.theta[axis, :n], learning.p[axis, :n, :n], x, y, 1.0)
            accumulate(axis, point[0], x, y, root_weight, noise, learning, tuning)
