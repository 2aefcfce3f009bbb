"""The views of parameters and state."""

from __future__ import annotations

from typing import Any

from nicegui import events, ui

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXIS_WORDS
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.panel import Html, Panel, bring_into_view, card, picked, plot
from aircraft_sysid_ros.workbench.refine_panel import RefinePanel
from aircraft_sysid_ros.workbench.views import states, track
from aircraft_sysid_ros.workbench.views.figure import Figure
from aircraft_sysid_ros.workbench.views.numbers import parameters_csv
from aircraft_sysid_ros.workbench.views.parameters import IN_FLIGHT, OF_ALL, history_figure, parameter_rows

#: What the figures of the track show.
TRACK_WORDS = ("track from above, coloured by model error", "height over time, coloured by model error")


class ParametersPanel(Panel):
    """Estimates, and one of them over the flight."""

    def build(self) -> None:
        """Make the table and the figure."""
        self._name = ""
        self._refine = RefinePanel(self.page)
        with ui.element("div").classes("view wide"):
            with card() as box:
                self._title = ui.label("").classes("heading").props("data-testid=parameter-title")
                ui.label("As it was learnt in flight. Press a name below for another one.").classes("soft small")
                self._plot = plot(self._figure(), "one parameter over the flight with its interval")
                self._empty = ui.label("").classes("soft")
            self._box = box
            with card("Parameters"):
                self._words = ui.label("").classes("soft small")
                self._table = Html().props("data-testid=parameters")
                picked(self._table, self._choose)
                button = ui.button("Parameters as CSV", icon="download", on_click=self._download)
                button.props("flat dense data-testid=save-parameters").style("margin-top:8px")
            self._refine.place = ui.element("div").style("width:100%")
        self.update()
        self._refine.show()

    def allow(self, allowed: bool) -> None:
        """Whether the panels may change the run."""
        super().allow(allowed)
        if self._built:
            self._refine.allow(allowed)

    def update(self) -> None:
        """After a change of the run or the theme."""
        view = self.page.view
        self._refine.refresh()
        self._words.text = IN_FLIGHT if view.current == view.versions[0].identifier else OF_ALL
        rows = parameter_rows(view.parameters[view.current], self.page.session.truth.parameters)
        record = self.page.session.record
        names = record.parameters.names if record else ()
        if self._name not in names:
            self._name = next((row.name for row in rows if row.name in names and row.name.endswith("_alpha")), "")
            self._name = self._name or next(iter(names), "")
        self._table.show(markup.parameter_table(rows, self._name))
        self._title.text = self._name or "No history"
        self._empty.text = "" if record else self.page.session.record_problem or "Being read."
        self._plot.set_visibility(bool(record and self._name))
        self._plot.update_figure(self._figure())

    def _download(self) -> None:
        view = self.page.view
        rows = parameter_rows(view.parameters[view.current], self.page.session.truth.parameters)
        ui.download.content(parameters_csv(rows), f"{self.page.session.name}_parameters_{view.current}.csv", "text/csv")

    def _choose(self, name: str) -> None:
        record = self.page.session.record
        if record is None or name not in record.parameters.names:
            ui.notify(f"{name} was not in the model in flight: it has no history")
            return
        self._name = name
        self.update()
        bring_into_view(self._title)

    def _figure(self) -> Figure:
        record, theme = self.page.session.record, self.page.look.theme
        if record is None or not self._name:
            return {"data": [], "layout": {"height": 300}}
        truth, view = self.page.session.truth.parameters.get(self._name), self.page.view
        listed = view.parameters[view.current] if view.current != view.versions[0].identifier else []
        fitted = next((p["value"] for p in listed if p["name"] == self._name), None)
        return history_figure(record.parameters, self._name, theme, truth, fitted)


class StatePanel(Panel):
    """Everything of the first step."""

    def build(self) -> None:
        """Make all figures, or say why there are none."""
        self._axis = track.WORST
        self._place = ui.element("div").classes("view wide")
        self.update()

    def update(self) -> None:
        """After a change of the run or the theme, or when the record has been read."""
        self._place.clear()
        record = self.page.session.record
        with self._place:
            if record is None:
                ui.label(self.page.session.record_problem or "Being read.").classes("soft")
                return
            for note in record.notes:
                ui.label(note).classes("flag").style("white-space:normal").props("data-testid=state-note")
            figures = states.all_figures(record.state, self.page.look.theme, self.page.session.truth.content)
            with ui.element("div").classes("grid2"):
                for title, made in figures:
                    if title != states.INNOVATIONS:
                        with card(title):
                            plot(made, title)
                        continue
                    with card(title).style("grid-column: 1 / -1"), ui.element("div").classes("beside"):
                        plot(made, title)
                        table = markup.consistency_table(states.consistencies(record.summary))
                        Html(table).props("data-testid=consistency")
            self._track(record.state)

    def _track(self, state: states.StateHistory) -> None:
        """The error of the model, on the map and over the height."""
        axes = {track.WORST: "worst of all", **{name: AXIS_WORDS[name] for name in self.page.view.comparison.axes}}
        self._axis = self._axis if self._axis in axes else track.WORST
        with card("Residual over the noise, along the track"):
            picker = ui.select(axes, value=self._axis, label="axis", on_change=self._choose)
            picker.props("outlined dense options-dense data-testid=track-axis").style("width:190px; margin:8px 0")
            with ui.element("div").classes("grid2"):
                self._drawn = [
                    plot(made, words).props(f"data-testid={name}")
                    for name, words, made in zip(("track", "height"), TRACK_WORDS, self._figures(state), strict=True)
                ]

    def _figures(self, state: states.StateHistory) -> list[Figure]:
        error, theme = track.flown_error(self.page.view.comparison, self._axis), self.page.look.theme
        return [track.track_figure(state, error, theme), track.height_figure(state, error, theme)]

    def _choose(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._axis = str(event.value)
        for drawn, made in zip(self._drawn, self._figures(self.page.session.record.state), strict=True):
            drawn.update_figure(made)
