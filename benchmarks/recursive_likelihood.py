"""Recursive maximum likelihood beside recursive least squares: errors, coverage, and the share of a processor.

    python benchmarks/recursive_likelihood.py [--seeds 10] [--out benchmarks/results/recursive_likelihood.json]

Flights of 90 s of benchmarks/accuracy.py, in calm air and in light turbulence. Both estimators see the same states.
The constants of the learner were chosen with seeds 0 to 9 in sight: the flights here are others.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.identification.estimators.likelihood_state import LEARNT
from aircraft_sysid_ros.identification.estimators.maximum_likelihood import MaximumLikelihoodEstimator
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, simulate_samples

DURATION = 90.0
FIRST_SEED = 100
ESTIMATORS = ("rls", "rml")
TURBULENCE = ("none", "light")


def fly(seed: int, turbulence: str) -> SimulatedFlight:
    """A flight with its own wind of up to 6 m/s."""
    random = np.random.default_rng(1000 + seed)
    speed, direction = random.uniform(0.0, 6.0), random.uniform(-np.pi, np.pi)
    wind = (speed * np.cos(direction), speed * np.sin(direction), 0.0)
    aircraft = load_aircraft(config_path("ultra_stick_25e.yaml"))
    return simulate_samples(aircraft, seed, DURATION, wind=wind, turbulence=turbulence)


def run_seed(seed: int, turbulence: str) -> dict[str, Any]:
    """Estimates of both estimators on one flight."""
    flight = fly(seed, turbulence)
    result: dict[str, Any] = {}
    for estimator in ESTIMATORS:
        pipeline = Pipeline(flight.aircraft, None, ParameterOptions(estimator=estimator))
        pipeline.push(flight.samples)
        pipeline.flush()
        result[estimator] = {
            p.name: [p.value, p.std, flight.aircraft.coefficients[p.name], p.status == Trust.USE]
            for p in pipeline.parameters.snapshot().parameters
        }
        learner = pipeline.parameters.learning.estimator
        if isinstance(learner, MaximumLikelihoodEstimator):
            result["restarts"], result["levels"] = learner.restarts, learner.noise_levels()
    return result


def summarise(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage and errors of both estimators, over all parameters and flights."""
    result: dict[str, Any] = {"seeds": len(runs), "duration": DURATION}
    rows = {e: np.array([list(run[e].values()) for run in runs], dtype=float) for e in ESTIMATORS}
    names = list(runs[0]["rml"])
    for estimator in ESTIMATORS:
        value, std, truth, used = np.moveaxis(rows[estimator], -1, 0)
        z = (value - truth) / std
        result[estimator] = {
            "within_95": float(np.mean(np.abs(z) <= 1.96)),
            "within_3_sigma": float(np.mean(np.abs(z) <= 3.0)),
            "use_share": float(np.mean(used)),
            "use_within_95": float(np.mean(np.abs(z[used > 0]) <= 1.96)),
            "rms_z": float(np.sqrt(np.mean(z**2))),
            "median_relative_error": float(np.median(np.abs(value / truth - 1.0))),
            "bias_over_std": {n: round(float(b), 2) for n, b in zip(names, z.mean(axis=0), strict=True)},
            "least_covered": _least_covered(names, np.mean(np.abs(z) <= 1.96, axis=0)),
        }
    error = {e: np.sqrt(np.mean((rows[e][..., 0] - rows[e][..., 2]) ** 2, axis=0)) for e in ESTIMATORS}
    result["median_error_rml_over_rls"] = float(np.median(error["rml"] / error["rls"]))
    result["restarts"] = int(sum(run["restarts"] for run in runs))
    levels = {name: float(np.median([run["levels"][name] for run in runs])) for name in runs[0]["levels"]}
    result["median_noise_levels"] = levels
    return result


def _least_covered(names: list[str], share: np.ndarray[Any, Any]) -> dict[str, float]:
    return {names[i]: float(share[i]) for i in np.argsort(share, kind="stable")[:5]}


def speed(rate: float) -> dict[str, float]:
    """Time that the learner takes of each sample of the IMU that it is given, as the live node calls it."""
    flight = fly(0, "none")
    options = ParameterOptions(estimator="rml", rml_rate=rate)
    pipeline = Pipeline(flight.aircraft, None, options)
    pipeline.warm_up()
    learner = pipeline.parameters.learning.estimator
    assert isinstance(learner, MaximumLikelihoodEstimator)
    spent = 0.0
    push, push_samples = learner.push, learner.push_samples

    def timed(call: Any) -> Any:
        def run(*arguments: Any) -> Any:
            nonlocal spent
            begin = time.process_time()
            result = call(*arguments)
            spent += time.process_time() - begin
            return result

        return run

    learner.push, learner.push_samples = timed(push), timed(push_samples)  # type: ignore[method-assign]
    samples = flight.samples
    starts = np.flatnonzero(samples.kind == Kind.IMU)
    for begin, end in itertools.pairwise(starts):  # one IMU sample at a time
        pipeline.push(samples[begin:end])
    learnt = float(learner.recursion.clock[LEARNT])
    return {
        "rate": rate,
        "parameters": len(learner.recursion.free),
        "filters": len(learner.recursion.states),
        "share_of_a_core": spent / learnt,
        "microseconds_per_step": 1e6 * spent / learnt / rate,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "recursive_likelihood.json")
    arguments = parser.parse_args()
    result: dict[str, Any] = {"speed": [speed(50.0), speed(100.0)]}
    with ProcessPoolExecutor(2) as pool:
        for turbulence in TURBULENCE:
            seeds = range(FIRST_SEED, FIRST_SEED + arguments.seeds)
            runs = list(pool.map(run_seed, seeds, [turbulence] * arguments.seeds))
            result[turbulence] = summarise(runs)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
