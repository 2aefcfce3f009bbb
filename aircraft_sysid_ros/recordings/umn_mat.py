"""Flights of the UAV Lab, University of Minnesota: Ultra Stick 25e "Thor" with a five-hole probe.

How each channel was understood (flight 75; "fit" is a least-squares fit over the flight under autopilot):

- time: seconds since power-up. The clock is set by GPS time of week, which belongs to the date in the file.
- Rows before the IMU reports (imuStatus 0) are left out.
- GPS: a fix is new where GPS_TOW changes; before the first, TOW is 0 and the position a constant (45, -93).
- The surfaces are commands of the autopilot and frozen at the last value while the pilot flies (mode 1), when
  the servos follow the pilot's channels instead: they are NaN there. Positive is trailing edge down for
  elevator and each aileron: da_r = -da_l, and positive da_r rolls left (fit: Cl_da < 0, Cm_de < 0, as in the
  lab's own model), so that aileron = (da_r - da_l) / 2.
- IMU: once the onboard filter runs (25 s) the recorded rates and accelerations are less its bias estimates.
  At rest p is -0.0198 rad/s before and 0.0002 after, with p_bias -0.0204; ax is 1.92 and 1.53 m/s^2, with
  ax_bias 0.37: the estimates are added back, so that the recording is what the sensors gave.
- Air data are made from the pressures. Each pressure reads its zero (median while the aircraft stands) when
  there is no flow: without it, Pd alone is wrong by 5.9 m/s at rest. The onboard ``ias`` is the same thing,
  equivalent airspeed without the zero (fit: sqrt(2 (Pd + 19.7 Pa) / 1.225) to 0.001 m/s); true airspeed uses
  the density of the measured static pressure and the standard temperature at it.
- Angles: the firmware's calibration of the probe plus its 3.50 deg mount offset. The onboard ``aoa`` and
  ``aos`` are these angles (fit: to 0.006 deg) carried to the centre of gravity with the raw gyros, by + 0.178
  q/V - 0.360 p/V and - 0.178 r/V. That correction belongs to the estimator, which knows the gyro biases and
  also corrects the airspeed: here the angles are those at the probe, 0.178 m ahead and 0.360 m to the right.
- Angles need flow: below MINIMUM_DYNAMIC_PRESSURE they are NaN.
- Magnetometer: axes are forward-left-up and the hard iron of the aircraft, about as large as the field, is
  not removed. ``imu/mag`` is without HARD_IRON (fit with the onboard attitude, residual 0.01 gauss);
  ``imu/mag_raw`` is as measured.
"""

from __future__ import annotations

import re
from datetime import date, datetime
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.atmosphere import density_at
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.imported_log import Array, ImportedLog, ImportedTopic, gps_seconds, stamps
from aircraft_sysid_ros.ros_messages.conversion import (
    TOPICS,
    gps_fix_fields,
    gps_velocity_fields,
    imu_fields,
)

PASCAL_PER_KILOPASCAL = 1000.0
TESLA_PER_GAUSS = 1e-4
#: alpha [deg] of the pressure ratio Pd_aoa / Pd, highest power first, and beta [deg] per ratio Pd_aos / Pd.
ALPHA_CALIBRATION = (0.9898, -0.0666, 13.566, 0.5297)
BETA_PER_RATIO = 1.0 / 0.068
MOUNT_OFFSET = 3.50  # [deg] of alpha
MINIMUM_DYNAMIC_PRESSURE = 30.0  # [Pa] 7 m/s: the noise of 2 Pa is then 1 deg
STANDING_SPEED = 1.0  # [m/s] over ground
HARD_IRON = (0.392, 0.164, -0.421)  # [gauss] forward, left, up
_AUTOPILOT = 2  # mode
_FIRST_WEEK = date(1980, 1, 6)


def _raw(data: Any, name: str) -> Array:
    """What the sensor gave, (n,): the recorded channel has the onboard bias estimate taken out."""
    return np.asarray(getattr(data, name) + getattr(data, f"{name}_bias"), dtype=np.float64)


def import_flight_data(content: dict[str, Any]) -> ImportedLog:
    """a flight of the UMN UAV Lab"""
    data = content["flight_data"]
    start = _start(data, content.get("flight_info"))
    topics = [*_imu(data, start), *_gps(data, start), *_air(data, start), _surfaces(data, start)]
    missing = {
        "control_surfaces while the pilot flies": "the recorded commands are frozen then: NaN",
        "flaps, thrust, propeller_speed": "not measured on the clock of the flight computer: NaN",
        "height_above_ground": "the barometric height is not the height above ground",
        "mass_properties": "constant, see the aircraft file",
        "imu/data orientation": "the onboard attitude is a reference to compare with, not an input",
    }
    notes = [
        "angles are at the probe: air_data_position is [0.178, 0.36, 0] in the aircraft file",
        f"imu/mag is without the hard iron {HARD_IRON} gauss (FLU); imu/mag_raw is as measured",
    ]
    return ImportedLog("UMN UAV Lab flight_data", topics, missing, notes)


def _start(data: Any, information: Any) -> float:
    """Unix time [s] of time 0: date of the file and GPS time of week, whose offset is constant (median)."""
    match = re.match(r"\d{1,2}-\w{3}-\d{4}", str(getattr(information, "date", "")))
    if match is None:
        raise InputError("flight_info.date is missing: it must say the day of the flight such as 10-Oct-2012")
    day = datetime.strptime(match.group(), "%d-%b-%Y").date()
    new = _new_fixes(data)
    if len(new) == 0:
        raise InputError("the flight has no GPS fix: it cannot be used")
    return gps_seconds((day - _FIRST_WEEK).days // 7, float(np.median(data.GPS_TOW[new] - data.time[new])))


def _new_fixes(data: Any) -> np.ndarray:
    """Rows with a new and valid fix."""
    time_of_week = data.GPS_TOW
    return np.flatnonzero((np.diff(time_of_week, prepend=time_of_week[0]) != 0.0) & (time_of_week > 0.0))


def _imu(data: Any, start: float) -> list[ImportedTopic]:
    works = data.imuStatus > 0
    stamp = stamps(start, data.time[works])
    force = np.stack([_raw(data, name) for name in ("ax", "ay", "az")], axis=1)[works]
    rate = np.stack([_raw(data, name) for name in ("p", "q", "r")], axis=1)[works]
    measured = works & ((data.hx != 0.0) | (data.hy != 0.0) | (data.hz != 0.0))
    field = np.stack([data.hx, data.hy, data.hz], axis=1)[measured]  # its axes are FLU already
    mag, raw = ({"magnetic_field": f * TESLA_PER_GAUSS} for f in (field - np.array(HARD_IRON), field))
    magnetic = stamps(start, data.time[measured])
    source = "ax ay az p q r with the onboard biases put back"
    return [
        ImportedTopic("imu/data", stamp, imu_fields(force, rate), source),
        ImportedTopic("imu/mag", magnetic, mag, "hx hy hz without hard iron"),
        ImportedTopic("imu/mag_raw", magnetic, raw, "hx hy hz", type_name=TOPICS["imu/mag"]),
    ]


def _gps(data: Any, start: float) -> list[ImportedTopic]:
    new = _new_fixes(data)
    stamp = stamps(start, data.time[new])
    fix = gps_fix_fields(np.radians(data.lat[new]), np.radians(data.lon[new]), data.alt[new])
    velocity = gps_velocity_fields(np.stack([data.vn, data.ve, data.vd], axis=1)[new])
    return [
        ImportedTopic("gps/fix", stamp, fix, "lat lon alt where GPS_TOW changes", "gps"),
        ImportedTopic("gps/vel", stamp, velocity, "vn ve vd where GPS_TOW changes", "gps"),
    ]


def _air(data: Any, start: float) -> list[ImportedTopic]:
    stamp = stamps(start, data.time)
    static, total, alpha, beta = (
        PASCAL_PER_KILOPASCAL * np.asarray(channel, dtype=np.float64)
        for channel in (data.Ps, data.Pd, data.Pd_aoa, data.Pd_aos)
    )
    pressures = {
        "static_pressure": static, "dynamic_pressure": total, "alpha_pressure": alpha, "beta_pressure": beta,
    }  # fmt: skip
    stands = (data.GPS_TOW > 0.0) & (np.hypot(data.vn, data.ve) < STANDING_SPEED)
    zeros = [float(np.median(pressure[stands])) for pressure in (total, alpha, beta)]
    air = air_data(static, total - zeros[0], alpha - zeros[1], beta - zeros[2])
    return [
        ImportedTopic("air_data", stamp, air, "Pd Pd_aoa Pd_aos Ps, calibrated", "five_hole_probe"),
        ImportedTopic("five_hole_probe", stamp, pressures, "Ps Pd Pd_aoa Pd_aos, raw", "five_hole_probe"),
    ]


def air_data(static: Array, dynamic: Array, alpha_pressure: Array, beta_pressure: Array) -> dict[str, Array]:
    """Fields of AirData (n,) from pressures (n,) [Pa] without their zeros, by the firmware's calibration."""
    density = density_at(static)
    flow = np.where(dynamic >= MINIMUM_DYNAMIC_PRESSURE, dynamic, np.nan)
    return {
        "true_airspeed": np.sqrt(2.0 * np.maximum(dynamic, 0.0) / density),
        "angle_of_attack": np.radians(np.polyval(ALPHA_CALIBRATION, alpha_pressure / flow) + MOUNT_OFFSET),
        "sideslip": np.radians(BETA_PER_RATIO * beta_pressure / flow),
        "air_density": density,
        "static_pressure": static,
    }


def _surfaces(data: Any, start: float) -> ImportedTopic:
    commanded = data.mode == _AUTOPILOT
    fields = {
        "elevator": data.de,
        "aileron": 0.5 * (data.da_r - data.da_l),
        "rudder": data.dr,
        "throttle": data.dthr,
    }
    fields = {name: np.where(commanded, channel, np.nan) for name, channel in fields.items()}
    source = "de (da_r-da_l)/2 dr dthr, commands of the autopilot"
    return ImportedTopic("control_surfaces", stamps(start, data.time), fields, source)
