"""The error of a state and what its attitude does to it: moved by it, and its covariance turned with it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import Matrix, applied, three, transposed, turn_by, turn_jacobian, turned
from aircraft_sysid_ros.estimation.iterated_ekf import (
    symmetrise,
)
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.process import attitude_of
from aircraft_sysid_ros.reconstruction.state import D_ATTITUDE

Array = npt.NDArray[np.float64]


@njit(cache=True)
def retract(x: Array, delta: Array) -> Array:
    """State x (19,) or (25,) moved by the error delta (18,) or (24,): added, and for the attitude turned."""
    moved = np.empty(len(x))
    retract_into(x, delta, moved)
    return moved


@njit(cache=True)
def retract_into(x: Array, delta: Array, moved: Array) -> None:
    """``retract`` into ``moved``."""
    w, i, j, k = turned(attitude_of(x), turn_by(three(delta[D_ATTITUDE : D_ATTITUDE + 3])))
    norm = np.sqrt(w**2 + i**2 + j**2 + k**2)
    for at in range(6):
        moved[at] = x[at] + delta[at]
    moved[6], moved[7], moved[8], moved[9] = w / norm, i / norm, j / norm, k / norm
    for at in range(10, len(x)):
        moved[at] = x[at] + delta[at - 1]


@njit(cache=True)
def turn_attitude_columns(h: Array, jacobian: Matrix) -> None:
    """Attitude columns of h times ``jacobian``: from the error at eta to the error at the prediction."""
    back = transposed(jacobian)
    for i in range(h.shape[0]):
        columns = applied(back, three(h[i, D_ATTITUDE : D_ATTITUDE + 3]))
        h[i, D_ATTITUDE], h[i, D_ATTITUDE + 1], h[i, D_ATTITUDE + 2] = columns


@njit(cache=True)
def jacobian_of(delta: Array) -> Matrix:
    """Right Jacobian of the turn in an error (18,) or (24,)."""
    return turn_jacobian(three(delta[D_ATTITUDE : D_ATTITUDE + 3]))


@njit(cache=True)
def turn_attitude_error(p: Array, jacobian: Matrix) -> None:
    """Covariance p (n, n) after the attitude error is multiplied by ``jacobian``, in place; symmetric to the bit."""
    a, b, c = D_ATTITUDE, D_ATTITUDE + 1, D_ATTITUDE + 2
    for j in range(len(p)):
        p[a, j], p[b, j], p[c, j] = applied(jacobian, (p[a, j], p[b, j], p[c, j]))
    for j in range(a, c + 1):
        p[j, a], p[j, b], p[j, c] = applied(jacobian, (p[j, a], p[j, b], p[j, c]))
    symmetrise(p[a : c + 1, a : c + 1])
    for j in range(len(p)):
        p[j, a], p[j, b], p[j, c] = p[a, j], p[b, j], p[c, j]
