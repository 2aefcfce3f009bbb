"""An airspeed that reads otherwise at some times, by the speed over ground in one steady wind.

A pitot tube that leaks makes dynamic pressure, and every coefficient with it, another one from one time on: that is no
moment that some input makes. With k for the airspeed that GPS and a wind w say, over the one that is read,

    |v - w| = k V,    k = k1 outside and k2 inside of the times,

is solved for w, k1 and k2 by least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.failures.episode import Times
from aircraft_sysid_ros.flight_check.steady_wind import (
    LEAST_DIFFERENCE,
    Blocks,
    block_sums,
    blocks_of,
    difference_of_courses,
)
from aircraft_sysid_ros.samples import Kind, Samples, are_sound

Array = npt.NDArray[np.float64]

#: ln of the ratio from which it is told, and its standard errors. In eleven flights of a stranger it was 0.03 and 2.9
#: at most where the airspeed was as before, and 0.12 and 19 at least where it read 0.88 of that.
LEAST, SURE = 0.05, 8.0
#: Lowest and highest ratio that a tube may make; beyond, the wind was not told.
POSSIBLE = (0.5, 1.6)
#: Time [s] about a begin or an end that is left out, and share of the usual airspeed below which it does not fly.
_BESIDE, _FLYING = 2.0, 0.5
#: How far about the time that moments have [s] the begin of a lasting step is looked for, and how finely.
SEARCHED, _GRID = 60.0, 5.0
#: Twice the ln of the likelihood that two standard errors cost.
_TWO_SIGMA = 4.0
_NOTHING = 1e-12  # [m^2/s^2] that is left of speeds without noise
#: Blocks that are needed within the times and in the rest, and steps of least squares.
_FEWEST, _STEPS = 2, 20


class AirspeedStep(NamedTuple):
    """What the airspeed reads at some times, over what it reads at others."""

    ratio: float
    std: float
    times: tuple[Times, ...]  # those that were asked, or from when on the airspeed itself has it


def airspeed_step(samples: Samples, times: Sequence[Times], zero: int | None = None) -> AirspeedStep | None:
    """The step at some times [s from stamp ``zero`` [ns], else the first sample of the IMU]; None: small or not sure.

    What goes on to the end of the flight began when the speeds say so, within SEARCHED of what was asked.
    """
    samples = samples[are_sound(samples.stamp)]
    imu = samples.stamp[samples.kind == Kind.IMU]
    if not len(imu):
        return None
    seconds = (samples.stamp - (imu.min() if zero is None else zero)) * 1e-9
    air, ground = samples.kind == Kind.AIRSPEED, samples.kind == Kind.GPS_VELOCITY
    air &= np.isfinite(samples.values[:, 0])
    ground &= np.isfinite(samples.values[:, :3]).all(axis=1)
    if np.count_nonzero(air) < 2 or np.count_nonzero(ground) < 2:
        return None
    time, velocity = seconds[ground], samples.values[ground, :3]
    read = np.interp(time, seconds[air], samples.values[air, 0])
    known = read > _FLYING * np.median(read)
    time, velocity, read = time[known], velocity[known], read[known]
    told = _told(time, velocity, read, times)
    if len(times) > 1 or times[0].end is not None:
        return told
    begin = _begin(time, velocity, read, times[0].begin)
    if begin is None or (told is not None and abs(begin.begin - times[0].begin) <= begin.begin_error):
        return told
    return _told(time, velocity, read, (begin,)) or told


def _begin(time: Array, velocity: Array, read: Array, about: float) -> Times | None:
    """From when on the airspeed has a step that lasts, about a time [s]; None where it may be farther from that.

    Its error is half of the span in which begins are as likely as two standard errors allow; a block of the residuals
    counts as one measurement.
    """
    begins = about + np.arange(-SEARCHED, SEARCHED + 1.0, _GRID)
    left = np.array([_misfit(time, velocity, read, float(begin)) for begin in begins])
    best = int(np.argmin(left))
    if not np.isfinite(left[best]):
        return None
    likely = np.flatnonzero(len(np.unique(blocks_of(time))) * np.log(left / max(left[best], _NOTHING)) <= _TWO_SIGMA)
    if likely[0] == 0 or likely[-1] == len(begins) - 1 or not np.isfinite(left[[likely[0] - 1, likely[-1] + 1]]).all():
        return None
    span = max(begins[likely[-1]] - begins[likely[0]], 2.0 * _GRID)
    return Times(float(begins[best]), None, float(span / 2.0), 0.0)


def _told(time: Array, velocity: Array, read: Array, times: Sequence[Times]) -> AirspeedStep | None:
    """The step at some times, of speeds in flight; None where it is small or not sure."""
    edges = np.array([edge for each in times for edge in (each.begin, each.end) if edge is not None])
    known = np.all(np.abs(time[:, None] - edges) > _BESIDE, axis=1)
    time, velocity, read = time[known], velocity[known], read[known]
    inside = np.any([(time > t.begin) & (time < (np.inf if t.end is None else t.end)) for t in times], axis=0)
    blocks, course = blocks_of(time), velocity[:, 0] + 1j * velocity[:, 1]
    if min(len(np.unique(blocks[inside])), len(np.unique(blocks[~inside]))) < _FEWEST:
        return None
    if max(difference_of_courses(course[inside]), difference_of_courses(course[~inside])) < LEAST_DIFFERENCE:
        return None
    ratio, std, _ = _step(velocity, read, inside, blocks)
    is_told = POSSIBLE[0] < ratio < POSSIBLE[1] and abs(np.log(ratio)) > max(LEAST, SURE * std)
    return AirspeedStep(ratio, ratio * std, tuple(times)) if is_told else None


def _misfit(time: Array, velocity: Array, read: Array, begin: float) -> float:
    """What a step from one time on leaves (sum of squares); infinite where one side of it is short."""
    inside, blocks = time > begin, blocks_of(time)
    if min(len(np.unique(blocks[inside])), len(np.unique(blocks[~inside]))) < _FEWEST:
        return np.inf
    return _step(velocity, read, inside, blocks)[2]


def _step(velocity: Array, read: Array, inside: npt.NDArray[np.bool_], blocks: Blocks) -> tuple[float, float, float]:
    """k1 / k2, which is what is read inside over what is read outside, the standard error of its logarithm, and the sum
    of squares that is left.
    """
    found = np.array([0.0, 0.0, 1.0, 1.0])
    for _ in range(_STEPS):
        through = velocity - np.array([*found[:2], 0.0])
        speed = np.linalg.norm(through, axis=1)
        left = speed - read * np.where(inside, found[3], found[2])
        slopes = np.column_stack([-through[:, :2] / speed[:, None], -read * ~inside, -read * inside])
        found = found - np.linalg.lstsq(slopes, left, rcond=None)[0]
    inverse = np.linalg.pinv(slopes.T @ slopes)
    scores = block_sums(slopes * left[:, None], blocks)
    covariance = inverse @ scores.T @ scores @ inverse
    of_log = np.array([0.0, 0.0, 1.0 / found[2], -1.0 / found[3]])
    return float(found[2] / found[3]), float(np.sqrt(of_log @ covariance @ of_log)), float(left @ left)
