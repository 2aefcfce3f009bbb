"""Angles of attack and sideslip for the regressors: those of the vanes where gusts make the filter late.

The filter is causal and knows no aerodynamics: in gusts its angles are some milliseconds late, and what is late in
alpha looks like a term in q. Equation error takes that for C_m,q and C_Z,q. A vane is noisy, but on time, and its noise
has no part in the motion. Kinematics (``flow_angle_rates``), integrated to I, take the motion out of what it shows,

    s = vane - lever arm - I,

and leave gusts and noise. s is linear between the samples on both sides of a state at t; the angle is

    angle(t) = (1 - w) filter(t) + w (I(t) + s(t)).

The states have waited for their controls, so that the sample after t is there. w is 0 where the filter is so quiet, in
calm air, that its own error is small beside the noise of the vane that is left in the differentiating window, and
where no sound sample stands on both sides of t.

The noise R of a vane comes from its samples alone: the steps D of s are nearly independent ones of gusts, and
differences of white noise, so that E[D_k D_k-1] = -R.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.signals import flow_angle_rates
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.drift import Drift
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

#: Kinds of samples, and the column of a state that each replaces; the order of the columns of ``ANGLES``.
VANES = ((Kind.ANGLE_OF_ATTACK, "angle_of_attack"), (Kind.SIDESLIP, "sideslip"))
#: Columns of what ``FlowAngles.at`` gives: both angles [rad], one sigma of each, and that of the vane in it.
ANGLES, STD, VANE_STD, WIDTH = 0, 2, 4, 6
#: Longest time [s] from one sample of a vane to the next, and from a sample to a state.
_LONGEST = 0.1
#: w rises from 0 to 1 between these ratios of variances: error of the filter over noise of the vane in the window.
_QUIET, _GUSTY = 0.8, 0.9
#: Integral of the square of the parabola of ``window_average``, times its half-width.
WINDOW_WIDTH = 0.6
#: A sample further off than this many sigma is left out.
_GATE = 5.0
#: The noise of a vane begins as that of the aircraft file, worth so many samples; it is a mean over so long [s].
_WORTH, _MEMORY = 100.0, 60.0
#: It stays between these multiples (of sigma) of what it was at first.
_LEAST, _MOST = 0.2, 20.0

_TIME, _AIRSPEED, _STD = StateField.TIME, StateField.AIRSPEED, StateField.AIR_VELOCITY_STD
_AIR, _RATES = StateField.AIR_VELOCITY.start, StateField.ANGULAR_VELOCITY.start
_ANGLE_OF_ATTACK, _SIDESLIP = StateField.ANGLE_OF_ATTACK, StateField.SIDESLIP


class _Place(NamedTuple):
    """What the loop needs to know."""

    arm: Array  # (3,) vane from the centre of gravity
    gravity: float
    minimum_airspeed: float
    half_width: float  # [s] of the differentiating window
    longest: float  # [s]


# A vane between two calls, by column: its newest row (time, lever arm, filter, I, rate), the two newest sound samples
# (time, s), newest value and step of s, R, how many products are in it, and R at first.
_ROW, _BEFORE, _AFTER, _VALUE, _STEP, _SQUARE, _COUNT, _FIRST, _TRACK = 0, 5, 7, 9, 10, 11, 12, 13, 14
_OF_TIME, _LEVER, _OF_FILTER, _INTEGRAL, _RATE = range(5)


@njit(cache=True)
def share_in_window(interval: float, half_width: float) -> float:
    """Variance that is left of white noise, ``interval`` [s] from sample to sample, in the mean over a window.

    The parabola of ``window_average`` over straight lines between samples: 0.6 r for r = interval / half-width far
    below 1; the denominator is fitted to sums of squared weights, to 3 % up to r = 1.25.
    """
    r = interval / half_width
    return WINDOW_WIDTH * r / (1.0 + 0.1 * r + 0.25 * r * r)


@njit(cache=True)
def angle_at(row: Array, arm: Array, of_sideslip: bool) -> float:
    """Angle [rad] of the air at ``arm`` from the centre of gravity, by a state."""
    p, q, r = row[_RATES], row[_RATES + 1], row[_RATES + 2]
    u = row[_AIR] + q * arm[2] - r * arm[1]
    v = row[_AIR + 1] + r * arm[0] - p * arm[2]
    w = row[_AIR + 2] + p * arm[1] - q * arm[0]
    return float(np.arctan2(v, np.sqrt(u * u + w * w)) if of_sideslip else np.arctan2(w, u))


@njit(cache=True)
def _follow_rows(rows: Array, of_sideslip: bool, place: _Place, track: Array, out: Array) -> None:
    """Columns _ROW of rows (n, …) into ``out`` (n + 1, 5), the first that of the row before them."""
    column = _SIDESLIP if of_sideslip else _ANGLE_OF_ATTACK
    out[0] = track[_ROW:_BEFORE]
    for i in range(len(rows)):
        row, before, now = rows[i], out[i], out[i + 1]
        rates = flow_angle_rates(row, place.gravity)
        now[_OF_TIME], now[_OF_FILTER] = row[_TIME], row[column]
        now[_LEVER] = angle_at(row, place.arm, of_sideslip) - row[column]
        now[_RATE] = rates[1] if of_sideslip else rates[0]
        step = now[_OF_TIME] - before[_OF_TIME]
        now[_INTEGRAL] = before[_INTEGRAL] + 0.5 * step * (now[_RATE] + before[_RATE])
        if not (np.isfinite(now[_INTEGRAL]) and step <= place.longest):
            now[_INTEGRAL] = 0.0  # no two samples that belong together stand on both sides


@njit(cache=True)
def _bounded_square(track: Array) -> float:
    """R as it is used."""
    return float(min(max(track[_SQUARE], _LEAST**2 * track[_FIRST]), _MOST**2 * track[_FIRST]))


@njit(cache=True)
def _take(time: float, value: float, std: float, early: Array, late: Array, longest: float, track: Array) -> None:
    """One sample of a vane between two rows of ``_follow_rows``; ``std`` [rad] of the filter."""
    share = (time - early[_OF_TIME]) / (late[_OF_TIME] - early[_OF_TIME])
    there = early + share * (late - early)
    off = value - there[_LEVER] - there[_OF_FILTER]
    if value == track[_VALUE] or not off * off <= _GATE**2 * (std * std + _bounded_square(track)):
        return
    shown = value - there[_LEVER] - there[_INTEGRAL]
    interval = time - track[_AFTER]
    step = shown - track[_AFTER + 1] if interval <= longest else np.nan
    product = -step * track[_STEP]
    if np.isfinite(product):
        track[_COUNT] += 1.0
        weight = max(1.0 / (_WORTH + track[_COUNT]), interval / _MEMORY)
        track[_SQUARE] += weight * (product - track[_SQUARE])
    track[_VALUE], track[_STEP] = value, step
    track[_BEFORE : _BEFORE + 2] = track[_AFTER : _AFTER + 2]
    track[_AFTER], track[_AFTER + 1] = time, shown


@njit(cache=True)
def _write(seen: Array, std: float, column: int, place: _Place, track: Array, out: Array) -> None:
    """Angle of a state and its errors into the columns ``column`` of ``out`` (WIDTH,), from the samples about it."""
    time, interval = seen[_OF_TIME], track[_AFTER] - track[_BEFORE]
    if not (track[_BEFORE] < time <= track[_AFTER] and interval <= place.longest):
        return
    square = _bounded_square(track) * share_in_window(interval, place.half_width)
    w = min(max((std * std / square - _QUIET) / (_GUSTY - _QUIET), 0.0), 1.0)
    if not w > 0.0:
        return
    share = (time - track[_BEFORE]) / interval
    measured = seen[_INTEGRAL] + track[_BEFORE + 1] + share * (track[_AFTER + 1] - track[_BEFORE + 1])
    out[ANGLES + column] += w * (measured - seen[_OF_FILTER])
    out[VANE_STD + column] = w * np.sqrt(square)
    out[STD + column] = np.sqrt((1.0 - w) ** 2 * std * std + w * w * square)


@njit(cache=True)
def write_measured(
    rows: Array, due: int, times: Array, values: Array, column: int, place: _Place, track: Array, out: Array
) -> None:
    """Angle 0 or 1 of VANES into ``out`` (due, WIDTH), which has those of the filter, from samples by rising time [s].

    rows (n, StateField.WIDTH), n >= due: those that are not due are there for the samples between them, and will come
    again. ``track`` (_TRACK,) goes on.
    """
    seen = np.empty((len(rows) + 1, _BEFORE))
    _follow_rows(rows, column == 1, place, track, seen)
    k, j = np.searchsorted(times, track[_AFTER], side="right"), 1
    for i in range(due):
        time = rows[i, _TIME]
        while track[_AFTER] < time and k < len(times) and times[k] <= time + place.longest:
            while j < len(rows) and seen[j, _OF_TIME] < times[k]:
                j += 1
            if seen[j, _OF_TIME] < times[k]:
                break
            early, late = seen[j - 1], seen[j]
            between = early[_OF_TIME] <= times[k] and late[_OF_TIME] - early[_OF_TIME] <= place.longest
            if between and rows[j - 1, _AIRSPEED] >= place.minimum_airspeed:
                std = rows[j - 1, _STD] / rows[j - 1, _AIRSPEED]
                _take(times[k], values[k], std, early, late, place.longest, track)
            k += 1
        _write(seen[i + 1], rows[i, _STD] / rows[i, _AIRSPEED], column, place, track, out[i])
    track[_ROW:_BEFORE] = seen[due]


def angles_of_filter(rows: Array) -> Array:
    """Angles (n, WIDTH) of states (n, …) as the filter has them: no noise of a vane is in them."""
    out = np.zeros((len(rows), WIDTH))
    out[:, ANGLES], out[:, ANGLES + 1] = rows[:, _ANGLE_OF_ATTACK], rows[:, _SIDESLIP]
    with np.errstate(divide="ignore", invalid="ignore"):
        out[:, STD] = out[:, STD + 1] = rows[:, _STD] / rows[:, _AIRSPEED]
    return out


class FlowAngles:
    """Angles of both vanes at the times of states."""

    def __init__(self, aircraft: Aircraft, gravity: float) -> None:
        self._aircraft, self._gravity = aircraft, gravity
        self._tracks = np.zeros((len(VANES), _TRACK))
        for track, (_, sensor) in zip(self._tracks, VANES, strict=True):
            track[_SQUARE] = track[_FIRST] = aircraft.sensors[sensor].noise_of_true[0] ** 2
        self._drift = Drift(aircraft)
        self.restart_clock()

    def restart_clock(self) -> None:
        """The clock started over: the noise of the vanes stays what it was."""
        self._drift.begin_flight()
        self._tracks[:, _ROW:_SQUARE] = np.nan
        self._tracks[:, [_ROW, _BEFORE, _AFTER]] = -np.inf

    def begin_flight(self) -> None:
        """Another flight begins by the same clock."""
        self._drift.begin_flight()

    @property
    def drifts_since(self) -> float | None:
        """Time [s] of the first state of the flight, from which the air data drift; None before it."""
        return self._drift.since

    def at(
        self, rows: Array, due: int, series: list[tuple[Array, Array]] | None, settle: float, half_width: float
    ) -> Array:
        """Angles (due, WIDTH) of the first ``due`` of states (n, …), those of the filter where ``series`` is None.

        ``series`` are times [s] and values (k, 1) of each of VANES; ``settle`` [s]: how much later than those that are
        due states may be there; ``half_width`` [s] of the differentiating window.
        """
        out = angles_of_filter(rows[:due])
        self._drift.note_states(rows[:, _TIME], -np.inf)
        if series is None:
            return out
        aircraft = self._aircraft
        longest, least = min(_LONGEST, settle), aircraft.minimum_airspeed
        place = _Place(aircraft.air_data_position, self._gravity, least, half_width, longest)
        for column, ((kind, _), (times, values)) in enumerate(zip(VANES, series, strict=True)):
            shown = self._drift.corrected(times, np.full(len(times), kind), values)
            write_measured(rows, due, times, shown[:, 0], column, place, self._tracks[column], out)
        return out
