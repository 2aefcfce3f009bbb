"""Airspeed against velocity over ground: V = s |v - w| with one wind w for the flight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.flight_check.grid import Comparison, compare
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation

Array = npt.NDArray[np.float64]
_SCALE, _LAG = 0.06, 0.07  # the time [s] for a GPS of four fixes a second or more
_SHORT, _SECONDS = 0.6, 8.0
#: Least course change [rad] that separates the wind from the scale.
_TURNED = 2.0
#: Wind along the course [m/s], or as a share of the airspeed, with which a whole flight without turns may be flown.
_STRONGEST = (15.0, 0.45)
#: Highest rate [1/s] at which an aeroplane, and who flies it, answers a gust along the path with its speed over ground.
_ANSWER = 0.2
#: Changes [s] of the speed that are slower than the noise of its sensors, and quicker than the wind.
_CHANGES = (2.0, 60.0)
#: Longest lag [s] that is looked for.
_LATEST = 2.0
#: Residuals beyond this share of the speed count less; most steps of the fit.
_USUAL, _ROUNDS = 0.05, 60


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


def scale_and_wind(speed: Array, ground: Array, scale: float) -> tuple[float, Array, float]:
    """s, w (2,) [m/s] of V = s |v - w| that suit speeds (n,) and velocities over ground (n, 3), and one sigma of s.

    Residuals count as 2 (sqrt(1 + r^2) - 1), r over 5 % of the speed: outliers less. Damped Gauss-Newton steps
    (Levenberg, Marquardt) from ``scale`` and calm air.
    """
    usual = max(_USUAL * float(np.median(speed)), 1e-6)
    x, damping = np.array([scale, 0.0, 0.0]), 1e-3
    cost, residual, jacobian = _cost_of(x, speed, ground, usual)
    for _ in range(_ROUNDS):
        weight = 1.0 / np.sqrt(1.0 + (residual / usual) ** 2)
        normal = jacobian.T @ (weight[:, None] * jacobian)
        step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), jacobian.T @ (weight * residual))[0]
        found = _cost_of(x - step, speed, ground, usual)
        if not found[0] < cost:
            if damping > 1e6:
                break
            damping *= 8.0
            continue
        is_settled = cost - found[0] < 1e-10 * cost
        x, (cost, residual, jacobian), damping = x - step, found, damping / 8.0
        if is_settled:
            break
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    std = 3.0 * float(np.sqrt(np.mean(residual**2) * inverse[0, 0]))  # gusts last for some samples
    return float(x[0]), x[1:], std


def _cost_of(x: Array, speed: Array, ground: Array, usual: float) -> tuple[float, Array, Array]:
    """Cost, residuals V - s |v - w| (n,) and their derivatives (n, 3)."""
    air = ground - [x[1], x[2], 0.0]
    length = np.linalg.norm(air, axis=1)
    residual = speed - x[0] * length
    towards = x[0] * air[:, :2] / np.maximum(length, 1e-9)[:, None]
    cost = float(np.sum(np.sqrt(1.0 + (residual / usual) ** 2) - 1.0))
    return cost, residual, np.column_stack([-length, towards])


def _slow(motion: Motion, speed: Array, expected: Array, words: str, scale_tolerance: float | None) -> list[Relation]:
    """Changes of the airspeed (n,) and of what it should be, over seconds.

    Gusts e, which are in the airspeed alone, are no noise where they are answered: x' has -_ANSWER e of them, by which
    the airspeed seems later, by _ANSWER sum(e e) / sum(x' y') or by less: as likely by anything between. In 41 clean
    flights of JSBSim it seemed up to 1 s late, and early in none by more than three standard errors.
    """
    grid = motion.grid
    y, x = (grid.band(each, *_CHANGES) for each in (speed, expected))
    found = compare(y, x, grid.step, _LATEST)
    if found is None or abs(found.lag) > _LATEST - 1.5 * grid.step:  # no maximum
        return []
    known = np.isfinite(x) & np.isfinite(y)
    left = float(np.sum(y[known] ** 2)) * (1.0 - found.correlation**2)
    common = float(np.nansum(np.gradient(x, grid.step) * np.gradient(y, grid.step)))
    if not common > 0.0:
        return []
    answered = _ANSWER * left / common
    found = replace(found, lag=found.lag - 0.5 * answered, lag_std=float(np.hypot(found.lag_std, answered / 12**0.5)))
    tolerance = _LAG * motion.gps_width
    return [
        Relation(
            "true_airspeed", "velocity.north", found, words, scale_tolerance, has_sign=False, lag_tolerance=tolerance
        )
    ]


def _fitted(motion: Motion, speed: Array, ground: Array, thin: npt.NDArray[np.int64], seconds: float) -> list[Relation]:
    v, u = speed[thin], ground[thin]
    typical = float(np.median(v) / np.median(np.linalg.norm(u, axis=1)))
    scale, wind, std = scale_and_wind(v, u, typical)
    course = np.unwrap(np.arctan2(u[:, 1], u[:, 0]))
    found: list[Relation] = []
    turned = np.ptp(course) > _TURNED and np.hypot(*wind) < 0.9 * np.median(np.linalg.norm(u, axis=1))
    low, high = scale - 3.0 * std, scale + 3.0 * std
    if not turned:  # only a unit can be told, where no wind explains it, or by changes of the speed
        usual, over_ground = float(np.median(v)), float(np.median(np.linalg.norm(u, axis=1)))
        strongest = max(_STRONGEST[0], _STRONGEST[1] * usual)
        low, high = 0.55 * typical, 1.45 * typical
        if abs(usual - over_ground) < strongest:
            low, high = usual / (over_ground + strongest), usual / max(over_ground - strongest, 0.05 * usual)
        found += _slow(motion, speed, np.linalg.norm(ground, axis=1), "the changes of the GPS speed", 0.3)
    if scale > 0.0 or not turned:
        comparison = Comparison(1.0, max(low, 1e-6), high, 0.0, np.inf, 1e3, seconds)
        words = f"the GPS speed less a wind of {np.hypot(*wind):.1f} m/s" if turned else "the GPS speed"
        found.append(Relation("true_airspeed", "velocity.north", comparison, words, _SCALE, has_lag=False))
    if turned:
        expected = np.linalg.norm(ground - [wind[0], wind[1], 0.0], axis=1)
        found += _slow(motion, speed, expected, "the GPS speed less the wind", None)
    return found
