"""Estimates of JSBSim's aeroplanes against derivatives that JSBSim's own forces give: a truth that is not ours.

    python benchmarks/jsbsim_truth.py [--seeds 6] [--estimators rls,fourier,rml] [--aircraft c172p,J3Cub,c182]

Each seed flies twice in calm air with its own wind, biases and sensor noise; the second flight is held out.
Truth (a), (b): see aircraft_sysid_ros/simulation/jsbsim_derivatives.py.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.simulation.jsbsim_derivatives import (
    WindTunnel,
    flight_projection,
    flown_steps,
    local_derivatives,
    model_nrmse,
)
from aircraft_sysid_ros.simulation.jsbsim_flight import MODELS, signals_of
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, simulate_jsbsim_samples

DURATION = 150.0
HELD_OUT = 1000  # what is added to the seed of a flight for its second
MAIN_DERIVATIVES = (
    "CX_alpha2", "CX_Tc", "CY_beta", "CY_dr", "CZ_alpha", "Cl_beta", "Cl_p", "Cl_r", "Cl_da",
    "Cm_alpha", "Cm_q", "Cm_de", "Cn_beta", "Cn_r", "Cn_dr",
)  # fmt: skip
#: Slopes of JSBSim that the 32 terms have no place for.
OUTSIDE = (("CZ", "alpha_dot"), ("Cm", "alpha_dot"), ("Cm", "Tc"), ("Cl", "Tc"), ("Cm", "r"), ("Cn", "q"))


def fly(name: str, seed: int) -> SimulatedFlight:
    """The flight of one seed: wind of up to 6 m/s from any side."""
    random = np.random.default_rng(2000 + seed)
    speed, direction = random.uniform(0.0, 6.0), random.uniform(-np.pi, np.pi)
    return simulate_jsbsim_samples(
        name, seed, DURATION, wind=(speed * np.cos(direction), speed * np.sin(direction), 0.0)
    )


def options(estimator: str) -> ParameterOptions:
    """Options of an estimator; InputError where this version does not have it."""
    if "estimator" in {f.name for f in fields(ParameterOptions)}:
        return ParameterOptions(**{"estimator": estimator})  # type: ignore[arg-type]
    if estimator != "rls":
        raise InputError(f"this version has no estimator '{estimator}': use rls")
    return ParameterOptions()


def estimate(aircraft: Aircraft, flight: SimulatedFlight, held_out: SimulatedFlight, estimator: str) -> dict[str, Any]:
    """One model from the sensors of a flight: parameters beside (b), and errors on the flight that was held out."""
    pipeline = Pipeline(aircraft, None, options(estimator))
    pipeline.push(flight.samples)
    pipeline.flush()
    found = pipeline.parameters.snapshot().parameters
    projected, in_sample = flight_projection(aircraft.model, aircraft, flight.truth)
    other = held_out.truth[::4]
    signals, true = signals_of(aircraft, other), other.coefficients
    # what was never learnt stays NaN: it is then taken from nothing, and says so
    values = {p.name: p.value for p in found}
    return {
        "parameters": {
            p.name: {"value": p.value, "std": p.std, "status": Trust(p.status).name, "projection": projected[p.name]}
            for p in found
        },
        "projection_nrmse": in_sample,
        "held_out": model_nrmse(aircraft.model, values, signals, true),
        "held_out_projection": model_nrmse(aircraft.model, projected, signals, true),
    }


def run_seed(name: str, seed: int, estimators: list[str]) -> dict[str, Any]:
    """Both models on one flight: the 32 terms with every estimator, the added terms with the first."""
    flight, held_out = fly(name, seed), fly(name, seed + HELD_OUT)
    local, ranges = local_derivatives(name, flight.aircraft, flight.truth)
    slopes = WindTunnel(name).slopes(flown_steps(flight.aircraft, flight.truth))
    added = load_aircraft(config_path(f"jsbsim_{name.lower()}.yaml"))
    return {
        "local": local,
        "local_range": ranges,
        "outside": {f"{axis}_{variable}": slopes.slope(axis, variable) for axis, variable in OUTSIDE},
        "textbook": {e: estimate(flight.aircraft, flight, held_out, e) for e in estimators},
        "added": estimate(added, flight, held_out, estimators[0]),
    }


def summarise_model(results: list[dict[str, Any]]) -> dict[str, Any]:
    """Medians over the flights of one model and estimator."""
    table: dict[str, dict[str, Any]] = {}
    all_scores, used = [], []
    for name in results[0]["parameters"]:
        rows = [r["parameters"][name] for r in results]
        value, std, projected = (np.array([row[k] for row in rows]) for k in ("value", "std", "projection"))
        scores = (value - projected) / std
        all_scores.append(scores)
        used.append(np.array([row["status"] == "USE" for row in rows]))
        table[name] = {
            "value": float(np.median(value)),
            "std": float(np.median(std)),
            "projection": float(np.median(projected)),
            "relative_error": float(np.median(np.abs(value - projected) / np.abs(projected))),
            "within_3_sigma": float(np.mean(np.abs(scores) <= 3.0)),
            "use": float(np.mean(used[-1])),
        }
    inside, use = np.abs(np.array(all_scores)) <= 3.0, np.array(used)
    medians = {
        key: {axis: float(np.median([r[key][axis] for r in results])) for axis in AXES}
        for key in ("projection_nrmse", "held_out", "held_out_projection")
    }
    return {
        "parameters": table,
        "pairs": int(inside.size),
        "within_3_sigma": float(inside.mean()),
        "use_share": float(use.mean()),
        "use_within_3_sigma": float(inside[use].mean()) if use.any() else None,
        **medians,
    }


def summarise(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """One aircraft: truth (a), its range, what lies outside, both models."""
    names = runs[0]["local"]
    local = {n: float(np.median([r["local"][n] for r in runs])) for n in names}
    estimators = {e: summarise_model([r["textbook"][e] for r in runs]) for e in runs[0]["textbook"]}
    for summary in estimators.values():
        errors = [summary["parameters"][n]["relative_error"] for n in MAIN_DERIVATIVES]
        summary["median_relative_error"] = float(np.median(errors))
    return {
        "flights": len(runs),
        "main_derivatives": list(MAIN_DERIVATIVES),
        "local": local,
        "local_range": {n: [min(r["local_range"][n][0] for r in runs), max(r["local_range"][n][1] for r in runs)]
                        for n in names},
        "outside": {n: float(np.median([r["outside"][n] for r in runs])) for n in runs[0]["outside"]},
        "textbook": estimators,
        "added": summarise_model([r["added"] for r in runs]),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--estimators", default="rls,rml", help="separated by commas (default: %(default)s)")
    parser.add_argument("--aircraft", default=",".join(MODELS), help="separated by commas (default: all)")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "jsbsim_truth.json")
    arguments = parser.parse_args()
    estimators, names = arguments.estimators.split(","), arguments.aircraft.split(",")
    jobs = [(name, seed) for name in names for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(2) as pool:
        runs = list(pool.map(run_seed, *zip(*jobs, strict=True), [estimators] * len(jobs)))
    result = {
        "duration": DURATION,
        "aircraft": {n: summarise([r for (job, _), r in zip(jobs, runs, strict=True) if job == n]) for n in names},
    }
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(f"written: {arguments.out}")


if __name__ == "__main__":
    main()
