"""Tables of docs/polar.md: polars against a known one, and those of a real flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from results import Rows


def truth(flights: Sequence[Mapping[str, Any]]) -> Rows:
    """Errors of each number, and how often its standard error holds the truth."""
    flown = [flight for flight in flights if "failed" not in flight]
    header = ["of", "flights", "relative error, median", "worst", "with USE", "worst with USE", "inside of 95 %"]
    rows = []
    for name, words in (("efficiency", "efficiency"), ("CD0", "C_D0"), ("k", "k")):
        found = [(*flight["parameters"][name], flight[name]) for flight in flown if name in flight["parameters"]]
        rows.append(_row(words, [(value, std, true, status) for value, std, status, true in found]))
    rows.append(_row("C_D in the middle of the lift that was flown", [(*f["middle"], "") for f in flown]))
    if len(flown) < len(flights):
        rows.append(["not flown to the end", str(len(flights) - len(flown)), *[""] * 5])
    return header, rows


def _row(words: str, found: Sequence[tuple[float, float, float, str]]) -> list[str]:
    value, std, true = (np.array([each[i] for each in found], float) for i in range(3))
    errors, used = np.abs(value / true - 1.0), np.array([each[3] == "USE" for each in found])
    inside = int(np.sum(np.abs(value - true) < 1.96 * std))
    with_use = [str(int(used.sum())), _percent(errors[used].max()) if used.any() else ""] if found[0][3] else ["", ""]
    return [words, str(len(found)), _percent(np.median(errors)), _percent(errors.max()), *with_use,
            f"{inside} of {len(found)}"]  # fmt: skip


def seaway(parts: Mapping[str, Mapping[str, Any]]) -> Rows:
    """The real flight, whole and in halves."""
    header = ["Solar Surfer", "flight", "explained", "efficiency", "C_D0", "k", "power of level flight at 10 m/s"]
    words = {"whole": "whole", "first": "first half", "second": "second half"}
    rows = []
    for part, said in parts.items():
        level = said["level"]
        power, std = (float(np.interp(10.0, level["airspeed"], level[key])) for key in ("power", "std"))
        numbers = [f"{p['value']:.3f} ± {p['std']:.3f} ({p['status']})" for p in said["parameters"]]
        rows.append([words[part], f"{said['time']:.0f} s", _percent(said["explained"], 0), *numbers,
                     f"{power:.0f} ± {std:.0f} W"])  # fmt: skip
    return header, rows


def _percent(share: float, digits: int = 1) -> str:
    return f"{100.0 * share:.{digits}f} %"
