"""Steady straight and level flight of a learnt model, and the slopes of its coefficients there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.signals import CONTROL_WORDS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.export.learnt_model import SURFACES, LearntModel, that_go_with_time, thrust_part
from aircraft_sysid_ros.rounding import fixed

Array = npt.NDArray[np.float64]

SEA_LEVEL_DENSITY = 1.225  # [kg/m^3] of the calibrated airspeed
#: Residual [-] of the coefficients that still counts as trimmed.
_TOLERANCE = 1e-6
_STEP = 1e-5
#: Angle of attack, sideslip or bank [rad] beyond which no level flight is meant, but a hover or a knife edge.
_STEEPEST = 0.5
SLOPES = ("alpha", "beta", "p", "q", "r", "de", "da", "dr", "alpha_dot")
#: The moment that each surface is there for.
MOMENT_OF = {"de": "Cm", "da": "Cl", "dr": "Cn"}
_FLOW = ("alpha", "beta", *SURFACES)


@dataclass(frozen=True)
class LevelFlight:
    """A trim. Angles [rad], airspeeds [m/s]."""

    airspeed: float  # true
    calibrated_airspeed: float
    density: float  # [kg/m^3]
    alpha: float
    bank: float  # 0 where aileron and rudder leave the wings level
    surfaces: Array  # (3,) elevator, aileron, rudder
    thrust: float  # [N]; NaN where the model does not know it
    signals: Array  # (SIGNAL_COUNT,) its signal row
    outside: tuple[str, ...]  # signals beyond the range in which they were learnt
    moved: tuple[str, ...]  # surfaces that the model knows


def airspeeds_of(learnt: LearntModel) -> tuple[float, float, float]:
    """True airspeeds [m/s] that gains are made for: trim, which is the median of the rows, lowest and highest.

    The lowest is no slower than the largest lift that was flown carries: a push-over or a stall is no level flight.
    Raises InputError without whole rows, and where that lift does not carry the weight at trim.
    """
    speed = learnt.signal("V")
    trim, carried = float(np.median(speed)), slowest(learnt) * float(np.sqrt(SEA_LEVEL_DENSITY / density_of(learnt)))
    if carried > trim:
        raise InputError(
            f"the largest lift that was flown carries {learnt.aircraft.mass:.3g} kg only from {carried:.1f} m/s "
            f"on, and half of the flight is slower than {trim:.1f} m/s: the mass is wrong, or the model lacks lift, "
            "which shows in aircraft-sysid compare"
        )
    return trim, max(float(speed.min()), carried), float(speed.max())


def density_of(learnt: LearntModel) -> float:
    """Density of the air [kg/m^3], the median of the rows."""
    flown = learnt.flown
    return float(np.median(2.0 * flown.signal("qbar") / flown.signal("V") ** 2))


def slowest(learnt: LearntModel) -> float:
    """Calibrated airspeed [m/s] of level flight at the largest lift that was flown; 0 where none was."""
    lift = float(lift_coefficient(learnt.flown).max())
    weight = learnt.aircraft.mass * STANDARD_GRAVITY / learnt.aircraft.wing_area
    return float(np.sqrt(2.0 * weight / (SEA_LEVEL_DENSITY * lift))) if lift > 0.0 else 0.0


def lift_coefficient(flown: LearntModel) -> Array:
    """C_L (n,) of the rows without thrust."""
    ours, alpha = flown.coefficients - thrust_part(flown), flown.signal("alpha")
    return np.asarray(ours[:, 0] * np.sin(alpha) - ours[:, 2] * np.cos(alpha))


def middle_row(learnt: LearntModel) -> Array:
    """Medians of the rows (SIGNAL_COUNT,), 0 of signals that are never known."""
    known = (column[np.isfinite(column)] for column in learnt.signals.T)
    return np.array([np.median(column) if len(column) else 0.0 for column in known])


def level_flight(learnt: LearntModel, airspeed: float) -> LevelFlight:
    """Angles and surfaces at which nothing accelerates. Raises InputError where there are none.

    Signals that are neither flow, rates nor surfaces are the medians of the rows. Without a term of T_c or of the
    throttle the model does not know its thrust, and C_X is left out. An aeroplane without rudder or without ailerons
    banks a little for a straight path. A pitching moment that no elevator is known to trim, and a rolling moment that
    neither aileron nor rudder is, are left out, and the elevator is then where it was in flight.
    """
    aircraft, names = learnt.aircraft, learnt.model.signal_names
    density = density_of(learnt)
    row = middle_row(learnt)
    qbar = 0.5 * density * airspeed**2
    row[[names.index(name) for name in ("p", "q", "r", "alpha_dot", "beta_dot")]] = 0.0
    row[names.index("V")], row[names.index("qbar")] = airspeed, qbar
    weight = aircraft.mass * STANDARD_GRAVITY / (qbar * aircraft.wing_area)
    read = learnt.reads("CX", "CY", "CZ", "Cl", "Cm", "Cn")
    thrust = next((name for name in ("Tc", "throttle") if name in learnt.reads("CX")), None)
    is_trimmed = {"CX": thrust is not None, "Cm": "de" in learnt.reads("Cm"), "Cl": bool({"da", "dr"} & read)}
    flow = [name for name in _FLOW if name != "de" or is_trimmed["Cm"]]
    free = [name for name in (*flow, thrust) if name is not None and name in read]
    balanced = [i for i, axis in enumerate(AXES) if is_trimmed.get(axis, True)]
    to_gravity = learnt.about_gravity
    banks = not {"da", "dr"} <= read

    def put(x: Array) -> Array:
        out = row.copy()
        for name in flow:
            out[names.index(name)] = 0.0
        for name, value in zip(free, x, strict=False):  # the bank is the last one
            out[names.index(name)] = value
        return out

    def residual(x: Array) -> Array:
        signals = put(x)
        coefficients = to_gravity @ learnt.coefficients_of(learnt.terms_on(signals[None]))[0]
        pitch, bank = signals[names.index("alpha")], x[-1] if banks else 0.0
        coefficients[0] -= weight * np.sin(pitch)
        coefficients[1] += weight * np.cos(pitch) * np.sin(bank)
        coefficients[2] += weight * np.cos(pitch) * np.cos(bank)
        return np.asarray(coefficients[balanced])

    start = np.zeros(len(free) + banks)
    found = least_squares(residual, start, method="lm", xtol=1e-12, ftol=1e-14, gtol=1e-14)
    signals, bank = put(found.x), float(found.x[-1]) if banks else 0.0
    steepest = max(abs(signals[names.index("alpha")]), abs(signals[names.index("beta")]), abs(bank))
    if not np.max(np.abs(found.fun)) < _TOLERANCE or steepest > _STEEPEST:
        raise InputError(
            f"the model {learnt.identifier} has no steady level flight at {airspeed:.1f} m/s: what it lacks of lift, "
            "pitching moment or control shows in aircraft-sysid compare"
        )
    at = {name: float(signals[names.index(name)]) for name in _FLOW}
    outside = tuple(
        n for n in (*free, "V") if n in learnt.ranges and not _within(signals[names.index(n)], learnt.ranges[n])
    )
    calibrated = airspeed * float(np.sqrt(density / SEA_LEVEL_DENSITY))
    surfaces = np.array([at[name] for name in SURFACES])
    newtons = float(signals[names.index("Tc")]) * qbar * aircraft.wing_area if thrust == "Tc" else np.nan
    moved = tuple(name for name in SURFACES if name in read)
    return LevelFlight(airspeed, calibrated, density, at["alpha"], bank, surfaces, newtons, signals, outside, moved)


def slopes(learnt: LearntModel, signals: Array) -> Array:
    """d C_i / d (signal of SLOPES) per parameter at a signal row, (k, 9): with the values of an axis its slopes."""
    names, rows = learnt.model.signal_names, []
    for name in SLOPES:
        for sign in (1.0, -1.0):
            row = signals.copy()
            row[names.index(name)] += sign * _STEP
            rows.append(row)
    steady = np.array([learnt.terms_on(row[None])[0] for row in rows])  # each by itself: lags are in steady flight
    change = (steady[0::2] - steady[1::2]) / (2.0 * _STEP)
    return np.asarray(np.nan_to_num(change).T)


def level_words(level: LevelFlight) -> str:
    """A trim in words."""
    surfaces = "".join(
        f", {CONTROL_WORDS[name]} {fixed(np.degrees(value), 2)} deg"
        for name, value in zip(SURFACES, level.surfaces, strict=True)
        if name in level.moved
    )
    bank = f", bank {fixed(np.degrees(level.bank), 2)} deg" if level.bank else ""
    thrust = f", thrust {fixed(level.thrust, 2)} N" if np.isfinite(level.thrust) else ""
    outside = f"; outside of the learnt range: {', '.join(level.outside)}" if level.outside else ""
    return (
        f"level flight at {level.airspeed:.2f} m/s (calibrated {level.calibrated_airspeed:.2f}): angle of attack "
        f"{fixed(np.degrees(level.alpha), 2)} deg{surfaces}{bank}{thrust}{outside}"
    )


def time_notes(learnt: LearntModel) -> list[str]:
    """At which time trims and slopes are those of a model that goes with it."""
    if not (names := that_go_with_time(learnt)):
        return []
    at = middle_row(learnt)[learnt.model.signal_names.index("time")]
    return [f"{names}: the model goes with the time of the flight, and trims and gains are for {at:.0f} s, its middle"]


def moment_signs(learnt: LearntModel, signals: Array) -> dict[str, float]:
    """+1 or -1 by surface: the sign of the moment of a positive deflection at a row; 0 where it is not known."""
    factors = slopes(learnt, signals)
    parts = [learnt.values[learnt.model.axis_slice(axis)] @ factors[learnt.model.axis_slice(axis)] for axis in AXES]
    c = learnt.about_gravity @ np.array(parts)
    return {s: float(np.sign(c[AXES.index(axis), SLOPES.index(s)])) for s, axis in MOMENT_OF.items()}


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
