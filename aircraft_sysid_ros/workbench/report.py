"""The page of a run as one HTML file that needs nothing else: figures, tables, and plotly.js itself."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from markupsafe import Markup

from aircraft_sysid_ros.after_flight.refine import refined_sentences
from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.frequency_responses import rate_responses
from aircraft_sysid_ros.json_text import without_nan
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.calibration_view import CalibrationView
from aircraft_sysid_ros.workbench.run_view import NO_TRUTH, FlightRecord, RunView, TruthView
from aircraft_sysid_ros.workbench.views import (
    calibration,
    candidates,
    coefficients,
    places,
    residuals,
    responses,
    states,
    track,
)
from aircraft_sysid_ros.workbench.views.candidates import moments_named
from aircraft_sysid_ros.workbench.views.figure import DARK, LIGHT, Figure, Theme
from aircraft_sysid_ros.workbench.views.history import changed_from_first, history
from aircraft_sysid_ros.workbench.views.parameters import IN_FLIGHT, OF_ALL, parameter_rows
from aircraft_sysid_ros.workbench.views.words import sentence

STYLE = Path(__file__).with_name("style.css")
#: Maps that a file shows: of the axes that fail, over the flow angles and over speed and height.
_MAPS = (("alpha", "beta"), ("V", "height"))
_MOST_MAPS = 4
#: Parts of the file of a run, by the name of their place.
_PARTS = {
    "model": "Model", "residuals": "Residuals", "responses": "Frequency responses", "where": "Where it fails",
    "why": "Why", "versions": "Versions", "parameters": "Parameters", "state": "State", "calibration": "Calibration",
}  # fmt: skip


def _tokens() -> Theme:
    """A theme of names in place of colours, which the file's own script fills in for light or dark."""
    colours = {field.name: f"@{field.name}@" for field in fields(Theme) if field.name not in ("name", "scale")}
    scale = tuple(f"@scale{i}@" for i in range(len(LIGHT.scale)))
    return Theme(name="tokens", scale=scale, **colours)


def _palette(theme: Theme) -> dict[str, str]:
    """Token and colour of a theme."""
    listed = {f"@{name}@": value for name, value in asdict(theme).items() if isinstance(value, str)}
    return {**listed, **{f"@scale{i}@": colour for i, colour in enumerate(theme.scale)}}


@dataclass(frozen=True)
class _Drawn:
    """The place of a figure in the file; linked ones share their window of time."""

    name: str
    height: int
    words: str
    linked: bool


class _Figures:
    """The figures of a file, which its script draws."""

    def __init__(self) -> None:
        self.theme = _tokens()
        self.made: dict[str, Figure] = {}

    def add(self, made: Figure, words: str, linked: bool = False) -> _Drawn:
        """One more figure, with what it shows for those who cannot see it."""
        name = f"figure-{len(self.made)}"
        self.made[name] = made
        return _Drawn(name, made["layout"]["height"], words, linked)


def report_html(
    view: RunView,
    record: FlightRecord | None,
    truth: TruthView = NO_TRUTH,
    calibrated: CalibrationView | None = None,
) -> str:
    """The whole file of a run."""
    figures = _Figures()
    run = (
        _model(figures, view)
        | _residuals(figures, view)
        | _responses(figures, view)
        | _where(figures, view)
        | _why(figures, view)
        | _parameters(view, truth)
    )
    state = _state(figures, view, record, truth) if record is not None else None
    facts = markup.model_facts(
        (view.name, view.lengths), view.current, view.name_of(view.current), changed_from_first(view.changes)
    )
    return _whole(figures, view.aircraft, view.name, facts, run=run, state=state, calibrated=calibrated)


def calibration_html(view: CalibrationView) -> str:
    """The whole file of a calibration alone."""
    title, facts = f"calibration of {view.what}", markup.calibration_facts(view)
    return _whole(_Figures(), view.aircraft, title, facts, calibrated=view)


def _whole(
    figures: _Figures,
    aircraft: str,
    title: str,
    facts: Markup,
    run: dict[str, Any] | None = None,
    state: dict[str, Any] | None = None,
    calibrated: CalibrationView | None = None,
) -> str:
    """The template with everything."""
    from plotly.offline import get_plotlyjs

    found = _calibration(figures, calibrated) if calibrated is not None else None
    there = {
        "responses": bool(run and run["responses"]),
        "why": bool(run and run["diagnosis"]),
        "state": state is not None,
        "calibration": found is not None,
    }
    return markup.page(
        "report.html",
        aircraft=aircraft,
        title=title,
        facts=facts,
        run=run,
        contents=[(name, words) for name, words in _PARTS.items() if there.get(name, True)],
        state=state,
        calibration=found,
        style=Markup(STYLE.read_text(encoding="utf8")),
        script=Markup(markup.SCRIPT),
        plotly=Markup(get_plotlyjs().replace("</script", "<\\/script")),
        figures=_script_json(figures.made),
        palettes=_script_json({theme.name: _palette(theme) for theme in (LIGHT, DARK)}),
    )


def _script_json(content: object) -> Markup:
    """JSON that may stand in a script element, null for what is not finite: one NaN, and no figure is drawn."""
    return Markup(json.dumps(without_nan(content), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def _model(figures: _Figures, view: RunView) -> dict[str, Any]:
    rows = coefficients.axis_rows(view.comparison)
    ordered = {row.axis: row for row in rows}
    axes, moments = [], moments_named(view.diagnosis)
    for name in coefficients.ORDER:
        made = coefficients.coefficient_figure(view.comparison, name, figures.theme, moments=moments)
        words = f"{name} measured and predicted over time, and the residual"
        axes.append((ordered[name], figures.add(made, words, linked=True)))
    scale = markup.errors_scale(row.held_out for row in rows)
    return {"errors": rows, "scale": scale, "notes": view.notes, "axes": axes, "changes": moments}


def _residuals(figures: _Figures, view: RunView) -> dict[str, Any]:
    drawn = []
    for name in (name for name in coefficients.ORDER if name in view.comparison.axes):
        made = residuals.residual_figure(view.comparison, name, figures.theme)
        drawn.append((name, figures.add(made, f"residual of {name}: histogram and autocorrelation")))
    return {"residuals": drawn, "residual_rows": residuals.residual_rows(view.comparison)}


def _responses(figures: _Figures, view: RunView) -> dict[str, Any]:
    drawn = []
    for found in rate_responses(view.flight):
        words = responses.title(found)
        made = responses.response_figure(found, figures.theme)
        drawn.append((words, figures.add(made, f"frequency response of {words}: magnitude, phase and coherence")))
    return {"responses": drawn, "responses_words": responses.WORDS}


def _where(figures: _Figures, view: RunView) -> dict[str, Any]:
    worst = view.comparison.worst
    failing = [axis for axis in AXES if any(place.axis == axis for place in worst)]
    moving = set(places.moving_signals(view.flight))
    shown = [(axis, *pair) for axis in failing for pair in _MAPS if moving >= set(pair)][:_MOST_MAPS]
    maps = []
    for axis, x, y in shown:
        made = places.map_figure(places.residual_map(view.comparison, axis, x, y), figures.theme)
        maps.append((axis, figures.add(made, f"map of {axis}")))
    return {"worst": worst, "maps": maps, "nowhere": places.nowhere(view.comparison)}


def _why(figures: _Figures, view: RunView) -> dict[str, Any]:
    found = view.diagnosis
    if found is None:
        return {"diagnosis": None}
    known = view.comparisons.get(found["model"], view.comparison)
    listed = []
    for card in candidates.cards(found, known.flight):
        noise = known.axes[card.main_axis].floor.nrmse if card.main_axis in known.axes else None
        drawn = None
        if card.evidence is not None:
            made = candidates.evidence_figure(card.evidence, figures.theme)
            drawn = figures.add(made, f"the residual against the signal of {card.title}")
        has = candidates.is_in_model(card, found["model"], view.current, view.changes)
        listed.append((card, noise, drawn, has))
    verdict, advice = candidates.verdict(found, view.current)
    of_shown = found["model"] == view.current
    said = {"verdict": verdict, "advice": advice, "of_shown": of_shown}
    return {
        "diagnosis": found,
        "candidates": listed,
        "diagnosis_notes": candidates.beside_the_verdict(found, view.notes),
        **said,
    }


def _parameters(view: RunView, truth: TruthView) -> dict[str, Any]:
    return {
        "versions": history(view.versions, view.current, view.comparisons, view.labels),
        "of_parameters": IN_FLIGHT if view.current == view.versions[0].identifier else OF_ALL,
        "parameters": parameter_rows(view.parameters[view.current], truth.parameters),
        "refined": [_refined(view, method) for method in view.refined],
    }


def _refined(view: RunView, method: str) -> dict[str, Any]:
    """What ``refine`` found by a method, beside what was known."""
    found, listed = dict(view.refined[method]), view.parameters[view.current]
    return {
        "title": f"Maximum likelihood, {method.replace('-', ' ')}",
        "sentences": [sentence(text) + "." for text in refined_sentences(found)],
        "errors": markup.refined_errors(found["not_fitted"]),
        "parameters": markup.parameters_beside(listed, found["parameters"], ("table above", "refined")),
    }


def _state(figures: _Figures, view: RunView, record: FlightRecord, truth: TruthView) -> dict[str, Any]:
    made = states.all_figures(record.state, figures.theme, truth.content)
    drawn = [(title, figures.add(figure, title)) for title, figure in made]
    error = track.flown_error(view.comparison)
    tracks = {
        "Track from above, coloured by the worst residual": track.track_figure(record.state, error, figures.theme),
        "Height, coloured by the worst residual": track.height_figure(record.state, error, figures.theme),
    }
    return {
        "figures": [each for each in drawn if each[0] != states.INNOVATIONS],
        "innovations": next(each for each in drawn if each[0] == states.INNOVATIONS),
        "tracks": [(title, figures.add(figure, title)) for title, figure in tracks.items()],
        "consistencies": states.consistencies(record.summary),
    }


def _calibration(figures: _Figures, view: CalibrationView) -> dict[str, Any]:
    traces = []
    for column, parameter in enumerate(view.sampled if len(view.trace) > 1 else ()):
        title = f"Tr R over {parameter.name}"
        traces.append((title, figures.add(calibration.trace_figure(view, column, figures.theme), title)))
    residuals = []
    for output in view.outputs:
        made = calibration.residual_figure(view, output, figures.theme)
        residuals.append((output.name, figures.add(made, f"residuals of {output.name}")))
    return {
        "view": view,
        "verdict": calibration.verdict(view),
        "sentences": calibration.sentences(view),
        "traces": traces,
        "residuals": residuals,
    }
