"""How late the motion is recorded after the surfaces that make it, estimated in flight where no file says so.

Servos follow what is recorded of them, IMUs filter, loggers stamp when they write. With the surfaces as they were tau
before, each moment coefficient is

    C = X theta - tau (dC/d(delta)) delta' + gusts,

delta' the rate of each surface. Least squares of this would take the noise and the gusts in X for something that tau
explains: X goes together with them. What follows the recorded surfaces does not, so that theta and tau are those for
which the rest does not go together with the surfaces, their rates and their lags (two-stage least squares, as in
``undescribed_sensors``). Whether that is so is asked where there are more of these than unknowns (Sargan, The
estimation of economic relationships using instrumental variables, Econometrica 26, 1958), and whether the three moments
agree with each other and with what delays are; where not, tau is known the less.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import (
    LEARNT,
    MEASURED,
    SIGNALS_OF_SAMPLE,
    TERMS_OF_SAMPLE,
)
from aircraft_sysid_ros.identification.coefficients.pace import LOWEST_RATE
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Columns = npt.NDArray[np.int64]

SURFACES = ("de", "da", "dr")
#: One sigma [s] of what is not known before: servos need 0.05 s, filters and loggers as much.
LAG = 0.04
#: What is slower than this [s] is not asked; time constants [s] of what follows the surfaces; memory [s]; a pause [s]
#: that begins anew; time [s] between looks.
_BAND, _FOLLOW, _MEMORY, _PAUSE, _LOOK_STEP = 3.0, (0.1, 0.3, 1.0), 120.0, 0.3, 1.0
#: Samples that gusts make as one: they last 0.4 s, and samples come every 0.04 s.
_ALIKE = 20.0
#: From so many standard errors and seconds on a delay is there; 5 ms are a turn of some degrees at the quickest mode.
_SURE, _WORTH = 3.0, 0.005
#: One sigma [s] of what happens between samples at LOWEST_RATE; it goes with the square of the interval. A judgement,
#: on a flight at 10 Hz that showed 16 ms and had none.
_SAMPLED = 0.012
#: Least samples that are summed.
_LEAST = 125.0
_FIRST_MOMENT, _MOMENTS = 3, (3, 4, 5)
#: Surfaces that move each of them, as numbers in SURFACES.
_MOVE = ((1, 2), (0,), (1, 2))
_FIRST = SIGNAL_INDEX[SURFACES[0]]
_COUNT = len(SURFACES)
#: After the terms: what was measured, rates of the surfaces, the surfaces, and what follows them.
_MADE = 1 + _COUNT * (2 + len(_FOLLOW))
#: A correlation matrix that may be singular gets this.
_NEARLY = 1e-7
#: The rates need the derivatives, which need tau: so often in turn.
_TURNS = 5
#: Or until tau changes by less than this [s].
_SAME = 1e-5


class LateMotion:
    """Follows samples of the coefficients, and says how late motion is recorded: ``late`` [s] and its ``variance``."""

    def adopt(self, offsets: Columns, derivatives: Sequence[Columns]) -> None:
        """Another model, with the places (3,) of the derivatives by SURFACES in each axis, -1: none."""
        self._offsets, self._derivatives = offsets, derivatives
        size = int(np.diff(offsets).max()) + _MADE
        self._moments, self._counts = np.zeros((len(_MOMENTS), size, size)), np.zeros(len(_MOMENTS))
        self.late, self.variance = 0.0, LAG**2
        self.restart_clock()

    def restart_clock(self) -> None:
        """The clock began anew, or another manoeuvre."""
        self._filter = np.zeros((len(_MOMENTS), 3, self._moments.shape[1]))
        self._begun = np.full(len(_MOMENTS), np.nan)
        self._follows = np.full(_COUNT * len(_FOLLOW), np.nan)
        self._due = -np.inf

    def add(self, samples: Array) -> None:
        """Samples one after the other; of the first and the last there are no rates, they come again."""
        _sum(samples, self._offsets, self._follows, self._filter, self._begun, self._counts, self._moments)

    def is_due(self, time: float) -> bool:
        """Whether it is time [s] to look; then the next look is a step later."""
        if time < self._due:
            return False
        self._due = time + _LOOK_STEP
        return True

    @property
    def is_found(self) -> bool:
        """Whether the flight shows a delay."""
        return abs(self.late) > max(_SURE * float(np.sqrt(self.variance)), _WORTH)

    def look(self, interval: float) -> None:
        """Estimate ``late`` and ``variance`` from what was summed; states come ``interval`` [s] apart, 0: dense."""
        found = [
            _estimate(
                self._moments[k], float(self._counts[k]), int(np.diff(self._offsets)[axis]), self._derivatives[axis], k
            )
            for k, axis in enumerate(_MOMENTS)
        ]
        each = np.array([one for one in found if one is not None]).reshape(-1, 2)
        value, information = each[:, 0], 1.0 / each[:, 1]
        before = LAG**-2
        mean = float(information @ value) / (before + float(np.sum(information)))
        apart = (before * mean**2 + float(information @ (value - mean) ** 2)) / max(len(value), 1)
        information = information / max(apart, 1.0)  # they do not agree, or with what delays are
        self.variance = 1.0 / (before + float(np.sum(information)))
        self.late = self.variance * float(information @ value)
        self.variance += (_SAMPLED * (interval * LOWEST_RATE) ** 2) ** 2


def _estimate(m: Array, count: float, n: int, derivatives: Columns, moment: int) -> tuple[float, float] | None:
    """tau [s] and its variance from sums of products; None: this moment does not tell."""
    first = len(m) - _MADE
    moving = np.diag(m) > 0.0
    terms = np.flatnonzero(moving[:n])
    of_surfaces = [(int(np.searchsorted(terms, j)), k) for k, j in enumerate(derivatives) if j >= 0 and moving[j]]
    made = first + 1 + _COUNT
    instruments = [
        column
        for k in _MOVE[moment]
        for column in (first + 1 + k, made + k, *(made + _COUNT + k * len(_FOLLOW) + i for i in range(len(_FOLLOW))))
        if moving[column]
    ]
    if count < _LEAST or not of_surfaces or not moving[first] or len(instruments) <= len(terms):
        return None
    scale = np.sqrt(np.diag(m))
    z = m[np.ix_(instruments, instruments)] / np.outer(scale[instruments], scale[instruments])
    weights = np.linalg.inv(z + _NEARLY * np.eye(len(z)))
    used = [*terms, *(first + 1 + k for _, k in of_surfaces)]
    with_x, with_y = m[np.ix_(instruments, used)], m[instruments, first]
    with_x, with_y = with_x / scale[instruments][:, None], with_y / scale[instruments]
    theta, late = np.linalg.lstsq(m[np.ix_(terms, terms)], m[terms, first], rcond=None)[0], 0.0
    for _ in range(_TURNS):
        turn = np.zeros((len(used), len(terms) + 1))  # of theta and tau to the columns that are used
        turn[: len(terms), : len(terms)] = np.eye(len(terms))
        turn[len(terms) :, -1] = [-theta[j] for j, _ in of_surfaces]
        by = with_x @ turn
        information = by.T @ weights @ by
        size = np.sqrt(np.diag(information))
        if not np.all(size > 0.0):
            return None
        normal = information / np.outer(size, size) + _NEARLY * np.eye(len(size))
        solution = np.linalg.solve(normal, by.T @ weights @ with_y / size) / size
        theta, late, before = solution[:-1], float(solution[-1]), late
        if abs(late - before) < _SAME:
            break
    whole = turn @ solution
    rest = float(m[first, first] - 2.0 * whole @ m[used, first] + whole @ m[np.ix_(used, used)] @ whole)
    left, spare = with_y - with_x @ whole, len(instruments) - len(terms) - 1
    variance = max(rest, 0.0) / count * _ALIKE
    if not variance > 0.0 or not np.isfinite(late):
        return None
    explained = float(left @ weights @ left) / (variance * spare) if spare > 0 else 1.0
    of_late = float(np.linalg.inv(normal)[-1, -1]) / float(size[-1]) ** 2
    return late, variance * max(explained, 1.0) * of_late


@njit(cache=True)
def _put_surfaces(samples: Array, i: int, first: int, step: float, follows: Array, series: Array) -> None:
    """Rates of the surfaces, the surfaces and what follows them, into a series."""
    for k in range(_COUNT):
        at = SIGNALS_OF_SAMPLE + _FIRST + k
        rate = (samples[i + 1, at] - samples[i - 1, at]) / (samples[i + 1, 0] - samples[i - 1, 0])
        now = samples[i, at]
        is_there = np.isfinite(now + rate)
        series[first + 1 + k] = rate if is_there else 0.0
        series[first + 1 + _COUNT + k] = now if is_there else 0.0
        for j in range(len(_FOLLOW)):
            place = k * len(_FOLLOW) + j
            if is_there and np.isfinite(follows[place]):
                follows[place] += step / (step + _FOLLOW[j]) * (now - follows[place])
            else:
                follows[place] = now if is_there else np.nan
            series[first + 1 + 2 * _COUNT + place] = follows[place] if is_there else 0.0


@njit(cache=True)
def _high_pass(series: Array, step: float, filters: Array) -> None:
    """Take away what is slow, twice; ``filters`` (3, n): newest series, after one and after two."""
    before, once, twice = filters
    share = _BAND / (_BAND + step)
    for j in range(len(series)):
        now = share * (once[j] + series[j] - before[j])
        twice[j] = share * (twice[j] + now - once[j])
        once[j], before[j] = now, series[j]


@njit(cache=True)
def _sum(
    samples: Array, offsets: Columns, follows: Array, filters: Array, begun: Array, counts: Array, moments: Array
) -> None:
    """Sums of products, without what is slow, of each moment's terms and what is _MADE."""
    size = moments.shape[1]
    first = size - _MADE
    series = np.zeros(size)
    for i in range(1, len(samples) - 1):
        time, step = samples[i, 0], samples[i, 0] - samples[i - 1, 0]
        if not 0.0 < samples[i + 1, 0] - samples[i - 1, 0] < _PAUSE:
            begun[:] = np.nan
            follows[:] = np.nan
            continue
        _put_surfaces(samples, i, first, step, follows, series)
        for m in range(len(moments)):
            axis = m + _FIRST_MOMENT
            begin, n = offsets[axis], offsets[axis + 1] - offsets[axis]
            series[:first] = 0.0
            series[:n] = samples[i, TERMS_OF_SAMPLE + begin : TERMS_OF_SAMPLE + begin + n]
            series[first] = samples[i, MEASURED + axis]
            if not (samples[i, LEARNT + axis] > 0.0 and np.isfinite(np.sum(series[: first + 1]))):
                begun[m] = np.nan
                continue
            if np.isnan(begun[m]):
                begun[m] = time
                filters[m, 0], filters[m, 1:] = series, 0.0
                continue
            _high_pass(series, step, filters[m])
            if time - begun[m] < 2.0 * _BAND:
                continue
            keep, twice = np.exp(-step / _MEMORY), filters[m, 2]
            counts[m] = keep * counts[m] + 1.0
            for j in range(size):
                for k in range(size):
                    moments[m, j, k] = keep * moments[m, j, k] + twice[j] * twice[k]
