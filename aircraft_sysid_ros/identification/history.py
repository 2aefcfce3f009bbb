"""Everything that looks back looks here: the newest coefficient samples once, what was known at older times once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.identification.coefficients.layout import WEIGHT_COLUMNS, CoefficientSample
from aircraft_sysid_ros.identification.description import Description
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import RlsState
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS

Array = npt.NDArray[np.float64]

#: Time [s] for which samples are kept.
SAMPLE_MEMORY = 20.0
#: Time [s] between checkpoints, and for how long they are kept.
SPACING, CHECKPOINT_MEMORY = 1.0, 30.0

_TIME = CoefficientSample.TIME
_WEIGHTS = slice(0, WEIGHT_COLUMNS)
_BY_LEAST_SQUARES = slice(WEIGHT_COLUMNS, WEIGHT_COLUMNS + 6)
_EXTRA = WEIGHT_COLUMNS + 6


class SampleHistory:
    """The newest coefficient samples, with their weights and what least squares predicted of them.

    The samples themselves hold the predictions that are published. ``count`` of samples ever added numbers them.
    """

    def __init__(self, columns: int, newest: int) -> None:
        """``columns`` of a sample; the ``newest`` so many are kept however old they are."""
        self.keep_newest(newest)
        self._samples, self._extra = np.empty((1024, columns)), np.empty((1024, _EXTRA))
        self._first = self._last = self._dropped = self._begin = 0

    def keep_newest(self, count: int) -> None:
        """The newest so many samples are kept however old they are."""
        self._newest = count

    @property
    def count(self) -> int:
        """How many samples were ever added."""
        return self._dropped + self._last

    def restart(self) -> None:
        """The clock or the model is another one: only ``newest`` still shows what was before."""
        self._begin = self.count

    def widen(self, columns: int) -> None:
        """Another model: samples have other terms, those of the past are not known."""
        shared = min(columns, CoefficientSample.TERMS)
        samples = np.full((len(self._samples), columns), np.nan)
        samples[:, :shared] = self._samples[:, :shared]
        self._samples = samples
        self.restart()

    def add(self, samples: Array, weights: Array, by_least_squares: Array) -> None:
        """New samples (m, …), their weights (m, WEIGHT_COLUMNS), and the predictions (m, 6) of least squares."""
        if self._last + len(samples) > len(self._samples):
            self._compact(len(samples))
        new = slice(self._last, self._last + len(samples))
        self._samples[new], self._extra[new, _WEIGHTS] = samples, weights
        self._extra[new, _BY_LEAST_SQUARES] = by_least_squares
        self._last = new.stop
        self._first = self._oldest()

    def _compact(self, count: int) -> None:
        """Move what is young enough to the front, with room for ``count`` more."""
        drop = max(min(self.first - self._dropped, self._last - self._newest), 0)
        kept = self._last - drop
        size = max(len(self._samples), 2 * (kept + count))
        for name in ("_samples", "_extra"):
            old = getattr(self, name)
            new = np.empty((size, old.shape[1]))
            new[:kept] = old[drop : self._last]
            setattr(self, name, new)
        self._last, self._dropped = kept, self._dropped + drop
        self._first = max(self._first - drop, 0)

    @property
    def first(self) -> int:
        """Number of the oldest sample that is young enough."""
        return max(self._begin, self._dropped + self._first)

    def _oldest(self) -> int:
        """Its row."""
        low = max(self._begin - self._dropped, self._first)
        times = self._samples[low : self._last, _TIME]
        return low + int(np.searchsorted(times, times[-1] - SAMPLE_MEMORY)) if len(times) else low

    def since(self, number: int) -> Array:
        """Samples (n, …) from a number on, of those that are young enough: a view."""
        return self._samples[max(number, self.first) - self._dropped : self._last]

    def weights(self, number: int) -> Array:
        """(n, WEIGHT_COLUMNS) of ``since``: a view."""
        return self._extra[max(number, self.first) - self._dropped : self._last, _WEIGHTS]

    def by_least_squares(self, number: int) -> Array:
        """Predictions (n, 6) of ``since`` by least squares: a view."""
        return self._extra[max(number, self.first) - self._dropped : self._last, _BY_LEAST_SQUARES]

    def newest(self) -> Array:
        """The newest samples (n, …), however old: a view."""
        return self._samples[max(self._last - self._newest, 0) : self._last]

    def forget_predictions(self, axes: list[int]) -> None:
        """Leave out what was predicted of some axes: their model is another one now."""
        for axis in axes:
            self._samples[: self._last, CoefficientSample.VALID.start + axis] = 0.0


@dataclass(frozen=True)
class ParameterCheckpoint:
    """All that was known at a time [s]; copies that nobody changes."""

    time: float
    describe: Description  # makes ``found``: seldom needed, and work
    least_squares: RlsState
    estimator: Any  # what ``Estimator.checkpoint`` gave, if another one is published; else None
    changed: Array  # (2, 6) when each axis changed last: [s] as in CoefficientSample.TIME, [s] of flight
    ranges: Array  # (3, 2) learnt between these V, alpha, beta
    carried: ParameterSet | None = None  # ``found`` as another model has it, which came since
    moved: float = 0.0  # [s] by which its clock shows more than the first one of the flight, see ``Learning``

    @cached_property
    def found(self) -> ParameterSet:
        """As it was published then."""
        return self.describe() if self.carried is None else self.carried

    @cached_property
    def said(self) -> Array:
        """Values and standard errors (2, parameters) as they were published then."""
        return np.array([(p.value, p.std) for p in self.found.parameters]).reshape(-1, 2).T

    @cached_property
    def within_flight(self) -> Array:
        """The same with the standard errors of what differs from one time of the flight to another: what sensors that
        nobody described leave in doubt is alike at both, see ``Description.shared_variance``.
        """
        if self.carried is not None:
            return self.said
        value, std = self.said
        return np.array([value, np.sqrt(np.maximum(std**2 - self.describe.shared_variance(), 0.0))])

    @cached_property
    def theta(self) -> Array:
        """The same values (parameters,), 0 where nothing was known."""
        return np.nan_to_num(self.describe.values() if self.carried is None else self.said[0])

    def without_time(self) -> ParameterCheckpoint:
        """The same after the clock started over: what was found then has no age on it."""
        carried = None if self.carried is None else replace(self.carried, time=np.nan)
        return replace(self, describe=self.describe._replace(time=np.nan), carried=carried)


#: Makes of a checkpoint one of another model.
Carry = Callable[[ParameterCheckpoint], ParameterCheckpoint]


class Checkpoints:
    """The checkpoints of the newest half minute, and per axis since when they are sound."""

    def __init__(self) -> None:
        self._kept: deque[ParameterCheckpoint] = deque()
        self._slot = -np.inf
        self._sound_since = np.full(len(AXES), -np.inf)
        self._fallback: list[ParameterCheckpoint | None] = [None] * len(AXES)

    def clear(self) -> None:
        """The clock or the model is another one."""
        self.__init__()  # type: ignore[misc]

    def is_due(self, time: float) -> bool:
        """Whether a checkpoint is to be kept at ``time`` [s]."""
        before, self._slot = self._slot, float(np.floor(time / SPACING))
        return bool(self._slot != before)

    def keep(self, kept: ParameterCheckpoint) -> None:
        """One more."""
        self._kept.append(kept)
        while self._kept[0].time < kept.time - CHECKPOINT_MEMORY:
            self._kept.popleft()

    def newest(self) -> ParameterCheckpoint | None:
        """The newest checkpoint."""
        return self._kept[-1] if self._kept else None

    def before(self, time: float, axis: int) -> ParameterCheckpoint | None:
        """Newest checkpoint that is not younger than ``time`` [s] and sound in an axis; None where there is none."""
        for kept in reversed(self._kept):
            if self._sound_since[axis] < kept.time <= time:
                return kept
        return self._fallback[axis]

    def go_on(self, before: Checkpoints, carry: Carry) -> None:
        """The newest of ``before``, and what each axis knew some time ago, as another model has them by ``carry``."""
        newest, now = before.newest(), -np.inf
        if newest is not None:
            self.keep(carry(newest))
            now = newest.time
        for axis in range(len(AXES)):
            kept = before.before(now - THRESHOLDS.unspoilt, axis)
            self.begin_anew(axis, now, None if kept is None else carry(kept))

    def begin_anew(self, axis: int, now: float, fallback: ParameterCheckpoint | None) -> None:
        """Checkpoints from before ``now`` [s] say nothing of an axis any more, but for one."""
        self._sound_since[axis], self._fallback[axis] = now, fallback
