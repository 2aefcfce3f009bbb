"""Where the aeroplane was when the model failed: the track over the ground and the height, coloured by model error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.stretches import stretches
from aircraft_sysid_ros.workbench.views.coefficients import TIME_TITLE, time_of
from aircraft_sysid_ros.workbench.views.figure import Figure, Theme, axis, encoded, figure, line
from aircraft_sysid_ros.workbench.views.places import colour_bar
from aircraft_sysid_ros.workbench.views.states import StateHistory
from aircraft_sysid_ros.workbench.views.words import symbol

Array = npt.NDArray[np.float64]

#: Least length of a piece of the track that has one colour [s], and most pieces.
_SHORTEST, _MOST = 1.0, 500
#: The worst of all axes, as the menu of axes calls it.
WORST = "worst"


@dataclass(frozen=True)
class FlownError:
    """The residual by pieces of the flight, n of them: middle [s], rms in times the noise, and of which axis."""

    time: Array  # (n,)
    times_noise: Array  # (n,)
    axis: tuple[str, ...]  # (n,)


def flown_error(comparison: Comparison, name: str = WORST) -> FlownError:
    """Of one axis, or in each piece that of the worst axis; pieces in which nothing was measured are left out."""
    time = time_of(comparison.flight)
    length = max(_SHORTEST, float(time[-1] - time[0]) / _MOST)
    piece = ((time - time[0]) / length).astype(np.int64)
    count = int(piece[-1]) + 1
    names = [each for each in AXES if each in comparison.axes and name in (WORST, each)]
    table = np.full((len(names), count), np.nan)
    for row, each in enumerate(names):
        found = comparison.axes[each]
        z = found.fit.held_out / found.floor.std
        known = np.isfinite(z)
        points = np.bincount(piece[known], minlength=count)
        square = np.bincount(piece[known], z[known] ** 2, minlength=count)
        with np.errstate(invalid="ignore", divide="ignore"):
            table[row] = np.where(points > 0, np.sqrt(square / points), np.nan)
    there = np.isfinite(table).any(axis=0)
    worst = np.argmax(np.where(np.isnan(table), -np.inf, table), axis=0)
    middle: Array = float(time[0]) + length * (np.arange(count, dtype=np.float64) + 0.5)
    at = np.flatnonzero(there)
    return FlownError(middle[at], table[worst[at], at], tuple(names[k] for k in worst[at]))


def track_figure(state: StateHistory, error: FlownError | None, theme: Theme, height: int = 460) -> Figure:
    """The track over the ground seen from above, start and end marked; None: the track alone.

    Without GPS it is the track in the air, and its axes say so; of several manoeuvres each begins at the origin.
    """
    at = _drawn(state)
    whole_north, whole_east = state.position[at, 0], state.position[at, 1]
    parts = (_parts(state) if state.is_joined else []) or [(0, len(state.time) - 1)]
    marked = np.array(parts).ravel()
    ends = {
        "type": "scatter", "mode": "markers+text", "x": encoded(state.position[marked, 1]),
        "y": encoded(state.position[marked, 0]), "text": ["start", "end", *[""] * (len(marked) - 2)],
        "textposition": "top center", "hoverinfo": "skip", "name": "ends", "textfont": {"color": theme.ink},
        "marker": {"size": 9, "color": theme.ink, "symbol": ["circle", "square"] * len(parts)},
    }  # fmt: skip
    data = [line(whole_east, whole_north, theme.noise, "track", width=1.0, hoverinfo="skip")]
    if error is not None:
        north, east = (np.interp(error.time, state.time, state.position[:, k]) for k in (0, 1))
        data.append(_coloured(east, north, error, theme))
    within = " of where each manoeuvre began" if state.is_joined else ""
    within += "" if state.knows_wind else ", relative to the air"
    return figure(
        theme, [*data, ends], height,
        xaxis=axis(theme, f"east{within} [m]"),
        yaxis=axis(theme, f"north{within} [m]", scaleanchor="x", scaleratio=1),
        dragmode="pan", margin={"l": 66, "r": 8, "t": 10, "b": 44},
    )  # fmt: skip


def height_figure(state: StateHistory, error: FlownError, theme: Theme, height: int = 460) -> Figure:
    """Height above the origin of the positions over time."""
    shown, origin = _drawn(state), "where each manoeuvre began" if state.is_joined else "the origin"
    path = line(state.time[shown], -state.position[shown, 2], theme.noise, "height", width=1.0, hoverinfo="skip")
    at = -np.interp(error.time, state.time, state.position[:, 2])
    return figure(
        theme, [path, _coloured(error.time, at, error, theme)], height,
        xaxis=axis(theme, TIME_TITLE), yaxis=axis(theme, f"height above {origin} [m]", fixedrange=True),
        margin={"l": 66, "r": 8, "t": 10, "b": 44},
    )  # fmt: skip


def _drawn(state: StateHistory) -> npt.NDArray[np.intp]:
    """Rows that are drawn: evenly taken, and the gaps, where lines end."""
    every = np.arange(0, len(state.time), max(len(state.time) // 2000, 1))
    return np.union1d(every, np.flatnonzero(np.isnan(state.position[:, :2]).any(axis=1)))


def _parts(state: StateHistory) -> list[tuple[int, int]]:
    """First and last row of each part of the track between gaps."""
    is_known = np.asarray(np.isfinite(state.position[:, :2]).all(axis=1))
    return [(begin, end - 1) for begin, end in stretches(is_known)]


def _coloured(x: Array, y: Array, error: FlownError, theme: Theme) -> dict[str, Any]:
    """Marks whose colour is the residual, with its scale."""
    bar, low, high = colour_bar(error.times_noise, theme)
    words = [
        f"{at:.0f} s<br>{symbol(name)}: {times:.1f} times the noise"
        for at, name, times in zip(error.time, error.axis, error.times_noise, strict=True)
    ]
    return {
        "type": "scatter", "mode": "markers", "x": encoded(x), "y": encoded(y), "text": words,
        "hovertemplate": "%{text}<extra></extra>", "name": "model error",
        "marker": {
            "size": 7, "color": encoded(error.times_noise), "cmin": low, "cmax": high,
            "colorscale": bar.pop("colorscale"), "colorbar": bar, "line": {"width": 0.5, "color": theme.noise},
        },
    }  # fmt: skip
