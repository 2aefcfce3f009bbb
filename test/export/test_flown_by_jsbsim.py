"""JSBSim flies the exported file: benchmarks/export.py in small."""

from __future__ import annotations

from dataclasses import replace

import export as benchmark
import numpy as np
import pytest
from models import with_terms

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.export.jsbsim import FOOT, OUTSIDE, export_jsbsim, lag_property, property_of
from aircraft_sysid_ros.export.learnt_model import LearntModel, Parameter
from aircraft_sysid_ros.export.level_flight import airspeeds_of, level_flight

pytest.importorskip("jsbsim")
#: Terms of every function and operator of expressions.
ODD_TERMS = {
    "CX": ["1", "alpha**2", "Tc", "exp(-V/20)", "sqrt(abs(alpha))"],
    "CY": ["beta", "sign(beta)*beta**2", "beta*alpha", "beta+alpha"],
    "CZ": ["1", "alpha", "max(alpha,0.05)", "min(de,0.0)", "alpha_dot"],
    "Cl": ["p", "da", "tanh(3*beta)", "sin(alpha)*r"],
    "Cm": ["1", "alpha", "q", "cos(alpha)/(1+alpha)"],
    "Cn": ["beta", "dr", "mach", "qbar/1000"],
}


def in_jsbsim(learnt):
    return benchmark.ExportedAeroplane(learnt, str(export_jsbsim(learnt).content))


@pytest.mark.long
def test_forces_and_moments_are_ours_and_as_far_from_the_held_out_flight(learnt, held_out):
    found = benchmark.held_out_states(in_jsbsim(learnt), held_out, 60)
    assert found["largest_difference"] < 1e-6
    for axis, nrmse in found["nrmse_model"].items():
        assert found["nrmse_jsbsim"][axis] == pytest.approx(nrmse, abs=2e-3), axis
        assert nrmse < 0.1, axis


@pytest.mark.long
def test_pieces_of_the_held_out_flight_are_flown_as_our_simulator_flies_them(learnt, held_out):
    found = benchmark.held_out_pieces(in_jsbsim(learnt), held_out)
    assert found["pieces"] > 3
    for output in benchmark.OUTPUTS:
        assert found["apart"][output] < 0.01, output  # another integrator, a round earth
        assert found["nrmse_jsbsim"][output] < found["nrmse_own"][output] + 0.01, output
        assert found["nrmse_jsbsim"][output] < 0.1, output


def test_jsbsim_stays_in_the_level_flight_that_the_file_states(learnt, held_out):
    level = level_flight(learnt, airspeeds_of(learnt)[0])
    exported = in_jsbsim(learnt)
    assert f"thrust {level.thrust:.2f} N" in str(export_jsbsim(learnt).content)
    names, e = learnt.model.signal_names, exported.executive
    beta = float(level.signals[names.index("beta")])
    flow = [np.cos(beta) * np.cos(level.alpha), np.sin(beta), np.cos(beta) * np.sin(level.alpha)]
    attitude = quaternion_from_euler(0.0, level.alpha, 0.0)
    still = replace(
        held_out[:1],
        position=np.zeros((1, 3)),
        quaternion=attitude[None],
        rates=np.zeros((1, 3)),
        air_velocity=level.airspeed * np.array([flow]),
        controls=np.array([[*level.surfaces, 0.0, 0.0, level.thrust, 0.0]]),
    )
    exported.put(still, 0)
    for _ in range(600):
        e.run()
    assert FOOT * e["velocities/vt-fps"] == pytest.approx(level.airspeed, abs=0.05)
    assert e["attitude/theta-rad"] == pytest.approx(level.alpha, abs=0.01)
    assert e["attitude/phi-rad"] == pytest.approx(0.0, abs=0.02)


def test_commands_go_the_way_of_jsbsims_own_aeroplanes(learnt, held_out):
    """Elevator nose down, aileron to the right, rudder nose left, as far as is asked for."""
    exported = benchmark.ExportedAeroplane(learnt, str(export_jsbsim(learnt, np.radians([25.0, 20.0, 30.0])).content))
    e = exported.executive
    ways = (("elevator", "m", -1, 25.0), ("aileron", "l", 1, 20.0), ("rudder", "n", -1, 30.0))
    for name, moment, way, degrees in ways:
        found = []
        for command in (0.0, 1.0):
            e[f"fcs/{name}-cmd-norm"] = command
            exported.coefficients(held_out, 100)
            position = "left-aileron" if name == "aileron" else name
            found.append((e[f"moments/{moment}-aero-lbsft"], e[f"fcs/{position}-pos-rad"]))
        (before, at_rest), (after, deflected) = found
        assert np.sign(after - before) == way, name
        assert abs(deflected - at_rest) == pytest.approx(np.radians(degrees)), name
        e[f"fcs/{name}-cmd-norm"] = 0.0


@pytest.mark.long
def test_every_kind_of_term_is_held_about_any_reference_point(learnt, held_out):
    odd = with_terms(learnt, ODD_TERMS, (0.03, 0.01, -0.02))
    exported = in_jsbsim(odd)
    for i in range(0, len(held_out), len(held_out) // 10):
        theirs, ours = exported.coefficients(held_out, i)
        assert theirs == pytest.approx(ours, abs=1e-9)
        assert np.abs(ours).min() > 1e-6


def test_a_term_that_is_undefined_counts_nothing_as_it_was_learnt(learnt, held_out):
    """A root of a negative number ended the export of level flight, and was no number in JSBSim."""
    rooted = {**ODD_TERMS, "CZ": ["1", "alpha", "sqrt(alpha-0.06)", "1+sqrt(beta)"]}
    odd = with_terms(learnt, {**rooted, "Cm": ["1", "alpha", "q", "de", "de/alpha"]})
    assert len(odd.flown.signals) == len(learnt.flown.signals)
    exported = in_jsbsim(odd)
    defined = set()
    for i in range(0, len(held_out), len(held_out) // 10):
        alpha, beta = held_out.alpha[i], held_out.beta[i]
        theirs, _ = exported.coefficients(held_out, i)
        root = odd.value("CZ_sqrt(alpha-0.06)") * np.sqrt(max(alpha - 0.06, 0.0))
        of_slip = odd.value("CZ_1+sqrt(beta)") * (1.0 + np.sqrt(beta) if beta >= 0.0 else 0.0)
        assert theirs[2] == pytest.approx(odd.value("CZ_0") + odd.value("CZ_alpha") * alpha + root + of_slip, abs=1e-6)
        defined |= {(bool(alpha > 0.06), bool(beta > 0.0))}
    assert len(defined) > 2


def test_flight_without_sideslip_is_flown_where_a_term_divides_by_it(learnt):
    """Every flight of JSBSim begins so: the moment was infinite, and from then on nothing was a number."""
    terms = {**learnt.model.terms, "Cn": [*learnt.model.terms["Cn"], "da/beta"]}
    aeroplane = in_jsbsim(with_terms(learnt, terms)).executive
    aeroplane["ic/h-sl-ft"], aeroplane["ic/u-fps"], aeroplane["ic/v-fps"] = 300.0, 60.0, 0.0
    aeroplane.run_ic()
    assert aeroplane["aero/beta-rad"] == 0.0
    for _ in range(10):
        assert np.isfinite(aeroplane["moments/n-aero-lbsft"])
        aeroplane.run()
    assert aeroplane["aero/beta-rad"] != 0.0


def test_a_lag_is_followed(learnt, held_out):
    exported = in_jsbsim(with_terms(learnt, {**ODD_TERMS, "Cm": ["1", "alpha", "q", "lag(de, 0.2)"]}))
    e = exported.executive
    exported.put(held_out, 0)
    e["sysid/elevator-rad"] = 0.0
    for _ in range(400):
        e.run()
    e["sysid/elevator-rad"] = 0.1
    steps = 40
    for _ in range(steps):
        e.run()
    assert e[lag_property(0)] == pytest.approx(0.1 * (1.0 - np.exp(-steps * benchmark.STEP / 0.2)), rel=0.05)


def test_a_limited_surface_moves_at_its_rate_and_no_further(learnt, held_out):
    exported = in_jsbsim(with_terms(learnt, {**ODD_TERMS, "Cm": ["1", "alpha", "q", "limited(de, 0.3)"]}))
    e, seen = exported.executive, []
    exported.put(held_out, 0)
    for command in (0.0, 0.1):
        e["sysid/elevator-rad"] = command
        for _ in range(400):
            e.run()
            seen.append(e[lag_property(0)])
    moved = np.diff(seen[399:])
    steps = round(0.1 / 0.3 / benchmark.STEP)
    np.testing.assert_allclose(moved[2 : steps - 2], 0.3 * benchmark.STEP, rtol=1e-6)
    assert seen[-1] == pytest.approx(0.1, abs=1e-12)


def test_it_counts_the_signals_that_are_outside_of_what_was_learnt(learnt, held_out):
    exported = in_jsbsim(learnt)
    low, high = learnt.ranges["alpha"]
    slow = int(np.argmin(np.abs(held_out.alpha - 0.5 * (low + high)) + np.abs(held_out.beta)))
    exported.coefficients(held_out, slow)
    assert exported.executive[OUTSIDE] == 0.0
    steep = replace(held_out, air_velocity=held_out.air_velocity + [0.0, 0.0, 8.0])
    exported.coefficients(steep, slow)
    assert exported.executive[property_of("alpha")] > high
    assert exported.executive[OUTSIDE] >= 1.0


def test_a_parameter_that_is_not_known_has_no_term(learnt, held_out):
    k = SIGNAL_INDEX["flaps"]
    rows = learnt.signals.copy()
    rows[:, k] = np.nan  # never measured
    terms = {axis: list(texts) for axis, texts in learnt.model.terms.items()}
    terms["CZ"].append("flaps")
    model = model_from_terms(terms)
    by_name = {p.name: p for p in learnt.parameters}
    listed = tuple(by_name.get(n, Parameter(n, np.nan, np.nan, "HOLD")) for n in model.parameter_names)
    with_flaps = LearntModel(replace(learnt.aircraft, model=model), "flaps", listed, rows, learnt.step)
    assert "CZ_flaps" not in str(export_jsbsim(with_flaps).content).split("aerodynamics>")[1]
    theirs, ours = in_jsbsim(with_flaps).coefficients(held_out, 100)
    assert theirs == pytest.approx(ours, abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("name", benchmark.AEROPLANES)
def test_aeroplanes_of_which_the_terms_are_not_the_truth(name):
    found = benchmark.judge(name, 60.0)
    assert found["states"]["largest_difference"] < 1e-6
    for output, own in found["pieces"]["nrmse_own"].items():
        assert found["pieces"]["nrmse_jsbsim"][output] < own + 0.01, output
    assert all("refused" in loop or loop["stable"] >= 99 for loop in found["gains"].values())
