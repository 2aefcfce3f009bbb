"""A flight with one fault, or with what is stuck, taken out, so that what is left is judged without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler, quaternion_product
from aircraft_sysid_ros.flight_check.signals import ATTITUDE, KIND_OF, NAMES, VELOCITY, Flight, Stream, groups
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]


def with_factor(flight: Flight, signal: str, factor: float) -> Flight:
    """A signal times a factor; of an angle of the attitude only its sign can be changed."""
    kind = KIND_OF[signal]
    stream = flight.streams[kind]
    values = stream.values.copy()
    if kind == Kind.ATTITUDE:
        values = _mirrored(values, ATTITUDE.index(signal)) if factor < 0.0 else values
    else:
        values[:, NAMES[kind].index(signal)] *= factor
    return _with_stream(flight, replace(stream, values=values))


def _mirrored(quaternions: Array, angle: int) -> Array:
    """Attitudes (n, 4) with the sign of one Euler angle changed."""
    out = np.empty_like(quaternions)
    for i, (w, x, y, z) in enumerate(quaternions):
        euler = [
            np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            np.arcsin(min(max(2.0 * (w * y - x * z), -1.0), 1.0)),
            np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ]
        euler[angle] = -euler[angle]
        out[i] = quaternion_from_euler(*euler)
    return out


def with_columns(flight: Flight, follows: Mapping[str, str]) -> Flight:
    """Signals of a stream, or of streams of one signal each, in the places of those that they follow."""
    streams = dict(flight.streams)
    for signal, place in follows.items():
        source, kind = flight.streams[KIND_OF[signal]], KIND_OF[place]
        if source.kind != kind:
            streams[kind] = replace(source, kind=kind)
            continue
        values = streams[kind].values.copy()
        values[:, NAMES[kind].index(place)] = source.values[:, NAMES[kind].index(signal)]
        streams[kind] = replace(streams[kind], values=values)
    return replace(flight, streams=streams)


def with_delay(flight: Flight, names: tuple[str, ...], delay: float) -> Flight:
    """The streams of some signals stamped earlier by ``delay`` [s]."""
    for kind in {KIND_OF[name] for name in names}:
        stream = flight.streams[kind]
        flight = _with_stream(flight, replace(stream, time=stream.time - delay))
    return flight


def with_yaw(flight: Flight, angle: float) -> Flight:
    """The attitude turned about the vertical by ``angle`` [rad]."""
    stream = flight.streams[Kind.ATTITUDE]
    turn = quaternion_from_euler(0.0, 0.0, angle)
    values = np.array([quaternion_product(turn, q) for q in stream.values])
    return _with_stream(flight, replace(stream, values=values))


#: Fewer samples (`values`) do not tell that something is stuck; controls stand as they like.
LEAST_SAMPLES = 20
_FREE = (Kind.CONTROLS, Kind.MASS)


def without_stuck(flight: Flight) -> Flight:
    """The flight without the signals of sensors that stay at one value all the time, which measure nothing.

    A velocity or an attitude is left as it is while a part of it moves: GPS may have no vertical speed.
    """
    for kind, stream in flight.streams.items():
        if kind in _FREE:
            continue
        stuck = [_stays(values) for values in stream.values.T]
        for names, columns in groups(stream):
            if names in (ATTITUDE, VELOCITY):
                stuck[columns] = [all(stuck[columns])] * len(stuck[columns])
        if any(stuck):
            flight = _with_stream(flight, replace(stream, values=np.where(stuck, np.nan, stream.values)))
    return flight


def _stays(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return len(known) >= LEAST_SAMPLES and float(np.ptp(known)) == 0.0


def _with_stream(flight: Flight, stream: Stream) -> Flight:
    return replace(flight, streams={**flight.streams, stream.kind: stream})
