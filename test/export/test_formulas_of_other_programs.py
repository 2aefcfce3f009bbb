"""Files for other simulators, read back and put into those programs' formulas as docs/export.md states them.

The formulas stand here once more, in forces [N] and moments [N m], point by point and without the package's own.
"""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from models import with_terms

from aircraft_sysid_ros.export import px4
from aircraft_sysid_ros.export.ardupilot_sitl import export_ardupilot_sitl
from aircraft_sysid_ros.export.gains import _trims
from aircraft_sysid_ros.export.gazebo import export_gazebo
from aircraft_sysid_ros.export.px4 import PULL_REQUEST, export_px4
from aircraft_sysid_ros.export.targets import reached

FULL = np.radians([25.0, 20.0, 30.0])
#: Deflections at inputs of 1 in SITL, which make positive moments there; those of this aeroplane make negative ones.
INPUT = -FULL
AIRSPEED, DENSITY = 17.0, 1.18


@pytest.fixture(scope="module")
def for_sitl(learnt):
    """For surfaces that go as far as FULL."""
    return export_ardupilot_sitl(learnt, FULL)


@pytest.fixture(scope="module")
def for_gazebo(learnt):
    return export_gazebo(learnt)


def grid(learnt):
    """Flows and surfaces inside of the range in which the model was learnt, at its edges and in the middle."""
    at = {name: np.linspace(*learnt.ranges[name], 3) for name in ("alpha", "beta", "p", "q", "r", "de", "da", "dr")}
    rates = list(zip(at["p"], at["q"], at["r"], strict=True))
    surfaces = list(zip(at["de"], at["da"][::-1], at["dr"], strict=True))
    for alpha, beta, (p, q, r), (de, da, dr) in itertools.product(at["alpha"], at["beta"], rates, surfaces):
        yield {"alpha": alpha, "beta": beta, "p": p, "q": q, "r": r, "de": de, "da": da, "dr": dr}


def ours(learnt, point):
    """Coefficients (6,) of the model at a point, without thrust."""
    qbar = 0.5 * DENSITY * AIRSPEED**2
    signals = {**{k: np.array([v]) for k, v in point.items()}, "Tc": np.zeros(1), "V": np.array([AIRSPEED])}
    values = dict(zip(learnt.model.parameter_names, learnt.values.tolist(), strict=True))
    return learnt.model.coefficients(values, {**signals, "qbar": np.array([qbar])})[0]


def accelerations(learnt, coefficients):
    """Of the aeroplane itself (6,): forces over mass, and moments about the centre of gravity over inertia."""
    a, qs = learnt.aircraft, 0.5 * DENSITY * AIRSPEED**2 * learnt.aircraft.wing_area
    force = qs * coefficients[:3]
    moment = qs * coefficients[3:] * [a.span, a.chord, a.span] + np.cross(a.aerodynamic_reference, force)
    return np.concatenate([force / a.mass, np.linalg.solve(a.inertia, moment)])


def spread_of_accelerations(learnt):
    """Of the rows that it was learnt from."""
    return np.std([accelerations(learnt, c) for c in learnt.flown.coefficients], axis=0)


# -- ArduPlane SITL ----------------------------------------------------------------------------------------------


def read_sitl(text):
    """The JSON as the program reads it: lines that begin with # are comments."""
    return json.loads("\n".join(line for line in text.splitlines() if not line.lstrip().startswith("#")))


def sitl(c, point, full):
    """Accelerations (6,) of SITL's plane of 2 kg and 1 kg m^2."""
    b, chord, s, v = c["b"], c["c"], c["s"], AIRSPEED
    alpha = point["alpha"]
    beta = math.atan2(math.sin(point["beta"]), math.cos(point["beta"]) * math.cos(alpha))
    p, q, r = 2.0 * v * point["p"] / b, v * point["q"] / chord, 2.0 * v * point["r"] / b
    elevator, aileron, rudder = (point[n] / f for n, f in zip(("de", "da", "dr"), full, strict=True))
    stall, m = c["alpha_stall"], c["mcoeff"]
    held = min(max(alpha, stall - 0.8), stall + 0.8)
    e1, e2 = math.exp(-m * (held - stall)), math.exp(m * (held + stall))
    sigmoid = (1 + e1 + e2) / (1 + e1) / (1 + e2)
    plate = 2 * math.copysign(1, held) * math.sin(held) ** 2 * math.cos(held)
    lift = (1 - sigmoid) * (c["c_lift_0"] + c["c_lift_a"] * held) + sigmoid * plate
    drag = c["c_drag_p"] + (c["c_lift_0"] + c["c_lift_a"] * alpha) ** 2 / (math.pi * c["oswald"] * b * b / s)
    cos, sin = math.cos(alpha), math.sin(alpha)
    by_q = chord * q / (2 * v)
    qs = 0.5 * DENSITY * v * v * s
    x = qs * (
        -drag * cos + lift * sin + (-c["c_drag_q"] * cos + c["c_lift_q"] * sin) * by_q
        - c["c_drag_deltae"] * cos * abs(elevator) + c["c_lift_deltae"] * sin * elevator
    )  # fmt: skip
    z = qs * (
        -drag * sin - lift * cos + (-c["c_drag_q"] * sin - c["c_lift_q"] * cos) * by_q
        - c["c_drag_deltae"] * sin * abs(elevator) - c["c_lift_deltae"] * cos * elevator
    )  # fmt: skip

    def side(prefix):
        return (
            c[f"{prefix}_0"] + c[f"{prefix}_b"] * beta + c[f"{prefix}_p"] * b * p / (2 * v)
            + c[f"{prefix}_r"] * b * r / (2 * v) + c[f"{prefix}_deltaa"] * aileron + c[f"{prefix}_deltar"] * rudder
        )  # fmt: skip

    pitch = c["c_m_0"] + c["c_m_a"] * alpha + c["c_m_q"] * by_q + c["c_m_deltae"] * elevator
    assert c["CGOffset"] == [0.0, 0.0, 0.0]
    force = np.array([x, qs * side("c_y"), z])
    return np.concatenate([force / 2.0, [qs * b * side("c_l"), qs * chord * pitch, qs * b * side("c_n")]])


@pytest.mark.long
def test_sitl_accelerates_as_the_aeroplane_does(learnt, for_sitl):
    exported = for_sitl
    c, spread = read_sitl(exported.content), spread_of_accelerations(learnt)
    errors = [sitl(c, point, INPUT) - accelerations(learnt, ours(learnt, point)) for point in grid(learnt)]
    assert np.max(np.abs(errors), axis=0) == pytest.approx(0.0, abs=0.15 * spread.max()), "nowhere far off"
    rms = np.sqrt(np.mean(np.square(errors), axis=0)) / spread
    assert rms[1:] == pytest.approx(0.0, abs=0.02)
    assert rms[0] < 0.3  # drag by elevator is |de| there; the flight was in no corner of this grid
    assert max(exported.lost.values()) < 0.05


def test_full_input_of_sitl_is_nose_up_right_wing_down_and_nose_right(for_sitl):
    c = read_sitl(for_sitl.content)
    assert c["c_m_deltae"] > 0.0 and c["c_l_deltaa"] > 0.0 and c["c_n_deltar"] > 0.0
    assert [c["deltae_max"], c["deltaa_max"], c["deltar_max"]] == pytest.approx(FULL)
    assert "full input is elevator -25.0, aileron -20.0, rudder -30.0 deg" in for_sitl.content


def test_what_sitl_loses_is_what_its_formula_misses_on_the_flight(learnt, for_sitl):
    exported = for_sitl
    c, flown = read_sitl(exported.content), learnt.flown
    names = learnt.model.signal_names
    errors = []
    for row in flown.signals[::10]:
        point = {name: float(row[names.index(name)]) for name in ("alpha", "beta", "p", "q", "r", "de", "da", "dr")}
        a, qs = learnt.aircraft, 0.5 * DENSITY * AIRSPEED**2 * learnt.aircraft.wing_area
        missed = sitl(c, point, INPUT) - accelerations(learnt, ours(learnt, point))
        force, moment = a.mass * missed[:3], a.inertia @ missed[3:]
        errors.append(np.concatenate([force, moment / [a.span, a.chord, a.span]]) / qs)
    nrmse = np.sqrt(np.mean(np.square(errors), axis=0)) / np.std(flown.coefficients, axis=0)
    assert nrmse == pytest.approx(list(exported.lost.values()), rel=0.3, abs=1e-4)


def test_sitl_gets_the_accelerations_of_an_aeroplane_about_another_reference_point(learnt):
    moved = replace(learnt, aircraft=replace(learnt.aircraft, aerodynamic_reference=np.array([0.02, 0.0, -0.01])))
    exported = export_ardupilot_sitl(moved, FULL)
    c, spread = read_sitl(exported.content), spread_of_accelerations(moved)
    errors = [sitl(c, point, INPUT) - accelerations(moved, ours(moved, point)) for point in grid(moved)]
    rms = np.sqrt(np.mean(np.square(errors), axis=0)) / spread
    assert rms[1:] == pytest.approx(0.0, abs=0.05)


# -- Gazebo ------------------------------------------------------------------------------------------------------


def read_sdf(text):
    """Numbers of the plugin by name, its surfaces by joint, and the mass and inertia of the link."""
    root = ElementTree.fromstring(text.encode())
    plugin = root.find("model/plugin")
    c = {e.tag: float(e.text) for e in plugin if len(e) == 0 and e.tag not in ("link_name", "forward", "upward", "cp")}
    c["cp"] = [float(x) for x in plugin.find("cp").text.split()]
    surfaces = {
        e.find("name").text: {child.tag: float(child.text) for child in e if child.tag != "name"}
        for e in plugin.findall("control_surface")
    }
    return c, surfaces, root


def gazebo(c, surfaces, point):
    """Force [N] and moment [N m] about the link's origin (6,), FRD, in air of the plugin's density."""
    v, rho, area, mac = AIRSPEED, c["air_density"], c["area"], c["mac"]
    span = math.sqrt(area * c["AR"])
    alpha, beta = point["alpha"], point["beta"]
    omega = np.array([2 * v * point["p"] / span, v * point["q"] / mac, 2 * v * point["r"] / span])
    velocity = v * np.array([math.cos(beta) * math.cos(alpha), math.sin(beta), math.cos(beta) * math.sin(alpha)])
    cp = np.array([c["cp"][0], -c["cp"][1], -c["cp"][2]])  # FLU to FRD
    air = velocity + np.cross(omega, cp)
    plane = math.hypot(air[0], air[2])
    alpha, beta = math.atan2(air[2], air[0]), math.atan2(air[1], air[0])
    pressure, half = 0.5 * rho * plane**2, 0.5 * rho * plane
    hats = (omega[0] * span / 2, omega[1] * mac / 2, omega[2] * span / 2)
    deflections = {
        "elevator_joint": math.degrees(point["de"]),
        "aileron_joint": math.degrees(point["da"]),
        "rudder_joint": math.degrees(point["dr"]),
    }

    def control(name):
        return sum(
            d * surfaces[joint][f"{name}_ctrl"] * surfaces[joint]["direction"] for joint, d in deflections.items()
        )

    def by_rates(name):
        return half * sum(c[name + letter] * hat for letter, hat in zip("pqr", hats, strict=True))

    stall, m = c["alpha_stall"], 15.0
    e1, e2 = math.exp(-m * (alpha - stall)), math.exp(m * (alpha + stall))
    sigma = (1 + e1 + e2) / ((1 + e1) * (1 + e2))
    plate = 2 * math.copysign(1, alpha) * math.sin(alpha) ** 2 * math.cos(alpha)
    cl = (1 - sigma) * (c["CL0"] + c["CLa"] * alpha) + sigma * plate + c["CLb"] * beta + control("CL")
    lift = area * (cl * pressure + by_rates("CL"))
    flat = 2 / (1 + math.exp(-0.224 - 0.115 * max(c["AR"], 1 / c["AR"])))
    cd = (1 - sigma) * (c["CD0"] + cl * cl / (math.pi * c["AR"] * c["eff"]))
    cd += sigma * abs(flat * (0.5 - 0.5 * math.cos(2 * alpha))) + control("CD")
    drag = area * (cd * pressure + by_rates("CD"))
    side = area * ((c["CYa"] * alpha + c["CYb"] * beta + control("CY")) * pressure + by_rates("CY"))
    roll = area * span * ((c["Cella"] * alpha + c["Cellb"] * beta + control("Cell")) * pressure + by_rates("Cell"))
    pitch = area * mac * ((c["Cemb"] * beta + control("Cem")) * pressure + by_rates("Cem"))  # Cem0, Cema: dropped
    yaw = area * span * ((c["Cena"] * alpha + c["Cenb"] * beta + control("Cen")) * pressure + by_rates("Cen"))
    force = np.array(
        [-drag * math.cos(alpha) + lift * math.sin(alpha), side, -drag * math.sin(alpha) - lift * math.cos(alpha)]
    )
    return np.concatenate([force, np.array([roll, pitch, yaw]) + np.cross(cp, force)])


def test_gazebo_makes_the_forces_and_moments_but_for_constants_that_it_has_none_for(learnt, for_gazebo):
    exported = for_gazebo
    c, surfaces, root = read_sdf(exported.content)
    a, qs = learnt.aircraft, 0.5 * c["air_density"] * AIRSPEED**2 * learnt.aircraft.wing_area
    scale = qs * np.array([1.0, 1.0, 1.0, a.span, a.chord, a.span])
    errors = np.array([gazebo(c, surfaces, point) / scale - ours(learnt, point) for point in grid(learnt)])
    spread = np.std(learnt.flown.coefficients, axis=0)
    without_constant = np.std(errors, axis=0) / spread
    assert without_constant[0] < 0.3 and without_constant[1:] == pytest.approx(0.0, abs=0.1)
    lost = np.sqrt(np.mean(errors**2, axis=0)) / spread
    assert lost[1:] == pytest.approx(list(exported.lost.values())[1:], rel=0.3, abs=0.05)
    inertial = {
        e.tag: float(e.text) for e in root.iter() if e.tag in ("ixx", "iyy", "izz", "ixz") and float(e.text) > 1e-3
    }
    assert inertial == {"ixx": a.inertia[0, 0], "iyy": a.inertia[1, 1], "izz": a.inertia[2, 2], "ixz": -a.inertia[0, 2]}


def test_gazebos_pitch_stiffness_is_there_although_the_plugin_drops_it(learnt, for_gazebo):
    c, surfaces, _ = read_sdf(for_gazebo.content)
    still = {"alpha": 0.0, "beta": 0.0, "p": 0.0, "q": 0.0, "r": 0.0, "de": 0.0, "da": 0.0, "dr": 0.0}
    moments = [gazebo(c, surfaces, {**still, "alpha": alpha})[4] for alpha in (0.03, 0.08)]
    qsc = 0.5 * c["air_density"] * AIRSPEED**2 * c["area"] * c["mac"]
    assert np.diff(moments)[0] / 0.05 / qsc == pytest.approx(learnt.value("Cm_alpha"), rel=0.05)
    assert c["Cem0"] == c["Cema"] == 0.0  # a version without the fault shall not add them


# -- what cannot be held -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", ["sitl", "gazebo"])
def test_a_cross_term_is_named_with_what_is_lost(learnt, for_sitl, for_gazebo, target):
    terms = {axis: list(texts) for axis, texts in learnt.model.terms.items()}
    terms["Cl"].append("alpha*beta")
    crossed = with_terms(learnt, terms)
    values = [learnt.value(p.name) if p.name in learnt.model.parameter_names else -2.0 for p in crossed.parameters]
    crossed = crossed.with_values(np.array(values))
    of_crossed = export_ardupilot_sitl(crossed, FULL) if target == "sitl" else export_gazebo(crossed)
    exported, before = of_crossed, for_sitl if target == "sitl" else for_gazebo
    (said,) = [s for s in exported.not_held if "alpha*beta" in s]
    assert said.startswith("Cl") and "%" in said
    assert exported.lost["Cl"] > before.lost["Cl"] + 0.05
    assert exported.lost["CZ"] == pytest.approx(before.lost["CZ"], abs=1e-6)


# -- PX4 ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("write", [lambda model: export_ardupilot_sitl(model, FULL), export_gazebo])
def test_an_induced_drag_that_no_wing_has_is_said(learnt, write):
    """An oswald of -0.11 was written without a word: of lift that pushes forward."""
    assert not any("lift lowers drag" in note for note in write(learnt).notes)
    values = dict(zip(learnt.model.parameter_names, learnt.values.tolist(), strict=True))
    pushed = {**values, "CX_alpha2": values["CX_alpha2"] + 12.0}
    parameters = [replace(p, value=pushed.get(p.name, p.value)) for p in learnt.parameters]
    wrong = write(replace(learnt, parameters=tuple(parameters)))
    assert any("lift lowers drag" in note for note in wrong.notes) and "lift lowers drag" in wrong.content


@pytest.fixture(scope="module")
def with_trims(learnt):
    """For surfaces whose travel is known."""
    return export_px4(learnt, FULL)


@pytest.fixture(scope="module")
def of_pull_request(learnt):
    """For surfaces whose travel is not."""
    return export_px4(learnt, None, PULL_REQUEST)


def read_params(text):
    """A parameter file of QGroundControl."""
    rows = [line.split("\t") for line in text.splitlines() if line and not line.startswith("#")]
    assert all(row[:2] == ["1", "1"] and row[4] == "9" for row in rows)
    return {row[2]: float(row[3]) for row in rows}


@pytest.mark.long
def test_px4s_trims_hold_level_flight(learnt, with_trims):
    """At trim, and at both ends of the airspeeds, the command that PX4 adds leaves no moment."""
    p = read_params(with_trims.content)
    assert p["FW_AIRSPD_STALL"] <= p["FW_AIRSPD_MIN"] < p["FW_AIRSPD_TRIM"] < p["FW_AIRSPD_MAX"]
    density = float(np.median(2.0 * learnt.signal("qbar") / learnt.signal("V") ** 2))
    assert density == pytest.approx(DENSITY, abs=0.02)
    hold_level_flight(learnt, p)


def test_px4s_trims_are_of_its_lowest_airspeed_where_that_is_not_the_slowest_that_was_flown(learnt):
    """They had been those of an airspeed at which the lift that was flown does not carry the weight."""
    heavy = replace(learnt, aircraft=replace(learnt.aircraft, mass=1.8 * learnt.aircraft.mass))
    slowest = float(learnt.signal("V").min()) * np.sqrt(DENSITY / 1.225)
    p = {entry.name: entry.value for entry in px4._entries(heavy, FULL)}
    assert p["FW_AIRSPD_STALL"] == pytest.approx(p["FW_AIRSPD_MIN"]) and p["FW_AIRSPD_MIN"] > 1.02 * slowest
    hold_level_flight(heavy, p)
    trims = _trims(heavy, FULL)  # of gains
    assert trims["FW_DTRIM_P_VMIN"] == p["FW_DTRIM_P_VMIN"]
    assert any("0.9 of FW_AIRSPD_MIN" in note for note in export_px4(heavy, None).notes)


def hold_level_flight(learnt, p):
    """Parameters of PX4 by name leave no moment at trim and at both ends of the airspeeds."""
    signs = np.sign([learnt.value("Cm_de"), learnt.value("Cl_da"), learnt.value("Cn_dr")])
    for end, speed in (("", "TRIM"), ("VMIN", "MIN"), ("VMAX", "MAX")):
        command = np.array(
            [p[f"TRIM_{n}"] + (p[f"FW_DTRIM_{n[0]}_{end}"] if end else 0.0) for n in ("PITCH", "ROLL", "YAW")]
        )
        de, da, dr = signs * command * FULL
        pressure = 0.5 * 1.225 * p[f"FW_AIRSPD_{speed}"] ** 2  # calibrated
        weight = learnt.aircraft.mass * 9.80665 / (pressure * learnt.aircraft.wing_area)
        alpha, beta = (weight_angle(learnt, weight, de), side_angle(learnt, da, dr))
        point = {"alpha": alpha, "beta": beta, "p": 0.0, "q": 0.0, "r": 0.0, "de": de, "da": da, "dr": dr}
        assert ours(learnt, point)[3:] == pytest.approx(0.0, abs=3e-5)
        if not end:
            assert p["FW_PSP_OFF"] == pytest.approx(np.degrees(alpha), abs=0.02)


def weight_angle(learnt, weight, de):
    """Angle of attack at which lift carries the weight."""
    alpha = 0.05
    for _ in range(20):
        alpha = (-weight * np.cos(alpha) - learnt.value("CZ_0") - learnt.value("CZ_de") * de) / learnt.value("CZ_alpha")
    return alpha


def side_angle(learnt, da, dr):
    """Sideslip without side force."""
    moved = learnt.value("CY_da") * da + learnt.value("CY_dr") * dr
    return -(learnt.value("CY_0") + moved) / learnt.value("CY_beta")


@pytest.mark.long
def test_coefficients_of_the_pull_request_say_the_flow_from_the_forces(learnt, with_trims, of_pull_request):
    """v = -F_y V / (q S B1), as its source has it; alpha = (C_L - A0) / A1, as its parameters are described."""
    released = read_params(with_trims.content)
    assert not any(name.startswith("FW_W_") for name in released), "of no release"
    p = read_params(of_pull_request.content)
    assert p["FW_W_MASS"] == pytest.approx(learnt.aircraft.mass)
    flown = learnt.flown
    c, alpha, beta = flown.coefficients, flown.signal("alpha"), flown.signal("beta")
    force_y = 0.5 * DENSITY * AIRSPEED**2 * p["FW_W_AREA"] * c[:, 1]
    v = -force_y * AIRSPEED / (0.5 * DENSITY * AIRSPEED**2 * p["FW_W_AREA"] * p["FW_W_C_B1"])
    assert np.std(v / AIRSPEED - np.sin(beta)) < 0.25 * np.std(beta)
    thrust = learnt.value("CX_Tc") * flown.signal("Tc")
    lift = (c[:, 0] - thrust) * np.sin(alpha) - c[:, 2] * np.cos(alpha)
    assert np.std((lift - p["FW_W_C_A0"]) / p["FW_W_C_A1"] - alpha) < 0.06 * np.std(alpha)


@pytest.mark.long
def test_without_the_travel_of_the_surfaces_px4_gets_no_trims(learnt, of_pull_request):
    assert not any("TRIM_" in name for name in read_params(of_pull_request.content))
    assert any("--full-deflection" in note for note in of_pull_request.notes)
    assert reached(learnt) == pytest.approx([max(map(abs, learnt.ranges[n])) for n in ("de", "da", "dr")])


@pytest.mark.long
def test_numbers_of_files_carry_standard_errors_and_the_range(learnt, for_sitl, for_gazebo, with_trims):
    for text in (for_sitl.content, for_gazebo.content, with_trims.content):
        assert "OUTSIDE OF IT THE MODEL IS NOT KNOWN TO HOLD" in text
        assert f"alpha: {learnt.ranges['alpha'][0]:.4g} to {learnt.ranges['alpha'][1]:.4g} rad" in text
        assert "CZ_alpha = " in text and " USE" in text
    slope = learnt.parameters[learnt.model.parameter_names.index("CZ_alpha")]
    (line,) = [x for x in for_sitl.content.splitlines() if "c_lift_a =" in x]
    value, std = (float(x) for x in line.split("=")[1].split("+-"))
    assert std / value == pytest.approx(slope.std / abs(slope.value), rel=0.5)
