"""The model as an SDF model with Gazebo's plugin Advanced Lift Drag.

Formula: ``AdvancedLiftDragPrivate::Update``, src/systems/advanced_lift_drag/AdvancedLiftDrag.cc of gazebosim/gz-sim at
033d64ce. That source sets ``Cem = Cemb * beta`` after it has added Cem0 and Cema * alpha: neither has an effect.
Static stability in pitch is therefore given by the point ``cp`` at which the plugin lets the forces act, and Cem0 and
Cema are 0: right with that source, and right where it is corrected. docs/export.md states the formula.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.export.ardupilot_sitl import LEAST_INDUCED
from aircraft_sysid_ros.export.exported import Exported, comment_of, header_lines, induced_drag_notes, number_lines
from aircraft_sysid_ros.export.learnt_model import (
    SURFACES,
    LearntModel,
    fitted,
    lost,
    not_held,
    stalled_lift,
    standard_errors,
    thrust_part,
)

Array = npt.NDArray[np.float64]

VERSIONS = ("gz-sim",)
_SIGNALS = ("alpha", "beta", "p", "q", "r", *SURFACES)
_SIDE = _SIGNALS
HELD = {
    "CX": ("1", "alpha", "alpha**2", *_SIGNALS[1:]), "CY": _SIDE, "CZ": ("1", *_SIGNALS),
    "Cl": _SIDE, "Cm": ("1", *_SIGNALS), "Cn": _SIDE,
}  # fmt: skip
#: ``M`` and ``alphaStall`` of the plugin, of which the first is not read from SDF.
_BLENDING, _STALL = 15.0, np.pi / 2.0
#: Share of the mass that each surface has in Gazebo, which does not take 0.
_OF_A_SURFACE = 1e-4
_JOINTS = {"de": "elevator_joint", "da": "aileron_joint", "dr": "rudder_joint"}
#: Prefix of the plugin's names by row of its coefficients: drag, side force, lift, roll, pitch, yaw.
_PREFIXES = ("CD", "CY", "CL", "Cell", "Cem", "Cen")
_ALWAYS_MISSING = (
    "thrust: the plugin has none, add a propeller of Gazebo's",
    "stall: none was learnt, alpha_stall is 90 deg; air of other densities than the flight's",
)


def export_gazebo(learnt: LearntModel, full: Array | None = None) -> Exported:
    """``full`` (3,) [rad]: how far elevator, aileron and rudder go; None: as far as they went in flight.

    Raises InputError without whole rows.
    """
    flown = learnt.flown
    values = coefficients(flown)
    misses = lost(flown, body_coefficients(values, flown, flown.signals) + thrust_part(flown))
    missing = (*not_held(learnt, HELD), *_ALWAYS_MISSING)
    elevator = values["Cem_ctrl_de"]
    shift = (
        f", for which the elevator stands {values['Cem0_dropped'] / elevator:+.2g} deg elsewhere" if elevator else ""
    )
    note = (
        "gz-sim at 033d64ce drops Cem0 and Cema: static stability in pitch is given by cp, which lies "
        f"{-values['cp_x']:.3g} m behind the centre of gravity, and a constant of C_m of {values['Cem0_dropped']:.2g} "
        f"is lost{shift}"
    )
    root = Element("sdf", version="1.9")
    notes = (note, *induced_drag_notes(values["eff"]))
    lines = [*header_lines(learnt, "gz-sim, Advanced Lift Drag", misses, missing), *notes]
    lines += number_lines(values, standard_errors(flown, coefficients))
    root.append(Comment(comment_of(lines)))
    model = SubElement(root, "model", name="".join(c if c.isalnum() else "_" for c in learnt.aircraft.name))
    _links(model, learnt, full)
    _plugin(model, values)
    indent(root)
    text = '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(root, encoding="unicode") + "\n"
    return Exported(text, misses, missing, notes)


def coefficients(flown: LearntModel) -> dict[str, float]:
    """All numbers of the plugin by its names, and ``cp_x`` [m, forward], by least squares over the rows."""
    aircraft = flown.aircraft
    lift_slope = flown.value("CZ_alpha")
    behind = aircraft.chord * flown.value("Cm_alpha") / lift_slope if lift_slope < 0.0 else 0.0
    values = {
        "area": aircraft.wing_area, "AR": aircraft.span**2 / aircraft.wing_area, "mac": aircraft.chord,
        "cp_x": -behind + float(aircraft.aerodynamic_reference[0]), "alpha_stall": _STALL, "Cem0": 0.0, "Cema": 0.0,
        "air_density": float(np.median(2.0 * flown.signal("qbar") / flown.signal("V") ** 2)),
    }  # fmt: skip
    ours = flown.coefficients - thrust_part(flown)
    flow = _Flow(flown, flown.signals, values["cp_x"])
    lift = ours[:, 0] * np.sin(flow.alpha) - ours[:, 2] * np.cos(flow.alpha)
    drag = -ours[:, 0] * np.cos(flow.alpha) - ours[:, 2] * np.sin(flow.alpha)
    moments = (ours @ flown.about_gravity.T)[:, 3:] - _moments_of_forces(flown, ours, values["cp_x"])
    of_symmetry = {"1", *flown.reads("CX", "CZ")}
    _put(values, "CL", fitted(flow.columns("1", "alpha", "beta"), lift, of_symmetry))
    wing = flow.columns("1", "beta") | {"wing": flow.square * flow.lift_without_rates(values) ** 2}
    found = fitted(wing, drag, of_symmetry - {"beta"} | {"wing"})
    _put(values, "CD", found)
    values["eff"] = 1.0 / (np.pi * values["AR"] * (found["wing"] or LEAST_INDUCED))
    forces = flown.reads("CX", "CY", "CZ") if flown.aircraft.aerodynamic_reference.any() else set()
    for prefix, axis, target in (("CY", "CY", ours[:, 1]), ("Cell", "Cl", moments[:, 0]), ("Cen", "Cn", moments[:, 2])):
        also = {"beta", *flown.reads("CY")} if prefix == "Cen" else set()  # the side force acts at cp
        reads = {"1", *flown.reads(axis), *forces, *also}
        found = fitted(flow.columns("1", "alpha", "beta"), target, reads)
        _put(values, prefix, {name: value for name, value in found.items() if name != "1"})  # it has no constant
    pitch = flow.columns("1", "beta")
    of_pitch = {"1", *flown.reads("Cm"), *of_symmetry, *forces} - {"alpha"}
    found = fitted(pitch, moments[:, 1], of_pitch)
    _put(values, "Cem", found)
    values["Cem0_dropped"] = found["1"]
    return values


class _Flow:
    """What the plugin works with on signal rows: the flow at ``cp``, as factors of ours at the centre of gravity.

    Signals that are not known are 0: no term of the model reads them.
    """

    def __init__(self, learnt: LearntModel, signals: Array, cp_x: float) -> None:
        names, aircraft = learnt.model.signal_names, learnt.aircraft
        flow = (signals[:, names.index(name)] for name in ("alpha", "beta", "p", "q", "r"))
        alpha, beta, p, q, r = map(np.nan_to_num, flow)
        pitch, yaw = q / aircraft.chord, 2.0 * r / aircraft.span  # rates over V [1/m]
        u = np.cos(beta) * np.cos(alpha)  # velocity over V at cp
        v = np.sin(beta) + yaw * cp_x
        w = np.cos(beta) * np.sin(alpha) - pitch * cp_x
        plane = np.hypot(u, w)
        self.alpha, self.beta = np.arctan2(w, u), np.arctan2(v, u)
        self.square = plane**2  # dynamic pressure in the plane of symmetry over ours
        self.rates = [plane * p, plane * 0.5 * q, plane * r]
        self.surfaces = [np.degrees(np.nan_to_num(signals[:, names.index(name)])) for name in SURFACES]

    def columns(self, *static: str) -> dict[str, Array]:
        """What numbers of the plugin are multiplied with, by signal: those of ``static``, surfaces [deg] and rates."""
        found = {"1": np.ones_like(self.alpha), "alpha": self.alpha, "beta": self.beta}
        found |= dict(zip(SURFACES, self.surfaces, strict=True))
        multiplied = {name: self.square * found[name] for name in (*static, *SURFACES)}
        return multiplied | dict(zip("pqr", self.rates, strict=True))

    def lift_without_rates(self, c: Mapping[str, float]) -> Array:
        """The plugin's C_L that its drag is induced by."""
        linear = c["CL0"] + c["CLa"] * self.alpha
        lift = stalled_lift(linear, self.alpha, c["alpha_stall"], _BLENDING) + c["CLb"] * self.beta
        return np.asarray(lift + sum(c[f"CL_ctrl_{s}"] * d for s, d in zip(SURFACES, self.surfaces, strict=True)))


_NAMES = {"1": "{}0", "alpha": "{}a", "beta": "{}b", **{s: f"{{}}_ctrl_{s}" for s in SURFACES}}
_NAMES |= {rate: f"{{}}{rate}" for rate in "pqr"}


def _put(values: dict[str, float], prefix: str, found: Mapping[str, float]) -> None:
    """Enter the numbers of one coefficient by the plugin's names; Cem0, which has no effect, stays as it is."""
    for name, value in found.items():
        if name in _NAMES and (prefix, name) != ("Cem", "1"):
            values[_NAMES[name].format(prefix)] = value


def _moments_of_forces(learnt: LearntModel, forces: Array, cp_x: float) -> Array:
    """Moment coefficients (n, 3) of the forces at cp about the origin of the link, the centre of gravity."""
    place = np.broadcast_to([cp_x, 0.0, 0.0], forces[:, :3].shape)
    return np.asarray(np.cross(place, forces[:, :3]) / learnt.arms)


def body_coefficients(c: Mapping[str, float], learnt: LearntModel, signals: Array) -> Array:
    """C_X … C_n (n, 6) about our reference point that the plugin's formula gives on rows, in the flight's air."""
    flow = _Flow(learnt, signals, c["cp_x"])
    wing = flow.lift_without_rates(c)

    def of(prefix: str, static: Array) -> Array:
        controlled = sum(c[f"{prefix}_ctrl_{s}"] * d for s, d in zip(SURFACES, flow.surfaces, strict=True))
        of_rates = sum(c[prefix + rate] * column for rate, column in zip("pqr", flow.rates, strict=True))
        return np.asarray(flow.square * (static + controlled) + of_rates)

    alpha, beta = flow.alpha, flow.beta
    lift = flow.square * wing + sum(c[f"CL{rate}"] * column for rate, column in zip("pqr", flow.rates, strict=True))
    drag = of("CD", c["CD0"] + wing**2 / (np.pi * c["AR"] * c["eff"]))
    forces = np.stack(
        [
            -drag * np.cos(alpha) + lift * np.sin(alpha),
            of("CY", c["CYa"] * alpha + c["CYb"] * beta),
            -drag * np.sin(alpha) - lift * np.cos(alpha),
        ],
        axis=1,
    )
    moments = np.stack(
        [
            of("Cell", c["Cella"] * alpha + c["Cellb"] * beta),
            of("Cem", c["Cemb"] * beta),  # Cem0 and Cema are dropped
            of("Cen", c["Cena"] * alpha + c["Cenb"] * beta),
        ],
        axis=1,
    )
    about_origin = moments + _moments_of_forces(learnt, forces, c["cp_x"])
    return np.asarray(np.linalg.solve(learnt.about_gravity, np.hstack([forces, about_origin]).T).T)


def _text(parent: Element, tag: str, value: object) -> None:
    SubElement(parent, tag).text = repr(float(value)) if isinstance(value, float) else str(value)


def _links(model: Element, learnt: LearntModel, full: Array | None) -> None:
    """The aeroplane about its centre of gravity, in Gazebo's FLU, and a joint for each surface."""
    link = SubElement(model, "link", name="base_link")
    inertial = SubElement(link, "inertial")
    small_mass = _OF_A_SURFACE * float(learnt.aircraft.mass)
    _text(inertial, "mass", float(learnt.aircraft.mass) - len(_JOINTS) * small_mass)
    inertia, body = SubElement(inertial, "inertia"), learnt.aircraft.inertia
    for tag, value in (("ixx", body[0, 0]), ("iyy", body[1, 1]), ("izz", body[2, 2]), ("ixz", -body[0, 2])):
        _text(inertia, tag, float(value) + 0.0)
    for tag in ("ixy", "iyz"):
        _text(inertia, tag, 0.0)
    for k, (name, joint) in enumerate(_JOINTS.items()):
        surface = joint.removesuffix("_joint")
        small = SubElement(SubElement(model, "link", name=surface), "inertial")
        _text(small, "mass", small_mass)
        of_surface = SubElement(small, "inertia")
        for tag in ("ixx", "iyy", "izz"):
            _text(of_surface, tag, small_mass * float(learnt.aircraft.chord) ** 2)
        element = SubElement(model, "joint", {"name": joint, "type": "revolute"})
        _text(element, "parent", "base_link")
        _text(element, "child", surface)
        axis = SubElement(element, "axis")
        _text(axis, "xyz", {"de": "0 1 0", "da": "0 1 0", "dr": "0 0 1"}[name])
        flown = max(map(abs, learnt.ranges.get(name, (0.0, 0.0))))
        limit, reached = SubElement(axis, "limit"), flown if full is None else float(full[k])
        _text(limit, "lower", -reached)
        _text(limit, "upper", reached)


def _plugin(model: Element, c: Mapping[str, float]) -> None:
    attributes = {"filename": "gz-sim-advanced-lift-drag-system", "name": "gz::sim::systems::AdvancedLiftDrag"}
    plugin = SubElement(model, "plugin", attributes)
    for tag, text in (
        ("link_name", "base_link"),
        ("forward", "1 0 0"),
        ("upward", "0 0 1"),
        ("cp", f"{c['cp_x']!r} 0 0"),
    ):
        _text(plugin, tag, text)
    for name in ("air_density", "area", "AR", "eff", "mac", "alpha_stall", "CL0", "CD0", "Cem0", "Cema"):
        _text(plugin, name, c[name])
    for name in ("CLa", "CYa", "Cella", "Cena", *(prefix + "b" for prefix in _PREFIXES[1:])):
        _text(plugin, name, c[name])
    for prefix in _PREFIXES:
        for rate in "pqr":
            _text(plugin, prefix + rate, c[prefix + rate])
    _text(plugin, "num_ctrl_surfaces", len(_JOINTS))
    for surface, joint in _JOINTS.items():
        element = SubElement(plugin, "control_surface")
        _text(element, "name", joint)
        _text(element, "direction", 1.0)
        for prefix in _PREFIXES:
            _text(element, f"{prefix}_ctrl", c[f"{prefix}_ctrl_{surface}"])
