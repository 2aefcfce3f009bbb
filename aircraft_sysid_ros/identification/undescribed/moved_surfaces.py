"""Surfaces as they may have moved, from what is recorded of them: so much later, or with the lag of a servo."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.aircraft.term_values import lagged
from aircraft_sysid_ros.identification.coefficients.layout import SIGNALS_OF_SAMPLE
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

SURFACES = ("de", "da", "dr")
COUNT = len(SURFACES)
FIRST = SIGNAL_INDEX[SURFACES[0]]
#: What is tried [s]: later by so much; with so long a time constant; and with so long a one after each dead time. A
#: command that is held from one to the next is late by half of what is between them: 10 ms at 50 Hz.
_DELAYS, _LAGS = np.array([-0.04, 0.04, 0.08, 0.12, 0.2]), np.array([0.03, 0.06, 0.1, 0.16, 0.25])
_DEAD_TIMES, _DEAD_LAGS = np.array([0.01, 0.02, 0.03]), np.array([0.0, 0.03, 0.06, 0.1, 0.16])
#: Of each surface: as it is recorded, with each delay, with each lag, and with each after each of the dead times.
_FIRST_LAG = 1 + len(_DELAYS)
_FIRST_DEAD = _FIRST_LAG + len(_LAGS)
FORMS = _FIRST_DEAD + len(_DEAD_TIMES) * len(_DEAD_LAGS)
#: A pause [s] that starts over; samples that are kept.
PAUSE, _KEPT = 0.3, 32
#: Forms of which one between them is made.
NEAR = 3


class Between(NamedTuple):
    """What makes forms between others, by time: which (…, NEAR), the share of each, and its change per second."""

    forms: npt.NDArray[np.int64]
    shares: Array
    slopes: Array


class Course(NamedTuple):
    """One way of being late: times [s] in order, and the forms that have them."""

    is_lag: bool  # or a delay
    dead_time: float  # [s] before a lag
    times: Array
    forms: npt.NDArray[np.int64]

    def between(self, time: Array | float) -> Between:
        """What is that late [s], by the parabola through the three forms that are next to it."""
        t = np.asarray(time, dtype=np.float64)
        last = len(self.times) - 1
        at = np.clip(np.searchsorted(self.times, t), 2, last)
        at += (at < last) & (self.times[at] - t < t - self.times[at - 1])
        a, b, c = self.times[at - 2], self.times[at - 1], self.times[at]
        scale = 1.0 / np.stack([(a - b) * (a - c), (b - a) * (b - c), (c - a) * (c - b)], axis=-1)
        shares = np.stack([(t - b) * (t - c), (t - a) * (t - c), (t - a) * (t - b)], axis=-1)
        slopes = np.stack([2.0 * t - b - c, 2.0 * t - a - c, 2.0 * t - a - b], axis=-1)
        near = np.stack([self.forms[at - 2], self.forms[at - 1], self.forms[at]], axis=-1)
        return Between(near, scale * shares, scale * slopes)

    def in_file(self, time: float) -> dict[str, float]:
        """Keys and values of control_surfaces in the aircraft file."""
        if not self.is_lag:
            return {"delay": -time}
        return {"delay": -self.dead_time, "lag": time} if self.dead_time else {"lag": time}


DELAY = Course(False, 0.0, np.array([_DELAYS[0], 0.0, *_DELAYS[1:]]), np.array([1, 0, *range(2, _FIRST_LAG)]))
LAG = Course(True, 0.0, np.array([0.0, *_LAGS]), np.array([0, *range(_FIRST_LAG, _FIRST_DEAD)]))
COURSES = (
    DELAY, LAG,
    *(
        Course(True, dead, _DEAD_LAGS, _FIRST_DEAD + i * len(_DEAD_LAGS) + np.arange(len(_DEAD_LAGS)))
        for i, dead in enumerate(_DEAD_TIMES.tolist())
    ),
)  # fmt: skip
#: Lags among the forms that are good instruments.
LAGGED = (int(LAG.forms[2]), int(LAG.forms[4]))


def derivatives_of(model: AerodynamicModel, axis: int) -> npt.NDArray[np.int64]:
    """Places (3,) of the derivatives by SURFACES among the terms of an axis, -1: none."""
    names, name = model.parameter_names[model.axis_slice(AXES[axis])], AXES[axis]
    listed = [f"{name}_{surface}" for surface in SURFACES]
    return np.array([names.index(one) if one in names else -1 for one in listed])


class MovedSurfaces:
    """Follows samples of the coefficients, in blocks of any size."""

    def __init__(self) -> None:
        self.restart_clock()

    def restart_clock(self) -> None:
        """The clock started over, or another manoeuvre."""
        self._kept = np.full((_KEPT, 1 + COUNT), np.nan)  # times and surfaces, the newest first
        self._lags = np.full((COUNT, len(_LAGS)), np.nan)
        # of the newest sample, and after them what was there the dead time before the one before it, and before that
        self._dead_lags = np.full((COUNT, len(_DEAD_TIMES), len(_DEAD_LAGS) + 2), np.nan)

    def follow(self, samples: Array) -> Array:
        """Forms (n, COUNT, FORMS) of samples (n, …), 0 where there is no surface. The early one is as it is recorded:
        ``look_ahead`` fills it in once the next sample is there.
        """
        return _forms(samples, self._kept, self._lags, self._dead_lags)


@njit(cache=True)
def _forms(samples: Array, kept: Array, lags: Array, dead_lags: Array) -> Array:
    out = np.zeros((len(samples), COUNT, FORMS))
    for i in range(len(samples)):
        time, step = samples[i, 0], samples[i, 0] - kept[0, 0]
        begins = not 0.0 < step < PAUSE
        if begins:
            kept[:] = np.nan
            lags[:] = np.nan
            dead_lags[:] = np.nan
        kept[1:] = kept[:-1].copy()
        kept[0, 0] = time
        evenly = abs(kept[1, 0] - kept[2, 0] - step) < 0.1 * step  # NaN: no
        for k in range(COUNT):
            at = SIGNALS_OF_SAMPLE + FIRST + k
            now, before, earlier = samples[i, at], kept[1, 1 + k], kept[2, 1 + k] if evenly else np.nan
            kept[0, 1 + k] = now
            if not np.isfinite(now):
                lags[k] = np.nan
                dead_lags[k] = np.nan
                continue
            forms = out[i, k]
            forms[0] = forms[1] = now
            for j in range(1, len(_DELAYS)):
                forms[1 + j] = _at(time - _DELAYS[j], kept, k)
            for j in range(len(_LAGS)):
                lags[k, j] = _lagged(lags[k, j], earlier, before, now, step, _LAGS[j])
                forms[_FIRST_LAG + j] = lags[k, j]
            at_form = _FIRST_DEAD
            for dead in range(len(_DEAD_TIMES)):
                ones = dead_lags[k, dead]
                was, late = ones[-1], _at(time - _DEAD_TIMES[dead], kept, k)
                earlier = ones[-2] if evenly else np.nan
                for j in range(len(_DEAD_LAGS)):
                    ones[j] = _lagged(ones[j], earlier, was, late, step, _DEAD_LAGS[j])
                    forms[at_form] = ones[j]
                    at_form += 1
                ones[-2], ones[-1] = was, late
    return out


@njit(cache=True)
def look_ahead(samples: Array, forms: Array) -> None:
    """Fill in the early forms (n, COUNT, FORMS) of samples (n, …), but for the last one."""
    for i in range(len(samples) - 1):
        step = samples[i + 1, 0] - samples[i, 0]
        if 0.0 < step < PAUSE:
            share = min(-_DELAYS[0] / step, 1.0)
            for k in range(COUNT):
                change = forms[i + 1, k, 0] - forms[i, k, 0]
                forms[i, k, 1] = forms[i, k, 0] + share * change


@njit(cache=True)
def _lagged(value: float, earlier: float, before: float, now: float, step: float, lag: float) -> float:
    """What follows with a lag [s], a step [s] after it had a value; at once where it has none, or no lag.

    On the parabola through what it follows now, one step before and two: straight lines lose a twentieth at 3 Hz.
    """
    if lag <= 0.0 or not np.isfinite(value + before):
        return now
    if not np.isfinite(earlier):
        return float(lagged(value, before, now, step, lag))
    slope, bend = (3.0 * now - 4.0 * before + earlier) / (2.0 * step), (now - 2.0 * before + earlier) / (2.0 * step**2)
    settled = now - lag * slope + 2.0 * lag * lag * bend  # what it would be after the parabola for long, now
    was = before - lag * (slope - 2.0 * step * bend) + 2.0 * lag * lag * bend  # and a step before
    return float(settled + np.exp(-step / lag) * (value - was))


@njit(cache=True)
def _at(time: float, kept: Array, k: int) -> float:
    """A surface at a time [s] before the newest one, on the parabola through the three samples about it; before the
    oldest that is known it stood still.
    """
    value: float = kept[0, 1 + k]
    for j in range(1, len(kept)):
        if not np.isfinite(kept[j, 1 + k]):
            return value
        if kept[j, 0] <= time:
            first = j - 1 if j + 1 < len(kept) and np.isfinite(kept[j + 1, 1 + k]) else j - 2
            if first < 0:
                share = (time - kept[j, 0]) / (kept[j - 1, 0] - kept[j, 0])
                return float(kept[j, 1 + k] + share * (kept[j - 1, 1 + k] - kept[j, 1 + k]))
            a, b, c = kept[first, 0], kept[first + 1, 0], kept[first + 2, 0]
            of_a = (time - b) * (time - c) / ((a - b) * (a - c))
            of_b = (time - a) * (time - c) / ((b - a) * (b - c))
            of_c = (time - a) * (time - b) / ((c - a) * (c - b))
            return float(of_a * kept[first, 1 + k] + of_b * kept[first + 1, 1 + k] + of_c * kept[first + 2, 1 + k])
        value = kept[j, 1 + k]
    return value
