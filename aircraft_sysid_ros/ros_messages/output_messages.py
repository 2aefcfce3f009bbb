"""Estimates as ROS messages: the same fields for a recording (n at once) and for a live node (one)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import euler_angles
from aircraft_sysid_ros.identification.monitoring.error_window import AxisError
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.ros_messages.conversion import enu_from_ned

Array = npt.NDArray[np.float64]

STATE_TOPIC = "/state_estimator/state"
WIND_TOPIC = "/state_estimator/wind"
PARAMETERS_TOPIC = "/parameter_estimator/parameters"
MODEL_ERROR_TOPIC = "/parameter_estimator/model_error"
STATE_TYPE = "aircraft_sysid_msgs/msg/AircraftState"
WIND_TYPE = "geometry_msgs/msg/TwistWithCovarianceStamped"
PARAMETERS_TYPE = "aircraft_sysid_msgs/msg/Parameters"
MODEL_ERROR_TYPE = "aircraft_sysid_msgs/msg/ModelError"

#: Fields of AircraftState that are columns of a row of reconstructed states.
_STATE_COLUMNS: dict[str, slice | int] = {
    "air_velocity_body": StateField.AIR_VELOCITY,
    "position_ned": StateField.POSITION,
    "velocity_ned": StateField.VELOCITY,
    "attitude": StateField.ATTITUDE,
    "accelerometer_bias": StateField.ACCELEROMETER_BIAS,
    "gyro_bias": StateField.GYRO_BIAS,
    "wind_ned": StateField.WIND,
    "standard_deviations": StateField.STANDARD_DEVIATIONS,
    "specific_force": StateField.SPECIFIC_FORCE,
    "angular_velocity": StateField.ANGULAR_VELOCITY,
    "true_airspeed": StateField.AIRSPEED,
    "angle_of_attack": StateField.ANGLE_OF_ATTACK,
    "sideslip": StateField.SIDESLIP,
    "air_density": StateField.AIR_DENSITY,
    "air_velocity_std": StateField.AIR_VELOCITY_STD,
    "latitude_origin": StateField.ORIGIN.start,
    "longitude_origin": StateField.ORIGIN.start + 1,
    "altitude_origin": StateField.ORIGIN.start + 2,
    "innovation_consistency": StateField.CONSISTENCY,
}
_COUNT_COLUMNS = {"fused": StateField.FUSED, "rejected": StateField.REJECTED, "late": StateField.LATE}
#: STATUS_CONTRADICTED of AircraftState: so many times the number of the sensor is added to the status.
_CONTRADICTED = 16
_WIND_STD = slice(StateField.STANDARD_DEVIATIONS.stop - 3, StateField.STANDARD_DEVIATIONS.stop)


def state_fields(rows: Array) -> dict[str, npt.NDArray[Any]]:
    """Flat fields of AircraftState, each (n,) or (n, k), from rows (n, StateField.WIDTH); without status_text."""
    fields: dict[str, npt.NDArray[Any]] = {name: rows[:, at] for name, at in _STATE_COLUMNS.items()}
    fields.update({name: rows[:, at].astype(np.uint64) for name, at in _COUNT_COLUMNS.items()})
    contradiction = rows[:, StateField.CONTRADICTION].astype(np.uint8)
    fields["status"] = rows[:, StateField.STATUS].astype(np.uint8) + _CONTRADICTED * contradiction
    fields["euler"] = euler_angles(np.ascontiguousarray(rows[:, StateField.ATTITUDE]))
    return fields


def row_from_state(message: Any, time: float) -> Array:
    """Row (1, StateField.WIDTH) from a message AircraftState received live, exactly as it was sent."""
    row = np.full((1, StateField.WIDTH), np.nan)
    row[0, StateField.TIME] = time
    for name, at in _STATE_COLUMNS.items():
        row[0, at] = getattr(message, name)
    for name, at in _COUNT_COLUMNS.items():
        row[0, at] = getattr(message, name)
    row[0, StateField.CONTRADICTION], row[0, StateField.STATUS] = divmod(message.status, _CONTRADICTED)
    return row


def wind_fields(rows: Array) -> dict[str, npt.NDArray[Any]]:
    """Flat fields of TwistWithCovarianceStamped, ENU; what is not estimated has the covariance -1."""
    n = len(rows)
    variance = np.square(rows[:, _WIND_STD])[:, [1, 0, 2]]
    covariance = np.zeros((n, 36))
    for i in range(3):
        covariance[:, 7 * i] = np.where(np.isnan(variance[:, i]), -1.0, variance[:, i])
        covariance[:, 21 + 7 * i] = -1.0  # the rotation of the air is not estimated
    return {
        "twist.twist.linear": enu_from_ned(rows[:, StateField.WIND]),
        "twist.twist.angular": np.full((n, 3), np.nan),
        "twist.covariance": covariance,
    }


def parameters_content(estimates: ParameterSet) -> dict[str, Any]:
    """Content of the message Parameters, without the header."""
    return {
        "model": estimates.model,
        "parameters": [
            {
                "name": p.name,
                "value": p.value,
                "standard_deviation": p.std,
                "status": int(p.status),
                "reason": p.reason,
                "age": p.age,
                "excitation": p.excitation,
            }
            for p in estimates.parameters
        ],
        "covariance": estimates.covariance.ravel(),
        "airspeed_min": estimates.airspeed[0],
        "airspeed_max": estimates.airspeed[1],
        "alpha_min": estimates.alpha[0],
        "alpha_max": estimates.alpha[1],
        "beta_min": estimates.beta[0],
        "beta_max": estimates.beta[1],
    }


def model_error_content(model: str, window: float, errors: list[AxisError]) -> dict[str, Any]:
    """Content of the message ModelError, without the header."""
    return {
        "model": model,
        "window": window,
        "axes": [
            {
                "axis": e.axis,
                "measured": e.measured,
                "predicted": e.predicted,
                "nrmse": e.nrmse,
                "residual_rms": e.residual_rms,
                "lag_one_correlation": e.lag_one_correlation,
                "white": e.white,
            }
            for e in errors
        ],
    }
