"""Time stamps [ns], and seconds of a flight, which come back as the same stamps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Of one second.
NANOSECONDS = 1_000_000_000
#: Stamps become seconds after a multiple of this, exact to 0.1 ns and the same in every process.
_EPOCH_STEP = 2**20 * NANOSECONDS


def epoch_of(stamp: int) -> int:
    """Reference [ns] from which the seconds of a recording are counted."""
    return stamp // _EPOCH_STEP * _EPOCH_STEP


def seconds(stamp: npt.NDArray[np.int64], epoch: int) -> Array:
    """Stamps [ns] as seconds after the epoch; ``nanoseconds`` gives them back exactly."""
    return (stamp - epoch).astype(np.float64) / NANOSECONDS


def nanoseconds(time: Array, epoch: int) -> npt.NDArray[np.int64]:
    """Inverse of ``seconds``."""
    return np.asarray(np.rint(np.asarray(time) * NANOSECONDS).astype(np.int64) + epoch)
