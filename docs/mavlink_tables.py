"""Tables of docs/mavlink.md from benchmarks/results/mavlink_bridge.json: header and rows of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from results import Rows

Result = dict[str, Any]


def identification(result: Result) -> Rows:
    """Differences of the parameters, in standard errors."""
    rows = [
        [name, str(d["pairs"]), f"{d['rms']:.2f}", f"{d['largest']:.2f}", f"{100 * d['within_1']:.0f} %"]
        for name, d in result["differences"].items()
    ]
    header = ["simulator, packets lost", "parameters with USE", "rms", "largest", "within one standard error"]
    return header, rows


def faults(result: Result) -> Rows:
    """What the bridge did."""
    garbage, restart = result["garbage"], result["restart"]
    rows = [
        [f"restart of the autopilot, {100 * result['loss']:.0f} % of the packets lost",
         f"{restart['silence']:.1f} s without samples, of which the autopilot is silent for 3 s"],
        [f"{garbage['seconds'] / 60:.0f} minutes of garbage ({garbage['megabytes']:.1f} MB)",
         f"memory grows by {garbage['memory_growth_kilobytes']:.0f} kB in the last half, "
         f"{100 * garbage['processor_share']:.1f} % of a core"],
        ["the 10 s of flight after it", f"{garbage['samples_after']} of 1000 IMU samples"],
    ]  # fmt: skip
    return ["fault", "the bridge"], rows


def vaneless(result: Result) -> Rows:
    """Parameters without vanes: how often usable, how much weaker."""
    part, flights = result["vaneless"], result["flights"]
    rows = [
        [f"`{name}`", f"{p['use']} of {flights}", f"{p['std_ratio']:.1f}", p["reason"]]
        for name, p in part["parameters"].items()
    ]
    errors = part["errors"]
    text = f"error {errors['rms']:.2f} standard errors rms, {errors['largest']:.1f} at most"
    rows.append(["all with USE", str(errors["pairs"]), "", text])
    return ["parameter", "USE", "standard error, over that with vanes", "reason in the last flight"], rows


TABLES: dict[str, Callable[[Result], Rows]] = {
    "identification": identification,
    "faults": faults,
    "vaneless": vaneless,
}
