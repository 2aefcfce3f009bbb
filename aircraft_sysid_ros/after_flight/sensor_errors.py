"""What one flight tells of the constant errors of its sensors, for a comparison with other flights.

Scales and offsets of airspeed and vanes are those of a filter that has them as states
(``reconstruction.air_data_errors``), beside what the aircraft file says of them; biases of the IMU are those of the
replay at its end. What a flight has not told keeps the uncertainty that the filter began with: it is held, and so is a
scale in gusts, which stand for one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.flight.reconstruction import as_flown
from aircraft_sysid_ros.reconstruction.absences import has_airspeed
from aircraft_sysid_ros.reconstruction.air_data_errors import UNKNOWN_STD_OF
from aircraft_sysid_ros.reconstruction.alignment import ACCELEROMETER_BIAS_STD, GYRO_BIAS_STD
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples

USE, HOLD = "USE", "HOLD"
#: Of the standard deviation before the flight that is left where a flight has told a number.
LEARNT = 0.25
#: Sensors by the name of their errors in the filter, as the aircraft file calls them.
_AIR_DATA = {
    "V": ("airspeed", Kind.AIRSPEED),
    "alpha": ("angle_of_attack", Kind.ANGLE_OF_ATTACK),
    "beta": ("sideslip", Kind.SIDESLIP),
}
_IMU = {"accelerometer_bias": ACCELEROMETER_BIAS_STD, "gyro_bias": GYRO_BIAS_STD}
Row = dict[str, Any]


class Offset(NamedTuple):
    """Constant error of a vane [rad], its standard deviation, and what of that is the doubt in the attitude."""

    value: float
    std: float
    of_attitude: float = 0.0


def air_data_errors(aircraft: Aircraft, samples: Samples) -> dict[str, dict[str, float]]:
    """Value and standard deviation by the names of the filter; nothing of a flight in pieces or without airspeed."""
    if np.any(samples.kind == Kind.SEAM) or not np.any(samples.kind == Kind.AIRSPEED):
        return {}
    estimator = StateEstimator(aircraft, StateOptions(air_data_errors=True))
    estimator.push(samples)
    estimator.flush()
    return estimator.air_data_errors


def offset_of(known: Mapping[str, Mapping[str, float]], samples: Samples, name: str, kind: Kind) -> Offset:
    """Constant error of a vane, of ``air_data_errors``.

    At the median angle: what gusts feign as a scale they take off the constant.
    """
    shown = samples.values[samples.kind == kind, 0]
    usual = float(np.nanmedian(shown)) if np.isfinite(shown).any() else 0.0
    constant = known[f"b_{name}"]
    value = constant["value"] + known[f"lambda_{name}"]["value"] * usual
    return Offset(value, constant["std"], constant.get("of_attitude", 0.0))


def sensor_errors(aircraft: Aircraft, samples: Samples, state: Mapping[str, Any]) -> list[Row]:
    """Rows of name, value, std and status; noise and gusts are those of the flight. ``state``: of state.json."""
    if np.any(samples.kind == Kind.SEAM) or not has_airspeed(samples):
        return [*_of_imu(state)]
    flown, calm = as_flown(aircraft, samples)
    return [*_of_air_data(air_data_errors(flown, samples), samples, calm), *_of_imu(state)]


def _of_air_data(known: Mapping[str, Mapping[str, float]], samples: Samples, calm: bool) -> Iterator[Row]:
    for name, (sensor, kind) in _AIR_DATA.items():
        shown = samples.values[samples.kind == kind, 0]
        if not known or not np.isfinite(shown).any():
            continue
        scale = known[f"lambda_{name}"]
        gain = 1.0 / (1.0 + scale["value"])  # y_true = (1 + lambda) y + b
        is_told = scale["std"] < LEARNT * UNKNOWN_STD_OF[f"lambda_{name}"]
        yield _row(f"{sensor}.scale", gain, scale["std"] * gain**2, is_told and calm)
        if name != "V":
            offset, std, _ = offset_of(known, samples, name, kind)
            yield _row(f"{sensor}.offset", -offset, std, std < LEARNT * UNKNOWN_STD_OF[f"b_{name}"])


def _of_imu(state: Mapping[str, Any]) -> Iterator[Row]:
    for name, before in _IMU.items():
        for axis, value, std in zip("xyz", state[name], state[f"{name}_std"], strict=True):
            if value is not None and std is not None:
                yield _row(f"{name}.{axis}", value, std, std < LEARNT * before)


def _row(name: str, value: float, std: float, is_told: bool) -> Row:
    return {"name": name, "value": float(value), "std": float(std), "status": USE if is_told else HOLD}
