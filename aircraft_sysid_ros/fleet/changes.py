"""What changes from flight to flight in one airframe: a parameter that drifts, or jumps at a date.

A series is one parameter of one airframe in the order of its flights, of values to USE alone, with their standard
errors. Three models of a series are fitted with random effects (``random_effects``):

    constant    y_i = a
    drift       y_i = a + b n_i              n_i: number of the flight
    jump        y_i = a + d [n_i >= k]       k: the flight from which on

each with a part c (V_i / V - 1) where the airspeed of the flights differs by enough. The p-value of a jump is that of
its best date times the number of dates (Bonferroni), that of a change the smaller one of drift and jump times two. The
likelihood says which of the two it is, with half of log n off for the date. One flight that is far off is no jump: a
jump must also hold when any one of the flights is left out. Over all series of a fleet changes are named at a false
discovery rate (Benjamini and Hochberg, 1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.fleet.random_effects import Fitted, fit, fit_with, two_sided

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

DRIFT, JUMP = "drift", "jump"
#: Share of the changes that are named which may be none.
RATE = 0.05
#: Flights of a series, and on either side of a jump.
FEWEST, FEWEST_BESIDE = 6, 2
#: Largest p-value of a jump with any one of the flights left out.
_WITHOUT_ONE = 0.01
#: Flights of a mean that is compared with those of other airframes.
FEWEST_OF_A_MEAN = 2
#: Relative spread of the airspeed from which its part is fitted.
AIRSPEED_SPREAD = 0.05
#: Times that the date of a jump and the spread between flights are found in turn.
_ROUNDS = 5


@dataclass(frozen=True)
class Series:
    """One parameter of one airframe over n flights."""

    number: Integers  # (n,) of the flight among all flights of the airframe, rising
    value: Array  # (n,)
    std: Array  # (n,)
    airspeed: Array  # (n,) [m/s], NaN where it is not known

    def __len__(self) -> int:
        return len(self.number)

    @property
    def base(self) -> Array:
        """Columns (n, 1 or 2) of the constant, and of the airspeed where it counts."""
        ones = np.ones((len(self), 1))
        mean = float(np.mean(self.airspeed))
        if not np.std(self.airspeed) >= AIRSPEED_SPREAD * mean:
            return ones
        return np.column_stack([ones, self.airspeed / mean - 1.0])


@dataclass(frozen=True)
class Change:
    """The likelier one of the drift and the jump of a series."""

    kind: str
    number: int  # of the first flight after a jump; of the first flight of a drift
    size: float  # per flight of a drift; of a jump
    std: float
    p_value: float


def change_of(series: Series) -> Change | None:
    """The change of a series with its p-value, however large; None where the flights are too few."""
    if len(series) < FEWEST:
        return None
    base = series.base
    columns = np.column_stack([base, series.number - np.mean(series.number)])
    drift = fit(series.value, series.std, columns)
    jump, first, dates = _jump(series, base)
    may_jump = not _rests_on_one_flight(series, base, first, jump.between**2)
    p_value = min(1.0, 2.0 * min(drift.p_value(), dates * jump.p_value() if may_jump else 1.0))
    is_jump = may_jump and jump.log_likelihood - 0.5 * np.log(len(series)) > drift.log_likelihood
    fitted, kind = (jump, JUMP) if is_jump else (drift, DRIFT)
    number = int(series.number[first if is_jump else 0])
    return Change(kind, number, float(fitted.value[-1]), float(fitted.std[-1]), p_value)


def _jump(series: Series, base: Array) -> tuple[Fitted, int, int]:
    """The best jump, the first flight after it, and the number of dates that were tried."""
    dates = np.arange(FEWEST_BESIDE, len(series) - FEWEST_BESIDE + 1)
    fitted, best = fit(series.value, series.std, base), -1
    for _ in range(_ROUNDS):
        found = int(dates[np.argmax(_gains(series, base, dates, fitted.between**2))])
        if found == best:
            break
        best = found
        fitted = fit(series.value, series.std, _with_step(base, best))
    return fitted, best, len(dates)


def _with_step(base: Array, first: int) -> Array:
    return np.column_stack([base, np.arange(len(base)) >= first])


def _rests_on_one_flight(series: Series, base: Array, first: int, between_square: float) -> bool:
    """Whether a jump is gone once one of the flights is left out.

    Of 50 flights whose last one is far off, the last two look like a jump, with a p-value of one in a million.
    """
    columns = _with_step(base, first)
    others = (np.arange(len(series)) != k for k in range(len(series)))
    without = (fit_with(series.value[k], series.std[k], columns[k], between_square) for k in others)
    return any(fitted.p_value() > _WITHOUT_ONE for fitted in without)


def _gains(series: Series, base: Array, dates: Integers, between_square: float) -> Array:
    """How much a jump at each date lessens the weighted squares, with tau² known."""
    root = 1.0 / np.sqrt(series.std**2 + between_square)
    q = np.linalg.qr(root[:, None] * base)[0]
    steps = root[:, None] * (np.arange(len(series))[:, None] >= dates)
    steps -= q @ (q.T @ steps)
    squares = np.sum(steps**2, axis=0)
    along = steps.T @ (root * series.value)
    return np.where(squares > 1e-9, along**2 / np.maximum(squares, 1e-9), 0.0)


def named(p_values: Sequence[float], rate: float = RATE) -> npt.NDArray[np.bool_]:
    """Which of the hypotheses are named, so that at most ``rate`` of those that are is false in the mean."""
    if not len(p_values):
        return np.zeros(0, np.bool_)
    from scipy.stats import false_discovery_control  # here: 0.5 s that fewer than two airframes do not need

    adjusted: npt.NDArray[np.bool_] = false_discovery_control(np.asarray(p_values), method="bh") <= rate
    return adjusted


@dataclass(frozen=True)
class Mean:
    """The value of a parameter in one airframe over its flights."""

    value: float
    std: float
    between: float  # spread between flights
    flights: int


def mean_of(series: Series) -> Mean | None:
    """The mean of a series; None where it has one flight only."""
    if len(series) < FEWEST_OF_A_MEAN:
        return None
    fitted = fit(series.value, series.std, np.ones((len(series), 1)))
    return Mean(float(fitted.value[0]), float(fitted.std[0]), fitted.between, len(series))


#: Other airframes from which their own spread can be told.
FEWEST_OTHERS = 3


def difference(one: Mean, others: Sequence[Mean]) -> tuple[float, float, float]:
    """Mean of the other airframes, its standard error, and the p-value that ``one`` is like them.

    Flights of one airframe scatter no less than those of half of the airframes: a few that agree may do so by chance.
    Of few others the spread between airframes is hardly known: of two it is what they differ by, and of one it is asked
    whether both are equal.
    """
    y, s, own = np.array([o.value for o in others]), np.array([o.std for o in others]), one.std
    if len(others) >= FEWEST_OTHERS:
        scatter = float(np.median([mean.between for mean in (one, *others)]))
        own, *least = (max(mean.std, scatter / float(np.sqrt(mean.flights))) for mean in (one, *others))
        s = np.array(least)
        fitted = fit(y, s, np.ones((len(y), 1)))
        value, std, spread, freedom = float(fitted.value[0]), float(fitted.std[0]), fitted.between, fitted.freedom
    else:
        spread = float(np.sqrt(max(np.var(y, ddof=1) - np.mean(s**2), 0.0))) if len(y) > 1 else 0.0
        weight = 1.0 / (s**2 + spread**2)
        value, std = float(weight @ y / weight.sum()), float(weight.sum() ** -0.5)
        freedom = min([one.flights, *(o.flights for o in others)]) - 1
    apart = (one.value - value) / np.sqrt(own**2 + std**2 + spread**2)
    return value, std, two_sided(apart, freedom)
