"""Axes of pictures have their units: those of a refinement and of a calibration had none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.flight_model.layout import OUTPUT_NAMES
from aircraft_sysid_ros.report.calibration_figures import trace_figure
from aircraft_sysid_ros.report.figures import outputs_figure


@pytest.fixture
def saved(monkeypatch):
    """Figures that were saved."""
    found = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda self, path, **options: found.append(self))
    return found


def test_every_output_of_a_refinement_has_a_unit(saved, tmp_path) -> None:
    values = np.random.default_rng(0).normal(size=(20, len(OUTPUT_NAMES)))
    outputs_figure(np.arange(20.0), values, values, tmp_path / "refined.png", "refined")
    titles = dict(plot.get_title(loc="left").rstrip("]").split(" [") for plot in saved[0].axes)
    assert set(titles) == set(OUTPUT_NAMES)
    given = ("Az", "m/s²"), ("p", "rad/s"), ("position down", "m"), ("velocity east", "m/s"), ("beta", "rad")
    assert all(titles[name] == unit for name, unit in (*given, ("heading", "rad"), ("V", "m/s")))


def test_every_parameter_of_a_calibration_has_a_unit(saved, tmp_path) -> None:
    names = ("eps_phi", "lambda_V")
    samples = SimpleNamespace(xi2=np.ones((5, 2)), trace=np.ones(5))
    answer = SimpleNamespace(
        problem=SimpleNamespace(names2=names, n1=1), determined=np.ones(3, np.bool_), samples=samples, xi=np.zeros(3),
        decision=SimpleNamespace(reason="clear"), refused={},
    )  # fmt: skip
    parameters = [{"name": name, "unit": unit} for name, unit in zip(names, ("rad", ""), strict=True)]
    trace_figure(SimpleNamespace(answer=answer, parameters=parameters, title="probe"), tmp_path / "trace.png")
    assert {plot.get_xlabel() for plot in saved[0].axes if plot.get_visible()} == {"eps_phi [rad]", "lambda_V [-]"}


@pytest.mark.parametrize("none_left", [False, True])
def test_samples_stand_above_the_name_of_their_own_parameter(saved, tmp_path, none_left) -> None:
    """Those of a parameter without an answer stood above the name of the next, and with no answer at all it ended."""
    names, of = ("eps_phi", "lambda_V"), np.array([3.0, 5.0])
    refused = dict.fromkeys(names if none_left else names[:1], "at its bound")
    answer = SimpleNamespace(
        problem=SimpleNamespace(names2=names, n1=1), determined=np.array([True, False, not none_left]),
        samples=SimpleNamespace(xi2=np.tile(of, (4, 1)), trace=np.ones(4)), xi=np.array([0.0, 0.0, of[1]]),
        decision=SimpleNamespace(reason="clear"), refused=refused,
    )  # fmt: skip
    parameters = [{"name": name, "unit": ""} for name in names]
    trace_figure(SimpleNamespace(answer=answer, parameters=parameters, title="probe"), tmp_path / "trace.png")
    plots = {plot.get_xlabel().partition(" ")[0]: plot.lines for plot in saved[0].axes if plot.get_visible()}
    assert {name: lines[0].get_xdata()[0] for name, lines in plots.items()} == dict(zip(names, of, strict=True))
    assert {name: len(lines) - 1 for name, lines in plots.items()} == {"eps_phi": 0, "lambda_V": int(not none_left)}
