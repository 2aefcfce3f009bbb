"""Is what may be used right where a busy machine loses most of the samples for seconds?

    python benchmarks/lost_samples.py [--flights 30] [--first 9400] [--jobs 2]

Flights of 45 s of the simulator, of every other one the IMU at 50 Hz. In periods of 3 s on average, 4 s apart, each
topic by itself loses 40 to 85 % of its samples, one by one or in runs. The parameters are asked for every half second;
counted are values with USE, and those that are more than 3 and 5 standard errors from the truth. Each flight is a line
in results/lost_samples.jsonl. Rules were made on seeds below 9230; those from 9400 on were looked at once.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores; before numpy is loaded

from pathlib import Path
from typing import Any

import numpy as np
import resumed

from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

RESULTS = Path(__file__).parent / "results" / "lost_samples.jsonl"
FIRST, DURATION, ASKED = 9400, 45.0, 90
#: Mean length [s] of periods in which samples are lost, and of those between; shares that are lost; steps of a run.
BAD, GOOD, LOST, RUN = 3.0, 4.0, (0.4, 0.85), 0.35
TOPICS = (
    (Kind.IMU,), (Kind.CONTROLS,), (Kind.AIRSPEED,), (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP),
    (Kind.GPS_POSITION, Kind.GPS_VELOCITY),
)  # fmt: skip


def lossy(samples: Samples, seed: int) -> Samples:
    """What is left of a flight."""
    rng, keep = np.random.default_rng(seed), np.ones(len(samples), bool)
    time, edges = (samples.stamp - samples.stamp[0]) * 1e-9, [0.0]
    while edges[-1] < time[-1]:
        edges.append(edges[-1] + rng.exponential(GOOD if len(edges) % 2 else BAD))
    period = np.searchsorted(edges, time, side="right")
    one_by_one = np.random.default_rng([seed, 7]).random(len(edges) + 2) < 0.5
    share = np.random.default_rng([seed, 8]).uniform(*LOST, len(edges) + 2)
    for topic in TOPICS:
        chosen = np.flatnonzero(np.isin(samples.kind, topic) & (period % 2 == 0))
        stamps, first = np.unique(samples.stamp[chosen], return_index=True)
        of_stamp, gone, i = period[chosen][first], np.zeros(len(stamps), bool), 0
        while i < len(stamps):
            count = 1 if one_by_one[of_stamp[i]] else 1 + rng.geometric(RUN)
            if rng.random() < share[of_stamp[i]]:
                gone[i : i + count] = True
            i += count
        keep[chosen] &= ~np.isin(samples.stamp[chosen], stamps[gone])
    return samples[keep]


def fly(seed: int) -> dict[str, Any]:
    """One flight: how much of it was left, and what might be used."""
    aircraft = default_aircraft()
    if seed % 2:
        for sensor in ("accelerometer", "gyro"):
            aircraft = with_setting(aircraft, ("sensors", sensor, "rate"), 50.0)
    whole = simulate_samples(aircraft, seed, DURATION).samples
    samples, pipeline = lossy(whole, seed), Pipeline(aircraft)
    errors: list[float] = []
    for part in np.array_split(np.arange(len(samples)), ASKED):
        pipeline.push(samples[part])
        used = [p for p in pipeline.parameters.snapshot().parameters if p.status == Trust.USE]
        errors += [abs(p.value - aircraft.coefficients[p.name]) / p.std for p in used]
    return {
        "seed": seed,
        "left": len(samples) / len(whole),
        "used": len(errors),
        "beyond_3": sum(error > 3.0 for error in errors),
        "beyond_5": sum(error > 5.0 for error in errors),
        "largest": max(errors, default=0.0),
    }


def main() -> None:
    parser = resumed.options(__doc__, FIRST, flights=30)
    args = parser.parse_args()
    wanted = list(range(args.first, args.first + args.flights))
    found = resumed.flown_aloud(fly, wanted, args.results or RESULTS, args.jobs, lambda r: f"{r['largest']:.1f}")
    used = sum(r["used"] for r in found)
    print({name: sum(r[name] for r in found) / max(used, 1) for name in ("beyond_3", "beyond_5")}, used)


if __name__ == "__main__":
    main()
