"""Airspeed against GPS and wind: flights of a point that turns in a wind, without anything of the program in them.

The last one is simulated, and goes through the whole chain.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight.replay_notes import sensor_findings
from aircraft_sysid_ros.flight_check.finding import ERROR, WARNING
from aircraft_sysid_ros.flight_check.in_flight import InFlightCheck
from aircraft_sysid_ros.flight_check.wind_triangle import SURE, TOLERANCE, WindTriangle, scale_of
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import CONTRADICTED, StateField, Status
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from fault_kinds import KINDS
from turning_point import SECOND, START, flown

AIRSPEED_CODE = next(code for code, sensor in CONTRADICTED.items() if sensor == "airspeed")


def watched(samples, minimum_airspeed=8.0):
    triangle, worst = WindTriangle(minimum_airspeed), -np.inf
    triangle.add(samples)
    for stamp in range(int(samples.stamp[0]), int(samples.stamp[-1]), SECOND):
        triangle.advance(stamp)
        if triangle.newest:
            (low, low_std, _), (high, high_std, _) = triangle.newest
            worst = max(worst, (low - 1.0 - TOLERANCE) / low_std, (1.0 - TOLERANCE - high) / high_std)
    return triangle, worst


@pytest.mark.parametrize("flight", [{}, {"gust": 2.0}, {"climb": 2.0}, {"front": 5.0}, {"turn": 0.0, "front": 5.0}])
def test_a_sound_airspeed_is_not_named_in_any_wind(flight):
    for seed in range(2):
        triangle, worst = watched(flown(seed, **flight))
        assert worst < SURE - 1.0 and triangle.findings == ()


def landing(seed):
    """Circles at 15 m/s in a north wind of 6 m/s, then straight into it and a landing as of a stranger's trainer.

    Within twenty seconds 14 m/s through the air and 8.5 over ground became 3 and 1: "it reads 1.67 ± 0.13".
    """
    rng, time = np.random.default_rng(seed), np.arange(0.0, 260.0, 0.05)
    heading = np.where(time < 190.0, 2.0 * np.pi * time / 38.0, 0.0)
    slow = np.convolve(rng.normal(size=len(time) + 59), np.ones(60) / 7.7, "valid")
    at = [0.0, 200.0, 204.0, 208.0, 212.0, 216.0, 220.0]
    ground = np.interp(time, at, [9.0, 9.0, 8.5, 8.1, 7.1, 4.8, 0.5])
    through = np.interp(time, at, [15.0, 15.0, 14.1, 12.4, 9.5, 7.3, 2.5])
    flies = time < 200.0
    north = np.where(flies, 15.0 * np.cos(heading) - 6.0, ground)
    east = np.where(flies, 15.0 * np.sin(heading), 0.0)
    shown = np.where(flies, 15.0, through) + 0.3 * slow + 0.3 * rng.normal(size=len(time))
    stamps = START + np.rint(time * SECOND).astype(np.int64)
    fixes = np.column_stack([north, east, 0.0 * north])[::4] + 0.1 * rng.normal(size=(len(time[::4]), 3))
    both = concatenate([samples_of(Kind.AIRSPEED, stamps, shown), samples_of(Kind.GPS_VELOCITY, stamps[::4], fixes)])
    return both[np.argsort(both.stamp, kind="stable")]


def test_of_a_landing_into_a_wind_that_is_calmer_at_the_ground_nothing_is_kept():
    for seed in range(3):
        triangle, _ = watched(landing(seed), minimum_airspeed=6.0)
        triangle.finish()
        assert triangle.findings == ()
        assert triangle._flown[:, 1].min() > 0.7 * 15.0


def test_slow_flight_that_lasts_is_no_landing_and_a_fault_in_it_is_found():
    fast, slow = flown(3, 240.0, speed=25.0), flown(4, 300.0, speed=16.0, scale=lambda t: np.where(t > 120.0, 0.8, 1.0))
    later = replace(slow, stamp=slow.stamp + 240 * SECOND)
    triangle, _ = watched(concatenate([fast, later]), minimum_airspeed=6.0)
    assert triangle.is_wrong and triangle.readings[-1].scale == pytest.approx(0.8, abs=0.08)


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_a_scale_is_found_with_its_time_and_is_over_when_it_is_over(factor):
    samples = flown(5, 420.0, scale=lambda t: np.where((t > 90.0) & (t < 200.0), factor, 1.0))
    on_the_way, _ = watched(samples[samples.stamp < START + 190 * SECOND])
    (reading,) = on_the_way.readings
    assert on_the_way.is_wrong and on_the_way.findings[0].severity == ERROR
    assert reading.scale == pytest.approx(factor, abs=4.0 * reading.std) and reading.std < 0.05
    assert reading.since == pytest.approx(90.0, abs=3.0)
    assert f"it reads {reading.scale:.2f} ± {reading.std:.2f} of what GPS and wind say, since " in (
        on_the_way.findings[0].sentence
    )
    after, _ = watched(samples)
    (reading,) = after.readings
    assert not after.is_wrong and 200.0 < reading.until < 330.0
    assert after.findings[0].severity == WARNING and "it read " in after.findings[0].sentence


@pytest.mark.long
def test_a_scale_from_the_beginning_and_one_that_grows_by_a_per_cent_a_minute():
    always, _ = watched(flown(6, 150.0, scale=lambda t: np.full_like(t, 1.2)))
    assert always.is_wrong and always.readings[0].since == pytest.approx(0.0, abs=1.0)
    icing, _ = watched(flown(7, 1200.0, scale=lambda t: 1.0 - 0.01 * t / 60.0))
    assert icing.is_wrong and 0.8 < icing.readings[0].scale < 1.0 - TOLERANCE


@pytest.mark.parametrize("factor", [0.96, 1.0, 1.04])
def test_an_error_within_the_tolerance_holds_nothing_and_is_told_at_the_end_where_it_is_sure(factor):
    for seed in range(3):
        triangle, _ = watched(flown(seed, scale=lambda t: factor * np.ones_like(t), speed=90.0))
        assert triangle.findings == () and not triangle.is_wrong
        triangle.finish()
        if factor == 1.0:
            assert triangle.findings == ()
            continue
        (finding,) = triangle.findings
        scale, std = (float(word) for word in finding.sentence.split(" of what ")[0].split("reads ")[1].split(" ± "))
        assert finding.severity == WARNING and abs(scale - factor) < 3.0 * std and std < 0.02
        told = float(finding.sentence.split("every coefficient by ")[1].split(" %")[0])
        assert told == pytest.approx(100.0 * abs(factor**-2 - 1.0), abs=2.0)


def test_without_a_turn_nothing_is_said_and_what_is_wrong_is_not_released():
    straight = {"turn": 0.0, "gust": 1.0}
    triangle, _ = watched(flown(8, scale=lambda t: np.where(t > 60.0, 1.2, 1.0), **straight))
    assert triangle.findings == ()
    triangle, _ = watched(flown(9, 150.0, scale=lambda t: np.full_like(t, 0.75)))
    assert triangle.is_wrong
    triangle.restart()
    triangle.add(flown(10, **straight))
    triangle.advance(START + 239 * SECOND)
    assert triangle.is_wrong


@pytest.mark.parametrize("scale", [0.85, 1.0, 1.2])
def test_what_it_may_read_is_wide_in_straight_flight_and_holds_the_truth(scale):
    widths = []
    for turn in (0.0, 10.0):
        triangle, _ = watched(flown(3, scale=lambda t: scale * np.ones_like(t), turn=turn))
        low, high = triangle.reads
        assert low < scale < high
        widths.append(high - low)
    assert widths[0] > 0.3 > widths[1]
    assert WindTriangle(8.0).reads is None


def test_gaps_outliers_and_what_is_no_number_do_no_harm():
    samples = flown(11, scale=lambda t: np.where(t > 60.0, 0.8, 1.0))
    rng = np.random.default_rng(0)
    values = samples.values.copy()
    hit = rng.random(len(samples))
    values[hit < 0.02, 0] = np.nan
    values[(hit > 0.98) & (samples.kind == Kind.AIRSPEED), 0] = 60.0
    values[hit == hit.max()] = 1e30
    time = (samples.stamp - START) / SECOND
    holed = type(samples)(samples.stamp, samples.kind, values)[(time < 70.0) | (time > 100.0)]
    triangle, _ = watched(holed)
    assert triangle.is_wrong and triangle.readings[0].scale == pytest.approx(0.8, abs=0.08)
    leapt = WindTriangle(8.0)
    leapt.add(samples)
    leapt.advance(START + 10**9 * SECOND)  # a stamp of another decade
    assert not leapt.is_wrong


def test_bounds_hold_the_scale_between_them_as_regressions_either_way():
    samples = flown(12, 180.0, scale=lambda t: np.full_like(t, 1.1), gust=2.0)
    triangle, _ = watched(samples)
    (low, low_std, _), (high, high_std, _) = triangle.newest
    assert low - 2.0 * low_std < 1.1 < high + 2.0 * high_std and low < high
    still = np.zeros((60, 6))
    still[:, 0], still[:, 1], still[:, 2] = np.arange(60.0), 20.0, 20.0
    _, std, _ = scale_of(still, False, False)
    assert std > 0.1  # a straight flight at one speed knows nothing


def rows_at(stamps, epoch):
    rows = np.zeros((len(stamps), StateField.WIDTH))
    rows[:, StateField.TIME] = (stamps - epoch) * 1e-9
    rows[:, StateField.AIRSPEED], rows[:, StateField.STATUS] = 18.0, Status.OK
    return rows


@pytest.mark.long
def test_rows_are_marked_in_blocks_of_any_size_alike_and_another_sensor_that_is_known_stands():
    samples = flown(13, scale=lambda t: np.where(t > 60.0, 0.8, 1.0))
    epoch, stamps = START // SECOND * SECOND, START + np.arange(0, 239 * SECOND, SECOND // 10)
    marked = []
    for edges in (range(7, len(stamps), 7), range(1, len(stamps)), [1900]):
        check, parts, before = InFlightCheck(8.0), [], 0
        for block in np.split(stamps, list(edges)):
            upto = int(np.searchsorted(samples.stamp, block[-1], side="right"))
            check.add(samples[before:upto])
            check._over = True
            parts.append(rows_at(block, epoch))
            check.mark(parts[-1], epoch)
            before = upto
        marked.append(np.vstack(parts)[:, StateField.CONTRADICTION])
    assert np.array_equal(marked[0], marked[1]) and np.array_equal(marked[0], marked[2])
    assert marked[0][-1] == AIRSPEED_CODE and marked[0][0] == 0.0
    rows = rows_at(stamps[-2:] + SECOND, epoch)
    rows[:, StateField.CONTRADICTION] = 3.0, 11.0  # attitude, which is known, and innovations of the airspeed
    check.mark(rows, epoch)
    assert rows[:, StateField.CONTRADICTION].tolist() == [3.0, AIRSPEED_CODE]
    assert any("true_airspeed: it reads 0." in words for words in check.words)
    silent = InFlightCheck(8.0, asks_airspeed=False)
    silent.add(samples)
    silent.mark(rows_at(stamps, epoch), epoch)
    assert silent.findings == ()


@pytest.mark.long
def test_nothing_is_used_while_the_airspeed_is_wrong_and_the_reason_names_it():
    flight = simulate_samples(default_aircraft(), 4, 130.0, manoeuvres="calibration").samples
    flight = flight[~np.isin(flight.kind, (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP))]
    wrong = KINDS["airspeed x 1.2"].change(flight, 20.0, 200.0, np.random.default_rng(0))
    said = {}
    for name, samples in (("sound", flight), ("wrong", wrong)):
        pipeline, marked = Pipeline(default_aircraft()), []
        for i in range(0, len(samples), 5000):
            marked.append(pipeline.push(samples[i : i + 5000])[0][:, StateField.CONTRADICTION])
        marked.append(pipeline.flush()[0][:, StateField.CONTRADICTION])
        words, findings = pipeline.check.words, sensor_findings(pipeline)
        said[name] = pipeline.parameters.snapshot().parameters, np.concatenate(marked), words, findings
    parameters, marked, words, findings = said["wrong"]
    assert [(f.signals, f.kind, f.severity) for f in findings] == [(("true_airspeed",), "scale", ERROR)]
    assert said["sound"][3] == []
    assert marked[-1] == AIRSPEED_CODE and any("of what GPS and wind say" in sentence for sentence in words)
    assert not any(p.status is Trust.USE for p in parameters)
    assert any("scale of the airspeed contradict" in p.reason for p in parameters)
    assert not (said["sound"][1] == AIRSPEED_CODE).any() and not any("GPS and wind" in w for w in said["sound"][2])
