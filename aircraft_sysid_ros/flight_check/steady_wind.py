"""What one steady wind needs to tell anything: courses that differ, and blocks of time that gusts leave apart."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Blocks = npt.NDArray[np.int64]

#: Blocks [s] that are independent: gusts last that long.
BLOCK = 20.0
#: How much courses must differ: what straight legs tell of a wind goes together with the scale of the airspeed.
LEAST_DIFFERENCE = 0.2


def difference_of_courses(velocity: npt.NDArray[np.complex128]) -> float:
    """How much the courses of some velocities (n,), north + i east, differ: 0 straight ahead, 1 all round.

    1 less the length of the mean direction.
    """
    return float(1.0 - abs(np.mean(np.exp(1j * np.angle(velocity)))))


def blocks_of(time: Array) -> Blocks:
    """Number of the block (n,) of each time [s]."""
    return np.asarray(time // BLOCK, dtype=np.int64)


def block_sums(scores: npt.NDArray[np.inexact], blocks: Blocks) -> npt.NDArray[np.inexact]:
    """Sums (blocks, ...) of scores (n, ...), whose squares are the variance of their sum."""
    return np.array([scores[blocks == block].sum(axis=0) for block in np.unique(blocks)])
