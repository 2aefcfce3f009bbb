"""How late the motion is recorded after the surfaces that make it, estimated in flight where no file says so.

Servos follow what is recorded of them, IMUs filter, loggers stamp when they write. With delta_tau the surfaces as they
were, so much later than they are recorded or with so long a lag of their servos (``moved_surfaces``), and X_tau the
terms with those, each moment coefficient is

    C = X_tau theta + gusts.

Least squares of this would take the noise and the gusts in X for something that tau explains: X goes together with
them. What follows the recorded surfaces does not, so that theta and tau are those for which the rest does not go
together with the surfaces, their rates and their lags (two-stage least squares, as in ``vanes``), for the
three moments together. Whether that is so is asked where there are more of these than unknowns (Sargan, The estimation
of economic relationships using instrumental variables, Econometrica 26, 1958), and whether the three moments agree with
each other and with what delays are; where not, tau is known the less. What is left says how probable each tau is, of a
delay and of a lag, which may be more than one: what is known is their mean and variance over all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.coefficients.layout import (
    LEARNT,
    MEASURED,
    SIGNALS_OF_SAMPLE,
    TERMS_OF_SAMPLE,
)
from aircraft_sysid_ros.identification.coefficients.pace import LOWEST_RATE
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.undescribed.moved_surfaces import (
    COUNT,
    COURSES,
    DELAY,
    FIRST,
    FORMS,
    LAGGED,
    NEAR,
    PAUSE,
    Between,
    Course,
)
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Columns = npt.NDArray[np.int64]
#: Of the terms of an axis that two models have, in the one and in the other.
Places = tuple[Columns, Columns]

#: What is slower than this [s] is not asked; time constants [s] of what follows the surfaces; memory [s]; time [s]
#: between looks, and more of it later: a share of what has passed since the first.
_BAND, _FOLLOW, _MEMORY, _LOOK_STEP, _LOOK_SHARE = 3.0, (0.3, 1.0), 120.0, 1.0, 0.05
#: Samples that gusts make as one: they last 0.4 s, and samples come every 0.04 s.
_ALIKE = 20.0
_FIRST_MOMENT, _MOMENTS = 3, (3, 4, 5)
#: Surfaces that move each of them, as numbers in SURFACES.
_MOVE = ((1, 2), (0,), (1, 2))
#: After the terms: what was measured, rates of the surfaces, their forms, and what follows them.
_RATES, _FORMS, _FOLLOWS = 1, 1 + COUNT, 1 + COUNT * (1 + FORMS)
_MADE = _FOLLOWS + COUNT * len(_FOLLOW)
#: A correlation matrix that may be singular gets this.
_NEARLY = 1e-7
#: Times [s] of a delay and of a lag that are asked, and by how much finer around the best.
_DELAYS, _LAGS, _FINE = np.arange(-0.08, 0.201, 0.01), np.arange(0.0, 0.251, 0.01), np.arange(-0.0095, 0.01, 0.001)


class Late(NamedTuple):
    """One way of being late, how probable it is, by how much [s], and the variance of that."""

    course: Course
    probability: float
    time: float
    variance: float
    near: Between  # forms that are that late

    @property
    def whole(self) -> float:
        """By how much [s] in all, with the dead time."""
        return self.course.dead_time + self.time


class LateMotion:
    """Follows samples of the coefficients, and says how late motion is recorded: ``ways``."""

    def __init__(self, found: float = 0.0) -> None:
        """``found``: one sigma [s] of what an earlier flight has found, which is taken off."""
        self._found = found
        self.moments, self._filter = np.zeros((len(_MOMENTS), 0, 0)), np.zeros((len(_MOMENTS), 3, 0))
        self._begun = np.full(len(_MOMENTS), np.nan)
        self._unknown = (Late(DELAY, 1.0, 0.0, THRESHOLDS.motion_late**2, DELAY.between(0.0)),)

    def adopt(self, offsets: Columns, derivatives: Sequence[Columns], stays: Sequence[Places] | None = None) -> None:
        """Another model, with the places (3,) of the derivatives by SURFACES in each axis, -1: none.

        ``stays``: of each axis the terms that the model before had; None: there was none, or nothing stays.
        """
        sums, filters = self.moments, self._filter
        self._offsets, self._derivatives = offsets, derivatives
        size = int(np.diff(offsets).max()) + _MADE
        self.moments, self._filter = np.zeros((len(_MOMENTS), size, size)), np.zeros((len(_MOMENTS), 3, size))
        if stays is None:
            self.counts = np.zeros(len(_MOMENTS))
            self.ways: tuple[Late, ...] = self._unknown
            self.restart_clock()
            return
        for m, axis in enumerate(_MOMENTS):
            old = np.append(stays[axis][0], sums.shape[1] - _MADE + np.arange(_MADE))
            new = np.append(stays[axis][1], size - _MADE + np.arange(_MADE))
            self.moments[m][np.ix_(new, new)] = _whole(sums[m])[np.ix_(old, old)]
            self._filter[m][:, new] = filters[m][:, old]
            if len(stays[axis][0]) < offsets[axis + 1] - offsets[axis]:
                self._begun[m] = np.nan  # what is slow of a term that came is not known

    def restart_clock(self) -> None:
        """The clock started over, or another manoeuvre."""
        self._filter = np.zeros((len(_MOMENTS), 3, self.moments.shape[1]))
        self._begun = np.full(len(_MOMENTS), np.nan)
        self._follows = np.full(COUNT * len(_FOLLOW), np.nan)
        self._first = self._due = -np.inf

    def add(self, samples: Array, forms: Array) -> None:
        """Samples one after the other, with the forms (n, COUNT, FORMS) of their surfaces; of the first and the last
        there are no rates, they come again.
        """
        _sum(samples, forms, self._offsets, self._follows, self._filter, self._begun, self.counts, self.moments)

    def is_due(self, time: float) -> bool:
        """Whether it is time [s] to look; then the next look is a step later."""
        if time < self._due:
            return False
        self._first = time if self._first == -np.inf else self._first
        self._due = time + max(_LOOK_STEP, _LOOK_SHARE * (time - self._first))
        return True

    @property
    def best(self) -> Late:
        """The more probable way."""
        return max(self.ways, key=lambda way: way.probability)

    @property
    def whole(self) -> tuple[float, float]:
        """By how much [s] motion is late, in whatever way, and the variance of that."""
        mean = sum(way.probability * way.whole for way in self.ways)
        return mean, sum(way.probability * (way.variance + (way.whole - mean) ** 2) for way in self.ways)

    @property
    def is_found(self) -> bool:
        """Whether the flight shows that motion is late, in whatever way."""
        mean, variance = self.whole
        return abs(mean) > max(THRESHOLDS.late_surely * float(np.sqrt(variance)), THRESHOLDS.late_least)

    def warm_up(self) -> None:
        """Compile, or load from the cache, what is first needed once a moment has moved enough."""
        other = LateMotion()
        other.adopt(self._offsets, self._derivatives)
        other.counts[:], other.moments[:] = 1e6, np.eye(other.moments.shape[1])
        other.look(0.0)

    def look(self, interval: float) -> None:
        """Estimate ``ways`` from what was summed; states come ``interval`` [s] apart, 0: dense."""
        asked = [
            _asked(_whole(self.moments[k]), self.counts[k], self._derivatives[axis], k)
            for k, axis in enumerate(_MOMENTS)
        ]
        known = [each for each in asked if each is not None]
        if not known:
            self.ways = self._unknown
            return
        coarse = [_profiles(known, course, _LAGS if course.is_lag else _DELAYS) for course in COURSES]
        variances = np.min([profile.variances(known) for profile in coarse], axis=0)
        best = [profile.times[int(np.argmin(profile.whole(variances)))] for profile in coarse]
        near = [
            time + _FINE[time + _FINE >= (0.0 if course.is_lag else _DELAYS[0])]
            for course, time in zip(COURSES, best, strict=True)
        ]
        fine = [_profiles(known, course, times) for course, times in zip(COURSES, near, strict=True)]
        each = [one.beside(other) for one, other in zip(coarse, fine, strict=True)]
        alone = sum(np.min(np.hstack([profile.left for profile in each]), axis=1) / variances)
        least = min(float(np.min(profile.whole(variances))) for profile in each)
        apart = max((least - float(alone)) / len(known), 1.0)  # they do not agree, or with what delays are
        beyond = [(profile.whole(variances) - least) / apart for profile in each]
        weights = [profile.steps() * np.exp(-0.5 * more) for profile, more in zip(each, beyond, strict=True)]
        whole = float(sum(np.sum(weight) for weight in weights))
        sampled = (THRESHOLDS.motion_between * (interval * LOWEST_RATE) ** 2) ** 2 + self._found**2
        self.ways = tuple(
            _way(course, profile.times, weight / whole, sampled)
            for course, profile, weight in zip(COURSES, each, weights, strict=True)
        )


def _way(course: Course, times: Array, weights: Array, sampled: float) -> Late:
    """Probability, mean and variance of times [s] of such weights."""
    probability = float(np.sum(weights))
    share = weights / max(probability, 1e-300)
    mean = float(share @ times)
    wrong = (THRESHOLDS.motion_wrong * (course.dead_time + mean)) ** 2
    variance = float(share @ (times - mean) ** 2) + sampled + wrong
    return Late(course, probability, mean, variance, course.between(mean))


def _whole(sums: Array) -> Array:
    """Both of each pair, where one is summed."""
    return np.asarray(np.tril(sums) + np.tril(sums, -1).T)


class _Asked(NamedTuple):
    """What a moment has to say: sums of products ``m``, the columns of its terms and which of them is the derivative by
    which surface, -1: none; its instruments, their scale and the weights of their products.
    """

    m: Array
    samples: float
    terms: Columns
    surfaces: Columns
    instruments: Columns
    scale: Array
    weights: Array

    @property
    def spare(self) -> int:
        """Instruments more than unknowns, but for the one that all moments share."""
        return len(self.instruments) - len(self.terms)

    @property
    def free(self) -> float:
        """Samples that chance makes, of those that gusts make as one, without those that the unknowns take."""
        return self.samples / _ALIKE - len(self.terms) - 1


class _Profile(NamedTuple):
    """At times (t,) [s] of a course, of each moment (m, t): what goes together with the instruments, and the whole rest
    of the sum of squares.
    """

    times: Array
    left: Array
    rest: Array

    def variances(self, known: Sequence[_Asked]) -> Array:
        """Of what goes together with the instruments (m,), by the rest and by itself, the larger."""
        free = np.array([asked.free for asked in known])[:, None]
        spare = np.array([asked.spare for asked in known])[:, None]
        return np.asarray(np.min(np.maximum(np.maximum(self.rest, 0.0) / free, self.left / spare), axis=1))

    def whole(self, variances: Array) -> Array:
        """Chi square (t,) of all moments, with what is known before."""
        return np.asarray(self.times**2 / THRESHOLDS.motion_late**2 + (1.0 / variances) @ self.left)

    def beside(self, other: _Profile) -> _Profile:
        """Both, in order of time."""
        times = np.concatenate([self.times, other.times])
        order = np.argsort(times, kind="stable")
        left, rest = np.hstack([self.left, other.left]), np.hstack([self.rest, other.rest])
        return _Profile(times[order], left[:, order], rest[:, order])

    def steps(self) -> Array:
        """How much (t,) [s] each time stands for."""
        return np.gradient(self.times)


def _asked(m: Array, count: float, derivatives: Columns, moment: int) -> _Asked | None:
    """None: this moment does not tell."""
    first = len(m) - _MADE
    moving = np.diag(m) > 0.0
    terms = np.flatnonzero(moving[:first])
    surfaces = np.full(len(terms), -1)
    for k, place in enumerate(derivatives):
        if place >= 0 and moving[place]:
            surfaces[np.searchsorted(terms, place)] = k
    instruments = np.array(
        [
            first + column
            for k in _MOVE[moment]
            for column in (
                _RATES + k,
                *(_FORMS + k * FORMS + form for form in (0, *LAGGED)),
                *(_FOLLOWS + k * len(_FOLLOW) + i for i in range(len(_FOLLOW))),
            )
            if moving[first + column]
        ],
        dtype=np.int64,
    )
    too_few = count < max(THRESHOLDS.motion_samples, _ALIKE * (len(terms) + 3)) or len(instruments) <= len(terms)
    if too_few or not (surfaces >= 0).any() or not moving[first]:
        return None
    scale = np.sqrt(np.diag(m)[instruments])
    z = m[np.ix_(instruments, instruments)] / np.outer(scale, scale)
    weights = np.linalg.inv(z + _NEARLY * np.eye(len(z)))
    return _Asked(m, float(count), terms, surfaces, instruments, scale, weights)


def _profiles(known: Sequence[_Asked], course: Course, times: Array) -> _Profile:
    near = course.between(times)
    found = [
        _two_stage(a.m, a.terms, a.surfaces, a.instruments, a.scale, a.weights, near.forms, near.shares) for a in known
    ]
    return _Profile(times, np.array([left for left, _ in found]), np.array([rest for _, rest in found]))


@njit(cache=True)
def _put_terms(
    terms: Columns, surfaces: Columns, forms: Columns, shares: Array, columns: Columns, parts: Array
) -> None:  # fmt: skip
    """Columns and parts (n, NEAR) of terms; those of surfaces are made of forms (NEAR,) of the first surface."""
    for j in range(len(terms)):
        columns[j], parts[j], parts[j, 0] = terms[j], 0.0, 1.0
        if surfaces[j] >= 0:
            columns[j], parts[j] = surfaces[j] * FORMS + forms, shares


@njit(cache=True)
def _mixed(row: Array, columns: Columns, parts: Array) -> float:
    """Parts (NEAR,) of columns of a row."""
    total = 0.0
    for k in range(NEAR):
        total += parts[k] * row[columns[k]]
    return total


@njit(cache=True)
def _two_stage(
    m: Array, terms: Columns, surfaces: Columns, instruments: Columns, scale: Array, weights: Array,
    forms: Columns, shares: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """What goes together with the instruments (t,), and the rest of the sum of squares, of surfaces made of forms
    (t, NEAR).
    """
    first, n, count = len(m) - _MADE, len(terms), len(instruments)
    left, rest = np.empty(len(forms)), np.empty(len(forms))
    x, y = np.empty((count, n)), np.empty(count)
    squares, with_y, size = np.empty((n, n)), np.empty(n), np.empty(n)
    columns, parts = np.empty((n, NEAR), np.int64), np.zeros((n, NEAR))
    for t in range(len(forms)):
        _put_terms(terms, surfaces, first + _FORMS + forms[t], shares[t], columns, parts)
        for i in range(count):
            y[i] = m[instruments[i], first] / scale[i]
            for j in range(n):
                x[i, j] = _mixed(m[instruments[i]], columns[j], parts[j]) / scale[i]
        for j in range(n):
            with_y[j] = _mixed(m[first], columns[j], parts[j])
            for i in range(n):
                squares[j, i] = 0.0
                for k in range(NEAR):
                    squares[j, i] += parts[j, k] * _mixed(m[columns[j, k]], columns[i], parts[i])
        weighted = weights @ x
        information = x.T @ weighted
        for j in range(n):
            size[j] = np.sqrt(max(information[j, j], 1e-300))
        normal = information / np.outer(size, size) + _NEARLY * np.eye(n)
        theta = np.linalg.solve(normal, weighted.T @ y / size) / size
        away = y - x @ theta
        left[t] = away @ weights @ away
        rest[t] = m[first, first] - 2.0 * theta @ with_y + theta @ squares @ theta
    return left, rest


@njit(cache=True)
def _put_surfaces(samples: Array, forms: Array, i: int, first: int, step: float, follows: Array, series: Array) -> None:
    """Rates of the surfaces, their forms, and what follows them, into a series."""
    for k in range(COUNT):
        at = SIGNALS_OF_SAMPLE + FIRST + k
        rate = (samples[i + 1, at] - samples[i - 1, at]) / (samples[i + 1, 0] - samples[i - 1, 0])
        now = samples[i, at]
        is_there = np.isfinite(now + rate)
        series[first + _RATES + k] = rate if is_there else 0.0
        for j in range(FORMS):
            series[first + _FORMS + k * FORMS + j] = forms[i, k, j] if is_there else 0.0
        for j in range(len(_FOLLOW)):
            place = k * len(_FOLLOW) + j
            if is_there and np.isfinite(follows[place]):
                follows[place] += step / (step + _FOLLOW[j]) * (now - follows[place])
            else:
                follows[place] = now if is_there else np.nan
            series[first + _FOLLOWS + place] = follows[place] if is_there else 0.0


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
    samples: Array, forms: Array, offsets: Columns, follows: Array, filters: Array, begun: Array, counts: Array,
    moments: Array,
) -> None:  # fmt: skip
    """Sums of products, without what is slow, of each moment's terms and what is _MADE: of each pair one."""
    size = moments.shape[1]
    first = size - _MADE
    series = np.zeros(size)
    for i in range(1, len(samples) - 1):
        time, step = samples[i, 0], samples[i, 0] - samples[i - 1, 0]
        if not 0.0 < samples[i + 1, 0] - samples[i - 1, 0] < PAUSE:
            begun[:] = np.nan
            follows[:] = np.nan
            continue
        _put_surfaces(samples, forms, i, first, step, follows, series)
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
                row, by = moments[m, j], twice[j]
                for k in range(j + 1):
                    row[k] = keep * row[k] + by * twice[k]
