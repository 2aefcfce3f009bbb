"""A moment that is there from one time on, or for a while, and that no recorded input shows.

A rudder that goes hard over while its command hardly moves, a flap, a load on one wing, a centre of gravity that moved:
each is another constant in the balances of moments. Which of them it was such a flight does not tell, since no vane
measures the angle that it makes, nor how large it is, since the sideslip or angle of attack that it makes turns
most of it back. It does tell that there is something, about which axes, and from when to when.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from aircraft_sysid_ros.diagnosis.failures.episode import Episode, times_of
from aircraft_sysid_ros.diagnosis.failures.failure_search import FailureSearch, Judged
from aircraft_sysid_ros.diagnosis.failures.held_out import held_out_errors
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS


class UnrecordedChange(Episode):
    """Another constant of some moments, for a while or for good."""


def unrecorded_change(searched: Iterable[tuple[FailureSearch, Judged]], first: float) -> UnrecordedChange | None:
    """The likeliest of some changes of constants, which are sure, where it has size and the rest is understood.

    ``first`` [s]: time of the first point of the series.
    """
    understood = [(search, judged) for search, judged in searched if _explains(search, judged)]
    search, best = max(understood, key=lambda item: item[1].evidence, default=(None, None))
    if search is None or best is None:
        return None
    axis = best.main_axis
    size = 1.0 - float(np.exp(-best.gains[axis] / search.count))  # a gain is n times ln of the ratio of errors
    if size < THRESHOLDS.unrecorded_size:
        return None
    gains = {a: gain for a, gain in best.gains.items() if gain > np.log(search.count)}
    errors = {a: held_out_errors(search, best.hypothesis, a) for a in gains}
    times = times_of(search, best, first)
    return UnrecordedChange(times=times, evidence=best.evidence, gains=gains, main_axis=axis, size=size, errors=errors)


def _explains(search: FailureSearch, judged: Judged) -> bool:
    """Whether the model with the change explains enough of its main axis for a change in that to mean something.

    Where gyros are noisy the acceleration is noise for the most part, and the derivatives are not found in it: what the
    one turn of a flight does is then as well a constant for as long as it lasts.
    """
    axis = judged.main_axis
    left = np.var(search.fitted(axis, judged.hypothesis).residual) / np.var(search.relations[axis].response)
    return bool(1.0 - left >= THRESHOLDS.unrecorded_explained)
