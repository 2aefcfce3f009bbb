"""The health watch beside a fleet's prior: time until a fault is said, its size, and false alarms per hour.

    python benchmarks/fleet_health.py [--flights 6] [--healthy 120] [--tune]

Flights of 120 s of the Ultra Stick 25e, half in light turbulence, identified with the prior of ``fleet_prior.py``: one
fault each from take-off on, or an airspeed that creeps, or none. The coefficients of every flight are off by 2 %, as
those of the fleet. Limits were made with --tune, on other seeds; those of the table were looked at once.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from fleet_prior import AIRS, FIRST_SEED, PIECES, TUNE_SEED, aeroplane, prior_of, states_of

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, default_aircraft, simulate_samples

RESULT = Path(__file__).parent / "results" / "fleet_health.json"
DURATION, STEP = 120.0, 1.0
SCALE, CREEP, HEAVIER, AFT, LOST = 0.9, -0.001, 1.2, 0.08, 0.6


def _airspeed(aircraft: Aircraft, **more: float) -> Aircraft:
    return replace(aircraft, sensors={**aircraft.sensors, "airspeed": replace(aircraft.sensors["airspeed"], **more)})


def _with(aircraft: Aircraft, **coefficients: float) -> Aircraft:
    return replace(aircraft, coefficients={**aircraft.coefficients, **coefficients})


def _aft(aircraft: Aircraft) -> Aircraft:
    """Moments about a point further aft: M + (d, 0, 0) x F."""
    c, shape = aircraft.coefficients, aircraft.chord / aircraft.span
    moved = {n: v - AFT * c.get(n.replace("Cm", "CZ"), 0.0) for n, v in c.items() if n.startswith("Cm")}
    moved |= {n: v + AFT * shape * c.get(n.replace("Cn", "CY"), 0.0) for n, v in c.items() if n.startswith("Cn")}
    return _with(aircraft, **moved)


def _lost(signal: str) -> Callable[[Aircraft], Aircraft]:
    return lambda a: _with(a, **{n: LOST * v for n, v in a.coefficients.items() if n.endswith(f"_{signal}")})


#: What is wrong: the kind that is to be said, its true size at the end, and how the aeroplane becomes it.
CASES: dict[str, tuple[str, float, Callable[[Aircraft], Aircraft]]] = {
    "airspeed 10 % too small": ("airspeed_scale", SCALE - 1.0, lambda a: _airspeed(a, scale=SCALE)),
    "airspeed loses 0.1 % per second": ("airspeed_scale", CREEP * DURATION, lambda a: _airspeed(a, drift=CREEP)),
    "mass 20 % above the file": ("mass", HEAVIER - 1.0, lambda a: replace(a, mass=HEAVIER * a.mass)),
    "centre of gravity 8 % of the chord aft": ("centre_of_gravity", AFT, _aft),
    "elevator lost 40 %": ("elevator_power", LOST - 1.0, _lost("de")),
    "ailerons lost 40 %": ("aileron_power", LOST - 1.0, _lost("da")),
    "rudder lost 40 %": ("rudder_power", LOST - 1.0, _lost("dr")),
    "nothing": ("", 0.0, lambda a: a),
}


def fly(seed: int, air: str, case: str) -> SimulatedFlight:
    random = np.random.default_rng(1000 + seed)
    speed, direction = random.uniform(0.0, 5.0), random.uniform(-np.pi, np.pi)
    wind = (speed * np.cos(direction), speed * np.sin(direction), 0.0)
    return simulate_samples(CASES[case][2](aeroplane(seed)), seed, DURATION, wind=wind, turbulence=air)


def one(seed: int, air: str, case: str, prior: dict[str, Any]) -> dict[str, Any]:
    """What the watch said, and when."""
    flight = fly(seed, air, case)
    rows, epoch = states_of(flight)
    file = {key: value for key, value in default_aircraft().source.items() if key != "coefficients"}
    identifier = Identifier(aircraft_from_dict({**file, "prior": prior}))
    identifier.push_samples(flight.samples, epoch)
    time, said = rows[:, StateField.TIME], []
    edges = [*np.searchsorted(time, np.arange(time[0], time[-1], STEP)), len(rows)]
    for first, last in itertools.pairwise(edges):
        identifier.push_states(rows[first:last], epoch)
        found = identifier.learning.health.now
        kinds = [] if found is None else [*found.kinds]
        if not said or said[-1]["kinds"] != kinds:
            said.append({"time": float(time[last - 1] - time[0]), "kinds": kinds, "size": found and found.size})
        elif found is not None:
            said[-1]["size"] = found.size
    learning = identifier.learning
    return {
        "seed": seed, "air": air, "case": case, "said": said, "duration": float(time[-1] - time[0]),
        "notes": learning.health.notes(), "prior": learning.fleet.json, "holds": learning.integrity.summary(),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=6)
    parser.add_argument("--healthy", type=int, default=120)
    parser.add_argument("--tune", action="store_true")
    args = parser.parse_args()
    base = TUNE_SEED if args.tune else FIRST_SEED
    prior, path = prior_of(base), PIECES / f"health_{base}.json"
    done = json.loads(path.read_text(encoding="utf8")) if path.exists() else {}
    for number, case in enumerate(CASES):
        for k in range(args.healthy if case == "nothing" else args.flights):
            seed = base + 5000 + 500 * number + k
            if str(seed) not in done:
                done[str(seed)] = one(seed, AIRS[k % 2], case, prior)
                path.write_text(json.dumps(done), encoding="utf8")
    if not args.tune:
        result = {"flights": [*done.values()], "truth": {case: [kind, size] for case, (kind, size, _) in CASES.items()}}
        RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
