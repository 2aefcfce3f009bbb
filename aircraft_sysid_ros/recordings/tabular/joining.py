"""Streams of different clocks on the stamps of one of them, a window of time after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.mavlink.quantities import quaternion_of_euler
from aircraft_sysid_ros.recordings.tabular.clock import Stamps
from aircraft_sysid_ros.recordings.tabular.streams import Stream
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]
#: Between samples that are further apart than so many of their usual steps nothing is interpolated.
_LONGEST_GAP = 3.5
_SHORTEST_LIMIT = 0.05 * NANOSECONDS


@dataclass(frozen=True)
class Window:
    """From ``start`` to before ``end`` [ns]."""

    start: int
    end: int

    def rows(self, stamp: Stamps) -> slice:
        """The rows of rising stamps (n,) in it."""
        first, last = np.searchsorted(stamp, (self.start, self.end))
        return slice(int(first), int(last))


def windows(streams: Sequence[Stream]) -> list[Window]:
    """Windows over all streams, in none of which a stream has more than ROWS rows."""
    chosen = sorted({stamp for stream in streams for stamp in stream.marks})
    end = max(stream.newest for stream in streams) + 1
    return [Window(start, stop) for start, stop in zip(chosen, [*chosen[1:], end], strict=True) if stop > start]


def value_at(stream: Stream, component: int, at: Stamps) -> Array:
    """A component (n,) at stamps (n,): as measured where it was, between neighbours linear, NaN across gaps.

    A longitude goes the short way, over 180 degrees too.
    """
    goes_round = stream.signals[component] == "longitude"
    stamp, found = _interpolated(stream, component, at, goes_round=goes_round)
    if goes_round:
        found = np.where(np.abs(found) > np.pi, np.mod(found + np.pi, 2.0 * np.pi) - np.pi, found)
    return np.where(_is_near(stamp, at, stream.step_of(component)), found, np.nan) if len(stamp) else found


def slow_value_at(stream: Stream, component: int, at: Stamps) -> Array:
    """The same of what changes slowly, such as the temperature of the air: across gaps, and at the ends the last."""
    return _interpolated(stream, component, at, at_ends=None)[1]


def _interpolated(
    stream: Stream, component: int, at: Stamps, *, at_ends: float | None = np.nan, goes_round: bool = False
) -> tuple[Stamps, Array]:
    """Stamps (m,) near those asked for (n,) at which a component is measured, and its values (n,) between these."""
    if not len(at):
        return np.empty(0, np.int64), np.empty(0)
    stamp, first, last = _around(stream, at)
    values = np.array(stream.values[first:last, component])
    known = np.isfinite(values)
    stamp, values = stamp[known], values[known]
    if not len(stamp):
        return stamp, np.full(len(at), np.nan)
    if goes_round:
        values = np.unwrap(values)
    zero = int(at[0])
    return stamp, np.interp(at - zero, stamp - zero, values, left=at_ends, right=at_ends)


def attitude_at(stream: Stream, at: Stamps, before: int) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Quaternions (n, 4) FRD to NED at stamps (n,), and where there is one: once for every sample of ``stream``.

    A sample goes to the first of the stamps that is not before it, carried there between its neighbours. ``before``
    is the stamp before the first.
    """
    quaternions, there = np.full((len(at), 4), np.nan), np.zeros(len(at), dtype=bool)
    if not len(at):
        return quaternions, there
    stamp, first, last = _around(stream, at)
    euler = np.array(stream.values[first:last])
    whole = np.isfinite(euler).all(axis=1)
    stamp, euler = stamp[whole], euler[whole]
    if not len(stamp):
        return quaternions, there
    counts = np.searchsorted(stamp, np.concatenate([[before], at]), side="right")
    there = (np.diff(counts) > 0) & _is_near(stamp, at, stream.step)
    samples = quaternion_of_euler(euler)
    after = np.minimum(np.searchsorted(stamp, at[there]), len(stamp) - 1)
    prior = np.maximum(after - (stamp[after] > at[there]), 0)
    span = np.maximum(stamp[after] - stamp[prior], 1)
    share = ((at[there] - stamp[prior]) / span)[:, None]
    ends = samples[after] * np.where(np.sum(samples[after] * samples[prior], axis=1) < 0.0, -1.0, 1.0)[:, None]
    joined = np.where(share > 0.0, samples[prior] + share * (ends - samples[prior]), samples[prior])
    joined = np.where((stamp[after] == at[there])[:, None], samples[after], joined)
    quaternions[there] = joined / np.linalg.norm(joined, axis=1, keepdims=True)
    return quaternions, there


def _around(stream: Stream, at: Stamps) -> tuple[Stamps, int, int]:
    """Stamps of a stream from one before to one after the stamps asked for, and where they are."""
    first = max(int(np.searchsorted(stream.stamp, at[0], side="right")) - 2, 0)
    last = min(int(np.searchsorted(stream.stamp, at[-1])) + 2, len(stream.stamp))
    return np.array(stream.stamp[first:last]), first, last


def _is_near(stamp: Stamps, at: Stamps, step: float) -> npt.NDArray[np.bool_]:
    """Whether a stamp (n,) is one of ``stamp``, or between two that are no gap apart."""
    after = np.searchsorted(stamp, at)
    inside = after < len(stamp)
    exact = inside & (stamp[np.minimum(after, len(stamp) - 1)] == at)
    between = inside & (after > 0)
    gap = stamp[np.minimum(after, len(stamp) - 1)] - stamp[np.maximum(after - 1, 0)]
    return exact | (between & (gap <= max(_LONGEST_GAP * step, _SHORTEST_LIMIT)))
