"""Loops of roll rate and pitch rate about a learnt model: gains with margins, and how they fare in its covariance.

Model: short period (alpha, q) and roll with dutch roll (beta, p, r), linear about level flight; a surface follows its
command with a first-order lag after a delay. Controller: u = P e + I int e dt + FF r, with e = r - rate, scaled with
airspeed as PX4 and ArduPlane do: P and I by (V0 / V)^2, FF by V0 / V. u is in rad of surface here.

FF is the deflection that a steady rate needs. I / P is a fifth of the slower of the airframe and the actuator. P is the
largest that keeps the margins at every airspeed, but no larger than half of FF: then feedback adds at most half of the
damping that the airframe has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.export.learnt_model import LearntModel
from aircraft_sysid_ros.export.level_flight import (
    MOMENT_OF,
    SLOPES,
    LevelFlight,
    airspeeds_of,
    level_flight,
    moment_signs,
    slopes,
)
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.rounding import with_error

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complexfloating[Any, Any]]

GAIN_MARGIN = 10.0 ** (10.0 / 20.0)  # 10 dB
PHASE_MARGIN = np.radians(60.0)
INTEGRAL_SHARE, FEEDBACK_SHARE = 0.2, 0.5
#: Draws of the covariance, and the share of them that may be unstable.
DRAWS, MAY_FAIL = 1000, 0.005
_SEED = 20240
_FREQUENCIES = np.geomspace(0.05, 300.0, 1500)  # [rad/s]
ROLL, PITCH = "roll", "pitch"
_SURFACE = {ROLL: "da", PITCH: "de"}
#: The second one is fed back.
_STATES = {ROLL: ("beta", "p", "r"), PITCH: ("alpha", "q")}
_AXES = {ROLL: ("CY", "Cl", "Cn"), PITCH: ("CZ", "Cm")}


@dataclass(frozen=True)
class Actuator:
    """From command to surface."""

    lag: float = 0.05  # [s] first order
    delay: float = 0.03  # [s]


def actuator_of(aircraft: Aircraft, found: Mapping[str, tuple[float, float]] | None = None) -> Actuator:
    """A usual one, with lag and delay [s] of the servos that the flight has ``found``, or that the aircraft file says.

    Both have the delay of what follows its record later as a negative number. An autopilot takes time itself: a delay
    is no shorter than the usual one.
    """
    surfaces, usual = aircraft.sensors[CONTROLS], Actuator()
    lag, delay = ((found or {}).get(key, (getattr(surfaces, key), 0.0))[0] for key in ("lag", "delay"))
    return Actuator(lag if lag > 0.0 else usual.lag, max(usual.delay, -delay))


@dataclass(frozen=True)
class RateLoop:
    """Gains in rad of surface; ``sign``: of the moment that a positive deflection makes."""

    axis: str
    sign: float
    p: float  # [s]
    i: float  # [-]
    ff: float  # [s]
    ff_std: float
    gain_margin: float  # the smallest over the airspeeds
    phase_margin: float  # [rad]
    crossover: float  # [rad/s] at trim; NaN: the loop gain stays below 1
    stable_share: float  # of the draws, at all airspeeds


@dataclass(frozen=True)
class Plant:
    """x' = A x + B delta at one airspeed, batches of (n, m, m) and (n, m); the rate is state 1."""

    a: Array
    b: Array


def plants(learnt: LearntModel, level: LevelFlight, axis: str, values: Array) -> Plant:
    """The motion about level flight for parameter values (n, k), SI."""
    a = learnt.aircraft
    qs, speed = 0.5 * level.density * level.airspeed**2 * a.wing_area, level.airspeed
    factors = slopes(learnt, level.signals)
    parts = [(values[:, part] @ factors[part]) for part in (learnt.model.axis_slice(name) for name in AXES)]
    c = np.einsum("ij,njs->nis", learnt.about_gravity, np.stack(parts, axis=1))  # (n, 6, SLOPES)
    rate = {
        "p": a.span / (2.0 * speed),
        "q": a.chord / speed,
        "r": a.span / (2.0 * speed),
        "alpha_dot": a.chord / speed,
    }
    c = c * np.array([rate.get(name, 1.0) for name in SLOPES])
    at = {name: i for i, name in enumerate(SLOPES)}
    columns = [at[name] for name in (*_STATES[axis], _SURFACE[axis])]
    if axis == PITCH:
        lift = qs / (a.mass * speed * np.cos(level.alpha)) * c[:, 2]
        turning = qs * a.chord / a.inertia[1, 1] * c[:, 4]
        rows = np.stack([lift[:, columns], turning[:, columns]], axis=1)
        rows[:, 0, 1] += 1.0  # alpha' = q + Z / (m V)
        rows[:, 0] /= (1.0 - lift[:, at["alpha_dot"]])[:, None]
        rows[:, 1] += turning[:, at["alpha_dot"], None] * rows[:, 0]
    else:
        side = qs / (a.mass * speed) * c[:, 1]
        moments = np.stack([qs * a.span * c[:, 3], qs * a.span * c[:, 5]], axis=1)
        turning = np.einsum("ij,njs->nis", np.linalg.inv(a.inertia[np.ix_([0, 2], [0, 2])]), moments)
        rows = np.concatenate([side[:, None, columns], turning[:, :, columns]], axis=1)
        rows[:, 0, 1] += np.sin(level.alpha)
        rows[:, 0, 2] -= np.cos(level.alpha)
    return Plant(rows[:, :, :-1], rows[:, :, -1])


def response(plant: Plant, s: Complex) -> Complex:
    """Rate over deflection (n, len(s))."""
    eye = np.eye(plant.a.shape[1])
    matrices = s[None, :, None, None] * eye - plant.a[:, None]
    right = np.broadcast_to(plant.b[:, None, :, None], (*matrices.shape[:3], 1))
    return np.asarray(np.linalg.solve(matrices, right)[:, :, 1, 0])


def closed_loop(plant: Plant, p: float, i: float, actuator: Actuator) -> Array:
    """A (n, m + 4, m + 4) of states, surface, second-order Padé delay (2) and integral; P and I in rad of surface."""
    n, m = plant.b.shape
    t, surface, first, second, integral = actuator.delay, m, m + 1, m + 2, m + 3
    out = np.zeros((n, m + 4, m + 4))
    out[:, :m, :m], out[:, :m, surface] = plant.a, plant.b
    out[:, surface, surface] = -1.0 / actuator.lag
    for row, share in ((surface, 1.0 / actuator.lag), (second, 1.0)):  # what reads the command
        out[:, row, 1] -= share * p
        out[:, row, integral] += share * i
    out[:, surface, second] -= 12.0 / t / actuator.lag
    out[:, first, second] = 1.0
    out[:, second, first] -= 12.0 / t**2
    out[:, second, second] -= 6.0 / t
    out[:, integral, 1] = -1.0
    return out


def is_stable(matrices: Array) -> npt.NDArray[np.bool_]:
    """Whether all eigenvalues of each matrix (n, m, m) are in the left half plane."""
    return np.asarray(np.linalg.eigvals(matrices).real.max(axis=1) < 0.0)


def design(learnt: LearntModel, axis: str, actuator: Actuator) -> RateLoop:
    """Gains of one loop. Raises InputError where the covariance allows an unstable one, naming the parameter."""
    trim, *others = airspeeds_of(learnt)
    levels = [level_flight(learnt, trim), *(level_flight(learnt, speed) for speed in others)]
    own = learnt.values[None]
    nominal = [plants(learnt, level, axis, own) for level in levels]
    sign = moment_signs(learnt, levels[0].signals)[_SURFACE[axis]]
    _check_known(learnt, axis, sign)
    scales = [(trim / level.airspeed) ** 2 for level in levels]
    ff = feed_forward(nominal[0]) * sign
    ratio = INTEGRAL_SHARE * min(_slowest(nominal[0]), 1.0 / (actuator.lag + actuator.delay))
    shapes = [sign * k * shape_of(plant, ratio, actuator) for plant, k in zip(nominal, scales, strict=True)]
    p = min(_largest(shape[0]) for shape in shapes)
    p = min(p, FEEDBACK_SHARE * float(ff[0])) if ff[0] > 0.0 else p
    margins = [margins_of(p * shape[0]) for shape in shapes]
    least = (
        1.0 if all(is_stable(plant.a)[0] for plant in nominal) else 1.0 / GAIN_MARGIN
    )  # a loop that must not be weak
    if not all(
        stable_draws(learnt, axis, own, levels, k * sign * p, k * sign * ratio * p, actuator)[0] for k in (1.0, least)
    ):
        raise InputError(
            f"no {axis} gains: the model is unstable without feedback in its range of airspeeds, and a rate loop with "
            "these margins does not make it stable: move the centre of gravity forward, or tune by hand"
        )
    drawn = learnt.draws(DRAWS, _SEED)
    stable = stable_draws(learnt, axis, drawn, levels, sign * p, sign * ratio * p, actuator)
    if np.mean(~stable) > MAY_FAIL:
        raise _too_uncertain(
            learnt, axis, drawn, levels, (sign * p, sign * ratio * p), actuator, float(np.mean(stable))
        )
    drawn_ff = feed_forward(plants(learnt, levels[0], axis, drawn)) * sign
    return RateLoop(
        axis, sign, p, ratio * p, max(float(ff[0]), 0.0), float(np.std(drawn_ff)),
        min(m[0] for m in margins), min(m[1] for m in margins), margins[0][2], float(np.mean(stable)),
    )  # fmt: skip


def feed_forward(plant: Plant) -> Array:
    """Deflection per steady rate (n,) [s]."""
    return np.asarray(1.0 / response(plant, np.zeros(1, dtype=np.complex128))[:, 0].real)


def shape_of(plant: Plant, ratio: float, actuator: Actuator) -> Complex:
    """Loop gain (n, frequencies) over P, I / P being ``ratio`` [rad/s]."""
    s = 1j * _FREQUENCIES
    lagged = np.exp(-s * actuator.delay) / (1.0 + s * actuator.lag)
    return np.asarray((1.0 + ratio / s) * lagged * response(plant, s))


def margins_of(loop: Complex) -> tuple[float, float, float]:
    """Gain margin [-], phase margin [rad] and crossover [rad/s] of a loop gain (frequencies,); inf, inf, NaN: none."""
    gain = np.abs(loop)
    over = np.flatnonzero(np.diff(np.sign(loop.imag)) * (0.5 * (loop.real[1:] + loop.real[:-1]) < 0.0))
    gain_margin = float(1.0 / max((gain[k] for k in over), default=1e-12))
    crossings = np.flatnonzero(np.diff(np.sign(gain - 1.0)))
    distances = [abs((np.angle(loop[k]) + np.pi + np.pi) % (2.0 * np.pi) - np.pi) for k in crossings]
    crossover = float(_FREQUENCIES[crossings[-1]]) if len(crossings) else np.nan
    return gain_margin, float(min(distances, default=np.inf)), crossover


def _largest(shape: Complex) -> float:
    """The largest P whose loop keeps both margins, by bisection; it is stable without feedback or P would be 0."""
    low, high = 0.0, 1.0 / float(np.abs(shape[len(shape) // 2]).max())
    while _keeps(high * shape) and high < 1e6:
        low, high = high, 2.0 * high
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _keeps(middle * shape) else (low, middle)
    return low


def _keeps(loop: Complex) -> bool:
    gain_margin, phase_margin, _ = margins_of(loop)
    return gain_margin >= GAIN_MARGIN and phase_margin >= PHASE_MARGIN


def _slowest(plant: Plant) -> float:
    """Magnitude [rad/s] of the largest eigenvalue: of roll subsidence, or of the short period."""
    return float(np.abs(np.linalg.eigvals(plant.a[0])).max())


def stable_draws(
    learnt: LearntModel, axis: str, drawn: Array, levels: Sequence[LevelFlight], p: float, i: float, actuator: Actuator
) -> npt.NDArray[np.bool_]:
    """Which draws (n, k) are stable at every airspeed, with the gains scaled as the autopilots do."""
    stable = np.ones(len(drawn), dtype=np.bool_)
    for level in levels:
        scale = (levels[0].airspeed / level.airspeed) ** 2
        plant = plants(learnt, level, axis, drawn)
        stable &= is_stable(closed_loop(plant, scale * p, scale * i, actuator))
    return stable


def _names_of(learnt: LearntModel, axis: str) -> list[str]:
    names = learnt.model.parameter_names
    return [name for a in _AXES[axis] for name in names[learnt.model.axis_slice(a)]]


def _check_known(learnt: LearntModel, axis: str, sign: float) -> None:
    """Raises InputError where the surface has no effect, or what the loop rests on is not to be used.

    That is the moment of its own axis from its rate, its surface, and in pitch from the angle of attack: where the
    model is wrong there, its standard errors do not say by how much.
    """
    moment = MOMENT_OF[_SURFACE[axis]]
    if not any(_SURFACE[axis] in program.signals for program in learnt.model.programs[AXES.index(moment)]):
        raise InputError(
            f"no {axis} gains: {moment} has no term of {_SURFACE[axis]}; record what moves the aeroplane as elevator "
            "and aileron, elevons as half of their sum and of their difference, and replay with terms of de and da"
        )
    if sign == 0.0:
        raise InputError(
            f"no {axis} gains: {moment}_{_SURFACE[axis]} is not known: move that surface in flight, and replay again"
        )
    rests_on = {*_STATES[axis], _SURFACE[axis]} - {"beta", "r"}
    programs = learnt.model.programs[AXES.index(moment)]
    for p, program in zip(learnt.parameters[learnt.model.axis_slice(moment)], programs, strict=True):
        if p.status != Trust.USE.name and program.signals & rests_on:
            raise InputError(
                f"no {axis} gains: they rest on {p.name}, which is not to be used ({p.reason or p.status}): fly "
                "manoeuvres that determine it, or see what aircraft-sysid diagnose says of the run"
            )
    for p in learnt.parameters:
        if p.name in _names_of(learnt, axis) and learnt.value(p.name) and not np.isfinite(p.std):
            raise InputError(f"no {axis} gains: {p.name} has no standard error: excite it, and replay again")


def _too_uncertain(
    learnt: LearntModel, axis: str, drawn: Array, levels: Sequence[LevelFlight], gains: tuple[float, float],
    actuator: Actuator, share: float,
) -> InputError:  # fmt: skip
    """Names the parameter without whose uncertainty most draws would be stable."""
    names, best, culprit = learnt.model.parameter_names, -1.0, ""
    for name in _names_of(learnt, axis):
        k = names.index(name)
        known = drawn[: len(drawn) // 5].copy()
        known[:, k] = learnt.values[k]
        stable = float(np.mean(stable_draws(learnt, axis, known, levels, *gains, actuator)))
        if stable > best:
            best, culprit = stable, name
    p = learnt.parameters[names.index(culprit)]
    return InputError(
        f"no {axis} gains: with the uncertainty of the parameters the loop is stable in {100.0 * share:.1f} % of draws "
        f"only, and {culprit} = {with_error(p.value, p.std)} is too uncertain: excite it in more manoeuvres"
    )
