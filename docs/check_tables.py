"""Tables of docs/check.md: faults that were put into clean flights and named, and clean flights with a finding."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from results import Rows


def injections(result: Mapping[str, Any]) -> Rows:
    """One row for each fault."""
    header = ["fault put in", "kind", "flights", "named", "other warnings and errors"]
    rows = [
        [name, f"`{r['kind']}`", str(r["flights"]), str(r["named"]), str(r["others"])]
        for name, r in result["injections"].items()
    ]
    total = [sum(r[key] for r in result["injections"].values()) for key in ("flights", "named", "others")]
    return header, [*rows, ["all", "", *(str(count) for count in total)]]


def clean(result: Mapping[str, Any]) -> Rows:
    """Clean flights by simulator."""
    header = ["clean flights", "flights", "with a warning or an error"]
    groups: dict[str, list[bool]] = {}
    for flight in result["clean"]:
        simulator = "textbook" if flight["aircraft"] == "textbook" else "JSBSim"
        groups.setdefault(simulator, []).append(bool(flight["found"]))
    return header, [[name, str(len(found)), str(sum(found))] for name, found in groups.items()]


def miswired(result: Mapping[str, Any]) -> Rows:
    """What is said within a minute of flight, and what has USE, with the check in flight and without it."""
    header = ["in the flight", "flights", "named", "flights with USE at 65 s", "without the check between sensors"]
    clean = result["clean"]

    def row(name: str, flights: list[dict[str, Any]], named: int) -> list[str]:
        counts = (len(flights), named, sum(f["use"] > 0 for f in flights), sum(f["use_without"] > 0 for f in flights))
        return [name, *map(str, counts)]

    rows = [row("nothing", clean, sum(bool(flight["named"]) for flight in clean))]
    rows += [row(name, flights, sum(f["right"] for f in flights)) for name, flights in result["faults"].items()]
    return header, rows


TABLES: dict[str, Callable[[Mapping[str, Any]], Rows]] = {"injections": injections, "clean": clean}
