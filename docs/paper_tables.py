"""Tables of docs/paper.md from benchmarks/results/paper.json, with equations of the two-stage paper."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from results import Rows

Result = dict[str, Any]

TITLES = {"example_1": "1", "example_2": "2"}
METHODS = {"truth": "optimiser started at the truth"}


def percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f} %"


def correct(result: Result) -> Rows:
    """Tables 1 and 3."""
    rows = []
    for key, title in TITLES.items():
        one, new = result[key]["one_record"]["methods"], result[key]["new_noise"]["methods"]
        for method in one:
            published = result[key]["published"]["correct"].get(method)
            rows.append(
                [title, METHODS.get(method, method), percent(published), percent(one[method]["correct"]),
                 percent(new[method]["correct"]), percent(new[method]["right_minimum"]),
                 percent(new[method]["same_outputs"])]
            )  # fmt: skip
    header = ["example", "method", "correct, paper", "correct, one record", "correct, new noise",
              "at the right minimum, new noise", "with its outputs"]  # fmt: skip
    return header, rows


def estimates(result: Result) -> Rows:
    """Tables 2 and 4; the spread of the runs with new noise is scaled from their noise to that of the record."""
    rows = []
    for key, title in TITLES.items():
        told, published = result[key]["estimate"], result[key]["published"]["estimate"]
        scale = (told["parameters"]["R"]["value"] / told["noise_variance"]) ** 0.5
        for name, p in told["parameters"].items():
            value, std = published[name]
            spread = result[key]["new_noise"]["spread"].get(name)
            rows.append(
                [title, name, f"{p['truth']:.4g}", f"{value:.4f}" + ("" if std is None else f" ± {std:.4f}"),
                 f"{p['value']:.4f} ± {p['std']:.4f}", "" if std is None else f"{p['std'] / std:.2f}",
                 "" if spread is None else f"{scale * spread:.4f}"]
            )  # fmt: skip
    header = ["example", "parameter", "truth (of our record)", "paper", "ours", "our standard error over the paper's",
              "spread of the runs"]  # fmt: skip
    return header, rows


def bound(result: Result) -> Rows:
    """The cost of stage 1 and its bound."""
    rows = []
    for key, title in TITLES.items():
        b = result[key]["estimate"]["bound"]
        rows.append([title, *(f"{b[name]:.3g}" for name in ("stage_1", "optimum", "lower", "error", "error_bound")),
                     f"{b['lower_by_constants']:.3g}"])  # fmt: skip
    header = ["example", "cost of the best sample", "least cost", "bound from E", "E", "bound of E, (13)",
              "bound from (13)"]  # fmt: skip
    return header, rows


TABLES: dict[str, Callable[[Result], Rows]] = {"correct": correct, "estimates": estimates, "bound": bound}
