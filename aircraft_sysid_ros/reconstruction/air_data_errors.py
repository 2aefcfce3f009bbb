"""Errors of the air data as states of the filter, and what is known before it starts.

With ``StateOptions.air_data_errors`` six constants follow the nineteen states, and six errors the eighteen. As in (36)
of the two-stage paper, for y of V, alpha and beta,

    y_true = (1 + lambda_y) y + b_y,   so that the sensor shows   y = (h(x) - b_y) / (1 + lambda_y) + v.

They are constants: nothing is added to their covariance. Turns tell lambda_V from the wind, different airspeeds
lambda_V from b_V, pitching and yawing the others; what a flight does not tell keeps the uncertainty of its start.

In straight flight lambda_V and the airspeed V move together without a trace, along (dV, d lambda) = (y, 1). A filter
that linearises at a y which every sample moves a little sees a trace of it in each, and is sure of a wrong scale within
seconds. In the coordinates (y, lambda) the sensor is linear and lambda has no part in it. ``settle`` makes each update
one in these coordinates, for all three sensors, and comes back to the air velocity at the new state.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import Vector, cross_matrix
from aircraft_sysid_ros.estimation.iterated_ekf import symmetrise
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.alignment import WIND_STD
from aircraft_sysid_ros.reconstruction.state import (
    AIR_VELOCITY,
    D_AIR_VELOCITY,
    D_ATTITUDE,
    D_VELOCITY,
    ERROR_SIZE,
    STATE_SIZE,
    VELOCITY,
)
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

NAMES = ("lambda_V", "b_V", "lambda_alpha", "b_alpha", "lambda_beta", "b_beta")
COUNT = len(NAMES)
#: One sigma of sensors that nobody calibrated: scales, [m/s], [rad].
UNKNOWN_STD = np.array([0.2, 1.0, 0.2, 0.05, 0.2, 0.05])
UNKNOWN_STD_OF = dict(zip(NAMES, UNKNOWN_STD.tolist(), strict=True))
#: First of the two errors of a kind of air data.
FIRST = {Kind.AIRSPEED: 0, Kind.ANGLE_OF_ATTACK: 2, Kind.SIDESLIP: 4}
_SLOWEST = 1.0  # [m/s]
_AIRSPEED, _ALPHA = int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK)


@dataclass(frozen=True)
class StartValues:
    """Wind NED (3,) [m/s], errors of the air data (6,) in the order of NAMES, and the covariance of all nine (9, 9)."""

    wind: Array = field(default_factory=lambda: np.zeros(3))
    errors: Array = field(default_factory=lambda: np.zeros(COUNT))
    covariance: Array = field(default_factory=lambda: np.diag(np.square([*WIND_STD, *UNKNOWN_STD])))

    @property
    def wind_std(self) -> Array:
        """(3,) [m/s]."""
        return np.sqrt(np.diag(self.covariance)[:3])


@njit(cache=True)
def shown(kind: int, predicted: float, x: Array, h: Array) -> float:
    """What a sensor with the errors of x (25,) shows of ``predicted``; its row h (1, 24), without them, is changed."""
    at = 0 if kind == _AIRSPEED else (2 if kind == _ALPHA else 4)
    gain = 1.0 / (1.0 + x[STATE_SIZE + at])
    value = (predicted - x[STATE_SIZE + at + 1]) * gain
    for i in range(ERROR_SIZE):
        h[0, i] *= gain
    h[0, ERROR_SIZE + at] = -value * gain
    h[0, ERROR_SIZE + at + 1] = -gain
    return value


@njit(cache=True)
def _frame(v: Array | Vector, errors: Array, by_shown: Array, by_errors: Array, raw: Array) -> None:
    """Of the air velocity v (3,) at the probe: its derivatives by what the sensors show (3, 3) and by their errors
    (3, 6), and what they show (3,)."""
    level = np.sqrt(v[0] * v[0] + v[2] * v[2])
    speed = np.sqrt(level * level + v[1] * v[1])
    true = (speed, np.arctan2(v[2], v[0]), np.arctan2(v[1], level))
    for i in range(3):
        raw[i] = (true[i] - errors[2 * i + 1]) / (1.0 + errors[2 * i])
    for j in range(3):
        by_errors[j, 1] = v[j] / speed
    by_errors[0, 3], by_errors[1, 3], by_errors[2, 3] = -v[2], 0.0, v[0]
    by_errors[0, 5], by_errors[1, 5], by_errors[2, 5] = -v[1] * v[0] / level, level, -v[1] * v[2] / level
    for i in range(3):
        for j in range(3):
            by_shown[j, i] = (1.0 + errors[2 * i]) * by_errors[j, 2 * i + 1]
            by_errors[j, 2 * i] = raw[i] * by_errors[j, 2 * i + 1]


@njit(cache=True)
def settle(v: Vector, x: Array, delta: Array, moved: Array, p: Array) -> None:
    """An update of x (25,) by delta (24,) to ``moved`` (25,), p (24, 24), as one of what the sensors show; in place.

    v: air velocity at the probe before it. Slower than _SLOWEST angles mean nothing, and all stays as it is.
    """
    if not v[0] * v[0] + v[2] * v[2] > _SLOWEST**2:
        return
    by_shown, by_errors, raw = np.empty((3, 3)), np.empty((3, COUNT)), np.empty(3)
    _frame(v, x[STATE_SIZE:], by_shown, by_errors, raw)
    rest, true = np.empty(3), np.empty(3)
    for j in range(3):
        rest[j] = delta[D_AIR_VELOCITY + j]
        for k in range(COUNT):
            rest[j] -= by_errors[j, k] * delta[ERROR_SIZE + k]
    back = np.empty((3, 3))  # inverse of by_shown, whose columns are at right angles
    for i in range(3):
        square = by_shown[0, i] ** 2 + by_shown[1, i] ** 2 + by_shown[2, i] ** 2
        for j in range(3):
            back[i, j] = by_shown[j, i] / square
        step = back[i, 0] * rest[0] + back[i, 1] * rest[1] + back[i, 2] * rest[2]
        true[i] = (1.0 + moved[STATE_SIZE + 2 * i]) * (raw[i] + step) + moved[STATE_SIZE + 2 * i + 1]
    v_new = np.empty(3)
    v_new[0] = true[0] * np.cos(true[1]) * np.cos(true[2])
    v_new[1] = true[0] * np.sin(true[2])
    v_new[2] = true[0] * np.sin(true[1]) * np.cos(true[2])
    if not v_new[0] * v_new[0] + v_new[2] * v_new[2] > _SLOWEST**2:
        return
    for j in range(3):
        moved[AIR_VELOCITY.start + j] += v_new[j] - (v[j] + delta[D_AIR_VELOCITY + j])
    shown_new, errors_new = np.empty((3, 3)), np.empty((3, COUNT))
    _frame(v_new, moved[STATE_SIZE:], shown_new, errors_new, raw)
    turn = shown_new @ back
    _change_frame(p, turn, errors_new - turn @ by_errors)


@njit(cache=True)
def _change_frame(p: Array, turn: Array, by_errors: Array) -> None:
    """p (24, 24) after du becomes turn du + by_errors de, in place."""
    for _ in range(2):
        rows = turn @ p[D_AIR_VELOCITY:ERROR_SIZE] + by_errors @ p[ERROR_SIZE:]
        p[D_AIR_VELOCITY:ERROR_SIZE] = rows
        p[:] = p.T.copy()
    symmetrise(p)


def without_errors(kind: int, values: Array, errors: Array) -> Array:
    """Values of a sample without the errors (6,) of its sensor."""
    if kind not in FIRST:
        return values
    at = FIRST[Kind(kind)]
    out = values.copy()
    out[0] = (1.0 + errors[at]) * values[0] + errors[at + 1]
    return out


def extended(x: Array, p: Array, errors: Array, covariance: Array, flow: Array | None) -> tuple[Array, Array]:
    """State (25,) and covariance (24, 24) with errors (6,) and their covariance (6, 6).

    flow: V, alpha, beta (3,) without their errors, from which the air velocity of x comes, NaN where an angle was not
    measured; None where it comes from elsewhere.
    """
    both = np.zeros((ERROR_SIZE + COUNT, ERROR_SIZE + COUNT))
    both[:ERROR_SIZE, :ERROR_SIZE], both[ERROR_SIZE:, ERROR_SIZE:] = p, covariance
    if flow is not None:
        moves = np.zeros((ERROR_SIZE + COUNT, COUNT))
        moves[D_AIR_VELOCITY:ERROR_SIZE] = _by_errors(flow, errors)
        moves[ERROR_SIZE:] = np.eye(COUNT)
        both[ERROR_SIZE:, ERROR_SIZE:] = 0.0
        both += moves @ covariance @ moves.T
    return np.concatenate([x, errors]), 0.5 * (both + both.T)


def _by_errors(flow: Array, errors: Array) -> Array:
    """Derivative (3, 6) of the air velocity by the errors of the sensors that show it."""
    speed, alpha, beta = flow[0], *np.nan_to_num(flow[1:])
    by_flow = np.array([
        [np.cos(alpha) * np.cos(beta), -speed * np.sin(alpha) * np.cos(beta), -speed * np.cos(alpha) * np.sin(beta)],
        [np.sin(beta), 0.0, speed * np.cos(beta)],
        [np.sin(alpha) * np.cos(beta), speed * np.cos(alpha) * np.cos(beta), -speed * np.sin(alpha) * np.sin(beta)],
    ])  # fmt: skip
    out = np.zeros((3, COUNT))
    for i, value in enumerate(flow):
        if np.isfinite(value):
            raw = (value - errors[2 * i + 1]) / (1.0 + errors[2 * i])
            out[:, 2 * i], out[:, 2 * i + 1] = raw * by_flow[:, i], by_flow[:, i]
    return out


def with_start(x: Array, p: Array, rotation: Array, start: StartValues) -> tuple[Array, Array]:
    """State (25,) and covariance (24, 24) whose air velocity and errors are those of ``start``: u = C' (v - W).

    rotation: C (3, 3), body to NED. Velocity, position, attitude and biases stay.
    """
    x = x.copy()
    x[AIR_VELOCITY] = rotation.T @ (x[VELOCITY] - start.wind)
    x[STATE_SIZE:] = start.errors
    kept = np.zeros_like(p)
    kept[:D_AIR_VELOCITY, :D_AIR_VELOCITY] = p[:D_AIR_VELOCITY, :D_AIR_VELOCITY]
    moves = np.eye(len(p))
    moves[D_AIR_VELOCITY:ERROR_SIZE, D_AIR_VELOCITY:] = 0.0
    moves[D_AIR_VELOCITY:ERROR_SIZE, D_VELOCITY : D_VELOCITY + 3] = rotation.T
    moves[D_AIR_VELOCITY:ERROR_SIZE, D_ATTITUDE : D_ATTITUDE + 3] = cross_matrix(x[AIR_VELOCITY])
    known = np.zeros((len(p), 3 + COUNT))
    known[D_AIR_VELOCITY:ERROR_SIZE, :3] = -rotation.T
    known[ERROR_SIZE:, 3:] = np.eye(COUNT)
    both = moves @ kept @ moves.T + known @ start.covariance @ known.T
    return x, 0.5 * (both + both.T)


def error_table(x: Array, p: Array, pitch_doubt: float = 0.0) -> dict[str, dict[str, float]]:
    """Value and standard deviation by name, of a state (25,) and its covariance (24, 24).

    pitch_doubt: what the angle of attack may be off by a pitch that is [rad].
    """
    std = np.sqrt(np.diag(p)[ERROR_SIZE:])
    table = {
        name: {"value": float(value), "std": float(sigma)}
        for name, value, sigma in zip(NAMES, x[STATE_SIZE:], std, strict=True)
    }
    if pitch_doubt > 0.0:
        of_alpha = table["b_alpha"]
        of_alpha.update(std=float(np.hypot(of_alpha["std"], pitch_doubt)), of_attitude=pitch_doubt)
    return table
