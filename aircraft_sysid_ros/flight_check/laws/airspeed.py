"""Airspeed against velocity over ground: V = s |v - w| with one wind w for the flight."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.flight_check.grid import Comparison, compare
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation

Array = npt.NDArray[np.float64]
_SCALE, _LAG = 0.06, 0.07  # the time [s] for a GPS of four fixes a second or more
_LONG = 60.0
_SHORT, _SECONDS = 0.6, 8.0
#: Least course change [rad] that separates the wind from the scale.
_TURNED = 2.0


def relations(motion: Motion) -> list[Relation]:
    """The scale, where the course changed enough; the lag of the speed."""
    grid, width = motion.grid, motion.gps_width
    speed = grid.smooth(motion.airspeed, width)
    ground = np.column_stack([grid.smooth(v, width) for v in motion.velocity.T])
    good = np.isfinite(speed) & np.all(np.isfinite(ground), axis=1)
    if good.sum() * grid.step < 10.0:
        return []
    found = _along(motion)
    thin = np.flatnonzero(good)[:: max(1, round(0.5 * width / grid.step))]
    return found + _fitted(motion, speed, ground, thin, float(good.sum() * grid.step))


def _along(motion: Motion) -> list[Relation]:
    """dV/dt, the force of air and weight along the air velocity, sideslip neglected: for the time of the airspeed.

    dV/dt = f_x cos(alpha) + f_z sin(alpha) - g (sin(pitch) cos(alpha) - cos(pitch) cos(roll) sin(alpha))
    """
    grid = motion.grid
    short = max(_SHORT, 4.0 * grid.step)
    roll, pitch, _ = motion.euler.T
    sine, cosine = np.sin(motion.alpha), np.cos(motion.alpha)
    weight = STANDARD_GRAVITY * (np.sin(pitch) * cosine - np.cos(pitch) * np.cos(roll) * sine)
    expected = motion.force[:, 0] * cosine + motion.force[:, 2] * sine - weight
    y = grid.band(grid.slope(motion.airspeed), short, _SECONDS)
    along = compare(y, grid.band(grid.as_slope(expected), short, _SECONDS), grid.step)
    if along is None:
        return []
    words = "its derivative by accelerometers and attitude"
    return [Relation("true_airspeed", "specific_force.x", along, words, has_sign=False, lag_tolerance=0.06)]


def _fitted(motion: Motion, speed: Array, ground: Array, thin: npt.NDArray[np.int64], seconds: float) -> list[Relation]:
    from scipy.optimize import least_squares  # here: see `in_flight.warm_up`

    grid = motion.grid
    v, u = speed[thin], ground[thin]
    typical = float(np.median(v) / np.median(np.linalg.norm(u, axis=1)))

    def residual(x: Array) -> Array:
        return v - x[0] * np.linalg.norm(u - [x[1], x[2], 0.0], axis=1)

    fit = least_squares(residual, [typical, 0.0, 0.0], loss="soft_l1", f_scale=max(0.05 * float(np.median(v)), 1e-6))
    course = np.unwrap(np.arctan2(u[:, 1], u[:, 0]))
    scatter = float(np.sqrt(np.mean(fit.fun**2)))
    inverse = np.linalg.pinv(fit.jac.T @ fit.jac)
    std = 3.0 * scatter * float(np.sqrt(inverse[0, 0]))  # gusts last for some samples
    scale, wind = float(fit.x[0]), fit.x[1:]
    found: list[Relation] = []
    turned = np.ptp(course) > _TURNED and np.hypot(*wind) < 0.9 * np.median(np.linalg.norm(u, axis=1))
    if not turned:  # only a unit can be told, with a wind of up to half of the speed, or by changes of the speed
        scale, std = typical, 0.15 * typical
        changes = compare(
            grid.band(speed, grid.step, _LONG),
            grid.band(np.linalg.norm(ground, axis=1), grid.step, _LONG),
            grid.step,
            1.0,
        )
        if changes is not None:
            words = "the changes of the GPS speed"
            found.append(
                Relation(
                    "true_airspeed",
                    "velocity.north",
                    changes,
                    words,
                    0.3,
                    has_sign=False,
                    lag_tolerance=_LAG * motion.gps_width,
                )
            )
    if scale > 0.0:
        low, high = max(scale - 3.0 * std, 1e-6), scale + 3.0 * std
        comparison = Comparison(1.0, low, high, 0.0, np.inf, 1e3, seconds)
        words = f"the GPS speed less a wind of {np.hypot(*wind):.1f} m/s" if turned else "the GPS speed"
        found.append(Relation("true_airspeed", "velocity.north", comparison, words, _SCALE, has_lag=False))
    if turned:
        expected = np.linalg.norm(ground - [wind[0], wind[1], 0.0], axis=1)
        lag = compare(grid.band(speed, grid.step, _LONG), grid.band(expected, grid.step, _LONG), grid.step, 1.0)
        if lag is not None:
            words = "the GPS speed less the wind"
            found.append(
                Relation(
                    "true_airspeed", "velocity.north", lag, words, has_sign=False, lag_tolerance=_LAG * motion.gps_width
                )
            )
    return found
