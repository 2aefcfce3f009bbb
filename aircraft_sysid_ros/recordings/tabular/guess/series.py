"""Columns on one grid of time, and how one follows another."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from aircraft_sysid_ros.recordings.tabular.signals import UNITS
from aircraft_sysid_ros.recordings.tabular.units import conversion

Array = npt.NDArray[np.float64]
_LONGEST = 1800.0  # [s] of a flight that are looked at
_FASTEST, _SLOWEST = 0.02, 0.2  # [s] steps of the grid
_GAP = 1.0  # [s]
_FEWEST_BLOCKS = 6  # of a flight, of which a spread is made
SPEEDS = ("true_airspeed", "calibrated_airspeed", "indicated_airspeed")
#: Quantities that are positive by what they are.
POSITIVE = (
    *SPEEDS, "latitude", "longitude", "altitude", "pressure_altitude", "height_above_ground", "static_pressure",
    "dynamic_pressure", "air_temperature", "air_density", "throttle", "thrust", "propeller_speed", "mass",
)  # fmt: skip


@dataclass
class Column:
    """A column with a known name: its numbers, and what is found of its unit and sign."""

    table: str
    name: str
    signal: str
    values: Array  # (n,) as in the file
    time: Array  # (n,) [s]; NaN as long as the time of its table is not known
    said_unit: str = ""
    custom: float = 1.0  # the sign that its name implies; 0: none
    distance: int = 0
    unit: str = ""
    sign: float = 0.0  # 0: not known
    factor: float = np.nan  # SI value is sign * (factor * column + shift)
    shift: float = 0.0
    doubt: str = ""  # why a line stays commented out
    evidence: list[str] = field(default_factory=list)
    sure: bool = True
    rough: float = np.nan  # SI per unit as the physics has it, where no unit is exactly that
    offset: float = 0.0  # of the MAP, in the unit of the column
    expression: str = ""  # instead of the column

    @property
    def is_known(self) -> bool:
        """Whether unit and sign are."""
        return bool(self.unit) and self.sign != 0.0 and not self.doubt

    @property
    def numbers(self) -> Array:
        """The finite ones of its values (m,)."""
        return self.values[np.isfinite(self.values)]

    def take_unit(self, unit: str, why: str) -> None:
        """Its unit, where none was found before; "" is none."""
        if unit and not self.unit:
            convert = conversion(unit, UNITS[self.signal])
            self.unit, self.factor, self.shift = unit, convert.factor, convert.shift
            self.evidence.append(f"{unit}: {why}")
            if self.signal in POSITIVE:
                self.sign = 1.0

    def take_sign(self, sign: float, why: str) -> None:
        """Its sign, where none was found before."""
        if self.sign == 0.0:
            self.sign = sign
            self.evidence.append(f"{'positive' if sign > 0 else 'the other way'}: {why}")

    def si(self, values: Array) -> Array:
        """Values of the column in SI, with the sign of the signal."""
        return self.sign * (self.factor * (values + self.offset) + self.shift)


@dataclass(frozen=True)
class Fit:
    """reference = slope * column + constant: slope, correlation, and the t-value of the correlation."""

    slope: float
    correlation: float
    t: float

    @property
    def sign(self) -> float:
        """+1 or -1."""
        return float(np.sign(self.slope))


class Grid:
    """Columns on equal steps, smoothed alike, so that they can be compared and differentiated."""

    def __init__(self, columns: list[Column]) -> None:
        timed = [c for c in columns if len(c.time) > 3 and np.isfinite(c.time).all()]
        if not timed:
            self.time = np.empty(0)
            self.step = _FASTEST
            return
        start = min(c.time[0] for c in timed)
        end = min(max(c.time[-1] for c in timed), start + _LONGEST)
        steps = [float(np.median(np.diff(c.time))) for c in timed]
        self.step = float(np.clip(np.median(steps), _FASTEST, _SLOWEST))
        self.time = np.arange(start, end, self.step)

    def raw(self, column: Column, turn: float | None) -> Array:
        """The column's own numbers at the times of the grid, NaN in gaps; of held numbers the new ones.

        Angles go on over their jumps of a whole ``turn``.
        """
        known = np.isfinite(column.values) & np.isfinite(column.time)
        time, values = column.time[known], column.values[known]
        if len(values) < 4:
            return np.full(len(self.time), np.nan)
        fresh = np.concatenate([[True], np.diff(values) != 0.0])
        if fresh.sum() > 10 and fresh.mean() < 0.5:
            time, values = time[fresh], values[fresh]
        if turn is not None:
            values = np.unwrap(values, period=turn)
        found = np.interp(self.time, time, values, left=np.nan, right=np.nan)
        after = np.clip(np.searchsorted(time, self.time), 1, len(time) - 1)
        usual = float(np.median(np.diff(time)))
        return np.where(time[after] - time[after - 1] > max(_GAP, 3.0 * usual), np.nan, found)

    def unwrapped(self, values: Array, turn: float) -> Array:
        """Angles without their jumps of a whole ``turn``."""
        known = np.isfinite(values)
        out = values.copy()
        out[known] = np.unwrap(values[known], period=turn)
        return out

    def smooth(self, values: Array, seconds: float) -> Array:
        """Running mean, twice; NaN spreads."""
        width = max(round(seconds / self.step), 1)
        known = np.isfinite(values)
        if not known.any():
            return values
        filled = np.where(known, values, 0.0)
        weight = uniform_filter1d(uniform_filter1d(known.astype(float), width), width)
        mean = uniform_filter1d(uniform_filter1d(filled, width), width)
        with np.errstate(all="ignore"):
            return np.where(weight > 0.95, mean / weight, np.nan)

    def integral(self, values: Array) -> Array:
        """Sum over time from the first known value on; over gaps it goes on from value to value."""
        known = np.isfinite(values)
        if not known.any():
            return values
        at = np.arange(len(values))
        total = np.cumsum(np.interp(at, at[known], values[known])) * self.step
        return np.where(np.cumsum(known) > 0, total, np.nan)

    def changes(self, values: Array, seconds: float = 6.0) -> Array:
        """What is faster than a running mean."""
        return values - self.smooth(values, seconds)

    def rate(self, values: Array, seconds: float) -> Array:
        """Derivative of the smoothed values."""
        return np.gradient(self.smooth(values, seconds), self.step)


def fit(reference: Array, column: Array, block: int, where: npt.NDArray[np.bool_] | None = None) -> Fit | None:
    """How ``reference`` follows ``column``; None without enough of both. ``block``: as in regress."""
    known = np.isfinite(reference) & np.isfinite(column)
    if where is not None:
        known &= where
    if known.sum() < 40:
        return None
    y, x = reference[known], column[known]
    low, high = np.percentile(y, (0.5, 99.5))
    inside = (y >= low) & (y <= high)
    y, x = y[inside] - np.mean(y[inside]), x[inside] - np.mean(x[inside])
    yy, xx, xy = float(y @ y), float(x @ x), float(x @ y)
    if yy <= 0.0 or xx <= 0.0:
        return None
    left = x * (y - x * (xy / xx))
    with np.errstate(all="ignore"):
        t = xy / float(np.sqrt(_spread_of_sums(left[:, None], block)[0, 0]))
    return Fit(float(np.sign(xy)) * np.sqrt(yy / xx), xy / np.sqrt(xx * yy), t)


def regress(reference: Array, columns: list[Array], free: list[Array], block: int) -> tuple[Array, Array, float] | None:
    """Least squares of ``reference`` (n,) on columns, a constant and ``free`` columns, which take up known errors.

    Slopes and t-values of the columns, and the share of the largest term of the law that is left over. Residuals of
    smoothed rows follow one another: their spread is that of overlapping blocks of so many rows (Newey and West 1987).
    """
    matrix = np.stack([*columns, *free, np.ones(len(reference))], axis=1)
    known = np.isfinite(reference) & np.isfinite(matrix).all(axis=1)
    if known.sum() < 60:
        return None
    x = matrix[known]
    x[:, :-1] -= x[:, :-1].mean(axis=0)
    y = reference[known] - reference[known].mean()
    scale = np.sqrt(np.mean(x * x, axis=0))
    if (scale[: len(columns)] <= 0.0).any() or not y.any():
        return None
    x = x / np.where(scale > 0.0, scale, 1.0)
    inverse = np.linalg.pinv(x.T @ x)
    solution = inverse @ (x.T @ y)
    residual = y - x @ solution
    spread = np.sqrt(np.diag(inverse @ _spread_of_sums(x * residual[:, None], block) @ inverse))
    with np.errstate(all="ignore"):
        t = solution / spread
    count = len(columns)
    largest = max(float(np.mean(y * y)), float(np.max(solution[:count] ** 2)))
    return solution[:count] / scale[:count], t[:count], float(np.mean(residual**2)) / largest


def _spread_of_sums(rows: Array, block: int) -> Array:
    """Covariance (k, k) of the sum of rows (n, k) that are dependent over less than a block."""
    block = max(min(block, len(rows) // _FEWEST_BLOCKS), 1)
    padding = np.zeros((block, rows.shape[1]))
    total = np.cumsum(np.concatenate([padding, rows, padding]), axis=0)
    sums = total[block:] - total[:-block]
    return np.asarray(sums.T @ sums / block)
