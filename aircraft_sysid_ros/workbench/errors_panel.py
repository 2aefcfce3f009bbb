"""Errors of all axes as bars that move when the model changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nicegui import ui

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.panel import Html, card
from aircraft_sysid_ros.workbench.views.coefficients import AxisRow
from aircraft_sysid_ros.workbench.views.words import percent, symbol, typeset


class Errors:
    """Bars with numbers, in a box of their own."""

    def __init__(self, title: str, words: str) -> None:
        self._rows: dict[str, dict[str, Any]] = {}
        with card(title):
            ui.label(words).classes("soft small")
            with ui.element("div").classes("errors"):
                ui.label("").classes("head")
                self._scale = Html()
                for text in ("error", "noise", ""):
                    ui.label(text).classes("head")
                for name in AXES:
                    self._row(name)
            self._notes = ui.element("div").classes("notes soft small")

    def _row(self, name: str) -> None:
        Html(symbol(name)).classes("sym")
        with ui.element("div").classes("track") as track:
            was = ui.element("div").classes("was")
            fill = ui.element("div").classes("fill").props(f"data-testid=bar-{name}")
            tick = ui.element("div").classes("tick")
        error = ui.label("").classes("num").props(f"data-testid=held-out-{name}")
        noise = ui.label("").classes("num soft").props(f"data-testid=noise-{name}")
        words = Html()
        parts = {"track": track, "fill": fill, "was": was, "tick": tick, "error": error, "noise": noise}
        self._rows[name] = {**parts, "words": words}

    def show(self, rows: Sequence[AxisRow], before: Mapping[str, float], notes: Sequence[str] = ()) -> None:
        """Set lengths and numbers, the style moves them; ``before`` are errors of the model before the change."""
        self._notes.clear()
        self._notes.set_visibility(bool(notes))
        with self._notes:
            for note in notes:
                Html(typeset(note))
        top = markup.errors_scale([*(row.held_out for row in rows), *before.values()])
        self._scale.show(markup.scale_head(top))
        for row in rows:
            self._show(row, top, before.get(row.axis))

    def _show(self, row: AxisRow, top: float, was: float | None) -> None:
        parts, known = self._rows[row.axis], row.held_out is not None
        for part in ("track", "fill", "error"):
            parts[part].set_visibility(known)
        for part in ("tick", "noise"):
            parts[part].set_visibility(known and row.floor is not None)
        parts["words"].classes(add="" if known else "whole", remove="whole" if known else "")
        parts["words"].show(markup.state_words(row))
        parts["was"].set_visibility(False)
        if row.held_out is None:
            return
        parts["fill"].style(f"width:{100.0 * row.held_out / top:.2f}%")
        parts["fill"].classes(add="fails" if row.fails else "", remove="" if row.fails else "fails")
        parts["error"].text = f"{percent(row.held_out)} %"
        if row.floor is not None:
            parts["tick"].style(f"left:{100.0 * min(row.floor / top, 1.0):.2f}%")
            parts["noise"].text = f"{percent(row.floor)} %"
        if was is not None and abs(was - row.held_out) > 0.002:
            parts["was"].set_visibility(True)
            parts["was"].style(f"width:{100.0 * was / top:.2f}%")
