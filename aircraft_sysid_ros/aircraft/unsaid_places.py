"""How far sensors may be from where they are taken to be, where an aircraft file leaves that out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft

Vector = npt.NDArray[np.float64]

#: One sigma of the place of an IMU that nobody has given, in each axis, over the span: autopilots sit in the fuselage.
PLACE = np.full(3, 0.03)
#: The same of vanes, ahead, to the right and below: the boom of a jet is half a span long; farther out on the wing is
#: found in flight.
VANE_PLACE = np.array([0.25, 0.05, 0.03])
#: Share of the span by which a vane that is elsewhere matters.
MATTERS = 0.1
#: One sigma [m/s] and correlation time [s] of what else moves a vane up and down while the wing rolls, gusts mostly.
_UP_AND_DOWN, _LASTS = 0.25, 0.4


def unsaid_keys(aircraft: Aircraft) -> list[str]:
    """Keys of the aircraft file for places of sensors that it leaves out, or a part of."""
    return sorted({key for key, _ in aircraft.unsaid}, reverse=True)


def doubt_of_imu(aircraft: Aircraft) -> Vector:
    """One sigma (3,) [m] of the position of the IMU, 0 of what is said."""
    return _doubt(aircraft, "imu_position", PLACE)


def doubt_of_vanes(aircraft: Aircraft) -> Vector:
    """One sigma (3,) [m] of the position of the vanes, 0 of what is said."""
    return _doubt(aircraft, "air_data_position", VANE_PLACE)


def _doubt(aircraft: Aircraft, key: str, of_span: Vector) -> Vector:
    sigma = np.array([aircraft.unsaid.get((key, at), 0.0) for at in "xyz"])
    return np.where(np.isnan(sigma), aircraft.span * of_span, sigma)


def roll_that_shows(span: float) -> float:
    """Integral of the square of the roll rate [rad^2/s] from which a vane shows to MATTERS of the span where it is, in
    gusts that are light; in moderate ones four times as much.
    """
    return _LASTS * (_UP_AND_DOWN / (MATTERS * span)) ** 2
