"""Differentiation that treats both sides of an equation alike: the weak form with a parabolic window.

Every signal s is replaced by its weighted mean over a window of half-width h about t,

    <s>(t) = integral w(tau) s(t + tau) d tau,    w(tau) = 3 (h^2 - tau^2) / (4 h^3),

and <ds/dt> is the weighted mean of the slopes between samples, which is the least-squares slope of a straight
line through the window (Savitzky and Golay 1964). An equation that is linear in its signals, such as
I domega/dt + omega x I omega = qbar S c sum theta phi, holds for the means as it holds for the signals,
whatever their frequency (Preisig and Rippin 1993, modulating functions): the differentiator has a delay, h,
but makes no error that the regressors do not make too. What is left is what happens between samples dt apart.

Dense samples: the mean of an interval is that of its two ends. A sine that is sampled evenly has the mean cos x and
the slope sin x / x of the true ones, x = omega dt / 2: slopes are too large by tan x / x, 0.1 % at 1 Hz and 50 Hz.

Sparse samples: means and slopes are both those of the straight lines between samples, weighted exactly. Lines keep
(sin x / x)^2 of a sine and as much of its derivative, at any dt and any window: nothing is too large. The line spans
its interval, so that the window is never shorter than that. What is left are the images of a sine, at multiples of
the rate beside it, which come and go with the place of the window between the samples and do not add up.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]


@njit(cache=True)
def _cumulative(u: float) -> float:
    """Integral of the parabola from -1 to u, clipped to [-1, 1]."""
    u = min(max(u, -1.0), 1.0)
    return 0.25 * (2.0 + 3.0 * u - u * u * u)


@njit(cache=True)
def _moment(u: float) -> float:
    """Integral of the parabola times its argument from -1 to u, clipped to [-1, 1]."""
    u = min(max(u, -1.0), 1.0)
    return -0.1875 * (1.0 - u * u) ** 2


@njit(cache=True)
def window_average(
    times: Array,
    data: Array,
    first: int,
    last: int,
    center: float,
    half_width: float,
    means: Array,
    slopes: Array,
    sparse: bool,
) -> None:
    """Means and slopes of the columns of data (n, m) over the window, into ``means`` and ``slopes``, (m,).

    times (n,) ascending; rows ``first`` to ``last`` inclusive must span center - half_width to
    center + half_width. ``sparse``: the rule for samples that are not dense beside motion or window.
    """
    means[:] = 0.0
    slopes[:] = 0.0
    before = _cumulative((times[first] - center) / half_width)
    for j in range(first, last):
        after = _cumulative((times[j + 1] - center) / half_width)
        weight = after - before
        before = after
        if weight <= 0.0:
            continue
        step = times[j + 1] - times[j]
        ahead = 0.5 * weight  # of the later sample
        if sparse:
            moment = _moment((times[j + 1] - center) / half_width) - _moment((times[j] - center) / half_width)
            ahead = (weight * (center - times[j]) + half_width * moment) / step
        for k in range(data.shape[1]):
            if sparse:
                means[k] += (weight - ahead) * data[j, k] + ahead * data[j + 1, k]
            else:
                means[k] += 0.5 * weight * (data[j, k] + data[j + 1, k])
            slopes[k] += weight * (data[j + 1, k] - data[j, k]) / step


@njit(cache=True)
def window_averages(times: Array, data: Array, centers: Array, half_width: float, sparse: bool) -> Array:
    """Means (c, m) of the columns of data (n, m) over the windows about c centers; NaN where times do not span one."""
    means, slopes = np.full((len(centers), data.shape[1]), np.nan), np.empty(data.shape[1])
    for i in range(len(centers)):
        first = np.searchsorted(times, centers[i] - half_width, side="right") - 1
        last = np.searchsorted(times, centers[i] + half_width)
        if first >= 0 and last < len(times):
            window_average(times, data, first, last, centers[i], half_width, means[i], slopes, sparse)
    return means
