"""Missing effects as the live node would have named them: false verdicts on clean flights, and hidden effects.

    python benchmarks/live_diagnosis.py [--seeds 25] [--out benchmarks/results/live_diagnosis.json]

Flights of 180 s of simulation.hidden_flight, calm and in light turbulence, looked at every 30 s from 90 s on with what
the node keeps of them and the filter's states, not smoothed. A clean flight counts as false when any look gives a
verdict. The limits of the search in flight were chosen with seeds 100 to 224 in sight: the flights here are others.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.diagnosis.live.search_in_flight import FORCES, diagnose_live, windows
from aircraft_sysid_ros.effects import LIBRARY
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.flight_memory import SampleMemory
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import D_ACCELEROMETER_BIAS, StateField
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, hidden_flight

FIRST_SEED = 400
LOOKS = (90.0, 120.0, 150.0, 180.0)
TURBULENCE = ("none", "light")
BIAS = StateField.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS
Case = tuple[str, str | None, int, str]


def looks(flight: SimulatedFlight) -> Iterator[tuple[float, SampleMemory]]:
    """What is kept of a flight at the time of each look."""
    pipeline, memory = Pipeline(flight.aircraft), SampleMemory()
    rows, points = (np.vstack(parts) for parts in zip(pipeline.push(flight.samples), pipeline.flush(), strict=True))
    at = np.clip(np.searchsorted(rows[:, StateField.TIME], points[:, 0]), 0, len(rows) - 1)
    done = 0
    for look in LOOKS:
        while done < len(points) and points[done, 0] - points[0, 0] <= look:
            row = rows[at[done]]
            memory.add(points[done : done + 1], row[BIAS : BIAS + 3], float(row[StateField.AIR_VELOCITY_STD]))
            done += 1
        yield look, memory


def run(case: Case) -> dict[str, Any]:
    """The verdicts of all looks at one flight."""
    simulator, effect, seed, turbulence = case
    about = {"simulator": simulator, "effect": effect, "seed": seed, "turbulence": turbulence}
    try:
        flight = hidden_flight(simulator, effect, 1.0, seed, turbulence)
    except InputError as error:
        return {**about, "refused": str(error)}
    said = []
    for look, memory in looks(flight):
        flights = windows(flight.aircraft, memory, ParameterOptions().step)
        began = time.process_time()
        found = diagnose_live(flights) if flights else None
        spent = time.process_time() - began
        if found is not None:
            named = [f.trial.candidate.family for f in found.findings]
            said.append({"at": look, "verdict": found.verdict, "named": named, "processor_time": spent})
    return {**about, "manoeuvres": flight.manoeuvres, "looks": said}


def cases(seeds: int) -> list[Case]:
    """Clean flights of both simulators, and each effect that is judged in flight once in either air."""
    clean = [("textbook", None, FIRST_SEED + i, air) for i in range(seeds) for air in TURBULENCE]
    clean += [("c172p", None, FIRST_SEED + i, air) for i in range(seeds // 5) for air in TURBULENCE]
    judged = [e.identifier for e in LIBRARY if e.kind != MEASUREMENT and not e.signals & FORCES]
    hidden = [("textbook", name, FIRST_SEED + i, air) for i, name in enumerate(judged) for air in TURBULENCE]
    return [*clean, *hidden]


def summary(results: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares of flights."""
    flown = [r for r in results if r.get("looks")]
    out: dict[str, Any] = {"refused": len(results) - len(flown)}
    for simulator in sorted({r["simulator"] for r in flown}):
        for air in TURBULENCE:
            group = [r for r in flown if (r["simulator"], r["turbulence"], r["effect"]) == (simulator, air, None)]
            false = [r for r in group if any(look["verdict"] != "none" for look in r["looks"])]
            single = sum(look["verdict"] != "none" for r in group for look in r["looks"])
            out[f"clean, {simulator}, {air}"] = {
                "flights": len(group), "false": len(false), "looks": sum(len(r["looks"]) for r in group),
                "false looks": single,
            }  # fmt: skip
    for air in TURBULENCE:
        group = [r for r in flown if r["effect"] and r["turbulence"] == air]
        last = [r["looks"][-1] for r in group]
        out[f"hidden, {air}"] = {
            "flights": len(group),
            "verdict": sum(look["verdict"] != "none" for look in last),
            "right first": sum(r["effect"] in look["named"][:1] for r, look in zip(group, last, strict=True)),
            "right in three": sum(r["effect"] in look["named"][:3] for r, look in zip(group, last, strict=True)),
        }
    spent = [look["processor_time"] for r in flown for look in r["looks"]]
    out["processor time of a look [s]"] = {"mean": float(np.mean(spent)), "longest": float(np.max(spent))}
    return out


def main() -> None:
    """Run all cases and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=25)
    parser.add_argument("--out", default="benchmarks/results/live_diagnosis.json")
    args = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        results = list(pool.map(run, cases(args.seeds)))
    content = {"summary": summary(results), "flights": results}
    Path(args.out).write_text(json.dumps(content, indent=1) + "\n", encoding="utf8")
    print(json.dumps(content["summary"], indent=1))


if __name__ == "__main__":
    main()
