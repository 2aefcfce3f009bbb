"""A moment that is there from one time on, or for a while, and that no recorded input shows.

A rudder that goes hard over while its command hardly moves, a flap, a load on one wing, a centre of gravity that moved:
each is another constant in the balances of moments. Which of them it was such a flight does not tell, since no vane
measures the angle that it makes, nor how large it is, since the sideslip or angle of attack that it makes turns
most of it back. It does tell that there is something, about which axes, and from when to when.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aircraft_sysid_ros.diagnosis.failures.failure_search import FailureSearch, Judged
from aircraft_sysid_ros.diagnosis.failures.held_out import held_out_errors
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS


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


def unrecorded_change(searched: Iterable[tuple[FailureSearch, Judged]], first: float) -> UnrecordedChange | None:
    """The likeliest of the changes of constants that were sought, where it is one beyond doubt.

    ``first`` [s]: time of the first point of the series.
    """
    search, best = max(searched, key=lambda item: item[1].evidence, default=(None, None))
    if search is None or best is None or best.evidence < THRESHOLDS.unrecorded_evidence:
        return None
    hypothesis = best.hypothesis
    axis = max(best.gains, key=lambda a: best.gains[a])
    size = 1.0 - float(np.exp(-best.gains[axis] / search.count))  # a gain is n times ln of the ratio of errors
    if size < THRESHOLDS.unrecorded_size:
        return None
    gains = {a: gain for a, gain in best.gains.items() if gain > np.log(search.count)}
    before, after = held_out_errors(search, hypothesis, axis)
    errors, lasts = search.time_errors(best), hypothesis.lasts(search.count)
    return UnrecordedChange(
        first + search.step * hypothesis.begin, None if lasts else first + search.step * hypothesis.end,
        errors[0], np.nan if lasts else errors[1], best.evidence, gains, axis, size, before, after,
    )  # fmt: skip
