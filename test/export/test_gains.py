"""Gains of rate loops: stable in other aeroplanes of the covariance, and refused where they would not be."""

from __future__ import annotations

from dataclasses import replace

import export as benchmark
import numpy as np
import pytest
from scipy.linalg import expm

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.commands import gains as gains_command
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.export.autopilot_parameters import Entry, arduplane_gains, px4_file, px4_gains
from aircraft_sysid_ros.export.gains import gains
from aircraft_sysid_ros.export.jsbsim import export_jsbsim
from aircraft_sysid_ros.export.learnt_model import Parameter, range_words
from aircraft_sysid_ros.export.level_flight import airspeeds_of, level_flight, level_words
from aircraft_sysid_ros.export.rate_loops import PITCH, ROLL, Actuator, actuator_of, design
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft

ACTUATOR = Actuator()
FULL = np.radians([25.0, 20.0, 30.0])


@pytest.fixture(scope="module")
def loops(learnt):
    return {axis: design(learnt, axis, ACTUATOR) for axis in (ROLL, PITCH)}


def with_std(learnt, factor=1.0, **std):
    """The same model, its standard errors so many times as large, or given."""
    parameters = tuple(replace(p, std=std.get(p.name, factor * p.std)) for p in learnt.parameters)
    return replace(learnt, parameters=parameters)


@pytest.mark.long
@pytest.mark.parametrize("axis", [ROLL, PITCH])
def test_loops_are_stable_in_aeroplanes_drawn_from_the_covariance(learnt, loops, axis):
    """By our simulator's accelerations and a sampled loop, neither of which the design knows."""
    assert benchmark.stable_loops(learnt, loops[axis], ACTUATOR, learnt.draws(100, seed=7)) >= 99


@pytest.mark.parametrize("axis", [ROLL, PITCH])
def test_the_judge_calls_a_loop_of_the_wrong_sign_or_of_ten_times_the_gain_margin_unstable(learnt, loops, axis):
    loop = loops[axis]
    much = 1.5 * loop.gain_margin
    for bad in (replace(loop, sign=-loop.sign, p=5 * loop.p), replace(loop, p=much * loop.p, i=much * loop.i)):
        assert not benchmark.stable_loops(learnt, bad, ACTUATOR, learnt.values[None])


@pytest.mark.parametrize("axis", [ROLL, PITCH])
def test_the_gain_margin_is_where_the_loop_becomes_unstable(learnt, loops, axis):
    loop = loops[axis]
    for factor, stable in ((0.85, True), (1.15, False)):
        k = factor * loop.gain_margin
        other = replace(loop, p=k * loop.p, i=k * loop.i)
        assert bool(benchmark.stable_loops(learnt, other, ACTUATOR, learnt.values[None])) is stable


@pytest.mark.parametrize(
    ("axis", "name", "std"),
    [(ROLL, "Cl_da", 0.12), (ROLL, "Cl_p", 0.5), (PITCH, "Cm_de", 0.6), (PITCH, "Cm_alpha", 1.5)],
)
def test_what_is_too_uncertain_is_named(learnt, axis, name, std):
    with pytest.raises(InputError, match=rf"no {axis} gains.*{name} = .* is too uncertain"):
        design(with_std(learnt, **{name: std}), axis, ACTUATOR)


@pytest.mark.long
@pytest.mark.parametrize("factor", [pytest.param(10.0, marks=pytest.mark.long), 40.0, 160.0])
def test_whatever_the_uncertainty_gains_are_stable_or_refused(learnt, factor):
    vague = with_std(learnt, factor)
    try:
        loop = design(vague, ROLL, ACTUATOR)
    except InputError as error:
        assert "too uncertain" in str(error)
        return
    assert benchmark.stable_loops(vague, loop, ACTUATOR, vague.draws(100, seed=11)) >= 99


def test_an_unknown_surface_and_a_missing_standard_error_are_refused(learnt):
    k = learnt.model.parameter_names.index("Cl_da")
    values = learnt.values.copy()
    values[k] = 0.0
    with pytest.raises(InputError, match="Cl_da is not known"):
        design(learnt.with_values(values), ROLL, ACTUATOR)
    with pytest.raises(InputError, match="Cl_p has no standard error"):
        design(with_std(learnt, Cl_p=np.nan), ROLL, ACTUATOR)


@pytest.mark.parametrize(("axis", "name"), [(ROLL, "Cl_p"), (ROLL, "Cl_da"), (PITCH, "Cm_alpha"), (PITCH, "Cm_q")])
def test_what_is_not_to_be_used_carries_no_loop(learnt, axis, name):
    doubted = [replace(p, status="HOLD", reason="the model explains 27% of it") for p in learnt.parameters]
    one = tuple(d if p.name == name else p for p, d in zip(learnt.parameters, doubted, strict=True))
    with pytest.raises(InputError, match=rf"no {axis} gains.*{name}.*the model explains 27% of it"):
        design(replace(learnt, parameters=one), axis, ACTUATOR)


@pytest.mark.long
def test_a_flying_wing_without_a_rudder_flies_straight_with_a_little_bank_and_gets_gains(learnt, loops):
    rows = learnt.signals.copy()
    rows[:, learnt.model.signal_names.index("dr")] = np.nan
    listed = tuple(
        replace(p, value=np.nan, std=np.nan, status="HOLD") if p.name.endswith("_dr") else p for p in learnt.parameters
    )
    wing = replace(learnt, parameters=listed, signals=rows)
    level = level_flight(wing, airspeeds_of(wing)[0])
    assert 0.0 < abs(level.bank) < np.radians(5.0) and level.surfaces[2] == 0.0
    coefficients = wing.coefficients_of(wing.terms_on(level.signals[None]))[0]
    weight = wing.aircraft.mass * 9.80665 / (0.5 * level.density * level.airspeed**2 * wing.aircraft.wing_area)
    assert coefficients[1] == pytest.approx(-weight * np.cos(level.alpha) * np.sin(level.bank), abs=1e-6)
    assert coefficients[3:] == pytest.approx(0.0, abs=1e-6)
    assert design(wing, ROLL, ACTUATOR).p == pytest.approx(loops[ROLL].p, rel=0.05)
    said = gains(wing, "px4", FULL, ACTUATOR)
    assert "bank" in "\n".join(said.notes) and "TRIM_YAW" not in said.content
    assert "Cn_dr is not known, so that its term is left out" in said.content


def test_an_unstable_aeroplane_gets_a_loop_that_may_also_be_weaker_or_none(learnt):
    values = learnt.values.copy()
    values[learnt.model.parameter_names.index("Cm_alpha")] = 0.25
    unstable = learnt.with_values(values)
    loop = design(unstable, PITCH, ACTUATOR)
    assert not benchmark.stable_loops(unstable, replace(loop, p=0.0, i=0.0), ACTUATOR, unstable.values[None])
    for k in (1.0, 10 ** (-10 / 20)):
        other = replace(loop, p=k * loop.p, i=k * loop.i)
        assert benchmark.stable_loops(unstable, other, ACTUATOR, unstable.values[None])
    values[learnt.model.parameter_names.index("Cm_alpha")] = 3.0
    with pytest.raises(InputError, match="no pitch gains: the model is unstable without feedback"):
        design(learnt.with_values(values), PITCH, ACTUATOR)


def response_to(learnt, loop, autopilot_surface, seconds=3.0):
    """Rate [rad/s] at the end of a setpoint of 1: the autopilot's formula against our simulator's accelerations."""
    level = level_flight(learnt, airspeeds_of(learnt)[0])
    own = benchmark.OwnAeroplane(learnt)
    a, b = benchmark.fast_modes(own, level)
    surface, rate = (0, 3) if loop.axis == PITCH else (1, 2)
    step, n = 0.005, len(a)
    continuous = np.zeros((n + 1, n + 1))
    continuous[:n, :n], continuous[:n, n] = a, b[:, surface]
    discrete = expm(continuous * step)[:n]
    x, integral = np.zeros(n), 0.0
    for _ in range(round(seconds / step)):
        error = 1.0 - x[rate]
        deflection = autopilot_surface(error, integral, 1.0)
        integral += error * step
        x = discrete @ [*x, deflection]
    return x[rate]


@pytest.mark.parametrize("axis", [ROLL, PITCH])
def test_with_either_autopilots_formula_the_rate_follows_its_setpoint(learnt, loops, axis):
    loop, level = loops[axis], level_flight(learnt, airspeeds_of(learnt)[0])
    full = {ROLL: FULL[1], PITCH: FULL[0]}
    px4 = {e.name.split("_")[-1]: e.value for e in px4_gains([loop], full)}
    plane = {e.name.split("_")[-1]: e.value for e in arduplane_gains([loop], full, level)}
    assert plane.pop("SPEED") == pytest.approx(level.calibrated_airspeed)
    to_true = level.airspeed / level.calibrated_airspeed

    def of_px4(error, integral, setpoint):  # airspeed scaling 1 at trim; -1 to 1, positive moment
        command = px4["P"] * error + px4["I"] * integral + px4["FF"] * setpoint
        return loop.sign * full[axis] * command

    def of_arduplane(error, integral, setpoint):  # degrees of 45
        out = np.degrees(plane["P"] * error + plane["I"] * integral + plane["FF"] * setpoint / to_true)
        return loop.sign * full[axis] * out / 45.0

    assert of_px4(0.3, 0.2, 1.0) == pytest.approx(of_arduplane(0.3, 0.2, 1.0))
    assert response_to(learnt, loop, of_px4) == pytest.approx(1.0, abs=0.05)
    by_feed_forward = response_to(learnt, loop, lambda error, integral, setpoint: of_px4(0.0, 0.0, setpoint))
    assert by_feed_forward == pytest.approx(1.0, abs=0.05)


def test_an_aeroplane_of_whose_lift_nothing_is_known_has_no_level_flight(learnt):
    """It hung on its propeller at an angle of attack of 90 deg, and the file for JSBSim said so."""
    part = learnt.model.axis_slice("CZ")
    listed = list(learnt.parameters)
    listed[part] = [replace(p, value=np.nan, std=np.nan, status="HOLD") for p in listed[part]]
    unknown = replace(learnt, parameters=tuple(listed))
    with pytest.raises(InputError, match="no steady level flight"):
        level_flight(unknown, airspeeds_of(learnt)[0])
    with pytest.raises(InputError, match="or the model lacks lift"):
        airspeeds_of(unknown)
    assert not any("level flight" in note for note in export_jsbsim(unknown).notes)


def test_a_trim_that_is_not_set_is_said_wherever_it_is_listed(learnt):
    """In the file it was a comment, and on the terminal and in the JSON a value like any other."""
    held = tuple(replace(p, status="HOLD") if p.name == "Cn_dr" else p for p in learnt.parameters)
    found = gains(replace(learnt, parameters=held), "px4", FULL, ACTUATOR)
    told = {each["name"]: each for each in gains_command.listed(found)}
    assert told["TRIM_YAW"]["doubt"] == "Cn_dr (HOLD)" and not told["TRIM_ROLL"]["doubt"]
    shown = gains_command.gain_lines(list(told.values()))
    assert [line.split()[0] for line in shown if "NOT SET, since it rests on Cn_dr (HOLD)" in line] == [
        "TRIM_YAW", "FW_DTRIM_Y_VMIN", "FW_DTRIM_Y_VMAX",
    ]  # fmt: skip
    assert any("TRIM_YAW" in note and "stand in the file as comments" in note for note in found.notes)
    assert not any("stand in the file" in note for note in gains(learnt, "px4", FULL, ACTUATOR).notes)


def test_margins_and_limits_are_stated(learnt, loops):
    for loop in loops.values():
        assert loop.gain_margin >= 10 ** (10 / 20) * 0.999
        assert loop.phase_margin >= np.radians(60.0) * 0.999 or np.isinf(loop.phase_margin)
        assert 0.0 < loop.p <= 0.5 * loop.ff * 1.0001
    said = "\n".join(gains(learnt, "arduplane", FULL, ACTUATOR).notes)
    assert "gain margin of 10 dB" in said and "60 deg" in said and "level flight at" in said


def test_what_the_loops_do_not_follow_is_said(learnt):
    """Gains of an elevator that follows by half a second had the margins of one that follows at once."""
    terms = {**learnt.model.terms, "Cm": (*learnt.model.terms["Cm"], "lag(de,0.5)", "max(time-30,0)*de")}
    model = model_from_terms(terms)
    by_name = {p.name: p for p in learnt.parameters}
    more = {"Cm_lag(de,0.5)": -0.01, "Cm_max(time-30,0)*de": 1e-3}
    listed = tuple(by_name.get(n) or Parameter(n, more[n], 1e-5, "USE") for n in model.parameter_names)
    other = replace(learnt, aircraft=replace(learnt.aircraft, model=model), parameters=listed)
    said = "\n".join(gains(other, "px4", FULL, ACTUATOR).notes)
    assert "lag(de,0.5) of the model is taken to follow at once" in said
    middle = f"trims and gains are for {np.median(other.signal('time')):.0f} s"
    assert f"Cm_max(time-30,0)*de: the model goes with the time of the flight, and {middle}" in said
    assert any("JSBSim counts it from its own start" in note for note in export_jsbsim(other).notes)
    assert not any("at once" in note or "time" in note for note in gains(learnt, "px4", FULL, ACTUATOR).notes)


def test_a_slower_actuator_gets_less_gain(learnt, loops):
    assert design(learnt, PITCH, Actuator(0.1, 0.1)).p < loops[PITCH].p


def with_surfaces(**said):
    return aircraft_from_dict({**default_aircraft().source, "sensors": {"control_surfaces": said}})


def test_the_servos_of_the_file_are_those_of_the_loop():
    assert actuator_of(default_aircraft()) == Actuator()
    assert actuator_of(with_surfaces(lag=0.12)) == Actuator(0.12, Actuator().delay)
    assert actuator_of(with_surfaces(lag=0.12, delay=-0.1)) == Actuator(0.12, 0.1)
    assert actuator_of(with_surfaces(delay=0.1)) == Actuator(), "a recorded position that comes late is of no servo"


@pytest.mark.parametrize("late", [{"delay": (-0.15, 0.01)}, {"lag": (0.1, 0.01), "delay": (-0.15, 0.01)}])
def test_surfaces_that_follow_their_records_later_keep_the_margins_that_are_asked_for(learnt, late):
    """The delay that the flight had shown was left out: 4 dB were left of the 10 that the file stated."""
    loop = design(learnt, PITCH, actuator_of(learnt.aircraft, late))
    really = Actuator(late.get("lag", (Actuator().lag, 0.0))[0], 0.15)
    k = 0.98 * 10 ** (10 / 20)
    assert benchmark.stable_loops(learnt, replace(loop, p=k * loop.p, i=k * loop.i), really, learnt.values[None])


def in_a_push_over(learnt, airspeed):
    """The rows with some at an airspeed [m/s] at which no lift that was flown carries the weight."""
    rows, names = learnt.signals.copy(), learnt.model.signal_names
    speed, qbar = names.index("V"), names.index("qbar")
    rows[100:110, qbar] *= (airspeed / rows[100:110, speed]) ** 2
    rows[100:110, speed] = airspeed
    return replace(learnt, signals=rows)


@pytest.mark.parametrize("axis", [ROLL, PITCH])
def test_gains_are_made_for_airspeeds_that_lift_carries(learnt, loops, axis):
    """A push-over at 5.6 m/s was refused: level flight there needed what the model lacked of lift."""
    slow = in_a_push_over(learnt, 5.6)
    _, low, _ = airspeeds_of(slow)
    level = level_flight(slow, low)
    most = (-slow.flown.coefficients[:, 2]).max()
    weight = slow.aircraft.mass * 9.80665 / (0.5 * level.density * low**2 * slow.aircraft.wing_area)
    assert weight == pytest.approx(most, rel=0.1)
    assert design(slow, axis, ACTUATOR).p == pytest.approx(loops[axis].p, rel=0.05)


@pytest.mark.parametrize("has_rudder", [True, False])
def test_a_wing_whose_elevons_are_inputs_of_their_own_flies_level_and_is_told_why_it_has_no_gains(learnt, has_rudder):
    """Gains and airspeeds sent to compare, for lift that nobody lacked."""
    elevons = {"de": "left+right", "da": "left-right", "dr": "dr" if has_rudder else ""}
    terms = {
        axis: [t for t in (elevons.get(t, t) for t in of_axis) if t] for axis, of_axis in learnt.model.terms.items()
    }
    model = model_from_terms(terms, ("left", "right"))
    kept = [p for p in learnt.parameters if has_rudder or not p.name.endswith("_dr")]
    named = tuple(replace(p, name=n) for p, n in zip(kept, model.parameter_names, strict=True))
    rows, names = learnt.signals.copy(), model.signal_names
    rows[:, names.index("left")] = 0.5 * (learnt.signal("de") + learnt.signal("da"))
    rows[:, names.index("right")] = 0.5 * (learnt.signal("de") - learnt.signal("da"))
    wing = replace(learnt, aircraft=replace(learnt.aircraft, model=model), parameters=named, signals=rows)
    speed = airspeeds_of(wing)[0]
    level = level_flight(wing, speed)
    assert level.alpha == pytest.approx(level_flight(learnt, speed).alpha, abs=np.radians(0.3))
    assert (
        not {"elevator", "aileron"} & {*level_words(level).split()} and ("rudder" in level_words(level)) is has_rudder
    )
    for axis, missing in ((ROLL, "Cl has no term of da"), (PITCH, "Cm has no term of de")):
        with pytest.raises(InputError, match=rf"no {axis} gains: {missing}; record .* elevons as half of their sum"):
            design(wing, axis, ACTUATOR)


def test_without_the_moment_of_the_elevator_level_flight_has_the_angle_that_carries_the_weight(learnt):
    """Lift was trimmed with the elevator, by 20 deg and more, and the pitch written into PX4's file was of that."""
    unmoved = [replace(p, value=np.nan, status="HOLD") if p.name == "Cm_de" else p for p in learnt.parameters]
    unmoved = replace(learnt, parameters=tuple(unmoved))
    speed = airspeeds_of(learnt)[0]
    level, known = level_flight(unmoved, speed), level_flight(learnt, speed)
    assert level.alpha == pytest.approx(known.alpha, abs=np.radians(0.3))
    assert level.surfaces[0] == np.median(learnt.signal("de"))
    with pytest.raises(InputError, match="Cm_de is not known: move that surface"):
        design(unmoved, PITCH, ACTUATOR)


def test_nothing_has_a_negative_zero(learnt):
    """A wing was told to bank by -0.00 deg, and PX4 to trim by -0.000000."""
    level = level_flight(learnt, airspeeds_of(learnt)[0])
    words = level_words(replace(level, bank=-1e-7, surfaces=np.array([-1e-7, -0.0, 0.0]), thrust=-1e-7))
    assert "bank 0.00 deg" in words and "elevator 0.00 deg, aileron 0.00 deg" in words and "-0.00" not in words
    rows, names = learnt.signals.copy(), learnt.model.signal_names
    rows[:, names.index("dr")] = -0.0
    rows[:, names.index("Tc")] = np.linspace(5e-32, 0.2255, len(rows))
    lines = range_words(replace(learnt, signals=rows))
    assert "dr: 0 to 0 rad (0.0 to 0.0 deg)" in lines and "Tc: 0 to 0.2255" in lines  # it was "5e-32 to 0.2255 -"
    text = px4_file([], [Entry("TRIM_ROLL", -5e-19, what="command"), Entry("TRIM_PITCH", -1e-9, 0.09, "command")])
    assert "TRIM_ROLL = 0: command" in text and "TRIM_PITCH = 0.000 +- 0.090: command" in text and "-0" not in text


def test_a_mass_that_the_lift_of_most_of_the_flight_does_not_carry_is_said(learnt):
    """FW_AIRSPD_MIN was above FW_AIRSPD_TRIM, which PX4 refuses, or the model was said to lack lift."""
    for factor in (5.0, 50.0):
        heavy = replace(learnt, aircraft=replace(learnt.aircraft, mass=factor * learnt.aircraft.mass))
        with pytest.raises(InputError, match=r"carries \d+\.?\d* kg only from .* m/s on, .*: the mass is wrong"):
            airspeeds_of(heavy)
        assert not any("level flight" in note for note in export_jsbsim(heavy).notes)
