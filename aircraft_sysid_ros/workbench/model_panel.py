"""The view of the model: six axes over time, and beside them where it fails, why, and what is added."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nicegui import events, ui

from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.errors_panel import Errors
from aircraft_sysid_ros.workbench.panel import Html, Panel, bring_into_view, card, plot, side_tabs
from aircraft_sysid_ros.workbench.side_panels import AddPanel, WherePanel, WhyPanel
from aircraft_sysid_ros.workbench.views.candidates import moments_named
from aircraft_sysid_ros.workbench.views.coefficients import ORDER, Span, axis_rows, coefficient_figure, whole
from aircraft_sysid_ros.workbench.views.figure import Figure

if TYPE_CHECKING:
    from aircraft_sysid_ros.workbench.run_view import RunView

#: Window [s] below which nothing is zoomed.
_SHORTEST = 0.2
_RANGE = ("xaxis.range[0]", "xaxis.range[1]")


class ModelPanel(Panel):
    """Time plots that move together, the errors, and three panels beside them."""

    def __init__(self, page: Any) -> None:
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
                self._errors = Errors(
                    "Error on validation data",
                    "in % of the spread of each coefficient; line: noise of the sensors, pale: before the change",
                )
                side_tabs(dict(zip(("Where", "Why", "Add"), self.side, strict=True)))
                self._show_errors()

    def update(self) -> None:
        """After a change of the run, of the theme or of the version beside."""
        self.draw()
        self._show_errors()
        for panel in self.side:
            panel.refresh()

    def allow(self, allowed: bool) -> None:
        """Whether the panels beside may change the run."""
        for panel in self.side:
            panel.allow(allowed)

    def _show_errors(self) -> None:
        view = self.page.view
        self._errors.show(axis_rows(view.comparison), errors_before(view), view.notes)

    # -- time plots ------------------------------------------------------------------------------------------

    def _legend(self) -> None:
        with ui.element("div").classes("legend-row"):
            with ui.element("div").classes("legend"):
                Html(markup.LEGEND).style("display:contents")
                self._further_keys = Html().style("display:contents")
            with ui.element("div").classes("window"):
                self._window = ui.label("").props("data-testid=window")
                button = ui.button("Whole flight", on_click=lambda: self.look_at(None, [])).props("flat dense")
                button.tooltip("Drag in a plot to zoom; arrow keys move, + and − zoom, 0 shows all")

    def _axis(self, name: str) -> None:
        with card() as box:
            self._heads[name] = (box, Html())
            figure = self._figure(name)
            self._plots[name] = plot(figure, f"{name} measured and predicted over time, and the residual")
            self._plots[name].props(f"data-testid=plot-{name}")
            self._plots[name].on("plotly_relayout", self._zoomed)

    def _figure(self, name: str) -> Figure:
        look = self.page.look
        window = look.window or whole(self.page.view.comparison)
        view, moments = self.page.view, moments_named(self.page.view.diagnosis)
        return coefficient_figure(view.comparison, name, look.theme, window, look.marks, self.page.beside, moments)

    def _describe(self) -> None:
        for row in axis_rows(self.page.view.comparison):
            if row.axis in self._heads:
                box, head = self._heads[row.axis]
                head.show(markup.axis_head(row))
                box.classes(add="fails" if row.fails else "", remove="" if row.fails else "fails")
        begin, end = self.page.look.window or whole(self.page.view.comparison)
        self._window.text = f"{begin:.1f} to {end:.1f} s"
        version = str(self.page.look.beside) if self.page.beside else None
        self._further_keys.show(markup.further_keys(version, bool(moments_named(self.page.view.diagnosis))))

    def draw(self) -> None:
        """Draw all axes in the window."""
        self._describe()
        for name, found in self._plots.items():
            found.update_figure(self._figure(name))

    def look_at(self, window: Span | None, marks: list[Span] | None = None) -> None:
        """Show a window of time in all plots, the whole flight for None; ``marks`` None leaves what is marked."""
        look = self.page.look
        if marks:
            bring_into_view(self._window)
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


def errors_before(view: RunView) -> dict[str, float]:
    """Errors by axis of the version that the current one was made from."""
    current = next(v for v in view.versions if v.identifier == view.current)
    made_from = next((parent for parent in current.parents if parent in view.comparisons), None)
    rows = axis_rows(view.comparisons[made_from]) if made_from else []
    return {row.axis: row.held_out for row in rows if row.held_out is not None}
