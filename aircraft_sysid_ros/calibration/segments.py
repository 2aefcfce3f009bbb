"""Which parts of a flight a calibration rests on: Table 5 of the two-stage paper, found in the recording.

Stage 1 takes wind circles and pushover-pullups: they make xi1 (scale, bias, wind) well conditioned whatever xi2 is. The
paper's stage 2 takes the multisines, chirps and doublets alone; here it takes these and stage 1 together, since wind
and airspeed are best known from the circles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.calibration.navigation import Navigation
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.stretches import stretches

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Less flight [s] than this says too little.
SHORTEST = 30.0
#: Less change of heading [rad] than this, and wind and airspeed error are one number.
LEAST_TURN = np.radians(90.0)
#: A wind circle: the heading turns faster than this [rad/s], through at least this much [rad].
CIRCLE_RATE, CIRCLE_TURN = np.radians(5.0), np.radians(300.0)
#: A pushover-pullup: pitch and flight path change by more than this [rad] within a window [s], wings level [rad].
PUSH_PITCH, PUSH_WINDOW, LEVEL = np.radians(15.0), 6.0, np.radians(20.0)
_SMOOTHING = 2.0  # [s]
_SHORTEST_CIRCLES = 15.0  # [s] of stage 1


@dataclass(frozen=True)
class Segment:
    """A manoeuvre that was found: times [s] from the epoch of the navigation."""

    name: str
    begin: float
    end: float


@dataclass(frozen=True)
class Segments:
    """What n bins are used for: ``used`` in stage 2, ``first`` in stage 1, and the manoeuvres that were found."""

    used: Mask
    first: Mask
    found: tuple[Segment, ...]


def find_segments(navigation: Navigation, flying: Mask, step: float) -> Segments:
    """Segments of a flight on a grid of steps [s]; without a circle stage 1 takes all of it.

    Raises InputError when it is too short.
    """
    if flying.sum() * step < SHORTEST:
        raise InputError(
            f"only {flying.sum() * step:.0f} s of flight can be used and a calibration needs {SHORTEST:.0f} s: "
            "give a longer recording or a wider span"
        )
    c = navigation.rotation
    heading = _unwrapped(np.arctan2(c[:, 1, 0], c[:, 0, 0]), navigation.time, step)
    pitch, roll = np.arcsin(np.clip(-c[:, 2, 0], -1.0, 1.0)), np.arctan2(c[:, 2, 1], c[:, 2, 2])
    circles = _circles(navigation.time, heading, flying, step)
    pushes = _pushes(navigation.time, pitch, roll, flying, step)
    first = np.zeros(len(flying), dtype=bool)
    for segment in (*circles, *pushes):
        first |= (navigation.time >= segment.begin) & (navigation.time <= segment.end)
    first &= flying
    if not circles or first.sum() * step < _SHORTEST_CIRCLES:
        first = flying.copy()
    found = sorted([*circles, *pushes], key=lambda segment: segment.begin)
    return Segments(flying, first, tuple(found))


def turned_through(navigation: Navigation, used: Mask) -> float:
    """Largest difference of headings [rad] in the used part of a flight: at most a whole turn."""
    c = navigation.rotation[used]
    heading = np.sort(np.arctan2(c[:, 1, 0], c[:, 0, 0]))
    gaps = np.diff(np.append(heading, heading[0] + 2.0 * np.pi))
    return float(2.0 * np.pi - gaps.max())


def _unwrapped(angle: Array, time: Array, width: float) -> Array:
    """Continuous heading; jumps over a gap in time do not count as turning."""
    step = np.diff(angle, prepend=angle[0])
    step = (step + np.pi) % (2.0 * np.pi) - np.pi
    step[np.diff(time, prepend=time[0]) > 5.0 * width] = 0.0
    return np.cumsum(step)


def _circles(time: Array, heading: Array, flying: Mask, step: float) -> list[Segment]:
    rate = _smoothed(np.gradient(heading, time), _SMOOTHING / step)
    turning = [(rate > CIRCLE_RATE) & flying, (rate < -CIRCLE_RATE) & flying]
    return [
        Segment("wind circle", float(time[begin]), float(time[end - 1]))
        for mask in turning
        for begin, end in stretches(mask)
        if abs(heading[end - 1] - heading[begin]) >= CIRCLE_TURN
    ]


def _pushes(time: Array, pitch: Array, roll: Array, flying: Mask, step: float) -> list[Segment]:
    level = (np.abs(_smoothed(roll, _SMOOTHING / step)) < LEVEL) & flying
    half = round(0.5 * PUSH_WINDOW / step)
    window = np.lib.stride_tricks.sliding_window_view(np.pad(pitch, half, mode="edge"), 2 * half + 1)
    moving = (window.max(axis=1) - window.min(axis=1) > PUSH_PITCH) & level
    return [
        Segment("pushover-pullup", float(time[begin]), float(time[end - 1]))
        for begin, end in stretches(moving)
        if (end - begin) * step > 0.5 * PUSH_WINDOW
    ]


def _smoothed(values: Array, length: float) -> Array:
    """Moving mean over a number of samples."""
    width = min(2 * round(0.5 * length) + 1, len(values))
    padded = np.pad(values, width // 2, mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="same")[width // 2 : width // 2 + len(values)]
