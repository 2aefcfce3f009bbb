"""The views of versions, parameters and state."""

from __future__ import annotations

from typing import Any

from nicegui import events, ui

from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.panel import Html, Panel, card, picked, plot
from aircraft_sysid_ros.workbench.views import states
from aircraft_sysid_ros.workbench.views.figure import Figure
from aircraft_sysid_ros.workbench.views.history import VersionRow, history
from aircraft_sysid_ros.workbench.views.numbers import parameters_csv
from aircraft_sysid_ros.workbench.views.parameters import IN_FLIGHT, OF_ALL, history_figure, parameter_rows

#: Where there is nothing to compare with.
ONE_VERSION = (
    "There is one version only. Add an effect or a term in the view Model, under Why or Add (or in a terminal: "
    "aircraft-sysid add {} dihedral_alpha), and the new version stands here beside this one."
)


class VersionsPanel(Panel):
    """The history of the model, and two versions side by side."""

    def build(self) -> None:
        """Make the table, the two pickers and what stands beside each other."""
        with ui.element("div").classes("view wide"):
            with card("History of the model"):
                ui.label("Errors in % of the spread, on flight that was not seen. ▲ fails somewhere.").classes(
                    "soft small"
                )
                self._table = Html().props("data-testid=history")
            with card("Two versions side by side"):
                self._lonely = ui.label("").props("data-testid=one-version")
                self._pair = ui.element("div").style("width:100%")
            with self._pair:
                with ui.row().style("gap:14px; margin:10px 0; align-items:center"):
                    self._one = ui.select([], label="one", on_change=self._beside).props("outlined dense")
                    self._other = ui.select([], label="the other", on_change=self._beside).props("outlined dense")
                    self._draw = ui.switch("draw the first one in the time plots too", on_change=self._chosen)
                with ui.element("div").classes("grid2"):
                    self._errors = Html().props("data-testid=beside")
                    self._parameters = Html()
        self.update()

    def update(self) -> None:
        """After a change of the run."""
        view = self.page.view
        self._rows = {row.identifier: row for row in history(view.versions, view.current, view.comparisons)}
        self._table.show(markup.history_table(list(self._rows.values())))
        names = {row.identifier: f"{row.identifier}, {row.words}" for row in self._rows.values() if row.axes}
        self._lonely.text = ONE_VERSION.format(view.name) if len(names) < 2 else ""
        self._lonely.set_visibility(len(names) < 2)
        self._pair.set_visibility(len(names) > 1)
        current = self._rows[view.current]
        first = next(
            (name for name in (*current.parents, *names) if name in names and name != view.current), view.current
        )
        for picker, value in ((self._one, first), (self._other, view.current)):
            picker.set_options(names, value=picker.value if picker is self._one and picker.value in names else value)
        self._beside()

    def _beside(self) -> None:
        one, other = self._rows.get(self._one.value or ""), self._rows.get(self._other.value or "")
        if one is None or other is None:
            return
        self._errors.show(markup.errors_beside(one, other))
        listed = self.page.view.parameters
        names = (one.identifier, other.identifier)
        self._parameters.show(markup.parameters_beside(listed[names[0]], listed[names[1]], names))
        self._set_beside(one)

    def _chosen(self, event: events.ValueChangeEventArguments[Any]) -> None:
        one = self._rows.get(self._one.value or "")
        if one is not None:
            self._set_beside(one)

    def _set_beside(self, one: VersionRow) -> None:
        wanted = one.identifier if self._draw.value and one.identifier != self.page.view.current else None
        if wanted != self.page.look.beside:
            self.page.look.beside = wanted
            self.page.redraw_model()


class ParametersPanel(Panel):
    """Estimates, and one of them over the flight."""

    def build(self) -> None:
        """Make the table and the figure."""
        self._name = ""
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
        self.update()

    def update(self) -> None:
        """After a change of the run or the theme."""
        view = self.page.view
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
        ui.download.content(parameters_csv(rows), f"parameters_{view.current}.csv", "text/csv")

    def _choose(self, name: str) -> None:
        record = self.page.session.record
        if record is None or name not in record.parameters.names:
            ui.notify(f"{name} was not in the model in flight: it has no history")
            return
        self._name = name
        self.update()

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
        self._place = ui.element("div").classes("view wide")
        self.update()

    def update(self) -> None:
        """After a change of the theme, or when the record has been read."""
        self._place.clear()
        record = self.page.session.record
        with self._place:
            if record is None:
                ui.label(self.page.session.record_problem or "Being read.").classes("soft")
                return
            figures = states.all_figures(record.state, self.page.look.theme, self.page.session.truth.content)
            with ui.element("div").classes("grid2"):
                for title, made in figures:
                    with card(title):
                        plot(made, title)
                        if title == states.INNOVATIONS:
                            table = markup.consistency_table(states.consistencies(record.summary))
                            Html(table).props("data-testid=consistency")
