"""The values of one signal on its own: held, saturated, spikes, coarse, no numbers, beyond what an aeroplane has."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import euler_angles
from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, WARNING, Finding
from aircraft_sysid_ros.flight_check.grid import spikes
from aircraft_sysid_ros.flight_check.repair import LEAST_SAMPLES
from aircraft_sysid_ros.flight_check.signals import (
    ATTITUDE,
    COMMANDED,
    GEODETIC,
    INPUTS,
    SURFACES,
    Flight,
    Stream,
    groups,
    interpolated_length,
)
from aircraft_sysid_ros.samples import LARGEST_VALUES, Kind, share_below_zero
from aircraft_sysid_ros.stretches import stretches

Array = npt.NDArray[np.float64]

#: Kinds of which a sample is used whole or not at all, and the share of values that may lack without a word.
_WHOLE, _LACKS = (Kind.IMU, Kind.GPS_VELOCITY), 0.01
#: A flat top: samples at the extreme in the longest run, in all, and against the next value beside it.
LEAST_RUN, _FLAT, _TIMES = 4, 8, 3.0
#: Share of spikes that is worth a warning.
_SPIKES = 2e-4
#: An IMU of less [Hz] may lose all of a quick motion but one value; by so much of their range a fault is beyond others.
_SLOW_IMU, _BEYOND = 20.0, 0.5
#: Steps of the resolution over the spread of the signal.
_COARSE = 0.2
#: Surfaces further than this [rad] are in degrees; throttles above are in per cent.
_SURFACE, _THROTTLE = 1.25, 1.5
#: Surfaces that an aeroplane cannot be flown without moving, if it has them.
_TURNING = ("elevator", "aileron", "rudder")
#: By so much [deg] angles that stay differ after they were a quaternion.
_ROUNDING = 1e-9
#: Where zero is the end of the scale, at rest, and what is largest at the lowest place, the ground.
_FROM_ZERO = ("true_airspeed", "dynamic_pressure", "height_above_ground")
_FROM_GROUND = ("static_pressure", "air_density")


def findings(flight: Flight) -> list[Finding]:
    """Of every signal."""
    found = []
    for kind, stream in flight.streams.items():
        if kind == Kind.MASS or len(stream.time) < LEAST_SAMPLES:
            continue
        for names, columns in groups(stream):
            found += held(names, stream, columns) or _interpolated(names, stream, columns)
            found += _unusable(names, stream)
            if names == ATTITUDE:
                found += _still_angles(stream)
                continue
            for name, column in zip(names, range(columns.start, columns.stop), strict=True):
                found += _one(name, kind, stream, column)
    return found


def _still_angles(stream: Stream) -> list[Finding]:
    """Euler angles that stay all the time, but for rounding."""
    known = stream.values[np.all(np.isfinite(stream.values), axis=1)]
    if len(known) < LEAST_SAMPLES:
        return []
    angles = zip(ATTITUDE, np.degrees(euler_angles(known)).T, strict=True)
    return [_stuck(name, angle[0], "°") for name, angle in angles if np.ptp(angle) < _ROUNDING]


def _stuck(name: str, value: float, unit: str = "") -> Finding:
    text = f"it stays at {value + 0.0:.4g}{unit} all the time: the sensor is stuck or not connected"  # no -0
    return Finding((name,), "held", WARNING, text)


def held(names: tuple[str, ...], stream: Stream, columns: slice) -> list[Finding]:
    """A slower signal of which each value is repeated; commands of an engine may stand as they like."""
    hold = stream.hold(columns)
    if hold == 1.0 or names[0] in ("throttle", "thrust", "propeller_speed", "flaps"):
        return []
    return [Finding(
        names, "held", WARNING,
        f"each value is repeated {hold:.1f} times: at {stream.rate:.3g} Hz there are {stream.rate / hold:.3g} "
        "new ones a second, and the values between are wrong; record the sensor's own samples at their own times",
    )]  # fmt: skip


def _interpolated(names: tuple[str, ...], stream: Stream, columns: slice) -> list[Finding]:
    lengths = [interpolated_length(stream.time, values) for values in stream.values[:, columns].T]
    if names[0] in COMMANDED or min(lengths) == 1.0:
        return []
    length = float(np.median(lengths))
    return [Finding(
        names, "held", WARNING,
        f"it lies on straight lines between one of {length:.2g} samples and the next: at {stream.rate:.3g} Hz "
        f"{stream.rate / length:.3g} a second were measured, and one error counts {length:.2g} times; record the "
        "sensor's own samples, or leave out what is between them",
    )]  # fmt: skip


def _unusable(names: tuple[str, ...], stream: Stream) -> list[Finding]:
    total = len(stream.time) + stream.unusable
    if stream.unusable < _LACKS * total:
        return []
    return [Finding(
        names, "missing", WARNING,
        f"{stream.unusable} of {total} samples are not numbers or are marked invalid: find out why",
    )]  # fmt: skip


def _one(name: str, kind: Kind, stream: Stream, column: int) -> list[Finding]:
    known = np.isfinite(stream.values[:, column])
    values = stream.values[known, column]
    if len(values) < LEAST_SAMPLES:
        return []
    absurd = int(np.sum(np.abs(values) > LARGEST_VALUES[kind, column]))
    if name in COMMANDED:
        return _commanded(name, values)
    found = _negative(values) if name == "true_airspeed" else []
    lacks = len(known) - len(values)
    if kind in _WHOLE and lacks >= _LACKS * len(known):
        found.append(Finding(
            (name,), "missing", WARNING,
            f"{lacks} of {len(known)} values are not numbers, and the samples that hold them are not used: find out "
            "why",
        ))  # fmt: skip
    if absurd > 0 and np.percentile(np.abs(values), 95) < 0.1 * LARGEST_VALUES[kind, column]:
        found.append(Finding(
            (name,), "noise", WARNING,
            f"{absurd} of {len(values)} values are beyond what any aircraft has (up to {np.abs(values).max():.3g}): "
            "transmission faults, which are left out",
        ))  # fmt: skip
    if np.ptp(values) == 0.0:
        return [*found, _stuck(name, values[0])]
    fresh = values[np.concatenate([[True], np.diff(values) != 0.0])]
    found += saturated(name, values, stream.time[known]) if name not in GEODETIC else []
    is_slow = kind == Kind.IMU and stream.rate < _SLOW_IMU
    return found + (_spikes(name, fresh, is_slow=is_slow) or _coarse(name, fresh) if not absurd else [])


def _negative(values: Array) -> list[Finding]:
    """An airspeed below zero, but for noise at rest."""
    share = share_below_zero(values)
    if share == 0.0:
        return []
    return [Finding(
        ("true_airspeed",), "sign", ERROR,
        f"{share:.0%} of its values are below zero, down to {values.min():.3g} m/s: an airspeed never is, but a "
        "velocity component can be; map another column",
    )]  # fmt: skip


def _commanded(name: str, values: Array) -> list[Finding]:
    """Controls stand still and have flat tops by their nature; their size tells a wrong unit.

    A surface that never moves by as much as a bit is not recorded, or there is none.
    """
    if name in _TURNING and np.ptp(values) == 0.0:
        at = f"it stays at {np.degrees(values[0]):.3g}° all the time"
        if values[0] == 0.0:
            return [Finding((name,), "held", INFO, f"{at}: the flight does not show what it does")]
        return [Finding(
            (name,), "held", WARNING,
            f"{at}: if it moved and was not recorded, what it did is in other parameters; check its record",
        )]  # fmt: skip
    most = float(np.percentile(np.abs(values), 99))
    if name in SURFACES and most > _SURFACE:
        return [Finding(
            (name,), "unit", WARNING,
            f"it reaches {most:.3g}, which is {np.degrees(most):.0f}° if it is in radians: it is in degrees or a "
            "normalised command, give its unit in the map",
        )]  # fmt: skip
    if name == "throttle" and most > _THROTTLE:
        return [Finding(
            (name,), "unit", WARNING, f"it reaches {most:.3g} where 1 is full throttle: divide per cent by 100"
        )]  # fmt: skip
    return []


#: What a flat top means: of an input and of a sensor.
_AT_STOP = "a limited command, or a control at its stop, ends there; if it is a sensor, its range does"
_NO_RANGE = "the sensor's range ends there, leave these stretches out or choose a larger range"


def saturated(name: str, values: Array, time: Array) -> list[Finding]:
    """Flat tops: the extreme value again and again, one after another, and far more often than the value beside it."""
    levels, counts = np.unique(values, return_counts=True)
    usual = len(values) / max(int(np.sum(np.diff(values) != 0.0)), 1)
    found = []
    for end, beside in ((-1, slice(-4, -1)), (0, slice(1, 4))):
        if end == 0 and (name in _FROM_ZERO or (name.startswith(INPUTS) and levels[0] == 0.0)):
            continue  # an input that begins at zero, as the power of a motor, is off there
        if end == -1 and name in _FROM_GROUND:
            continue
        at = values == levels[end]
        runs = run_lengths(at)
        times = counts[end] / max(float(np.max(counts[beside], initial=1)), 1.0)
        if counts[end] >= _FLAT and max(runs) >= LEAST_RUN * usual and times >= _TIMES:
            first = float(time[np.argmax(at)])
            severity, why = (INFO, _AT_STOP) if name.startswith(INPUTS) else (WARNING, _NO_RANGE)
            found.append(Finding(
                (name,), "saturated", severity,
                f"it stays at its {'largest' if end else 'smallest'} value, {levels[end]:.4g}, for up to {max(runs)} "
                f"samples at a time ({counts[end]} in all, first at {first:.1f} s): {why}",
            ))  # fmt: skip
    return found


def run_lengths(at: npt.NDArray[np.bool_]) -> list[int]:
    """Lengths of the runs of True (n,)."""
    return [end - begin for begin, end in stretches(at)]


def _spikes(name: str, values: Array, *, is_slow: bool) -> list[Finding]:
    at, worst, usual = spikes(values)
    if is_slow and at.any():
        low, high = np.min(values[~at]), np.max(values[~at])
        at &= np.abs(values - 0.5 * (low + high)) > (0.5 + _BEYOND) * (high - low)
    count = int(at.sum())
    if not count:
        return []
    return [Finding(
        (name,), "noise", WARNING if count > max(2, _SPIKES * len(values)) else INFO,
        f"{'a single value jumps from its' if count == 1 else f'{count} single values jump from their'} neighbours by "
        f"up to {worst:.3g}, where such differences are {usual:.2g}: remove sensor or transmission faults",
    )]  # fmt: skip


def _coarse(name: str, values: Array) -> list[Finding]:
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0.0]
    spread = float(np.std(values))
    if len(steps) < 20 or not spread:
        return []
    smallest = float(np.percentile(steps, 1))
    if smallest < _COARSE * spread or len(np.unique(values)) > 0.2 * len(values):
        return []
    return [Finding(
        (name,), "noise", WARNING,
        f"its steps of {smallest:.3g} are {100 * smallest / spread:.0f} % of its spread: small motions do not show, "
        "record it with a finer resolution",
    )]  # fmt: skip
