"""Airspeed against GPS while they come: what the airspeed reads is s |v - w|, in a wind that is not constant.

Of each second of flight V is the airspeed and v the velocity over ground at the fixes of GPS. Over the newest MEMORY
seconds

    V = s |v - w(t) - k h| + u,    u' = -u / TAU + noise,

with a wind w that is a random walk between knots (WALK), its gradient k over height, and gusts u whose size the flight
shows, is solved for s by Gauss-Newton, outliers less (Huber). s is known where the course turns, or the speed changes;
a wind along a straight course and a scale are one, and the standard error says so.

Gusts are in V at once and, by and by, in v: an aeroplane holds its airspeed. So V = s |…| makes s too small, and
r V = |…|, r = 1 / s, makes it too large, and both together hold it between them (Frisch's bounds of regression with
errors in both variables). What the airspeed reads is wrong where the lower one is further above 1, or the upper one
further below, than TOLERANCE, as which a pitot may be built in, by SURE standard errors: of a sensor that is off by all
of that one look in 4 000.

The scale may have changed meanwhile. Of times that are asked, those where the errors leap and every EVERY seconds, the
one is taken that leaves least, if that is less by CHANGE (twice the logarithm of a likelihood ratio); the wind may leap
with it (LEAP), since a front does, so that a leap alone is no scale. That time is the best of many, and the standard
error does not count the choice: a change is said when two looks in a row prove it. It is right again where the other
bound says, by RIGHT standard errors, that it is nearer to 1 than to what it was.

Less than TOLERANCE holds nothing. At the end of a flight it is told where both bounds are on one side of 1 by SMALL and
SURE standard errors: forces and wind are off with it, and no standard error of theirs counts that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.flight_check.finding import ERROR, WARNING, Finding
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.samples import WIDTH, Kind, Samples, concatenate

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Seconds that are remembered, between two looks, between times of change that are asked, between knots of the wind;
#: and the least that are asked.
MEMORY, LOOK, EVERY, KNOTS, LEAST = 180, 5, 20, 45.0, 45
#: One sigma of the random walk of the wind [m/s per sqrt(s)], of its gradient [1/s], of its leaps and its size [m/s];
#: time [s] of gusts.
WALK, GRADIENT, LEAP, WIND, TAU = 0.15, 0.03, 4.0, 15.0, 20.0
#: See above.
CHANGE, TOLERANCE, SURE, RIGHT = 16.0, 0.05, 3.5, 2.0
SMALL = 0.02
#: One sigma of the scale of a sensor that nobody knows, and of one that was sound.
_ANY, _SOUND = 0.5, 0.03
#: Gusts and noise [m/s] are never less; seconds after which gusts differ; outliers count less from so many sigma on.
_LEAST_GUST, _LEAST_NOISE, _APART, _HUBER = 0.3, 0.1, 5, 2.5
#: First of the wind at knots among the unknowns; a step below which they are settled; least seconds beside a change.
_KNOT, _SETTLED, _SHORTEST = 6, 1e-3, 5
#: Share of the usual speeds, through the air and over ground, below which an aeroplane lands or takes off.
_SLOW = 0.75
#: Longest time [s] that a landing takes, from the flare to where the airspeed is none.
_LANDING = 30.0
#: A fix further [s] from the nearest airspeed is not used.
_NEAR = 0.3
_ROUNDS = 8
#: Speeds [m/s] above this are none; a standard error over that of what was said of the scale, for it to be said anew.
_FASTEST, _SURER = 1e3, 0.7
_SECOND = 1_000_000_000
_AIRSPEED, _GPS_VELOCITY = int(Kind.AIRSPEED), int(Kind.GPS_VELOCITY)
#: Columns of what is remembered of a second.
_TIME, _SPEED, _NORTH, _EAST, _DOWN, _HEIGHT, _WIDTH = 0, 1, 2, 3, 4, 5, 6


@njit(cache=True)
def _errors(flown: Array, change: int, of_air: bool, theta: Array, knots: Array, out: Array, jacobian: Array) -> None:
    """V - s |v - w - k h| (n,) and its derivatives (n, p), or with ``of_air`` r V - |v - w - k h|, r = 1 / s.

    ``theta``: s or r before and from ``change`` on, k (2,), by how much the wind leaps then (2,), w (knots, 2).
    """
    jacobian[:] = 0.0
    for i in range(len(flown)):
        scale = 0 if i < change else 1
        at = 0
        while at < len(knots) - 2 and flown[i, _TIME] > knots[at + 1]:
            at += 1
        share = min(max((flown[i, _TIME] - knots[at]) / (knots[at + 1] - knots[at]), 0.0), 1.0)
        first, height = _KNOT + 2 * at, flown[i, _HEIGHT]
        leapt = 1.0 if 0 < change <= i else 0.0
        north = flown[i, _NORTH] - (1.0 - share) * theta[first] - share * theta[first + 2] - theta[2] * height
        east = flown[i, _EAST] - (1.0 - share) * theta[first + 1] - share * theta[first + 3] - theta[3] * height
        north, east = north - leapt * theta[4], east - leapt * theta[5]
        speed = max(np.sqrt(north * north + east * east + flown[i, _DOWN] ** 2), 1e-3)
        gain = 1.0 if of_air else theta[scale]
        out[i] = theta[scale] * flown[i, _SPEED] - speed if of_air else flown[i, _SPEED] - gain * speed
        jacobian[i, scale] = flown[i, _SPEED] if of_air else -speed
        for j, part in enumerate((gain * north / speed, gain * east / speed)):
            jacobian[i, 2 + j] = part * height
            jacobian[i, 4 + j] = part * leapt
            jacobian[i, first + j] = part * (1.0 - share)
            jacobian[i, first + 2 + j] = part * share


@njit(cache=True)
def _noise_of(time: Array, errors: Array) -> tuple[float, float]:
    """Gusts and white noise [m/s], one sigma each, by how errors (n,) differ after a second and after _APART."""
    near, far, n = np.empty(len(time)), np.empty(len(time)), len(time)
    near_count = far_count = 0
    for i in range(1, n):
        if time[i] - time[i - 1] < 1.5:
            near[near_count] = abs(errors[i] - errors[i - 1])
            near_count += 1
        if i >= _APART and time[i] - time[i - _APART] < _APART + 1.0:
            far[far_count] = abs(errors[i] - errors[i - _APART])
            far_count += 1
    if far_count < _APART:
        return np.nan, np.nan
    after_one = 0.5 * (np.median(near[:near_count]) / 0.6745) ** 2
    after_more = 0.5 * (np.median(far[:far_count]) / 0.6745) ** 2
    keep = np.exp(-1.0 / TAU)
    gust = max((after_more - after_one) / (keep - keep**_APART), _LEAST_GUST**2)
    return np.sqrt(gust), np.sqrt(max(after_one - gust * (1.0 - keep), _LEAST_NOISE**2))


@njit(cache=True)
def _whiten(time: Array, change: int, gust: float, white: float, errors: Array, jacobian: Array) -> None:
    """Errors and their derivatives less what those before say of them, over one sigma of that; in place.

    A Kalman filter of gusts of which white noise is measured; what was before ``change`` says nothing.
    """
    p = jacobian.shape[1]
    mean, mean_of, variance = 0.0, np.zeros(p), gust**2
    for i in range(len(time)):
        keep = 0.0 if i == 0 or i == change else np.exp(-(time[i] - time[i - 1]) / TAU)
        variance = keep**2 * variance + (1.0 - keep**2) * gust**2
        gain, std = variance / (variance + white**2), np.sqrt(variance + white**2)
        variance *= 1.0 - gain
        mean *= keep
        left = errors[i] - mean
        mean += gain * left
        errors[i] = left / std
        for j in range(p):
            mean_of[j] *= keep
            left = jacobian[i, j] - mean_of[j]
            mean_of[j] += gain * left
            jacobian[i, j] = left / std


@njit(cache=True)
def _add_priors(theta: Array, before: float, step: float, normal: Array, right: Array) -> float:
    """What is known of the unknowns beforehand, to the normal equations in place; returns its part of the cost."""
    cost = 0.0
    stds = (before, _ANY, GRADIENT, GRADIENT, LEAP, LEAP, WIND, WIND)
    for j, std in enumerate(stds):
        error = (theta[j] - (1.0 if j < 2 else 0.0)) / std
        normal[j, j] += 1.0 / std**2
        right[j] -= error / std
        cost += error * error
    weight = 1.0 / (WALK * WALK * step)
    for j in range(_KNOT + 2, len(theta)):
        error = theta[j] - theta[j - 2]
        normal[j, j] += weight
        normal[j - 2, j - 2] += weight
        normal[j, j - 2] -= weight
        normal[j - 2, j] -= weight
        right[j] -= weight * error
        right[j - 2] += weight * error
        cost += weight * error * error
    return cost


@njit(cache=True)
def _add_errors(errors: Array, jacobian: Array, normal: Array, right: Array) -> float:
    """Normal equations of the whitened errors, outliers less; returns their cost."""
    normal[:], right[:], cost, p = 0.0, 0.0, 0.0, len(right)
    for i in range(len(errors)):
        size = abs(errors[i])
        weight = 1.0 if size < _HUBER else _HUBER / size
        cost += size * size if size < _HUBER else _HUBER * (2.0 * size - _HUBER)
        for j in range(p):
            if jacobian[i, j] != 0.0:
                right[j] -= weight * jacobian[i, j] * errors[i]
                for k in range(j + 1):
                    normal[j, k] += weight * jacobian[i, j] * jacobian[i, k]
    for j in range(p):
        for k in range(j):
            normal[k, j] = normal[j, k]
    return cost


@njit(cache=True)
def _solve(
    flown: Array, change: int, of_air: bool, before: float, noise: tuple[float, float], theta: Array, errors: Array
) -> tuple[float, float, tuple[float, float]]:
    """Cost, the standard error of the scale since ``change``, and the noise; ``theta`` is the start, and the solution.

    ``noise`` as in ``_noise_of``; NaN: as the flight shows it. ``errors`` (n,), whitened, are written.
    """
    n, p = len(flown), len(theta)
    knots = np.linspace(flown[0, _TIME], max(flown[-1, _TIME], flown[0, _TIME] + 1.0), (p - _KNOT) // 2)
    jacobian, normal, right = np.empty((n, p)), np.zeros((p, p)), np.zeros(p)
    cost, asked, time = np.inf, np.isnan(noise[0]), flown[:, _TIME].copy()
    for _ in range(_ROUNDS):
        _errors(flown, change, of_air, theta, knots, errors, jacobian)
        if asked:
            noise = _noise_of(time, errors)
        _whiten(time, change, noise[0], noise[1], errors, jacobian)
        cost = _add_errors(errors, jacobian, normal, right)
        cost += _add_priors(theta, before, knots[1] - knots[0], normal, right)
        if not np.isfinite(cost):
            return cost, np.nan, noise
        step = np.linalg.solve(normal, right)
        if np.max(np.abs(step)) < _SETTLED:
            break
        for j in range(p):
            most = 0.2 if j < 2 else 0.05 if j < 4 else 5.0
            theta[j] += min(max(step[j], -most), most)
        theta[0], theta[1] = max(theta[0], 0.1), max(theta[1], 0.1)
    unit = np.zeros(p)
    unit[1] = 1.0
    return cost, np.sqrt(np.linalg.solve(normal, unit)[1]), noise


@njit(cache=True)
def _line(x: float, at: Array, values: Array) -> float:
    """Value at ``x`` on straight lines between ``values`` (n,) at rising times (n,), the nearest outside of them."""
    after = int(np.searchsorted(at, x, side="right"))
    if after == 0:
        return float(values[0])
    if after == len(at):
        return float(values[-1])
    slope = (values[after] - values[after - 1]) / (at[after] - at[after - 1])
    return float(slope * (x - at[after - 1]) + values[after - 1])


@njit(cache=True)
def _second_of(stamps: Integers, kinds: Integers, values: Array, second: int, minimum_airspeed: float) -> Array:
    """Mean time [s], and medians of airspeed and velocity NED over ground, at the fixes of a second: (5,).

    NaN where there are none with an airspeed near them, in flight. The samples (n,) are in order of time, with those of
    the next second.
    """
    n, of_air = len(stamps), 0
    air, speeds, found, count = np.empty(n), np.empty(n), np.empty((4, n)), 0
    for i in range(n):
        if kinds[i] == _AIRSPEED and np.isfinite(values[i, 0]):
            air[of_air], speeds[of_air] = (stamps[i] - second * _SECOND) * 1e-9, values[i, 0]
            of_air += 1
    out, total = np.full(5, np.nan), 0.0
    for i in range(n if of_air else 0):
        if kinds[i] != _GPS_VELOCITY or stamps[i] // _SECOND != second:
            continue
        at = (stamps[i] - second * _SECOND) * 1e-9
        speed = _line(at, air[:of_air], speeds[:of_air])
        is_sound = np.min(np.abs(air[:of_air] - at)) < _NEAR and minimum_airspeed <= speed < _FASTEST
        for k in range(3):
            is_sound = is_sound and abs(values[i, k]) < _FASTEST
            found[1 + k, count] = values[i, k]
        if is_sound:
            found[0, count] = speed
            total += at
            count += 1
    if count:
        out[0] = second + total / count
        for k in range(4):
            out[1 + k] = np.median(found[k, :count])
    return out


@njit(cache=True)
def scale_of(flown: Array, of_air: bool, was_wrong: bool) -> tuple[float, float, int]:
    """Scale of the airspeed of late, its standard error, and since which of the seconds (n, _WIDTH) it has been so.

    ``of_air``: gusts are in the velocity over ground, else in the airspeed. ``was_wrong``: nothing is known of the
    scale before it changed.
    """
    n = len(flown)
    count = max(int(np.ceil((flown[-1, _TIME] - flown[0, _TIME]) / KNOTS)), 1) + 1
    theta, before, errors = np.zeros(_KNOT + 2 * count), _ANY if was_wrong else _SOUND, np.empty(n)
    theta[0] = theta[1] = 1.0
    cost, std, noise = _solve(flown, 0, of_air, before, (np.nan, np.nan), theta, errors)
    best, scale, since, unused = cost - CHANGE, theta[1], 0, np.empty(n)
    steepest = np.argsort(-np.abs(errors))[:2]
    changes = [*steepest, *range(EVERY, n, EVERY)]
    for change in changes:
        if not _SHORTEST <= change <= n - _SHORTEST:
            continue
        other = theta.copy()
        other[0] = 1.0
        cost, of_this, _ = _solve(flown, change, of_air, before, noise, other, unused)
        if cost < best:
            best, scale, std, since = cost, other[1], of_this, change
    return (1.0 / scale, std / scale**2, since) if of_air else (scale, std, since)


def warm_up() -> None:
    """Compile, or load from the cache."""
    for of_air in (False, True):
        scale_of(np.ones((LEAST, _WIDTH)) * np.arange(float(LEAST))[:, None], of_air, False)
    _second_of(np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros((1, WIDTH)), 0, 0.0)


class Reading(NamedTuple):
    """What the airspeed reads, over what GPS and wind say."""

    scale: float
    std: float
    since: float  # [s] of flight
    until: float = np.nan  # [s] of flight; NaN: it goes on

    @property
    def finding(self) -> Finding:
        """The same for people."""
        over = not np.isnan(self.until)
        when = f"from {self.since:.0f} s to {self.until:.0f} s" if over else f"since {self.since:.0f} s"
        sentence = (
            f"it {'read' if over else 'reads'} {self.scale:.2f} ± {self.std:.2f} of what GPS and wind say, {when} of "
            "flight: check pitot tube, lines and calibration"
        )
        return Finding(("true_airspeed",), "scale", WARNING if over else ERROR, sentence)


class WindTriangle:
    """Takes airspeed and GPS velocity, and says whether the one reads what the other and the wind say."""

    def __init__(self, minimum_airspeed: float) -> None:
        """``minimum_airspeed`` [m/s]: slower than that it is not flying."""
        self._minimum_airspeed = minimum_airspeed
        self.readings: list[Reading] = []  # that were wrong, the newest last
        self.newest: list[tuple[float, float, int]] = []  # what both bounds said at the last look, see ``scale_of``
        self._small: Finding | None = None  # an error within the tolerance, once the flight is over
        self.restart()

    def restart(self) -> None:
        """The clock started over: what was wrong is so until it is seen to be right."""
        self._waiting: list[Samples] = []
        self._flown = np.zeros((0, _WIDTH))
        self._next: int | None = None  # second [s] that is not done yet
        self._begin = np.nan  # [s] of the first second in flight
        self._was_too_large: bool | None = None  # as the look before proved; None: it did not

    @property
    def is_wrong(self) -> bool:
        """Whether it reads something else just now."""
        return bool(self.readings) and np.isnan(self.readings[-1].until)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All that was found in the flight, the newest first."""
        small = () if self._small is None else (self._small,)
        return tuple(reading.finding for reading in reversed(self.readings)) or small

    @property
    def reads(self) -> tuple[float, float] | None:
        """Least and most of what GPS and wind say that it may read of late, by two standard errors; None: unasked."""
        if not self.newest:
            return None
        return min(s - 2.0 * std for s, std, _ in self.newest), max(s + 2.0 * std for s, std, _ in self.newest)

    def finish(self) -> None:
        """The flight is over: an error that is sure and small, where none was larger."""
        if not self.newest or self.readings:
            return
        scales, stds, _ = (np.array(each, dtype=np.float64) for each in zip(*self.newest, strict=True))
        nearest = float(np.min(np.abs(scales - 1.0) - SURE * stds))
        if not (nearest > SMALL and (scales[0] > 1.0) == (scales[1] > 1.0)):
            return
        scale, std = float(np.mean(scales)), float(np.hypot(np.max(stds), 0.5 * np.ptp(scales)))
        speed = float(np.median(self._flown[:, _SPEED]))
        sentence = (
            f"it reads {scale:.3f} ± {std:.3f} of what GPS and wind say: the wind computed from it is off by about "
            f"{abs(1.0 / scale - 1.0) * speed:.1f} m/s and every coefficient by {100.0 * abs(scale**-2 - 1.0):.0f} %, "
            "which their standard errors do not include: calibrate it, or set the scale of the airspeed in the "
            "aircraft file"
        )
        self._small = Finding(("true_airspeed",), "scale", WARNING, sentence)

    def add(self, samples: Samples) -> None:
        """Samples in order of time."""
        used = (samples.kind == Kind.GPS_VELOCITY) | (samples.kind == Kind.AIRSPEED)
        if used.any():
            self._waiting.append(samples[used])

    def due(self, stamp: int) -> int:
        """First stamp [ns] of a state that completes another second, where the newest is at ``stamp`` [ns]."""
        if self._next is None:
            self._next = stamp // _SECOND
        return (self._next + 2) * _SECOND

    def advance(self, stamp: int) -> None:
        """A state has come at ``stamp`` [ns], and with it all that was measured until then."""
        while stamp >= self.due(stamp):
            assert self._next is not None
            oldest = min((int(samples.stamp[0]) // _SECOND for samples in self._waiting), default=stamp)
            second = max(self._next, min(oldest, stamp // _SECOND - 2))
            self._next = second + 1
            self._take(second)
            if second % LOOK == 0 and len(self._flown) >= LEAST and self._flown[-1, _TIME] > second - LOOK:
                self._judge()
            elif second % LOOK == 0:
                self._was_too_large = None

    def _take(self, second: int) -> None:
        """Keep what GPS and airspeed say of a second [s]."""
        if not self._waiting:
            return
        waiting = self._waiting[0] if len(self._waiting) == 1 else concatenate(self._waiting)
        first, after = np.searchsorted(waiting.stamp, np.array([second, second + 2]) * _SECOND)
        self._waiting = [waiting[first:]] if first < len(waiting) else []  # the second itself, to interpolate the next
        seen = waiting[:after]
        found = _second_of(seen.stamp, seen.kind, seen.values, second, self._minimum_airspeed)
        if np.isnan(found[0]):
            return
        (time, speed), mean, height = found[:2], found[2:5], 0.0
        self._begin = time if np.isnan(self._begin) else self._begin
        if self._lands(time, speed, float(np.linalg.norm(mean))):
            return
        if len(self._flown):
            before = self._flown[-1]
            height = before[_HEIGHT] - 0.5 * (before[_DOWN] + mean[2]) * (time - before[_TIME])
        kept = self._flown[self._flown[:, _TIME] > time - MEMORY]
        self._flown = np.vstack([kept, [time, speed, *mean, height]])

    def _lands(self, time: float, speed: float, over_ground: float) -> bool:
        """Whether it is slow through the air and over ground, beside the last minutes: it flares or rolls, in a wind
        that is another one at the ground, and by wheels. What lasts is slow flight.
        """
        if len(self._flown) < LEAST or time - self._flown[-1, _TIME] > _LANDING:
            return False
        usual = np.median(np.linalg.norm(self._flown[:, _NORTH : _DOWN + 1], axis=1))
        return bool(speed < _SLOW * np.median(self._flown[:, _SPEED]) and over_ground < _SLOW * usual)

    def _judge(self) -> None:
        flown = self._flown.copy()
        flown[:, _TIME] -= flown[0, _TIME]
        flown[:, _HEIGHT] -= flown[:, _HEIGHT].mean()
        low, high = self.newest = [scale_of(flown, of_air, self.is_wrong) for of_air in (False, True)]
        found = low if low[0] - 1.0 - TOLERANCE > SURE * low[1] else high  # NaN says nothing
        is_proven = found is low or 1.0 - TOLERANCE - high[0] > SURE * high[1]
        now, since = (float(self._flown[i, _TIME] - self._begin) for i in (-1, found[2]))
        if not self.is_wrong:
            was_too_large, self._was_too_large = self._was_too_large, found[0] > 1.0 if is_proven else None
            if is_proven and (found[2] == 0 or self._was_too_large == was_too_large):
                self.readings.append(Reading(found[0], found[1], since))
                self._was_too_large = None
            return
        was = self.readings[-1]
        between = 0.5 * (1.0 + was.scale)
        if between - high[0] > RIGHT * high[1] if was.scale > 1.0 else low[0] - between > RIGHT * low[1]:
            self.readings[-1] = was._replace(until=now)
        elif is_proven and (found[0] > 1.0) == (was.scale > 1.0) and _is_better(found, was):
            self.readings[-1] = was._replace(scale=found[0], std=found[1])


def _is_better(found: tuple[float, float, int], was: Reading) -> bool:
    """Whether a scale is to be said anew: it is much surer, or as sure and another one, as the first that is proven is
    further off than most.
    """
    return found[1] < _SURER * was.std or (found[1] <= was.std < abs(found[0] - was.scale))
