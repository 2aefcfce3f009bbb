"""A moment that is there from one time on, or for a while, and that no recorded input shows.

A rudder that goes hard over while its command hardly moves, a flap, a load on one wing, a centre of gravity that moved:
each is another constant in the balances of moments. Which of them it was such a flight does not tell, since no vane
measures the angle that it makes. It does tell that there is something, in which axes, from when to when, and what
deflection would do the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aircraft_sysid_ros.diagnosis.failures.axis_relation import ENGINE
from aircraft_sysid_ros.diagnosis.failures.failure_search import FailureSearch, Judged
from aircraft_sysid_ros.diagnosis.failures.held_out import held_out_errors
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS

#: A deflection is worked out where what the input does is known to this share of it, and said if the axes agree within
#: so many standard errors and a third of it: far out a surface acts in roughly the shares of a small deflection.
_KNOWN, _AGREE, _ROUGHLY = 0.25, 3.0, 1.0 / 3.0


@dataclass(frozen=True)
class UnrecordedChange:
    """Another constant of some moments, for a while or for good."""

    begin: float  # [s] from the first sample of the IMU
    end: float | None  # [s]; None: to the end of the flight
    begin_error: float  # [s] two standard errors
    end_error: float
    evidence: float  # ln of the likelihood over that of the model as it is, less what free numbers cost
    gains: dict[str, float]  # the same by axis
    main_axis: str
    size: float  # share of the error of the main axis that goes
    error_before: float  # of the main axis on flight that was held out
    error_after: float
    like: dict[str, tuple[float, float]]  # inputs: what they would have to move by besides, and its standard error


def unrecorded_change(searched: Iterable[tuple[FailureSearch, Judged]], begin: float) -> UnrecordedChange | None:
    """The likeliest of the changes of constants that were sought, where it is one beyond doubt.

    ``begin`` [s] of the first point of the series.
    """
    search, best = max(searched, key=lambda item: item[1].evidence, default=(None, None))
    if search is None or best is None or best.evidence < THRESHOLDS.unrecorded_evidence:
        return None
    hypothesis = best.hypothesis
    axis = max(best.gains, key=lambda a: best.gains[a])
    size = 1.0 - float(np.exp(-best.gains[axis] / search.count))  # a gain is n times ln of the ratio of errors
    if size < THRESHOLDS.size:
        return None
    gains = {a: gain for a, gain in best.gains.items() if gain > np.log(search.count)}
    before, after = held_out_errors(search, hypothesis, axis)
    errors, lasts = search.time_errors(best), hypothesis.lasts(search.count)
    return UnrecordedChange(
        begin + search.step * hypothesis.begin, None if lasts else begin + search.step * hypothesis.end,
        errors[0], np.nan if lasts else errors[1], best.evidence, gains, axis, size, before, after,
        {name: moved for name in search.names if (moved := _deflection(search, best, name, gains)) is not None},
    )  # fmt: skip


def _deflection(search: FailureSearch, best: Judged, name: str, gains: Iterable[str]) -> tuple[float, float] | None:
    """What an input would have to move by besides, with its standard error; None where the axes do not agree on it."""
    told: list[tuple[float, float]] = []
    for axis in gains:
        acting = search.relations[axis].acting
        if name == ENGINE or name not in acting or len(acting[name].columns) != 1:
            return None
        fit, at = search.fitted(axis, best.hypothesis), acting[name].columns[0]
        effect, effect_std = fit.parameters[at], fit.std[at]
        if effect_std > _KNOWN * abs(effect):
            return None
        moved = float(fit.parameters[-1] / effect)
        told.append((moved, float(np.hypot(fit.std[-1] / effect, moved * effect_std / effect))))
    values, std = np.array(told).T
    if np.ptp(values) > _AGREE * float(np.hypot.reduce(std)) + _ROUGHLY * float(np.abs(values).max()):
        return None
    weight = 1.0 / std**2
    return float(values @ weight / weight.sum()), float(weight.sum() ** -0.5)
