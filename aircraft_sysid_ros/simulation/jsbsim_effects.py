"""Hidden effects in a JSBSim aeroplane: a copy of its file with more forces, moments and masses.

Terms of a recipe become functions of JSBSim's own properties, in XML: JSBSim itself works them out in every step, as
it does with what its aeroplanes have already. They act at the aerodynamic reference point in body axes. A change of
mass or of the centre of gravity is made with point masses, whose weights are set in flight.
"""

from __future__ import annotations

import ast
import shutil
import tempfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.term_values import lags_of
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.hidden_effects import Hidden
from aircraft_sysid_ros.simulation.jsbsim_flight import (
    ALPHA_DOT,
    BETA_DOT,
    FOOT,
    INCH,
    POUND,
    RATE,
    SETTLING,
    JsbsimSetup,
    fly_jsbsim,
    trimmed,
)
from aircraft_sysid_ros.simulation.manoeuvres import Plan

Array = npt.NDArray[np.float64]


def _property(name: str) -> str:
    return f"<property>{name}</property>"


def _call(tag: str, *parts: str) -> str:
    return f"<{tag}>{''.join(parts)}</{tag}>"


def _value(number: float) -> str:
    return f"<value>{number:.12g}</value>"


def _scaled(name: str, factor: float) -> str:
    return _call("product", _property(name), _value(factor))


#: Signals of expressions as JSBSim functions.
_SIGNALS = {
    "alpha": _property("aero/alpha-rad"),
    "beta": _property("aero/beta-rad"),
    "p": _call("product", _property("velocities/p-aero-rad_sec"), _property("aero/bi2vel")),
    "q": _call("product", _property("velocities/q-aero-rad_sec"), _property("aero/ci2vel"), _value(2.0)),
    "r": _call("product", _property("velocities/r-aero-rad_sec"), _property("aero/bi2vel")),
    "de": _property("fcs/elevator-pos-rad"),
    "da": _property("fcs/left-aileron-pos-rad"),
    "dr": _property("fcs/rudder-pos-rad"),
    "flaps": _property("fcs/flap-pos-rad"),
    "Tc": _call(
        "quotient",
        _property("propulsion/engine/thrust-lbs"),
        _call("product", _property("aero/qbar-psf"), _property("metrics/Sw-sqft")),
    ),
    "throttle": _property("fcs/throttle-pos-norm"),
    "propeller_speed": _scaled("propulsion/engine/propeller-rpm", np.pi / 30.0),
    "V": _scaled("velocities/vt-fps", FOOT),
    "qbar": _scaled("aero/qbar-psf", POUND / FOOT**2),
    "mach": _property("velocities/mach"),
    "height": _scaled("position/h-agl-ft", FOOT),
    "alpha_dot": _call("product", _property(ALPHA_DOT), _property("aero/ci2vel"), _value(2.0)),
    "beta_dot": _call("product", _property(BETA_DOT), _property("aero/bi2vel")),
    "time": _call("difference", _property("simulation/sim-time-sec"), _value(SETTLING)),
}
_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "sum", ast.Sub: "difference", ast.Mult: "product", ast.Div: "quotient", ast.Pow: "pow",
}  # fmt: skip
_SAME_NAME = ("abs", "sin", "cos", "exp", "sqrt", "max", "min")
#: Direction of each axis, and the length that its moment coefficient is multiplied by.
_AXES = {
    "CX": ("force", "x", ""), "CY": ("force", "y", ""), "CZ": ("force", "z", ""),
    "Cl": ("moment", "x", "metrics/bw-ft"), "Cm": ("moment", "y", "metrics/cbarw-ft"),
    "Cn": ("moment", "z", "metrics/bw-ft"),
}  # fmt: skip


def function_of(expression: str) -> str:
    """The JSBSim function, in XML, of an expression of aircraft.expression."""
    return _function(ast.parse(expression, mode="eval").body)


def _function(node: ast.expr) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return _value(node.value)
    if isinstance(node, ast.Name):
        return _SIGNALS[node.id]
    if isinstance(node, ast.UnaryOp):
        inner = _function(node.operand)
        return _call("product", _value(-1.0), inner) if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp):
        return _call(_OPERATORS[type(node.op)], _function(node.left), _function(node.right))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        if node.func.id in ("lag", "limited"):
            started = _call("gt", _property("simulation/sim-time-sec"), _value(0.0))  # trimmed in steady flight
            return _call("ifthen", started, _property(_lag_name(ast.unparse(node))), _function(node.args[0]))
        arguments = [_function(argument) for argument in node.args]
        if node.func.id in _SAME_NAME:
            return _call(node.func.id, *arguments)
        if node.func.id == "sign":
            return _call("ifthen", _call("gt", arguments[0], _value(0.0)), _value(1.0), _value(-1.0))
        if node.func.id == "tanh":  # 1 - 2 / (1 + exp(2 x))
            power = _call("exp", _call("product", _value(2.0), arguments[0]))
            return _call("difference", _value(1.0), _call("quotient", _value(2.0), _call("sum", _value(1.0), power)))
    raise InputError(f"'{ast.unparse(node)}' has no counterpart in JSBSim")


def _lag_name(text: str) -> str:
    return f"hidden/lag-{zlib.crc32(text.replace(' ', '').encode()):08x}"


#: JSBSim works out the numbers of its filters when it loads an aeroplane, for its own step and not for ours [Hz].
_FILTER_RATE = 120.0


def lag_filters(terms: Sequence[Effect]) -> str:
    """XML of a system with one filter of JSBSim for each ``lag(…)`` of some terms, and an actuator for each
    ``limited(…)``; it goes before the aerodynamics.
    """
    parts = []
    for lag in lags_of([parse_expression(term.expression) for term in terms]):
        name = _lag_name(lag.text)
        kind, key, rate = ("lag_filter", "c1", 1.0 / lag.tau) if lag.tau > 0.0 else ("actuator", "rate_limit", lag.rate)
        parts.append(
            f'<fcs_function name="{name}-of"><function>{function_of(lag.program.text)}</function></fcs_function>'
            f'<{kind} name="{name}"><input>{name}-of</input><{key}>{_FILTER_RATE / RATE * rate:.12g}</{key}></{kind}>'
        )
    return f'<system name="hidden"><channel name="hidden">{"".join(parts)}</channel></system>' if parts else ""


def external_reactions(terms: Sequence[Effect], reference: Sequence[float]) -> str:
    """XML of forces and moments that add terms at the aerodynamic reference, structural axes [in]."""
    parts = []
    for axis in {term.axis: None for term in terms}:
        kind, direction, length = _AXES[axis]
        own = [_call("product", _value(t.value), function_of(t.expression)) for t in terms if t.axis == axis]
        factors = [_property("aero/qbar-psf"), _property("metrics/Sw-sqft"), *([_property(length)] if length else [])]
        magnitude = _call("product", *factors, _call("sum", _value(0.0), *own))
        place = "".join(f"<{k}>{v}</{k}>" for k, v in zip("xyz", reference, strict=True))
        arrow = "".join(f"<{k}>{float(k == direction)}</{k}>" for k in "xyz")
        location = f'<location unit="IN">{place}</location>' if kind == "force" else ""
        parts.append(
            f'<{kind} name="hidden-{axis}" frame="BODY"><function name="hidden/{axis}">{magnitude}</function>{location}'
            f"<direction>{arrow}</direction></{kind}>"
        )
    return f"<external_reactions>{''.join(parts)}</external_reactions>" if parts else ""


def edited_model(executive: Any, name: str, hidden: Sequence[Hidden], folder: Path) -> int:
    """Write a copy of a JSBSim aeroplane with hidden effects into ``folder``/name; the number of its point masses.

    ``executive`` has the original loaded: from it come the centre of gravity and the aerodynamic reference.
    """
    source = Path(executive.get_root_dir()) / "aircraft" / name
    shutil.copytree(source, folder / name)
    path = folder / name / f"{name}.xml"
    text = path.read_text(encoding="utf8", errors="replace")
    reference = [executive[f"metrics/aero-rp-{axis}-in"] for axis in "xyz"]
    terms = [term for effect in hidden for term in effect.terms]
    reactions = lag_filters(terms) + external_reactions(terms, reference)
    masses = text.count("<pointmass")
    text = text.replace("</fdm_config>", reactions + "</fdm_config>")
    if any(is_of_mass(effect) for effect in hidden):
        text = text.replace("</mass_balance>", _point_masses(executive) + "</mass_balance>", 1)
    path.write_text(text, encoding="utf8")
    return masses


def is_of_mass(effect: Hidden) -> bool:
    """The effect changes mass or centre of gravity."""
    return effect.mass_factor != 1.0 or any(effect.cg_shift)


#: Deflection [rad] of whole flaps (the Cessnas of JSBSim have 30 degrees).
FULL_FLAPS = np.radians(30.0)
#: Arm [m] of the pair of point masses that moves the centre of gravity.
_ARM = 1.0


def _point_masses(executive: Any) -> str:
    """Three point masses without weight: at the centre of gravity, and ahead and behind or beside it."""
    center = np.array([executive[f"inertia/cg-{axis}-in"] for axis in "xyz"])
    arm = _ARM / INCH
    places = [center, center + [arm, 0, 0], center - [arm, 0, 0], center + [0, arm, 0], center - [0, arm, 0]]
    made = []
    for i, place in enumerate(places):
        where = "".join(f"<{k}>{v}</{k}>" for k, v in zip("xyz", place, strict=True))
        where = f'<weight unit="LBS">0</weight><location unit="IN">{where}</location>'
        made.append(f'<pointmass name="Hidden{i}">{where}</pointmass>')
    return "".join(made)


def change_mass(executive: Any, effect: Hidden, count: int) -> None:
    """Add the weights that make the change; ``count`` point masses stand before those of ``edited_model``."""
    weight = float(executive["inertia/weight-lbs"])
    x, y, _ = effect.cg_shift  # structural x points aft, y right
    aft, right = -0.5 * x / _ARM, 0.5 * y / _ARM
    for i, part in enumerate((effect.mass_factor - 1.0, aft, -aft, right, -right)):
        executive[f"inertia/pointmass-weight-lbs[{count + i}]"] += part * weight


class Adjustment:
    """What happens to a flight step by step besides the commands of the pilot: flaps, masses, slow actuators."""

    def __init__(self, plan: Plan, hidden: Sequence[Hidden], masses: int) -> None:
        self.plan, self.hidden, self.masses = plan, hidden, masses
        self.lag = sum(effect.command_lag for effect in hidden)
        self.pending = [effect for effect in hidden if is_of_mass(effect)]
        self.shown: Array | None = None

    def __call__(self, executive: Any, step: int, commands: Array) -> Array:
        """Set what is due at a step and return the commands (4,) that act."""
        for effect in [e for e in self.pending if step / RATE >= e.inner["t0"]]:
            change_mass(executive, effect, self.masses)
            self.pending.remove(effect)
        if np.any(self.plan.flaps > 0.0):
            executive["fcs/flap-cmd-norm"] = self.plan.flaps[step] / FULL_FLAPS
        if self.lag <= 0.0:
            return commands
        keep = np.exp(-1.0 / (RATE * self.lag))
        self.shown = commands if self.shown is None else commands + keep * (self.shown - commands)
        return np.array([*self.shown[:3], commands[3]])


def fly_jsbsim_hidden(setup: JsbsimSetup, wind: Array, plan: Plan, hidden: Sequence[Hidden], ground: float) -> Truth:
    """A flight of a JSBSim aeroplane with hidden effects above a ground [m]; InputError when it does not fly."""
    time = np.arange(len(wind)) / RATE
    for effect in hidden:
        wind = wind + effect.wind(time)
    with tempfile.TemporaryDirectory() as made:
        folder, masses = None, 0
        if any(effect.terms or is_of_mass(effect) for effect in hidden):
            folder = Path(made)
            masses = edited_model(trimmed(setup.name, speed=setup.speed), setup.name, hidden, folder)
        return fly_jsbsim(setup, wind, plan, folder=folder, ground=ground, adjust=Adjustment(plan, hidden, masses))
