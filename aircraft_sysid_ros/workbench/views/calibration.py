"""A calibration: Tr R over the sampled parameters, as figures 2, 4 and 6 of the two-stage paper, and the residuals."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.workbench.calibration_view import CalibrationView, Residual
from aircraft_sysid_ros.workbench.views.coefficients import bands
from aircraft_sysid_ros.workbench.views.figure import Figure, Theme, axis, encoded, figure, upright
from aircraft_sysid_ros.workbench.views.parameters import INTERVAL

Array = npt.NDArray[np.float64]

TRACE = "Tr R"
_MARGIN = {"l": 66, "r": 12, "t": 8, "b": 44}
#: Share of the samples within the colours of the plane.
_TOP = 0.95
_TICKS = (1.0, 2.0, 5.0)


def verdict(view: CalibrationView) -> str:
    """Whether the flight has one minimum, in words."""
    return "One clear minimum" if view.unique else "No unique minimum"


def sentences(view: CalibrationView) -> list[str]:
    """Why, and what stage 2 made of it."""
    why = view.decision[:1].upper() + view.decision[1:]
    fitted = view.stage_2.replace("xi2 alone", "the sampled parameters alone")
    return [
        f"{why}.",
        f"Stage 2: {fitted}" + ("." if view.converged else ", not converged."),
        f"{TRACE} is the mean square of what a sample leaves unexplained; stage 2 fits from the best.",
    ]


def trace_figure(view: CalibrationView, column: int, theme: Theme, height: int = 240) -> Figure:
    """Tr R of every sample over one parameter (figure 2), with the minima, the estimate and its interval."""
    parameter = view.sampled[column]
    data = [_dots(view.xi2[:, column], view.trace, theme), _minima(view, column, theme)]
    shapes = []
    if parameter.estimate is not None:
        shapes.append(upright(parameter.estimate, theme.predicted, 1.6))
    if parameter.estimate is not None and parameter.std is not None:
        low, high = (parameter.estimate + sign * INTERVAL * parameter.std for sign in (-1.0, 1.0))
        shapes.insert(0, {
            "type": "rect", "xref": "x", "yref": "paper", "x0": low, "x1": high,
            "y0": 0, "y1": 1, "fillcolor": theme.mark, "line": {"width": 0}, "layer": "below",
        })  # fmt: skip
    return figure(
        theme, data, height,
        xaxis=axis(theme, parameter.title, fixedrange=True, range=_reach(view.xi2[:, column], parameter.estimate)),
        yaxis=_trace_axis(view, theme), shapes=shapes, margin=_MARGIN,
    )  # fmt: skip


def distance_figure(view: CalibrationView, theme: Theme, height: int = 240) -> Figure | None:
    """Tr R over the distance from the estimate in half ranges of the samples; None where an estimate is not known.

    Figure 6 has the norm of xi2 there, which adds angles to scales.
    """
    if not np.isfinite(view.estimate).all():
        return None
    data = [_dots(_distance(view, view.xi2), view.trace, theme)]
    return figure(
        theme, data, height,
        xaxis=axis(theme, "distance [half ranges]", fixedrange=True, rangemode="tozero"),
        yaxis=_trace_axis(view, theme), margin=_MARGIN,
    )  # fmt: skip


def plane_figure(view: CalibrationView, x: int, y: int, theme: Theme, height: int = 380) -> Figure:
    """The plane of two parameters, coloured by Tr R (figure 4): the darkest has the least."""
    known = np.isfinite(view.trace)
    order = np.argsort(-view.trace[known], kind="stable")  # the lowest are drawn last, on top
    points, value = view.xi2[known][order], np.log10(view.trace[known][order])
    low, high = (float(value.min()), float(np.quantile(value, _TOP))) if len(value) else (0.0, 1.0)
    high = high if high > low else low + 1.0
    shades = theme.scale[::-1]
    scale = [[i / (len(shades) - 1), colour] for i, colour in enumerate(shades)]
    ticks = _log_ticks(low, high)
    words = [f"{tick:g}" for tick in ticks]
    dots = {
        "type": "scatter", "mode": "markers", "x": encoded(points[:, x]), "y": encoded(points[:, y]),
        "marker": {
            "size": 7, "color": encoded(value), "cmin": low, "cmax": high, "colorscale": scale,
            "line": {"width": 0.5, "color": theme.muted},
            "colorbar": {
                "title": {"text": TRACE, "side": "top"}, "thickness": 10, "outlinewidth": 0, "len": 0.9,
                "tickvals": np.log10(ticks).tolist(), "ticktext": words, "tickfont": {"color": theme.muted},
            },
        },
        "customdata": encoded(10.0**value), "hovertemplate": f"{TRACE} %{{customdata:.3g}}<extra></extra>",
        "name": "samples",
    }  # fmt: skip
    one, other = view.sampled[x], view.sampled[y]
    estimate = {
        "type": "scatter", "mode": "markers", "x": [one.estimate], "y": [other.estimate], "name": "estimate",
        "marker": {"size": 13, "symbol": "x-thin", "line": {"width": 3, "color": theme.predicted}},
    }  # fmt: skip
    return figure(
        theme, [dots, estimate], height,
        xaxis=axis(theme, one.title, fixedrange=True), yaxis=axis(theme, other.title, fixedrange=True), margin=_MARGIN,
    )  # fmt: skip


def residual_figure(view: CalibrationView, output: Residual, theme: Theme, height: int = 230) -> Figure:
    """Residuals of one output over time, before and after; shaded is what stage 1 took."""
    both = (("before", output.before, theme.noise, "circle-open"), ("after", output.after, theme.residual, "circle"))
    data = [
        {
            "type": "scatter", "mode": "markers", "x": encoded(view.time), "y": encoded(values), "name": name,
            "marker": {"size": 3.5, "color": colour, "symbol": symbol}, "hoverinfo": "skip",
        }
        for name, values, colour, symbol in both
    ]  # fmt: skip
    window = (float(view.time[0]), float(view.time[-1])) if len(view.time) else (0.0, 1.0)
    return figure(
        theme, data, height,
        xaxis=axis(theme, "time that was used [s]"),
        yaxis=axis(theme, f"{output.name} [{short_unit(view.unit)}]", fixedrange=True),
        shapes=bands([(begin, end) for _, begin, end in view.segments], window, theme.shade), margin=_MARGIN,
    )  # fmt: skip


def short_unit(unit: str) -> str:
    """A unit as short as beside an axis."""
    return {"sigma of the aircraft file": "σ", "unit of the sensor": "sensor"}.get(unit, unit)


def _dots(x: Array, trace: Array, theme: Theme) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "markers", "x": encoded(x), "y": encoded(trace), "name": "samples",
        "marker": {"size": 4, "color": theme.residual, "opacity": 0.6},
        "hovertemplate": f"%{{x:.3g}}<br>{TRACE} %{{y:.3g}}<extra></extra>",
    }  # fmt: skip


def _minima(view: CalibrationView, column: int, theme: Theme) -> dict[str, Any]:
    """Where Tr R ends when it is followed down from the best samples."""
    return {
        "type": "scatter", "mode": "markers", "name": "minimum of stage 1",
        "x": encoded([xi2[column] for xi2, _ in view.minima]), "y": encoded([trace for _, trace in view.minima]),
        "marker": {"size": 10, "symbol": "diamond-open", "color": theme.ink, "line": {"width": 2}},
        "hovertemplate": f"minimum %{{x:.3g}}<br>{TRACE} %{{y:.3g}}<extra></extra>",
    }  # fmt: skip


def _trace_axis(view: CalibrationView, theme: Theme) -> dict[str, Any]:
    """Logarithmic, the same for all parameters: samples and minima lie within."""
    values = np.concatenate([view.trace, [trace for _, trace in view.minima]])
    values = values[np.isfinite(values) & (values > 0.0)]
    low, high = (np.log10(values.min()), np.log10(values.max())) if len(values) else (0.0, 1.0)
    room = 0.06 * (high - low) + 0.02
    ticks = _log_ticks(low - room, high + room)
    return axis(
        theme, TRACE, type="log", fixedrange=True, range=[float(low - room), float(high + room)],
        tickvals=ticks, ticktext=[f"{tick:g}" for tick in ticks],
    )  # fmt: skip


def _log_ticks(low: float, high: float) -> list[float]:
    """1, 2, 5 or powers of ten between powers of ten; both ends where there is none in between."""
    powers = np.arange(np.floor(low), np.ceil(high) + 1.0)
    many = len(powers) > 4
    ticks = [m * 10.0**p for p in powers for m in ((1.0,) if many else _TICKS) if low <= np.log10(m) + p <= high]
    return ticks if len(ticks) > 1 else [float(f"{10.0**end:.3g}") for end in (low, high)]


def _reach(x: Array, estimate: float | None) -> list[float]:
    """Range of the samples and of the estimate."""
    values = x[np.isfinite(x)]
    if estimate is not None:
        values = np.append(values, estimate)
    if not len(values):
        return [0.0, 1.0]
    room = 0.04 * float(np.ptp(values)) or 1.0
    return [float(values.min()) - room, float(values.max()) + room]


def _distance(view: CalibrationView, xi2: Array) -> Array:
    spread = 0.5 * np.ptp(view.xi2, axis=0)
    return np.asarray(np.linalg.norm((xi2 - view.estimate) / np.where(spread > 0.0, spread, 1.0), axis=1))
