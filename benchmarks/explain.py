"""Does `explain` say the right thing first? Ten logs, simulated with one thing wrong each, by real processes.

    python benchmarks/explain.py [--duration 120] [--seeds judged] [--only stall]

A log is flown with a seed, written as a recording (or, in other units, as it would be logged), and explained with an
aircraft file that holds mass, shape and places of the sensors, no coefficients and no noise. What is wrong, and which
sentence is right, stands in CASES. Rules were made on the seeds of `made`; those of `judged` are looked at once.
Results: benchmarks/results/explain.json, a table of docs/explain.md.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions, Stream, measure
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.flight import fly, prepare
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, default_aircraft, simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight
from aircraft_sysid_ros.simulation.varied_plan import STANDARD, plan_of

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results" / "explain.json"
#: Seed of each set, to which the number of the case is added.
SEEDS = {"made": 4100, "judged": 8300}
KNOWN_KEYS = (
    "name", "mass", "wing_area", "span", "chord", "inertia", "imu_position", "air_data_position", "gps_position",
    "ground_altitude",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One thing that is wrong: how it is flown, what is done to the log and to the user's file, what must be said."""

    name: str
    right: tuple[str, ...]  # kinds of a first sentence that are right
    words: tuple[str, ...]  # any of which must be in it
    fly: Callable[[Aircraft, int, float], SimulatedFlight] = simulate_samples
    log: Callable[[Stream, int], Stream] = lambda stream, seed: stream
    file: Callable[[dict[str, Any]], dict[str, Any]] = lambda content: content


def _with(**changed: Any) -> Callable[[Aircraft, int, float], SimulatedFlight]:
    return lambda aircraft, seed, duration: simulate_samples(aircraft, seed, duration, **changed)


def _scaled(topic: str, field: str, factor: float) -> Callable[[Stream, int], Stream]:
    def log(stream: Stream, seed: int) -> Stream:
        if stream.topic != topic:
            return stream
        return replace(stream, fields={**stream.fields, field: stream.fields[field] * factor})

    return log


def _vane_offset(stream: Stream, seed: int) -> Stream:
    """Two degrees, to a side that the seed draws."""
    if stream.topic != "air_data":
        return stream
    offset = np.radians(2.0) * (1.0 if seed % 2 else -1.0)
    return replace(stream, fields={**stream.fields, "angle_of_attack": stream.fields["angle_of_attack"] + offset})


def _late_controls(stream: Stream, seed: int) -> Stream:
    """0.15 s late."""
    return replace(stream, stamp=stream.stamp + 150_000_000) if stream.topic == "control_surfaces" else stream


def _wrong_units(stream: Stream, seed: int) -> Stream:
    """Degrees or knots, of a signal that the seed draws."""
    degrees = 180.0 / np.pi
    chosen = (
        ("air_data", "angle_of_attack", degrees), ("imu/data", "angular_velocity", degrees),
        ("air_data", "true_airspeed", 1.943844), ("control_surfaces", "elevator", degrees),
    )[seed % 4]  # fmt: skip
    topic, name, factor = chosen
    if stream.topic != topic:
        return stream
    fields = {key: value * factor if key == name else value for key, value in stream.fields.items()}
    return replace(stream, fields=fields)


def _aft(aircraft: Aircraft, seed: int, duration: float) -> SimulatedFlight:
    """The centre of gravity 12 % of the chord further aft, of which the user's file knows nothing."""
    moved = {**aircraft.source, "aerodynamic_reference": [0.12 * aircraft.chord, 0.0, 0.0]}
    return simulate_samples(aircraft_from_dict(moved), seed, duration)


def _half_aileron(aircraft: Aircraft, seed: int, duration: float) -> SimulatedFlight:
    """Half of it is lost in the middle of the flight."""
    since = f"max(sign(time-{0.45 * duration:g}),0)*da"
    lost = [Effect(axis, since, -0.5 * aircraft.coefficients[f"{axis}_da"]) for axis in ("Cl", "Cn")]
    return simulate_samples(aircraft, seed, duration, effects=lost)


def _little_motion(aircraft: Aircraft, seed: int, duration: float) -> SimulatedFlight:
    """Turns and a few small inputs: what a pilot flies who was told nothing."""
    setup, time_ = prepare(aircraft), np.arange(round(duration * 400.0) + 1) / 400.0
    small = {name: 0.03 * getattr(setup.excitation, name) for name in ("elevator", "aileron", "rudder", "throttle")}
    plan = plan_of(STANDARD, time_, replace(setup.excitation, **small), seed)
    truth = fly(setup, plan, np.tile([3.0, -2.0, 0.0], (len(time_), 1)))
    streams, biases = measure(aircraft, truth, seed, SensorOptions())
    return SimulatedFlight(aircraft, seed, (), truth, biases, streams)


CASES = (
    Case("airspeed scale", ("instrument scale", "airspeed_scale", "check scale"), ("irspeed",),
         log=_scaled("air_data", "true_airspeed", 1.1)),
    Case("vane offset", ("instrument offset",), ("angle of attack",), log=_vane_offset),
    Case("wrong mass", ("mass",), ("mass",), file=lambda content: {**content, "mass": 1.25 * content["mass"]}),
    Case("aft centre of gravity", ("balance",), ("centre of gravity",), fly=_aft),
    Case("halved aileron", ("control_damage", "stuck_control"), ("control surface",), fly=_half_aileron),
    Case("stall", ("stall", "dynamic_stall"), ("Stall",), fly=_with(hidden=[("stall", 1.0)])),
    Case(
        "late controls",
        ("check offset", "actuator_lag", "late_controls"),
        ("elevator", "aileron", "rudder", "ctuator"),
        log=_late_controls,
    ),
    Case("nothing", ("nothing",), ("Nothing",)),
    Case("wrong units", ("check unit",), ("divide", "unit"), log=_wrong_units),
    Case("too little motion", ("motion",), ("too little motion",), fly=_little_motion),
)  # fmt: skip


def explained(case: Case, number: int, seed: int, duration: float, folder: Path) -> dict[str, Any]:
    """The first sentence of a log, whether it is right, and what it took."""
    aircraft = default_aircraft()
    flight = case.fly(aircraft, seed, duration)
    flight = replace(flight, streams=[case.log(stream, seed) for stream in flight.streams])
    bag, file = folder / f"log_{number}", folder / f"aircraft_{number}.yaml"
    write_flight(flight, bag)
    content = {key: aircraft.source[key] for key in KNOWN_KEYS}
    file.write_text(yaml.safe_dump(case.file(content), sort_keys=False), encoding="utf8")
    words = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "explain", bag, "--aircraft", file,
             "--out", folder / f"out_{number}", "--json"]  # fmt: skip
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"explain of '{case.name}' failed: {done.stderr}")
    said = json.loads(done.stdout)
    kind, sentence = said["said"][0]["kind"], said["first"]
    return {
        "case": case.name,
        "seed": seed,
        "kind": kind,
        "sentence": sentence,
        "right": kind in case.right and any(word in sentence for word in case.words),
        "others": [each["kind"] for each in said["said"][1:]],
        "elapsed": time.perf_counter() - begun,
        "processor": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "page": (folder / f"out_{number}" / "explain.html").is_file(),
    }


def main() -> None:
    """Fly, explain, and write the results of the judged seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=120.0, help="of every flight [s] (default: %(default)s)")
    parser.add_argument("--seeds", choices=tuple(SEEDS), default="judged", help="default: %(default)s")
    parser.add_argument(
        "--only", help="one case by its name; of results of the same duration it takes the old one's place"
    )
    args = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as place:
        for number, case in enumerate(CASES):
            if args.only in (None, case.name):
                seed = SEEDS[args.seeds] + number
                rows.append(explained(case, number, seed, args.duration, Path(place)))
                row = rows[-1]
                print(f"{'right' if row['right'] else 'WRONG'} {case.name}: [{row['kind']}] {row['sentence']} "
                      f"({row['elapsed']:.0f} s, {row['processor']:.0f} of processor)", flush=True)  # fmt: skip
    print(f"{sum(row['right'] for row in rows)} of {len(rows)} right")
    if args.only is not None and RESULTS.exists():
        known = json.loads(RESULTS.read_text(encoding="utf8"))
        rows = [rows[0] if row["case"] == args.only else row for row in known["logs"]]
        args.seeds = args.seeds if known["duration"] == args.duration else ""
    if args.seeds == "judged" and len(rows) == len(CASES):
        content = {
            "duration": args.duration,
            "right": sum(row["right"] for row in rows),
            "logs": rows,
            "cores": len(os.sched_getaffinity(0)),
            "load_average": os.getloadavg()[0],
        }
        RESULTS.write_text(json.dumps(content, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
