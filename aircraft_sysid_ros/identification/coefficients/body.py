"""Mass properties and geometry as the second step uses them, and how they change in flight."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, inertia_matrix
from aircraft_sysid_ros.aircraft.earth import gravity
from aircraft_sysid_ros.identification.coefficients.layout import Body

Array = npt.NDArray[np.float64]


def body_of(aircraft: Aircraft) -> Body:
    """Body as the aircraft file has it."""
    return Body(
        mass=aircraft.mass,
        inertia=aircraft.inertia,
        imu=aircraft.imu_position,
        reference=aircraft.aerodynamic_reference,
        geometry=np.array([aircraft.wing_area, aircraft.span, aircraft.chord]),
        gravity=float(gravity(0.8, 0.0)),  # only in the rates of alpha and beta, where 0.3 % do not matter
        minimum_airspeed=aircraft.minimum_airspeed,
    )


def force_noise(aircraft: Aircraft, half_width: float) -> float:
    """One sigma [N] of the accelerometer's white noise, averaged over a window of ``half_width`` [s], times mass."""
    accelerometer = aircraft.sensors["accelerometer"]
    window = max(half_width * accelerometer.rate, 1.0)
    return float(aircraft.mass * accelerometer.noise[0] / np.sqrt(window))


def body_with(aircraft: Aircraft, body: Body, values: Array) -> Body:
    """Body after a MASS sample: what is NaN in it stays as it was, and so does an inertia that none has."""
    before = [*np.diag(body.inertia), -body.inertia[0, 2]]
    inertia = np.where(np.isfinite(values[1:5]), values[1:5], before)
    matrix = inertia_matrix(*inertia)
    shift = np.where(np.isfinite(values[5:8]), values[5:8], aircraft.imu_position - body.imu)
    return body._replace(
        mass=float(values[0]) if np.isfinite(values[0]) and values[0] > 0.0 else body.mass,
        inertia=body.inertia if np.any(np.linalg.eigvalsh(matrix) <= 0.0) else matrix,
        imu=aircraft.imu_position - shift,
        reference=aircraft.aerodynamic_reference - shift,
    )
