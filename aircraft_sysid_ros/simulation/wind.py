"""Wind of a simulated flight: a constant part, a random walk, and Dryden turbulence.

Turbulence is the low-altitude model of MIL-F-8785C, sections 3.7.2.1 and 3.7.3.4: continuous forming filters,
discretised exactly, along the mean wind, across it and down, as that specification orders below 1000 ft.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, solve_continuous_lyapunov

from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

FEET = 0.3048  # [m]
KNOTS = 0.514444  # [m/s]
VERTICAL_RETURN = 60.0  # [s]
#: Wind speed at 20 ft [m/s] that stands for each class of turbulence.
TURBULENCE_WIND = {"none": 0.0, "light": 15.0 * KNOTS, "moderate": 30.0 * KNOTS, "severe": 45.0 * KNOTS}


@dataclass(frozen=True)
class Turbulence:
    """Standard deviations [m/s] and length scales [m] of the gusts u (along), v (across), w (down)."""

    sigma: tuple[float, float, float]
    length: tuple[float, float, float]


def low_altitude_turbulence(height: float, wind_at_20_feet: float) -> Turbulence:
    """Turbulence of MIL-F-8785C at a height [m], used between 10 and 1000 ft, for a wind [m/s] at 20 ft."""
    h = float(np.clip(height / FEET, 10.0, 1000.0))
    base = 0.177 + 0.000823 * h
    sigma_w = 0.1 * wind_at_20_feet
    sigma_u = sigma_w / base**0.4
    length_u = h / base**1.2 * FEET
    return Turbulence((sigma_u, sigma_u, sigma_w), (length_u, length_u, h * FEET))


def dryden_gusts(rng: np.random.Generator, count: int, step: float, airspeed: float, turbulence: Turbulence) -> Array:
    """Gusts u, v, w [m/s], shape (count, 3), every ``step`` [s] of flight at ``airspeed`` [m/s], stationary.

    Spectra of MIL-F-8785C: H_u = s_u sqrt(2 T) / (1 + T s) with T = L_u / V; H_v = s_v sqrt(T) (1 + sqrt(3) T
    s) / (1 + T s)^2 with T = L_v / V; H_w likewise; driven by white noise of unit two-sided intensity.
    """
    columns = []
    for axis in range(3):
        sigma, period = turbulence.sigma[axis], turbulence.length[axis] / airspeed
        if axis == 0:
            a, b, c = (
                np.array([[-1.0 / period]]),
                np.array([[1.0]]),
                np.array([sigma * np.sqrt(2.0 / period)]),
            )
        else:
            a = np.array([[0.0, 1.0], [-1.0 / period**2, -2.0 / period]])
            b = np.array([[0.0], [1.0]])
            c = sigma * np.sqrt(period) * np.array([1.0, np.sqrt(3.0) * period]) / period**2
        columns.append(_stationary_output(rng, count, step, a, b, c))
    return np.stack(columns, axis=1)


def _stationary_output(rng: np.random.Generator, count: int, step: float, a: Array, b: Array, c: Array) -> Array:
    """Output (count,) of dx = a x dt + b dw, y = c x, sampled exactly, stationary from the first."""
    covariance = solve_continuous_lyapunov(a, -b @ b.T)
    transition = expm(a * step)
    noise = covariance - transition @ covariance @ transition.T  # what keeps a stationary process stationary
    noise_root = np.linalg.cholesky(0.5 * (noise + noise.T))
    start = np.linalg.cholesky(covariance) @ rng.standard_normal(len(a))
    return _linear_output(transition, noise_root, c, start, rng.standard_normal((count, len(a))))


@njit(cache=True)
def _linear_output(transition: Array, noise_root: Array, c: Array, start: Array, noise: Array) -> Array:
    out = np.empty(len(noise))
    x = start
    for i in range(len(noise)):
        out[i] = np.sum(c * x)
        x = transition @ x + noise_root @ noise[i]
    return out


def random_walk(rng: np.random.Generator, count: int, step: float, intensity: float) -> Array:
    """Random walk NED (count, 3) from 0, level standard deviation ``intensity`` * sqrt(time).

    The vertical part returns to 0 with VERTICAL_RETURN [s]: air does not rise for minutes, or no flight would
    keep its height.
    """
    increments = intensity * np.sqrt(step) * rng.standard_normal((count, 3))
    increments[0] = 0.0
    walk = np.cumsum(increments, axis=0)
    one, keep = np.ones((1, 1)), np.full((1, 1), np.exp(-step / VERTICAL_RETURN))
    following = np.append(increments[1:, 2:], [[0.0]], axis=0)
    walk[:, 2] = _linear_output(keep, one, one[0], increments[0, 2:], following)
    return walk


def wind_series(
    rng: np.random.Generator,
    count: int,
    step: float,
    mean: npt.ArrayLike,
    walk: float,
    airspeed: float,
    turbulence: Turbulence | None,
) -> Array:
    """Wind NED [m/s], shape (count, 3): the direction the air moves to."""
    constant = np.asarray(mean, dtype=np.float64)
    wind = constant + random_walk(rng, count, step, walk)
    if turbulence is None:
        return wind
    heading = np.arctan2(constant[1], constant[0])
    c, s = np.cos(heading), np.sin(heading)
    level = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    result: Array = wind + dryden_gusts(rng, count, step, airspeed, turbulence) @ level.T
    return result
