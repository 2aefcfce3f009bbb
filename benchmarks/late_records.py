"""Is a delay of the recorded controls told, either way, and none of a flight that has none?

    python benchmarks/late_records.py [--clean 8] [--late 10] [--first 9700] [--jobs 2]

Flights of 100 s of the simulator, in calm air or light turbulence as the seed draws; the user knows mass, shape and
places. Of the late ones the stamps of the controls are 0.04 to 0.2 s late or early. The measurement half of
``diagnose`` looks at each. Each flight is a line in results/late_records.jsonl. The search was made on the seeds 9600
to 9655, those from 9700 on were looked at once.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores; before numpy is loaded

from dataclasses import replace
from pathlib import Path
from typing import Any

import explain
import numpy as np
import resumed

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct_as_flown
from aircraft_sysid_ros.diagnosis.flight_diagnosis import measurement_first
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT
from aircraft_sysid_ros.effects import LIBRARY
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.processes import CORES
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

RESULTS = Path(__file__).parent / "results" / "late_records.jsonl"
FIRST, DURATION, DELAYS = 9700, 100.0, (0.04, 0.2)


def fly(job: dict[str, Any]) -> dict[str, Any]:
    """One flight, and the settings that are named."""
    os.environ[CORES] = "1"
    seed, delay = job["seed"], 0.0
    rng, flying = np.random.default_rng([seed, 5]), default_aircraft()
    known = aircraft_from_dict({key: flying.source[key] for key in explain.KNOWN_KEYS})
    air = ("calm", "light")[int(rng.integers(2))]
    samples = simulate_samples(flying, seed, DURATION, turbulence="none" if air == "calm" else air).samples
    if job["late"]:
        delay = float(rng.choice([-1, 1])) * float(rng.uniform(*DELAYS))
        stamp = samples.stamp + np.where(samples.kind == Kind.CONTROLS, round(1e9 * delay), 0)
        samples = replace(samples, stamp=stamp)[np.argsort(stamp, kind="stable")]
    measuring = [effect for effect in LIBRARY if effect.kind == MEASUREMENT]
    flight, calm = reconstruct_as_flown(known, samples, with_covariance=False)
    settings = measurement_first(known, flight, calm, measuring, COUNT, lambda what, share: None)[3]
    found = [each for each in settings if each.matters]
    return {
        **job,
        "air": air,
        "delay": delay,
        "named": [each.setting.label for each in found],
        "told": next((e.setting.value for e in found if e.setting.variant.setting[1:] == (CONTROLS, "delay")), None),
    }


def main() -> None:
    parser = resumed.options(__doc__, FIRST, clean=8, late=10)
    args = parser.parse_args()
    wanted = [{"seed": args.first + n, "late": False} for n in range(args.clean)]
    wanted += [{"seed": args.first + 20 + n, "late": True} for n in range(args.late)]
    resumed.flown_aloud(
        fly,
        wanted,
        args.results or RESULTS,
        args.jobs,
        lambda r: f"{r['air']} {r['delay']:.3f}: {r['named']} {r['told']}",
    )


if __name__ == "__main__":
    main()
