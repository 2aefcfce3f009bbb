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
        decision=SimpleNamespace(reason="clear"),
    )  # fmt: skip
    parameters = [{"name": name, "unit": unit} for name, unit in zip(names, ("rad", ""), strict=True)]
    trace_figure(SimpleNamespace(answer=answer, parameters=parameters, title="probe"), tmp_path / "trace.png")
    assert {plot.get_xlabel() for plot in saved[0].axes if plot.get_visible()} == {"eps_phi [rad]", "lambda_V [-]"}
