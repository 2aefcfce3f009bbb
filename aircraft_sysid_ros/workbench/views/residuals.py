"""Held-out residuals of each axis against the noise of the sensors: their distribution and their autocorrelation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.compare import AxisComparison, Comparison
from aircraft_sysid_ros.diagnosis.significance.noise_floor import HALF_WIDTH
from aircraft_sysid_ros.workbench.views.figure import Figure, Theme, axis, encoded, figure, line

Array = npt.NDArray[np.float64]

#: The histogram ends there [sigma], and its first and last bar have what is beyond; bars of this width.
_END, _WIDTH = 5.0, 0.25
#: Share of the width of a figure that the histogram takes.
_HISTOGRAM = 0.5


@dataclass(frozen=True)
class ResidualRow:
    """The residual of one axis in numbers; a share is of all samples, NaN where there are too few to tell."""

    axis: str
    rms: float  # in sigma of the noise
    within_two: float
    beyond_three: float
    p_value: float  # of no correlation but that of the noise


def scaled(found: AxisComparison) -> Array:
    """Held-out residuals (m,) over the sigma of the noise, where there are any."""
    z = found.fit.held_out / found.floor.std
    return z[np.isfinite(z)]


def residual_rows(comparison: Comparison) -> list[ResidualRow]:
    """One row for each axis with data."""
    rows = []
    for name in AXES:
        if name in comparison.axes:
            found = comparison.axes[name]
            z = scaled(found)
            within, beyond = float(np.mean(np.abs(z) <= 2.0)), float(np.mean(np.abs(z) > 3.0))
            rows.append(ResidualRow(name, float(np.sqrt(np.mean(z**2))), within, beyond, found.whiteness.p_value))
    return rows


def residual_figure(comparison: Comparison, name: str, theme: Theme, height: int = 240) -> Figure:
    """Histogram in sigma of the noise beside that of noise alone; autocorrelation with its bounds of 95 %."""
    found = comparison.axes[name]
    edges = np.arange(-_END, _END + 0.5 * _WIDTH, _WIDTH)
    middle = 0.5 * (edges[1:] + edges[:-1])
    z = scaled(found)
    counted = np.histogram(np.clip(z, -_END, _END - 1e-9), edges)[0] / max(len(z), 1) / _WIDTH
    normal = np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi)
    spacing = np.ceil(2.0 * HALF_WIDTH / comparison.flight.step) * comparison.flight.step
    correlation = found.whiteness.correlation
    lag = spacing * np.arange(1, len(correlation) + 1)
    bound = 1.96 / np.sqrt(max(found.whiteness.count, 1))
    ends = np.array([0.0, lag[-1] + 0.6 * spacing])
    bar = {"type": "bar", "marker": {"color": theme.residual}}
    data = [
        {**bar, "x": encoded(middle), "y": encoded(counted), "name": "residual", "width": 0.92 * _WIDTH},
        line(edges, normal, theme.predicted, "noise alone", width=1.6, hoverinfo="skip"),
        {
            **bar, "x": encoded(lag), "y": encoded(correlation), "name": "autocorrelation", "width": 0.3 * spacing,
            "xaxis": "x2", "yaxis": "y2",
        },
        *(
            line(ends, np.full(2, side * bound), theme.noise, "95 % of white noise", xaxis="x2", yaxis="y2", dash="dot",
                 hoverinfo="skip", showlegend=side > 0.0)
            for side in (-1.0, 1.0)
        ),
    ]  # fmt: skip
    top = float(max(0.3, 1.1 * bound, 1.1 * np.nanmax(np.abs(correlation), initial=0.0)))
    left, right = {"domain": [0.0, _HISTOGRAM]}, {"domain": [_HISTOGRAM + 0.2, 1.0], "anchor": "y2"}
    return figure(
        theme, data, height,
        xaxis=axis(theme, "residual [sigma of the noise]", range=[-_END, _END], fixedrange=True, **left),
        yaxis=axis(theme, "density [-]", fixedrange=True, nticks=4),
        xaxis2=axis(theme, "lag [s]", range=ends.tolist(), fixedrange=True, **right),
        yaxis2=axis(theme, "autocorrelation [-]", anchor="x2", range=[-top, top], fixedrange=True, nticks=4),
        margin={"l": 56, "r": 12, "t": 6, "b": 40},
        bargap=0,
    )  # fmt: skip
