"""MAVLink (common and ardupilotmega) to quantities: one table for the bridge and for telemetry logs.

Units and frames as the dialect files define them: accelerations in mG and rates in mrad/s of SCALED_IMU and RAW_IMU (as
ArduPilot fills it), degrees times 1e7, mm, cm/s, centi-degrees, hPa; body axes FRD, world NED. 65535 and the like mean
"not known". HIGHRES_IMU and the others report specific force: -9.8 on z at rest.
"""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.mavlink.quantities import (
    Array,
    Entry,
    Fields,
    Quantity,
    Table,
    columns,
    entry,
    position_of_fix,
    quaternion_of_euler,
)
from aircraft_sysid_ros.ros_messages.conversion import NO_FIX, UNKNOWN_FIX

_MILLI_G = 1e-3 * STANDARD_GRAVITY
_TESLA_PER_GAUSS = 1e-4
_LARGEST_FIELD = 1.0  # [T] the earth's is 7e-5
_KELVIN = 273.15
_UNKNOWN_16 = 65535
_FIX_2D = 2
_DIFFERENTIAL_PRESSURE = 16  # bit of MAV_SYS_STATUS_SENSOR
_UNHEALTHY = 1  # bit of AIRSPEED_SENSOR_FLAGS
SERVO_COUNT = 16


def _whole_imu(fields: Fields) -> Array:
    """HIGHRES_IMU in SI; the main IMU has the id 0."""
    values = columns(fields, "xacc yacc zacc xgyro ygyro zgyro")
    values[fields["id"] != 0] = np.nan
    return values


def _scaled_imu(fields: Fields) -> Array:
    force, rate = columns(fields, "xacc yacc zacc", _MILLI_G), columns(fields, "xgyro ygyro zgyro", 1e-3)
    values = np.concatenate([force, rate], axis=1)
    if "id" in fields:
        values[fields["id"] != 0] = np.nan
    return values


def _magnetic(scale: float) -> Entry:
    """Field by a scale of the definition; ArduPilot up to 4.6 multiplies HIGHRES_IMU's milligauss by 1000."""

    def values(fields: Fields) -> Array:
        field = columns(fields, "xmag ymag zmag", scale)
        field[np.all(field == 0.0, axis=1)] = np.nan  # there is no magnetometer
        field[np.linalg.norm(field, axis=1) > _LARGEST_FIELD] *= 1e-6
        return field

    return entry(Quantity.MAGNETIC_FIELD, values, "xmag ymag zmag")


def _gps_position(fields: Fields) -> Array:
    """Fix; a GPS that does not state its accuracy (0) leaves it to the aircraft file."""
    place = np.concatenate([np.radians(columns(fields, "lat lon", 1e-7)), columns(fields, "alt", 1e-3)], axis=1)
    across, up = columns(fields, "h_acc", 1e-3)[:, 0], columns(fields, "v_acc", 1e-3)[:, 0]
    variance = np.stack([0.5 * across**2, 0.5 * across**2, up**2], axis=1)  # h_acc is a radius
    variance[~((across > 0.0) & (up > 0.0))] = np.nan
    return position_of_fix(place, variance, fields["fix_type"])


def _gps_velocity(fields: Fields) -> Array:
    """Speed and course over ground; the message has no vertical velocity."""
    speed, course = columns(fields, "vel", 1e-2)[:, 0], np.radians(columns(fields, "cog", 1e-2)[:, 0])
    velocity = np.stack([speed * np.cos(course), speed * np.sin(course), np.full(len(speed), np.nan)], axis=1)
    unknown = (fields["vel"] == _UNKNOWN_16) | (fields["cog"] == _UNKNOWN_16) | (fields["fix_type"] < _FIX_2D)
    velocity[unknown] = np.nan
    return velocity


def _global_position(fields: Fields) -> Array:
    """Of the autopilot's filter, which does not say what fix it has."""
    place = np.concatenate([np.radians(columns(fields, "lat lon", 1e-7)), columns(fields, "alt", 1e-3)], axis=1)
    place[(fields["lat"] == 0) & (fields["lon"] == 0)] = np.nan
    status = np.where(np.isnan(place[:, :1]), NO_FIX, UNKNOWN_FIX)
    return np.concatenate([place, np.full((len(place), 3), np.nan), status], axis=1)


def _pressure(fields: Fields) -> Array:
    pressure, temperature = columns(fields, "press_abs", 100.0), columns(fields, "temperature", 0.01) + _KELVIN
    values = np.concatenate([pressure, temperature], axis=1)
    values[values[:, 0] <= 0.0] = np.nan
    return values


def _imu_pressure(fields: Fields) -> Array:
    pressure, temperature = columns(fields, "abs_pressure", 100.0), columns(fields, "temperature") + _KELVIN
    values = np.concatenate([pressure, temperature], axis=1)
    values[(values[:, 0] <= 0.0) | (fields["id"] != 0)] = np.nan
    return values


def _servos(fields: Fields, port: int = 0) -> Array:
    """Pulses of a bank of outputs, the first by default; 0 and 65535 are outputs that are not there."""
    names = [f"servo{i}_raw" for i in range(1, SERVO_COUNT + 1)]
    pulses = columns(fields, " ".join(names))
    pulses[(pulses == 0.0) | (pulses == _UNKNOWN_16)] = np.nan
    pulses[fields["port"] != port] = np.nan
    return pulses


def _actuators(fields: Fields) -> Array:
    """Outputs of PX4, of which ``active`` is a set of bits."""
    values = columns(fields, "actuator")
    active = np.asarray(fields["active"], dtype=np.int64)[:, None] >> np.arange(values.shape[1]) & 1
    return np.where(active > 0, values, np.nan)


def _esc_status(fields: Fields) -> Array:
    """Four engines from ``index`` on."""
    speeds = columns(fields, "rpm")
    values = np.full((len(speeds), 16), np.nan)
    for i, first in enumerate(np.asarray(fields["index"], dtype=np.int64)):
        if 0 <= first <= 12:
            values[i, first : first + 4] = speeds[i]
    return values


def _rpm(fields: Fields) -> Array:
    speeds = columns(fields, "rpm1 rpm2")
    return np.where(speeds >= 0.0, speeds, np.nan)  # -1: no sensor


def _wind(fields: Fields) -> Array:
    """ArduPilot's WIND says where the wind comes from; speed_z is down, of the air."""
    towards = np.radians(columns(fields, "direction")[:, 0]) + np.pi
    speed, down = columns(fields, "speed")[:, 0], columns(fields, "speed_z")[:, 0]
    wind = np.stack([speed * np.cos(towards), speed * np.sin(towards), down], axis=1)
    return np.concatenate([wind, np.full_like(wind, np.nan)], axis=1)


def _wind_covariance(fields: Fields) -> Array:
    """WIND_COV: its var_ fields are the variability of the wind; what is known of it are the accuracies, one sigma."""
    level, vertical = columns(fields, "horiz_accuracy") ** 2, columns(fields, "vert_accuracy") ** 2
    variance = np.concatenate([level, level, vertical], axis=1)
    return np.concatenate([columns(fields, "wind_x wind_y wind_z"), np.where(variance > 0.0, variance, np.nan)], axis=1)


def _airspeed(fields: Fields) -> Array:
    speed = columns(fields, "airspeed")
    is_unhealthy = np.asarray(fields["flags"], dtype=np.int64) & _UNHEALTHY > 0
    speed[(fields["id"] != 0) | is_unhealthy] = np.nan
    return speed


def _has_airspeed_sensor(fields: Fields) -> Array:
    """Whether a sensor is there and healthy: else what the autopilot shows as its airspeed is an estimate."""
    present, healthy = (
        np.asarray(fields[f"onboard_control_sensors_{word}"], dtype=np.int64) for word in ("present", "health")
    )
    return (present & healthy & _DIFFERENTIAL_PRESSURE > 0).astype(np.float64)[:, None]


_SENSORS = "onboard_control_sensors_present onboard_control_sensors_health"


_ACC_GYRO = "xacc yacc zacc xgyro ygyro zgyro"
MAVLINK: Table = {
    "HIGHRES_IMU": (
        entry(Quantity.IMU, _whole_imu, f"{_ACC_GYRO} id"),
        _magnetic(_TESLA_PER_GAUSS),
        entry(Quantity.PRESSURE, _imu_pressure, "abs_pressure temperature id"),
        entry(Quantity.IMPACT_PRESSURE, lambda f: columns(f, "diff_pressure", 100.0), "diff_pressure"),
    ),
    "SCALED_IMU": (entry(Quantity.IMU, _scaled_imu, _ACC_GYRO), _magnetic(1e-3 * _TESLA_PER_GAUSS)),
    "RAW_IMU": (entry(Quantity.IMU, _scaled_imu, _ACC_GYRO), _magnetic(1e-3 * _TESLA_PER_GAUSS)),
    "GPS_RAW_INT": (
        entry(Quantity.POSITION, _gps_position, "fix_type lat lon alt h_acc v_acc"),
        entry(Quantity.VELOCITY, _gps_velocity, "fix_type vel cog"),
    ),
    "GLOBAL_POSITION_INT": (
        entry(Quantity.POSITION, _global_position, "lat lon alt"),
        entry(Quantity.VELOCITY, lambda f: columns(f, "vx vy vz", 1e-2), "vx vy vz"),
        entry(Quantity.DESCENT, lambda f: columns(f, "vz", 1e-2), "vz"),
    ),
    "SCALED_PRESSURE": (
        entry(Quantity.PRESSURE, _pressure, "press_abs temperature"),
        entry(Quantity.IMPACT_PRESSURE, lambda f: columns(f, "press_diff", 100.0), "press_diff"),
    ),
    "AIRSPEED": (entry(Quantity.AIRSPEED, _airspeed, "airspeed id flags"),),
    "VFR_HUD": (
        entry(Quantity.AIRSPEED, lambda f: columns(f, "airspeed"), "airspeed"),
        entry(Quantity.DESCENT, lambda f: columns(f, "climb", -1.0), "climb"),
    ),
    "AOA_SSA": (
        entry(Quantity.ANGLE_OF_ATTACK, lambda f: np.radians(columns(f, "AOA")), "AOA"),
        entry(Quantity.SIDESLIP, lambda f: np.radians(columns(f, "SSA")), "SSA"),
    ),
    "SERVO_OUTPUT_RAW": (
        entry(Quantity.PULSES, _servos, "servo1_raw servo16_raw port"),
        entry(Quantity.UPPER_PULSES, lambda f: _servos(f, port=1), "servo1_raw servo16_raw port"),
    ),
    "ACTUATOR_OUTPUT_STATUS": (entry(Quantity.PULSES, _actuators, "actuator active"),),
    "RPM": (entry(Quantity.PROPELLER, _rpm, "rpm1 rpm2"),),
    "ESC_STATUS": (entry(Quantity.PROPELLER, _esc_status, "rpm index"),),
    "ESC_TELEMETRY_1_TO_4": (entry(Quantity.PROPELLER, lambda f: columns(f, "rpm"), "rpm"),),
    "ATTITUDE_QUATERNION": (entry(Quantity.ATTITUDE, lambda f: columns(f, "q1 q2 q3 q4"), "q1 q2 q3 q4"),),
    "ATTITUDE": (
        entry(Quantity.ATTITUDE, lambda f: quaternion_of_euler(columns(f, "roll pitch yaw")), "roll pitch yaw"),
    ),
    "WIND_COV": (entry(Quantity.WIND, _wind_covariance, "wind_x wind_y wind_z horiz_accuracy vert_accuracy"),),
    "WIND": (entry(Quantity.WIND, _wind, "direction speed speed_z"),),
    "SYS_STATUS": (entry(Quantity.AIRSPEED_SENSOR, _has_airspeed_sensor, _SENSORS),),
}
