"""Is there anything left in a residual but noise?

Residuals of neighbouring points are correlated even under a perfect model, since their windows overlap and since the
error of the reconstructed air data decays slowly. That correlation is known (``NoiseFloor.correlation``). Points whose
windows do not overlap are taken, each divided by its known sigma; the best linear prediction from the points before
it, for the known correlation (Levinson and Durbin), is taken away. Under a perfect model what is left is white,

    Q = sum_{k=1}^{m} n_k r_k^2     with    r_k = (1/n_k sum e(t) e(t-k)) / (1/n sum e(t)^2),

n_k the pairs of points k apart, is chi-square with m degrees of freedom (Box and Pierce 1970, with the pairs that
there are in place of n, as Ljung and Box 1978), and the test of 5 % fires in 5 % of the flights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincc

Array = npt.NDArray[np.float64]

#: Lags of the statistic, and of the prediction that takes the known correlation away.
LAGS, ORDER = 10, 8
#: Probability that white noise is called coloured.
FALSE_ALARM = 0.05
#: Points below which nothing is said.
LEAST_POINTS = 60


@dataclass(frozen=True)
class Whiteness:
    """The result of the test; NaN and not white where there are too few points."""

    statistic: float
    p_value: float
    correlation: Array  # (LAGS,) of what is left, at multiples of the spacing of the points
    count: int = 0  # points that it rests on

    @property
    def white(self) -> bool | None:
        """Nothing but noise is seen at FALSE_ALARM; None where there is too little to tell."""
        return None if np.isnan(self.p_value) else self.p_value >= FALSE_ALARM


def prediction(correlation: Array) -> tuple[Array, float]:
    """Coefficients (order,) of the best prediction from the newest values, newest first, and the share of the variance
    that it leaves, for a correlation (order + 1,) that starts with 1: the recursion of Levinson and Durbin.
    """
    coefficients, left = np.zeros(0), 1.0
    for k in range(1, len(correlation)):
        reflection = float(correlation[k] - coefficients @ correlation[k - 1 : 0 : -1]) / left
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        left *= 1.0 - reflection**2
    return coefficients, left


def whiteness_of(residual: Array, std: Array, correlation: Array) -> Whiteness:
    """Test a residual (n,) on an even grid of points, NaN where there is none.

    std (n,): its known sigma; correlation (ORDER + 1,): its known correlation, 1 first. Scale does not matter.
    """
    scaled = residual / std
    coefficients, _ = prediction(correlation)
    innovation = scaled[ORDER:].copy()
    for k, coefficient in enumerate(coefficients, start=1):
        innovation -= coefficient * scaled[ORDER - k : len(scaled) - k]
    known = np.isfinite(innovation)
    if known.sum() < LEAST_POINTS:
        return Whiteness(np.nan, np.nan, np.full(LAGS, np.nan))
    e = np.where(known, innovation - np.mean(innovation[known]), 0.0)
    variance = float(np.sum(e**2) / known.sum())
    pairs = np.array([np.sum(known[k:] & known[:-k]) for k in range(1, LAGS + 1)])
    sums = np.array([np.sum(e[k:] * e[:-k]) for k in range(1, LAGS + 1)])
    r = sums / np.maximum(pairs, 1) / variance
    # the variance of r_k about -1/n, which the mean that was taken away leaves, is (n - k) / (n (n + 2)) for n points
    count = float(known.sum())
    statistic = float(np.sum(pairs * (1.0 + 2.0 / count) * (r + 1.0 / count) ** 2))
    return Whiteness(statistic, float(gammaincc(0.5 * LAGS, 0.5 * statistic)), r, int(count))


def on_grid(time: Array, values: Array, step: float, every: int) -> Array:
    """Every ``every``-th value of points at ``time`` (n,) on the even grid of ``step`` [s]; NaN where there is none."""
    slot = np.asarray(np.rint((time - time[0]) / step), dtype=np.int64)
    grid = np.full(slot[-1] + 1, np.nan)
    grid[slot] = values
    return grid[::every]
