"""Time of ``diagnose`` over the whole library on a long flight, as a user waits for it.

    python benchmarks/diagnosis_speed.py [--duration 600] [--runs 3]

A flight of this project's simulator with IMU at 100 Hz and a hidden effect, so that the search goes round more than
once; seconds by the clock, and of processor time in all processes. Medians over the runs after one that compiles; the
flight is flown before the clock starts.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import hidden_flight

RESULT = Path(__file__).parent / "results" / "diagnosis_speed.json"
EFFECT, SEED = "dihedral_alpha", 3


class Clock:
    """Seconds of each part, by what the diagnosis says that it does."""

    def __init__(self) -> None:
        self.parts: dict[str, float] = defaultdict(float)
        self._what, self._since = "", time.perf_counter()

    def hear(self, what: str, share: float) -> None:
        """A message of progress."""
        if what != self._what:
            self.stop()
            self._what = what

    def stop(self) -> None:
        """End of the present part."""
        now = time.perf_counter()
        if self._what:
            self.parts[self._what] += now - self._since
        self._what, self._since = "", now


def measure(duration: float, runs: int) -> dict[str, Any]:
    """Medians over ``runs``."""
    flight = hidden_flight("textbook", EFFECT, seed=SEED, duration=duration)
    load = os.getloadavg()[0]
    diagnose_flight(*_short())
    walls, processor, parts, found = [], [], defaultdict(list), None
    for _ in range(runs):
        started, before, clock = time.perf_counter(), sum(os.times()[:4]), Clock()
        found = diagnose_flight(flight.aircraft, flight.samples, progress=clock.hear)
        clock.stop()
        walls.append(time.perf_counter() - started)
        processor.append(sum(os.times()[:4]) - before)
        for what, seconds in clock.parts.items():
            parts[what].append(seconds)
    assert found is not None
    imu = flight.samples.stamp[flight.samples.kind == Kind.IMU]
    return {
        "duration": duration,
        "imu_rate": round(1e9 / float(np.median(np.diff(np.sort(imu))))),
        "samples": len(flight.samples),
        "verdict": found.verdict,
        "hidden": EFFECT,
        "named": [f.trial.candidate.label for f in found.diagnosis.found],
        "runs": runs,
        "seconds": statistics.median(walls),
        "processor_seconds": statistics.median(processor),
        "parts": {what: statistics.median(seconds) for what, seconds in parts.items()},
        "cores": len(os.sched_getaffinity(0)),
        "load_average": load,
        "machine": f"{platform.machine()}, {platform.python_implementation()} {platform.python_version()}",
    }


def _short() -> tuple[Any, Any]:
    flight = hidden_flight("textbook", seed=SEED, duration=60.0)
    return flight.aircraft, flight.samples


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=600.0)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--out", type=Path, default=RESULT)
    arguments = parser.parse_args()
    result = measure(arguments.duration, arguments.runs)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
