"""What sensors that no aircraft file describes leave in doubt of the parameters of an axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.undescribed.late_motion import Late
from aircraft_sysid_ros.identification.undescribed.moved_surfaces import COUNT, FORMS, derivatives_of

Array = npt.NDArray[np.float64]

#: What may be wrong: each angle and its derivative, the force coefficients that a turning of 1 m beside makes, what 1 m
#: ahead and to the right make of alpha, 1 m ahead and below of beta, what is wrong of alpha, its derivative, and 1 m
#: ahead and to the right, times alpha; and the forms of each surface.
TURNING, OF_VANES, BY_ALPHA, OF_FORMS = 4, 7, 11, 15
#: Coordinates of what 1 m makes of each angle.
_ACROSS = ([0, 1], [0, 2])


class OfSensors(NamedTuple):
    """What vanes do to the parameters of an axis."""

    shift: Array  # (n,) that frees them of what was found
    covariance: Array  # (n, n) of what is left
    found: Array  # (n, n) mean square of what was found


class SensorDoubt(NamedTuple):
    """What is known of the sensors, and of what they do."""

    mean: Array  # (2, 2) of each angle (scale - 1, lag [s])
    covariance: Array  # (2, 2, 2)
    place: Array  # (3,) [m] one sigma of the place of the IMU
    vane_place: Array  # (3,) [m] the same of the vanes
    late: tuple[Late, ...]  # motion after the surfaces
    is_new: bool  # what is known was learnt in another flight, and this one has not shown its sensors yet
    regressions: Array  # (6, k, n): of each axis, of what may be wrong on its terms

    def of(self, model: AerodynamicModel, axis: int, theta: Array, slopes: Sequence[float], bend: float) -> OfSensors:
        """For an axis with the parameters ``theta``; ``slopes`` dC/d(alpha) at alpha = 0 and dC/d(beta), and by how
        much the first grows with alpha, ``bend``.
        """
        n = len(model.terms[AXES[axis]])
        shift, left, found = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
        all_rows = self.regressions[axis, :, :n]
        if self.is_new:
            of_constant, of_derivative = THRESHOLDS.other_constant, THRESHOLDS.other_derivative
            least = np.array([of_constant if text == "1" else of_derivative for text in model.terms[AXES[axis]]])
            return OfSensors(shift, np.diag(np.maximum(np.abs(np.nan_to_num(theta)), least) ** 2), found)
        if not np.isfinite(all_rows).all():
            return OfSensors(shift, left, found)
        bends = bend * all_rows[BY_ALPHA:OF_FORMS]
        for angle, slope in enumerate(slopes):
            rows = slope * all_rows[2 * angle : 2 * angle + 2] + (bends[:2] if angle == 0 else 0.0)
            rows = rows * np.array([[1.0], [-1.0]])
            moved = self.mean[angle] @ rows
            shift += moved
            left += rows.T @ self.covariance[angle] @ rows
            found += np.outer(moved, moved)
            beside = slope * all_rows[OF_VANES + 2 * angle : OF_VANES + 2 * angle + 2]
            beside = beside + (bends[2:] if angle == 0 else 0.0)
            left += (beside.T * self.vane_place[_ACROSS[angle]] ** 2) @ beside
        if axis < 3:  # of e, the two axes across the force, each by the angular acceleration about the other
            about = [k for k in range(3) if k != axis]
            turning = all_rows[TURNING:OF_VANES][about]
            left += (turning.T * self.place[about[::-1]] ** 2) @ turning
        if self.late and np.isfinite(theta).all():
            self._late(all_rows[OF_FORMS:], derivatives_of(model, axis), theta, shift, left, found)
        return OfSensors(shift, left, found)

    def freeing(self, model: AerodynamicModel, axis: int, way: Late) -> Array:
        """What frees the parameters of an axis (n,) of surfaces that are late in one way, (n, n)."""
        n = len(model.terms[AXES[axis]])
        forms = self.regressions[axis, OF_FORMS:, :n]
        if not np.isfinite(forms).all():
            return np.eye(n)
        return _freeing(forms.reshape(COUNT, FORMS, n), derivatives_of(model, axis), [way])[0][0]

    def _late(
        self, rows: Array, derivatives: npt.NDArray[np.int64], theta: Array, shift: Array, left: Array, found: Array
    ) -> None:  # fmt: skip
        """Add what late motion does to ``theta``; of each surface rows (FORMS,) on the terms."""
        whole, change = _freeing(rows.reshape(COUNT, FORMS, -1), derivatives, self.late)
        probability, variance = np.array([(way.probability, way.variance) for way in self.late]).T
        freed = whole @ theta
        by_late = (whole @ (change @ freed[:, :, None]))[:, :, 0]
        mean = probability @ freed
        square = (freed.T * probability) @ freed + (by_late.T * (probability * variance)) @ by_late
        shift += mean - theta
        found += np.outer(mean - theta, mean - theta)
        left += square - np.outer(mean, mean)


def _freeing(forms: Array, derivatives: npt.NDArray[np.int64], ways: Sequence[Late]) -> tuple[Array, Array]:
    """What frees parameters of each way of being late, and what being late by a second more makes of those (w, n, n);
    what is more than ``most_freed`` of a combination of them is not believed.
    """
    n = forms.shape[-1]
    turn, change = np.zeros((len(ways), n, n)), np.zeros((len(ways), n, n))
    near, shares, slopes = (np.array(each) for each in zip(*(way.near for way in ways), strict=True))
    for form, column in zip(forms, derivatives, strict=True):
        if column >= 0:
            turn[:, :, column] = form[0] - (shares[:, None] @ form[near])[:, 0]
            change[:, :, column] = -(slopes[:, None] @ form[near])[:, 0]
    largest = np.max(np.abs(np.linalg.eigvals(turn)), axis=1, initial=0.0)
    believed = np.minimum(1.0, THRESHOLDS.most_freed / np.maximum(largest, 1e-9))
    return np.asarray(np.linalg.inv(np.eye(n) - turn * believed[:, None, None])), change
