"""Maximum likelihood on the version that is shown: begun, and what it found beside what was known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nicegui import ui

from aircraft_sysid_ros.after_flight.refine import refined_sentences
from aircraft_sysid_ros.refinement.refined_file import FILTER_ERROR, METHODS, OUTPUT_ERROR
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.panel import Html, Panel, card
from aircraft_sysid_ros.workbench.views.words import sentence, typeset
from aircraft_sysid_ros.workbench.worker import REFINE, UNDO, Job

_WORDS = {
    FILTER_ERROR: "A Kalman filter with the model; gusts and the noise of the sensors are estimated, too.",
    OUTPUT_ERROR: "Simulates each piece of the flight from its start, for calm air.",
}


class RefinePanel(Panel):
    """A method, the button, and the last result of that method on the current version."""

    def build(self) -> None:
        """Make everything."""
        with card("Maximum likelihood"):
            ui.label(
                "Fits the whole aircraft model at once to what the sensors measured; the table above has each axis for "
                "itself. Half a minute to some minutes; it can be stopped, and the run is then as it was."
            ).classes("soft small")
            with ui.row().style("align-items:center; gap:12px; margin-top:10px"):
                names = {method: method.replace("-", " ") for method in METHODS}
                self._method = ui.select(names, value=FILTER_ERROR, label="method", on_change=self.update)
                self._method.props("outlined dense options-dense data-testid=refine-method").style("width:170px")
                button = ui.button("Refine", on_click=self._refine).props("unelevated data-testid=refine")
                self.changing(button)
                self._undo = ui.button("Undo", on_click=self._take_back).props("flat data-testid=undo-refine")
                self.changing(self._undo)
            self._words = ui.label("").classes("soft small")
            self._said = ui.element("div").props("data-testid=refined-words").style("margin-top:6px")
            with ui.element("div").classes("beside") as self._tables:
                self._errors = Html().props("data-testid=refined-errors")
                self._parameters = Html().props("data-testid=refined")
        self.update()

    def update(self) -> None:
        """After a change of the run or of the method."""
        method, view = str(self._method.value), self.page.view
        found: Mapping[str, Any] | None = view.refined.get(method)
        self._words.text = _WORDS[method]
        self._undo.set_visibility(f"{REFINE} {method}" in view.undoable)
        self._said.clear()
        self._tables.set_visibility(found is not None)
        with self._said:
            if found is None:
                ui.label(f"Version {view.current} was not refined by this method yet.")
                return
            for text in refined_sentences(dict(found)):
                said = Html(typeset(sentence(text) + ".")).style("white-space:normal")
                said.classes("flag" if text.startswith(("WORSE", "NOT")) else "")
        self._errors.show(markup.refined_errors(found["not_fitted"]))
        listed = view.parameters[view.current]
        self._parameters.show(markup.parameters_beside(listed, found["parameters"], ("table above", "refined")))

    def _refine(self) -> None:
        if not self.page.session.start(Job(REFINE, str(self._method.value))):
            ui.notify("Something else is under way: wait for it to end")

    def _take_back(self) -> None:
        if not self.page.session.start(Job(UNDO, f"{REFINE} {self._method.value}")):
            ui.notify("Something else is under way: wait for it to end")
