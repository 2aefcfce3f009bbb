"""Has the aeroplane changed? The model error of a second, against what it was since the parameters were known.

Per axis: e = measured - predicted before the sample, where the axis learns. The mean square over the newest WINDOW of
these is compared with those of earlier blocks of the same length, of which the newest GUARD evaluations are left out: a
change is not to be in what it is measured by. The alarm wants both, RATIO times the rms of all blocks and WORST times
the largest of them, over some looks (``thresholds``). Errors of a model that is always wrong somewhere raise the bar by
themselves. Gusts that set in, or a noisier sensor, raise the errors of most axes, a change of the aeroplane those of
some: by what the errors have grown in all but the quietest two axes is not counted. Nor is a window that is spread over
some times its length (``window_spread``): in cruise an axis learns now and then, from what is not motion.

How much of a coefficient the model explains: the mean square error over the variance of the coefficient, over the
newest FIT_BLOCKS blocks in which it moves. One in which it has less than LEAST_MOTION of its variance says nothing.
Over the same blocks, how much of it is no noise: the mean square error over what noise makes of it.

When the change was: with n errors of variance s^2 before it and RATIO^2 s^2 since, the sum of

    e^2 / s^2 - ln(RATIO^2) RATIO^2 / (RATIO^2 - 1)

from a time on is largest from the most likely one on (Page 1954, cumulative sums of log likelihoods).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, MEASURED, CoefficientSample
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.records import Record, one_record

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Evaluations (25 per second) of the window and of a block; those between the window and the blocks, the window too.
WINDOW, GUARD = 25, 50
#: Blocks that are remembered, and those of them that say how much the model explains.
MOST_BLOCKS, FIT_BLOCKS = 60, 30
LEAST_BLOCKS, TENTH_BLOCKS, LEAST_MOTION = THRESHOLDS.least_blocks, THRESHOLDS.tenth_blocks, THRESHOLDS.least_motion
RATIO, WORST, _QUIETER = THRESHOLDS.change_ratio, THRESHOLDS.change_worst, THRESHOLDS.quieter_axes

_TIME = CoefficientSample.TIME
QBAR = CoefficientSample.SIGNALS.start + SIGNAL_INDEX["qbar"]


class Errors(Record):
    """Squared model errors of six axes."""

    newest: Array  # (6, GUARD) newest first
    time: Array  # (6, GUARD) [s] of them
    filled: Integers  # (6,) how many there are
    measured: Array  # (6, GUARD) the coefficients of them
    noise: Array  # (6, GUARD) variances that noise makes of them
    block: Array  # (6, 6) of one being filled: sums of squared errors, 1, the coefficient, its square, noise, 1/qbar
    thin: Array  # (6, GUARD) 1/qbar [1/Pa] of the newest
    blocks: Array  # (6, MOST_BLOCKS) mean squares, newest first
    blocks_thin: Array  # (6, MOST_BLOCKS) means of 1/qbar in them
    block_count: Integers  # (6,)
    fit_error: Array  # (6, FIT_BLOCKS) mean squares of blocks in which the coefficient moves, newest first
    fit_mean: Array  # (6, FIT_BLOCKS) means of the coefficient in them
    fit_square: Array  # (6, FIT_BLOCKS) and of its square
    fit_noise: Array  # (6, FIT_BLOCKS) and of what noise makes of the mean squares
    fit_count: Integers  # (6,)


class Summary(Record):
    """What the errors of all axes are now against what they were."""

    window: Array  # (6, 3) mean square of window, of all blocks, and of the largest; NaN where they do not compare
    usual: Array  # (6, 3) mean square of all blocks and of the largest, mean of 1/qbar; NaN before there are enough
    common: Array  # (1,) by what the mean square error has grown in most axes


@njit(cache=True)
def thinness(sample: Array) -> float:
    """1/qbar [1/Pa]: errors of flow angles and specific force weigh more in a coefficient the slower it flies."""
    return 1.0 / sample[QBAR] if sample[QBAR] > 0.0 else 0.0


@njit(cache=True)
def _shift(array: Array, axis: int, count: int) -> None:
    """Make room at the front of a row."""
    for i in range(count - 1, 0, -1):
        array[axis, i] = array[axis, i - 1]


@njit(cache=True)
def add_errors(samples: Array, predicted: Array, noise: Array, known: npt.NDArray[np.bool_], errors: Errors) -> None:
    """Take samples (m, …) with predictions and noise (m, 6) of the axes (6,) whose parameters are known, in place."""
    for i in range(len(samples)):
        for axis in range(6):
            e = samples[i, MEASURED + axis] - predicted[i, axis]
            if not (known[axis] and samples[i, LEARNT + axis] > 0.0 and np.isfinite(e)):
                continue
            if errors.filled[axis] == GUARD:
                _add_to_block(axis, errors)
            _shift(errors.newest, axis, GUARD)
            _shift(errors.time, axis, GUARD)
            _shift(errors.measured, axis, GUARD)
            _shift(errors.noise, axis, GUARD)
            _shift(errors.thin, axis, GUARD)
            errors.newest[axis, 0], errors.time[axis, 0] = e * e, samples[i, _TIME]
            errors.measured[axis, 0], errors.noise[axis, 0] = samples[i, MEASURED + axis], noise[i, axis]
            errors.thin[axis, 0] = thinness(samples[i])
            errors.filled[axis] = min(errors.filled[axis] + 1, GUARD)


@njit(cache=True)
def _add_to_block(axis: int, errors: Errors) -> None:
    """The oldest error of the newest ones goes there."""
    measured = errors.measured[axis, GUARD - 1]
    errors.block[axis, 0] += errors.newest[axis, GUARD - 1]
    errors.block[axis, 1] += 1.0
    errors.block[axis, 2] += measured
    errors.block[axis, 3] += measured * measured
    errors.block[axis, 4] += errors.noise[axis, GUARD - 1]
    errors.block[axis, 5] += errors.thin[axis, GUARD - 1]
    if errors.block[axis, 1] == WINDOW:
        _add_to_fit(axis, errors)
        _shift(errors.blocks, axis, MOST_BLOCKS)
        _shift(errors.blocks_thin, axis, MOST_BLOCKS)
        errors.blocks[axis, 0] = errors.block[axis, 0] / WINDOW
        errors.blocks_thin[axis, 0] = errors.block[axis, 5] / WINDOW
        errors.block_count[axis] = min(errors.block_count[axis] + 1, MOST_BLOCKS)
        errors.block[axis] = 0.0


@njit(cache=True)
def _add_to_fit(axis: int, errors: Errors) -> None:
    """Keep a block that is full for ``unexplained``, if the coefficient moves in it."""
    mean, square = errors.block[axis, 2] / WINDOW, errors.block[axis, 3] / WINDOW
    count = errors.fit_count[axis]
    if count >= LEAST_BLOCKS:
        usual = errors.fit_mean[axis, :count].mean()
        variance = errors.fit_square[axis, :count].mean() - usual * usual
        if square - 2.0 * mean * usual + usual * usual < LEAST_MOTION * variance:
            return
    _shift(errors.fit_error, axis, FIT_BLOCKS)
    _shift(errors.fit_mean, axis, FIT_BLOCKS)
    _shift(errors.fit_square, axis, FIT_BLOCKS)
    _shift(errors.fit_noise, axis, FIT_BLOCKS)
    errors.fit_error[axis, 0] = errors.block[axis, 0] / WINDOW
    errors.fit_mean[axis, 0], errors.fit_square[axis, 0] = mean, square
    errors.fit_noise[axis, 0] = errors.block[axis, 4] / WINDOW
    errors.fit_count[axis] = min(count + 1, FIT_BLOCKS)


@njit(cache=True)
def summarise(errors: Errors, longest: float, summary: Summary) -> None:
    """All of ``summary`` from the errors, in place; windows longer than ``longest`` [s] do not count."""
    summary.window[:], summary.usual[:] = np.nan, np.nan
    grown = np.full(6, np.inf)
    for axis in range(6):
        count = errors.block_count[axis]
        if count < LEAST_BLOCKS:
            continue
        blocks = errors.blocks[axis, :count]
        mean, largest = blocks.mean(), blocks.max()
        summary.usual[axis, 0], summary.usual[axis, 1] = mean, largest
        summary.usual[axis, 2] = errors.blocks_thin[axis, :count].mean()
        span = errors.time[axis, 0] - errors.time[axis, WINDOW - 1]
        if errors.filled[axis] >= WINDOW and span <= longest and largest > 0.0:  # without any error there is no measure
            window = errors.newest[axis, :WINDOW].mean()
            summary.window[axis, 0], summary.window[axis, 1], summary.window[axis, 2] = window, mean, largest
            grown[axis] = window / mean
    grown.sort()
    enough = np.isfinite(grown[_QUIETER + 1])
    summary.common[0] = max(grown[_QUIETER], 1.0) if enough else 1.0


@njit(cache=True)
def excesses(summary: Summary, out: Array) -> None:
    """Variance in the window of each axis (6,) that the blocks do not explain, over RATIO^2.

    Negative or NaN: there is no alarm.
    """
    for axis in range(6):
        now, mean, largest = summary.window[axis]
        common = summary.common[0]
        out[axis] = min(now / RATIO**2 - common * mean, now / WORST**2 - common * largest)


@njit(cache=True)
def _fits(one_errors: npt.NDArray[np.void], out: Array) -> None:
    """``ResidualMonitor.fits`` of all axes (6, 3), in place; NaN where there are too few."""
    errors = one_errors[0]
    ratios = np.empty(FIT_BLOCKS)
    for axis in range(6):
        count, error, mean, square, over, known = errors.fit_count[axis], 0.0, 0.0, 0.0, 0.0, 0
        for i in range(count):
            error += errors.fit_error[axis, i]
            mean += errors.fit_mean[axis, i]
            square += errors.fit_square[axis, i]
            if errors.fit_noise[axis, i] > 0.0:
                ratios[known] = errors.fit_error[axis, i] / errors.fit_noise[axis, i]
                over += ratios[known]
                known += 1
        variance = square / count - (mean / count) ** 2 if count > 0 else 0.0
        out[axis, 0] = error / count / variance if count >= LEAST_BLOCKS and variance > 0.0 else np.nan
        out[axis, 1] = out[axis, 2] = np.nan
        if known >= LEAST_BLOCKS:
            out[axis, 1] = np.sqrt(over / known)
        if known >= TENTH_BLOCKS:
            out[axis, 2] = np.sqrt(np.sort(ratios[:known])[known - 1 - known // 10])


@njit(cache=True)
def _follow(
    samples: Array,
    predicted: Array,
    noise: Array,
    known: npt.NDArray[np.bool_],
    longest: float,
    one_errors: npt.NDArray[np.void],
    one_summary: npt.NDArray[np.void],
    excess: Array,
) -> None:
    """``add_errors``, and all that follows from them, in one call; one record each, see ``records``."""
    errors, summary = one_errors[0], one_summary[0]
    add_errors(samples, predicted, noise, known, errors)
    summarise(errors, longest, summary)
    excesses(summary, excess)


class ResidualMonitor:
    """Compares the model errors of all axes with what they were."""

    def __init__(self, step: float) -> None:
        """``step`` [s] between evaluations."""
        self._longest = THRESHOLDS.window_spread * WINDOW * step
        self._one_errors = one_record(
            Errors,
            newest=np.zeros((6, GUARD)),
            time=np.zeros((6, GUARD)),
            filled=np.zeros(6, np.int64),
            measured=np.zeros((6, GUARD)),
            noise=np.zeros((6, GUARD)),
            block=np.zeros((6, 6)),
            thin=np.zeros((6, GUARD)),
            blocks_thin=np.zeros((6, MOST_BLOCKS)),
            blocks=np.zeros((6, MOST_BLOCKS)),
            block_count=np.zeros(6, np.int64),
            fit_error=np.zeros((6, FIT_BLOCKS)),
            fit_mean=np.zeros((6, FIT_BLOCKS)),
            fit_square=np.zeros((6, FIT_BLOCKS)),
            fit_noise=np.zeros((6, FIT_BLOCKS)),
            fit_count=np.zeros(6, np.int64),
        )
        self.one_summary = one_record(
            Summary, window=np.full((6, 3), np.nan), usual=np.full((6, 3), np.nan), common=np.ones(1)
        )
        self._excess = np.full(6, np.nan)
        self._raised = np.zeros(6, np.int64)  # evaluations in a row at which the error was too large

    @property
    def _errors(self) -> Errors:
        """The record of which a copy of this has a copy."""
        return cast(Errors, self._one_errors[0])

    @property
    def _summary(self) -> Summary:
        return cast(Summary, self.one_summary[0])

    def add(self, samples: Array, predicted: Array, known: npt.NDArray[np.bool_], noise: Array | None = None) -> None:
        """Take samples (m, …) with predictions (m, 6); only axes (6,) whose parameters are known count.

        ``noise`` (m, 6): variances that noise makes of their errors, where they are known.
        """
        noise = np.zeros((len(samples), 6)) if noise is None else noise
        _follow(samples, predicted, noise, known, self._longest, self._one_errors, self.one_summary, self._excess)

    def forget(self, axis: int) -> None:
        """The parameters of an axis are others now: what its errors are is still to be seen."""
        for name in self._errors.dtype.names or ():
            self._errors[name][axis] = 0
        self._raised[axis] = 0
        self._compare()

    def skip(self, *axes: int) -> None:
        """What was in the windows does not count, of some axes or any: sensors were at odds."""
        chosen = list(axes) or slice(None)
        self._errors.filled[chosen] = 0
        self._raised[chosen] = 0
        self._compare()

    def _compare(self) -> None:
        summarise(self._errors, self._longest, self._summary)
        excesses(self._summary, self._excess)

    def usual(self, axis: int) -> tuple[float, float]:
        """Mean square error and largest block of an axis, grown as in most axes; NaN before there are enough blocks."""
        mean, largest = self._summary.usual[axis, :2].tolist()
        common = float(self._summary.common[0])
        return common * mean, common * largest

    def variance(self, axis: int) -> float:
        """Mean square of the error of an axis in the blocks; 0 without any."""
        count = self._errors.block_count[axis]
        return float(self._errors.blocks[axis, :count].mean()) if count else 0.0

    def blocks(self, axis: int) -> int:
        """How many blocks of motion of an axis there are, at most MOST_BLOCKS."""
        return int(self._errors.block_count[axis])

    def fits(self) -> Array:
        """Of each axis (6, 3) ``unexplained``, ``over_noise`` and ``worst_over_noise``."""
        out = np.full((6, 3), np.nan)
        _fits(self._one_errors, out)
        return out

    def unexplained(self, axis: int) -> float:
        """Share of the variance of a coefficient that the model does not explain; NaN before there are enough blocks.

        Each sample was predicted before it was learnt from.
        """
        return float(self.fits()[axis, 0])

    def over_noise(self, axis: int) -> float:
        """Rms error over what noise makes of it, the mean over the blocks of ``unexplained`` in which that is known.

        NaN before there are enough.
        """
        return float(self.fits()[axis, 1])

    def worst_over_noise(self, axis: int) -> float:
        """What a tenth of the blocks of ``over_noise`` exceed: a model may be right in most of a flight, and not there.

        NaN before there are enough.
        """
        return float(self.fits()[axis, 2])

    def excess(self, axis: int) -> float:
        """Variance in the window that the blocks do not explain, over RATIO^2; negative or NaN: there is no alarm."""
        return float(self._excess[axis])

    def is_quiet(self) -> bool:
        """Whether no axis can have changed; what was raised is forgotten then."""
        if (self._excess > 0.0).any():
            return False
        self._raised[:] = 0
        return True

    def has_changed(self, axis: int, explained: Callable[[], float]) -> bool:
        """Whether the axis has changed; ``explained`` is a variance over RATIO^2 that has other reasons."""
        excess = self._excess[axis]
        if not excess > 0.0:
            self._raised[axis] = 0
            return False
        self._raised[axis] = self._raised[axis] + 1 if excess > explained() else 0
        return bool(self._raised[axis] >= THRESHOLDS.change_looks)

    def window_begin(self, axis: int) -> float:
        """Time [s] of the oldest error in the window."""
        return float(self._errors.time[axis, WINDOW - 1])

    def change_time(self, axis: int) -> float:
        """Most likely time [s] of the first error after the change."""
        count = int(self._errors.filled[axis])
        level = np.log(RATIO**2) * RATIO**2 / (RATIO**2 - 1.0)
        gain = np.cumsum(self._errors.newest[axis, :count] / max(self.variance(axis), 1e-300) - level)
        return float(self._errors.time[axis, int(np.argmax(gain))])
