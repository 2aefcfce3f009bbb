"""A calibration on the page: what was found, whether the flight tells it, and residuals before and after."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import events, ui

from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.calibration_view import CalibrationFolder, CalibrationView
from aircraft_sysid_ros.workbench.frame import Frame
from aircraft_sysid_ros.workbench.panel import Html, Panel, card, plot
from aircraft_sysid_ros.workbench.views import calibration as views


class CalibrationPanel(Panel):
    """Estimates, stage 1, residuals; drawn anew when the folder was changed."""

    def __init__(self, page: Any, folder: CalibrationFolder) -> None:
        super().__init__(page)
        self.folder = folder
        self._plane = (0, 1)

    def build(self) -> None:
        """Make the place of everything."""
        self._place = ui.element("div").classes("view wide")
        self.update()

    def update(self) -> None:
        """After a change of the folder or the theme."""
        view, self._theme = self.folder.view, self.page.look.theme
        self._place.clear()
        with self._place:
            if self.folder.damage:
                ui.label(self.folder.damage).classes("flag").props("role=alert data-testid=calibration-damage").style(
                    "white-space:normal"
                )
            with card("What was found"):
                self._html(markup.calibration_words(view))
                self._html(markup.calibration_table(view), "calibration")
                for note in view.notes:
                    ui.label(f"Note: {note}").classes("small")
            self._stage(view)
            self._residuals(view)

    def _stage(self, view: CalibrationView) -> None:
        with card():
            title = ui.label(views.verdict(view)).classes("heading").props("data-testid=calibration-verdict")
            title.classes("" if view.unique else "flag")
            for text in views.sentences(view):
                ui.label(text)
            self._html(markup.TRACE_LEGEND)
        with ui.element("div").classes("grid2"):
            for column, parameter in enumerate(view.sampled):
                made = views.trace_figure(view, column, self._theme)
                self._figure(f"Tr R over {parameter.name}", made, f"trace-{column}")
            found = views.distance_figure(view, self._theme)
            if found is not None:
                self._figure("Tr R over the distance from the estimate", found, "trace-distance")
            if len(view.sampled) > 1:
                self._plane_card(view)

    def _plane_card(self, view: CalibrationView) -> None:
        self._plane = self._plane if max(self._plane) < len(view.sampled) else (0, 1)
        options = {i: p.name for i, p in enumerate(view.sampled)}
        with card("Tr R over two parameters, × is the estimate").style("grid-column: 1 / -1"):
            with ui.element("div").classes("pickers two"):
                for place, label in enumerate(("across", "upwards")):
                    picker = ui.select(options, value=self._plane[place], label=label, on_change=self._choose(place))
                    picker.props("dense options-dense outlined")
            made = views.plane_figure(view, *self._plane, self._theme)
            self._drawn = plot(made, "Tr R over two sampled parameters").props("data-testid=trace-plane")

    def _choose(self, place: int) -> Any:
        def chosen(event: events.ValueChangeEventArguments[Any]) -> None:
            both = [*self._plane]
            both[place] = int(event.value)
            self._plane = (both[0], both[1])
            self._drawn.update_figure(views.plane_figure(self.folder.view, *self._plane, self._theme))

        return chosen

    def _residuals(self, view: CalibrationView) -> None:
        with card(f"Residuals before and after [{view.unit}]"):
            self._html(markup.residuals_table(view), "calibration-residuals")
            self._html(markup.RESIDUAL_LEGEND)
        if view.models:
            with card(f"Models that were tried, in parts of the flight that were left out [{view.unit}]"):
                self._html(markup.models_table(view), "calibration-models")
        with ui.element("div").classes("grid2"):
            for number, output in enumerate(view.outputs):
                self._figure(output.name, views.residual_figure(view, output, self._theme), f"residual-{number}")

    def _figure(self, title: str, made: Any, name: str) -> None:
        with card(title):
            plot(made, title).props(f"data-testid={name}")

    def _html(self, text: str, name: str = "") -> None:
        found = Html(text)
        if name:
            found.props(f"data-testid={name}")


class CalibrationSession:
    """A calibration without a run, for all browsers that look at it."""

    def __init__(self, folder: CalibrationFolder) -> None:
        self.folder = folder

    def wait(self, timeout: float, tell: Callable[[str, float], None] = lambda what, share: None) -> None:
        """It is read already."""

    def close(self) -> None:
        """Nothing is open."""


class CalibrationPage(Frame):
    """One browser's page of a calibration."""

    @property
    def name(self) -> str:
        """The aircraft."""
        return str(self.session.folder.view.aircraft)

    def views(self) -> dict[str, Panel]:
        """One view."""
        self._seen = self.session.folder.revision
        return {"Calibration": CalibrationPanel(self, self.session.folder)}

    @property
    def allowed(self) -> bool:
        """Nothing can be changed here."""
        return False

    def follow(self) -> None:
        """Show what the folder holds now."""
        folder = self.session.folder
        folder.look()
        self.facts.show(markup.calibration_facts(folder.view))
        self.notice(folder.damage, is_bad=bool(folder.damage))
        if folder.revision != self._seen:
            self._seen = folder.revision
            self.panels["Calibration"].refresh()
