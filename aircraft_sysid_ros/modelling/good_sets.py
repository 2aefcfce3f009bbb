"""What was known at times of the newest half minute, and how to go back to it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.modelling.parameter_set import ParameterSet
from aircraft_sysid_ros.modelling.regression import Learning

Array = npt.NDArray[np.float64]

#: Time [s] between sets that are kept, and for how long they are.
SPACING, MEMORY = 1.0, 30.0
_BY_AXIS = ("theta", "p", "sums", "updates", "doubt", "prior", "prior_variance", "sampling")
_BY_PARAMETER = ("noise_square", "last_learnt")


@dataclass(frozen=True)
class KnownSet:
    """All that was known at a time [s]; copies that nobody changes."""

    time: float
    describe: Callable[[], ParameterSet]  # makes ``found``: seldom needed, and work
    learning: Learning  # of recursive least squares
    learner: object  # what ``Learner.remember`` gave; None without one
    changed: Array  # (2, 6) times of Changes: since, times
    ranges: Array  # (3, 2) learnt between these V, alpha, beta

    @cached_property
    def found(self) -> ParameterSet:
        """As it was published then."""
        return self.describe()

    @cached_property
    def theta(self) -> Array:
        """The same values (parameters,), 0 where nothing was known."""
        return np.nan_to_num(np.array([p.value for p in self.found.parameters]))

    def without_time(self) -> KnownSet:
        """The same after the clock began anew: what was found then has no age on it."""
        found = replace(self.found, time=np.nan)
        return replace(self, describe=lambda: found)


def copied(learning: Learning) -> Learning:
    """A copy of its own."""
    return learning._replace(**{name: array.copy() for name, array in learning._asdict().items()})


def go_back(axis: int, model: AerodynamicModel, learning: Learning, before: Learning) -> None:
    """Make of one axis what it was, in place. What followed in time is no neighbour of what comes."""
    for name in _BY_AXIS:
        getattr(learning, name)[axis] = getattr(before, name)[axis]
    part = model.axis_slice(AXES[axis])
    for name in _BY_PARAMETER:
        getattr(learning, name)[part] = getattr(before, name)[part]
    learning.recent[axis], learning.last_valid[axis] = np.nan, -np.inf


class GoodSets:
    """The sets of the newest half minute, and per axis since when they are sound."""

    def __init__(self) -> None:
        self._kept: deque[KnownSet] = deque()
        self._slot = -np.inf
        self._sound_since = np.full(len(AXES), -np.inf)
        self._fallback: list[KnownSet | None] = [None] * len(AXES)

    def clear(self) -> None:
        """The clock or the model is another one."""
        self.__init__()  # type: ignore[misc]

    def is_due(self, time: float) -> bool:
        """Whether a set is to be kept at ``time`` [s]."""
        before, self._slot = self._slot, float(np.floor(time / SPACING))
        return bool(self._slot != before)

    def keep(self, kept: KnownSet) -> None:
        """One more."""
        self._kept.append(kept)
        while self._kept[0].time < kept.time - MEMORY:
            self._kept.popleft()

    def newest(self) -> KnownSet | None:
        """The newest set."""
        return self._kept[-1] if self._kept else None

    def before(self, time: float, axis: int) -> KnownSet | None:
        """Newest set that is not younger than ``time`` [s] and sound in an axis; None where there is none."""
        sound = [k for k in self._kept if self._sound_since[axis] < k.time <= time]
        return sound[-1] if sound else self._fallback[axis]

    def begin_anew(self, axis: int, now: float, fallback: KnownSet | None) -> None:
        """Sets from before ``now`` [s] say nothing of an axis any more, but for one."""
        self._sound_since[axis], self._fallback[axis] = now, fallback
