"""The page of a run: five views. It shows what a session holds and calls it; it computes nothing itself."""

from __future__ import annotations

from nicegui import ui

from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.calibration_panel import CalibratePanel
from aircraft_sysid_ros.workbench.calibration_view import CalibrationFolder
from aircraft_sysid_ros.workbench.frame import POINT, Frame
from aircraft_sysid_ros.workbench.model_panel import ModelPanel
from aircraft_sysid_ros.workbench.other_panels import ParametersPanel, StatePanel
from aircraft_sysid_ros.workbench.panel import Panel
from aircraft_sysid_ros.workbench.residuals_panel import ResidualsPanel
from aircraft_sysid_ros.workbench.run_picker import run_picker
from aircraft_sysid_ros.workbench.run_view import RunView
from aircraft_sysid_ros.workbench.session import READS, Session
from aircraft_sysid_ros.workbench.shelf import Shelf
from aircraft_sysid_ros.workbench.versions_panel import VersionsPanel
from aircraft_sysid_ros.workbench.views.history import changed_from_first
from aircraft_sysid_ros.workbench.worker import DIAGNOSE, RECORD

#: Why less is compared than was recorded.
COMPARED = "compared is the longest stretch in flight, from when the filter has settled to its last whole window"


class Page(Frame):
    """One browser's page of a session."""

    def __init__(self, session: Session, theme: str | None, shelf: Shelf | None = None, name: str = "") -> None:
        self.shelf, self.run = shelf, name
        self._seen, self._view, self._record = -1, session.view, session.record
        self._held: set[str] = set()
        super().__init__(session, theme)

    @property
    def name(self) -> str:
        """The aircraft."""
        return self.view.aircraft

    def views(self) -> dict[str, Panel]:
        """All that is known of a run."""
        self._model, self._versions = ModelPanel(self), VersionsPanel(self)
        found: dict[str, Panel] = {
            "Model": self._model,
            "Residuals": ResidualsPanel(self),
            "Versions": self._versions,
            "Parameters": ParametersPanel(self),
            "State": StatePanel(self),
            "Calibration": CalibratePanel(self),
        }
        self._calibrated: tuple[CalibrationFolder | None, int] = (None, -1)
        return found

    @property
    def view(self) -> RunView:
        """The run as it is known now."""
        view: RunView | None = self.session.view
        assert view is not None
        return view

    @property
    def other_runs(self) -> list[str]:
        """Names of the other runs of the same server."""
        return [] if self.shelf is None else [name for name in self.shelf.names if name != self.run]

    def other_session(self, name: str) -> Session:
        """The session of another run, which stays open while this page is. Raises InputError."""
        assert self.shelf is not None
        if name not in self._held:
            session = self.shelf.session(name)
            self._held.add(name)
            ui.context.client.on_delete(self.shelf.hold(name))
            return session
        return self.shelf.session(name)

    @property
    def beside(self) -> Comparison | None:
        """The comparison of the other version that is drawn."""
        return self.view.comparisons.get(self.look.beside) if self.look.beside else None

    def help(self) -> dict[str, str]:
        """Keys of the time plots, and the way from a failing model to a better one."""
        return {
            "Where, Why, Add": "where the model fails, which effect it lacks, and the effect in the model; "
            "Undo takes the last change back",
            "← →": "move the window of time",
            "+ −": "zoom in and out",
            "0": "the whole flight",
            "Versions": "what each is called, and two of them, or two flights, side by side",
            "Parameters, Calibration": "refine by maximum likelihood, and calibrate sensors, from this run; "
            "Undo brings back what was there before",
            "Drag in a time plot": "zooms; a double click shows everything again",
            **POINT,
            **super().help(),
        }

    def header_extras(self) -> None:
        """The other runs of the same server."""
        if self.shelf is not None:
            run_picker(self.shelf, self.run)

    def notice_extras(self) -> None:
        """Progress of the work under way, and its end."""
        self._bar = ui.linear_progress(0.0, show_value=False).classes("bar").props("instant-feedback rounded")
        self._stop = ui.button("Stop", on_click=self.session.stop).props("flat dense data-testid=stop")

    # -- what changes ----------------------------------------------------------------------------------------

    def follow(self) -> None:
        """Show what the session holds now."""
        session = self.session
        if session.calibration is not None:
            self._follow_calibration(session.calibration)
        if session.busy:
            self._progress()
        self._versions.follow()
        if session.revision == self._seen:
            return
        self._seen = session.revision
        self._say()
        if not self.facts.content:
            self.facts.show(self._facts_text())
        if session.view is not self._view or session.record is not self._record:
            if self._view is not None and not self._view.is_of_flight(self.view.signature):
                self.look.window, self.look.marks = None, []  # in the flight that was there before
            self._view, self._record = session.view, session.record
            self.heading.text = self.name  # of another aircraft, where the run was written anew
            self.facts.show(self._facts_text())
            if self.look.beside not in self.view.comparisons:
                self.look.beside = None
            for panel in self.panels.values():
                panel.refresh()
        self.allow()

    def _follow_calibration(self, folder: CalibrationFolder) -> None:
        folder.look()
        if (folder, folder.revision) != self._calibrated:
            self._calibrated = (folder, folder.revision)
            self.panels["Calibration"].refresh()

    def redraw_model(self) -> None:
        """The time plots, after another version was chosen to be drawn as well."""
        self._model.draw()

    @property
    def allowed(self) -> bool:
        """Whether the run may be changed now."""
        session = self.session
        return not (session.damage or session.waiting) and (session.job is None or session.job.kind == RECORD)

    def _facts_text(self) -> str:
        view = self.view
        begin = (view.name, markup.lengths(view.lengths, COMPARED))
        return markup.model_facts(begin, view.current, view.name_of(view.current), changed_from_first(view.changes))

    def _say(self) -> None:
        """One line under the header: work under way, what came of the last, or why the run cannot be read."""
        session, job = self.session, self.session.job
        works = job is not None and job.kind not in READS
        text = "" if works else session.damage or session.sentence
        self.notice(text, bool(session.damage or session.is_bad), is_shown=works)
        self._progress()
        self._bar.set_visibility(works)
        self._stop.set_visibility(works)

    def _progress(self) -> None:
        job = self.session.job
        if job is None or job.kind in READS:
            return
        told = self.session.told
        what = told.what or ("looking for what is missing" if job.kind == DIAGNOSE else job.text)
        self._notice_text.show(f"{what[:1].upper()}{what[1:]} · {self.session.elapsed:.0f} s")
        self._bar.value = max(told.share, 0.02)

    def key(self, name: str) -> None:
        """Arrows move the window of time, plus and minus change it, 0 shows all."""
        super().key(name)
        if self.tabs.value == "Model":
            self._model.key(name)
