"""What the page of a run and the page of a flight in progress have in common: header, notice, views, light or dark."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nicegui import events, ui

from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.panel import Html, Panel
from aircraft_sysid_ros.workbench.views.figure import DARK, LIGHT, Theme
from aircraft_sysid_ros.workbench.views.words import sentence, typeset

STYLE = Path(__file__).with_name("style.css")
_SCRIPT = Path(__file__).with_name("frame.js").read_text(encoding="utf8")
#: Time [s] between looks at the session.
POLL = 0.25
#: Help of pages with plots over time.
POINT = {"Point at a time plot": "draws a line through all of them, with the values there; on a phone, tap"}
_REMEMBER_THEME = "document.cookie = 'theme={}; path=/; max-age=31536000; samesite=strict'"
#: A figure whose view is left is told of its new size when it is gone already, which plotly.js calls an error.
_QUIET = """<script>
  addEventListener("unhandledrejection", (e) => {
    if (String(e.reason?.message ?? e.reason).includes("displayed plot div")) e.preventDefault();
  });
</script>"""
#: What the system wants, which the browser keeps until it is closed where its user has chosen nothing: the next page is
#: then made in it, and does not flash.
_ASK_THEME = """
  const wanted = matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light';
  document.cookie = `theme=as-system-${wanted}; path=/; samesite=strict`;
  return wanted === 'dark';
"""


@dataclass
class Look:
    """What one browser looks at: others may look at something else of the same run."""

    theme: Theme = LIGHT
    window: tuple[float, float] | None = None  # [s]; None is the whole flight
    marks: list[tuple[float, float]] = field(default_factory=list)
    beside: str | None = None  # version that is drawn as well


class Frame(ABC):
    """One browser's page: a header with a notice under it, and views of which the first is shown."""

    def __init__(self, session: Any, theme: str | None) -> None:
        self.session, self.look = session, Look(DARK if (theme or "").endswith("dark") else LIGHT)
        ui.add_css(STYLE)
        ui.add_head_html(_QUIET)
        ui.add_head_html(f"<script>{markup.SCRIPT}\n{_SCRIPT}</script>")
        self._dark = ui.dark_mode(self.look.theme is DARK)
        self.panels = self.views()
        first = next(iter(self.panels))
        self._header()
        with ui.tab_panels(self.tabs, value=first, animated=False):
            for name, panel in self.panels.items():
                with ui.tab_panel(name) as panel.place:
                    pass
        self.panels[first].show()
        self.tabs.on_value_change(lambda event: self.panels[event.value].show())
        self.follow()
        ui.timer(POLL, self.follow)
        if theme not in ("light", "dark"):
            ui.timer(0.1, self._adopt_theme, once=True)
        ui.on("system-theme", lambda event: self._follow_system(bool(event.args)))
        ui.keyboard(self._pressed, ignore=["input", "select", "textarea"])

    # -- what a page adds ------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def name(self) -> str:
        """Heading of the page."""

    @abstractmethod
    def views(self) -> dict[str, Panel]:
        """The views by name."""

    @abstractmethod
    def follow(self) -> None:
        """Show what the session holds now; called every POLL seconds."""

    @property
    @abstractmethod
    def allowed(self) -> bool:
        """Whether the model may be changed now."""

    # -- frame -----------------------------------------------------------------------------------------------

    def _header(self) -> None:
        with ui.element("header").classes("top"):
            with ui.element("div").classes("top-inner"):
                with ui.element("div").classes("who"):
                    self.heading = ui.label(self.name).classes("name")
                    self.facts = Html().classes("facts").props("data-testid=facts")
                self.header_extras()
                with ui.tabs().props("no-caps inline-label aria-label=Views") as self.tabs:
                    for name in self.panels:
                        ui.tab(name).props(f"data-testid=tab-{name.lower()}")
                ui.button(icon="help_outline", on_click=self.show_help).props(
                    'flat round dense color=grey-7 aria-label="Help" data-testid=help'
                )
                ui.button(icon="contrast", on_click=self._toggle_theme).props(
                    'flat round dense color=grey-7 aria-label="Light or dark" data-testid=theme'
                )
            with ui.element("div").classes("notice").props("role=status aria-live=polite data-testid=notice") as box:
                self._notice_box = box
                self._notice_text = Html().classes("text")
                self.notice_extras()

    def help(self) -> dict[str, str]:
        """What can be done on the page, and how."""
        return {
            "Camera under a figure": "saves it as SVG",
            "◐": "light or dark",
            "?": "this help",
        }

    def show_help(self) -> None:
        """Keys, and what is not written on a button."""
        with ui.dialog() as dialog, ui.card().classes("help").props("data-testid=help-text"):
            Html(self.name + ": help", "h2")
            Html(markup.help_list(self.help()))
            ui.button("Close", on_click=dialog.close).props("unelevated")
        dialog.on_value_change(lambda event: None if event.value else dialog.delete())
        dialog.open()

    def key(self, name: str) -> None:
        """A key was pressed, by its name."""
        if name == "?":
            self.show_help()

    def _pressed(self, event: events.KeyEventArguments) -> None:
        if event.action.keydown and not (event.modifiers.ctrl or event.modifiers.alt or event.modifiers.meta):
            self.key(event.key.name or "")

    def header_extras(self) -> None:  # noqa: B027  a page may have none
        """More elements of the header."""

    def notice_extras(self) -> None:  # noqa: B027
        """More elements of the notice."""

    def notice(self, text: str, is_bad: bool, is_shown: bool = False) -> None:
        """Say one sentence under the header; nothing where it is empty, unless the notice is shown anyway."""
        self._notice_text.show(typeset(sentence(text)))
        self._notice_box.set_visibility(bool(text) or is_shown)
        self._notice_box.classes(add="bad" if is_bad else "", remove="" if is_bad else "bad")

    def allow(self) -> None:
        """Enable or disable what changes the model."""
        for panel in self.panels.values():
            panel.allow(self.allowed)

    # -- theme -----------------------------------------------------------------------------------------------

    async def _adopt_theme(self) -> None:
        """Light or dark as the system asks, where the user has not chosen."""
        try:
            wanted = DARK if await ui.run_javascript(_ASK_THEME, timeout=5.0) else LIGHT
        except TimeoutError:  # a browser that has gone, or sleeps: it stays as it is
            return
        if wanted is not self.look.theme:
            self._set_theme(wanted)

    def _follow_system(self, is_dark: bool) -> None:
        """The system went from light to dark, or back, and the user has chosen neither."""
        wanted = DARK if is_dark else LIGHT
        if wanted is not self.look.theme:
            self._set_theme(wanted)

    def _toggle_theme(self) -> None:
        self._set_theme(LIGHT if self.look.theme is DARK else DARK)
        ui.run_javascript(_REMEMBER_THEME.format(self.look.theme.name))

    def _set_theme(self, theme: Theme) -> None:
        self.look.theme = theme
        self._dark.value = theme is DARK
        for panel in self.panels.values():
            panel.refresh()
