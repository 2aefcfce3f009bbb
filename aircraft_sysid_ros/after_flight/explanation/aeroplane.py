"""What an aeroplane is like: stability, damping, control power and modes, from the parameters of a whole flight.

Values are the least squares of ``compare`` at the median conditions of the flight, their standard deviations come from
draws of the parameters' covariance. That knows the noise alone; the standard errors of the parameters that were learnt
in flight know of times that are off by part of a sample as well, and where they are larger they count. What rests on a
parameter that is not to USE is not stated, nor on one of which the two ways say different things, nor on axes of which
the diagnosis says that the model lacks something: one model of all of it is then of no aeroplane.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.rigid_body import coefficients_about_gravity
from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_model.layout import (
    DENSITY,
    HEIGHT,
    INPUT_SIZE,
    NAMED,
    REFERENCE,
    SPEED_OF_SOUND,
    TIME,
    FlightModel,
    flight_model_of,
    make_theta,
)
from aircraft_sysid_ros.flight_model.modes import (
    DUTCH_ROLL,
    PHUGOID,
    ROLL,
    ROLL_SPIRAL,
    SHORT_PERIOD,
    SPIRAL,
    Mode,
    SteadyFlight,
    linearised,
    modes_of,
    steady_flight,
)
from aircraft_sysid_ros.rounding import with_error

Array = npt.NDArray[np.float64]
Verdicts = Mapping[str, tuple[str, str]]

#: Draws of the parameters from their covariance; the standard deviation of one from so many is good to 5 %.
DRAWS = 200
#: Share of a derivative from which a parameter counts as what it rests on.
_PART = 0.1
#: Least share of the draws in which a mode must be there under its name.
_MOST = 0.9
#: Standard errors by which what was learnt in flight may differ from least squares over the same flight. A judgement.
_APART = 3.0
_DEGREE = np.pi / 180.0
_STEPS = {"alpha": 1e-3, "beta": 1e-3, "p": 1e-3, "q": 1e-4, "r": 1e-3, "de": 1e-3, "da": 1e-3, "dr": 1e-3, "Tc": 1e-3}
#: Derivatives that a mode is made of, by axis and signal.
_MADE_OF: dict[str, tuple[tuple[str, str], ...]] = {
    SHORT_PERIOD: (("CZ", "alpha"), ("Cm", "alpha"), ("Cm", "q")),
    PHUGOID: (("CX", "alpha"), ("CZ", "alpha")),
    DUTCH_ROLL: (("CY", "beta"), ("Cn", "beta"), ("Cn", "r")),
    ROLL: (("Cl", "p"),),
    SPIRAL: (("Cl", "beta"), ("Cl", "r"), ("Cn", "beta"), ("Cn", "r")),
    ROLL_SPIRAL: (("Cl", "beta"), ("Cl", "p"), ("Cn", "beta"), ("Cn", "r")),
}
_PITCHING, _ROLLING, _ACROSS = ("CX", "CZ", "Cm"), ("CY", "Cl", "Cn"), (DUTCH_ROLL, ROLL, SPIRAL, ROLL_SPIRAL)
_CONTROL_SIGNALS = ("de", "da", "dr", "flaps", "throttle", "", "propeller_speed")


@dataclass(frozen=True)
class Fact:
    """One thing that is known of an aeroplane, or not, and then why: ``reason`` is empty where it is known."""

    key: str
    group: str
    title: str
    value: float
    std: float
    unit: str
    words: str
    reason: str = ""

    @property
    def json(self) -> dict[str, Any]:
        """With null for what is not known."""
        known = not self.reason
        return {
            "key": self.key,
            "group": self.group,
            "title": self.title,
            "value": self.value if known else None,
            "std": self.std if known else None,
            "unit": self.unit,
            "words": self.words if known else "",
            "reason": self.reason,
        }


@dataclass(frozen=True)
class KnownMode:
    """A mode with the standard deviations of frequency [rad/s], damping and period; ``reason`` why it is not known.

    Where one part of the motion grows and the other dies away it has none of the three (NaN), and where that may be.
    """

    name: str
    frequency: float
    damping: float
    std_frequency: float
    std_damping: float
    growth: float = np.nan  # [1/s]
    std_growth: float = np.nan
    period: float = np.nan  # [s]
    std_period: float = np.nan
    reason: str = ""
    is_first_order: bool = False  # one eigenvalue: its damping is 1 or -1 by definition, and is no finding

    @property
    def time_constant(self) -> float:
        """Time [s] in which a mode of first order falls to, or grows by, e; NaN of one that is of second order."""
        return 1.0 / self.frequency if self.is_first_order and self.frequency > 0.0 else np.nan

    @property
    def std_time_constant(self) -> float:
        """Standard deviation [s], of small errors."""
        return self.time_constant * self.std_frequency / self.frequency if self.is_first_order else np.nan

    @property
    def json(self) -> dict[str, Any]:
        """As ``explain --json`` prints it, with null for what is not known."""
        known = not self.reason
        swings_or_dies = known and bool(np.isfinite(self.frequency))
        std = {
            "frequency": self.std_frequency if swings_or_dies else None,
            "damping": self.std_damping if swings_or_dies and not self.is_first_order else None,
        }
        return {
            "name": self.name,
            "frequency": self.frequency if swings_or_dies else None,
            "damping": self.damping if swings_or_dies else None,
            "std": std if known else None,
            "growth": self.growth if known else None,
            "time_constant": self.time_constant if known and self.is_first_order else None,
            "words": self.words,
            "reason": self.reason,
        }

    @property
    def words(self) -> str:
        """What the motion does."""
        if self.reason:
            return ""
        sure = abs(self.growth) > 2.0 * self.std_growth
        if not sure:
            return "about neutral: growth or decay is within the standard errors"
        if self.growth > 0.0:
            return f"grows: doubles in {np.log(2.0) / self.growth:.2g} s"
        swings = self.damping < 1.0
        return f"{'swings and dies' if swings else 'dies'} away: halves in {np.log(2.0) / -self.growth:.2g} s"


class Learnt:
    """The model of a flight with its parameters, their draws, and the verdict on each."""

    def __init__(
        self,
        comparison: Comparison,
        verdicts: Verdicts,
        estimates: Mapping[str, tuple[float, float]] | None = None,
        lacking: Mapping[str, str] | None = None,
    ) -> None:
        """``verdicts``: status and reason by name, ``estimates``: value and standard error, as in parameters.json;
        ``lacking``: what the model lacks, in words, by axis.
        """
        lacks = (lacking or {}).items()
        self.lacking = {axis: f"the model of {axis[0]}_{axis[1]} lacks {words}: add it" for axis, words in lacks}
        estimates = estimates or {}
        self.flight = comparison.flight
        self.aircraft: Aircraft = comparison.flight.aircraft
        self.model = self.aircraft.model
        names = self.model.parameter_names
        self.values = np.zeros(len(names))
        self.draws = np.zeros((DRAWS, len(names)))
        self.unknown = dict.fromkeys(names, "this flight does not determine it")
        rng = np.random.default_rng(20)
        for axis, fitted in comparison.axes.items():
            part, fit = self.model.axis_slice(axis), fitted.fit
            known = np.isfinite(fit.parameters)
            at = np.arange(part.start, part.stop)[known]
            self.values[at] = fit.parameters[known]
            fitted_names = [str(name) for name in np.array(fit.names)[known]]
            covariance = _not_below(fit.covariance[np.ix_(known, known)], fitted_names, estimates)
            self.draws[:, at] = rng.multivariate_normal(fit.parameters[known], covariance, DRAWS, method="eigh")
            for name, value, std in zip(fitted_names, fit.parameters[known], fit.std[known], strict=True):
                status, reason = verdicts.get(name, ("HOLD", "it is not in the run"))
                apart = _apart(name, (float(value), float(std)), estimates.get(name))
                self.unknown[name] = apart if status == "USE" else f"{name} is {status}: {reason}"
        for axis, why in self.lacking.items():
            for name in names[self.model.axis_slice(axis)]:
                self.unknown[name] = self.unknown[name] or why

    @cached_property
    def conditions(self) -> dict[str, float]:
        """Median of every signal of the flight; 0 of what is not measured."""
        with np.errstate(all="ignore"):
            seen = {name: self.flight.signal(name) for name in self.model.signal_names}
        return {name: float(np.median(x[np.isfinite(x)])) if np.isfinite(x).any() else 0.0 for name, x in seen.items()}

    @cached_property
    def about_gravity(self) -> Array:
        """(6, 6) that turns C_X … C_n of the model into those about the centre of gravity."""
        aircraft = self.aircraft
        return coefficients_about_gravity(aircraft.aerodynamic_reference, aircraft.span, aircraft.chord)

    def row(self, axis: str, signal: str) -> Array:
        """d C_axis / d signal at the conditions is this row (p,) times the parameters.

        Moments are about the centre of gravity: where the model has them about another point, forces are part of them.
        """
        factors = zip(AXES, self.about_gravity[AXES.index(axis)], strict=True)
        return np.sum([factor * self._own_row(each, signal) for each, factor in factors if factor], axis=0)

    def _own_row(self, axis: str, signal: str) -> Array:
        """The same with moments about the aerodynamic reference point."""
        row, part = np.zeros(len(self.values)), self.model.axis_slice(axis)
        at = {name: np.array([value, value]) for name, value in self.conditions.items()}
        for name in ("p", "q", "r", "beta", "alpha_dot", "beta_dot"):
            at[name] = np.zeros(2)
        step = _STEPS[signal]
        at[signal] = at[signal] + np.array([step, -step])
        high, low = self.model.regressors(axis, at)
        row[part] = np.nan_to_num((high - low) / (2.0 * step))
        return row

    def why_unknown(self, *derivatives: tuple[str, str]) -> str:
        """Why derivatives, by axis and signal, are not known; empty where they are."""
        reasons = []
        for axis, signal in derivatives:
            if not self._own_row(axis, signal).any():
                reasons.append(f"the model of {axis[0]}_{axis[1]} has no {signal}")
                continue
            parts = np.abs(self.row(axis, signal) * np.where(self.values, self.values, 1.0))
            large = np.flatnonzero(parts > _PART * parts.max())
            reasons += [self.unknown[self.model.parameter_names[j]] for j in large]
        return next(filter(None, reasons), "")

    def estimate(self, function: Callable[[Array], float]) -> tuple[float, float]:
        """A function of the parameters (p,), and its standard deviation over the draws; half of what 68 % span."""
        return function(self.values), _spread(np.array([function(draw) for draw in self.draws]))


def _apart(name: str, whole: tuple[float, float], learnt: tuple[float, float] | None) -> str:
    """Why a value and standard error of the whole flight do not count beside those learnt in flight; empty: they do."""
    if learnt is None or not abs(whole[0] - learnt[0]) > _APART * np.hypot(whole[1], learnt[1]):
        return ""
    return f"{name} is {with_error(*learnt)} as learnt in flight, but {with_error(*whole)} over the whole flight"


def _not_below(covariance: Array, names: list[str], estimates: Mapping[str, tuple[float, float]]) -> Array:
    """A covariance (k, k) with each standard deviation at least the learnt one, and the same correlations."""
    own = np.sqrt(np.diag(covariance))
    least = np.array([estimates[name][1] if name in estimates else 0.0 for name in names])
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where((own > 0.0) & np.isfinite(least), np.maximum(least / own, 1.0), 1.0)
    return np.asarray(covariance * np.outer(factor, factor))


def _spread(drawn: Array) -> float:
    drawn = drawn[np.isfinite(drawn)]
    return float(np.ptp(np.percentile(drawn, (15.87, 84.13))) / 2.0) if len(drawn) else np.nan


# -- stability, damping, control power -------------------------------------------------------------------------


def facts_of(learnt: Learnt, stall_onset: float | None = None) -> list[Fact]:
    """What can be said, in the order in which a pilot asks. ``stall_onset`` [rad]: where a stall was found."""
    return [*_stability(learnt), *_damping(learnt), *_controls(learnt), *_stall(learnt, stall_onset)]


def _slope(learnt: Learnt, group: str, title: str, axis: str, signal: str, say: Callable[[float, float], str]) -> Fact:
    row = learnt.row(axis, signal)
    value, std = learnt.estimate(lambda theta: float(row @ theta))
    reason = learnt.why_unknown((axis, signal))
    return Fact(f"{axis}_{signal}", group, title, value, std, "per rad", say(value, std), reason)


def _by_sign(minus: str, plus: str) -> Callable[[float, float], str]:
    """Words for a value whose sign is sure, and for one whose sign is not."""
    return lambda value, std: "about neutral" if abs(value) <= 2.0 * std else minus if value < 0.0 else plus


def _stability(learnt: Learnt) -> list[Fact]:
    group = "stability"
    cm, cz = learnt.row("Cm", "alpha"), learnt.row("CZ", "alpha")
    margin, std = learnt.estimate(lambda theta: 100.0 * float(cm @ theta) / float(cz @ theta))
    words = "stable in pitch" if margin > 2.0 * std else "unstable in pitch" if margin < -2.0 * std else "neutral"
    return [
        Fact(
            "static_margin", group, "static margin", margin, std, "% of the chord", words,
            learnt.why_unknown(("Cm", "alpha"), ("CZ", "alpha")),
        ),
        _slope(learnt, group, "pitch stiffness", "Cm", "alpha",
               _by_sign("the nose comes back from a gust", "a gust carries the nose away")),
        _slope(learnt, group, "weathercock stability", "Cn", "beta",
               _by_sign("the nose turns out of the wind", "the nose turns into the wind")),
        _slope(learnt, group, "dihedral effect", "Cl", "beta",
               _by_sign("it rolls away from a sideslip", "it rolls into a sideslip")),
    ]  # fmt: skip


def _damping(learnt: Learnt) -> list[Fact]:
    damped = _by_sign("damped", "driven, not damped")
    named = (("pitch damping", "Cm", "q"), ("roll damping", "Cl", "p"), ("yaw damping", "Cn", "r"))
    return [_slope(learnt, "damping", title, axis, signal, damped) for title, axis, signal in named]


def _controls(learnt: Learnt) -> list[Fact]:
    aircraft, at = learnt.aircraft, learnt.conditions
    rolling = 2.0 * at["V"] / aircraft.span  # [rad/s] per pb/2V
    pitching = at["qbar"] * aircraft.wing_area * aircraft.chord / float(aircraft.inertia[1, 1])
    cm, cl, damping = learnt.row("Cm", "de"), learnt.row("Cl", "da"), learnt.row("Cl", "p")
    cn, stiffness = learnt.row("Cn", "dr"), learnt.row("Cn", "beta")
    listing = (
        ("elevator", "pitch acceleration", "deg/s² per degree",
         lambda theta: pitching * float(cm @ theta), (("Cm", "de"),)),
        ("aileron", "steady roll rate", "deg/s per degree",
         lambda theta: -rolling * float(cl @ theta) / float(damping @ theta), (("Cl", "da"), ("Cl", "p"))),
        ("rudder", "steady sideslip", "deg per degree",
         lambda theta: -float(cn @ theta) / float(stiffness @ theta), (("Cn", "dr"), ("Cn", "beta"))),
    )  # fmt: skip
    facts = []
    for surface, title, unit, function, derivatives in listing:
        if reason := learnt.why_unknown(*derivatives):
            facts.append(Fact(surface, "control power", f"{surface}: {title}", np.nan, np.nan, unit, "", reason))
            continue
        with np.errstate(all="ignore"):
            value, std = learnt.estimate(function)
        words = f"at {at['V']:.3g} m/s"
        facts.append(Fact(surface, "control power", f"{surface}: {title}", value, std, unit, words))
    return facts


def _stall(learnt: Learnt, onset: float | None) -> list[Fact]:
    alpha, cz = learnt.flight.signal("alpha"), learnt.flight.coefficient("CZ")
    known = np.isfinite(alpha) & np.isfinite(cz)
    lacks = [name for name in learnt.flight.inferred if name == "alpha"] or not known.any()
    if lacks:
        reason = "no angle of attack was measured"
        return [Fact("stall_margin", "stall", "margin to the stall", np.nan, np.nan, "deg", "", reason)]
    usual, highest = float(np.median(alpha[known])), float(np.percentile(alpha[known], 99.5))
    lift = float(np.percentile(-cz[known], 99.5))
    if onset is not None and onset <= usual:
        reason = f"what begins at {onset / _DEGREE:.1f}°, below the median of {usual / _DEGREE:.1f}°, is not a stall"
        return [Fact("stall_margin", "stall", "margin to the stall", np.nan, np.nan, "deg", "", reason)]
    if onset is not None and np.isfinite(onset):
        words = f"the stall begins at {onset / _DEGREE:.1f}°, half of the flight is below {usual / _DEGREE:.1f}°"
        return [Fact("stall_margin", "stall", "margin to the stall", (onset - usual) / _DEGREE, np.nan, "deg", words)]
    words = (
        f"at least, since half of the flight is below {usual / _DEGREE:.1f}°, and it reached {highest / _DEGREE:.1f}° "
        f"and a lift coefficient of {lift:.2f} without a stall"
    )
    return [Fact("stall_margin", "stall", "margin to the stall", (highest - usual) / _DEGREE, np.nan, "deg", words)]


def apparent_mass(learnt: Learnt) -> tuple[float, float] | None:
    """Mass [kg] by which the measured thrust accelerates the aeroplane, and its standard deviation; None: not known.

    With T_c = T / (q̄ S) the derivative of C_X = m A_x / (q̄ S) by it is its m over the true one, for thrust along the
    body.
    """
    row = learnt.row("CX", "Tc")
    if "CX" in learnt.lacking or learnt.why_unknown(("CX", "Tc")) or not np.isfinite(learnt.flight.signal("Tc")).any():
        return None
    value, std = learnt.estimate(lambda theta: float(row @ theta))
    if not value > 5.0 * std:
        return None
    mass = float(learnt.aircraft.mass) / value
    return mass, mass * std / value


# -- modes ------------------------------------------------------------------------------------------------------


def known_modes(learnt: Learnt) -> list[KnownMode]:
    """The modes at the median airspeed of the flight; of those that cannot be known the reason."""
    try:
        model = flight_model_of(learnt.aircraft, STANDARD_GRAVITY)
        nominal = {mode.name: mode for mode in _modes(learnt, model, learnt.values)}
    except InputError as error:
        return [_unknown(name, str(error)) for name in (SHORT_PERIOD, PHUGOID, DUTCH_ROLL, ROLL, SPIRAL)]
    drawn: dict[str, list[Mode]] = {name: [] for name in nominal}
    for draw in learnt.draws:
        try:
            for mode in _modes(learnt, model, draw):
                drawn.setdefault(mode.name, []).append(mode)
        except InputError:  # such an aeroplane would not fly
            continue
    return [_known(learnt, mode, drawn[name]) for name, mode in nominal.items()]


def _known(learnt: Learnt, mode: Mode, drawn: list[Mode]) -> KnownMode:
    if reason := learnt.why_unknown(*_MADE_OF[mode.name]):
        return _unknown(mode.name, reason)
    for axis in _ROLLING if mode.name in _ACROSS else _PITCHING:  # it has a part in it, as small as it may be
        if axis in learnt.lacking:
            return _unknown(mode.name, learnt.lacking[axis])
    if len(drawn) < _MOST * DRAWS:
        return _unknown(mode.name, "within the standard errors this mode may not exist")

    def known(name: str) -> tuple[float, float]:
        """A number and its standard deviation; NaN where a part of the draws does not have it."""
        values = np.array([getattr(each, name) for each in drawn])
        return (getattr(mode, name), _spread(values)) if np.isfinite(values).mean() >= _MOST else (np.nan, np.nan)

    (frequency, std_frequency), (damping, std_damping), growth, period = map(
        known, ("frequency", "damping", "growth", "period")
    )
    first_order = len(mode.eigenvalues) == 1
    return KnownMode(
        mode.name, frequency, damping, std_frequency, std_damping, *growth, *period, is_first_order=first_order
    )


def _unknown(name: str, reason: str) -> KnownMode:
    return KnownMode(name, np.nan, np.nan, np.nan, np.nan, reason=reason)


def _modes(learnt: Learnt, model: FlightModel, values: Array) -> list[Mode]:
    """Raises InputError where there is no steady flight."""
    flight = _steady(learnt, model, values)
    return modes_of(*linearised(model, make_theta(model, values), flight))


def _steady(learnt: Learnt, model: FlightModel, values: Array) -> SteadyFlight:
    at = learnt.conditions
    inputs = np.zeros(INPUT_SIZE)
    inputs[: len(_CONTROL_SIGNALS)] = [at.get(name, 0.0) for name in _CONTROL_SIGNALS]
    inputs[5] = at["Tc"] * at["qbar"] * learnt.aircraft.wing_area
    inputs[DENSITY], inputs[HEIGHT], inputs[TIME] = 2.0 * at["qbar"] / at["V"] ** 2, at["height"], at["time"]
    inputs[SPEED_OF_SOUND] = at["V"] / at["mach"] if at["mach"] > 0.0 else 340.0
    inputs[REFERENCE] = 1.0, 0.0, 0.0, 0.0
    for k, name in enumerate(learnt.model.inputs):
        inputs[NAMED.start + k] = at[name]
    theta, by_elevator = make_theta(model, values), float(learnt.row("Cm", "de") @ values)
    by_thrust = float(learnt.row("CX", "Tc") @ values)
    return steady_flight(model, theta, at["V"], inputs, has_elevator=by_elevator != 0.0, has_thrust=by_thrust != 0.0)
