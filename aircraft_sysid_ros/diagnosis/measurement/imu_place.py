"""Where the IMU sits, sideways, as the forces tell it where gusts hide that from the likelihood of the first step.

What a place adds to the forces is in ``flight.place_columns``. So d is found beside the model's own parameters, by
least squares over both forces at once that it stands in, and judged on held-out flight. What turns an aeroplane in
gusts is mostly sideslip, which drives r' by its yaw stiffness: an IMU a third of a metre to the side had been "C_X
depends on beta".

An IMU aside adds the yaw acceleration to C_X and the roll acceleration to C_Z, by the same d. No air does that to a
symmetric aeroplane. A place ahead or below is left to the likelihood: what the angles of flow are wrong by in gusts,
and what meets the tail alone, makes a force and turns the aeroplane by it. In C_Y with r' and C_Z with q' that is an
IMU behind the centre of gravity, in C_Y with p' and C_X with q' one above it: a tenth of the span on clean flights.
"""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import FORCES
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.place_columns import columns_of
from aircraft_sysid_ros.diagnosis.measurement.setting import Setting
from aircraft_sysid_ros.diagnosis.search.evaluator import log_ratio, price_of_one, size_of
from aircraft_sysid_ros.diagnosis.search.fit import fits_of, tied_gains
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect

#: Number of the coordinate.
SIDEWAYS = 1
#: Farthest place [spans] that is believed.
FARTHEST = 0.3


def sideways_of_forces(data: FlightData) -> tuple[float, float] | None:
    """How much farther to the right the IMU is [spans] than the aircraft file says, and the evidence: 1 is needed.

    None where the forces do not tell, or speak against it.
    """
    fits, _ = fits_of(data, FORCES)
    columns = {axis: each[:, SIDEWAYS : SIDEWAYS + 1] for axis, each in columns_of(data).items() if axis in fits}
    gains = tied_gains(fits, columns, dict.fromkeys(columns, np.eye(1)))
    if not gains.keys() >= {"CX", "CZ"}:
        return None
    price = price_of_one(gains["CX"])
    place = float(gains["CX"].parameters[0]) / data.aircraft.span
    told = max(map(size_of, gains.values())) >= THRESHOLDS.size
    told = told and all(log_ratio(gains[axis]) > price for axis in ("CX", "CZ"))
    if not told or not abs(place) <= FARTHEST:
        return None
    return place, sum(map(log_ratio, gains.values())) / price


def setting_of_forces(data: FlightData, effect: Effect) -> Setting | None:
    """The same as a setting of the effect "imu_offset"; None where the forces do not tell."""
    told = sideways_of_forces(data)
    if told is None:
        return None
    place, evidence = float(f"{told[0]:.4g}"), told[1]
    return Setting(effect, effect.variants[SIDEWAYS], 0.0, place, 0.0, evidence, np.nan, of_coefficients=True)
