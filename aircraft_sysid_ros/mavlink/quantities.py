"""What autopilots report, whatever the protocol: quantities in SI, radians, FRD and NED, and when they were taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.ros_messages.conversion import (
    FIX,
    GROUND_AUGMENTED_FIX,
    NO_FIX,
    SATELLITE_AUGMENTED_FIX,
)

Array = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]
Fields = Mapping[str, npt.NDArray[Any]]


class Quantity(Enum):
    """Quantities, with the columns of their values; NaN where a column is not reported."""

    IMU = "specific force (3) [m/s^2] and angular rate (3) [rad/s], FRD"
    MAGNETIC_FIELD = "field (3) [T], FRD"
    POSITION = "latitude, longitude [rad], altitude [m], variance north, east, down [m^2], status of the fix"
    VELOCITY = "over ground, NED (3) [m/s]; down may be NaN"
    DESCENT = "down velocity [m/s] for a VELOCITY without it"
    AIRSPEED = "[m/s], of the meaning that source or calibration says"
    IMPACT_PRESSURE = "P_t - P_s [Pa]"
    PRESSURE = "static pressure [Pa], temperature of the sensor [K]"
    ANGLE_OF_ATTACK = "[rad], nose up positive"
    SIDESLIP = "[rad], wind from the right positive"
    PULSES = "servo outputs [us], output 1 first"
    UPPER_PULSES = "servo outputs that are told apart from the first 16 [us], output 17 first"
    COMMANDS = "normalised outputs -1..1, output 1 first"
    MOTORS = "normalised thrust of motors -1..1, motor 1 first"
    PROPELLER = "revolutions per minute of engine 1, 2, …"
    ATTITUDE = "quaternion w, x, y, z of FRD to NED"
    WIND = "NED (3) [m/s], the direction the air moves to; variances (3) [m^2/s^2]"
    NAMED = "value of a named float"
    AIRSPEED_SENSOR = "1 where the autopilot has one that is healthy, else 0"


#: How many leading columns must be numbers, for a reading to say anything.
NEEDED = {
    Quantity.IMU: 6, Quantity.MAGNETIC_FIELD: 3, Quantity.VELOCITY: 2, Quantity.DESCENT: 1, Quantity.AIRSPEED: 1,
    Quantity.IMPACT_PRESSURE: 1, Quantity.PRESSURE: 1, Quantity.ANGLE_OF_ATTACK: 1, Quantity.SIDESLIP: 1,
    Quantity.ATTITUDE: 4, Quantity.WIND: 3, Quantity.NAMED: 1,
}  # fmt: skip
#: Column of POSITION with the status, as in sensor_msgs/NavSatStatus, or NO_RECEIVER.
FIX_STATUS = 6
NO_RECEIVER = -9.0


@dataclass(frozen=True)
class Batch:
    """n messages of one name: times at which they were taken [ns] (n,), and their fields, each (n,) or (n, k)."""

    name: str
    stamp: Stamps
    fields: Fields


@dataclass(frozen=True)
class Reading:
    """n values (n, k) of a quantity from one source, with stamps [ns] (n,)."""

    quantity: Quantity
    source: str
    stamp: Stamps
    values: Array


@dataclass(frozen=True)
class Entry:
    """How a message gives a quantity: fields to values (n, k), the fields it needs, and the text for a report."""

    quantity: Quantity
    values: Callable[[Fields], Array]
    needs: tuple[str, ...]


#: So many times the samples of another source, or the fixes of another receiver, are clearly more.
CLEARLY_MORE = 1.2


def first_of_most(counts: npt.ArrayLike) -> int:
    """Which counts of the first, unless another has clearly more; ``counts`` (n,) of each."""
    of_each = np.asarray(counts)
    return int(np.argmax(CLEARLY_MORE * of_each >= of_each.max()))


def is_sound(reading: Reading) -> bool:
    """Whether there is a number wherever one is needed."""
    return bool(np.all(np.isfinite(reading.values[:, : NEEDED.get(reading.quantity, 0)])))


_NOTHING, FIX_3D, _DIFFERENTIAL_FIX, _RTK_FLOAT, _RTK_FIXED = 0, 3, 4, 5, 6
#: The message that brings what MAVLink has no message for.
NAMED_VALUES = "NAMED_VALUE_FLOAT"
#: Entries by name of the message. Of several messages with one quantity the first in the table is preferred.
Table = Mapping[str, tuple[Entry, ...]]


def entry(quantity: Quantity, values: Callable[[Fields], Array], needs: str) -> Entry:
    """An entry whose needed fields are the words of ``needs``."""
    return Entry(quantity, values, tuple(needs.split()))


def columns(fields: Fields, names: str, scale: float = 1.0) -> Array:
    """The fields that are the words of ``names``, side by side (n, k), times ``scale``."""
    parts = [np.asarray(fields[name], dtype=np.float64) for name in names.split()]
    return np.concatenate([p if p.ndim == 2 else p[:, None] for p in parts], axis=1) * scale


def readings_of(table: Table, batch: Batch) -> list[Reading]:
    """What a batch reports, by a table; rows without a finite number are left out. Messages not in the table: none.

    Of several entries with one quantity (versions of a message) the first counts whose fields are there.
    """
    if batch.name == NAMED_VALUES:
        return _named(batch)
    found: list[Reading] = []
    known: set[Quantity] = set()
    for item in table.get(batch.name, ()):
        if item.quantity in known or not all(name in batch.fields for name in item.needs):
            continue
        known.add(item.quantity)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            values = item.values(batch.fields)
        values = np.where(np.isfinite(values), values, np.nan)
        rows = np.flatnonzero(np.any(np.isfinite(values), axis=1))
        if len(rows):
            found.append(Reading(item.quantity, batch.name, batch.stamp[rows], values[rows]))
    return found


def _named(batch: Batch) -> list[Reading]:
    """Named floats by their names, which are the sources; text or bytes up to their end."""
    names = np.array([text(name) for name in batch.fields["name"]])
    values = np.asarray(batch.fields["value"], dtype=np.float64)[:, None]
    each = ((name, np.flatnonzero(names == name)) for name in np.unique(names).tolist())
    return [Reading(Quantity.NAMED, name, batch.stamp[rows], values[rows]) for name, rows in each]


def position_of_fix(place: Array, variance: Array, fix_type: npt.NDArray[Any]) -> Array:
    """POSITION (n, 7) of latitude, longitude [rad], altitude [m] and variances, each (n, 3), and types of fix (n,).

    MAVLink's GPS_FIX_TYPE, DataFlash and PX4 count alike: 0 no receiver, 1 no fix, 2 without altitude, 3 whole, 4 with
    differential corrections, 5 and 6 with those of a base station (RTK).
    """
    kinds = [fix_type < FIX_3D, fix_type == _DIFFERENTIAL_FIX, (fix_type == _RTK_FLOAT) | (fix_type == _RTK_FIXED)]
    status = np.select(kinds, [float(NO_FIX), float(SATELLITE_AUGMENTED_FIX), float(GROUND_AUGMENTED_FIX)], float(FIX))
    status[fix_type == _NOTHING] = NO_RECEIVER
    numbers = np.concatenate([place, variance], axis=1)
    numbers[fix_type < FIX_3D] = np.nan
    return np.concatenate([numbers, status[:, None]], axis=1)


def without_vertical_zero(velocity: Array) -> Array:
    """Velocities NED (n, 3) [m/s]; a vertical part that is 0 all the time is that of a receiver that measures none."""
    if not np.any(np.nan_to_num(velocity[:, 2])):
        velocity[:, 2] = np.nan
    return velocity


def with_receiver(reading: Reading, heard: set[str]) -> Reading | None:
    """A reading without what comes from no GPS receiver; one that was there before and is lost has no fix.

    ``heard``: sources that have had a receiver, to which this one is added. None: nothing is left.
    """
    if reading.quantity is not Quantity.POSITION:
        return reading
    lost = reading.values[:, FIX_STATUS] == NO_RECEIVER
    had = np.logical_or.accumulate(~lost) | (reading.source in heard)
    if had.any():
        heard.add(reading.source)
    if not lost.any():
        return reading
    values = reading.values[had]
    values[lost[had], FIX_STATUS] = NO_FIX
    return replace(reading, stamp=reading.stamp[had], values=values) if len(values) else None


def text(value: Any) -> str:
    """A text field, which pymavlink gives as text or bytes, up to its end."""
    content = value.decode("ascii", "replace") if isinstance(value, (bytes, bytearray)) else str(value)
    return content.split("\x00", 1)[0]


def rank(table: Table, quantity: Quantity) -> tuple[str, ...]:
    """Names of the messages that have a quantity, preferred first."""
    return tuple(name for name, entries in table.items() if any(e.quantity is quantity for e in entries))


def quaternion_of_euler(angles: Array) -> Array:
    """Quaternions (n, 4) w, x, y, z of roll, pitch, yaw [rad] (n, 3)."""
    cr, cp, cy = np.cos(0.5 * angles).T
    sr, sp, sy = np.sin(0.5 * angles).T
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=1,
    )
