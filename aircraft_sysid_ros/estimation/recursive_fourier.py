"""Least squares in the frequency domain, recursively (Morelli, J. Guidance 23(5), 2000), with forgetting.

The finite Fourier transform of a signal x at the angular frequency w, seen from its newest time T, is

    X(T) = integral_0^T exp((jw - 1/tau) (T - t)) x(t) dt,    dX/dT = (jw - 1/tau) X + x,

one complex pole per frequency: memory and work do not grow. The amplitude fades with tau, so the weight of the
data in a sum of squares with tau/2. Integration by parts transforms a derivative without differentiating:

    D(T) = integral exp((jw - 1/tau) (T - t)) x'(t) dt = x(T) - exp((jw - 1/tau) T) x(0) + (jw - 1/tau) X(T),

exact for any signal. (With exp(-jwt) instead of the phase seen from T, the usual convention, it is multiplied
by exp(-jwT).) Where data stop and begin again each stretch has its own two boundary terms: ``close`` and ``open``
add them, and time stands still in between. An equation that is linear in its signals holds for transforms as it
holds for the signals.

Integrals are those of the trapezoidal rule; for steps h its error is, besides aliasing, that of Euler and
Maclaurin at the ends of a stretch, h^2/12 of the slope there.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.least_squares import Solution, solve_factor
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

#: Spectra of residuals are averaged over this many independent frequencies to each side.
_AVERAGED = 8.0
#: Residuals below this share of the response are rounding.
_ROUNDING = 1e-9
#: Windows whose sums are kept: those of six axes, with a zero frequency and without.
_WINDOWS = 12


class SpectralFit(NamedTuple):
    """Result of ``spectral_least_squares``."""

    solution: Solution  # its inverse (n, n) is that of sum_k W_k Re(x_k* x_k')
    weights: Array  # (m,) W_k of |v_k|^2
    spectrum: Array  # (m,) power density S_k of the residuals: E|v_k|^2 over the energy of the window


class Window(NamedTuple):
    """What the transforms look through: frequencies, memory, and how long they have been looking."""

    frequencies: Array  # (m,) angular [rad/s], ascending, evenly spaced but for a zero before them
    memory: float  # tau [s] of the amplitude
    length: float  # [s] of data

    def energy(self, differences: Array | float) -> ComplexArray:
        """Integral of w(t)^2 exp(j differences t): the covariance of transforms of unit white noise."""
        rate = 1j * np.asarray(differences) - 2.0 / self.memory
        return np.asarray((np.exp(rate * self.length) - 1.0) / rate)

    @property
    def power(self) -> float:
        """Integral of w(t)^2."""
        return float(self.energy(0.0).real)

    @property
    def freedom(self) -> float:
        """Independent real numbers in the band: 2 B T with the effective length T = (int w^2)^2 / int w^4."""
        return _freedom(self.frequencies.tobytes(), self.memory, self.length)

    @property
    def correlations(self) -> tuple[ComplexArray, ComplexArray]:
        """Energies (m, m) of the differences and of the sums of the frequencies."""
        w, rate = self.frequencies, 2.0 / self.memory
        turned = np.exp(1j * w * self.length)
        faded = np.exp(-rate * self.length) * turned[:, None]
        differences = (faded * turned.conj() - 1.0) / (1j * (w[:, None] - w) - rate)
        return differences, (faded * turned - 1.0) / (1j * (w[:, None] + w) - rate)

    @property
    def neighbours(self) -> tuple[Array, Array]:
        """Weights (k, k) of the k positive frequencies in an average about each of them, and their sums (k,)."""
        return _neighbours(self.frequencies.tobytes(), self.memory, self.length)


def _window(frequencies: bytes, memory: float, length: float) -> Window:
    return Window(np.frombuffer(frequencies), memory, length)


@lru_cache(_WINDOWS)
def _freedom(*window: Any) -> float:
    frequencies, memory, length = seen = _window(*window)
    band = frequencies[-1] - frequencies[np.searchsorted(frequencies, 0.0, side="right")]
    squares = 0.25 * memory * -np.expm1(-4.0 * length / memory)
    return float(band / np.pi * seen.power**2 / squares)


@lru_cache(_WINDOWS)
def _neighbours(*window: Any) -> tuple[Array, Array]:
    seen = _window(*window)
    w = seen.frequencies[seen.frequencies > 0.0]
    reach = _AVERAGED * (w[-1] - w[0]) * 2.0 / max(seen.freedom, 1e-9)
    kernel = np.maximum(1.0 - np.abs(w[:, None] - w[None, :]) / max(reach, 1e-9), 1e-9)
    return kernel, kernel.sum(axis=1)


@njit(cache=True)
def advance(transforms: ComplexArray, before: Array, now: Array, step: float, factor: ComplexArray) -> None:
    """One step [s] of the transforms (c, m) of c signals, in place, from their values ``before`` and ``now`` (c,).

    ``factor`` (m,) is exp((jw - 1/tau) step).
    """
    half = 0.5 * step
    for k in range(len(factor)):
        f = factor[k]
        for i in range(transforms.shape[0]):
            transforms[i, k] = f * (transforms[i, k] + half * before[i]) + half * now[i]


@njit(cache=True)
def step_factor(frequencies: Array, memory: float, step: float, out: ComplexArray) -> None:
    """exp((jw - 1/tau) step) for every frequency, into ``out`` (m,)."""
    fade = np.exp(-step / memory)
    for k in range(len(frequencies)):
        angle = frequencies[k] * step
        out[k] = fade * complex(np.cos(angle), np.sin(angle))


def derivative_transform(
    transform: ComplexArray, boundary: ComplexArray, newest: float, frequencies: Array, memory: float
) -> ComplexArray:
    """Transform (m,) of dx/dt from that of x.

    ``boundary`` (m,) is the sum of the boundary terms of earlier times, faded with the transforms: - x where a
    stretch of data began, + x where it ended; ``newest`` is x now, 0 between stretches.
    """
    return np.asarray(boundary + newest + (1j * frequencies - 1.0 / memory) * transform)


def spectral_least_squares(regressors: ComplexArray, response: ComplexArray, window: Window) -> SpectralFit:
    """Real theta (n,) of response (m,) = regressors (m, n) theta + v, weighted by the spectrum of v.

    First with equal weights; the power of the residuals, averaged over neighbouring frequencies, then gives
    weights (4.5) and a second solution: differentiated white noise, for one, grows with frequency. The zero
    frequency is one real equation, where the others are two.
    """
    power = window.power
    smallest = _ROUNDING * np.max(np.abs(response), initial=0.0) + 1e-150
    spectrum = np.ones(len(response))
    for _ in range(2):
        weights = np.where(window.frequencies > 0.0, 2.0, 1.0) / spectrum
        root = np.sqrt(weights)
        rows, right = root[:, None] * regressors, root * response
        stacked, values = np.concatenate([rows.real, rows.imag]), np.concatenate([right.real, right.imag])
        solution = solve_factor(stacked, values)
        residuals = response - regressors @ solution.estimate
        spectrum = (averaged(np.abs(residuals) ** 2, window) + smallest**2) / power
    return SpectralFit(solution, weights, spectrum)


def spectral_covariance(fit: SpectralFit, regressors: ComplexArray, window: Window) -> Array:
    """Covariance (n, n) of the estimate; NaN where it is not determined or without degrees of freedom.

    It does not take frequencies for independent: seen through a window of finite length residuals are correlated,
    E[v_k v_l*] = (S_k S_l)^1/2 G(w_k - w_l) and E[v_k v_l] the same with G(w_k + w_l), G the transform of the
    squared window. The error of theta is M^-1 Re u with u = sum_k W_k x_k* v_k, and Re u has the covariance
    1/2 Re(E[u u^H] + E[u u^T]).
    """
    n, freedom = regressors.shape[1], window.freedom
    if freedom <= n + 1.0:
        return np.full((n, n), np.nan)
    x = (fit.weights * np.sqrt(fit.spectrum))[:, None] * regressors
    of_differences, of_sums = window.correlations
    hermitian = x.conj().T @ of_differences @ x
    symmetric = x.conj().T @ of_sums @ x.conj()
    middle = 0.5 * (hermitian + symmetric).real * freedom / (freedom - n)
    return fit.solution.masked(fit.solution.inverse @ middle @ fit.solution.inverse)


def averaged(power: Array, window: Window) -> Array:
    """Power (m,) averaged over neighbouring frequencies, which holds enough independent ones; 0 gets its neighbours'.

    Two residuals are independent about pi / T apart, T the effective length of the window.
    """
    positive = window.frequencies > 0.0
    weights, sums = window.neighbours
    smooth = np.empty(len(power))
    smooth[positive] = weights @ power[positive] / sums
    smooth[~positive] = smooth[positive][0]
    return smooth
