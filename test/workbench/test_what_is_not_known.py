"""What is not known is said in words and not as a number that is none; what does nothing is not offered."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.diagnosis.two_runs import SideBySide
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.calibration_panel import CalibrationPage
from aircraft_sysid_ros.workbench.live_page import LivePage
from aircraft_sysid_ros.workbench.page import Page
from aircraft_sysid_ros.workbench.shelf_page import ShelfPage
from aircraft_sysid_ros.workbench.views import candidates, figure, places, states, track
from aircraft_sysid_ros.workbench.views.coefficients import NO_DATA, AxisRow
from aircraft_sysid_ros.workbench.views.history import VersionRow

WHY = "CY cannot be fitted: it needs dr"


@pytest.fixture
def view_of_failure():
    """What a card says was fitted of an engine that stopped, with some numbers of its own."""

    def numbers(inner):
        candidate = dict.fromkeys(("name", "physics", "label", "where", "manoeuvre"), "")
        candidate |= {"effect": "loss_of_thrust", "expression": None, "terms": {}, "main_axis": "CX", "p_value": 0.01}
        candidate |= {"error_before": 0.3, "error_after": 0.1, "found": True, "confounded_with": [], "parameters": []}
        (card,) = candidates.cards({"candidates": [{**candidate, "inner": inner}]}, None)
        return card.numbers

    return numbers


def test_a_wind_that_is_not_estimated_in_flight_is_no_number() -> None:
    """The page of a flight without GPS showed "nan ± –"."""
    std = np.full(18, 0.01)
    std[15:] = np.nan
    state = {"status_text": "", "standard_deviations": std.tolist(), "wind_ned": [np.nan] * 3}
    table = markup.state_table({**state, "accelerometer_bias": [0.1] * 3, "gyro_bias": [0.2] * 3})
    assert "nan" not in table and table.count("not known") == 3 and "0.100" in table


@pytest.mark.parametrize("is_first", [True, False])
def test_an_axis_that_one_version_cannot_fit_says_why_on_either_side(is_first) -> None:
    """With the version that cannot fit it at the right the row was empty."""
    without = AxisRow("CY", "side force", None, None, None, NO_DATA, WHY)
    fitted = AxisRow("CY", "side force", 0.1, 0.1, 0.05, "only noise")
    rows = [VersionRow(name, "as it was", (), False, (axis,)) for name, axis in (("a", without), ("b", fitted))]
    table = markup.errors_beside(*(rows if is_first else rows[::-1]))
    assert "it needs dr" in table


def test_only_plots_that_zoom_are_said_to() -> None:
    """Those of a flight in progress slide by themselves; a list of runs has none."""
    helps = {page: page.help(object.__new__(page)) for page in (Page, LivePage, ShelfPage, CalibrationPage)}
    assert [page for page, said in helps.items() if any(what.startswith("Drag") for what in said)] == [Page]
    assert [page for page, said in helps.items() if any(what.startswith("Point") for what in said)] == [Page, LivePage]


@pytest.mark.parametrize("is_known", [True, False])
def test_without_a_wind_no_track_over_the_ground_is_drawn(is_known) -> None:
    """Positions drift with the air then, and were drawn as a map beside an empty figure of the wind."""
    flown, wind = np.zeros((5, 3)), np.full((5, 3), 1.0 if is_known else np.nan)
    state = states.StateHistory(
        np.arange(5.0), flown, flown, flown, flown, wind, wind, flown, flown, np.ones(5), measured_time={}, measured={}
    )
    drawn = dict(states.all_figures(state, figure.LIGHT, {}))
    (of_wind,) = (made["layout"] for title, made in drawn.items() if title.startswith("Wind"))
    assert [note["text"] for note in of_wind["annotations"]] == ["not estimated"] * (not is_known)
    map_of_it = track.track_figure(state, None, figure.LIGHT)["layout"]
    for name in ("xaxis", "yaxis"):
        assert ("relative to the air" in map_of_it[name]["title"]["text"]) == (not is_known)


@pytest.mark.parametrize("is_one_flight", [True, False])
def test_errors_on_a_flight_that_was_fitted_are_not_called_others(is_one_flight) -> None:
    """Of two runs of one flight each model has seen the other's: the command said so, the page the opposite."""
    runs, errors = ("a", "b"), {"CZ": np.full((2, 2), 0.1)}
    both = SideBySide(runs, ("m", "n"), is_one_flight, (), ({}, {}), errors, ())
    table = markup.errors_of_flights(both)
    assert ("that was not fitted" in table) == (not is_one_flight)
    assert ("as it was fitted to this flight" in table) == is_one_flight


@pytest.mark.parametrize(("fails", "is_told"), [((False, None), True), ((None, None), False)])
def test_where_nothing_can_be_judged_it_is_not_said_that_nothing_fails(fails, is_told) -> None:
    """Beside "too few to judge it" the page and the file said that no stretch of time is worse than noise."""
    axes = {name: SimpleNamespace(fails=said) for name, said in zip(("CX", "CY"), fails, strict=True)}
    said = places.nowhere(SimpleNamespace(axes=axes))
    assert said.startswith("Nowhere") == is_told


@pytest.mark.parametrize("name", ["t0", "t3", "full"])
def test_moments_of_a_failure_have_their_unit(view_of_failure, name) -> None:
    """An engine that stops is no effect of the library, and something may be stuck twice."""
    (number,) = view_of_failure({name: 74.4})
    assert number == f"{name} = 74.4 s"
