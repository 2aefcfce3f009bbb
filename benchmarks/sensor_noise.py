"""What an aircraft file without any noise costs, and what finding it in flight brings back.

    python benchmarks/sensor_noise.py [--seeds 4]

The same flights of 60 s with three files, all with mass, shape and places: the defaults stated as noise, which is what
a file without noise was before it was found in flight; no noise, so that it is found; and the true noise. The noise of
all sensors is a multiple of the defaults, or as in ``MIXED``, IMU, air data and attitude come at most at the rate that
the table gives, messages carry no covariance. Flights of the project's own simulator and of JSBSim's c172p.
Writes results/sensor_noise.json. Seeds were drawn before anything was tuned.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from accuracy import state_error
from jsbsim_truth import flight_projection

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.sensor_settings import DEFAULT_PROCESS_NOISE, DEFAULT_SENSORS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions, arrived, measure
from aircraft_sysid_ros.simulation.simulated_flight import (
    SimulatedFlight,
    default_aircraft,
    simulate_jsbsim_samples,
    simulate_samples,
)

RESULT = Path(__file__).parent / "results" / "sensor_noise.json"
FIRST_SEED, DURATION, SETTLED = 9100, 60.0, 20.0
MIXED = {"accelerometer": 0.5, "gyro": 0.4, "attitude": 0.3, "airspeed": 4.0, "angle_of_attack": 2.0, "sideslip": 2.0}
#: Simulator, factor on the default noise (0: MIXED), rate [Hz], turbulence.
CELLS = (
    *(("own", factor, rate, "none") for factor in (0.3, 1.0, 4.0) for rate in (100.0, 50.0, 10.0)),
    ("own", 0.3, 100.0, "light"), ("own", 4.0, 100.0, "light"),
    ("own", 0.0, 100.0, "none"), ("own", 0.0, 50.0, "light"),
    ("jsbsim", 0.3, 100.0, "none"), ("jsbsim", 0.3, 50.0, "light"), ("jsbsim", 2.0, 50.0, "none"),
)  # fmt: skip
MAIN = ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr")
FILES = ("defaults", "found", "stated")
_RATED = ("accelerometer", "gyro", "attitude", "airspeed", "angle_of_attack", "sideslip", "static_pressure")


def noise_of(name: str, factor: float) -> list[float]:
    """The true noise of a sensor."""
    return [(factor or MIXED.get(name, 1.0)) * value for value in DEFAULT_SENSORS[name].noise]


def real(aircraft: Aircraft, factor: float, rate: float) -> Aircraft:
    """The aeroplane with the sensors that it really has."""
    return replace(
        aircraft,
        sensors={
            name: replace(
                sensor,
                noise=tuple(noise_of(name, factor)) if name != "control_surfaces" else sensor.noise,
                rate=min(rate, DEFAULT_SENSORS[name].rate) if name in _RATED else sensor.rate,
                delay=0.0,
            )
            for name, sensor in aircraft.sensors.items()
        },
    )


def fly(cell: tuple[str, float, float, str], seed: int) -> SimulatedFlight:
    """The flight of one seed: wind of up to 6 m/s from any side."""
    simulator, factor, rate, air = cell
    random = np.random.default_rng(1000 + seed)
    speed, direction = random.uniform(0.0, 6.0), random.uniform(-np.pi, np.pi)
    wind, sensors = (speed * np.cos(direction), speed * np.sin(direction), 0.0), SensorOptions(attitude=True)
    if simulator == "own":
        return simulate_samples(
            real(default_aircraft(), factor, rate), seed, DURATION, wind=wind, turbulence=air, sensors=sensors
        )
    flight = simulate_jsbsim_samples("c172p", seed, DURATION, wind=wind, turbulence=air, fitted=True, wind_walk=0.03)
    streams, biases = measure(real(flight.aircraft, factor, rate), flight.truth, seed, sensors)
    return replace(flight, streams=streams, biases=biases)


def files(flight: SimulatedFlight, factor: float, air: str) -> dict[str, Aircraft]:
    """The three aircraft files of a flight."""
    source = {k: v for k, v in flight.aircraft.source.items() if k not in ("sensors", "process_noise", "coefficients")}
    default = {name: {"noise": list(sensor.noise)} for name, sensor in DEFAULT_SENSORS.items()}
    true = {name: {"noise": noise_of(name, factor)} for name in DEFAULT_SENSORS if name != "control_surfaces"}
    calm = {"wind": 0.03 if air == "none" else DEFAULT_PROCESS_NOISE["wind"]}
    surfaces = {"control_surfaces": {"noise": flight.aircraft.sensors["control_surfaces"].noise[0]}}
    kinds = {
        "defaults": {"sensors": {**default, **surfaces}, "process_noise": {"wind": DEFAULT_PROCESS_NOISE["wind"]}},
        "found": {"sensors": surfaces},
        "stated": {"sensors": {**true, **surfaces}, "process_noise": calm},
    }
    return {name: aircraft_from_dict({**source, **kinds[name]}) for name in FILES}


def without_variances(samples: Samples) -> Samples:
    """Samples as of messages without covariances."""
    values = samples.values.copy()
    values[samples.kind == Kind.IMU, 6:] = values[samples.kind == Kind.ATTITUDE, 4:] = np.nan
    values[samples.kind == Kind.GPS_POSITION, 3:] = np.nan
    return Samples(samples.stamp, samples.kind, values)


def one(flight: SimulatedFlight, samples: Samples, aircraft: Aircraft, truth: dict[str, float]) -> dict[str, Any]:
    """Errors of one flight with one file."""
    pipeline = Pipeline(aircraft)
    begin = int(np.searchsorted(samples.stamp, flight.biases.stamp[0] + int(SETTLED * 1e9)))
    pipeline.push(samples[:begin])
    memory = pipeline.state.memory
    nis, degrees = memory.nis_sum.copy(), memory.degrees.copy()
    pipeline.push(samples[begin:])
    pipeline.flush()
    error, covariance = state_error(flight, pipeline), pipeline.state.covariance
    seen = [p for p in pipeline.parameters.snapshot().parameters if np.isfinite(p.std) and p.excitation >= 3.0]
    used = [p for p in seen if p.status == Trust.USE]
    return {
        "main": [abs(p.value / truth[p.name] - 1.0) for p in seen if p.name in MAIN],
        "inside": [abs(p.value - truth[p.name]) < 1.96 * p.std for p in seen],
        "used_inside": [abs(p.value - truth[p.name]) < 1.96 * p.std for p in used],
        "wrong": sum(abs(p.value / truth[p.name] - 1.0) > 0.25 for p in used if p.name in MAIN),
        "nees": float(error @ np.linalg.solve(covariance, error)) / len(error),
        "nis": (memory.nis_sum - nis)[degrees < memory.degrees].sum() / max((memory.degrees - degrees).sum(), 1),
        "rejected": int(memory.rejected.sum()) / len(samples),
        "attitude": float(np.rad2deg(np.sqrt(np.mean(error[6:8] ** 2)))),
    }


def cell_of(job: tuple[tuple[str, float, float, str], int]) -> dict[str, Any]:
    """All files on one flight."""
    cell, seed = job
    flight = fly(cell, seed)
    aircraft = replace(flight, aircraft=files(flight, cell[1], cell[3])["stated"])
    samples = without_variances(arrived(flight.streams, flight.aircraft.inputs))
    truth = flight.coefficients or flight_projection(flight.aircraft.model, flight.aircraft, flight.truth)[0]
    return {name: one(aircraft, samples, file, truth) for name, file in files(flight, cell[1], cell[3]).items()}


def summarised(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of one cell and one file over its seeds."""
    joined = {key: [value for run in runs for value in run[key]] for key in ("main", "inside", "used_inside")}
    return {
        "main_error": float(np.median(joined["main"])) if joined["main"] else None,
        "inside": float(np.mean(joined["inside"])) if joined["inside"] else None,
        "seen": len(joined["inside"]),
        "used": len(joined["used_inside"]),
        "used_inside": float(np.mean(joined["used_inside"])) if joined["used_inside"] else None,
        "wrong": sum(run["wrong"] for run in runs),
        "nees": float(np.median([run["nees"] for run in runs])),
        "nis": float(np.mean([run["nis"] for run in runs])),
        "rejected": float(np.mean([run["rejected"] for run in runs])),
        "tilt_error": float(np.sqrt(np.mean(np.square([run["attitude"] for run in runs])))),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    jobs = [(cell, FIRST_SEED + number) for cell in CELLS for number in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.workers) as pool:
        found = list(pool.map(cell_of, jobs))
    lines = []
    for number, (simulator, factor, rate, air) in enumerate(CELLS):
        runs = found[number * arguments.seeds : (number + 1) * arguments.seeds]
        by_file = {name: summarised([run[name] for run in runs]) for name in FILES}
        lines.append({"simulator": simulator, "factor": factor, "rate": rate, "air": air, **by_file})
    result = {"seeds": arguments.seeds, "first_seed": FIRST_SEED, "duration": DURATION, "cells": lines}
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
