"""The wind of a flight without airspeed, from its speed over ground: in turns it depends on the course.

|v_ground - w| is the airspeed; a flight that holds it while its course changes has velocities over ground on a circle
about the wind. The airspeed may change slowly, as a line between knots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.reconstruction.absences import has_airspeed
from aircraft_sysid_ros.samples import Kind, Samples, is_absurd

Array = npt.NDArray[np.float64]

#: Seconds after which what changes the speed, gusts and the throttle, is another.
_CORRELATED = 5.0
#: Standard errors, and share of the airspeed, from which a wind is one.
SURE, LEAST_SHARE = 4.0, 0.05
#: Two standard errors of the wind, as a share of the airspeed, from which a flight cannot tell it.
_UNKNOWN = 0.25
_ROUNDS = 20
#: Time [s] between knots of the airspeed.
_KNOTS = 30.0


@dataclass(frozen=True)
class GroundSpeedWind:
    """The wind north and east [m/s] under which the airspeed is steadiest, with its covariance."""

    wind: Array  # (2,)
    covariance: Array  # (2, 2)
    airspeed: float  # [m/s]

    @property
    def speed(self) -> float:
        """[m/s]"""
        return float(np.hypot(*self.wind))

    @property
    def std(self) -> float:
        """One sigma [m/s], in the direction in which it is least certain."""
        return float(np.sqrt(np.max(np.linalg.eigvalsh(self.covariance))))

    @property
    def is_there(self) -> bool:
        """The flight shows that the air is not calm."""
        squares = float(self.wind @ np.linalg.solve(self.covariance, self.wind))
        return squares > SURE**2 and self.speed > LEAST_SHARE * self.airspeed

    @property
    def is_known(self) -> bool:
        """The course changed enough to tell."""
        return 2.0 * self.std < _UNKNOWN * self.airspeed

    @property
    def text(self) -> str:
        """In words."""
        if not self.is_there:
            return ""
        from_north = np.degrees(np.arctan2(-self.wind[1], -self.wind[0])) % 360.0
        return (
            f"the speed over ground depends on the course as in a wind of {self.speed:.1f} ± {self.std:.1f} m/s "
            f"from {from_north:.0f}°"
        )


def wind_of_ground_speed(velocity: Array, step: float) -> GroundSpeedWind | None:
    """The wind from velocities over ground (n, 2) [m/s], ``step`` [s] apart; None where they tell nothing.

    Least squares of |v - w| - V(t), Gauss-Newton from calm air; the standard error counts one independent value in
    five seconds.
    """
    count = len(velocity)
    if count * step < 2.0 * _KNOTS:
        return None
    knots = np.linspace(0.0, count, max(round(count * step / _KNOTS), 2) + 1)
    lines = np.stack([np.interp(np.arange(count), knots, unit) for unit in np.eye(len(knots))], axis=1)
    wind, normal, residual = np.zeros(2), np.eye(2), np.zeros(count)
    for _ in range(_ROUNDS):
        air = velocity - wind
        speed = np.maximum(np.linalg.norm(air, axis=1), 1e-3)
        both = np.column_stack([-air / speed[:, None], speed])
        both = both - lines @ np.linalg.lstsq(lines, both, rcond=None)[0]  # the airspeed that suits this wind best
        jacobian, residual = both[:, :2], both[:, 2]
        normal = jacobian.T @ jacobian
        if np.linalg.cond(normal) > 1e6:
            return None
        change = -np.linalg.solve(normal, jacobian.T @ residual)
        wind = wind + np.clip(change, -5.0, 5.0)
        if np.max(np.abs(change)) < 1e-4:
            break
    fewer = max(_CORRELATED / step, 1.0)
    covariance = fewer * float(np.mean(residual**2)) * np.linalg.inv(normal)
    return GroundSpeedWind(
        wind, np.array(covariance, dtype=np.float64), float(np.mean(np.linalg.norm(velocity - wind, axis=1)))
    )


def contradicted_calm(samples: Samples, minimum_airspeed: float) -> str:
    """What a flight without airspeed says against air that was taken as calm, in words; empty where nothing does.

    ``minimum_airspeed`` [m/s]: slower than that it is not flying.
    """
    if has_airspeed(samples):
        return ""
    of_gps = samples[(samples.kind == Kind.GPS_VELOCITY) & ~is_absurd(samples).any(axis=1)]
    order = np.argsort(of_gps.stamp, kind="stable")
    velocity = of_gps.values[order, :2]
    velocity = velocity[np.linalg.norm(velocity, axis=1) > minimum_airspeed]
    if len(velocity) < 3:
        return ""
    wind = wind_of_ground_speed(velocity, float(np.median(np.diff(of_gps.stamp[order]))) * 1e-9)
    return wind.text if wind is not None else ""
