"""The page of a run as one HTML file that needs nothing else: figures, tables, and plotly.js itself."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, fields
from html import escape
from pathlib import Path
from string import Template

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.calibration_view import CalibrationView
from aircraft_sysid_ros.workbench.run_view import NO_TRUTH, FlightRecord, RunView, TruthView
from aircraft_sysid_ros.workbench.views import calibration, candidates, coefficients, places, states
from aircraft_sysid_ros.workbench.views.figure import DARK, LIGHT, Figure, Theme
from aircraft_sysid_ros.workbench.views.history import effect_name, history
from aircraft_sysid_ros.workbench.views.parameters import IN_FLIGHT, OF_ALL, parameter_rows
from aircraft_sysid_ros.workbench.views.words import percent, symbol

TEMPLATE, STYLE = Path(__file__).with_name("report.html"), Path(__file__).with_name("style.css")
#: Maps that a file shows: of the axes that fail, over the flow angles and over speed and height.
_MAPS = (("alpha", "beta"), ("V", "height"))
_MOST_MAPS = 4


def _tokens() -> Theme:
    """A theme of names in place of colours, which the file's own script fills in for light or dark."""
    colours = {field.name: f"@{field.name}@" for field in fields(Theme) if field.name not in ("name", "scale")}
    scale = tuple(f"@scale{i}@" for i in range(len(LIGHT.scale)))
    return Theme(name="tokens", scale=scale, **colours)


def _palette(theme: Theme) -> dict[str, str]:
    """Token and colour of a theme."""
    listed = {f"@{name}@": value for name, value in asdict(theme).items() if isinstance(value, str)}
    return {**listed, **{f"@scale{i}@": colour for i, colour in enumerate(theme.scale)}}


class _File:
    """Gathers boxes and figures."""

    def __init__(self) -> None:
        self.theme = _tokens()
        self.boxes: list[str] = []
        self.figures: dict[str, Figure] = {}

    def plot(self, made: Figure, words: str, linked: bool = False) -> str:
        """The place of a figure; linked ones share their window of time."""
        name = f"figure-{len(self.figures)}"
        self.figures[name] = made
        style = f"height:{made['layout']['height']}px"
        kind = "plot linked" if linked else "plot"
        return markup.element("div", "", id=name, class_=kind, style=style, role="img", aria_label=words)

    def box(self, title: str, *parts: str) -> None:
        """One box over the whole width."""
        self.boxes.append(_card(title, *parts))

    def pairs(self, boxes: Iterator[str]) -> None:
        """Boxes two by two."""
        self.boxes.append(markup.element("div", "".join(boxes), class_="grid2"))

    def part(self, title: str) -> None:
        """A heading of what follows."""
        self.boxes.append(markup.element("h2", escape(title), class_="part"))


def report_html(
    view: RunView,
    record: FlightRecord | None,
    truth: TruthView = NO_TRUTH,
    calibrated: CalibrationView | None = None,
) -> str:
    """The whole file of a run."""
    file = _File()
    _model(file, view)
    _where(file, view)
    _why(file, view)
    file.part("Versions")
    file.box("", markup.history_table(history(view.versions, view.current, view.comparisons)))
    file.part("Parameters")
    words = IN_FLIGHT if view.current == view.versions[0].identifier else OF_ALL
    rows = parameter_rows(view.parameters[view.current], truth.parameters)
    file.box("", markup.element("p", words, class_="soft small"), markup.parameter_table(rows, linked=False))
    if record is not None:
        file.part("State")
        figures = states.all_figures(record.state, file.theme, truth.content)
        file.pairs(_card(title, file.plot(made, title)) for title, made in figures)
        file.box("", markup.consistency_table(states.consistencies(record.summary)))
    if calibrated is not None:
        file.part("Calibration")
        _calibration(file, calibrated)
    has = ", ".join(escape(effect_name(label)) for label in view.changes)
    facts = f"{escape(view.name)} · {view.lengths} · model {escape(view.current)}"
    return _whole(file, view.aircraft, view.name, facts + (f", with {has}" if has else ""))


def calibration_html(view: CalibrationView) -> str:
    """The whole file of a calibration alone."""
    file = _File()
    _calibration(file, view)
    return _whole(file, view.aircraft, f"calibration of {view.what}", markup.calibration_facts(view))


def _whole(file: _File, aircraft: str, title: str, facts: str) -> str:
    """The template with everything; ``facts`` is HTML."""
    from plotly.offline import get_plotlyjs

    return Template(TEMPLATE.read_text(encoding="utf8")).substitute(
        title=escape(f"{aircraft}, {title}"),
        style=STYLE.read_text(encoding="utf8"),
        aircraft=escape(aircraft),
        facts=facts,
        body="\n".join(file.boxes),
        plotly=get_plotlyjs().replace("</script", "<\\/script"),
        figures=_script_json(file.figures),
        palettes=_script_json({theme.name: _palette(theme) for theme in (LIGHT, DARK)}),
    )


def _script_json(content: object) -> str:
    """JSON that may stand in a script element."""
    return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")


def _model(file: _File, view: RunView) -> None:
    rows = coefficients.axis_rows(view.comparison)
    file.box("Error on flight that was not seen, in % of the spread of each coefficient", markup.errors_table(rows))
    if view.notes:
        file.box("Notes", *(markup.element("p", escape(note)) for note in view.notes))
    file.boxes.append(markup.element("div", markup.LEGEND, class_="legend"))
    ordered = {row.axis: row for row in rows}
    file.pairs(
        _card("", markup.axis_head(ordered[name]), file.plot(
            coefficients.coefficient_figure(view.comparison, name, file.theme),
            f"{name} measured and predicted over time, and what is left over", linked=True,
        ))
        for name in coefficients.ORDER
    )  # fmt: skip


def _where(file: _File, view: RunView) -> None:
    worst = view.comparison.worst
    file.part("Where it fails")
    if not worst:
        file.box("", "<p>Nowhere: no stretch of time and no part of the flight envelope is worse than noise.</p>")
        return
    lines = [
        f"<li><b>{symbol(p.axis)}</b>{escape(p.text[3:])}: {percent(p.nrmse)} %, {p.excess:.1f} × noise</li>"
        for p in worst
    ]
    file.box("", markup.element("ol", "".join(lines)))
    failing = [axis for axis in AXES if any(place.axis == axis for place in worst)]
    moving = set(places.moving_signals(view.flight))
    shown = [(axis, *pair) for axis in failing for pair in _MAPS if moving >= set(pair)][:_MOST_MAPS]
    file.pairs(
        _card(
            f"{symbol(axis)}: what is left over",
            file.plot(
                places.map_figure(places.residual_map(view.comparison, axis, x, y), file.theme), f"map of {axis}"
            ),
        )
        for axis, x, y in shown
    )


def _why(file: _File, view: RunView) -> None:
    found = view.diagnosis
    if found is None:
        return
    file.part(f"Why: {candidates.VERDICTS.get(found['verdict'], '').lower()}")
    file.box("", f"<p>{escape(found['advice'])}</p>", f'<p class="soft">Found for model {escape(found["model"])}.</p>')
    known = view.comparisons.get(found["model"], view.comparison)
    file.pairs(_candidate(file, card, known) for card in candidates.cards(found, known.flight))


def _candidate(file: _File, card: candidates.Card, known: Comparison) -> str:
    floor = known.axes[card.main_axis].floor.nrmse if card.main_axis in known.axes else None
    parts = [markup.card_facts(card, floor)]
    if card.evidence is not None:
        words = f"what is left over against the signal of {card.title}"
        parts.append(file.plot(candidates.evidence_figure(card.evidence, file.theme), words))
    return _card(escape(card.title), *parts)


def _calibration(file: _File, view: CalibrationView) -> None:
    notes = [markup.element("p", f"Note: {escape(note)}", class_="small") for note in view.notes]
    file.box("What was found", markup.calibration_words(view), markup.calibration_table(view), *notes)
    why = [markup.element("p", escape(text)) for text in calibration.sentences(view)]
    file.box(calibration.verdict(view), *why, markup.TRACE_LEGEND)
    traces = [calibration.trace_figure(view, column, file.theme) for column in range(len(view.sampled))]
    titles = [f"Tr R over {p.name}" for p in view.sampled]
    file.pairs(_card(escape(t), file.plot(made, t)) for t, made in zip(titles, traces, strict=True))
    file.box(f"Residuals before and after [{escape(view.unit)}]", markup.residuals_table(view), markup.RESIDUAL_LEGEND)
    if view.models:
        file.box("Models that were tried, in parts of the flight that were left out", markup.models_table(view))
    file.pairs(
        _card(escape(o.name), file.plot(calibration.residual_figure(view, o, file.theme), f"residuals of {o.name}"))
        for o in view.outputs
    )


def _card(title: str, *parts: str) -> str:
    heading = markup.element("h2", title) if title else ""
    return markup.element("section", heading + "".join(parts), class_="card")
