"""Figures of several manoeuvres in one run: no line is drawn where nothing was flown, and each has its own origin."""

from __future__ import annotations

import base64

import numpy as np
import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.report.diagnosis_figures import comparison_figure
from aircraft_sysid_ros.report.figures import coefficients_figure, learning_figure
from aircraft_sysid_ros.workbench.run_view import load_flight_record, load_run_view
from aircraft_sysid_ros.workbench.views import coefficients, states, track
from aircraft_sysid_ros.workbench.views.figure import LIGHT, thinned

SEGMENTS = """
- {recording: FLIGHT, start: 3, stop: 26, name: first}
- {recording: FLIGHT, start: 33, stop: 58, name: second}
"""


@pytest.fixture(scope="module")
def joined(hidden_effect, aircraft_file, tmp_path_factory):
    """A run of two manoeuvres, as the page holds it, and what was estimated in it."""
    folder, flight = tmp_path_factory.mktemp("joined"), str(hidden_effect.parent / "flight")
    (folder / "segments.yaml").write_text(SEGMENTS.replace("FLIGHT", flight))
    given = ["--aircraft", str(aircraft_file), "--segments", str(folder / "segments.yaml")]
    assert main(["replay", flight, *given, "--out", str(folder / "run")]) == 0
    view = load_run_view(folder / "run")
    return view, load_flight_record(folder / "run", view.zero)


def line_of(made, name):
    """Both coordinates of a line."""
    (found,) = [trace for trace in made["data"] if trace["name"] == name]
    return [np.frombuffer(base64.b64decode(found[axis]["bdata"]), "<f4") for axis in "xy"]


def test_no_line_crosses_the_pause_between_manoeuvres(joined) -> None:
    """A straight line from the last point of one to the first of the next stood in every plot over time."""
    view, record = joined
    of_model = coefficients.coefficient_figure(view.comparison, "CZ", LIGHT)
    drawn = [(of_model, name) for name in ("measured", "predicted", "residual, held out")]
    drawn += [(states.air_figure(record.state, "airspeed", LIGHT), name) for name in ("measured", "reconstructed")]
    drawn += [(states.consistency_figure(record.state, LIGHT), "all sensors")]
    drawn += [(states.bias_figure(record.state, "wind", LIGHT), name) for name in ("north", "east", "down")]
    for made, name in drawn:
        x, y = line_of(made, name)
        crossed = (np.diff(x) > 2.5) & np.isfinite(y[1:]) & np.isfinite(y[:-1])
        assert not crossed.any() and np.ptp(x) > 40.0, name


def test_no_line_of_the_pictures_of_commands_crosses_it_either(joined, tmp_path, monkeypatch) -> None:
    saved = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda self, path, **options: saved.append(self))
    view, _ = joined
    comparison_figure(view.comparison, tmp_path / "compare.png", "compare")
    coefficients_figure(view.run.path, tmp_path / "coefficients.png", "coefficients")
    learning_figure(view.run.path, tmp_path / "learning.png", "learning")
    lines = [line.get_xydata() for figure in saved for plot in figure.axes for line in plot.lines]
    assert len(saved) == 3 and len(lines) > 30
    for line in (line for line in lines if len(line)):
        crossed = (np.diff(line[:, 0]) > 5.0) & np.isfinite(line[1:, 1]) & np.isfinite(line[:-1, 1])
        assert not crossed.any() and np.nanmax(line[:, 0]) - np.nanmin(line[:, 0]) > 40.0


def test_each_manoeuvre_is_drawn_from_its_own_origin_and_this_is_said(joined) -> None:
    """The second began where the first had begun, a line led there, and the map said nothing of it."""
    view, record = joined
    made = track.track_figure(record.state, track.flown_error(view.comparison), LIGHT)
    x, y = line_of(made, "track")
    steps = np.hypot(np.diff(x), np.diff(y))
    assert np.nanmax(steps) < 20.0 and np.isnan(steps).any()
    assert "each manoeuvre" in made["layout"]["xaxis"]["title"]["text"]
    (ends,) = [trace for trace in made["data"] if trace["name"] == "ends"]
    assert ends["marker"]["symbol"] == ["circle", "square"] * 2
    height = track.height_figure(record.state, track.flown_error(view.comparison), LIGHT)["layout"]
    assert "each manoeuvre" in height["yaxis"]["title"]["text"]


def test_a_gap_of_one_moment_stays_in_a_thinned_line() -> None:
    time, values = np.arange(50_000.0), np.sin(np.arange(50_000.0))
    values[31_234] = np.nan
    assert 31_234 in thinned(time, values)
