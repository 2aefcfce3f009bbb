"""Signals on one grid of time, smoothed and differentiated alike, and how two of them compare.

Where a signal has a gap it is NaN on the grid, and so is all that is made of it there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Spectrum = npt.NDArray[np.complex128]

#: A gap is longer than so many sample intervals, and than so many seconds.
_GAP_INTERVALS, _GAP_SECONDS = 3.5, 0.3
#: Of the weight of a kernel that may fall on NaN.
_LEAST_COVER = 1e-3


@dataclass(frozen=True)
class Grid:
    """Times ``start + step * k`` [s], k < count."""

    start: float
    step: float
    count: int

    @property
    def time(self) -> Array:
        """(count,) [s]."""
        return self.start + self.step * np.arange(self.count, dtype=np.float64)

    def put(self, time: Array, values: Array) -> Array:
        """Samples (n,) or (n, k) at rising times (n,) on the grid: interpolated, or averaged where they are denser."""
        columns = values[:, None] if values.ndim == 1 else values
        return np.column_stack([self._column(time, column) for column in columns.T])

    def _column(self, time: Array, values: Array) -> Array:
        known = np.isfinite(values)
        time, values = time[known], values[known]
        first = np.concatenate([[True], np.diff(time) > 0.0])[: len(time)]
        time, values = time[first], values[first]
        if len(time) < 2:
            return np.full(self.count, np.nan)
        interval, at = float(np.median(np.diff(time))), self.time
        if interval < 0.7 * self.step:
            area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
            half = 0.5 * self.step
            out = (np.interp(at + half, time, area) - np.interp(at - half, time, area)) / self.step
        else:
            out = np.interp(at, time, values)
        next_one = np.searchsorted(time, at).clip(1, len(time) - 1)
        gap = time[next_one] - time[next_one - 1] > max(_GAP_INTERVALS * interval, _GAP_SECONDS)
        return np.asarray(np.where(gap | (at < time[0]) | (at > time[-1]), np.nan, out))

    def smooth(self, values: Array, width: float) -> Array:
        """Hann average (count,) over ``width`` [s]; as it is where the width is less than three steps."""
        half = round(0.5 * width / self.step)
        if half < 1:
            return values
        kernel = np.hanning(2 * half + 3)[1:-1]
        kernel /= kernel.sum()
        missing = np.isnan(values)
        padded = np.pad(np.where(missing, 0.0, values), half)
        lost = np.pad(missing.astype(np.float64), half, constant_values=1.0)
        smooth, uncovered = _convolve(np.stack([padded, lost]), kernel)
        return np.where(uncovered > _LEAST_COVER, np.nan, smooth)

    def slope(self, values: Array) -> Array:
        """Central differences (count,) per second."""
        out = np.full(self.count, np.nan)
        out[1:-1] = (values[2:] - values[:-2]) / (2.0 * self.step)
        return out

    def as_slope(self, values: Array) -> Array:
        """A rate (count,) as ``slope`` sees it: its mean over two steps, by Simpson's rule."""
        out = np.full(self.count, np.nan)
        out[1:-1] = (values[:-2] + 4.0 * values[1:-1] + values[2:]) / 6.0
        return out

    def band(self, values: Array, short: float, long: float) -> Array:
        """What changes slower than ``short`` and faster than ``long`` [s]."""
        smooth = self.smooth(values, short)
        return smooth - self.smooth(smooth, long)


@dataclass(frozen=True)
class Comparison:
    """How y follows x: y(t) = ratio x(t - lag) + noise.

    The ratio lies between ``low`` and ``high``, its least-squares values when all noise is in y and when all is in x
    (the bounds of Frisch for errors in both), widened by three standard errors. ``correlation`` at the best lag, with
    its sign, which is that of the ratio.
    """

    correlation: float
    low: float
    high: float
    lag: float  # [s]
    lag_std: float  # [s]
    independent: float  # as many independent samples as the series are worth
    seconds: float  # of data

    @property
    def is_sure(self) -> bool:
        """The two belong together beyond doubt."""
        strength = np.arctanh(min(abs(self.correlation), 0.999999)) * np.sqrt(max(self.independent - 3.0, 0.0))
        return bool(abs(self.correlation) > 0.5 and strength > 5.0)

    @property
    def ratio(self) -> float:
        """The middle of the bounds, with the sign."""
        return float(np.copysign(np.sqrt(self.low * self.high), self.correlation))


def _convolve(values: Array, kernel: Array) -> Array:
    """Rows (m, n) with a kernel (k,), only where it lies inside: (m, n - k + 1). scipy.signal would cost 0.4 s more."""
    size = 1 << (values.shape[1] - 1).bit_length()
    spectrum = np.fft.rfft(values, size) * np.fft.rfft(kernel, size)
    return np.fft.irfft(spectrum, size)[:, len(kernel) - 1 : values.shape[1]]


#: Share of the common points that must be left at a lag.
_LEAST_OVERLAP = 0.5
#: Frequencies, of series that are filled up to twice their length, over which coherence is a mean.
_NEIGHBOURS = 33


def compare(y: Array, x: Array, step: float, longest_lag: float = 0.5) -> Comparison | None:
    """Compare two series (n,) on a grid of ``step`` [s]; None where fewer than 100 points are common.

    Independent samples after Bartlett. Standard errors of ratio and lag are those of least squares with residuals that
    are correlated in time; only changes that both series have tell a lag.
    """
    common = np.isfinite(x) & np.isfinite(y)
    n = int(common.sum())
    if n < 100 or np.std(x[common]) < 1e-12 or np.std(y[common]) < 1e-12:
        return None
    slopes = [np.nan_to_num(np.gradient(np.where(common, v, np.nan))) for v in (x, y)]  # before gaps are filled
    x, y = (np.where(common, v - v[common].mean(), 0.0) for v in (x, y))
    size = 2 ** int(np.ceil(np.log2(2 * len(x))))
    fx, fy, fm = (np.fft.rfft(v, size) for v in (x, y, common))
    cross, auto_x, auto_y = (np.fft.irfft(f, size) for f in (fy * np.conj(fx), np.abs(fx) ** 2, np.abs(fy) ** 2))
    norm = np.sqrt(auto_x[0] * auto_y[0])
    most = min(round(longest_lag / step), len(x) // 4)
    lags = np.arange(-most, most + 1)
    size_x = np.fft.irfft(fm * np.conj(np.fft.rfft(x**2, size)), size)[lags]  # of what is common at each lag
    size_y = np.fft.irfft(np.fft.rfft(y**2, size) * np.conj(fm), size)[lags]
    rho = cross[lags] / np.sqrt(np.maximum(size_x * size_y, 1e-12 * norm**2))
    overlap = np.fft.irfft(np.abs(fm) ** 2, size)[lags]  # little of short pieces is left at a large lag: it agrees
    rho = np.where(overlap > _LEAST_OVERLAP * n, rho, 0.0)
    best, sign = _best(rho, most)
    lag, r = _peak(sign * rho, best)
    lag = (lag - most) * step
    memory = min(len(x) // 4, round(20.0 / step))
    independent = n / max(float(1.0 + 2.0 * np.sum(auto_x[1:memory] * auto_y[1:memory]) / norm**2), 1.0)
    steps = round(lag / step)
    shifted = np.roll(x, steps)
    residual = np.where(common, y - (shifted @ y) / max(float(shifted @ shifted), 1e-300) * shifted, 0.0)
    auto_e = np.fft.irfft(np.abs(np.fft.rfft(residual, size)) ** 2, size)
    together = 1.0 + 2.0 * np.sum(auto_x[1:memory] * auto_e[1:memory]) / max(auto_x[0] * auto_e[0], 1e-300)
    noise = np.sqrt(max(1.0 / r**2 - 1.0, 1e-12) * max(float(together), 1.0) / n) if r > 0.0 else np.inf
    spread = np.sqrt(auto_y[0] / auto_x[0])
    width = np.exp(min(3.0 * noise, 3.0))
    before, after = max(-steps, 0), max(steps, 0)
    bend = float(slopes[1][after : len(x) - before] @ slopes[0][before : len(x) - after])
    return Comparison(
        sign * r, spread * max(r, 1e-9) / width, spread / max(r, 1e-9) * width,
        lag, step * _lag_error(fx, fy, bend, size, steps, n), independent, n * step,
    )  # fmt: skip


def _lag_error(fx: Spectrum, fy: Spectrum, bend: float, size: int, steps: int, n: int) -> float:
    """Standard error, in steps, of the lag at which the sum of y(t) x(t - lag) is largest, of n points.

    There that of y x' is 0, and it bends by that of y' x'. What scatters the former is incoherent in both: noise
    of x has a slope, too, and that says nothing of y. The transforms, of x and y, are ``size`` long.
    """
    phase = 2.0 * np.pi / size * np.arange(len(fx))
    coherent = np.abs(_smooth(fy * np.conj(fx) * np.exp(1j * steps * phase))) ** 2
    incoherent = np.maximum(_smooth(np.abs(fx) ** 2) * _smooth(np.abs(fy) ** 2) - coherent, 0.0)
    return float(np.sqrt(np.fft.irfft(np.sin(phase) ** 2 * incoherent, size)[0] / n)) / max(abs(bend), 1e-300)


def _smooth(spectrum: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The mean over neighbouring frequencies, by which two series are coherent or not."""
    return np.convolve(spectrum, np.ones(_NEIGHBOURS) / _NEIGHBOURS, mode="same")


def _best(rho: Array, zero: int) -> tuple[int, float]:
    """Where the correlation is strongest, and its sign; half a wave later the sign turns too: plus is preferred."""
    plus, minus = int(np.argmax(rho)), int(np.argmin(rho))
    if -rho[minus] > 1.15 * rho[plus] and rho[zero] < 0.5 * -rho[minus]:
        return minus, -1.0
    return plus, 1.0


def _peak(rho: Array, best: int) -> tuple[float, float]:
    """Place and height of the top of the parabola through three points."""
    if not 0 < best < len(rho) - 1:
        return float(best), float(min(rho[best], 1.0))
    left, top, right = rho[best - 1 : best + 2]
    bend = left - 2.0 * top + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return best + shift, float(min(top - 0.25 * (left - right) * shift, 1.0))


#: A spike stands above its neighbours by so many robust standard deviations of such differences, and by a share of the
#: signal's range; its neighbours agree within a share of it.
_SPIKE, _RANGE, _AGREE = 25.0, 0.5, 0.2


def spikes(values: Array) -> tuple[npt.NDArray[np.bool_], float, float]:
    """Single values (n,) far from both neighbours, the largest such difference, and the usual one."""
    found = np.zeros(len(values), dtype=bool)
    if len(values) < 50:
        return found, 0.0, 0.0
    apart = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    usual = 1.4826 * float(np.median(np.abs(apart - np.median(apart))))
    span = float(np.percentile(values, 98) - np.percentile(values, 2))
    high = np.abs(apart) > max(_SPIKE * usual, _RANGE * span)
    found[1:-1] = high & (np.abs(values[2:] - values[:-2]) < _AGREE * np.abs(apart))
    return found, float(np.max(np.abs(apart[found[1:-1]]), initial=0.0)), usual


def regress(y: Array, columns: Array, step: float) -> tuple[Array, Array, Array] | None:
    """Least squares of y (n,) on columns (n, k) and a constant.

    Coefficients, standard errors and partial correlations, each (k,). The errors allow for residuals that are
    correlated in time (factor of Bartlett). None for too little data.
    """
    good = np.isfinite(y) & np.all(np.isfinite(columns), axis=1)
    if good.sum() < 100:
        return None
    x = columns[good] - columns[good].mean(axis=0)
    target = y[good] - y[good].mean()
    scale = np.sqrt(np.mean(x**2, axis=0))
    if np.any(scale < 1e-15) or np.linalg.cond(x / scale) > 1e6:
        return None
    theta, *_ = np.linalg.lstsq(x / scale, target, rcond=None)
    residual = target - x / scale @ theta
    inverse = np.linalg.inv((x / scale).T @ (x / scale))
    independent = len(target) / memory_of(residual, round(20.0 / step))
    std = np.sqrt(np.diag(inverse) * (residual @ residual) / max(independent - x.shape[1] - 1.0, 1.0))
    alone = np.sqrt(1.0 / np.diag(inverse)) * np.abs(theta)
    partial = np.sign(theta) * alone / np.sqrt(np.maximum(alone**2 + residual @ residual, 1e-300))
    return theta / scale, std / scale, partial


def memory_of(series: Array, longest: int) -> float:
    """How many neighbours (n,) count as one: 1 + 2 sum of squared autocorrelations."""
    series = series - series.mean()
    size = 2 ** int(np.ceil(np.log2(2 * len(series))))
    auto = np.fft.irfft(np.abs(np.fft.rfft(series, size)) ** 2, size)
    auto = auto[1 : min(longest, len(series) // 4)] / max(auto[0], 1e-300)
    return float(1.0 + 2.0 * np.sum(auto**2))
