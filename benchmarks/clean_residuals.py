"""What `compare` says of flights that lack nothing: errors against their floor, and residuals that are not noise.

    python benchmarks/clean_residuals.py [--flights 60] [--first 7420000] [--jobs 2]

Flights of 120 s of the project's own simulator under the model that it flies: air, attitude or none, and manoeuvres
are drawn from the seed. Each is a line of results/clean_residuals.jsonl. Seeds are looked at once.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores; before numpy is loaded

from pathlib import Path
from typing import Any

import numpy as np
from resumed import flown

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.diagnosis.compare import compare
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct_as_flown, settled_flight
from aircraft_sysid_ros.diagnosis.significance.whiteness import FALSE_ALARM
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.varied_plan import PLANS

RESULTS = Path(__file__).parent / "results" / "clean_residuals.jsonl"
FIRST, DURATION = 7_420_000, 120.0
AIRS = ("none", "light", "moderate")
AEROPLANES = ("ultra_stick_25e", "ultra_stick_120")


def fly(seed: int) -> dict[str, Any]:
    """One flight, and by axis the held-out error over its floor and the p-value of white noise."""
    rng = np.random.default_rng([seed, 3])
    aircraft = load_aircraft(config_path(f"{rng.choice(AEROPLANES)}.yaml"))
    drawn = {
        "seed": seed, "air": str(rng.choice(AIRS)), "attitude": bool(rng.random() < 0.5),
        "manoeuvres": str(rng.choice(PLANS)),
    }  # fmt: skip
    sensors = SensorOptions(attitude=drawn["attitude"])
    try:
        flight = simulate_samples(
            aircraft, seed, DURATION, turbulence=drawn["air"], manoeuvres=drawn["manoeuvres"], sensors=sensors
        )
        found = compare(settled_flight(reconstruct_as_flown(aircraft, flight.samples)[0]))
    except InputError as error:
        return {**drawn, "failed": str(error)}
    return {
        **drawn,
        "over_floor": {name: axis.fit.nrmse_held_out / axis.floor.nrmse for name, axis in found.axes.items()},
        "p_value": {name: axis.whiteness.p_value for name, axis in found.axes.items()},
    }


def summary(results: list[dict[str, Any]]) -> str:
    """Counts; the table is in docs/compare.md (docs/build.py)."""
    p_values = [p for r in results if "p_value" in r for p in r["p_value"].values() if np.isfinite(p)]
    ratios = [ratio for r in results if "over_floor" in r for ratio in r["over_floor"].values()]
    fired = sum(p < FALSE_ALARM for p in p_values)
    return (
        f"more than noise: {fired} of {len(p_values)} axes; held out over floor: median {np.median(ratios):.2f}, "
        f"largest {max(ratios):.2f}; not flown: {sum('failed' in r for r in results)}"
    )


def main() -> None:
    """Fly what is not flown yet, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=60)
    parser.add_argument("--first", type=int, default=FIRST, help="first seed")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--results", type=Path, default=RESULTS)
    args = parser.parse_args()
    print(summary(list(flown(fly, range(args.first, args.first + args.flights), args.results, args.jobs))))


if __name__ == "__main__":
    main()
