"""From a linear system in continuous time to one in discrete time, (1.1) to (2.1) of docs/references.md, exactly.

    x' = F x + B u + G w,  w white of the density Q    ->    x(k+1) = Phi x(k) + Psi u(k) + Gamma w_d(k),

with u held over the step dt [s]:

    Phi = exp(F dt)                                                                                        (3.9)
    Psi = S B,   S = integral from 0 to dt of exp(F s) ds
    Gamma Q_d Gamma' = integral from 0 to dt of exp(F s) G Q G' exp(F s)' ds.

The noise of (3.7) then enters every state (Gamma = I, Q_d the integral). Noise that a sampler holds over the step,
as that of an IMU, has Gamma = S G instead: ``held_input`` with G. In (3.8), which goes with (3.9), the noise of
y(k) is printed v(k+1): it is v(k).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Discrete:
    """transition Phi (n, n), input_matrix Psi (n, l), noise Q_d (n, n) with Gamma = I."""

    transition: Array
    input_matrix: Array
    noise: Array


def discretise(f: Array, b: Array, g: Array, density: Array, dt: float) -> Discrete:
    """All of a step dt [s] >= 0 from F (n, n), B (n, l), G (n, m) and the density Q (m, m) of the noise [1/Hz].

    Raises ValueError if a number is not finite or dt is negative.
    """
    return Discrete(transition_matrix(f, dt), held_input(f, b, dt), noise_covariance(f, g, density, dt))


def transition_matrix(f: Array, dt: float) -> Array:
    """exp(F dt) (3.9), shape (n, n), by scaling and squaring of a Pade approximation, not by the printed series.

    The series loses all digits to cancellation for a large stable F dt.
    """
    _check(f, dt)
    return np.asarray(expm(np.asarray(f, dtype=np.float64) * dt))


def held_input(f: Array, b: Array, dt: float) -> Array:
    """Integral of exp(F s) B over the step, shape (n, l), also for singular F: a block of one exponential."""
    _check(f, dt)
    n, inputs = np.shape(b)
    block = np.zeros((n + inputs, n + inputs))
    block[:n, :n], block[:n, n:] = f, b
    return np.asarray(expm(block * dt)[:n, n:])


def noise_covariance(f: Array, g: Array, density: Array, dt: float) -> Array:
    """Covariance (n, n) of the noise that x gathers over dt, by Van Loan; symmetric to the last bit.

    Van Loan's exponential holds exp(-F dt), which for a large F dt drowns the rest. It is therefore taken of a
    short step h = dt / 2^s, and the step is doubled: W(2h) = W(h) + exp(F h) W(h) exp(F h)', in which
    nothing is subtracted.
    """
    _check(f, dt)
    n = len(f)
    doublings = int(np.ceil(np.log2(max(float(np.linalg.norm(f, 1)) * dt, 1.0))))
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[n:, n:] = -np.asarray(f), np.transpose(f)
    block[:n, n:] = np.asarray(g) @ np.asarray(density) @ np.transpose(g)
    exponential = expm(block * (dt / 2.0**doublings))
    phi = exponential[n:, n:].T
    w = phi @ exponential[:n, n:]
    for _ in range(doublings):
        w = w + phi @ w @ phi.T
        phi = phi @ phi
    return np.asarray(0.5 * (w + w.T))


def _check(f: Array, dt: float) -> None:
    if not (np.all(np.isfinite(f)) and np.isfinite(dt) and dt >= 0.0):
        raise ValueError(f"F must be finite and the step finite and not negative, not {dt}")
