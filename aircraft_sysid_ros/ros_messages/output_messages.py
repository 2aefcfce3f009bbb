"""Estimates as ROS messages: the same fields for a recording (n at once) and for a live node (one)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import euler_angles, rotation_matrix
from aircraft_sysid_ros.identification.monitoring.error_window import AxisError
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.ros_messages.conversion import (
    UNKNOWN_VARIANCE,
    enu_from_ned,
    flu_from_frd,
    quaternion_enu_flu,
)

Array = npt.NDArray[np.float64]

STATE_TOPIC = "/state_estimator/state"
WIND_TOPIC = "/state_estimator/wind"
PARAMETERS_TOPIC = "/parameter_estimator/parameters"
MODEL_ERROR_TOPIC = "/parameter_estimator/model_error"
STATE_TYPE = "aircraft_sysid_msgs/msg/AircraftState"
WIND_TYPE = "geometry_msgs/msg/TwistWithCovarianceStamped"
PARAMETERS_TYPE = "aircraft_sysid_msgs/msg/Parameters"
MODEL_ERROR_TYPE = "aircraft_sysid_msgs/msg/ModelError"

#: Frames of REP 103 and REP 105, whose origin is that of the state: ENU and FLU, NED and FRD.
MAP, BASE, MAP_NED, BASE_FRD = "map", "base_link", "map_ned", "base_link_frd"

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


def knows_wind(rows: Array) -> npt.NDArray[np.bool_]:
    """Rows (n,) in which the wind is estimated."""
    return np.asarray(np.isfinite(rows[:, StateField.WIND]).all(axis=1))


def wind_fields(rows: Array) -> dict[str, npt.NDArray[Any]]:
    """Flat fields of TwistWithCovarianceStamped, ENU, of rows that know the wind; its rotation is not estimated."""
    n = len(rows)
    covariance = np.zeros((n, 6, 6))
    for i, source in enumerate((1, 0, 2)):
        covariance[:, i, i] = np.square(rows[:, StateField.WIND_STD])[:, source]
        covariance[:, 3 + i, 3 + i] = UNKNOWN_VARIANCE
    return {
        "twist.twist.linear": enu_from_ned(rows[:, StateField.WIND]),
        "twist.twist.angular": np.zeros((n, 3)),
        "twist.covariance": covariance.reshape(n, 36),
    }


def odometry_content(row: Array) -> dict[str, Any]:
    """Fields of nav_msgs/Odometry from one row (StateField.WIDTH,), in ``map``, ENU, and ``base_link``, FLU at the IMU.

    The velocity is that over ground. Covariances are those of the standard deviations, turned into the frames.
    """
    std = row[StateField.STANDARD_DEVIATIONS]
    turn = rotation_matrix(row[StateField.ATTITUDE])
    body_from_ned = np.diag([1.0, -1.0, -1.0]) @ turn.T  # FLU
    enu_from_body = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]) @ turn
    pose, twist = np.zeros((6, 6)), np.zeros((6, 6))
    pose[:3, :3] = np.diag(std[[4, 3, 5]] ** 2)
    pose[3:, 3:] = enu_from_body @ np.diag(std[6:9] ** 2) @ enu_from_body.T
    twist[:3, :3] = body_from_ned @ np.diag(std[0:3] ** 2) @ body_from_ned.T
    twist[3:, 3:] = np.diag(std[12:15] ** 2)
    return {
        "position": enu_from_ned(row[StateField.POSITION]),
        "orientation": quaternion_enu_flu(row[StateField.ATTITUDE]),
        "linear": body_from_ned @ row[StateField.VELOCITY],
        "angular": flu_from_frd(row[StateField.ANGULAR_VELOCITY]),
        "pose_covariance": pose.ravel(),
        "twist_covariance": twist.ravel(),
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
                "over_noise": e.over_noise,
            }
            for e in errors
        ],
    }
