"""ImuEpochs of recursive maximum likelihood between states that are far apart.

The filters of ``likelihood_recursion`` take the controls to be a straight line from epoch to epoch. At 10 Hz that takes
3 % of the motion of a surface at 1 Hz away, and the derivatives explain it. Between two such epochs others are put in,
STEP apart, without measurements: their controls are cubic through four epochs (``signals.cubic``), so that an epoch
waits for the next one. All else is a straight line.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.flight_model.layout import REFERENCE
from aircraft_sysid_ros.identification.coefficients.signals import cubic
from aircraft_sysid_ros.identification.estimators.likelihood_state import ImuEpochs
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]

#: Time [s] between epochs, at most.
STEP = 0.025


class DenseEpochs:
    """Takes epochs in order of time, in portions of any size."""

    def __init__(self) -> None:
        self._kept: ImuEpochs | None = None  # the newest three at most, of which the last may wait
        self._given = 0  # how many of them have been given

    def add(self, epochs: ImuEpochs, longest: float) -> ImuEpochs:
        """ImuEpochs that are due, with others between them where they are sparse.

        ``longest`` time [s] between two that is filled; 0: they are dense, and all are due as they are.
        """
        if self._kept is not None:
            epochs = ImuEpochs._make(np.concatenate(pair) for pair in zip(self._kept, epochs, strict=True))
        first, count = self._given, len(epochs.time)
        due = max(count - 1, first) if longest > 0.0 else count
        start = max(due - 2, 0)
        self._kept, self._given = part_of(epochs, start, count), due - start
        return filled(epochs, first, due, longest) if longest > 0.0 and due > first else part_of(epochs, first, due)


def part_of(epochs: ImuEpochs, first: int, last: int) -> ImuEpochs:
    """ImuEpochs ``first`` to ``last``, without the latter."""
    return ImuEpochs._make(array[first:last] for array in epochs)


def filled(epochs: ImuEpochs, first: int, due: int, longest: float) -> ImuEpochs:
    """ImuEpochs ``first`` to ``due``, without the latter, and those between each and the one before it."""
    times, number = [], []
    for k in range(first, due):
        span = epochs.time[k] - epochs.time[k - 1] if k else np.inf
        pieces = max(int(np.ceil(span / STEP - 0.5)), 1) if span <= longest else 1
        times.append(
            epochs.time[k] - span * np.arange(pieces - 1, -1, -1.0) / pieces if pieces > 1 else [epochs.time[k]]
        )
        number.append(np.full(pieces, k))
    at, end = np.concatenate(times), np.concatenate(number)
    begin = np.maximum(end - 1, 0)
    span = epochs.time[end] - epochs.time[begin]
    weight = np.where(at < epochs.time[end], (at - epochs.time[begin]) / np.where(span > 0.0, span, 1.0), 1.0)[:, None]

    def between(series: Array) -> Array:
        return np.where(weight < 1.0, (1.0 - weight) * series[begin] + weight * series[end], series[end])

    inputs, rows = between(epochs.inputs), between(epochs.rows)
    rows[:, StateField.ORIGIN] = epochs.rows[end][:, StateField.ORIGIN]  # to the bit: another one starts over
    curved = cubic(epochs.time, epochs.inputs, at, longest)
    inputs = np.where(np.isfinite(curved) & (weight < 1.0), curved, inputs)
    for attitude in (inputs[:, REFERENCE], rows[:, StateField.ATTITUDE]):
        attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    imu = np.where(weight < 1.0, np.nan, epochs.imu[end])
    usable = epochs.usable[end] & (epochs.usable[begin] | (weight[:, 0] == 1.0))
    ends = between(epochs.end[:, None])[:, 0]
    return ImuEpochs(at, ends, usable, imu, inputs, rows, between(epochs.history))
