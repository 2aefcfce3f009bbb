"""Tables and words of the views as HTML, for the page and for the file. Everything from outside is escaped."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.workbench.calibration_view import CalibrationView
from aircraft_sysid_ros.workbench.views.candidates import Card
from aircraft_sysid_ros.workbench.views.coefficients import NO_DATA, AxisRow
from aircraft_sysid_ros.workbench.views.history import VersionRow
from aircraft_sysid_ros.workbench.views.parameters import INTERVAL, STATUS_WORDS, ParameterRow
from aircraft_sysid_ros.workbench.views.states import Consistency
from aircraft_sysid_ros.workbench.views.words import percent, symbol

LEGEND = (
    '<span class="key" style="color:var(--measured)"><span>measured</span></span>'
    '<span class="key" style="color:var(--predicted)"><span>predicted</span></span>'
    '<span class="key" style="color:var(--residual)"><span>left over, held out</span></span>'
    '<span class="key dots" style="color:var(--noise)"><span>noise, two sigma</span></span>'
    '<span class="key shaded"><span>held out together</span></span>'
)
LIVE_LEGEND = (
    '<span class="key" style="color:var(--measured)"><span>measured</span></span>'
    '<span class="key" style="color:var(--predicted)"><span>predicted before it was learnt from</span></span>'
    '<span class="key" style="color:var(--residual)"><span>left over</span></span>'
    '<span class="key dashes" style="color:var(--second)"><span>the model was changed</span></span>'
)
TRACE_LEGEND = (
    '<div class="legend"><span class="key glyph" style="color:var(--residual)" data-glyph="●"><span>samples of stage 1'
    '</span></span><span class="key glyph" style="color:var(--ink)" data-glyph="◇"><span>minimum that stage 1 reached'
    '</span></span><span class="key dashes" style="color:var(--predicted)"><span>estimate</span></span>'
    '<span class="key shaded" style="--shade:var(--mark)"><span>its 95 % interval</span></span></div>'
)
RESIDUAL_LEGEND = (
    '<div class="legend"><span class="key glyph" style="color:var(--noise)" data-glyph="○"><span>before</span></span>'
    '<span class="key glyph" style="color:var(--residual)" data-glyph="●"><span>after</span></span>'
    '<span class="key shaded"><span>wind circles and pushover-pullups</span></span></div>'
)
SECOND_KEY = '<span class="key" style="color:var(--second)"><span>version {}</span></span>'


def element(tag: str, content: str, **attributes: str) -> str:
    """One HTML element; ``class_`` is class, ``data_x`` is data-x. ``content`` is HTML already."""
    names = {name: name.rstrip("_").replace("_", "-") for name in attributes}
    listed = "".join(f' {names[name]}="{escape(value)}"' for name, value in attributes.items())
    return f"<{tag}{listed}>{content}</{tag}>"


def axis_head(row: AxisRow) -> str:
    """Symbol, words and errors of an axis above its figure."""
    parts = [element("span", symbol(row.axis), class_="sym"), element("span", escape(row.words), class_="soft")]
    if row.fails:
        parts.append(element("span", "▲ fails", class_="flag", data_testid=f"fails-{row.axis}"))
    if row.held_out is None or row.floor is None:
        parts.append(element("span", escape(row.reason), class_="numbers"))
    else:
        error = element("b", f"{percent(row.held_out)} %", data_testid=f"error-{row.axis}")
        parts.append(element("span", f"error {error} &nbsp; noise {percent(row.floor)} %", class_="numbers"))
    return element("div", "".join(parts), class_="axis-head")


def errors_scale(errors: Iterable[float | None]) -> float:
    """The error that fills a bar: 0.1, 0.2, 0.5, 1, ... of the spread, the least that none of these errors exceeds."""
    top = max((e for e in errors if e is not None and math.isfinite(e)), default=0.0)
    scale, steps = 0.1, itertools.cycle((2.0, 2.5, 2.0))
    while scale < top:
        scale *= next(steps)
    return scale


def scale_head(top: float) -> str:
    """Both ends of the bars, as the head of their column."""
    ends = element("span", "0") + element("span", f"{100 * top:.0f} % of spread")
    return element("div", ends, class_="scale", data_testid="scale")


def errors_table(rows: Sequence[AxisRow]) -> str:
    """Errors of all axes as bars with numbers."""
    top = errors_scale(row.held_out for row in rows)
    cells = [element("span", "", class_="head"), scale_head(top)]
    cells += [element("span", text, class_="head") for text in ("error %", "noise %", "")]
    for row in rows:
        cells.append(element("span", symbol(row.axis), class_="sym"))
        if row.held_out is None or row.floor is None:
            cells += [element("span", escape(row.reason), class_="soft small"), "<i></i>", "<i></i>", "<i></i>"]
            continue
        fill = f'<div class="fill{" fails" if row.fails else ""}" style="width:{100 * row.held_out / top:.1f}%"></div>'
        tick = f'<div class="tick" style="left:{100 * row.floor / top:.1f}%"></div>'
        cells.append(element("div", fill + tick, class_="track"))
        cells += [element("span", percent(value), class_="num") for value in (row.held_out, row.floor)]
        cells.append(state_words(row))
    return element("div", "".join(cells), class_="errors")


def state_words(row: AxisRow) -> str:
    """What is left over of an axis, in words."""
    if row.fails:
        return element("span", "▲ fails", class_="flag")
    return element("span", escape(row.state if row.state != NO_DATA else ""), class_="soft small")


def card_facts(card: Card, noise: float | None) -> str:
    """What is known of a candidate."""
    axis = symbol(card.main_axis)
    floor = f", noise {percent(noise)} %" if noise is not None else ""
    removed = f"held-out error of {axis}: {escape(card.gain)}{floor}"
    facts = [("Error removed", removed), ("By chance", escape(card.sure)), ("In the flight", escape(card.where))]
    if card.confounded_with:
        names = ", ".join(escape(name) for _, name in card.confounded_with)
        facts.append(("Looks like", f"this flight cannot tell it from {names}"))
    if card.manoeuvre:
        title = "Told apart by" if card.confounded_with else "Shown by"
        facts.append((title, escape(card.manoeuvre)))
    if card.numbers:
        facts.append(("Fitted", "<br>".join(element("code", escape(text)) for text in card.numbers)))
    listed = "".join(element("dt", title) + element("dd", text) for title, text in facts)
    return element("p", escape(card.physics)) + element("dl", listed, class_="facts-list")


def history_table(rows: Sequence[VersionRow]) -> str:
    """All versions with their held-out errors in %."""
    heads = ["version", "what it is", "made from", *(symbol(axis) for axis in AXES)]
    head = "".join(element("th", text, class_="n" if i > 2 else "") for i, text in enumerate(heads))
    body = [element("tr", head)]
    for row in rows:
        name = element("span", escape(row.identifier), class_="mono") + (" · now" if row.is_current else "")
        cells = [element("td", text) for text in (name, escape(row.words), escape(" ".join(row.parents)) or "the run")]
        shown = {axis.axis: axis for axis in row.axes}
        for axis in AXES:
            found = shown.get(axis)
            text = percent(found.held_out) if found is not None and found.held_out is not None else "–"
            flag = " ▲" if found is not None and found.fails else ""
            cells.append(element("td", text + flag, class_="n worse" if flag else "n"))
        body.append(element("tr", "".join(cells), class_="now" if row.is_current else ""))
    return _table(body)


def errors_beside(one: VersionRow, other: VersionRow) -> str:
    """Errors of two versions side by side."""
    heads = ["", *(element("span", escape(v.identifier), class_="mono") for v in (one, other)), "change", "noise"]
    body = [element("tr", "".join(element("th", text, class_="n" if i else "") for i, text in enumerate(heads)))]
    right = {axis.axis: axis for axis in other.axes}
    for row in one.axes:
        b = right.get(row.axis)
        first = element("td", f"<b>{symbol(row.axis)}</b> {escape(row.words)}")
        if row.held_out is None or b is None or b.held_out is None or b.floor is None:
            body.append(element("tr", first + element("td", escape(row.reason), colspan="4")))
            continue
        change = 100.0 * (b.held_out - row.held_out)
        word = "better" if change < -0.05 else "worse" if change > 0.05 else "soft"
        cells = [element("td", f"{percent(v)} %", class_="n") for v in (row.held_out, b.held_out)]
        cells.append(element("td", f"{change:+.1f}".replace("-", "−"), class_=f"n {word}"))
        cells.append(element("td", f"{percent(b.floor)} %", class_="n soft"))
        body.append(element("tr", first + "".join(cells)))
    return _table(body)


def parameters_beside(
    one: Sequence[Mapping[str, Any]], other: Sequence[Mapping[str, Any]], names: tuple[str, str]
) -> str:
    """Parameters of two versions side by side."""
    left, right = ({p["name"]: p for p in listed} for listed in (one, other))
    heads = ["parameter", *(element("span", escape(name), class_="mono") for name in names)]
    body = [element("tr", "".join(element("th", text, class_="n" if i else "") for i, text in enumerate(heads)))]
    for name in dict.fromkeys((*left, *right)):
        cells = [element("td", _value(side.get(name)), class_="n") for side in (left, right)]
        body.append(element("tr", element("td", escape(name), class_="mono") + "".join(cells)))
    return element("p", "Estimate ± half of its 95 % interval", class_="soft small") + _table(body)


def _value(p: Mapping[str, Any] | None) -> str:
    if p is None:
        return '<span class="soft">not in the model</span>'
    if p["value"] is None or p["std"] is None:
        return escape(p["reason"] or "not known")
    return f'{_number(p["value"])} <span class="soft">± {_number(INTERVAL * p["std"], 2)}</span>'


def parameter_table(rows: Sequence[ParameterRow], chosen: str = "", linked: bool = True) -> str:
    """Estimates with interval, status and reason, and the truth where it is known; names are buttons if linked."""
    known = any(row.truth is not None for row in rows)
    heads = ["parameter", "estimate", "95 % interval", *(["truth"] if known else []), "status", "why"]
    classes = ["", "n", "n", *(["n"] if known else []), "", ""]
    body = [element("tr", "".join(element("th", h, class_=c) for h, c in zip(heads, classes, strict=True)))]
    for row in rows:
        name = escape(row.name)
        if linked:
            name = element("button", name, class_="linklike mono", data_name=row.name)
        interval = "–" if row.interval is None else " to ".join(_number(v) for v in row.interval)
        cells = [element("td", name, class_="mono"), element("td", _number(row.value), class_="n")]
        cells.append(element("td", interval, class_="n soft"))
        if known:
            cells.append(element("td", _truth(row), class_="n"))
        word = STATUS_WORDS.get(row.status, row.status)
        cells.append(element("td", element("span", escape(row.status), class_=f"status {word}")))
        cells.append(element("td", escape(row.reason), class_="soft small"))
        body.append(element("tr", "".join(cells), class_="now" if row.name == chosen else ""))
    return _table(body)


def _truth(row: ParameterRow) -> str:
    """The true value, marked where the interval misses it."""
    if row.truth is None:
        return "–"
    inside = row.interval is None or row.interval[0] <= row.truth <= row.interval[1]
    return _number(row.truth) + ("" if inside else ' <span class="soft" title="outside of the interval">○</span>')


def consistency_table(rows: Sequence[Consistency]) -> str:
    """Consistency of every sensor with what the filter expected."""
    heads = ("sensor", "over expected", "samples", "fused", "rejected")
    body = [element("tr", "".join(element("th", h, class_="n" if i else "") for i, h in enumerate(heads)))]
    for row in rows:
        ratio = "–" if row.ratio is None else f"{row.ratio:.2f}"
        cells = [element("td", escape(row.sensor)), element("td", ratio, class_="n")]
        cells += [
            element("td", f"{count:,}".replace(",", " "), class_="n")
            for count in (row.received, row.fused, row.rejected)
        ]
        body.append(element("tr", "".join(cells)))
    return _table(body)


def state_table(state: Mapping[str, Any]) -> str:
    """Wind and biases of the content of one AircraftState with half of their 95 % intervals."""
    heads = ("", "x, north", "y, east", "z, down")
    body = [element("tr", "".join(element("th", h, class_="n" if i else "") for i, h in enumerate(heads)))]
    listed = (("wind [m/s]", "wind_ned", 15), ("accelerometer bias [m/s²]", "accelerometer_bias", 9),
              ("gyro bias [rad/s]", "gyro_bias", 12))  # fmt: skip
    for title, name, first in listed:
        cells = [element("td", title)]
        for k, value in enumerate(state[name]):
            half = _number(INTERVAL * state["standard_deviations"][first + k], 2)
            cells.append(element("td", f'{_number(value, 3)} <span class="soft">± {half}</span>', class_="n"))
        body.append(element("tr", "".join(cells)))
    words = f"{state['status_text']}. ± is half of the 95 % interval."
    return element("p", escape(words), class_="soft small") + _table(body)


def calibration_facts(view: CalibrationView) -> str:
    """What was calibrated from what, for a header."""
    return f"{escape(view.what)} · {escape(view.recording)} · {view.seconds:.0f} s of flight used"


def calibration_words(view: CalibrationView) -> str:
    """What was calibrated, and what its numbers mean."""
    text = f"{calibration_facts(view)}. Standard errors allow for residuals that are correlated."
    return element("p", text, class_="soft small")


def calibration_table(view: CalibrationView) -> str:
    """Estimates with standard errors, and what is wrong with those that should not be used."""
    heads = ("parameter", "unit", "estimate", "standard error", "95 % interval", "", "why")
    body = [element("tr", "".join(element("th", h, class_="n" if 1 < i < 5 else "") for i, h in enumerate(heads)))]
    for p in view.parameters:
        cells = [element("td", escape(p.name), class_="mono"), element("td", escape(p.unit or "–"), class_="soft")]
        known = p.determined and p.value is not None and p.std is not None
        interval = f"{_number(p.value - INTERVAL * p.std)} to {_number(p.value + INTERVAL * p.std)}" if known else "–"  # type: ignore[operator]
        shown = (_number(p.value), _number(p.std, 3)) if known else ("–", "–")
        cells += [element("td", text, class_="n") for text in (*shown, interval)]
        state = "hold" if not p.determined else "reject"
        cells.append(element("td", element("span", escape(p.state), class_=f"status {state}")))
        cells.append(element("td", escape(p.reason.removeprefix(p.state).lstrip(" ,:")), class_="soft small"))
        body.append(element("tr", "".join(cells)))
    return _table(body)


def residuals_table(view: CalibrationView) -> str:
    """Rms of the residuals of every output, before and after."""
    heads = ("output", "rms before", "rms after", "after over before")
    body = [element("tr", "".join(element("th", h, class_="n" if i else "") for i, h in enumerate(heads)))]
    for output in view.outputs:
        before, after = output.rms_before, output.rms_after
        share = f"{percent(after / before)} %" if before and after is not None else "–"
        cells = [element("td", text, class_="n") for text in (_number(before), _number(after), share)]
        body.append(element("tr", element("td", escape(output.name), class_="mono") + "".join(cells)))
    return _table(body)


def models_table(view: CalibrationView) -> str:
    """Models that were tried, with their residuals in parts of the flight that were left out."""
    heads = ("model", "rms where left out", "better by [standard errors]", "")
    body = [element("tr", "".join(element("th", h, class_="n" if i in (1, 2) else "") for i, h in enumerate(heads)))]
    for model in view.models:
        cells = [element("td", _number(n, d), class_="n") for n, d in ((model.rms, 4), (model.better_by, 2))]
        cells.append(element("td", "used" if model.is_used else "", class_="soft"))
        name = element("td", escape(model.words))
        body.append(element("tr", name + "".join(cells), class_="now" if model.is_used else ""))
    return _table(body)


def _number(value: float | None, digits: int = 4) -> str:
    """Significant digits, with a true minus."""
    return "–" if value is None else f"{value:.{digits}g}".replace("-", "−")


def _table(rows: Iterable[str]) -> str:
    return element("div", element("table", "".join(rows), class_="plain"), class_="scroll")
