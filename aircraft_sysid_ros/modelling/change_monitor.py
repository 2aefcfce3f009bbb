"""Has the aeroplane changed? The model error of a second, against what it was since the parameters were known.

Per axis: e = measured - predicted before the sample, where the axis learns. The mean square over the newest WINDOW of
these is compared with those of earlier blocks of the same length, of which the newest GUARD evaluations are left out:
a change is not to be in what it is measured by. The alarm wants both, RATIO times the rms of all blocks and WORST
times the largest of them, over PATIENCE looks. Errors of a model that is always wrong somewhere raise the bar by
themselves. Gusts that set in, or a noisier sensor, raise the errors of most axes, a change of the aeroplane those of
some: by what the errors have grown in all but the quietest two axes is not counted. Nor is a window that is spread over
SPREAD times its length: in cruise an axis learns now and then, from what is not motion.

When the change was: with n errors of variance s^2 before it and RATIO^2 s^2 since, the sum of

    e^2 / s^2 - ln(RATIO^2) RATIO^2 / (RATIO^2 - 1)

from a time on is largest from the most likely one on (Page 1954, cumulative sums of log likelihoods).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.modelling.regression import Point

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Evaluations (25 per second) of the window and of a block; those between the window and the blocks, the window too.
WINDOW, GUARD = 25, 50
#: Blocks that are remembered, and how many there must be.
MOST_BLOCKS, LEAST_BLOCKS = 60, 8
#: Rms of the window over that of all blocks, and over that of the largest.
RATIO, WORST = 5.0, 3.0
#: Looks in a row.
PATIENCE = 2

SPREAD = 2.0
#: How many axes are quieter than the one that tells by what the errors of all have grown.
_QUIETEST = 2

_MEASURED, _PREDICTED, _LEARNT = Point.MEASURED.start, Point.PREDICTED.start, Point.LEARNT.start


class Errors(NamedTuple):
    """Squared model errors of six axes."""

    newest: Array  # (6, GUARD) newest first
    time: Array  # (6, GUARD) [s] of them
    filled: Integers  # (6,) how many there are
    block: Array  # (6, 2) sum and count of the block that is being filled
    blocks: Array  # (6, MOST_BLOCKS) mean squares, newest first
    block_count: Integers  # (6,)


@njit(cache=True)
def add_errors(points: Array, known: npt.NDArray[np.bool_], errors: Errors) -> None:
    """Take points (m, …) of the axes (6,) whose parameters are known, in place."""
    for point in points:
        for axis in range(6):
            e = point[_MEASURED + axis] - point[_PREDICTED + axis]
            if not (known[axis] and point[_LEARNT + axis] > 0.0 and np.isfinite(e)):
                continue
            if errors.filled[axis] == GUARD:
                _add_to_block(axis, errors.newest[axis, GUARD - 1], errors)
            errors.newest[axis, 1:] = errors.newest[axis, : GUARD - 1].copy()
            errors.time[axis, 1:] = errors.time[axis, : GUARD - 1].copy()
            errors.newest[axis, 0], errors.time[axis, 0] = e * e, point[0]
            errors.filled[axis] = min(errors.filled[axis] + 1, GUARD)


@njit(cache=True)
def _add_to_block(axis: int, square: float, errors: Errors) -> None:
    errors.block[axis, 0] += square
    errors.block[axis, 1] += 1.0
    if errors.block[axis, 1] == WINDOW:
        errors.blocks[axis, 1:] = errors.blocks[axis, : MOST_BLOCKS - 1].copy()
        errors.blocks[axis, 0] = errors.block[axis, 0] / WINDOW
        errors.block_count[axis] = min(errors.block_count[axis] + 1, MOST_BLOCKS)
        errors.block[axis] = 0.0


@njit(cache=True)
def summarise(errors: Errors, longest: float, out: Array) -> None:
    """Mean square of window, all blocks and largest block into ``out`` (6, 3); NaN where they do not compare."""
    out[:] = np.nan
    for axis in range(6):
        span = errors.time[axis, 0] - errors.time[axis, WINDOW - 1]
        count = errors.block_count[axis]
        if count >= LEAST_BLOCKS and errors.filled[axis] >= WINDOW and span <= longest:
            blocks = errors.blocks[axis, :count]
            if blocks.max() > 0.0:  # a model without any error has no measure of one
                out[axis, 0] = errors.newest[axis, :WINDOW].mean()
                out[axis, 1], out[axis, 2] = blocks.mean(), blocks.max()


@njit(cache=True)
def summarise_blocks(errors: Errors, out: Array) -> None:
    """Mean of the blocks and the largest of them into ``out`` (6, 2); NaN before there are enough."""
    out[:] = np.nan
    for axis in range(6):
        count = errors.block_count[axis]
        if count >= LEAST_BLOCKS:
            out[axis, 0], out[axis, 1] = errors.blocks[axis, :count].mean(), errors.blocks[axis, :count].max()


class ChangeMonitor:
    """Looks at the model errors of all axes."""

    def __init__(self, step: float) -> None:
        """``step`` [s] between evaluations."""
        self._longest = SPREAD * WINDOW * step
        self._errors = Errors(
            newest=np.zeros((6, GUARD)),
            time=np.zeros((6, GUARD)),
            filled=np.zeros(6, np.int64),
            block=np.zeros((6, 2)),
            blocks=np.zeros((6, MOST_BLOCKS)),
            block_count=np.zeros(6, np.int64),
        )
        self._summary, self._usual = np.full((6, 3), np.nan), np.full((6, 2), np.nan)
        self._common = 1.0  # by what the mean square error has grown in most axes
        self._raised = np.zeros(6, np.int64)  # looks in a row at which the error was too large

    def add(self, points: Array, known: npt.NDArray[np.bool_]) -> None:
        """Take points (m, …) of ``Point``; only axes (6,) whose parameters are known count."""
        add_errors(points, known, self._errors)
        self._compare()

    def forget(self, axis: int) -> None:
        """The parameters of an axis are others now: what its errors are is still to be seen."""
        for array in self._errors:
            array[axis] = 0
        self._raised[axis] = 0
        self._compare()

    def skip(self, *axes: int) -> None:
        """What was in the windows is not to be looked at, of some axes or any: sensors were at odds."""
        chosen = list(axes) or slice(None)
        self._errors.filled[chosen] = 0
        self._raised[chosen] = 0
        self._compare()

    def _compare(self) -> None:
        summarise(self._errors, self._longest, self._summary)
        summarise_blocks(self._errors, self._usual)
        grown = np.sort(self._summary[:, 0] / self._summary[:, 1])  # NaN last
        enough = np.isfinite(grown[_QUIETEST + 1])
        self._common = max(float(grown[_QUIETEST]), 1.0) if enough else 1.0

    def usual(self, axis: int) -> tuple[float, float]:
        """Mean square error and largest block of an axis, grown as in most axes; NaN before there are enough blocks."""
        mean, largest = self._usual[axis].tolist()
        return self._common * mean, self._common * largest

    def variance(self, axis: int) -> float:
        """Mean square of the error of an axis in the blocks; 0 without any."""
        count = self._errors.block_count[axis]
        return float(self._errors.blocks[axis, :count].mean()) if count else 0.0

    def excess(self, axis: int) -> float:
        """Variance in the window that the blocks do not explain, over RATIO^2; negative or NaN: there is no alarm."""
        now, mean, largest = self._summary[axis].tolist()
        return min(now / RATIO**2 - self._common * mean, now / WORST**2 - self._common * largest)

    def look(self, axis: int, explained: Callable[[], float]) -> bool:
        """Whether the axis has changed; ``explained`` is a variance over RATIO^2 that has other reasons."""
        excess = self.excess(axis)
        self._raised[axis] = self._raised[axis] + 1 if excess > 0.0 and excess > explained() else 0
        return bool(self._raised[axis] >= PATIENCE)

    def window_begin(self, axis: int) -> float:
        """Time [s] of the oldest error in the window."""
        return float(self._errors.time[axis, WINDOW - 1])

    def change_time(self, axis: int) -> float:
        """Most likely time [s] of the first error after the change."""
        count = int(self._errors.filled[axis])
        level = np.log(RATIO**2) * RATIO**2 / (RATIO**2 - 1.0)
        gain = np.cumsum(self._errors.newest[axis, :count] / max(self.variance(axis), 1e-300) - level)
        return float(self._errors.time[axis, int(np.argmax(gain))])
