"""Pictures of a calibration: Tr R over the samples, as figures 2, 4 and 6 of the two-stage paper, and residuals."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from aircraft_sysid_ros.calibration.report import Report
from aircraft_sysid_ros.report.figures import MEASURED_COLOUR, PREDICTED_COLOUR, RESIDUAL_COLOUR
from aircraft_sysid_ros.report.picture import picture
from aircraft_sysid_ros.report.pyplot import pyplot


def draw_calibration(what: str, report: Report, folder: Path) -> tuple[list[str], list[str]]:
    """Write both pictures into a folder: names of those that are there, and why one is not."""
    drawn = {
        name: picture(partial(draw, report, folder / name))
        for name, draw in ((f"{what}-trace.png", trace_figure), (f"{what}-residuals.png", before_after_figure))
    }
    notes = [note for _, said in drawn.values() for note in said]
    return [name for name, (file, _) in drawn.items() if file], list(dict.fromkeys(notes))


def trace_figure(report: Report, path: str | Path) -> Path:
    """Write Tr R of every sample of stage 1 over each sampled parameter, and its estimate if any, to a PNG file."""
    plt = pyplot()

    answer = report.answer
    names2 = answer.problem.names2
    units = {str(p["name"]): p["unit"] for p in report.parameters}
    determined = answer.determined[answer.problem.n1 :]
    sampled = [k for k, name in enumerate(names2) if determined[k] or name in answer.refused]  # columns of xi2
    columns = min(len(sampled), 3)
    rows = -(-len(sampled) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(4.2 * columns, 3.0 * rows), sharey=True, layout="constrained", squeeze=False
    )
    trace = answer.samples.trace
    there = np.isfinite(trace)
    estimate = answer.xi[answer.problem.n1 :]
    for column, (number, plot) in enumerate(zip(sampled, axes.flat, strict=False)):
        plot.semilogy(answer.samples.xi2[there, column], trace[there], ".", ms=3, color=RESIDUAL_COLOUR)
        if determined[number]:
            plot.axvline(estimate[number], color=PREDICTED_COLOUR, lw=1.2, label="estimate")
        plot.set_xlabel(f"{names2[number]} [{units.get(names2[number]) or '-'}]")
        plot.grid(alpha=0.3)
    for plot in axes.flat[len(sampled) :]:
        plot.set_visible(False)
    for plot in axes[:, 0]:
        plot.set_ylabel("Tr R")
    for plot in [each for each in axes.flat if each.get_legend_handles_labels()[0]][:1]:
        plot.legend(loc="upper right", fontsize=8)
    figure.suptitle(f"{report.title}: {answer.decision.reason}", fontsize=10)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return Path(path)


def before_after_figure(report: Report, path: str | Path) -> Path:
    """Write the residuals of every output, uncalibrated and calibrated, over time to a PNG file."""
    plt = pyplot()

    count = len(report.outputs)
    figure, axes = plt.subplots(
        count, 1, figsize=(11, 1.9 * count + 1.0), sharex=True, layout="constrained", squeeze=False
    )
    for i, (name, plot) in enumerate(zip(report.outputs, axes[:, 0], strict=True)):
        plot.plot(report.time, report.before[:, i], ".", ms=1.5, color=MEASURED_COLOUR, label="uncalibrated")
        plot.plot(report.time, report.after[:, i], ".", ms=1.5, color=PREDICTED_COLOUR, label="calibrated")
        for segment in report.segments.found:
            begin = report.navigation.time[0]
            plot.axvspan(segment.begin - begin, segment.end - begin, color=RESIDUAL_COLOUR, alpha=0.07, lw=0)
        plot.set_ylabel(f"{name} [{report.unit}]" if count < 2 else name)
        plot.grid(alpha=0.3)
    axes[0, 0].legend(loc="upper right", ncols=2, fontsize=8, markerscale=6)
    axes[-1, 0].set_xlabel("time used [s]; shaded: circles and pushover-pullups")
    figure.suptitle(f"{report.title}: residuals [{report.unit}]")
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return Path(path)
