"""Inputs that stop acting in flights without vanes: found, dated, told from what nothing fails in. Laws and flights."""

from __future__ import annotations

import itertools
import json
import re
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz

from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.aircraft.term_values import evaluate_signals
from aircraft_sysid_ros.diagnosis import flight_answer
from aircraft_sysid_ros.diagnosis.failures import failures as found_failures
from aircraft_sysid_ros.diagnosis.failures.axis_relation import AxisRelation, whitened, with_power
from aircraft_sysid_ros.diagnosis.failures.coloured_fit import coloured_fit
from aircraft_sysid_ros.diagnosis.failures.episode import Times
from aircraft_sysid_ros.diagnosis.failures.failure import FailureReport
from aircraft_sysid_ros.diagnosis.failures.failures import by_forces, failures_of
from aircraft_sysid_ros.diagnosis.failures.force_balance import force_balance
from aircraft_sysid_ros.diagnosis.failures.interval_search import (
    CONSTANT,
    FROZEN,
    PART,
    Whitened,
    intervals,
    sums_of_squares,
)
from aircraft_sysid_ros.diagnosis.failures.repeats import likeliest, times_there
from aircraft_sysid_ros.diagnosis.failures.unrecorded_change import UnrecordedChange
from aircraft_sysid_ros.diagnosis.failures.words import (
    _window,
    candidate_json,
    change_json,
    report_json,
    sentence_of,
    terms_of,
)
from aircraft_sysid_ros.diagnosis.flight_answer import answer, diagnose_run
from aircraft_sysid_ros.diagnosis.model_versions import failed_input as failed_inputs
from aircraft_sysid_ros.diagnosis.model_versions.additions import add, remove
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.diagnosis.words import headline
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.model_change import with_terms
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.ground_speed_wind import contradicted_calm, wind_of_ground_speed
from aircraft_sysid_ros.run_reader import read_points
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.samples import Kind

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import failure_flights as flights
import jsbsim_missions as missions


@pytest.fixture(scope="module")
def stuck():
    """One elevon is held for a while; no airspeed, no vanes."""
    return flights.fly(53002, flights.LAYOUTS["no airspeed, 60 Hz"], "elevon_left")


@pytest.fixture(scope="module")
def engine():
    """The engine fails; IMU of 10 Hz, commands of 2.5 Hz, no vanes."""
    return flights.fly(3, flights.LAYOUTS["airspeed, 10 Hz"], "engine")


@pytest.fixture(scope="module")
def engine_report(engine):
    """What the search says of it."""
    return failures_of(engine.aircraft, engine.samples)


# -- laws -----------------------------------------------------------------------------------------------------


def test_running_sums_are_the_sums_of_squares_of_the_fits() -> None:
    rng = np.random.default_rng(1)
    n = 60
    rest, acting, frozen = rng.standard_normal((n, 2)), rng.standard_normal((n, 1)), np.full((n, 1), 0.3)
    constant, response = rng.uniform(0.5, 1.5, n), rng.standard_normal(n)
    begin, end = intervals(n, 10, 7)
    series = Whitened(rest, acting, frozen, constant, response)
    found = {kind: sums_of_squares(series, kind, begin, end) for kind in (CONSTANT, FROZEN, PART)}
    for w, (first, last) in enumerate(zip(begin, end, strict=True)):
        inside = np.zeros(n)
        inside[first:last] = 1.0
        held = np.where(inside[:, None] > 0.0, frozen, acting)
        part = np.column_stack([acting, inside[:, None] * acting])
        for kind, moving in ((CONSTANT, acting), (FROZEN, held), (PART, part)):
            x = np.column_stack([rest, moving, inside * constant])
            left = response - x @ np.linalg.lstsq(x, response, rcond=None)[0]
            assert found[kind][w] == pytest.approx(float(left @ left), rel=1e-5), (kind, first, last)


def test_what_comes_with_the_throttle_is_explained_by_it_and_nothing_else_is() -> None:
    """Two more columns, the power that follows the throttle and its square, at any weight."""
    rng, step = np.random.default_rng(2), 0.1
    throttle = np.repeat(rng.uniform(0.0, 1.0, 20), 30)
    known = np.column_stack([np.ones(600), rng.standard_normal(600)])
    relation = AxisRelation("Cl", np.zeros(600), known, ("1", "da"), {}, ())
    balance = SimpleNamespace(signal={"throttle": throttle}.__getitem__, time=step * np.arange(600))
    power = np.zeros(600)
    power[0] = throttle[0]
    for i in range(1, 600):
        power[i] = power[i - 1] + (1.0 - np.exp(-step)) * (throttle[i] - power[i - 1])
    found = with_power(relation, balance).columns
    assert found == pytest.approx(np.column_stack([known, power, power**2]), abs=1e-12)
    silent = SimpleNamespace(signal=lambda name: np.full(600, np.nan), time=balance.time)
    assert with_power(relation, silent) is relation


def test_a_fit_with_a_colour_is_that_of_plain_least_squares_and_the_smallest_where_columns_are_alike() -> None:
    rng, count, order, floor = np.random.default_rng(5), 300, 4, 0.05
    columns = rng.standard_normal((count, 3)) * [1.0, 1e3, 1e-3]
    noise = np.convolve(rng.standard_normal(count + 1), [1.0, 0.8], "valid")
    for x in (columns, np.column_stack([columns, 2.0 * columns[:, 0], np.zeros(count)])):
        y = columns @ [1.0, 2e-3, 5e2] + noise
        rows, theta, colour, size, variance = coloured_fit(x, y, np.ones(1), order, floor, 3)
        scaled = x / np.where(size > 0.0, size, 1.0)
        known = np.linalg.lstsq(scaled, y, rcond=1e-8)[0]
        for _ in range(3):
            left = y - scaled @ known
            left -= left.mean()
            lags = np.array([left[k:] @ left[: count - k] / count for k in range(order + 1)])
            lags[0] = lags[0] * (1.0 + 1e-4) + floor**2
            expected = np.concatenate([[1.0], -solve_toeplitz(lags[:-1], lags[1:])])
            white = whitened(scaled, expected), whitened(y, expected)
            known = np.linalg.lstsq(*white, rcond=1e-8)[0]
        assert colour == pytest.approx(expected, rel=1e-9) and theta == pytest.approx(known, rel=1e-9, abs=1e-12)
        assert rows == pytest.approx(np.vstack([white[0].T, white[1]]), rel=1e-9, abs=1e-9)
        assert white[1] == pytest.approx(np.convolve(y, expected, "valid"), rel=1e-12, abs=1e-12)
        innovations = white[1] - white[0] @ known
        assert variance == pytest.approx(np.mean(innovations**2) + floor**2 * np.sum(expected**2), rel=1e-9)
    assert whitened(columns[:, :0], colour).shape == (count - order, 0), "an input may have a constant only"
    assert whitened(y[:3], colour).shape == (0,), "a series may be shorter than the filter"


def test_the_likeliest_times_are_the_best_of_all_that_there_are() -> None:
    rng, count, change = np.random.default_rng(4), 11, 1.3
    sequences = np.array([*itertools.product([False, True], repeat=count)])
    changes = np.abs(np.diff(sequences.astype(int), axis=1, prepend=0)).sum(axis=1)
    for _ in range(20):
        gains = rng.standard_normal(count)
        best = sequences[np.argmax(sequences @ gains - change * changes)]
        assert np.array_equal(likeliest(gains, change), best)


def test_times_that_are_near_are_one_and_short_ones_none() -> None:
    gains = np.full(60, -3.0)
    for begin, end in ((10, 20), (22, 30), (40, 43), (50, 60)):
        gains[begin:end] = 3.0
    assert times_there(gains, 2.0, 5) == [(10.0, 30.0), (50.0, 60.0)]


def test_the_wind_of_a_circle_is_its_centre() -> None:
    rng = np.random.default_rng(2)
    course = np.linspace(0.0, 12.0 * np.pi, 900)
    velocity = 15.0 * np.column_stack([np.cos(course), np.sin(course)]) + [3.0, -2.0]
    wind = wind_of_ground_speed(velocity + 0.2 * rng.standard_normal(velocity.shape), 0.2)
    assert wind is not None and wind.is_there and wind.is_known
    assert np.abs(wind.wind - [3.0, -2.0]).max() < 3.0 * wind.std + 0.05
    calm = wind_of_ground_speed(velocity - [3.0, -2.0] + 0.2 * rng.standard_normal(velocity.shape), 0.2)
    assert calm is not None and not calm.is_there and not calm.text


def test_straight_flight_tells_no_wind() -> None:
    rng = np.random.default_rng(3)
    velocity = np.array([18.0, 0.0]) + 0.2 * rng.standard_normal((600, 2))
    wind = wind_of_ground_speed(velocity, 0.2)
    assert wind is None or not (wind.is_there and wind.is_known)


@pytest.mark.long
def test_forces_of_the_balance_are_those_of_the_imu(engine) -> None:
    balance = force_balance(engine.aircraft, engine.samples)
    imu = engine.samples.values[engine.samples.kind == Kind.IMU]
    normal = balance.measured[:, 2] * balance.signal("qbar") * engine.aircraft.wing_area / engine.aircraft.mass
    assert np.mean(normal) == pytest.approx(np.mean(imu[:, 2]), rel=0.03)
    assert balance.band < 1.1, "commands come at 2.5 Hz"


@pytest.mark.parametrize("kind", [Kind.IMU, Kind.AIRSPEED])
def test_a_stamp_of_0_is_no_time_of_a_flight(engine, kind) -> None:
    """A driver that began with one made a grid of decades: no memory was enough for it."""
    at = np.flatnonzero(engine.samples.kind == kind)[0]
    stamp = engine.samples.stamp.copy()
    stamp[at] = 0
    begun, without = replace(engine.samples, stamp=stamp), engine.samples[np.arange(len(stamp)) != at]
    balances = [force_balance(engine.aircraft, samples) for samples in (begun, without)]
    assert balances[0].begin == balances[1].begin and balances[0].recorded_from == balances[1].recorded_from
    np.testing.assert_array_equal(balances[0].measured, balances[1].measured)


# -- flights --------------------------------------------------------------------------------------------------


def test_times_by_forces_and_those_of_their_terms_count_from_where_the_filter_started(aircraft, flight) -> None:
    """A term had begun as much too early as the filter had started late; the stamps were right."""
    samples = flight.samples[flight.samples.stamp < flight.samples.stamp.min() + 30 * 10**9]
    whole = force_balance(aircraft, samples)
    late = force_balance(aircraft, samples, zero=whole.begin + 2 * 10**9)
    assert late.time == pytest.approx(whole.time - 2.0, abs=1e-9) and (late.signal("time") == late.time).all()
    told = []
    for balance, begin in ((whole, 14.0), (late, 12.0)):
        times = (Times(begin, begin + 6.0, 0.5, 0.5),)
        changed = UnrecordedChange(
            times=times, evidence=200.0, gains={"Cm": 200.0}, main_axis="Cm", size=0.3, errors={"Cm": (0.5, 0.4)}
        )
        report = FailureReport((), changed, (), ("de",), frozenset({"de"}), ("Cm",), {}, balance)
        told.append((change_json(changed, report), balance))
    (one, _), (other, _) = told
    assert one["stamps"] == other["stamps"] and other["inner"] == {"t0": 12.0, "t1": 18.0}
    assert "(14 s to 20 s since the first sample: the filter started 2 s late)" in other["where"]
    acts = [balance.columns(said["terms"]["Cm"])[:, 0] for said, balance in told]
    assert np.array_equal(*acts) and set(acts[0]) == {0.0, 1.0}


def test_a_failure_that_began_before_the_filter_started_has_a_term_all_the_same() -> None:
    text = _window(SimpleNamespace(times=(Times(-3.2, 5.0, 0.5, 0.5),)))
    signals = np.zeros((8, SIGNAL_COUNT))
    signals[:, SIGNAL_INDEX["time"]] = np.arange(8.0)
    (column,) = evaluate_signals([parse_expression(text)], np.arange(8.0), signals, 1.5).T
    assert column.tolist() == [1.0] * 5 + [0.0] * 3


def test_what_a_run_says_by_forces_counts_as_its_terms_do(hidden_run, monkeypatch) -> None:
    run, asked = open_run(hidden_run), []

    def by_forces(aircraft, samples, progress=None, zero=None):
        asked.append(zero)
        raise InputError("enough")

    for module in (flight_answer, failed_inputs):
        monkeypatch.setattr(module, "by_forces", by_forces)
    with pytest.raises(InputError, match="enough"):
        flight_answer.diagnose_run(run.path)
    with pytest.raises(InputError, match="enough"):
        add(run.path, "stuck_control")
    points = read_points(run.path)
    time = points["signals"][:, points["signal_names"].tolist().index("time")]
    assert asked == [run.zero, run.zero] and np.abs(points["stamp"] - run.zero - 1e9 * time).max() < 1e6
    assert run.zero > run.samples.stamp.min(), "the filter needs some samples before it starts"


@pytest.mark.long
def test_an_elevon_that_sticks_is_named_and_dated(stuck) -> None:
    (found,) = failures_of(stuck.aircraft, stuck.samples).found
    assert found.name == "elevon_left" and found.end is None
    assert abs(found.begin - stuck.begin) < 2.0
    assert abs(found.left) < 0.35, "nothing is left of what it does"


@pytest.mark.long
def test_an_engine_that_fails_is_named_and_dated_at_10_hz(engine, engine_report) -> None:
    report = engine_report
    (found,) = report.found
    assert found.is_loss_of_thrust and found.end is None
    assert abs(found.begin - engine.begin) < 2.0
    said = report_json(report, [])
    assert said["verdict"] == "missing" and said["candidates"][0]["effect"] == "loss_of_thrust"
    assert "no thrust" in sentence_of(found) and {"CY", "CZ"} <= set(report.not_judged)
    stamp = candidate_json(found, report)["stamps"]["t0"]
    first = int(engine.samples.stamp[engine.samples.kind == Kind.IMU].min())
    assert (stamp - first) * 1e-9 == pytest.approx(found.begin, abs=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("layout", ["airspeed, 10 Hz", pytest.param("no airspeed, 60 Hz", marks=pytest.mark.long)])
def test_nothing_is_named_where_nothing_fails(layout) -> None:
    flight = flights.fly(3002, flights.LAYOUTS[layout], "none")
    assert not failures_of(flight.aircraft, flight.samples).says_something


@pytest.mark.long
@pytest.mark.parametrize("seed", [7100, 7105])
def test_an_engine_that_takes_seconds_to_follow_its_throttle_is_dated_all_the_same(seed) -> None:
    layout = list(flights.LAYOUTS.values())[seed % 4]
    flight = flights.fly(seed, layout, "engine", spool=3.0)
    (found,) = failures_of(flight.aircraft, flight.samples).found
    assert found.name == "engine" and found.is_loss_of_thrust and abs(found.begin - flight.begin) < 1.5


@pytest.mark.long
def test_with_vanes_and_commands_too_slow_for_the_library_the_forces_judge_the_surfaces() -> None:
    flight = flights.fly(8100, flights.Layout(25.0, 2.5, 10.0, elevons=False, vanes=True), "aileron")
    said = answer(flight.aircraft, flight.samples)
    (found,) = said["candidates"]
    assert (said["verdict"], found["label"]) == ("missing", "stuck_control (aileron)")
    assert abs(found["inner"]["t0"] - flight.begin) < 2.0
    assert said["notes"] == [
        "the library was not searched: the flight cannot be judged: the controls come at 2.5 Hz: at least 10 Hz are "
        "needed"
    ]


@pytest.mark.long
def test_a_jet_that_is_throttled_back_has_not_lost_its_engine() -> None:
    """JSBSim's 737 makes no thrust while it idles, nor in the 5 s after that in which its turbines spool up."""
    layout = flights.Layout(10.0, 10.0, 20.0, elevons=False, vanes=True)
    flight = missions.fly(3118, layout, "none", {"737": missions.KNOWN["737"]})
    report = by_forces(flight.aircraft, flight.samples)
    assert report is not None and not report.says_something


@pytest.mark.long
@pytest.mark.parametrize(("seed", "failure"), [(9720005, "engine"), (9710003, "none")])
def test_with_vanes_an_engine_is_told_by_the_forces_where_nobody_measured_its_thrust(seed, failure) -> None:
    flight = flights.fly(seed, flights.WITH_VANES, failure)
    report = by_forces(flight.aircraft, flight.samples)
    assert report is not None and report.tried == ("engine",)
    if failure == "none":
        assert not report.says_something
        return
    (found,) = report.found
    assert found.is_loss_of_thrust and found.end is None
    assert abs(found.begin - flight.begin) < found.begin_error
    said = answer(flight.aircraft, flight.samples)
    assert [each["effect"] for each in said["candidates"]] == ["loss_of_thrust"]
    known = with_terms(flight.aircraft, {a: tuple(t) for a, t in terms_of(found, report).items()}, {})
    assert not by_forces(known, flight.samples).says_something, "the model has it now"


@pytest.mark.long
def test_an_elevon_that_is_held_for_seconds_only_is_told_by_two_moments() -> None:
    flight = flights.fly(9100005, flights.LAYOUTS["no airspeed, 60 Hz"], "elevon_right", moved=True, lasting=5.6)
    (found,) = failures_of(flight.aircraft, flight.samples).found
    assert found.name == "elevon_right" and found.end - found.begin < 6.0
    assert abs(found.begin - flight.begin) < 0.5 and abs(found.end - flight.end) < 0.5


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "layout"),
    [
        (8700007, "no airspeed, 25 Hz"),  # held for the 3 s before it pushes
        pytest.param(9850011, "no airspeed, 25 Hz", marks=pytest.mark.long),  # held up to the midst of a doublet
        (9860024, "airspeed, 10 Hz"),  # held for as long as the aeroplane turns
        pytest.param(9860041, "airspeed, 50 Hz", marks=pytest.mark.long),  # another moment while it does not
    ],
)
def test_what_only_seems_to_fail_is_none(seed, layout) -> None:
    flight = flights.fly(seed, flights.LAYOUTS[layout], "none")
    assert not failures_of(flight.aircraft, flight.samples).says_something


@pytest.mark.parametrize(
    ("evidence", "by_the_other", "least", "is_denied"),
    [(89.0, -73.0, 60.0, True), (70.0, -18.0, 30.0, False), (112.0, 135.0, 60.0, False)],
)
def test_what_one_form_of_the_balance_has_of_an_input_must_hold_beside_the_other(
    evidence, by_the_other, least, is_denied
) -> None:
    """Both are of one flight: what both make of it together must still be as much as one of them needs."""
    sure = SimpleNamespace(evidence=evidence, hypothesis=None)
    said = SimpleNamespace(gains={"Cl": by_the_other - 1.0, "Cn": 1.0})
    form = SimpleNamespace(search=SimpleNamespace(count=1498), least=least)
    other = SimpleNamespace(search=SimpleNamespace(count=1498, judged=lambda hypothesis: said))
    assert found_failures._is_denied(sure, form, other) is is_denied
    other.search.count = 1490  # other samples: its points are not those of this one
    assert not found_failures._is_denied(sure, form, other)


@pytest.mark.parametrize(("of_gear", "answers_no_more"), [(2637.0, False), (140.0, True)])
def test_a_moment_that_says_more_than_an_input_that_no_longer_acts_is_left_to_the_library(
    monkeypatch, of_gear, answers_no_more
) -> None:
    """An elevator that holds the trim against a gear does nothing that shows: it had been called another one."""
    sure, constant = (SimpleNamespace(score=score, evidence=ev) for score, ev in ((700.0, 1427.0), (60.0, of_gear)))
    search = SimpleNamespace(best=lambda name, kind: constant, base={}, axes_of=lambda name: [])
    form = SimpleNamespace(search=search, balance=None)
    for name, value in {
        "_frozen": sure, "_weakened": None, "_of_input": sure, "described": "it", "named": None,
        "is_long_enough": True, "_is_shown": True, "_deaf": (),
    }.items():  # fmt: skip
        monkeypatch.setattr(found_failures, name, lambda *_, value=value: value)
    found = found_failures._searched(found_failures._Job(form, "de"))
    assert (found.unlike is not None) == answers_no_more and found.failure is None


@pytest.mark.long
def test_an_aileron_that_moves_for_the_first_time_has_not_changed() -> None:
    """Straight for 137 s at 10 Hz, then a turn: the rolling acceleration, noise there, had an aileron that fails."""
    flight = missions.fly(11050007, flights.Layout(10.0, 10.0, 5.0, elevons=False, vanes=False), "none")
    said = answer(flight.aircraft, flight.samples)
    assert said["verdict"] == "none" and not any(c["found"] for c in said["candidates"])


@pytest.mark.long
def test_a_control_that_does_something_else_to_the_end_is_unexplained() -> None:
    """An elevator that sticks where it is, in a flight whose autopilot hardly moves it: not enough for the name."""
    flight = flights.fly(9970001, flights.LAYOUTS["airspeed, 50 Hz"], "elevator")
    report = failures_of(flight.aircraft, flight.samples)
    assert report.found == () and report.unexplained is not None
    said = report_json(report, [])
    (candidate,) = said["candidates"]
    assert (said["verdict"], candidate["effect"], candidate["input"]) == ("unexplained", None, "de")
    assert "does not answer the control 'elevator' as before" in said["advice"]
    assert all(set(texts) for texts in candidate["terms"].values()) and candidate["main_axis"] == "Cm"
    over = replace(report.unexplained, times=(report.unexplained.times[0]._replace(end=100.0, end_error=1.0),))
    said = report_json(replace(report, unlike=(over,)), [])
    assert said["verdict"] == "none" and "The effect of elevator is not the same throughout" in said["advice"]
    assert "elevator" not in said["advice"].split("The effect of elevator")[0], "it is not said to be sound"


@pytest.mark.long
def test_a_surface_that_does_more_to_one_side_has_not_failed() -> None:
    """An elevator that moves half of what is recorded when it goes up, all flight long: as a log of commands has it."""
    flight = flights.fly(9840002, flights.LAYOUTS["airspeed, 50 Hz"], "none")
    values, controls = flight.samples.values.copy(), flight.samples.kind == Kind.CONTROLS
    elevator = values[controls, 0]
    trim = np.nanmedian(elevator)
    values[controls, 0] = np.where(elevator > trim, elevator, trim + 2.0 * (elevator - trim))
    assert not failures_of(flight.aircraft, replace(flight.samples, values=values)).says_something


@pytest.fixture(scope="module")
def hard_over():
    """The rudder goes to a side and stays there, while its command hardly moves; no airspeed, no vanes."""
    return flights.fly(8400502, flights.LAYOUTS["no airspeed, 25 Hz"], "rudder", moved=True)


@pytest.mark.long
def test_a_rudder_that_goes_hard_over_is_a_moment_that_no_input_shows(hard_over) -> None:
    report = failures_of(hard_over.aircraft, hard_over.samples)
    assert report.found == () and report.changed is not None, (
        "a rudder that hardly moves is not told from other moments"
    )
    assert report.changed.main_axis == "Cn" and "Cl" in report.changed.gains and "Cm" not in report.changed.gains
    assert abs(report.changed.begin - hard_over.begin) < 0.5 and report.changed.end is None
    said = report_json(report, [])
    (candidate,) = said["candidates"]
    assert said["verdict"] == "missing" and candidate["effect"] == "parameter_change"
    assert "stuck_control" in candidate["confounded_with"]
    assert set(candidate["terms"]) == {"Cn", "Cl"}
    assert "No recorded input explains a rolling moment" in said["advice"] and "yawing moment" in said["advice"]


@pytest.mark.long
def test_a_rudder_that_stands_aside_does_not_keep_a_third_of_its_effect() -> None:
    """About a place that is far beyond all that it is told to: no surface keeps a share of its effect there."""
    flight = flights.fly(9977031, flights.LAYOUTS["no airspeed, 25 Hz"], "rudder", moved=True)
    report = failures_of(flight.aircraft, flight.samples)
    assert report.found == () and report.changed is not None and report.changed.main_axis == "Cn"
    assert abs(report.changed.begin - flight.begin) < 1.0


@pytest.mark.long
def test_a_surface_that_keeps_part_of_its_effect_is_named_with_what_is_left() -> None:
    flight = flights.fly(8420005, flights.LAYOUTS["airspeed, 50 Hz"], "part of elevator")
    (found,) = failures_of(flight.aircraft, flight.samples).found
    assert (found.name, found.kind) == ("de", PART)
    assert abs(found.begin - flight.begin) < 1.0 and abs(found.end - flight.end) < 1.0
    assert found.left == pytest.approx(flight.share, abs=3.0 * found.left_std + 0.02)
    assert "keeps 4" in sentence_of(found) and "of its effect" in sentence_of(found)


@pytest.mark.long
def test_inputs_that_a_flight_does_not_show_are_said_and_not_called_sound() -> None:
    flight = flights.fly(3002, flights.LAYOUTS["airspeed, 10 Hz"], "none")
    controls = flight.samples.kind == Kind.CONTROLS
    values = flight.samples.values.copy()
    values[controls, 2] = 1e-4 * np.sin(np.arange(controls.sum()))  # the rudder moves by nothing that counts
    still = replace(flight.samples, values=values)
    advice = report_json(failures_of(flight.aircraft, still), [])["advice"]
    assert "none was seen to fail: elevator" in advice and "would not be seen" in advice
    assert "cannot show whether" in advice and "rudder" in advice.partition("cannot show whether")[2]


@pytest.mark.long
def test_the_answer_needs_airspeed_or_the_choice_of_calm_air(stuck) -> None:
    with pytest.raises(InputError, match="--calm-air"):
        answer(stuck.aircraft, stuck.samples)
    said = answer(stuck.aircraft, stuck.samples, calm_air=True)
    assert said["candidates"][0]["input"] == "elevon_left"
    assert any("taken as calm" in note for note in said["notes"])


def written(path: Path, flight) -> Path:
    """The run of a flight."""
    pipeline = Pipeline(flight.aircraft)
    with RunWriter(path, flight.aircraft) as writer:
        for rows, points in (pipeline.push(flight.samples), pipeline.flush()):
            writer.add_rows(rows)
            writer.add_points(points)
        writer.add_samples(flight.samples)
        writer.finish(pipeline.state, pipeline.parameters, pipeline.state.flight_time, time.perf_counter())
    return path


@pytest.fixture(scope="module")
def run_without_vanes(engine, tmp_path_factory):
    """A run of the flight whose engine fails, of which no coefficient can be fitted."""
    return written(tmp_path_factory.mktemp("runs") / "engine", engine)


@pytest.mark.long
def test_what_forces_alone_have_found_is_added_and_taken_back(run_without_vanes, engine, engine_report) -> None:
    (found,) = engine_report.found
    added = add(run_without_vanes, "loss_of_thrust")
    assert {a: (e["error_before"], e["error_after"]) for a, e in added.axes.items()} == dict(found.errors)
    assert added.improved and "falls from" in added.verdict and "by the balance of forces" in added.verdict
    run = open_run(run_without_vanes)
    said = diagnose_run(run.path)[0]
    assert said["verdict"] == "none" and "already says that engine failed" in said["advice"], "the model has it now"
    begin = float(re.search(r"time-([\d.]+)", added.change.terms["CX"][-1]).group(1))
    since = begin + (run.zero - run.samples.stamp[run.samples.kind == Kind.IMU].min()) * 1e-9
    assert since == pytest.approx(found.begin, abs=0.01) and since == pytest.approx(engine.begin, abs=2.0)
    listed = json.loads((run_without_vanes / "models" / added.version.identifier / "parameters.json").read_text())
    assert {p["status"] for p in listed["parameters"]} == {"HOLD"} and "10 Hz" in listed["parameters"][0]["reason"]
    with pytest.raises(InputError, match="in the model already"):
        add(run_without_vanes, "loss_of_thrust")
    removed = remove(run_without_vanes, "loss_of_thrust")
    assert removed.axes["CX"]["error_after"] == added.axes["CX"]["error_before"] and not removed.improved
    assert open_run(run_without_vanes).current.changes == {}


@pytest.mark.long
def test_what_the_model_has_failed_is_not_called_sound(engine, engine_report) -> None:
    report = engine_report
    (found,) = report.found
    known = with_terms(engine.aircraft, {a: tuple(t) for a, t in terms_of(found, report).items()}, {})
    said = report_json(failures_of(known, engine.samples), [])
    assert said["verdict"] == "none" and "The model already says that engine failed" in said["advice"]
    assert headline(said) == "no input has stopped acting, nothing else was checked"


@pytest.mark.long
def test_nothing_is_added_by_forces_where_diagnose_would_say_nothing(stuck, tmp_path) -> None:
    written(tmp_path / "run", stuck)
    with pytest.raises(InputError, match="replay it with --calm-air"):
        add(tmp_path / "run", "stuck_control")
    assert not (tmp_path / "run" / "models").exists()


@pytest.mark.long
def test_a_wind_contradicts_calm_air(stuck, engine) -> None:
    assert "wind of" in contradicted_calm(stuck.samples, stuck.aircraft.minimum_airspeed)
    assert contradicted_calm(engine.samples, engine.aircraft.minimum_airspeed) == "", "its airspeed is measured"


@pytest.mark.parametrize(
    ("axis", "evidence", "made", "since", "came"),
    [
        ("Cn", 90.0, 5.0, 60.0, True),
        ("Cn", 20.0, 5.0, 60.0, False),  # no evidence
        ("Cn", 90.0, 80.0, 60.0, False),  # the aileron makes it
        ("Cn", 90.0, 5.0, 95.0, False),  # at another time
        ("Cn", 90.0, 5.0, 0.0, False),  # all the time: the model lacks it
        ("Cm", 90.0, 5.0, 60.0, False),  # no moment of a rudder
    ],
)
def test_an_aileron_is_not_stuck_where_something_yaws_at_the_same_time(axis, evidence, made, since, came):
    """A rudder that stood aside, against which ailerons held the bank, had been one."""
    seconds = np.arange(0.0, 100.0, 0.1)
    failure = SimpleNamespace(
        name="da", main_axis="Cl", gains={"Cl": 210.0, "Cn": made}, times=(Times(60.0, 80.0, 0.5, 0.5),)
    )
    form = SimpleNamespace(balance=SimpleNamespace(time=seconds), search=SimpleNamespace(count=len(seconds)))
    there = (seconds >= since) & (seconds <= 82.0) if since else np.full(len(seconds), True)
    hypothesis = SimpleNamespace(share=lambda count: there.astype(float))
    constant = SimpleNamespace(main_axis=axis, evidence=evidence, gains={axis: 95.0}, hypothesis=hypothesis)
    assert found_failures._came_with(failure, form, constant) is came
    failure.name = "dr"  # of a rudder nothing of this is known
    assert not found_failures._came_with(failure, form, constant)
