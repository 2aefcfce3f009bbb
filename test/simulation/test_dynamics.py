"""The simulated motion obeys mechanics, and its coefficients are exactly those of the aircraft file."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.aircraft.term_values import evaluate
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.simulation.dynamics import (
    ATTITUDE,
    CONTROLS,
    POSITION,
    RATES,
    SHORTEST_LAG,
    VELOCITY,
    Effect,
    airframe_of,
    flow_rates,
    limited,
    motion,
    runge_kutta_step,
)
from aircraft_sysid_ros.simulation.flight import fly, prepare
from aircraft_sysid_ros.simulation.manoeuvres import flight_plan, level_plan

CALM = np.zeros(3)


def signals_of(aircraft, truth):
    """Signals from the truth by their definitions."""
    scale = 0.5 * truth.density * truth.airspeed**2 * aircraft.wing_area
    return {
        "alpha": truth.alpha, "beta": truth.beta,
        "p": truth.rates[:, 0] * aircraft.span / (2.0 * truth.airspeed),
        "q": truth.rates[:, 1] * aircraft.chord / truth.airspeed,
        "r": truth.rates[:, 2] * aircraft.span / (2.0 * truth.airspeed),
        "de": truth.controls[:, 0], "da": truth.controls[:, 1], "dr": truth.controls[:, 2],
        "Tc": truth.controls[:, 5] / scale,
    }  # fmt: skip


def short_flight(aircraft, seconds=20.0, wind=None, effects=(), rate=400.0):
    setup = prepare(aircraft, effects)
    time = np.arange(round(seconds * rate) + 1) / rate
    air = np.broadcast_to(CALM if wind is None else wind, (len(time), 3)).copy()  # writeable, as every other wind
    return setup, fly(setup, flight_plan(time, setup.excitation), air)


@pytest.mark.long
def test_the_motion_has_the_coefficients_of_the_aircraft_file(aircraft, flight, measured_coefficients):
    truth = flight.truth[::20]
    expected = aircraft.model.coefficients(aircraft.coefficients, signals_of(aircraft, truth))
    np.testing.assert_allclose(measured_coefficients(aircraft, truth), expected, atol=1e-9)
    np.testing.assert_allclose(truth.coefficients, expected, atol=1e-12)


def test_moment_coefficients_are_about_the_aerodynamic_reference(aircraft, measured_coefficients):
    moved = replace(aircraft, aerodynamic_reference=np.array([0.01, 0.005, -0.02]))
    _, truth = short_flight(moved)
    truth = truth[::40]
    expected = aircraft.model.coefficients(aircraft.coefficients, signals_of(aircraft, truth))
    np.testing.assert_allclose(measured_coefficients(moved, truth), expected, atol=1e-9)
    assert np.abs(measured_coefficients(aircraft, truth) - expected)[:, 3:].max() > 1e-3


def test_an_effect_adds_its_term_and_nothing_else(aircraft):
    _, truth = short_flight(aircraft, effects=[Effect("CZ", "alpha**3", -5.0), Effect("CZ", "alpha", 0.5)])
    signals = signals_of(aircraft, truth)
    plain = aircraft.model.coefficients(aircraft.coefficients, signals)
    difference = truth.coefficients - plain
    np.testing.assert_allclose(difference[:, 2], -5.0 * truth.alpha**3 + 0.5 * truth.alpha, atol=1e-12)
    np.testing.assert_allclose(np.delete(difference, 2, axis=1), 0.0, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("gust", [0.0, 1.0])
def test_terms_in_flow_rates_act_at_once_and_do_not_see_gusts(aircraft, gust):
    """The force depends on alpha_dot and alpha_dot on the force: both must hold at the same instant."""
    effects = [
        Effect("CZ", "alpha_dot", -2.0),
        Effect("Cm", "alpha_dot", -5.0),
        Effect("CY", "beta_dot", 0.3),
    ]
    phase = np.arange(8001) / 400.0
    wind = gust * np.column_stack([np.zeros(8001), 2.0 * np.sin(2.0 * phase), np.sin(3.0 * phase)])
    _, truth = short_flight(aircraft, wind=wind, effects=effects)
    step = truth.time[1] - truth.time[0]
    plain = aircraft.model.coefficients(aircraft.coefficients, signals_of(aircraft, truth))
    gusts = -np.gradient(wind, step, axis=0)
    gust_rates = np.array(
        [
            flow_rates(v, rotation_matrix(q).T @ g)
            for v, q, g in zip(truth.air_velocity, truth.quaternion, gusts, strict=True)
        ]
    )
    # steps of commands bend alpha_dot, which differences smear, as they do the wind: medians and not maxima
    for axis, value, angle, length in (
        (2, -2.0, truth.alpha, aircraft.chord),
        (4, -5.0, truth.alpha, aircraft.chord),
        (1, 0.3, truth.beta, 0.5 * aircraft.span),
    ):
        whole = np.gradient(angle, step)
        of_gusts = gust_rates[:, 1 if axis == 1 else 0]
        part = value * (whole - of_gusts) * length / truth.airspeed
        error = truth.coefficients[:, axis] - plain[:, axis] - part
        assert np.median(np.abs(error)) < (1e-3 if gust == 0.0 else 0.03) * np.median(np.abs(part))


@pytest.mark.long
def test_a_lag_in_the_aerodynamics_is_a_state_of_the_motion(aircraft):
    """The simulator integrates it with the rest; along its flight it is the exact solution for the angle of attack."""
    text, flow = "lag(0.5-0.5*tanh((alpha-alpha_dot)/0.05),0.3)", Effect("Cm", "alpha_dot", -1e-9)
    _, truth = short_flight(aircraft, effects=[Effect("Cm", text, 0.02), flow])
    signals = {**signals_of(aircraft, truth), "time": truth.time}
    signals["alpha_dot"] = np.gradient(truth.alpha, truth.time) * aircraft.chord / truth.airspeed
    lagged = evaluate([parse_expression(text)], signals)[:, 0]
    own = truth.coefficients - aircraft.model.coefficients(aircraft.coefficients, signals)
    np.testing.assert_allclose(own[:, 4], 0.02 * lagged, atol=2e-5)
    assert np.ptp(lagged) > 0.05
    with pytest.raises(InputError, match=r"lags of 0\.02 s and longer"):
        prepare(aircraft, [Effect("Cm", "lag(alpha,0.001)", -0.1)])


def test_a_limited_signal_is_one_too_behind_a_quick_servo(aircraft):
    """The exact solution has no time constant; the simulator's servo is behind it by no more than its own lag."""
    rate = 0.1
    _, truth = short_flight(aircraft, effects=[Effect("Cm", f"limited(alpha,{rate})", 0.02)])
    signals = {**signals_of(aircraft, truth), "time": truth.time}
    wanted = evaluate([parse_expression(f"limited(alpha,{rate})")], signals)[:, 0]
    own = (truth.coefficients - aircraft.model.coefficients(aircraft.coefficients, signals))[:, 4] / 0.02
    assert np.max(np.abs(own - wanted)) < 1.5 * SHORTEST_LAG * rate < 0.2 * np.max(np.abs(truth.alpha - wanted))
    assert np.max(np.abs(np.diff(own))) <= rate * (truth.time[1] - truth.time[0]) * (1.0 + 1e-9)


def test_the_autopilot_reckons_with_surfaces_that_arrive_late(aircraft):
    """A derivative with a lag held fast would be none where the whole deflection is late."""
    late = [Effect("Cm", "lag(de,0.05)-de", aircraft.coefficients["Cm_de"])]
    assert prepare(aircraft, late).autopilot.pitch_gain == pytest.approx(
        prepare(aircraft).autopilot.pitch_gain, rel=1e-3
    )
    _, truth = short_flight(aircraft, effects=late)
    assert np.max(np.abs(truth.alpha)) < 0.3


def test_flow_rates_are_derivatives_of_the_flow_angles():
    velocity, change, step = np.array([16.0, 2.0, 1.5]), np.array([0.5, -3.0, 4.0]), 1e-5

    def angles(t):
        u, v, w = velocity + t * change
        return np.array([np.arctan2(w, u), np.arctan2(v, np.hypot(u, w))])

    np.testing.assert_allclose(flow_rates(velocity, change), (angles(step) - angles(-step)) / (2 * step), rtol=1e-7)


@pytest.mark.long
def test_position_velocity_attitude_and_forces_belong_together(flight):
    truth = flight.truth
    step = truth.time[1] - truth.time[0]
    middle = slice(1, -1)

    def derivative(values):
        return (values[2:] - values[:-2]) / (2.0 * step)

    np.testing.assert_allclose(derivative(truth.position), truth.velocity[middle], atol=1e-3)
    force = np.array([rotation_matrix(q) @ f for q, f in zip(truth.quaternion, truth.specific_force, strict=True)])
    weight = derivative(truth.velocity) - force[middle]
    np.testing.assert_allclose(np.median(weight, axis=0), [0.0, 0.0, 9.805], atol=1e-3)
    assert np.percentile(np.abs(weight - np.median(weight, axis=0)), 99) < 0.02
    errors = derivative(truth.rates) - truth.angular_acceleration[middle]
    assert np.percentile(np.abs(errors), 99) < 0.02 * np.percentile(np.abs(truth.angular_acceleration), 99)


def test_without_air_forces_a_body_falls_on_a_parabola(aircraft):
    coefficients = dict.fromkeys(aircraft.coefficients, 0.0)
    setup = prepare(aircraft)
    airframe = airframe_of(replace(aircraft, coefficients=coefficients))
    state = setup.trim.state.copy()
    state[RATES : RATES + 3] = [1.0, -0.5, 2.0]
    start, step, count = state.copy(), 1.0 / 400.0, 800
    for i in range(count):
        np.testing.assert_array_equal(motion(airframe, setup.place, state, CALM, 0.0).specific_force, np.zeros(3))
        state = runge_kutta_step(airframe, setup.place, state, state[CONTROLS:], CALM, CALM, i * step, step)
    seconds = count * step
    fall = np.array([0.0, 0.0, setup.place.gravity])
    velocity = start[VELOCITY : VELOCITY + 3]
    np.testing.assert_allclose(state[VELOCITY : VELOCITY + 3], velocity + seconds * fall, rtol=1e-9)
    np.testing.assert_allclose(
        state[POSITION : POSITION + 3], seconds * velocity + 0.5 * seconds**2 * fall, rtol=1e-9, atol=1e-9
    )
    momentum = [
        rotation_matrix(s[ATTITUDE : ATTITUDE + 4]) @ aircraft.inertia @ s[RATES : RATES + 3] for s in (start, state)
    ]
    np.testing.assert_allclose(momentum[1], momentum[0], rtol=1e-6)


def test_trimmed_flight_stays_trimmed_with_the_controls_held(aircraft):
    setup = prepare(aircraft)
    state = setup.trim.state.copy()
    step = 1.0 / 400.0
    for i in range(8000):
        state = runge_kutta_step(setup.airframe, setup.place, state, setup.trim.controls, CALM, CALM, i * step, step)
    assert abs(state[POSITION + 2]) < 1e-3
    np.testing.assert_allclose(state[RATES : RATES + 3], 0.0, atol=1e-5)
    speed = np.linalg.norm(state[VELOCITY : VELOCITY + 3])
    assert speed == pytest.approx(setup.trim.airspeed, abs=1e-3)


def test_a_steady_wind_only_carries_the_flight_along(aircraft):
    """Galileo: the same motion through the air, whatever the air does over the ground."""
    wind = np.array([4.0, -3.0, 0.0])
    (_, calm), (_, carried) = short_flight(aircraft), short_flight(aircraft, wind=wind)
    np.testing.assert_allclose(carried.air_velocity, calm.air_velocity, atol=1e-8)
    np.testing.assert_allclose(carried.velocity, calm.velocity + wind, atol=1e-8)
    np.testing.assert_allclose(carried.position, calm.position + calm.time[:, None] * wind, atol=1e-7)


def test_a_gust_acts_through_the_flow_and_not_as_a_force(aircraft):
    """In the first instant of a change of wind the velocity over ground is what it was."""
    setup = prepare(aircraft)
    gust = np.array([0.0, 0.0, -2.0])
    before = motion(setup.airframe, setup.place, setup.trim.state, CALM, 0.0)
    after = motion(setup.airframe, setup.place, setup.trim.state, gust, 0.0)
    assert after.air_velocity[2] == pytest.approx(before.air_velocity[2] + 2.0 * np.cos(setup.trim.alpha))
    assert after.specific_force[2] < before.specific_force[2] - 1.0  # rising air lifts


@pytest.mark.parametrize("shear", [0.0, 8.0])
def test_the_integration_is_of_fourth_order(aircraft, shear):
    """Also in a wind that changes at ``shear`` [m/s^2]."""
    setup = prepare(aircraft)
    start = setup.trim.state.copy()
    start[RATES : RATES + 3] = [0.8, 0.5, -0.5]
    rate = np.array([0.0, shear, -shear])

    def final(step):
        state = start
        for t in step * np.arange(round(0.5 / step)):
            command = setup.trim.controls
            state = runge_kutta_step(setup.airframe, setup.place, state, command, rate * t, rate * (t + step), t, step)
        return state

    exact = final(1.0 / 1600.0)
    coarse, fine = (np.max(np.abs(final(step) - exact)) for step in (1.0 / 50.0, 1.0 / 100.0))
    assert 11.0 < coarse / fine < 24.0


def test_thrust_acts_only_through_the_terms_with_thrust(aircraft):
    deaf = replace(aircraft, coefficients={**aircraft.coefficients, "CX_Tc": 0.0})
    setup = prepare(aircraft)
    idle, full = setup.trim.state.copy(), setup.trim.state.copy()
    idle[CONTROLS + 3], full[CONTROLS + 3] = 0.0, 1.0

    def force(of, state):
        return motion(airframe_of(of), setup.place, state, CALM, 0.0).specific_force

    np.testing.assert_array_equal(force(deaf, full), force(deaf, idle))
    gained = force(aircraft, full) - force(aircraft, idle)
    thrust = motion(setup.airframe, setup.place, full, CALM, 0.0).thrust
    np.testing.assert_allclose(gained, [thrust / aircraft.mass, 0.0, 0.0], atol=1e-12)


def test_commands_are_limited():
    np.testing.assert_allclose(
        limited(np.array([9.0, -9.0, 0.1, 2.0])), [np.radians(25.0), -np.radians(25.0), 0.1, 1.0]
    )
    assert limited(np.array([0.0, 0.0, 0.0, -1.0]))[3] == 0.0


def test_any_model_can_fly(aircraft):
    terms = {**aircraft.model.terms, "CZ": ["1", "alpha", "abs(alpha)*alpha", "q", "de"]}
    coefficients = {**aircraft.coefficients, "CZ_abs(alpha)*alpha": -1.0}
    other = replace(aircraft, model=model_from_terms(terms), coefficients=coefficients)
    _, truth = short_flight(other)
    expected = other.model.coefficients(coefficients, signals_of(other, truth[::50]))
    np.testing.assert_allclose(truth.coefficients[::50], expected, atol=1e-12)


def test_missing_coefficients_are_named(aircraft):
    few = {name: value for name, value in aircraft.coefficients.items() if name not in ("Cm_q", "Cn_dr")}
    with pytest.raises(InputError, match="Cm_q Cn_dr"):
        airframe_of(replace(aircraft, coefficients=few))


def test_an_aeroplane_that_cannot_fly_level_is_refused(aircraft):
    heavy = replace(aircraft, mass=50.0)
    with pytest.raises(InputError, match="no straight level flight"):
        prepare(heavy)


def test_an_unstable_aeroplane_is_lost_and_said_to_be(aircraft):
    setup = prepare(replace(aircraft, coefficients={**aircraft.coefficients, "Cm_alpha": 8.0}))
    time = np.arange(4001) / 400.0
    plan = level_plan(time, setup.trim.airspeed)
    plan.controls[400:500, 0] = 0.01
    with pytest.raises(InputError, match="out of control after"):
        fly(setup, plan, np.zeros((len(time), 3)))


def test_an_effect_on_an_unknown_axis_is_refused(aircraft):
    with pytest.raises(InputError, match="the axes are CX CY"):
        airframe_of(aircraft, [Effect("CQ", "alpha", 1.0)])
