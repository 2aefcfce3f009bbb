"""Equation error in the frequency domain after a change of the aeroplane: with what was known before as a prior.

The transforms X (m, n) and Z (m,) of one axis start over with the change. With weights W_k = 2 / S_k the prior
(theta_0, I_0^-1) enters beside them as

    (c Re X* W X + I_0) theta = c Re X* W Z + I_0 theta_0.

Frequencies are nearer to each other than the window can tell apart, so that sums over them count the same data several
times: c = freedom / (2 m G(0)) makes the first term the information that is there, G(0) the energy of the window. With
M the matrix on the left over c, and V the covariance of X* W v as in ``spectral_covariance``, the estimate has

    M^-1 (V + I_0 / c^2) M^-1.

The spectrum S of the residuals is that from before the change until as much data as made it say otherwise.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.least_squares import solve_factor
from aircraft_sysid_ros.estimation.recursive_fourier import SpectralFit, Window, averaged
from aircraft_sysid_ros.identification.estimators.reset_prior import MEMORY, changed_variance, information

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

#: The spectrum from before the change counts as so many independent numbers.
_PRIOR_WORTH = 30.0


class Prior(NamedTuple):
    """What an axis knew before it changed."""

    theta: Array  # (n,)
    information: Array  # (n, n) at the time of the change
    spectrum: Array  # (m,) of the residuals


class Before(NamedTuple):
    """A fit of one axis at one time [s]."""

    time: float
    fit: SpectralFit
    scale: float  # c of the module


def information_scale(window: Window) -> float:
    """c of the module: what sums over frequencies are to be multiplied by to be information."""
    positive = float(np.sum(window.frequencies > 0.0))
    return window.freedom / (2.0 * positive * window.power)


def newest_before(fits: deque[Before], time: float) -> Before | None:
    """Newest fit that is not younger than ``time`` [s], or the oldest there is."""
    older = [fit for fit in fits if fit.time <= time]
    return older[-1] if older else (fits[0] if fits else None)


def forget_old(fits: deque[Before], now: float) -> None:
    """Drop what is older than what a change needs, in place."""
    while fits and fits[0].time < now - MEMORY:
        fits.popleft()


def prior_of(before: Before, spread: Array) -> Prior:
    """The prior of an axis that knew ``before``, opened to any change, see ``reset_prior``."""
    covariance = before.fit.solution.inverse / before.scale
    theta = before.fit.solution.estimate
    open_to = changed_variance(theta, spread)
    return Prior(theta, information(covariance + np.diag(open_to)), before.fit.spectrum)


def fit_with_prior(regressors: ComplexArray, response: ComplexArray, window: Window, prior: Prior) -> SpectralFit:
    """The estimate of the module; its solution's inverse is M^-1."""
    root_prior = np.linalg.cholesky(prior.information / information_scale(window)).T
    power, spectrum = window.power, prior.spectrum
    for _ in range(2):
        weights = np.where(window.frequencies > 0.0, 2.0, 1.0) / spectrum
        root = np.sqrt(weights)
        rows, right = root[:, None] * regressors, root * response
        stacked = np.concatenate([rows.real, rows.imag, root_prior])
        solution = solve_factor(stacked, np.concatenate([right.real, right.imag, root_prior @ prior.theta]))
        residuals = averaged(np.abs(response - regressors @ solution.estimate) ** 2, window) / power
        both = _PRIOR_WORTH * prior.spectrum + window.freedom * residuals
        spectrum = both / (_PRIOR_WORTH + window.freedom)
    return SpectralFit(solution, weights, spectrum)


def covariance_with_prior(fit: SpectralFit, regressors: ComplexArray, window: Window, prior: Prior) -> Array:
    """Covariance (n, n) of the module."""
    x = (fit.weights * np.sqrt(fit.spectrum))[:, None] * regressors
    of_differences, of_sums = window.correlations
    hermitian = x.conj().T @ of_differences @ x
    symmetric = x.conj().T @ of_sums @ x.conj()
    middle = 0.5 * (hermitian + symmetric).real + prior.information / information_scale(window) ** 2
    covariance = fit.solution.inverse @ middle @ fit.solution.inverse
    return 0.5 * (covariance + covariance.T)
