"""Why it fails: each candidate of ``diagnose`` in plain words, and the residual against its own signal."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.expression import Program
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.model_versions.versions import Change
from aircraft_sysid_ros.diagnosis.search.candidates import TIMES_OF_CHANGE
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis
from aircraft_sysid_ros.diagnosis.words import chosen_anew, headline
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import END, FULL
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench.views.figure import Figure, Theme, axis, encoded, figure, line
from aircraft_sysid_ros.workbench.views.history import is_removal
from aircraft_sysid_ros.workbench.views.words import Quantity, chance, percent, quantity_of, rounded, sentence, symbol

Array = npt.NDArray[np.float64]

#: Points of the scatter that are drawn, and bins whose means are.
_MOST_DOTS, _BINS = 1500, 18
_LEAST_IN_BIN = 12
#: The headline of what was found for another version than the one that is shown.
EARLIER = "Of an earlier model"
#: Height of the figure of a candidate [px].
EVIDENCE_HEIGHT = 280


def verdict(found: Mapping[str, Any], current: str) -> tuple[str, str]:
    """Headline and advice of a diagnosis, beside a version of the model: it may be of an earlier one."""
    if found["model"] == current:
        return sentence(headline(found)), str(found["advice"])
    return EARLIER, f"This was found for model {found['model']}. Diagnose again to see what is missing now."


def beside_the_verdict(found: Mapping[str, Any], said: Sequence[str] = ()) -> list[str]:
    """What a diagnosis says of itself, without what is ``said`` already, and which effects the flight cannot show."""
    notes = [f"Note: {note}." for note in found.get("notes", ()) if note not in said]
    unseen = "; ".join(f"{each['name']} ({each['why']})" for each in found.get("cannot_show", ()))
    return [*notes, f"This flight could not show: {unseen}."] if unseen else notes


@dataclass(frozen=True)
class Evidence:
    """Points (n,) of one axis against the effect's own signal, and the curve that was fitted."""

    axis: str
    quantity: Quantity
    x: Array
    left: Array  # what the model leaves over, with the rest of its terms refitted
    curve: Array  # what the effect adds, at x


@dataclass(frozen=True)
class Card:
    """One candidate for people."""

    key: str  # what ``add`` is called with
    title: str
    label: str
    physics: str
    found: bool
    main_axis: str
    before: float
    after: float
    p_value: float
    where: str
    confounded_with: tuple[tuple[str, str], ...]  # id and name
    manoeuvre: str
    refused: str  # why it has no name
    numbers: tuple[str, ...]  # parameters and inner numbers with their values
    evidence: Evidence | None
    chosen_anew: str = ""  # what is named without each part of the flight
    how_large: str = ""  # in newtons, and as the number that its physics means
    is_to_add: bool = True  # else no term or setting of the model stands for it

    @property
    def gain(self) -> str:
        """How much error it removes."""
        return f"{percent(self.before)} % → {percent(self.after)} %"

    @property
    def sure(self) -> str:
        """How sure, in words."""
        return f"{chance(self.p_value)} if nothing were missing"


def moments_named(diagnosis: Mapping[str, Any] | None) -> list[float]:
    """Times [s] at which a change that is named begins, is complete, or ends."""
    found = [c["inner"] for c in (diagnosis or {}).get("candidates", ()) if c["found"]]
    return sorted({time for inner in found for name, time in inner.items() if _is_time_of_change(name)})


def _is_time_of_change(name: str) -> bool:
    """Whether a number of a candidate is a moment: a failure may come and go several times, t0 to t1, t2 to t3."""
    return name in TIMES_OF_CHANGE or re.fullmatch(r"t\d+", name) is not None


def cards(diagnosis: Mapping[str, Any], flight: FlightData) -> list[Card]:
    """The candidates of a diagnosis as of ``diagnose --json``, best first."""
    return [_card(candidate, flight) for candidate in diagnosis["candidates"]]


def _card(candidate: Mapping[str, Any], flight: FlightData) -> Card:
    terms = {a: tuple(texts) for a, texts in candidate.get("terms", {}).items()}
    main = candidate["main_axis"]
    effect = candidate["effect"]
    numbers = [_fitted(p) for p in candidate["parameters"] if p["value"] is not None]
    numbers += [f"{name} = {value:.4g}{_unit(effect, name)}" for name, value in candidate["inner"].items()]
    return Card(
        key=effect or candidate["expression"],
        title=candidate["name"] if effect else f"What no effect of the library has: {candidate['label']}",
        label=candidate["label"],
        physics=candidate["physics"] or "",
        found=candidate["found"],
        main_axis=main,
        before=candidate["error_before"] or np.nan,
        after=candidate["error_after"] or np.nan,
        p_value=candidate["p_value"],
        where=candidate["where"],
        how_large=candidate.get("how_large", ""),
        confounded_with=tuple((i, BY_ID[i].name if i in BY_ID else i) for i in candidate["confounded_with"]),
        manoeuvre=candidate["manoeuvre"] or "",
        refused=candidate.get("refused", ""),
        numbers=tuple(numbers),
        evidence=evidence(flight, main, terms[main]) if main in terms else None,
        chosen_anew=chosen_anew(candidate),
        is_to_add=candidate.get("is_to_add", True),
    )


def is_in_model(card: Card, found_for: str, current: str, changes: Mapping[str, Change]) -> bool:
    """Whether the current version has by now what was found for an earlier one.

    What was found for the current version itself is missing there, where the effect was added once before, too.
    """
    return found_for != current and card.key in changes and not is_removal(changes[card.key])


def _fitted(parameter: Mapping[str, Any]) -> str:
    """A number that was fitted, with its standard error where the file of the diagnosis has it."""
    name, std = f"{parameter['axis']}_{parameter['term']}", parameter.get("std")
    value, doubt = rounded(parameter["value"], np.nan if std is None else std)
    return f"{name} = {value}" + ("" if std is None else f" ± {doubt}")


def _unit(effect: str | None, name: str) -> str:
    if effect is None or _is_time_of_change(name):
        return " s"
    inner = (*BY_ID[effect].inner, END, FULL) if effect in BY_ID else ()
    return next((f" {number.unit}" for number in inner if number.name == name and number.unit), "")


def evidence(flight: FlightData, name: str, texts: Sequence[str]) -> Evidence | None:
    """What an axis leaves over against the signal of new terms; None where the flight cannot fit them.

    With y = X theta + Z phi + e fitted to all points, ``left`` is e + Z phi and ``curve`` is Z phi. The signal is
    the one that all terms read, where there is one; else the term itself, or the sum of the terms.
    """
    known = set(flight.model.terms[name])
    programs = [program for program in flight.parsed(texts) if program.text not in known]
    if not programs:
        return None
    columns = flight.columns(programs)
    try:
        fitted = fit_axis(flight, name).extended(columns, [program.text for program in programs]).fit
    except InputError:
        return None
    values = np.nan_to_num(fitted.parameters[-len(programs) :])
    curve = columns @ values
    x, quantity = _own_signal(flight, programs, columns, curve)
    used = np.isfinite(fitted.residual) & np.isfinite(curve) & np.isfinite(x)
    order = np.flatnonzero(used)[np.argsort(x[used], kind="stable")]
    return Evidence(name, quantity, x[order], (fitted.residual + curve)[order], curve[order])


def _own_signal(
    flight: FlightData, programs: Sequence[Program], columns: Array, curve: Array
) -> tuple[Array, Quantity]:
    read = frozenset().union(*(program.signals for program in programs))
    if len(read) == 1:
        (name,) = read
        quantity = quantity_of(name)
        return flight.signal(name) * quantity.factor, quantity
    if len(programs) == 1:
        return columns[:, 0], Quantity(programs[0].text if len(programs[0].text) < 40 else "its term", "-")
    return curve, Quantity("what the effect adds", "-")


def evidence_figure(found: Evidence, theme: Theme, height: int = EVIDENCE_HEIGHT) -> Figure:
    """Dots, means of bins with two standard errors, and the fitted curve."""
    step = max(len(found.x) // _MOST_DOTS, 1)
    dots = {
        "type": "scatter", "mode": "markers", "x": encoded(found.x[::step]), "y": encoded(found.left[::step]),
        "marker": {"size": 3, "color": theme.noise, "opacity": 0.45}, "hoverinfo": "skip", "name": "points",
    }  # fmt: skip
    at, mean, error = _binned(found.x, found.left)
    means = {
        "type": "scatter", "mode": "markers", "x": encoded(at), "y": encoded(mean), "name": "means",
        "marker": {"size": 6, "color": theme.residual},
        "error_y": {"type": "data", "array": encoded(2.0 * error), "width": 0, "color": theme.residual},
    }  # fmt: skip
    every = max(len(found.x) // 600, 1)
    curve = line(found.x[::every], found.curve[::every], theme.predicted, "what the effect adds", width=2.2)
    return figure(
        theme, [dots, curve, means], height,
        xaxis=axis(theme, found.quantity.title, fixedrange=True),
        yaxis=axis(theme, "residual of " + symbol(found.axis) + " [-]", fixedrange=True),
        margin={"l": 66, "r": 8, "t": 8, "b": 42},
    )  # fmt: skip


def _binned(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Middles, means and standard errors of bins of x (sorted) that hold enough points."""
    edges = np.linspace(x[0], x[-1], _BINS + 1) if len(x) else np.zeros(_BINS + 1)
    cuts = np.searchsorted(x, edges)
    parts = [(x[a:b], y[a:b]) for a, b in pairwise(cuts) if b - a >= _LEAST_IN_BIN]
    rows = [(px.mean(), py.mean(), py.std(ddof=1) / np.sqrt(len(py))) for px, py in parts]
    table = np.array(rows).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]
