"""What the views of a page have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

from markupsafe import escape
from nicegui import ui

from aircraft_sysid_ros.workbench.views.figure import Figure
from aircraft_sysid_ros.workbench.views.words import readable


class Panel(ABC):
    """One view: built when it is first shown, then brought up to date."""

    def __init__(self, page: Any) -> None:
        self.page = page  # a Frame, with what the view shows
        self.place: Any = None
        self._built = False
        self._changing: list[Any] = []  # elements that change the run

    def show(self) -> None:
        """Build, once."""
        if not self._built:
            self._built = True
            with self.place:
                self.build()
            self.allow(self.page.allowed)

    @abstractmethod
    def build(self) -> None:
        """Make the elements of the view."""

    @abstractmethod
    def update(self) -> None:
        """Show what the session holds now."""

    def refresh(self) -> None:
        """Bring up to date if it has been shown."""
        if self._built:
            self.update()

    def allow(self, allowed: bool) -> None:
        """Enable or disable what changes the run."""
        self._changing = [element for element in self._changing if not element.is_deleted]
        for element in self._changing:
            element.set_enabled(allowed)

    def changing(self, element: Any) -> Any:
        """An element that may be used only while the run may be changed."""
        element.set_enabled(self.page.allowed)
        self._changing.append(element)
        return element


class Html(ui.html):
    """Markup as the templates make it; plain text is escaped."""

    def __init__(self, content: str = "", tag: str = "div") -> None:
        super().__init__(readable(str(escape(content))), sanitize=False, tag=tag)

    def show(self, content: str) -> None:
        """Show other markup."""
        self.content = readable(str(escape(content)))


def bring_into_view(element: ui.element) -> None:
    """Scroll to an element that is out of sight: in a narrow window all stands one below another."""
    ui.run_javascript(
        f"const e = document.getElementById('{element.html_id}'), box = e?.getBoundingClientRect();"
        "if (box && (box.bottom < 0 || box.top > innerHeight)) e.scrollIntoView({block: 'start', behavior: 'smooth'})"
    )


def card(title: str = "") -> ui.element:
    """A box, with its heading."""
    box = ui.element("section").classes("card")
    if title:
        with box:
            Html(title, "h2")
    return box


def fold(title: str, name: str, caption: str = "") -> ui.expansion:
    """A box that opens below its heading, with its name for tests."""
    box = ui.expansion(title, caption=caption or None).classes("cand")
    return box.props(f":duration=0 data-testid={name} header-class=cand-head")


def side_tabs(panels: Mapping[str, Panel]) -> None:
    """Panels behind tabs of which the first is shown."""
    first = next(iter(panels))
    with card():
        with ui.tabs().props("no-caps dense align=justify").classes("side-tabs") as tabs:
            for name in panels:
                ui.tab(name).props(f"data-testid=side-{name.lower()}")
        with ui.tab_panels(tabs, value=first, animated=False):
            for name, panel in panels.items():
                with ui.tab_panel(name) as panel.place:
                    pass
    tabs.on_value_change(lambda event: panels[event.value].show())
    panels[first].show()


def plot(made: Figure, words: str) -> ui.plotly:
    """A figure with what it shows, for those who cannot see it."""
    found = ui.plotly(made).classes("plot").style(f"height:{made['layout']['height']}px")
    quoted = words.replace("\\", "").replace('"', "'")
    return found.props(f'role=img aria-label="{quoted}"')


def picked(place: ui.element, choose: Callable[[str], None]) -> None:
    """Call ``choose`` with the name of any button with data-name that is pressed inside a place."""
    script = "(e) => { const b = e.target.closest('[data-name]'); if (b) emit(b.dataset.name); }"
    place.on("click", lambda event: choose(str(event.args)), js_handler=script)
