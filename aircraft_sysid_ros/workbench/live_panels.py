"""The views of a flight in progress: six axes, candidates, what is added, parameters, state."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from nicegui import ui

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXIS_WORDS
from aircraft_sysid_ros.diagnosis.words import headline
from aircraft_sysid_ros.effects import LIBRARY
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.errors_panel import Errors
from aircraft_sysid_ros.workbench.live_flight import ERRORS, MISSING, PARAMETERS, STATE, LiveFlight
from aircraft_sysid_ros.workbench.panel import Html, Panel, card, fold, plot, side_tabs
from aircraft_sysid_ros.workbench.side_panels import UNDONE, AddPanel, ListedChange, SidePanel
from aircraft_sysid_ros.workbench.views import live, states, track
from aircraft_sysid_ros.workbench.views.candidates import EARLIER, Card
from aircraft_sysid_ros.workbench.views.coefficients import ORDER
from aircraft_sysid_ros.workbench.views.figure import Figure
from aircraft_sysid_ros.workbench.views.history import effect_name
from aircraft_sysid_ros.workbench.views.parameters import parameter_rows
from aircraft_sysid_ros.workbench.views.words import sentence, typeset
from aircraft_sysid_ros.workbench.worker import ADD, REMOVE

#: Least time [s] between two drawings: a playback at ten times real time must not choke the browser.
_DRAW = 0.5


class LivePanel(Panel):
    """A view that is drawn again when messages of its kinds have come, while it is looked at."""

    kinds: tuple[str, ...] = ()

    def __init__(self, page: Any) -> None:
        super().__init__(page)
        self._drawn, self._seen = 0.0, ()  # type: tuple[float, tuple[int, ...]]

    @property
    def flight(self) -> LiveFlight:
        """What was heard."""
        found: LiveFlight = self.page.session.flight
        return found

    def follow(self) -> None:
        """Draw where there is something new: messages, or what came of a request."""
        seen = (self.page.session.revision, *(self.flight.heard[kind] for kind in self.kinds))
        if self._built and seen != self._seen and time.monotonic() - self._drawn > _DRAW:
            self._seen, self._drawn = seen, time.monotonic()
            self.update()


class LiveModelPanel(LivePanel):
    """Time plots that slide, the errors, and beside them what may be missing and what is added."""

    kinds = (ERRORS, MISSING)

    def __init__(self, page: Any) -> None:
        super().__init__(page)
        self.side: tuple[SidePanel, ...] = (LiveWhyPanel(page, None), LiveAddPanel(page, None))

    def build(self) -> None:
        """Make everything."""
        self._plots: dict[str, tuple[ui.element, Html, ui.plotly]] = {}
        with ui.element("div").classes("view"):
            with ui.element("div"):
                with ui.element("div").classes("legend-row"), ui.element("div").classes("legend"):
                    Html(markup.LIVE_LEGEND).style("display:contents")
                with ui.element("div").classes("grid2"):
                    for name in ORDER:
                        with card() as box:
                            head = Html()
                            made = plot(self._figure(name), f"{name} measured and predicted lately, and what is left")
                            self._plots[name] = (box, head, made.props(f"data-testid=plot-{name}"))
            with ui.element("aside").classes("side"):
                self._errors = Errors(
                    "Error of predictions before they were learnt from",
                    "in % of the spread of each coefficient, over the node's window; line: about what of it is noise, "
                    "pale: before the last change of the model",
                )
                side_tabs(dict(zip(("Why", "Add"), self.side, strict=True)))
        self.update()

    def update(self) -> None:
        """Draw all axes in the newest window."""
        flight = self.flight
        errors = list(flight.errors)
        rows = live.axis_rows(
            errors[-1] if errors else None, set() if flight.found_earlier else live.failing_axes(flight.missing)
        )
        for row in rows:
            box, head, found = self._plots[row.axis]
            head.show(markup.axis_head(row))
            box.classes(add="fails" if row.fails else "", remove="" if row.fails else "fails")
            found.update_figure(self._figure(row.axis))
        self._errors.show(rows, flight.before)
        for panel in self.side:
            panel.refresh()

    def allow(self, allowed: bool) -> None:
        """Whether the panels beside may change the model."""
        for panel in self.side:
            panel.allow(allowed)

    def _figure(self, name: str) -> Figure:
        flight = self.flight
        return live.coefficient_figure(list(flight.errors), name, self.page.look.theme, list(flight.changes))


class LiveWhyPanel(SidePanel):
    """What the node's own search found, as cards."""

    def build(self) -> None:
        """Make the verdict and the place of the cards."""
        self._verdict = ui.label("").classes("heading").props("data-testid=verdict")
        self._words = Html().classes("soft").style("margin-bottom:6px")
        self._cards = ui.element("div").style("width:100%").props("data-testid=cards")
        self._shown: Any = ""
        self.update()

    def update(self) -> None:
        """Cards that are open stay open while nothing new was found."""
        flight = self.page.session.flight
        found, added = flight.missing, [item.text for item in flight.added]
        stale, of_model = flight.found_earlier, found is not None and found["model"] != flight.model
        if (found, added, stale, of_model) == self._shown:
            return
        self._shown = (found, added, stale, of_model)
        self._cards.clear()
        if found is None or not found["verdict"]:
            self._verdict.text = "Not looked for yet"
            self._words.show("The node searches by itself, from about a minute and a half of flight on.")
            return
        self._verdict.text = sentence(headline(found))
        words = found["advice"]
        if stale:
            self._verdict.text = EARLIER if of_model else "Found earlier"
            found_by = f"for model {found['model']}" if of_model else "before the node last started over"
            words = f"This was found {found_by}. The node searches again by itself."
        self._words.show(typeset(words))
        with self._cards:
            for number, shown in enumerate(live.cards(found)):
                self._card(shown, number, shown.key in added)

    def _card(self, shown: Card, number: int, has: bool) -> None:
        note = "in the model" if has else "missing"
        caption = f"{AXIS_WORDS[shown.main_axis]} {shown.gain} · {note}"
        with fold(shown.title, f"card-{number}", caption).classes("top-card" if number == 0 else ""):
            Html(markup.card_facts(shown, None))
            add = ui.button("Add in flight", on_click=lambda: self.do(ADD, shown.key)).style("margin-top:10px")
            add.props(f"unelevated data-testid=add-{number}")
            add.set_visibility(not has)
            self.changing(add)


class LiveAddPanel(AddPanel):
    """Own terms and effects, into the model of the node and out of it."""

    nothing = "Nothing from this page."
    library = tuple(effect for effect in LIBRARY if effect.kind != MEASUREMENT)

    def more_buttons(self) -> None:
        """Any term of the model can go."""
        button = ui.button("Take the term out", on_click=self._do_term(REMOVE))
        self.changing(button.props("flat data-testid=remove-term"))

    def update(self) -> None:
        """Only where it is another list: buttons must not go away under the mouse."""
        newest = self.changes(), self.inputs()
        if newest != getattr(self, "_shown", None):
            self._shown = newest
            super().update()

    def inputs(self) -> tuple[str, ...]:
        """As the node tells them in its diagnostics."""
        return self.page.session.flight.inputs

    def changes(self) -> Sequence[str]:
        """What the node was asked to add."""
        return [item.text for item in self.page.session.flight.added]

    def listed(self) -> list[ListedChange]:
        """The node takes out what it has added; it does not tell what else has gone."""
        texts = self.changes()
        buttons = [*["Take out"] * (len(texts) - 1), UNDONE]
        return [ListedChange(effect_name(t), b, (REMOVE, t)) for t, b in zip(texts, buttons, strict=False)]


class LiveParametersPanel(LivePanel):
    """Estimates with intervals, and whether they may be used."""

    kinds = (PARAMETERS,)

    def build(self) -> None:
        """Make the table."""
        with ui.element("div").classes("view wide"), card("Parameters"):
            self._words = ui.label("").classes("soft small")
            self._table = Html().props("data-testid=parameters")
        self.update()

    def update(self) -> None:
        """The newest estimates."""
        newest = self.flight.parameters
        self._words.text = f"As the node has learnt them, model {newest['model']}." if newest else "Nothing yet."
        rows = parameter_rows(newest["parameters"], {}) if newest else []
        self._table.show(markup.parameter_table(rows, linked=False) if rows else "")


class LiveStatePanel(LivePanel):
    """Biases, wind, air data, consistency and track."""

    kinds = (STATE,)

    def build(self) -> None:
        """Make the numbers; figures follow with the first states."""
        self._plots: list[ui.plotly] = []
        with ui.element("div").classes("view wide"):
            with card("State"):
                self._numbers = Html("Nothing yet.").props("data-testid=state")
            self._place = ui.element("div").classes("grid2")
        self.update()

    def update(self) -> None:
        """The newest numbers and the newest minutes."""
        rows = list(self.flight.states)
        if rows:
            self._numbers.show(markup.state_table(rows[-1]))
        if len(rows) < 2:
            return
        state, theme = live.state_history(rows), self.page.look.theme
        made = [*states.all_figures(state, theme, {}), ("Track from above", track.track_figure(state, None, theme))]
        if not self._plots:
            with self._place:
                for title, figure in made:
                    with card(title):
                        self._plots.append(plot(figure, title))
            return
        for found, (_, figure) in zip(self._plots, made, strict=True):
            found.update_figure(figure)


def added_words(flight: LiveFlight) -> list[str]:
    """What was added from the page, in words; empty where nothing was."""
    names = [effect_name(item.text) for item in flight.added]
    return [f"with {', '.join(names)}"] if names else []
