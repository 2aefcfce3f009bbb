"""Which parameters a flight can show, from what was measured alone.

Of each axis the terms of the model are made of measured signals, and the measured acceleration over dynamic pressure
is regressed on them: f/qbar for forces, d(p, q, r)/dt/qbar for moments, whose scale (mass, inertia) does not matter
here. A parameter can be shown when

1. every signal of its term is measured, and every one that another term of its axis reads and that nothing makes up
   for: without it `replay` has no sample of the axis and holds it whole;
2. what its term moves apart from the other terms of the axis is at least EXCITATION times the noise of the term
   (collinearity: R. V. Jategaonkar, ch. 6, and Klein and Morelli, ch. 5, in docs/references.md);
3. its standard error, with residuals correlated in time, is at most RELATIVE_ERROR of its value, or so small that it
   moves the coefficient by less than NEGLIGIBLE of its spread.

These are the limits by which `replay` gives USE (identification/trust.py); the states are coarser than its own.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.atmosphere import SEA_LEVEL_TEMPERATURE, altitude_at
from aircraft_sysid_ros.aircraft.expression import Program
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.aircraft.term_values import evaluate
from aircraft_sysid_ros.flight_check.grid import memory_of
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.signals import FORCE, GYRO, INPUTS, SURFACES, Flight, Stream

Array = npt.NDArray[np.float64]

EXCITATION, RELATIVE_ERROR, NEGLIGIBLE = 3.0, 0.25, 0.05
#: Average [s] over which samples are looked at, and points that are looked at at most.
_WIDTH, _MOST_POINTS = 0.3, 30_000
#: Terms are collinear where no more than this share of their square is their own.
_ROUNDING = 1e-9
#: Density and speed of sound where nothing says them.
_DENSITY, _SOUND = 1.225, float(np.sqrt(1.4 * 287.05287 * SEA_LEVEL_TEMPERATURE))
#: The measured signal that a signal of a term needs; those that are not named need the airspeed alone.
_NEEDS = {
    "alpha": "angle_of_attack", "beta": "sideslip", "p": GYRO[0], "q": GYRO[1], "r": GYRO[2], "de": "elevator",
    "da": "aileron", "dr": "rudder", "flaps": "flaps", "Tc": "thrust", "throttle": "throttle",
    "propeller_speed": "propeller_speed", "height": "altitude", "alpha_dot": "angle_of_attack", "beta_dot": "sideslip",
}  # fmt: skip


#: Signals that the reconstruction may have where nothing measures them.
_MADE_UP = frozenset({"alpha", "beta", "alpha_dot", "beta_dot", "height"})


@dataclass(frozen=True)
class Identifiability:
    """Of one parameter: whether the flight shows it, the motion of its term alone over its noise, and why."""

    name: str
    is_shown: bool
    excitation: float  # NaN where the term is not measured
    relative_error: float  # standard error over value
    reason: str
    is_held: bool = False  # its motion shows it, but its axis lacks a signal, and nothing of that is learnt


def identifiable(motion: Motion, model: AerodynamicModel) -> list[Identifiability]:
    """Of all parameters of a model."""
    found = []
    values, noise = _signals(motion), _noises(motion)
    for axis, programs in enumerate(model.programs):
        first = model.offsets[axis]
        names = model.parameter_names[first : first + len(programs)]
        lacking = [_lacking(motion.flight, axis, [s for s in model.signal_names if s in p.signals]) for p in programs]
        there = [j for j, reason in enumerate(lacking) if not reason]
        verdicts = _judged(_response(motion, axis), [programs[j] for j in there], values, noise, model.inputs)
        judged = dict(zip(there, verdicts, strict=True))
        held = _held(motion.flight, axis, model.signals_of_axes[axis])
        for j, name in enumerate(names):
            nothing = (False, float("nan"), float("nan"), lacking[j])
            one = Identifiability(name, *judged.get(j, nothing))
            if held and j in judged:
                one = replace(one, is_shown=False, is_held=one.is_shown, reason=held)
            found.append(one)
    return found


def _lacking(flight: Flight, axis: int, signals: list[str]) -> str:
    """What the flight does not measure of a term; empty: nothing."""
    response = FORCE[0] if axis < 3 else GYRO[0]
    needed = [response, "true_airspeed", *(_NEEDS[s] for s in signals if s in _NEEDS)]
    needed += [INPUTS + s for s in signals if s not in SIGNALS]
    missing = [name for name in needed if flight.column(name) is None]
    return f"{missing[0]} is not measured" if missing else ""


def _held(flight: Flight, axis: int, signals: Collection[str]) -> str:
    """Why `replay` holds an axis whole, whatever its other terms show: one that it reads has no value; empty: not so.

    Not of what the reconstruction makes up for: the angles of flow and the height.
    """
    for signal in signals:
        if signal not in _MADE_UP and (lacking := _lacking(flight, axis, [signal])):
            return f"replay holds all of {AXES[axis][0]}_{AXES[axis][1]}, whose model reads it: {lacking}"
    return ""


def _signals(motion: Motion) -> dict[str, Array]:
    """SIGNALS and the named inputs (count,) on the grid, rates without the length that norms them, smoothed alike."""
    grid = motion.grid
    width = max(_WIDTH, 3.0 * grid.step)
    speed = _speed(motion)
    density = np.where(np.isfinite(motion.air[:, 0]), motion.air[:, 0], _DENSITY)
    qbar = 0.5 * density * speed**2
    p, q, r = motion.gyro.T
    de, da, dr, flaps, throttle, thrust, propeller = motion.controls.T
    with np.errstate(divide="ignore", invalid="ignore"):
        raw = {
            "alpha": motion.alpha, "beta": motion.beta, "p": p / speed, "q": q / speed, "r": r / speed,
            "de": de, "da": da, "dr": dr, "flaps": flaps, "Tc": thrust / qbar, "throttle": throttle,
            "propeller_speed": propeller, "V": speed, "qbar": qbar, "mach": speed / _SOUND, "height": _height(motion),
            "alpha_dot": grid.slope(motion.alpha) / speed, "beta_dot": grid.slope(motion.beta) / speed,
            "time": grid.time,
        }  # fmt: skip
    raw |= {item.name: column for item, column in zip(motion.flight.inputs, motion.inputs.T, strict=True)}
    return {name: grid.smooth(value, width) for name, value in raw.items()}


def _speed(motion: Motion) -> Array:
    """The airspeed (count,) [m/s], NaN where it is none that divides."""
    return np.where(motion.airspeed > 0.0, motion.airspeed, np.nan)


def _height(motion: Motion) -> Array:
    height = -motion.position[:, 2]
    if np.any(np.isfinite(height)):
        return height
    pressure = motion.air[:, 1]
    return np.asarray(altitude_at(np.where(pressure > 0.0, pressure, np.nan)))


def white_noise(stream: Stream, column: int) -> float:
    """One sigma of the noise of a signal from its third differences, by their median: motion leaves little in them.

    Third differences of white noise have a variance of 20 times its own.
    """
    values = stream.values[:, column]
    third = np.diff(values[np.isfinite(values)], 3)
    return 1.4826 * float(np.median(np.abs(third))) / np.sqrt(20.0) if len(third) > 20 else 0.0


def _noises(motion: Motion) -> dict[str, float]:
    """One sigma of SIGNALS and the named inputs after the average, from the scatter of their samples."""
    speeds = _speed(motion)
    speed = float(np.nanmedian(speeds)) if np.any(np.isfinite(speeds)) else 1.0
    play = {surface: motion.flight.surface_noise for surface in SURFACES}
    play |= {INPUTS + item.name: item.noise for item in motion.flight.inputs}
    noise = dict.fromkeys(SIGNALS, 0.0)
    for name, needed in [*_NEEDS.items(), *((item.name, INPUTS + item.name) for item in motion.flight.inputs)]:
        there = motion.flight.column(needed)
        if there is None or name in ("alpha_dot", "beta_dot", "Tc"):
            continue
        stream, column = there
        averaged = max(1.0, 0.67 * _WIDTH * stream.rate) if np.isfinite(stream.rate) else 1.0
        noise[name] = white_noise(stream, column) / float(np.sqrt(averaged))
        if name in ("p", "q", "r"):
            noise[name] /= speed
        noise[name] = max(noise[name], play.get(needed, 0.0))  # a command has no noise, but its surface has play
    return noise


def _response(motion: Motion, axis: int) -> Array:
    """Acceleration over dynamic pressure (count,), smoothed as the terms."""
    grid = motion.grid
    density = np.where(np.isfinite(motion.air[:, 0]), motion.air[:, 0], _DENSITY)
    if axis < 3:
        acceleration = motion.force[:, axis]
    else:
        acceleration = grid.slope(motion.gyro[:, axis - 3])
    with np.errstate(divide="ignore", invalid="ignore"):
        return grid.smooth(acceleration / (0.5 * density * motion.airspeed**2), max(_WIDTH, 3.0 * grid.step))


def _judged(
    response: Array,
    programs: list[Program],
    values: Mapping[str, Array],
    noise: Mapping[str, float],
    inputs: tuple[str, ...],
) -> list[tuple[bool, float, float, str]]:
    """Shown or not, excitation, relative error and reason of each term."""
    if not programs:
        return []
    terms = evaluate(programs, values, inputs)
    good = np.flatnonzero(np.isfinite(response) & np.all(np.isfinite(terms), axis=1))
    stride = max(1, len(good) // _MOST_POINTS)
    good = good[::stride]
    if len(good) < 20 * len(programs):
        return [(False, 0.0, float("inf"), "too few samples in the air")] * len(programs)
    x, y = terms[good], response[good]
    shifts = [
        evaluate(programs, {**values, name: values[name] + size}, inputs)[good] - x
        for name, size in noise.items()
        if size
    ]
    term_noise = np.sqrt(sum((np.mean(shift**2, axis=0) for shift in shifts), np.zeros(len(programs))))
    scale = np.sqrt(np.mean(x**2, axis=0))
    moving = scale > 1e-12
    theta, std, alone = np.zeros(len(scale)), np.full(len(scale), np.inf), np.zeros(len(scale))
    basis = x[:, moving] / scale[moving]
    inverse = np.linalg.inv(basis.T @ basis / len(y) + _ROUNDING * np.eye(basis.shape[1]))
    theta[moving] = inverse @ (basis.T @ y) / len(y) / scale[moving]
    residual = y - x @ theta
    memory = memory_of(residual, min(len(residual) // 4, 1000))
    spread = np.sqrt(np.diag(inverse))
    std[moving] = np.std(residual) * spread * np.sqrt(memory / len(y)) / scale[moving]
    alone[moving] = scale[moving] / spread
    effect = np.where(moving, std, 0.0) * scale / max(float(np.std(y)), 1e-300)
    return [_verdict(alone[j], term_noise[j], theta[j], std[j], effect[j]) for j in range(len(scale))]


def _verdict(alone: float, noise: float, theta: float, std: float, effect: float) -> tuple[bool, float, float, str]:
    excitation = alone / noise if noise > 0.0 else (100.0 if alone > 0.0 else 0.0)
    error = std / abs(theta) if theta else float("inf")
    if alone == 0.0:
        return False, 0.0, error, "it does not move"
    if excitation < EXCITATION:
        return False, excitation, error, f"moves {excitation:.2f} times its noise on its own, {EXCITATION:g} needed"
    small = effect < NEGLIGIBLE
    if error > RELATIVE_ERROR and not small:
        return False, excitation, error, f"expected standard error {100.0 * min(error, 9.99):.0f} % of its value"
    reason = f"moves {min(excitation, 999.0):.0f} times its noise, standard error {100.0 * min(error, 9.99):.0f} %"
    return True, excitation, error, f"{reason}, small" if error > RELATIVE_ERROR else reason
