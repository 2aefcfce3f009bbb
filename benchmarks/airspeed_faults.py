"""An airspeed that reads a fifth too little or too much, or ices up, in flights without vanes: is it found, is it held?

    python benchmarks/airspeed_faults.py [--first 7700000] [--flights 12]

Of every three flights one is sound; of the others one reads 0.8 or 1.2 of the airspeed from a drawn time on, for 120 s
or to the end, and of every six one ices up by 1 % a minute for 20 minutes. Manoeuvres, wind (its walk, its gusts) and
times are drawn from the seed. Each goes through the chain of replay and live with the residual of GPS against airspeed
and wind (``flight_check.wind_triangle``) and without it. A main derivative is wrong where it has USE and is off by more
than a quarter, later than 5 s after the onset. The rules were made on seeds below 7700000. Looked at once. Writes
results/airspeed_faults.jsonl; a run that is stopped goes on where it was.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import resumed
from fault_kinds import KINDS
from faults import MAIN, WRONG

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.flight_check.in_flight import InFlightCheck
from aircraft_sysid_ros.flight_check.laws.vane_place import Vane
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.calibration_plan import CALIBRATION
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

RESULTS = Path(__file__).parent / "results" / "airspeed_faults.jsonl"
DURATION, LONG, STEP, LATE = 360.0, 1200.0, 1.0, 5.0  # [s]
ICING, SCALES = "pitot icing, 1 % per minute", ("airspeed x 0.8", "airspeed x 1.2")
PLANS, AIRS = (CALIBRATION, "varied", "speeds", "standard"), ("none", "none", "light", "moderate")
VANES = (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)


def drawn(seed: int) -> dict[str, Any]:
    """Everything of a flight."""
    rng = np.random.default_rng([seed, 0xA5])
    icing, sound = seed % 6 == 5, seed % 3 == 0
    fault = "" if sound else ICING if icing else SCALES[int(rng.integers(2))]
    begin = 0.0 if icing else float(rng.uniform(60.0, 140.0))
    return {
        "fault": fault, "begin": begin, "lasts": LONG if icing else float(rng.choice([120.0, DURATION])),
        "plan": str(rng.choice(PLANS)), "air": str(rng.choice(AIRS)), "walk": float(rng.uniform(0.02, 0.15)),
        "wind": [float(rng.normal(0.0, 4.0)), float(rng.normal(0.0, 4.0)), 0.0],
        "duration": LONG if icing else DURATION,
    }  # fmt: skip


def fly(want: dict[str, Any]) -> dict[str, Any]:
    """One flight, both ways."""
    flight = want | drawn(want["seed"])
    aircraft, end = default_aircraft(), min(flight["begin"] + flight["lasts"], flight["duration"])
    samples = simulate_samples(
        aircraft, flight["seed"], flight["duration"], turbulence=flight["air"], manoeuvres=flight["plan"],
        wind=flight["wind"], wind_walk=flight["walk"],
    ).samples  # fmt: skip
    samples = samples[~np.isin(samples.kind, VANES)]
    if flight["fault"]:
        change = KINDS[flight["fault"]].change
        assert change is not None
        samples = change(samples, flight["begin"], end, np.random.default_rng(flight["seed"]))
    return {**flight, "end": end, **{way: watched(aircraft, samples, flight, way) for way in ("without", "with")}}


def watched(aircraft: Aircraft, samples: Samples, flight: dict[str, Any], way: str) -> dict[str, Any]:
    """What is published, every second, against the truth."""
    pipeline = Pipeline(aircraft)
    if way == "without":
        check = InFlightCheck(aircraft.minimum_airspeed, Vane(0.0, aircraft.span, True), asks_airspeed=False)
        pipeline.check = pipeline.state.watch = check
    names = list(aircraft.model.parameter_names)
    truth = np.array([aircraft.coefficients[name] for name in MAIN])
    columns = [names.index(name) for name in MAIN]
    times = np.arange(STEP, flight["duration"] + STEP, STEP)
    edges = [0, *np.searchsorted(samples.stamp, stamps_of(times)).tolist()]
    used, wrong, named, held = [], [], None, []
    since = flight["begin"] + LATE if flight["fault"] else np.inf
    for time, (low, high) in zip(times.tolist(), pairwise(edges), strict=True):
        pipeline.push(samples[low:high])
        parameters = pipeline.parameters.snapshot().parameters
        published = [parameters[i] for i in columns]
        use = np.array([p.status is Trust.USE for p in published])
        off = np.abs([p.value for p in published] / truth - 1.0) > WRONG
        used.append(int(use.sum()))
        wrong.append(int((use & off).sum()) if time > since else 0)
        reads = [f for f in pipeline.check.findings if "GPS and wind" in f.sentence]
        named = time if reads and named is None else named
        held.append(any(hold is not None for hold in pipeline.parameters.learning.integrity.holds))
    return {
        "named": named, "said": [f.sentence for f in pipeline.check.findings], "wrong_seconds": sum(map(bool, wrong)),
        "wrong_at_the_end": wrong[-1], "use_seconds": sum(used), "use_at_the_end": used[-1], "held_seconds": sum(held),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=7_700_000)
    parser.add_argument("--flights", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--results", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    wanted = [{"seed": arguments.first + i} for i in range(arguments.flights)]
    for record in resumed.flown(fly, wanted, arguments.results, arguments.jobs):
        print(json.dumps(record), flush=True)


if __name__ == "__main__":
    main()
