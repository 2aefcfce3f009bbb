"""What `check` and `diagnose` say of missions of JSBSim's aeroplanes: clean ones, and such in which something fails.

    python benchmarks/missions.py [--clean 60] [--failed 36] [--moved 18] [--first 10700001] [--jobs 2]
    python benchmarks/missions.py --aeroplanes strangers --first 9961000

The flights are those of jsbsim_missions.py, each with a layout of a log that is drawn; each is a line in
results/missions.jsonl. The user knows mass and shape. Seeds are drawn before and looked at once. Of aeroplanes that
are flown nowhere else, half of the flights have vanes; their results have a file of their own.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores; before numpy is loaded

from collections import Counter
from pathlib import Path
from typing import Any

import jsbsim_missions
import numpy as np
import resumed
from failure_flights import PART_OF, Layout

from aircraft_sysid_ros.aircraft.aerodynamic_model import textbook_model
from aircraft_sysid_ros.diagnosis.flight_answer import answer
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.finding import INFO
from aircraft_sysid_ros.flight_check.relation import LEAST_FOR_LAG
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.simulation.jsbsim_flight import MODELS

RESULTS = Path(__file__).parent / "results" / "missions.jsonl"
FIRST = 10_700_001
USUAL = "usual"
AEROPLANES = {USUAL: MODELS, "known": jsbsim_missions.KNOWN, "strangers": jsbsim_missions.STRANGERS}
#: Rates [Hz] of a logger: of the IMU, of the commands, and of airspeed, 0 where there is none.
IMU, COMMANDS, AIRSPEED = (10.0, 25.0, 50.0, 100.0), (2.5, 5.0, 10.0, 25.0, 50.0), (0.0, 5.0, 10.0, 20.0)
FAILURES = ("elevator", "aileron", "rudder", "engine", PART_OF + "elevator", PART_OF + "aileron")
#: What a test puts aside, or to its trim, in place of where it was.
MOVED = ("rudder", "aileron", "elevator")


def layout_of(seed: int, some_have_vanes: bool = False) -> Layout:
    """What a log holds, drawn; of four flights one has no airspeed."""
    rng = np.random.default_rng([seed, 62])
    imu = float(rng.choice(IMU))
    commands, airspeed = min(float(rng.choice(COMMANDS)), imu), float(rng.choice(AIRSPEED))
    vanes = some_have_vanes and airspeed > 0.0 and bool(rng.random() < 0.5)
    return Layout(imu, commands, airspeed, elevons=False, vanes=vanes)


def fly(job: dict[str, Any]) -> dict[str, Any]:
    """One flight and what is said of it."""
    aeroplanes = AEROPLANES[job.get("aeroplanes", USUAL)]
    layout = layout_of(job["seed"], "aeroplanes" in job)
    result = {**job, "imu": layout.imu, "commands": layout.controls, "airspeed": layout.airspeed}
    try:
        flight = jsbsim_missions.fly(job["seed"], layout, job["failure"], aeroplanes, moved="moved" in job)
        checked = check(flight_of(flight.samples, flight.samples.stamp), textbook_model())
        said = answer(flight.aircraft, flight.samples, calm_air=not layout.airspeed)
    except InputError as error:
        return {**result, "failed": str(error)}
    first = next((c for c in said["candidates"] if c["found"]), {})
    return {
        **result,
        "aeroplane": flight.aircraft.name,
        "lasts": float(np.ptp(flight.samples.stamp)) * 1e-9,
        "begin": flight.begin,
        "end": flight.end,
        "verdict": said["verdict"],
        "first": first.get("effect"),
        "input": first.get("input"),
        "times": first.get("inner"),
        "label": first.get("label"),
        "check": [
            [f.kind, f.signals[0], f.sentence] for f in checked.findings if f.severity != INFO and f.kind != "missing"
        ],
        "lags": [
            [r.first, r.evidence, r.comparison.lag, r.comparison.lag_std]
            for r in checked.relations
            if r.has_lag and r.comparison.is_sure and abs(r.comparison.correlation) > LEAST_FOR_LAG
        ],
    }


def jobs(clean: int, failed: int, first: int, aeroplanes: str = USUAL, moved: int = 0) -> list[dict[str, Any]]:
    """Clean flights, and flights in which the failures take turns."""
    flights: list[dict[str, Any]] = [{"seed": first + n, "failure": "none"} for n in range(clean)]
    flights += [{"seed": first + 50_000 + n, "failure": FAILURES[n % len(FAILURES)]} for n in range(failed)]
    flights += [{"seed": first + 80_000 + n, "failure": MOVED[n % len(MOVED)], "moved": True} for n in range(moved)]
    return flights if aeroplanes == USUAL else [{**job, "aeroplanes": aeroplanes} for job in flights]


def summary(results: list[dict[str, Any]]) -> str:
    """Counts; the table is in docs/diagnosis.md (docs/build.py)."""
    done = [r for r in results if "verdict" in r]
    clean = [r for r in done if r["failure"] == "none"]
    lines = [
        f"clean flights: {len(clean)}, given a verdict: {sum(r['verdict'] != 'none' for r in clean)}, "
        f"told of a fault by check: {sum(bool(r['check']) for r in clean)}"
    ]
    for failure, moved in (*((f, False) for f in FAILURES), *((f, True) for f in MOVED)):
        these = [r for r in done if r["failure"] == failure and ("moved" in r) == moved]
        said = Counter(str((r["verdict"], r["input"] or r["first"])) for r in these)
        lines.append(f"  {failure}{', moved' * moved}: {dict(said)}")
    return "\n".join([*lines, f"not diagnosed: {len(results) - len(done)}"])


def main() -> None:
    """Fly what is not flown yet, and count."""
    parser = resumed.options(__doc__, FIRST, clean=60, failed=36, moved=0)
    parser.add_argument("--aeroplanes", choices=list(AEROPLANES), default=USUAL)
    args = parser.parse_args()
    named = RESULTS if args.aeroplanes == USUAL else RESULTS.with_stem(f"missions_{args.aeroplanes}")
    wanted = jobs(args.clean, args.failed, args.first, args.aeroplanes, args.moved)
    print(summary(resumed.flown_aloud(fly, wanted, args.results or named, args.jobs, _says)))


def _says(result: dict[str, Any]) -> str:
    return f"{result['failure']} {result.get('verdict')} {result.get('input')}"


if __name__ == "__main__":
    main()
