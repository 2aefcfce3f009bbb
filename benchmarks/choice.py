"""Does the estimator that chooses itself choose well?

    python benchmarks/choice.py [--seeds 3]

Flights of 90 s of the Ultra Stick 25e in calm air and in light turbulence, with all that the aircraft file has, with
vanes at 5 Hz, with the IMU at 25 Hz, and without vanes, by every estimator. The limits of ``auto`` were made on seeds
91001 to 91004 and 91050. Writes results/choice.json.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, get_args

import numpy as np
from accuracy import MAIN_DERIVATIVES
from hidden_effects import with_slow_imu

from aircraft_sysid_ros.identification.options import EstimatorName, ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, default_aircraft, simulate_samples

RESULT = Path(__file__).parent / "results" / "choice.json"
FIRST_SEED, DURATION, BLOCK = 92000, 90.0, 1000
AIRS = ("none", "light")
EXCITED, NORMAL_95, FAR = 3.0, 1.96, 0.25
VANES = (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)


def with_slow_vanes(samples: Samples, rate: float) -> Samples:
    """The samples with so many [Hz] of each vane."""
    kept = np.ones(len(samples), np.bool_)
    for kind in VANES:
        own = np.flatnonzero(samples.kind == kind)
        slot = np.floor((samples.stamp[own] - samples.stamp[own[0]]) * 1e-9 * rate + 1e-6)
        kept[own[np.diff(slot, prepend=-1.0) == 0.0]] = False
    return samples[kept]


def sensors(flight: SimulatedFlight) -> dict[str, Samples]:
    """The samples of a flight, by what is there of the sensors."""
    return {
        "all sensors": flight.samples,
        "vanes at 5 Hz": with_slow_vanes(flight.samples, 5.0),
        "IMU at 25 Hz": with_slow_imu(flight, 25.0).samples,
        "no vanes": flight.samples[~np.isin(flight.samples.kind, VANES)],
    }


def identified(flight: SimulatedFlight, samples: Samples, estimator: EstimatorName) -> dict[str, Any]:
    """What one estimator knows at the end."""
    pipeline = Pipeline(flight.aircraft, None, ParameterOptions(estimator=estimator))
    for i in range(0, len(samples), BLOCK):
        pipeline.push(samples[i : i + BLOCK])
    pipeline.flush()
    found, truth = pipeline.parameters.snapshot().parameters, flight.coefficients
    excited = [p for p in found if p.excitation >= EXCITED and np.isfinite(p.std)]
    main = [p for p in found if p.name in MAIN_DERIVATIVES]
    off = {p.name: abs(p.value / truth[p.name] - 1.0) for p in main}
    used = [p for p in main if p.status == Trust.USE]
    return {
        "published": pipeline.parameters.learning.published["published"],
        "excited": len(excited),
        "inside": sum(abs(p.value - truth[p.name]) < NORMAL_95 * p.std for p in excited),
        "error": float(np.median([off[p.name] for p in used])) if used else None,
        "use": sum(p.status == Trust.USE for p in found),
        "use_main": len(used),
        "far": sum(off[p.name] > FAR for p in used),
    }


def joined(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Flights of one cell and estimator."""
    errors = [run["error"] for run in runs if run["error"] is not None]
    sums = {name: sum(run[name] for run in runs) for name in ("excited", "inside", "use", "use_main", "far")}
    return {
        **sums,
        "error": float(np.median(errors)) if errors else None,
        "published": sorted({run["published"] for run in runs}),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    seeds, cells = parser.parse_args().seeds, []
    for air in AIRS:
        flights = [simulate_samples(default_aircraft(), FIRST_SEED + n, DURATION, turbulence=air) for n in range(seeds)]
        flown = [(flight, sensors(flight)) for flight in flights]
        for case in flown[0][1]:
            for estimator in get_args(EstimatorName):
                runs = [identified(flight, samples[case], estimator) for flight, samples in flown]
                cells.append({"air": air, "sensors": case, "estimator": estimator, **joined(runs)})
                print(json.dumps(cells[-1]), flush=True)
    content = {"seeds": seeds, "duration": DURATION, "cells": cells}
    RESULT.write_text(json.dumps(content, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
