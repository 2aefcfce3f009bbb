"""Scale and lag of a vane that no aircraft file describes, by what the IMU says of the same angle.

What a regression has for an angle, a, follows the true one, s times too large and tau late.
Between two samples true angles change as kinematics say (``flow_angle_rates``, from the IMU), whose integral I is
without noise to speak of, but not what gusts add. In a band of motion, without what is slow,

    a = s I - s tau I' + gusts,

where both are those of the air at the IMU.

An aeroplane answers gusts, so that I goes together with them: least squares of this would find a scale that is too
small. What moves the surfaces is no gust, so that s and tau are those for which the rest does not go together with the
surfaces and what follows them (two-stage least squares; Soderstrom, Errors-in-variables methods, Automatica 43, 2007).
Before a flight says so, they are not known better than vanes are built in: ``vane_scale`` and ``vane_lag`` of the
thresholds.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.flow_angles import angle_at
from aircraft_sysid_ros.identification.coefficients.layout import FLYING, SIGNAL, TIME, Body, CoefficientBatch
from aircraft_sysid_ros.identification.coefficients.signals import flow_angle_rates
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.undescribed.moved_surfaces import PAUSE
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]

ANGLES = ("alpha", "beta")
#: Slower than this [s] is not asked; time constants [s] of what follows the surfaces; time [s] that gusts last in the
#: band; memory [s]; time [s] between what is summed.
_BAND, _FOLLOW, _GUST, _MEMORY, _STEP = 3.0, (0.3, 1.0), 0.4, 120.0, 0.04
_OF_STATE = (StateField.ANGLE_OF_ATTACK, StateField.SIDESLIP)
_FIRST_CONTROL, _COUNT_OF_CONTROLS = SIGNAL_INDEX["de"], 3
#: Angle, I, I', and each control with what follows it.
_SERIES = 3 + _COUNT_OF_CONTROLS * (1 + len(_FOLLOW))
#: Surfaces that move each angle, as columns of the series.
_INSTRUMENTS = (np.array([3, 4, 5]), np.array([6, 7, 8, 9, 10, 11]))
#: What is left of a sum after another.
KEEP = float(np.exp(-_STEP / _MEMORY))
#: A correlation matrix that may be singular gets this.
NEARLY = 1e-6


class VaneMotion:
    """Follows both angles of flow as vanes and as the IMU say them."""

    def __init__(self) -> None:
        self.moments, self.counts = np.zeros((len(ANGLES), _SERIES, _SERIES)), np.zeros(len(ANGLES))
        self.restart_clock()

    def restart_clock(self) -> None:
        """The clock started over, or another manoeuvre."""
        self._filter = np.full((len(ANGLES), 4, _SERIES), np.nan)
        self._last = np.array([np.nan, -np.inf, np.nan])

    def add(self, batch: CoefficientBatch) -> None:
        """States that came together."""
        _follow(batch.rows, batch.history, batch.body, self._filter, self._last, self.counts, self.moments)

    def error(self, angle: int) -> tuple[Array, Array]:
        """Mean (2,) of (scale - 1, lag [s]) of an angle, and covariance (2, 2)."""
        return estimate(self.moments[angle], float(self.counts[angle]), _INSTRUMENTS[angle])


def estimate(moments: Array, count: float, instruments: npt.NDArray[np.int64]) -> tuple[Array, Array]:
    """Mean (2,) and covariance (2, 2) of (scale - 1, lag) from sums of products of the series."""
    prior = np.diag([1.0 / THRESHOLDS.vane_scale**2, 1.0 / THRESHOLDS.vane_lag**2])
    unknown = np.zeros(2), np.linalg.inv(prior)
    moving = instruments[np.diag(moments)[instruments] > 0.0]
    if count * _STEP < THRESHOLDS.vane_seconds or not np.all(np.diag(moments)[:3] > 0.0) or len(moving) < 3:
        return unknown
    scale, instruments = np.sqrt(np.diag(moments)), moving
    z = moments[np.ix_(instruments, instruments)] / np.outer(scale[instruments], scale[instruments])
    sign = np.array([1.0, -1.0])
    of_x = moments[np.ix_(instruments, np.array([1, 2]))] * sign / scale[instruments][:, None]
    of_a = moments[instruments, 0] / scale[instruments]
    weights = np.linalg.inv(z + NEARLY * np.eye(len(z)))
    information = of_x.T @ weights @ of_x
    theta = np.linalg.solve(information + NEARLY * np.diag(np.diag(information)), of_x.T @ weights @ of_a)
    x, with_a = moments[1:3, 1:3] * np.outer(sign, sign), moments[1:3, 0] * sign
    left = moments[0, 0] - 2.0 * theta @ with_a + theta @ x @ theta
    variance = max(left, 0.0) / count * (2.0 * _GUST / _STEP)
    of_data = information / max(variance, 1e-12)
    covariance = np.linalg.inv(of_data + prior)
    return covariance @ of_data @ (theta - np.array([1.0, 0.0])), covariance


@njit(cache=True)
def _high_pass(series: Array, controls: Array, step: float, begins: bool, filters: Array) -> None:
    """Fill I and what follows the controls into a series (_SERIES,), and take away what is slow, twice."""
    before, once, twice, follows = filters
    keep = 1.0 if begins else _BAND / (_BAND + step)
    series[1] = 0.0 if begins else before[1] + 0.5 * step * (series[2] + before[2])
    for j in range(_COUNT_OF_CONTROLS):
        first = 3 + j * (1 + len(_FOLLOW))
        series[first] = controls[j]
        for k in range(len(_FOLLOW)):
            at, share = first + 1 + k, 1.0 if begins else step / (step + _FOLLOW[k])
            follows[at] = controls[j] if begins else follows[at] + share * (controls[j] - follows[at])
            series[at] = follows[at]
    for j in range(_SERIES):
        now = 0.0 if begins else keep * (once[j] + series[j] - before[j])
        twice[j] = 0.0 if begins else keep * (twice[j] + now - once[j])
        once[j], before[j] = now, series[j]


@njit(cache=True)
def _follow(
    rows: Array, history: Array, body: Body, filters: Array, last: Array, counts: Array, moments: Array
) -> None:
    """Sums of products of the series of both angles, (2, _SERIES, _SERIES), and how many are in them, from states.

    ``filters`` (2, 4, _SERIES): newest series, after one high-pass, after two, and what follows the controls; ``last``:
    newest time [s], time of the newest sum and of the begin.
    """
    series = np.empty(_SERIES)
    for i in range(len(rows)):
        time, row = history[i, TIME], history[i]
        step = time - last[0]
        good = row[FLYING] > 0.0
        for j in range(_FIRST_CONTROL, _FIRST_CONTROL + _COUNT_OF_CONTROLS):
            good = good and np.isfinite(row[SIGNAL + j])
        if not good:
            last[0] = np.nan
            continue
        rates = flow_angle_rates(rows[i], body.gravity)
        begins = not (0.0 < step < PAUSE)
        if begins:
            last[2] = time
        for angle in range(2):
            at_imu = angle_at(rows[i], body.imu, angle == 1) - rows[i, _OF_STATE[angle]]
            series[0], series[2] = row[SIGNAL + angle] + at_imu, rates[angle]
            _high_pass(series, row[SIGNAL + _FIRST_CONTROL :], step, begins, filters[angle])
        last[0] = time
        if time - last[2] < 2.0 * _BAND or time - last[1] < _STEP - 1e-6:
            continue
        last[1] = time
        for angle in range(2):
            twice = filters[angle, 2]
            if np.isfinite(twice[0]) and np.isfinite(twice[1]):
                counts[angle] = KEEP * counts[angle] + 1.0
                for j in range(_SERIES):
                    for k in range(_SERIES):
                        moments[angle, j, k] = KEEP * moments[angle, j, k] + twice[j] * twice[k]
            else:
                last[0] = np.nan
