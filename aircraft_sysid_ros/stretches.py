"""Uninterrupted stretches of a series: where a condition holds, from which index to which, and where it has gaps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

#: Time [s] without a point across which no line is drawn.
_GAP = 2.5


def stretches(mask: Mask) -> list[tuple[int, int]]:
    """First and last index (exclusive) of each run of True in a mask (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def longest_stretch(mask: Mask) -> slice:
    """The first of the longest runs of True in a mask (n,); empty where there is none."""
    return slice(*max(stretches(mask), key=lambda run: run[1] - run[0], default=(0, 0)))


def gaps(time: Array) -> Indices:
    """Indices of times (n,) before which nothing was heard for long: a playback may be faster than the flight was."""
    steps = np.diff(time)
    return 1 + np.flatnonzero(steps > max(_GAP, 3.0 * float(np.median(steps)) if len(steps) else 0.0))
