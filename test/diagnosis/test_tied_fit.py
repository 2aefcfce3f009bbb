"""Terms whose parameters are fewer numbers than terms: against plain weighted least squares over all axes at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft import rigid_body
from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.diagnosis.finding import Finding
from aircraft_sysid_ros.diagnosis.flight.flight_data import FOLDS, FlightData
from aircraft_sysid_ros.diagnosis.search.candidates import candidates_of, with_inner
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis, tied_gains
from aircraft_sysid_ros.diagnosis.search.sudden_change import sudden_change
from aircraft_sysid_ros.effects import LIBRARY, effect_of
from aircraft_sysid_ros.effects.effect import CHORD_BY_SPAN

STEP, CHANGE = 0.04, 57.0
NOISE = np.array([0.002, 0.002, 0.01, 0.001, 0.002, 0.0005])


def flight_of(aircraft, change=lambda c, after, f: c, seconds=120.0, seed=0):
    """Random motion, the textbook's coefficients with something changed after a time, and noise."""
    random = np.random.default_rng(seed)
    n = round(seconds / STEP)
    signals = np.full((n, SIGNAL_COUNT), np.nan)
    sizes = {"alpha": 0.05, "beta": 0.05, "p": 0.02, "q": 0.004, "r": 0.02, "de": 0.1, "da": 0.1, "dr": 0.1, "Tc": 0.1}
    values = {name: size * random.normal(size=n) for name, size in sizes.items()}
    values |= {"time": STEP * np.arange(n), "V": np.full(n, 17.0), "qbar": np.full(n, 177.0)}
    values["propeller_speed"] = 500.0 + 100.0 * random.normal(size=n)
    for name, column in values.items():
        signals[:, SIGNAL_INDEX[name]] = column
    measured = aircraft.model.coefficients(aircraft.coefficients, values)
    measured = change(measured.copy(), values["time"] > CHANGE, values) + NOISE * random.normal(size=(n, 6))
    return FlightData(aircraft, values["time"], measured, signals, STEP)


def tried(flight, identifier, variant, **inner):
    bench = CandidateEvaluator(flight)
    effect = effect_of(identifier)
    return bench.trial(with_inner(effect, effect.variants[variant], inner, bench.base))


def test_with_a_number_for_every_term_it_is_the_fit_of_each_axis(aircraft):
    flight = flight_of(aircraft)
    fits = {axis: fit_axis(flight, axis) for axis in ("CZ", "Cm")}
    columns = {axis: np.column_stack([flight.signal("alpha") ** 3, flight.signal("beta")]) for axis in fits}
    ties = {"CZ": np.eye(2, 4), "Cm": np.eye(2, 4, 2)}
    tied = tied_gains(fits, columns, ties)
    for axis, fit in fits.items():
        alone = fit.gain(columns[axis])
        np.testing.assert_allclose(tied[axis].after, alone.after, rtol=1e-9)
        np.testing.assert_allclose(tied[axis].parameters, alone.parameters, rtol=1e-7)
        assert tied[axis].fitted_after == pytest.approx(alone.fitted_after, rel=1e-12)


def test_shared_numbers_are_those_of_plain_least_squares_over_the_axes(aircraft):
    """Fold by fold: one regression of all axes at once, each over the root of its variance."""
    flight = flight_of(aircraft)
    fits = {axis: fit_axis(flight, axis) for axis in ("CZ", "Cm", "Cl")}
    shape, factors = flight.signal("alpha") * np.abs(flight.signal("de")), {"CZ": 1.0, "Cm": -0.4, "Cl": 0.1}
    found = tied_gains(fits, dict.fromkeys(fits, shape[:, None]), {a: np.array([[f]]) for a, f in factors.items()})
    use = ~flight.guarded
    roots = {}
    for axis, fit in fits.items():  # the variance with the number that suits the axis best
        z = np.column_stack([fit.columns, shape])[use]
        y = fit.measured[use]
        roots[axis] = np.std(y - z @ np.linalg.lstsq(z, y, rcond=None)[0])
    for fold in range(FOLDS):
        train, inside = use & (flight.fold != fold), use & (flight.fold == fold)
        blocks, sides, start = [], [], 0
        width = sum(fit.columns.shape[1] for fit in fits.values()) + 1
        for axis, fit in fits.items():
            k = fit.columns.shape[1]
            rows = np.zeros((len(flight.time), width))
            rows[:, start : start + k], rows[:, -1] = fit.columns, factors[axis] * shape
            blocks.append(rows / roots[axis])
            sides.append(fit.measured / roots[axis])
            start += k
        theta = np.linalg.lstsq(
            np.vstack([b[train] for b in blocks]), np.concatenate([s[train] for s in sides]), rcond=None
        )[0]
        for axis, rows, side in zip(fits, blocks, sides, strict=True):
            wanted = np.sum((side[inside] - rows[inside] @ theta) ** 2) * roots[axis] ** 2
            gain = found[axis]
            assert np.sum(gain.after[gain.fit.fold == fold]) == pytest.approx(wanted, rel=1e-8)


def test_a_mass_that_falls_is_one_factor_of_the_three_forces(aircraft):
    def lighter(c, after, _):
        c[np.ix_(after, [0, 1, 2])] *= 0.8
        return c

    flight = flight_of(aircraft, lighter)
    score = tried(flight, "mass_change", 0, t0=CHANGE)
    shares = [float(gain.parameters[0]) for gain in score.gains.values()]
    assert shares == pytest.approx([shares[0]] * 3) and shares[0] == pytest.approx(-0.22, abs=0.03)  # of their mean
    assert score.candidate.numbers == 2

    def one_force(c, after, _):
        c[after, 2] *= 0.8
        return c

    alone = flight_of(aircraft, one_force)
    assert tried(alone, "mass_change", 0, t0=CHANGE).score < 0.2 * tried(alone, "parameter_change", 2, t0=CHANGE).score


@pytest.mark.parametrize(("variant", "shift"), [(0, (0.02, 0.0, 0.0)), (1, (0.0, 0.02, 0.0))])
def test_a_shift_of_the_centre_of_gravity_is_d_cross_f(aircraft, variant, shift):
    """The moments of rigid_body about a point moved by d, and one number that has the sign and the size of d."""

    def shifted(c, after, _):
        lengths = np.array([aircraft.span, aircraft.chord, aircraft.span])
        for i in np.flatnonzero(after):
            c[i, 3:] = rigid_body.moment_at_reference(c[i, 3:] * lengths, c[i, :3], np.array(shift)) / lengths
        return c

    flight = flight_of(aircraft, shifted)
    score, other = (tried(flight, "cg_shift", k, t0=CHANGE) for k in (variant, 1 - variant))
    found = [float(gain.parameters[0]) for gain in score.gains.values()]
    axis, arm = (("Cm", aircraft.chord), ("Cl", aircraft.span))[variant]
    sign = (1.0, -1.0)[variant]
    assert found[0] == pytest.approx(sign * shift[variant] / arm, rel=0.05) and next(iter(score.gains)) == axis
    ratio = -1.0 if variant else -aircraft.chord / aircraft.span
    assert found[1] == pytest.approx(ratio * found[0], rel=1e-9)
    assert score.score > 3.0 * other.score


def test_a_propeller_has_one_angular_momentum(aircraft):
    """M = -h r and N = h q in the coefficients: -2 to 1 in the normalised rates."""
    h = 0.02 / 500.0

    def spins(c, _, f):
        spin = h * f["propeller_speed"] / (f["qbar"] * aircraft.wing_area)
        c[:, 4] -= spin * f["r"] * 2.0 * f["V"] / aircraft.span / aircraft.chord
        c[:, 5] += spin * f["q"] * f["V"] / aircraft.chord / aircraft.span
        return c

    score = tried(flight_of(aircraft, spins, seconds=400.0), "propeller_gyroscopic", 0)
    wanted = h / (aircraft.wing_area * aircraft.chord * aircraft.span)
    assert score.gains["Cm"].parameters[0] == pytest.approx(-2.0 * wanted, rel=0.25)
    assert score.gains["Cn"].parameters[0] == pytest.approx(-0.5 * score.gains["Cm"].parameters[0])


def test_a_surface_loses_one_share_of_its_part_in_all_axes(aircraft):
    def lost(c, after, f):
        for axis in ("Cm", "CZ"):
            c[after, AXES.index(axis)] -= 0.5 * aircraft.coefficients[f"{axis}_de"] * f["de"][after]
        return c

    flight = flight_of(aircraft, lost)
    score = tried(flight, "control_damage", 0, t0=CHANGE)
    derivatives = CandidateEvaluator(flight).parameters
    shares = [float(score.gains[axis].parameters[0]) / derivatives[f"{axis}_de"] for axis in ("Cm", "CZ")]
    assert shares[0] == pytest.approx(shares[1]) and -0.8 < shares[0] < -0.6  # of the mean of before and after

    def moved(c, after, f):  # of a C_m alone: no surface of which half is gone
        c[after, 4] -= 0.5 * aircraft.coefficients["Cm_de"] * f["de"][after]
        c[after, 2] += 2.0 * aircraft.coefficients["CZ_de"] * f["de"][after]
        return c

    other = tried(flight_of(aircraft, moved), "control_damage", 0, t0=CHANGE)
    assert other.log_ratios["CZ"] < 0.0 and other.score < other.log_ratios["Cm"]


def test_an_event_in_one_fold_only_is_predicted_without(aircraft):
    flight = flight_of(aircraft)
    fits = {axis: fit_axis(flight, axis) for axis in ("CZ", "Cm")}
    event = ((flight.time > 5.2) & (flight.time < 9.8)).astype(float)[:, None]
    gains = tied_gains(fits, dict.fromkeys(fits, event), dict.fromkeys(fits, np.ones((1, 1))))
    for axis, gain in gains.items():
        np.testing.assert_allclose(gain.after[1], fits[axis].held_out_sse[1], rtol=1e-9)


@pytest.mark.parametrize("effect", [e for e in LIBRARY if any(v.ties for v in e.variants)], ids=lambda e: e.identifier)
def test_every_term_of_a_tied_variant_has_a_number(effect, aircraft):
    for variant in effect.variants:
        if variant.ties:
            assert {a: len(t) for a, t in variant.ties.items()} == {a: len(t) for a, t in variant.terms.items()}
            used = {tie.number for ties in variant.ties.values() for tie in ties}
            assert used == set(range(variant.numbers)) and variant.numbers < sum(map(len, variant.terms.values()))
            known = {"", CHORD_BY_SPAN, *aircraft.model.parameter_names}
            assert {tie.of for ties in variant.ties.values() for tie in ties} <= known


def test_a_price_grows_with_numbers_and_falls_with_time(aircraft):
    short, long = (tried(flight_of(aircraft, seconds=s), "control_damage", 0, t0=CHANGE) for s in (120.0, 480.0))
    half = tried(flight_of(aircraft), "control_damage", 1, t0=CHANGE)
    assert half.price == pytest.approx(1.5 * short.price) and long.price < 0.4 * short.price
    free = replace(short.candidate, ties={})
    assert free.numbers == 3 and short.candidate.numbers == 2


def test_a_shift_that_is_undone_has_a_begin_and_an_end(aircraft):
    """A passenger walks forward and back. One that stays does not pass."""
    ends = {"passes": 99.0, "stays": np.inf}
    found = {}
    for name, end in ends.items():

        def shifted(c, after, values, end=end):
            there = after & (values["time"] < end)
            c[there, 4] += 0.05 * c[there, 2]
            c[there, 5] -= 0.05 * aircraft.chord / aircraft.span * c[there, 1]
            return c

        bench = CandidateEvaluator(flight_of(aircraft, shifted, seconds=180.0))
        found[name] = bench.best_of(effect_of("cg_shift"))
    inner = dict(found["passes"].candidate.inner)
    assert found["passes"].candidate.passes and found["passes"].candidate.numbers == 3
    assert inner["t0"] == pytest.approx(57.0, abs=1.0) and inner["t1"] == pytest.approx(99.0, abs=1.0)
    assert float(found["passes"].gains["Cm"].parameters[0]) == pytest.approx(0.05, rel=0.1)
    assert "to 99 s" in found["passes"].candidate.span
    assert not found["stays"].candidate.passes
    assert dict(found["stays"].candidate.inner)["t0"] == pytest.approx(57.0, abs=1.0)


def test_a_shift_that_takes_its_time_has_both_its_times(aircraft):
    """Fuel is moved within 40 s; a load that falls off is gone at once."""
    lengths = {"moved": 40.0, "fallen": 0.0}
    found = {}
    for name, length in lengths.items():

        def shifted(c, after, values, length=length):
            there = np.clip((values["time"] - CHANGE) / max(length, STEP), 0.0, 1.0)
            c[:, 4] += 0.05 * there * c[:, 2]
            c[:, 5] -= 0.05 * aircraft.chord / aircraft.span * there * c[:, 1]
            return c

        found[name] = CandidateEvaluator(flight_of(aircraft, shifted, seconds=180.0)).best_of(effect_of("cg_shift"))
    moved, fallen = (found[name].candidate for name in lengths)
    inner = dict(moved.inner)
    assert moved.grows and not moved.passes and moved.numbers == 3
    assert inner["t0"] == pytest.approx(57.0, abs=5.0) and inner["full"] == pytest.approx(97.0, abs=5.0)
    assert float(found["moved"].gains["Cm"].parameters[0]) == pytest.approx(0.05, rel=0.1)
    assert "complete at 9" in moved.span or "complete at 10" in moved.span
    assert not fallen.grows and dict(fallen.inner)["t0"] == pytest.approx(57.0, abs=1.0)


def test_an_aileron_with_free_play_is_told_from_one_that_saturates(aircraft):
    known, gap = aircraft.coefficients, 0.04

    def slack(c, after, values):
        lacking = np.clip(values["da"], -gap, gap)
        c[:, 3] -= known["Cl_da"] * lacking
        c[:, 5] -= known["Cn_da"] * lacking
        return c

    bench = CandidateEvaluator(flight_of(aircraft, slack))
    best, rival = (bench.best_of(effect_of(name)) for name in ("free_play", "control_nonlinearity"))
    inner = dict(best.candidate.inner)
    assert best.candidate.variant == "aileron" and best.score - best.price > rival.score - rival.price
    assert inner["gap"] == pytest.approx(gap, abs=0.006) and abs(inner["centre"]) < 0.01


@pytest.mark.parametrize("rate", [0.15, 0.6])
def test_an_aileron_at_its_greatest_rate_is_told_from_one_with_free_play_or_one_that_saturates(aircraft, rate):
    """A servo in steps of its own, of which the diagnosis knows nothing."""
    known = aircraft.coefficients

    def slow(c, after, values):
        command, place = np.asarray(values["da"]), 0.0
        moved = np.empty(len(command))
        for i, wanted in enumerate(command):
            place += float(np.clip(wanted - place, -rate * STEP, rate * STEP))
            moved[i] = place
        c[:, 3] += known["Cl_da"] * (moved - command)
        c[:, 5] += known["Cn_da"] * (moved - command)
        return c

    bench = CandidateEvaluator(flight_of(aircraft, slow))
    best, *rivals = (bench.best_of(effect_of(name)) for name in ("rate_limit", "free_play", "control_nonlinearity"))
    assert best.candidate.variant == "aileron" and dict(best.candidate.inner)["rate"] == pytest.approx(rate, rel=0.15)
    assert best.score - best.price > max(rival.score - rival.price for rival in rivals)
    assert float(best.gains["Cl"].parameters[0]) == pytest.approx(known["Cl_da"], rel=0.15)


def test_a_banner_that_is_dropped_is_a_line_and_no_gear(aircraft):
    """At two speeds its drag has the same size, and the drag of a gear the same coefficient."""
    flight = flight_of(aircraft)
    signals, measured = flight.signals.copy(), flight.measured.copy()
    pressure = np.where(np.sin(0.2 * flight.time) > 0.0, 120.0, 300.0)
    signals[:, SIGNAL_INDEX["qbar"]] = pressure
    measured[flight.time <= CHANGE, 0] -= (6.0 / pressure)[flight.time <= CHANGE]
    bench = CandidateEvaluator(replace(flight, signals=signals, measured=measured))
    line, gear = (bench.best_of(effect_of(name)) for name in ("tow_line", "landing_gear"))
    assert line.candidate.variant == "dropped" and line.candidate.moment == pytest.approx(CHANGE, abs=1.0)
    assert line.score - line.price > gear.score - gear.price
    assert line.gains["CX"].parameters[0] == pytest.approx(-6.0, rel=0.05)


@pytest.mark.long
def test_what_passes_and_has_no_name_is_seen_with_both_its_times(aircraft):
    def another(c, after, values):
        there = after & (values["time"] < 99.0)
        c[there, 5] += 0.02
        return c

    change = sudden_change(CandidateEvaluator(flight_of(aircraft, another, seconds=180.0)))
    inner = dict(change.candidate.inner)
    assert inner["t0"] == pytest.approx(57.0, abs=1.0) and inner["t1"] == pytest.approx(99.0, abs=1.0)
    assert list(change.candidate.changed) == ["Cn"] and change.candidate.label.startswith("from 57 s to 99 s")


@pytest.mark.long
def test_half_a_fin_takes_its_rudder_with_it(aircraft):
    """One arm for what sideslip, yaw and rudder lose: three numbers for six terms."""
    known = aircraft.coefficients

    def half(c, after, values):
        angle = values["dr"] - 1.5 * values["beta"] + 2.0 * values["r"]
        for axis in ("CY", "Cn"):
            c[after, AXES.index(axis)] -= 0.5 * known[f"{axis}_dr"] * angle[after]
        return c

    bench = CandidateEvaluator(flight_of(aircraft, half))
    best, damage = (bench.best_of(effect_of(name)) for name in ("parameter_change", "control_damage"))
    assert best.candidate.variant == "fin with its rudder" and best.candidate.numbers == 4
    assert best.candidate.moment == pytest.approx(CHANGE, abs=1.0)
    of_rudder, of_sideslip, of_yaw = best.gains["Cn"].parameters
    assert of_sideslip / of_rudder == pytest.approx(-1.5, rel=0.05) and of_yaw / of_rudder == pytest.approx(2, rel=0.05)
    assert of_rudder == pytest.approx(-0.5 * known["Cn_dr"], rel=0.05)
    assert best.score - best.price > damage.score - damage.price


def test_an_engine_that_stops_is_all_of_what_the_thrust_did(aircraft):
    def stopped(c, after, values):
        c[after, 0] -= aircraft.coefficients["CX_Tc"] * values["Tc"][after]
        return c

    bench = CandidateEvaluator(flight_of(aircraft, stopped))
    best, gear = (bench.best_of(effect_of(name)) for name in ("loss_of_thrust", "landing_gear"))
    assert best.candidate.moment == pytest.approx(CHANGE, abs=1.0) and best.score > 3.0 * gear.score
    assert best.gains["CX"].parameters[0] == pytest.approx(-aircraft.coefficients["CX_Tc"], rel=0.05)


@pytest.mark.parametrize("name", ["stall", "dynamic_stall"])
def test_a_wing_whose_flow_has_left_it_in_half_of_a_flight_does_not_stall(aircraft, name):
    flight, effect = flight_of(aircraft), effect_of(name)
    tried_so = [dict(each.inner) for each in candidates_of(effect, flight, CandidateEvaluator(flight).base)]
    usual = float(np.median(flight.signal("alpha")))
    assert tried_so and all(inner["onset"] - inner.get("width", 0.0) >= usual for inner in tried_so)


@pytest.mark.parametrize(("share", "refused"), [(0.5, False), (-0.5, True)])
def test_flow_that_separates_takes_lift_away(aircraft, share, refused):
    """A part of the slope of lift is gone above an angle of attack, or the slope is larger there: that is no stall."""

    def bent(c, _, f):
        c[:, 2] -= share * aircraft.coefficients["CZ_alpha"] * np.maximum(f["alpha"] - 0.05, 0.0)
        return c

    bench = CandidateEvaluator(flight_of(aircraft, bent))
    stall = Finding(bench.best_of(effect_of("stall")), bench.data, 9.0, 9.0, 0.0, 0.5, 9.0)
    said = stall.refusal(first=True)
    assert said == ("its part of C_Z has an impossible sign" if refused else "")


def test_a_centre_of_gravity_that_moves_along_the_fuselage_need_not_be_seen_in_yaw(aircraft):
    """What it makes of C_n is little, and lost in what else the model lacks there. What a surface loses is not."""

    def moved(c, after, f):
        c[:, 4] += np.where(after, 0.09 * c[:, 2], 0.0)
        c[:, 5] += 0.4 * f["beta"] ** 3 + 0.3 * f["alpha"] * f["da"]
        return c

    trial = tried(flight_of(aircraft, moved), "cg_shift", 0, t0=CHANGE)
    assert not Finding(trial, flight_of(aircraft), 0.0, 0.0, 0.0, 0.0, 0.0).impossible
    rudder = next(k for k, v in enumerate(effect_of("control_damage").variants) if v.name == "rudder")
    assert tried(flight_of(aircraft), "control_damage", rudder, t0=CHANGE).candidate.shows_in == ("Cn", "CY")
