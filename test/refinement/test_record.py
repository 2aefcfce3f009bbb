"""The record of a flight against the truth of its simulation."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_model.layout import CONTROL_COUNT, CONTROLS, INPUT_SIZE
from aircraft_sysid_ros.identification.model_change import with_terms
from aircraft_sysid_ros.refinement.record import record_of
from aircraft_sysid_ros.refinement.resampling import cubic
from aircraft_sysid_ros.refinement.segments import Segment, segments_of
from aircraft_sysid_ros.samples import CONTROL_COLUMNS, Kind, joined
from aircraft_sysid_ros.sensors.sensor_models import air_data_at, specific_force_at


@pytest.fixture(scope="module")
def record(still_flight, still_run):
    return record_of(still_flight.aircraft, still_run.samples, 50.0)


def truth_at(flight, record, shift=0.0):
    begin = int(flight.biases.stamp[0])
    return flight.truth.at((record.stamp - begin) * 1e-9 + shift)


@pytest.mark.long
def test_outputs_are_those_of_the_truth_at_the_grid(still_flight, record):
    """Means over the flight: any delay of 2 ms, or a sample put at a wrong time, would stand out of the noise."""
    inside = slice(100, -100)
    truth, aircraft = truth_at(still_flight, record), still_flight.aircraft
    biases = still_flight.biases
    expected = np.column_stack(
        [
            specific_force_at(truth, aircraft.imu_position) + biases.accelerometer[0],
            truth.rates + biases.gyro[0],
        ]
    )
    error = (record.outputs[:, :6] - expected)[inside]
    noise = record.model.output_std[:6]
    assert np.all(np.std(error, axis=0) < 1.15 * noise)
    air = record.outputs[inside, 15:18] - air_data_at(truth, aircraft.air_data_position)[inside]
    assert np.all(np.nanstd(air, axis=0) < 1.15 * record.model.output_std[15:18])
    assert np.mean(np.isfinite(air)) > 0.95
    assert np.nanmean(np.isfinite(record.outputs[inside, 6])) == pytest.approx(0.1, abs=0.01)  # GPS: 5 Hz
    assert not record.measured[12:15].any()  # neither attitude nor magnetometer in this flight


@pytest.mark.long
def test_inputs_are_those_of_the_truth_at_both_ends_and_in_the_middle(still_flight, record):
    inside, surfaces = slice(100, -100), slice(0, 3)
    truth, middle = truth_at(still_flight, record), truth_at(still_flight, record, -0.01)
    noise = still_flight.aircraft.sensors["control_surfaces"].noise[0]
    for inputs, real in (
        (record.inputs[:, CONTROLS], truth.controls),
        (record.inputs[:, INPUT_SIZE : INPUT_SIZE + CONTROL_COUNT], middle.controls),
    ):
        error = (inputs - real)[inside, surfaces]
        assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 1.3 * noise)
    np.testing.assert_allclose(record.inputs[inside, 7], truth.density[inside], rtol=2e-3)


def test_cubic_interpolation_keeps_what_a_straight_line_takes_away():
    times = np.arange(0.0, 2.0, 0.02)
    at = times[5:-5] + 0.01
    values = np.sin(10.0 * times)[:, None]
    exact = np.sin(10.0 * at)
    assert np.abs(cubic(times, values, at, 0.2)[:, 0] - exact).max() < 1e-4
    assert np.abs(0.5 * (values[5:-5, 0] + values[6:-4, 0]) - exact).max() > 4e-3
    gap = np.delete(np.arange(len(times)), np.arange(40, 60))
    inside = cubic(times[gap], values[gap], times[[45, 50]], 0.2)[:, 0]
    assert inside[0] == values[39, 0] and np.isnan(inside[1])  # held for a while, and no cubic over a gap
    assert np.isnan(cubic(times[:3], values[:3], np.array([5.0]), 0.2)[0, 0])


def test_sensor_delays_are_taken_out(still_flight, still_run, record):
    aircraft, samples = still_flight.aircraft, still_run.samples
    vane = samples.kind == Kind.ANGLE_OF_ATTACK
    later = replace(samples, stamp=np.where(vane, samples.stamp + 50_000_000, samples.stamp))
    sensors = {**aircraft.sensors, "angle_of_attack": replace(aircraft.sensors["angle_of_attack"], delay=0.05)}
    moved = record_of(replace(aircraft, sensors=sensors), later, 50.0)
    inside = slice(200, 1200)
    np.testing.assert_allclose(moved.outputs[inside, 16], record.outputs[inside, 16], atol=1e-3)


def test_segments_cover_the_flight_and_do_not_cross_gaps(record):
    pieces = segments_of(record, 8.0, 2.0)
    fitted = [p.part for p in pieces if not p.held_out]
    held = [p.part for p in pieces if p.held_out]
    assert len(fitted) == 3 and len(held) == 2
    assert sum(p.stop - p.start for p in fitted + held) == pytest.approx(record.in_flight.sum(), abs=2)
    ordered = sorted(fitted + held, key=lambda p: p.start)
    assert all(a.stop <= b.start for a, b in pairwise(ordered))
    time = record.time.copy()
    time[1000:] += 3.0
    broken = segments_of(replace(record, time=time), 8.0, 2.0)
    assert not any(p.part.start < 1000 < p.part.stop for p in broken)
    grounded = replace(record, in_flight=np.zeros(len(time), np.bool_))
    assert segments_of(grounded, 8.0, 2.0) == []
    assert isinstance(pieces[0], Segment)


@pytest.mark.long
def test_magnetometer_and_attitude_become_rotation_vectors(aircraft):
    from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

    for options, columns in ((SensorOptions(magnetometer=True), [14]), (SensorOptions(attitude=True), [12, 13, 14])):
        flight = simulate_samples(aircraft, seed=1, duration=20.0, sensors=options)
        record = record_of(aircraft, flight.samples, 50.0)
        there = np.flatnonzero(np.any(np.isfinite(record.outputs[:, 12:15]), axis=0)) + 12
        assert there.tolist() == columns
        assert np.all(np.nanstd(record.outputs[400:, there], axis=0) < 0.08)


def test_a_single_wild_value_is_left_out(still_flight, still_run, record):
    samples = still_run.samples
    values = samples.values.copy()
    at = np.flatnonzero(samples.kind == Kind.ANGLE_OF_ATTACK)[800]
    values[at, 0] += 1.0
    wild = record_of(still_flight.aircraft, replace(samples, values=values), 50.0)
    assert np.nanmax(np.abs(wild.outputs[:, 16] - record.outputs[:, 16])) < 0.05


def test_positions_go_on_after_a_moment_without_a_fix(still_flight, still_run, record):
    """A fix that is none costs its own output, and not the positions of all that follow."""
    samples = still_run.samples
    values = samples.values.copy()
    at = np.flatnonzero(samples.kind == Kind.GPS_POSITION)
    values[at[40:43], :3] = np.nan
    lacking = record_of(still_flight.aircraft, replace(samples, values=values), 50.0)
    there, whole = (np.isfinite(r.outputs[:, 6:9]).all(axis=1) for r in (lacking, record))
    assert whole.sum() - there.sum() == 3
    both = there & whole
    np.testing.assert_allclose(lacking.outputs[both, 6:9], record.outputs[both, 6:9], atol=0.05)


def test_a_control_that_no_term_reads_may_come_and_go(still_flight):
    """A tachometer that falls silent for a second, beside surfaces that do not, left no flight to refine."""
    begin = still_flight.samples.stamp[0]
    samples = still_flight.samples[still_flight.samples.stamp < begin + 12 * 10**9]
    aircraft, values = still_flight.aircraft, samples.values.copy()
    controls = np.flatnonzero(samples.kind == Kind.CONTROLS)
    silent = controls[(samples.stamp[controls] - begin) // 10**9 % 2 == 1]
    values[silent, CONTROL_COLUMNS.index("propeller_speed")] = np.nan
    whole, found = (record_of(aircraft, s, 50.0) for s in (samples, replace(samples, values=values)))
    np.testing.assert_array_equal(found.in_flight, whole.in_flight)
    read = with_terms(aircraft, {"Cl": ("propeller_speed",)}, {})
    assert record_of(read, replace(samples, values=values), 50.0).in_flight.sum() < 0.7 * whole.in_flight.sum()


def test_flights_whose_imus_have_other_rates_are_both_in_the_record(still_flight):
    """Of two flights that were joined the one with the slower IMU was taken for gaps, and was lost without a word."""
    samples = still_flight.samples
    since = (samples.stamp - samples.stamp[0]) * 1e-9
    imu = np.flatnonzero(samples.kind == Kind.IMU)
    thin = np.ones(len(samples), np.bool_)
    thin[imu[1::2]] = False
    body, shifts = joined([samples[since < 9.0], samples[(since >= 9.0) & (since < 18.0) & thin]])
    record = record_of(still_flight.aircraft, body, 50.0)
    is_second = record.stamp > samples.stamp[0] + 9 * 10**9 + shifts[1]
    assert is_second[record.in_flight].sum() > 0.4 * record.in_flight.sum()
    assert np.median(np.diff(record.time[is_second])) == pytest.approx(0.02, rel=0.01)
    alone = record_of(still_flight.aircraft, samples[since < 18.0], 50.0)
    same = slice(200, 400)  # whatever is joined to it, the first flight is as it is alone
    np.testing.assert_allclose(record.outputs[same, :6], alone.outputs[same, :6], atol=1e-9)


def test_samples_without_a_flight_are_refused(still_flight, still_run):
    with pytest.raises(InputError, match="no state"):
        record_of(still_flight.aircraft, still_run.samples[:10], 50.0)


def test_stated_errors_of_the_air_data_are_taken_off(still_flight):
    """A vane that shows too little and aside, an airspeed that drifts: with a file that says so, the same outputs."""
    begin, end = still_flight.samples.stamp[[0, -1]]
    samples = still_flight.samples[still_flight.samples.stamp < begin + (end - begin) // 3]
    aircraft = still_flight.aircraft
    right = record_of(aircraft, samples, 50.0)
    since, values = right.time[0], samples.values.copy()
    times = (samples.stamp - right.stamp[0]) * 1e-9
    vane, speed = samples.kind == Kind.ANGLE_OF_ATTACK, samples.kind == Kind.AIRSPEED
    values[vane, 0] = 0.85 * (values[vane, 0] + 0.03)
    values[speed, 0] *= 1.1 * (1.0 + 0.01 * np.maximum(times[speed], 0.0))
    stated = {("angle_of_attack", "scale"): 0.85, ("angle_of_attack", "offset"): 0.03, ("airspeed", "scale"): 1.1}
    for (name, _), value in list(stated.items())[::2]:
        stated[name, "noise"] = value * aircraft.sensors[name].noise[0]
    for key, value in {**stated, ("airspeed", "drift"): 0.01}.items():
        aircraft = with_setting(aircraft, ("sensors", *key), value)
    found = record_of(aircraft, replace(samples, values=values), 50.0)
    np.testing.assert_allclose(found.outputs, right.outputs, rtol=1e-4, atol=2e-5)
    assert since == found.time[0]


def test_signals_of_the_reference_motion_have_the_rates_of_the_flow_angles(still_flight):
    """What a term in alpha_dot does is known before the fit: its steps were a thousand million times too large."""
    begin = still_flight.samples.stamp[0]
    samples = still_flight.samples[still_flight.samples.stamp < begin + 12 * 10**9]
    record = record_of(with_terms(still_flight.aircraft, {"Cm": ("alpha_dot",)}, {}), samples, 50.0)
    signals, inside = record.signals(), slice(50, -50)
    chord = still_flight.aircraft.chord
    rate = np.gradient(signals[:, SIGNAL_INDEX["alpha"]], record.time) * chord / signals[:, SIGNAL_INDEX["V"]]
    found = signals[inside, SIGNAL_INDEX["alpha_dot"]]
    assert np.sqrt(np.mean((found - rate[inside]) ** 2)) < 0.3 * np.std(rate[inside])
