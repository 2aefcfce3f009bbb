"""Series of samples at other times, without what means and straight lines take away from brisk motion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.coefficients import signals
from aircraft_sysid_ros.identification.estimators.dense_epochs import STEP
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Intervals of sparse states over which a flight goes on: what was lost there is not measured, and no gap.
BRIDGED = 3.5
#: Longest step [s] between rows of ``dense_rows`` that is no gap: what is just not cut in two.
LONGEST_STEP = 1.5 * STEP


def cubic(times: Array, values: Array, at: Array, longest: float) -> Array:
    """Series (n, k) at times ``at`` (m,), cubic through the two samples before and the two after.

    A straight line would take h^2 omega^2 / 12 of a motion away, half a per cent of a servo at 50 Hz. Where four
    samples are not within ``longest`` [s], linear or held, as in the second step; where none is near, NaN.
    """
    curved = signals.cubic(times, values, at, longest)
    return np.where(np.isfinite(curved), curved, signals.interpolate(times, values, at, longest))


def sharpened(mean: Array, time: Array, every: npt.NDArray[np.int64]) -> Array:
    """Value (N, k) at the middle of a step from the means of ``every`` samples (N,) over it and its neighbours.

    A mean of n samples T apart takes omega^2 T^2 (n^2 - 1) / 24 of a motion away, a third of a per cent of a brisk
    one; second differences of the means tell how much, and where a neighbour is missing nothing is put back.
    """
    out = mean.copy()
    step = float(np.median(np.diff(time))) if len(time) > 2 else 1.0
    share = (1.0 - 1.0 / every**2) / 24.0
    regular = (np.abs(np.diff(time[:-1]) - step) < 0.2 * step) & (np.abs(np.diff(time[1:]) - step) < 0.2 * step)
    bend = mean[2:] - 2.0 * mean[1:-1] + mean[:-2]
    out[1:-1] -= np.where(regular[:, None], share[1:-1, None] * bend, 0.0)
    return out


def dense_rows(rows: Array, interval: float) -> tuple[Array, Mask]:
    """Rows (n, StateField.WIDTH) of sparse states with others between them, and which of them (m,) were there before.

    ``interval`` [s]: the usual one. New rows are about STEP apart and cubic in time through the four rows about them;
    lost samples are bridged over BRIDGED intervals. Nothing is measured there: a flight model goes that way in small
    steps, with controls that are no straight lines from one IMU sample to the next.
    """
    gaps = np.diff(rows[:, StateField.TIME])
    broken = np.flatnonzero((gaps <= 0.0) | (gaps > BRIDGED * interval)) + 1
    parts = [_dense_part(part, BRIDGED * interval) for part in np.split(rows, broken)]
    dense, known = zip(*parts, strict=True)
    return np.vstack(dense), np.concatenate(known)


def _dense_part(rows: Array, longest: float) -> tuple[Array, Mask]:
    """``dense_rows`` of rows without a gap longer than ``longest`` [s]."""
    time = rows[:, StateField.TIME]
    pieces = np.maximum(np.ceil(np.diff(time) / STEP - 0.5), 1.0).astype(np.int64)
    begin = np.append(np.repeat(np.arange(len(pieces)), pieces), len(pieces))
    number = np.arange(len(begin)) - np.append(np.repeat(np.cumsum(pieces) - pieces, pieces), len(begin) - 1)
    known = number == 0
    at = time[begin].copy()
    at[~known] += (number / np.append(pieces, 1)[begin] * np.append(np.diff(time), 0.0)[begin])[~known]
    rows = rows.copy()
    sides = np.sign(np.sum(rows[1:, StateField.ATTITUDE] * rows[:-1, StateField.ATTITUDE], axis=1))
    rows[1:, StateField.ATTITUDE] *= np.cumprod(np.where(sides == 0.0, 1.0, sides))[:, None]
    dense = np.where(known[:, None], rows[begin], cubic(time, rows, at, longest))
    dense[:, StateField.ATTITUDE] /= np.linalg.norm(dense[:, StateField.ATTITUDE], axis=1, keepdims=True)
    for field in (StateField.STATUS, StateField.ORIGIN):
        dense[:, field] = rows[begin][:, field]
    return dense, known
