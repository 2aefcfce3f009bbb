"""Numbers of several flights, each with its standard error, and a spread between flights that nobody knows.

    y_i = x_i' b + u_i + e_i,   u_i ~ N(0, tau²),   e_i ~ N(0, s_i²)

tau² by restricted maximum likelihood; b by weighted least squares, w_i = 1 / (s_i² + tau²), with the correction of
Knapp and Hartung: its covariance times q = Σ w_i r_i² / (n - p), where that is more than 1, and Student's t with n - p
degrees of freedom. Veroniki et al. (2016) for tau², Röver et al. (2015) for q, in docs/references.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from scipy.special import stdtr

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Fitted:
    """A fit of p numbers to n flights."""

    value: Array  # (p,)
    covariance: Array  # (p, p)
    between: float  # tau, the spread between flights, in the unit of y
    freedom: int  # n - p
    log_likelihood: float  # with tau and b where they are; for models of the same flights

    @property
    def std(self) -> Array:
        """Standard errors (p,)."""
        return np.sqrt(np.diag(self.covariance))

    def p_value(self, which: int = -1) -> float:
        """Of the hypothesis that one of the numbers is 0."""
        return two_sided(float(self.value[which] / self.std[which]), self.freedom)


def two_sided(t: float, freedom: int) -> float:
    """Probability of a value of Student's t that is as far from 0."""
    return float(2.0 * stdtr(freedom, -abs(t)))


def fit(y: Array, s: Array, x: Array) -> Fitted:
    """Fit y (n,) with standard errors s (n,) by columns x (n, p) of full rank; n > p."""
    between_square = _restricted_maximum(y, s, x)
    return fit_with(y, s, x, between_square)


def fit_with(y: Array, s: Array, x: Array, between_square: float) -> Fitted:
    """``fit`` with a known tau²."""
    freedom = len(y) - x.shape[1]
    weight = 1.0 / (s**2 + between_square)
    root = np.sqrt(weight)
    q, r = np.linalg.qr(root[:, None] * x)
    value = solve_triangular(r, q.T @ (root * y))
    residual = root * (y - x @ value)
    excess = float(residual @ residual)
    inverse = solve_triangular(r, np.eye(len(r)))
    covariance = inverse @ inverse.T * max(excess / freedom, 1.0)
    likelihood = 0.5 * float(np.sum(np.log(weight))) - 0.5 * excess
    return Fitted(value, covariance, float(np.sqrt(between_square)), freedom, likelihood)


def restricted_log_likelihood(between_square: float, y: Array, s: Array, x: Array) -> float:
    """log of the restricted likelihood of tau², without its constant."""
    root = 1.0 / np.sqrt(s**2 + between_square)
    q, r = np.linalg.qr(root[:, None] * x)
    weighted = root * y
    residual = weighted - q @ (q.T @ weighted)
    return float(np.sum(np.log(root)) - np.sum(np.log(np.abs(np.diag(r)))) - 0.5 * residual @ residual)


def _restricted_maximum(y: Array, s: Array, x: Array) -> float:
    """tau² >= 0 with the greatest restricted likelihood."""
    residual = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    scale = float(residual @ residual) / (len(y) - x.shape[1])
    if scale <= 0.0:
        return 0.0
    from scipy.optimize import minimize_scalar  # here: 0.2 s that comparing two runs does not need

    low, high = np.log(1e-8 * scale), np.log(100.0 * scale)
    found = minimize_scalar(
        lambda log: -restricted_log_likelihood(float(np.exp(log)), y, s, x), bounds=(low, high), method="bounded",
        options={"xatol": 1e-4},
    )  # fmt: skip
    best = float(np.exp(found.x))
    at_zero = restricted_log_likelihood(0.0, y, s, x)
    return best if -float(found.fun) > at_zero else 0.0
