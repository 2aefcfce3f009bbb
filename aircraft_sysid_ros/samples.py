"""What flows through the program: time-stamped samples, converted at the edge to FRD, NED, SI and radians.

A batch holds n samples of any kinds in the order in which they arrived; live nodes push batches of one
message, replay pushes a second of flight at once, and both meet the same code.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

#: Values per sample; a kind with fewer leaves the rest NaN.
WIDTH = 10


class Kind(IntEnum):
    """Kinds of samples, with their values in order."""

    IMU = 0  # specific force (3) [m/s^2], angular rate (3) [rad/s], body; their variances or NaN
    ATTITUDE = 1  # quaternion body to NED (4), variance (3) [rad^2] or NaN
    MAGNETIC_FIELD = 2  # field (3), body, any unit
    GPS_POSITION = 3  # latitude, longitude [rad], altitude [m], variance north, east, down [m^2] or NaN
    GPS_VELOCITY = 4  # velocity over ground NED (3) [m/s]
    AIRSPEED = 5  # true airspeed [m/s]
    ANGLE_OF_ATTACK = 6  # [rad]
    SIDESLIP = 7  # [rad]
    AIR = 8  # density [kg/m^3], static pressure [Pa]; either may be NaN
    CONTROLS = 9  # elevator, aileron, rudder, flaps [rad], throttle 0..1, thrust [N], propeller speed [rad/s]
    HEIGHT = 10  # above the ground [m]
    MASS = 11  # mass [kg], Ixx, Iyy, Izz, Ixz [kg m^2], centre of gravity (3) [m]
    FIVE_HOLE = 12  # static, dynamic, alpha and beta pressure [Pa]


#: How many leading values must be finite for a sample of the kind to be of use.
REQUIRED_VALUES = np.zeros(len(Kind), dtype=np.int64)
for _kind, _count in (
    (Kind.IMU, 6), (Kind.ATTITUDE, 4), (Kind.MAGNETIC_FIELD, 3), (Kind.GPS_POSITION, 3),
    (Kind.GPS_VELOCITY, 3), (Kind.AIRSPEED, 1), (Kind.ANGLE_OF_ATTACK, 1), (Kind.SIDESLIP, 1),
    (Kind.HEIGHT, 1), (Kind.FIVE_HOLE, 2),
):  # fmt: skip
    REQUIRED_VALUES[_kind] = _count

#: Beyond these magnitudes a value is no measurement of an aircraft but a fault of transmission, (kinds, WIDTH).
LARGEST_VALUES = np.full((len(Kind), WIDTH), np.inf)
for _kind, _limits in {
    Kind.IMU: [2000.0] * 3 + [200.0] * 3,
    Kind.ATTITUDE: [2.0] * 4,
    Kind.MAGNETIC_FIELD: [1e6] * 3,
    Kind.GPS_POSITION: [1.6, 6.3, 1e5],
    Kind.GPS_VELOCITY: [2000.0] * 3,
    Kind.AIRSPEED: [2000.0],
    Kind.ANGLE_OF_ATTACK: [3.2],
    Kind.SIDESLIP: [3.2],
    Kind.AIR: [10.0, 1e6],
    Kind.CONTROLS: [1.6] * 4 + [10.0, 1e7, 1e5],
    Kind.HEIGHT: [1e5],
    Kind.MASS: [1e7] + [1e10] * 4 + [1e3] * 3,
    Kind.FIVE_HOLE: [1e6] * 4,
}.items():
    LARGEST_VALUES[_kind, : len(_limits)] = _limits


@dataclass(frozen=True)
class Samples:
    """n samples in order of arrival: ``stamp`` [ns] (n,), ``kind`` (n,) and ``values`` (n, WIDTH)."""

    stamp: npt.NDArray[np.int64]
    kind: npt.NDArray[np.int64]
    values: npt.NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.stamp)

    def __getitem__(self, index: slice | npt.NDArray[np.int64] | npt.NDArray[np.bool_]) -> Samples:
        return Samples(self.stamp[index], self.kind[index], self.values[index])


def samples_of(kind: Kind, stamp: npt.ArrayLike, *columns: npt.ArrayLike | npt.NDArray[np.float64]) -> Samples:
    """Samples of one kind from stamps [ns] (n,) and columns, each (n,) or (n, k); the rest is NaN."""
    stamps = np.atleast_1d(np.asarray(stamp, dtype=np.int64))
    values = np.full((len(stamps), WIDTH), np.nan)
    at = 0
    for column in columns if len(stamps) else ():
        block = np.asarray(column, dtype=np.float64).reshape(len(stamps), -1)
        values[:, at : at + block.shape[1]] = block
        at += block.shape[1]
    return Samples(stamps, np.full(len(stamps), int(kind), dtype=np.int64), values)


def concatenate(batches: list[Samples]) -> Samples:
    """Join batches in the given order."""
    if not batches:
        return Samples(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, WIDTH)))
    return Samples(
        np.concatenate([b.stamp for b in batches]),
        np.concatenate([b.kind for b in batches]),
        np.concatenate([b.values for b in batches]),
    )


def is_absurd(samples: Samples) -> npt.NDArray[np.bool_]:
    """Which values (n, WIDTH) no aircraft has; NaN is not absurd."""
    return np.asarray(np.abs(samples.values) > LARGEST_VALUES[samples.kind])
