"""What an axis knew before the aeroplane changed, as a prior: any parameter may have changed.

With theta_0 and the covariance P_0 from just before the change, the prior says that any parameter may have changed by a
share of itself, and by what a share of the coefficient's spread is:

    theta ~ (theta_0, P_0 + diag(d_j^2)),    d_j^2 = (SHARE theta_0j)^2 + (SPREAD spread / rms x_j)^2.

So no value leaves the reach of the prior, whatever the first second of data says.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: One sigma of a change: share of the parameter, and share of the spread of its coefficient that the term may do.
SHARE, SPREAD = 0.75, 0.2
#: Time [s] for which samples and parameters are remembered: from before the change to its alarm.
MEMORY = 5.0
#: Information of a prior, or share of it, that is none any more.
FORGOTTEN = 1e-100


def changed_variance(theta: Array, spread: Array) -> Array:
    """Variance (n,) of what a change may do to parameters (n,); ``spread`` as of spread_of_terms."""
    return (SHARE * theta) ** 2 + (SPREAD * spread) ** 2


def spread_of_terms(sums: Array) -> Array:
    """Value (n,) of each parameter that would spread its coefficient as the flight did, from sums (n + 2, n + 2)."""
    n = len(sums) - 2
    moments = sums / max(sums[n + 1, n + 1], 1e-300)
    spread = np.sqrt(max(moments[n, n] - moments[n, n + 1] ** 2, 0.0))
    size = np.sqrt(np.diag(moments)[:n])
    return np.asarray(np.where(size > 0.0, spread / np.where(size > 0.0, size, 1.0), 0.0))


def information(covariance: Array) -> Array:
    """Inverse (n, n) of a positive covariance, scaled and through its factor."""
    scale = np.sqrt(np.diag(covariance))
    half = np.linalg.solve(np.linalg.cholesky(covariance / np.outer(scale, scale)), np.diag(1.0 / scale))
    return half.T @ half


def within_prior(covariance: Array, information: Array) -> Array:
    """A covariance (n, n) with standard errors that are at most those of the prior: systematic parts know no bound."""
    root = np.linalg.cholesky(information)
    most = np.sqrt(np.sum(np.linalg.solve(root, np.eye(len(root))) ** 2, axis=0))
    factor = np.minimum(most / np.sqrt(np.diag(covariance)), 1.0)
    return np.asarray(covariance * np.outer(factor, factor))
