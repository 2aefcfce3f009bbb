"""Coefficients of force and moment of a recorded or simulated motion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft

Array = npt.NDArray[np.float64]


def coefficients_of_motion(
    aircraft: Aircraft, specific_force: Array, rates: Array, turning: Array, pressure: Array
) -> Array:
    """C_X … C_n (n, 6) about the aerodynamic reference, by (6.14)-(6.19) of Klein and Morelli.

    ``specific_force`` (n, 3) [m/s^2] at the centre of gravity, ``rates`` (n, 3) [rad/s] and ``turning`` (n, 3)
    [rad/s^2], their slopes, in FRD; ``pressure`` (n,) [Pa] is the dynamic one.
    """
    force = aircraft.mass * specific_force
    moment = turning @ aircraft.inertia.T + np.cross(rates, rates @ aircraft.inertia.T)
    moment = moment - np.cross(aircraft.aerodynamic_reference, force)
    scale = (pressure * aircraft.wing_area)[:, None]
    return np.hstack([force / scale, moment / (scale * [aircraft.span, aircraft.chord, aircraft.span])])
