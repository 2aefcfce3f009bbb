"""A change of trim: what moves the elevator of steady flight at one moment, and back at another.

In steady flight C_m is about nothing, and the elevator says what it balances: it follows angle of attack and speed, and
slowly the fuel and the thrust. Where it moves without any of them, something else has changed: a passenger walked
forward, the gear went down. In a long flight no regression of C_m shows that: what is not in the model and trims the
aeroplane makes its derivatives look small, and with small derivatives nothing is left to explain (``quick_motion``).

So the derivatives are taken from manoeuvres alone, and what they leave of means over some seconds is searched for a
change that speed, time and the terms of the model, with numbers of their own, do not explain. What chance does is told
by series with the same correlation in time: a trim that wanders looks like steps, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.quick_motion import moved_by, quick_rows
from aircraft_sysid_ros.diagnosis.search.evaluator import moves
from aircraft_sysid_ros.identification.conditions import CONTROL_SIGNALS

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: [s] whose mean is one point, and points from which anything is said: shorter flights the ordinary search serves.
WINDOW, LEAST_WINDOWS = 10.0, 40
#: [s] to which its times are told.
_FINE = 2.0
#: A change lasts for so many points at least, and leaves as many before it.
SHORTEST = 3
#: A block is a manoeuvre where the elevator moves so many times as much as in the median block; where there are fewer
#: than so many, the livelier quarter of the flight stands in for them.
_EXCITED, _LEAST_BLOCKS = 4.0, 4
#: Standard errors from which the derivative to the elevator is known, with those of white noise.
_KNOWN = 10.0
#: Series that say what chance does, and their seed.
_SERIES, _SEED = 399, 0
#: Their largest correlation from window to window, and how often the room for it is halved.
_MOST_CORRELATED, _HALVINGS = 0.995, 8
#: What trims an aeroplane slowly and has a number of its own, whatever the model says.
_BESIDE = ("time", "V", "Tc", "flaps")
#: Standard errors, with the correlation in time, from which another axis is said to have changed at the same moments,
#: and the least change over that of C_m: an elevator that balances it acts a chord behind at least.
_COMPANY, _LEAST_COMPANY = 4.0, {"CX": 0.2, "CZ": 1.0}


@dataclass(frozen=True)
class Change:
    """One change in a series of means."""

    first: int  # point from which it is there
    last: int  # and before which it ends
    gain: float  # ln of the sums of squares without and with it

    def of(self, shape: Array) -> Array:
        """A shape (k,), 0 where the change is not."""
        inside = np.arange(len(shape))
        return np.where((inside >= self.first) & (inside < self.last), shape, 0.0)


@dataclass(frozen=True)
class TrimChange:
    """What the likeliest change of trim is."""

    begin: float  # the signal ``time`` [s]
    end: float | None  # None: it lasts to the end of the flight
    within: float  # [s] to which these times are told, 95 %
    with_lift: float  # change of C_m over C_Z, were it in proportion to that
    std_with_lift: float
    constant: float  # change of C_m, were it a constant
    #: ln of the likelihood of the one over that of the other.
    prefers_lift: float
    p_value: float
    evidence: float  # in standard deviations
    before: float  # rms of what is left of the means, over that of what the elevator makes
    after: float
    #: Changes of other axes at the same moments that exceed chance.
    company: dict[str, float]
    unknown: tuple[str, ...]  # axes of C_X and C_Z that do not tell


def trim_change(data: FlightData) -> TrimChange | None:
    """The likeliest change of trim beside the model of a flight; None where the flight does not tell."""
    if data.manoeuvre is not None or data.run is not None:  # these are short, or are told apart run by run
        return None
    points, told = _points(data, WINDOW), _of_manoeuvres(data)
    if points is None or told is None or points.count < LEAST_WINDOWS:
        return None
    derivatives, doubt = told
    response, trimmed = _left(data, points, derivatives)
    beside = _beside(data, points, "Cm")
    lift, one = points.mean(data.coefficient("CZ")), np.ones(points.count)
    if not np.isfinite(lift).all() or trimmed == 0.0:
        return None
    searches = [(shape, _Search(beside, shape)) for shape in (lift, one)]
    before = _without(beside, response)
    best, shape = max(((each.best(before), shape) for shape, each in searches), key=lambda found: found[0].gain)
    left = _at(beside, response, best.of(shape)).left
    wandering = _wandering(before, beside, points.number)
    chance = [max(each.best(series).gain for _, each in searches) for series in wandering]
    begin, end, within = _times(data, points.edge(best.first), points.edge(best.last), derivatives)
    inside = points.inside(begin, end)
    with_lift, constant = (_at(beside, response, inside * shape) for shape in (lift, one))
    company, unknown = _company(data, points, inside, constant.value)
    independent = points.count * _independent(left, points.number)
    return TrimChange(
        begin=begin,
        end=None if best.last == points.count else end,
        within=within,
        with_lift=with_lift.value,
        std_with_lift=float(np.hypot(with_lift.std(points.number), doubt * with_lift.value)),
        constant=constant.value,
        prefers_lift=0.5 * independent * float(np.log(constant.squares / with_lift.squares)),
        evidence=float(np.sqrt(2.0 * independent * best.gain)),
        p_value=(1.0 + sum(gain >= best.gain for gain in chance)) / (1.0 + len(chance)),
        before=_rms(before) / trimmed,
        after=_rms(left) / trimmed,
        company=company,
        unknown=tuple(unknown),
    )


# -- means over a few seconds ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Points:
    """The windows of a flight that have values in most of their time."""

    window: Integers  # (n,) of each row
    rows: Mask  # (n,) that count
    number: Integers  # (k,) of each window
    begins: float  # the signal ``time`` [s] of window 0
    size: float  # [s]

    @property
    def count(self) -> int:
        """How many."""
        return len(self.number)

    def mean(self, values: Array) -> Array:
        """Means (k,) of a signal (n,)."""
        place = np.searchsorted(self.number, self.window[self.rows])
        sums = np.bincount(place, values[self.rows], self.count)
        return np.asarray(sums / np.bincount(place, minlength=self.count))

    def edge(self, point: int) -> float:
        """When a point begins, or the last one ends."""
        number = self.number[point] if point < self.count else self.number[-1] + 1
        return self.begins + self.size * float(number)

    def inside(self, begin: float, end: float) -> Array:
        """Share (k,) of the time of each point in which a change is there."""
        since = self.begins + self.size * self.number
        return np.clip(np.minimum(since + self.size, end) - np.maximum(since, begin), 0.0, self.size) / self.size


def _points(data: FlightData, size: float) -> _Points | None:
    """Windows in most of which C_m and its terms are known; None where there is none."""
    known = np.isfinite(data.coefficient("Cm")) & np.isfinite(_terms(data, "Cm")).all(axis=1)
    known &= np.isfinite(data.coefficient("CZ"))
    window = np.asarray(data.time // size, dtype=np.int64)
    number, count = np.unique(window[known], return_counts=True)
    number = number[count * data.step > 0.5 * size]
    return _Points(window, known & np.isin(window, number), number, data.begin, size) if len(number) else None


def _terms(data: FlightData, axis: str) -> Array:
    """Columns (n, k) of the model of an axis."""
    return data.columns(data.model.programs[AXES.index(axis)])


def _acting(data: FlightData, axis: str) -> list[int]:
    """Numbers of the terms of an axis that read the controls."""
    programs = data.model.programs[AXES.index(axis)]
    return [j for j, program in enumerate(programs) if program.signals & CONTROL_SIGNALS]


def _beside(data: FlightData, points: _Points, axis: str) -> Array:
    """Orthonormal columns (k, m) of what trims an aeroplane slowly: the terms of its model without controls, and more.

    Angle of attack, speed, time, thrust and every named input that the flight has and moves.
    """
    columns = list(np.delete(_terms(data, axis), _acting(data, axis), axis=1).T)
    columns += [data.signal(name) for name in (*_BESIDE, *data.model.inputs) if moves(data.signal(name))]
    means = [points.mean(column) for column in columns]
    table = np.column_stack([np.ones(points.count), *(mean for mean in means if np.isfinite(mean).all())])
    left, size, _ = np.linalg.svd(table / np.maximum(np.linalg.norm(table, axis=0), 1e-300), full_matrices=False)
    return np.asarray(left[:, size > 1e-6 * size[0]])


def _left(data: FlightData, points: _Points, derivatives: Array) -> tuple[Array, float]:
    """Means (k,) of C_m less what derivatives make of it, and the spread of what those to the controls make."""
    columns, acting = _terms(data, "Cm"), _acting(data, "Cm")
    trimmed = points.mean(columns[:, acting] @ derivatives[acting])
    return points.mean(data.coefficient("Cm") - columns @ derivatives), float(np.std(trimmed))


def _times(data: FlightData, begin: float, end: float, derivatives: Array) -> tuple[float, float, float]:
    """The times of a change of C_m, told more finely, one after the other, and to how many seconds they are told.

    That is how far from them what is left is not yet less likely by e^2, each point counting as it is independent.
    """
    points = _points(data, _FINE)
    if points is None:
        return begin, end, WINDOW
    response, beside = _left(data, points, derivatives)[0], _beside(data, points, "Cm")
    steps = np.arange(-WINDOW, WINDOW + 0.5 * _FINE, _FINE)

    def left_by(first: float, last: float) -> float:
        column = points.inside(first, last)
        return _at(beside, response, column).squares if column.any() else np.inf

    found, within = [begin, end], _FINE
    for edge in (0, 1):
        times = [found[edge] + step for step in steps.tolist()]
        squares = np.array([left_by(*(time, found[1]) if edge == 0 else (found[0], time)) for time in times])
        found[edge] = times[int(np.argmin(squares))]
        left = _at(beside, response, points.inside(*found)).left
        less_likely = 0.5 * points.count * _independent(left, points.number) * np.log(squares / squares.min())
        within = max(within, *np.abs(np.array(times)[less_likely < 2.0] - found[edge]))
    return found[0], found[1], float(within)


def _of_manoeuvres(data: FlightData) -> tuple[Array, float] | None:
    """Derivatives (k,) of C_m in manoeuvres, and the standard error of that to the elevator over its value; None where
    they do not tell what the elevator does.
    """
    columns, acting = _terms(data, "Cm"), _acting(data, "Cm")
    quick = quick_rows(data, np.column_stack([data.coefficient("Cm"), columns]))
    rows = np.asarray(np.isfinite(quick).all(axis=1))
    if not acting or not rows.any():
        return None
    rows = rows & _in_manoeuvres(data, rows, quick[:, 1 + acting[0]])
    y, x = quick[rows, 0], quick[rows, 1:]
    size, moving = np.std(x, axis=0), np.flatnonzero(moved_by(x, columns[rows]))
    if len(y) < 10 * len(moving) or acting[0] not in moving:
        return None
    x = x[:, moving] / size[moving]
    values = np.linalg.lstsq(x, y, rcond=None)[0]
    std = np.sqrt(np.diag(np.linalg.pinv(x.T @ x)) * np.mean((y - x @ values) ** 2))
    place = moving.tolist().index(acting[0])
    if not abs(values[place]) > _KNOWN * std[place]:
        return None
    derivatives = np.zeros(columns.shape[1])
    derivatives[moving] = values / size[moving]
    return derivatives, float(std[place] / abs(values[place]))


def _in_manoeuvres(data: FlightData, rows: Mask, elevator: Array) -> Mask:
    """Rows (n,) of blocks in which the elevator moves much more than usual."""
    blocks, place = np.unique(data.block, return_inverse=True)
    squares = np.bincount(place[rows], elevator[rows] ** 2, len(blocks))
    motion = np.sqrt(squares / np.maximum(np.bincount(place[rows], minlength=len(blocks)), 1))
    moved = motion[motion > 0.0]
    lively = motion > (_EXCITED * float(np.median(moved)) if len(moved) else 0.0)
    if np.sum(lively) < _LEAST_BLOCKS:
        lively = motion >= np.quantile(motion, 0.75)
    return np.asarray(lively[place])


# -- the search --------------------------------------------------------------------------------------------------------


class _Search:
    """All changes of one shape: what does not depend on the response is worked out once."""

    def __init__(self, beside: Array, shape: Array) -> None:
        self.beside, self.shape, count = beside, shape, len(shape)
        first, last = np.triu_indices(count + 1, SHORTEST)
        keep = (first >= SHORTEST) & (count - last + first >= SHORTEST)
        self.first, self.last = first[keep], last[keep]
        own = self._inside(shape**2) - np.sum(self._inside(beside * shape[:, None]) ** 2, axis=1)
        scale = np.maximum(self._inside(shape**2), 1e-300)
        self.own = np.where(own > 1e-6 * scale, own, np.inf)

    def _inside(self, values: Array) -> Array:
        """Sums of values (k, …) over the points of each change."""
        sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        return np.asarray(sums[self.last] - sums[self.first])

    def best(self, left: Array) -> Change:
        """The change that explains most of what the columns beside it leave (k,) of a response."""
        explained = self._inside(left * self.shape) ** 2 / self.own
        at, total = int(np.argmax(explained)), float(left @ left)
        gain = -np.log(max(1.0 - explained[at] / total, 1e-12)) if total > 0.0 else 0.0
        return Change(int(self.first[at]), int(self.last[at]), float(gain))


@dataclass(frozen=True)
class _Fitted:
    """One column that is fitted beside others."""

    value: float
    own: float  # sum of squares of what is its own
    left: Array  # (k,) of the response

    @property
    def squares(self) -> float:
        """Sum of squares of what it leaves."""
        return float(np.sum(self.left**2))

    def std(self, number: Integers) -> float:
        """Standard error of the value, with the correlation in time of what it leaves."""
        free = max(_independent(self.left, number), 1e-3)
        return float(_rms(self.left) / np.sqrt(self.own * free))


def _at(beside: Array, response: Array, column: Array) -> _Fitted:
    """The fit of a column (k,) to a response (k,)."""
    left, column = _without(beside, response), _without(beside, column)
    own = float(column @ column)
    value = float(column @ left / own)
    return _Fitted(value, own, left - value * column)


def _without(beside: Array, values: Array) -> Array:
    """Values (k,) without what orthonormal columns explain."""
    return np.asarray(values - beside @ (beside.T @ values))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


# -- chance ------------------------------------------------------------------------------------------------------------


def _correlation(left: Array, number: Integers) -> float:
    """Correlation of neighbours, from 0 on."""
    near = np.diff(number) == 1
    square = float(np.mean(left**2))
    return float(np.clip(np.mean((left[1:] * left[:-1])[near]) / square, 0.0, 0.999)) if square > 0.0 else 0.0


def _independent(left: Array, number: Integers) -> float:
    """Share of points that are as good as independent."""
    rho = _correlation(left, number)
    return (1.0 - rho) / (1.0 + rho)


def _wandering(left: Array, beside: Array, number: Integers) -> list[Array]:
    """Series (k,) with the correlation of what is left, of which nothing changed: autoregressive, of order one.

    What is fitted beside takes the slowest part of a series away, and a short one shows less of its correlation: theirs
    is the one with which they show as much, on average, once the same is fitted beside them.
    """
    noise = np.random.default_rng(_SEED).standard_normal((_SERIES, int(number[-1] - number[0]) + 1))
    shown, low, high = _correlation(left, number), 0.0, _MOST_CORRELATED
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        series = _correlated(middle, noise, beside, number)
        less = float(np.mean([_correlation(one, number) for one in series])) < shown
        low, high = (middle, high) if less else (low, middle)
    return _correlated(high, noise, beside, number)


def _correlated(rho: float, noise: Array, beside: Array, number: Integers) -> list[Array]:
    """Autoregressive series (k,) of white noise (m, …), without what orthonormal columns explain."""
    from scipy.signal import lfilter  # here: 0.6 s that compare, add and the nodes do not need

    driven = noise * np.sqrt(1.0 - rho**2)
    driven[:, 0] = noise[:, 0]
    series = lfilter([1.0], [1.0, -rho], driven, axis=1)
    return [_without(beside, one[number - number[0]]) for one in series]


def _company(data: FlightData, points: _Points, inside: Array, pitching: float) -> tuple[dict[str, float], list[str]]:
    """Constants of C_X and C_Z that changed with the trim, and the axes that do not tell.

    ``pitching``: the change of C_m, which the elevator balances, and makes some lift and drag by that.
    """
    found, unknown = {}, []
    for axis, least in _LEAST_COMPANY.items():
        response = points.mean(data.coefficient(axis))
        if not np.isfinite(response).all() or (axis == "CX" and not moves(data.signal("Tc"))):  # thrust hides drag
            unknown.append(axis)
            continue
        fitted = _at(_beside(data, points, axis), response, inside)
        if abs(fitted.value) > max(_COMPANY * fitted.std(points.number), least * abs(pitching)):
            found[axis] = fitted.value
    return found, unknown
