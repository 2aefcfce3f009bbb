"""ArduPilot's DataFlash messages to quantities.

The reader has applied the formats' own scales (L: 1e-7 degrees, c: 0.01). FRD and NED, SI but for degrees, milligauss
and microseconds of the servos. Where a message has instances (I), the first that is there is taken, unless another has
clearly more fixes, or is healthy clearly more often. What a sensor shows that is not healthy is no measurement: of a
pitot that does not answer ARSP has the airspeed of its offset. ARSP.Airspeed is indicated airspeed; AOA is what the
autopilot works out, unless a vane feeds it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.mavlink.quantities import (
    FIX_3D,
    Array,
    Fields,
    Quantity,
    Table,
    columns,
    entry,
    first_of_most,
    position_of_fix,
    quaternion_of_euler,
    without_vertical_zero,
)

_TESLA_PER_MILLIGAUSS = 1e-7
_KELVIN = 273.15
_FIX_2D = 2
SERVO_COUNT = 14
#: Fields that are 0 where the sensor is not healthy; of an IMU its gyros and its accelerometers.
_HEALTH = ("H", "Health", "GH", "AH")


def _works(fields: Fields) -> npt.NDArray[np.bool_]:
    """Where (n,) a sensor is healthy, and a GPS receiver has a fix; older versions say it of the latter alone."""
    works = np.ones(len(next(iter(fields.values()))), np.bool_)
    for name in _HEALTH:
        works &= np.asarray(fields.get(name, 1)) != 0
    return works & (np.asarray(fields.get("Status", FIX_3D)) >= FIX_3D)


def instances(fields: Fields) -> list[int]:
    """Instances of a sensor, before all that which is read: the first, unless another works clearly more often."""
    found, which = np.unique(fields["I"], return_inverse=True)
    best = first_of_most(np.bincount(which[_works(fields)], minlength=len(found)))
    return [int(found[best]), *np.delete(found, best).tolist()]


def _of_one(fields: Fields, values: Array) -> Array:
    """Values of the instance alone that is read."""
    if "I" in fields and len(values):
        values[fields["I"] != instances(fields)[0]] = np.nan
    return values


def _measured(fields: Fields, values: Array) -> Array:
    """Values of the instance alone that is read, where it is healthy."""
    values[~_works(fields)] = np.nan
    return _of_one(fields, values)


def _imu(fields: Fields) -> Array:
    return _measured(fields, columns(fields, "AccX AccY AccZ GyrX GyrY GyrZ"))


def _magnetic(fields: Fields) -> Array:
    return _measured(fields, columns(fields, "MagX MagY MagZ", _TESLA_PER_MILLIGAUSS))


def _position(fields: Fields) -> Array:
    place = np.concatenate([np.radians(columns(fields, "Lat Lng")), columns(fields, "Alt")], axis=1)
    return _of_one(fields, position_of_fix(place, np.full((len(place), 3), np.nan), fields["Status"]))


def _velocity(fields: Fields) -> Array:
    speed, course = columns(fields, "Spd")[:, 0], np.radians(columns(fields, "GCrs")[:, 0])
    velocity = np.stack([speed * np.cos(course), speed * np.sin(course), columns(fields, "VZ")[:, 0]], axis=1)
    velocity[fields["Status"] < _FIX_2D] = np.nan
    return without_vertical_zero(_of_one(fields, velocity))


def _pressure(fields: Fields) -> Array:
    values = columns(fields, "Press Temp") + np.array([0.0, _KELVIN])
    values[values[:, 0] <= 0.0] = np.nan
    return _measured(fields, values)


def _servos(fields: Fields) -> Array:
    names = [f"C{i}" for i in range(1, SERVO_COUNT + 1)]
    pulses = columns(fields, " ".join(name for name in names if name in fields))
    return np.where(pulses > 0.0, pulses, np.nan)


def _both_speeds(fields: Fields) -> Array:
    speeds = columns(fields, "rpm1 rpm2")
    return np.where(speeds >= 0.0, speeds, np.nan)  # -1: no sensor, or one that is not healthy


def _speed(fields: Fields) -> Array:
    """Speed of the engine that the instance names."""
    speed = columns(fields, "RPM")[:, 0]
    speed[~_works(fields)] = np.nan
    which = np.asarray(fields["I"] if "I" in fields else fields["Instance"], dtype=np.int64)
    values = np.full((len(speed), 16), np.nan)
    inside = np.flatnonzero((which >= 0) & (which < 16))
    values[inside, which[inside]] = speed[inside]
    return values


def _wind(fields: Fields) -> Array:
    """Wind of the EKF; its vertical part is not estimated."""
    wind = columns(fields, "VWN VWE")
    values = np.full((len(wind), 6), np.nan)
    values[:, :2], values[:, 2] = wind, 0.0
    if "C" in fields:
        values[fields["C"] != 0] = np.nan
    return values


def _attitude(fields: Fields) -> Array:
    return quaternion_of_euler(np.radians(columns(fields, "Roll Pitch Yaw")))


_WIND = (entry(Quantity.WIND, _wind, "VWN VWE"),)
DATAFLASH: Table = {
    "IMU": (entry(Quantity.IMU, _imu, "AccX AccY AccZ GyrX GyrY GyrZ"),),
    "MAG": (entry(Quantity.MAGNETIC_FIELD, _magnetic, "MagX MagY MagZ"),),
    "GPS": (
        entry(Quantity.POSITION, _position, "Status Lat Lng Alt"),
        entry(Quantity.VELOCITY, _velocity, "Status Spd GCrs VZ"),
    ),
    "BARO": (entry(Quantity.PRESSURE, _pressure, "Press Temp"),),
    "ARSP": (
        entry(Quantity.AIRSPEED, lambda f: _measured(f, columns(f, "Airspeed")), "Airspeed"),
        entry(Quantity.IMPACT_PRESSURE, lambda f: _measured(f, columns(f, "DiffPress")), "DiffPress"),
    ),
    "AOA": (
        entry(Quantity.ANGLE_OF_ATTACK, lambda f: np.radians(columns(f, "AOA")), "AOA"),
        entry(Quantity.SIDESLIP, lambda f: np.radians(columns(f, "SSA")), "SSA"),
    ),
    "RCOU": (entry(Quantity.PULSES, _servos, "C1"),),
    "RPM": (
        entry(Quantity.PROPELLER, _both_speeds, "rpm1 rpm2"),
        entry(Quantity.PROPELLER, _speed, "RPM I"),
    ),
    "ESC": (entry(Quantity.PROPELLER, _speed, "RPM Instance"),),
    "ATT": (entry(Quantity.ATTITUDE, _attitude, "Roll Pitch Yaw"),),
    "XKF2": _WIND,
    "NKF2": _WIND,
}
