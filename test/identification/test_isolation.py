"""What contradicts what was known: a wrong record, a wrong sensor, or an aeroplane that lost something."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.identification.coefficients.layout import WEIGHT_COLUMNS, CoefficientSample
from aircraft_sysid_ros.identification.history import SampleHistory
from aircraft_sysid_ros.identification.monitoring.hold import Hold, Release
from aircraft_sysid_ros.identification.monitoring.hold_end import Signs
from aircraft_sysid_ros.identification.monitoring.integrity import IntegrityMonitor
from aircraft_sysid_ros.identification.monitoring.isolation import explanations, noisy_records, wrong_gyros
from aircraft_sysid_ros.identification.monitoring.known_before import KnownBefore, cause
from aircraft_sysid_ros.identification.monitoring.residuals import GUARD, WINDOW
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.reconstruction.state import SUSPECTED

NOISE, STEP, COUNT = 1e-3, 0.04, 250


@pytest.fixture(scope="module")
def truth(aircraft):
    return np.array([aircraft.coefficients[name] for name in aircraft.model.parameter_names])


def motion(seed: int = 1, scale: dict[str, float] | None = None, late: dict[str, float] | None = None):
    """Smooth signals, as they are and as they are recorded: times ``scale``, ``late`` by so much [s]."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(COUNT)
    really = {name: np.zeros(COUNT) for name in SIGNALS}
    seen = dict(really)
    for name, size in dict(alpha=0.05, beta=0.05, p=0.3, q=0.2, r=0.2, de=0.1, da=0.1, dr=0.1).items():
        f, phase = rng.uniform(0.2, 0.8, 4), rng.uniform(0.0, 2.0 * np.pi, 4)

        def at(t, f=f, phase=phase, size=size):
            return size * np.sin(2.0 * np.pi * f * t[:, None] + phase).sum(axis=1) / 2.0

        really[name] = at(time)
        seen[name] = (scale or {}).get(name, 1.0) * at(time - (late or {}).get(name, 0.0))
    return time, really, seen


def points(aircraft, theta, scale=None, late=None, factor: float = 1.0):
    """Samples of coefficients that ``theta`` makes, times ``factor``, with the terms of what is recorded."""
    time, really, seen = motion(scale=scale, late=late)
    model, rng = aircraft.model, np.random.default_rng(2)
    rows = np.zeros((COUNT, CoefficientSample.TERMS + len(theta)))
    rows[:, CoefficientSample.TIME], rows[:, CoefficientSample.LEARNT] = time, 1.0
    for axis, name in enumerate(AXES):
        part = model.axis_slice(name)
        rows[:, CoefficientSample.TERMS + part.start : CoefficientSample.TERMS + part.stop] = model.regressors(
            name, seen
        )
        rows[:, 1 + axis] = factor * model.regressors(name, really) @ theta[part] + NOISE * rng.standard_normal(COUNT)
    return rows


def best_of(aircraft, truth, rows):
    known, ratio = np.ones(len(truth), np.bool_), aircraft.chord / aircraft.span
    return explanations(aircraft.model, rows, [truth] * 6, known, np.full(6, NOISE**2), ratio)[0]


@pytest.mark.parametrize(
    ("scale", "what", "size"),
    [({"de": 0.5}, "de", 1.0), ({"da": -1.0}, "da", -2.0), ({"alpha": 0.7}, "alpha", 0.43),
     ({"beta": 1.5}, "beta", -0.33)],
)  # fmt: skip
def test_what_is_recorded_with_a_wrong_scale_is_named(aircraft, truth, scale, what, size):
    best = best_of(aircraft, truth, points(aircraft, truth, scale))
    assert best.what == what and best.is_sure and not best.is_aeroplane
    assert best.size == pytest.approx(size, abs=0.02)
    assert f"the factor {1.0 + best.size:.2g}" in best.words


def test_a_density_that_is_wrong_scales_all_axes(aircraft, truth):
    best = best_of(aircraft, truth, points(aircraft, truth, factor=1.0 / 0.75))
    assert best.what == "airspeed" and best.words.startswith("airspeed or density is wrong")


@pytest.mark.parametrize(
    ("signals", "words"),
    [(("de", "da", "dr"), "the controls are 0.0"), (("alpha", "beta"), "the air data are 0.0"),
     (("de", "da", "dr", "alpha", "beta"), "the IMU is 0.0")],
)  # fmt: skip
def test_what_is_late_is_named(aircraft, truth, signals, words):
    """An IMU that is late makes all else early."""
    late = -0.05 if len(signals) > 3 else 0.05
    best = best_of(aircraft, truth, points(aircraft, truth, late=dict.fromkeys(signals, late)))
    assert best.words.startswith(words) and best.words.endswith("late")


def test_a_surface_that_loses_effect_is_an_aeroplane_and_a_change_of_one_axis_is_nothing_else(aircraft, truth):
    names = aircraft.model.parameter_names
    half = np.where([name.endswith("_de") for name in names], 0.5, 1.0) * truth
    best = best_of(aircraft, truth, points(aircraft, half))
    assert (best.what, best.is_aeroplane) == ("de", True) and best.size == pytest.approx(-0.5, abs=0.02)
    other = np.where([name == "Cm_alpha" for name in names], 0.3, 1.0) * truth
    assert not best_of(aircraft, truth, points(aircraft, other)).is_aeroplane
    assert best_of(aircraft, truth, points(aircraft, truth)).before == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("aft", [0.06, -0.1])
def test_a_centre_of_gravity_that_moves_is_an_aeroplane(aircraft, truth, aft):
    """Forces that act elsewhere: r x F, in chords and spans."""
    rows = points(aircraft, truth)
    rows[:, 5] -= aft * rows[:, 3]
    rows[:, 6] += aft * aircraft.chord / aircraft.span * rows[:, 2]
    best = best_of(aircraft, truth, rows)
    assert best.is_aeroplane and best.size == pytest.approx(aft, abs=0.005)
    assert best.words == f"the centre of gravity moved {'aft' if aft > 0 else 'forward'} by {abs(aft):.0%} of the chord"


# -- what was known -------------------------------------------------------------------------------------------------


def known_as(aircraft, theta, share: float = 0.01):
    """A checkpoint of parameters with standard errors of a share of the true ones."""
    true = [aircraft.coefficients[name] for name in aircraft.model.parameter_names]
    found = [SimpleNamespace(value=v, std=share * abs(t), status=Trust.USE) for v, t in zip(theta, true, strict=True)]
    offsets = aircraft.model.offsets
    sums = np.zeros((6, 1, 9, 9))
    for axis, n in enumerate(np.diff(offsets)):
        sums[axis, 0, : n + 2, : n + 2] = np.diag([*np.ones(n), 1e-6, 1.0])  # each term moves more than matters
    state = SimpleNamespace(sums=sums, offsets=offsets)
    said = np.array([(p.value, p.std) for p in found]).T
    return SimpleNamespace(
        found=SimpleNamespace(parameters=found), said=said, within_flight=said, least_squares=state, theta=theta
    )


def with_(aircraft, truth, **factors: float):
    return truth * [factors.get(name, 1.0) for name in aircraft.model.parameter_names]


def noted(aircraft, truth) -> KnownBefore:
    known = KnownBefore(aircraft.model)
    for axis in range(6):
        known.note(axis, known_as(aircraft, truth))
    return known


def test_a_value_that_differs_surely_is_a_change_and_one_that_may_not_is_none(aircraft, truth):
    known, half = noted(aircraft, truth), with_(aircraft, truth, Cm_de=0.5)
    assert not known.changes(known_as(aircraft, truth))
    assert [c.name for c in known.changes(known_as(aircraft, half))] == ["Cm_de"]
    assert not known.changes(known_as(aircraft, half, 0.5))
    assert not known.changes(known_as(aircraft, with_(aircraft, truth, Cm_de=1.0 - 0.9 * THRESHOLDS.contradicts_share)))
    assert not known.changes(known_as(aircraft, with_(aircraft, truth, Cm_0=5.0)))


def test_what_creeps_is_not_followed_and_what_is_known_better_is(aircraft, truth):
    known = noted(aircraft, truth)
    for factor in np.linspace(1.0, 0.7, 31):
        for axis in range(6):
            known.note(axis, known_as(aircraft, with_(aircraft, truth, Cn_beta=factor)))
    assert [c.name for c in known.changes(known_as(aircraft, with_(aircraft, truth, Cn_beta=0.7)))] == ["Cn_beta"]
    better = known_as(aircraft, with_(aircraft, truth, Cn_beta=0.7), 0.9 * THRESHOLDS.known_better * 0.01)
    assert not known.changes(better) and known.changes(better, strict=True)
    known.note(5, better)
    assert not known.changes(better, strict=True)


def test_what_is_known_far_better_is_a_change_after_something_was_wrong(aircraft, truth):
    """A record that is another one after a hold gives values that are soon known better than those before."""
    known, half = noted(aircraft, truth), with_(aircraft, truth, Cm_de=0.5)
    sure = known_as(aircraft, half, 0.1 * THRESHOLDS.known_better * 0.01)
    assert not known.changes(sure) and [c.name for c in known.changes(sure, strict=True)] == ["Cm_de"]


def monitor_of(aircraft, truth, status=Trust.USE):
    """A monitor that knows what is true, with a usual error in all axes."""
    integrity = IntegrityMonitor(
        aircraft, STEP, 2.0 * STEP, 0.999, False, SampleHistory(CoefficientSample.TERMS + len(truth), 250)
    )
    for axis in range(6) if status == Trust.USE else ():
        integrity.known_before.note(axis, known_as(aircraft, truth))
    samples = np.zeros((GUARD + 20 * WINDOW, CoefficientSample.TERMS))
    samples[:, CoefficientSample.TIME] = STEP * np.arange(len(samples))
    samples[:, CoefficientSample.LEARNT], samples[:, CoefficientSample.MEASURED] = 1.0, NOISE
    integrity.errors.monitor.add(samples, np.zeros((len(samples), 6)), np.ones(6, np.bool_))
    past = known_as(aircraft, truth)
    for p in past.found.parameters:
        p.status = status
    past.time, past.theta = 5.0, truth
    integrity.checkpoints.keep(past)
    return integrity


@pytest.mark.parametrize(("status", "held"), [(Trust.HOLD, False), (Trust.USE, True)])
def test_an_axis_that_changes_when_nothing_of_it_was_to_be_used_is_not_held_and_has_no_usual_error(
    aircraft, truth, status, held
):
    """Its errors were those of cruise, in which it had hardly moved; the first motion would always be worse."""
    integrity = monitor_of(aircraft, truth, status)
    assert np.isfinite(integrity.errors.monitor.usual(4)[0])
    integrity.note_change(
        4, 5.0 + THRESHOLDS.worse_since, is_news=not integrity.was_known(4, 5.0 + THRESHOLDS.worse_since)
    )
    assert (integrity.holds[4] is not None) == held == np.isfinite(integrity.errors.monitor.usual(4)[0])


def test_what_was_learnt_together_with_a_contradiction_is_not_believed_either(aircraft, truth):
    """Aileron and rudder exchanged: of the one the effect was known before, of the other it was not."""
    integrity = monitor_of(aircraft, truth)
    now, good = known_as(aircraft, with_(aircraft, truth, Cl_da=-0.1), 1e-3), known_as(aircraft, truth)
    now.time = 100.0
    for axis in (3, 5):
        integrity._before[axis] = good
        integrity.errors.end_hold(axis, 96.0)
    integrity._compare_with_before(now)
    assert integrity.holds[3] is not None and "aileron" in integrity.holds[3].words
    assert integrity.holds[5] is not None and integrity.holds[5].good is good
    assert all(integrity.holds[axis] is None for axis in (0, 1, 2, 4))


def test_two_axes_do_not_hold_each_other_in_turns(aircraft, truth):
    """Half an aileron: each was let go while the other was still held, and was held anew for that."""
    integrity = monitor_of(aircraft, truth)
    now = known_as(aircraft, with_(aircraft, truth, Cl_da=-0.1), 1e-3)
    now.time = 100.0
    for axis in (3, 5):
        integrity._before[axis] = known_as(aircraft, truth)
        integrity.errors.end_hold(axis, 96.0)
    integrity._compare_with_before(now)
    assert [integrity.holds[axis] is not None for axis in (3, 5)] == [True, True]
    integrity._let_go(3, 101.0, None)
    integrity._before[3] = known_as(aircraft, truth)
    integrity._doubt_together(now)
    assert [integrity.holds[axis] is not None for axis in (3, 5)] == [False, True]


def test_what_a_surface_lost_in_one_axis_is_believed_of_the_others(aircraft, truth):
    """Only as much of it, and nothing besides."""
    known = noted(aircraft, truth)
    lost = known_as(aircraft, with_(aircraft, truth, Cl_da=0.5))
    known.accept(known.changes(lost), lost, "the aileron lost half")

    def believed(**factors: float) -> bool:
        now = known_as(aircraft, with_(aircraft, truth, Cl_da=0.5, **factors))
        return known.accept_alike(known.changes(now), now)

    assert not believed(Cn_da=0.2)
    assert not believed(Cn_da=0.5, Cn_p=0.5)
    assert not believed(Cn_dr=0.5)
    assert believed(Cn_da=0.53)
    assert len(known.changed) == 2
    again = known_as(aircraft, with_(aircraft, truth, Cl_da=0.25, Cn_da=0.25))  # half of what was left
    assert known.changes(again) and not known.accept_alike(known.changes(again), again)
    known.regain(known_as(aircraft, truth))
    assert not believed(CY_da=0.5)


@pytest.mark.parametrize("since", [98.0, np.nan])
@pytest.mark.parametrize(("moved", "goes_back"), [(0.0, False), (1.0, True)])
def test_a_hold_does_not_end_while_what_was_lost_does_not_move(aircraft, truth, moved, goes_back, since):
    """After half of an aileron was lost roll rate and sideslip alone moved for 4 s: both sets predict them alike, and
    the old effect had USE again. Where the aileron moves, and does what it did, it may. So in the next manoeuvre.
    """
    integrity, axis = monitor_of(aircraft, truth), AXES.index("Cl")
    good, newest = (known_as(aircraft, with_(aircraft, truth, Cl_da=left)) for left in (1.0, 0.5))
    good.time, newest.time = 5.0, 99.0
    integrity.checkpoints.keep(newest)
    samples = np.zeros((GUARD + WINDOW, CoefficientSample.TERMS + len(truth)))
    samples[:, CoefficientSample.TIME] = 100.0 + STEP * np.arange(len(samples))
    samples[:, CoefficientSample.LEARNT] = 1.0
    at = aircraft.model.parameter_names.index("Cl_da")
    terms = samples[:, CoefficientSample.TERMS :]
    terms[:, at - 2] = terms[:, at - 1] = 0.01 * np.sin(np.arange(len(samples)))
    terms[:, at] = moved * 0.1 * np.cos(np.arange(len(samples)))
    part = aircraft.model.axis_slice("Cl")
    samples[:, CoefficientSample.MEASURED.start + axis] = terms[:, part] @ truth[part]
    samples[:, CoefficientSample.PREDICTED.start + axis] = terms[:, part] @ newest.theta[part]
    weights = np.zeros((len(samples), WEIGHT_COLUMNS))
    integrity._history.add(samples, weights, samples[:, CoefficientSample.PREDICTED])
    begun = 98.0 if np.isfinite(since) else -np.inf  # as after a restart of the clock
    hold = Hold(since, begun, "model error", good, sensor=False, high=True)
    hold.sensor = True  # as where what was learnt was not believed: no sensor has said anything
    assert (integrity._end.decide(axis, hold, 110.0, Signs(), False) is Release.BACK) == goes_back


def test_what_times_a_hold_has_are_none_by_another_clock(aircraft, truth):
    """The record of a surface stood still when the clock was set back by an hour: the axis was held for that hour."""
    integrity = monitor_of(aircraft, truth)
    hold = Hold(3590.0, 3591.0, "model error", known_as(aircraft, truth), sensor=False, high=True, stuck="da")
    hold.still, hold.last_heard = 3600.0, 3588.0
    hold.good.without_time = lambda: hold.good
    integrity.holds[AXES.index("Cl")] = hold
    integrity.known_before.restart_clock = lambda: None
    integrity.restart()
    assert "stands still" in hold.what and hold.still < 0.0
    assert np.isnan(hold.last_heard) and np.isnan(hold.said_since)


def test_an_effect_that_was_lost_may_come_back(aircraft, truth):
    known, half = noted(aircraft, truth), known_as(aircraft, with_(aircraft, truth, Cm_de=0.5, CZ_de=0.5))
    changes = known.changes(half)
    assert {c.name for c in changes} == {"Cm_de", "CZ_de"}
    known.accept(changes, half, "words")
    assert not known.changes(half) and len(known.changed) == 2
    assert not known.changes(known_as(aircraft, truth))
    assert known.changes(known_as(aircraft, with_(aircraft, truth, Cm_de=2.0)))
    assert not known.regain(half)
    assert known.regain(known_as(aircraft, truth)) and not known.changed
    assert known.changes(half)


def test_candidates_are_named(aircraft, truth):
    known = noted(aircraft, truth)

    def words(**factors: float) -> str:
        return cause(known.changes(known_as(aircraft, with_(aircraft, truth, **factors))))

    assert words(Cm_de=2.0).startswith("the record of the elevator is wrong, or the aeroplane has changed (Cm_de went")
    assert words(CZ_alpha=1.4, Cm_alpha=1.4).startswith("the angle of attack is wrong")
    assert words(Cm_de=0.6, Cl_da=0.6).startswith("the records of the controls are wrong")
    assert words(Cm_de=1.5, Cl_da=1.5, Cl_p=1.5, CZ_alpha=1.5).startswith("airspeed or density is wrong")
    assert words(Cm_q=1.5, Cl_p=0.5).startswith("a sensor is wrong")


@pytest.mark.parametrize(("std", "named"), [(0.0, ""), (0.003, ""), (0.0175, "the record of the elevator is noisy")])
def test_noise_on_a_record_is_told_from_motion_that_is_steered(aircraft, truth, std, named):
    """Steps and sines of 0.1 rad, with the noise of a record that is digital, and then of a degree."""
    rows, rng = points(aircraft, truth), np.random.default_rng(3)
    at = CoefficientSample.SIGNALS.start + SIGNALS.index("de")
    time = rows[:, CoefficientSample.TIME]
    rows[:, at] = 0.1 * np.sign(np.sin(2.0 * np.pi * 0.7 * time)) + 0.1 * np.sin(2.0 * np.pi * 2.0 * time)
    rows[:, at] += np.where(time > 5.0, std, 0.001) * rng.standard_normal(len(rows))
    assert noisy_records(aircraft.model, rows, 5.0) == named


def test_a_gyro_is_told_from_the_vane_that_it_predicts():
    """Innovations of the sideslip: if the side force agrees with the vane, and a moment does not, it is the gyro."""
    sideslip = next(code for code, sensor in SUSPECTED.items() if sensor == "sideslip")
    gyro, vane = np.ones(6), np.ones(6)
    gyro[AXES.index("Cn")] = vane[AXES.index("Cn")] = 9.0
    vane[AXES.index("CY")] = 7.0
    assert "the gyros are wrong" in wrong_gyros(sideslip, gyro)
    assert wrong_gyros(sideslip, vane) == wrong_gyros(0, gyro) == wrong_gyros(sideslip, np.full(6, np.nan)) == ""
