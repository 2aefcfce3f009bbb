"""The unit of a time whose name and header do not say it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.recordings.tabular.clock import seconds_of_hhmmss
from aircraft_sysid_ros.recordings.tabular.guess.names import guess_name
from aircraft_sysid_ros.recordings.tabular.table import Table, numbers
from aircraft_sysid_ros.recordings.tabular.units import conversion

Array = npt.NDArray[np.float64]
_SHORTEST_STEP, _LONGEST_STEP = 2e-4, 6.0  # [s]; recorders of whole flights write every few seconds
_UNIX = (9e8, 2.14e9)  # [s]
_SHORTEST_FLIGHT, _LONGEST_FLIGHT = 2.0, 3.0 * 86_400.0  # [s]
_MOST_STEPS = 1.5  # from one minute to the next, of a time in hours, minutes and seconds
#: By how much larger the numbers of a rate or of a speed may be than those of what they are the derivative of, in SI.
_TURN, _LENGTH = (1.0, np.pi / 180.0, 180.0 / np.pi), (1.0, 2.0, 3.4, 0.3)  # m/s, kt, ft/s or km/h; ft beside m/s
_LATITUDE = tuple(metres * speed for metres in (111_195.0, 6.371e6, 0.0111195) for speed in (1.0, 2.0, 3.4))
_DERIVATIVES = (
    ("angular_velocity.x", "attitude.roll", _TURN),
    ("angular_velocity.y", "attitude.pitch", _TURN),
    ("velocity.north", "position.north", _LENGTH),
    ("velocity.east", "position.east", _LENGTH),
    ("velocity.north", "latitude", _LATITUDE),
)
_WINDOWS = (5, 20, 100, 500, 2000)  # rows over which the derivatives are added up
#: Correlation from which on the two belong together, and the factor by which their sizes then may differ.
_LEAST_CORRELATION, _TOLERANCE = 0.8, 1.5


def is_unix_time(seconds: Array) -> bool:
    """Whether times (n,) [s] count from 1970."""
    return bool(_UNIX[0] < np.nanmin(seconds) < _UNIX[1])


def is_usual_step(seconds: float) -> bool:
    """Whether tables come in steps like this."""
    return 0.1 * _SHORTEST_STEP <= seconds < 2.5 * _LONGEST_STEP


def is_hhmmss(ticks: Array) -> bool:
    """Whether times (n,) are hours, minutes and seconds in one number: from 59 s they jump on to the next minute."""
    known = ticks[np.isfinite(ticks)]
    seconds = seconds_of_hhmmss(known)
    if len(known) < 3 or np.isnan(seconds).any():
        return False
    steps, in_seconds = np.diff(known), np.diff(seconds) % 86_400.0
    jumps = np.abs(steps - in_seconds) > 1.0
    rising = in_seconds[in_seconds > 0.0]
    return bool(jumps.any() and np.median(in_seconds[jumps]) < _MOST_STEPS * np.median(rising))


def fitting_units(
    ticks: Array, step: float, table: Table, columns: dict[str, npt.NDArray[Any]]
) -> tuple[list[str], str]:
    """The units that times (n,) may have that usually rise by ``step``, beside the columns (n,) of a table, and why.

    A step of 1 is one of seconds at 1 Hz and one of milliseconds at 1 kHz: dates tell, or motion and its derivative, or
    that one of them is too short or too long for a flight.
    """
    scales = {unit: conversion(unit, "s").factor for unit in ("s", "ms", "us", "ns")}
    fitting = [unit for unit, scale in scales.items() if _SHORTEST_STEP <= step * scale < _LONGEST_STEP]
    if len(fitting) < 2:
        return fitting, ""
    of_dates = [unit for unit in fitting if is_unix_time(ticks * scales[unit])]
    if of_dates:
        return of_dates, "it counts from 1970"
    slopes = _slopes(ticks, table, columns)
    if slopes:
        moved = [unit for unit in fitting if all(_is_one(slope / scales[unit], near) for slope, near in slopes)]
        return moved or fitting, "rates and speeds then add up to angles and places"
    span = float(np.nanmax(ticks) - np.nanmin(ticks))
    of_a_flight = [unit for unit in fitting if _SHORTEST_FLIGHT <= span * scales[unit] < _LONGEST_FLIGHT]
    return of_a_flight, "all else would be too short or too long a flight"


def _is_one(slope: float, near: tuple[float, ...]) -> bool:
    return any(1.0 / _TOLERANCE < slope * factor < _TOLERANCE for factor in near)


def _slopes(ticks: Array, table: Table, columns: dict[str, npt.NDArray[Any]]) -> list[tuple[float, tuple[float, ...]]]:
    """By how much motion changes where its derivative adds up to 1 over the ticks, and what makes that 1 in SI."""
    by_signal: dict[str, Array] = {}
    for name, values in columns.items():
        guess = guess_name(name, table.units.get(name, ""), table.name)
        if guess is not None and len(values) == len(ticks):
            by_signal.setdefault(guess.signal, numbers(values)[0])
    found = []
    for rate, motion, near in _DERIVATIVES:
        if rate in by_signal and motion in by_signal:
            slope = _slope(ticks, by_signal[rate], by_signal[motion])
            found += [(slope, near)] if slope is not None else []
    return found


def _slope(ticks: Array, rate: Array, motion: Array) -> float | None:
    """The size of the change of motion (n,) for that of its rate added up; None where they do not belong together."""
    known = np.isfinite(ticks) & np.isfinite(rate) & np.isfinite(motion)
    ticks, rate, motion = ticks[known], rate[known], motion[known]
    if len(ticks) < 2 * _WINDOWS[0]:
        return None
    added = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(ticks))])
    best, slope = _LEAST_CORRELATION, None
    for window in _WINDOWS:
        x, y = (values[window:] - values[:-window] for values in (added, motion))
        if len(x) < 4 * window or not (np.ptp(x) > 0.0 and np.ptp(y) > 0.0):
            break
        correlation = abs(float(np.corrcoef(x, y)[0, 1]))
        if correlation > best:
            best, slope = correlation, float(np.std(y) / np.std(x))
    return slope
