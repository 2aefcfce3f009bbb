"""MAVROS topics (relative to its namespace) to quantities: SI already, but FLU and ENU."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.mavlink.quantities import Array, Fields, Quantity, Table, columns, entry
from aircraft_sysid_ros.ros_messages.conversion import (
    frd_from_flu,
    has_no_fix,
    ned_from_enu,
    quaternion_ned_frd,
)


def _imu(fields: Fields) -> Array:
    force, rate = columns(fields, "linear_acceleration"), columns(fields, "angular_velocity")
    return np.concatenate([frd_from_flu(force), frd_from_flu(rate)], axis=1)


def _attitude(fields: Fields) -> Array:
    attitude = quaternion_ned_frd(columns(fields, "orientation"))
    attitude[columns(fields, "orientation_covariance")[:, 0] < 0.0] = np.nan
    return attitude


def _position(fields: Fields) -> Array:
    place = np.concatenate([np.radians(columns(fields, "latitude longitude")), columns(fields, "altitude")], axis=1)
    variance = columns(fields, "position_covariance")[:, [4, 0, 8]]
    variance[(fields["position_covariance_type"] == 0) | ~np.all(variance > 0.0, axis=1)] = np.nan
    status = np.asarray(fields["status.status"], dtype=np.float64)
    place[has_no_fix(status, place[:, 0], place[:, 1])] = np.nan
    return np.concatenate([place, np.where(np.isnan(place), np.nan, variance), status[:, None]], axis=1)


def _velocity(fields: Fields) -> Array:
    return ned_from_enu(columns(fields, "twist.linear"))


def _raw_velocity(fields: Fields) -> Array:
    """Of GPS_RAW_INT, whose vertical part MAVROS leaves at 0."""
    velocity = _velocity(fields)
    velocity[velocity[:, 2] == 0.0, 2] = np.nan
    return velocity


def _pressure(fields: Fields) -> Array:
    pressure = columns(fields, "fluid_pressure")
    return np.concatenate([pressure, np.full_like(pressure, np.nan)], axis=1)


def _servos(fields: Fields) -> Array:
    pulses = columns(fields, "channels")
    return np.where((pulses > 0.0) & (pulses < 65535.0), pulses, np.nan)


def _wind(fields: Fields) -> Array:
    variance = columns(fields, "twist.covariance")[:, [7, 0, 14]]
    return np.concatenate([ned_from_enu(columns(fields, "twist.twist.linear")), variance], axis=1)


_FIX = "latitude longitude altitude status.status position_covariance position_covariance_type"
_IMU = (
    entry(Quantity.IMU, _imu, "linear_acceleration angular_velocity"),
    entry(Quantity.ATTITUDE, _attitude, "orientation orientation_covariance"),
)
MAVROS: Table = {
    "imu/data_raw": _IMU[:1],
    "imu/data": _IMU,
    "imu/mag": (
        entry(Quantity.MAGNETIC_FIELD, lambda f: frd_from_flu(columns(f, "magnetic_field")), "magnetic_field"),
    ),
    "global_position/raw/fix": (entry(Quantity.POSITION, _position, _FIX),),
    "global_position/global": (entry(Quantity.POSITION, _position, _FIX),),
    "global_position/raw/gps_vel": (entry(Quantity.VELOCITY, _raw_velocity, "twist.linear"),),
    "local_position/velocity_local": (
        entry(Quantity.VELOCITY, _velocity, "twist.linear"),
        entry(Quantity.DESCENT, lambda f: _velocity(f)[:, 2:], "twist.linear"),
    ),
    "vfr_hud": (
        entry(Quantity.AIRSPEED, lambda f: columns(f, "airspeed"), "airspeed"),
        entry(Quantity.DESCENT, lambda f: columns(f, "climb", -1.0), "climb"),
    ),
    "imu/static_pressure": (entry(Quantity.PRESSURE, _pressure, "fluid_pressure"),),
    "imu/diff_pressure": (entry(Quantity.IMPACT_PRESSURE, lambda f: columns(f, "fluid_pressure"), "fluid_pressure"),),
    "rc/out": (entry(Quantity.PULSES, _servos, "channels"),),
    "esc_status": (entry(Quantity.PROPELLER, lambda f: columns(f, "rpm"), "rpm"),),
    "wind_estimation": (entry(Quantity.WIND, _wind, "twist.twist.linear twist.covariance"),),
}
