"""Tables of docs/closed-loop.md from benchmarks/results/closed_loop.json."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from results import Rows

Result = dict[str, Any]

CONTROLLERS = ("fixed", "live", "truth")
WORDS = {
    "none": "no damage", "elevator": "elevator halved", "aileron": "aileron lost on one side",
    "cg_aft": "centre of gravity aft", "airspeed_blocked": "airspeed blocked", "alpha_vane_stuck": "α vane stuck",
    "gps_lost": "GPS lost", "imu_bias_jump": "IMU bias jumps",
}  # fmt: skip


def _degrees(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}°"


def tracking(result: Result) -> Rows:
    """Tracking error and lost flights."""
    rows = []
    for name, case in result["cases"].items():
        of = case["controllers"]
        errors = [_degrees(of[c]["after"]) for c in CONTROLLERS]
        lost = " / ".join(str(of[c]["lost"]) for c in CONTROLLERS)
        better = case.get("after", {})
        margin = "" if better.get("error") is None else f"{better['difference']:+.2f}° ± {better['error']:.2f}°"
        count = f"{better['live_better']} of {case['compared']}" if better else ""
        rows.append([WORDS[name], str(case["flights"]), *errors, margin, count, lost])
    header = ["from 30 s on", "flights", "fixed", "live", "truth", "live - fixed", "live better in",
              "lost: fixed / live / truth"]  # fmt: skip
    return header, rows


def late(result: Result) -> Rows:
    """The end of the flights, when what can be learnt has been."""
    rows = []
    for name, case in result["cases"].items():
        of, better = case["controllers"], case.get("late", {})
        margin = "" if better.get("error") is None else f"{better['difference']:+.2f}° ± {better['error']:.2f}°"
        count = f"{better['live_better']} of {case['compared']}" if better else ""
        before = " / ".join(_degrees(of[c]["before"]) for c in CONTROLLERS)
        rows.append([WORDS[name], before, *(_degrees(of[c]["late"]) for c in CONTROLLERS), margin, count])
    header = ["case", "5 to 30 s: fixed / live / truth", "last 15 s: fixed", "live", "truth", "live - fixed",
              "live better in"]  # fmt: skip
    return header, rows


def published(result: Result) -> Rows:
    """What was published."""
    rows = []
    for name, case in result["cases"].items():
        p = case["published"]
        share = "" if p["use_share_after"] is None else f"{100 * p['use_share_after']:.0f} %"
        again = f"{p['relearnt']} of {case['flights']}, median {p['relearnt_median']:.0f} s" if p["relearnt"] else ""
        wrong, names = sum(p["wrong"].values()), ", ".join(f"`{n}`" for n in list(p["wrong"])[:3])
        text = f"{wrong} ({100 * wrong / max(p['uses'], 1):.1f} %), first of them {names}" if wrong else "0"
        rows.append([WORDS[name], str(p["uses"]), str(p["out_of_bounds"]), text, share, again])
    header = ["case", "values with USE", "outside their bounds", "wrong by 3 standard errors and 25 %",
              "share with USE after 30 s", "what the damage changed most is USE and right again"]  # fmt: skip
    return header, rows


TABLES: dict[str, Callable[[Result], Rows]] = {"tracking": tracking, "late": late, "published": published}
