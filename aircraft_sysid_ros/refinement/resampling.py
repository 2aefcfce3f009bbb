"""Series of samples at other times, without what means and straight lines take away from brisk motion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.coefficients import signals

Array = npt.NDArray[np.float64]


def cubic(times: Array, values: Array, at: Array, longest: float) -> Array:
    """Series (n, k) at times ``at`` (m,), cubic through the two samples before and the two after.

    A straight line would take h^2 omega^2 / 12 of a motion away, half a per cent of a servo at 50 Hz. Where four
    samples are not within ``longest`` [s], linear or held, as in the second step; where none is near, NaN.
    """
    curved = signals.cubic(times, values, at, longest)
    return np.where(np.isfinite(curved), curved, signals.interpolate(times, values, at, longest))


def sharpened(mean: Array, time: Array, every: int) -> Array:
    """Value (N, k) at the middle of a step from the means of ``every`` samples over it and its neighbours.

    A mean of n samples T apart takes omega^2 T^2 (n^2 - 1) / 24 of a motion away, a third of a per cent of a brisk
    one; second differences of the means tell how much, and where a neighbour is missing nothing is put back.
    """
    out = mean.copy()
    step = float(np.median(np.diff(time))) if len(time) > 2 else 1.0
    share = (1.0 - 1.0 / every**2) / 24.0
    regular = (np.abs(np.diff(time[:-1]) - step) < 0.2 * step) & (np.abs(np.diff(time[1:]) - step) < 0.2 * step)
    bend = mean[2:] - 2.0 * mean[1:-1] + mean[:-2]
    out[1:-1] -= np.where(regular[:, None], share * bend, 0.0)
    return out
