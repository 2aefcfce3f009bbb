"""Two versions of a run, or two flights, side by side: errors, parameters and how sure their differences are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from nicegui import events, ui

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXIS_WORDS
from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run
from aircraft_sysid_ros.diagnosis.two_runs import SideBySide, side_by_side
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.panel import Html, Panel, card, plot
from aircraft_sysid_ros.workbench.run_view import RunView
from aircraft_sysid_ros.workbench.views import places
from aircraft_sysid_ros.workbench.views.envelope import envelope_words, shared_scale
from aircraft_sysid_ros.workbench.views.history import VersionRow, history
from aircraft_sysid_ros.workbench.views.words import quantity_of, readable, sentence

#: Where there is nothing to compare with.
ONE_VERSION = (
    "There is one version only. Add an effect or a term in the view Model, under Why or Add (or in a terminal: "
    "aircraft-sysid add {} dihedral_alpha), and the new version stands here beside this one."
)
#: What the menu of the second one calls the current version of another run.
_OF_RUN = "run:"

#: Height of a map [px].
_MAP = 280

Side = tuple[Run, Comparison]


class BesidePanel(Panel):
    """Two pickers and what stands beside each other; any version of this run, and the current ones of other runs."""

    def __init__(self, page: Any) -> None:
        super().__init__(page)
        self._shown: Any = None
        self._refused = ""

    def build(self) -> None:
        """Make everything."""
        self._choice = {"axis": "", "x": "alpha", "y": "beta"}
        with card("Two versions or flights side by side"):
            self._lonely = ui.label("").props("data-testid=one-version")
            self._pair = ui.element("div").style("width:100%")
            with self._pair:
                with ui.element("div").classes("pickers pair"):
                    self._one = ui.select([], label="one", on_change=self._chosen)
                    self._other = ui.select([], label="the other", on_change=self._chosen)
                    for picker, name in ((self._one, "beside-one"), (self._other, "beside-other")):
                        picker.props(f"outlined dense options-dense data-testid={name}")
                self._draw = ui.switch("draw the first one in the time plots too", on_change=self._set_beside)
                self._said = ui.element("div").props("data-testid=beside-words")
                with ui.element("div").classes("beside"):
                    with ui.element("div"):
                        self._errors = Html().props("data-testid=beside")
                        self._envelope()
                    self._parameters = Html().props("data-testid=differences")
        self.update()

    def _envelope(self) -> None:
        """Two maps of the residual with one scale."""
        with ui.element("div").style("width:100%") as self._maps:
            ui.label("Residual over the envelope, side by side").classes("heading").style("margin:18px 0 8px")
            with ui.element("div").classes("pickers"):
                self._pickers = {
                    key: ui.select([], label=label, on_change=self._mapped(key)).props("dense options-dense outlined")
                    for key, label in (("axis", "axis"), ("x", "across"), ("y", "upwards"))
                }
            self._drawn = []
            for side in ("one", "other"):
                words = ui.label("").classes("small").style("margin-top:10px").props(f"data-testid=covered-{side}")
                empty = {"data": [], "layout": {"height": _MAP}}
                self._drawn.append((words, plot(empty, f"residual over the envelope, {side}")))

    def update(self) -> None:
        """After a change of a run or of the theme."""
        view: RunView = self.page.view
        rows = history(view.versions, view.current, view.comparisons, view.labels)
        self._rows = {row.identifier: row for row in rows if row.axes}
        versions = {identifier: row.title for identifier, row in self._rows.items()}
        others = {f"{_OF_RUN}{name}": f"flight {name}" for name in self.page.other_runs}
        lonely = len(versions) + len(others) < 2
        self._lonely.text = ONE_VERSION.format(view.name) if lonely else ""
        self._lonely.set_visibility(lonely)
        self._pair.set_visibility(not lonely)
        if lonely:
            return
        parents = next(v.parents for v in view.versions if v.identifier == view.current)
        first = next((v for v in (*parents, *versions) if v in versions and v != view.current), view.current)
        last = view.current if first != view.current else next(iter(others), view.current)
        every = {**versions, **others}
        self._one.set_options(versions, value=self._one.value if self._one.value in versions else first)
        self._other.set_options(every, value=self._other.value if self._other.value in every else last)
        self._shown, self._refused = None, ""
        self._compare()

    def follow(self) -> None:
        """Another run that is waited for may have been read, or changed."""
        if self._built and self._pair.visible and str(self._other.value).startswith(_OF_RUN):
            self._compare()

    def _chosen(self, event: events.ValueChangeEventArguments[Any]) -> None:
        if event.sender is self._other and str(self._other.value).startswith(_OF_RUN):
            self._one.value = self.page.view.current  # another flight is set beside the model as it is
        if self._pair.visible and self._one.value and self._other.value:
            self._compare()

    def _compare(self) -> None:
        """Work out and show what stands beside each other, where it has changed."""
        view: RunView = self.page.view
        self._set_beside()
        one = (replace(view.run, current=self._version(view, self._one.value)), view.comparisons[self._one.value])
        try:
            other = self._side(str(self._other.value))
            key = (other if other is None else other[1], one[1], self.page.look.theme)
            if self._shown is not None and all(a is b for a, b in zip(key, self._shown, strict=True)):
                return
            self._shown = key
            if other is None:
                self._say([f"{self._other.value.removeprefix(_OF_RUN)} is being read"])
                return
            both = side_by_side((one[0], other[0]), (one[1], other[1]))
        except InputError as error:
            if str(error) != self._refused:  # asked again and again while it is so
                self._refused = str(error)
                self._say([self._refused])
            self._shown = None
            return
        self._refused = ""
        self._say([*both.told, *both.notes])
        self._show(both, one[1], other[1])

    def _say(self, sentences: list[str]) -> None:
        """Sentences in place of tables, until those are shown."""
        self._said.clear()
        with self._said:
            for text in sentences:
                ui.label(readable(sentence(text)) + ".").classes("small")
        for place in (self._errors, self._parameters, self._maps):
            place.set_visibility(False)

    def _show(self, both: SideBySide, one: Comparison, other: Comparison) -> None:
        for place in (self._errors, self._parameters, self._maps):
            place.set_visibility(True)
        if both.same_flight and self._other.value in self._rows:
            rows: list[VersionRow] = [self._rows[self._one.value], self._rows[self._other.value]]
            self._errors.show(markup.errors_beside(*rows))
        else:
            self._errors.show(markup.errors_of_flights(both))
        self._parameters.show(markup.differences(both))
        self._compared, self._names = (one, other), both.runs
        self._offer(one, other)
        self._draw_maps()

    def _side(self, chosen: str) -> Side | None:
        """The second one; None while it is read. Raises InputError where it cannot be."""
        view: RunView = self.page.view
        if not chosen.startswith(_OF_RUN):
            return replace(view.run, current=self._version(view, chosen)), view.comparisons[chosen]
        session = self.page.other_session(chosen.removeprefix(_OF_RUN))
        if session.damage:
            raise InputError(session.damage)
        found: RunView | None = session.view
        return None if found is None else (found.run, found.comparison)

    @staticmethod
    def _version(view: RunView, identifier: str) -> Any:
        return next(version for version in view.versions if version.identifier == identifier)

    def _set_beside(self, event: Any = None) -> None:
        """Draw the first one in the time plots, or not."""
        chosen = self._one.value
        wanted = chosen if self._draw.value and chosen and chosen != self.page.view.current else None
        self._draw.set_visibility(chosen != self.page.view.current)
        if wanted != self.page.look.beside:
            self.page.look.beside = wanted
            self.page.redraw_model()

    # -- the envelope ----------------------------------------------------------------------------------------

    def _offer(self, one: Comparison, other: Comparison) -> None:
        """Axes and signals that both have."""
        axes = {name: AXIS_WORDS[name] for name in one.axes if name in other.axes}
        signals = [s for s in places.moving_signals(one.flight) if s in places.moving_signals(other.flight)]
        words = {name: quantity_of(name).words for name in signals}
        for key, options in (("axis", axes), ("x", words), ("y", words)):
            if not options:
                self._maps.set_visibility(False)
                return
            wanted = self._choice[key] if self._choice[key] in options else next(iter(options))
            if key == "axis" and not self._choice["axis"]:
                wanted = first if (first := places.first_axis(one)) in options else wanted
            self._choice[key] = wanted
            self._pickers[key].set_options(options, value=wanted)

    def _mapped(self, key: str) -> Any:
        def chosen(event: events.ValueChangeEventArguments[Any]) -> None:
            if event.value and event.value != self._choice[key]:
                self._choice[key] = event.value
                self._draw_maps()

        return chosen

    def _draw_maps(self) -> None:
        axis, x, y = (self._choice[key] for key in ("axis", "x", "y"))
        if not self._maps.visible:
            return
        edges = places.shared_edges([c.flight for c in self._compared], x, y)
        maps = [places.residual_map(comparison, axis, x, y, edges) for comparison in self._compared]
        top = shared_scale(maps)
        for (words, drawn), name, found in zip(self._drawn, self._names, maps, strict=True):
            words.text = f"{readable(name)}: {envelope_words(found)}"
            drawn.update_figure(places.map_figure(found, self.page.look.theme, _MAP, top))
