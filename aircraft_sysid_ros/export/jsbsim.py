"""The model as an aeroplane of JSBSim: aircraft XML, version 2.0 of fdm_config.

Coefficients stay in body axes (axes X, Y, Z, ROLL, PITCH, YAW), so that every term is held as it is. Numbers are
written in JSBSim's own units, since its conversions of metric units are rounded. Surfaces are the sum of a command,
times the deflection at full command, and of a property in rad; thrust is a property in N: the flight has not shown how
throttle makes thrust.
"""

from __future__ import annotations

import contextlib
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.export.exported import Exported, comment_of, header_lines
from aircraft_sysid_ros.export.jsbsim_expression import function_of, node, number, prop
from aircraft_sysid_ros.export.learnt_model import LearntModel
from aircraft_sysid_ros.export.level_flight import (
    airspeeds_of,
    level_flight,
    level_words,
    middle_row,
    moment_signs,
    time_notes,
)
from aircraft_sysid_ros.rounding import with_error

Array = npt.NDArray[np.float64]

VERSIONS = ("2.0",)  # of fdm_config
FOOT, INCH, POUND_MASS = 0.3048, 0.0254, 0.45359237
POUND = POUND_MASS * 9.80665  # [N]
SLUG = POUND / FOOT  # [kg]
_PSF = POUND / FOOT**2  # [Pa]
THRUST = "sysid/thrust-n"
OUTSIDE = "sysid/signals-outside-learnt-range"
_AXES = {"CX": "X", "CY": "Y", "CZ": "Z", "Cl": "ROLL", "Cm": "PITCH", "Cn": "YAW"}
_ARMS = {"Cl": "metrics/bw-ft", "Cm": "metrics/cbarw-ft", "Cn": "metrics/bw-ft"}
#: Surface: signal, position that it goes to, command, property in rad.
SURFACES = (
    ("de", "fcs/elevator-pos-rad", "fcs/elevator-cmd-norm", "sysid/elevator-rad"),
    ("da", "fcs/left-aileron-pos-rad", "fcs/aileron-cmd-norm", "sysid/aileron-rad"),
    ("dr", "fcs/rudder-pos-rad", "fcs/rudder-cmd-norm", "sysid/rudder-rad"),
    ("flaps", "fcs/flap-pos-rad", "fcs/flap-cmd-norm", "sysid/flaps-rad"),
)
#: Sign of the moment of a positive command, as in the c172p, the c182 and the J3Cub that come with JSBSim: elevator
#: nose down, aileron to the right, rudder nose left.
COMMANDED = {"de": -1.0, "da": 1.0, "dr": -1.0}
#: Signals that nothing in an aeroplane of JSBSim has: properties that whoever flies it may set, SI.
GIVEN = {"throttle": "sysid/throttle", "propeller_speed": "sysid/propeller-speed-rad_sec"}
_NOT_HELD = (
    "how throttle makes thrust: set the property sysid/thrust-n [N]",
    "landing gear, fuel and what is not in the aircraft file: there is one contact point, at the centre of gravity",
    "actuators: a surface is where it is commanded at once",
)


def export_jsbsim(learnt: LearntModel, full: Array | None = None) -> Exported:
    """The whole file; ``full`` (3,) [rad]: elevator, aileron and rudder at full command, None: the largest flown."""
    root = Element("fdm_config", name=learnt.aircraft.name, version=VERSIONS[0], release="BETA")
    notes = _notes(learnt)
    lines = [*header_lines(learnt, "JSBSim", {}, _NOT_HELD), *notes]
    root.append(Comment(comment_of(lines)))
    header = SubElement(root, "fileheader")
    _text(header, "author", "aircraft-sysid export")
    _text(header, "description", f"{learnt.aircraft.name}, model {learnt.identifier}, learnt in flight")
    _metrics(root, learnt)
    _mass(root, learnt)
    _ground(root)
    SubElement(root, "propulsion")
    _properties(root, learnt)
    _surfaces(root, learnt, full)
    _aerodynamics(root, learnt)
    indent(root)
    text = '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(root, encoding="unicode") + "\n"
    misses = {axis: 0.0 if learnt.knows(axis) else float("nan") for axis in AXES}  # every known term is held
    return Exported(text, misses, _NOT_HELD, notes)


def _notes(learnt: LearntModel) -> tuple[str, ...]:
    notes = [f"the property {OUTSIDE} counts the signals that are outside of the range in which they were learnt"]
    with contextlib.suppress(InputError):  # it may have none, and be flown all the same
        notes.append(level_words(level_flight(learnt, airspeeds_of(learnt)[0])))
    notes += [f"{note}; JSBSim counts it from its own start" for note in time_notes(learnt)]
    if {"alpha_dot", "beta_dot"} & learnt.model.signals_used:
        notes.append(
            "JSBSim works out its alpha and beta rates from the inertial velocity: in a steady wind, terms of "
            "alpha_dot and beta_dot see rolls and pitches that the air does not know"
        )
    return tuple(notes)


def property_of(name: str) -> str:
    """The property that holds a signal of the model, in its unit."""
    return f"sysid/signal/{name}"


def lag_property(number: int) -> str:
    """The property that holds a lag of the model."""
    return f"sysid/lag/lag{number}"


def _lag_input(number: int) -> str:
    return f"sysid/lag/input{number}"


def _text(parent: Element, tag: str, text: str, **attributes: str) -> Element:
    element = SubElement(parent, tag, attributes)
    element.text = text
    return element


def _place(parent: Element, tag: str, position: np.ndarray, **attributes: str) -> Element:
    """A location in structural axes (aft, right, up) whose zero is the centre of gravity, from FRD [m]."""
    place = SubElement(parent, tag, {**attributes, "unit": "IN"})
    for axis, value, sign in zip("xyz", position, (-1.0, 1.0, -1.0), strict=True):
        _text(place, axis, repr(float(sign * value / INCH) + 0.0))
    return place


def _metrics(root: Element, learnt: LearntModel) -> None:
    a = learnt.aircraft
    metrics = SubElement(root, "metrics")
    _text(metrics, "wingarea", repr(a.wing_area / FOOT**2), unit="FT2")
    _text(metrics, "wingspan", repr(a.span / FOOT), unit="FT")
    _text(metrics, "chord", repr(a.chord / FOOT), unit="FT")
    _place(metrics, "location", a.aerodynamic_reference, name="AERORP")
    for name in ("EYEPOINT", "VRP"):
        _place(metrics, "location", np.zeros(3), name=name)


def _mass(root: Element, learnt: LearntModel) -> None:
    inertia = learnt.aircraft.inertia / (SLUG * FOOT**2)
    balance = SubElement(root, "mass_balance", {"negated_crossproduct_inertia": "false"})
    for tag, value in (("ixx", inertia[0, 0]), ("iyy", inertia[1, 1]), ("izz", inertia[2, 2]), ("ixz", -inertia[0, 2])):
        _text(balance, tag, repr(float(value) + 0.0), unit="SLUG*FT2")
    _text(balance, "emptywt", repr(learnt.aircraft.mass / POUND_MASS), unit="LBS")
    _place(balance, "location", np.zeros(3), name="CG")


def _ground(root: Element) -> None:
    contact = SubElement(SubElement(root, "ground_reactions"), "contact", {"type": "STRUCTURE", "name": "cg"})
    _place(contact, "location", np.zeros(3))
    for tag, value, unit in (("spring_coeff", "100", "LBS/FT"), ("damping_coeff", "10", "LBS/FT/SEC")):
        _text(contact, tag, value, unit=unit)
    for tag in ("static_friction", "dynamic_friction"):
        _text(contact, tag, "0.5")


def _given(learnt: LearntModel) -> list[str]:
    """Properties of signals that whoever flies it sets."""
    used = learnt.model.signals_used
    return [*(GIVEN[name] for name in GIVEN if name in used), *(f"sysid/inputs/{name}" for name in learnt.model.inputs)]


def _properties(root: Element, learnt: LearntModel) -> None:
    system = SubElement(root, "system", name="sysid")
    for name in (THRUST, *(in_rad for *_, in_rad in SURFACES), *_given(learnt)):
        _text(system, "property", name, value="0")
    for k, lag in enumerate(learnt.model.lags):
        channel = SubElement(system, "channel", name=f"lag {k}")
        followed = SubElement(channel, "fcs_function", name=_lag_input(k))
        signals = {name: property_of(name) for name in learnt.model.signal_names}
        SubElement(followed, "function").append(function_of(lag.program.text, signals, {}))
        is_lag = np.isinf(lag.rate)
        filtered = SubElement(channel, "lag_filter" if is_lag else "actuator", name=lag_property(k))
        _text(filtered, "input", _lag_input(k))
        _text(filtered, *(("c1", repr(1.0 / max(lag.tau, 1e-6))) if is_lag else ("rate_limit", repr(lag.rate))))


def _surfaces(root: Element, learnt: LearntModel, full: Array | None) -> None:
    signs = moment_signs(learnt, middle_row(learnt))
    reach = {name: max(map(abs, learnt.ranges.get(name, (0.0, 0.0)))) for name, *_ in SURFACES}
    if full is not None:
        reach |= dict(zip(("de", "da", "dr"), full.tolist(), strict=True))
    control = SubElement(root, "flight_control", name="surfaces")
    for name, position, command, in_rad in SURFACES:
        channel = SubElement(control, "channel", name=name)
        summed = SubElement(channel, "fcs_function", name=f"sysid/position/{name}")
        way = COMMANDED.get(name, 1.0) * signs.get(name, 0.0) or 1.0
        scaled = node("product", prop(command), number(way * reach[name]))
        SubElement(summed, "function").append(node("sum", scaled, prop(in_rad)))
        _text(summed, "output", position)


def _signal(name: str) -> Element:
    """A signal of the model, in its unit, from JSBSim's properties."""
    positions = {signal: position for signal, position, *_ in SURFACES}
    if name in positions:
        return prop(positions[name])
    if name in GIVEN:
        return prop(GIVEN[name])
    half_span, chord = prop("aero/bi2vel"), node("product", number(2.0), prop("aero/ci2vel"))
    made = {
        "alpha": lambda: prop("aero/alpha-rad"),
        "beta": lambda: prop("aero/beta-rad"),
        "p": lambda: node("product", prop("velocities/p-aero-rad_sec"), half_span),
        "q": lambda: node("product", prop("velocities/q-aero-rad_sec"), chord),
        "r": lambda: node("product", prop("velocities/r-aero-rad_sec"), half_span),
        "alpha_dot": lambda: node("product", prop("aero/alphadot-rad_sec"), chord),
        "beta_dot": lambda: node("product", prop("aero/betadot-rad_sec"), half_span),
        "V": lambda: node("product", prop("velocities/vt-fps"), number(FOOT)),
        "qbar": lambda: node("product", prop("aero/qbar-psf"), number(_PSF)),
        "mach": lambda: prop("velocities/mach"),
        "height": lambda: node("product", prop("position/h-agl-ft"), number(FOOT)),
        "time": lambda: prop("simulation/sim-time-sec"),
        "Tc": lambda: node(
            "quotient", node("quotient", prop(THRUST), number(POUND)), node("max", _scale(), number(1e-6))
        ),
    }
    return made[name]() if name in made else prop(f"sysid/inputs/{name}")


def _scale() -> Element:
    return node("product", prop("aero/qbar-psf"), prop("metrics/Sw-sqft"))


def _aerodynamics(root: Element, learnt: LearntModel) -> None:
    aerodynamics = SubElement(root, "aerodynamics")
    signals = [n for n in learnt.model.signal_names if n in learnt.model.signals_used or n in learnt.ranges]
    for name in signals:
        SubElement(aerodynamics, "function", name=property_of(name)).append(_signal(name))
    outside = SubElement(aerodynamics, "function", name=OUTSIDE)
    counted = [
        node(operation, prop(property_of(name)), number(limit))
        for name, limits in learnt.ranges.items()
        for operation, limit in zip(("lt", "gt"), limits, strict=True)
    ]
    outside.append(node("sum", *counted))
    properties = {name: property_of(name) for name in signals}
    lags = {lag.text: lag_property(k) for k, lag in enumerate(learnt.model.lags)}
    for axis, texts in learnt.model.terms.items():
        element = SubElement(aerodynamics, "axis", name=_AXES[axis])
        names = learnt.model.parameter_names[learnt.model.axis_slice(axis)]
        for name, text in zip(names, texts, strict=True):
            value = learnt.value(name)
            if value == 0.0:
                continue
            product = node("product", _scale(), number(value))
            if axis in _ARMS:
                product.append(prop(_ARMS[axis]))
            if text != "1":
                product.append(function_of(text, properties, lags))
            function = SubElement(element, "function", name=f"aero/coefficient/{_property_name(learnt, name)}")
            _text(function, "description", _described(learnt, name))
            function.append(product)


def _property_name(learnt: LearntModel, name: str) -> str:
    """A name that the property tree of JSBSim takes: letters, digits, underscores; a number tells equal ones apart."""
    plain = ["".join(c if c.isalnum() or c == "_" else "_" for c in each) for each in learnt.model.parameter_names]
    k = learnt.model.parameter_names.index(name)
    return plain[k] if plain.count(plain[k]) == 1 else f"{plain[k]}_{k}"


def _described(learnt: LearntModel, name: str) -> str:
    p = learnt.parameters[learnt.model.parameter_names.index(name)]
    return f"{p.name} = {with_error(p.value, p.std, '+-')}, {p.status}"
