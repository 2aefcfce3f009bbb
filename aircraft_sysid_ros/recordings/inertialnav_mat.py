"""Two logs of P. Riseborough's InertialNav: a small flying wing, no angles, no surfaces.

- TestLog2 (arrays with labels, ArduPlane): TimeMS of IMU, MAG, NTUN and CTUN and T of GPS are milliseconds of
  the autopilot; TimeMS of GPS is time of week and gives the date (T minus it is constant to 1 ms after the
  start). A row that repeats the time of week of the one before is no new fix. VZ is positive down (against
  the rate of altitude). Arspd is equivalent airspeed: the density is that of the logged ground pressure and
  temperature (GND_ABS_PRESS, GND_TEMP) at the barometric height. The magnetometer is mG without the
  autopilot's offsets, FRD; its heading at rest plus the logged declination agrees with the autopilot's to 1
  deg.
- SwissLog1 (one vector per channel): seconds since the start of the log. CourseDeg is in radians. The EAS2TAS
  of 1 in the file is not used: at 450 m the standard atmosphere makes it 1.022. The log has no date: it
  begins at SWISS_START.

Sensors are late by delays that the aircraft files say; the stamps are those of the log.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import (
    GAS_CONSTANT,
    LAPSE_RATE,
    SEA_LEVEL_PRESSURE,
    SEA_LEVEL_TEMPERATURE,
    STANDARD_GRAVITY,
    density_of,
)
from aircraft_sysid_ros.recordings.imported_log import Array, ImportedLog, ImportedTopic, gps_seconds, stamps
from aircraft_sysid_ros.ros_messages.conversion import (
    flu_from_frd,
    gps_fix_fields,
    gps_velocity_fields,
    imu_fields,
)

MILLISECOND = 1e-3
SEA_LEVEL_DENSITY = SEA_LEVEL_PRESSURE / (GAS_CONSTANT * SEA_LEVEL_TEMPERATURE)
TESLA_PER_GAUSS = 1e-4
TESLA_PER_MILLIGAUSS = 1e-7
CELSIUS = 273.15
SWISS_START = 1_388_534_400  # 2014-01-01, Unix time [s]
_FIX_3D = 3
_MISSING = {
    "angle_of_attack, sideslip": "not measured: NaN",
    "five_hole_probe": "not on this aircraft",
    "control_surfaces": "deflections are not in the log",
    "height_above_ground": "not measured",
    "mass_properties": "not known: state, bias and wind only",
    "imu/data orientation": "the autopilot's attitude is a reference to compare with, not an input",
}
Rows = dict[str, npt.NDArray[Any]]


def import_labelled(content: dict[str, Any]) -> ImportedLog:
    """an InertialNav log with labels"""
    imu, mag, gps, navigation, control = (_table(content, name) for name in ("IMU", "MAG", "GPS", "NTUN", "CTUN"))
    parameters = {str(name): value for name, value in content["PARM"]}
    new = (np.diff(gps["TimeMS"], prepend=-1.0) != 0.0) & (gps["Status"] >= _FIX_3D)
    gps = {name: column[new] for name, column in gps.items()}
    offset = float(np.median(gps["TimeMS"] - gps["T"])) * MILLISECOND
    start = gps_seconds(int(gps["Week"][0]), offset)

    def at(table: Rows, name: str = "TimeMS") -> npt.NDArray[np.int64]:
        return stamps(start, table[name] * MILLISECOND)

    force, rate = _vector(imu, "AccX", "AccY", "AccZ"), _vector(imu, "GyrX", "GyrY", "GyrZ")
    field = {"magnetic_field": flu_from_frd(_vector(mag, "MagX", "MagY", "MagZ")) * TESLA_PER_MILLIGAUSS}
    density = density_above(parameters["GND_ABS_PRESS"], parameters["GND_TEMP"] + CELSIUS, navigation["Alt"])
    topics = [
        ImportedTopic("imu/data", at(imu), imu_fields(force, rate), "IMU Gyr Acc"),
        ImportedTopic("imu/mag", at(mag), field, "MAG Mag"),
        *_gps(at(gps, "T"), gps["Lat"], gps["Lng"], gps["Alt"], gps["Spd"], np.radians(gps["GCrs"]), gps["VZ"]),
        ImportedTopic("air_data", at(navigation), _air_data(navigation["Arspd"], density), "NTUN Arspd Alt"),
        ImportedTopic("control_surfaces", at(control), {"throttle": control["ThrOut"] / 100.0}, "CTUN ThrOut"),
    ]
    missing = _MISSING | {"control_surfaces": "deflections are not in the log: only the throttle command"}
    notes = ["the delays of GPS and airspeed are in config/inertialnav_testlog2.yaml"]
    return ImportedLog("InertialNav, ArduPlane arrays with labels", topics, missing, notes)


def import_vectors(content: dict[str, Any]) -> ImportedLog:
    """an InertialNav log with a vector for each channel"""
    field = np.stack([content[name] for name in ("MagX", "MagY", "MagZ")], axis=1)
    new = np.any(np.diff(field, axis=0, prepend=np.nan) != 0.0, axis=1)  # held in between
    magnetic = {"magnetic_field": flu_from_frd(field[new]) * TESLA_PER_GAUSS}
    density = density_above(SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE, content["HgtBaro"])
    imu = imu_fields(content["accel"], content["angRate"])
    topics = [
        ImportedTopic("imu/data", stamps(SWISS_START, content["IMUtime"]), imu, "angRate accel"),
        ImportedTopic("imu/mag", stamps(SWISS_START, content["MAGtime"][new]), magnetic, "MagX MagY MagZ, new ones"),
        *_gps(
            stamps(SWISS_START, content["GPStime"]),
            *(content[name] for name in ("LatDeg", "LngDeg", "Hgt", "GndSpd", "CourseDeg", "VelD")),
        ),
        ImportedTopic(
            "air_data",
            stamps(SWISS_START, content["ADStime"]),
            _air_data(content["Veas"], density),
            "Veas HgtBaro",
        ),
    ]
    notes = [
        "the log has no date: it is stamped from 2014-01-01",
        "the delays of GPS, airspeed and magnetometer are in config/inertialnav_swisslog.yaml",
    ]
    return ImportedLog("InertialNav, a vector for each channel", topics, _MISSING, notes)


def density_above(pressure: float, temperature: float, height: Array) -> Array:
    """Density [kg/m^3] (n,) at ``height`` [m] (n,) above a place of that pressure [Pa], temperature [K]."""
    cooler = temperature - LAPSE_RATE * height
    aloft = pressure * (cooler / temperature) ** (STANDARD_GRAVITY / (GAS_CONSTANT * LAPSE_RATE))
    return density_of(aloft, cooler)


def _table(content: dict[str, Any], name: str) -> Rows:
    """Columns by label."""
    labels = [str(label) for label in content[f"{name}_label"]]
    return {label: content[name][:, i].astype(np.float64) for i, label in enumerate(labels)}


def _vector(table: Rows, *names: str) -> Array:
    return np.stack([table[name] for name in names], axis=1)


def _air_data(equivalent_airspeed: Array, density: Array) -> dict[str, Array]:
    airspeed = np.maximum(equivalent_airspeed, 0.0) * np.sqrt(SEA_LEVEL_DENSITY / density)
    return {"true_airspeed": airspeed, "air_density": density}


def _gps(
    stamp: npt.NDArray[np.int64], lat: Array, lon: Array, alt: Array, speed: Array, course: Array, down: Array
) -> list[ImportedTopic]:
    """Fix from degrees and m; velocity from ground speed [m/s], course [rad] and descent [m/s]; all (n,)."""
    velocity = np.stack([speed * np.cos(course), speed * np.sin(course), down], axis=1)
    fix = gps_fix_fields(np.radians(lat), np.radians(lon), alt)
    return [
        ImportedTopic("gps/fix", stamp, fix, "GPS latitude longitude altitude", "gps"),
        ImportedTopic("gps/vel", stamp, gps_velocity_fields(velocity), "GPS speed, course and rate of descent", "gps"),
    ]
