"""Kalman filter and prediction for a linear system in discrete time, (2.1)-(2.13) of docs/references.md.

    x(k+1) = Phi x(k) + Psi u(k) + Gamma w(k),   w ~ N(0, Q_d)                                             (2.1)
    y(k)   = C x(k) + D u(k) + v(k),             v ~ N(0, R)                                               (2.2)

(1.2), from which (2.2) comes, is printed with y-dot on its left side: the output is y. The covariance is set in
the Joseph form instead of (2.10), and no matrix is inverted. ``filter_series`` runs over a record and keeps what
``smoothing.smooth_series`` needs; ``predict`` and ``update`` are its steps for use in a loop.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.iterated_ekf import cholesky, gain, joseph_update, symmetrise
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LinearSystem:
    """The matrices of (2.1), (2.2), each constant or a series over k with one more axis in front.

    transition Phi (n, n), output C (p, n), noise Q_d (m, m) and measurement_noise R (p, p), positive definite.
    noise_input Gamma (n, m) is I if left out; input_matrix Psi (n, l) and feedthrough D (p, l) are 0. All are
    kept as series (T, rows, columns), T = 1 where constant. Raises ValueError where shapes do not fit.
    """

    transition: Array
    output: Array
    noise: Array
    measurement_noise: Array
    noise_input: Array = field(default_factory=lambda: np.empty((0, 0)))
    input_matrix: Array = field(default_factory=lambda: np.empty((0, 0)))
    feedthrough: Array = field(default_factory=lambda: np.empty((0, 0)))

    def __post_init__(self) -> None:
        n, p, m = (np.shape(a)[-1] for a in (self.transition, self.measurement_noise, self.noise))
        inputs = max(np.shape(self.input_matrix)[-1], np.shape(self.feedthrough)[-1])
        shapes = {
            "transition": (n, n),
            "output": (p, n),
            "noise": (m, m),
            "measurement_noise": (p, p),
            "noise_input": (n, m),
            "input_matrix": (n, inputs),
            "feedthrough": (p, inputs),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            if np.size(value) == 0:
                value = np.eye(n) if name == "noise_input" else np.zeros(shape)
            series = np.array(value, dtype=np.float64, ndmin=3, order="C")
            if series.ndim != 3 or series.shape[1:] != shape:
                raise ValueError(f"{name} must have the shape {shape}, not {np.shape(value)}")
            object.__setattr__(self, name, series)

    @property
    def noise_covariance(self) -> Array:
        """Gamma Q_d Gamma' of (2.8), shape (T, n, n)."""
        return np.asarray(self.noise_input @ self.noise @ np.swapaxes(self.noise_input, 1, 2))

    def forcing(self, inputs: Array | None, steps: range) -> tuple[Array, Array]:
        """Psi u (N, n) and D u (N, p) for the inputs u (N, l) of the steps k; without inputs 0."""
        self._check_length(steps.stop)
        count, wanted = len(steps), self.input_matrix.shape[2]
        u = np.empty((count, 0)) if inputs is None else np.asarray(inputs, dtype=np.float64)
        if u.shape != (count, wanted):
            raise ValueError(f"inputs must have the shape {(count, wanted)}, not {u.shape}")
        psi, d = (a if len(a) == 1 else a[steps.start : steps.stop] for a in (self.input_matrix, self.feedthrough))
        return (psi @ u[:, :, None])[:, :, 0], (d @ u[:, :, None])[:, :, 0]

    def _check_length(self, stop: int) -> None:
        for name in self.__dataclass_fields__:
            length = len(getattr(self, name))
            if 1 < length < stop:
                raise ValueError(f"{name} is given for {length} steps and {stop} are asked for")


@dataclass(frozen=True)
class FilterSeries:
    """Estimates over N steps: x(k|k) (N, n), P(k|k) (N, n, n), and x(k+1|k), P(k+1|k) of the same k."""

    state: Array
    covariance: Array
    predicted_state: Array
    predicted_covariance: Array


@njit(cache=True)
def predict(state: Array, covariance: Array, transition: Array, forcing: Array, noise: Array) -> tuple[Array, Array]:
    """x(k+1|k), P(k+1|k) (2.7), (2.8), with ``forcing`` = Psi u (n,) and ``noise`` = Gamma Q_d Gamma' (n, n)."""
    predicted = transition @ covariance @ transition.T + noise
    symmetrise(predicted)
    return transition @ state + forcing, predicted


@njit(cache=True)
def update(
    state: Array, covariance: Array, measured: Array, output: Array, measurement_noise: Array
) -> tuple[Array, Array]:
    """x(k|k), P(k|k) (2.9)-(2.11) with the Joseph form, from ``measured`` = y - D u (p,), C (p, n) and R (p, p).

    A NaN in ``measured`` is a missing measurement: that element is left out, and with all missing nothing
    changes. The outputs are combined into independent ones with the factor of R. The result is NaN if R of the
    elements that are there is not positive definite.
    """
    there = np.flatnonzero(np.isfinite(measured))
    count, n = len(there), len(state)
    updated = covariance.copy()
    if count == 0:
        return state.copy(), updated
    noise, white = np.empty((count, count)), np.empty((count, n + 1))
    for i in range(count):
        row = there[i]
        for j in range(count):
            noise[i, j] = measurement_noise[row, there[j]]
        white[i, :n] = output[row]
        white[i, n] = measured[row] - np.sum(output[row] * state)
    factor = cholesky(noise)
    for i in range(count):  # L^-1 [C, y - C x]: their errors are independent, of variance 1
        for j in range(i):
            white[i] -= factor[i, j] * white[j]
        white[i] /= factor[i, i]
    c, ones = white[:, :n].copy(), np.ones(count)
    k_gain, _ = gain(updated, c, ones)
    joseph_update(updated, k_gain, c, ones)
    return state + k_gain @ white[:, n].copy(), updated


@njit(cache=True)
def _filter(
    state: Array, covariance: Array, measured: Array, forcing: Array, phi: Array, w: Array, c: Array, r: Array
) -> tuple[Array, Array, Array, Array]:
    steps, n = forcing.shape
    x, p = np.empty((steps, n)), np.empty((steps, n, n))
    x_next, p_next = np.empty((steps, n)), np.empty((steps, n, n))
    for k in range(steps):
        x[k], p[k] = update(state, covariance, measured[k], c[min(k, len(c) - 1)], r[min(k, len(r) - 1)])
        state, covariance = predict(x[k], p[k], phi[min(k, len(phi) - 1)], forcing[k], w[min(k, len(w) - 1)])
        x_next[k], p_next[k] = state, covariance
    return x, p, x_next, p_next


def filter_series(
    system: LinearSystem, state: Array, covariance: Array, outputs: Array, inputs: Array | None = None
) -> FilterSeries:
    """Filter a record: outputs y (N, p), NaN where missing, and inputs u (N, l) at the same instants.

    ``state`` x(0|-1) (n,) and ``covariance`` P(0|-1) (n, n) are what is known before the first output. Raises
    ValueError where shapes do not fit, numpy.linalg.LinAlgError if R or an innovation covariance is not
    positive definite.
    """
    y = np.asarray(outputs, dtype=np.float64)
    n, p = system.transition.shape[2], system.output.shape[1]
    if y.ndim != 2 or y.shape[1] != p:
        raise ValueError(f"outputs must have the shape (N, {p}), not {y.shape}")
    start = _checked_start(state, covariance, n)
    forcing, feedthrough = system.forcing(inputs, range(len(y)))
    matrices = (system.transition, system.noise_covariance, system.output, system.measurement_noise)
    series = FilterSeries(*_filter(*start, y - feedthrough, forcing, *matrices))
    if not np.all(np.isfinite(series.predicted_covariance)):
        raise np.linalg.LinAlgError("R or the innovation covariance is not positive definite, or a matrix not finite")
    return series


def predict_ahead(
    system: LinearSystem,
    state: Array,
    covariance: Array,
    steps: int,
    inputs: Array | None = None,
    start: int = 0,
) -> tuple[Array, Array]:
    """x(k+i|k) (steps, n) and P(k+i|k) (steps, n, n) for i = 1 .. steps, (2.12), (2.13), from x(k|k), P(k|k).

    inputs u(k) .. u(k+steps-1) of shape (steps, l), or one u of shape (l,) that is held, as is usual
    where the future input is not known. ``start`` is k, for matrices that change with it.
    """
    x, p = _checked_start(state, covariance, system.transition.shape[2])
    if inputs is not None and np.ndim(inputs) == 1:
        inputs = np.tile(inputs, (steps, 1))
    forcing, _ = system.forcing(inputs, range(start, start + steps))
    phi, w = system.transition, system.noise_covariance
    states, covariances = np.empty((steps, len(x))), np.empty((steps, len(x), len(x)))
    for i in range(steps):
        k = start + i
        x, p = predict(x, p, phi[min(k, len(phi) - 1)], forcing[i], w[min(k, len(w) - 1)])
        states[i], covariances[i] = x, p
    return states, covariances


def _checked_start(state: Array, covariance: Array, n: int) -> tuple[Array, Array]:
    x, p = (np.array(a, dtype=np.float64, order="C") for a in (state, covariance))
    if x.shape != (n,) or p.shape != (n, n):
        raise ValueError(f"state and covariance must have the shapes {(n,)}, {(n, n)}, not {x.shape}, {p.shape}")
    return x, p
