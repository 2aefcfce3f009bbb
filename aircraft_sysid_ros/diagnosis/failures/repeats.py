"""When something is there, of something whose begin and end are not known: all of its times in a flight.

A loose plug comes and goes, and a test of failures is flown more than once. With what a failure does known, each moment
of the flight tells by its own innovations whether it is there: the likeliest sequence of there and absent is that of
Viterbi, with a price for each change.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Span = tuple[float, float]


def times_there(gains: Array, change: float, shortest: int) -> list[Span]:
    """First and last points of all times that are long enough; what lies between two that are near is part of them.

    ``gains`` (n,): ln of the likelihood of each point if it is there over that if it is not; ``change``: the price.
    """
    there = likeliest(gains, change)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(np.int8), [0]]))).astype(float).tolist()
    joined: list[Span] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if joined and begin - joined[-1][1] < shortest:
            begin = joined.pop()[0]
        joined.append((begin, end))
    return [(begin, end) for begin, end in joined if end - begin >= shortest]


def likeliest(gains: Array, change: float) -> Mask:
    """The likeliest sequence (n,) of what is there and what is not, which begins absent."""
    n = len(gains)
    there, absent = -change, 0.0
    was_there = np.zeros((n, 2), np.bool_)  # the point before, of the best way to absent and to there
    for k, gain in enumerate(gains.tolist()):
        was_there[k] = there - change > absent, there >= absent - change
        there, absent = max(there, absent - change) + gain, max(absent, there - change)
    state = np.empty(n, np.bool_)
    now = there > absent
    for k in range(n - 1, -1, -1):
        state[k] = now
        now = bool(was_there[k, int(now)])
    return state
