"""Figures of a run, as PNG files: people look at pictures before tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.report.pyplot import ABOVE, pyplot
from aircraft_sysid_ros.run_reader import PARAMETERS, POINTS
from aircraft_sysid_ros.stretches import gaps

Array = npt.NDArray[np.float64]

# Okabe and Ito: told apart by the colour-blind.
MEASURED_COLOUR, PREDICTED_COLOUR, RESIDUAL_COLOUR = "#000000", "#D55E00", "#0072B2"
_AXIS_COLOURS = ("#E69F00", "#56B4E9", "#D55E00", "#0072B2", "#000000", "#CC79A7")
#: Units of the outputs of the aircraft model, by what they are of.
_UNITS = {
    "specific_force": "m/s²", "angular_rate": "rad/s", "position": "m", "velocity": "m/s", "attitude": "rad",
    "airspeed": "m/s", "angle_of_attack": "rad", "sideslip": "rad",
}  # fmt: skip
_SYMBOLS = {"CX": "$C_X$", "CY": "$C_Y$", "CZ": "$C_Z$", "Cl": "$C_l$", "Cm": "$C_m$", "Cn": "$C_n$"}


def load_points(run: str | Path) -> dict[str, Any]:
    """Points of a run with ``time`` [s] from its start, and ``fitted`` (n, 6).

    ``fitted`` are the coefficients by the final parameters. Raises InputError when the folder is not a run.
    """
    run = Path(run)
    try:
        with np.load(run / POINTS) as archive:
            points: dict[str, Any] = {name: archive[name] for name in archive.files}
        parameters = json.loads((run / PARAMETERS).read_text(encoding="utf8"))["parameters"]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{run} is not a run or is damaged ({error}): make it with replay or live") from None
    values = {p["name"]: p["value"] for p in parameters}
    points["time"] = (points["stamp"] - points["stamp"].min(initial=np.iinfo(np.int64).max)) * 1e-9
    names = [str(name) for name in points["parameter_names"]]
    fitted = np.full((len(points["stamp"]), len(AXES)), np.nan)
    for i, axis in enumerate(AXES):
        columns = [k for k, name in enumerate(names) if name.startswith(axis + "_")]
        theta = np.array([np.nan if values[names[k]] is None else values[names[k]] for k in columns])
        if columns:
            fitted[:, i] = points["terms"][:, columns] @ theta
    return {**points, "fitted": fitted}


def apart(time: Array, *values: Array) -> list[Array]:
    """Times (n,) [s] and values (n,), with NaN in each long gap, as between manoeuvres: no line crosses it."""
    at = gaps(time)
    return [np.insert(np.asarray(each, dtype=np.float64), at, np.nan) for each in (time, *values)]


def nrmse(measured: Array, predicted: Array) -> float:
    """Rms error over the standard deviation of the measured values; NaN without data."""
    both = np.isfinite(measured) & np.isfinite(predicted)
    if both.sum() < 2:
        return float("nan")
    return float(np.sqrt(np.mean((measured[both] - predicted[both]) ** 2)) / np.std(measured[both]))


def coefficients_figure(run: str | Path, path: str | Path, title: str) -> Path:
    """Write measured against predicted coefficients, six axes with their residuals, to a PNG file."""
    plt = pyplot()

    points = load_points(run)
    figure, axes = plt.subplots(6, 2, figsize=(14, 13), sharex=True, width_ratios=(3, 2), layout="constrained")
    for i, axis in enumerate(AXES):
        measured, fitted = points["measured"][:, i], points["fitted"][:, i]
        both, residual = axes[i]
        error = nrmse(measured, fitted)
        time, measured, fitted = apart(points["time"], measured, fitted)
        both.plot(time, measured, color=MEASURED_COLOUR, lw=0.9, label="measured")
        both.plot(time, fitted, color=PREDICTED_COLOUR, lw=0.9, ls="--", label="predicted by the model")
        residual.plot(time, measured - fitted, color=RESIDUAL_COLOUR, lw=0.7)
        both.set_ylabel(f"{_SYMBOLS[axis]} [-]")
        residual.set_ylim(both.get_ylim() - np.mean(both.get_ylim()))
        text = "not estimated" if np.isnan(error) else f"rms error {100 * error:.1f} % of its spread"
        residual.set_title(text, fontsize=9, loc="right")
        for plot in (both, residual):
            plot.grid(alpha=0.3)
    axes[0, 0].set_title("measured and predicted", loc="left")
    axes[0, 1].set_title("residual, same scale", loc="left")
    axes[0, 0].legend(fontsize=8, **ABOVE)
    for plot in axes[-1]:
        plot.set_xlabel("time in flight [s]")
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return Path(path)


def learning_figure(run: str | Path, path: str | Path, title: str, window: float = 5.0) -> Path:
    """Write how the prediction error falls while the parameters are learnt, to a PNG file.

    Every sample is predicted by the parameters from before it was seen. The error of each axis is the rms
    over ``window`` [s], over the standard deviation of the coefficient in the whole flight.
    """
    plt = pyplot()

    points = load_points(run)
    figure, (above, below) = plt.subplots(2, 1, figsize=(11, 6.5), sharex=True, layout="constrained")
    pitch = AXES.index("Cm")
    time, measured, predicted = apart(points["time"], points["measured"][:, pitch], points["predicted"][:, pitch])
    above.plot(time, measured, color=MEASURED_COLOUR, lw=0.9, label="measured")
    above.plot(
        time, predicted, color=PREDICTED_COLOUR, lw=0.9, ls="--",
        label="predicted, before the sample was learnt from",
    )  # fmt: skip
    above.set_ylabel(f"{_SYMBOLS['Cm']} [-]")
    above.legend(loc="upper right", ncols=2, fontsize=9)
    for i, axis in enumerate(AXES):
        time, error = apart(*_sliding_error(points, i, window))
        below.semilogy(time, 100.0 * error, lw=1.5, color=_AXIS_COLOURS[i], label=_SYMBOLS[axis])
    below.set_ylabel("prediction error [% of spread]")
    below.set_xlabel("time in flight [s]")
    below.legend(loc="upper right", ncols=6, fontsize=9)
    for plot in (above, below):
        plot.grid(alpha=0.3)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return Path(path)


def _sliding_error(points: dict[str, Any], axis: int, window: float) -> tuple[Array, Array]:
    """Ends [s] of windows and the rms error within them, over the spread of the whole flight."""
    valid = points["valid"][:, axis]
    time = points["time"][valid]
    error = (points["measured"] - points["predicted"])[valid, axis]
    if len(time) < 2:
        return np.empty(0), np.empty(0)
    total = np.concatenate([[0.0], np.cumsum(error**2)])
    first = np.searchsorted(time, time - window)
    count = np.arange(1, len(time) + 1) - first
    rms = np.sqrt((total[1:] - total[first]) / count)
    return time, rms / np.std(points["measured"][valid, axis])


def outputs_figure(time: Array, measured: Array, modelled: Array, path: str | Path, title: str) -> Path:
    """Write measured outputs (n, 18) of (6.3) against those of the refined model over time [s] to a PNG file.

    Where nothing was fitted the model is NaN and leaves a gap; outputs that were never measured are left out.
    """
    plt = pyplot()

    from aircraft_sysid_ros.flight_model.layout import GROUP_OF_OUTPUT, OUTPUT_GROUPS, OUTPUT_NAMES

    units = [_UNITS[OUTPUT_GROUPS[group]] for group in GROUP_OF_OUTPUT]
    shown = [i for i in range(len(OUTPUT_NAMES)) if np.any(np.isfinite(measured[:, i]))]
    rows = (len(shown) + 2) // 3
    figure, axes = plt.subplots(rows, 3, figsize=(16, 2.1 * rows), sharex=True, layout="constrained", squeeze=False)
    for i, plot in zip(shown, axes.flat, strict=False):
        there, fitted = np.isfinite(measured[:, i]), np.isfinite(modelled[:, i])
        plot.plot(time[there], measured[there, i], color=MEASURED_COLOUR, lw=0, marker=".", ms=1.5, label="measured")
        parts = np.split(np.flatnonzero(fitted), np.flatnonzero(np.diff(time[fitted]) > 1.0) + 1)
        for k, part in enumerate(parts):
            label = "model" if k == 0 else None
            plot.plot(time[part], modelled[part, i], color=PREDICTED_COLOUR, lw=0.9, label=label)
        plot.set_title(f"{OUTPUT_NAMES[i]} [{units[i]}]", fontsize=9, loc="left")
        plot.grid(alpha=0.3)
    axes[0, 0].legend(loc="upper right", fontsize=8)
    for plot in axes[-1]:
        plot.set_xlabel("time in flight [s]")
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return Path(path)
