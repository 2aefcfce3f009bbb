"""A sensor that is wired wrongly is named in flight, and nothing that follows from it is USE."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight.delay_notes import delay_notes
from aircraft_sysid_ros.aircraft.atmosphere import air_density
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.flight_check.in_flight import InFlightCheck
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import CONTRADICTED, StateField, contradiction_text
from aircraft_sysid_ros.samples import Kind, Samples, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from flight_check import scaled
from miswired import FAULTS

NUMBER = {name: code for code, name in CONTRADICTED.items()}


@pytest.fixture(scope="module")
def clean():
    """65 s in light turbulence and wind, without an attitude."""
    return simulate_samples(default_aircraft(), 63, 65.0, turbulence="light").samples


def flown(samples, block=1000, aircraft=None):
    pipeline, rows = Pipeline(aircraft or default_aircraft()), []
    for i in range(0, len(samples), block):
        rows.append(pipeline.push(samples[i : i + block])[0])
    rows.append(pipeline.flush()[0])
    return pipeline, np.vstack(rows)


def used(pipeline):
    return [p.name for p in pipeline.parameters.snapshot().parameters if p.status is Trust.USE]


@pytest.mark.long
def test_a_clean_flight_is_not_contradicted_and_not_asked_again(clean):
    pipeline, rows = flown(clean)
    assert pipeline.check.findings == ()
    assert np.all(rows[:, StateField.CONTRADICTION] == 0.0)
    assert used(pipeline)
    assert not pipeline.check._waiting


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "sensor"),
    [
        ("angle of attack upside down", "angle of attack"), ("sideslip upside down", "sideslip"),
        ("angle of attack in degrees", "angle of attack"), ("gyros in deg/s", "gyros"),
    ],
)  # fmt: skip
def test_what_is_wired_wrongly_is_named_within_a_minute_and_nothing_is_used(clean, fault, sensor):
    pipeline, rows = flown(FAULTS[fault][0](clean))
    contradicted = rows[rows[:, StateField.CONTRADICTION] == NUMBER[sensor], StateField.TIME]
    assert contradicted[0] - rows[0, StateField.TIME] <= 60.0
    assert rows[-1, StateField.CONTRADICTION] == NUMBER[sensor]
    assert used(pipeline) == []
    assert any("reverse it" in words or "divide it by 57.2958" in words for words in pipeline.check.words)


@pytest.mark.long
@pytest.mark.parametrize("rate", [1, 4])
def test_an_imu_that_is_late_is_named_and_not_the_surfaces_and_nothing_is_used(clean, rate):
    """By 0.1 s: in a flight by others a third of what the aileron does had been used, with a note about servos."""
    late = Samples(clean.stamp + 100_000_000 * (clean.kind == Kind.IMU), clean.kind, clean.values)
    imu = np.flatnonzero(late.kind == Kind.IMU)
    late = late[np.setdiff1d(np.arange(len(late)), imu[np.arange(len(imu)) % rate != 0])]
    pipeline, rows = flown(late[np.argsort(late.stamp, kind="stable")])
    (words,) = pipeline.check.words
    said = re.search(r"it comes ([\d.]+) s \(± ([\d.]+)\) later than ", words)
    assert words.startswith("specific_force.{x,y,z}, angular_velocity.{x,y,z}: ") and said
    assert float(said[1]) == pytest.approx(0.1, abs=float(said[2]) + 0.01)
    text = contradiction_text(int(rows[-1, StateField.CONTRADICTION]))
    assert text == "sign, unit, axes, place or time of the accelerometers contradict the other sensors"
    assert used(pipeline) == []
    assert pipeline.check.has_late_imu and pipeline.parameters.learning.late_surfaces == {}
    pipeline.parameters.learning.imu_is_late = True
    assert delay_notes(pipeline.parameters) == []


@pytest.mark.long
@pytest.mark.parametrize("kinds", [(Kind.GPS_POSITION, Kind.GPS_VELOCITY), (Kind.CONTROLS,)])
def test_what_others_are_late_by_is_not_laid_to_the_imu(clean, kinds):
    late = Samples(clean.stamp + 100_000_000 * np.isin(clean.kind, kinds), clean.kind, clean.values)
    pipeline, rows = flown(late[np.argsort(late.stamp, kind="stable")])
    assert not pipeline.check.has_late_imu
    assert not np.isin(rows[:, StateField.CONTRADICTION], list(CONTRADICTED)).any()


@pytest.mark.long
def test_a_vane_out_on_the_wing_that_the_file_does_not_mention_is_named_and_nothing_is_used(clean):
    """It is 0.4 m to the right; what depends on the angle of attack came out a fifth too small, with USE."""
    known = default_aircraft().source
    silent = aircraft_from_dict({key: value for key, value in known.items() if key != "air_data_position"})
    pipeline, rows = flown(clean, aircraft=silent)
    assert rows[-1, StateField.CONTRADICTION] == NUMBER["angle of attack"]
    assert used(pipeline) == []
    (words,) = pipeline.check.words
    assert "does not say where it is: set air_data_position: [null, " in words
    assert pipeline.check.vane_place == pytest.approx((0.4, 0.04), abs=0.03)  # a tenth: vanes have a lag
    place, error = map(float, re.search(r"moves like one ([\d.]+) ± ([\d.]+) m to the right", words).groups())
    assert abs(place - 0.4) < 4.0 * error < 0.4


@pytest.mark.long
def test_the_reason_of_a_parameter_names_the_sensor(clean):
    pipeline, _ = flown(FAULTS["sideslip upside down"][0](clean))
    reasons = {p.reason for p in pipeline.parameters.snapshot().parameters}
    assert any(contradiction_text(NUMBER["sideslip"]) in reason for reason in reasons)


@pytest.mark.long
@pytest.mark.parametrize("block", [137, pytest.param(1000, marks=pytest.mark.long)])
def test_a_density_that_leaves_its_height_is_told_while_it_does_and_nothing_is_used(clean, block):
    """A static port that is blocked or leaks: all coefficients are off by the same factor, and nothing else tells."""
    values, since = clean.values.copy(), (clean.stamp - clean.stamp[0]) * 1e-9
    wrong = (clean.kind == Kind.AIR) & (since > 40.0) & (since < 55.0)
    values[wrong, :2] *= 0.75
    samples = Samples(clean.stamp, clean.kind, values)
    pipeline, rows = flown(samples[since < 54.0], block)
    time = rows[:, StateField.TIME] - rows[0, StateField.TIME]
    marked = rows[:, StateField.CONTRADICTION] == NUMBER["static pressure"]
    assert not marked[time < 38.0].any() and marked[time > 42.0].all()
    assert used(pipeline) == []
    assert any("static pressure" in p.reason for p in pipeline.parameters.snapshot().parameters)
    _, rows = flown(samples, block)
    time = rows[:, StateField.TIME] - rows[0, StateField.TIME]
    assert np.all(rows[time > 57.0, StateField.CONTRADICTION] == 0.0)


def test_a_climb_of_three_kilometres_on_a_hot_day_changes_no_density():
    rows = np.full((3000, StateField.WIDTH), np.nan)
    rows[:, StateField.TIME] = 0.005 * np.arange(3000)  # the laws of motion are not asked yet
    height = 400.0 + np.arange(3000.0)
    rows[:, StateField.ORIGIN], rows[:, StateField.POSITION] = 400.0, 0.0
    rows[:, StateField.POSITION.stop - 1] = 400.0 - height
    # hydrostatic, 20 K above the standard at the ground and 3 K below it at the top
    temperature = 288.15 - 0.0065 * height + np.linspace(20.0, -3.0, 3000)
    pressure = 96_000.0 * np.exp(-np.concatenate([[0.0], np.cumsum(9.80665 / (287.05 * temperature[1:]))]))
    rows[:, StateField.AIR_DENSITY] = pressure / (287.05 * temperature)
    rows[:, StateField.AIRSPEED], rows[:, StateField.STATUS], rows[:, StateField.CONTRADICTION] = 60.0, 1.0, 0.0
    check = InFlightCheck(10.0)
    check.mark(rows, 0)
    assert np.all(rows[:, StateField.CONTRADICTION] == 0.0)
    rows[2000:, StateField.AIR_DENSITY] *= 0.7
    check.mark(rows, 0)
    assert np.all(rows[2000:, StateField.CONTRADICTION] == NUMBER["static pressure"])


def test_a_density_that_comes_after_the_begin_of_the_flight_is_that_of_the_day():
    """A recording that begins in the air, at a place that is far from the standard atmosphere's sea level."""
    rows = np.full((400, StateField.WIDTH), np.nan)
    rows[:, StateField.TIME] = 0.05 * np.arange(400)
    rows[:, StateField.ORIGIN], rows[:, StateField.POSITION] = 0.0, 0.0
    rows[:, StateField.POSITION.stop - 1] = -5.0 * np.sin(rows[:, StateField.TIME])
    rows[:, StateField.AIR_DENSITY] = [air_density(-down) for down in rows[:, StateField.POSITION.stop - 1]]
    rows[7:, StateField.AIR_DENSITY] *= 0.889
    rows[:, StateField.AIRSPEED], rows[:, StateField.STATUS], rows[:, StateField.CONTRADICTION] = 60.0, 1.0, 0.0
    check = InFlightCheck(10.0)
    for part in np.split(rows, [3, 11, 50]):
        check.mark(part, 0)
    assert np.all(rows[:, StateField.CONTRADICTION] == 0.0)


@pytest.mark.long
@pytest.mark.parametrize("signal", ["elevator", "throttle"])
def test_controls_of_another_unit_are_not_learnt_from(clean, signal):
    pipeline, _ = flown(scaled(signal, 100.0)(clean))
    assert used(pipeline) == []
    assert any(f"values of the {signal} cannot be in" in p.reason for p in pipeline.parameters.snapshot().parameters)


@pytest.mark.long
def test_a_control_that_was_garbled_now_and_then_is_no_other_unit(clean):
    values, chosen = clean.values.copy(), np.flatnonzero(clean.kind == Kind.CONTROLS)
    values[chosen[::400], 0] = 90.0  # one in eight seconds
    pipeline, _ = flown(Samples(clean.stamp, clean.kind, values))
    assert used(pipeline)


@pytest.mark.long
def test_what_is_found_does_not_depend_on_how_samples_come_together(clean):
    samples = FAULTS["angle of attack in degrees"][0](clean)
    samples = samples[samples.stamp < samples.stamp[0] + 35 * 10**9]
    together, one_by_one = flown(samples, 3000)[1], flown(samples, 61)[1]
    assert together[-1, StateField.CONTRADICTION] > 0.0
    assert np.array_equal(together, one_by_one, equal_nan=True)


@pytest.mark.long
def test_the_check_survives_a_clock_that_begins_anew(clean):
    samples = FAULTS["sideslip upside down"][0](clean)
    half = samples.stamp[0] + 33 * 10**9
    again = Samples(samples.stamp - np.where(samples.stamp > half, 10**12, 0), samples.kind, samples.values)
    pipeline, rows = flown(again)
    assert rows[-1, StateField.CONTRADICTION] == NUMBER["sideslip"]
    assert used(pipeline) == []


def test_what_stands_on_the_ground_is_not_judged():
    check, epoch = InFlightCheck(10.0), 0
    rows = np.zeros((100, StateField.WIDTH))
    rows[:, StateField.AIRSPEED] = 2.0
    imu = np.tile([0.0, 0.0, -9.8, 0.0, 0.0, 0.0], (100, 1))
    for second in range(90):
        rows[:, StateField.TIME] = second + 0.01 * np.arange(100)
        stamps = np.rint(1e9 * rows[:, StateField.TIME])
        check.add(samples_of(Kind.IMU, stamps, imu))
        check.add(samples_of(Kind.AIRSPEED, stamps, np.full(100, 2.0)))
        check.add(samples_of(Kind.GPS_VELOCITY, stamps, np.full((100, 3), 0.05)))
        check.mark(rows, epoch)
    assert check.findings == ()
    assert sum(len(samples) for samples in check._waiting) < 1000  # nothing is kept for a flight that may never come


def test_a_manoeuvre_long_after_is_in_another_wind(aircraft, monkeypatch):
    """One wind was looked for in test points half an hour apart: a pitot that was right read 0.81 of what it should."""
    pipeline, begun = Pipeline(aircraft), []
    monkeypatch.setattr(pipeline.check._triangle, "restart", lambda: begun.append(1))
    pipeline.begin_anew(20.0)
    assert not begun
    pipeline.begin_anew(1700.0)
    pipeline.begin_anew(np.nan)
    assert len(begun) == 2
