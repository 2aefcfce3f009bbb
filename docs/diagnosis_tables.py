"""Tables of docs/diagnosis.md from the results of benchmarks/hidden_effects.py: header and rows by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Rows = tuple[list[str], list[list[str]]]
#: Sets of flights, and what stands in the tables for them.
SETS = {"tuned": "tuned on", "fresh": "fresh, flown once"}
_PARTS = {
    "relevant": "all", "relevant_textbook": "own simulator", "relevant_jsbsim": "JSBSim", "relevant_calm": "calm",
    "relevant_light": "light turbulence",
}  # fmt: skip


def percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def fine(share: float) -> str:
    return f"{100 * share:.1f} %"


def hidden(sets: dict[str, dict[str, Any]]) -> Rows:
    """How often the right effect was named, and what became of the error."""
    header = [
        "flights with a hidden effect", "number", "detected", "right first", "in first three",
        "right or confounded with it", "error: base", "diagnosed", "truth added", "floor", "within 10 % of truth",
    ]  # fmt: skip
    rows = []
    for name, found in sets.items():
        for key, words in _PARTS.items():
            r = found[key]
            if r["flights"]:
                shares = [percent(r[k]) for k in ("detected", "right_first", "in_first_three", "within_confounded")]
                errors = [fine(r[k]) for k in ("base", "diagnosed", "oracle", "floor")]
                row = [f"{SETS[name]}, {words}", str(r["flights"]), *shares, *errors]
                rows.append([*row, percent(r["within_ten_percent"])])
    return header, rows


def other(sets: dict[str, dict[str, Any]]) -> Rows:
    """Clean flights, small effects, and effects that were taken out of the library."""
    rows = []
    for name, found in sets.items():
        for words, r in {"all": found["false_verdicts"], **found["clean_by"]}.items():
            if r["flights"]:
                said = f"a verdict other than none in {percent(r['share'])}"
                rows.append([f"{SETS[name]}, clean, {words}", str(r["flights"]), said])
        r = found["small"]
        if r["flights"]:
            said = f"detected in {percent(r['detected'])}, right first in {percent(r['right_first'])}"
            rows.append([f"{SETS[name]}, effect too small to matter", str(r["flights"]), said])
        r = found["without"]
        if r["flights"]:
            said = (
                f"unexplained in the right axis {percent(r['unexplained_right_axis'])}, unexplained in another "
                f"{percent(r['unexplained'] - r['unexplained_right_axis'])}, another name {percent(r['wrong_name'])}, "
                f"none {percent(r['none'])}"
            )
            rows.append([f"{SETS[name]}, the effect taken out of the library", str(r["flights"]), said])
    return ["flights", "number", "what was said"], rows


def by_effect(sets: dict[str, dict[str, Any]]) -> Rows:
    """Each effect, over the flights that were flown last."""
    found = list(sets.values())[-1]
    rows = []
    for effect, r in found["by_effect"].items():
        if r["flights"]:
            shares = [percent(r[k]) for k in ("right_first", "in_first_three")]
            rows.append([effect, str(r["flights"]), *shares, *(fine(r[k]) for k in ("base", "diagnosed", "oracle"))])
    return ["effect", "flights", "right first", "in first three", "error: base", "diagnosed", "truth added"], rows


TABLES: dict[str, Callable[[dict[str, dict[str, Any]]], Rows]] = {
    "hidden_effects": hidden,
    "hidden_effects_other": other,
    "hidden_effects_by_effect": by_effect,
}
