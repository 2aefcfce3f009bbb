"""The campaign of benchmarks/faults.py: its faults are what they say, and a small seeded part of it."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import fault_kinds
import faults

BEGIN, END = 8.0, 12.0


@pytest.fixture(scope="module")
def samples(aircraft):
    return simulate_samples(aircraft, seed=3, duration=20.0).samples


def test_there_are_forty_kinds_and_more():
    assert len(fault_kinds.KINDS) > 40
    assert all((kind.change is None) == bool(kind.surface) and kind.names for kind in fault_kinds.KINDS.values())


@pytest.mark.parametrize("name", [name for name, kind in fault_kinds.KINDS.items() if kind.change is not None])
def test_a_fault_changes_the_record_while_it_lasts_and_nothing_else(samples, name):
    found = fault_kinds.KINDS[name].change(samples, BEGIN, END, np.random.default_rng(1))
    begin, end = stamps_of([BEGIN, END])
    late = int(6e8)  # samples that are stamped later than they were measured

    def outside(of):
        rows = (of.stamp < begin) | (of.stamp >= end + late)
        return of[rows]

    before, after = outside(samples), outside(found)
    assert np.array_equal(before.stamp, after.stamp) and np.array_equal(before.kind, after.kind)
    np.testing.assert_array_equal(before.values, after.values)
    same = len(found) == len(samples) and np.array_equal(found.stamp, samples.stamp)
    assert not (same and np.array_equal(found.values, samples.values, equal_nan=True))


def test_a_surface_that_stands_somewhere_pushes_as_it_would_there_and_follows_no_command(aircraft):
    truth = aircraft.coefficients
    pushed = {name: 0.0 for name in truth if name.endswith("_dr")}
    for effect in fault_kinds.effects_of(fault_kinds.KINDS["rudder runs away"], truth, BEGIN, END):
        follows = effect.expression.endswith("*dr")
        expected = -truth[f"{effect.axis}_dr"] if follows else 0.06 * truth[f"{effect.axis}_dr"]
        assert effect.value == pytest.approx(expected)
        pushed[f"{effect.axis}_dr"] += not follows
    assert set(pushed.values()) == {1.0}
    (lost, stands) = fault_kinds.effects_of(fault_kinds.KINDS["engine dead"], truth, BEGIN, END)
    assert (lost.axis, lost.value, stands.value) == ("CX", -truth["CX_Tc"], 0.0)


def test_flights_of_the_results_are_drawn_as_they_were_and_later_ones_from_all_kinds():
    first = {*list(fault_kinds.KINDS)[: fault_kinds.FIRST_KINDS]}
    new = range(fault_kinds.ALL_KINDS_FROM, fault_kinds.ALL_KINDS_FROM + 400)
    old = range(fault_kinds.ALL_KINDS_FROM - 400, fault_kinds.ALL_KINDS_FROM)
    assert {faults.drawn(seed)["fault"] for seed in old} <= first
    assert {faults.drawn(seed)["fault"] for seed in new} - first
    kept = faults.RESULTS.read_text(encoding="utf8").splitlines()[:50]
    for record in (json.loads(line) for line in kept):
        assert not record["faulty"] or faults.drawn(record["seed"])["fault"] == record["fault"]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(9_690_000, 9_690_008))
def test_nothing_breaks(seed):
    """How often something wrong is sure is counted by the benchmark, docs/trust.md."""
    found = faults.fly({"seed": seed, "faulty": True})
    assert "exception" not in found and found["nonfinite"] == 0 and found["used_before"] > 0


def test_what_has_not_been_moved_cannot_be_known(samples):
    lost, other = fault_kinds.KINDS["half the elevator"], fault_kinds.KINDS["alpha stuck"]
    values, stamp = samples.values.copy(), samples.stamp
    controls = samples.kind == faults.Kind.CONTROLS
    values[controls, 0] = np.where((stamp - stamp[0])[controls] > 11e9, 0.05, 0.01)
    still = faults.Samples(stamp, samples.kind, values)
    assert faults.moved_since(still, lost, BEGIN) == pytest.approx(11.0, abs=0.1)
    assert faults.moved_since(still, lost, END) == np.inf
    assert faults.moved_since(still, other, BEGIN) == BEGIN


def test_a_summary_counts_what_was_flown():
    moved = {"faulty": True, "fault": "alpha stuck", "touched": ["Cm_q"], "held": 2.0, "sure_wrong": 0, "nonfinite": 0}
    moved |= {"sure_wrong_at_the_end": 0, "sure_wrong_unmoved": 2, "named": True}
    records = [moved, moved | {"held": None, "sure_wrong": 3}, {"faulty": True, "fault": "GPS lost", "exception": "E"}]
    records += [{"faulty": False, "holds": 1, "sure_wrong": 0}, {"faulty": False, "holds": 0, "sure_wrong": 0}]
    records += [{"faulty": False, "file": "bare", "holds": 6, "sure_wrong": 0, "named": True}]
    records += [moved | {"sure_wrong": 2}]
    found = faults.summary(records)
    assert found["all"]["flights"] == 4 and found["all"]["exceptions"] == 1
    assert found["all"]["sure_wrong"] == 2 and found["all"]["sure_wrong_though_moved"] == 1
    assert (found["faults"]["alpha stuck"]["moved"], found["faults"]["alpha stuck"]["held"]) == (3, 2)
    assert found["bare"] == {"flights": 1, "named": 1, "sure_wrong": 0}
    assert found["healthy"] == {"flights": 2, "held": 1, "sure_wrong": 0, "exceptions": 0}
