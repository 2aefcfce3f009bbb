"""Is what is named after the first effect there? Flights with one hidden effect, and flights with two.

    python benchmarks/further_effects.py [--single 20] [--pairs 16] [--jobs 2] [--first 9400000]

Flights of 120 s from the project's own simulator, effects of the aerodynamics and changes drawn from the seed, the
second half as strong as the first in every other pair, calm air and light turbulence in turn. An effect of a pair is
relevant where the truth of it lowers the held-out error of an axis by a fifth when the other is known. Each flight is
a line in results/further_effects.jsonl; a run that is stopped goes on where it was. Seeds are drawn before and looked
at once.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores; before numpy is loaded

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from resumed import flown

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.flight.reconstruction import fit_sensor_noise, reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.aliases import aliases_of
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.hidden_effects import SIMULATED
from aircraft_sysid_ros.simulation.simulated_flight import (
    HIDDEN_RATE,
    SimulatedFlight,
    default_aircraft,
    simulate_samples,
)

RESULTS = Path(__file__).parent / "results" / "further_effects.jsonl"
DURATION, REPLICAS, FIRST = 120.0, 4, 9_400_000
RELEVANT = 0.2
#: They need another aeroplane, or are told by other means.
_ELSEWHERE = ("compressibility", "wind_change")
EFFECTS = sorted(e for e in SIMULATED if BY_ID[e].kind != MEASUREMENT and e not in _ELSEWHERE)


def jobs(single: int, pairs: int, first: int) -> list[dict[str, Any]]:
    """What is hidden in which flight: every effect in turn, in a drawn order."""
    rng = np.random.default_rng(first)
    ones = [(EFFECTS[i % len(EFFECTS)],) for i in rng.permutation(max(single, len(EFFECTS)))[:single]]
    twos = [tuple(rng.choice(EFFECTS, 2, replace=False).tolist()) for _ in range(pairs)]
    flights = [{"seed": first + n, "hidden": hidden} for n, hidden in enumerate([*ones, *twos])]
    return [flights[i] for i in rng.permutation(len(flights))]


def fly(job: dict[str, Any]) -> dict[str, Any]:
    """One flight and what is said of it."""
    rng, hidden = np.random.default_rng(job["seed"]), job["hidden"]
    turbulence = "light" if job["seed"] % 2 else "none"
    strengths = [1.0, 0.5 if job["seed"] // 2 % 2 else 1.0][: len(hidden)]
    try:
        flight = simulate_samples(
            default_aircraft(), job["seed"], DURATION, rate=HIDDEN_RATE, turbulence=turbulence,
            wind=(*rng.uniform(-3.0, 3.0, 2), 0.0), hidden=list(zip(hidden, strengths, strict=True)),
            sensors=SensorOptions(height_above_ground=True),
        )  # fmt: skip
        said = diagnose_flight(flight.aircraft, flight.samples, replicas=REPLICAS).json
        relevant = [name for name, gain in zip(hidden, gains(flight), strict=True) if gain >= RELEVANT]
    except InputError as error:
        return {**job, "failed": str(error)}
    found = [{key: c[key] for key in ("effect", "label", "confounded_with")} for c in said["candidates"] if c["found"]]
    return {**job, "turbulence": turbulence, "relevant": relevant, "found": found}


def gains(flight: SimulatedFlight) -> list[float]:
    """Of each hidden effect: the largest share of the held-out error of an axis that its truth explains, with all
    others known.
    """
    whole = _errors(flight, flight.hidden)
    found = []
    for effect in flight.hidden:
        lacking = _errors(flight, [other for other in flight.hidden if other is not effect])
        found.append(max(1.0 - whole[axis] / lacking[axis] for axis in whole if axis in lacking))
    return found


def _errors(flight: SimulatedFlight, known: Sequence[Any]) -> dict[str, float]:
    aircraft: Aircraft = flight.aircraft
    for effect in known:
        aircraft = effect.oracle(aircraft, flight.coefficients)
    seen = fit_sensor_noise(aircraft, flight.samples)
    bench = CandidateEvaluator(settled_flight(reconstruct(seen, flight.samples, with_covariance=False)))
    return {axis: fit.nrmse_held_out for axis, fit in bench.fits.items()}


def is_named(effect: str, finding: dict[str, Any]) -> bool:
    """Under its own name, or one that the flight or the physics cannot tell from it."""
    return effect in {finding["effect"], *finding["confounded_with"]} or finding["effect"] in aliases_of(effect)


def summary(results: list[dict[str, Any]]) -> str:
    """Counts."""
    done = [r for r in results if "failed" not in r]
    lines = []
    for count in (1, 2):
        of_it = [r for r in done if len(r["hidden"]) == count and len(r["relevant"]) == count]
        extra = [r for r in of_it if any(not any(is_named(e, f) for e in r["hidden"]) for f in r["found"])]
        whole = [r for r in of_it if all(any(is_named(e, f) for f in r["found"]) for e in r["hidden"])]
        lines.append(
            f"{count} hidden, relevant: {len(of_it)}; all named: {len(whole)}; "
            f"a name more that is not there: {len(extra)}"
        )
        lines += [
            f"  {r['seed']} {r['hidden']}: {[f['label'] for f in r['found']]}"
            for r in of_it
            if r in extra or r not in whole
        ]
    return "\n".join([*lines, f"not flown: {len(results) - len(done)}"])


def main() -> None:
    """Fly what is not flown yet, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--single", type=int, default=20)
    parser.add_argument("--pairs", type=int, default=16)
    parser.add_argument("--first", type=int, default=FIRST, help="first seed")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--results", type=Path, default=RESULTS)
    args = parser.parse_args()
    print(summary(list(flown(fly, jobs(args.single, args.pairs, args.first), args.results, args.jobs))))


if __name__ == "__main__":
    main()
