"""The library of effects: laws that every entry obeys, and a new effect in one entry."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.sensor_settings import SCALED_SENSORS
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.aircraft.term_values import evaluate
from aircraft_sysid_ros.diagnosis.finding import Finding
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.search.candidates import with_inner
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.effects import BY_ID, LIBRARY, effect_of
from aircraft_sysid_ros.effects.effect import (
    AERODYNAMIC,
    CHANGE,
    KINDS,
    MEASUREMENT,
    Effect,
    ShapeParameter,
    Variant,
    fill,
    placeholders,
    with_setting,
)
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

INTERFACE = {
    AERODYNAMIC: "stall ground_effect alpha_dot flaps propwash thrust_offset propeller_torque propeller_gyroscopic "
    "compressibility adverse_yaw dihedral_alpha sideslip_drag sideslip_pitching control_nonlinearity "
    "control_effectiveness_alpha asymmetric_thrust landing_gear icing",
    CHANGE: "control_damage stuck_control parameter_change mass_change cg_shift",
    MEASUREMENT: "alpha_scale beta_scale airspeed_scale air_data_lag probe_offset imu_offset actuator_lag wind_change",
}
BASE = {axis: "0.1+0.5*alpha+0.2*beta" for axis in AXES}


def ordinary_signals(n=200):
    """Signals as flights have them, slow and fast, low and high."""
    rng = np.random.default_rng(1)
    low_high = {
        "alpha": (-0.1, 0.3), "beta": (-0.2, 0.2), "p": (-0.1, 0.1), "q": (-0.02, 0.02), "r": (-0.05, 0.05),
        "de": (-0.4, 0.4), "da": (-0.4, 0.4), "dr": (-0.4, 0.4), "flaps": (0.0, 0.6), "Tc": (-0.05, 1.0),
        "throttle": (0.0, 1.0), "propeller_speed": (0.0, 1200.0), "V": (8.0, 300.0), "qbar": (40.0, 5e4),
        "mach": (0.02, 1.2), "height": (-1.0, 3000.0), "alpha_dot": (-0.02, 0.02), "beta_dot": (-0.02, 0.02),
        "time": (0.0, 600.0),
    }  # fmt: skip
    assert set(low_high) == set(SIGNALS)
    return {name: rng.uniform(*limits, n) for name, limits in low_high.items()}


def values_of(number, signals):
    """Inner numbers at both ends of their range and in the middle."""
    share = np.linspace(number.low, number.high, 3)
    if number.signal is None:
        return share
    values = signals[number.signal]
    return values.min() + share * np.ptp(values)


@pytest.mark.parametrize("kind", KINDS)
def test_the_library_has_every_effect_of_the_interface(kind):
    assert set(INTERFACE[kind].split()) <= {effect.identifier for effect in LIBRARY if effect.kind == kind}


def test_ids_are_unique_and_measurement_comes_first():
    assert len(BY_ID) == len(LIBRARY)
    kinds = [effect.kind for effect in LIBRARY]
    assert kinds == sorted(kinds, key=lambda kind: kind != MEASUREMENT)
    with pytest.raises(InputError, match="'wings' is not an effect of the library"):
        effect_of("wings")
    assert effect_of("stall").identifier == "stall"


@pytest.mark.parametrize("effect", LIBRARY, ids=lambda effect: effect.identifier)
def test_an_effect_is_told_in_two_sentences_with_a_source(effect):
    assert len(re.findall(r"[A-Za-z0-9)]\.(?= [A-Z]|$)", effect.physics)) == 2, effect.physics
    for text in (effect.name, effect.source, effect.formula, effect.residuals, effect.manoeuvre):
        assert text.strip() == text and len(text) > 3
    assert effect.kind in KINDS
    assert re.fullmatch(r"[a-z_]+", effect.identifier)
    names = [variant.name for variant in effect.variants]
    assert names and len(set(names)) == len(names)


@pytest.mark.parametrize("effect", LIBRARY, ids=lambda effect: effect.identifier)
def test_terms_are_finite_on_ordinary_signals_for_all_inner_numbers(effect):
    signals = ordinary_signals()
    for variant in effect.variants:
        assert bool(variant.terms) != bool(variant.setting)
        assert set(variant.terms) <= set(AXES)
        for axis, texts in variant.terms.items():
            assert len(set(texts)) == len(texts), axis
            for which in range(3):
                numbers = {number.name: values_of(number, signals)[which] for number in effect.inner}
                programs = [parse_expression(fill(text, {**BASE, **numbers})) for text in texts]
                columns = evaluate(programs, signals)
                assert np.all(np.isfinite(columns))


@pytest.mark.parametrize("effect", LIBRARY, ids=lambda effect: effect.identifier)
def test_inner_numbers_are_those_of_the_terms_and_have_sensible_ranges(effect):
    used = {
        name
        for variant in effect.variants
        for texts in variant.terms.values()
        for text in texts
        for name in placeholders(text)
    }
    declared = {number.name for number in effect.inner}
    if effect.kind != MEASUREMENT:
        assert used - set(AXES) == declared
    else:
        assert len(declared) == 1 and not used
    for number in effect.inner:
        assert number.low < number.high and 3 <= number.count <= 30
        if number.signal is not None:
            assert number.signal in SIGNALS and number.low >= 0.0 and number.high <= 1.0


@pytest.mark.parametrize("effect", [e for e in LIBRARY if e.kind == MEASUREMENT], ids=lambda effect: effect.identifier)
def test_a_measurement_effect_is_one_more_aircraft_file(aircraft, effect):
    """Every value of its range is allowed in the file; only that number changes, and it can be changed back."""
    for variant in effect.variants:
        number = effect.setting_number(variant)
        for value in (number.low or 0.5 * number.high, number.high or 0.5 * number.low):
            changed = with_setting(aircraft, variant.setting, value)
            assert aircraft_from_dict(changed.source).source == changed.source != aircraft.source
            assert changed.model.terms == aircraft.model.terms
            different = [key for key in aircraft.source if changed.source[key] != aircraft.source[key]]
            assert different == [variant.setting[0]]


def test_settings_reach_what_they_name(aircraft):
    lag = with_setting(aircraft, ("sensors", "air_data", "delay"), 0.1)
    assert [lag.sensors[name].delay for name in SCALED_SENSORS] == [0.1, 0.1, 0.1]
    assert lag.sensors["sideslip"].noise == aircraft.sensors["sideslip"].noise
    moved = with_setting(aircraft, ("imu_position", "y"), 0.1)
    np.testing.assert_allclose(moved.imu_position - aircraft.imu_position, [0.0, 0.1 * aircraft.span, 0.0])
    assert with_setting(aircraft, ("process_noise", "wind"), 0.7).process_noise["wind"] == 0.7
    assert with_setting(aircraft, ("sensors", "airspeed", "scale"), 1.1).sensors["airspeed"].scale == 1.1
    with pytest.raises(InputError, match="scale of sensor airspeed must be between"):
        with_setting(aircraft, ("sensors", "airspeed", "scale"), -1.0)
    with pytest.raises(InputError, match="sensor gyro has no scale"):
        with_setting(aircraft, ("sensors", "gyro", "scale"), 1.1)


def test_a_new_effect_is_one_entry():
    """As docs/effects.md shows: nothing else has to be written."""
    page = (Path(__file__).parents[2] / "docs" / "effects.md").read_text(encoding="utf8")
    (entry,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    names = {"AERODYNAMIC": AERODYNAMIC, "Effect": Effect, "ShapeParameter": ShapeParameter, "Variant": Variant}
    effect = eval(entry, names)
    assert effect.axes == ("Cn",) and effect.signals == {"beta"}
    text = fill(effect.variants[0].terms["Cn"][0], {"onset": 0.1})
    beta = np.array([-0.3, -0.05, 0.0, 0.15])
    np.testing.assert_allclose(evaluate([parse_expression(text)], {"beta": beta})[:, 0], [-0.2, 0.0, 0.0, 0.05])


def separated(alpha, step=0.02, **numbers):
    """Lift lost (n,) of the stall with a memory and of the gradual one without, for angles of attack [rad]."""
    time = step * np.arange(len(alpha))
    numbers = {"onset": 0.2, "width": 0.04, "lag": 0.4, **numbers}
    late, now = effect_of("dynamic_stall").variants[0], effect_of("stall").variants[1]
    programs = [parse_expression(fill(variant.terms["CZ"][0], numbers)) for variant in (late, now)]
    return evaluate(programs, {"alpha": alpha, "time": time}).T


def test_a_stall_with_a_memory_is_the_static_one_in_steady_flight():
    """And loses nothing well below the onset, three quarters of the lift well beyond it: Kirchhoff's limits."""
    for level in (0.05, 0.2, 0.22, 0.5):
        late, now = separated(np.full(50, level))
        np.testing.assert_allclose(late, now, rtol=1e-12)
    np.testing.assert_allclose(separated(np.full(9, 0.6))[0], 0.75, atol=1e-4)
    np.testing.assert_allclose(separated(np.full(9, -0.1))[0], 0.0, atol=1e-4)
    half = separated(np.full(9, 0.2))[1]  # x = 1/2
    np.testing.assert_allclose(half, 1.0 - ((1.0 + np.sqrt(0.5)) / 2.0) ** 2, rtol=1e-12)


def test_without_its_time_it_is_the_static_one_in_any_motion():
    alpha = 0.2 + 0.15 * np.sin(0.02 * np.arange(1500) * 3.0)
    loops = [np.max(np.abs(np.subtract(*separated(alpha, lag=lag)))) for lag in (0.4, 0.04, 0.004, 0.0)]
    assert loops == sorted(loops, reverse=True) and loops[0] > 0.1 and loops[2] < 0.02 and loops[3] == 0.0


def test_it_loses_less_lift_on_the_way_up_than_on_the_way_down():
    """The loop of lift over angle of attack is run clockwise: the integral of lost lift over it is negative."""
    alpha = 0.2 + 0.15 * np.sin(2.0 * np.pi * np.arange(3000) / 300)
    (late, now), turn = separated(alpha), slice(-601, None)
    up, down = np.diff(alpha[turn]) > 0.0, np.diff(alpha[turn]) < 0.0
    same = np.abs(alpha[turn][1:] - 0.22) < 0.01
    assert late[turn][1:][up & same].mean() < now[turn][1:][same].mean() < late[turn][1:][down & same].mean()
    area = [float(np.trapezoid(lost[turn], alpha[turn])) for lost in (late, now)]
    assert area[0] < -0.01 and abs(area[1]) < 1e-3


def explained(truth, other, numbers, signals):
    """Share of the lift that one effect loses, beside a linear model, that the terms of another one explain."""
    linear = [np.ones_like(signals["alpha"]), signals["alpha"]]
    (identifier, variant), (rival, form) = truth, other
    lost = effect_of(identifier).variants[variant].terms["CZ"][-1]
    texts = effect_of(rival).variants[form].terms["CZ"]
    columns = evaluate([parse_expression(fill(text, numbers)) for text in (lost, *texts)], signals)
    model, whole = np.column_stack([*linear, columns[:, 1:]]), columns[:, 0]
    left, before = (whole - x @ np.linalg.lstsq(x, whole, rcond=None)[0] for x in (model, np.column_stack(linear)))
    return 1.0 - float(np.sum(left**2) / np.sum(before**2))


def test_stated_sets_of_the_stall_follow_from_the_formulas():
    """In slow motion the memory tells nothing; a stall that has just begun has the shape of a cubic, and a parabola
    that of a gradual stall at any depth.
    """
    slow, quick = (0.15 + 0.12 * np.sin(2.0 * np.pi * 0.02 * np.arange(5000) / period) for period in (40.0, 2.0))
    numbers, static, late = {"onset": 0.22, "width": 0.05, "lag": 0.3}, ("stall", 1), ("dynamic_stall", 0)
    for alpha, low, high in ((slow, 0.95, 1.0), (quick, 0.0, 0.8)):
        signals = {"alpha": alpha, "time": 0.02 * np.arange(5000)}
        assert low < explained(late, static, numbers, signals) < high
    for top, low, high in ((0.25, 0.9, 1.0), (0.45, 0.0, 0.7)):
        signals = {"alpha": np.linspace(0.0, top, 500)}
        curved = [explained(static, ("lift_nonlinearity", form), numbers, signals) for form in (0, 2)]
        assert low < max(curved) < high
        assert explained(("lift_nonlinearity", 0), static, numbers, signals) > 0.9


def of_terms(identifier, variant, numbers, signals, axis):
    """Columns (n, k) of the terms of one axis."""
    (form,) = (each for each in effect_of(identifier).variants if each.name == variant)
    return evaluate([parse_expression(fill(text, numbers)) for text in form.terms[axis]], signals)


def test_a_surface_with_free_play_rests_in_the_gap_and_follows_with_its_half_width_outside():
    numbers, commands = {"gap": 0.02, "centre": 0.01}, np.array([-0.2, -0.01, 0.0, 0.01, 0.025, 0.03, 0.11])
    lacking = of_terms("free_play", "elevator", numbers, {"de": commands}, "Cm")[:, 0]
    moved = commands - lacking  # with a share of -1
    np.testing.assert_allclose(moved, [-0.18, 0.01, 0.01, 0.01, 0.01, 0.01, 0.09], atol=1e-15)


def test_a_surface_at_its_greatest_rate_lacks_what_is_left_of_the_command():
    signals = {"time": np.arange(0.0, 2.0, 0.1), "da": np.r_[np.zeros(5), np.full(15, 0.3)]}
    column = of_terms("rate_limit", "aileron", {"rate": 0.5}, signals, "Cl")[:, 0]
    np.testing.assert_allclose(column[:5], 0.0, atol=1e-15)
    np.testing.assert_allclose(column[5:11], [-0.25, -0.2, -0.15, -0.1, -0.05, 0.0], atol=1e-12)
    np.testing.assert_allclose(column[11:], 0.0, atol=1e-12)


@pytest.mark.long
def test_a_surface_at_its_greatest_rate_is_followed_as_quickly_as_it_was_recorded(aircraft):
    """Of means over windows the same limit makes another motion, and its error outweighs what it explains."""
    flown = simulate_samples(aircraft, 4, 45.0, hidden=[("rate_limit", 1.0)])
    data = settled_flight(reconstruct(aircraft, flown.samples, with_covariance=False))
    effect, true = effect_of("rate_limit"), flown.hidden[0].inner["rate"]
    quick, of_means = (CandidateEvaluator(each) for each in (data, replace(data, surfaces=None)))
    variant = next(each for each in effect.variants if each.name == flown.hidden[0].variant)
    explained, hardly = (b.trial(with_inner(effect, variant, {"rate": true}, b.base)) for b in (quick, of_means))
    assert explained.log_ratios["Cm"] > 2.0 > 10.0 * hardly.log_ratios["Cm"]
    score = quick.best_of(effect)
    for sign, words in ((1.0, ""), (-1.0, "impossible sign")):  # who leads is not late
        gains = {axis: replace(gain, parameters=sign * gain.parameters) for axis, gain in score.gains.items()}
        said = Finding(replace(score, gains=gains), data, 0.0, 0.0, 0.0, 0.0, 0.0).impossible
        assert words in said if words else not said
    best = score.candidate
    assert best.variant == variant.name and dict(best.inner)["rate"] == pytest.approx(true, rel=0.05)
    never_reached = data.columns(data.parsed(["limited(de,50)-de"]))
    assert np.all(never_reached == 0.0), "what is left by rounding had explained a tenth of a moment"


def test_a_line_pulls_as_hard_at_any_speed():
    """Its coefficient times dynamic pressure is the same while it is there, and nothing else."""
    signals = {"time": [1.0, 2.0, 9.0, 10.0], "qbar": [100.0, 200.0, 100.0, 400.0]}
    for variant, force in (("hooked on", [0.0, 0.0, 1.0, 1.0]), ("dropped", [1.0, 1.0, 0.0, 0.0])):
        column = of_terms("tow_line", variant, {"t0": 5.0}, signals, "CX")[:, 0]
        np.testing.assert_allclose(column * signals["qbar"], force, atol=1e-15)


def test_ice_on_one_wing_rolls_and_yaws_as_the_lift_and_drag_that_it_costs():
    signals = {"time": np.linspace(0.0, 100.0, 11), "alpha": np.linspace(-0.05, 0.15, 11)}
    for form in ("growing", "settling"):
        drag, yaw, lift, roll = (
            of_terms("icing", f"{form} on one wing", {"t0": 30.0}, signals, axis) for axis in ("CX", "Cn", "CZ", "Cl")
        )
        np.testing.assert_array_equal(drag, yaw)
        np.testing.assert_array_equal(lift, roll)
        np.testing.assert_allclose(lift, drag * signals["alpha"][:, None], rtol=1e-12, atol=1e-15)
        assert np.all(drag[:4] == 0.0) and np.all(np.diff(drag[3:, 0]) > 0.0)


def test_courses_of_a_change_in_time():
    """A step stays, a pulse ends, a ramp is half there in its middle and stays as it is at its end."""
    (variant,) = effect_of("mass_change").variants
    time = {"time": np.array([9.0, 11.0, 15.0, 19.0, 21.0, 99.0])}
    numbers = {"t0": 10.0, "t1": 20.0, "full": 20.0, "CX": 1.0}
    for form, there in (
        (variant, [0.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
        (variant.passing, [0.0, 1.0, 1.0, 1.0, 0.0, 0.0]),
        (variant.growing, [0.0, 0.1, 0.5, 0.9, 1.0, 1.0]),
    ):
        column = evaluate([parse_expression(fill(form.terms["CX"][0], numbers))], time)[:, 0]
        np.testing.assert_allclose(column, there, atol=1e-12)
    assert effect_of("fuel_burn").variants[0].growing is None  # no change at a moment


def test_flaps_that_stay_out_are_a_step_whether_they_are_recorded_or_not():
    """The stated sets of unrecorded flaps: terms of C_Z and C_m are the same then, and at one speed those of a line."""
    time = np.linspace(0.0, 100.0, 21)
    signals = {"time": time, "flaps": 0.3 * (time > 50.0)}
    for axis in ("CZ", "Cm"):
        known = of_terms("flaps", "", {}, signals, axis)
        step = of_terms("unrecorded_flaps", "", {"t0": 50.0}, signals, axis)
        np.testing.assert_allclose(known, 0.3 * step, atol=1e-15)
        line = of_terms("tow_line", "hooked on", {"t0": 50.0}, {**signals, "qbar": np.full(21, 200.0)}, axis)
        np.testing.assert_allclose(200.0 * line, step, rtol=1e-12)


def test_a_thrust_that_is_lost_at_full_throttle_is_a_line_that_pulls_back():
    """The stated set of both: T_c of a constant thrust is in proportion to 1 / q̄; of one that changes it is not."""
    qbar, time = np.linspace(150.0, 400.0, 21), np.linspace(0.0, 100.0, 21)
    line = of_terms("tow_line", "hooked on", {"t0": 50.0}, {"time": time, "qbar": qbar}, "CX")
    for thrust, is_alike in ((np.full(21, 12.0), True), (np.linspace(12.0, 2.0, 21), False)):
        lost = of_terms("loss_of_thrust", "", {"t0": 50.0}, {"time": time, "Tc": thrust / (qbar * 0.3)}, "CX")
        assert np.allclose(lost, 12.0 / 0.3 * line, rtol=1e-12) == is_alike


def test_the_physics_of_some_terms():
    """A stall begins at its onset, the ground is felt near it, a change is a step, a mass change keeps proportions."""
    stall, _ = effect_of("stall").variants
    column = evaluate([parse_expression(fill(stall.terms["CZ"][0], {"onset": 0.2}))], {"alpha": [0.1, 0.2, 0.25]})
    np.testing.assert_allclose(column[:, 0], [0.0, 0.0, 0.05], atol=1e-15)
    (ground,) = effect_of("ground_effect").variants
    near = evaluate([parse_expression(fill(ground.terms["CZ"][0], {"decay": 2.0}))], {"height": [-0.1, 2.0, 1e3]})
    np.testing.assert_allclose(near[:, 0], [1.0, np.exp(-1.0), 0.0], atol=1e-15)
    (mass,) = effect_of("mass_change").variants
    step = evaluate(
        [parse_expression(fill(mass.terms["CZ"][0], {"t0": 5.0, "CZ": "-0.3-4*alpha"}))],
        {"time": [4.9, 5.1], "alpha": [0.1, 0.1]},
    )
    np.testing.assert_allclose(step[:, 0], [0.0, -0.7])
