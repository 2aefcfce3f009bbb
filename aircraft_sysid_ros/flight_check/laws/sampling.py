"""Times of the samples: rate, gaps, jitter, stamps that go back, and clocks that differ from the recorder's."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, WARNING, Finding
from aircraft_sysid_ros.flight_check.signals import Flight, Stream, groups, signal_names
from aircraft_sysid_ros.reconstruction.alignment import LARGEST_GAP
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

#: A gap is an interval longer than so many of its own; worth a warning beyond [s], or with a share lost.
_GAP, _LONG_GAP, _LOST = 2.5, 1.0, 0.02
#: Intervals' spread (half of the 5th to 95th percentile) over their median: information, warning.
_JITTER, _MUCH_JITTER = 0.25, 0.6
#: Ends of a stream away from those of the recording: at least [s] and share.
_ENDS, _END_SHARE = 5.0, 0.05
#: A rate that changes: blocks of the flight, and their ratio.
_BLOCKS, _RATE_CHANGE = 8, 1.5
#: IMU rates [Hz] below which the short motions of small aeroplanes blur.
_SLOW_IMU = 40.0
#: Clocks: delays from stamp to arrival [s] that differ, and drift [s] over the flight.
_CLOCKS, _DRIFT = 1.0, 0.05


def findings(flight: Flight) -> list[Finding]:
    """Of every stream."""
    found = []
    for stream in flight.every_stream:
        names = tuple(name for name, _ in signal_names(stream))
        if len(stream.time) < 3 or not names:
            found += _order(stream, stream.names) if stream.away else []
            continue
        found += _order(stream, names) + _jitter(stream, names) + _rate(stream, names)
        for group, columns in groups(stream) if stream.kind != Kind.MASS else ():
            measured = tuple(name for name in group if name in names)
            if measured:
                found += _gaps(flight, stream, measured, columns)
    return found + _clocks(flight)


def _gaps(flight: Flight, stream: Stream, names: tuple[str, ...], columns: slice) -> list[Finding]:
    """Silences, and ends before the recording's."""
    time = stream.time[np.any(np.isfinite(stream.values[:, columns]), axis=1)]
    steps = np.diff(time)
    if not np.any(steps > 0.0):
        return []
    own = float(np.median(steps[steps > 0.0]))
    long = np.flatnonzero(steps > _GAP * own)
    found = []
    if len(long):
        lost = float(np.sum(steps[long] / own - 1.0)) / (len(time) + float(np.sum(steps[long] / own - 1.0)))
        longest = long[np.argmax(steps[long])]
        severity = WARNING if steps[longest] > max(_LONG_GAP, 4.0 * own) or lost > _LOST else INFO
        places = f"{len(long)} gaps" if len(long) > 1 else "a gap"
        of_up_to = "of up to" if len(long) > 1 else "of"
        found.append(Finding(
            names, "gap", severity,
            f"{places} {of_up_to} {steps[longest]:.2f} s (at {time[longest]:.1f} s) at a rate of {1.0 / own:.3g} Hz, "
            f"{100 * lost:.1f} % of the samples are lost: what happened there cannot be known, leave it out of a fit",
        ))  # fmt: skip
    least = max(_ENDS, _END_SHARE * flight.duration, 10.0 * own)
    if time[0] > least or flight.duration - time[-1] > least:
        found.append(Finding(
            names, "gap", WARNING,
            f"there from {time[0]:.1f} to {time[-1]:.1f} s of the {flight.duration:.1f} s of the recording: "
            "cut the recording to where all sensors work, or expect nothing outside that",
        ))  # fmt: skip
    return found


def _order(stream: Stream, names: tuple[str, ...]) -> list[Finding]:
    same = int(np.sum(np.diff(stream.time) == 0.0))
    found = []
    if stream.away:
        found.append(Finding(
            names, "jitter", ERROR,
            f"{stream.away} samples are stamped more than half a day from the rest of the recording and are left out: "
            "set the clock of the sensor, or stamp on arrival",
        ))  # fmt: skip
    if stream.disordered:
        severity = WARNING if stream.disordered > 1e-3 * len(stream.time) else INFO
        found.append(Finding(
            names, "jitter", severity,
            f"{stream.disordered} samples are stamped earlier than the one before them: correct the clock of the "
            "sensor, or stamp on arrival",
        ))  # fmt: skip
    if same == len(stream.time) - 1 > 0:
        found.append(Finding(
            names, "jitter", ERROR,
            f"all {len(stream.time)} samples have the same stamp: let the driver stamp each when it is measured "
            "(header.stamp), nothing can be estimated without",
        ))  # fmt: skip
    elif same > 0.01 * len(stream.time):
        found.append(Finding(
            names, "jitter", WARNING,
            f"{same} of {len(stream.time)} samples have the stamp of the one before: the stamps are too coarse for "
            f"{stream.rate:.3g} Hz, record them in ns",
        ))  # fmt: skip
    elif stream.repeated > 0.01 * len(stream.time):
        found.append(Finding(
            names, "jitter", WARNING,
            f"{stream.repeated} of {len(stream.time) + stream.repeated} samples have stamp and values of the one "
            "before, and count once: is the topic recorded twice, or sent by two programs?",
        ))  # fmt: skip
    return found


def _spread(steps: Array) -> float:
    """Half of the range of nine in ten intervals over their median, gaps left out."""
    steps = steps[(steps > 0.0) & (steps < _GAP * np.median(steps))]
    return float((np.percentile(steps, 95) - np.percentile(steps, 5)) / (2.0 * np.median(steps))) if len(steps) else 0.0


def _jitter(stream: Stream, names: tuple[str, ...]) -> list[Finding]:
    steps = np.diff(stream.time)
    if len(steps) < 20 or not np.any(steps > 0.0):
        return []
    spread = _spread(steps)
    if spread < _JITTER:
        return []
    arrivals = np.diff(np.sort(stream.time + stream.delay))
    better = np.any(arrivals > 0.0) and _spread(arrivals) < 0.5 * spread
    remedy = "the arrivals are more even: stamp on arrival" if better else "stamp where the sensor samples"
    low, high = np.percentile(steps, [5, 95])
    return [Finding(
        names, "jitter", WARNING if spread > _MUCH_JITTER else INFO,
        f"nine in ten intervals between stamps lie between {1e3 * low:.1f} and {1e3 * high:.1f} ms about a median of "
        f"{1e3 * stream.interval:.1f} ms: {remedy}",
    )]  # fmt: skip


def _rate(stream: Stream, names: tuple[str, ...]) -> list[Finding]:
    """A rate that changes in flight, and an IMU that is slow for moments."""
    found = []
    blocks = [np.diff(part) for part in np.array_split(stream.time, _BLOCKS)]
    rates = [1.0 / np.median(steps) for steps in blocks if len(steps) >= 20 and np.median(steps) > 0.0]
    if rates and max(rates) > _RATE_CHANGE * min(rates):
        found.append(Finding(
            names, "rate", WARNING,
            f"the rate changes between {min(rates):.3g} and {max(rates):.3g} Hz during the flight: look for an "
            "overloaded link or recorder, and state the noise for the slower rate",
        ))  # fmt: skip
    if stream.kind == Kind.IMU and stream.interval > LARGEST_GAP:
        found.append(Finding(
            names, "rate", ERROR,
            f"{stream.rate:.3g} Hz: the filter needs samples that are at most {LARGEST_GAP:g} s apart, so that replay "
            "cannot start: check the unit of the time in the import map, or record faster",
        ))  # fmt: skip
    elif stream.kind == Kind.IMU and stream.rate < _SLOW_IMU:
        found.append(Finding(
            names, "rate", INFO,
            f"{stream.rate:.3g} Hz: moments are derivatives of body rates, and motions faster than "
            f"{stream.rate / 5.0:.2g} Hz are blurred; record 50 Hz or more for the derivatives of the short period",
        ))  # fmt: skip
    return found


def _clocks(flight: Flight) -> list[Finding]:
    """Streams whose time from stamp to arrival differs from the others', or drifts."""
    streams = [s for s in flight.every_stream if len(s.time) >= 10]
    if not streams:
        return []
    middles = [float(np.median(s.delay)) for s in streams]
    common = float(np.median([*{s.kind: m for s, m in zip(streams, middles, strict=True)}.values()]))
    found = []
    for stream, middle in zip(streams, middles, strict=True):
        names = tuple(name for name, _ in signal_names(stream))
        third = max(len(stream.delay) // 3, 1)
        drift = float(np.median(stream.delay[-third:]) - np.median(stream.delay[:third])) * 1.5
        if abs(middle - common) > _CLOCKS:
            found.append(Finding(
                names, "offset", WARNING,
                f"from stamp to arrival {middle:.2f} s pass, with the other sensors {common:.2f} s: its clock is not "
                "theirs, synchronise them",
            ))  # fmt: skip
        elif abs(drift) > max(_DRIFT, 3.0 * float(np.percentile(stream.delay, 90) - np.percentile(stream.delay, 50))):
            found.append(Finding(
                names, "offset", WARNING,
                f"the time from stamp to arrival drifts by {drift:.2f} s over the recording: its clock runs at a "
                "different rate from the recorder's, synchronise them",
            ))  # fmt: skip
    return found
