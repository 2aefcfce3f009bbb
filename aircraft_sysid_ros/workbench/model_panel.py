"""The view of the model: six axes over time, and beside them where it fails, why, and what is added."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import events, ui

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.workbench.markup import LEGEND, SECOND_KEY, axis_head, errors_scale, state_words
from aircraft_sysid_ros.workbench.panel import Panel, card, plot
from aircraft_sysid_ros.workbench.side_panels import AddPanel, WherePanel, WhyPanel
from aircraft_sysid_ros.workbench.views.coefficients import ORDER, AxisRow, Span, axis_rows, coefficient_figure, whole
from aircraft_sysid_ros.workbench.views.figure import Figure
from aircraft_sysid_ros.workbench.views.words import percent, symbol

if TYPE_CHECKING:
    from aircraft_sysid_ros.workbench.page import Page

#: Window [s] below which nothing is zoomed.
_SHORTEST = 0.2
_RANGE = ("xaxis.range[0]", "xaxis.range[1]")


class ModelPanel(Panel):
    """Time plots that move together, the errors, and three panels beside them."""

    def __init__(self, page: Page) -> None:
        super().__init__(page)
        self._plots: dict[str, ui.plotly] = {}
        self._heads: dict[str, Any] = {}
        self.side = (WherePanel(page, self), WhyPanel(page, self), AddPanel(page, self))

    def build(self) -> None:
        """Make everything."""
        self._built = True
        with self.place, ui.element("div").classes("view"):
            with ui.element("div"):
                self._legend()
                with ui.element("div").classes("grid2"):
                    for name in ORDER:
                        self._axis(name)
                self._describe()
            with ui.element("aside").classes("side"):
                self._errors = Errors(self.page)
                self._tabs()

    def update(self) -> None:
        """After a change of the run, of the theme or of the version beside."""
        self.draw()
        self._errors.update()
        for panel in self.side:
            panel.refresh()

    def allow(self, allowed: bool) -> None:
        """Pass it on."""
        for panel in self.side:
            panel.allow(allowed)

    def _tabs(self) -> None:
        names = ("Where", "Why", "Add")
        with card():
            with ui.tabs().props("no-caps dense align=justify").classes("side-tabs") as tabs:
                for name in names:
                    ui.tab(name).props(f"data-testid=side-{name.lower()}")
            with ui.tab_panels(tabs, value="Where", animated=False):
                for name, panel in zip(names, self.side, strict=True):
                    with ui.tab_panel(name) as panel.place:
                        pass
        tabs.on_value_change(lambda event: self.side[names.index(event.value)].show())
        self.side[0].show()

    # -- time plots ------------------------------------------------------------------------------------------

    def _legend(self) -> None:
        with ui.element("div").classes("legend-row"):
            with ui.element("div").classes("legend"):
                ui.html(LEGEND, sanitize=False).style("display:contents")
                self._second_key = ui.html("", sanitize=False).style("display:contents")
            with ui.element("div").classes("window"):
                self._window = ui.label("").props("data-testid=window")
                button = ui.button("Whole flight", on_click=lambda: self.look_at(None, [])).props("flat dense")
                button.tooltip("Drag in a plot to zoom; arrow keys move, + and − zoom, 0 shows all")

    def _axis(self, name: str) -> None:
        with card() as box:
            self._heads[name] = (box, ui.html("", sanitize=False))
            figure = self._figure(name)
            self._plots[name] = plot(figure, f"{name} measured and predicted over time, and what is left over")
            self._plots[name].props(f"data-testid=plot-{name}")
            self._plots[name].on("plotly_relayout", self._zoomed)

    def _figure(self, name: str) -> Figure:
        look = self.page.look
        window = look.window or whole(self.page.view.comparison)
        return coefficient_figure(self.page.view.comparison, name, look.theme, window, look.marks, self.page.beside)

    def _describe(self) -> None:
        for row in axis_rows(self.page.view.comparison):
            if row.axis in self._heads:
                box, head = self._heads[row.axis]
                head.content = axis_head(row)
                box.classes(add="fails" if row.fails else "", remove="" if row.fails else "fails")
        begin, end = self.page.look.window or whole(self.page.view.comparison)
        self._window.text = f"{begin:.1f} to {end:.1f} s"
        self._second_key.content = SECOND_KEY.format(escape(str(self.page.look.beside))) if self.page.beside else ""

    def draw(self) -> None:
        """Draw all axes in the window."""
        self._describe()
        for name, found in self._plots.items():
            found.update_figure(self._figure(name))

    def look_at(self, window: Span | None, marks: list[Span] | None = None) -> None:
        """Show a window of time in all plots, the whole flight for None; ``marks`` None leaves what is marked."""
        look = self.page.look
        if window is not None:
            begin, end = whole(self.page.view.comparison)
            middle = 0.5 * (window[0] + window[1])
            half = max(0.5 * (window[1] - window[0]), 0.5 * _SHORTEST)
            window = (max(middle - half, begin), min(middle + half, end))
            window = None if (window[0] <= begin and window[1] >= end) or window[0] >= window[1] else window
        if window == look.window and marks in (None, look.marks):
            return
        look.window = window
        if marks is not None:
            look.marks = marks
        self.draw()

    def _zoomed(self, event: events.GenericEventArguments) -> None:
        """A user changed one plot. Drawing does not raise this event again, since it is a whole new figure."""
        changed = event.args or {}
        if all(key in changed for key in _RANGE):
            low, high = (float(changed[key]) for key in _RANGE)
            self.look_at((min(low, high), max(low, high)))
        elif changed.get("xaxis.autorange"):
            if self.page.look.window is None:
                self.draw()  # the plot has made room around its points
            self.look_at(None)

    def key(self, name: str) -> None:
        """Move with arrows, zoom with plus and minus, 0 shows all."""
        begin, end = self.page.look.window or whole(self.page.view.comparison)
        size, middle = end - begin, 0.5 * (begin + end)
        shift = {"ArrowLeft": -0.25, "ArrowRight": 0.25}.get(name)
        factor = {"+": 0.5, "=": 0.5, "-": 2.0}.get(name)
        if name == "0":
            self.look_at(None)
        elif shift is not None:
            low, high = whole(self.page.view.comparison)
            move = min(max(shift * size, low - begin), high - end)
            self.look_at((begin + move, end + move))
        elif factor is not None:
            self.look_at((middle - 0.5 * factor * size, middle + 0.5 * factor * size))


class Errors:
    """Held-out errors of all axes as bars that move when the model changes."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._rows: dict[str, dict[str, Any]] = {}
        with card("Error on flight that was not seen"):
            ui.label(
                "in % of the spread of each coefficient; line: noise of the sensors, pale: before the change"
            ).classes("soft small")
            with ui.element("div").classes("errors"):
                for text in ("", "", "error", "noise", ""):
                    ui.label(text).classes("head")
                for name in AXES:
                    self._row(name)
            self._notes = ui.element("div").classes("notes soft small")
        self.update()

    def _row(self, name: str) -> None:
        ui.html(symbol(name), sanitize=False).classes("sym")
        with ui.element("div").classes("track"):
            was = ui.element("div").classes("was")
            fill = ui.element("div").classes("fill").props(f"data-testid=bar-{name}")
            tick = ui.element("div").classes("tick")
        error = ui.label("").classes("num").props(f"data-testid=held-out-{name}")
        noise = ui.label("").classes("num soft")
        words = ui.html("", sanitize=False)
        self._rows[name] = {"fill": fill, "was": was, "tick": tick, "error": error, "noise": noise, "words": words}

    def update(self) -> None:
        """Set lengths and numbers; the style moves them."""
        view = self._page.view
        self._notes.clear()
        self._notes.set_visibility(bool(view.notes))
        with self._notes:
            for note in view.notes:
                ui.label(note)
        before = self._before()
        rows = axis_rows(view.comparison)
        top = errors_scale([*rows, *before.values()])
        for row in rows:
            parts, known = self._rows[row.axis], row.held_out is not None and row.floor is not None
            for part in ("fill", "tick"):
                parts[part].set_visibility(known)
            parts["words"].content = (
                state_words(row) if known else f'<span class="soft small">{escape(row.reason)}</span>'
            )
            parts["was"].set_visibility(False)
            if row.held_out is None or row.floor is None:
                parts["error"].text = parts["noise"].text = "–"
                continue
            parts["fill"].style(f"width:{100.0 * row.held_out / top:.2f}%")
            parts["fill"].classes(add="fails" if row.fails else "", remove="" if row.fails else "fails")
            parts["tick"].style(f"left:{100.0 * row.floor / top:.2f}%")
            parts["error"].text, parts["noise"].text = f"{percent(row.held_out)} %", f"{percent(row.floor)} %"
            was = before[row.axis].held_out if row.axis in before else None
            if was is not None and abs(was - row.held_out) > 0.002:
                parts["was"].set_visibility(True)
                parts["was"].style(f"width:{100.0 * was / top:.2f}%")

    def _before(self) -> dict[str, AxisRow]:
        """Errors of the version that the current one was made from."""
        view = self._page.view
        current = next(v for v in view.versions if v.identifier == view.current)
        made_from = next((parent for parent in current.parents if parent in view.comparisons), None)
        return {row.axis: row for row in axis_rows(view.comparisons[made_from])} if made_from else {}
