"""Noise of the IMU where the differentiating window looks, from the quietest quarter of the newest two minutes.

Differences from sample to sample show noise at half the rate of the samples. The slope over a window of half-width h
feels most what is at 1/(3 h): of a recording that was smoothed the one says little of the other. So means over 1.5 h
are taken first, whose fifth differences are largest there, too. Of white noise of variance R means over m samples have
R / m; m times their variance is the white noise that would be as dense there, whatever colour it has, and whether
samples repeat.

There motion is not gone as it is at the rate of the samples. But no aeroplane moves all the time: of blocks of BLOCK
differences, axis by axis, the quarter that is quietest tells. In gusts that never rest it is motion, and too large.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.sensor_noise import bounded
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.records import Record, one_record

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Differences of a block, blocks that are remembered, and how many there must be.
BLOCK, MOST, LEAST = 25, 60, 5
#: The mean square of a block that a quarter of them has less than, over the mean of all, where they are white noise
#: alone: fifth differences of white noise in turn are as 8.6 independent ones.
QUARTER = 0.645
WEIGHTS = np.array([1.0, -5.0, 10.0, -10.0, 5.0, -1.0])
SUM_OF_SQUARES = 252.0
_DEPTH, _AXES = 6, 6
#: Length of a mean over the half-width of the window.
WIDTH = 1.5
#: Longest step between samples, over the usual, across which differences are taken, and [s] that counts for that.
_GAP, _LONGEST = 3.0, 0.5
_TIME, _FORCE, _RATES = StateField.TIME, StateField.SPECIFIC_FORCE.start, StateField.ANGULAR_VELOCITY.start
#: Elements of ``QuietNoise.counts``.
_SAMPLES, _MEANS, _DIFFERENCES, _BLOCKS, _EACH = range(5)


class QuietNoise(Record):
    """Memory; forces [m/s^2] before rates [rad/s]."""

    sums: Array  # (6,) of the samples of a mean that is being taken
    means: Array  # (6, _DEPTH) the newest first
    squares: Array  # (6,) sums of squared differences of a block that is being filled
    blocks: Array  # (6, MOST) mean squares of blocks, as variances of white noise of samples; the newest first
    counts: Integers  # (5,) of samples in ``sums``, of means, differences, blocks; and samples that are in a mean
    variance: Array  # (2,) of accelerometer and gyro, NaN before it is known
    pace: Array  # (2,) time [s] of the newest sample, and the usual time [s] between two


def new_quiet_noise() -> npt.NDArray[np.void]:
    """One before a flight, (1,)."""
    return one_record(
        QuietNoise,
        sums=np.zeros(_AXES),
        means=np.zeros((_AXES, _DEPTH)),
        squares=np.zeros(_AXES),
        blocks=np.zeros((_AXES, MOST)),
        counts=np.zeros(5, np.int64),
        variance=np.full(2, np.nan),
        pace=np.array([-np.inf, 0.0]),
    )


@njit(cache=True)
def follow(row: Array, half_width: float, noise: QuietNoise) -> None:
    """A state (StateField.WIDTH,) in flight, of a window of ``half_width`` [s]."""
    counts, pace, step = noise.counts, noise.pace, row[_TIME] - noise.pace[0]
    pace[0] = row[_TIME]
    if 0.0 < step <= _LONGEST:
        pace[1] += (0.01 if pace[1] > 0.0 else 1.0) * (step - pace[1])
    if not 0.0 < step <= _GAP * pace[1]:
        counts[_SAMPLES] = counts[_MEANS] = 0
        noise.sums[:] = 0.0
    each = max(int(np.rint(WIDTH * half_width / pace[1])), 1) if pace[1] > 0.0 else 1
    if counts[_SAMPLES] == 0 and counts[_DIFFERENCES] == 0 and each != counts[_EACH]:
        counts[_EACH], counts[_MEANS] = each, 0
    for i in range(3):
        noise.sums[i] += row[_FORCE + i]
        noise.sums[3 + i] += row[_RATES + i]
    counts[_SAMPLES] += 1
    if counts[_SAMPLES] >= counts[_EACH]:
        _add_mean(noise)


@njit(cache=True)
def _add_mean(noise: QuietNoise) -> None:
    counts = noise.counts
    for i in range(_AXES):
        for k in range(_DEPTH - 1, 0, -1):
            noise.means[i, k] = noise.means[i, k - 1]
        noise.means[i, 0] = noise.sums[i] / counts[_SAMPLES]
        noise.sums[i] = 0.0
    counts[_SAMPLES] = 0
    counts[_MEANS] = min(counts[_MEANS] + 1, _DEPTH)
    if counts[_MEANS] < _DEPTH:
        return
    for i in range(_AXES):
        difference = 0.0
        for k in range(_DEPTH):
            difference += WEIGHTS[k] * noise.means[i, k]
        noise.squares[i] += difference * difference
    counts[_DIFFERENCES] += 1
    if counts[_DIFFERENCES] == BLOCK:
        _add_block(noise)


@njit(cache=True)
def _add_block(noise: QuietNoise) -> None:
    counts = noise.counts
    for i in range(_AXES):
        for k in range(MOST - 1, 0, -1):
            noise.blocks[i, k] = noise.blocks[i, k - 1]
        noise.blocks[i, 0] = counts[_EACH] * noise.squares[i] / (BLOCK * SUM_OF_SQUARES)
        noise.squares[i] = 0.0
    counts[_DIFFERENCES] = 0
    counts[_BLOCKS] = min(counts[_BLOCKS] + 1, MOST)
    if counts[_BLOCKS] < LEAST:
        return
    noise.variance[:] = 0.0
    for i in range(_AXES):
        sorted_blocks = np.sort(noise.blocks[i, : counts[_BLOCKS]])
        noise.variance[i // 3] += sorted_blocks[(counts[_BLOCKS] - 1) // 4] / (3.0 * QUARTER)


def in_use(said: float, shown: float, quiet: float) -> float:
    """Variance of a sensor of which ``said`` is said, the factor on it that differences of samples show, and ``quiet``.

    What is said stands where the quiet of the flight does not deny it; noise that differences show counts in any case.
    """
    return said * max(shown, bounded(min(quiet / said, 1.0)) if np.isfinite(quiet) else 1.0)
