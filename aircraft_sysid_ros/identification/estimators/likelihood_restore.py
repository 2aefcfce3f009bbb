"""Recursive maximum likelihood after a change of the aeroplane: back to before it, wait, and go on.

A parameter that is suddenly another one makes innovations that noise is taken to have made: within a second the levels
of gusts and disturbances grow, biases and other axes move, and soon the flight counts as unexplained. All of that is
undone: the recursion goes back to how it was before the change, and stands still while recursive least squares learns
the axis anew. Gauss-Newton steps from where the axis was do not do: linearised so far from the truth they end
anywhere. Then the axis takes what least squares knows, as it did at its first start, with a wider covariance, and is
independent of the others,

    theta_a = theta_rls,    P = [[P_oo, 0], [0, WIDENING^2 P_rls]],

the filters begin with the state of the first step, and all learn on.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.iterated_ekf import cholesky
from aircraft_sysid_ros.identification.estimators.likelihood_start import set_theta
from aircraft_sysid_ros.identification.estimators.likelihood_state import RUNNING, Recursion
from aircraft_sysid_ros.identification.estimators.reset_prior import MEMORY

Array = npt.NDArray[np.float64]

#: Time [s] between states of the recursion that are kept.
_SPACING = 0.5
#: Standard errors of least squares are taken so many times larger: gusts bias it.
WIDENING = 2.0
_KEPT = ("theta", "root", "last_learnt", "clock")


class Past:
    """What a recursion had learnt at times of the newest seconds."""

    def __init__(self) -> None:
        self._kept: deque[tuple[float, Recursion]] = deque()

    def clear(self) -> None:
        """Forget it."""
        self._kept.clear()

    def keep(self, time: float, recursion: Recursion) -> None:
        """What has been learnt before ``time`` [s], now and then."""
        if not self._kept or time >= self._kept[-1][0] + _SPACING:
            self._kept.append((time, copied(recursion)))
        while len(self._kept) > 1 and self._kept[1][0] < time - MEMORY:
            self._kept.popleft()

    def restore(self, time: float, recursion: Recursion) -> None:
        """Make of the recursion, in place, what it was at ``time`` [s]; its filters do not run."""
        older = [kept for at, kept in self._kept if at <= time] or [kept for _, kept in self._kept][:1]
        for old in older[-1:]:
            put_back(old, recursion)
        recursion.clock[RUNNING] = 0.0


def copied(recursion: Recursion) -> Recursion:
    """What has been learnt, copied; the rest shared."""
    scores = type(recursion.scores)(*(array.copy() for array in recursion.scores))
    return recursion._replace(**{name: getattr(recursion, name).copy() for name in _KEPT}, scores=scores)


def put_back(old: Recursion, recursion: Recursion) -> None:
    """Make of a recursion, in place, what it was when it was copied; its filters do not run."""
    for name in _KEPT:
        getattr(recursion, name)[:] = getattr(old, name)
    for array, before in zip(recursion.scores, old.scores, strict=True):
        array[:] = before
    set_theta(recursion.theta[recursion.free], recursion)
    recursion.clock[RUNNING] = 0.0


def take_axis(recursion: Recursion, part: slice, theta: Array, covariance: Array) -> None:
    """Coefficients ``part`` (n,) from another estimator, in place; P as in the module, through its root."""
    free_theta, root = recursion.theta[recursion.free], recursion.root.copy()
    free_theta[part] = theta
    root[part, :] = 0.0
    own = np.zeros((len(root), part.stop - part.start))
    own[part] = WIDENING * cholesky(covariance)
    recursion.root[:] = np.asarray(np.linalg.qr(np.hstack([root, own]).T, mode="r")).T
    set_theta(free_theta, recursion)
