"""What one flight tells of the constant errors of its sensors, for a comparison with other flights.

Scales and offsets of airspeed and vanes are those of a filter that has them as states
(``reconstruction.air_data_errors``), beside what the aircraft file says of them; biases of the IMU are those of the
replay at its end. What a flight has not told keeps the uncertainty that the filter began with: it is held, and so is a
scale in gusts, which stand for one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.flight.constant_errors import NAMES, air_data_errors, is_told, offset_of
from aircraft_sysid_ros.diagnosis.flight.reconstruction import AIR_DATA, as_flown
from aircraft_sysid_ros.reconstruction.absences import has_airspeed
from aircraft_sysid_ros.reconstruction.alignment import ACCELEROMETER_BIAS_STD, GYRO_BIAS_STD
from aircraft_sysid_ros.samples import Kind, Samples

USE, HOLD = "USE", "HOLD"
#: Of the standard deviation before the flight that is left where a flight has told a number.
LEARNT = 0.25
_IMU = {"accelerometer_bias": ACCELEROMETER_BIAS_STD, "gyro_bias": GYRO_BIAS_STD}
Row = dict[str, Any]


def sensor_errors(aircraft: Aircraft, samples: Samples, state: Mapping[str, Any]) -> list[Row]:
    """Rows of name, value, std and status; noise and gusts are those of the flight. ``state``: of state.json."""
    if np.any(samples.kind == Kind.SEAM) or not has_airspeed(samples):
        return [*_of_imu(state)]
    flown, calm = as_flown(aircraft, samples)
    return [*_of_air_data(air_data_errors(flown, samples), samples, calm), *_of_imu(state)]


def _of_air_data(known: Mapping[str, Mapping[str, float]], samples: Samples, calm: bool) -> Iterator[Row]:
    for sensor, kind in AIR_DATA.items():
        name = NAMES[kind]
        shown = samples.values[samples.kind == kind, 0]
        if not known or not np.isfinite(shown).any():
            continue
        scale = known[f"lambda_{name}"]
        gain = 1.0 / (1.0 + scale["value"])  # y_true = (1 + lambda) y + b
        yield _row(f"{sensor}.scale", gain, scale["std"] * gain**2, is_told(known, f"lambda_{name}", LEARNT) and calm)
        if kind != Kind.AIRSPEED:
            offset, std, _ = offset_of(known, samples, kind)
            yield _row(f"{sensor}.offset", -offset, std, is_told(known, f"b_{name}", LEARNT))


def _of_imu(state: Mapping[str, Any]) -> Iterator[Row]:
    for name, before in _IMU.items():
        for axis, value, std in zip("xyz", state[name], state[f"{name}_std"], strict=True):
            if value is not None and std is not None:
                yield _row(f"{name}.{axis}", value, std, std < LEARNT * before)


def _row(name: str, value: float, std: float, usable: bool) -> Row:
    return {"name": name, "value": float(value), "std": float(std), "status": USE if usable else HOLD}
