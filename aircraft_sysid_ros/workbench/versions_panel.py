"""The view of versions: their history, what they are called, and two of them, or two flights, side by side."""

from __future__ import annotations

from typing import Any

from nicegui import events, ui

from aircraft_sysid_ros.diagnosis.model_versions.labels import LONGEST_NAME, LONGEST_NOTE, Label
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.beside_panel import BesidePanel
from aircraft_sysid_ros.workbench.panel import Html, Panel, card, fold
from aircraft_sysid_ros.workbench.views.history import VersionRow, history
from aircraft_sysid_ros.workbench.worker import NAME, RETURN, UNNAME, Job


class VersionsPanel(Panel):
    """The history of the model; below it names and notes, and two side by side."""

    def __init__(self, page: Any) -> None:
        super().__init__(page)
        self._beside = BesidePanel(page)

    def build(self) -> None:
        """Make the table, the form of a name, and what stands beside each other."""
        with ui.element("div").classes("view wide"):
            with card("History of the model"):
                ui.label("Errors in % of the spread, on validation data. ▲ fails somewhere.").classes("soft small")
                self._table = Html().props("data-testid=history")
                self._form()
            self._beside.place = ui.element("div").style("width:100%")
        self.update()
        self._beside.show()

    def follow(self) -> None:
        """Another run may have been read meanwhile."""
        self._beside.follow()

    def _form(self) -> None:
        """What a version is called."""
        self._shown: tuple[str, Label] | None = None
        with fold("Name a version, or go back to it", "naming"):
            with ui.element("div").classes("naming"):
                self._which = ui.select([], label="version", on_change=self._fill).props("outlined dense options-dense")
                self._name = ui.input("name").props(f"outlined dense maxlength={LONGEST_NAME} data-testid=version-name")
                self._note = ui.textarea("note").props(  # a field that grew would move the button while it is pressed
                    f"outlined dense rows=3 maxlength={LONGEST_NOTE} counter data-testid=version-note"
                )
            with ui.row().style("gap:10px; margin-top:6px"):
                keep = ui.button("Keep the name", on_click=self._keep).props("unelevated data-testid=keep-name")
                undo = ui.button("Undo", on_click=lambda: self._do(UNNAME)).props("flat data-testid=undo-name")
                back = ui.button("Make it the current one", on_click=lambda: self._do(RETURN))
            self.changing(keep)
            self._return = self.changing(back.props("outline data-testid=make-current"))
            self._undo = self.changing(undo)

    def update(self) -> None:
        """After a change of the run."""
        view = self.page.view
        rows = {r.identifier: r for r in history(view.versions, view.current, view.comparisons, view.labels)}
        self._rows: dict[str, VersionRow] = rows
        self._table.show(markup.history_table(list(rows.values())))
        names = {identifier: row.title for identifier, row in rows.items()}
        self._which.set_options(names, value=self._which.value if self._which.value in names else view.current)
        self._fill()
        self._beside.refresh()

    def _fill(self, event: events.ValueChangeEventArguments[Any] | None = None) -> None:
        """Name and note of the chosen version, unless they are shown already: somebody may be typing."""
        row = self._rows[self._which.value]
        if self._shown != (row.identifier, row.label):
            self._shown = (row.identifier, row.label)
            self._name.value, self._note.value = row.label.name, row.label.note
        self._return.set_visibility(row.identifier != self.page.view.current)
        self._undo.set_visibility(len(self.page.view.labels.get(row.identifier, ())) > 1)

    def _keep(self) -> None:
        self._do(NAME, str(self._name.value or ""), str(self._note.value or ""))

    def _do(self, kind: str, *more: str) -> None:
        if not self.page.session.start(Job(kind, str(self._which.value), more)):
            ui.notify("Something else is under way: wait for it to end")
