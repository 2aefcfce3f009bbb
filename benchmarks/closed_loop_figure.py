"""The picture of docs/closed-loop.md: tracking errors of all cases, and one flight."""

from __future__ import annotations

from pathlib import Path
from typing import Any

Result = dict[str, Any]

CONTROLLERS = ("fixed", "live", "truth")
_COLOURS = {"fixed": "#D55E00", "live": "#0072B2", "truth": "#009E73"}


def draw(result: Result, path: Path) -> None:
    """Mean tracking errors of all cases, and one flight with an elevator that loses half of its effect."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(11, 8), layout="constrained")
    grid = figure.add_gridspec(3, 1, height_ratios=(1.1, 1.0, 0.8))
    _bars(figure.add_subplot(grid[0]), result)
    flight = figure.add_subplot(grid[1])
    _flight(flight, result["example"])
    _parameter(figure.add_subplot(grid[2], sharex=flight), result["example"])
    figure.savefig(path, dpi=100, metadata={"Software": None})
    plt.close(figure)


def _bars(plot: Any, result: Result) -> None:
    names = [name for name, case in result["cases"].items() if case["compared"]]
    for i, c in enumerate(CONTROLLERS):
        values = [result["cases"][name]["controllers"][c]["after"] for name in names]
        at = [k + 0.27 * (i - 1) for k in range(len(names))]
        plot.bar_label(plot.bar(at, values, 0.25, color=_COLOURS[c], label=c), fmt="%.1f", fontsize=8)
    plot.set_xticks(range(len(names)), [name.replace("_", "\n") for name in names], fontsize=9)
    plot.set_ylabel("tracking error, rms [deg]")
    plot.legend(fontsize=9, title="parameters")
    plot.margins(y=0.12)
    plot.grid(alpha=0.3, axis="y")


def _flight(plot: Any, example: Result) -> None:
    for c in CONTROLLERS:
        track = example["controllers"][c]
        error = [a - b for a, b in zip(track["pitch"], track["reference"], strict=True)]
        plot.plot(track["time"], error, color=_COLOURS[c], lw=1.1, label=c)
    plot.axvline(example["time_of_change"], color="0.5", ls="--", lw=1.0)
    plot.set_ylabel("pitch off its reference [deg]")
    plot.legend(fontsize=9, ncols=3)
    plot.grid(alpha=0.3)


def _parameter(plot: Any, example: Result) -> None:
    rows = example["published"]["Cm_de"]
    time, value = [r[0] for r in rows], [r[1] for r in rows]
    low, high = ([r[1] + sign * 2.0 * r[2] for r in rows] for sign in (-1.0, 1.0))
    plot.fill_between(time, low, high, color=_COLOURS["live"], alpha=0.2, label="± 2 standard errors")
    plot.plot(time, value, color="0.6", lw=1.0)
    used = [r for r in rows if r[3] == 0]
    plot.plot([r[0] for r in used], [r[1] for r in used], ".", color=_COLOURS["live"], label="USE")
    before, after = example["truth"]["Cm_de"]
    change = example["time_of_change"]
    known = ([0.0, change, change, time[-1]], [before, before, after, after])
    plot.plot(*known, color=_COLOURS["truth"], lw=1.2, label="truth")
    plot.axvline(change, color="0.5", ls="--", lw=1.0)
    plot.set_ylim(-1.3, 0.2)
    plot.set_ylabel("$C_{m,\\delta e}$ published [-]")
    plot.set_xlabel("time in flight [s]")
    plot.legend(fontsize=9)
    plot.grid(alpha=0.3)
