"""Pages of several runs: the list of them, one that is being read, and the picker on the page of a run."""

from __future__ import annotations

import time

from nicegui import ui

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.frame import Frame
from aircraft_sysid_ros.workbench.page import Page
from aircraft_sysid_ros.workbench.panel import Html, Panel, card, picked
from aircraft_sysid_ros.workbench.run_picker import go_to, run_picker
from aircraft_sysid_ros.workbench.session import Session
from aircraft_sysid_ros.workbench.shelf import ListedRun, Shelf

#: Time [s] between looks at the folder of runs.
_LOOK = 2.0


def shelf_page(shelf: Shelf, theme: str | None, name: str | None) -> object:
    """The page of the run that an address names, or the list of all."""
    if not name:
        return ShelfPage(shelf, theme)
    try:
        session = shelf.session(name)
    except InputError as error:
        return ShelfPage(shelf, theme, str(error))
    release = shelf.hold(name)
    ui.context.client.on_delete(release)
    ui.page_title(f"{name} · workbench")
    if session.view is None:
        return ReadingPage(session, shelf, name, theme)
    return Page(session, theme, shelf, name)


class ShelfPage(Frame):
    """The list of runs."""

    def __init__(self, shelf: Shelf, theme: str | None, complaint: str = "") -> None:
        self.complaint, self._looked = complaint, 0.0
        super().__init__(shelf, theme)

    @property
    def name(self) -> str:
        """Name of the folder."""
        return str(self.session.title)

    def views(self) -> dict[str, Panel]:
        """One view."""
        self._runs = RunsPanel(self)
        return {"Runs": self._runs}

    @property
    def allowed(self) -> bool:
        """Nothing can be changed here."""
        return False

    def help(self) -> dict[str, str]:
        """What can be done here."""
        return {"A name": "opens the run; new runs appear by themselves", **super().help()}

    def follow(self) -> None:
        """Show which runs there are now."""
        if time.monotonic() - self._looked < _LOOK:
            return
        self.notice(self.complaint, is_bad=True)
        self._runs.refresh()
        count = len(self._runs.rows)
        self.facts.show(f"{count} run{'s' if count != 1 else ''}")
        self._looked = time.monotonic()


class RunsPanel(Panel):
    """A table of runs."""

    rows: list[ListedRun]

    def build(self) -> None:
        """Make the table."""
        self.rows = []
        with ui.element("div").classes("view wide"), card("Runs"):
            ui.label("Press a name to open the run.").classes("soft small")
            self._table = Html().props("data-testid=runs")
            picked(self._table, go_to)
        self.update()

    def update(self) -> None:
        """Look at the folder."""
        rows = self.page.session.listed()
        if rows != self.rows or not self._table.content:
            self.rows = rows
            self._table.show(markup.runs_table(rows))


class ReadingPage(Frame):
    """A run that is being read, or why it cannot be."""

    def __init__(self, session: Session, shelf: Shelf, name: str, theme: str | None) -> None:
        self.shelf, self.run, self._goes = shelf, name, False
        super().__init__(session, theme)

    @property
    def name(self) -> str:
        """Of the folder."""
        return self.run

    def views(self) -> dict[str, Panel]:
        """One view, which is empty."""
        return {"Run": _NothingYet(self)}

    @property
    def allowed(self) -> bool:
        """Nothing can be changed here."""
        return False

    def header_extras(self) -> None:
        """The other runs."""
        run_picker(self.shelf, self.run)

    def follow(self) -> None:
        """How far it is; the page of the run when it has been read."""
        session = self.session
        if session.view is not None and not self._goes:
            self._goes = True
            go_to(self.run)
        told = f"{session.told.what} · {session.elapsed:.0f} s" if session.busy else ""
        self.notice(session.damage or told, is_bad=bool(session.damage))


class _NothingYet(Panel):
    """Nothing to show."""

    def build(self) -> None:
        """Nothing."""

    def update(self) -> None:
        """Nothing."""
