"""The one place where ROS meets the inside: FLU and ENU (REP-103, REP-145) to FRD and NED, and back.

All functions work on n messages of one topic at once and are elementwise, so that n = 1 (a live node) and
n = 100 000 (a replay) give the same bits. Flat fields are what a message holds without its nesting: the name
is the dotted path, an array (n,) for a number and (n, k) for a vector, a quaternion (x, y, z, w) or a
covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.samples import Kind, Samples, samples_of
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]
Rows = npt.NDArray[np.int64]
Fields = Mapping[str, npt.NDArray[Any]]

#: The input topics and their types.
TOPICS: dict[str, str] = {
    "imu/data": "sensor_msgs/msg/Imu",
    "imu/mag": "sensor_msgs/msg/MagneticField",
    "gps/fix": "sensor_msgs/msg/NavSatFix",
    "gps/vel": "geometry_msgs/msg/TwistStamped",
    "air_data": "aircraft_sysid_msgs/msg/AirData",
    "five_hole_probe": "aircraft_sysid_msgs/msg/FiveHoleProbe",
    "control_surfaces": "aircraft_sysid_msgs/msg/ControlSurfaces",
    "height_above_ground": "sensor_msgs/msg/Range",
    "mass_properties": "aircraft_sysid_msgs/msg/MassProperties",
}
#: The topic of the inputs that an aircraft file names, and its type. It is read where there are such.
INPUTS_TOPIC, INPUTS_TYPE = "inputs", "sensor_msgs/msg/JointState"


def frame_of(topic: str) -> str:
    """The frame in the header of an input topic, where we write it: of the GPS antenna, or of the body."""
    return "gps" if topic.startswith("gps/") else "base_link"


#: The fields that are used: their names and, for a nested vector, the names of its components.
USED_FIELDS: dict[str, dict[str, str]] = {
    "imu/data": {
        "orientation": "x y z w",
        "orientation_covariance": "",
        "angular_velocity": "x y z",
        "angular_velocity_covariance": "",
        "linear_acceleration": "x y z",
        "linear_acceleration_covariance": "",
    },
    "imu/mag": {"magnetic_field": "x y z"},
    "gps/fix": dict.fromkeys(
        (
            "status.status",
            "latitude",
            "longitude",
            "altitude",
            "position_covariance",
            "position_covariance_type",
        ),
        "",
    ),
    "gps/vel": {"twist.linear": "x y z"},
    "air_data": dict.fromkeys(("true_airspeed", "angle_of_attack", "sideslip", "air_density", "static_pressure"), ""),
    "five_hole_probe": dict.fromkeys(("static_pressure", "dynamic_pressure", "alpha_pressure", "beta_pressure"), ""),
    "control_surfaces": dict.fromkeys(
        ("elevator", "aileron", "rudder", "flaps", "throttle", "thrust", "propeller_speed"), ""
    ),
    "height_above_ground": dict.fromkeys(("range", "min_range", "max_range"), ""),
    "mass_properties": {
        **dict.fromkeys(("mass", "ixx", "iyy", "izz", "ixz"), ""),
        "center_of_gravity": "x y z",
    },
    INPUTS_TOPIC: {"name": "", "position": ""},
}
#: Status of a fix in sensor_msgs/NavSatStatus; UNKNOWN is what a driver leaves that does not set it.
UNKNOWN_FIX, NO_FIX, FIX, SATELLITE_AUGMENTED_FIX, GROUND_AUGMENTED_FIX = -2, -1, 0, 1, 2
#: Variance of what is not known, for messages that have no other way to say so.
UNKNOWN_VARIANCE = 1e6
RADIANS_PER_DEGREE = np.pi / 180.0
_SQRT_HALF = np.sqrt(0.5)
_HALF_TURN_FORWARD = np.array([1.0, -1.0, -1.0])
_EAST_NORTH = np.array([1, 0, 2])
_DOWN_UP = np.array([1.0, 1.0, -1.0])
#: A quaternion whose length differs more from 1 is not an orientation.
_NORM_TOLERANCE = 0.1


def topics_of(inputs: Sequence[NamedInput]) -> dict[str, str]:
    """TOPICS, and that of the inputs where an aircraft file names some."""
    return {**TOPICS, INPUTS_TOPIC: INPUTS_TYPE} if inputs else TOPICS


def to_samples(topic: str, stamp: Stamps, fields: Fields, inputs: Sequence[NamedInput] = ()) -> list[Samples]:
    """Samples of n messages of a topic (relative name) from their stamps [ns] (n,) and flat fields.

    A message may hold several samples (orientation, the parts of air data) or none. Values that are there but
    useless (no GPS fix) become NaN and are left to the estimator to count; values that are not measured give
    none. ``inputs`` are those that the aircraft file names.
    """
    return [samples for samples, _ in samples_and_rows(topic, stamp, fields, inputs) if len(samples)]


def samples_and_rows(
    topic: str, stamp: Stamps, fields: Fields, inputs: Sequence[NamedInput] = ()
) -> list[tuple[Samples, Rows]]:
    """As to_samples, each batch with the row (m,) of the message that each of its samples came from."""
    if topic == INPUTS_TOPIC:
        return _named_inputs(np.atleast_1d(stamp), fields, inputs)
    return _CONVERSIONS[topic](np.atleast_1d(stamp), fields)


def nanoseconds_of(message: Any) -> int:
    """The stamp of a message's header [ns]."""
    return int(message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec)


def message_fields(topic: str, message: Any) -> tuple[Stamps, dict[str, npt.NDArray[Any]]]:
    """Stamp [ns] (1,) and flat fields (n = 1) of a live message of a topic."""
    stamp = np.array([nanoseconds_of(message)], dtype=np.int64)
    return stamp, {name: np.array([getter(message)]) for name, getter in _GETTERS[topic].items()}


def input_fields(names: Sequence[str], values: Array) -> dict[str, npt.NDArray[Any]]:
    """Fields of sensor_msgs/JointState of n messages that hold all of some inputs, values (n, k)."""
    return {"name": np.tile(np.array(names, dtype=object), (len(values), 1)), "position": values}


def frd_from_flu(vector: npt.ArrayLike) -> Array:
    """Body vectors (n, 3) from forward-left-up to forward-right-down; its own inverse."""
    return np.asarray(vector, dtype=np.float64) * _HALF_TURN_FORWARD


def ned_from_enu(vector: npt.ArrayLike) -> Array:
    """World vectors (n, 3) from east-north-up to north-east-down; its own inverse."""
    return np.asarray(vector, dtype=np.float64)[..., _EAST_NORTH] * _DOWN_UP


flu_from_frd = frd_from_flu
enu_from_ned = ned_from_enu


def quaternion_ned_frd(orientation: npt.ArrayLike) -> Array:
    """Quaternion (n, 4) w, x, y, z, FRD to NED, of a ROS one (n, 4) x, y, z, w, FLU to ENU.

    q = (NED from ENU) (x) orientation (x) (FLU from FRD), with (0, 1, 1, 0) / sqrt 2 (half a turn about the
    north-east diagonal) and (0, 1, 0, 0) (half a turn about forward), multiplied out.
    """
    x, y, z, w = np.moveaxis(np.asarray(orientation, dtype=np.float64), -1, 0)
    return np.stack([w + z, x + y, x - y, w - z], axis=-1) * _SQRT_HALF


def quaternion_enu_flu(attitude: npt.ArrayLike) -> Array:
    """ROS quaternion (n, 4) x, y, z, w, FLU to ENU, of one (n, 4) w, x, y, z, FRD to NED."""
    w, x, y, z = np.moveaxis(np.asarray(attitude, dtype=np.float64), -1, 0)
    return np.stack([x + y, x - y, w - z, w + z], axis=-1) * _SQRT_HALF


def imu_fields(
    specific_force: npt.ArrayLike,
    angular_velocity: npt.ArrayLike,
    *,
    attitude: npt.ArrayLike | None = None,
    variances: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> dict[str, Array]:
    """Fields of sensor_msgs/Imu of n samples FRD (n, 3), and of attitudes (n, 4) w, x, y, z to NED if any.

    ``variances`` of specific force, angular velocity and attitude; 0 means unknown, as in ROS.
    """
    force, rate = np.atleast_2d(specific_force), np.atleast_2d(angular_velocity)
    n = len(force)
    fields = {
        "linear_acceleration": flu_from_frd(force),
        "angular_velocity": flu_from_frd(rate),
        "linear_acceleration_covariance": np.tile(variances[0] * np.eye(3).ravel(), (n, 1)),
        "angular_velocity_covariance": np.tile(variances[1] * np.eye(3).ravel(), (n, 1)),
        "orientation": np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        "orientation_covariance": np.tile(variances[2] * np.eye(3).ravel(), (n, 1)),
    }
    if attitude is None:
        fields["orientation_covariance"][:, 0] = -1.0  # sensor_msgs/Imu: there is no orientation
    else:
        fields["orientation"] = quaternion_enu_flu(np.atleast_2d(attitude))
    return fields


def gps_fix_fields(
    latitude: npt.ArrayLike,
    longitude: npt.ArrayLike,
    altitude: npt.ArrayLike,
    *,
    variance_ned: tuple[float, float, float] | None = None,
    status: npt.ArrayLike = FIX,
) -> dict[str, npt.NDArray[Any]]:
    """Fields of sensor_msgs/NavSatFix: latitude, longitude [rad], altitude [m] (n,), variances [m^2].

    ``status``: of sensor_msgs/NavSatStatus, (n,) or one for all.
    """
    latitude, longitude = np.atleast_1d(latitude), np.atleast_1d(longitude)
    fields: dict[str, npt.NDArray[Any]] = {
        "latitude": latitude / RADIANS_PER_DEGREE,
        "longitude": longitude / RADIANS_PER_DEGREE,
        "altitude": np.atleast_1d(np.asarray(altitude, dtype=np.float64)),
        "status.status": np.full(len(latitude), status, dtype=np.int8),
        "status.service": np.ones(len(latitude), dtype=np.uint16),
    }
    if variance_ned is not None:
        north, east, down = variance_ned
        fields["position_covariance"] = np.tile(np.diag([east, north, down]).ravel(), (len(latitude), 1))
        fields["position_covariance_type"] = np.full(len(latitude), 2, dtype=np.uint8)  # diagonal known
    return fields


def gps_velocity_fields(velocity_ned: npt.ArrayLike) -> dict[str, Array]:
    """Fields of geometry_msgs/TwistStamped of velocities over ground NED (n, 3) [m/s]."""
    return {"twist.linear": enu_from_ned(np.atleast_2d(velocity_ned))}


def _all_rows(samples: Samples) -> tuple[Samples, Rows]:
    return samples, np.arange(len(samples))


def _some_rows(kind: Kind, stamp: Stamps, valid: npt.NDArray[np.bool_], *columns: Array) -> tuple[Samples, Rows]:
    rows = np.flatnonzero(valid)
    return samples_of(kind, stamp[rows], *(column[rows] for column in columns)), rows


def _mean_variance(covariance: Array) -> Array:
    """Mean (n,) of the three variances, the same in all axes; NaN where element 0 says unknown."""
    mean = (covariance[:, 0] + covariance[:, 4] + covariance[:, 8]) / 3.0
    known = (covariance[:, 0] > 0.0) & (mean > 0.0) & np.isfinite(mean)
    return np.where(known, mean, np.nan)


def _imu(stamp: Stamps, fields: Fields) -> list[tuple[Samples, Rows]]:
    """Specific force, rate, one variance of each; the attitude where its covariance says it is there."""
    imu = samples_of(
        Kind.IMU,
        stamp,
        frd_from_flu(fields["linear_acceleration"]),
        frd_from_flu(fields["angular_velocity"]),
        _mean_variance(fields["linear_acceleration_covariance"]),
        _mean_variance(fields["angular_velocity_covariance"]),
    )
    return [_all_rows(imu), *_attitude(stamp, fields)]


def _attitude(stamp: Stamps, fields: Fields) -> list[tuple[Samples, Rows]]:
    is_there = fields["orientation_covariance"][:, 0] > 0.0
    if not is_there.any():
        return []
    x, y, z, w = fields["orientation"].T
    with np.errstate(over="ignore"):
        norm = np.sqrt(w * w + x * x + y * y + z * z)
    usable = is_there & (np.abs(norm - 1.0) <= _NORM_TOLERANCE)
    if not usable.any():
        return []
    with np.errstate(divide="ignore", invalid="ignore"):
        quaternion = quaternion_ned_frd(fields["orientation"]) / norm[:, None]
    variance = _mean_variance(fields["orientation_covariance"])
    return [_some_rows(Kind.ATTITUDE, stamp, usable, quaternion, variance, variance, variance)]


def _magnetic_field(stamp: Stamps, fields: Fields) -> list[tuple[Samples, Rows]]:
    return [_all_rows(samples_of(Kind.MAGNETIC_FIELD, stamp, frd_from_flu(fields["magnetic_field"])))]


def has_no_fix(status: npt.NDArray[Any], latitude: Array, longitude: Array) -> npt.NDArray[np.bool_]:
    """Whether messages (n,) say that there is no fix, by their status or by a place of 0, 0.

    A status that is unknown says nothing: the numbers count.
    """
    return np.asarray((status == NO_FIX) | ((latitude == 0.0) & (longitude == 0.0)))


def _gps_position(stamp: Stamps, fields: Fields) -> list[tuple[Samples, Rows]]:
    latitude, longitude = fields["latitude"], fields["longitude"]
    no_fix = has_no_fix(fields["status.status"], latitude, longitude)
    position = np.stack([latitude * RADIANS_PER_DEGREE, longitude * RADIANS_PER_DEGREE, fields["altitude"]], axis=-1)
    position[no_fix] = np.nan
    variance = np.asarray(fields["position_covariance"], dtype=np.float64)[:, [4, 0, 8]]  # east, north, up
    known = (fields["position_covariance_type"] > 0)[:, None] & (variance > 0.0) & np.isfinite(variance)
    variance = np.where(known, variance, np.nan)
    return [_all_rows(samples_of(Kind.GPS_POSITION, stamp, position, variance))]


def _gps_velocity(stamp: Stamps, fields: Fields) -> list[tuple[Samples, Rows]]:
    return [_all_rows(samples_of(Kind.GPS_VELOCITY, stamp, ned_from_enu(fields["twist.linear"])))]


def _air_data(stamp: Stamps, fields: Fields) -> list[tuple[Samples, Rows]]:
    density, pressure = fields["air_density"], fields["static_pressure"]
    parts = [
        (Kind.AIRSPEED, np.isfinite(fields["true_airspeed"]), (fields["true_airspeed"],)),
        (Kind.ANGLE_OF_ATTACK, np.isfinite(fields["angle_of_attack"]), (fields["angle_of_attack"],)),
        (Kind.SIDESLIP, np.isfinite(fields["sideslip"]), (fields["sideslip"],)),
        (Kind.AIR, np.isfinite(density) | np.isfinite(pressure), (density, pressure)),
    ]
    return [_some_rows(kind, stamp, valid, *columns) for kind, valid, columns in parts if valid.any()]


def _height(stamp: Stamps, fields: Fields) -> list[tuple[Samples, Rows]]:
    """REP-117: a range outside its limits or infinite is no measurement; a maximum of 0 is not filled in."""
    distance, highest = fields["range"].astype(np.float64), fields["max_range"]
    measured = np.isfinite(distance) & (distance >= fields["min_range"])
    measured &= (distance <= highest) | (highest <= 0.0)
    return [_all_rows(samples_of(Kind.HEIGHT, stamp, np.where(measured, distance, np.nan)))]


def _mass(stamp: Stamps, fields: Fields) -> list[tuple[Samples, Rows]]:
    """A mass or a moment of inertia of 0 was not filled in; without any moment neither was the product."""
    mass, *moments, product, center = (np.asarray(fields[name]) for name in USED_FIELDS["mass_properties"])
    mass, *moments = (np.where(value > 0.0, value, np.nan) for value in (mass, *moments))
    product = np.where(np.isfinite(moments).any(axis=0), product, np.nan)
    return [_all_rows(samples_of(Kind.MASS, stamp, mass, *moments, product, center))]


def _named_inputs(stamp: Stamps, fields: Fields, inputs: Sequence[NamedInput]) -> list[tuple[Samples, Rows]]:
    """Each named input in SI, in the order of the aircraft file; NaN: not in the message, or no value it can have.

    A message with another number of positions than names holds nothing.
    """
    column = {item.name: k for k, item in enumerate(inputs)}
    values = np.full((len(stamp), len(inputs)), np.nan)
    names, positions = fields["name"], fields["position"]
    if names.ndim == 2 and names.shape == positions.shape and (names == names[:1]).all():
        rows: Iterable[Any] = [(values, names[0] if len(names) else (), positions.T)]  # all at once
    else:
        rows = zip(values, names, positions, strict=True)
    for row, listed, numbers in rows:
        for name, number in zip(listed, numbers, strict=True) if len(listed) == len(numbers) else ():
            if name in column:
                row[..., column[name]] = number
    values *= [item.factor for item in inputs]
    low, high = np.array([item.limits for item in inputs]).T
    values[~((values >= low) & (values <= high))] = np.nan
    return [_some_rows(Kind.INPUTS, stamp, np.isfinite(values).any(axis=1), values)]


def _columns(kind: Kind, topic: str) -> Callable[[Stamps, Fields], list[tuple[Samples, Rows]]]:
    """Conversion of a topic whose fields are the values of the kind, in order, units and axes."""
    names = tuple(USED_FIELDS[topic])

    def convert(stamp: Stamps, fields: Fields) -> list[tuple[Samples, Rows]]:
        return [_all_rows(samples_of(kind, stamp, *(fields[name] for name in names)))]

    return convert


_CONVERSIONS: dict[str, Callable[[Stamps, Fields], list[tuple[Samples, Rows]]]] = {
    "imu/data": _imu,
    "imu/mag": _magnetic_field,
    "gps/fix": _gps_position,
    "gps/vel": _gps_velocity,
    "air_data": _air_data,
    "five_hole_probe": _columns(Kind.FIVE_HOLE, "five_hole_probe"),
    "control_surfaces": _columns(Kind.CONTROLS, "control_surfaces"),
    "height_above_ground": _height,
    "mass_properties": _mass,
}


def _getter(name: str, components: str) -> Callable[[Any], Any]:
    """What takes a field out of a live message: a number, an array or a tuple of components."""
    return attrgetter(*(f"{name}.{c}" for c in components.split())) if components else attrgetter(name)


_GETTERS = {
    topic: {name: _getter(name, components) for name, components in names.items()}
    for topic, names in USED_FIELDS.items()
}
