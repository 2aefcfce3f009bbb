"""Where a model fails: a list of places, and a map of the residual on two signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.significance.error_regions import Place, cells
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.workbench.views.coefficients import time_of
from aircraft_sysid_ros.workbench.views.figure import Figure, Theme, axis, encoded, figure
from aircraft_sysid_ros.workbench.views.words import quantity_of

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Span = tuple[float, float]

#: Cells of a map along each signal, and points below which a cell says nothing.
CELLS, LEAST_POINTS = 18, 4
#: Shares of the flight beyond the ends of a map: a few odd points must not squeeze the rest.
_TAIL = 0.002
#: Points of a place that are this near [s] are one span; at most so many spans are shown.
_JOIN, _MOST_SPANS = 0.6, 40
#: Share of the cells within the colours of a map.
_TOP = 0.97


@dataclass(frozen=True)
class ResidualMap:
    """Rms of the residual, in times the noise, by cells of two signals; NaN where too little was flown."""

    name: str
    signals: tuple[str, str]
    edges: tuple[Array, Array]  # (CELLS + 1,) each, SI
    times_noise: Array  # (CELLS, CELLS), rows of the second signal


def moving_signals(flight: FlightData) -> list[str]:
    """Signals that this flight has and that move."""
    there = [name for name in flight.model.signal_names if np.isfinite(flight.signal(name)).any()]
    return [name for name in there if np.nanstd(flight.signal(name)) > 0.0]


def shared_edges(flights: Sequence[FlightData], x: str, y: str) -> tuple[Array, Array]:
    """Edges of cells that span what all of these flights have flown of two signals."""
    joined = (np.concatenate([flight.signal(name) for flight in flights]) for name in (x, y))
    across, upwards = (_edges(values) for values in joined)
    return across, upwards


def residual_map(
    comparison: Comparison, name: str, x: str, y: str, edges: tuple[Array, Array] | None = None
) -> ResidualMap:
    """The map of one axis over two signals, between ``edges`` or those of its flight; ``name`` must have data."""
    found, flight = comparison.axes[name], comparison.flight
    z = found.fit.held_out / found.floor.std
    edges = shared_edges([flight], x, y) if edges is None else edges
    inside = np.isfinite(z)
    columns = [np.digitize(flight.signal(s), e) - 1 for s, e in zip((x, y), edges, strict=True)]
    for column in columns:
        inside &= (column >= 0) & (column < CELLS)
    cell = columns[1][inside] * CELLS + columns[0][inside]
    count = np.bincount(cell, minlength=CELLS**2)
    square = np.bincount(cell, z[inside] ** 2, minlength=CELLS**2)
    with np.errstate(invalid="ignore", divide="ignore"):
        rms = np.where(count >= LEAST_POINTS, np.sqrt(square / count), np.nan)
    return ResidualMap(name, (x, y), edges, rms.reshape(CELLS, CELLS))


def _edges(values: Array) -> Array:
    low, high = np.nanquantile(values, [_TAIL, 1.0 - _TAIL])
    return np.linspace(low, high if high > low else low + 1.0, CELLS + 1)


def top_of(times_noise: Array) -> float:
    """The end of the colours [times the noise]: a few odd ones must not squeeze the rest."""
    known = times_noise[np.isfinite(times_noise)]
    return max(float(np.quantile(known, _TOP)), 2.0) if len(known) else 2.0


def colour_bar(times_noise: Array, theme: Theme, top: float | None = None) -> tuple[dict[str, Any], float, float]:
    """The scale of colours with its bar, from the noise to ``top``, by default the end of what is shown; both ends."""
    top = top_of(times_noise) if top is None else top
    ticks = np.linspace(1.0, top, 4)
    words = [f"≤ {ticks[0]:.0f}", *(f"{tick:.1f}" for tick in ticks[1:-1]), f"≥ {top:.1f}"]
    bar = {
        "colorscale": [[i / (len(theme.scale) - 1), colour] for i, colour in enumerate(theme.scale)],
        "title": {"text": "times the noise", "side": "right"}, "thickness": 10, "outlinewidth": 0, "len": 0.9,
        "tickvals": ticks.tolist(), "ticktext": words, "tickfont": {"color": theme.muted},
    }  # fmt: skip
    return bar, 1.0, top


def map_figure(found: ResidualMap, theme: Theme, height: int = 330, top: float | None = None) -> Figure:
    """The map, with a scale that begins at the noise and ends at ``top``, by default its own."""
    words = [quantity_of(name) for name in found.signals]
    x, y = (0.5 * (e[1:] + e[:-1]) * w.factor for e, w in zip(found.edges, words, strict=True))
    bar, low, high = colour_bar(found.times_noise, theme, top)
    heat = {
        "type": "heatmap", "x": encoded(x), "y": encoded(y), "z": encoded(found.times_noise),
        "zmin": low, "zmax": high, "colorscale": bar.pop("colorscale"), "xgap": 1, "ygap": 1,
        "hoverongaps": False,
        "hovertemplate": f"{words[0].words} %{{x:.3g}} {words[0].unit}<br>{words[1].words} %{{y:.3g}} {words[1].unit}"
        "<br>%{z:.1f} times the noise<extra></extra>",
        "colorbar": bar,
    }  # fmt: skip
    return figure(
        theme, [heat], height,
        xaxis=axis(theme, words[0].title, fixedrange=True, showgrid=False),
        yaxis=axis(theme, words[1].title, fixedrange=True, showgrid=False),
        margin={"l": 62, "r": 8, "t": 10, "b": 44},
    )  # fmt: skip


def mask_of_cell(flight: FlightData, found: ResidualMap, x: float, y: float) -> Mask:
    """Points (n,) of the cell that a click at x, y (in the units of the map) meets."""
    inside: Mask = np.ones(len(flight.time), dtype=bool)
    for name, edges, at in zip(found.signals, found.edges, (x, y), strict=True):
        k = int(np.clip(np.searchsorted(edges, at / quantity_of(name).factor) - 1, 0, CELLS - 1))
        values = flight.signal(name)
        inside &= (values >= edges[k]) & (values < edges[k + 1])
    return inside


def spans_of_place(comparison: Comparison, place: Place) -> list[Span]:
    """Spans of time [s] of a place: the stretch itself, or when the flight was in the cell."""
    if not place.is_cell:
        return [(place.t_start, place.t_end)]
    mask = mask_of_place(comparison, place)
    return [(place.t_start, place.t_end)] if mask is None else spans_of(time_of(comparison.flight), mask)


def mask_of_place(comparison: Comparison, place: Place) -> Mask | None:
    """Points (n,) of a cell of the flight envelope, found again by its words; None where it is not."""
    found = comparison.axes[place.axis]
    judged = np.isfinite(found.fit.held_out / found.floor.std)
    return next((mask for _, mask, words in cells(comparison.flight, judged) if words == place.conditions), None)


def spans_of(time: Array, mask: Mask) -> list[Span]:
    """Spans of time [s] that hold the points of a mask, the longest of them where they are many, in order."""
    at = time[mask]
    if not len(at):
        return []
    breaks = np.flatnonzero(np.diff(at) > _JOIN)
    begins, ends = at[np.concatenate([[0], breaks + 1])], at[np.concatenate([breaks, [len(at) - 1]])]
    spans = [(float(b) - 0.05, float(e) + 0.05) for b, e in zip(begins, ends, strict=True)]
    return sorted(sorted(spans, key=lambda s: s[0] - s[1])[:_MOST_SPANS])


def window_around(spans: list[Span], whole: Span) -> Span:
    """The window that shows spans with room around them."""
    begin, end = spans[0][0], spans[-1][1]
    room = max(0.15 * (end - begin), 2.0)
    return max(begin - room, whole[0]), min(end + room, whole[1])


#: Where nothing fails; the map beside it may have dark cells all the same. And where that cannot be said.
NOT_JUDGED = f"That cannot be said: {THRESHOLDS.shortest:g} s of flight that show what the model leaves are needed."
NOWHERE = (
    "Nowhere: no stretch of time and no part of the flight envelope is worse than noise alone makes one of so many. "
    "Of the cells of a map, too, noise alone makes a few stand out."
)


def nowhere(comparison: Comparison) -> str:
    """What is said where no place fails: so it is, or the flight is too short to tell in any axis."""
    return NOWHERE if any(axis.fails is False for axis in comparison.axes.values()) else NOT_JUDGED


def first_axis(comparison: Comparison) -> str:
    """The axis that is looked at first: the one that is furthest above its noise."""
    axes = comparison.axes
    return max((a for a in AXES if a in axes), key=lambda a: axes[a].fit.nrmse_held_out / axes[a].floor.nrmse)
