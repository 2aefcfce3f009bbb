"""Figures of comparisons: where a model fails, and what an addition changed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.report.figures import MEASURED_COLOUR, PREDICTED_COLOUR, RESIDUAL_COLOUR, apart
from aircraft_sysid_ros.report.pyplot import pyplot

_WORST_COLOUR = "#E69F00"
_FLOOR_COLOUR = "#009E73"
_SHOWN_FOLD = 0  # of the folds, the one that is shaded
_SYMBOLS = {axis: f"$C_{{{axis[1]}}}$" for axis in AXES}


def comparison_figure(comparison: Comparison, path: str | Path, title: str) -> Path:
    """Write measured and predicted coefficients with their held-out residuals, six axes, to a PNG file.

    One fold of the held-out blocks is shaded; worst places in time are marked on the residuals.
    """
    plt = pyplot()

    figure, plots = plt.subplots(6, 2, figsize=(14, 13), sharex=True, width_ratios=(3, 2), layout="constrained")
    flight, time = comparison.flight, _time_of(comparison)
    for (both, residual), name in zip(plots, AXES, strict=True):
        measured = flight.coefficient(name)
        both.plot(*apart(time, measured), color=MEASURED_COLOUR, lw=0.9, label="measured")
        both.set_ylabel(f"{_SYMBOLS[name]} [-]")
        if name in comparison.axes:
            _plot_axis(both, residual, comparison, name)
        else:
            residual.text(0.5, 0.5, comparison.reasons[name], ha="center", transform=residual.transAxes, fontsize=8)
        for plot in (both, residual):
            plot.grid(alpha=0.3)
            for begin, end in flight.held_out_spans(_SHOWN_FOLD):
                span = flight.begin + begin, min(flight.begin + end, time[-1])
                plot.axvspan(*span, color="#000000", alpha=0.05, lw=0)
    plots[0, 0].set_title("measured and predicted; shaded: blocks that are held out together", loc="left")
    plots[0, 0].legend(loc="upper right", ncols=2, fontsize=8)
    plots[0, 1].set_title("held-out residual, two sigma of noise (green), worse (orange)", loc="left", fontsize=10)
    for plot in plots[-1]:
        plot.set_xlabel("time since the filter started [s]")
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return Path(path)


def _time_of(comparison: Comparison) -> Any:
    """Time (n,) of the recording [s]."""
    return comparison.flight.time + comparison.flight.begin


def _plot_axis(both: Any, residual: Any, comparison: Comparison, name: str) -> None:
    axis, time = comparison.axes[name], _time_of(comparison)
    both.plot(*apart(time, axis.predicted), color=PREDICTED_COLOUR, lw=0.9, ls="--", label="predicted by the model")
    residual.plot(*apart(time, axis.fit.held_out), color=RESIDUAL_COLOUR, lw=0.7)
    for sign in (-2.0, 2.0):
        residual.plot(*apart(time, sign * axis.floor.std), color=_FLOOR_COLOUR, lw=0.7)
    for place in axis.places:
        if not place.is_cell:
            residual.axvspan(place.t_start, place.t_end, color=_WORST_COLOUR, alpha=0.35, lw=0)
    errors = f"held out {100 * axis.fit.nrmse_held_out:.1f} %, floor {100 * axis.floor.nrmse:.1f} % of its spread"
    residual.text(0.99, 0.97, errors, ha="right", va="top", transform=residual.transAxes, fontsize=9)


def errors_figure(axes: Mapping[str, Mapping[str, float]], path: str | Path, title: str) -> Path:
    """Write held-out errors before and after a change, with the noise floor, to a PNG file.

    ``axes``: error_before, error_after and noise_floor by axis, as NRMSE.
    """
    plt = pyplot()

    figure, plot = plt.subplots(figsize=(2.5 + 1.4 * len(axes), 4.2), layout="constrained")
    at = np.arange(len(axes))
    keys = (("error_before", "before", MEASURED_COLOUR), ("error_after", "after", PREDICTED_COLOUR))
    for shift, (key, label, colour) in zip((-0.2, 0.2), keys, strict=True):
        values = [100.0 * errors[key] for errors in axes.values()]
        bars = plot.bar(at + shift, values, 0.38, color=colour, label=label)
        plot.bar_label(bars, fmt="%.1f", fontsize=9)
    floors = [100.0 * errors["noise_floor"] for errors in axes.values()]
    if np.isfinite(floors).any():
        plot.hlines(floors, at - 0.45, at + 0.45, color=_FLOOR_COLOUR, lw=2.0, label="noise floor")
    plot.set_xticks(at, [_SYMBOLS[axis] for axis in axes])
    plot.set_ylabel("held-out error [% of spread]")
    plot.set_title(title, fontsize=10)
    plot.legend(fontsize=9)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return Path(path)
