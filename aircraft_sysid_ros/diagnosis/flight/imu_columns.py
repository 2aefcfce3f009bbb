"""What an IMU that is elsewhere adds to the force coefficients.

An accelerometer at r + d, of which the aircraft file says r, measures E d more than the force at the centre of
gravity, E d = ω' x d + ω x (ω x d), (6.3). The angular acceleration stands in the measured moments, (6.16)-(6.18): it
is averaged over the same windows as the forces are.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData

Array = npt.NDArray[np.float64]

FORCES = ("CX", "CY", "CZ")


def turning_of(data: FlightData) -> Array:
    """Angular acceleration (n, 3) [rad/s²] that the measured moments (n,) are."""
    aircraft = data.aircraft
    made = data.measured * (data.signal("qbar") * aircraft.wing_area)[:, None]
    force, moment = made[:, :3], made[:, 3:]
    rates = np.column_stack([data.signal(name) for name in "pqr"])
    moment = moment * [aircraft.span, aircraft.chord, aircraft.span] + np.cross(aircraft.aerodynamic_reference, force)
    moment -= np.cross(rates, rates @ aircraft.inertia.T)
    return np.asarray(np.linalg.solve(aircraft.inertia, moment.T).T)


def columns_of(data: FlightData) -> dict[str, Array]:
    """By force, what each coordinate of d [m] adds to its coefficient, (n, 3)."""
    rates = np.column_stack([data.signal(name) for name in "pqr"])
    turning, unit = turning_of(data), np.eye(3)
    felt = np.stack([np.cross(turning, e) + np.cross(rates, np.cross(rates, e)) for e in unit], axis=2)
    scale = data.aircraft.mass / (data.signal("qbar") * data.aircraft.wing_area)
    return {axis: data.within(felt[:, k] * scale[:, None]) for k, axis in enumerate(FORCES)}


def unsaid_columns(data: FlightData, axis: str) -> tuple[Array, list[str]]:
    """The same of the coordinates that nobody has said, (n, m), and their names."""
    unsaid = [k for k, at in enumerate("xyz") if axis in FORCES and ("imu_position", at) in data.aircraft.unsaid]
    if not unsaid:
        return np.empty((len(data.time), 0)), []
    return columns_of(data)[axis][:, unsaid], [f"{axis}_place_{'xyz'[k]}" for k in unsaid]
