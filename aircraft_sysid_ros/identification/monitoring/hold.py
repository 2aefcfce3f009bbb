"""A hold: why an axis is held, what is published meanwhile, and how it ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SURFACE_WORDS
from aircraft_sysid_ros.identification.history import ParameterCheckpoint
from aircraft_sysid_ros.identification.monitoring.sensor_faults import LOST
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate, ParameterSet
from aircraft_sysid_ros.identification.trust import Trust

Array = npt.NDArray[np.float64]

#: Time [s] that is before any by the clock of now, and one that was.
_BEFORE_ALL = -float(np.finfo(np.float64).max)


@dataclass
class Hold:
    """Why an axis is held."""

    since: float  # [s] first sign
    begun: float  # [s] when it was held
    words: str
    good: ParameterCheckpoint | None  # what is published; None: nothing was known before
    sensor: bool  # a sensor is suspected
    high: bool  # its error was too large
    contradicts: bool = False  # what was known, without a larger error: a model that lacks something does so
    lacks: str = ""  # that the model does not explain the coefficient, in words, where that is so
    stuck: str = ""  # a surface of which nothing is left, or whose record stands still: "de" and so on
    still: float = -np.inf  # [s] when its record was last seen to stand still
    sure: bool = False  # the words say which sensor it is
    last_heard: float = np.nan  # [s] of the sensor that the words call lost
    told: bool = False  # they name one that is lost, or that contradicts all others by itself
    leader: int | None = None  # the axis that found it stuck, whose end is the end of this one
    is_beside: bool = False  # it agrees with what was known, and another axis contradicts that

    def rename(self, words: str) -> None:
        """Say what explains it, unless a sensor is known to be lost or wrong, or contradicts all others by itself."""
        if not (self.sure or self.told):
            self.words = words

    def restart_clock(self) -> None:
        """The clock started over: what was by the other one was before all that is by this one."""
        self.since = self.last_heard = np.nan
        self.begun, self.still = -np.inf, min(self.still, _BEFORE_ALL)
        if self.good is not None:
            self.good = self.good.without_time()

    @property
    def said_since(self) -> float:
        """Time [s] from which on it is so; learning goes back to before it, by more where a sensor was lost."""
        is_lost = self.words in LOST and np.isfinite(self.last_heard)
        return self.last_heard if is_lost else self.since

    @property
    def what(self) -> str:
        """What is wrong, in words."""
        if not self.stuck:
            return self.lacks or self.words
        recorded = self.still > -np.inf
        surface = SURFACE_WORDS[self.stuck]
        return f"the record of the {surface} stands still" if recorded else f"the {surface} is stuck or lost"


class Release(Enum):
    """How a hold ends: learning goes back to the good set, or on from what is newest."""

    BACK = 1
    ON = 2


class Restore(NamedTuple):
    """Command: an axis is to know again what it knew at a checkpoint, and nothing of what came since."""

    axis: int
    checkpoint: ParameterCheckpoint


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


def _since(time: float, start: float) -> str:
    """A time [s] of a flight since ``start`` [s]; NaN: by a clock that has started over since."""
    return f"{max(time - start, 0.0):.1f} s" if np.isfinite(time) else "before this manoeuvre or clock"


def with_holds(
    found: ParameterSet, holds: list[Hold | None], model: AerodynamicModel, changed: Array, start: float
) -> ParameterSet:
    """What is published while axes are held: they ``changed`` (6,) [s] last then, ``start`` [s] of the flight."""
    parameters, covariance = list(found.parameters), found.covariance.copy()
    for axis, hold in enumerate(holds):
        if hold is None:
            continue
        part = model.axis_slice(AXES[axis])
        words = f"{hold.what} since {_since(hold.said_since, start)}"
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
