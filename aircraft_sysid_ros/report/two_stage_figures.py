"""Figures of the two-stage estimator: Tr R over the samples of stage 1, as figures 2, 4 and 6 of its paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.two_stage.residual_sampling import ResidualSamples
from aircraft_sysid_ros.report.figures import MEASURED_COLOUR, PREDICTED_COLOUR, RESIDUAL_COLOUR
from aircraft_sysid_ros.report.pyplot import pyplot

Array = npt.NDArray[np.float64]


def trace_figure(
    samples: ResidualSamples,
    names2: tuple[str, ...],
    xi2: Array,
    path: str | Path,
    title: str,
    *,
    reason: str = "",
    truth: tuple[Array, float] | None = None,
) -> Path:
    """Write Tr R of the samples to a PNG file, with the final estimate xi2 (n2,).

    reason: of the decision; truth: xi2 and Tr R there, where they are known. One unknown: Tr R over it (figure 2).
    Two: the plane, coloured by Tr R (figure 4). More: Tr R over the distance from the final estimate, in half ranges
    of the samples (figure 6 has the norm of xi2, which adds radians to scales).
    """
    plt = pyplot()

    figure, plot = plt.subplots(figsize=(7.0, 4.6), layout="constrained")
    draw = (_line, _plane)[len(names2) - 1] if len(names2) < 3 else _distances
    draw(plot, samples, names2, xi2, truth)
    plot.grid(alpha=0.3)
    plot.legend(fontsize=8)
    plot.set_title(reason, fontsize=8, loc="left")
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return Path(path)


def _line(plot: Any, samples: ResidualSamples, names: tuple[str, ...], xi2: Array, truth: Any) -> None:
    order = np.argsort(samples.xi2[:, 0])
    plot.plot(samples.xi2[order, 0], samples.trace[order], "s-", ms=4, lw=0.9, color=RESIDUAL_COLOUR, label="samples")
    plot.axvline(xi2[0], color=PREDICTED_COLOUR, lw=1.0, ls="--", label="final estimate")
    if truth is not None:
        plot.plot(truth[0], [truth[1]], "o", color=MEASURED_COLOUR, label="truth")
    plot.set_xlabel(names[0])
    plot.set_ylabel("Tr R")


def _plane(plot: Any, samples: ResidualSamples, names: tuple[str, ...], xi2: Array, truth: Any) -> None:
    finite = np.isfinite(samples.trace)
    points, trace = samples.xi2[finite], samples.trace[finite]
    if len(points) > 3:
        plot.tricontour(*points.T, trace, levels=12, colors="0.7", linewidths=0.6)
    dots = plot.scatter(*points.T, c=trace, s=16, cmap="viridis")
    plot.figure.colorbar(dots, ax=plot, label="Tr R")
    plot.plot(*xi2, "x", color=PREDICTED_COLOUR, ms=9, mew=2.0, label="final estimate")
    if truth is not None:
        plot.plot(*truth[0], "o", color=MEASURED_COLOUR, mfc="none", label="truth")
    plot.set_xlabel(names[0])
    plot.set_ylabel(names[1])


def _distances(plot: Any, samples: ResidualSamples, names: tuple[str, ...], xi2: Array, truth: Any) -> None:
    distance = np.linalg.norm((samples.xi2 - xi2) / samples.spread, axis=1)
    plot.plot(distance, samples.trace, "x", ms=4, color=RESIDUAL_COLOUR, label="samples")
    if truth is not None:
        far = np.linalg.norm((truth[0] - xi2) / samples.spread)
        plot.plot([far], [truth[1]], "o", color=MEASURED_COLOUR, label="truth")
    plot.set_xlabel(f"distance of ({', '.join(names)}) from the final estimate [half ranges of the samples]")
    plot.set_ylabel("Tr R")
