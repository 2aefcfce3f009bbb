"""The benchmark counts what it says: lost flights, and errors over the flights that nobody lost."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from closed_loop import compared, flown_by


def line(after, lost=None):
    """A flight; published by a live one."""
    return {
        "before": 1.0, "after": after, "late": after, "lost_at": lost, "processor_time": 1.0, "messages": 9,
        "uses": 100, "out_of_bounds": 0, "wrong": {"CX_q": 2}, "after_messages": 5, "uses_after": 80,
        "parameters": 32, "relearnt": None,
    }  # fmt: skip


def test_lost_flights_are_counted_and_not_averaged():
    runs = {("elevator", c, s): line(a) for c, a in (("fixed", 3.0), ("live", 2.0), ("truth", 1.0)) for s in range(4)}
    runs["elevator", "fixed", 3] = line(50.0, lost=40.0)
    runs["elevator", "live", 9] = line(0.0)  # the others have not flown that seed
    found = compared(runs, "elevator")
    assert (found["flights"], found["compared"]) == (4, 3)
    assert {c: v["lost"] for c, v in found["controllers"].items()} == {"fixed": 1, "live": 0, "truth": 0}
    assert [found["controllers"][c]["after"] for c in ("fixed", "live", "truth")] == [3.0, 2.0, 1.0]
    assert found["after"]["live_better"] == 3 and found["after"]["difference"] == -1.0
    assert found["published"]["wrong"] == {"CX_q": 8} and found["published"]["use_share_after"] == pytest.approx(0.5)


def test_without_damage_the_fixed_flights_are_those_of_the_truth():
    assert flown_by("gps_lost", "truth") == "fixed" and flown_by("aileron", "truth") == "truth"
    runs = {("none", c, 0): line(a) for c, a in (("fixed", 2.0), ("live", 2.1))}
    found = compared(runs, "none")
    assert found["controllers"]["truth"]["after"] == 2.0 and found["after"]["error"] is None
    assert found["after"]["live_better"] == 0 and found["after"]["worst"] == pytest.approx(0.1)
