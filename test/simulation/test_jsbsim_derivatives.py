"""Derivatives of JSBSim aeroplanes: those of their own files, and those that the chain finds from sensors."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms, textbook_model
from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.simulation.jsbsim_derivatives import (
    VARIABLES,
    WindTunnel,
    derived_truth,
    flight_projection,
)
from aircraft_sysid_ros.simulation.jsbsim_flight import MODELS, jsbsim_aircraft_file, signals_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_jsbsim_samples
from aircraft_sysid_ros.simulation.truth_files import load_truth, write_flight

jsbsim = pytest.importorskip("jsbsim")

STEPS = {"alpha": 0.01, "beta": 0.02, "p": 0.01, "q": 0.003, "r": 0.01, "de": 0.02, "da": 0.02, "dr": 0.02,
         "Tc": 0.01}  # fmt: skip
#: Derivatives that are one number in the file of the aeroplane (or a table that is a straight line), which is
#: typed here from the file. JSBSim multiplies pitch rates by c/2V, we by c/V: half the number.
IN_THE_FILE = {
    "c172p": {
        ("CY", "dr"): 0.187, ("Cl", "beta"): -0.0322 / 0.349, ("Cl", "p"): -0.484, ("Cl", "da"): 0.229,
        ("Cl", "dr"): 0.0147, ("Cm", "alpha"): -1.8, ("Cm", "q"): -12.4 / 2, ("Cm", "alpha_dot"): -7.27 / 2,
        ("Cn", "beta"): 0.0205 / 0.349, ("Cn", "p"): -0.0278, ("Cn", "r"): -0.0937, ("Cn", "da"): -0.0053,
    },
    "J3Cub": {
        ("CY", "r"): 0.1423, ("CY", "dr"): 0.0934, ("Cl", "p"): -0.525, ("Cl", "da"): 0.3498,
        ("Cl", "dr"): 0.0133, ("Cm", "q"): -12.7022 / 2, ("Cm", "alpha_dot"): -7.5904 / 2,
        ("Cn", "beta"): 0.0602, ("Cn", "r"): -0.081,
    },
    "c182": {
        ("CY", "dr"): 0.187, ("Cl", "da"): 0.15, ("Cl", "dr"): -0.0147, ("Cm", "q"): -12.4 / 2,
    },
}  # fmt: skip
#: How near to (b) the estimates of one noisy flight come, over (b). The damping of pitch is the hardest: alpha_dot,
#: which no term of the textbook holds, moves almost as q does.
TOLERANCE = {
    "CX_Tc": 0.10, "CY_beta": 0.06, "CZ_alpha": 0.03, "Cl_p": 0.08, "Cl_da": 0.08, "Cm_alpha": 0.08, "Cm_q": 0.25,
    "Cm_de": 0.15, "Cn_beta": 0.03, "Cn_r": 0.06, "Cn_dr": 0.04,
}  # fmt: skip


@cache
def fly(name):
    return simulate_jsbsim_samples(name, seed=3, duration=120.0)


@pytest.fixture(scope="module", params=["c172p", pytest.param("J3Cub", marks=pytest.mark.long)])
def found(request):
    """A flight, the parameters that the chain finds from its sensors, and the truth."""
    flight = fly(request.param)
    pipeline = Pipeline(flight.aircraft)
    pipeline.push(flight.samples)
    pipeline.flush()
    parameters = {p.name: p for p in pipeline.parameters.snapshot().parameters}
    return flight, parameters, derived_truth(request.param, flight.aircraft, flight.truth)


@pytest.mark.parametrize("name", MODELS)
def test_slopes_are_the_constants_of_the_aeroplanes_own_file(name):
    slopes = WindTunnel(name).slopes(STEPS)
    for (axis, variable), value in IN_THE_FILE[name].items():
        assert slopes.slope(axis, variable) == pytest.approx(value, rel=0.01), (axis, variable)


def test_slopes_in_body_axes_follow_from_lift_and_drag():
    """C_Z,alpha = -(C_L,alpha + C_D) at a small alpha, C_Z,q = -C_Lq/2, C_Z,de = -C_L,de, C_Y,beta = C_Yb - C_D."""
    slopes = WindTunnel("c172p").slopes(STEPS)
    alpha = slopes.variables[0]
    lift_slope = (0.73 - 0.25) / 0.09  # of its table from 0 to 0.09 rad
    drag = -slopes.coefficients[0] * np.cos(alpha) - slopes.coefficients[2] * np.sin(alpha)
    drag += slopes.variables[VARIABLES.index("Tc")] * np.cos(alpha)
    assert slopes.slope("CZ", "alpha") == pytest.approx(-(lift_slope + drag), rel=0.01)
    assert slopes.slope("CZ", "q") == pytest.approx(-3.9 / 2 * np.cos(alpha), rel=0.01)
    assert slopes.slope("CZ", "alpha_dot") == pytest.approx(-1.7 / 2 * np.cos(alpha), rel=0.01)
    assert slopes.slope("CZ", "de") == pytest.approx(-0.43, rel=0.01)
    assert slopes.slope("CY", "beta") == pytest.approx(-0.137 / 0.349 - drag, rel=0.02)


def test_the_textbook_parameters_have_the_value_and_the_slope_at_the_condition():
    slopes = WindTunnel("c182").slopes(STEPS)
    values, model = slopes.textbook(), textbook_model()
    at = dict(zip(VARIABLES, slopes.variables, strict=True))
    np.testing.assert_allclose(model.coefficients(values, at)[0], slopes.coefficients, atol=1e-12)
    higher, lower = ({**at, "alpha": at["alpha"] + step} for step in (1e-4, -1e-4))
    slope = (model.coefficients(values, higher) - model.coefficients(values, lower))[0] / 2e-4
    np.testing.assert_allclose(slope[[0, 2, 4]], slopes.jacobian[0, [0, 2, 4]], rtol=1e-6)


@pytest.mark.long
def test_the_projection_of_a_model_on_itself_is_the_model(found):
    flight, _, truth = found
    model, signals = flight.aircraft.model, signals_of(flight.aircraft, flight.truth)
    again = model.coefficients(truth["projection"], signals)
    values, nrmse = flight_projection(model, flight.aircraft, replace(flight.truth, coefficients=again))
    assert values == pytest.approx(truth["projection"], rel=1e-6, abs=1e-9)
    assert max(nrmse.values()) < 1e-9


@pytest.mark.long
def test_estimates_are_near_the_best_that_the_model_can_do(found):
    _, parameters, truth = found
    for name, tolerance in TOLERANCE.items():
        assert parameters[name].value == pytest.approx(truth["projection"][name], rel=tolerance), name
    inside = [abs(p.value - truth["projection"][name]) <= 3.0 * p.std for name, p in parameters.items()]
    assert np.mean(inside) >= 0.9  # of 32; C_X of the J3Cub is by a quarter not what its terms can say


@pytest.mark.long
def test_estimates_of_constant_derivatives_are_those_of_the_file(found):
    """Roll and yaw of both aeroplanes are nearly linear: there the file itself is the truth."""
    _, parameters, truth = found
    local = truth["local"]
    for name, tolerance in {"Cl_p": 0.12, "Cl_da": 0.12, "Cn_beta": 0.04, "Cn_r": 0.07, "CZ_alpha": 0.08}.items():
        assert parameters[name].value == pytest.approx(local[name], rel=tolerance), name


@pytest.mark.long
def test_downwash_lag_in_the_model_gives_damping_in_pitch_back():
    """Without a term in alpha_dot, C_m,q takes a part of it: only with it is the 12.4/2 of the file found."""
    flight = fly("c172p")
    added = load_aircraft(config_path("jsbsim_c172p.yaml"))
    textbook, _ = flight_projection(flight.aircraft.model, flight.aircraft, flight.truth)
    values, nrmse = flight_projection(added.model, added, flight.truth)
    assert textbook["Cm_q"] < -7.5
    assert values["Cm_q"] == pytest.approx(-12.4 / 2, rel=0.08)
    assert values["Cm_alpha_dot"] == pytest.approx(-7.27 / 2, rel=0.15)
    assert values["Cm_alpha"] == pytest.approx(-1.8, rel=0.04)
    assert nrmse["Cm"] < 0.08
    pitch = {"Cm": [*textbook_model().terms["Cm"], "Tc", "Tc*de"]}
    _, without = flight_projection(model_from_terms({**textbook_model().terms, **pitch}), added, flight.truth)
    assert nrmse["Cm"] < 0.6 * without["Cm"]


@pytest.mark.parametrize("name", MODELS)
def test_aircraft_files_hold_the_aeroplanes_of_jsbsim(name):
    file = load_aircraft(config_path(f"jsbsim_{name.lower()}.yaml"))
    for key, value in jsbsim_aircraft_file(name).items():
        held = file.source[key]
        assert held == (value if isinstance(value, str) else pytest.approx(value, rel=1e-4, abs=1e-5)), key
    assert set(textbook_model().parameter_names) < set(file.model.parameter_names)


@pytest.mark.long
def test_the_truth_beside_a_recording_holds_both(tmp_path):
    flight = simulate_jsbsim_samples("c182", seed=1, duration=20.0)
    write_flight(flight, tmp_path / "bag")
    document, _ = load_truth(tmp_path / "bag")
    derived = document["derived_coefficients"]
    assert document["coefficients"] is None
    assert set(derived["local"]) == set(derived["projection"]) == set(flight.aircraft.model.parameter_names)
    assert all(low <= derived["local"][name] <= high for name, (low, high) in derived["local_range"].items())
