"""The page: header, notices, four views. It shows what a session holds and calls it; it computes nothing itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from nicegui import events, ui

from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.workbench.model_panel import ModelPanel
from aircraft_sysid_ros.workbench.other_panels import ParametersPanel, StatePanel, VersionsPanel
from aircraft_sysid_ros.workbench.run_view import RunView
from aircraft_sysid_ros.workbench.session import Session
from aircraft_sysid_ros.workbench.views.figure import DARK, LIGHT, Theme
from aircraft_sysid_ros.workbench.views.history import effect_name
from aircraft_sysid_ros.workbench.worker import DIAGNOSE, LOAD, RECORD

STYLE = Path(__file__).with_name("style.css")
#: Time [s] between looks at the session.
_POLL = 0.25
_REMEMBER_THEME = "document.cookie = 'theme={}; path=/; max-age=31536000; samesite=strict'"
#: A figure whose view is left is told of its new size when it is gone already, which plotly.js calls an error.
_QUIET = """<script>
  addEventListener("unhandledrejection", (e) => {
    if (String(e.reason?.message ?? e.reason).includes("displayed plot div")) e.preventDefault();
  });
</script>"""
_ASK_THEME = "matchMedia('(prefers-color-scheme: dark)').matches"


@dataclass
class Look:
    """What one browser looks at: others may look at something else of the same run."""

    theme: Theme = LIGHT
    window: tuple[float, float] | None = None  # [s]; None is the whole flight
    marks: list[tuple[float, float]] = field(default_factory=list)
    beside: str | None = None  # version that is drawn as well


class Page:
    """One browser's page of a session."""

    def __init__(self, session: Session, theme: str | None) -> None:
        self.session, self.look = session, Look(DARK if theme == "dark" else LIGHT)
        self._seen, self._view, self._record = -1, session.view, session.record
        ui.add_css(STYLE)
        ui.add_head_html(_QUIET)
        self._dark = ui.dark_mode(self.look.theme is DARK)
        self._header()
        with ui.tab_panels(self.tabs, value="Model", animated=False):
            self._panels = [
                self._panel("Model", ModelPanel(self)),
                self._panel("Versions", VersionsPanel(self)),
                self._panel("Parameters", ParametersPanel(self)),
                self._panel("State", StatePanel(self)),
            ]
        self.tabs.on_value_change(lambda event: self._show(event.value))
        self._refresh()
        ui.timer(_POLL, self._refresh)
        ui.keyboard(self._key, ignore=["input", "select", "textarea"])
        if theme is None:
            ui.timer(0.1, self._adopt_theme, once=True)

    @property
    def view(self) -> RunView:
        """The run as it is known now."""
        assert self.session.view is not None
        return self.session.view

    @property
    def beside(self) -> Comparison | None:
        """The comparison of the other version that is drawn."""
        return self.view.comparisons.get(self.look.beside) if self.look.beside else None

    # -- frame -----------------------------------------------------------------------------------------------

    def _header(self) -> None:
        with ui.element("header").classes("top"):
            with ui.element("div").classes("top-inner"):
                with ui.element("div").classes("who"):
                    ui.label(self.view.aircraft).classes("name")
                    self._facts = ui.html("", sanitize=False).classes("facts").props("data-testid=facts")
                ui.element("div").classes("spring")
                with ui.tabs().props("no-caps inline-label aria-label=Views") as self.tabs:
                    for name in ("Model", "Versions", "Parameters", "State"):
                        ui.tab(name).props(f"data-testid=tab-{name.lower()}")
                self._switch = ui.button(icon="contrast", on_click=self._toggle_theme).props(
                    'flat round dense color=grey-7 aria-label="Light or dark" data-testid=theme'
                )
            self._notice()

    def _notice(self) -> None:
        with ui.element("div").classes("notice").props("role=status aria-live=polite data-testid=notice") as box:
            self._notice_box = box
            self._notice_text = ui.label("").classes("text")
            self._bar = ui.linear_progress(0.0, show_value=False).classes("bar").props("instant-feedback rounded")
            self._stop = ui.button("Stop", on_click=self.session.stop).props("flat dense data-testid=stop")

    def _panel(self, name: str, panel: ModelPanel | VersionsPanel | ParametersPanel | StatePanel) -> tuple[str, object]:
        with ui.tab_panel(name) as place:
            pass
        panel.place = place
        if name == "Model":
            panel.show()
        return name, panel

    def _show(self, name: str) -> None:
        """Build a view when it is first looked at."""
        for panel_name, panel in self._panels:
            if panel_name == name:
                panel.show()  # type: ignore[attr-defined]

    # -- what changes ----------------------------------------------------------------------------------------

    def _refresh(self) -> None:
        """Follow the session."""
        session = self.session
        if session.busy:
            self._progress()
        if session.revision == self._seen:
            return
        self._seen = session.revision
        self._say()
        if not self._facts.content:
            self._facts.content = self._facts_text()
        if session.view is not self._view or session.record is not self._record:
            self._view, self._record = session.view, session.record
            self._facts.content = self._facts_text()
            if self.look.beside not in self.view.comparisons:
                self.look.beside = None
            for _, panel in self._panels:
                panel.refresh()  # type: ignore[attr-defined]
        for _, panel in self._panels:
            panel.allow(self.allowed)  # type: ignore[attr-defined]

    def redraw_model(self) -> None:
        """The time plots, after another version was chosen to be drawn as well."""
        model = self._panels[0][1]
        if isinstance(model, ModelPanel):
            model.draw()

    @property
    def allowed(self) -> bool:
        """Whether the run may be changed now."""
        return not self.session.damage and (self.session.job is None or self.session.job.kind == RECORD)

    def _facts_text(self) -> str:
        view = self.view
        has = ", ".join(escape(effect_name(label)) for label in view.changes)
        model = f'model <span class="mono" data-testid="model">{escape(view.current)}</span>'
        return f"{escape(view.name)} · {view.duration:.0f} s of flight · {model}" + (f", with {has}" if has else "")

    def _say(self) -> None:
        """One line under the header: work under way, what came of the last, or why the run cannot be read."""
        session, job = self.session, self.session.job
        works = job is not None and job.kind not in (LOAD, RECORD)
        text = session.damage or session.sentence
        text = text[:1].upper() + text[1:]
        if works and job is not None:
            text = ""
            self._progress()
        else:
            self._notice_text.text = text
        self._notice_box.set_visibility(bool(text) or works)
        self._notice_box.classes(add="bad" if session.damage or session.is_bad else "", remove="bad")
        if session.damage or session.is_bad:
            self._notice_box.classes("bad")
        self._bar.set_visibility(works)
        self._stop.set_visibility(works)

    def _progress(self) -> None:
        job = self.session.job
        if job is None or job.kind in (LOAD, RECORD):
            return
        told = self.session.told
        what = told.what or ("looking for what is missing" if job.kind == DIAGNOSE else job.text)
        self._notice_text.text = f"{what[:1].upper()}{what[1:]} · {self.session.elapsed:.0f} s"
        self._bar.value = max(told.share, 0.02)

    # -- theme and keys --------------------------------------------------------------------------------------

    async def _adopt_theme(self) -> None:
        """Light or dark as the browser asks, at the first visit."""
        if await ui.run_javascript(_ASK_THEME, timeout=5.0):
            self._set_theme(DARK)

    def _toggle_theme(self) -> None:
        self._set_theme(LIGHT if self.look.theme is DARK else DARK)
        ui.run_javascript(_REMEMBER_THEME.format(self.look.theme.name))

    def _set_theme(self, theme: Theme) -> None:
        self.look.theme = theme
        self._dark.value = theme is DARK
        for _, panel in self._panels:
            panel.refresh()  # type: ignore[attr-defined]

    def _key(self, event: events.KeyEventArguments) -> None:
        """Arrows move the window of time, plus and minus change it, 0 shows all."""
        if not event.action.keydown or event.modifiers.ctrl or event.modifiers.alt or event.modifiers.meta:
            return
        model = self._panels[0][1]
        if self.tabs.value == "Model" and isinstance(model, ModelPanel):
            model.key(event.key.name or "")
