"""How fast the sensors of a recording are, whatever its aircraft file says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.pace import interval_of, sparse_interval
from aircraft_sysid_ros.samples import Kind, Samples

#: So few samples of a kind tell no rate.
_TOO_FEW = 10
_SENSORS = {
    Kind.IMU: ("accelerometer", "gyro"),
    Kind.GPS_POSITION: ("gps_position",),
    Kind.GPS_VELOCITY: ("gps_velocity",),
    Kind.AIRSPEED: ("airspeed", "angle_of_attack", "sideslip", "static_pressure"),  # and each its own, where it comes
    Kind.ANGLE_OF_ATTACK: ("angle_of_attack",),
    Kind.SIDESLIP: ("sideslip",),
    Kind.AIR: ("static_pressure",),
    Kind.CONTROLS: ("control_surfaces",),
    Kind.ATTITUDE: ("attitude",),
    Kind.MAGNETIC_FIELD: ("magnetometer",),
    Kind.HEIGHT: ("height_above_ground",),
}


def with_recorded_rates(aircraft: Aircraft, samples: Samples) -> Aircraft:
    """The aircraft with the rates that the sensors of a recording have: the median of the times between samples."""
    sensors = dict(aircraft.sensors)
    for kind, names in _SENSORS.items():
        if np.sum(samples.kind == kind) > _TOO_FEW and (interval := interval_of(samples, kind)) > 0.0:
            rate = 1.0 / interval
            for name in names:
                sensors[name] = replace(sensors[name], rate=rate)
    return replace(aircraft, sensors=sensors)


def with_sparse_rates(aircraft: Aircraft, samples: Samples) -> Aircraft:
    """The same where the IMU is sparse (``pace``); elsewhere the rates of the aircraft file stand."""
    return with_recorded_rates(aircraft, samples) if sparse_interval(samples) > 0.0 else aircraft
