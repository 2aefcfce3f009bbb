"""Knots of recursive maximum likelihood between states that are far apart.

The filters of ``likelihood_recursion`` take the controls to be a straight line from knot to knot. At 10 Hz that takes
3 % of the motion of a surface at 1 Hz away, and the derivatives explain it. Between two such knots others are put in,
STEP apart, without measurements: their controls are cubic through four knots (``signals.cubic``), so that a knot waits
for the next one. All else is a straight line.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.flight_model.layout import REFERENCE
from aircraft_sysid_ros.modelling.likelihood_state import Knots
from aircraft_sysid_ros.modelling.signals import cubic
from aircraft_sysid_ros.reconstruction.state import Column

Array = npt.NDArray[np.float64]

#: Time [s] between knots, at most.
STEP = 0.025


class DenseKnots:
    """Takes knots in order of time, in portions of any size."""

    def __init__(self) -> None:
        self._kept: Knots | None = None  # the newest three at most, of which the last may wait
        self._given = 0  # how many of them have been given

    def take(self, knots: Knots, longest: float) -> Knots:
        """Knots that are due, with others between them where they are sparse.

        ``longest`` time [s] between two that is filled; 0: they are dense, and all are due as they are.
        """
        if self._kept is not None:
            knots = Knots._make(np.concatenate(pair) for pair in zip(self._kept, knots, strict=True))
        first, count = self._given, len(knots.time)
        due = max(count - 1, first) if longest > 0.0 else count
        start = max(due - 2, 0)
        self._kept, self._given = part_of(knots, start, count), due - start
        return filled(knots, first, due, longest) if longest > 0.0 and due > first else part_of(knots, first, due)


def part_of(knots: Knots, first: int, last: int) -> Knots:
    """Knots ``first`` to ``last``, without the latter."""
    return Knots._make(array[first:last] for array in knots)


def filled(knots: Knots, first: int, due: int, longest: float) -> Knots:
    """Knots ``first`` to ``due``, without the latter, and those between each and the one before it."""
    times, number = [], []
    for k in range(first, due):
        span = knots.time[k] - knots.time[k - 1] if k else np.inf
        pieces = int(np.ceil(span / STEP - 0.5)) if span <= longest else 1
        times.append(knots.time[k] - span * np.arange(pieces - 1, -1, -1.0) / pieces if pieces > 1 else [knots.time[k]])
        number.append(np.full(pieces, k))
    at, end = np.concatenate(times), np.concatenate(number)
    begin = np.maximum(end - 1, 0)
    span = knots.time[end] - knots.time[begin]
    weight = np.where(at < knots.time[end], (at - knots.time[begin]) / np.where(span > 0.0, span, 1.0), 1.0)[:, None]

    def between(series: Array) -> Array:
        return np.where(weight < 1.0, (1.0 - weight) * series[begin] + weight * series[end], series[end])

    inputs, rows = between(knots.inputs), between(knots.rows)
    rows[:, Column.ORIGIN] = knots.rows[end][:, Column.ORIGIN]  # to the bit: another one begins anew
    curved = cubic(knots.time, knots.inputs, at, longest)
    inputs = np.where(np.isfinite(curved) & (weight < 1.0), curved, inputs)
    for attitude in (inputs[:, REFERENCE], rows[:, Column.ATTITUDE]):
        attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    imu = np.where(weight < 1.0, np.nan, knots.imu[end])
    usable = knots.usable[end] & (knots.usable[begin] | (weight[:, 0] == 1.0))
    ends = between(knots.end[:, None])[:, 0]
    return Knots(at, ends, usable, imu, inputs, rows, between(knots.history))
