"""Two flights of `make hidden-effects` in JSBSim: the benchmark in docs/diagnosis.md in small."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import hidden_effects


@pytest.fixture(scope="module")
def flown():
    """One flight with an effect and one without, each with what was said of it."""
    pytest.importorskip("jsbsim")
    jobs = [
        {"simulator": "J3Cub", "effect": "landing_gear", "seed": 2008},
        {"simulator": "c172p", "effect": None, "seed": 2010},
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hidden_effects, "DURATION", 60.0)
        patch.setattr(hidden_effects, "METHODS_EVERY", 10_000)
        patch.setattr(hidden_effects, "_one_core", lambda: None)
        return [hidden_effects.fly(job) for job in jobs]


def test_hidden_effects_are_named_and_nothing_else(flown):
    assert [line["verdict"] for line in flown] == ["missing", "none"]
    for line in flown[:1]:
        assert line["candidates"][0]["effect"] == line["effect"]
        assert line["oracle_gain"] > 0.2


def test_the_error_with_what_was_named_is_that_of_the_truth(flown):
    for line in flown[:1]:
        errors = {name: by_axis[line["axis"]] for name, by_axis in line["errors"].items()}
        assert errors["diagnosed"] < 1.1 * errors["oracle"] < 0.8 * errors["base"]


def test_what_is_taken_out_of_the_library_is_unexplained_and_gets_no_other_name(flown):
    for line in flown[:1]:
        assert line["without"]["verdict"] == "unexplained" and line["axis"] in line["without"]["axes"]


def test_the_summary_counts_them(flown):
    found = hidden_effects.summary(flown)
    assert found["false_verdicts"] == {"share": 0.0, "flights": 1}
    assert found["relevant"]["flights"] == 1 and found["relevant"]["right_first"] == 1.0
    assert found["without"]["unexplained_right_axis"] == 1.0
