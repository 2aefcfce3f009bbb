"""Beside the time plots: where the model fails, why, and what is added to it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from nicegui import events, ui

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AXIS_WORDS
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.diagnosis.model_versions.requests import parse_request
from aircraft_sysid_ros.diagnosis.model_versions.versions import Change, Version
from aircraft_sysid_ros.diagnosis.significance.error_regions import Place
from aircraft_sysid_ros.effects import BY_ID, LIBRARY
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.spelling import nearest
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.panel import Html, Panel, fold, plot
from aircraft_sysid_ros.workbench.views import places
from aircraft_sysid_ros.workbench.views.candidates import (
    EVIDENCE_HEIGHT,
    Card,
    beside_the_verdict,
    cards,
    evidence_figure,
    is_in_model,
    verdict,
)
from aircraft_sysid_ros.workbench.views.coefficients import Span, time_of, whole
from aircraft_sysid_ros.workbench.views.history import effect_name, is_removal
from aircraft_sysid_ros.workbench.views.words import quantity_of, typeset
from aircraft_sysid_ros.workbench.worker import ADD, DIAGNOSE, REMOVE, RETURN, Job

_SPANS = re.compile(r"(\d+) to (\d+) s")


class TimePlots(Protocol):
    """The time plots that a side panel moves."""

    def look_at(self, window: Span | None, marks: list[Span] | None = None) -> None:
        """Show a window of time in all plots, the whole flight for None; ``marks`` None leaves what is marked."""


class SidePanel(Panel):
    """A panel that can move the time plots, where there are any that move."""

    def __init__(self, page: Any, plots: TimePlots | None) -> None:
        super().__init__(page)
        self.plots = plots

    def mark(self, spans: list[Span]) -> None:
        """Show spans of time in the time plots, or nothing."""
        if spans and self.plots is not None:
            self.plots.look_at(places.window_around(spans, whole(self.page.view.comparison)), spans)

    def do(self, kind: str, text: str = "") -> None:
        """Begin a job on the run."""
        if not self.page.session.start(Job(kind, text)):
            ui.notify("Something else is under way: wait for it to end")


class WherePanel(SidePanel):
    """The list of places, and the map."""

    def build(self) -> None:
        """Make list and map."""
        self._choice = {"axis": "", "x": "alpha", "y": "beta"}
        ui.label("Where it fails, worst first").classes("heading")
        self._list = ui.element("div").classes("list").props("data-testid=places")
        ui.label("Residual by two signals").classes("heading").style("margin-top:12px")
        ui.label("Press a cell to see in the time plots when it was flown.").classes("soft small")
        with ui.element("div").classes("pickers"):
            self._pickers = {
                key: ui.select([], label=label, on_change=self._choose(key)).props("dense options-dense outlined")
                for key, label in (("axis", "axis"), ("x", "across"), ("y", "upwards"))
            }
        self._offer()
        self._map = plot(self._figure(), "map of the residual on two signals").props("data-testid=map")
        self._map.on("plotly_click", self._cell, args=["points"])
        self._fill()

    def update(self) -> None:
        """After a change of the run or the theme."""
        self._fill()
        self._offer()
        self._map.update_figure(self._figure())

    def _offer(self) -> None:
        """Axes and signals that there are: another version, or another flight in the same folder, may have others."""
        comparison = self.page.view.comparison
        signals = {name: quantity_of(name).words for name in places.moving_signals(comparison.flight)}
        axes = {name: AXIS_WORDS[name] for name in AXES if name in comparison.axes}
        first = {"axis": places.first_axis(comparison), "x": next(iter(signals)), "y": next(iter(signals))}
        for key, options in (("axis", axes), ("x", signals), ("y", signals)):
            if self._choice[key] not in options:
                self._choice[key] = first[key]
        for key, options in (("axis", axes), ("x", signals), ("y", signals)):  # all are known: each may draw the map
            self._pickers[key].set_options(options, value=self._choice[key])

    def _choose(self, key: str) -> Any:
        def chosen(event: events.ValueChangeEventArguments[Any]) -> None:
            if event.value and event.value != self._choice[key]:
                self._choice[key] = event.value
                self._map.update_figure(self._figure())

        return chosen

    def _figure(self) -> Any:
        choice = self._choice
        self._found = places.residual_map(self.page.view.comparison, choice["axis"], choice["x"], choice["y"])
        return places.map_figure(self._found, self.page.look.theme)

    def _fill(self) -> None:
        self._list.clear()
        worst = self.page.view.comparison.worst
        with self._list:
            if not worst:
                ui.label(places.nowhere(self.page.view.comparison))
            for place in worst:
                self._row(place)

    def _row(self, place: Place) -> None:
        with ui.element("button").classes("place").on("click", lambda: self._go(place)):
            Html(markup.place_words(place), "span")
            Html(markup.place_excess(place), "span").classes("much")

    def _go(self, place: Place) -> None:
        self.mark(places.spans_of_place(self.page.view.comparison, place))

    def _cell(self, event: events.GenericEventArguments) -> None:
        points = (event.args or {}).get("points") or []
        if points:
            flight = self.page.view.comparison.flight
            inside = places.mask_of_cell(flight, self._found, float(points[0]["x"]), float(points[0]["y"]))
            self.mark(places.spans_of(time_of(flight), inside))


class WhyPanel(SidePanel):
    """The diagnosis: a verdict, and candidates as cards."""

    def build(self) -> None:
        """Make the button, and the cards of the last diagnosis."""
        with ui.row().style("align-items:center; gap:12px; flex-wrap:nowrap; width:100%"):
            self._verdict = ui.label("").classes("heading").props("data-testid=verdict")
            ui.element("div").classes("spring")
            button = ui.button("Diagnose", on_click=lambda: self.do(DIAGNOSE)).props("unelevated data-testid=diagnose")
            self.changing(button)
        self._words = Html().classes("soft").style("margin-bottom:6px")
        self._cards = ui.element("div").style("width:100%").props("data-testid=cards")
        self._notes = ui.element("div").style("margin-top:10px").props("data-testid=diagnosis-notes")
        self._drawn: list[tuple[Any, Card]] = []
        self._shown: Any = None
        self.update()

    def update(self) -> None:
        """After a change of the run or the theme; open cards stay open where the diagnosis is the same."""
        view, found = self.page.view, self.page.view.diagnosis
        if (found, view.current) == self._shown:
            for drawn, card in self._drawn:
                if card.evidence is not None:
                    drawn.update_figure(evidence_figure(card.evidence, self.page.look.theme))
            return
        self._shown, self._drawn = (found, view.current), []
        self._cards.clear()
        self._notes.clear()
        if found is None:
            self._verdict.text = "Not looked for yet"
            self._words.show(
                "Tries every effect of the library, and terms outside of it, against flights in which nothing is "
                "missing. Half a minute to some minutes; it can be stopped."
            )
            return
        self._verdict.text, words = verdict(found, view.current)
        self._words.show(typeset(words))
        with self._notes:
            for text in beside_the_verdict(found, view.notes):
                Html(typeset(text)).classes("soft small")
        known = view.comparisons.get(found["model"], view.comparison)
        with self._cards:
            for number, card in enumerate(cards(found, known.flight)):
                floor = known.axes[card.main_axis].floor.nrmse if card.main_axis in known.axes else None
                self._card(card, number, floor)

    def _card(self, card: Card, number: int, floor: float | None) -> None:
        view = self.page.view
        has = is_in_model(card, view.diagnosis["model"], view.current, view.changes)
        note = "in the model" if has else "missing" if card.found else "weaker"
        caption = f"{AXIS_WORDS[card.main_axis]} {card.gain} · {note}"
        with fold(card.title, f"card-{number}", caption).classes("top-card" if number == 0 else "") as box:
            Html(markup.card_facts(card, floor))
            height = EVIDENCE_HEIGHT if card.evidence is not None else 0  # kept free: the button below stays
            where = ui.element("div").style(f"width:100%; min-height:{height}px")
            with ui.row().style("gap:10px; margin-top:10px"):
                add = ui.button("Add to the model", on_click=lambda: self.do(ADD, card.key))
                add.props(f"unelevated data-testid=add-{number}")
                add.set_visibility(card.is_to_add and not has)
                self.changing(add)
                spans = [(float(a), float(b)) for a, b in _SPANS.findall(card.where)]
                if spans:
                    ui.button("Show in the time plots", on_click=lambda: self.mark(spans)).props("flat")
        box.on_value_change(lambda event: self._open(card, where) if event.value else None)

    def _open(self, card: Card, where: ui.element) -> None:
        """Draw the evidence when a card is first opened."""
        if card.evidence is None or any(card is drawn for _, drawn in self._drawn):
            return
        with where:
            figure = evidence_figure(card.evidence, self.page.look.theme)
            self._drawn.append((plot(figure, f"the residual against the signal of {card.title}"), card))


#: The button of the last change.
UNDONE = "Undo"


@dataclass(frozen=True)
class ListedChange:
    """One change for people: what it is, the button that takes it back, and the job that this begins."""

    words: str
    button: str
    back: tuple[str, str]


def listed_changes(version: Version, before: Version | None) -> list[ListedChange]:
    """Changes of a version and what is gone since ``before``, that it was made from; the last change can be undone.

    Where the last change was one of something that was there before, as an effect that was added once more, to undo it
    is to go back to the version before.
    """
    old = {} if before is None else before.changes
    rows = {label: _listed(label, change, is_there=True) for label, change in version.changes.items()}
    rows |= {label: _listed(label, old[label], is_there=False) for label in old if label not in version.changes}
    last = [label for label in rows if old.get(label) != version.changes.get(label)]
    for label in last[-1:]:
        is_alone = len(last) == 1 and (label in old) != (label in version.changes)
        back = rows[label].back if is_alone or before is None else (RETURN, before.identifier)
        rows[label] = ListedChange(rows[label].words, UNDONE, back)
    return list(rows.values())


def _listed(label: str, change: Change, *, is_there: bool) -> ListedChange:
    """A change that is in the model, or one that was in it before."""
    is_added = is_there != is_removal(change)  # terms are in the model by it, or because it is gone
    words = effect_name(label) + ("" if is_there and is_added else ": put back" if is_added else ": taken out")
    return ListedChange(words, "Take out" if is_added else "Put back", (REMOVE if is_added else ADD, label))


class AddPanel(SidePanel):
    """Own terms, effects of the library, and the way back."""

    nothing = "Nothing: this is the model of the run."
    library = LIBRARY

    def build(self) -> None:
        """Make both inputs and the list of what was added."""
        ui.label("A term of your own").classes("heading")
        self._term = ui.input(placeholder="CZ: alpha**3", on_change=self._check).props(
            'outlined dense debounce=200 aria-label="axis and term" data-testid=term'
        )
        self._term.style("width:100%").on("keydown.enter", self._do_term(ADD))
        self._complaint = _alert("complaint")
        with ui.row().style("gap:10px"):
            button = ui.button("Add the term", on_click=self._do_term(ADD))
            self.changing(button.props("unelevated data-testid=add-term"))
            self.more_buttons()
        self._help = Html().classes("soft small").style("margin-bottom:12px").props("data-testid=signals")
        ui.label("An effect of the library").classes("heading")
        options = {effect.identifier: f"{effect.name} ({effect.identifier})" for effect in self.library}
        self._effect = ui.select(options, with_input=True, label="effect", on_change=self._effect_chosen)
        self._effect.props("outlined dense options-dense")
        self._effect.props("popup-content-class=effect-menu data-testid=effect").style("width:100%")
        self._effect.add_slot("option", _grouped([effect.kind for effect in self.library]))
        self._no_effect = _alert("no-effect")
        self.changing(ui.button("Add the effect", on_click=self._add_effect).props("outline data-testid=add-effect"))
        ui.label("What was added").classes("heading").style("margin-top:12px")
        self._added = ui.element("div").classes("list").props("data-testid=added")
        self.update()

    def update(self) -> None:
        """After a change of the run."""
        self._help.show(markup.term_help((*SIGNALS, *self.inputs())))
        self._added.clear()
        with self._added:
            if not self.changes():
                ui.label(self.nothing).classes("soft")
            for change in self.listed():
                self._row(change)

    def _row(self, change: ListedChange) -> None:
        """One change, and the button that takes it back."""
        with ui.row().style("align-items:center; width:100%; flex-wrap:nowrap; gap:10px"):
            ui.label(change.words).style("flex:1 1 auto")
            button = ui.button(change.button, on_click=lambda: self.do(*change.back))
            self.changing(button.props("flat dense" + (" data-testid=undo" if change.button == UNDONE else "")))

    def inputs(self) -> tuple[str, ...]:
        """Named inputs of the aircraft file."""
        return self.page.view.flight.model.inputs

    def changes(self) -> Sequence[str]:
        """What was added or taken away, in order."""
        return list(self.page.view.changes)

    def listed(self) -> list[ListedChange]:
        """All changes of the version, and what the last one took out of them."""
        known = {version.identifier: version for version in self.page.view.versions}
        current = known[self.page.view.current]
        return listed_changes(current, next((known[v] for v in current.parents if v in known), None))

    def _check(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._complain(str(event.value or ""))

    def _complain(self, text: str) -> bool:
        """Say what is wrong with a term; nothing while it is empty."""
        self._complaint.text = complaint(text, self.inputs()) if text.strip() else ""
        return not self._complaint.text

    def _do_term(self, kind: str) -> Callable[[], None]:
        def do() -> None:
            text = str(self._term.value or "")
            if not text.strip():
                self._complaint.text = "Write a term with its axis, such as CZ: alpha**3"
            elif self._complain(text):
                self.do(kind, text)

        return do

    def more_buttons(self) -> None:
        """What else can be done with a term."""

    def _add_effect(self) -> None:
        if self._effect.value:
            self.do(ADD, str(self._effect.value))
        else:
            self._no_effect.text = "Choose an effect first"

    def _effect_chosen(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._no_effect.text = ""


def _alert(name: str) -> ui.label:
    """What is wrong with a field, below it; empty where nothing is."""
    return ui.label("").classes("flag").props(f"role=alert data-testid={name}").style("white-space:normal")


def complaint(text: str, inputs: tuple[str, ...] = ()) -> str:
    """What is wrong with a term, beginning with what to do; empty where nothing is.

    ``inputs``: names that the aircraft file gives to further signals.
    """
    try:
        parse_request(text, inputs)
    except InputError as error:
        if ":" in text:
            return str(error)
        near = nearest(text.strip(), BY_ID)
        hint = f"; or did you mean the effect {near[0]}?" if near else ""
        return f"Write a term with its axis, such as CZ: alpha**3; '{text.strip()[:40]}' alone is not an effect{hint}"
    return ""


#: Kinds of effects as headings of the menu.
_KINDS = {"measurement": "Sensors", "aerodynamic": "Aerodynamics", "change in flight": "Changes in flight"}


def _grouped(kinds: Sequence[str]) -> str:
    """The row of a menu whose options come by kinds: above the first of each kind stands what kind it is."""
    first = {str(kinds.index(kind)): _KINDS[kind] for kind in _KINDS if kind in kinds}
    heads = json.dumps(first).replace('"', "'")
    return f"""
      <q-item-label header class="effect-kind" v-if="({heads})[props.opt.value]">
        {{{{ ({heads})[props.opt.value] }}}}</q-item-label>
      <q-item v-bind="props.itemProps"><q-item-section>
        <q-item-label>{{{{ props.opt.label }}}}</q-item-label></q-item-section></q-item>"""
