"""PX4's uORB topics to quantities: one table for ULog files, and for px4_msgs in bags and live, with the same fields.

SI, FRD and NED; older versions have GPS positions as integers (1e-7 degrees, mm), newer ones in degrees and m.
"""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.mavlink.quantities import (
    Array,
    Entry,
    Fields,
    Quantity,
    Stamps,
    Table,
    columns,
    entry,
    position_of_fix,
    without_vertical_zero,
)

_TESLA_PER_GAUSS = 1e-4
_KELVIN = 273.15
_FIX_2D = 2
_INVALID = 2**31 - 1  # of a relative time: the values that it belongs to are none
#: Fields that say what a validated airspeed is of, the second up to PX4 1.15; what is not one of the sensors is an
#: estimate without an airspeed sensor, or none.
AIRSPEED_SOURCES, _SENSORS = ("airspeed_source", "selected_airspeed_index"), (1, 2, 3)
_LONGEST_DELAY = 1_000_000  # [us] from sample to message: a sample that is older was not filled in
#: Fields that say when a sample was taken, best first.
TIMES = ("timestamp_sample", "timestamp")
#: Fields that count where a message has them.
OPTIONAL = (*TIMES, *AIRSPEED_SOURCES, "accelerometer_timestamp_relative", "valid", "vel_ned_valid")


def sample_time(fields: Fields) -> Stamps:
    """Time [ns] (n,) when samples were taken: that of the sample where it is just before that of the message."""
    published = np.asarray(fields[TIMES[1]]).astype(np.int64)
    taken = np.asarray(fields.get(TIMES[0], published)).astype(np.int64)
    delay = published - taken
    return np.asarray(np.where((delay >= 0) & (delay < _LONGEST_DELAY), taken, published) * 1000)


def _sensor_combined(fields: Fields) -> Array:
    values = columns(fields, _FORCE_AND_RATE)
    values[np.asarray(fields.get("accelerometer_timestamp_relative", 0)) == _INVALID, :3] = np.nan
    return values


def _validated(fields: Fields) -> Array:
    """Calibrated airspeed, where a sensor is behind it: it may be ground speed less wind, or made of the throttle."""
    speed = columns(fields, "calibrated_airspeed_m_s")
    for name in AIRSPEED_SOURCES:
        if name in fields:
            speed[~np.isin(fields[name], _SENSORS)] = np.nan
    return speed


def _angle(name: str) -> Entry:
    """An angle of the flow [rad] where the sensor is within its range."""
    quantity = Quantity.ANGLE_OF_ATTACK if name == "aoa_rad" else Quantity.SIDESLIP

    def values(fields: Fields) -> Array:
        angle = columns(fields, name)
        return np.where(np.asarray(fields.get("valid", np.ones(len(angle)))).astype(np.bool_)[:, None], angle, np.nan)

    return entry(quantity, values, name)


def _vehicle_imu(fields: Fields) -> Array:
    """Mean specific force and rate from increments over their intervals [us]."""
    force = columns(fields, "delta_velocity") / columns(fields, "delta_velocity_dt", 1e-6)
    rate = columns(fields, "delta_angle") / columns(fields, "delta_angle_dt", 1e-6)
    return np.concatenate([force, rate], axis=1)


def _with_variance(fields: Fields, place: Array) -> Array:
    across, up = columns(fields, "eph")[:, 0], columns(fields, "epv")[:, 0]
    variance = np.stack([0.5 * across**2, 0.5 * across**2, up**2], axis=1)
    variance[~((across > 0.0) & (up > 0.0))] = np.nan
    return position_of_fix(place, variance, fields["fix_type"])


def _position(fields: Fields) -> Array:
    place = columns(fields, "latitude_deg longitude_deg altitude_msl_m")
    return _with_variance(fields, np.concatenate([np.radians(place[:, :2]), place[:, 2:]], axis=1))


def _position_integer(fields: Fields) -> Array:
    place = np.concatenate([np.radians(columns(fields, "lat lon", 1e-7)), columns(fields, "alt", 1e-3)], axis=1)
    return _with_variance(fields, place)


def _velocity(fields: Fields) -> Array:
    velocity = columns(fields, "vel_n_m_s vel_e_m_s vel_d_m_s")
    is_known = np.asarray(fields.get("vel_ned_valid", True)) != 0
    velocity[(fields["fix_type"] < _FIX_2D) | ~is_known] = np.nan
    return without_vertical_zero(velocity)


def _pressure(fields: Fields) -> Array:
    return columns(fields, "baro_pressure_pa baro_temp_celcius") + np.array([0.0, _KELVIN])


def _pressure_with_ambient(fields: Fields) -> Array:
    return columns(fields, "baro_pressure_pa ambient_temperature") + np.array([0.0, _KELVIN])


def _outputs(fields: Fields) -> Array:
    """Outputs in us; only those that are in use."""
    values = columns(fields, "output")
    used = np.arange(values.shape[1])[None, :] < np.asarray(fields["noutputs"], dtype=np.int64)[:, None]
    return np.where(used & (values > 0.0), values, np.nan)


def _wind(fields: Fields) -> Array:
    level = columns(fields, "windspeed_north windspeed_east")
    variance = columns(fields, "variance_north variance_east")
    nothing = np.zeros((len(level), 1))
    return np.concatenate([level, nothing, variance, nothing + np.nan], axis=1)


def _esc(fields: Fields) -> Array:
    names = [f"esc[{i}].esc_rpm" for i in range(8)]
    return columns(fields, " ".join(name for name in names if name in fields))


_GPS = (
    entry(Quantity.POSITION, _position, "latitude_deg longitude_deg altitude_msl_m eph epv fix_type"),
    entry(Quantity.POSITION, _position_integer, "lat lon alt eph epv fix_type"),
    entry(Quantity.VELOCITY, _velocity, "vel_n_m_s vel_e_m_s vel_d_m_s fix_type"),
)
_FORCE_AND_RATE = "accelerometer_m_s2 gyro_rad"
_WIND = (entry(Quantity.WIND, _wind, "windspeed_north windspeed_east variance_north variance_east"),)
PX4: Table = {
    "sensor_combined": (entry(Quantity.IMU, _sensor_combined, _FORCE_AND_RATE),),
    "vehicle_imu": (entry(Quantity.IMU, _vehicle_imu, "delta_angle delta_velocity delta_angle_dt delta_velocity_dt"),),
    "vehicle_magnetometer": (
        entry(Quantity.MAGNETIC_FIELD, lambda f: columns(f, "magnetometer_ga", _TESLA_PER_GAUSS), "magnetometer_ga"),
    ),
    "sensor_gps": _GPS,
    "vehicle_gps_position": _GPS,
    "airspeed": (entry(Quantity.AIRSPEED, lambda f: columns(f, "indicated_airspeed_m_s"), "indicated_airspeed_m_s"),),
    "airspeed_validated": (entry(Quantity.AIRSPEED, _validated, "calibrated_airspeed_m_s"),),
    "differential_pressure": (
        entry(Quantity.IMPACT_PRESSURE, lambda f: columns(f, "differential_pressure_pa"), "differential_pressure_pa"),
    ),
    "vehicle_air_data": (
        entry(Quantity.PRESSURE, _pressure_with_ambient, "baro_pressure_pa ambient_temperature"),
        entry(Quantity.PRESSURE, _pressure, "baro_pressure_pa baro_temp_celcius"),
    ),
    "airflow_aoa": (_angle("aoa_rad"),),
    "airflow_slip": (_angle("slip_rad"),),
    "actuator_outputs": (entry(Quantity.PULSES, _outputs, "output noutputs"),),
    "actuator_servos": (entry(Quantity.COMMANDS, lambda f: columns(f, "control"), "control"),),
    "actuator_motors": (entry(Quantity.MOTORS, lambda f: columns(f, "control"), "control"),),
    "esc_status": (entry(Quantity.PROPELLER, _esc, "esc[0].esc_rpm"),),
    "rpm": (entry(Quantity.PROPELLER, lambda f: columns(f, "rpm_estimate"), "rpm_estimate"),),
    "vehicle_attitude": (entry(Quantity.ATTITUDE, lambda f: columns(f, "q"), "q"),),
    "wind": _WIND,
    "wind_estimate": _WIND,
}
