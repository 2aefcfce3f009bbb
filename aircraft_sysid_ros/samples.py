"""What flows through the program: time-stamped samples, converted at the edge to FRD, NED, SI and radians.

A batch holds n samples of any kinds in the order in which they arrived; live nodes push batches of one
message, replay pushes a second of flight at once, and both meet the same code.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

#: Values per sample; a kind with fewer leaves the rest NaN.
WIDTH = 10


class Kind(IntEnum):
    """Kinds of samples, with their values in order."""

    IMU = 0  # specific force (3) [m/s^2], angular rate (3) [rad/s], body; their variances or NaN
    ATTITUDE = 1  # quaternion body to NED (4), variance (3) [rad^2] or NaN
    MAGNETIC_FIELD = 2  # field (3), body, any unit
    GPS_POSITION = 3  # latitude, longitude [rad], altitude [m], variance north, east, down [m^2] or NaN; see GPS_NED
    GPS_VELOCITY = 4  # velocity over ground NED (3) [m/s]
    AIRSPEED = 5  # true airspeed [m/s]
    ANGLE_OF_ATTACK = 6  # [rad]
    SIDESLIP = 7  # [rad]
    AIR = 8  # density [kg/m^3], static pressure [Pa]; either may be NaN
    CONTROLS = 9  # elevator, aileron, rudder, flaps [rad], throttle 0..1, thrust [N], propeller speed [rad/s]
    HEIGHT = 10  # above the ground [m]
    MASS = 11  # mass [kg], Ixx, Iyy, Izz, Ixz [kg m^2], centre of gravity (3) [m]
    FIVE_HOLE = 12  # static, dynamic, alpha and beta pressure [Pa]
    #: No measurement: another manoeuvre begins, so long [s] after the one before, or NaN. Where it is the first of
    #: another run, of several that are diagnosed together, the number of that run from 0.
    SEAM = 13
    INPUTS = 14  # the inputs that the aircraft file names, in its order, SI; NaN for one that the message leaves out


#: Signals of the model that the columns of Kind.CONTROLS give, in order.
CONTROL_COLUMNS = ("de", "da", "dr", "flaps", "throttle", "Tc", "propeller_speed")


#: Where a GPS_POSITION has its position NED [m] within the first step, which works it out (``earth.Odometer``).
GPS_NED = slice(6, 9)

#: How many leading values must be finite for a sample of the kind to be of use.
REQUIRED_VALUES = np.zeros(len(Kind), dtype=np.int64)
for _kind, _count in (
    (Kind.IMU, 6), (Kind.ATTITUDE, 4), (Kind.MAGNETIC_FIELD, 3), (Kind.GPS_POSITION, 3),
    (Kind.GPS_VELOCITY, 3), (Kind.AIRSPEED, 1), (Kind.ANGLE_OF_ATTACK, 1), (Kind.SIDESLIP, 1),
    (Kind.HEIGHT, 1), (Kind.FIVE_HOLE, 2),
):  # fmt: skip
    REQUIRED_VALUES[_kind] = _count

#: Beyond these magnitudes a value is no measurement of an aircraft but a fault of transmission, (kinds, WIDTH).
LARGEST_VALUES = np.full((len(Kind), WIDTH), np.inf)
for _kind, _limits in {
    Kind.IMU: [2000.0] * 3 + [200.0] * 3,
    Kind.ATTITUDE: [2.0] * 4,
    Kind.MAGNETIC_FIELD: [1e6] * 3,
    Kind.GPS_POSITION: [1.6, 6.3, 1e5],
    Kind.GPS_VELOCITY: [2000.0] * 3,
    Kind.AIRSPEED: [2000.0],
    Kind.ANGLE_OF_ATTACK: [3.2],
    Kind.SIDESLIP: [3.2],
    Kind.AIR: [10.0, 1e6],
    Kind.CONTROLS: [1.6] * 4 + [10.0, 1e7, 1e5],
    Kind.HEIGHT: [1e5],
    Kind.MASS: [1e7] + [1e10] * 4 + [1e3] * 3,
    Kind.FIVE_HOLE: [1e6] * 4,
}.items():
    LARGEST_VALUES[_kind, : len(_limits)] = _limits


@dataclass(frozen=True, eq=False)
class Samples:
    """n samples in order of arrival: ``stamp`` [ns] (n,), ``kind`` (n,) and ``values`` (n, WIDTH).

    Equal is what is the same object, so that a cache can have it as a key.
    """

    stamp: npt.NDArray[np.int64]
    kind: npt.NDArray[np.int64]
    values: npt.NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.stamp)

    def __getitem__(self, index: slice | npt.NDArray[np.int64] | npt.NDArray[np.bool_]) -> Samples:
        return Samples(self.stamp[index], self.kind[index], self.values[index])


def samples_of(kind: Kind, stamp: npt.ArrayLike, *columns: npt.ArrayLike | npt.NDArray[np.float64]) -> Samples:
    """Samples of one kind from stamps [ns] (n,) and columns, each (n,) or (n, k); the rest is NaN."""
    stamps = np.atleast_1d(np.asarray(stamp, dtype=np.int64))
    values = np.full((len(stamps), WIDTH), np.nan)
    at = 0
    for column in columns if len(stamps) else ():
        block = np.asarray(column, dtype=np.float64).reshape(len(stamps), -1)
        values[:, at : at + block.shape[1]] = block
        at += block.shape[1]
    return Samples(stamps, np.full(len(stamps), int(kind), dtype=np.int64), values)


def concatenate(batches: list[Samples]) -> Samples:
    """Join batches in the given order."""
    if not batches:
        return Samples(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, WIDTH)))
    if len(batches) == 1:
        return batches[0]
    return Samples(
        np.concatenate([b.stamp for b in batches]),
        np.concatenate([b.kind for b in batches]),
        np.concatenate([b.values for b in batches]),
    )


#: A manoeuvre of less [s] is of no use: the filter starts after a second of IMU and GPS, and a window needs time.
SHORTEST = 2.0
#: Time [s] between the end of a manoeuvre and the begin of the next one, at least: longer than a residual remembers.
PAUSE = 10.0
#: Time [s] between manoeuvres within which they are of one flight: the sensors have not been switched off.
SAME_FLIGHT = 3600.0
#: Stamps [ns] further from the middle of a recording than this are wrong.
_LONGEST = 24 * 3600 * 10**9
_SECOND = 10**9
#: So many samples of a flight may be days from the others; more are a clock that was set.
STRAYS = 10


def joined(parts: Sequence[Samples]) -> tuple[Samples, list[int]]:
    """Manoeuvres in the given order as one stream, a SEAM before each but the first, and what was added to the stamps
    of each [ns].

    Each begins ``PAUSE`` or up to a second more after the end of the one before, whatever day it was flown on: stamps
    move by whole seconds, so that what is sampled at multiples of a step is sampled at the same times of a manoeuvre
    in any order. How long there really was between them the SEAM says; of those that overlap nobody knows, since their
    clocks are not the same.
    """
    spans = [span(part) for part in parts]
    batches, shifts, end = [parts[0]], [0], spans[0][1]
    for part, (first, last), before in zip(parts[1:], spans[1:], spans, strict=False):
        shift = -((first - end - int(PAUSE * _SECOND)) // _SECOND) * _SECOND
        since = max(first - before[1], before[0] - last) / _SECOND
        at = first + shift - int(0.5 * PAUSE * _SECOND)
        batches += [samples_of(Kind.SEAM, [at], [since if since >= 0.0 else np.nan])]
        batches += [Samples(part.stamp + shift, part.kind, part.values)]
        shifts.append(shift)
        end = last + shift
    return concatenate(batches), shifts


def flight_at(samples: Samples) -> npt.NDArray[np.int64]:
    """Number from 0 of the flight of each sample (n,): another begins at a SEAM after more than SAME_FLIGHT, or NaN."""
    return np.cumsum((samples.kind == Kind.SEAM) & ~(samples.values[:, 0] <= SAME_FLIGHT))


def repeats(time: npt.NDArray[Any], values: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Which samples of one kind (n,), in order of ``time`` (n,), are the one before them once more, ``values`` (n, k)
    and all: of a topic that came twice.
    """
    repeated = np.zeros(len(time), np.bool_)
    again = 1 + np.flatnonzero(time[1:] == time[:-1])
    if len(again):
        repeated[again] = _are_equal(values[again], values[again - 1])
    return repeated


def _are_equal(new: npt.NDArray[np.float64], old: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Which rows (n, k) are the same."""
    return np.asarray(np.all((new == old) | (np.isnan(new) & np.isnan(old)), axis=1))


def without_repeats(samples: Samples) -> Samples:
    """Samples, as they arrived, without those that are there already, stamp and values and all."""
    order = np.lexsort((samples.stamp, samples.kind))  # stable: equals stay in the order of arrival
    again = 1 + np.flatnonzero((np.diff(samples.stamp[order]) == 0) & (np.diff(samples.kind[order]) == 0))
    again = again[_are_equal(samples.values[order[again]], samples.values[order[again - 1]])]
    keep = np.ones(len(samples), np.bool_)
    keep[order[again]] = False
    return samples if keep.all() else samples[keep]


def span(samples: Samples) -> tuple[int, int]:
    """First and last stamp [ns] that can be right: of the IMU, which is the clock, where there is one."""
    of_imu = samples.stamp[samples.kind == Kind.IMU]
    return first_and_last(of_imu if len(of_imu) else samples.stamp)


def with_mass_in_flight(samples: Samples) -> Samples:
    """Samples of one clock, in order of arrival, of which mass properties from before the flight are stamped when it
    begins, in their order, or a second before they arrive.

    A latched message is older than the flight by hours, or has no stamp: times would count from it.
    """
    masses, of_imu = np.flatnonzero(samples.kind == Kind.MASS), samples.kind == Kind.IMU
    clock = samples.stamp[of_imu]
    if not len(masses) or not len(clock) or np.count_nonzero(~are_sound(clock)) > STRAYS:
        return samples
    begin, end = first_and_last(clock)
    early = masses[samples.stamp[masses] < begin]
    if not len(early):
        return samples
    heard = of_imu & (samples.stamp >= begin) & (samples.stamp <= end)
    arrived = np.maximum.accumulate(np.where(heard, samples.stamp, begin))[early]
    rank = np.argsort(np.argsort(samples.stamp[early], kind="stable"), kind="stable")
    stamp = samples.stamp.copy()
    stamp[early] = np.maximum(begin - len(early) + rank, arrived - _SECOND)
    return Samples(stamp, samples.kind, samples.values)


def first_and_last(stamps: npt.NDArray[np.int64]) -> tuple[int, int]:
    """The first and the last of stamps [ns] (n,) of a recording that can be right."""
    sound = sound_stamps(stamps)
    return int(sound.min()), int(sound.max())


def sound_stamps(stamps: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Those of stamps [ns] (n,) of a recording that can be right: a driver may begin with one of 0."""
    return stamps[are_sound(stamps)]


def are_sound(stamps: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Which of stamps [ns] (n,) of a recording can be right."""
    if not len(stamps):
        return np.zeros(0, np.bool_)
    return np.asarray(np.abs(stamps - middle_stamp(stamps)) < _LONGEST)


def middle_stamp(stamps: npt.NDArray[np.int64]) -> int:
    """The middle one of stamps [ns] (n,): of two groups one of the later, and nothing between them."""
    return int(np.partition(stamps, len(stamps) // 2)[len(stamps) // 2])


def manoeuvres(samples: Samples) -> list[Samples]:
    """The samples between seams, in order of arrival: one part where there is no seam."""
    return _split(samples, np.flatnonzero(samples.kind == Kind.SEAM))


def manoeuvres_in_turn(samples: Samples) -> Iterator[tuple[float | None, Samples]]:
    """Each of the manoeuvres with the time [s] since the one before it, NaN where nobody knows; None for the first."""
    since = samples.values[samples.kind == Kind.SEAM, 0].tolist()
    return zip([None, *since], manoeuvres(samples), strict=True)


def flights(samples: Samples) -> list[Samples]:
    """The manoeuvres of each flight, with the seams between them: those that follow within ``SAME_FLIGHT``."""
    return _split(samples, np.flatnonzero(np.diff(flight_at(samples), prepend=0)))


def _split(samples: Samples, at: npt.NDArray[np.int64]) -> list[Samples]:
    edges = [-1, *at.tolist(), len(samples)]
    return [samples[begin + 1 : end] for begin, end in pairwise(edges)] if len(at) else [samples]


def fewer_manoeuvres(samples: Samples, longest: float) -> Samples:
    """Every first, second, third, … manoeuvre with the seams between them: about ``longest`` [s] at most in all."""
    spans = [span(part) for part in manoeuvres(samples)]
    every = max(int(np.ceil(sum(last - first for first, last in spans) / _SECOND / longest)), 1)
    return samples[np.cumsum(samples.kind == Kind.SEAM) % every == 0]


def manoeuvre_at(samples: Samples, stamp: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Number (n,) from 0 of the manoeuvre that each stamp [ns] lies in."""
    return np.asarray(np.searchsorted(samples.stamp[samples.kind == Kind.SEAM], stamp, side="right"), dtype=np.int64)


def with_run_numbers(samples: Samples, lengths: Sequence[int]) -> Samples:
    """Samples that ``joined`` made of runs with so many samples each: the seams between runs have the run's number."""
    values = samples.values.copy()
    for number in range(1, len(lengths)):
        values[sum(lengths[:number]) + number - 1, 1] = number
    return Samples(samples.stamp, samples.kind, values)


def run_of_manoeuvres(samples: Samples) -> npt.NDArray[np.int64]:
    """Number from 0 of the run that each manoeuvre is of: 0 where no runs were joined."""
    begun = np.nan_to_num(samples.values[samples.kind == Kind.SEAM, 1])
    return np.maximum.accumulate(np.concatenate([[0.0], begun])).astype(np.int64)


def same_imu(a: Samples, b: Samples) -> bool:
    """Whether two recordings hold the same IMU samples: what was fitted would be held out."""
    first, second = (samples[samples.kind == Kind.IMU] for samples in (a, b))
    _, i, j = np.intersect1d(first.stamp, second.stamp, return_indices=True)
    return bool(len(i)) and np.array_equal(first.values[i, :6], second.values[j, :6], equal_nan=True)


def is_absurd(samples: Samples) -> npt.NDArray[np.bool_]:
    """Which values (n, WIDTH) no aircraft has; NaN is not absurd."""
    return np.asarray(np.abs(samples.values) > LARGEST_VALUES[samples.kind])


#: Share of airspeeds below zero from which they are none, and how far below, over the usual largest, may be the zero of
#: a pitot at rest (MIT seaway: -4.4 m/s of 30).
_BELOW_ZERO, _AT_REST = 0.02, 0.25


def share_below_zero(airspeeds: npt.NDArray[np.float64]) -> float:
    """Share of airspeeds (n,) that no pitot reads; 0 where they are few enough, or near zero."""
    known = airspeeds[np.isfinite(airspeeds)]
    if not len(known):
        return 0.0
    share = float(np.mean(known < -_AT_REST * np.quantile(np.abs(known), 0.99)))
    return share if share > _BELOW_ZERO else 0.0
