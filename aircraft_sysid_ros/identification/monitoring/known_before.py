"""What was surely known before, and what contradicts it.

Of each parameter the value is kept that was known best: a later one takes its place only where it is known far better,
so that what creeps is not followed. A value contradicts it where the two differ surely, by more than a fifth, and by
what matters to the coefficient. What may have happened is read from all that changed, in all axes:

- One surface, in every axis that it moves, does less than before, and that explains all errors (``isolation``): it lost
  a part of its effect. Or the centre of gravity moved. That is the aeroplane, and is believed after some seconds of
  motion more. So is what comes back.
- Anything else is not believed. No surface gains effect, and no damage makes several axes depend less, or more, on
  several things at once; but a record that is too small does, an angle that is scaled, airspeed, density, or a delay.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SURFACE_WORDS
from aircraft_sysid_ros.identification.history import ParameterCheckpoint
from aircraft_sysid_ros.identification.monitoring.isolation import INPUTS, Explanation
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_NEAR = THRESHOLDS.known_near


class Change(NamedTuple):
    """A parameter that contradicts what was known of it."""

    axis: int
    name: str  # "Cm_de"
    before: float
    now: float

    @property
    def label(self) -> str:
        """What the coefficient depends on: "de", "alpha"."""
        return self.name.partition("_")[2]

    @property
    def ratio(self) -> float:
        """What is now over what was before."""
        return self.now / self.before


class KnownBefore:
    """The best known of every parameter, and what was before the aeroplane changed."""

    def __init__(self, model: AerodynamicModel) -> None:
        self._model = model
        names = model.parameter_names
        self._moving = np.concatenate(model.constants) == 0.0
        self._best = np.full((2, len(names)), np.nan)  # value, standard error
        self._whole = np.full((2, len(names)), np.nan)  # the same before the aeroplane changed
        self._kept: list[ParameterCheckpoint | None] = [None] * len(AXES)
        self.changed: dict[int, tuple[str, float]] = {}  # of parameters: words, and what they were
        self._lost: dict[str, tuple[float, str]] = {}  # of surfaces: what is left of their effect, and the words

    @property
    def is_known(self) -> npt.NDArray[np.bool_]:
        """Which parameters are surely known."""
        return np.isfinite(self._best[0])

    def restart_clock(self) -> None:
        """The clock started over: what was known has no age on it."""
        self._kept = [kept and kept.without_time() for kept in self._kept]

    def of(self, axis: int) -> ParameterCheckpoint | None:
        """The newest checkpoint of an axis that is near what is known best; None where there was none."""
        return self._kept[axis]

    def note(self, axis: int, kept: ParameterCheckpoint) -> None:
        """What is known of an axis that does not contradict what was."""
        part = self._model.axis_slice(AXES[axis])
        now, best = kept.within_flight[:, part], self._best[:, part]
        sure = (now[1] < THRESHOLDS.known_surely * np.abs(now[0])) & self._moving[part]
        sure &= np.array([p.status == Trust.USE for p in kept.found.parameters[part]], np.bool_)
        better = sure & ~(now[1] >= THRESHOLDS.known_better * best[1])  # or nothing was known
        best[:, better] = now[:, better]
        if not np.isnan(best[0]).all() and not (np.abs(now[0] - best[0]) > _NEAR * np.abs(best[0])).any():
            self._kept[axis] = kept

    def may_differ(self, kept: ParameterCheckpoint) -> npt.NDArray[np.bool_]:
        """Of which axes (6,) the values alone, which are quickly had, leave it open that one is a change."""
        return np.asarray(_differ(self._model.offsets, kept.theta, self._best[0], self._whole[0]))

    def changes(self, kept: ParameterCheckpoint, axes: range = range(len(AXES)), strict: bool = False) -> list[Change]:
        """What a checkpoint surely says otherwise than was known best, and before the aeroplane changed.

        What is known far better than before is no change, unless ``strict``: something was wrong meanwhile.
        """
        found = []
        for axis in axes:
            part = self._model.axis_slice(AXES[axis])
            if np.isnan(self._best[0, part]).all():
                continue
            now, best = kept.within_flight[:, part], self._best[:, part]
            changed = _contradicts(now, best) & ~_is_near(now, self._whole[:, part])
            changed &= np.abs(now[0] - best[0]) * _effect(kept, axis) > THRESHOLDS.contradicts_effect
            changed &= strict | (now[1] >= THRESHOLDS.known_better * best[1])
            for j in np.flatnonzero(changed) + part.start:
                name, before = self._model.parameter_names[j], float(self._best[0, j])
                found.append(Change(axis, name, before, float(now[0, j - part.start])))
        return found

    def accept(self, changes: list[Change], kept: ParameterCheckpoint, words: str) -> None:
        """The aeroplane is another one from now on, for which there are words; what it was is remembered, too."""
        names = self._model.parameter_names
        for change in changes:
            j = names.index(change.name)
            if j in self.changed:  # it is less again, and the others may not have said how much yet
                self._lost.pop(change.label, None)
            elif change.label in SURFACE_WORDS:
                self._lost[change.label] = change.ratio, words
            self._whole[:, j] = self._best[:, j]
            self._best[:, j] = kept.within_flight[:, j]
            self.changed[j] = (f"changed: {change.before:.3g} before, {words}", change.before)
            self._kept[change.axis] = kept

    def accept_alike(self, changes: list[Change], kept: ParameterCheckpoint) -> bool:
        """Whether all that changed is what a surface does that is known to have lost effect, and lost as much of it.

        The aeroplane is that one in this axis, too. What has lost it already and does less again is another one.
        """
        names = self._model.parameter_names
        for change in changes:
            left, words = self._lost.get(change.label, (np.nan, ""))
            if names.index(change.name) in self.changed or not abs(change.ratio - left) < THRESHOLDS.alike * abs(left):
                return False
        self.accept(changes, kept, words)
        return True

    def regain(self, kept: ParameterCheckpoint) -> bool:
        """Whether what changed is again what it was; that is then known best."""
        values = kept.said[0]
        back = _is_near(values[None], self._whole) & ~_is_near(values[None], self._best)
        self._best[:, back], self._whole[:, back] = self._whole[:, back], np.nan
        for j in np.flatnonzero(back).tolist():
            del self.changed[j]
            self._lost.pop(self._model.parameter_names[j].partition("_")[2], None)
            self._kept[int(np.searchsorted(self._model.offsets, j, side="right")) - 1] = kept
        return bool(back.any())


def _effect(kept: ParameterCheckpoint, axis: int) -> Array:
    """What a unit of each parameter of an axis (n,) moves its coefficient by, over the spread that that had."""
    n = int(np.diff(kept.least_squares.offsets)[axis])
    sums = kept.least_squares.sums[axis, 0, : n + 2, : n + 2]
    moments = sums / max(sums[n + 1, n + 1], 1e-300)
    return np.asarray(np.sqrt(np.diag(moments)[:n] / max(moments[n, n] - moments[n, n + 1] ** 2, 1e-300)))


def _contradicts(now: Array, before: Array) -> npt.NDArray[np.bool_]:
    """Which values (2, n) with standard errors differ surely, and by a size that matters; none that is not known."""
    apart = np.abs(now[0] - before[0])
    large = apart > THRESHOLDS.contradicts_share * np.abs(before[0])
    return np.asarray(large & (apart > THRESHOLDS.contradicts_sigma * np.hypot(now[1], before[1])))


@njit(cache=True)
def _differ(offsets: Integers, now: Array, best: Array, whole: Array) -> npt.NDArray[np.bool_]:
    """Which axes (6,) have a value, of all (parameters,), that is known and near neither the best nor what it was."""
    found = np.zeros(len(offsets) - 1, np.bool_)
    for axis in range(len(found)):
        for j in range(offsets[axis], offsets[axis + 1]):
            from_best, from_whole = abs(now[j] - best[j]), abs(now[j] - whole[j])
            is_near = from_best <= _NEAR * abs(best[j]) or from_whole <= _NEAR * abs(whole[j])
            found[axis] |= np.isfinite(best[j]) and not is_near
    return found


def _is_near(now: Array, before: Array, share: float = THRESHOLDS.contradicts_share) -> npt.NDArray[np.bool_]:
    return np.asarray(np.abs(now[0] - before[0]) <= share * np.abs(before[0]))


def cause(changes: list[Change], best: Explanation | None = None) -> str:
    """What may be wrong, in words, and what shows it; ``best`` is what explains the errors best."""
    if best is not None and best.is_sure:
        return best.words
    shown = ", ".join(f"{c.name} went from {c.before:.3g} to {c.now:.3g}" for c in changes[:2])
    more = f" and {len(changes) - 2} more" if len(changes) > 2 else ""
    return f"{_candidates(changes)} ({shown}{more})"


def _candidates(changes: list[Change]) -> str:
    labels, ratios = {c.label.rstrip("0123456789") for c in changes}, np.array([c.ratio for c in changes])
    if len(labels) == 1 and labels <= set(INPUTS):
        return f"the {INPUTS[labels.pop()]} is wrong, or the aeroplane has changed"
    if labels <= set(SURFACE_WORDS):
        return "the records of the controls are wrong, or the aeroplane has changed"
    scale = float(np.mean(ratios))
    several = len(changes) > 2 and len({c.axis for c in changes}) > 1
    if several and np.all(np.abs(ratios / scale - 1.0) < THRESHOLDS.alike):
        return "airspeed or density is wrong, or the aeroplane has changed"
    return "a sensor is wrong, or the aeroplane has changed"
