"""What ArduPlane's System ID injected, by its own log messages: each sweep is a manoeuvre.

``AP_SystemID`` (ArduPlane/systemid.cpp of ArduPilot/ardupilot at 04713941) writes SIDS when a sweep begins, with its
axis ``Ax`` and the length ``TR`` [s], and SIDD with each sample of it, until it has ended or was ended.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.recordings.segment_list import Span
from aircraft_sysid_ros.stamps import NANOSECONDS

MESSAGES = ("SIDS", "SIDD")
#: Time [ns] that a manoeuvre has before its sweep and after it; two that are nearer share what is between them.
AROUND = 3 * NANOSECONDS
#: SIDD comes at the rate of the loop or a part of it: after such a pause [ns] a sweep has ended.
_PAUSE = NANOSECONDS
#: By Ax, as _AXIS of the source.
_AXES = (
    "none", "input roll angle", "input pitch angle", "input yaw angle", "recovery roll angle", "recovery pitch angle",
    "recovery yaw angle", "rate roll", "rate pitch", "rate yaw", "mixer roll", "mixer pitch", "mixer yaw",
    "mixer thrust",
)  # fmt: skip


def injections(tables: Mapping[str, Mapping[str, npt.NDArray[np.generic]]], start: int) -> list[Span]:
    """The sweeps of a log in order of time; ``start`` [ns] is the Unix time of its time 0."""
    settings = tables.get("SIDS", {})
    if not {"TimeUS", "Ax", "TR"} <= settings.keys():
        return []
    begins = _nanoseconds(settings["TimeUS"])
    samples = np.sort(_nanoseconds(tables.get("SIDD", {}).get("TimeUS", np.empty(0, np.int64))))
    order = np.argsort(begins, kind="stable")
    begins = begins[order]
    axes, lengths = np.asarray(settings["Ax"], np.int64)[order], np.asarray(settings["TR"], np.float64)[order]
    ends = [
        _end(int(begin), float(length), samples, int(until))
        for begin, length, until in zip(begins, lengths, [*begins[1:], np.iinfo(np.int64).max], strict=True)
    ]
    spans = []
    for k, (begin, end) in enumerate(zip(begins.tolist(), ends, strict=True)):
        first = max(begin - AROUND, (ends[k - 1] + begin) // 2 if k else begin - AROUND)
        last = min(end + AROUND, (end + int(begins[k + 1])) // 2 if k + 1 < len(begins) else end + AROUND)
        name = _AXES[axes[k]] if 0 <= axes[k] < len(_AXES) else f"axis {axes[k]}"
        spans.append(Span(f"sweep {k + 1} {name}", start + first, start + last))
    return spans


def _end(begin: int, length: float, samples: npt.NDArray[np.int64], until: int) -> int:
    """When a sweep ended [ns]: with its last sample, or by its length where none was kept."""
    of_it = samples[(samples >= begin) & (samples < until)]
    if not len(of_it):
        planned = begin + int(1e9 * length) if np.isfinite(length) and 0.0 < length < 1e4 else begin
        return min(planned, until)
    pauses = np.flatnonzero(np.diff(of_it) > _PAUSE)
    return int(of_it[pauses[0]] if len(pauses) else of_it[-1])


def _nanoseconds(microseconds: npt.NDArray[np.generic]) -> npt.NDArray[np.int64]:
    return np.asarray(microseconds, dtype=np.int64) * 1000
