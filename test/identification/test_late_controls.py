"""Controls that arrive late: within the horizon they count at their own time, later they are counted, in any blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


@pytest.fixture(scope="module")
def flight(aircraft):
    samples = simulate_samples(aircraft, seed=3, duration=20.0).samples
    return samples[: 2 * len(samples) // 5]


def with_late_controls(samples, lateness: float, kind=Kind.CONTROLS):
    """Every fortieth sample of the controls, or another kind, arrives later [s]; also how many are late."""
    controls = np.flatnonzero(samples.kind == kind)
    chosen = controls[(np.arange(len(controls)) % 40 == 7) & (controls < 0.7 * len(samples))]
    arrival = samples.stamp.copy()
    arrival[chosen] += round(lateness * 1e9)
    return samples[np.argsort(arrival, kind="stable")], len(chosen)


def flown(aircraft, samples, block: int):
    pipeline = Pipeline(aircraft)
    points = [pipeline.push(samples[at : at + block])[1] for at in range(0, len(samples), block)]
    points.append(pipeline.flush()[1])
    return np.vstack(points), pipeline.parameters.late


@pytest.mark.long
@pytest.mark.parametrize("lateness", [0.75, *(pytest.param(late, marks=pytest.mark.long) for late in (0.4, 1.5, 4.0))])
def test_blocks_of_any_size_give_the_same(aircraft, flight, lateness) -> None:
    samples, count = with_late_controls(flight, lateness)
    points, late = flown(aircraft, samples, 1)
    for block in (37, 1000, len(samples)):
        others, counted = flown(aircraft, samples, block)
        assert counted == late
        np.testing.assert_array_equal(others, points)
    if lateness > 1.0:
        assert late == count
    if lateness < 0.5:
        assert late == 0


def test_within_the_horizon_it_makes_no_difference(aircraft, flight) -> None:
    on_time, late = flown(aircraft, flight, 500)
    again, _ = flown(aircraft, with_late_controls(flight, 0.4)[0], 500)
    assert late == 0
    np.testing.assert_array_equal(again, on_time)


def test_late_vanes_are_counted_by_both_steps(aircraft, flight) -> None:
    samples, count = with_late_controls(flight, 1.5, Kind.ANGLE_OF_ATTACK)
    pipeline = Pipeline(aircraft)
    pipeline.push(samples)
    pipeline.flush()
    of_first_step = pipeline.state.counts()["angle_of_attack"]["late"]
    assert (pipeline.parameters.late, pipeline.parameters.late_vanes, of_first_step) == (0, count, count)


def test_controls_by_another_clock_are_said_to_be(aircraft, flight) -> None:
    """Stamps that a driver left at 0: "not measured: record them", and a longer horizon was to wait for them."""
    stamp = np.where(flight.kind == Kind.CONTROLS, 0, flight.stamp)
    pipeline = Pipeline(aircraft)
    for at in range(0, len(flight), 500):
        pipeline.push(replace(flight, stamp=stamp)[at : at + 500])
    pipeline.flush()
    reasons = {p.name: p.reason for p in pipeline.parameters.snapshot().parameters}
    assert "needs de, whose stamps are" in reasons["Cm_de"] and "stamp all by one clock" in reasons["Cm_de"]
    assert pipeline.parameters.stream.controls.pace.behind > 1e6


def test_controls_that_all_come_too_late_are_said_to_come(aircraft, flight) -> None:
    """Three seconds behind the IMU they were "not measured: record it"."""
    behind = flight.stamp - np.where(flight.kind == Kind.CONTROLS, 3 * 10**9, 0)
    pipeline = Pipeline(aircraft)
    for at in range(0, len(flight), 500):
        pipeline.push(replace(flight, stamp=behind)[at : at + 500])
    pipeline.flush()
    reasons = {p.name: p.reason for p in pipeline.parameters.snapshot().parameters}
    assert "needs de, whose samples come" in reasons["Cm_de"] and "too late to be used" in reasons["Cm_de"]
    waited = 3.0 - pipeline.state.options.horizon - pipeline.parameters.options.settle
    assert pipeline.parameters.stream.controls.pace.behind == pytest.approx(waited, abs=0.05)


def test_a_flight_that_came_twice_is_the_flight(aircraft, flight) -> None:
    """Every measurement counted as two: standard errors were too small by up to the root of that."""
    twice = flight[np.repeat(np.arange(len(flight)), 2)]
    points, _ = flown(aircraft, flight, 500)
    np.testing.assert_array_equal(flown(aircraft, twice, 500)[0], points)
