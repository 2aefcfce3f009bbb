"""An airspeed that reads a few per cent too much or too little, and that no limit of 5 % holds: is one told of it?

    python benchmarks/small_airspeed_error.py [--first 9990000] [--flights 10]

Flights of four minutes of a point that turns (``turning_point``), of 18 and 50 m/s in six airs; seeds drawn before and
looked at once. Told is what ``WindTriangle`` says when the flight is over; within: whether what the sensor reads is in
the range of two standard errors that ``explain`` goes by. Writes results/small_airspeed_error.jsonl.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from turning_point import AIRS, SECOND, flown

from aircraft_sysid_ros.flight_check.wind_triangle import WindTriangle

RESULTS = Path(__file__).parent / "results" / "small_airspeed_error.jsonl"
SPEEDS, ERRORS = (18.0, 50.0), (0.0, -0.03, 0.03, -0.06, 0.06)


def told(seed: int, air: str, speed: float, error: float) -> dict[str, Any]:
    """What is said of one flight, and in flight."""
    samples = flown(seed, scale=lambda t: (1.0 + error) * np.ones_like(t), speed=speed, **AIRS[air])
    triangle = WindTriangle(8.0)
    triangle.add(samples)
    for stamp in range(int(samples.stamp[0]), int(samples.stamp[-1]), SECOND):
        triangle.advance(stamp)
    in_flight = bool(triangle.findings)
    triangle.finish()
    low, high = triangle.reads or (np.nan, np.nan)
    return {
        "air": air, "in_flight": in_flight, "told": bool(triangle.findings),
        "within": bool(low <= 1.0 + error <= high), "range": float(high - low),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=9_990_000)
    parser.add_argument("--flights", type=int, default=10, help="of each speed, error and air")
    parser.add_argument("--out", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    found, seed = [], arguments.first
    for speed in SPEEDS:
        for error in ERRORS:
            flights = []
            for air in AIRS:
                for _ in range(arguments.flights):
                    flights.append(told(seed, air, speed, error))
                    seed += 1
            found.append({"speed": speed, "error": error, "flights": flights})
            print(speed, error, len(flights), sum(f["told"] for f in flights), sum(f["within"] for f in flights))
    arguments.out.write_text("".join(json.dumps(each) + "\n" for each in found), encoding="utf8")


if __name__ == "__main__":
    main()
