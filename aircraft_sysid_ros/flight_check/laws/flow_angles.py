"""Vanes against the IMU, for steady wind, (6.17), (6.18):

    d(alpha)/dt = q - tan(beta) (p cos(alpha) + r sin(alpha)) + (f_z + g_z)/V,
    d(beta)/dt = p sin(alpha) - r cos(alpha) + (f_y + g_y)/V,

in a band in which pitch hardly changes gravity, each of the other terms with a factor that should be 1. A roll changes
g_y/V by g/V times its integral, and d(beta)/dt by p sin(alpha): both are fitted beside them. They hold at the IMU; a
vane elsewhere also sees dp/dt, dq/dt and dr/dt, which is taken off where an aircraft file says where it is. And a
sideslip to the right pushes to the left, an angle of attack up: signs of C_Y,beta and C_Z,alpha that every aeroplane
has.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.flight_check.grid import Comparison, compare, regress
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import FORCE, GYRO
from aircraft_sysid_ros.flight_check.triple import Triple

Array = npt.NDArray[np.float64]
_SHORT, _LONG = 0.25, 4.0
#: What the IMU does not explain of a vane is gusts, which bias the factors: by so much, times 1 - correlation.
_GUSTS, _FINE = 2.0, 0.05  # up to this step [s], and more for longer ones
#: And an aeroplane follows gusts: what the vane sees of them alone and what the IMU sees are correlated by so much. In
#: moderate gusts a vane of a stranger that reads 1.02 of the truth had seemed to read 1.98, at a correlation of 0.6.
_FOLLOWS, _MOST_GUSTS = 0.4, 10.0
#: Time [s] that the law gets wrong.
_LATE = 0.04
#: A ratio that tells a unit and no scale.
_UNIT = 1.5
#: Least and largest -d(force)/d(angle) [m/s^2 per rad] of aeroplanes: g C_Z,alpha / C_L, g C_Y,beta / C_L. A fast one
#: flies with a C_L of 0.05.
_SLOPES = {"angle_of_attack": (15.0, 1000.0), "sideslip": (0.7, 150.0)}


def pair(motion: Motion) -> Triple:
    """Derivatives of both vanes, and what the IMU makes of each, in the same band."""
    grid, (alpha, beta), over_speed = motion.grid, motion.angles_at_imu, _over_speed(motion)
    short = max(_SHORT, 4.0 * grid.step)
    measured = [grid.band(grid.slope(angle), short, _LONG) for angle in (alpha, beta)]
    rates = (motion.gyro[:, 1] + over_speed[:, 2], -motion.gyro[:, 2] + over_speed[:, 1])
    expected = [grid.band(grid.as_slope(rate), short, _LONG) for rate in rates]
    return Triple(("angle_of_attack", "sideslip"), measured, expected, grid.step, "gyros and accelerometers")


def relations(motion: Motion) -> list[Relation]:
    """Of both vanes."""
    over_speed = _over_speed(motion)
    p, q, r = motion.gyro.T
    alpha, beta = motion.angles_at_imu
    slope = motion.grid.slope
    with np.errstate(invalid="ignore", divide="ignore"):
        bank = np.cumsum(np.nan_to_num(p)) * motion.grid.step / motion.speed
    rolls = [motion.grid.as_slope(p), motion.grid.as_slope(bank)]
    down = _vane(motion, "angle_of_attack", alpha, (GYRO[1], q), (FORCE[2], over_speed[:, 2]), [slope(p), slope(q)])
    beside = [slope(p), slope(r), *rolls]
    side = _vane(motion, "sideslip", beta, (GYRO[2], -r), (FORCE[1], over_speed[:, 1]), beside)
    return down + side


def _over_speed(motion: Motion) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(motion.force / motion.speed[:, None])


def _in_time(y: Array, columns: Array, late: int, step: float) -> tuple[Array, Array, Array] | None:
    """As ``regress``, with y (n,) earlier by ``late`` steps where that leaves less unexplained: a factor that is told
    of other times is too small, or too large."""
    solved = regress(y, columns, step)
    if not late or solved is None:
        return solved
    moved, n = np.full_like(y, np.nan), len(y)
    moved[max(-late, 0) : n - max(late, 0)] = y[max(late, 0) : n - max(-late, 0)]
    other = regress(moved, columns, step)
    is_better = other is not None and np.nanvar(moved - columns @ other[0]) < np.nanvar(y - columns @ solved[0])
    return other if is_better else solved


def _bias_of_gusts(correlation: float) -> float:
    """How far a factor k of a law may be off that gusts, which the IMU follows, leave with a correlation r.

    Of y = x + g with x and g correlated by rho the factor is k = 1 + rho |g| / |x|, and what is left of y is
    (1 - rho^2)^(1/2) |g| = k (1/r^2 - 1)^(1/2) |x|.
    """
    share = _FOLLOWS / np.sqrt(1.0 - _FOLLOWS**2) * np.sqrt(1.0 / max(correlation, 1e-3) ** 2 - 1.0)
    return float(min(share / max(1.0 - share, 1e-3), _MOST_GUSTS))


def _vane(
    motion: Motion,
    name: str,
    angle: Array,
    rate: tuple[str, Array],
    force: tuple[str, Array],
    beside: Sequence[Array],
) -> list[Relation]:
    grid = motion.grid
    short = max(_SHORT, 4.0 * grid.step)

    def band(values: Array) -> Array:
        return grid.band(values, short, _LONG)

    measured = band(grid.slope(angle))
    terms = [band(grid.as_slope(v)) for v in (rate[1], force[1])]
    nuisance = [band(v) for v in beside]
    found = []
    together = compare(measured, terms[0] + terms[1], grid.step)
    known_to = _LATE + motion.arm_time  # [s] of the law
    late = together.lag if together is not None and together.is_sure and abs(together.lag) > known_to else 0.0
    solved = _in_time(measured, np.column_stack([*terms, *nuisance]), round(late / grid.step), grid.step)
    if solved is not None:
        theta, std, partial = (values[:2] for values in solved)
        gusts = _GUSTS * max(1.0, grid.step / _FINE)
        divisors = ("", "true_airspeed")
        for other, divisor, k, sigma, r in zip((rate[0], force[0]), divisors, theta, std, partial, strict=True):
            low, high = abs(k) - 3.0 * sigma, abs(k) + 3.0 * sigma
            sure = low > 0.3 * abs(k)
            comparison = Comparison(float(r) if sure else 0.0, max(low, 1e-9), high, 0.0, np.inf, 1e3, 0.0)
            words = f"the derivative of {name.replace('_', ' ')} that the IMU gives"
            room = 0.05 + max(gusts * (1.0 - abs(r)), _bias_of_gusts(abs(float(r))))
            found.append(Relation(name, other, comparison, words, room, has_lag=False, divisor=divisor))
    if together is not None:
        words = "its derivative by gyros and accelerometers"
        found.append(Relation(name, rate[0], together, words, _UNIT, has_sign=False, lag_tolerance=known_to))
    least, most = _SLOPES[name]
    column = motion.force[:, FORCE.index(force[0])]
    push = compare(band(-column / np.sqrt(least * most)), band(angle), grid.step, 0.1)
    if push is not None:
        words, room = "the force of the air that it makes", float(np.sqrt(most / least))
        found.append(Relation(force[0], name, push, words, room - 1.0, has_lag=False))
    return found
