"""Standard errors of a calibration, with residuals as they are: correlated in time.

The covariance of the two-stage paper, the inverse of the Hessian, holds for white v. In flight the residuals are mostly
errors of the navigation and changes of the wind, which last for seconds. For the whitened rows h(k) of the residual's
derivative by all unknowns the covariance of the estimate is then (Morelli and Klein, J. Guidance 20(1), 1997)

    (sum h'h)^-1  [ sum_l w_l sum_k h(k)' R_e(l) h(k - l) ]  (sum h'h)^-1

as in estimation.least_squares, with Parzen's window, whose length follows from the residuals themselves (Andrews,
Econometrica 59, 1991: 2.66 (a N)^(1/5) with a = 4 r^2 / (1 - r)^4 for a correlation r of neighbours).

What the fit takes for a parameter is not in the residuals: a heading that is wrong throughout is b_beta. The attitude's
standard deviations s are known from the smoother, and how long its errors last roughly, T. To the middle sum is added

    sum_k sum_l h(k)' D(k) diag(s(k) s(l) exp(-|t_k - t_l| / T)) D(l)' h(l)

with D the derivative of the residual by a small rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.least_squares import coloured_sandwich, solve_factor
from aircraft_sysid_ros.estimation.two_stage.covariance import separated
from aircraft_sysid_ros.estimation.two_stage.problem import Problem

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: How long [s] an error of the attitude lasts: heading is corrected from turn to turn.
ATTITUDE_TIME = 20.0
#: A jackknife over fewer pieces says nothing.
FEWEST_PIECES = 4
#: A parameter is not determined when its standard error exceeds this share of half the distance of its bounds.
DETERMINED = 0.5
_LARGEST_CORRELATION = 0.97
#: The window covers at most this share of the flight.
_LONGEST_WINDOW = 0.25


@dataclass(frozen=True)
class Errors:
    """Covariances of xi1 and xi2 together (n, n), with residuals as they are and white, and the window."""

    coloured: Array
    white: Array
    lags: int

    @property
    def std(self) -> Array:
        """Standard errors (n,), infinite where the data say nothing."""
        variance = np.diag(self.coloured)
        return np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.inf))


@dataclass(frozen=True)
class AttitudeErrors:
    """Errors of the attitude: times (K,) [s], standard deviations (K, 3) [rad] and D (K, m, 3)."""

    time: Array
    std: Array
    derivative: Array

    def covariance(self, rows: Array, noise_std: Array, inverse: Array) -> Array:
        """Their part (n, n) for whitened rows (K, m, n), noise_std (m,) and inverse (sum h'h)^-1 (n, n)."""
        shares = np.einsum("kmn,kma->kna", rows, self.derivative / noise_std[:, None]) * self.std[:, None, :]
        fading = np.exp(-np.diff(self.time, prepend=self.time[0]) / ATTITUDE_TIME)
        before, middle = np.zeros(shares.shape[1:]), np.zeros((shares.shape[1],) * 2)
        for share, fade in zip(shares, fading, strict=True):
            before = before * fade
            cross = share @ before.T
            middle += cross + cross.T + share @ share.T
            before = before + share
        return np.asarray(inverse @ middle @ inverse)


def standard_errors(
    problem: Problem, xi1: Array, xi2: Array, noise: Array, piece: npt.NDArray[np.int64], free: Mask,
    instruments: Array | None = None, attitude: AttitudeErrors | None = None,
) -> Errors:  # fmt: skip
    """Covariances at an estimate; noise: diagonal of R (m,); piece (K,): rows of another piece are not correlated.

    ``free`` (n,): unknowns that are estimated; the others are known, with covariance zero. ``instruments`` (K, m, n):
    rows h, where the estimate is that of instrumental variables; they are what the rows of A are without noise.
    ``attitude``: errors of the attitude in A and b.
    """
    a, b = problem.evaluate(xi2)
    residuals = (problem.kept - b - a @ xi1) / np.sqrt(noise)
    slopes = np.concatenate([a, problem.slopes(xi1, xi2)], axis=2) if instruments is None else instruments
    rows = slopes / np.sqrt(noise)[:, None]
    lags = window_length(residuals, piece)
    padded, padded_residuals = separated(rows[:, :, free], piece, lags), separated(residuals, piece, lags)
    root = np.asarray(np.linalg.qr(rows[:, :, free].reshape(-1, int(free.sum())), mode="r"))
    solution = solve_factor(root, np.zeros(len(root)))
    coloured = coloured_sandwich(padded, padded_residuals, solution, lags, residuals.size)
    if attitude is not None:
        coloured = coloured + attitude.covariance(rows[:, :, free], np.sqrt(noise), solution.inverse)
    return Errors(embedded(coloured, free), embedded(solution.covariance, free), lags)


def jackknife(
    problem: Problem, xi1: Array, xi2: Array, noise: Array, piece: npt.NDArray[np.int64], free: Mask
) -> Errors:
    """As ``standard_errors``, for residuals that are correlated over a whole piece in whatever way.

    From the answers without one of the G pieces, to first order: d_p = (sum h'h - h_p'h_p)^-1 h_p'r_p and the
    covariance (G - 1)/G sum d_p d_p' about their mean. G pieces know it badly: it is multiplied by the variance of
    Student's t, (G - 1)/(G - 3), and no variance is less than that of white residuals. Infinite for G < FEWEST_PIECES.
    """
    a, b = problem.evaluate(xi2)
    left = (problem.kept - b - a @ xi1) / np.sqrt(noise)
    slopes = np.concatenate([a, problem.slopes(xi1, xi2)], axis=2)[:, :, free] / np.sqrt(noise)[:, None]
    n = slopes.shape[2]
    white = solve_factor(np.asarray(np.linalg.qr(slopes.reshape(-1, n), mode="r")), np.zeros(n)).covariance
    changes = []
    for number in np.unique(piece):
        own = piece == number
        rest = np.asarray(np.linalg.qr(slopes[~own].reshape(-1, n), mode="r")) if not own.all() else np.zeros((n, n))
        without = solve_factor(rest, np.zeros(len(rest))).covariance
        changes.append(without @ np.einsum("kmj,km->j", slopes[own], left[own]))
    moved = np.array(changes) - np.mean(changes, axis=0)
    count = len(moved)
    if count < FEWEST_PIECES:
        covariance = np.full((n, n), np.inf)
    else:
        covariance = moved.T @ moved * ((count - 1.0) ** 2 / (count * (count - 3.0)))
        covariance += np.diag(np.maximum(np.diag(white) - np.diag(covariance), 0.0))
    return Errors(embedded(covariance, free), embedded(white, free), 0)


def by_the_others(
    problem: Problem, xi1: Array, xi2: Array, noise: Array, free: Mask, instruments: Array | None = None
) -> Array:
    """Derivative (n_free, n - n_free) of the estimate of what is free by what is taken as known.

    What they add to the covariance of the estimate follows from it (Jazwinski, section 8.3: consider parameters).
    """
    a, _ = problem.evaluate(xi2)
    slopes = np.concatenate([a, problem.slopes(xi1, xi2)], axis=2) / np.sqrt(noise)[:, None]
    rows = (slopes if instruments is None else instruments / np.sqrt(noise)[:, None])[:, :, free]
    h, own = (part.reshape(-1, int(free.sum())) for part in (rows, slopes[:, :, free]))
    others = slopes[:, :, ~free].reshape(len(h), -1)
    return -np.asarray(np.linalg.lstsq(h.T @ own, h.T @ others)[0])


def window_length(residuals: Array, piece: npt.NDArray[np.int64]) -> int:
    """Length of Parzen's window [samples] for residuals (K, m), by the output that is correlated most."""
    same = piece[1:] == piece[:-1]
    centred = residuals - residuals.mean(axis=0)
    power = np.maximum(np.sum(centred**2, axis=0), 1e-300)
    correlation = np.sum((centred[1:] * centred[:-1])[same], axis=0) / power
    r = float(np.clip(correlation.max(), 0.0, _LARGEST_CORRELATION))
    length = 2.6614 * (4.0 * r**2 / (1.0 - r) ** 4 * len(residuals)) ** 0.2
    return int(np.clip(np.ceil(length), 1, max(1, _LONGEST_WINDOW * len(residuals))))


def undetermined(problem: Problem, std: Array) -> Mask:
    """(n,) which unknowns the flight says too little of, against their bounds."""
    half = 0.5 * (problem.bounds[:, 1] - problem.bounds[:, 0])
    return np.asarray(~(std <= DETERMINED * half))


def embedded(covariance: Array, free: Mask) -> Array:
    """A covariance of what is free as one of all (n, n)."""
    out = np.zeros((len(free), len(free)))
    out[np.ix_(free, free)] = covariance
    return out
