"""Figures of the certificate, as SVG files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from accuracy import MAIN_DERIVATIVES
from certificate_flights import CLOSE, PATH_STEP, REMAINING, Record, first_moves, the_aircraft
from certificate_summary import select

# Okabe and Ito: told apart by the colour-blind.
COLOURS = {
    "rls": "#0072B2", "fourier": "#E69F00", "rml": "#D55E00", "output-error": "#56B4E9", "filter-error": "#009E73",
}  # fmt: skip
AIR_TITLES = {"none": "calm air", "light": "light turbulence"}


def draw(summary: dict[str, Any], records: dict[str, list[Record]], folder: Path) -> None:
    """Write certificate_*.svg; the same numbers give the same bytes."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update({"svg.hashsalt": "certificate", "font.size": 9, "axes.grid": True, "grid.alpha": 0.3})
    folder.mkdir(parents=True, exist_ok=True)
    if summary["methods"]:
        _save(_coverage(summary), folder / "certificate_coverage.svg")
        _save(_bias(summary), folder / "certificate_bias.svg")
    if any("path" in r for r in records["flights"]):
        _save(_convergence(records["flights"]), folder / "certificate_convergence.svg")
    if any("path" in r for r in records["loss"]):
        _save(_loss(records["loss"]), folder / "certificate_loss.svg")


def _save(figure: Any, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def _axes(rows: int, columns: int, size: tuple[float, float], **more: Any) -> Any:
    import matplotlib.pyplot as plt

    return plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False, **more)


def _coverage(summary: dict[str, Any]) -> Any:
    """Coverage with two standard errors, excited parameters and those marked USE."""
    figure, grid = _axes(1, 2, (8.0, 3.0), sharey=True)
    for axis, air in zip(grid[0], AIR_TITLES, strict=True):
        bars = []
        if air in summary["corrections"]:
            bars.append(("rls, white", summary["corrections"][air]["white"], None, "#999999"))
        for method, airs in summary["methods"].items():
            if air in airs:
                bars.append((method, airs[air]["excited"], airs[air]["use"], COLOURS[method]))
        for i, (_, excited, use, colour) in enumerate(bars):
            axis.errorbar(
                i, 100 * excited["share"], 200 * excited["error"], fmt="o", color=colour, capsize=3,
                label="excited" if i == 1 else None,
            )  # fmt: skip
            if use is not None and use["share"] is not None:
                axis.errorbar(
                    i + 0.2, 100 * use["share"], 200 * use["error"], fmt="s", mfc="white", color=colour, capsize=3,
                    label="marked USE" if i == 1 else None,
                )  # fmt: skip
        axis.axhline(95.0, color="black", lw=0.8, ls="--")
        axis.set_xticks(range(len(bars)), [bar[0] for bar in bars], rotation=25, ha="right")
        axis.set_title(AIR_TITLES[air])
    grid[0][0].set_ylabel("95 % intervals that hold the truth [%]")
    grid[0][0].legend(loc="lower right", fontsize=7)
    return figure


def _bias(summary: dict[str, Any]) -> Any:
    """Bias of the main derivatives with its 95 % Monte Carlo interval."""
    figure, grid = _axes(2, 1, (8.0, 5.4), sharex=True)
    for axis, air in zip(grid[:, 0], AIR_TITLES, strict=True):
        methods = [m for m in summary["methods"] if air in summary["methods"][m]]
        for i, method in enumerate(methods):
            bias = summary["methods"][method][air]["bias"]
            there = [k for k, name in enumerate(MAIN_DERIVATIVES) if bias[name]["mean"] is not None]
            mean, error = (np.array([100 * bias[MAIN_DERIVATIVES[k]][key] for k in there]) for key in ("mean", "error"))
            at = np.array(there) + 0.14 * (i - 0.5 * (len(methods) - 1))
            axis.errorbar(at, mean, 1.96 * error, fmt="o", ms=3, color=COLOURS[method], capsize=1.5, label=method)
        axis.axhline(0.0, color="black", lw=0.8)
        axis.set_yscale("symlog", linthresh=1.0)
        ticks = (-10, -1, 0, 1, 10)
        axis.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.set_ylabel("bias [% of the truth]")
        axis.set_title(AIR_TITLES[air])
    grid[1, 0].set_xticks(range(len(MAIN_DERIVATIVES)), MAIN_DERIVATIVES, rotation=40, ha="right")
    grid[0, 0].legend(ncols=5, fontsize=7)
    return figure


def _convergence(records: list[Record]) -> Any:
    """Median and 5 to 95 % of the flights over time, over the truth."""
    names = ("Cm_alpha", "Cm_de", "Cl_p", "Cn_beta")
    figure, grid = _axes(len(names), 2, (8.0, 8.0), sharex=True, sharey="row")
    for row, name in zip(grid, names, strict=True):
        for axis, air in zip(row, AIR_TITLES, strict=True):
            for method in ("rls", "fourier", "rml"):
                paths = [r["path"][name] for r in select(records, method, air) if "path" in r]
                if not paths:
                    continue
                values = np.array(paths, dtype=float) / the_aircraft().coefficients[name]
                time = PATH_STEP * np.arange(1, values.shape[1] + 1)
                seen = np.mean(np.isfinite(values), axis=0) >= 0.5
                low, middle, high = np.nanpercentile(values[:, seen], [5, 50, 95], axis=0)
                axis.fill_between(time[seen], low, high, color=COLOURS[method], alpha=0.2, lw=0)
                axis.plot(time[seen], middle, color=COLOURS[method], lw=1.2, label=method)
            axis.axhspan(1 - CLOSE, 1 + CLOSE, color="black", alpha=0.06, lw=0)
            axis.axvline(first_moves()[name], color="black", lw=0.8, ls=":")
            axis.set_ylim(0.7, 1.3)
        row[0].set_ylabel(f"{name} over the truth")
    for axis, title in zip(grid[0], AIR_TITLES.values(), strict=True):
        axis.set_title(title)
    for axis in grid[-1]:
        axis.set_xlabel("time [s]")
    grid[0, 1].legend(fontsize=7)
    return figure


def _loss(records: list[Record]) -> Any:
    """C_m,de after the loss, over its old value: median of the flights."""
    figure, grid = _axes(1, 2, (8.0, 3.2), sharey=True)
    styles = {"": "-", "+keep": "--", "+reset": ":"}
    grid_time = np.arange(-10.0, 40.0, 0.5)
    for axis, air in zip(grid[0], AIR_TITLES, strict=True):
        for method in dict.fromkeys(r["method"] for r in records):
            estimator = method.split("+")[0]
            paths = [(r["at"], r["path"]) for r in select(records, method, air) if "path" in r]
            if not paths:
                continue
            values = np.array([_since(at, np.array(path, dtype=float), grid_time) for at, path in paths])
            seen = np.mean(np.isfinite(values), axis=0) >= 0.5
            axis.plot(
                grid_time[seen], np.nanmedian(values[:, seen], axis=0), color=COLOURS[estimator],
                ls=styles[method[len(estimator) :]], lw=1.2, label=method,
            )  # fmt: skip
        axis.axhspan(REMAINING * (1 - CLOSE), REMAINING * (1 + CLOSE), color="black", alpha=0.1, lw=0)
        axis.set_title(AIR_TITLES[air])
        axis.set_xlabel("time after the loss [s]")
        axis.set_ylim(-0.5, 1.5)
    grid[0][0].set_ylabel("Cm_de over its old truth")
    grid[0][0].legend(fontsize=6, ncols=2)
    return figure


def _since(at: float, path: np.ndarray[Any, Any], grid: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    time = PATH_STEP * np.arange(1, len(path) + 1) - at
    return np.interp(grid, time, path / the_aircraft().coefficients["Cm_de"], left=np.nan, right=np.nan)
