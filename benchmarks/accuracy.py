"""Accuracy of the chain on simulated flights with light noise: are errors as large as standard errors say?

    python benchmarks/accuracy.py [--seeds 50] [--out benchmarks/results/accuracy.json]

Each seed flies the test flight of config/ultra_stick_25e.yaml for 120 s with its own wind, biases and noise.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.aircraft.frames import (
    quaternion_conjugate,
    quaternion_log,
    quaternion_product,
    rotation_matrix,
)
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import ERROR_SIZE
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, simulate_samples

DURATION = 120.0
EARLY = 10.0  # [s] after the start, before the first turn
SETTLED = 20.0  # [s] from when on innovations are counted: before, the filter still allows for gusts
TURBULENCE = {"light": 20, "moderate": 20}  # flights besides those in calm air
MAIN_DERIVATIVES = (
    "CX_alpha2", "CX_Tc", "CY_beta", "CY_dr", "CZ_alpha", "Cl_beta", "Cl_p", "Cl_r", "Cl_da",
    "Cm_alpha", "Cm_q", "Cm_de", "Cn_beta", "Cn_r", "Cn_dr",
)  # fmt: skip


def fly(seed: int, turbulence: str = "none") -> SimulatedFlight:
    """The flight of one seed: wind of up to 6 m/s from any side."""
    random = np.random.default_rng(1000 + seed)
    speed, direction = random.uniform(0.0, 6.0), random.uniform(-np.pi, np.pi)
    wind = (speed * np.cos(direction), speed * np.sin(direction), 0.0)
    aircraft = load_aircraft(config_path("ultra_stick_25e.yaml"))
    return simulate_samples(aircraft, seed, DURATION, wind=wind, turbulence=turbulence)


def state_error(flight: SimulatedFlight, pipeline: Pipeline) -> np.ndarray[Any, Any]:
    """Error (18,) of the newest state, truth minus estimate, in the filter's error coordinates."""
    estimator = pipeline.state
    assert estimator.epoch is not None and estimator.last_row is not None
    start = int(flight.biases.stamp[0])
    time = estimator.last_row[0] + (estimator.epoch - start) * 1e-9
    truth = flight.truth.at([time])
    x = estimator.state_vector
    arm = flight.aircraft.imu_position
    c = rotation_matrix(truth.quaternion[0])
    geodetic_origin = estimator.last_row[57:60]
    from aircraft_sysid_ros.aircraft.earth import ned_between

    shift = ned_between(geodetic_origin, flight.truth.origin)
    error = np.empty(ERROR_SIZE)
    error[0:3] = truth.velocity[0] + c @ np.cross(truth.rates[0], arm) - x[0:3]
    error[3:6] = truth.position[0] + shift + c @ arm - x[3:6]
    error[6:9] = quaternion_log(quaternion_product(quaternion_conjugate(x[6:10]), truth.quaternion[0]))
    nearest = int(np.argmin(np.abs(flight.biases.stamp - start - time * 1e9)))
    error[9:12] = flight.biases.accelerometer[nearest] - x[10:13]
    error[12:15] = flight.biases.gyro[nearest] - x[13:16]
    error[15:18] = truth.air_velocity[0] + np.cross(truth.rates[0], arm) - x[16:19]
    return error


def run_seed(seed: int, turbulence: str = "none") -> dict[str, Any]:
    """Errors of one flight."""
    flight = fly(seed, turbulence)
    pipeline = Pipeline(flight.aircraft)
    begin = flight.biases.stamp[0]
    early, settled = (int(np.searchsorted(flight.samples.stamp, begin + int(t * 1e9))) for t in (EARLY, SETTLED))
    pipeline.push(flight.samples[:early])
    z_early = state_error(flight, pipeline) / np.sqrt(np.diag(pipeline.state.covariance))
    pipeline.push(flight.samples[early:settled])
    memory = pipeline.state.memory
    nis_sum, degrees = memory.nis_sum.copy(), memory.degrees.copy()
    pipeline.push(flight.samples[settled:])
    pipeline.flush()
    error, covariance = state_error(flight, pipeline), pipeline.state.covariance
    parameters = {
        p.name: {
            "value": p.value,
            "std": p.std,
            "truth": flight.aircraft.coefficients[p.name],
            "status": Trust(p.status).name,
            "excitation": p.excitation,
        }
        for p in pipeline.parameters.snapshot().parameters
    }
    fused = [kind for kind in Kind if memory.degrees[kind]]
    return {
        "seed": seed,
        "parameters": parameters,
        "z_early": z_early.tolist(),
        "z_late": (error / np.sqrt(np.diag(covariance))).tolist(),
        "nees": float(error @ np.linalg.solve(covariance, error)),
        "nis": {k.name: [float((memory.nis_sum - nis_sum)[k]), int((memory.degrees - degrees)[k])] for k in fused},
        "rejected": int(memory.rejected.sum()),
    }


def summarise(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures over all seeds."""
    from scipy.stats import chi2

    z, used_z, relative = [], [], {name: [] for name in MAIN_DERIVATIVES}
    per_parameter: dict[str, list[float]] = {}
    for run in runs:
        for name, p in run["parameters"].items():
            score = (p["value"] - p["truth"]) / p["std"]
            if p["excitation"] >= 3.0:
                z.append(score)
                per_parameter.setdefault(name, []).append(score)
            if p["status"] == "USE":
                used_z.append(score)
            if name in relative:
                relative[name].append(abs(p["value"] / p["truth"] - 1.0))
    early, late = (np.array([run[key] for run in runs]) for key in ("z_early", "z_late"))
    nees = np.array([run["nees"] for run in runs])
    n = len(runs)
    shares = {name: float(np.mean(np.abs(v) <= 3.0)) for name, v in per_parameter.items()}
    return {
        "seeds": n,
        "duration": DURATION,
        "pairs": len(z),
        "within_3_sigma": float(np.mean(np.abs(z) <= 3.0)),
        "within_2_sigma": float(np.mean(np.abs(z) <= 1.96)),
        "use_pairs": len(used_z),
        "use_within_3_sigma": float(np.mean(np.abs(used_z) <= 3.0)),
        "worst_parameters": dict(sorted(shares.items(), key=lambda item: item[1])[:5]),
        "median_relative_error": {name: float(np.median(v)) for name, v in relative.items()},
        "median_relative_error_all": float(np.median(np.concatenate(list(relative.values())))),
        "bias_and_wind_within_3_sigma": float(np.mean(np.abs(late[:, 9:]) <= 3.0)),
        "z_early": np.sqrt(np.mean(early**2, axis=0)).tolist(),
        "z_late": np.sqrt(np.mean(late**2, axis=0)).tolist(),
        "nees": {
            "mean": float(nees.mean()),
            "low": float(chi2.ppf(0.025, n * ERROR_SIZE) / n),
            "high": float(chi2.ppf(0.975, n * ERROR_SIZE) / n),
        },
        "nis": innovation_consistency(runs),
        "rejected": int(sum(run["rejected"] for run in runs)),
    }


def coverage(summary: dict[str, Any], runs: list[dict[str, Any]]) -> dict[str, Any]:
    """What is asked of flights in turbulence: how far standard errors can be trusted, and which least."""
    inside: dict[str, list[bool]] = {}
    for run in runs:
        for name, p in run["parameters"].items():
            if p["status"] == "USE":
                inside.setdefault(name, []).append(abs(p["value"] - p["truth"]) <= 3.0 * p["std"])
    worst = sorted(((float(np.mean(v)), name, len(v)) for name, v in inside.items() if len(v) > 4))[:4]
    return {
        "seeds": len(runs),
        "use_share": summary["use_pairs"] / (32 * len(runs)),
        "use_within_3_sigma": summary["use_within_3_sigma"],
        "worst": {name: share for share, name, _ in worst},
        "median_relative_error_all": summary["median_relative_error_all"],
        "median_relative_error": summary["median_relative_error"],
        "nees_mean": summary["nees"]["mean"],
        "bias_and_wind_within_3_sigma": summary["bias_and_wind_within_3_sigma"],
    }


def innovation_consistency(runs: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Normalised innovation squared per degree of freedom, by kind, and where 95 % of them should be."""
    from scipy.stats import chi2

    result = {}
    for name in runs[0]["nis"]:
        total, degrees = np.sum([run["nis"][name] for run in runs], axis=0)
        low, high = (float(chi2.ppf(q, degrees) / degrees) for q in (0.025, 0.975))
        result[name] = {"mean": float(total / degrees), "low": low, "high": high}
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "accuracy.json")
    arguments = parser.parse_args()
    run_seed(0)  # compile once, before the workers
    with ProcessPoolExecutor(2) as pool:
        runs = list(pool.map(run_seed, range(arguments.seeds)))
        result = summarise(runs)
        for turbulence, seeds in TURBULENCE.items():
            runs = list(pool.map(run_seed, range(seeds), [turbulence] * seeds))
            result[turbulence] = coverage(summarise(runs), runs)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
