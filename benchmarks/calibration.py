"""Calibrations against the truth of simulated flights, and on a real probe: results for docs/calibration.md.

    python benchmarks/calibration.py [--truths 100] [--others 20] [--data ../shared/data]

Every flight is one line of benchmarks/results/calibration_runs.jsonl: a stopped benchmark goes on where it was. The
summary is benchmarks/results/calibration.json. Flights with 100 truths of the probe have errors drawn evenly within the
constraints of Table 6 of the two-stage paper and a steady wind of 1 to 10 m/s; the constants of the code were chosen
with seeds below FIRST in sight, these are others.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from calibration_thor import thor

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.calibration import compatibility, five_hole_probe, magnetometer
from aircraft_sysid_ros.calibration.procedure import residuals, solve
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.estimation.two_stage.comparison import nonlinear_programming
from aircraft_sysid_ros.estimation.two_stage.estimate import estimate
from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.sensors.sensor_models import EPOCH, SensorOptions, air_data_at
from aircraft_sysid_ros.simulation.calibration_flight import CALIBRATION_AIRCRAFT, calibration_flight
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight

Array = npt.NDArray[np.float64]

RESULTS = Path(__file__).parent / "results"
RUNS, SUMMARY = RESULTS / "calibration_runs.jsonl", RESULTS / "calibration.json"
FIRST = 1000
RANDOM_STARTS = 5
THINNING = 5
#: The same minimum: every unknown nearer to that from the truth than this share of half its range.
SAME = 0.02


def truth_of(flight: SimulatedFlight, section: str) -> dict[str, float]:
    """True parameters of a calibration, the wind too."""
    wind = flight.truth.wind.mean(axis=0)
    known = {**flight.calibration[section], **dict(zip(("W_N", "W_E", "W_D"), map(float, wind), strict=True))}
    for name, axes, biases in (("b_a", "xyz", flight.biases.accelerometer), ("b_", "pqr", flight.biases.gyro)):
        known.update({name + axis: float(column.mean()) for axis, column in zip(axes, biases.T, strict=True)})
    return known


def compared(names: tuple[str, ...], values: Array, std: Array, truth: dict[str, float]) -> dict[str, list[float]]:
    """Estimate, standard error and truth by parameter."""
    rows = zip(names, values, std, strict=True)
    return {name: [float(value), float(error), truth[name]] for name, value, error in rows}


def reached(problem: Problem, xi: Array, reference: Array) -> bool:
    """Whether an optimisation ended where that from the truth does."""
    half = 0.5 * (problem.bounds[:, 1] - problem.bounds[:, 0])
    return bool(np.all(np.abs(xi - reference) <= SAME * half))


def probe_run(seed: int) -> dict[str, Any]:
    """One flight: two stages, one stage from zero and from random starts."""
    flight = calibration_flight(seed)
    made = five_hole_probe.probe_flight(flight.samples, flight.aircraft)
    task, truth = made.task(), truth_of(flight, "five_hole_probe")
    problem = task.problem
    started = time.perf_counter()
    answer, steady = made.solve()
    elapsed = time.perf_counter() - started
    plain = solve(replace(task, instruments=None), 64)  # the paper's estimator: without the instrumental step
    at_truth = np.array([truth[name] for name in problem.names])
    every_fifth = np.arange(len(made.data.indicated)) % THINNING == 0  # some optimisers take thousands of steps
    thinned = made.data[every_fifth].problem()
    one = lambda xi, method="gauss-newton": nonlinear_programming(thinned, *np.split(xi, [problem.n1]), method)  # noqa: E731
    reference = one(at_truth)
    best = np.concatenate([reference.xi1, reference.xi2])
    rng = np.random.default_rng([seed, 7])
    starts = rng.uniform(*problem.bounds.T, (RANDOM_STARTS, len(best)))
    ends = {
        "two_stage": [estimate(thinned).xi],
        "one_stage_zero": [one(np.zeros(len(best)))], "one_stage_random": map(one, starts),
        "sqp_zero": [one(np.zeros(len(best)), "sqp")], "sqp_random": [one(starts[0], "sqp")],
    }  # fmt: skip
    unpacked = {
        name: [end if isinstance(end, np.ndarray) else np.concatenate([end.xi1, end.xi2]) for end in found]
        for name, found in ends.items()
    }
    return {
        "parameters": compared(problem.names, answer.xi, answer.std, truth),
        "least_squares": compared(problem.names, plain.xi, plain.std, truth),
        "white_std": np.sqrt(np.diag(answer.errors.white)).tolist(),
        "reached": {name: [reached(thinned, xi, best) for xi in found] for name, found in unpacked.items()},
        "velocity_rms": np.sqrt(np.mean(residuals(problem, answer.xi) ** 2, axis=0)).tolist(),
        "noise_std": np.sqrt(answer.noise).tolist(),
        "airspeed_rms": airspeed_rms(flight, made, answer.xi),
        "steady": steady, "alone": answer.alone, "elapsed": elapsed, "samples": len(answer.samples.trace),
    }  # fmt: skip


def airspeed_rms(flight: SimulatedFlight, made: five_hole_probe.ProbeFlight, xi: Array) -> float:
    """Rms [m/s] of the calibrated airspeed against the true one at the probe."""
    time_of_flight = made.navigation.time + (made.navigation.epoch - EPOCH) * 1e-9
    true = air_data_at(flight.truth.at(time_of_flight), flight.aircraft.air_data_position)[:, 0]
    calibrated = (1.0 + xi[0]) * made.data.indicated + xi[1]
    return float(np.sqrt(np.mean((calibrated - true) ** 2)))


def magnetic_run(seed: int) -> dict[str, Any]:
    """Magnetometer: the strength of the field is known."""
    flight = calibration_flight(seed)
    strength = float(np.hypot(1.7e-5, 5.1e-5))  # of simulation.sensors
    made = magnetometer.magnetic_flight(flight.samples, flight.aircraft, strength=strength)
    answer = solve(made.task())
    truth = {**truth_of(flight, "magnetometer"), "inclination": float(np.arctan2(5.1, 1.7))}
    field = np.linalg.solve(
        magnetometer.sensor_matrix(answer.xi[:3], answer.xi[6:]), (made.data.measured - answer.xi[3:6]).T
    ).T
    spread = [float(np.std(np.linalg.norm(h, axis=1)) / strength) for h in (made.data.measured, field)]
    return {"parameters": compared(answer.problem.names, answer.xi, answer.std, truth), "spread": spread}


def compatibility_run(seed: int) -> dict[str, Any]:
    """Data compatibility, and output error from zero on the same problem."""
    flight = calibration_flight(seed, aircraft=constant_biases(), sensors=SensorOptions(attitude=True))
    made = compatibility.compatibility_flight(flight.samples, flight.aircraft)
    answer, data = made.solve(16)
    problem = data.problem()
    zero = nonlinear_programming(problem, np.zeros(problem.n1), np.zeros(problem.n2))
    xi = np.concatenate([zero.xi1, zero.xi2])
    truth = truth_of(flight, "compatibility")
    return {
        "parameters": compared(problem.names, answer.xi, answer.std, truth),
        "reached": {"output_error_zero": [bool(np.all(np.abs(xi - answer.xi) <= 0.1 * answer.std))]},
    }


def constant_biases() -> Aircraft:
    """The aeroplane with IMU biases that do not walk, as (B5) has them."""
    source = load_aircraft(config_path(CALIBRATION_AIRCRAFT)).source
    walks = {**source["process_noise"], "accelerometer_bias": 0.0, "gyro_bias": 0.0}
    return aircraft_from_dict({**source, "process_noise": walks})


KINDS: dict[str, Callable[[int], dict[str, Any]]] = {
    "probe": probe_run, "magnetometer": magnetic_run, "compatibility": compatibility_run,
}  # fmt: skip


def summarise(runs: list[dict[str, Any]], kind: str) -> dict[str, Any]:
    """Errors of all parameters against their standard errors, and shares."""
    chosen = [run for run in runs if run["kind"] == kind]
    if not chosen:
        return {"flights": 0}
    out: dict[str, Any] = {"flights": len(chosen), "parameters": errors(chosen, "parameters")}
    if kind == "probe":
        out["least_squares"] = errors(chosen, "least_squares")
        out["velocity_rms"] = np.sqrt(np.mean(np.square([run["velocity_rms"] for run in chosen]), axis=0)).tolist()
        out["noise_std"] = np.median([run["noise_std"] for run in chosen], axis=0).tolist()
        rms = [run["airspeed_rms"] for run in chosen]
        out["airspeed_rms"] = {"median": float(np.median(rms)), "largest": float(np.max(rms))}
        out["elapsed"] = float(np.median([run["elapsed"] for run in chosen]))
        out["samples"] = chosen[0]["samples"]
        out["steady"] = float(np.mean([run["steady"] for run in chosen]))
        out["alone"] = float(np.mean([run["alone"] for run in chosen]))
        white = np.array([run["white_std"] for run in chosen])
        std = np.array([[row[1] for row in run["parameters"].values()] for run in chosen])
        out["std_over_white"] = float(np.median(std / white))
    if kind == "magnetometer":
        out["spread"] = np.median([run["spread"] for run in chosen], axis=0).tolist()
    if "reached" in chosen[0]:
        names = chosen[0]["reached"]
        out["reached"] = {n: float(np.mean([hit for run in chosen for hit in run["reached"][n]])) for n in names}
        out["starts"] = {n: sum(len(run["reached"][n]) for run in chosen) for n in names}
    return out


def errors(runs: list[dict[str, Any]], key: str) -> dict[str, dict[str, float]]:
    """By parameter: rms error, median standard error, rms of error over standard error, share within 2."""
    out = {}
    for name in runs[0][key]:
        rows = np.array([run[key][name] for run in runs], dtype=float)
        known = np.isfinite(rows[:, 1])
        error, std = rows[known, 0] - rows[known, 2], rows[known, 1]
        out[name] = {
            "determined": float(np.mean(known)), "rms_error": float(np.sqrt(np.mean(error**2))),
            "median_std": float(np.median(std)), "rms_z": float(np.sqrt(np.mean((error / std) ** 2))),
            "within_2": float(np.mean(np.abs(error) <= 2.0 * std)), "mean_z": float(np.mean(error / std)),
        }  # fmt: skip
    return out


def load_runs() -> list[dict[str, Any]]:
    """What has been flown."""
    lines = RUNS.read_text(encoding="utf8").splitlines() if RUNS.exists() else []
    return [json.loads(line, parse_constant=lambda _: float("nan")) for line in lines]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truths", type=int, default=100, help="of the probe")
    parser.add_argument("--others", type=int, default=20, help="of magnetometer and compatibility")
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[2] / "shared" / "data")
    arguments = parser.parse_args()
    RESULTS.mkdir(exist_ok=True)
    runs = load_runs()
    done = {(run["kind"], run["seed"]) for run in runs}
    counts = {"probe": arguments.truths, "magnetometer": arguments.others, "compatibility": arguments.others}
    for kind, count in counts.items():
        for seed in range(FIRST, FIRST + count):
            if (kind, seed) in done:
                continue
            runs.append({"kind": kind, "seed": seed, **KINDS[kind](seed)})
            with RUNS.open("a", encoding="utf8") as file:
                file.write(json.dumps(runs[-1]) + "\n")
            print(f"{kind} {seed}", flush=True)
    result = {kind: summarise(runs, kind) for kind in KINDS}
    before = json.loads(SUMMARY.read_text(encoding="utf8")) if SUMMARY.exists() else {}
    flight = arguments.data / "umn_thor_flight75" / "flight75.mat"
    result["thor"] = thor(flight) if flight.exists() else before.get("thor")
    SUMMARY.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
