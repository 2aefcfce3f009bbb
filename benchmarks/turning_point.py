"""GPS and airspeed of a point that turns in a wind: flights without anything of the program in them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.samples import Kind, Samples, concatenate, samples_of

Array = npt.NDArray[np.float64]

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND + 123_456_789
#: Airs and tracks, as what ``flown`` is given.
AIRS: dict[str, dict[str, Any]] = {
    "circles": {}, "gusts of 2 m/s": {"gust": 2.0}, "a climb through a shear": {"climb": 2.0},
    "a front": {"front": 5.0}, "wide circles": {"turn": 4.0}, "straight, a front": {"turn": 0.0, "front": 5.0},
}  # fmt: skip


def flown(
    seed: int,
    duration: float = 240.0,
    scale: Callable[[Array], Array] = np.ones_like,
    turn: float = 10.0,
    gust: float = 0.5,
    climb: float = 0.0,
    front: float = 0.0,
    speed: float = 18.0,
) -> Samples:
    """Samples of GPS at 5 Hz and airspeed at 20 Hz: circles of ``turn`` [deg/s], every other minute straight.

    The wind wanders, shears with height (``climb`` [m/s]), has gusts and a ``front`` [m/s] in the middle; gusts are in
    the airspeed at once, and by and by in the speed over ground, since the airspeed is held.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 0.05)
    course = np.cumsum(np.radians(turn) * (time % 60.0 < 40.0)) * 0.05 + rng.uniform(0.0, 6.0)
    slow = np.cumsum(rng.normal(0.0, 0.1 * np.sqrt(0.05), (len(time), 2)), axis=0) + rng.normal(0.0, 4.0, 2)
    slow += np.outer(climb * time, [0.02, -0.01]) + front * np.outer(time > duration / 2.0, [0.8, 0.6])
    gusts, along = np.zeros(len(time)), np.zeros(len(time))
    for i in range(1, len(time)):
        gusts[i] = gusts[i - 1] * (1.0 - 0.05 / 15.0) + gust * np.sqrt(0.1 / 15.0) * rng.normal()
        along[i] = along[i - 1] + 0.05 / 10.0 * (gusts[i] - along[i - 1])  # of the gust, what the aeroplane follows
    still = speed + 1.5 * np.sin(2.0 * np.pi * time / 70.0)
    heading = np.column_stack([np.cos(course), np.sin(course)])
    airspeed = still + gusts - along  # against the air: a gust from ahead is more at once
    velocity = np.column_stack([heading * (still - along)[:, None] + slow, np.full(len(time), -climb)])
    shown = scale(time) * np.sqrt(airspeed**2 + climb**2) + 0.3 * rng.normal(size=len(time))
    stamps = START + np.rint(time * SECOND).astype(np.int64)
    fixes = velocity[::4] + 0.1 * rng.normal(size=(len(time[::4]), 3))
    both = concatenate([samples_of(Kind.AIRSPEED, stamps, shown), samples_of(Kind.GPS_VELOCITY, stamps[::4], fixes)])
    return both[np.argsort(both.stamp, kind="stable")]
