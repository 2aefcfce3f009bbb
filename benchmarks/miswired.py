"""Sensors that are wired wrongly: is it noticed within the first minute, does the message say how, is nothing USE?

    python benchmarks/miswired.py [--first-seed 400] [--flights 12]

Flights as in flight_check.py, with wind, calm to turbulent, 10 to 400 Hz, some of JSBSim, with an attitude in seven of
ten; the aircraft file is complete. Each goes through the pipeline of replay and live for 65 s as it is, and then with
one fault after another, and without the check for comparison. The rules of the check were made on seeds below 200.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import flight_check
from flight_check import all_of, late, scaled, swapped

from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples

SECONDS = 65.0
BLOCK = 1000
GYROS = tuple(f"angular_velocity.{axis}" for axis in "xyz")
#: What is done to the samples, and the signals of which one must be named.
FAULTS: dict[str, tuple[Callable[[Samples], Samples], tuple[str, ...]]] = {
    "angle of attack upside down": (scaled("angle_of_attack", -1.0), ("angle_of_attack",)),
    "sideslip upside down": (scaled("sideslip", -1.0), ("sideslip",)),
    "airspeed in knots": (scaled("true_airspeed", 1.943844), ("true_airspeed",)),
    "airspeed in km/h": (scaled("true_airspeed", 3.6), ("true_airspeed",)),
    "IMU turned by 90°": (
        all_of(
            *(
                all_of(swapped(f"{v}.x", f"{v}.y"), scaled(f"{v}.y", -1.0))
                for v in ("specific_force", "angular_velocity")
            )
        ),
        ("specific_force", "angular_velocity"),
    ),
    "GPS 0.5 s late": (late(0.5, Kind.GPS_VELOCITY, Kind.GPS_POSITION), ("velocity",)),
    "angle of attack in degrees": (scaled("angle_of_attack", 57.29578), ("angle_of_attack",)),
    "gyros in deg/s": (all_of(*(scaled(name, 57.29578) for name in GYROS)), ("angular_velocity",)),
    "elevator in degrees": (scaled("elevator", 57.29578), ("elevator",)),
}


def flown(pipeline: Pipeline, samples: Samples) -> int:
    """Push a flight; returns how many parameters have USE at its end."""
    for i in range(0, len(samples), BLOCK):
        pipeline.push(samples[i : i + BLOCK])
    pipeline.flush()
    return sum(p.status is Trust.USE for p in pipeline.parameters.snapshot().parameters)


def judged(samples: Samples, aircraft: Any) -> dict[str, Any]:
    """What the pipeline says of samples, and what it would without the check."""
    pipeline, blind = Pipeline(aircraft), Pipeline(aircraft)
    use = flown(pipeline, samples)
    blind.state = StateEstimator(aircraft)
    controls = pipeline.parameters.stream.controls.misread(float("inf"))
    named = [signal for finding in pipeline.check.findings for signal in finding.signals]
    named += ["elevator"] * any("elevator" in words for words in controls)
    return {"named": named, "use": use, "use_without": flown(blind, samples)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first-seed", type=int, default=400)
    parser.add_argument("--flights", type=int, default=12)
    parser.add_argument("--clean", type=int, default=28, help="more flights that are judged as they are only")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "miswired.json")
    arguments = parser.parse_args()
    faults: dict[str, list[dict[str, Any]]] = {name: [] for name in FAULTS}
    cleans = []
    for number in range(arguments.flights + arguments.clean):
        seed = arguments.first_seed + number
        whole, what, aircraft = flight_check.flown_by(seed)
        samples = whole[whole.stamp <= whole.stamp.min() + round(SECONDS * 1e9)]
        cleans.append({"seed": seed, **what, **judged(samples, aircraft)})
        for name, (fault, signals) in FAULTS.items() if number < arguments.flights else ():
            record = judged(fault(samples), aircraft)
            record["right"] = any(signal.startswith(signals) for signal in record["named"])
            faults[name].append({"seed": seed, **record})
        print(f"{number + 1} of {arguments.flights + arguments.clean}", flush=True)
    arguments.out.write_text(json.dumps({"clean": cleans, "faults": faults}, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
