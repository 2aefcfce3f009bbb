"""A calibration on the page: what was found, whether the flight tells it, and residuals before and after."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import events, ui

from aircraft_sysid_ros.after_flight.calibrate import possible
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.calibration_view import CalibrationFolder, CalibrationView
from aircraft_sysid_ros.workbench.frame import Frame
from aircraft_sysid_ros.workbench.panel import Html, Panel, card, plot
from aircraft_sysid_ros.workbench.views import calibration as views
from aircraft_sysid_ros.workbench.worker import CALIBRATE, UNDO, Job

_SENSORS = {
    "five-hole": "five-hole probe",
    "magnetometer": "magnetometer",
    "compatibility": "IMU and air data together",
}
_CALIBRATE = (
    "Finds errors of sensors from the samples of this run by the two-stage estimator, as calibrate does; from a flight "
    "without the manoeuvres that it needs it says so. It can be stopped."
)
_CANNOT = (
    "This run holds no samples of sensors that can be calibrated: IMU, GPS, and a probe, a magnetometer or air data."
)


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
            if len(view.trace) > 1:
                self._html(markup.TRACE_LEGEND)
        if len(view.trace) < 2:  # a start that was given, and no picture of Tr R
            return
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


class CalibratePanel(Panel):
    """The view of a run: a calibration from its samples is begun, and the last one is shown."""

    def __init__(self, page: Any) -> None:
        super().__init__(page)
        self._found: CalibrationPanel | None = None

    def build(self) -> None:
        """Make the choice, the button, and the place of what is found."""
        with (
            ui.element("div").classes("view wide").style("padding-bottom:0"),
            card("Calibrate sensors from this flight"),
        ):
            self._words = ui.label("").classes("soft small").props("data-testid=calibrate-words")
            with ui.row().style("align-items:center; gap:12px; margin-top:10px") as self._row:
                self._what = ui.select([], label="sensors", on_change=self._show_undo)
                self._what.props("outlined dense options-dense").style("width:250px")
                button = ui.button("Calibrate", on_click=self._calibrate).props("unelevated data-testid=calibrate")
                self.changing(button)
                self._undo = ui.button("Undo", on_click=self._take_back).props("flat data-testid=undo-calibrate")
                self.changing(self._undo)
        self._below = ui.element("div").style("width:100%")
        self.update()

    def update(self) -> None:
        """After a change of the run, of the calibration or of the theme."""
        samples, folder = self.page.view.run.samples, self.page.session.calibration
        options = {what: _SENSORS[what] for what in (possible(samples) if samples is not None else ())}
        self._words.text = _CALIBRATE if options else _CANNOT
        self._row.set_visibility(bool(options))
        self._what.set_options(
            options, value=self._what.value if self._what.value in options else next(iter(options), None)
        )
        self._show_undo()
        if folder is None:
            self._below.clear()
            self._found = None
        elif self._found is None or self._found.folder is not folder:
            self._below.clear()
            self._found = CalibrationPanel(self.page, folder)
            self._found.place = self._below
            self._found.show()
        else:
            self._found.refresh()

    def _show_undo(self) -> None:
        """Offer to take back what was calibrated last of the chosen sensors."""
        self._undo.set_visibility(f"{CALIBRATE} {self._what.value}" in self.page.view.undoable)

    def _take_back(self) -> None:
        if not self.page.session.start(Job(UNDO, f"{CALIBRATE} {self._what.value}")):
            ui.notify("Something else is under way: wait for it to end")

    def _calibrate(self) -> None:
        if not self.page.session.start(Job(CALIBRATE, str(self._what.value))):
            ui.notify("Something else is under way: wait for it to end")


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
            self.heading.text = self.name
            self.panels["Calibration"].refresh()
