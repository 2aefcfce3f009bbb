"""Tables of docs/fleet.md: changes between flights that were named, and a simulated fleet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Table = tuple[list[str], list[list[str]]]


def healthy(result: Mapping[str, Any]) -> Table:
    """False alarms."""
    header = ["flights of each airframe", "healthy fleets", "parameters in all", "changes named", "fleets with one"]
    keys = ("flights", "fleets", "series", "named", "fleets_with_alarm")
    return header, [[str(row[key]) for key in keys] for row in result["healthy"]]


def changed(result: Mapping[str, Any]) -> Table:
    """Drifts and jumps that were there."""
    header = ["flights", "size", "false of all named"]
    header += ["drifts named", "as drift", "rate inside 95 %", "jumps named", "as jump", "size inside 95 %"]
    header += ["date within one flight"]
    rows = []
    for row in result["changed"]:
        drift, jump = row["drift"], row["jump"]
        rows.append([
            str(row["flights"]), f"{row['size']:g}", f"{row['false']} of {row['named']}", *_shares(drift),
            *_shares(jump), _share(jump["date"], jump["kind"]),
        ])  # fmt: skip
    return header, rows


def _shares(one: Mapping[str, int]) -> list[str]:
    named = _share(one["named"], one["there"])
    return [named, _share(one["kind"], one["named"]), _share(one["inside"], one["kind"])]


def _share(count: int, of: int) -> str:
    return f"{100.0 * count / of:.0f} %" if of else "–"


def small(result: Mapping[str, Any]) -> Table:
    """What was hidden in the simulated fleet, and what was named."""
    rows = []
    for row in result["truth"]:
        since = f" from {row['airframe']}/{row['flight']:03d}" if row["kind"] == "jump" else " per flight"
        found = row["found"]
        said = "not named"
        if found:
            where = f" from {found['flight']}" if found["kind"] == "jump" else " per flight"
            said = f"{found['kind']} {found['size']:+.4f} ± {1.96 * found['std']:.4f}{where}"
        rows.append([row["airframe"], row["parameter"], f"{row['kind']} {row['size']:+.4f}{since}", said])
    others = ", ".join(f"{c['airframe']} {c['parameter']}" for c in result["other_changes"]) or "none"
    rows.append(["all", "changes named that are none", "", others])
    rows.append(["damaged", "files named, of those that are damaged or hang", str(result["damaged"]),
                 str(result["damaged_named"])])  # fmt: skip
    each = result["cpu_per_flight"]
    hours = f"{each * 1e6 / 3600.0:,.0f}".replace(",", " ")
    rows += [
        ["each flight", "processor time, bytes of its answer", f"{each:.1f} s", f"{result['bytes_per_answer']:.0f}"],
        ["a million", "core hours, of answers", hours, f"{result['bytes_per_answer'] / 1e3:.1f} GB"],
    ]
    return ["airframe", "parameter", "truth", "named, with 95 % interval"], rows


def costs(result: Mapping[str, Any]) -> Table:
    """What a fleet costs."""
    one, two, count = result["workers_1"], result["workers_2"], result["flights"]
    ahead = one["flights_cpu"] / result["plain_cpu"] - 1.0
    rows = [
        ["scheduler, client and worker, for each flight", f"{1000.0 * result['own']:.0f} ms"],
        [f"{count} flights one after the other in one process", f"{result['plain_cpu']:.1f} s"],
        ["the same in a fleet, in the processes of the flights", f"{one['flights_cpu']:.1f} s ({100 * ahead:+.1f} %)"],
        ["the same, wall-clock time with one worker and with two", f"{one['wall']:.0f} s, {two['wall']:.0f} s"],
        ["load of the machine's two cores before", f"{result['load']:.1f}"],
    ]
    return ["measured", ""], rows
