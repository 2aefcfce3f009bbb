"""Hidden effects in JSBSim: it works out what our expressions say, and changes mass when it should."""

import tempfile
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jsbsim")

from aircraft_sysid_ros.aircraft.aerodynamic_model import TEXTBOOK_TERMS, model_from_terms
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.term_values import evaluate
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.hidden_effects import Hidden
from aircraft_sysid_ros.simulation.jsbsim_effects import SETTLING, change_mass, edited_model
from aircraft_sysid_ros.simulation.jsbsim_flight import (
    ALPHA_DOT,
    FOOT,
    INCH,
    POUND,
    log_row,
    set_flow_rates,
    signals_of,
    trimmed,
    truth_of_log,
)
from aircraft_sysid_ros.simulation.jsbsim_hidden import BASE_TERMS, prepared
from aircraft_sysid_ros.simulation.simulated_flight import hidden_flight

NAME = "c172p"
TERMS = (
    Effect("CZ", "q*2-alpha**3+abs(beta)", -0.3),
    Effect("CY", "lag(sin(dr)*V/50,0.05)-beta", 0.2),  # with a filter of its own
    Effect("CX", "max(sign(time+19.9),0)*tanh(3*alpha)*exp(-abs(de))", 0.02),
    Effect("Cm", "min(Tc,0.3)*sqrt(V)/10-(1-exp(-height/500))", 0.001),
    Effect("Cn", "p-r*propeller_speed*V/qbar/50", 0.05),
    Effect("Cl", "alpha_dot+limited(sin(da),0.7)*cos(dr)+throttle/100", 0.03),  # with an actuator of its own
)


def misfit(flight, model):
    truth = flight.truth[::5]
    signals = {**signals_of(flight.aircraft, truth), "time": truth.time, "flaps": truth.controls[:, 3]}
    out = []
    for i, axis in enumerate(model.terms):
        columns, c = model.regressors(axis, signals), flight.apparent_coefficients[::5, i]
        out.append(np.std(c - columns @ np.linalg.lstsq(columns, c, rcond=None)[0]) / np.std(c))
    return np.array(out)


def test_jsbsim_works_out_the_same_numbers():
    """Forces and moments that JSBSim adds are the values of our expressions on the signals of the same instant."""
    aircraft = prepared(NAME)[0].aircraft
    with tempfile.TemporaryDirectory() as folder:
        edited_model(trimmed(NAME), NAME, [Hidden("test", terms=TERMS)], Path(folder))
        executive = trimmed(NAME, Path(folder))
        rows, forces = [], []
        for i in range(120):
            executive["fcs/elevator-cmd-norm"] = -0.2 * np.sin(i / 20.0)
            executive["fcs/aileron-cmd-norm"] = 0.3 * np.sin(i / 15.0)
            executive["fcs/rudder-cmd-norm"] = 0.3 * np.sin(i / 10.0)
            set_flow_rates(executive, log_row(executive))
            executive.run()
            rows.append(log_row(executive))
            time = executive["simulation/sim-time-sec"] - SETTLING
            forces.append([time, executive[ALPHA_DOT]])
            forces[-1] += [executive[f"hidden/{t.axis}"] for t in TERMS]
    truth = truth_of_log(aircraft, np.zeros(len(rows)), np.array(rows))
    log = np.array(forces)
    signals = signals_of(aircraft, truth)
    signals |= {"time": log[:, 0], "height": truth.height, "alpha_dot": log[:, 1] * aircraft.chord / truth.airspeed}
    scale = 0.5 * truth.density * truth.airspeed**2 * aircraft.wing_area
    lengths = {"Cl": aircraft.span, "Cm": aircraft.chord, "Cn": aircraft.span}
    for k, term in enumerate(TERMS):
        wanted = term.value * evaluate([parse_expression(term.expression)], signals)[:, 0] * scale
        unit = POUND * FOOT if term.axis in lengths else POUND
        got = log[:, 2 + k] * unit / lengths.get(term.axis, 1.0)
        # JSBSim works some of its properties out after its forces: one step of 5 ms between them and the log
        error = np.min([np.abs(got - np.roll(wanted, step)) for step in (-1, 0, 1)], axis=0)
        assert np.median(error) < 0.02 * np.std(wanted) + 1e-9, term


@pytest.mark.long
def test_a_steady_wind_is_no_effect():
    """JSBSim's own derivative of alpha, of the inertial velocity, has a roll in a crosswind change C_m."""
    flight = hidden_flight(NAME, None, seed=16500, duration=60.0, manoeuvres="standard")
    assert np.hypot(*flight.truth.wind[0, :2]) > 5.0
    model = flight.aircraft.model
    more = model_from_terms({**model.terms, "Cm": [*model.terms["Cm"], "p"]})
    m = list(model.terms).index("Cm")
    assert misfit(flight, more)[m] > 0.9 * misfit(flight, model)[m]


@pytest.mark.long
def test_mass_changes_at_its_time():
    flight = hidden_flight(NAME, "mass_change", seed=1, duration=30.0)
    ratio = flight.apparent_coefficients[:, 2] / flight.truth.coefficients[:, 2]
    change = flight.hidden[0].inner["t0"]
    before, after = flight.truth.time < change - 0.02, flight.truth.time > change + 0.02
    np.testing.assert_allclose(ratio[before], 1.0, rtol=1e-6)
    np.testing.assert_allclose(ratio[after], 1.0 / flight.hidden[0].mass_factor, rtol=1e-3)


def test_one_change_of_the_mass_properties_leaves_the_one_before(tmp_path):
    """Ten per cent of the mass gone, then the centre of gravity 2 cm aft: both are there, and the mass stays gone."""
    lighter, aft = Hidden("mass_change", mass_factor=0.9), Hidden("cg_shift", cg_shift=(-0.02, 0.0, 0.0))
    count = edited_model(trimmed(NAME), NAME, [lighter, aft], tmp_path)
    executive = trimmed(NAME, tmp_path)
    weight, place = executive["inertia/weight-lbs"], executive["inertia/cg-x-in"]
    for effect in (lighter, aft):
        change_mass(executive, effect, count)
        executive.run()
    assert executive["inertia/weight-lbs"] == pytest.approx(0.9 * weight, rel=1e-6)
    assert executive["inertia/cg-x-in"] - place == pytest.approx(0.02 / INCH, rel=1e-3)  # points aft


@pytest.mark.long
@pytest.mark.parametrize(
    "effect",
    [
        "cg_shift",
        "control_damage",
        *(pytest.param(effect, marks=pytest.mark.long) for effect in ("thrust_offset", "asymmetric_thrust")),
    ],
)
def test_the_oracle_explains_what_the_user_cannot(effect):
    """Injected, of the mass properties, or JSBSim's own: in the axis that it enters the error falls."""
    flight = hidden_flight(NAME, effect, seed=2, duration=40.0)
    before, after = misfit(flight, flight.aircraft.model), misfit(flight, flight.oracle.model)
    assert np.all(after <= before + 1e-9)
    assert np.min(after / before) < 0.7


@pytest.mark.long
def test_an_effect_of_its_own_is_hidden_by_leaving_it_out():
    flight = hidden_flight(NAME, "propeller_gyroscopic", seed=2, duration=20.0)
    assert flight.hidden[0].terms == () and flight.hidden[0].native
    for axis, text in flight.hidden[0].native:
        assert text in BASE_TERMS[NAME][axis]
        assert text not in flight.aircraft.model.terms[axis] and text in flight.oracle.model.terms[axis]


@pytest.mark.long
def test_a_plain_file_has_the_32_terms():
    flight = hidden_flight(NAME, seed=2, duration=20.0, plain=True)
    assert flight.aircraft.model.terms == TEXTBOOK_TERMS and flight.hidden == ()


@pytest.mark.long
def test_what_an_aeroplane_cannot_show_is_said():
    with pytest.raises(InputError, match="flaps cannot be seen in flights of the JSBSim aircraft J3Cub"):
        hidden_flight("J3Cub", "flaps", duration=20.0)
