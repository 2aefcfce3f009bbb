"""Six axes: measured and predicted coefficient over time, the residual, and the errors as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AXIS_WORDS
from aircraft_sysid_ros.diagnosis.compare import FAILS, AxisComparison, Comparison, left_in_words
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.workbench.views.figure import (
    TIMED,
    Figure,
    Theme,
    axis,
    broken,
    broken_time,
    figure,
    gaps_among,
    line,
    span_of,
    thinned,
    ticks_about_zero,
    upright,
)
from aircraft_sysid_ros.workbench.views.words import percent, symbol

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
Span = tuple[float, float]

NO_DATA = "no data"
#: Forces at the left, moments at the right.
ORDER = ("CX", "Cl", "CY", "Cm", "CZ", "Cn")
TIME_TITLE = "time since the filter started [s]"
#: Of the folds, the one whose blocks are shaded.
_SHOWN_FOLD = 0
#: Share of the height of a plot that the residual takes.
_RESIDUAL = 0.36


@dataclass(frozen=True)
class AxisRow:
    """One axis in the table of errors; shares of the spread of its coefficient, None without data."""

    axis: str
    words: str
    held_out: float | None
    fit: float | None
    floor: float | None  # None, too, where the noise is not known
    state: str
    reason: str = ""

    @property
    def fails(self) -> bool:
        """Whether places were found where it is worse than noise."""
        return self.state == FAILS


def axis_rows(comparison: Comparison) -> list[AxisRow]:
    """The table of errors, with the numbers of ``compare``."""
    return [_row(comparison, name) for name in AXES]


def _row(comparison: Comparison, name: str) -> AxisRow:
    if name in comparison.reasons:
        return AxisRow(name, AXIS_WORDS[name], None, None, None, NO_DATA, comparison.reasons[name])
    found = comparison.axes[name]
    state = left_in_words(found.fails, found.whiteness.white)
    fit = found.fit
    return AxisRow(name, AXIS_WORDS[name], fit.nrmse_held_out, fit.nrmse_fit, found.floor.nrmse, state)


def error_sentence(row: AxisRow) -> str:
    """The errors of an axis in one line, for a figure."""
    if row.held_out is None:
        return row.reason
    noise = "" if row.floor is None else f", noise {percent(row.floor)} %"
    return f"error {percent(row.held_out)} % of spread{noise}"


def time_of(flight: FlightData) -> Array:
    """Time (n,) of the recording [s], as people read it."""
    return flight.time + flight.begin


def whole(comparison: Comparison) -> Span:
    """Begin and end [s] of the flight."""
    time = time_of(comparison.flight)
    return float(time[0]), float(time[-1])


def coefficient_figure(
    comparison: Comparison,
    name: str,
    theme: Theme,
    window: Span | None = None,
    marks: Sequence[Span] = (),
    beside: Comparison | None = None,
    moments: Sequence[float] = (),
    height: int = 226,
) -> Figure:
    """One axis in a window of time [s]: above measured and predicted, below the held-out residual in its noise.

    ``marks`` are spans of time that were chosen; ``beside`` is the same flight under another version; ``moments`` [s]
    are those at which something changed.
    """
    window = window or whole(comparison)
    time, measured = time_of(comparison.flight), comparison.flight.coefficient(name)
    at, at_beside = _moments(comparison, beside, name, window)
    apart = gaps_among(time, at)
    data = [line(broken_time(time[at], apart), broken(measured[at], apart), theme.ink, "measured", width=2.2)]
    residuals = []
    if beside is not None and name in beside.axes:
        colours, words = (theme.second, theme.second), ("the other version", "residual, the other version")
        data += _model(beside, name, at_beside, colours, words)
        residuals.append(beside.axes[name].fit.held_out[at_beside])
    if name in comparison.axes:
        found = comparison.axes[name]
        data += _noise_band(found, time, window, theme)
        data += _model(comparison, name, at, (theme.predicted, theme.residual), ("predicted", "residual, held out"))
        residuals += [found.fit.held_out[at], 2.0 * found.floor.std[at]]
    ticks = ticks_about_zero(*residuals)
    split, held_out = _RESIDUAL, _held_out(comparison.flight)
    return figure(
        theme, data, height,
        xaxis=axis(theme, TIME_TITLE, range=list(window), anchor="y2", nticks=9),
        yaxis=axis(theme, symbol(name) + " [-]", domain=[split + 0.05, 1.0], fixedrange=True, nticks=5),
        yaxis2=axis(theme, "residual [-]", domain=[0.0, split], fixedrange=True, **ticks),
        **TIMED, shapes=[
            *bands(held_out, window, theme.shade),
            *bands(marks, window, theme.mark),
            *(upright(t, theme.second, 1.5) for t in moments if window[0] <= t <= window[1]),
        ],
    )  # fmt: skip


def _moments(comparison: Comparison, beside: Comparison | None, name: str, window: Span) -> tuple[Indices, Indices]:
    """The moments at which the lines of both versions are drawn: the same where both have the same times."""
    time, lines = time_of(comparison.flight), _lines(comparison, name)
    if beside is None:
        return thinned(time, lines, window), np.arange(0)
    time_beside, of_beside = time_of(beside.flight), _lines(beside, name)
    if np.array_equal(time, time_beside):
        at = thinned(time, np.column_stack([lines, of_beside]), window)
        return at, at
    return thinned(time, lines, window), thinned(time_beside, of_beside, window)


def _lines(comparison: Comparison, name: str) -> Array:
    """What is drawn of one axis, (n, 1) or (n, 3): measured, predicted, held-out residual."""
    measured, found = comparison.flight.coefficient(name), comparison.axes.get(name)
    return np.column_stack([measured] if found is None else [measured, predicted(comparison, name), found.fit.held_out])


def predicted(comparison: Comparison, name: str) -> Array:
    """Prediction (n,) of an axis by parameters that have not seen the point: measured less the held-out residual.

    Of points that were in no block, that of the fit.
    """
    found, measured = comparison.axes[name], comparison.flight.coefficient(name)
    unseen = measured - found.fit.held_out
    return np.where(np.isfinite(unseen), unseen, found.predicted)


def _model(
    comparison: Comparison, name: str, at: Indices, colours: tuple[str, str], words: tuple[str, str]
) -> list[dict[str, Any]]:
    """Prediction and held-out residual at the moments of some indices."""
    time, residual = time_of(comparison.flight), comparison.axes[name].fit.held_out
    apart = gaps_among(time, at)
    drawn = broken_time(time[at], apart)
    return [
        line(drawn, broken(predicted(comparison, name)[at], apart), colours[0], words[0], width=1.1),
        line(drawn, broken(residual[at], apart), colours[1], words[1], yaxis="y2", width=1.0),
    ]


def _noise_band(found: AxisComparison, time: Array, window: Span, theme: Theme) -> list[dict[str, Any]]:
    """Two sigma of the noise of a perfect model."""
    begin, end = span_of(time, window)
    step = max((end - begin) // 300, 1)
    apart = gaps_among(time, np.arange(begin, end, step))
    x, std = broken_time(time[begin:end:step], apart), broken(found.floor.std[begin:end:step], apart)
    return [
        line(
            x,
            sign * 2.0 * std,
            theme.noise,
            "two sigma of noise",
            yaxis="y2",
            width=1.0,
            dash="dot",
            hoverinfo="skip",
            showlegend=sign > 0.0,
        )
        for sign in (-1.0, 1.0)
    ]


def _held_out(flight: FlightData) -> list[Span]:
    """What is held out together."""
    return [(flight.begin + begin, flight.begin + end) for begin, end in flight.held_out_spans(_SHOWN_FOLD)]


def bands(spans: Sequence[Span], window: Span, colour: str) -> list[dict[str, Any]]:
    """Spans of time within a window as one shape: a shape of its own for each would be slow."""
    inside = [(max(b, window[0]), min(e, window[1])) for b, e in spans if e > window[0] and b < window[1]]
    if not inside:
        return []
    path = "".join(f"M{b:.3f},0V1H{e:.3f}V0Z" for b, e in inside)
    place = {"type": "path", "xref": "x", "yref": "paper", "path": path}
    return [{**place, "fillcolor": colour, "line": {"width": 0}, "layer": "below"}]
