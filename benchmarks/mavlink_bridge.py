"""Identification through MAVLink against the direct topics, without vanes, and the bridge under faults.

    python benchmarks/mavlink_bridge.py [--flights 3] [--garbage 600]

The MAVLink simulator and the bridge's session run on one virtual clock, so that a flight takes less than its time:
the same samples go to the pipeline directly, and as packets over a link with jitter, with a clock that drifts, and
with losses.
"""

from __future__ import annotations

import argparse
import json
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
from aircraft_sysid_ros.mavlink.session import Session
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.mavlink_simulator.autopilot import Faults, MavlinkSimulator
from aircraft_sysid_ros.simulation.mavlink_simulator.flight import START, Link, bridged, samples_of_outputs
from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import Event, FlightSensors, direct_samples, pieces
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_jsbsim_samples, simulate_samples

RESULT = Path(__file__).resolve().parent / "results" / "mavlink_bridge.json"
DURATION = 120.0
DRIFT = 40e-6
LINK = Link(least=0.004, jitter=0.006)
LOSS = 0.2
_BAUD_BYTES = 5760  # [1/s] at 57600 baud


def identify(aircraft: Aircraft, samples: Samples) -> ParameterSet:
    """Parameters at the end of a flight; the magnetometer only starts the heading, docs/state-reconstruction.md."""
    pipeline = Pipeline(replace(aircraft, magnetic_declination=None))
    pipeline.push(samples)
    pipeline.flush()
    return pipeline.parameters.snapshot()


def flown(simulator: str, seed: int) -> tuple[Aircraft, list[Event]]:
    """An aeroplane and the samples of its flight."""
    if simulator == "textbook":
        flight = simulate_samples(default_aircraft(), seed=seed, duration=DURATION)
    else:
        flight = simulate_jsbsim_samples(simulator, seed=seed, duration=DURATION)
    sensors = FlightSensors(flight.aircraft, seed)
    return flight.aircraft, [event for piece in pieces(flight.truth) for event in sensors.events(piece)]


def through_link(events: list[Event], seed: int, loss: float) -> tuple[Samples, dict[str, Any]]:
    """The samples that come out of the bridge, and its summary."""
    mapping = load_servo_mapping(config_path("mavlink_simulator_servos.yaml"))
    simulator = MavlinkSimulator(mapping, Faults(drift=DRIFT, loss=loss), seed)
    session = Session(mapping)
    outputs = bridged(events, simulator, session, Link(LINK.least, LINK.jitter, seed))
    return samples_of_outputs(outputs), session.summary()


def compared(direct: ParameterSet, other: ParameterSet) -> list[float]:
    """Differences in standard errors of the direct estimate, of parameters that either calls USE."""
    return [
        (b.value - a.value) / a.std
        for a, b in zip(direct.parameters, other.parameters, strict=True)
        if Trust.USE in (a.status, b.status)
    ]


def truth_errors(aircraft: Aircraft, found: ParameterSet) -> list[float]:
    """Errors in standard errors of what may be used."""
    known = aircraft.coefficients
    return [(p.value - known[p.name]) / p.std for p in found.parameters if p.status == Trust.USE]


def without_vanes(samples: Samples) -> Samples:
    """The same flight of an aircraft that has none."""
    return samples[~np.isin(samples.kind, (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP))]


def identification(flights: int) -> dict[str, Any]:
    """Differences by simulator and link, and what a flight without vanes still gives."""
    cases = [("textbook", seed) for seed in range(flights)] + [("c172p", 0)]
    differences: dict[str, list[float]] = {}
    vaneless: dict[str, Any] = {"errors": [], "use": {}, "reasons": {}, "std_ratio": {}}
    for simulator, seed in cases:
        aircraft, events = flown(simulator, seed)
        direct = identify(aircraft, direct_samples(events, START))
        for loss in (0.0, LOSS):
            samples, _ = through_link(events, seed, loss)
            key = f"{'textbook' if simulator == 'textbook' else 'JSBSim ' + simulator}, {100 * loss:.0f} % lost"
            differences.setdefault(key, []).extend(compared(direct, identify(aircraft, samples)))
            print(key, seed, f"{np.sqrt(np.mean(np.square(differences[key]))):.2f}", flush=True)
        if simulator == "textbook":
            bare = identify(aircraft, without_vanes(direct_samples(events, START)))
            vaneless["errors"] += truth_errors(aircraft, bare)
            for p, with_vanes in zip(bare.parameters, direct.parameters, strict=True):
                vaneless["use"][p.name] = vaneless["use"].get(p.name, 0) + (p.status == Trust.USE)
                vaneless["reasons"][p.name] = p.reason
                vaneless["std_ratio"].setdefault(p.name, []).append(p.std / with_vanes.std)
    return {
        "flights": flights,
        "differences": {key: summary(values) for key, values in differences.items()},
        "vaneless": {
            "errors": summary(vaneless["errors"]),
            "parameters": {
                name: {
                    "use": count,
                    "std_ratio": float(np.median(vaneless["std_ratio"][name])),
                    "reason": vaneless["reasons"][name],
                }
                for name, count in vaneless["use"].items()
            },
        },
    }


def summary(z: list[float]) -> dict[str, Any]:
    """Rms, largest, and share within one standard error."""
    values = np.abs(z)
    return {
        "pairs": len(values),
        "rms": float(np.sqrt(np.mean(values**2))),
        "largest": float(values.max()),
        "within_1": float(np.mean(values < 1.0)),
    }


def restart() -> dict[str, Any]:
    """How long no samples come when the autopilot starts anew in flight, of which it is silent itself for a while."""
    _, events = flown("textbook", 1)
    events = [event for event in events if event.time < 40.0]
    mapping = load_servo_mapping(config_path("mavlink_simulator_servos.yaml"))
    simulator, session = MavlinkSimulator(mapping, Faults(drift=DRIFT, loss=LOSS)), Session(mapping)
    outputs = bridged(events, simulator, session, LINK, at=[(20.0, lambda: simulator.reboot(20.0))])
    stamps = np.sort([o.stamp[0] for o in outputs if o.topic == "imu/data"])
    return {"silence": float(np.diff(stamps).max() * 1e-9), "reboots": session.boot_time.reboots}


def garbage(seconds: float) -> dict[str, Any]:
    """Random bytes at the rate of a telemetry radio: memory, processor time, and whether it goes on afterwards."""
    mapping = load_servo_mapping(config_path("mavlink_simulator_servos.yaml"))
    session, rng = Session(mapping), np.random.default_rng(0)
    tracemalloc.start()
    sizes, spent = [], 0.0
    for second in range(round(seconds)):
        data = rng.integers(0, 256, _BAUD_BYTES, np.uint8).tobytes()
        began = time.process_time()
        session.receive(data, START + second * 10**9)
        session.tick(START + second * 10**9)
        spent += time.process_time() - began
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    _, events = flown("textbook", 2)
    session._next_heartbeat = session._next_sync = 0  # the virtual flight begins at its own time 0
    outputs = bridged([e for e in events if e.time < 10.0], MavlinkSimulator(mapping), session)
    return {
        "seconds": seconds,
        "megabytes": seconds * _BAUD_BYTES / 1e6,
        "memory_growth_kilobytes": (max(sizes[len(sizes) // 2 :]) - sizes[len(sizes) // 4]) / 1e3,
        "processor_share": spent / seconds,
        "samples_after": sum(o.topic == "imu/data" for o in outputs),
    }


def main() -> None:
    """Measure and write the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=3, help="of the textbook aeroplane")
    parser.add_argument("--garbage", type=float, default=600.0, help="seconds of garbage")
    args = parser.parse_args()
    result = {"duration": DURATION, "loss": LOSS, "drift_ppm": 1e6 * DRIFT, "jitter_ms": 1e3 * LINK.jitter}
    result |= {"restart": restart(), "garbage": garbage(args.garbage), **identification(args.flights)}
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(f"written to {RESULT}")


if __name__ == "__main__":
    main()
