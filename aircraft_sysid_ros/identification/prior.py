"""What earlier flights say of an axis helps to tell its terms apart, and is dropped where this flight contradicts it.

This flight says theta with the covariance C of one axis, earlier ones m with the variances d (n,), of those parameters
that they say anything of: D = diag(d), and no information of the others. Together

    F = (C^-1 + D^-1)^-1,    theta_F = theta + F D^-1 (m - theta).

Published is of each parameter j what this flight says of it with the help of what earlier ones say of the *others*,

    c_j = F_jj / (1 - F_jj / d_j),    theta_j = (theta_F,j - F_jj / d_j m_j) / (1 - F_jj / d_j),

with the correlations of F. So a prior tells collinear terms apart sooner, and never vouches for its own parameter: one
that has changed since is as free as without. Where one that would be to USE without the prior is further from it than
``prior_sigma`` standard errors of both, those of this flight ``prior_wider``, at some looks in a row, the prior of the
axis is dropped for good, and from then on all is as without it.

Nothing but what is published knows of the prior: estimators, residuals and holds are those of a flight without it, and
changes in flight are found as they are without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.fleet_prior import FleetPrior
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.rounding import with_error

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

#: Time [s] between two looks at this flight beside the prior.
LOOK_STEP = 1.0
#: What is added to a correlation matrix that may be singular; this flight says nothing beside less information.
_NEARLY = 1e-9


class AxisPrior(NamedTuple):
    """What earlier flights say of one axis."""

    mean: Array  # (n,)
    information: Array  # (n,) 1 / variance; 0 of what they say nothing of
    flights: str  # whose, in words
    dropped: str = ""  # why it counts no more, as a sentence goes on; empty: it counts


class Helped(NamedTuple):
    """One axis by this flight, each parameter with what earlier ones say of the others."""

    theta: Array  # (n,)
    covariance: Array  # (n, n)
    gain: Array  # (n,) standard error without the prior over that with it, 1 or more


def axis_priors(model: AerodynamicModel, prior: FleetPrior | None) -> list[AxisPrior | None]:
    """What a prior says of each axis of a model; None of an axis that it does not speak of."""
    return [_of_axis(model, axis, prior) for axis in AXES]


def _of_axis(model: AerodynamicModel, axis: str, prior: FleetPrior | None) -> AxisPrior | None:
    names = model.parameter_names[model.axis_slice(axis)]
    known = {} if prior is None else prior.parameters
    if prior is None or not any(name in known for name in names):
        return None
    mean, std = np.array([known.get(name, (0.0, np.inf)) for name in names]).T
    return AxisPrior(mean, 1.0 / std**2, prior.flights)


def helped(theta: Array, covariance: Array, prior: AxisPrior | None) -> Helped | None:
    """One axis (n,), (n, n) with its prior; None where that does not count, or this flight says nothing yet.

    Nor where what comes of it is further from the prior of a parameter than ``prior_sigma`` standard errors of both:
    then another one has changed, and this one would pay for it.
    """
    if prior is None or prior.dropped:
        return None
    with np.errstate(all="ignore"):
        scale = np.sqrt(np.diag(covariance))
        if not (np.all(np.isfinite(theta)) and np.all(np.isfinite(covariance)) and np.all(scale > 0.0)):
            return None
        weight = prior.information * scale**2
        try:
            own = np.linalg.inv(covariance / np.outer(scale, scale) + _NEARLY * np.eye(len(theta)))
            both = np.linalg.inv(own + np.diag(weight))
        except np.linalg.LinAlgError:
            return None
    both = 0.5 * (both + both.T)
    together = theta + scale * (both @ (weight * (prior.mean - theta) / scale))
    rest = 1.0 - np.diag(both) * weight  # share of the information on a parameter that is not its own prior
    if not np.all(rest > _NEARLY):
        return None
    alone = (together - (1.0 - rest) * prior.mean) / rest
    std = np.minimum(np.sqrt(np.diag(both) / rest), 1.0)
    if np.any(_apart(alone, scale * std, prior) > THRESHOLDS.prior_sigma):
        return None
    grown = scale * std / np.sqrt(np.diag(both))
    return Helped(alone, both * np.outer(grown, grown), 1.0 / std)


def _apart(value: Array, std: Array, prior: AxisPrior) -> Array:
    """By how many standard errors of both a flight and a prior differ (n,); 0 of what the prior says nothing of."""
    of_prior = np.sqrt(1.0 / np.where(prior.information > 0.0, prior.information, np.inf))
    return np.where(prior.information > 0.0, np.abs(value - prior.mean) / np.hypot(std, of_prior), 0.0)


def contradiction(names: Sequence[str], value: Array, std: Array, is_used: Bools, prior: AxisPrior) -> str:
    """What of this flight contradicts the prior, as a sentence goes on; empty: nothing does.

    ``value`` and ``std`` (n,) are by this flight alone; only what is to USE by it alone (n,) can contradict.
    """
    asked = is_used & (prior.information > 0.0)
    apart = np.where(asked, _apart(value, THRESHOLDS.prior_wider * std, prior), 0.0)
    j = int(np.argmax(apart))
    if apart[j] <= THRESHOLDS.prior_sigma:
        return ""
    earlier = with_error(float(prior.mean[j]), float(prior.information[j]) ** -0.5)
    return f"{names[j]} is {with_error(float(value[j]), float(std[j]))}, and {prior.flights} say {earlier}"


class FleetKnowledge:
    """The priors of all axes while a flight goes on, and why one counts no more."""

    def __init__(self, model: AerodynamicModel, prior: FleetPrior | None) -> None:
        self._model = model
        self.axes = axis_priors(model, prior)
        self._due, self._times = -np.inf, [0] * len(AXES)  # looks in a row that found a contradiction

    @property
    def is_there(self) -> bool:
        """Whether any axis has one, dropped or not."""
        return any(axis is not None for axis in self.axes)

    def restart_clock(self) -> None:
        """The clock started over."""
        self._due = -np.inf

    def is_due(self, time: float) -> bool:
        """Whether it is time [s] to look at this flight beside it; then the next look is a step later."""
        if not self.is_there or time < self._due:
            return False
        self._due = time + LOOK_STEP
        return True

    def drop(self, axis: int, why: str) -> None:
        """The prior of an axis counts no more."""
        prior = self.axes[axis]
        if prior is not None and not prior.dropped:
            self.axes[axis] = prior._replace(dropped=why)

    def look(self, axis: int, value: Array, std: Array, is_used: Bools, time: float) -> None:
        """Drop the prior of an axis that this flight contradicts; ``time`` [s] of flight, the rest as it takes."""
        prior = self.axes[axis]
        if prior is None or prior.dropped:
            return
        names = self._model.parameter_names[self._model.axis_slice(AXES[axis])]
        why = contradiction(names, value, std, is_used, prior)
        self._times[axis] = self._times[axis] + 1 if why else 0
        if self._times[axis] >= THRESHOLDS.prior_looks:
            self.drop(axis, f"dropped at {time:.1f} s: {why}")

    def adopt(self, model: AerodynamicModel) -> None:
        """Another model: coefficients of other terms are other ones, and earlier flights say nothing of them."""
        for axis, name in enumerate(AXES):
            if model.terms[name] != self._model.terms[name]:
                self.axes[axis] = None
        self._model = model

    def notes(self) -> list[str]:
        """What came of the prior, for people."""
        of_axes = [(name, axis) for name, axis in zip(AXES, self.axes, strict=True) if axis is not None]
        used = [name for name, axis in of_axes if not axis.dropped]
        said = [f"prior of {of_axes[0][1].flights}: counts in {', '.join(used)}"] if used else []
        return said + [f"the prior of {name} was {axis.dropped}" for name, axis in of_axes if axis.dropped]

    @property
    def json(self) -> dict[str, str]:
        """By axis: that it counts, or why not."""
        return {name: axis.dropped or "counts" for name, axis in zip(AXES, self.axes, strict=True) if axis is not None}
