"""A flight cut into pieces: unstable modes and drift do not spoil a simulation of some seconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aircraft_sysid_ros.refinement.record import FlightRecord
from aircraft_sysid_ros.stretches import stretches


@dataclass(frozen=True)
class Segment:
    """Steps ``part`` of a record, one after the other without a gap."""

    part: slice
    held_out: bool


def segments_of(record: FlightRecord, length: float, held_out: float) -> list[Segment]:
    """Flight cut into pieces of about ``length`` [s], each followed by one of ``held_out`` [s] that is not fitted."""
    steady = np.diff(record.time) < 1.5 * record.longest_step
    found: list[Segment] = []
    for begin, end in stretches(record.in_flight):
        cuts = begin + 1 + np.flatnonzero(~steady[begin : end - 1])
        for a, b in zip([begin, *cuts], [*cuts, end], strict=True):
            found += _cut(int(a), int(b), round(length / record.step), round(held_out / record.step))
    return found


def _cut(begin: int, end: int, fit: int, hold: int) -> list[Segment]:
    """Pieces of one uninterrupted stretch: equal in length, so that the last is not too short."""
    count = max(round((end - begin + hold) / (fit + hold)), 1)
    length = (end - begin + hold) / count
    pieces = []
    for k in range(count):
        first = begin + round(k * length)
        last = min(begin + round((k + 1) * length), end + hold)
        if last - hold - first >= fit // 4:
            pieces.append(Segment(slice(first, last - hold), False))
            if last <= end:
                pieces.append(Segment(slice(last - hold, last), True))
    return pieces
