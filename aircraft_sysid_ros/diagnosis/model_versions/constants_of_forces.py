"""The constant of a force takes up the bias of the accelerometer: how well that is known is in its standard error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import FORCES
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run
from aircraft_sysid_ros.run_reader import UNREADABLE, read_state

Array = npt.NDArray[np.float64]


def with_bias(run: Run, flight: FlightData) -> Callable[[str, str, float], float]:
    """A function of axis, name of a parameter and its standard error by the fit, that gives the whole one."""
    qbar = flight.signal("qbar")
    known = qbar[np.isfinite(qbar)]
    per_bias = flight.aircraft.mass / (float(np.median(known)) * flight.aircraft.wing_area) if len(known) else 0.0
    of_force = dict(zip(FORCES, per_bias * _bias_std(run), strict=True))

    def whole(axis: str, name: str, std: float) -> float:
        return float(np.hypot(std, of_force[axis])) if axis in of_force and name == f"{axis}_0" else std

    return whole


def _bias_std(run: Run) -> Array:
    """How well the bias of the accelerometer is known (3,) [m/s^2]; 0 where the run does not say."""
    try:
        stated = read_state(run.path).get("accelerometer_bias_std") or [None] * 3
    except UNREADABLE:  # said of that file
        stated = [None] * 3
    return np.array([float(value or 0.0) for value in stated])
