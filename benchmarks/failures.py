"""How often a control that sticks, or an engine that fails, is found in flights without vanes; and false alarms.

    python benchmarks/failures.py [--clean 64] [--failed 48] [--again 16] [--first 9935000] [--jobs 2]

The flights are those of failure_flights.py; each is a line in results/failures.jsonl. Seeds are looked at once.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from pathlib import Path
from typing import Any

import failure_flights as flights
import numpy as np
from resumed import flown

from aircraft_sysid_ros.diagnosis.failures.failures import failures_of
from aircraft_sysid_ros.errors import InputError

RESULTS = Path(__file__).parent / "results" / "failures.jsonl"
FIRST = 9_935_000


def fly(job: dict[str, Any]) -> dict[str, Any]:
    """One flight and what is said of it."""
    layout, moved = flights.LAYOUTS[job["layout"]], job["where"] == "moved"
    times = {"moved": True, "lasting": job["lasting"], "every": job["every"]} if job["where"] == "again" else {}
    flight = flights.fly(job["seed"], layout, job["failure"], **(times or {"moved": moved}))
    try:
        report = failures_of(flight.aircraft, flight.samples)
    except InputError as error:
        return {**job, "failed": str(error)}
    found = [
        {"name": f.name, "kind": f.kind, "begin": f.begin, "end": f.end, "times": f.times, "evidence": f.evidence,
         "size": f.size, "left": f.left, "left_std": f.left_std, "level": f.level,
         "errors": [f.begin_error, f.end_error]}
        for f in report.found
    ]  # fmt: skip
    changed = report.changed and {
        "axes": sorted(report.changed.gains), "begin": report.changed.begin, "end": report.changed.end,
        "evidence": report.changed.evidence, "size": report.changed.size,
        "errors": [report.changed.begin_error, report.changed.end_error],
    }  # fmt: skip
    unexplained = report.unexplained and {"name": report.unexplained.name, "begin": report.unexplained.begin}
    stamps = flight.samples.stamp
    last = float(stamps.max() - stamps.min()) * 1e-9
    return {
        **job, "begin": flight.begin, "end": flight.end, "last": last, "share": flight.share, "found": found,
        "changed": changed, "unexplained": unexplained,
    }  # fmt: skip


def jobs(clean: int, failed: int, first: int) -> list[dict[str, Any]]:
    """Clean flights and flights in which something fails, of each layout in turn: held, moved, in part."""
    layouts = list(flights.LAYOUTS)
    listed = [{"seed": first + n, "layout": layouts[n % 4], "failure": "none", "where": "held"} for n in range(clean)]
    for n in range(failed):
        layout, where = layouts[n % 4], ("held", "moved", "part")[(n // 16) % 3]
        surfaces = ("elevon_left", "elevon_right") if flights.LAYOUTS[layout].elevons else ("elevator", "aileron")
        others = ("engine",) if flights.LAYOUTS[layout].elevons else ("engine", "rudder")
        kinds = tuple(flights.PART_OF + name for name in surfaces) if where == "part" else (*surfaces, *others)
        listed.append(
            {"seed": first + 50_000 + n, "layout": layout, "failure": kinds[(n // 4) % len(kinds)], "where": where}
        )
    return listed


def jobs_again(count: int, first: int) -> list[dict[str, Any]]:
    """Flights in which a control fails several times, as in a campaign of tests: put elsewhere, or in part."""
    layouts, listed = list(flights.LAYOUTS), []
    for n in range(count):
        rng, layout = np.random.default_rng(first + 80_000 + n), layouts[n % 4]
        surfaces = ("elevon_left", "elevon_right") if flights.LAYOUTS[layout].elevons else ("elevator", "aileron")
        lasting = float(rng.uniform(8.0, 14.0))
        failure = (flights.PART_OF if (n // 8) % 2 else "") + surfaces[(n // 4) % 2]
        every = lasting + float(rng.uniform(12.0, 18.0))
        listed.append(
            {"seed": first + 80_000 + n, "layout": layout, "failure": failure, "where": "again",
             "lasting": lasting, "every": every}
        )  # fmt: skip
    return listed


def summary(results: list[dict[str, Any]]) -> str:
    """Counts; the table by layout is in docs/diagnosis.md (docs/build.py)."""
    done = [r for r in results if "found" in r]
    clean = [r for r in done if r["failure"] == "none"]
    failed = [r for r in done if r["failure"] != "none"]
    clean_given, failed_given = (
        sum(bool(r["found"] or r["changed"] or r["unexplained"]) for r in some) for some in (clean, failed)
    )
    return (
        f"clean flights: {len(clean)}, given a verdict: {clean_given}; "
        f"with a failure: {len(failed)}, given one: {failed_given}"
    )


def main() -> None:
    """Fly what is not flown yet, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clean", type=int, default=64)
    parser.add_argument("--failed", type=int, default=48)
    parser.add_argument("--again", type=int, default=16, help="flights in which a control fails several times")
    parser.add_argument("--first", type=int, default=FIRST, help="first seed")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--results", type=Path, default=RESULTS)
    args = parser.parse_args()
    wanted = [*jobs(args.clean, args.failed, args.first), *jobs_again(args.again, args.first)]
    print(summary(list(flown(fly, wanted, args.results, args.jobs))))


if __name__ == "__main__":
    main()
