"""Modes of motion: the model linearised about steady straight flight, and the eigenvalues of that.

    x' = f(x, u, theta),   f(x_0, u_0, theta) = 0 in rates and body velocity,   d x' = A d x,

with A of ``derivatives.error_dynamics`` in body axes: (u, w, q, pitch) and (v, p, r, bank), which steady flight with
wings level does not couple (Etkin and Reid, Dynamics of Flight; Roskam, Airplane Flight Dynamics and Automatic Flight
Controls). What couples them in the model, such as a roll with the elevator, is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import root

from aircraft_sysid_ros.aircraft.frames import cross_matrix, quaternion_from_euler, rotation_matrix
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_model.derivatives import aerodynamics, error_dynamics
from aircraft_sysid_ros.flight_model.dynamics import derivative
from aircraft_sysid_ros.flight_model.layout import (
    ATTITUDE,
    D_ATTITUDE,
    D_RATES,
    D_VELOCITY,
    ERROR_SIZE,
    RATES,
    STATE_SIZE,
    VELOCITY,
    FlightModel,
)

Array = npt.NDArray[np.float64]

#: Places of elevator [rad] and thrust [N] in the inputs.
ELEVATOR, THRUST = 0, 5
_STEEPEST = 0.5  # [rad] flow angle or climb beyond which no steady flight is meant
_SMALL = 1e-6  # [m/s^2], [rad/s^2] residual that still counts as steady
SHORT_PERIOD, PHUGOID, DUTCH_ROLL, ROLL, SPIRAL = "short period", "phugoid", "Dutch roll", "roll", "spiral"
#: Roll and spiral where they are one oscillation.
ROLL_SPIRAL = "roll and spiral"


@dataclass(frozen=True)
class SteadyFlight:
    """Straight flight with wings level in which nothing accelerates."""

    alpha: float  # [rad]
    climb: float  # [rad] of the path, 0 where thrust balances drag
    inputs: Array  # (INPUT_SIZE,) with the elevator and the thrust that it takes
    state: Array  # (STATE_SIZE,)


@dataclass(frozen=True)
class Mode:
    """One or two eigenvalues [1/s] that belong together."""

    name: str
    eigenvalues: tuple[complex, ...]

    @property
    def frequency(self) -> float:
        """Undamped natural frequency [rad/s]; of one eigenvalue its size; NaN where one grows and one dies away."""
        if np.prod(self.eigenvalues).real < 0.0 and len(self.eigenvalues) > 1:
            return np.nan
        return float(np.prod(np.abs(self.eigenvalues)) ** (1.0 / len(self.eigenvalues)))

    @property
    def damping(self) -> float:
        """Damping ratio; beyond 1 nothing swings, below 0 the motion grows. Of one eigenvalue 1 or -1.

        NaN as the frequency.
        """
        mean = float(np.mean([value.real for value in self.eigenvalues]))
        return -mean / float(np.maximum(self.frequency, 1e-12))

    @property
    def period(self) -> float:
        """Time [s] of one swing; NaN where nothing swings."""
        turning = abs(self.eigenvalues[0].imag)
        return 2.0 * np.pi / turning if turning > 0.0 else np.nan

    @property
    def growth(self) -> float:
        """The largest real part [1/s]: the motion grows where it is positive."""
        return max(value.real for value in self.eigenvalues)


def steady_flight(
    model: FlightModel, theta: Array, airspeed: float, inputs: Array, *, has_elevator: bool = True,
    has_thrust: bool = True,
) -> SteadyFlight:  # fmt: skip
    """Steady straight flight at an airspeed [m/s] with the density and all else of ``inputs``.

    Elevator and thrust are found, from those of ``inputs``; where the model does not read the thrust the path climbs or
    descends instead, and without an elevator in the pitching moment nothing is asked of that. Raises InputError where
    there is none.
    """

    def flight_at(y: Array) -> SteadyFlight:
        at = inputs.copy()
        if has_elevator:
            at[ELEVATOR] = y[2]
        if has_thrust:
            at[THRUST] = y[1] * model.mass * model.gravity
        climb = 0.0 if has_thrust else float(y[1])
        return SteadyFlight(float(y[0]), climb, at, _state(airspeed, float(y[0]), climb))

    def residual(y: Array) -> Array:
        flight, slope = flight_at(y), np.empty(STATE_SIZE)
        derivative(flight.state, flight.inputs, theta, model, slope)
        wanted = [slope[0], slope[2], slope[RATES][1]]
        return np.array(wanted if has_elevator else wanted[:2])

    first = inputs[THRUST] / (model.mass * model.gravity) if has_thrust else 0.0
    start = np.nan_to_num([0.05, first, inputs[ELEVATOR]])
    found = root(residual, start if has_elevator else start[:2], tol=1e-12)
    flight = flight_at(found.x)
    if not np.max(np.abs(residual(found.x))) < _SMALL or max(abs(flight.alpha), abs(flight.climb)) > _STEEPEST:
        raise InputError(f"with these coefficients there is no steady straight flight at {airspeed:.3g} m/s")
    return flight


def _state(airspeed: float, alpha: float, climb: float) -> Array:
    """State in calm air north, wings level."""
    state = np.zeros(STATE_SIZE)
    state[VELOCITY] = airspeed * np.cos(climb), 0.0, -airspeed * np.sin(climb)
    state[ATTITUDE] = quaternion_from_euler(0.0, alpha + climb, 0.0)
    return state


def linearised(model: FlightModel, theta: Array, flight: SteadyFlight) -> tuple[Array, Array]:
    """Matrices (4, 4) of (u, w, q, pitch) and of (v, p, r, bank): SI, body axes."""
    c = rotation_matrix(flight.state[ATTITUDE])
    air = aerodynamics(flight.state, c, flight.inputs, theta, model)
    a = np.empty((ERROR_SIZE, ERROR_SIZE))
    error_dynamics(flight.state, c, air, a)
    kept = [*range(D_VELOCITY, D_VELOCITY + 3), *range(D_ATTITUDE, D_ATTITUDE + 3), *range(D_RATES, D_RATES + 3)]
    pitch = flight.alpha + flight.climb
    to_body = np.eye(9)  # body velocity; bank, pitch and heading; rates
    to_body[:3, :3], to_body[:3, 3:6] = c.T, cross_matrix(air.air_velocity)
    to_body[3, 5], to_body[5, 5] = np.tan(pitch), 1.0 / np.cos(pitch)
    body = to_body @ a[np.ix_(kept, kept)] @ np.linalg.inv(to_body)
    longitudinal, lateral = [0, 2, 7, 4], [1, 6, 8, 3]
    return body[np.ix_(longitudinal, longitudinal)], body[np.ix_(lateral, lateral)]


def modes_of(longitudinal: Array, lateral: Array) -> list[Mode]:
    """Modes of two matrices (4, 4), by name."""
    return [*_longitudinal(_eigenvalues(longitudinal)), *_lateral(_eigenvalues(lateral))]


def _eigenvalues(matrix: Array) -> list[complex]:
    return [complex(value) for value in np.linalg.eigvals(matrix)]


def _longitudinal(values: Sequence[complex]) -> list[Mode]:
    """Two modes: the quicker pair is the short period; a pair that swings stays together."""
    pairs, single = _split(values)
    if len(pairs) == 1:
        size = np.sqrt(abs(single[0] * single[1]))
        quick = abs(pairs[0][0]) > size
        both = [pairs[0], tuple(single)] if quick else [tuple(single), pairs[0]]
    elif pairs:
        both = sorted(pairs, key=lambda pair: -abs(pair[0]))
    else:
        both = [tuple(single[:2]), tuple(single[2:])]
    return [Mode(SHORT_PERIOD, both[0]), Mode(PHUGOID, both[1])]


def _lateral(values: Sequence[complex]) -> list[Mode]:
    """Dutch roll, roll and spiral; the last two may swing together."""
    pairs, single = _split(values)
    if len(pairs) == 2:
        quick, slow = sorted(pairs, key=lambda pair: -abs(pair[0]))
        return [Mode(DUTCH_ROLL, quick), Mode(ROLL_SPIRAL, slow)]
    swinging = pairs[0] if pairs else tuple(single[1:3])
    roll, spiral = single[0], single[-1]
    return [Mode(DUTCH_ROLL, swinging), Mode(ROLL, (roll,)), Mode(SPIRAL, (spiral,))]


def _split(values: Sequence[complex]) -> tuple[list[tuple[complex, ...]], list[complex]]:
    """Conjugate pairs, and real eigenvalues by falling size."""
    pairs: list[tuple[complex, ...]] = [(value, value.conjugate()) for value in values if value.imag > 0.0]
    return pairs, sorted((value for value in values if value.imag == 0.0), key=lambda value: -abs(value))
