"""What an IMU that is elsewhere adds to the force coefficients, and a vane to all.

An accelerometer at r + d, of which the aircraft file says r, measures E d more than the force at the centre of
gravity, E d = ω' x d + ω x (ω x d), (6.3). The angular acceleration stands in the measured moments, (6.16)-(6.18): it
is averaged over the same windows as the forces are.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import FORCES
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData

Array = npt.NDArray[np.float64]

_LONGITUDINAL = ("CX", "CZ", "Cm")


def rates_of(data: FlightData) -> Array:
    """Angular rates (n, 3) [rad/s] of the signals, which are p b/2V, q c/V, r b/2V."""
    lengths = np.array([0.5 * data.aircraft.span, data.aircraft.chord, 0.5 * data.aircraft.span])
    return np.column_stack([data.signal(name) for name in "pqr"]) * data.signal("V")[:, None] / lengths


def turning_of(data: FlightData) -> Array:
    """Angular acceleration (n, 3) [rad/s²] that the measured moments (n,) are."""
    aircraft = data.aircraft
    made = data.measured * (data.signal("qbar") * aircraft.wing_area)[:, None]
    force, moment = made[:, :3], made[:, 3:]
    rates = rates_of(data)
    moment = moment * [aircraft.span, aircraft.chord, aircraft.span] + np.cross(aircraft.aerodynamic_reference, force)
    moment -= np.cross(rates, rates @ aircraft.inertia.T)
    return np.asarray(np.linalg.solve(aircraft.inertia, moment.T).T)


def columns_of(data: FlightData) -> dict[str, Array]:
    """By force, what each coordinate of d [m] adds to its coefficient, (n, 3)."""
    rates = rates_of(data)
    turning, unit = turning_of(data), np.eye(3)
    felt = np.stack([np.cross(turning, e) + np.cross(rates, np.cross(rates, e)) for e in unit], axis=2)
    scale = data.per_acceleration[:, None]
    return {axis: data.within(felt[:, k] * scale) for k, axis in enumerate(FORCES)}


def unsaid_columns(data: FlightData, axis: str) -> tuple[Array, list[str]]:
    """What places that nobody has said may add to an axis, (n, m), and names: of the IMU to a force, of vanes to all.

    A vane at e from where it is taken to be shows (ω x e)/V more, of which each slope makes a part of its axis.
    """
    unsaid, rates = data.aircraft.unsaid, rates_of(data) / data.signal("V")[:, None]
    found: dict[str, Array] = {}
    if axis in FORCES:
        of_imu = columns_of(data)[axis]
        found |= {f"imu_{at}": of_imu[:, k] for k, at in enumerate("xyz") if ("imu_position", at) in unsaid}
    of_vane = {"x": -rates[:, 1], "y": rates[:, 0]} if axis in _LONGITUDINAL else {"x": rates[:, 2], "z": -rates[:, 0]}
    found |= {f"vane_{at}": values for at, values in of_vane.items() if ("air_data_position", at) in unsaid}
    if not found:
        return np.empty((len(data.time), 0)), []
    return np.column_stack(list(found.values())), [f"{axis}_place_{name}" for name in found]
