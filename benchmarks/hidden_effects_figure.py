"""The picture of docs/diagnosis.md: errors by effect, and how often the diagnosis was right, beside what was asked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

Lines = list[dict[str, Any]]

SETS = {"tuned": "tuned on", "fresh": "fresh, flown once"}
_COLOURS = {"base": "#D55E00", "diagnosed": "#0072B2", "oracle": "#009E73"}
_WORDS = {"base": "base model", "diagnosed": "with what was diagnosed", "oracle": "with the truth"}
_SET_COLOURS = {"tuned": "#999999", "fresh": "#0072B2"}
#: Key of the summary of a set, words, what was asked.
_RATES = (
    ("detected", "detected", 0.9),
    ("right_first", "right effect first", 0.9),
    ("in_first_three", "in the first three", 0.98),
    ("within_ten_percent", "error within 10 % of the truth's", None),
)


def draw(sets: dict[str, Lines], summaries: dict[str, dict[str, Any]], path: Path) -> None:
    """Flights with a relevant hidden effect of all sets."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    relevant = [x for lines in sets.values() for x in lines if x["effect"] and x.get("oracle_gain", 0.0) >= 0.2]
    effects = len({flight["effect"] for flight in relevant})
    figure, plots = plt.subplots(
        1, 2, figsize=(12, 2.0 + 0.22 * effects), width_ratios=(1.3, 1.0), layout="constrained"
    )
    _errors(plots[0], relevant)
    _rates(plots[1], summaries)
    figure.savefig(path, dpi=100, metadata={"Software": None})
    plt.close(figure)


def _errors(plot: Any, flights: Lines) -> None:
    by_effect: dict[str, Lines] = {}
    for flight in flights:
        by_effect.setdefault(flight["effect"], []).append(flight)

    def error(effect: str, kind: str) -> float:
        return 100.0 * float(np.median([f["errors"][kind][f["axis"]] for f in by_effect[effect]]))

    effects = sorted(by_effect, key=lambda effect: error(effect, "base"))
    rows = np.arange(len(effects))
    found = {kind: [error(effect, kind) for effect in effects] for kind in _COLOURS}
    floor = [100.0 * float(np.median([f["floor"].get(f["axis"], np.nan) for f in by_effect[e]])) for e in effects]
    plot.hlines(rows, found["diagnosed"], found["base"], color="0.8", lw=2)
    plot.plot(floor, rows, "|", color="0.4", ms=10, label="noise floor")
    for kind, marker in (("base", "o"), ("oracle", "D"), ("diagnosed", ".")):
        size = 8 if kind == "diagnosed" else 6
        plot.plot(found[kind], rows, marker, color=_COLOURS[kind], ms=size, label=_WORDS[kind])
    plot.set_xscale("log")
    ticks = [2, 5, 10, 20, 50]
    plot.set_xticks(ticks, [str(tick) for tick in ticks])
    plot.xaxis.minorticks_off()
    plot.set_yticks(rows, [f"{effect} ({len(by_effect[effect])})" for effect in effects], fontsize=8)
    plot.set_xlabel("held-out error of the main axis, NRMSE [%], median")
    plot.set_ylabel("hidden effect (flights of both sets)")
    plot.legend(fontsize=8, loc="lower left", bbox_to_anchor=(-0.1, 1.0), ncols=4)
    plot.grid(alpha=0.3)


def _rates(plot: Any, summaries: dict[str, dict[str, Any]]) -> None:
    labels = []
    for row, (key, words, asked) in enumerate(_RATES):
        labels.append(words)
        _goal(plot, row, asked)
        for name, summary in summaries.items():
            _bar(plot, row, name, summary["relevant"].get(key), summary["relevant"]["flights"])
    others = (
        ("taken out of the library:\nunexplained, right axis", "without", "unexplained_right_axis", 0.8),
        ("clean flights:\na false verdict", "false_verdicts", "share", 0.05),
    )
    for row, (words, part, key, asked) in enumerate(others, len(labels)):
        labels.append(words)
        _goal(plot, row, asked)
        for name, summary in summaries.items():
            _bar(plot, row, name, summary[part].get(key), summary[part]["flights"])
    plot.set_yticks(range(len(labels)), labels, fontsize=9)
    plot.invert_yaxis()
    plot.set_xlim(0.0, 132.0)
    plot.set_xticks(range(0, 101, 20))
    plot.set_xlabel("share of flights [%], with 95 % interval")
    handles, names = plot.get_legend_handles_labels()
    unique = dict(zip(names, handles, strict=True))
    plot.legend(unique.values(), unique.keys(), fontsize=8, loc="lower left", bbox_to_anchor=(-0.35, 1.0), ncols=3)
    plot.grid(alpha=0.3, axis="x")


def _goal(plot: Any, row: int, asked: float | None) -> None:
    if asked is not None:
        plot.vlines(100.0 * asked, row - 0.42, row + 0.42, color="#CC79A7", lw=2, label="asked")


def _bar(plot: Any, row: int, name: str, share: float | None, flights: int) -> None:
    if share is None or not flights:
        return
    at = row + 0.19 * (1 if name == "fresh" else -1)
    low, high = binomtest(round(share * flights), flights).proportion_ci(method="wilson")
    span = [[100.0 * max(share - low, 0.0)], [100.0 * max(high - share, 0.0)]]
    plot.barh(at, 100.0 * share, 0.34, color=_SET_COLOURS[name], label=SETS[name], alpha=0.8)
    plot.errorbar(100.0 * share, at, xerr=span, color="0.2", lw=1, capsize=2)
    plot.text(101.0, at, f"{100.0 * share:.0f} % of {flights}", va="center", fontsize=7)
