"""The picture of an error that falls: the failing axis before and after, and the errors of all axes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.report.figures import MEASURED_COLOUR, PREDICTED_COLOUR
from aircraft_sysid_ros.report.pyplot import ABOVE, pyplot

_AFTER_COLOUR, _FLOOR_COLOUR = "#0072B2", "#009E73"
_SYMBOLS = {axis: f"$C_{{{axis[1]}}}$" for axis in AXES}
#: Flight [s] that is shown, where the first model fails most.
_SHOWN = 22.0


def story_figure(before: Comparison, after: Comparison, axis: str, path: str | Path, words: tuple[str, str]) -> Path:
    """Write measured and held-out predicted coefficients of one axis under two models, and all errors, to a PNG file.

    ``words``: titles of the two models. Lines have gaps where no point is judged, at the borders of held-out blocks.
    """
    plt = pyplot()

    figure = plt.figure(figsize=(13, 5.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(2.1, 1))
    above = figure.add_subplot(grid[0, 0])
    below = figure.add_subplot(grid[1, 0], sharex=above, sharey=above)
    shown = _window(before, axis)
    cases = ((above, before, PREDICTED_COLOUR, words[0]), (below, after, _AFTER_COLOUR, words[1]))
    for plot, comparison, colour, title in cases:
        _plot_model(plot, comparison, axis, colour)
        plot.set_title(f"{_SYMBOLS[axis]}, {title}", loc="left", fontsize=11)
    above.set_xlim(shown)
    above.tick_params(labelbottom=False)
    below.set_xlabel("time in flight [s]")
    _plot_errors(figure.add_subplot(grid[:, 1]), before, after)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return Path(path)


def _plot_model(plot: Any, comparison: Comparison, axis: str, colour: str) -> None:
    flight, fit = comparison.flight, comparison.axes[axis].fit
    measured = np.where(np.isfinite(fit.held_out), flight.coefficient(axis), np.nan)
    plot.plot(flight.time, measured, color=MEASURED_COLOUR, lw=2.4, label="measured")
    plot.plot(flight.time, measured - fit.held_out, color=colour, lw=1.2, label="predicted on held-out flight")
    plot.set_ylabel(f"{_SYMBOLS[axis]} [-]")
    plot.legend(fontsize=9, **ABOVE)
    plot.grid(alpha=0.3)


def _window(comparison: Comparison, axis: str) -> tuple[float, float]:
    """The stretch [s] with the largest held-out error."""
    flight, end = comparison.flight, float(comparison.flight.time[-1])
    squares = np.nan_to_num(comparison.axes[axis].fit.held_out) ** 2
    total = np.concatenate([[0.0], np.cumsum(squares)])
    last = np.searchsorted(flight.time, flight.time + _SHOWN)
    begin = max(min(float(flight.time[np.argmax(total[last] - total[:-1])]), end - _SHOWN), 0.0)
    return begin, min(begin + _SHOWN, end)


def _plot_errors(plot: Any, before: Comparison, after: Comparison) -> None:
    names = [name for name in AXES if name in before.axes and name in after.axes]
    at = np.arange(len(names))
    cases = ((-0.2, before, PREDICTED_COLOUR, "before"), (0.2, after, _AFTER_COLOUR, "after"))
    for shift, comparison, colour, label in cases:
        values = [100.0 * comparison.axes[name].fit.nrmse_held_out for name in names]
        plot.bar_label(plot.bar(at + shift, values, 0.38, color=colour, label=label), fmt="%.1f", fontsize=8)
    floors = [100.0 * after.axes[name].floor.nrmse for name in names]
    plot.hlines(floors, at - 0.45, at + 0.45, color=_FLOOR_COLOUR, lw=2.0, label="noise of the sensors")
    plot.set_xticks(at, [_SYMBOLS[name] for name in names])
    plot.set_ylabel("error on held-out flight [% of spread]")
    plot.set_title("all axes", loc="left", fontsize=11)
    plot.legend(fontsize=9)
    plot.grid(alpha=0.3, axis="y")
