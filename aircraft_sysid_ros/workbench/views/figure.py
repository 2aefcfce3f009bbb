"""What all figures have in common: colours, fonts, thinned lines. A figure is a dict as plotly.js takes it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import escape

from aircraft_sysid_ros.stretches import Indices, gaps

Array = npt.NDArray[np.float64]
Figure = dict[str, Any]

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
#: Points of a line that are drawn: two per pixel of a narrow plot.
MOST_POINTS = 1000
#: What a curve that leaves the range of its plot is called, and most marks of it at one edge.
BEYOND, _MOST_MARKS = "beyond the plot", 40
#: A figure can be saved: the one button that plotly.js shows over it. No list in a list: plotly.js would take the
#: configuration for a new one, and begin the figure anew, each time that it is drawn.
CONFIG = {
    "modeBarButtonsToRemove": [
        "zoom2d",
        "pan2d",
        "select2d",
        "lasso2d",
        "zoomIn2d",
        "zoomOut2d",
        "autoScale2d",
        "resetScale2d",
        "sendChartToCloud",
    ],
    "toImageButtonOptions": {"format": "svg", "filename": "figure"},
    "plotlyServerURL": "",  # nothing is uploaded: plotly.js offers it by itself from version 4 on
    "displaylogo": False,
    "responsive": True,
    "doubleClick": "autosize",
    "showTips": False,
}


@dataclass(frozen=True)
class Theme:
    """Colours of light or dark figures. Lines are of Okabe and Ito: told apart by the colour-blind."""

    name: str
    ink: str  # text, and what was measured
    muted: str
    grid: str
    shade: str  # segments that are held out
    mark: str  # what was chosen
    predicted: str
    second: str  # another version
    residual: str
    noise: str
    pale: str  # intervals
    surface: str
    scale: tuple[str, ...]  # of maps, from nothing to much


LIGHT = Theme(
    "light", ink="#1d2329", muted="#66707a", grid="#e4e8ec", shade="rgba(29,35,41,0.055)",
    mark="rgba(230,159,0,0.15)", predicted="#d55e00", second="#009e73", residual="#0072b2", noise="#8a949e",
    pale="rgba(0,114,178,0.16)", surface="#ffffff", scale=("#dde8f2", "#c9d9ea", "#8fb0d3", "#3f78ae", "#0b3a67"),
)  # fmt: skip
DARK = Theme(
    "dark", ink="#e6eaee", muted="#98a3ad", grid="#2d353d", shade="rgba(230,234,238,0.06)",
    mark="rgba(230,159,0,0.17)", predicted="#f0843c", second="#2cc39a", residual="#56b4e9", noise="#7d8893",
    pale="rgba(86,180,233,0.18)", surface="#1b2127", scale=("#2d3a46", "#2b4560", "#3a6d9c", "#68a5d8", "#cfe6fb"),
)  # fmt: skip


def figure(theme: Theme, data: list[dict[str, Any]], height: int, **layout: Any) -> Figure:
    """A figure with the house layout; ``layout`` goes over it."""
    base = {
        "height": height,
        "margin": {"l": 76, "r": 12, "t": 6, "b": 36},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": FONT, "size": 12, "color": theme.muted},
        "hoverlabel": {"bgcolor": theme.surface, "bordercolor": theme.grid, "font": {"color": theme.ink}},
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": theme.muted, "activecolor": theme.ink},
        "showlegend": False,
        "legend": {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "font": {"size": 12}, "entrywidth": 0},
        "hovermode": "closest",
        "dragmode": "zoom",
    }
    return {"data": data, "layout": {**base, **layout}, "config": CONFIG}


#: A figure over time: the page draws one line through all of these, with the values there (crosshair.js).
TIMED: dict[str, Any] = {"meta": "time", "hovermode": False}


def axis(theme: Theme, title: str, **more: Any) -> dict[str, Any]:
    """One axis of a figure, with name and unit: text, or markup, of which plotly.js draws some."""
    base = {
        "title": {"text": str(escape(title)), "standoff": 5},
        "gridcolor": theme.grid,
        "zeroline": False,
        "linecolor": theme.grid,
        "showline": True,
        "ticks": "",
        "exponentformat": "none",
        "nticks": 6,
    }
    return {**base, **more}


def line(x: Array, y: Array, colour: str, name: str, **more: Any) -> dict[str, Any]:
    """A line trace; ``width`` and ``dash`` go to the line."""
    style = {"color": colour, "width": more.pop("width", 1.2), "dash": more.pop("dash", "solid"), "simplify": False}
    base = {"type": "scatter", "mode": "lines", "x": encoded(x), "y": encoded(y), "name": name, "line": style}
    return {**base, **more}


def ticks_about_zero(*lines: Array) -> dict[str, float]:
    """Ticks of an axis with lines on both sides of zero: there and beside it, where plotly.js may find one alone.

    Empty where nothing is known.
    """
    reach = max((float(np.nanmax(np.abs(line))) for line in lines if np.isfinite(line).any()), default=0.0)
    if reach <= 0.0:
        return {}
    decade = 10.0 ** np.floor(np.log10(reach))
    return {"tick0": 0.0, "dtick": float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= reach))}


def upright(at: float, colour: str, width: float) -> dict[str, Any]:
    """A dashed line through all of a figure, at a place of its first axis."""
    return {
        "type": "line", "xref": "x", "yref": "paper", "x0": at, "x1": at, "y0": 0, "y1": 1,
        "line": {"color": colour, "width": width, "dash": "dash"},
    }  # fmt: skip


def beyond(time: Array, values: Array, limits: Sequence[float] | None, theme: Theme) -> list[dict[str, Any]]:
    """Triangles at the edge of a plot where curves (n,) or (n, k) leave its range; nothing where none does.

    time rises. Of each slot of time one is drawn.
    """
    if limits is None or not len(time):
        return []
    columns = values.reshape(len(time), -1)
    inward = 0.02 * (limits[1] - limits[0])  # plotly hides a mark whose middle is outside
    slot = np.floor((time - time[0]) / max(float(time[-1] - time[0]), 1e-9) * _MOST_MARKS)
    found: list[dict[str, Any]] = []
    for outside, edge, shape in (
        (columns < limits[0], limits[0] + inward, "triangle-down"),
        (columns > limits[1], limits[1] - inward, "triangle-up"),
    ):  # fmt: skip
        at = np.flatnonzero(outside.any(axis=1))
        at = at[np.unique(slot[at], return_index=True)[1]]
        if not len(at):
            continue
        found.append({
            "type": "scatter", "mode": "markers", "x": encoded(time[at]), "y": encoded(np.full(len(at), edge)),
            "marker": {"size": 6, "symbol": shape, "color": theme.muted}, "cliponaxis": False, "hoverinfo": "skip",
            "name": BEYOND, "legendgroup": BEYOND, "showlegend": not found,
        })  # fmt: skip
    return found


def thinned(
    time: Array, values: Array, window: tuple[float, float] | None = None, most: int = MOST_POINTS
) -> npt.NDArray[np.intp]:
    """Indices of the moments by which lines (n,) or (n, k) are drawn: where one has its least or largest in a slot.

    Lines that are drawn at the same moments can be read together. time rises. One point beyond each border of the
    window [s] stays, so that lines reach it; all points where there are few, else at most ``most`` or so.
    """
    begin, end = (0, len(time)) if window is None else span_of(time, window)
    count, columns = end - begin, values[begin:end].reshape(end - begin, -1).T
    if count <= most:
        return np.arange(begin, end)
    size = -(-count // (most // (2 * len(columns))))
    first = np.arange(0, count, size)
    padded = np.full((len(columns), len(first) * size), np.nan)
    padded[:, :count] = columns
    table = padded.reshape(len(columns), len(first), size)
    low = np.argmin(np.where(np.isnan(table), np.inf, table), axis=2)
    high = np.argmax(np.where(np.isnan(table), -np.inf, table), axis=2)
    is_gap = np.asarray(np.isnan(columns).all(axis=0))
    ends = np.flatnonzero(is_gap[1:] & ~is_gap[:-1]) + 1  # else a line would go on across a gap of one moment
    ends = ends if len(ends) < most // 2 else ends[:0]
    chosen = np.unique(np.concatenate([(first + low).ravel(), (first + high).ravel(), ends]))
    moments: npt.NDArray[np.intp] = begin + np.minimum(chosen, count - 1)
    return moments


def gaps_among(time: Array, at: Indices) -> Indices:
    """Places in ``at``, rising indices of times (n,), before which a gap lies."""
    return 1 + np.flatnonzero(np.diff(np.searchsorted(gaps(time), at, side="right")))


def broken(values: Array, at: Indices) -> Array:
    """Values (n,) or (n, k) with NaN in gaps, where lines end."""
    return np.insert(values.astype(np.float64), at, np.nan, axis=0)


def broken_time(time: Array, at: Indices) -> Array:
    """Times (n,) with the middle of gaps."""
    return np.insert(time.astype(np.float64), at, 0.5 * (time[at - 1] + time[at]))


def span_of(time: Array, window: tuple[float, float]) -> tuple[int, int]:
    """First and end index of what lies in a window, and one more on either side."""
    begin = max(int(np.searchsorted(time, window[0])) - 1, 0)
    return begin, min(int(np.searchsorted(time, window[1], side="right")) + 1, len(time))


def encoded(values: npt.ArrayLike) -> dict[str, Any]:
    """Numbers as plotly.js reads them without parsing: 32 bit, base64."""
    array = np.ascontiguousarray(values, dtype="<f4")
    coded: dict[str, Any] = {"dtype": "f4", "bdata": base64.b64encode(array.tobytes()).decode()}
    return coded if array.ndim == 1 else {**coded, "shape": ", ".join(map(str, array.shape))}
