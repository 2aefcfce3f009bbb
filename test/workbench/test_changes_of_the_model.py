"""What was added and taken away is said as it is, and Undo takes back the last change and no other."""

from __future__ import annotations

from dataclasses import replace

import pytest

from aircraft_sysid_ros.diagnosis.model_versions.additions import add, remove
from aircraft_sysid_ros.diagnosis.model_versions.versions import Change, Version, open_run, versions_of
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.report import report_html
from aircraft_sysid_ros.workbench.run_view import load_run_view
from aircraft_sysid_ros.workbench.side_panels import UNDONE, listed_changes
from aircraft_sysid_ros.workbench.views.candidates import cards, is_in_model
from aircraft_sysid_ros.workbench.views.history import changed_from_first
from aircraft_sysid_ros.workbench.worker import ADD, REMOVE, RETURN

EFFECT, TERM = "parameter_change", "CX: q"
ONCE, TWICE = Change(terms={"Cl": ("time",)}), Change(terms={"Cl": ("time", "time**2")})
GONE = Change(without={"CX": ("q",)})
CANDIDATE = {
    "effect": EFFECT, "expression": None, "name": "change", "label": EFFECT, "physics": "", "found": True,
    "main_axis": "Cl", "error_before": 0.3, "error_after": 0.03, "p_value": 0.01, "where": "70 to 72 s",
    "confounded_with": [], "manoeuvre": "", "parameters": [], "inner": {}, "terms": {},
}  # fmt: skip


@pytest.fixture(scope="module")
def view(hidden_effect):
    """The run as the page holds it."""
    return load_run_view(hidden_effect)


@pytest.fixture(scope="module")
def version(hidden_effect):
    """A version with the changes that it is asked for."""
    aircraft = open_run(hidden_effect).root

    def made(changes, identifier="now"):
        return Version(identifier, aircraft, changes, ("before",))

    return made


def test_a_term_that_was_removed_is_not_what_the_model_is_with() -> None:
    """The header of page and file said "with CX: q" of a model without it."""
    facts = markup.model_facts((), "id", "", changed_from_first({EFFECT: ONCE, TERM: GONE}))
    assert ", with " in facts and f", without {TERM}" in facts


def undone(rows):
    """The one row with Undo."""
    (row,) = [row for row in rows if row.button == UNDONE]
    return row


def test_what_was_removed_can_be_put_back(version) -> None:
    """It was listed as added, with a button to take it out that added it."""
    rows = listed_changes(version({TERM: GONE, EFFECT: ONCE}), version({TERM: GONE}, "before"))
    assert [(row.words.rpartition(": ")[2], row.button, row.back) for row in rows[:1]] == [
        ("taken out", "Put back", (ADD, TERM))
    ]
    assert undone(rows) == rows[1] and rows[1].back == (REMOVE, EFFECT)
    (back,) = listed_changes(version({}), version({TERM: GONE}, "before"))
    assert back.words.endswith("put back") and back.button == UNDONE and back.back == (REMOVE, TERM)


def test_undo_of_an_effect_that_was_added_once_more_leaves_the_first(version) -> None:
    """It took out all of the effect, or stood beside the change that was made before."""
    changed = version({EFFECT: TWICE, "stall": ONCE})
    rows = listed_changes(changed, version({EFFECT: ONCE, "stall": ONCE}, "before"))
    assert undone(rows) == rows[0] and rows[0].back == (RETURN, "before")
    assert rows[1].back == (REMOVE, "stall")


def test_of_a_version_whose_origin_cannot_be_read_the_last_change_is_undone(version) -> None:
    assert undone(listed_changes(version({EFFECT: ONCE, "stall": ONCE}), None)).back == (REMOVE, "stall")


def test_undo_of_part_of_an_effect_that_was_removed_brings_it_back(run) -> None:
    """As a terminal takes one of several terms; Undo took the others."""
    add(run, "CX: beta**2; CX: alpha*beta")
    before = open_run(run).current
    remove(run, "CX: beta**2")
    current = open_run(run).current
    known = {each.identifier: each for each in versions_of(open_run(run))[0]}
    assert undone(listed_changes(current, known[current.parents[0]])).back == (RETURN, before.identifier)


@pytest.mark.parametrize(("found_for", "change", "has"), [("now", ONCE, False), ("before", ONCE, True),
                                                          ("before", GONE, False)])  # fmt: skip
def test_what_the_current_version_lacks_is_not_said_to_be_in_it(view, found_for, change, has) -> None:
    """A second change of the kind of the first could not be added, and was called "in the model"."""
    (card,) = cards({"candidates": [CANDIDATE]}, view.flight)
    assert is_in_model(card, found_for, "now", {EFFECT: change}) == has
    found = {"verdict": "missing", "advice": "", "candidates": [CANDIDATE]}
    found["model"] = view.current if found_for == "now" else found_for
    text = report_html(replace(view, diagnosis=found, changes={EFFECT: change}), None)
    assert ("in the model</h2>" in text) == has


def test_what_a_diagnosis_says_of_itself_stands_in_the_file(view) -> None:
    """That the library was not searched, and what the flight could not show, stood in the terminal alone."""
    unseen = [{"effect": "ground_effect", "name": "Ground effect", "why": "it flew high"}]
    said = {"notes": ["the library was not searched: it is short"], "cannot_show": unseen}
    found = {"verdict": "none", "advice": "", "candidates": [], "model": view.current, **said}
    text = report_html(replace(view, diagnosis=found), None)
    assert "Note: the library was not searched: it is short." in text
    assert "This flight could not show: Ground effect (it flew high)." in text


def test_what_no_term_stands_for_is_not_offered(view) -> None:
    """The page offered to add a scale of the airspeed to all of a flight that had it for a time; diagnose does not."""
    offered = [
        card.is_to_add for card in cards({"candidates": [CANDIDATE, CANDIDATE | {"is_to_add": False}]}, view.flight)
    ]
    assert offered == [True, False]
