"""Time of the two-stage estimator with 500 samples on the five-hole problem: results for docs/calibration.md.

    python benchmarks/two_stage_speed.py [--flights 5]

Calibration flights of 250 s at 25 Hz; stage 1 runs on as many threads as there are processors.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

from aircraft_sysid_ros.calibration.five_hole_probe import probe_flight
from aircraft_sysid_ros.estimation.two_stage.estimate import estimate
from aircraft_sysid_ros.simulation.calibration_flight import calibration_flight

SAMPLES = 500


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=5)
    arguments = parser.parse_args()
    times, rows = [], 0
    for seed in range(arguments.flights):
        flight = calibration_flight(seed)
        problem = probe_flight(flight.samples, flight.aircraft).data.problem()
        rows = len(problem.measured)
        started = time.perf_counter()
        estimate(problem, SAMPLES)
        times.append(time.perf_counter() - started)
    result = {"samples": SAMPLES, "rows": rows, "processors": os.cpu_count(), "seconds": sorted(times)}
    path = Path(__file__).parent / "results" / "two_stage_speed.json"
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
